"""Shared by all rooms: errors, units, findings, files, the cache, processes, registries."""
