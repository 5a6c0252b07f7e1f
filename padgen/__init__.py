"""padgen: vibrotactile pads with more taxels than coils.

A pad is a TOML spec; everything else is derived from it by pure functions, in one direction::

    spec.toml -> Spec -> Plan -> solids -> meshes -> pad -> checks -> files
                          +----> driver tables
"""

__version__ = "0.1.1"
__all__ = ["__version__"]
