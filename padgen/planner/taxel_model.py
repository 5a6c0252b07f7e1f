"""Model one taxel by beam theory: from dimensions in mm to resonance, mass, modes and stress.

This module turns dimensions in mm into the SI arrays of `padgen.physics`. Everything takes arrays of beam shapes, so
that a grid of candidates costs one call. `SolvedModel` has modes that finite elements solved for the printed solid in
place of the beam model's.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps
from typing import Any, NamedTuple

import numpy as np

from padgen.core.units import G_PER_CM3, GPA, MM
from padgen.physics.beams import (
    BeamSection,
    EndCompliance,
    PinFoot,
    Surroundings,
    YokeSize,
    on_elastic_ends,
    pin_motion,
    pushed_stress,
    within_fitted_range,
)
from padgen.physics.modes import (
    BENT,
    FLOOR,
    UNCERTAINTY,
    BeamPlacement,
    Modes,
    RigidBody,
    RigidPlate,
    bending_stress,
    box,
    combine,
    hardening,
    relative_error,
    ring,
    suspended_modes,
    to_tip,
    uncertain_energies,
)
from padgen.physics.resonator import TaxelModes, natural_frequency, rule_stiffness
from padgen.planner.suspensions import Arrangement, BeamShape, Block, PlateShape, suspension
from padgen.spec import Spec
from padgen.spec.model import ContactorTable

__all__ = [
    "STRAIGHT",
    "ContactMotion",
    "Exponents",
    "Push1N",
    "SolvedModel",
    "TaxelModel",
    "asked_error",
    "fillet_mm",
    "foot_fillet_mm",
    "hollows_mm",
    "narrowest_mm",
    "open_recess_mm",
    "pin_place_mm",
    "plate_shape",
    "post_diameter_mm",
    "recess_mm",
    "shortest_mm",
    "solved_model",
]

THINNEST_WALL_MM = 1e-3
Exponents = tuple[Any, Any, Any]
STRAIGHT: Exponents = (0.5, 1.5, -1.5)
"""Exponents a, b, c of a resonance ``f ∝ w^a t^b l^c`` on straight beams (width, thickness, length)."""
STEP = 1e-3
"""Relative step of a dimension for the numerical exponents of bent beams."""


def plate_shape(spec: Spec) -> PlateShape:
    """Return the plate's size: the spec's, else the least that holds the boss, and recess or ballast with walls."""
    walls = 2 * spec.printer.line_width_mm
    recess = recess_mm(spec)[0]
    boss = spec.contact_diameter_mm if spec.pin_share is None else 0.0
    taxel = spec.taxel
    ballast = spec.ballast
    along = max(recess, ballast.width_mm) if ballast else recess
    across = max(recess, ballast.corners_mm) if ballast else recess
    return PlateShape(
        taxel.plate_length_mm or max(along + walls, boss),
        taxel.plate_width_mm or max(across + walls, boss),
        taxel.plate_thickness_mm,
    )


def shortest_mm(spec: Spec, topology: str) -> float:
    """Return the least beam length in mm that has room for plate and pin and that the printer lays as drawn."""
    least = suspension(topology).shortest(plate_shape(spec), spec.printer.smallest_gap_mm)
    if spec.pin_share is None:
        return max(least, spec.printer.shortest_beam_mm)
    half = spec.contact_diameter_mm / 2
    before = (half + spec.taxel.fillet_mm) / spec.pin_share
    return max(least, spec.printer.shortest_beam_mm, before, half / (1 - spec.pin_share))


def narrowest_mm(spec: Spec) -> float:
    """Return the least beam width in mm: the printer's or, if larger, the diameter of a pin that stands on the beam."""
    if spec.pin_share is None:
        return spec.printer.smallest_beam_mm
    return max(spec.printer.smallest_beam_mm, spec.contact_diameter_mm)


def pin_place_mm(spec: Spec, arrangement: Arrangement) -> tuple[Any, Any]:
    """Return the place (x, y) in mm of the contactor's axis in the taxel's own axes."""
    if spec.pin_share is None:
        return arrangement.washer_x_mm, 0.0 * arrangement.washer_x_mm
    path = arrangement.beams[0]
    ahead = spec.pin_share * path.length_mm
    x: Any = 0.0
    y: Any = 0.0
    for index, segment in enumerate(path.segments):
        share = ahead / np.maximum(segment.length_mm, 1e-9)
        at = path.within(index, np.clip(share, 0.0, 1.0))
        here = (share >= 0) | (index == 0)
        x = np.where(here, at.x_mm, x)
        y = np.where(here, at.y_mm, y)
        ahead = ahead - segment.length_mm
    return x, y


def recess_mm(spec: Spec) -> tuple[float, float]:
    """Return diameter and depth in mm of the recess in the plate's underside."""
    return spec.washer_or_magnet.outer_diameter_mm + spec.taxel.washer_clearance_mm, spec.recess_depth_mm


def open_recess_mm(spec: Spec) -> tuple[float, float]:
    """Return diameter and depth in mm of the hollow in the plate's underside that ballast, without mover, leaves open.

    It is the recess; ballast that is wider than the recess leaves its pocket open below it.
    """
    diameter, depth = recess_mm(spec)
    ballast = spec.ballast
    if ballast is None or ballast.round_mm <= diameter:
        return diameter, depth
    return ballast.round_mm, spec.pocket_top_mm - ballast.height_mm


def hollows_mm(spec: Spec) -> list[tuple[float, float, float, float]]:
    """Return what is cut out of the plate as rings in mm: heights from and to, outer and inner diameter.

    They are the recess and, above it, the pocket of the ballast, which takes the recess in where it is wider.
    """
    diameter, depth = recess_mm(spec)
    recess = (0.0, depth, diameter, post_diameter_mm(spec))
    ballast = spec.ballast
    if ballast is None:
        return [recess]
    if ballast.round_mm > diameter:
        return [(0.0, spec.pocket_top_mm, ballast.round_mm, 0.0)]
    return [recess, (depth, spec.pocket_top_mm, ballast.round_mm, 0.0)]


def post_diameter_mm(spec: Spec) -> float:
    """Return the diameter in mm of the recess's centre post, 0 where it has none."""
    bore = spec.washer_or_magnet.inner_diameter_mm - spec.taxel.washer_clearance_mm
    return bore if spec.taxel.centre_post and bore >= spec.printer.line_width_mm else 0.0


def fillet_mm(spec: Spec, arrangement: Arrangement) -> Any:
    """Return the radius in mm of the root fillets: the spec's, or less where there is less room.

    The window limits it, and so does a short beam: beyond its fillets it must be as long as the printer's shortest. A
    beam that begins with an arc has none.
    """
    first = [path.segments[0] for path in arrangement.beams]
    room = (np.minimum(s.length_mm / 3, s.length_mm - spec.printer.shortest_beam_mm) for s in first)
    straight = (np.where(s.turn_rad, 0.0, straight_mm) for s, straight_mm in zip(first, room, strict=True))
    short = np.minimum.reduce(np.broadcast_arrays(*straight))
    return np.clip(np.minimum(arrangement.root_clearance_mm, short), 0, spec.taxel.fillet_mm)


FOOT_CLEARANCE_MM = 0.02
"""Least distance of a foot's fillet from the edge of what it stands on."""


def foot_fillet_mm(spec: Spec, beam_width_mm: float) -> float:
    """Return the radius in mm of the fillet round a pin's foot: the spec's, or what there is room for; a boss has none.

    On the plate it must also end below the chamfer of its top.
    """
    if spec.contactor == ContactorTable():
        return 0.0
    ground_mm = min(plate_shape(spec)[:2]) if spec.pin_share is None else beam_width_mm
    room_mm = (ground_mm - spec.contact_diameter_mm) / 2 - FOOT_CLEARANCE_MM
    return min(spec.contactor.fillet_mm, room_mm) if room_mm >= FOOT_CLEARANCE_MM else 0.0


def _rigid_top_mm(spec: Spec) -> float:
    """Return the height in mm above the bed of the contactor's top, a dome replaced by a flat top of equal mass.

    The top of a dome lies d/6 above that of the cylinder.
    """
    round_off = spec.contact_diameter_mm / 6 if spec.contactor.shape == "dome" else 0.0
    return spec.contact_top_mm - round_off


def _from_array(method: "Callable[[TaxelModel], np.ndarray]") -> "Callable[[TaxelModel], np.ndarray]":
    """Wrap a method so that a taxel taken from an array (`member_of`) looks its value up in the array's result."""

    @wraps(method)
    def value(model: "TaxelModel") -> np.ndarray:
        if not model.member_of:
            return method(model)
        array, index = model.member_of
        return getattr(array, method.__name__)[index]

    return value


class EndRatios(NamedTuple):
    """Factors on the compliances at a beam's ends.

    Of its root, of its tip, of what holds the tip (wall or crossbar), and of the yoke.
    """

    root: float = 1.0
    tip: float = 1.0
    mount: float = 1.0
    yoke: float = 1.0

    def scaled(self, ends: EndCompliance) -> EndCompliance:
        """Return `ends` with their compliances in vertical bending multiplied by these factors."""
        mount = self.mount * ends.mount
        return ends._replace(
            root=self.root * ends.root,
            tip=self.tip * (ends.tip - ends.mount) + mount,
            mount=mount,
            yoke_turn=self.yoke * ends.yoke_turn,
            yoke_both=self.yoke * ends.yoke_both,
            yoke_lift=self.yoke * ends.yoke_lift,
        )


class ContactMotion(NamedTuple):
    """Motion of a contactor divided by the mover's, in the working mode: `lever` vertical, `sway` sideways at its top.

    Under a push down on its top it has a `stiffness` in N/m; it moves sideways by `lean` times as much as down, and the
    mover follows by `mover` times as much.
    """

    lever: float
    sway: float
    stiffness: float
    lean: float
    mover: float


class Push1N(NamedTuple):
    """Downward travel in m/N of a contactor under a push, and largest nominal bending stress in Pa/N of the beams."""

    way_m: float
    stress_pa: float


@dataclass(frozen=True, eq=False)
class TaxelModel:
    """One taxel, or an array of taxels of one topology, by the beam model.

    `frame_depth_mm` is the depth of the frame behind a root up to where it is held, half a rib by default.
    `bead_ratio` is the stiffness across the beads of a layer over that along them; plans take 1. `end_ratios` scale the
    compliance of the beams' ends, to try what their error does. `member_of` is the
    model of an array of taxels and this taxel's index in it: slow steps are computed for the whole array at once.
    """

    spec: Spec
    topology: str
    plate: PlateShape
    beam: BeamShape
    frame_depth_mm: Any = field(default=None, kw_only=True)
    bead_ratio: Any = field(default=1.0, kw_only=True)
    end_ratios: EndRatios | None = field(default=None, kw_only=True)
    member_of: "tuple[TaxelModel, int] | None" = field(default=None, kw_only=True, compare=False, repr=False)

    @cached_property
    def arrangement(self) -> Arrangement:
        """Geometry of the taxel in mm: beams, moving blocks, and the opening in the frame."""
        return suspension(self.topology).arrange(
            self.plate, BeamShape(*(np.asarray(v, float) for v in self.beam)), self.spec.printer.smallest_gap_mm
        )

    @property
    def plastic_share(self) -> Any:
        """Printed mass of the plastic in plate and boss, divided by the drawn mass: 1 here, as no print is modelled."""
        return 1.0

    @cached_property
    def body(self) -> RigidBody:
        """The rigid moving body without beams: plate, boss, mover, ballast and glue, less recess and pocket."""
        return self.body_of(self.arrangement.blocks)

    def body_of(self, blocks: Sequence[Block]) -> RigidBody:
        """Return one rigid body of `blocks`, boss, mover, ballast and glue, less recess and pocket."""
        spec = self.spec
        taxel = self.spec.taxel
        density = spec.material.density_g_per_cm3 * G_PER_CM3 * self.plastic_share
        top = taxel.plate_thickness_mm * MM
        boss_top = top if spec.pin_share is not None else _rigid_top_mm(spec) * MM
        high = spec.mover_top_mm * MM
        low = high - spec.washer_or_magnet.thickness_mm * MM
        outer = spec.washer_or_magnet.outer_diameter_mm * MM
        bore = spec.washer_or_magnet.inner_diameter_mm * MM
        washer_at = (self.arrangement.washer_x_mm * MM, 0.0)
        parts = [
            *(
                box((x0 * MM, y0 * MM, 0), (x1 * MM, y1 * MM, height * MM), density)
                for x0, x1, y0, y1, height in blocks
            ),
            ring(washer_at, top, boss_top, spec.contact_diameter_mm * MM, 0, density),
            *(
                ring(washer_at, low_mm * MM, high_mm * MM, outer_mm * MM, inner_mm * MM, -density)
                for low_mm, high_mm, outer_mm, inner_mm in hollows_mm(spec)
            ),
            ring(washer_at, low, high, outer, bore, spec.washer_or_magnet.density_g_per_cm3 * G_PER_CM3),
        ]
        if ballast := spec.ballast:
            ballast_at = (spec.pocket_top_mm - ballast.height_mm) * MM, spec.pocket_top_mm * MM
            across = ballast.round_mm * MM, ballast.inner_diameter_mm * MM
            parts.append(ring(washer_at, *ballast_at, *across, ballast.density_g_per_cm3 * G_PER_CM3))
        if taxel.glue_mg:
            glue_density = taxel.glue_mg * 1e-6 / (np.pi / 4 * (outer**2 - bore**2) * (high - low))
            parts.append(ring(washer_at, low, high, outer, bore, glue_density))
        return combine(*parts)

    @cached_property
    def placements(self) -> list[BeamPlacement]:
        """The beams in SI units: sections, and places and directions of their tips at the body."""
        fillet = fillet_mm(self.spec, self.arrangement) * MM
        placements: list[BeamPlacement] = []
        share = self.spec.pin_share
        for path in self.arrangement.beams:
            pinned = share is not None and not placements
            width = (path.width_mm + self.spec.printer.width_offset_mm) * MM
            thickness = (path.thickness_mm + self.spec.printer.z_offset_mm) * MM
            pieces = () if path.is_straight else tuple((s.length_mm * MM, s.turn_rad) for s in path.segments)
            across = self.spec.material.cross_layer_ratio
            ratios = {"across": across, "beads": self.bead_ratio}
            bare = BeamSection(width, thickness, path.length_mm * MM, fillet, path=pieces, **ratios)
            section = on_elastic_ends(bare, self._surroundings, self.spec.material.poisson_ratio)
            if self.end_ratios:
                section = section._replace(ends=self.end_ratios.scaled(section.ends))
            if pinned:
                section = section._replace(pin=PinFoot(share, self.spec.contact_diameter_mm * MM))
            tip = path.corners[-1]
            x, y, z, *along = np.broadcast_arrays(tip.x_mm * MM, tip.y_mm * MM, thickness / 2, *tip[2:])
            pin = self._pin_body(thickness) if pinned else None
            placements.append(BeamPlacement(section, np.stack([x, y, z], -1), np.stack(along, -1), pin))
        return placements

    def _pin_body(self, thickness: Any) -> RigidBody:
        """Return the part of the pin above its beam, in axes at the middle of the beam's `thickness` in m."""
        density = self.elastic[2] * self.plastic_share
        top = _rigid_top_mm(self.spec) * MM - thickness / 2
        return ring((0.0, 0.0), thickness / 2, top, self.spec.contact_diameter_mm * MM, 0, density)

    @cached_property
    def contact(self) -> ContactMotion:
        """Motion of one taxel's contactor: as a ratio to the mover's in the working mode, and under a static push."""
        modes = self.modes
        angular = 2 * np.pi * modes.frequency_hz
        vertical = modes.at_point(self.washer_point_m)[..., 2, :]
        foot, local = self._foot_motion
        height = self.spec.contact_top_mm * MM
        if self.spec.pin_share is not None:
            height = height - float(self.placements[0].section.thickness) / 2
        rise = np.zeros((3, 6))
        rise[[0, 1, 2], [0, 1, 2]] = 1.0
        rise[0, 4] = height
        rise[1, 3] = -height
        top = rise @ foot
        working = int(self.working)
        moved = top[:, working] / vertical[working]
        pushed = top @ (top[2] / angular**2) + (rise @ local @ rise.T)[:, 2]
        pushed[2] += self._shortening_m_per_n
        followed = float(vertical @ (top[2] / angular**2))
        return ContactMotion(
            lever=float(moved[2]),
            sway=float(np.hypot(moved[0], moved[1])),
            stiffness=float(1 / pushed[2]),
            lean=float(np.hypot(pushed[0], pushed[1]) / pushed[2]),
            mover=followed / float(pushed[2]),
        )

    @property
    def _shortening_m_per_n(self) -> float:
        """Compression in m/N of one taxel's contactor, from its foot up, under a push on its top."""
        ground_mm = self.plate.thickness_mm
        if self.spec.pin_share is not None:
            ground_mm = float(self.arrangement.beams[0].thickness_mm)
        area = np.pi / 4 * (self.spec.contact_diameter_mm * MM) ** 2
        return max(self.spec.contact_top_mm - ground_mm, 0.0) * MM / (self.elastic[0] * area)

    @cached_property
    def _foot_motion(self) -> tuple[np.ndarray, np.ndarray]:
        """Motion (6, k) of the contactor's foot in each mode, and the foot's flexibility (6, 6) with the body held.

        On the plate it is at the washer's axis on the bed, on a beam below the pin at the middle of the thickness.
        """
        modes = self.modes
        if self.spec.pin_share is None:
            return np.concatenate([modes.at_point(self.washer_point_m), modes.shape[3:]]), np.zeros((6, 6))
        beam = self.placements[0]
        pinned = pin_motion(beam.section, *self.elastic[:2])
        return pinned.shape @ to_tip(beam, modes.reference) @ modes.shape, pinned.local

    @cached_property
    def pushes(self) -> tuple[Push1N, Push1N]:
        """Travel and beam stress per N of push on one contactor: with the mover free, and with it on the coil."""
        modes = self.modes
        angular = 2 * np.pi * modes.frequency_hz
        foot, local = self._foot_motion
        vertical = modes.at_point(self.washer_point_m)[..., 2, :]
        free = foot[2] / angular**2
        # The coil pushes back by as much as keeps the mover where it is.
        held = free - vertical / angular**2 * (vertical @ free) / (vertical @ (vertical / angular**2))
        pushes = []
        for share in (free, held):
            body = modes.shape @ share
            stresses = [bending_stress(beam, body, modes.reference, *self.elastic[:2]) for beam in self.placements]
            if self.spec.pin_share is not None:
                beam = self.placements[0]
                tip = (to_tip(beam, modes.reference) @ body[:, None])[:, 0]
                stresses[0] = pushed_stress(beam.section, tip, *self.elastic[:2])
            pushes.append(Push1N(float(foot[2] @ share + local[2, 2]), float(max(stresses))))
        return pushes[0], pushes[1]

    @cached_property
    def _surroundings(self) -> Surroundings:
        """Sizes in m of the parts that hold the beams' ends."""
        diameter, depth = open_recess_mm(self.spec)
        frame = self.spec.pad.rib_mm / 2 if self.frame_depth_mm is None else self.frame_depth_mm
        wall = max((self.plate.length_mm - diameter) / 2, THINNEST_WALL_MM)
        yoke = self.arrangement.yoke
        size = YokeSize(*(v * MM for v in yoke)) if yoke else None
        return Surroundings(frame * MM, wall * MM, depth * MM, diameter / 2 * MM, size)

    def beside_yoke(self, section: BeamSection) -> BeamSection:
        """Return `section` with the compliance of what holds its ends added, the yoke at its tip taken as rigid."""
        around = self._surroundings._replace(yoke=YokeSize(0.0, 1.0, 1.0, 0.0, 1.0))
        return on_elastic_ends(section, around, self.spec.material.poisson_ratio)

    @property
    def elastic(self) -> tuple[float, float, float]:
        """Young's modulus in Pa, Poisson's ratio and density in kg/m³."""
        material = self.spec.material
        return (
            material.modulus_gpa * GPA,
            material.poisson_ratio,
            material.density_g_per_cm3 * G_PER_CM3,
        )

    @cached_property
    def modes(self) -> Modes:
        """The six modes of the body on its beams."""
        if self.member_of:
            array, index = self.member_of
            return Modes(*(part[index] for part in array.modes))
        return suspended_modes(self.body, self.placements, *self.elastic)

    @cached_property
    def washer_point_m(self) -> np.ndarray:
        """Place (…, 3) in m of the washer's axis at z = 0, where the pull acts and a finger on the boss pushes."""
        x = np.asarray(self.arrangement.washer_x_mm * MM)
        return np.stack([x, 0 * x, 0 * x], -1)

    @cached_property
    @_from_array
    def compliances(self) -> np.ndarray:
        """Part (…, 6) in m/N that each mode contributes to the washer's static compliance under a vertical force."""
        vertical = self.modes.at_point(self.washer_point_m)[..., 2, :]
        angular = 2 * np.pi * self.modes.frequency_hz
        return vertical**2 / angular**2

    @cached_property
    @_from_array
    def working(self) -> np.ndarray:
        """Index (…,) of the working mode: the one that a vertical pull on the washer moves most."""
        return np.asarray(self.compliances.argmax(-1))

    @cached_property
    @_from_array
    def resonance_hz(self) -> np.ndarray:
        """Resonance (…,) of the working mode."""
        return _take(self.modes.frequency_hz, self.working)

    @cached_property
    @_from_array
    def stiffness_n_per_m(self) -> np.ndarray:
        """Stiffness (…,) of the working mode at the washer."""
        return 1 / _take(self.compliances, self.working)

    @cached_property
    @_from_array
    def effective_mass_kg(self) -> np.ndarray:
        """Effective mass (…,) in kg of the working mode, referred to the washer."""
        return self.stiffness_n_per_m / (2 * np.pi * self.resonance_hz) ** 2

    @cached_property
    @_from_array
    def rule_hz(self) -> np.ndarray:
        """Resonance (…,) by the paper's point-mass rule (Eq. 1-2): the whole body at the beam's tip."""
        rule = suspension(self.topology)
        width, thickness, length = (np.asarray(v, float) * MM for v in self.beam)
        one = rule_stiffness(self.elastic[0], width, thickness, length, rule.END_FACTOR)
        return np.asarray(natural_frequency(rule.BEAMS * one, self.body.mass))

    @cached_property
    @_from_array
    def sag_m(self) -> np.ndarray:
        """Sag (…,) of the washer under the weight of body and beams."""
        return self.modes.sag(self.washer_point_m)

    @property
    def second_mode(self) -> tuple[float, float]:
        """Frequency in Hz, and share of static compliance, of one taxel's mode nearest in frequency to its working one.

        The share is over the working mode's, and 0 where a pull at the washer's axis does not excite the mode.
        """
        working = int(self.working)
        others = [k for k in range(6) if k != working]
        ratio = np.abs(np.log(self.modes.frequency_hz / self.modes.frequency_hz[working]))
        nearest = min(others, key=lambda k: float(ratio[k]))
        return float(self.modes.frequency_hz[nearest]), float(self.compliances[nearest] / self.compliances[working])

    @property
    def beam_error(self) -> float | None:
        """Relative error of the beam model's resonance; None here, where no solid was solved."""
        return None

    @property
    def error_estimate(self) -> np.ndarray:
        """Relative error (…,) within which the resonance most likely lies (`mode_errors`)."""
        return _take(self.mode_errors, self.working)

    @property
    def is_straight(self) -> bool:
        """True where no beam has a bend."""
        return all(path.is_straight for path in self.arrangement.beams)

    @cached_property
    def exponents(self) -> Exponents:
        """Exponents a, b, c in one taxel's ``f ∝ w^a t^b l^c`` (beam width, thickness, length); numerical if bent."""
        if self.is_straight:
            return STRAIGHT
        step = np.exp(STEP * np.concatenate([np.eye(3), -np.eye(3)]))
        near = TaxelModel(self.spec, self.topology, self.plate, BeamShape(*(np.array(self.beam) * step).T))
        # Follow one mode through all sizes: the working one of the drawn beam.
        log_hz = np.log(near.modes.frequency_hz[:, int(self.working)])
        width, thickness, length = (log_hz[:3] - log_hz[3:]) / (2 * STEP)
        return width, thickness, length

    @property
    def in_range(self) -> np.ndarray:
        """True (…,) where beams are straight and their sizes are in the range that the beam model was fitted to."""
        return np.asarray(self.is_straight & within_fitted_range(*(np.asarray(side, float) for side in self.beam)))

    @cached_property
    @_from_array
    def mode_errors(self) -> np.ndarray:
        """Relative error (…, 6) within which each mode's frequency most likely lies (`padgen.physics.modes`)."""
        modulus, poisson, _ = self.elastic
        length, width, thickness = (side * MM for side in self.plate)
        roof = max(thickness - open_recess_mm(self.spec)[1] * MM, thickness / 10)
        yoke = self.arrangement.yoke
        plate = RigidPlate(length, width, roof, yoke.neck_length_mm * MM if yoke else None)
        energies = sum(uncertain_energies(beam, self.modes, modulus, poisson, plate) for beam in self.placements)
        floor = FLOOR if self.is_straight else BENT
        return relative_error(np.asarray(energies), self.modes.frequency_hz, self.working, floor)

    @cached_property
    @_from_array
    def sag_error(self) -> np.ndarray:
        """Relative error (…,) within which the sag most likely lies: errors by the modes and by the beams' weight."""
        parts = np.abs(self.modes.sag_parts(self.washer_point_m))
        by_modes = (parts * STATIC * self.mode_errors).sum(-1) / parts.sum(-1)
        density = self.elastic[2]
        sections = [placement.section for placement in self.placements]
        beams_kg = sum(section.width * section.thickness * section.length for section in sections) * density
        return np.asarray(by_modes + BEAMS_WEIGHT * beams_kg / (beams_kg + self.body.mass))

    @property
    def compliance_error(self) -> float:
        """Relative error within which one taxel's static deflection under a force most likely lies."""
        return STATIC * float(self.error_estimate)

    @property
    def stress_error(self) -> float:
        """Relative error within which one taxel's stress per displacement most likely lies, notches not counted."""
        return STATIC * float(self.error_estimate) + SHAPE_ERROR

    @cached_property
    @_from_array
    def stress_pa_per_m(self) -> np.ndarray:
        """Largest bending stress (…,) of the beams in Pa per m of the washer's motion, in the working mode."""
        motion = self._working_motion
        reference = self.modes.reference
        stresses = [bending_stress(beam, motion, reference, *self.elastic[:2]) for beam in self.placements]
        return np.asarray(np.maximum.reduce(stresses))

    @cached_property
    def _working_motion(self) -> np.ndarray:
        """Motion (…, 6) of the body at the modes' reference in the working mode, while the washer moves by 1 m."""
        shape = np.take_along_axis(self.modes.shape, self.working[..., None, None], -1)[..., 0]
        vertical = _take(self.modes.at_point(self.washer_point_m)[..., 2, :], self.working)
        return np.asarray(shape / vertical[..., None])

    @cached_property
    @_from_array
    def hardening_per_m2(self) -> np.ndarray:
        """Coefficient α of the working mode's force ``k z (1 + α z²)`` at the washer, due to stretching of beams."""
        modes = self.modes
        scaled = modes.shape / (2 * np.pi * modes.frequency_hz[..., None, :])
        compliance = scaled @ np.swapaxes(scaled, -1, -2)
        return hardening(self.placements, self._working_motion, modes.reference, compliance, self.elastic[:2])

    @cached_property
    def contact_errors(self) -> tuple[float, float]:
        """Likely relative errors of one contactor's lever (motion over the mover's) and of its stiffness to a push."""
        if self.spec.pin_share is None:
            return RIGID_LEVER, STATIC * float(self.error_estimate)
        contact = self.contact
        changes = [LEVER_FLOOR]
        softened = [PIN_FLOOR]
        for ratios in self._uncertain_ends:
            other = replace(self, member_of=None, end_ratios=ratios).contact
            changes.append(abs(other.lever / contact.lever - 1))
            softened.append(abs(contact.stiffness / other.stiffness - 1))
        return LEVER_SHARE * float(np.linalg.norm(changes)), PIN_SHARE * float(np.linalg.norm(softened))

    @property
    def _uncertain_ends(self) -> list[EndRatios]:
        """Factors on the beams' end compliances, in each set one raised by its uncertainty, for a pin's errors."""
        mount = "crossbar" if self.arrangement.yoke else "mount"
        return [
            EndRatios(root=1 + UNCERTAINTY["root"]),
            EndRatios(tip=1 + UNCERTAINTY["tip"]),
            EndRatios(mount=1 + UNCERTAINTY[mount]),
            EndRatios(yoke=1 + UNCERTAINTY["yoke"]),
        ]

    def root_stress_pa(self, level_m: np.ndarray) -> np.ndarray:
        """Return the largest bending stress in Pa of the beams as the washer moves by `level_m` in the working mode."""
        return np.asarray(self.stress_pa_per_m * level_m)


STATIC = 2.5
"""Error of a static answer over that of its resonance: 2 from the stiffness, more since the shape is off, too.

This and the next two were chosen on those taxels of `docs/measure_campaign.py` that are drawn by cells
(`tests/reference/taxel_cells.csv`, docs/accuracy.md).
"""
RIGID_LEVER = 0.01
"""Relative error of the lever of a contactor that is on the plate."""
LEVER_FLOOR = 0.02
"""Relative error of the lever of a pin on a beam whose ends were certain."""
LEVER_SHARE = 1.35
"""Share of that and of what the ends' uncertainties do to the lever that is stated (docs/contactor.md)."""
PIN_FLOOR = 0.016
"""Relative error of the stiffness at such a pin."""
PIN_SHARE = 1.2
"""Share of that and of what the ends' uncertainties do to the stiffness that is stated."""
SHAPE_ERROR = 0.035
"""Relative error of a nominal stress whose stiffness is exact."""
BEAMS_WEIGHT = 0.15
"""Share of the beams' weight, at most 1/2 - 13/35, that is missing from the load of the consistent mass."""
SOLVED_OTHERS = 0.03
"""Relative error of the solved modes other than the working one, for which the elements are not refined."""


def _take(values: np.ndarray, index: np.ndarray) -> np.ndarray:
    return np.take_along_axis(values, index[..., None], -1)[..., 0]


FINEST = 2e-3
"""Smallest relative error of a resonance that finite elements are asked for."""


@dataclass(frozen=True)
class SolvedModel(TaxelModel):
    """One taxel by 3-D elasticity: `solved` has its modes, `solver_error` their relative error.

    Sag and stress are the beam model's, scaled by the ratio of the working modes' stiffnesses: both go with the bending
    moment at a beam's root.
    """

    solved: TaxelModes
    solver_error: float

    @cached_property
    def beam_model(self) -> TaxelModel:
        """The beam model of the same taxel."""
        return TaxelModel(self.spec, self.topology, self.plate, self.beam)

    @cached_property
    def modes(self) -> Modes:
        """The solved modes, referred to the washer's axis."""
        return Modes(self.solved.frequency_hz, self.solved.motion.T, self.washer_point_m)

    @property
    def error_estimate(self) -> np.ndarray:
        """Relative error of the resonance by finite elements."""
        return np.asarray(self.solver_error)

    @property
    def mode_errors(self) -> np.ndarray:
        """Relative error (6,) of each mode's frequency by finite elements."""
        errors = np.full(len(self.modes.frequency_hz), max(SOLVED_OTHERS, self.solver_error))
        errors[int(self.working)] = self.solver_error
        return errors

    @property
    def sag_error(self) -> np.ndarray:
        """Relative error of the sag under gravity: the beam model's, its stiffness error replaced by the solver's."""
        return self.beam_model.sag_error + STATIC * (self.solver_error - float(self.beam_model.error_estimate))

    @property
    def stress_error(self) -> float:
        """Relative error within which the stress most likely lies: shape by the beam model, stiffness by the solver."""
        beam = self.beam_model
        return beam.stress_error + 2 * (self.solver_error - float(beam.error_estimate))

    @property
    def beam_error(self) -> float | None:
        """Relative error of the beam model's resonance, against the solved one."""
        return float(self.beam_model.resonance_hz / self.resonance_hz - 1)

    @property
    def sag_m(self) -> np.ndarray:
        """Sag in m of the washer under the weight of the taxel."""
        return np.asarray(self.beam_model.sag_m / self._stiffness_ratio)

    @property
    def hardening_per_m2(self) -> np.ndarray:
        """Hardening coefficient α in 1/m² due to stretching of the beams, from the beam model."""
        return self.beam_model.hardening_per_m2

    def root_stress_pa(self, level_m: np.ndarray) -> np.ndarray:
        """Return the largest bending stress in Pa of the beams when the washer moves by `level_m`."""
        return np.asarray(self.beam_model.root_stress_pa(level_m) * self._stiffness_ratio)

    @cached_property
    def contact_errors(self) -> tuple[float, float]:
        """Relative errors of the contactor's motion over the mover's and of its stiffness, from the beam model."""
        return self.beam_model.contact_errors

    @property
    def pushes(self) -> tuple[Push1N, Push1N]:
        """Travel in m and beam stress in Pa per N of a push on the contactor, by the beam model."""
        return self.beam_model.pushes

    @property
    def _stiffness_ratio(self) -> np.ndarray:
        return np.asarray(self.stiffness_n_per_m / self.beam_model.stiffness_n_per_m)


def solved_model(model: TaxelModel, solved: TaxelModes, solver_error: float) -> SolvedModel:
    """Return `model` with its modes replaced by the solved ones."""
    return SolvedModel(model.spec, model.topology, model.plate, model.beam, solved, solver_error)


def asked_error(spec: Spec) -> float:
    """Return the largest relative error that a finite-element resonance may have if beams count as tuned to it."""
    return min(FINEST, spec.model.tolerance)
