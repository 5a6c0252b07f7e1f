"""Batches of pad variants: what is varied, run over any executor, one row and one folder a variant.

`definition` reads a sweep, `points` lists its variants, `variant` makes one (in a worker), `run` makes them
all, `index` keeps what came of them. Between them, `window` holds what an executor has been given, `worker`
starts, feeds and ends the processes that `limits` watches, `lock` keeps a second sweep out of the folder, and
`events` tell how far it is.
"""
