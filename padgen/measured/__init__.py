"""From measurements of a print to its `Tuning`: the real resonance, Q and response of every taxel.

`tuning` defines the data that the driver reads; the other modules make them from tables, spectra and time series, and
find the tones that suit the print.
"""
