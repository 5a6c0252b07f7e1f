"""Beams far from the usual: foils and blocks, ribbons and blades, feathers and anvils at the tip.

The frame of Timoshenko elements against the roots of the frequency equation in forty digits, and the
beam model of taxels against 3-D elasticity of their printed solids.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.physics.frame import AttachedBody, Frame, checked_frame_modes, divided
from padgen.physics.frame_element import Element, rectangle
from padgen.physics.rigid_body import RigidBody
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.spec import make_spec
from padgen.verify.engines import engine
from padgen.verify.extreme import Answer, ExtremeCase

__all__ = ["Cantilever", "beam_answer", "exact_frequencies", "frame_answer", "structure_cases"]

DIGITS = 40
ELEMENTS = 4
BUBBLES = 6
MODES = 3
"""Bending modes in the plane up that are compared."""
NEAR = 1e-4
"""Where the search for a root starts, on both sides of the guess."""
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


def frame_answer(beam: Cantilever) -> Answer:
    """Bending frequencies up by the frame, lowest first; motions across, along and about the axis are held.

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
    return Answer(modes.frequency_hz[up][:MODES], float(error[up][:MODES].max()), modes.residual, modes.condition)


def exact_frequencies(beam: Cantilever, guess_hz: np.ndarray) -> np.ndarray:
    """Roots of Timoshenko's frequency equation nearest to `guess_hz`, in forty digits.

    The state (deflection, rotation, moment, shear) is carried along the beam by the exponential of
    its equations (Huang, J. Appl. Mech. 28, 1961, in the form of a transfer matrix).
    """
    mp = engine("mpmath")
    with mp.workdps(DIGITS):
        return np.array([float(_root(mp, beam, guess)) for guess in guess_hz])


def _root(mp: Any, beam: Cantilever, guess_hz: float) -> Any:
    start = 2 * mp.pi * mp.mpf(float(guess_hz))
    around = (start * (1 - NEAR), start * (1 + NEAR))
    found = mp.findroot(partial(_frequency_equation, mp, beam), around, tol=1e-25, verify=False)
    return found / (2 * mp.pi)


def _frequency_equation(mp: Any, beam: Cantilever, angular: Any) -> Any:
    """Determinant of the tip's conditions, over the beam's length and stiffness; zero at a mode."""
    length, modulus, density = (mp.mpf(v) for v in (beam.length, beam.modulus, beam.density))
    area = mp.mpf(beam.width) * mp.mpf(beam.thickness)
    inertia = area * mp.mpf(beam.thickness) ** 2 / 12
    poisson = mp.mpf(beam.poisson)
    shear = 10 * (1 + poisson) / (12 + 11 * poisson) * modulus / (2 * (1 + poisson)) * area
    bending = modulus * inertia
    force, moment = bending / length**2, bending / length
    # Deflections in lengths, forces and moments in those of the beam: the matrix stays of order one.
    state = mp.matrix(
        [
            [0, 1, 0, force / shear],
            [0, 0, 1, 0],
            [0, -density * inertia * angular**2 * length / moment, 0, -1],
            [-density * area * angular**2 * length**2 / force, 0, 0, 0],
        ]
    )
    carried = mp.expm(state, method="taylor")
    mass, gyration = mp.mpf(beam.tip_mass), mp.mpf(beam.tip_inertia)
    offset = mp.mpf(beam.offset)
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


def beam_answer(topology: str, beam: BeamShape, figures: tuple[float, ...], washer: str) -> Answer:
    """Working resonance of one of the taxels by the beam model.

    Raises
    ------
    SolverError
        The beam is shorter than those that the model was fitted to; the message names the next rung.
    """
    side, thick, rib, fillet, poisson = figures
    plate = {"plate_length_mm": side, "plate_width_mm": side, "plate_thickness_mm": thick}
    spec = make_spec(
        {
            "name": "extreme",
            "resolution": 1,
            "band_hz": [1, 100_000],
            "q_min": 15,
            "pad": {"rib_mm": rib},
            "taxel": {**plate, "fillet_mm": fillet},
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
    return Answer(np.array([float(model.resonance_hz)]), float(model.error_estimate))


def _cantilevers() -> Iterator[tuple[str, Cantilever]]:
    """The cases: each is one step away from a plain beam of 10 × 1 × 1 mm."""
    plain = Cantilever(1e-3, 1e-3, 10e-3)
    for per_length in (1 / 500, 1 / 100, 1 / 20, 1 / 5, 1 / 2, 1.0):
        beam = plain._replace(thickness=per_length * plain.length)
        yield f"thickness {per_length:.3g} of the length", beam
        yield (
            f"thickness {per_length:.3g} of the length, body 10 times its mass",
            beam._replace(mass_ratio=10.0, offset=2e-3, gyration=0.1),
        )
    for width_ratio in (0.2, 1.0, 5.0, 20.0):
        yield f"width {width_ratio:g} of the thickness", plain._replace(width=width_ratio * plain.thickness)
    for ratio in 10.0 ** np.arange(-3, 4):
        yield f"tip mass {ratio:g} of the beam's", plain._replace(mass_ratio=float(ratio), offset=1e-3, gyration=0.2)
    yield "foil of 0.1 mm, 15 mm long", Cantilever(1e-3, 1e-4, 15e-3, 100.0, 3e-3, 0.1)
    yield "steel beam under a resin plate", Cantilever(1e-3, 2e-4, 5e-3, 12.0, 2e-3, 0.3, 200e9, 0.3, 7850.0)


def structure_cases() -> Iterator[ExtremeCase]:
    """All cases of the structure ladder's beam rungs."""
    source = "roots of Timoshenko's frequency equation, forty digits"
    for name, beam in _cantilevers():
        solve, reference = partial(frame_answer, beam), partial(_reference, beam)
        yield ExtremeCase(name, "structure", "frame", solve, reference, source)
    source = "3-D elasticity of the printed solid, order 3, 0.3 %"
    for name, topology, shape, figures, washer, hz in _TAXELS:
        solve = partial(beam_answer, topology, shape, figures, washer)
        yield ExtremeCase(f"taxel: {name}", "structure", "beam", solve, partial(np.array, [hz]), source)


def _reference(beam: Cantilever) -> np.ndarray:
    return exact_frequencies(beam, frame_answer(beam).values)
