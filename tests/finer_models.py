"""Finer models of the terms that a plan leaves out: each gives the true size of a term, found apart from its bound.

Each function takes a plan and returns the largest relative error over its channels, or over `MOST_CHANNELS` of them
where a channel takes long; None where the plan has nothing of the term. `tests/planner/test_left_out.py` and
`docs/measure_left_out.py` compare these errors with the bounds.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import ceil, inf, pi
from typing import NamedTuple
from unittest.mock import patch

import numpy as np

import padgen.physics.pull as pull_module
from padgen.core.units import G_PER_CM3, GPA, GRAM, MA, MH, MM, UM
from padgen.physics.beams import EndCompliance, tip_stiffness
from padgen.physics.bounds import beam_inertia, core_polarisation, saturation_loss, washer_magnetised
from padgen.physics.magnetics import (
    MU_0,
    CoilSource,
    SteelBody,
    SteelRing,
    charged_core,
    fine_rings,
    ring_potential,
    saturating,
    steel_body,
    tube_outline,
    winding_rings,
)
from padgen.physics.modes import BeamPlacement, Modes, RigidBody, suspended_modes
from padgen.physics.pull import PullAt, leakage
from padgen.physics.resonator import TaxelModes, felt_energy
from padgen.physics.schemes import bias_a, current_lines_a
from padgen.planner.channels import (
    coil_modes,
    hanging_gap_um,
    heard_modes,
    site_wrenches,
    working_mode_ratios,
)
from padgen.planner.drive_scheme import coils_around, placed_channels
from padgen.planner.movers.washer import magnetic_parts
from padgen.planner.plan import Channel, Plan
from padgen.planner.suspensions import BeamShape, PlateShape
from padgen.planner.taxel_model import TaxelModel
from padgen.spec import Spec
from padgen.verify.field_solid import PlacedWasher, PullQuestion, Steel, solid_force
from padgen.verify.frame import AttachedBody, Element, Frame, divided, frame_modes, rectangle
from padgen.verify.pad_frame import PadModes, peak_hz
from padgen.verify.propagation import DecayingTones

MOST_CHANNELS = 4
AIR_KG_PER_M3 = 1.2
AIR_PA_S = 1.8e-5


def some(plan: Plan) -> list[Channel]:
    """Return the lowest channels, which move most, and the highest."""
    channels = plan.channels
    return list(dict.fromkeys([*channels[: MOST_CHANNELS - 1], channels[-1]]))


# The pull, solved where the washer hangs and swings.


class PullCurve(NamedTuple):
    """Pull on a channel's own mode over the pull at rest, a polynomial in ln gap; gaps at rest and nearest in µm."""

    shape: np.polynomial.Polynomial
    rest_um: float
    least_um: float

    def at(self, nearer_um):
        return self.shape(np.log(self.rest_um - np.asarray(nearer_um)))


CURVES: dict[int, tuple[Channel, PullCurve | None]] = {}
"""Curves by the channel's identity, since gap and softening need the same ones."""


def pull_curve(plan: Plan, channel: Channel) -> PullCurve | None:
    if id(channel) not in CURVES:
        if len(CURVES) > 16:
            CURVES.clear()
        CURVES[id(channel)] = channel, solved_curve(plan, channel)
    return CURVES[id(channel)][1]


def solved_curve(plan: Plan, channel: Channel, nodes: int = 8) -> PullCurve | None:
    """Solve surface charges at `nodes` gaps; None where the washer would come nearer than a twentieth of its gap."""
    spec = plan.spec
    rest_um = float(hanging_gap_um(spec, channel.sag_um))
    least_um = rest_um - 1.5 * channel.static_um - 1.1 * channel.level_um
    if least_um < rest_um / 20:
        return None
    least_um = min(least_um, 0.75 * rest_um)
    lows = np.log(least_um)
    high = np.log(max(rest_um + 1.1 * channel.level_um, 1.2 * rest_um))
    at = (lows + high) / 2 + (high - lows) / 2 * np.cos(np.pi * (np.arange(nodes) + 0.5) / nodes)
    modes = TaxelModes(np.array(channel.modes_hz), np.array(channel.mode_motions))
    offset = channel.site.coil_distance_mm * MM

    # At all gaps with as many nodes as the smallest asks for: steps in their number are steps of the pull.
    fine = pull_module._fineness(*magnetic_parts(spec), least_um * UM, offset)

    def on_mode(log_um: float) -> float:
        with patch.object(pull_module, "_fineness", lambda *_: fine):
            found = pull_module.pull(*magnetic_parts(spec), float(np.exp(log_um)) * UM, offset)
        pulled = PullAt(*(np.array([v]) for v in (-found.axial, found.side, found.moment, *[0.0] * 8)))
        return -found.axial * float(working_mode_ratios([modes], site_wrenches(spec, pulled, [channel.site]))[0])

    rest = on_mode(float(np.log(rest_um)))
    if rest <= 0:
        return None
    shape = np.polynomial.Polynomial.fit(at, [on_mode(v) / rest for v in at], nodes - 1)
    return PullCurve(shape, rest_um, least_um)


def balance(channel: Channel, curve: PullCurve) -> tuple[float, float] | None:
    """Return the deflection by a constant mean pull and the one in balance, in µm; None where nothing balances."""
    gap = curve.rest_um
    static = channel.static_um
    slack = static * max(1 - static / gap, 0) ** max(channel.pull_exponent, 0)
    z = np.linspace(0, gap - curve.least_um - channel.level_um, 4001)
    over = z - slack * curve.at(z)
    if not (over >= 0).any():
        return None
    at = int((over >= 0).argmax())
    return slack, float(z[at] - (z[1] * over[at] / (over[at] - over[at - 1]) if at else 0.0))


SWING = 2 * np.pi * (np.arange(48) + 0.5) / 48


def true_gap(plan: Plan) -> float:
    """Compare the pull where the washer hangs in balance, averaged over a swing, with the plan's pull at rest."""
    true = []
    for channel in some(plan):
        curve = pull_curve(plan, channel)
        found = curve and balance(channel, curve)
        if not found:
            return inf
        true.append(abs(curve.at(found[1] + channel.level_um * np.sin(SWING)).mean() - 1))
    return float(max(true))


def true_softening(plan: Plan) -> float:
    """Compute the resonance lowered by the pull's slope about the place of balance, over the whole swing."""
    true = []
    for channel in some(plan):
        curve = pull_curve(plan, channel)
        found = curve and balance(channel, curve)
        if not found:
            return inf
        slack, static = found
        swung = curve.at(static + channel.level_um * np.sin(SWING)) * np.sin(SWING)
        share = slack * 2 * swung.mean() / channel.level_um
        true.append(1 - np.sqrt(max(1 - share, 0.0)))
    return float(max(true))


# The coil's current.


def squares_at_worst(plan: Plan, own, k: int, phase: np.ndarray) -> np.ndarray:
    """Return the largest i² (A²) where channel k's own line of i² is at `phase`, and the others' at any phase."""
    scheme = plan.scheme
    lines = np.array([c.line_a2 for c in own])
    others = np.delete(np.arange(len(own)), k)
    if scheme.name == "spur-free":
        return (1 + plan.spec.drive.headroom) * lines.sum() + lines[k] * np.cos(phase) + lines[others].sum()
    tones = current_lines_a(scheme, lines)
    if scheme.name == "biased":
        return (bias_a(scheme, lines) + tones[k] * np.cos(phase) + tones[others].sum()) ** 2
    return (tones[k] * np.abs(np.cos(phase / 2)) + tones[others].sum()) ** 2


def true_switching(plan: Plan) -> float | None:
    """Compute the free motion after switching off, from vibration, mean deflection and the dying current's pull."""
    spec = plan.spec
    delays = []
    lag = spec.coil.inductance_mh * MH / spec.coil.resistance_ohm
    phase = np.linspace(0, 2 * np.pi, 181)
    for channel in plan.channels:
        if channel.ring_down_ms <= 0:
            continue
        own = plan.sets[channel.index % len(plan.sets)]
        w = 2 * np.pi * channel.resonance_hz
        tau = channel.ring_up_ms * 1e-3
        root = complex(-1 / tau, w * np.sqrt(1 - 1 / (4 * channel.q**2)))
        worst = squares_at_worst(plan, own, own.index(channel), phase)
        least = 0 * phase
        for square in (worst, least):
            pushed = square * channel.force_constant_n_per_a2 / channel.stiffness_n_per_m / UM
            fall = -2 / lag if lag > 0 else -1e12
            forced = pushed * w**2 / (fall**2 + w / channel.q * fall + w**2)
            start = channel.level_um * np.sin(phase) + channel.static_um - forced
            speed = channel.level_um * w * np.cos(phase) - forced * fall
            amplitude = np.hypot(start, (speed - root.real * start) / root.imag).max() / channel.level_um
            delays.append(np.log(amplitude) / (channel.ring_down_ms / channel.ring_up_ms))
    return float(max(delays)) if delays else None


def true_motion(plan: Plan) -> float:
    """Integrate the current with the flux of a moving washer; return the largest error over the channel's own tone."""
    spec = plan.spec
    scheme = plan.scheme
    resistance = spec.coil.resistance_ohm
    inductance = spec.coil.inductance_mh * MH
    true = []
    for channel in some(plan):
        if channel.line_a2 <= 0:
            continue
        own = plan.sets[channel.index % len(plan.sets)]
        lines = np.array([c.line_a2 for c in own])
        k = own.index(channel)
        swing = 2 * np.pi * channel.resonance_hz
        settle = ceil((8 * inductance / resistance) * channel.resonance_hz / 2) * 2 / channel.resonance_hz
        per_period = 400
        steps = ceil((settle + 4 / channel.resonance_hz) * channel.resonance_hz * per_period)
        if steps > 400_000:
            continue
        t = np.arange(steps + 1) / (channel.resonance_hz * per_period)
        if scheme.name == "spur-free":
            constant = (1 + spec.drive.headroom) * lines.sum()
            planned = np.sqrt(constant + lines[k] * np.cos(swing * t))
            tone = lines[k] / 2 / np.sqrt(constant)
            moved = np.sin(swing * t)
        elif scheme.name == "biased":
            tone = current_lines_a(scheme, lines)[k]
            planned = bias_a(scheme, lines) + tone * np.sin(swing * t)
            moved = -np.cos(swing * t)
        else:
            tone = current_lines_a(scheme, lines)[k]
            planned = tone * np.sin(swing / 2 * t)
            moved = -np.sin(swing * t)
        flux = 2 * channel.force_constant_n_per_a2 * channel.level_um * UM * moved
        # Of δ = current − planned: d/dt((L + flux) δ) + R δ = −d/dt(flux · planned); midpoint rule on (L + flux) δ.
        source = -np.diff(flux * planned)
        rate = resistance / (inductance + (flux[1:] + flux[:-1]) / 2) * (t[1] - t[0]) / 2
        if (inductance + flux).min() <= 0:
            true.append(inf)
            continue
        linked = 0.0
        error = np.empty(steps)
        keep = ((1 - rate) / (1 + rate)).tolist()
        add = (source / (1 + rate)).tolist()
        for i in range(steps):
            linked = keep[i] * linked + add[i]
            error[i] = linked
        error /= inductance + flux[1:]
        true.append(np.abs(error[-4 * per_period :]).max() / tone)
    return float(max(true, default=0.0))


# Beams: no fillets, no Poisson's ratio and no give but rotations of the ends, since the elements have no others.


class Suspended(NamedTuple):
    body: RigidBody
    beams: list[BeamPlacement]
    modes: Modes
    working: np.ndarray
    elastic: tuple[float, float, float]


def suspended(spec: Spec, plan: Plan, topology: str, shape: BeamShape) -> Suspended:
    plate = PlateShape(plan.plate.length_mm, plan.plate.width_mm, plan.plate.thickness_mm)
    material = replace(spec.material, poisson_ratio=0.0)
    bare = replace(spec, material=material, taxel=replace(spec.taxel, fillet_mm=0.0))
    model = TaxelModel(bare, topology, plate, shape)
    elastic = material.youngs_modulus_gpa * GPA, 0.0, material.density_g_per_cm3 * G_PER_CM3
    beams = [
        beam._replace(
            section=beam.section._replace(ends=EndCompliance(root=beam.section.ends.root, tip=beam.section.ends.tip))
        )
        for beam in model.placements
    ]
    modes = suspended_modes(model.body, beams, *elastic)
    compliance = modes.at_point(model.washer_point_m)[2] ** 2 / modes.frequency_hz**2
    return Suspended(model.body, beams, modes, np.asarray(compliance.argmax()), elastic)


def element_error(taxel: Suspended, parts: int = 3) -> float:
    """Return by how much the condensed beams' resonance is above that of many elements, relative."""
    modulus, _, density = taxel.elastic
    nodes = []
    elements = []
    roots = []
    tips = []
    for beam in taxel.beams:
        section = beam.section
        tip = np.asarray(beam.tip, float)
        root = tip - np.array([*np.asarray(beam.direction, float), 0.0]) * float(section.length)
        points, pairs = divided(root, tip, parts, sum(map(len, nodes)))
        cut = rectangle(float(section.width), float(section.thickness), 0.0, float(section.across))
        for k, (a, b) in enumerate(pairs):
            gives = [
                (float(give) / (modulus * cut.inertia_up), 0.0) if there else (0.0, 0.0)
                for give, there in ((section.ends.root, k == 0), (section.ends.tip, k == parts - 1))
            ]
            elements.append(Element(a, b, cut, modulus, modulus / 2, density, (0.0, 0.0, 1.0), *gives))
        nodes.append(points)
        roots.append(pairs[0][0])
        tips.append(pairs[-1][1])
    body = AttachedBody(taxel.body, tuple(tips))
    solved = frame_modes(Frame(np.concatenate(nodes), tuple(elements), (body,), tuple(roots), bubbles=3), 8)
    ratio = taxel.modes.frequency_hz[taxel.working] / solved.frequency_hz - 1
    return float(ratio[np.abs(ratio).argmin()])


def beam_shape(channel: Channel) -> BeamShape:
    return BeamShape(channel.beam.width_mm, channel.beam.thickness_mm, channel.beam.length_mm)


# Large motion: the elastica.


class Elastica(NamedTuple):
    """One beam under a vertical force at its washer: displacement, force, and the effective mass of its body."""

    z: np.ndarray
    force: np.ndarray
    mass: np.ndarray


def elastica(
    arm: float, body: tuple[float, float], ends: tuple[float, float], slender: float | None, most: float
) -> Elastica:
    """Solve a beam of unit length and bending stiffness, bent up to displacements of `most`.

    The washer lies `arm` beyond the tip; `body` is the body's centroid beyond the tip and its squared radius of
    gyration; `ends` are the turns of both ends per moment. `slender` is the stiffness along the beam times l³/EI: with
    it the tip neither turns nor moves along, as in half of a bridge, whose body only rises.
    """
    from scipy.optimize import root

    steps = 40

    def shape(force: float, held: tuple[float, float]) -> np.ndarray:
        """Return x, z, slope and moment at the tip, given the moment at the root and the force along."""
        moment, along = held
        y = np.array([0.0, 0.0, ends[0] * moment, moment])

        def rate(v: np.ndarray) -> np.ndarray:
            cosine = np.cos(v[2])
            sine = np.sin(v[2])
            stretch = 1 + (along * cosine + force * sine) / slender if slender else 1.0
            return np.array([stretch * cosine, stretch * sine, v[3], along * stretch * sine - force * stretch * cosine])

        h = 1 / steps
        for _ in range(steps):
            a = rate(y)
            b = rate(y + h / 2 * a)
            c = rate(y + h / 2 * b)
            y = y + h / 6 * (a + 2 * b + 2 * c + rate(y + h * c))
        return y

    def miss(held: np.ndarray, force: float) -> np.ndarray:
        x, _, slope, moment = shape(force, tuple(held))
        turned = slope + ends[1] * moment
        if slender:
            return np.array([turned, (x - 1) * slender / 10])
        return np.array([moment - force * arm * np.cos(turned), held[1]])

    # Straight beams first: what the moment at the root is, and how far the washer goes, by superposition.
    first = (1 / 2 + ends[1]) / (1 + ends[0] + ends[1]) if slender else 1 + arm
    free = first * ends[0] + first - 1 / 2  # slope at the tip
    compliance = first * ends[0] + first / 2 - 1 / 6 + (0.0 if slender else arm * (free + ends[1] * arm))
    force = most / compliance / 12
    held = []
    found = [(0.0, 0.0, 1 + body[0], 0.0, 0.0)]
    # Of a bridge the force along follows from how much a cubic shortens: 0.6 z².
    guess = np.array([force * first, 0.5 * (force * compliance) ** 2 * slender if slender else 0.0])
    while found[-1][0] < most and len(found) < 90:
        solved = root(miss, guess, (force,), method="lm", tol=1e-13)
        if not solved.success and np.abs(solved.fun).max() > 1e-6:
            raise ArithmeticError(f"no elastica at {force:.3g}: {solved.message}")
        x, z, slope, moment = shape(force, tuple(solved.x))
        turned = 0.0 if slender else slope + ends[1] * moment
        place = x + body[0] * np.cos(turned), z + body[0] * np.sin(turned)
        found.append((z + arm * np.sin(turned), force, *place, turned))
        more = 1 + 1 / len(found[1:]) if not slender else 1.2
        held.append((force, solved.x))
        guess = solved.x * np.array([more, more**2])
        force = force * more
        if len(held) > 2:
            (f0, a), (f1, b) = held[-2:]
            guess = b + (b - a) * (force - f1) / (f1 - f0)
    z, pulled, cx, cz, turn = np.array(found).T
    parts = (np.polynomial.Polynomial.fit(z, v, 7).deriv()(z) for v in (cx - cx[0], cz, turn))
    along, up, around = parts
    return Elastica(z, pulled, along**2 + up**2 + body[1] * around**2)


def elastica_rise(found: Elastica, level: float, away: float) -> float:
    """Return the relative rise of the resonance for motion of amplitude `level` about `away`, over small motion."""
    z = found.z[1:]
    scale = found.z[-1]
    # Both are even in z (force over z).
    stiffness, mass = (
        np.polynomial.Polynomial.fit((z / scale) ** 2, v, 5, domain=[0, 1])
        for v in (found.force[1:] / z, found.mass[1:])
    )

    def potential(v):
        x, weight = np.polynomial.legendre.leggauss(12)
        at = v[..., None] * (x + 1) / 2
        return (stiffness((at / scale) ** 2) * at * weight).sum(-1) * v / 2 - away * stiffness((away / scale) ** 2) * v

    high = away + level
    energy = potential(np.array(high))
    low_end = away
    low_start = away - 2.0 * level
    for _ in range(60):
        middle = (low_end + low_start) / 2
        low_end, low_start = (middle, low_start) if potential(np.array(middle)) < energy else (low_end, middle)
    low = (low_end + low_start) / 2
    angle = np.pi * (np.arange(64) + 0.5) / 64
    at = (high + low) / 2 + (high - low) / 2 * np.cos(angle)
    speed = np.sqrt(2 * np.maximum(energy - potential(at), 1e-300) / mass((at / scale) ** 2))
    half_period = ((high - low) / 2 * np.sin(angle) / speed).mean() * np.pi
    return float(np.pi / half_period / np.sqrt(stiffness(0.0) / mass(0.0)) - 1)


def motion_rise(plan: Plan, channel: Channel) -> float:
    """Return the elastica's rise of the resonance at a channel's level, about its sag and mean pull."""
    model = TaxelModel(
        plan.spec,
        channel.beam.topology,
        PlateShape(plan.plate.length_mm, plan.plate.width_mm, plan.plate.thickness_mm),
        beam_shape(channel),
    )
    placement = model.placements[0]
    section = placement.section
    length = channel.beam.length_mm * MM
    washer = model.washer_point_m
    tip = np.asarray(placement.tip, float)
    ends = float(section.ends.root) / length, float(section.ends.tip) / length
    body = model.body
    bridge = channel.hardening_per_mm2 > 0
    out = float(np.asarray(placement.direction)[0])
    arm, centre = ((float(v) - tip[0]) * out / length for v in (washer[0], body.centroid[0]))
    gyration = float(body.inertia[1, 1] / body.mass) / length**2
    modulus, poisson, _ = model.elastic
    bends = modulus * float(section.width * section.thickness**3) / 12
    # Along itself a beam is as stiff as the plan's model has it, ends included.
    slender = float(tip_stiffness(section, modulus, poisson)[0, 0]) * length**3 / bends if bridge else None
    level = channel.level_um * UM / length
    away = (channel.sag_um + channel.static_um) * UM / length
    hard = channel.hardening_per_mm2 * channel.beam.length_mm**2
    # Where all is of the second order it is found at larger motions, since digits run out.
    more = max((0.1 / np.sqrt(hard) if bridge else 0.03) / (level + away), 1.0)
    level = level * more
    away = away * more
    if bridge:
        arm = 0.0
        centre = 0.0
        gyration = 0.0
    most = min(away, (away / hard) ** (1 / 3)) * 1.2 if bridge else away
    found = elastica(arm, (centre, gyration), ends, slender, 1.15 * (level + most))
    if slender:  # the true offset is smaller: the beam has hardened
        small = found.force[1] / found.z[1]
        away = float(np.interp(away * small, found.force, found.z))
    return elastica_rise(found, level, away) / more**2


def is_straight(plan: Plan, channel: Channel) -> bool:
    return all(path.is_straight for path in plan.arrangement(channel).beams)


SHORT_FILLET = 0.1
"""Largest fillet over a beam's length up to which the elastica, a beam of one width, is the finer model."""


def true_stretching(plan: Plan) -> float | None:
    """Compare the plan's rise of the resonance with the elastica's for beams whose ends are held."""
    true = [
        abs(motion_rise(plan, c) - c.level_shift)
        for c in some(plan)
        if c.hardening_per_mm2 > 0 and is_straight(plan, c) and c.beam.fillet_mm <= SHORT_FILLET * c.beam.length_mm
    ]
    return max(true, default=None)


def true_large_slopes(plan: Plan) -> float | None:
    """Return the elastica's rise of free beams, for the channel that moves farthest for its length."""
    free = [c for c in plan.channels if c.hardening_per_mm2 == 0 and is_straight(plan, c)]
    farthest = max(free, key=lambda c: (c.sag_um + c.static_um + c.level_um) / c.beam.length_mm, default=None)
    return abs(motion_rise(plan, farthest)) if farthest else None


# Air.


class Moved(NamedTuple):
    """Square cells of side `side` m over the moving parts and around them.

    `at` (n, 2) is from the washer's axis in the taxel's own axes in m, `motion` over the washer's; `moves` and `slot`
    mark moving cells and open slots; `height` is the film's height over the coil in m.
    """

    at: np.ndarray
    side: float
    motion: np.ndarray
    moves: np.ndarray
    slot: np.ndarray
    height: float


def moved_cells(plan: Plan, channel: Channel, across: int, wide_mm: float) -> Moved:
    """Lay cells over a square of `wide_mm` about the washer; a beam moves as a cubic from its root to the plate."""
    arrangement = plan.arrangement(channel)
    side = wide_mm / across
    line = (np.arange(across) + 0.5) * side - wide_mm / 2
    x, y = np.meshgrid(line, line, indexing="ij")
    own_x = x + float(arrangement.washer_x_mm)
    motion = np.array(channel.mode_motions[int(np.argmax(channel.mode_shares))])
    rigid = 1 + (motion[3] * y - motion[4] * x) * MM / motion[2]
    moves = np.zeros(x.shape, bool)
    field = np.zeros(x.shape)
    for b in arrangement.blocks:
        inside = (own_x > b.low_x_mm) & (own_x < b.high_x_mm) & (y > b.low_y_mm) & (y < b.high_y_mm)
        moves |= inside
    field[moves] = rigid[moves]
    for path in arrangement.beams:
        x0, y0 = (float(v) for v in path.root_mm)
        direction = path.direction
        along = ((own_x - x0) * direction[0] + (y - y0) * direction[1]) / float(path.length_mm)
        beside = np.abs((y - y0) * direction[0] - (own_x - x0) * direction[1])
        inside = (along > 0) & (along < 1) & (beside < float(path.width_mm) / 2) & ~moves
        field[inside] = (rigid * along**2 * (3 - 2 * along))[inside]
        moves = moves | inside
    length, width = (float(v) for v in arrangement.window_mm)
    window = (own_x > 0) & (own_x < length) & (np.abs(y) < width / 2)
    slot = window & ~moves
    below = plan.plate.recess_depth_mm - plan.spec.washer.thickness_mm
    height = plan.spec.coil.gap_mm - below - (channel.sag_um + channel.static_um) * UM / MM
    return Moved(
        np.stack([x.ravel(), y.ravel()], -1) * MM, side * MM, field.ravel(), moves.ravel(), slot.ravel(), height * MM
    )


def true_air_mass(plan: Plan, across: int = 34) -> float | None:
    """Solve the potential flow of moving parts over the coil's plane, taken as infinite, by doublet panels."""
    true = []
    for channel in {c.beam.topology: c for c in reversed(plan.channels)}.values():
        length, width = (float(v) for v in plan.arrangement(channel).window_mm)
        window = 1.5 * max(length, width, 2 * float(plan.arrangement(channel).washer_x_mm))
        # Of long beams the part near the plate.
        cells = moved_cells(plan, channel, across, min(window, 3.2 * max(plan.plate.length_mm, plan.plate.width_mm)))
        if cells.height <= 0:
            return None
        panels = ~cells.slot
        at = cells.at[panels]
        half = cells.side / 2
        x, y = (at[:, None] - at[None]).transpose(2, 0, 1)

        def upward(high: float, x=x, y=y, half=half) -> np.ndarray:
            """Velocity along z of a square of unit doublets, `high` below: its rim as a vortex (Biot-Savart)."""
            total = np.zeros(x.shape)
            corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
            for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
                rx = x - ax
                ry = y - ay
                sx = x - bx
                sy = y - by
                r = np.sqrt(rx**2 + ry**2 + high**2)
                s = np.sqrt(sx**2 + sy**2 + high**2)
                cross = rx * sy - ry * sx
                square = cross**2 + high**2 * ((rx - sx) ** 2 + (ry - sy) ** 2)
                dx = bx - ax
                dy = by - ay
                total += cross * ((dx * rx + dy * ry) / r - (dx * sx + dy * sy) / s) / square
            return total / (4 * pi)

        normal = upward(0.0) - upward(2 * cells.height)
        jump = np.linalg.solve(normal, cells.motion[panels])
        mass = AIR_KG_PER_M3 * abs(jump @ cells.motion[panels]) * cells.side**2
        true.append(mass / (channel.effective_mass_g * GRAM) / 2)
    return float(max(true))


def true_air_damping(plan: Plan, across: int = 90) -> float | None:
    """Solve Reynolds' equation of the film over the coil by finite differences, with slots open to the air."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.linalg import spsolve

    coil_m = plan.spec.coil.outer_diameter_mm * MM / 2
    true = []
    for channel in some(plan):
        offset = channel.site.coil_distance_mm * MM
        reach = min(coil_m + offset, 3e-2)
        cells = moved_cells(plan, channel, across, 2 * reach / MM)
        if cells.height <= 0:
            return None
        cosine, sine = {"+x": (1, 0), "+y": (0, 1), "-x": (-1, 0), "-y": (0, -1)}[channel.site.along]
        x, y = channel.site.washer_mm
        axis = -np.array([cosine * x + sine * y, -sine * x + cosine * y]) * MM
        over = ((cells.at - axis) ** 2).sum(1) < (coil_m - cells.side / 2) ** 2  # beyond them the pressure is none
        film = cells.height**3 / (12 * AIR_PA_S)
        slot_wide = plan.plate.gap_mm * MM
        through = slot_wide**2 / (12 * AIR_PA_S * plan.plate.thickness_mm * MM) * cells.side**2
        number = np.full(across**2, -1)
        number[over] = np.arange(over.sum())
        grid = number.reshape(across, across)
        rows = []
        columns = []
        values = []
        diagonal = np.where(cells.slot, through, 0.0)[over] + 4 * film
        for a, b in ((grid[:-1], grid[1:]), (grid[:, :-1], grid[:, 1:])):
            both = (a >= 0) & (b >= 0)
            rows += [a[both], b[both]]
            columns += [b[both], a[both]]
            values += [np.full(2 * both.sum(), -film)]
        rows = np.concatenate([*rows, np.arange(len(diagonal))])
        columns = np.concatenate([*columns, np.arange(len(diagonal))])
        matrix = coo_matrix((np.concatenate([*values, diagonal]), (rows, columns))).tocsc()
        squeezed = np.where(cells.moves, cells.motion, 0.0)[over] * cells.side**2
        pressure = spsolve(matrix, squeezed)
        added = float(pressure @ squeezed) / np.sqrt(channel.stiffness_n_per_m * channel.effective_mass_g * GRAM)
        true.append(added * channel.q / (1 + added * channel.q))
    return float(max(true))


# Modes.


def beam_inertia_of(taxel: Suspended) -> tuple[float, float]:
    """Bound and true error of the resonance."""
    return float(condensed_bound(taxel)[0]), abs(element_error(taxel))


def condensed_bound(taxel: Suspended) -> np.ndarray:
    modes = taxel.modes
    of = modes.shape.T[None], modes.reference, modes.frequency_hz[None], taxel.working[None]
    return beam_inertia(taxel.beams, *of, *taxel.elastic)


def true_beam_inertia(plan: Plan) -> tuple[float, float] | None:
    """Solve Timoshenko beams of several elements with inner motions; return the channel nearest to its bare bound."""
    pairs = [
        beam_inertia_of(suspended(plan.spec, plan, c.beam.topology, beam_shape(c)))
        for c in some(plan)
        if is_straight(plan, c)
    ]
    return min(pairs, key=lambda pair: pair[0] / pair[1], default=None)


def true_far_modes(plan: Plan) -> float | None:
    """Compare an OFF taxel's motion under all tones with every mode to that with the modes that the plan counts."""
    true = []
    for own in plan.sets:
        line = placed_channels(plan.spec, own).line
        hz = np.array([c.resonance_hz for c in own])
        weight = (line / line[:, None]) ** 2 * (1 - np.eye(len(line)))
        taxels = coil_modes(plan.spec, own), heard_modes(plan.spec, own, line)
        every, heard = ((felt_energy(t, slice(None), hz) * weight).sum(1) for t in taxels)
        with np.errstate(divide="ignore", invalid="ignore"):
            true.append(np.nanmax(np.where(heard > 0, np.abs(np.sqrt(every / heard) - 1), 0.0)))
    return float(max(true))


class Sized(NamedTuple):
    """The true size of a term, and the finer model's own error in it."""

    true: float
    off: float


def climbed(at: Callable[[int], tuple[float, float]], orders: Sequence[int], bound: float) -> Sized:
    """Take elements of higher order until it is plain whether the true size is above `bound` or not.

    `at` returns for an order the size and how far two ways to find it differ. To this the size's step from the last
    order is added. The first order is never trusted; the last ends the search, whatever the error.
    """
    before, _ = at(orders[0])
    for order in orders[1:]:
        size, apart = at(order)
        off = abs(size - before) + apart
        before = size
        if abs(bound - size) > off:
            break
    return Sized(size, off)


def true_frame(plan: Plan, bound: float) -> Sized:
    """Compute the shift of the resonances on the whole pad's frame, made of solid elements on one mesh."""
    from padgen.verify import pad_frame

    clamping = "corners" if plan.spec.pad.hole_diameter_mm else "bottom"
    mesh = pad_frame.meshed(pad_frame._frame_solid(plan, clamping), pad_frame.MESH, "frame", set())

    def at(order: int) -> tuple[float, float]:
        with patch.object(pad_frame, "_frame_solid"), patch.object(pad_frame, "meshed", lambda *_: mesh):
            modes = pad_frame.pad_modes(plan, clamping, order)
        return max(abs(pad_frame.shift(plan, *modes, taxel)) for taxel in pad_frame.central_taxels(plan)), 0.0

    return climbed(at, (1, 2, 3), bound)


# Fields: finite elements.

SATURATION_T = 1.5


def gap_m(plan: Plan) -> float:
    return plan.spec.coil.gap_mm * MM


def saturation_on_axis(coil: CoilSource, washer: SteelRing, gap: float, current_a: float) -> tuple[float, float]:
    """Return bound and loss of force with saturating steels (Froehlich), on one mesh, so that its error cancels."""
    from padgen.verify.field_solid import axisymmetric_force

    core = saturating(coil.core_permeability, SATURATION_T) if coil.has_core else None
    steel = saturating(washer.permeability, SATURATION_T)
    # By coarser elements the two potentials differ by more than a fifth over long cores.
    linear, saturating_n = (
        axisymmetric_force(coil, washer, gap, current_a, *steels, order=4, levels=2).force_n
        for steels in ((None, None), (core, steel))
    )
    made = washer_magnetised(
        coil, washer, gap, np.zeros(1), np.array([pull_module.pull(coil, washer, gap, 0.0).dipole])
    )
    core_t, core_chi_n = core_polarisation(coil)
    bound = 2 * saturation_loss(core_t * current_a / SATURATION_T, core_chi_n)
    bound += saturation_loss(made.polarisation[0] * current_a / SATURATION_T, made.chi_n[0])
    return min(float(bound), 1.0), abs(1 - saturating_n / linear)


def true_saturation(plan: Plan) -> tuple[float, float]:
    """Return bound and truth for the plan's coil, washer and peak current, with the washer on the coil's axis."""
    return saturation_on_axis(*magnetic_parts(plan.spec), gap_m(plan), plan.load.current_peak_ma * MA)


def fields_in_space(
    coil: CoilSource, washers: Sequence[PlacedWasher], current_a: float, cases: Sequence[dict[str, Steel]]
) -> Callable[[int], tuple[float, float]]:
    """Return a function of the order of elements: by how much the pull on the first washer differs in the second case.

    The difference is relative to the pull in the first of the two `cases`; a case names the steels that are not
    linear. Both are solved on one mesh, so that its error cancels, and the second begins with the first's field.
    The function returns how far virtual work and surface stress differ in it, too.
    """
    import ngsolve as ng

    from padgen.verify import field_solid

    half = all(abs(w.y_m) < 1e-9 for w in washers)
    mesh, far_mm = field_solid._mesh(coil, washers, half, 0, 1.0)
    source = ng.CF((0, 0, field_solid.winding_source(coil, current_a, ng.sqrt(ng.x**2 + ng.y**2), ng.z)[0]))
    steels = {"core": coil.core_permeability, **{f"washer{i}": w.ring.permeability for i, w in enumerate(washers)}}

    def at(order: int) -> tuple[float, float]:
        field = None
        pulls = []
        for case in cases:
            field = field_solid.solve_scalar(
                mesh, source, {**steels, **case}, far_mm, order, 2.0 if half else 1.0, field
            )
            both = field_solid.body_wrench(field, "washer0", field_solid._foot_mm(washers[0]))
            pulls.append([wrench[2] for wrench in both])
        by_work, by_stress = np.abs(np.array(pulls[1]) / pulls[0] - 1).tolist()
        return by_work, abs(by_stress - by_work)

    return at


def true_saturation_aside(plan: Plan, bound: float) -> Sized:
    """Solve the loss in three dimensions, with the washer of the first channel at its place."""
    coil, washer = magnetic_parts(plan.spec)
    steels: dict[str, Steel] = {"washer0": saturating(washer.permeability, SATURATION_T)}
    if coil.has_core:
        steels["core"] = saturating(coil.core_permeability, SATURATION_T)
    ring = PlacedWasher(washer, gap_m(plan), plan.channels[0].site.coil_distance_mm * MM, 0.0)
    at = fields_in_space(coil, [ring], plan.load.current_peak_ma * MA, ({}, steels))
    return climbed(at, (1, 2, 3), bound)


def eddy_forces(coil: CoilSource, washer: SteelRing, gap: float, hz: float, resistivity: float) -> tuple:
    """Return phasors of the force at twice `hz`, without and with eddy currents, by the axisymmetric ``A = r w``."""
    import ngsolve as ng

    from padgen.verify.field_solid import _curl, _half_plane, winding_source

    mesh, far = _half_plane(coil, washer, gap, 2)
    space = ng.H1(mesh, order=4, complex=True)
    radius = ng.x
    u, v = space.TnT()
    weight = 2 * np.pi * radius
    steels = {"core": coil.core_permeability, "washer": washer.permeability}
    reluctivity = mesh.MaterialCF({k: 1 / (MU_0 * mu) for k, mu in steels.items()}, default=1 / MU_0)
    conducting = mesh.MaterialCF(dict.fromkeys(steels, 1 / resistivity), default=0)
    _, density = winding_source(coil, 1.0, ng.x, ng.y)
    more = ng.dx(bonus_intorder=4)
    source = ng.LinearForm(weight * density * radius * v * more).Assemble()
    near = ng.GridFunction(ng.H1(mesh, order=1))
    near.vec.FV().NumPy()[:] = [float(on) for on in near.space.GetDofs(mesh.Materials("washer"))]
    slope = ng.grad(near)
    forces = []
    for angular in (0.0, 2 * np.pi * hz):
        form = ng.BilinearForm(space)
        form += weight * reluctivity * ng.InnerProduct(_curl(u), _curl(v)) * more
        form += weight * 1e-6j * angular * conducting * radius * u * radius * v * more
        form += weight * radius * u * radius * v / (MU_0 * far) * ng.ds("far", bonus_intorder=4)
        form.Assemble()
        w = ng.GridFunction(space)
        w.vec.data = form.mat.Inverse(space.FreeDofs(), inverse="umfpack") * source.vec
        field = _curl(w) / MU_0
        square = field[0] * field[0] + field[1] * field[1]
        stress = square / 2 * slope[1] - (field[0] * slope[0] + field[1] * slope[1]) * field[1]
        forces.append(complex(ng.Integrate(weight * stress, mesh, definedon=mesh.Materials("air"), order=10)))
    return tuple(forces)


def true_eddy_currents(plan: Plan) -> float:
    """Return the change of the force's phasor at the highest frequency by eddy currents in core and washer of iron."""
    coil, washer = magnetic_parts(plan.spec)
    hz = max(channel.drive_hz for channel in plan.channels)
    still, moved = eddy_forces(coil, washer, gap_m(plan), hz, 1e-7)
    return float(abs(moved / still - 1))


# Leakage and shielding: cores and washers in the fields of each other and of all coils.


class Placed(NamedTuple):
    """A steel body of revolution at `axis` (2,), `up` m high; its charge has waves of up to `orders` round the axis."""

    body: SteelBody
    axis: np.ndarray
    up: float
    orders: int

    @property
    def angle(self) -> np.ndarray:
        turns = 2 * self.orders + 4
        return (np.arange(turns) + 0.5) * 2 * np.pi / turns

    @property
    def order(self) -> np.ndarray:
        """Orders of the parts 1, cos φ, sin φ, cos 2φ, …"""
        return (np.arange(2 * self.orders + 1) + 1) // 2

    def waves(self, angle: np.ndarray) -> np.ndarray:
        turned = [part(m * angle) for m in range(1, self.orders + 1) for part in (np.cos, np.sin)]
        return np.stack([np.ones_like(angle), *turned])

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the places (nodes, turns, 2) and heights (nodes, turns) of points on the surface."""
        round_axis = np.stack([np.cos(self.angle), np.sin(self.angle)], -1)
        at = self.axis + self.body.radius[:, None, None] * round_axis
        return at, np.broadcast_to((self.body.height + self.up)[:, None], at.shape[:2])

    def projected(self, value: np.ndarray) -> np.ndarray:
        """Return the parts (…, parts · nodes) of values given at the points (…, nodes, turns)."""
        share = self.waves(self.angle) * np.where(self.order == 0, 1.0, 2.0)[:, None] / len(self.angle)
        return np.swapaxes(value @ share.T, -1, -2).reshape(*value.shape[:-2], -1)

    def made(self, at: np.ndarray, height: np.ndarray, step: float, slope: bool = False) -> np.ndarray:
        """Return the potential (parts · nodes, …), or its slope along z, of one unit of each part of the charge."""
        radius, low, shares = fine_rings(self.body, step)
        rho, around = axial(at - self.axis)
        of = ring_potential(rho[..., None], height[..., None], radius, low + self.up, self.orders, at_ring=False)
        each = ((of.along_z if slope else of.value) @ shares)[self.order] * self.waves(around)[..., None]
        return np.moveaxis(each, -1, 1).reshape(-1, *rho.shape)


def axial(away: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.maximum(np.hypot(away[..., 0], away[..., 1]), 1e-9), np.arctan2(away[..., 1], away[..., 0])


def drawn(bodies: Sequence[Placed], step: float, outside: Callable[[int, np.ndarray], np.ndarray]) -> list[np.ndarray]:
    """Return for each body the charge (parts · nodes, k) that `outside` and all other bodies draw on it.

    `outside` returns, for the number of a body and its answer to potentials at its points, what it draws alone.
    """
    ends = np.cumsum([0, *(len(b.order) * len(b.body.area) for b in bodies)])
    mutual = np.zeros((ends[-1], ends[-1]))
    alone = []
    for i, one in enumerate(bodies):
        own = slice(ends[i], ends[i + 1])
        points = one.points()
        answer = np.zeros((len(one.order), len(one.body.area)) * 2)
        for part, order in enumerate(one.order):
            answer[part, :, part] = one.body.response[order]
        answer = answer.reshape(own.stop - own.start, -1)
        for j, other in enumerate(bodies):
            if i != j:
                mutual[own, ends[j] : ends[j + 1]] = answer @ one.projected(other.made(*points, step)).T
        alone.append(outside(i, answer))
    return np.split(np.linalg.solve(np.eye(ends[-1]) - mutual, np.concatenate(alone)), ends[1:-1])


class Wound(NamedTuple):
    """A coil's windings as rings of charge, at `axis` (2,)."""

    rings: tuple[np.ndarray, np.ndarray, np.ndarray]
    axis: np.ndarray

    def made(self, at: np.ndarray, height: np.ndarray, slope: bool = False) -> np.ndarray:
        """Return the potential of the windings per ampere, or its slope along z."""
        radius, low, charge = self.rings
        of = ring_potential(axial(at - self.axis)[0][..., None], height[..., None], radius, low, 0, at_ring=False)
        return (of.along_z if slope else of.value)[0] @ charge


def pulled(ring: Placed, charge: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return forces (k, l) in N on charges (parts · nodes, k) of a body in potentials whose slope along z is (l, …)."""
    weight = (ring.body.area * np.where(ring.order == 0, 1.0, 0.5)[:, None]).ravel()
    return MU_0 * (charge.T * weight) @ ring.projected(slope).T


def washer_body(washer: SteelRing, orders: int, nodes: tuple[int, int] = (9, 5)) -> SteelBody:
    sides = tube_outline(washer.outer_diameter / 2, washer.inner_diameter / 2, 0.0, washer.thickness, nodes)
    return steel_body(sides, washer.permeability, orders)


def many_coils(coil: CoilSource, washer: SteelRing, gap: float, place: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Return pulls (k, k) in N/A² on a washer at `place` by currents in coils at `axes` (k, 2), the own coil first."""
    core = charged_core(coil, 12, 2)
    step = 0.8 * gap
    ring = Placed(washer_body(washer, 4), place, gap, 4)
    bodies = [*([Placed(core[0], axis, 0.0, 2) for axis in axes] if core else []), ring]
    coils = [Wound(winding_rings(coil.windings, step), axis) for axis in axes]

    def outside(i: int, answer: np.ndarray) -> np.ndarray:
        one = bodies[i]
        alone = np.zeros((len(answer), len(axes)))
        for k, wound in enumerate(coils):
            if one is not ring and i == k:
                alone[: len(one.body.area), k] = core[1]  # a core in its own coil
            else:
                alone[:, k] = answer @ one.projected(wound.made(*one.points()))
        return alone

    charges = drawn(bodies, step, outside)
    slope = np.array([wound.made(*ring.points(), slope=True) for wound in coils])
    for charge, other in zip(charges[:-1], bodies[:-1], strict=True):
        slope += np.tensordot(charge.T, other.made(*ring.points(), step, slope=True), 1)
    force = pulled(ring, charges[-1], slope)
    return (force + force.T) / 2


def shielded(coil: CoilSource, washer: SteelRing, gap: float, places: np.ndarray, orders: int) -> float:
    """Return by how much washers at `places` (n, 2) over one coil change the pull on the first, relative.

    Charges of the washers have waves of up to `orders` round their axes, those of the core of up to 4.
    """
    apart = np.linalg.norm(places[1:] - places[0], axis=1).min() - washer.outer_diameter
    core, body, step = charged_core(coil, 12, 4), washer_body(washer, orders), 0.8 * min(gap, max(apart, gap / 4))
    wound = Wound(winding_rings(coil.windings, 0.8 * gap), np.zeros(2))
    middle = [Placed(core[0], np.zeros(2), 0.0, 4)] if core else []
    forces = []
    for count in (1, len(places)):
        bodies = [*(Placed(body, place, gap, orders) for place in places[:count]), *middle]

        def outside(i: int, answer: np.ndarray, bodies=bodies) -> np.ndarray:
            if bodies[i].body is body:
                return (answer @ bodies[i].projected(wound.made(*bodies[i].points())))[:, None]
            return np.pad(core[1], (0, len(answer) - len(core[1])))[:, None]

        first, *others = drawn(bodies, step, outside)
        points = bodies[0].points()
        slope = wound.made(*points, slope=True)
        for charge, other in zip(others, bodies[1:], strict=True):
            slope = slope + np.tensordot(charge[:, 0], other.made(*points, step, slope=True), 1)
        forces.append(pulled(bodies[0], first, slope[None])[0, 0])
    return float(abs(forces[1] / forces[0] - 1))


def true_shielding(plan: Plan, most: int = 20) -> float | None:
    """Compare the pull on a coil's first washer alone with that among the others, the `most` nearest of them."""
    place = np.array([c.site.washer_mm for c in plan.sets[0]]) * MM
    if len(place) < 2:
        return None
    near = place[np.linalg.norm(place - place[0], axis=1).argsort(kind="stable")[: most + 1]]
    return shielded(*magnetic_parts(plan.spec), gap_m(plan), near, 8 if len(near) <= 4 else 4)


def true_leakage(plan: Plan) -> float | None:
    """Compare what the coils next to the middle one leak with the plan's model of leakage."""
    grid = plan.coils
    parts = magnetic_parts(plan.spec)
    steps = coils_around(grid.rows, grid.columns)
    steps = steps[np.abs(steps).max(1) == 1]
    if not len(steps):
        return None
    axes = steps * np.array([grid.pitch_x_mm, grid.pitch_y_mm]) * MM
    true = []
    for channel in some(plan)[:2]:
        place = np.array(channel.site.washer_mm) * MM
        pulls = many_coils(*parts, gap_m(plan), place, np.concatenate([np.zeros((1, 2)), axes]))
        pulls = np.abs(pulls / pulls[0, 0])
        found = leakage(*parts, gap_m(plan), place[None], axes)
        true += [pulls[1:, 1:].sum() / np.abs(found.mutual).sum(), pulls[0, 1:].sum() / np.abs(found.product).sum()]
    return float(max(abs(share - 1) for share in true))


TRUE = {
    "gap": true_gap,
    "softening": true_softening,
    "switching": true_switching,
    "motion": true_motion,
    "beam inertia": true_beam_inertia,
    "stretching": true_stretching,
    "large slopes": true_large_slopes,
    "air's damping": true_air_damping,
    "far modes": true_far_modes,
}
"""Finer models that are tried on every plan."""
DEAR = {
    "leakage": true_leakage,
    "air's mass": true_air_mass,
    "eddy currents": true_eddy_currents,
    "saturation": true_saturation,
    "shielding": true_shielding,
}
"""Finer models that take up to a second or two."""
CLIMBING = {
    "saturation aside": true_saturation_aside,
    "frame": true_frame,
}
"""Finer models that take the term's bound, too, and compute no finer than it takes to compare the two (`climbed`); the
frame only of up to `MOST_TAXELS` taxels."""
MOST_TAXELS = 12
LEAST = {"gap": 1e-6, "softening": 1e-6, "far modes": 1e-12, "saturation": 2e-5, "saturation aside": 5e-5}
"""Sizes below which a finer model's own digits run out."""
OWN_BOUND = ("beam inertia", "saturation")
"""Terms whose finer model needs parts a little other than the plan's, and gives their bound with the true size."""


def shielding(pull: PullQuestion, order: int = 3) -> float:
    """Share of the pull that a second washer, opposite on the same coil, takes from the first, by fields in space."""
    near, far = (PlacedWasher(pull.washer, pull.gap_m, x) for x in (pull.offset_m, -pull.offset_m))
    both, alone = (solid_force(pull.coil, own, order=order).wrench[:, 2].mean() for own in ((near, far), (near,)))
    return float(1 - both / alone)


def crosstalk_db(plan: Plan, modes: PadModes, driven: int) -> np.ndarray:
    """How far below taxel `driven`, at its resonance, all washers (taxels,) move vertically, in dB; 0 for itself."""
    q = plan.channels[plan.taxels[driven].channel].q
    amplitude = np.abs(modes.receptance(driven, np.array([peak_hz(plan, modes, driven)]), q)[0])
    return np.asarray(20 * np.log10(amplitude[driven] / amplitude))


def merged(wave: DecayingTones) -> DecayingTones:
    """Add up the tones of one frequency and decay, lowest frequency first; `wave` has amplitudes (m,)."""
    key = np.stack([wave.frequency_hz, wave.rest_hz, wave.decay_per_s])
    unique, where = np.unique(key, axis=1, return_inverse=True)
    phasor = np.zeros(unique.shape[1], complex)
    np.add.at(phasor, where.ravel(), wave.amplitude * np.exp(1j * wave.phase_rad))
    still = (unique[0] == 0) & (unique[1] == 0)
    phasor[still] = phasor[still].real  # a tone of 0 Hz is the constant A cos φ
    return DecayingTones(unique[0], np.abs(phasor), np.angle(phasor), unique[2], unique[1])
