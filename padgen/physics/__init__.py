"""Formulas as pure functions on arrays, in SI units, with numpy only and the source of each.

"Paper" is Mohammadi, Abdelkhalek, Sadrafshari, *Resonance Frequency Selective Electromagnetic Actuation for
High-Resolution Vibrotactile Displays*.
"""
