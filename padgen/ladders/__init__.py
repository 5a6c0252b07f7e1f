"""Ladders of models, coarse to fine, each measured for error against run time (`padgen study`)."""
