"""Extreme cases of the finite elements of a taxel: slivers, foils, moduli over nine decades, nearly incompressible.

Each is a block on a beam, a steel ring glued below it, the beam's root held, written as STEP and solved as a plan's
taxels are; the references are finer elements, or the same with all moduli scaled.
"""

from collections.abc import Callable, Iterator
from functools import partial
from math import pi, sqrt
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from padgen.core.errors import number
from padgen.verify.elastic_material import Elastic
from padgen.verify.elasticity import SolidTaxel, converged_modes, solve_modes
from padgen.verify.engines import engine
from padgen.verify.extreme import Answer, ExtremeCase

__all__ = ["BlockTaxel", "solid_answer", "solid_cases"]

STEEL = Elastic(200e9, 0.3, 7850.0)
DENSITY = 1240.0
BLOCK_MM, HEIGHT_MM = 5.0, 2.0
RING_MM = (4.0, 2.0, 0.5)
"""Outer and inner diameter and thickness."""
TOLERANCE = 5e-3
FINER = (4, 3)
"""Order and levels of the reference's elements."""
FINER_ERROR = 1e-3
"""What those may be off by: they are not extrapolated."""


class BlockTaxel(NamedTuple):
    """A block of `BLOCK_MM` on a beam of these dimensions in mm; `step_mm` of its height stick out below the beam."""

    length: float = 6.0
    width: float = 1.0
    thickness: float = 0.4
    step_mm: float = 0.0
    modulus: float = 3e9
    poisson: float = 0.36
    washer: Elastic = STEEL

    def written(self, folder: Path) -> SolidTaxel:
        """The taxel as STEP file in `folder`. Imports netgen."""
        occ = engine("netgen.occ")
        outer, inner, thick = RING_MM
        low, middle = -self.step_mm, self.length + BLOCK_MM / 2
        corner, opposite = (self.length, -BLOCK_MM / 2, low), (self.length + BLOCK_MM, BLOCK_MM / 2, HEIGHT_MM)
        beam = occ.Box(occ.Pnt(0, -self.width / 2, 0), occ.Pnt(self.length, self.width / 2, self.thickness))
        body = beam + occ.Box(occ.Pnt(*corner), occ.Pnt(*opposite))
        foot = occ.Pnt(middle, 0, low - thick)
        ring = occ.Cylinder(foot, occ.Z, outer / 2, thick) - occ.Cylinder(foot, occ.Z, inner / 2, thick)
        step = folder / "taxel.step"
        occ.Compound([body.solids[0], ring.solids[0]]).WriteStep(str(step))
        volume = pi / 4 * (outer**2 - inner**2) * thick
        printed, sizes = Elastic(self.modulus, self.poisson, DENSITY), (self.length, self.width, self.thickness)
        name = f"a block on a beam of {' x '.join(map(number, sizes))} mm"
        return SolidTaxel(step, printed, self.washer, volume, middle, clamp="root", name=name)


def solid_answer(taxel: BlockTaxel) -> Answer:
    """Working resonance in Hz, and its error, by the elements that tune plans."""
    with TemporaryDirectory() as folder:
        found = converged_modes(taxel.written(Path(folder)), TOLERANCE)
    working = found.modes.working
    return Answer(found.modes.frequency_hz[[working]], float(found.error[working]), found.residual)


def _finer(taxel: BlockTaxel, scale: float = 1.0) -> Answer:
    """By elements of `FINER`, times `scale`."""
    with TemporaryDirectory() as folder:
        found = solve_modes(taxel.written(Path(folder)), *FINER)
    return Answer(scale * found.modes.frequency_hz[[found.modes.working]], FINER_ERROR)


def solid_cases() -> Iterator[ExtremeCase]:
    """All cases of the domain 'solid'; they need NGSolve."""
    plain, same = BlockTaxel(), f"elements of order {FINER[0]}, {FINER[1]} layers"

    def case(name: str, taxel: BlockTaxel, reference: Callable[[], Any], source: str) -> ExtremeCase:
        return ExtremeCase(name, "solid", "elements", partial(solid_answer, taxel), reference, source)

    for step in (0.05, 1e-3):
        taxel = plain._replace(step_mm=step)
        yield case(f"a sliver of {1e3 * step:g} µm under the beam", taxel, partial(_finer, taxel), same)
    for aspect in (1e2, 1e3, 1e4):
        taxel = plain._replace(length=10.0, thickness=10.0 / aspect)
        yield case(f"a beam {aspect:g} times as long as thick", taxel, partial(_finer, taxel), same)
    for poisson in (0.0, 0.49, 0.499):
        taxel = plain._replace(poisson=poisson)
        yield case(f"Poisson's ratio {poisson:g}", taxel, partial(_finer, taxel), same)
    for modulus in (1e3, 1e6):
        # Beside steel the print is soft: only the root of its modulus counts.
        reference = partial(_finer, plain._replace(modulus=1e7), sqrt(modulus / 1e7))
        taxel, source = plain._replace(modulus=modulus), f"{same}, at 10 MPa, by the root of the modulus"
        yield case(f"modulus {modulus:g} Pa under steel", taxel, reference, source)
    for modulus in (1e3, 1e12):
        share = modulus / plain.modulus
        taxel = plain._replace(modulus=modulus, washer=STEEL._replace(modulus_pa=share * STEEL.modulus_pa))
        source = f"{same}, at {plain.modulus:g} Pa, by the root of the moduli"
        yield case(f"modulus {modulus:g} Pa, steel in proportion", taxel, partial(_finer, plain, sqrt(share)), source)
    taxel = plain._replace(modulus=1e12)
    yield case("modulus 1e+12 Pa under steel", taxel, partial(_finer, taxel), same)
