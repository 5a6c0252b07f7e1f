"""A winding on a core of its own length: the paper's coil.

::

        |<-- outer -->|
        +--+ +---+ +--+   0: top face
        |xx| |   | |xx|
        |xx| | c | |xx|   x: winding, c: core
        +--+ +---+ +--+   -length
            |inner|
"""

from padgen.core.units import MM
from padgen.physics.magnetics import CoilSource, solenoid
from padgen.spec import Coil

__all__ = ["source"]


def source(coil: Coil) -> CoilSource:
    """Return the winding and the core, in m."""
    return solenoid(
        coil.outer_diameter_mm * MM,
        coil.inner_diameter_mm * MM,
        coil.length_mm * MM,
        coil.turns,
        coil.core_diameter_mm * MM,
        coil.core_relative_permeability,
    )
