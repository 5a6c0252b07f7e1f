"""List stiff and extreme cases of every model, each with its answer, the error that it states, and a reference.

Structure: foils and blocks, ribbons and blades, feathers and anvils at the tip: the frame of Timoshenko elements
against the roots of the frequency equation in forty digits, and the beam model of taxels against 3-D elasticity of
their printed solids. Solid: slivers, foils, moduli over nine decades, nearly incompressible: a block on a beam, a
steel ring glued below it, the beam's root held, written as STEP and solved as a plan's taxels are; the references are
finer elements, or the same with all moduli scaled. Force: the plan's pull, fields near and far, saturated, of any
permeability; pull-in. Dynamics: arithmetic in forty digits on formulas that cancel freely, energy and balance in
closed form, or a solver of another kind at its finest setting.

Specs are drawn from the whole space of specs and planned end to end: of each comes a plan of finite figures, or one
sentence. Selectivity has a Q up to 1e7, thousands of channels, lines that all but meet; each figure is held to the same
formula in 60 digits, at the frequencies that the doubles stand for.
"""

from collections.abc import Callable, Iterator
from dataclasses import Field, dataclass, fields, is_dataclass
from functools import cache, partial
from math import isnan, nan, pi, sqrt
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, get_args
from warnings import catch_warnings, simplefilter

import numpy as np

from padgen.core.errors import PadgenError, SolverError, number
from padgen.ladders.rung import Solved
from padgen.ladders.stages import axisymmetric_pull, charges_pull, three_d_pull
from padgen.make.planning import plan_for
from padgen.physics.ladder import LevelLaw, capacity, geometric_ladder
from padgen.physics.magnetics import (
    MILD_STEEL,
    SteelRing,
    balanced_deflection,
    impedance,
    pull_in_deflection,
    solenoid,
)
from padgen.physics.modes import RigidBody
from padgen.physics.selectivity import Channels, Scheme, channels, off_energy
from padgen.planner.make import BROKEN_DOWN
from padgen.planner.plan import non_finite_figures
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.spec import Spec, catalogue, make_spec
from padgen.spec.fields import choices, optional_type
from padgen.spec.load import CATALOGUES, PLAIN_TABLES, laid_over, read_toml, template_paths
from padgen.verify import mpmath, occ
from padgen.verify.coupled import CoupledSystem, Source, from_tones, make_system, scipy_motion, simulate
from padgen.verify.elasticity import Elastic, SolidTaxel, converged_modes, solve_modes
from padgen.verify.field_solid import PullQuestion
from padgen.verify.frame import AttachedBody, Element, Frame, checked_frame_modes, divided, rectangle
from padgen.verify.propagation import (
    STATED_ERROR,
    DecayingTones,
    circuit_current,
    propagate,
    squared,
    steady_phasors,
    tones,
)

__all__ = [
    "BlockTaxel",
    "Cantilever",
    "ExtremeCase",
    "beam_answer",
    "dynamics_cases",
    "exact_displacement",
    "exact_frequencies",
    "fault_of",
    "force_cases",
    "frame_answer",
    "odd_table",
    "random_pull",
    "random_table",
    "selectivity_cases",
    "solid_answer",
    "solid_cases",
    "spec_cases",
    "structure_cases",
]


@dataclass(frozen=True)
class ExtremeCase:
    """An extreme case of a model: its answer (or refusal, a raised `PadgenError`), and a reference for it.

    Relative errors are of the largest entry of `values`. `reference` is analytic, of many digits, or a finer
    solve (`source` says which); as an `Solved` it has an error of its own, which is allowed for.
    """

    name: str
    domain: str
    model: str
    solve: Callable[[], Solved]
    reference: Callable[[], np.ndarray | Solved]
    source: str


DIGITS = 40
ELEMENTS = 4
BUBBLES = 6
MODES = 3
"""Bending modes in the plane up that are compared."""
NEAR = 1e-4
"""Relative distance from the guess, on both sides, at which the search for a root starts."""
UP_SHARE = 1e-3
"""Share of the upward motion above which a mode counts as bending up: the others have none but rounding."""


class Cantilever(NamedTuple):
    """A uniform cantilever with a rigid body at its tip, in SI units.

    The body has `mass_ratio` times the beam's mass, its centroid `offset` beyond the tip, and the
    radius of gyration `gyration` in lengths of the beam.
    """

    width: float
    thickness: float
    length: float
    mass_ratio: float = 0.0
    offset: float = 0.0
    gyration: float = 0.0
    modulus: float = 3e9
    poisson: float = 0.36
    density: float = 1240.0

    @property
    def tip_mass(self) -> float:
        """Mass of the body in kg."""
        return self.mass_ratio * self.density * self.width * self.thickness * self.length

    @property
    def tip_inertia(self) -> float:
        """Moment of inertia of the body about its centroid in kg·m²."""
        return self.tip_mass * (self.gyration * self.length) ** 2


def frame_answer(beam: Cantilever) -> Solved:
    """Return the lowest frequencies in Hz of a cantilever's upright bending modes, by a frame of Timoshenko elements.

    Raises
    ------
    SolverError
        The frame has no trustworthy modes.
    """
    section = rectangle(beam.width, beam.thickness, beam.poisson)
    nodes, pairs = divided(np.zeros(3), np.array([beam.length, 0.0, 0.0]), ELEMENTS)
    shear_modulus = beam.modulus / (2 * (1 + beam.poisson))
    elements = tuple(Element(a, b, section, beam.modulus, shear_modulus, beam.density) for a, b in pairs)
    bodies: tuple[AttachedBody, ...] = ()
    if beam.mass_ratio:
        centroid = np.array([beam.length + beam.offset, 0.0, 0.0])
        body = RigidBody(np.asarray(beam.tip_mass), centroid, beam.tip_inertia * np.eye(3))
        bodies = (AttachedBody(body, (ELEMENTS,)),)
    frame = Frame(nodes, elements, bodies, (0,), bubbles=BUBBLES)
    modes, error = checked_frame_modes(frame, 5 * MODES)
    motion = np.abs(modes.node_motion) * np.repeat([1.0, beam.length], 3)
    up = motion[..., 2].max(1) > UP_SHARE * motion.max((1, 2))
    return Solved(modes.frequency_hz[up][:MODES], float(error[up][:MODES].max()), modes.residual, modes.condition)


def exact_frequencies(beam: Cantilever, guess_hz: np.ndarray | None = None) -> np.ndarray:
    """Return the roots in Hz of a cantilever's frequency equation nearest to `guess_hz` (default: of `frame_answer`).

    They are computed with `DIGITS` digits. The state (deflection, rotation, moment, shear) is carried along the beam by
    the exponential of its equations (Huang, J. Appl. Mech. 28, 1961, in the form of a transfer matrix).
    """
    roots = []
    equation = partial(_frequency_equation, beam)
    with mpmath.workdps(DIGITS):
        for guess in frame_answer(beam).values if guess_hz is None else guess_hz:
            start = 2 * mpmath.pi * mpmath.mpf(float(guess))
            root = mpmath.findroot(equation, (start * (1 - NEAR), start * (1 + NEAR)), tol=1e-25, verify=False)
            roots.append(float(root / (2 * mpmath.pi)))
    return np.array(roots)


def _frequency_equation(beam: Cantilever, angular: Any) -> Any:
    """Return the determinant of the tip's boundary conditions at an angular frequency; it is zero at a mode.

    The determinant has no unit.
    """
    width, thickness, length, _, offset, _, modulus, poisson, density = map(mpmath.mpf, beam)
    mass = mpmath.mpf(beam.tip_mass)
    gyration = mpmath.mpf(beam.tip_inertia)
    area = width * thickness
    inertia = area * thickness**2 / 12
    shear = 10 * (1 + poisson) / (12 + 11 * poisson) * modulus / (2 * (1 + poisson)) * area
    bending = modulus * inertia
    force = bending / length**2
    moment = bending / length
    # Deflections in lengths, forces and moments in those of the beam: the matrix stays of order one.
    state = mpmath.matrix(
        [
            [0, 1, 0, force / shear],
            [0, 0, 1, 0],
            [0, -density * inertia * angular**2 * length / moment, 0, -1],
            [-density * area * angular**2 * length**2 / force, 0, 0, 0],
        ]
    )
    carried = mpmath.expm(state, method="taylor")
    rows = []
    for column in (2, 3):
        up, turn, bent, sheared = (carried[k, column] for k in range(4))
        pull = mass * angular**2 * (up * length + offset * turn) / force
        twist = (gyration * angular**2 * turn) / moment + offset / length * pull
        rows.append((bent - twist, sheared - pull))
    return rows[0][0] * rows[1][1] - rows[0][1] * rows[1][0]


_TAXELS: tuple[tuple[str, str, BeamShape, tuple[float, ...], str, float], ...] = (
    (
        "foil 23 times as wide as thick",
        "cantilever",
        BeamShape(3.048, 0.132, 1.4),
        (5.16, 3.0, 0.68, 0.15, 0.2),
        "m1.6",
        121.1,
    ),
    ("thread under a heavy plate", "cantilever", BeamShape(0.3, 0.123, 1.49), (6.83, 4.0, 2.38, 0.0, 0.0), "m3", 17.06),
    ("cubes on both sides", "bridge", BeamShape(0.461, 0.524, 0.68), (4.41, 4.0, 1.96, 0.3, 0.4), "m1.6", 6201.38),
    ("ribbons on both sides", "bridge", BeamShape(3.492, 0.308, 1.57), (4.96, 4.0, 0.83, 0.6, 0.3), "m1.6", 4003.955),
    (
        "ribbon a ninth as long as wide",
        "cantilever",
        BeamShape(3.741, 0.359, 0.4),
        (4.62, 2.0, 1.19, 0.0, 0.4),
        "m1.6",
        1315.85,
    ),
    ("slit of two ribbons", "bridge", BeamShape(2.999, 0.232, 0.4), (4.43, 4.0, 1.42, 0.3, 0.45), "m1.6", 11116.38),
    (
        "block as long as thick",
        "cantilever",
        BeamShape(0.605, 1.473, 1.51),
        (4.77, 4.0, 2.03, 0.3, 0.2),
        "m1.6",
        1644.294,
    ),
)
"""Taxels far from the usual: beam in mm; side and thickness of the plate, rib and fillet in mm and Poisson's ratio;
washer; working resonance in Hz by 3-D elasticity (docs/measure_beams.py)."""


def beam_answer(topology: str, beam: BeamShape, figures: tuple[float, ...], washer: str) -> Solved:
    """Return the working resonance in Hz of a taxel with these dimensions by the beam model.

    Raises
    ------
    SolverError
        The beam is shorter than those that the model was fitted to; the message names the next rung.
    """
    side, thick, rib, fillet, poisson = figures
    spec = make_spec(
        {
            "name": "extreme",
            "resolution": 1,
            "band_hz": [1, 100_000],
            "q_min": 15,
            "pad": {"rib_mm": rib},
            "taxel": {
                "plate_length_mm": side,
                "plate_width_mm": side,
                "plate_thickness_mm": thick,
                "fillet_mm": fillet,
            },
            "printer": {"name": "fdm-0.25", "smallest_gap_mm": 0.2},
            "material": {"name": "pla", "poisson_ratio": poisson},
            "washer": f"iso7092-{washer}",
        }
    )
    model = TaxelModel(spec, topology, plate_shape(spec), beam)
    if not model.in_range:
        width, thickness, length = beam
        raise SolverError(
            f"a beam of {number(length)} mm is too short beside its width of {number(width)} and thickness of"
            f" {number(thickness)} mm for the beam model: solve the solid"
        )
    return Solved(np.array([float(model.resonance_hz)]), float(model.error_estimate))


def structure_cases() -> Iterator[ExtremeCase]:
    """Yield all cases of the domain 'structure': cantilevers by frame elements, taxels by the planner's beam model."""
    plain = Cantilever(1e-3, 1e-3, 10e-3)
    beams = {}
    for per_length in (1 / 500, 1 / 100, 1 / 20, 1 / 5, 1 / 2, 1.0):
        name = f"thickness {per_length:.3g} of the length"
        beam = plain._replace(thickness=per_length * plain.length)
        beams[name] = beam
        beams[f"{name}, body 10 times its mass"] = beam._replace(mass_ratio=10.0, offset=2e-3, gyration=0.1)
    beams |= {f"width {k:g} of the thickness": plain._replace(width=k * plain.thickness) for k in (0.2, 1.0, 5.0, 20.0)}
    for ratio in (10.0 ** np.arange(-3, 4)).tolist():
        beams[f"tip mass {ratio:g} of the beam's"] = plain._replace(mass_ratio=ratio, offset=1e-3, gyration=0.2)
    beams["foil of 0.1 mm, 15 mm long"] = Cantilever(1e-3, 1e-4, 15e-3, 100.0, 3e-3, 0.1)
    beams["steel beam under a resin plate"] = Cantilever(1e-3, 2e-4, 5e-3, 12.0, 2e-3, 0.3, 200e9, 0.3, 7850.0)
    source = "roots of Timoshenko's frequency equation, forty digits"
    for name, beam in beams.items():
        solve = partial(frame_answer, beam)
        reference = partial(exact_frequencies, beam)
        yield ExtremeCase(name, "structure", "frame", solve, reference, source)
    source = "3-D elasticity of the printed solid, order 3, 0.3 %"
    for name, topology, shape, figures, washer, hz in _TAXELS:
        solve = partial(beam_answer, topology, shape, figures, washer)
        yield ExtremeCase(f"taxel: {name}", "structure", "beam", solve, partial(np.array, [hz]), source)


STEEL = Elastic(200e9, 0.3, 7850.0)
DENSITY = 1240.0
BLOCK_MM = 5.0
HEIGHT_MM = 2.0
RING_MM = (4.0, 2.0, 0.5)
"""Outer and inner diameter and thickness."""
TOLERANCE = 5e-3
FINER_ELEMENTS = (4, 3)
"""Order and levels of the reference's elements."""
FINER_ERROR = 1e-3
"""Relative error of the finer elements, which are not extrapolated."""


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
        """Write the taxel to `folder` as a STEP file and return it for finite elements; this imports netgen."""
        outer, inner, thick = RING_MM
        low = -self.step_mm
        middle = self.length + BLOCK_MM / 2
        corner = (self.length, -BLOCK_MM / 2, low)
        opposite = (self.length + BLOCK_MM, BLOCK_MM / 2, HEIGHT_MM)
        beam = occ.Box(occ.Pnt(0, -self.width / 2, 0), occ.Pnt(self.length, self.width / 2, self.thickness))
        body = beam + occ.Box(occ.Pnt(*corner), occ.Pnt(*opposite))
        foot = occ.Pnt(middle, 0, low - thick)
        ring = occ.Cylinder(foot, occ.Z, outer / 2, thick) - occ.Cylinder(foot, occ.Z, inner / 2, thick)
        step = folder / "taxel.step"
        occ.Compound([body.solids[0], ring.solids[0]]).WriteStep(str(step))
        volume = pi / 4 * (outer**2 - inner**2) * thick
        printed = Elastic(self.modulus, self.poisson, DENSITY)
        sizes = (self.length, self.width, self.thickness)
        name = f"a block on a beam of {' x '.join(map(number, sizes))} mm"
        return SolidTaxel(step, printed, self.washer, volume, middle, clamp="root", name=name)


def solid_answer(taxel: BlockTaxel, finer: bool = False, scale: float = 1.0) -> Solved:
    """Return `scale` times a taxel's working resonance in Hz by finite elements, with its relative error.

    It is solved by the elements that tune plans, or by the `FINER_ELEMENTS`.
    """
    with TemporaryDirectory() as folder:
        solid = taxel.written(Path(folder))
        modes = solve_modes(solid, *FINER_ELEMENTS) if finer else converged_modes(solid, TOLERANCE)
    working = modes.modes.working
    error = FINER_ERROR if finer else float(modes.error[working])
    return Solved(scale * modes.modes.frequency_hz[[working]], error, modes.residual)


def solid_cases() -> Iterator[ExtremeCase]:
    """Yield all cases of the domain 'solid'; they need NGSolve."""
    plain = BlockTaxel()
    same = f"elements of order {FINER_ELEMENTS[0]}, {FINER_ELEMENTS[1]} layers"

    def case(name: str, taxel: BlockTaxel, reference: Callable[[], Any], source: str) -> ExtremeCase:
        return ExtremeCase(name, "solid", "elements", partial(solid_answer, taxel), reference, source)

    taxels = {f"a sliver of {1e3 * step:g} µm under the beam": plain._replace(step_mm=step) for step in (0.05, 1e-3)}
    for aspect in (1e2, 1e3, 1e4):
        taxels[f"a beam {aspect:g} times as long as thick"] = plain._replace(length=10.0, thickness=10.0 / aspect)
    taxels |= {f"Poisson's ratio {poisson:g}": plain._replace(poisson=poisson) for poisson in (0.0, 0.49, 0.499)}
    taxels["modulus 1e+12 Pa under steel"] = plain._replace(modulus=1e12)
    for name, taxel in taxels.items():
        yield case(name, taxel, partial(solid_answer, taxel, True), same)
    for modulus in (1e3, 1e6):
        # Beside steel the print is soft: only the root of its modulus counts.
        reference = partial(solid_answer, plain._replace(modulus=1e7), True, sqrt(modulus / 1e7))
        taxel = plain._replace(modulus=modulus)
        source = f"{same}, at 10 MPa, by the root of the modulus"
        yield case(f"modulus {modulus:g} Pa under steel", taxel, reference, source)
    for modulus in (1e3, 1e12):
        share = modulus / plain.modulus
        taxel = plain._replace(modulus=modulus, washer=STEEL._replace(modulus_pa=share * STEEL.modulus_pa))
        source = f"{same}, at {plain.modulus:g} Pa, by the root of the moduli"
        reference = partial(solid_answer, plain, True, sqrt(share))
        yield case(f"modulus {modulus:g} Pa, steel in proportion", taxel, reference, source)


COIL = solenoid(10e-3, 4e-3, 10e-3, 1000, 4e-3, 1000)
WASHER = SteelRing(4e-3, 2e-3, 0.5e-3, 1000)
"""The reference problem of tests/reference/magnetostatics.json."""
FINER_FIELD = 7, 6
"""Order and levels of the elements of the axisymmetric reference."""
HIGHER = 4
RANDOM = 12
"""Coils, washers and places drawn from what a spec allows."""


def force_cases() -> Iterator[ExtremeCase]:
    """Yield all cases of the domain 'force': extreme gaps, offsets, steels and currents, random pulls, pull-in.

    Each reference is a closed form or a field solution with far more unknowns than the model's.
    """
    for share in (0.5, 0.99, 0.9999):
        yield _near_pull_in(share)
    for permeability in (1.001, 1.1, 10.0, 1e3, 1e6):
        parts = (COIL._replace(core_permeability=permeability), WASHER._replace(permeability=permeability))
        yield _axisymmetric_case(f"both steels of permeability {permeability:g}", PullQuestion(*parts, gap_m=1e-3))
    for sizes in (1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3):
        gap_m = sizes * WASHER.outer_diameter
        yield _axisymmetric_case(f"gap of {sizes:g} washer diameters", PullQuestion(COIL, WASHER, gap_m))
    for current_a in (2.0, 20.0, 200.0):
        saturated = PullQuestion(COIL, WASHER, 1e-3, 0.0, current_a, MILD_STEEL, MILD_STEEL)
        yield _axisymmetric_case(f"saturated steels, {1000 * current_a:g} ampere turns", saturated)
    yield _solid_case(
        "saturated steels, 20000 ampere turns", PullQuestion(COIL, WASHER, 1e-3, 0, 20.0, MILD_STEEL, MILD_STEEL)
    )
    for ratio in (0.0, 0.98):
        coil = solenoid(10e-3, max(ratio, 0.4) * 10e-3, 10e-3, 1000, ratio * 10e-3, 1000)
        pull = PullQuestion(coil, WASHER, 1e-3)
        name = f"core {ratio:g} of the coil's diameter"
        yield _axisymmetric_case(name, pull)
        yield _solid_case(name, pull)
        yield _planned_case(name, pull)
    for gap_m in (1e-5, 5e-5, 2e-4, 5e-3):
        yield _planned_case(f"gap of {1e3 * gap_m:g} mm", PullQuestion(COIL, WASHER, gap_m))
    for offset_m in (3e-3, 5e-3, 8e-3):
        yield _planned_case(f"{1e3 * offset_m:g} mm off the axis", PullQuestion(COIL, WASHER, 1e-3, offset_m))
    wide = solenoid(20e-3, 16e-3, 20e-3, 1000, 16e-3, 1000)
    small = SteelRing(4e-3, 1.7e-3, 0.3e-3, 300)
    yield _planned_case("washer of M1.6 over a core of 16 mm", PullQuestion(wide, small, 5e-4))
    for index in range(RANDOM):
        pull = random_pull(index)
        what = f"washer of {1e3 * pull.washer.outer_diameter:g} mm, core of {1e3 * pull.coil.core_diameter:.3g} mm"
        place = f"{1e3 * pull.gap_m:.3g} mm above, {1e3 * pull.offset_m:.3g} mm aside"
        yield _planned_case(f"random {index}: {what}, {place}", pull)


def random_pull(index: int) -> PullQuestion:
    """Return random pull problem `index`: coil of core 0 … 20 mm, washer at a gap of 0.2 … 5 mm, offset 0 … 15 mm.

    The same ones on every machine.
    """
    draw = Random(index).random
    washers = [entry for name, entry in sorted(catalogue("washer").items()) if entry["relative_permeability"] > 10]
    ring = washers[int(draw() * len(washers))]
    core = 20e-3 * draw() if draw() < 0.8 else 0.0
    bore = max(core, 2e-3) * (1 + 0.3 * draw())
    outer = bore + 2e-3 * (1 + 4 * draw())
    length = 5e-3 * 8 ** draw()
    coil = solenoid(outer, bore, length, 1000, core, 1000)
    outer_m, inner_m, thickness_m = (
        1e-3 * ring[key] for key in ("outer_diameter_mm", "inner_diameter_mm", "thickness_mm")
    )
    washer = SteelRing(outer_m, inner_m, thickness_m, ring["relative_permeability"])
    return PullQuestion(coil, washer, 2e-4 * 25 ** draw(), 15e-3 * draw())


def _planned_case(name: str, pull: PullQuestion) -> ExtremeCase:
    reference = partial(axisymmetric_pull, pull)
    source = "axisymmetric field, with its error"
    if pull.offset_m:
        reference = partial(_off_axis, pull)
        source = "3-D field, with its own error"
    return ExtremeCase(name, "force", "plan", partial(charges_pull, pull), reference, source)


def _axisymmetric_case(name: str, pull: PullQuestion) -> ExtremeCase:
    source = "the same by elements of order 7 and six refinements, with its own error"
    solve = partial(axisymmetric_pull, pull)
    finer = partial(axisymmetric_pull, pull, *FINER_FIELD, scalar=True)
    return ExtremeCase(name, "force", "axisymmetric", solve, finer, source)


def _solid_case(name: str, pull: PullQuestion) -> ExtremeCase:
    source = "axisymmetric field, with its own error"
    return ExtremeCase(name, "force", "3-D", partial(three_d_pull, pull), partial(axisymmetric_pull, pull), source)


def _off_axis(pull: PullQuestion) -> Solved:
    """Return a coil's pull by 3-D finite elements, of a higher order where the usual ones are not accurate enough."""
    try:
        return three_d_pull(pull)
    except SolverError:
        return three_d_pull(pull, HIGHER)


def _near_pull_in(share: float) -> ExtremeCase:
    """Return a case: a washer's static deflection at `share` of the squared pull-in current, for a pull ∝ 1/gap²."""
    gap_m = 1e-3

    def solve() -> Solved:
        slack = share * pull_in_deflection(gap_m, 2.0)[1]
        return Solved(np.array([balanced_deflection(slack, gap_m, 2.0)], float), 1e-6)

    # z (g − z)² = share · 4 g³/27; the smallest root in closed form.
    root = gap_m * (2 / 3 + 2 / 3 * np.cos(np.arccos(2 * share - 1) / 3 + 2 * pi / 3))
    name = f"balance at {share:g} of the pull-in current squared"
    source = "cubic of a spring against 1/gap^2, closed form"
    return ExtremeCase(name, "force", "balance", solve, partial(np.array, [root]), source)


MASS_KG = 1e-4
GAP_M = 1e-3
RESISTANCE_OHM = 62.9

MANY_DIGITS = f"mpmath, {DIGITS} digits"
COUPLED_TOLERANCE = 1e-9


def dynamics_cases() -> Iterator[ExtremeCase]:
    """Yield all cases of the domain 'dynamics'; references need mpmath or scipy when they are asked for."""
    hz = np.array([20.0, 110.0, 440.0, 1000.0])
    early_and_late = np.array([1e-3, 0.1, 10.0])
    force = tones(np.append(hz[:2], hz[2:] + 1e-9), 1e-5, np.arange(4.0))
    for q in (1.0, 15.0, 1e3, 1e5, 1e7):
        yield _propagated(
            f"Q = {q:g}, on resonance and 1e-9 Hz off it, 1 ms and 10 s", hz, q, MASS_KG, force, early_and_late
        )
    critical = 0.5 * (1 + 1e-12 * np.arange(4))
    yield _propagated("critical damping, and 1e-12 off it", hz, critical, MASS_KG, force, early_and_late)
    yield _phasor_near_resonance()
    yield _many_oscillators()
    hz = np.geomspace(20, 1000, 7)
    name = "masses of 1e-3 to 1e3 of a taxel's under one force"
    yield _propagated(name, hz, 15.0, np.geomspace(1e-7, 1e-1, 7), tones(hz, 1e-5), np.array([0.01, 10.0]))
    for constant_s in (1e-6, 1e-3, 10.0):
        yield _circuit_and_taxel(constant_s)
    for constant_s in (1e-6, 10.0):
        yield _acting_back(constant_s)
    hz = np.array([60.0, 170.0, 480.0])
    mass = MASS_KG * np.array([1e3, 1.0, 1e-3])
    pull = mass * (2 * np.pi * hz) ** 2 * GAP_M / 40
    system = make_system(hz, 15.0, mass, pull, 2.0, GAP_M, RESISTANCE_OHM, 40 * GAP_M * float(pull.sum()))
    voltage = tones(hz / 2, 0.4 * np.abs(impedance(RESISTANCE_OHM, system.inductance_h, hz / 2)))
    yield _against_scipy("masses of 1e-3 to 1e3 over one coil", system, voltage, np.array([0.01, 0.03]), False)
    yield from _pull_in()


def exact_displacement(frequency_hz: float, q: float, mass_kg: float, force: DecayingTones, time_s: float) -> float:
    """Return the displacement in m of one resonator from rest by the textbook formula, in arithmetic of many digits.

    Raises
    ------
    EngineMissingError
        mpmath is not installed.
    """
    mp = mpmath.mp.clone()
    mp.dps = DIGITS + 20
    omega = 2 * mp.pi * mp.mpf(float(frequency_hz))
    t = mp.mpf(float(time_s))
    alpha = omega / (2 * mp.mpf(float(q)))
    # Where the formula is 0/0 it is taken a hair beside, far below the digits that are kept.
    hair = mp.mpf(10) ** (-DIGITS // 2)
    alpha = alpha * (1 + hair) if alpha == omega else alpha
    root = mp.sqrt(mp.mpc(alpha**2 - omega**2))
    first = -alpha + root
    second = -alpha - root
    push = (mp.exp(first * t) - mp.exp(second * t)) / (first - second)
    keep = (mp.exp(first * t) + mp.exp(second * t)) / 2 + alpha * push
    total = mp.mpf(0)
    for line in zip(*force, strict=True):
        hz, size, phase, decay, rest = (mp.mpf(float(v)) for v in line)
        a = mp.mpc(-decay, 2 * mp.pi * (hz + rest))
        a = a + omega * hair if abs(a - first) < omega * hair**1.5 else a
        moved = (mp.exp(a * t) - keep - a * push) / ((a - first) * (a - second))
        total += size * mp.re(mp.expj(phase) * moved)
    return float(total / mp.mpf(float(mass_kg)))


def _over_largest(values: np.ndarray) -> np.ndarray:
    """Return displacements (n, k) of resonators over time, each divided by that resonator's largest amount."""
    return np.asarray(values / np.abs(values).max(1, keepdims=True))


def _propagated(name: str, hz: np.ndarray, q: Any, mass: Any, force: DecayingTones, times: np.ndarray) -> ExtremeCase:
    def solve() -> Solved:
        return Solved(_over_largest(propagate(hz, q, mass, force, times)), 10 * STATED_ERROR)

    def exact() -> np.ndarray:
        taxels = zip(*np.broadcast_arrays(hz, q, mass), strict=True)
        return _over_largest(np.array([[exact_displacement(f, d, m, force, t) for t in times] for f, d, m in taxels]))

    return ExtremeCase(name, "dynamics", "exponential", solve, exact, MANY_DIGITS)


def _phasor_near_resonance() -> ExtremeCase:
    hz = 1000.0
    q = 1e7
    force = tones(hz + 1e-9, 1e-5)

    def exact() -> np.ndarray:
        with mpmath.workdps(DIGITS):
            resonance_hz = mpmath.mpf(hz)
            at = mpmath.mpf(float(force.frequency_hz[0]))
            bracket = mpmath.mpc(resonance_hz**2 - at**2, at * resonance_hz / mpmath.mpf(q))
            moved = complex(mpmath.mpf(1e-5) / (4 * mpmath.pi**2 * mpmath.mpf(MASS_KG) * bracket))
        return np.array([moved.real, moved.imag])

    def solve() -> Solved:
        line = steady_phasors(np.array([hz]), q, MASS_KG, force)[0, 0]
        return Solved(np.array([line.real, line.imag]), STATED_ERROR)

    name = "steady state at Q = 1e7, 1e-9 Hz off resonance"
    return ExtremeCase(name, "dynamics", "phasor", solve, exact, MANY_DIGITS)


def _many_oscillators() -> ExtremeCase:
    """Return a case of 2,048 resonators, each displacement divided by the static one, so that all count alike."""
    hz = np.geomspace(0.1, 1000, 2048)
    force = tones(hz[::32], 1e-5, np.arange(64))
    seen = np.linspace(0, len(hz) - 1, 16).astype(int)
    times = np.linspace(0, 10, 201)[1:]
    static = 1e-5 / (MASS_KG * (2 * np.pi * hz[seen]) ** 2)

    def solve() -> Solved:
        moved = propagate(hz, 1e6, MASS_KG, force, times)
        return Solved(moved[seen, -1] / static, 10 * STATED_ERROR)

    def exact() -> np.ndarray:
        return np.asarray([exact_displacement(f, 1e6, MASS_KG, force, 10.0) for f in hz[seen]] / static)

    name = "2,048 oscillators over 1e4 in frequency, Q = 1e6, 64 tones, 10 s"
    return ExtremeCase(name, "dynamics", "exponential", solve, exact, f"{MANY_DIGITS}, 16 of them")


def _refined(system: CoupledSystem, voltage: DecayingTones, times: np.ndarray) -> Solved:
    """Return the simulated motion of taxels and circuit; its stated error is ten times its difference from a finer run.

    Both are over each resonator's largest displacement in the finer run.
    """
    source = from_tones("voltage", voltage)
    run = simulate(system, source, times, tolerance=COUPLED_TOLERANCE)
    fine = simulate(system, source, times, tolerance=COUPLED_TOLERANCE / 100, stages=14).displacement_m
    largest = np.abs(fine).max(1, keepdims=True)
    off = float(np.abs((run.displacement_m - fine) / largest).max())
    return Solved(run.displacement_m / largest, 10 * off + 1e-11, run.residual)


def _circuit_and_taxel(constant_s: float) -> ExtremeCase:
    """Return a case of a circuit of time constant `constant_s` and a pull so weak that the linear model is exact."""
    inductance = RESISTANCE_OHM * constant_s
    weak = 1e-12
    voltage = tones([0.0, 500.0, 380.0], [1.0, 2.0, 2.0], [0.0, 0.3, 0.2])
    system = make_system(1000.0, 15.0, MASS_KG, weak, 0.0, GAP_M, RESISTANCE_OHM, inductance)
    times = np.array([0.002, 0.01, 0.05])

    def exact() -> np.ndarray:
        lines = squared(circuit_current(voltage, RESISTANCE_OHM, inductance))
        force = lines._replace(amplitude=weak * lines.amplitude)
        return _over_largest(np.array([[exact_displacement(1000.0, 15.0, MASS_KG, force, t) for t in times]]))

    name = f"R-L time constant of {constant_s:g} s beside a taxel of 1 kHz"
    return ExtremeCase(name, "dynamics", "coupled", partial(_refined, system, voltage, times), exact, MANY_DIGITS)


def _acting_back(constant_s: float) -> ExtremeCase:
    """Make a case in which motion acts back on the circuit, whose time constant L/R is `constant_s`.

    A pull held at its peak would close a tenth of the gap.
    """
    inductance = RESISTANCE_OHM * constant_s
    hz = 1000.0
    stiffness = MASS_KG * (2 * np.pi * hz) ** 2
    pull = min(stiffness * GAP_M / 10, inductance / GAP_M / 20)
    amps = float(np.sqrt(stiffness * GAP_M / 10 / pull))
    voltage = tones(hz / 2, amps * float(np.abs(impedance(RESISTANCE_OHM, inductance, hz / 2))), 0.0)
    system = make_system(hz, 5.0, MASS_KG, pull, 2.0, GAP_M, RESISTANCE_OHM, inductance)
    name = f"motion that acts back on a circuit of {constant_s:g} s, taxel of 1 kHz"
    return _against_scipy(name, system, voltage, np.array([0.0005, 0.001]), constant_s < 1e-4)


def _against_scipy(
    name: str, system: CoupledSystem, voltage: DecayingTones, times: np.ndarray, stiff: bool
) -> ExtremeCase:
    method, tolerance = ("Radau", 1e-12) if stiff else ("DOP853", 3e-14)

    def reference() -> np.ndarray:
        moved = scipy_motion(system, from_tones("voltage", voltage), times, method, tolerance)
        return _over_largest(moved[: len(system.gap_m)])

    solve = partial(_refined, system, voltage, times)
    source = f"scipy {method} at {tolerance:g}"
    return ExtremeCase(name, "dynamics", "coupled", solve, reference, source)


def _pull_in() -> Iterator[ExtremeCase]:
    """Yield cases of a constant current: just below and above static pull-in; undamped just below dynamic pull-in."""
    hz = 100.0
    exponent = 2.0
    direct = Source("current", np.ones_like)
    stiffness = MASS_KG * (2 * np.pi * hz) ** 2
    largest = stiffness * pull_in_deflection(GAP_M, exponent)[1]

    def highest(q: float, pull: float, times: np.ndarray, stated: float) -> Solved:
        system = make_system(hz, q, MASS_KG, pull, exponent, GAP_M)
        motion = simulate(system, direct, times, tolerance=COUPLED_TOLERANCE)
        return Solved(motion.displacement_m.max(keepdims=True) / GAP_M, stated, motion.residual)

    balance = balanced_deflection(0.99 * largest / stiffness, GAP_M, exponent) or nan
    for percent, truth, source in ((99, balance / GAP_M, "balance in closed form"), (101, nan, "there is none")):
        name = f"mean pull at {percent} % of pull-in"
        reference = partial(np.full, (1, 1), truth)
        solve = partial(highest, 0.5, percent / 100 * largest, np.ones(1), 1e-9)
        yield ExtremeCase(name, "dynamics", "coupled", solve, reference, source)
    # Let go of at rest, ½ k z (1 − z/g) = c i² gives the turning point, of a half of the gap at most.
    share = 0.999
    times = np.linspace(0, 0.03, 20_001)
    solve = partial(highest, np.inf, share * stiffness * GAP_M / 8, times, 1e-6)
    reference = partial(np.full, (1, 1), (1 - np.sqrt(1 - share)) / 2)
    name = "undamped, let go of at 99.9 % of what pulls it in"
    source = "conservation of energy"
    yield ExtremeCase(name, "dynamics", "coupled", solve, reference, source)


GROUPS = 8
IN_GROUP = 50
SOLIDS = (0, 1, 9, 11, 30, 37)
"""Random specs of which a taxel is solved by finite elements, too: feasible ones of every topology."""
SOLID_TOLERANCE = 3e-3
QUICK = (3, 1)
QUICK_ERROR = 3e-3
"""Order and levels of elements that a beam model is held against, and what they may be off by."""
MOST_ODD = 4
"""Fields, at most, that are drawn from all that they may be, the others being of the catalogues or usual."""
LONGEST_SENTENCE = 1000
IMPOSSIBLE: dict[str, dict[str, Any]] = {
    "a washer that sags by 10 mm over a gap of 1 mm": {"resonances_hz": [5.0], "band_hz": [4, 6], "resolution": 1},
    "a washer that rests on its coil by its weight": {"coil": {"gap_mm": 0.05}, "resonances_hz": [60.0, 120.0]},
    # Tones, or fewer channels over a coil, pull less: the search would take those, and that pad does survive.
    "a level of half the gap": {
        "drive": {"level_um": 500.0, "scheme": "biased"},
        "coil": {"grid": [1, 1], "gap_mm": 1.0},
    },
    "a level of twice the gap": {"drive": {"level_um": 2000.0}},
}
FREE = (
    "resolution",
    "threshold_file",
    "threshold_hz",
    "threshold_um",
    "resonances_hz",
    "structure",
    "name",
    "source",
    "shape",
    "outer_depth_mm",
    "power_w",
    "dynamic_ratio",
    "wet_ratio",
    "nozzle_c",
    "bed_c",
)
"""Fields of the spec that are not drawn among the odd ones: without bounds, drawn always, of no use without another, or
in no figure of a plan."""


def spec_cases() -> Iterator[ExtremeCase]:
    """Yield all cases of the domain 'specs': random specs, taxels of some by finite elements, and impossible specs."""
    for first in range(0, GROUPS * IN_GROUP, IN_GROUP):
        name = f"random {first} … {first + IN_GROUP - 1}"
        source = "a plan of finite figures, or one sentence"
        yield ExtremeCase(name, "specs", "plan", partial(_group_answer, first), partial(np.array, [0.0]), source)
    for place in SOLIDS:
        quick = partial(_solid, place, QUICK, QUICK_ERROR)
        source = f"elements of order {QUICK[0]}, {QUICK_ERROR:.1%}"
        yield ExtremeCase(f"taxel of random {place}", "specs", "beam", partial(_beam, place), quick, source)
    converged = partial(_solid, SOLIDS[1], None, nan)
    finer = partial(_solid, SOLIDS[1], FINER_ELEMENTS, FINER_ERROR)
    source = f"elements of order {FINER_ELEMENTS[0]}, {FINER_ELEMENTS[1]} layers"
    yield ExtremeCase(f"taxel of random {SOLIDS[1]}", "specs", "elements", converged, finer, source)
    for name, fields_ in IMPOSSIBLE.items():
        table = {"name": "impossible", "resolution": 4, "band_hz": [50, 200], "q_min": 15, **fields_}
        outcome_of = partial(np.array, [1.0])
        source = "an error or a refusal, since no pad can be so"
        yield ExtremeCase(name, "specs", "plan", partial(_has_error, table), outcome_of, source)


def _group_answer(first: int) -> Solved:
    """Return 0 if each of `IN_GROUP` random specs from `first` on is planned or refused without fault, else raise."""
    outcomes = {number: fault_of(random_table(number)) for number in range(first, first + IN_GROUP)}
    wrong = [f"random {number}: {fault}" for number, fault in outcomes.items() if fault]
    if wrong:
        raise ValueError(f"{len(wrong)} of {IN_GROUP} are wrong: {'; '.join(wrong[:3])}")
    return Solved(np.array([0.0]), 0.0)


def _has_error(table: dict[str, Any]) -> Solved:
    """Return 1 if the plan of a spec has an error among its findings, else 0; a refusal is raised."""
    plan = plan_for(make_spec(table))
    return Solved(np.array([float(any(finding.level == "error" for finding in plan.findings))]), 0.0)


def _beam(number: int) -> Solved:
    """Return the planned resonance of the first channel of a random spec, with its model's stated error."""
    channel = plan_for(make_spec(random_table(number, 0))).channels[0]
    return Solved(np.array([channel.resonance_hz]), channel.model_error)


def _solid(number: int, setting: tuple[int, int] | None, error: float) -> Solved:
    """Return the resonance of the first channel of a random spec by finite elements of the printed solid.

    `setting` is their order and levels, `error` what these may err by; without a setting the elements are those that
    tune plans, with their estimated error.
    """
    from padgen.make.solid_tuning import solid_taxel
    from padgen.solid.formats.step import write_taxel_step  # before NGSolve, which brings another OCCT
    from padgen.verify.elasticity import converged_modes, solve_modes

    plan = plan_for(make_spec(random_table(number, 0)))
    with TemporaryDirectory() as folder:
        step = Path(folder) / "taxel.step"
        write_taxel_step(plan, plan.channels[0], step)
        taxel = solid_taxel(plan, plan.channels[0], step)
        modes = solve_modes(taxel, *setting) if setting else converged_modes(taxel, SOLID_TOLERANCE)
    working = modes.modes.working
    stated = error if setting else float(modes.error[working])
    return Solved(modes.modes.frequency_hz[[working]], stated, modes.residual)


def random_table(number: int, most_odd: int = MOST_ODD) -> dict[str, Any]:
    """Return random spec `number` as a table, alike on each machine; up to `most_odd` fields take any allowed value."""
    random = Random(number)
    draw = random.random
    low = 10 * 20 ** draw()
    side_mm = 30 * 5 ** draw()
    # Rubbers are too soft for nearly all of these bands.
    stiff = [each for each in sorted(catalogue("material").items()) if each[1]["glass_c"] is not None]
    material, made = random.choice(stiff)
    printers = [name for name, entry in sorted(catalogue("printer").items()) if entry["process"] == made["process"]]
    table: dict[str, Any] = {
        "name": f"random-{number}",
        "resolution": 1 + int((side_mm / 12) ** 2 * draw()),
        "band_hz": [low, low * 2 * 10 ** draw()],
        "q_min": 3 * 30 ** draw(),
        "material": material,
        "printer": random.choice(printers),
        "washer": random.choice(sorted(catalogue("washer"))),
        "pad": {"width_mm": side_mm, "depth_mm": side_mm},
        "suspension": {"topology": random.choice(["auto", "cantilever", "folded", "bridge"])},
    }
    for _ in range(int(draw() * (most_odd + 1))):
        name, item = random.choice(DRAWN)
        meta = item.metadata
        if known := choices(meta):
            value: Any = random.choice(known)
        elif meta["low"] > 0:
            value = meta["low"] * (meta["high"] / meta["low"]) ** draw()
        else:
            value = meta["high"] * draw() ** 4
        entry = table.setdefault(name, {}) if name else table
        if isinstance(entry, str):
            entry = table[name] = {"name": entry}
        entry[item.name] = int(value) if item.type == "int" or item.type is int else value
    return table


DRAWN = [
    (name, item)
    for name, table in [("", Spec), *((part.name, part.type) for part in fields(Spec) if is_dataclass(part.type))]
    for item in fields(table)
    if item.name not in FREE and (choices(item.metadata) or ("low" in item.metadata and "count" not in item.metadata))
]
"""The tables of a spec ("" is the top level) and their fields, those that have bounds or choices."""


NOT_ODD = ("structure", "threshold_file", "name", "source")
ODD = [
    (name, item)
    for name, table in [("", Spec), *PLAIN_TABLES.items(), *((key, kind) for key, (kind, _) in CATALOGUES.items())]
    for item in fields(table)
    if item.name not in NOT_ODD and (choices(item.metadata) or "low" in item.metadata)
]
"""All fields that have bounds or choices, lists as well, and their tables."""
MOST_TOGETHER = 6
MOST_LISTED = 4
"""Most fields of one odd spec that are drawn, and most numbers in a drawn list."""
AT_CORNERS = 0.4
"""Share of the drawn numbers that are a field's lowest or highest."""


def odd_table(number: int) -> dict[str, Any]:
    """Return test spec `number` as a table: a four-line spec or a template, with some fields set to any allowed values.

    At most `MOST_TOGETHER` fields are drawn. The first specs have one field each, at its lowest, at its highest, or one
    of its words.
    """
    if number < len(corners := _corners()):
        name, item, value = corners[number]
        return _with_field(_odd_base(-1), name, item, value)
    random = Random(number)
    table = _odd_base(random.randrange(2 * len(template_paths())))
    for name, item in random.sample(ODD, random.randint(1, MOST_TOGETHER)):
        table = _with_field(table, name, item, _odd_value(item, random))
    return table


@cache
def _corners() -> list[tuple[str, "Field[Any]", Any]]:
    """Return every field of `ODD` with each of its extreme values: its lowest and highest, or each of its words."""
    corners: list[tuple[str, Field[Any], Any]] = []
    for name, item in ODD:
        meta = item.metadata
        ends = choices(meta) or (meta["low"], meta["high"])
        corners += [(name, item, [end] * (meta["count"] or 1) if "count" in meta else end) for end in ends]
    return corners


def _odd_base(number: int) -> dict[str, Any]:
    """Return the table of template `number` without [model], or of a four-line spec if there is no such template."""
    paths = list(template_paths().items())
    if 0 <= number < len(paths):
        table = read_toml(paths[number][1], paths[number][0])
        return {key: value for key, value in table.items() if key != "model"}
    return {"name": "odd", "resolution": 8, "band_hz": [50.0, 200.0], "q_min": 15.0}


def _odd_value(item: "Field[Any]", random: Random) -> Any:
    """Draw a field's value: one of its words, or numbers at or between its bounds, log-uniform for positive ones."""
    meta = item.metadata
    if known := choices(meta):
        return random.choice(known)
    low, high = float(meta["low"]), float(meta["high"])

    def one() -> float:
        if random.random() < AT_CORNERS:
            return random.choice((low, high))
        if low > 0:
            return min(max(low * (high / low) ** random.random(), low), high)
        return low + (high - low) * random.random() ** random.choice((1, 4))

    if "count" in meta:
        return sorted(one() for _ in range(meta["count"] or random.randint(1, MOST_LISTED)))
    return one()


def _with_field(table: dict[str, Any], name: str, item: "Field[Any]", value: Any) -> dict[str, Any]:
    """Return the table of a spec with one field set, rounded where the field takes whole numbers."""
    kind = optional_type(item.type)[0]
    numbers = isinstance(value, list)
    if kind is int or (numbers and get_args(kind)[0] is int):
        value = [round(v) for v in value] if numbers else round(value)
    return laid_over(table, {f"{name}.{item.name}" if name else item.name: value})


def fault_of(table: dict[str, Any]) -> str:
    """Return what is wrong with the answer to a spec; empty for a plan of finite figures or a refusal.

    A plan that finds an error in itself, as where a coil does not pull its washer, may have infinite figures, but no
    other. Warnings are faults, and so is a computation that broke down, in whatever words that is told.
    """
    try:
        with catch_warnings():
            simplefilter("error")
            plan = plan_for(make_spec(table))
    except PadgenError as error:
        if "\n" in str(error) or len(str(error)) > LONGEST_SENTENCE:
            return "its refusal is no sentence"
        causes = (error.__cause__, getattr(error.__cause__, "__cause__", None))
        return f"SolverError: {error}" if any(isinstance(cause, BROKEN_DOWN) for cause in causes) else ""
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    honest = any(finding.level == "error" for finding in plan.findings)
    lost = (at for at, value in non_finite_figures(plan) if isnan(value) or not honest)
    return next((f"{at} is no number" for at in lost), "")


SUM_DIGITS = 60
ROUNDING = float(np.finfo(float).eps)
PER_LINE = 16
"""Roundings that one line's energy may take, and one more for each time that the sum doubles."""


def selectivity_cases() -> Iterator[ExtremeCase]:
    """Yield the extreme cases of selectivity: an OFF taxel's energy in the worst state, and counts of channels."""
    for q in (1.0, 15.0, 1e3, 1e5, 1e7):
        yield _energy(f"32 channels in 20 … 1000 Hz, Q = {q:g}", (20.0, 1000.0), 32, q, "spur-free", 16)
    wide = "of 2,048 channels over 10⁴ in frequency, Q ="
    for q, off in ((1.0, 1023), (1e7, 0), (1e7, 1023), (1e7, 2047)):
        yield _energy(f"number {off} {wide} {q:g}", (0.1, 1000.0), 2048, q, "spur-free", off)
    for scheme in ("tones", "biased"):
        for off in (0, 31, 63):
            name = f"number {off} of 64 channels with spurs, Q = 1e7"
            yield _energy(name, (20.0, 1000.0), 64, 1e7, scheme, off)
    for scheme in ("tones", "spur-free"):
        name = "8 channels within 1e-9 of each other, Q = 1e7"
        yield _energy(name, (100.0, 100.0 * (1 + 1e-9)), 8, 1e7, scheme, 4)
    for q, delta_y in ((15.0, 10.0), (1e7, 10.0), (1e7, 1e-3), (1.0, 3.9999)):
        yield _capacity(q, delta_y)


def _selectivity_case(
    name: str, model: str, value: Callable[[], float], stated: float, exact: Callable[[], Any]
) -> ExtremeCase:
    def reference() -> np.ndarray:
        with mpmath.workdps(SUM_DIGITS):
            return np.array([float(exact())])

    source = f"the same sums in {SUM_DIGITS} digits (mpmath)"
    return ExtremeCase(name, "selectivity", model, lambda: Solved(np.array([value()]), stated), reference, source)


def _energy(name: str, band_hz: tuple[float, float], count: int, q: float, scheme: str, off: int) -> ExtremeCase:
    def value() -> float:
        return float(off_energy(_even_channels(band_hz, count, q), Scheme(scheme))[off])

    def exact() -> Any:
        channels = _even_channels(band_hz, count, q)
        hz, line = ([mpmath.mpf(float(v)) for v in part] for part in (channels.resonance_hz, channels.line))
        return _summed(hz, line, mpmath.mpf(q), Scheme(scheme), off)

    return _selectivity_case(name, scheme, value, (PER_LINE + float(np.log2(count))) * ROUNDING, exact)


def _capacity(q: float, delta_y: float) -> ExtremeCase:
    def exact() -> Any:
        share = mpmath.mpf(delta_y) / (4 * mpmath.mpf(q))
        return mpmath.log(mpmath.mpf(1000) / 20) / mpmath.log((1 + share) / (1 - share))

    name = f"channels in 20 … 1000 Hz, Q = {q:g}, Δy = {delta_y:g}"
    return _selectivity_case(name, "Eq. 12", lambda: capacity(20.0, 1000.0, q, delta_y), 8 * ROUNDING, exact)


def _even_channels(band_hz: tuple[float, float], count: int, q: float) -> Channels:
    resonance_hz = geometric_ladder(*band_hz, count)
    return channels(resonance_hz, q, LevelLaw(1.0)(resonance_hz))


def _summed(hz: list[Any], line: list[Any], q: Any, scheme: Scheme, off: int) -> Any:
    def heard(frequency: Any, amplitude: Any) -> Any:
        share = frequency / hz[off]
        return (amplitude / line[off]) ** 2 / ((q * (1 - share**2)) ** 2 + share**2)

    others = [j for j in range(len(hz)) if j != off]
    total = sum(heard(hz[j], line[j]) for j in others)
    if not scheme.has_pair_spurs:
        return total
    half = 2 if scheme.name == "tones" else 1
    biased = 2 * mpmath.mpf(scheme.bias_ratio) * max(line)
    for place, a in enumerate(others):
        if scheme.is_biased:
            total += heard(2 * hz[a], line[a] ** 2 / (2 * biased))
        for b in others[place + 1 :]:
            both = 2 * mpmath.sqrt(line[a] * line[b]) if scheme.name == "tones" else line[a] * line[b] / biased
            total += heard((hz[a] + hz[b]) / half, both) + heard(abs(hz[a] - hz[b]) / half, both)
    return total
