"""Measurements of a print → `Tuning`: what its taxels really are, and what the tones become.

`tuning` is the data that the driver reads; the rest makes it from spectra and time series.
"""
