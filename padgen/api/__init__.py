"""The public functions: what a command does, a notebook does by a function.

Their modules import what is heavy only when a function is called; `padgen` loads a function when it is first used.
"""
