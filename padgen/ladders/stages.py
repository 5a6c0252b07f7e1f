"""Build the ladders of `padgen study`: models, coarse to fine, of selectivity, mesh, pull, skin, resonance and motion.

Allocation: how far a coil's channels can be told apart in the band, from Eq. 12 to the optimum. Geometry: the mesh that
is printed against the B-rep that was modelled. Force: the coil's pull on a washer, from the paper's Eq. 4 to field
solutions. Structure: a taxel's working resonance, from the paper's point-mass rule to 3-D elements of the printed
solid; and the resonances of taxels on the real frame of the pad. Functions here hand a plan's figures to models that
live elsewhere.

Dynamics: where a coil's taxels are after switching on; phasors leave out the transient and how motion acts back, exact
propagation only the latter.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import inf, pi
from pathlib import Path
from typing import Any

import numpy as np

from padgen.core.errors import SolverError, number, plural
from padgen.core.units import GRAM, MH, MM
from padgen.ladders.rung import (
    Ladder,
    Rung,
    Scene,
    Solved,
    Theory,
    chosen_channels,
    distinct_channels,
    value_from_process,
    write_steps,
)
from padgen.physics.contact import Contactor
from padgen.physics.contact.half_space import HalfSpace, layer_radius
from padgen.physics.ladder import geometric_ladder, optimal_ladder
from padgen.physics.magnetics import impedance, paper_force_constant
from padgen.physics.pull import solved_pulls
from padgen.physics.schemes import bias_a
from padgen.physics.selectivity import Channels, Scheme, all_states, channels, one_hot_db
from padgen.planner.movers.washer import magnetic_parts
from padgen.planner.plan import Channel, Plan, level_law, scheme_named
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.spec import Spec
from padgen.verify.coupled import CoupledSystem, Source, from_tones, make_system, simulate
from padgen.verify.field_solid import PullQuestion, axisymmetric_force, solid_pull
from padgen.verify.layered_skin import LAYERED, SkinQuestion, solve_skin
from padgen.verify.propagation import DecayingTones, propagate, signal, squared, steady_phasors, tones

__all__ = [
    "LADDERS",
    "DynamicsQuestion",
    "Scene",
    "allocation_ladders",
    "axisymmetric_pull",
    "beam_elements_hz",
    "beam_hz",
    "bound_promise",
    "charges_pull",
    "dynamics_ladders",
    "dynamics_models",
    "dynamics_question",
    "exact_volumes",
    "force_ladders",
    "geometric_on_off_ratio",
    "geometry_ladders",
    "graded_hz",
    "layered_skin",
    "lumped_skin",
    "mesh_volumes",
    "optimal_ratio",
    "pad_hz",
    "pad_ladders",
    "paper_pull",
    "planned_hz",
    "rule_hz",
    "skin_ladders",
    "structure_ladders",
    "taxel_solids",
    "three_d_pull",
]

FINEST = "coupled"
COUPLED_TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10)
SAMPLES = 64
RING_UPS = 3.0


@dataclass(frozen=True)
class DynamicsQuestion:
    """Input of the models of motion: one coil, its taxels, its current, and the times (k,) in s of the displacements.

    `current` in A is of schemes that are sums of tones, None where it is the root of `squared_current` in A².
    """

    system: CoupledSystem
    scheme: Scheme
    current: DecayingTones | None
    squared_current: DecayingTones
    time_s: np.ndarray

    @property
    def force(self) -> DecayingTones:
        """Pull in N on each of n washers while it is held at its rest position, as m tones with amplitudes (n, m)."""
        lines = self.squared_current
        return lines._replace(amplitude=self.system.pull_n_per_a2[:, None] * lines.amplitude)

    @property
    def voltage(self) -> Source:
        """The voltage that drives the question's current through the coil while its washers are at rest."""
        resistance = self.system.resistance_ohm
        inductance = self.system.inductance_h
        current = self.current
        if current is None:
            return Source("voltage", partial(_root_voltage, self.squared_current, resistance, inductance))
        z = impedance(resistance, inductance, current.frequency_hz)
        size = current.amplitude * np.abs(z)
        phase = current.phase_rad + np.angle(z)
        return from_tones("voltage", current._replace(amplitude=size, phase_rad=phase))

    @property
    def initial_a(self) -> float:
        """The coil's current in A at t = 0, when the taxels are released, so that the circuit has no transient."""
        value = float(signal(self.current or self.squared_current, np.zeros(1))[0])
        return value if self.current else value**0.5


def dynamics_ladders(scene: Scene) -> Iterator[Ladder]:
    """Yield a ladder of models of the taxels' motion for each channel set in its worst state, if a washer is pulled."""
    for set_index in range(len(scene.plan.sets)):
        try:
            question = dynamics_question(scene.plan, coil_set=set_index)
        except SolverError:
            continue
        first, last = (1e3 * float(question.time_s[place]) for place in (0, -1))
        channels = ", ".join(str(channel.index) for channel in scene.plan.sets[set_index])
        yield Ladder(
            "dynamics",
            f"channels {channels}, driven {question.scheme.name}",
            f"displacement {first:.4g} … {last:.4g} ms after switching on",
            "m",
            tuple(
                Rung(model, resolution, solve, FINEST if model == FINEST else "")
                for model, resolution, solve in dynamics_models(question)
            ),
            FINEST,
            note="errors are of the largest displacement; the coupled model refines its tolerance",
        )


def dynamics_question(plan: Plan, after_s: float | None = None, coil_set: int = 0) -> DynamicsQuestion:
    """Return the input of motion models: a coil in its worst state, two periods of its lowest channel from `after_s`.

    Three ring-ups of the slowest channel unless told otherwise.

    Raises
    ------
    SolverError
        `after_s` is negative, or the coil pulls none of its washers.
    """
    channel_set = plan.sets[coil_set]
    coil = plan.spec.coil
    scheme = plan.scheme
    state = plan.selectivity.worst_state
    on = np.array(
        [bit == "1" for bit in state] if len(state) == len(channel_set) and "1" in state else [True] * len(channel_set)
    )
    line_a2 = np.array([c.line_a2 for c in channel_set])
    frequency = np.array([c.resonance_hz for c in channel_set])
    q = np.array([c.q for c in channel_set])
    start = RING_UPS * float((q / (np.pi * frequency)).max()) if after_s is None else after_s
    if start < 0 or not line_a2[on].any():
        raise SolverError(f"needs a time of at least 0 s and a washer that is pulled, got {number(start)} s")
    system = make_system(
        frequency,
        q,
        [c.effective_mass_g * GRAM for c in channel_set],
        [max(c.force_constant_n_per_a2, 0.0) for c in channel_set],
        [max(c.pull_exponent, 0.0) for c in channel_set],
        coil.gap_mm * MM,
        coil.resistance_ohm,
        coil.inductance_mh * MH,
    )
    hz = frequency[on]
    lines = line_a2[on]
    bias = bias_a(scheme, line_a2)
    current = None if scheme.is_root else tones(hz / 2, np.sqrt(2 * lines), -np.pi / 2)
    if scheme.is_biased:
        phase = np.append(np.full(len(hz), -np.pi / 2), 0.0)
        current = tones(np.append(hz, 0.0), np.append(lines / (2 * bias), bias), phase)
    wanted = tones(np.append(hz, 0.0), np.append(lines, (1 + plan.spec.drive.headroom) * lines.sum()))
    times = start + np.linspace(0, 2 / float(frequency.min()), SAMPLES)
    return DynamicsQuestion(system, scheme, current, squared(current) if current else wanted, times)


def dynamics_models(question: DynamicsQuestion) -> Iterator[tuple[str, str, Callable[[], Solved]]]:
    """Yield name, resolution and solving function of each model of motion, from steady state to coupled equations.

    Answers are displacements (n, k) in m; they can be sent to another process.
    """
    yield "phasor", "steady state", partial(_phasor, question)
    yield "exponential", "exact, linear", partial(_exponential, question)
    for tolerance in COUPLED_TOLERANCES:
        yield FINEST, f"tolerance {tolerance:g}", partial(_coupled, question, tolerance)


def _phasor(question: DynamicsQuestion) -> Solved:
    system = question.system
    force = question.force
    lines = steady_phasors(system.frequency_hz, system.q, system.mass_kg, force)
    moved = (lines @ np.exp(2j * np.pi * (force.frequency_hz + force.rest_hz)[:, None] * question.time_s)).real
    transient = np.exp(-np.pi * system.frequency_hz / system.q * question.time_s[0]).max()
    return Solved(moved, float(transient) + _linearisation_error(question, moved), unknowns=len(moved))


def _exponential(question: DynamicsQuestion) -> Solved:
    system = question.system
    moved = propagate(system.frequency_hz, system.q, system.mass_kg, question.force, question.time_s)
    return Solved(moved, _linearisation_error(question, moved), unknowns=2 * len(moved))


def _coupled(question: DynamicsQuestion, tolerance: float) -> Solved:
    motion = simulate(question.system, question.voltage, question.time_s, question.initial_a, tolerance)
    # Steps add up: a hundred periods of a root's corners came to 1.2 tolerances.
    return Solved(motion.displacement_m, 10 * tolerance, motion.residual, unknowns=2 * len(motion.displacement_m) + 1)


def _linearisation_error(question: DynamicsQuestion, moved: np.ndarray) -> float:
    """Estimate the relative error of linear models of motion, which leave out that motion changes pull and inductance.

    The mean pull softens a spring by ``m z/g``, and its resonance, met within 1/Q, feels that Q
    times; the swing itself does so in second order; and it changes the coil's inductance.
    """
    system = question.system
    largest = np.abs(moved).max(1)
    mean = np.abs(moved.mean(1)) / system.gap_m
    swing = largest / system.gap_m
    m = system.exponent
    q = np.maximum(system.q, 1)
    spring = q * m * mean + m * swing + q * m * (m + 1) * swing**2
    return float(spring.max()) + 4 * float((system.pull_n_per_a2 * largest).sum()) / system.inductance_h


def _root_voltage(lines: DecayingTones, resistance: float, inductance: float, time_s: np.ndarray) -> np.ndarray:
    """Return the voltage ``R i + L di/dt`` in V of a current whose square is a sum of tones in A².

    ``di/dt = (i²)'/(2i)``.
    """
    slope = 2 * np.pi * lines.frequency_hz * lines.amplitude
    quarter = lines._replace(amplitude=slope, phase_rad=lines.phase_rad + np.pi / 2)
    current = np.sqrt(signal(lines, time_s))
    return np.asarray(resistance * current + inductance * signal(quarter, time_s) / (2 * current))


EFFORTS = (0.1, 0.3, 1.0)
"""Shares of the random sets that are improved, and of the linear programs."""


def allocation_ladders(scene: Scene) -> Iterator[Ladder]:
    """Yield a ladder of models of the selectivity of a coil's channels in the band; nothing for one channel per coil.

    It is of all states, with equal masses.
    """
    spec = scene.plan.spec
    drive = scene.plan.selectivity.drive
    count = len(scene.plan.sets[0])
    if count < 2:
        return
    asked = (spec, drive, count)
    low, high = spec.band_hz
    yield Ladder(
        "allocation",
        f"{count} channels in {low:g} … {high:g} Hz, driven {drive}",
        "ON over OFF amplitude in all states",
        "",
        (
            Rung("paper's bound", "slots of Eq. 12", partial(bound_promise, spec, count)),
            Rung("exact response", "one channel on", partial(geometric_on_off_ratio, *asked, True)),
            Rung("exact response", "all states", partial(geometric_on_off_ratio, *asked, False)),
            *(
                Rung("optimised", f"{effort:.0%} of the search", partial(optimal_ratio, *asked, effort), "optimised")
                for effort in EFFORTS
            ),
        ),
        "optimised",
        note="the first three are of resonances spread evenly in octaves, the others of the best that a search finds;"
        " docs/selectivity.md compares these with what has been proven",
    )


def bound_promise(spec: Spec, count: int) -> Solved:
    """Return the paper's Δy (Eq. 12) for `count` channels in geometric progression: ``4 Q (ρ − 1)/(ρ + 1)``."""
    ratio = (spec.band_hz[1] / spec.band_hz[0]) ** (1 / (count - 1))
    return Solved(np.array([4 * spec.q_min * (ratio - 1) / (ratio + 1)]))


def geometric_on_off_ratio(spec: Spec, drive: str, count: int, one_hot: bool) -> Solved:
    """Return smallest ON / largest OFF amplitude of geometrically spaced resonances, in all states or with one ON."""
    which = _resonators(spec, geometric_ladder(*spec.band_hz, count))
    scheme = scheme_named(spec, drive)
    return _as_ratio(one_hot_db(which, scheme) if one_hot else all_states(which, scheme).db, count)


def optimal_ratio(spec: Spec, drive: str, count: int, effort: float) -> Solved:
    """Return ON over OFF amplitude in all states for the best resonances that a search of this `effort` finds."""
    scheme = scheme_named(spec, drive)
    ladder = optimal_ladder(*spec.band_hz, count, spec.q_min, level_law(spec), scheme, effort)
    return _as_ratio(all_states(_resonators(spec, ladder), scheme).db, count)


def _resonators(spec: Spec, resonance_hz: np.ndarray) -> Channels:
    return channels(resonance_hz, spec.q_min, level_law(spec)(resonance_hz))


def _as_ratio(decibel: float, count: int) -> Solved:
    return Solved(np.array([10 ** (decibel / 20)]), unknowns=count)


CHORDS_MM = (0.04, 0.01, 0.0025, 0.000625, 0.00015625)
INTEGRATED_TO = (1e-3, 1e-6, 1e-9)
KERNEL = ("build123d", "padgen.solid.taxel")
CHORD = "mesh, chord and angle together"


def geometry_ladders(scene: Scene) -> Iterator[Ladder]:
    """Yield a ladder of meshes and exact integrals for the volumes of distinct taxels with their sub-cells' frames."""
    from padgen.solid.mesh import ANGLE_RAD, CHORD_MM

    count = len(distinct_channels(scene.plan))
    model = partial(taxel_solids, scene.plan)
    # The height of a segment goes with the square of its angle.
    finenesses = [(chord, ANGLE_RAD * (chord / CHORD_MM) ** 0.5) for chord in CHORDS_MM]
    meshes = (
        Rung(
            "mesh",
            f"chord {chord:.2g} mm, {angle:.2g} rad",
            partial(mesh_volumes, chord, angle),
            CHORD,
            chord,
            KERNEL,
            prepare=model,
        )
        for chord, angle in finenesses
    )
    integrals = (
        Rung(
            "B-rep",
            f"integrated to {tolerance:g}",
            partial(exact_volumes, tolerance),
            "B-rep",
            imports=KERNEL,
            prepare=model,
            offered=False,
        )
        for tolerance in INTEGRATED_TO
    )
    yield Ladder(
        "geometry",
        f"{count} distinct taxel{'s' if count > 1 else ''}",
        "volume of the printed solid",
        "mm³",
        (*meshes, *integrals),
        "B-rep",
        "each",
        {CHORD: Theory(1, "a segment's area goes with its height, the chord tolerance", True)},
        f"a build meshes with a chord of {CHORD_MM:g} mm and {ANGLE_RAD:g} rad; the unknowns are triangles and faces",
    )


def taxel_solids(plan: Plan) -> list[Any]:
    """Make the build123d solids of all distinct taxels."""
    from padgen.solid.taxel import taxel_solid

    return [taxel_solid(plan, channel) for channel in distinct_channels(plan)]


def mesh_volumes(chord_mm: float, angle_rad: float, solids: list[Any]) -> Solved:
    """Return the volumes in mm³ inside triangle meshes of the solids, for tolerances of chord and angle."""
    from padgen.solid.mesh import signed_volume_mm3, tessellated

    meshes = [tessellated(solid, chord_mm, angle_rad) for solid in solids]
    return Solved(
        np.array([signed_volume_mm3(mesh) for mesh in meshes]), unknowns=sum(len(m.triangles) for m in meshes)
    )


def exact_volumes(tolerance: float, solids: list[Any]) -> Solved:
    """Integrate the volumes of the solids in mm³ adaptively over their faces, to a relative `tolerance`."""
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    from padgen.solid.kernel import kernel_errors

    volumes = []
    with kernel_errors("a volume"):
        for solid in solids:
            properties = GProp_GProps()
            BRepGProp.VolumeProperties_s(solid.wrapped, properties, tolerance)
            volumes.append(float(properties.Mass()))
    return Solved(np.array(volumes), unknowns=sum(len(solid.faces()) for solid in solids))


AXISYMMETRIC = ((3, 1), (4, 2), (5, 3), (6, 4))
SOLID = ((2, 1), (3, 2), (4, 3))
"""(order of the elements, refinements of the mesh at the edges of steel): both grow at a time."""
ORDER_NOTE = "the order is that of the polynomials in an element, and the mesh is refined at the edges"
COAXIAL = "axisymmetric field"
OFF_AXIS = "3-D field"
FIELD_ENGINE = ("ngsolve", "netgen.occ", "netgen.geom2d", "scipy.sparse.linalg", "padgen.verify.field_solid")
LEAST_OFFSET_MM = 1e-3


def force_ladders(scene: Scene) -> Iterator[Ladder]:
    """Yield a ladder of models of the coil's pull for each distance of a studied washer from the coil's axis."""
    coil, washer = magnetic_parts(scene.plan.spec)
    gap = scene.plan.spec.coil.gap_mm
    distances = {round(c.site.coil_distance_mm, 3) for c in chosen_channels(scene.plan)}
    for offset in sorted({distance if distance >= LEAST_OFFSET_MM else 0.0 for distance in distances}):
        pull = PullQuestion(coil, washer, gap * MM, offset * MM)
        place = f"{offset:g} mm off the axis" if offset else "on the axis"
        coaxial = () if offset else ((COAXIAL, axisymmetric_pull, AXISYMMETRIC),)
        fields = (
            Rung(model, _resolution(*step), partial(solve, pull, *step), model, imports=FIELD_ENGINE)
            for model, solve, steps in (*coaxial, (OFF_AXIS, three_d_pull, SOLID))
            for step in steps
        )
        yield Ladder(
            "force",
            f"{place}, gap {gap:g} mm",
            "pull over the current's square",
            "N/A²",
            (
                Rung("paper", "Eq. 4 as printed", partial(paper_pull, pull)),
                Rung("charges", "on core and washer", partial(charges_pull, pull)),
                *fields,
            ),
            OFF_AXIS if offset else COAXIAL,
            note=f"steel is linear, with the catalogue's permeability; {ORDER_NOTE} of steel; the paper's Eq. 4 leaves"
            " out the air gap and counts the core's permeability squared, so that it is decades off",
        )


def _resolution(order: int, levels: int) -> str:
    times = ("not refined", "refined once", f"refined {levels} times")[min(levels, 2)]
    return f"order-{order} elements, {times}"


def paper_pull(pull: PullQuestion) -> Solved:
    """Return the pull in N/A² by the paper's Eq. 4 as printed, with the core's area or, without a core, the bore's."""
    diameter = pull.coil.core_diameter or min(winding.inner_diameter for winding in pull.coil.windings)
    return Solved(np.array([paper_force_constant(pull.coil, pi / 4 * diameter**2)]))


def charges_pull(pull: PullQuestion) -> Solved:
    """Return the pull in N/A² by surface charges on core and washer, without saturation, as plans do."""
    pulls = solved_pulls(pull.coil, pull.washer, np.array([pull.gap_m]), np.array([pull.offset_m]))
    return Solved(pulls.pull, float(pulls.error[0]))


def axisymmetric_pull(pull: PullQuestion, order: int = 5, levels: int = 4, scalar: bool = False) -> Solved:
    """Return the pull in N/A² by axisymmetric finite elements of `order`: the mean of solutions by two potentials.

    These are the scalar and the vector potential; with `scalar`, the scalar one's answer alone.
    """
    steels = pull.core_steel, pull.washer_steel
    force = axisymmetric_force(pull.coil, pull.washer, pull.gap_m, pull.current_a, *steels, order=order, levels=levels)
    force_n = force.scalar_n if scalar else force.force_n
    answer = np.array([-force_n / pull.current_a**2])
    return Solved(answer, force.error, force.residual, unknowns=force.unknowns)


def three_d_pull(pull: PullQuestion, order: int = 3, levels: int = 1) -> Solved:
    """Return the axial pull in N/A² by 3-D elements of `order`."""
    force = solid_pull(pull, order, levels)
    answer = np.array([-float(force.wrench[0, 2]) / pull.current_a**2])
    return Solved(answer, force.error, force.residual, unknowns=force.unknowns)


GRADED = ((2, 0), (2, 1), (3, 1), (3, 2), (4, 3), (5, 4))
"""(order, levels of refinement at the edges that matter), as `solve_modes` has them; the last steps refine both."""
ELEMENTS = (1, 2, 4, 8)
FULL = 4
FRAME = "frame, cubic elements"
FRAMES = ("padgen.verify.taxel_frame",)
REFERENCE = "solid, graded"
THEORY = {
    FRAME: Theory(
        4, "cubic shapes and consistent mass; the flares are cut into a fixed number of slices, whose error stays"
    ),
}
ENGINE = ("ngsolve", "netgen.occ", "scipy.sparse.linalg", "padgen.verify.elasticity")


def structure_ladders(scene: Scene) -> Iterator[Ladder]:
    """Yield a ladder of models of a taxel's working resonance, point mass to 3-D elements, for each studied channel."""
    plan = scene.plan
    for place, channel in enumerate(chosen_channels(plan)):
        taxel = (plan.spec, channel)
        step = scene.step_path(channel)
        frame = partial(beam_elements_hz, *taxel)
        frames = (
            Rung("frame", f"{count} element{plural(count)} a beam", partial(frame, count), FRAME, 1 / count, FRAMES)
            for count in ELEMENTS
        )
        solids = (
            Rung("solid", _resolution(*each), partial(graded_hz, plan, channel, step, *each), REFERENCE, imports=ENGINE)
            for each in GRADED
        )
        yield Ladder(
            "structure",
            f"taxel of channel {channel.index}",
            "working resonance",
            "Hz",
            (
                Rung("rule", "the paper's point mass", partial(rule_hz, *taxel)),
                Rung("beam", "rigid plate, 6 degrees of freedom", partial(beam_hz, *taxel)),
                *frames,
                Rung("frame", f"{FULL} higher-order elements a beam", partial(frame, FULL, True), imports=FRAMES),
                *solids,
            ),
            REFERENCE,
            theory=THEORY,
            note=f"{ORDER_NOTE} that hold much energy",
            before=None if place else partial(value_from_process, write_steps, scene),
        )


def _model(spec: Spec, channel: Channel) -> TaxelModel:
    beam = channel.beam
    shape = BeamShape(beam.width_mm, beam.thickness_mm, beam.length_mm)
    return TaxelModel(spec, beam.topology, plate_shape(spec), shape)


def rule_hz(spec: Spec, channel: Channel) -> Solved:
    """Return a taxel's resonance in Hz by the paper's point-mass rule (Eq. 1 and 2)."""
    return Solved(np.array([_model(spec, channel).rule_hz]))


def beam_hz(spec: Spec, channel: Channel) -> Solved:
    """Return a taxel's resonance in Hz by the beam model, which plans are made with."""
    return Solved(np.array([_model(spec, channel).resonance_hz]), unknowns=6)


def beam_elements_hz(spec: Spec, channel: Channel, elements: int, inner: bool = False) -> Solved:
    """Return a taxel's resonance in Hz by beam elements, `elements` along each beam, of higher order if `inner`."""
    from padgen.verify.frame import frame_modes
    from padgen.verify.taxel_frame import taxel_frame

    model = _model(spec, channel)
    frame = taxel_frame(model, elements)
    frame = frame if inner else frame._replace(bubbles=0)
    modes = frame_modes(frame)
    arm = np.asarray(model.washer_point_m) - frame.bodies[0].body.centroid
    plate = modes.body_motion[:, 0]
    vertical = plate[:, 2] + plate[:, 3] * arm[1] - plate[:, 4] * arm[0]
    working = int(np.abs(vertical / modes.frequency_hz).argmax())
    unknowns = 6 * (len(frame.nodes) - len(frame.clamped))
    return Solved(modes.frequency_hz[[working]], residual=modes.residual, unknowns=unknowns)


def graded_hz(plan: Plan, channel: Channel, step: Path, order: int, levels: int) -> Solved:
    """Return a taxel's resonance in Hz by 3-D elements of `order`, refined `levels` times at edges of high energy."""
    from padgen.make.solid_tuning import solid_taxel
    from padgen.verify.elasticity import solve_modes

    modes = solve_modes(solid_taxel(plan, channel, step), order, levels)
    return Solved(
        np.array([modes.modes.frequency_hz[modes.modes.working]]), residual=modes.residual, unknowns=modes.unknowns
    )


ORDERS = (2, 3, 4)
ON_FRAME = "taxels on the frame"
FRAME_ENGINE = ("ngsolve", "netgen.occ", "scipy.linalg", "padgen.verify.pad_frame")


def pad_ladders(scene: Scene) -> Iterator[Ladder]:
    """Yield a ladder of models of the resonance of each channel's most central taxel on the pad's elastic frame.

    The frame is held by its screws or, without holes, glued down.
    """
    plan = scene.plan
    clamping = "corners" if scene.plan.spec.pad.hole_diameter_mm else "bottom"
    solve = partial(pad_hz, plan, clamping)
    yield Ladder(
        "pad",
        f"{len(plan.taxels)} taxels held at the {clamping}",
        "resonance of each channel on the frame",
        "Hz",
        (
            Rung("clamped sub-cell", "no frame around it", partial(planned_hz, plan)),
            *(
                Rung(ON_FRAME, f"order-{order} elements", partial(solve, order), ON_FRAME, imports=FRAME_ENGINE)
                for order in ORDERS
            ),
        ),
        ON_FRAME,
        "each",
        note="the frame alone is a solid; taxels are the plan's, whose error the structure ladder tells",
    )


def planned_hz(plan: Plan) -> Solved:
    """Return each channel's resonance as planned, with all sides of its sub-cell held."""
    return Solved(np.array([plan.channels[c].resonance_hz for c in sorted({t.channel for t in plan.taxels})]))


def pad_hz(plan: Plan, clamping: str, order: int) -> Solved:
    """Return each channel's resonance in Hz as shifted by the pad's elastic frame, at its most central taxel."""
    from padgen.verify.pad_frame import central_taxels, pad_modes, shift

    modes, held = pad_modes(plan, clamping, order)
    moved = [1 + shift(plan, modes, held, taxel) for taxel in central_taxels(plan)]
    return Solved(planned_hz(plan).values * moved, unknowns=modes.unknowns)


SKIN_STEPS = ((2, 0.1), (3, 0.05), (4, 0.02))
"""(order of the elements, size of the smallest one over the radius)."""
LAYERS = "layers by elements"
SKIN_ENGINE = ("ngsolve", "netgen.meshing", "scipy.sparse.linalg", "padgen.verify.layered_skin")
GUARD_RATIO = 2.0


def skin_ladders(scene: Scene) -> Iterator[Ladder]:
    """Yield two ladders on the dynamic stiffness of typical skin: free, and held by a plate round the contactor."""
    plan = scene.plan
    radius = plan.plate.boss_diameter_mm / 2 * MM
    hz = tuple(dict.fromkeys((plan.channels[0].resonance_hz, plan.channels[-1].resonance_hz)))
    for ratio, place in ((inf, "free skin"), (GUARD_RATIO, f"in a plate's hole {GUARD_RATIO:g} times as wide")):
        contactor = Contactor(radius, ratio)
        yield Ladder(
            "skin",
            f"{place}, contactor of {plan.plate.boss_diameter_mm:g} mm",
            f"dynamic stiffness at {' and '.join(number(each) for each in hz)} Hz, real and imaginary",
            "N/m",
            (
                Rung("half-space", "as wide as the contactor", partial(lumped_skin, contactor, hz, False)),
                Rung("half-space", "with an outer layer, as planned", partial(lumped_skin, contactor, hz, True)),
                *(
                    Rung(
                        LAYERS,
                        f"order-{order} elements from {finest:g} radii on",
                        partial(layered_skin, contactor, hz, order, finest),
                        LAYERS,
                        imports=SKIN_ENGINE,
                    )
                    for order, finest in SKIN_STEPS
                ),
            ),
            LAYERS,
            note="layers of the typical fingertip; what real skin is differs by far more (docs/touch.md)",
        )


def lumped_skin(contactor: Contactor, hz: Sequence[float], is_layered: bool) -> Solved:
    """Return real and imaginary part of skin's dynamic stiffness in N/m in closed form, with or without outer layer."""
    outer, below = LAYERED
    layer = layer_radius(outer.thickness, outer.shear, below.shear) if is_layered else 0.0
    skin = HalfSpace(4 * below.shear, layer, below.time)
    stiffness = skin.impedance(np.array(hz), contactor).dynamic_stiffness(hz)
    return Solved(_parts(stiffness), float(skin.error(np.array(hz), contactor).max()))


def layered_skin(contactor: Contactor, hz: Sequence[float], order: int, finest: float) -> Solved:
    """Return real and imaginary part of skin's dynamic stiffness in N/m by finite elements of its layers."""
    asked = (SkinQuestion(float(contactor.radius), each, LAYERED, float(contactor.hole_ratio)) for each in hz)
    answers = [solve_skin(question, order, finest) for question in asked]
    stiffness = np.array([answer.stiffness for answer in answers])
    residual = max(answer.residual for answer in answers)
    return Solved(_parts(stiffness), residual=residual, unknowns=sum(answer.unknowns for answer in answers))


def _parts(values: np.ndarray) -> np.ndarray:
    return np.stack([values.real, values.imag])


LADDERS: dict[str, Callable[[Scene], Iterable[Ladder]]] = {
    "allocation": allocation_ladders,
    "geometry": geometry_ladders,
    "dynamics": dynamics_ladders,
    "force": force_ladders,
    "skin": skin_ladders,
    "structure": structure_ladders,
    "pad": pad_ladders,
}
"""The ladders by name, in the order in which they run: the quick ones first."""
