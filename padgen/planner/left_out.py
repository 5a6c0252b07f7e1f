"""Bound the effects that the plan's models leave out, for one pad.

The frame's flexibility is bounded by hand formulas. A taxel's resonance is planned with the four sides of its sub-cell
held. The real frame yields in two ways: the rib at the beams' root twists, and the pad bends as a plate. In series with
a spring of stiffness k a compliance c lowers the resonance by k c/2.

A finger is not bounded but estimated: `padgen.planner.touch`.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from math import hypot, inf, isfinite, pi
from typing import NamedTuple

import numpy as np

from padgen.core.errors import Finding, InfeasibleError, percent, plural
from padgen.core.units import G_PER_CM3, GPA, GRAM, MA, MH, MM, UM
from padgen.physics.bounds import (
    beam_inertia,
    core_echo,
    core_eddies,
    core_polarisation,
    motional_voltage,
    mutual_shielding,
    ring_down_error,
    saturation_loss,
    washer_eddies,
    washer_magnetised,
)
from padgen.physics.magnetics import impedance, mutual_error, mutual_inductance
from padgen.physics.modes import resonance_rise
from padgen.physics.pull import pull_range
from padgen.physics.remanence import root_lines
from padgen.physics.resonator import TaxelModes, felt_energy
from padgen.physics.schemes import current_lines_a
from padgen.planner.board_layout import board_of
from padgen.planner.channels import (
    coil_modes,
    hanging_gap_um,
    heard_modes,
    site_pulls,
    site_wrenches,
    working_mode_ratios,
)
from padgen.planner.coils import coil_source
from padgen.planner.drive_scheme import placed_channels
from padgen.planner.layout import outline
from padgen.planner.movers import mover_of
from padgen.planner.movers.washer import magnetic_parts
from padgen.planner.plan import Channel, LeftOut, Plan
from padgen.planner.suspensions import Arrangement, BeamShape, PlateShape
from padgen.planner.taxel_model import TaxelModel
from padgen.spec import Material, Spec

__all__ = [
    "RUNGS",
    "FrameAround",
    "flexibility_bounds",
    "frame_around",
    "judge_left_out",
    "left_out",
    "left_out_line",
    "unbounded_and_included",
]


RIB_MARGIN = 2.5
PLATE_MARGIN = 2.5
"""Factors for effects outside the formulas: compliance of the joint, lateral bending of the rib, unequal supports, and
further modes.
"""
SHEAR_SHARE = 0.9
"""Factor on the frame's lowest mode for shear of the ribs, which thin-plate formulas leave out: 7 % were seen."""
NEAR_RESONANCE = 0.7
"""Share of the frame's lowest mode above which a static compliance is no bound."""
SUPPORTS = {"edges": (0.0056, 0.00126), "corners": (0.039, 0.0249), "bottom": (0.0, 0.0)}
"""Deflection of the centre of a square plate, by the way it is held: over P a²/D under a force P there, and over p a⁴/D
under an even pressure p, with the side a and the bending stiffness D. For ν = 0.3: Timoshenko and Woinowsky-Krieger,
Theory of Plates and Shells (1959), tables 35, 37 and 42.
"""


class FrameAround(NamedTuple):
    """The frame around one channel's taxel, in SI units.

    `twist_n_m` is the torsional stiffness in N·m/rad of the rib across the beams' root at its middle, both ends held.
    `bending_n_m` is the bending stiffness of the pad as a plate with sides of `side_m`. `mode_hz` estimates its lowest
    bending mode, to within a factor of two, with the mass of all taxels on it; inf where nothing bends.
    """

    twist_n_m: float
    bending_n_m: float
    side_m: float
    mode_hz: float


def flexibility_bounds(plan: Plan, clamping: str) -> np.ndarray:
    """Return bounds (n,) on resonances' relative shifts by the frame's compliance; inf near or above its lowest mode.

    `clamping` is a name in `SUPPORTS`: how the pad is held. The resonance is the peak of the taxel's own response.
    """
    bounds = []
    point = SUPPORTS[clamping][0]
    for channel in plan.channels:
        frame = frame_around(plan, channel, clamping)
        arrangement = plan.arrangement(channel)
        if channel.resonance_hz >= NEAR_RESONANCE * frame.mode_hz:
            bounds.append(inf)
            continue
        # From a root to the washer: along x for a straight beam, else directly.
        roots = [(path.is_straight, *(float(v) for v in path.root_mm)) for path in arrangement.beams]
        away = [(float(arrangement.washer_x_mm) - x, 0.0 if straight else y) for straight, x, y in roots]
        half = channel.stiffness_n_per_m / 2
        arm = max(hypot(*way) for way in away) * MM
        rib = half * arm**2 / frame.twist_n_m
        plate = half * point * frame.side_m**2 / frame.bending_n_m / (1 - (channel.resonance_hz / frame.mode_hz) ** 2)
        bounds.append(RIB_MARGIN * rib + PLATE_MARGIN * plate)
    return np.array(bounds)


def frame_around(plan: Plan, channel: Channel, clamping: str) -> FrameAround:
    """Return the stiffnesses of the frame around a channel's taxel, and the pad's lowest bending mode.

    The rib at the root is made of its part in this sub-cell and, beyond the seam, at least the thinnest wall that this
    sub-cell has. The lowest mode follows from the deflection w of the pad's centre under its own weight, ``ω² = g/w``
    (Rayleigh), which makes it low.
    """
    box = outline(plan, channel)
    pad = plan.spec.pad
    material = plan.spec.material
    modulus = material.modulus_gpa * GPA
    height = pad.frame_thickness_mm * MM
    length, width = (float(v) for v in plan.arrangement(channel).window_mm)
    walls = (-box.x0, box.x1 - length, width / 2 + box.y1 - width, -box.y0 - width / 2)
    thin, thick = sorted(((-box.x0 + max(min(walls), 0.0)) * MM, height))
    torsion = thick * thin**3 / 3 * (1 - 0.63 * thin / thick)
    wide = box.x1 - box.x0
    deep = box.y1 - box.y0
    across = max(pad.width_mm, pad.depth_mm) + 2 * pad.border_mm
    # A border that is held does not bend: the pad's cross-section is then that within it.
    open_share = 1.0 if clamping == "edges" else max(pad.width_mm, pad.depth_mm) / across
    bending = (1 - (length / wide + width / deep) / 2 * open_share) * modulus * height**3 / 12
    side = (across - pad.border_mm) * MM
    mode = inf
    if even := SUPPORTS[clamping][1]:
        tiles = (
            plan.cell.columns * plan.cell.rows * plan.coils.rows * plan.coils.columns * (wide * deep - length * width)
        )
        border = (pad.width_mm + 2 * pad.border_mm) * (pad.depth_mm + 2 * pad.border_mm) - pad.width_mm * pad.depth_mm
        plastic = (tiles + border) * MM**2 * pad.frame_thickness_mm * MM * (material.density_g_per_cm3 * G_PER_CM3)
        counts = np.bincount([taxel.channel for taxel in plan.taxels], minlength=len(plan.channels))
        moving = float(counts @ [each.effective_mass_g for each in plan.channels]) * GRAM
        mode = SHEAR_SHARE * (1 / (even * (plastic + moving) * side**2 / bending)) ** 0.5 / (2 * pi)
    return FrameAround(4 * modulus / 2 / (1 + material.poisson_ratio) * torsion / (width * MM), bending, side, mode)


SATURATION_T = 1.5
"""Saturation polarisation of the steel of cores and washers that has the least: ferritic stainless (iron: 2.15 T)."""
RESISTIVITY_OHM_M = 1e-7
"""Resistivity of iron, the best conductor among the materials of cores and washers."""
LEAST_GAP = 20
"""Gaps are taken to stay above the hanging gap divided by this, so that pulls stay finite."""
BALANCE_ROUNDS = 3
"""Iterations to balance mean pull and spring."""
SLOPE_HARDENING = 1.3
"""Relative growth of a beam's stiffness per square of deflection over length: 1.2 by the elastica, a little more where
its tip is elastically held."""
AIR_KG_PER_M3 = 1.2
AIR_PA_S = 1.8e-5
"""Density and viscosity of air."""
HARDENING_SHARE = 0.25
"""Relative error of the cubic spring of beams that stretch: 0.22 where their ends are elastic (docs/accuracy.md)."""

RUNGS = {
    "warmth": ("plastic softens as the coils warm it", "measure and re-tune while it is warm"),
    "moisture": ("water from humid air softens the plastic", "material.wet = true, or re-tune after some weeks"),
    "modulus at the frequency of use": (
        "plastic is stiffer at the resonances than in slow tests",
        "material.dynamic = true, or re-tune",
    ),
    "stretching": ("beams stretch as they bend", "a lower drive.level_um, or beams free to slide at one end"),
    "saturation": ("the steel saturates", "measure the level"),
    "remanence": (
        "steel that stays magnetised adds a pull that goes with the current",
        "keep magnets away from washers and cores, or measure the level",
    ),
    "eddy currents": ("eddy currents in core and washers", "measure the level, or take a laminated or ferrite core"),
    "shielding": ("washers shield each other from the coil", "measure the level"),
    "gap": ("the pull changes as a washer swings", "a lower drive.level_um or a wider coil.gap_mm"),
    "softening": ("the coil's pull softens the spring", "padgen study --only dynamics"),
    "motion": ("moving washers induce a voltage", "padgen study --only dynamics"),
    "mutual inductance": ("coils induce currents in each other", "drive with a current source"),
    "tracks to the pins": (
        "the board's tracks to its pins have a resistance, by which currents are lower",
        "drive with a current source, or re-tune",
    ),
    "switching": (
        "a coil's current needs time to change, so that a taxel stops later",
        "leave that much more time between frames",
    ),
    "air's mass": ("air moves along", "re-tune: it is the same for every taxel"),
    "air's damping": ("air damps", "a wider coil.gap_mm, or state the measured Q"),
    "large slopes": ("beams bend far", "a lower drive.level_um, or beams that sag less"),
    "far modes": ("modes far from the drive", "more distance between resonances"),
    "recoil": ("ON taxels shake the pad", 'mount = "glued" on a heavy base'),
    "frame": ("the frame gives way", "padgen study --only pad"),
    "beam inertia": ("the beams' own mass", "--model solid"),
}
"""Each effect that a plan leaves out in plain words, and a way to compute or avoid it."""


INCLUDED = {
    "lines of the squared current": "selectivity",
    "all channels of a coil at once": "selectivity",
    "other modes of a taxel": "selectivity",
    "distance of a washer from the axis": "force",
    "side force and moment of the pull": "force",
    "reactance of the coil": "voltage",
    "first order of sag": "force",
    "shear and twist of the beams": "resonance",
    "give of the beams' ends": "resonance",
    "rotary inertia of plate and washer": "resonance",
    "glue and fillets": "resonance",
    "whole layers and steps of the printer": "resonance",
}
"""Effects that every plan counts, and the figure that contains each."""
UNBOUNDED = {
    "skin": ("resonance of every taxel that is touched", "`touched` has a provisional model"),
    "creep and ageing of the plastic": ("resonance", "`life` has an assumed spread; re-tune after some weeks"),
    "losses of plastic and glue": ("Q, which the spec sets", "measure Q of a coupon"),
    "losses and lag by hysteresis of the steel": ("force", "measure the level"),
    "amplifier's own impedance and bandwidth": ("current", "measure the current"),
}
"""Effects that nothing in a spec bounds: what each changes, and what to do about it."""
STRESSES = "stresses of the print"
"""An unbounded effect: shrinkage pulls beams tight that cannot shorten, and raises their resonance. A plan with such
beams warns of it."""


LISTED = 4
"""Effects that a finding on what is left out names, the largest: a longer list is not read."""


def left_out(plan: Plan) -> tuple[LeftOut, ...]:
    """Return all physical effects: those left out with a bound (largest first), left out without one, and included.

    Each bound is of the channel where it is largest.
    """
    # The pad is screwed down at its corners or, without holes, glued down.
    frame = flexibility_bounds(plan, "corners" if plan.spec.pad.hole_diameter_mm else "bottom")
    entries = [
        _inertia(plan),
        *_bending(plan),
        *_air(plan),
        _worst_channel("frame", "resonance", plan.channels, frame),
        *_far_modes(plan),
        *_magnetic(plan),
    ]
    if plan.reuse.leak_db is not None:
        entries.append(LeftOut("leakage", plan.reuse.leak_error, "1", "leak from coil to coil", computed=True))
    shaken = plan.recoil
    if shaken.in_step_db is not None and not plan.spec.mount.is_immovable:
        heard = 10 ** (-shaken.kept_db(inf, shaken.in_step_db) / 20)
        entries.append(LeftOut("recoil", heard, "1", "ON level", computed=False))
    if plan.warm.resonance_shift:
        shift = abs(plan.warm.resonance_shift)
        entries.append(LeftOut("warmth", shift, "1", "resonances over the warmest coil", computed=False))
    entries += [entry for entry in _plastic(plan.spec.material) if entry.status == "bounded"]
    entries.sort(key=lambda entry: -_size(entry))
    return (*entries, *unbounded_and_included(plan))


def unbounded_and_included(plan: Plan) -> tuple[LeftOut, ...]:
    """Return the effects left out without a bound, then those that the plan includes: all that need no computation."""
    plastic = list(_plastic(plan.spec.material))
    whole = [LeftOut(term, None, "1", of, True, "included") for term, of in INCLUDED.items()]
    whole += [entry for entry in plastic if entry.status == "included"]
    free = [LeftOut(term, None, "1", of, False, "unbounded") for term, (of, _) in UNBOUNDED.items()]
    free += [entry for entry in plastic if entry.status == "unbounded"]
    tight = [channel for channel in plan.channels if channel.hardening_per_mm2 > 0]
    if tight:
        free.insert(0, LeftOut(STRESSES, None, "1", f"resonance of channel {tight[0].index}", False, "unbounded"))
    return (*free, *whole)


def _plastic(material: Material) -> Iterator[LeftOut]:
    """Yield two effects on resonances, moisture and dynamic stiffness, each marked bounded, unbounded or included."""
    for term, ratio, is_planned_by in (
        ("moisture", material.wet_ratio, material.wet),
        ("modulus at the frequency of use", material.dynamic_ratio, material.dynamic),
    ):
        if is_planned_by:
            yield LeftOut(term, None, "1", "resonance", True, "included")
        elif ratio is None:
            yield LeftOut(term, None, "1", "resonance", False, "unbounded")
        else:
            yield LeftOut(term, abs(ratio**0.5 - 1), "1", "resonance", False)


def left_out_line(entries: Sequence[LeftOut], most: int = 3) -> str:
    """Return one line of text with the `most` largest effects that are left out.

    >>> left_out_line([LeftOut("saturation", 0.0031, "1", "force of channel 1", False)])
    'effects not counted in these figures: the steel saturates (up to 0.31 % of the force of channel 1)'
    """
    dropped = _ignored(entries)
    more = len(dropped) - most
    rest = f", and {more} smaller one{plural(more)}" if more > 0 else ""
    largest = ", ".join(f"{RUNGS[entry.term][0]} ({_size_text(entry)})" for entry in dropped[:most])
    return f"effects not counted in these figures: {largest or 'none'}{rest}"


def _ignored(entries: Sequence[LeftOut]) -> list[LeftOut]:
    return [entry for entry in entries if not entry.computed and entry.status == "bounded"]


def _size_text(entry: LeftOut) -> str:
    """Say by how much an effect changes which figure, or that the amount is unknown."""
    if entry.bound is None:
        return f"the {entry.of} changes by an unknown amount"
    return f"up to {percent(entry.bound)} of the {entry.of}"


def judge_left_out(spec: Spec, entries: Sequence[LeftOut]) -> Iterator[Finding]:
    """Yield a note on left-out effects larger than `model.tolerance`, a warning where shrinkage tightens beams."""
    sentences = [
        f"{RUNGS[entry.term][0]}: {_size_text(entry)} (to compute or avoid it: {RUNGS[entry.term][1]})"
        for entry in _ignored(entries)
        if _size(entry) > spec.model.tolerance
    ]
    if any(entry.term == STRESSES for entry in entries):
        yield Finding(
            "warning",
            "model.unbounded",
            "plan",
            "as the print shrinks, beams held at both ends tighten, and resonate higher by an unknown amount: print the"
            " coupon (padgen build --parts coupon), measure it, and give its figures to padgen retune --coupon",
            ({"suspension.topology": "folded"}, {"suspension.topology": "cantilever"}),
        )
    if sentences:
        more = len(sentences) - LISTED
        if more > 0:
            sentences = [*sentences[:LISTED], f"and {more} smaller one{plural(more)} (left_out in plan.json)"]
        yield Finding(
            "note",
            "model.left_out",
            "plan",
            f"effects of more than {percent(spec.model.tolerance)} (model.tolerance) are not in these figures:"
            f" {'; '.join(sentences)}",
        )


def _size(entry: LeftOut) -> float:
    return inf if entry.bound is None else entry.bound


def _worst_channel(term: str, of: str, channels: Sequence[Channel], bound: np.ndarray) -> LeftOut:
    """Return a `LeftOut` entry for the effect `term`, bounded by its largest `bound` (n,) among the channels."""
    at = int(np.argmax(bound))
    largest = float(bound[at]) if isfinite(bound[at]) else None
    return LeftOut(term, largest, "1", f"{of} of channel {channels[at].index}", computed=False)


def _inertia(plan: Plan) -> LeftOut:
    """Bound the resonance error by the mass of beams, which the beam model neglects; for solids, the solver's error."""
    plate = PlateShape(plan.plate.length_mm, plan.plate.width_mm, plan.plate.thickness_mm)
    material = plan.spec.material
    channels = plan.channels
    bound = np.array([channel.model_error for channel in channels])
    elastic = material.modulus_gpa * GPA, material.poisson_ratio, material.density_g_per_cm3 * G_PER_CM3
    beams = [k for k, channel in enumerate(channels) if channel.model == "beam"]
    for topology in dict.fromkeys(channels[k].beam.topology for k in beams):
        same_kind = [k for k in beams if channels[k].beam.topology == topology]
        sizes = [(b.width_mm, b.thickness_mm, b.length_mm) for b in (channels[k].beam for k in same_kind)]
        model = TaxelModel(plan.spec, topology, plate, BeamShape(*np.array(sizes).T))
        motion, hz, shares = (
            np.array([getattr(channels[k], name) for k in same_kind])
            for name in ("mode_motions", "modes_hz", "mode_shares")
        )
        bound[same_kind] = beam_inertia(model.placements, motion, model.washer_point_m, hz, shares.argmax(1), *elastic)
    return replace(_worst_channel("beam inertia", "resonance", channels, bound), computed=not beams)


def _bending(plan: Plan) -> Iterator[LeftOut]:
    """Bound how beams that bend far shift resonances: by stretching, and by large slopes.

    Of stretching it is the cubic spring's error, and the mean pull's offset, which is not in `level_shift`; of slopes
    beyond linear theory, the secant stiffness that grows by `SLOPE_HARDENING` ``(z/l)²``. The cubic spring is that of a
    slender beam; shear and its ends' give change it by the order of (t/l)².
    """
    alpha, shift = np.array([(c.hardening_per_mm2 * UM**2 / MM**2, c.level_shift) for c in plan.channels]).T
    level, offset, thickness, length = np.array(
        [(c.level_um, c.sag_um + c.static_um, c.beam.thickness_mm, c.beam.length_mm) for c in plan.channels]
    ).T
    pulled = resonance_rise(alpha, level, offset)
    bound = pulled - shift + (HARDENING_SHARE + (thickness / length) ** 2) * pulled
    yield replace(_worst_channel("stretching", "resonance", plan.channels, bound), computed=True)
    sloping = resonance_rise(SLOPE_HARDENING / (length * MM) ** 2, level * UM, offset * UM)
    yield _worst_channel("large slopes", "resonance", plan.channels, sloping)


def _air(plan: Plan) -> Iterator[LeftOut]:
    """Bound the air's mass that moves with plate and beams, and the damping of the air film above the coil.

    Plate and beams are taken as a disc of their area, radius a. In an endless wall it carries an air mass of
    ``8/3 ρ a³`` on each side (Rayleigh, Theory of Sound, 302). A film of height h below, out to the window's radius R,
    adds ``πρ a⁴/(8h) (1 + 4 ln R/a)``. Over a coil of radius R the film damps by ``3πμ a⁴/(2h³) (1 + 4 ln R/a)``
    (Stefan 1874; the logarithm is of the flow from the disc's edge to the coil's). Slots beside the plate reduce both;
    of all shapes and places in a circle a disc in its middle has the largest mass and damping.
    """
    spec = plan.spec
    channels = plan.channels
    below = spec.mover_low_mm
    # Of a rectangular coil the circle round it.
    coil = (spec.coil.outer_diameter_mm if spec.coil.shape == "round" else hypot(*spec.coil.sides_mm)) / 2 * MM
    area, plates, square, most, window = np.array([_moving_area(plan.arrangement(c), c) for c in channels]).T
    mass, stiffness, q, sag, offset = np.array(
        [
            (c.effective_mass_g * GRAM, c.stiffness_n_per_m, c.q, c.sag_um + c.static_um, c.site.coil_distance_mm * MM)
            for c in channels
        ]
    ).T
    height = np.maximum((spec.coil.gap_mm - below) * MM - sag * UM * most, 1e-9)
    radius = np.sqrt(area / pi)
    film = pi * radius**4 * (1 + 4 * np.log(np.maximum(window / radius, 1)))
    heavier = AIR_KG_PER_M3 * square * (16 / 3 * radius**3 + film / (8 * height)) / mass
    yield _worst_channel("air's mass", "resonance", channels, 1 - 1 / np.sqrt(1 + heavier))
    # The beams may reach over the coil though their middle does not: all of their area is taken to lie over it.
    over = np.minimum(np.sqrt(_common_radius(np.sqrt(plates / pi), coil, offset) ** 2 + (area - plates) / pi), coil)
    film = pi * over**4 * (1 + 4 * np.log(np.maximum(coil / np.maximum(over, 1e-9), 1)))
    damped = 1.5 * AIR_PA_S * film / height**3 * most**2 * q / np.sqrt(stiffness * mass)
    yield _worst_channel("air's damping", "Q", channels, damped / (1 + damped))


def _common_radius(radius: np.ndarray, other: float, apart: np.ndarray) -> np.ndarray:
    """Return the radius (n,) of a circle with the area in which two circles at a distance `apart` overlap."""
    apart = np.maximum(apart, 1e-9)
    near = np.clip((apart**2 + radius**2 - other**2) / (2 * apart * radius), -1, 1)
    far = np.clip((apart**2 + other**2 - radius**2) / (2 * apart * other), -1, 1)
    # The shared area is two sectors less their triangles, or all of a circle that lies within the other.
    halves = [r**2 * (np.arccos(c) - c * np.sqrt(1 - c**2)) for r, c in ((radius, near), (other, far))]
    return np.asarray(np.sqrt((halves[0] + halves[1]) / pi))


def _moving_area(arrangement: Arrangement, channel: Channel) -> tuple[float, ...]:
    """Return two areas of a taxel's moving parts, mean square and largest motion (washer's = 1), and window diagonal.

    The figures are the area of blocks and beams and that of the blocks alone in m², the mean square and the largest
    motion, and the diagonal of the window in m.
    """
    motion = channel.mode_motions[int(np.argmax(channel.mode_shares))]

    def moves(x: float, y: float) -> float:
        return 1 + ((motion[3] * y - motion[4] * (x - float(arrangement.washer_x_mm))) * MM) / motion[2]

    area = square = most = 0.0
    for b in arrangement.blocks:
        x0, x1 = (b.low_x_mm, b.high_x_mm)
        y0, y1 = (b.low_y_mm, b.high_y_mm)
        corners = [moves(x, y) for x in (x0, x1) for y in (y0, y1)]
        area_mm2 = float((x1 - x0) * (y1 - y0))
        # The mean square of a linear function over a rectangle, from its middle and its corners.
        square += area_mm2 * float(2 * np.mean(corners) ** 2 + np.mean(np.square(corners))) / 3
        area = area + area_mm2
        most = max(most, *map(abs, corners))
    blocks = area
    for path in arrangement.beams:
        area_mm2 = float(path.width_mm * path.length_mm)
        tip = path.corners[-1]
        # The mean square of a beam guided at its tip is 13/35 of the square at the tip.
        square += area_mm2 * 13 / 35 * moves(float(tip.x_mm), float(tip.y_mm)) ** 2
        area += area_mm2
    return area * MM**2, blocks * MM**2, square / area, most, float(np.hypot(*arrangement.window_mm)) * MM


def _far_modes(plan: Plan) -> Iterator[LeftOut]:
    """Bound how much OFF amplitudes rise, relatively, by modes that `heard_modes` neglects, with all other channels on.

    The error is relative; by Cauchy's inequality for each component.
    """
    if not plan.selectivity.modes_left_out:
        return
    bounds = []
    for channel_set in plan.sets:
        line = placed_channels(plan.spec, channel_set).line
        hz = np.array([channel.resonance_hz for channel in channel_set])
        every = coil_modes(plan.spec, channel_set)
        heard = heard_modes(plan.spec, channel_set, line)
        kept = np.where(heard.gain.any(-1), heard.frequency_hz, 0.0)
        dropped = every.gain * ~(every.frequency_hz[..., None] == kept[:, None]).any(-1)[..., None]
        weight = (line / line[:, None]) ** 2 * ~np.eye(len(line), dtype=bool)
        amplitude = np.zeros(len(line))
        more = np.zeros(len(line))
        for part in range(dropped.shape[-1]):
            taxels = heard._replace(gain=heard.gain[..., [part]]), every._replace(gain=dropped[..., [part]])
            known, missed = (np.maximum((felt_energy(t, slice(None), hz) * weight).sum(1), 0.0) for t in taxels)
            amplitude = amplitude + known
            more = more + 2 * np.sqrt(known * missed) + missed
        bounds.append(np.divide(more, 2 * amplitude, out=np.zeros(len(line)), where=amplitude > 0))
    channels = [channel for channel_set in plan.sets for channel in channel_set]
    yield _worst_channel("far modes", "OFF amplitude", channels, np.concatenate(bounds))


def _magnetic(plan: Plan) -> Iterator[LeftOut]:
    """Bound the magnetic effects that the models leave out, for the channels that their coil pulls."""
    spec = plan.spec
    channels = [channel for channel in plan.channels if channel.force_constant_n_per_a2 > 0]
    if not channels:
        return
    if spec.washer:
        yield from _steel_effects(plan, channels)
    yield from _motion_effects(plan, channels)
    if plan.coils.rows * plan.coils.columns > 1:
        yield _coupled_coils(plan, channels)
    if spec.coil.kind == "board":
        with suppress(InfeasibleError):  # it is said elsewhere that there is no such board
            yield _leads(plan, channels)


def _leads(plan: Plan, channels: Sequence[Channel]) -> LeftOut:
    """Bound the relative loss of coil current, at a given voltage, by the resistance of tracks from coils to pins."""
    coil = plan.spec.coil
    hz = np.array([channel.drive_hz for channel in channels])
    alone = np.abs(impedance(coil.resistance_ohm, coil.inductance_mh * MH, hz))
    longest_ohm = max(board_of(plan).leads_ohm)
    together = np.abs(impedance(coil.resistance_ohm + longest_ohm, coil.inductance_mh * MH, hz))
    return _worst_channel("tracks to the pins", "current", channels, 1 - alone / together)


def _coupled_coils(plan: Plan, channels: Sequence[Channel]) -> LeftOut:
    """Bound the current that all other coils, driven in phase, induce in the middle one, divided by its own current."""
    spec = plan.spec
    coils = plan.coils
    coil = coil_source(spec.coil)
    row, column = np.divmod(np.arange(coils.rows * coils.columns), coils.columns)
    away_mm = np.hypot((row - coils.rows // 2) * coils.pitch_y_mm, (column - coils.columns // 2) * coils.pitch_x_mm)
    apart = away_mm[away_mm > 0] * MM
    henry = (np.abs(mutual_inductance(coil, apart)) * (1 + mutual_error(coil, apart))).sum()
    hz = np.array([channel.drive_hz for channel in channels])
    own_ohm = np.abs(impedance(spec.coil.resistance_ohm, spec.coil.inductance_mh * MH, hz))
    return _worst_channel("mutual inductance", "current", channels, 2 * pi * hz * henry / own_ohm)


def _steel_effects(plan: Plan, channels: Sequence[Channel]) -> Iterator[LeftOut]:
    """Bound the effects of saturation, eddy currents, other washers and remanence on the pull on steel."""
    spec = plan.spec
    coil, washer = magnetic_parts(spec)
    offset = np.array([channel.site.coil_distance_mm for channel in channels]) * MM
    hanging_um = hanging_gap_um(spec, np.array([channel.sag_um for channel in channels]))
    dipole = site_pulls(spec, [channel.site for channel in channels], hanging_um).dipole
    made = washer_magnetised(coil, washer, spec.coil.gap_mm * MM, offset, dipole)
    peak_a = plan.load.current_peak_ma * MA
    core_t, core_chi_n = core_polarisation(coil)
    of_core = saturation_loss(core_t * peak_a / SATURATION_T, core_chi_n)
    of_washers = saturation_loss(made.polarisation * peak_a / SATURATION_T, made.chi_n)
    yield _worst_channel("saturation", "force", channels, np.minimum(2 * of_core + of_washers, 1.0))
    drive = [channel.drive_hz for channel in channels]
    eddies = [2 * core_eddies(coil, RESISTIVITY_OHM_M, f) + washer_eddies(washer, RESISTIVITY_OHM_M, f) for f in drive]
    yield _worst_channel("eddy currents", "force", channels, np.array(eddies))
    shielded = np.zeros(len(channels))
    middle = (washer.outer_diameter + washer.inner_diameter) / 4
    for members in _sets(channels, spec):
        place = np.array([channels[k].site.washer_mm for k in members]) * MM
        echo = core_echo(coil, spec.coil.gap_mm * MM, place)
        shielded[members] = mutual_shielding(
            dipole[members], made.field[members], made.share[:, members], place, middle, echo
        )
    if shielded.any():
        yield _worst_channel("shielding", "force", channels, shielded)
    yield from _remanence(plan, channels)


USUAL_REMANENCE = 0.25
"""Share of the coercivity by which steel is magnetised, where a spec plans with none: assumed (docs/driving.md)."""


def _remanence(plan: Plan, channels: Sequence[Channel]) -> Iterator[LeftOut]:
    """Bound the force by remanent magnetisation, divided by each channel's wanted force, with all channels on.

    Plain tones make each a line at half the resonance, which the selectivity counts where the spec plans with it
    (`drive.remanent_share`); where it does not, the bound is of the usual share. A constant current makes the
    wanted lines stronger or weaker; the root of a force has further lines, of which an OFF taxel may hear all at most.
    """
    spec = plan.spec
    share = spec.drive.remanent_share
    offset_m = np.array([channel.site.coil_distance_mm for channel in channels]) * MM
    rho = mover_of(spec).remanent_currents(spec.coil, spec.washer_or_magnet, share or USUAL_REMANENCE, offset_m)
    line = np.array([channel.line_a2 for channel in channels])
    bound = np.zeros(len(channels))
    scheme = plan.scheme
    for members in _sets(channels, plan.spec):
        line_a2 = line[members]
        if scheme.is_root:
            lines = root_lines(line_a2, plan.spec.drive.headroom)
            current = lines.wanted + lines.others
        else:
            current = current_lines_a(scheme, line_a2)
        bound[members] = rho[members] * current / line_a2
    if bound.any():
        yield replace(
            _worst_channel("remanence", "force", channels, bound), computed=share > 0 and not scheme.has_constant
        )


def _sets(channels: Sequence[Channel], spec: Spec) -> list[list[int]]:
    """Return the indices into `channels` of those that share a coil, one list for each set of channels."""
    kinds = [channel.index % spec.coil.sets for channel in channels]
    return [members for kind in range(spec.coil.sets) if (members := [k for k, of in enumerate(kinds) if of == kind])]


def _motion_effects(plan: Plan, channels: Sequence[Channel]) -> Iterator[LeftOut]:
    """Bound the effects of the washers' motion on force, resonance, current and ring-down."""
    spec = plan.spec
    level, static, ring_down, ring_up = np.array(
        [(c.level_um, c.static_um, c.ring_down_ms, c.ring_up_ms) for c in channels]
    ).T
    nearer, softer = _pulled(plan, channels)
    yield _worst_channel("gap", "force", channels, nearer)
    yield _worst_channel("softening", "resonance", channels, softer)
    pull, stiffness, resonance, drive, q, line = np.array(
        [(c.force_constant_n_per_a2, c.stiffness_n_per_m, c.resonance_hz, c.drive_hz, c.q, c.line_a2) for c in channels]
    ).T
    # The constant part of the current over the channel's own tone in it.
    scheme = plan.scheme
    bias = np.zeros(len(channels))
    for members in _sets(channels, spec):
        if scheme.is_biased:
            bias[members] = scheme.bias_ratio * line[members].max() / line[members]
        elif scheme.is_root:
            bias[members] = 2 * (1 + spec.drive.headroom) * line[members].sum() / line[members]
    ohm = spec.coil.resistance_ohm
    henry = spec.coil.inductance_mh * MH
    moved = motional_voltage(pull, level * UM, resonance, drive, bias, partial(impedance, ohm, henry))
    yield _worst_channel("motion", "current", channels, moved)
    if not scheme.takes_turns and (ring_down > 0).any():
        pulse = pull * (plan.load.current_peak_ma * MA) ** 2 / stiffness / (level * UM)
        delay = ring_down_error(static / level, pulse, resonance, q, np.exp(ring_down / ring_up), henry / ohm)
        yield _worst_channel("switching", "ring-down time", channels, np.where(ring_down > 0, delay, 0.0))


def _pulled(plan: Plan, channels: Sequence[Channel]) -> tuple[np.ndarray, np.ndarray]:
    """Return two bounds (n,): on relative errors of force and resonance from taking pulls at the gap without current.

    In fact the mean pull draws a washer nearer, until the spring balances it, and the washer swings about that place.
    There the slope of the pull over the gap (of force and lever) softens the spring. Infinite where nothing balances.
    """
    spec = plan.spec
    sites = [channel.site for channel in channels]
    sag, static, exponent, level, here, error = np.array(
        [
            (c.sag_um, c.static_um, c.pull_exponent, c.level_um, c.force_constant_n_per_a2, c.force_error)
            for c in channels
        ]
    ).T
    gap_um = hanging_gap_um(spec, sag)
    rest = site_pulls(spec, sites, gap_um)
    # Errors of side force and moment add to the pull's: `error` has all three on the mode, `rest.error` the pull's.
    unsure = error / rest.error / rest.pull
    modes = [TaxelModes(np.array(c.modes_hz), np.array(c.mode_motions)) for c in channels]

    def on_mode(nearer_um: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return pull / planned pull at gaps reduced by `nearer_um`, errors of its slope per µm, curvature per µm²."""
        at = site_pulls(spec, sites, np.maximum(gap_um - nearer_um, gap_um / LEAST_GAP))
        share = working_mode_ratios(modes, site_wrenches(spec, at, sites))
        return at.pull * share / here, at.slope_off * unsure * UM, at.bend_off * unsure * UM**2

    # The deflection under the mean pull if that did not grow; a few iterations then find the balance.
    slack_um = static * np.maximum(1 - static / gap_um, 0) ** np.maximum(exponent, 0)
    for _ in range(BALANCE_ROUNDS):
        pull, doubt, bend = on_mode(static)
        static = slack_um * pull
    # Means over a swing, exact to the seventh order: of the pull, and of its component in phase with the motion.
    outer = level * np.cos(np.pi / 8)
    inner = level * np.sin(np.pi / 8)
    swung = [on_mode(static + side)[0] for side in (outer, inner, -inner, -outer)]
    slope = ((swung[0] - swung[3]) * outer + (swung[1] - swung[2]) * inner) / (2 * level**2)
    # Between two tables of pulls there may be a step as large as their error.
    near = np.maximum(gap_um - static - level, gap_um / LEAST_GAP)
    step = np.where(pull_range(near * UM) == pull_range((gap_um + level) * UM), 0.0, error)
    softer = np.maximum((slope + doubt + step * (outer + inner) / level**2) * slack_um, 0)
    meets = (static + level >= gap_um) | (np.array([c.static_um for c in channels]) >= gap_um)
    forces = np.abs(sum(swung) / 4 - 1) + doubt * static + bend * level**2 / 4 + rest.jump * unsure + step
    return np.where(meets, inf, forces), np.where(meets | (softer >= 1), inf, 1 - np.sqrt(np.maximum(1 - softer, 0)))
