"""Error against run time: every ladder of models measured alike (`padgen study`)."""
