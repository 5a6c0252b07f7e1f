"""Code that all other packages of padgen share: errors, units, findings, files, the cache, processes, registries."""
