"""Code that all rooms share: errors, units, findings, files, the cache, processes, registries."""
