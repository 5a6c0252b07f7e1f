"""From measurements of a print to its `Tuning`: the real resonance, Q and response of every taxel.

`tuning` defines the data that the driver reads; the other modules make them from tables, spectra and time series, find
the tones that suit the print, and judge a pad in a slicer's G-code.
"""
