"""Physics as pure functions on arrays: SI inside, numpy only, every formula with its source.

"Paper" is Mohammadi, Abdelkhalek, Sadrafshari, *Resonance Frequency Selective Electromagnetic
Actuation for High-Resolution Vibrotactile Displays*.
"""
