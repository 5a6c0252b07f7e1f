"""Batches of pad variants: what is varied, run over any executor, one row and one folder a variant.

`definition` reads a sweep with the conditions of `expression`, `points` lists its variants, `variant` makes one (in a
worker), `sweep` makes them all, `index` keeps what came of them, `pareto` finds the best. `executors` feeds whatever
runs them and starts the watched processes, `scheduler` connects to a Dask cluster.
"""
