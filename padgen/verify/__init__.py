"""Finer models than a plan's: finite elements, magnetic fields, time domain.

Every model here is a rung of a ladder, with its error and its cost (`padgen study`). Heavy packages
are imported by the functions that use them.
"""
