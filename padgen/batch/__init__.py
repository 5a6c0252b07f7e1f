"""Batches of pad variants: what is varied, run over any executor, one row and one folder a variant.

`definition` reads a sweep and lists its variants, `variant` makes one (in a worker), `sweep` makes them all on whatever
runs them, `index` keeps what came of them and finds the best. `scheduler` connects to a Dask cluster.
"""
