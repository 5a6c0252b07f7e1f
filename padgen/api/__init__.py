"""Public functions, one or more for each command, for notebooks and programs.

Their modules import what is heavy only when a function is called; `padgen` loads a function when it is first used.
"""
