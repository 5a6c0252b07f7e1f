"""Sweeps: many variants of a pad, computed in parallel, each with a row in a table and a folder of its own.

`definition` reads a sweep and lists its variants, `variant` makes one (in a worker), `sweep` makes them all on whatever
runs them, `index` keeps what came of them and finds the best. `scheduler` connects to a Dask cluster.
"""
