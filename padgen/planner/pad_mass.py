"""Mass, centre of mass and moments of inertia of a pad with its coils, from the sizes in its plan, without CAD.

The printed pad is a plate less the taxels' windows, holes and groove, with the moving bodies of the beam model in the
windows; beams are their paths' boxes, with the fillets' volume at their roots. The tray is that of
`padgen.planner.fixtures`. Prints count as solid. A winding's copper follows from turns, size and resistance: wire of
the length l = N π d has R = ρ l/A and the mass γ l A = γ ρ l²/R; insulation is left out. Cores and screws are iron.
Coils on a board lie on its laminate; its pins, spacers and screws are left out.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from math import pi
from typing import NamedTuple

import numpy as np

from padgen.core.errors import InfeasibleError
from padgen.core.units import COPPER_KG_PER_M3, COPPER_OHM_M, G_PER_CM3, GRAM, MG, MM
from padgen.physics.board_coil import LAMINATE_KG_PER_M3
from padgen.physics.modes import RigidBody, box, combine, combine_stacked, ring
from padgen.planner.board_layout import board_of
from padgen.planner.fixtures import Tray, plan_tray
from padgen.planner.layout import coil_axis_mm, corner_groove
from padgen.planner.plan import TURNS, Channel, Plan, Taxel
from padgen.planner.suspensions import BeamPath, BeamShape, PathPoint, PlateShape
from padgen.planner.taxel_model import TaxelModel

__all__ = ["PadMass", "mode_momentum", "pad_mass"]

IRON_KG_PER_M3 = 7850.0
HEAD_SHARE = 1.0
"""Height of a cylinder head screw's head over the thread's diameter (ISO 4762)."""
CORNERS = ((-1, -1), (-1, 1), (1, -1), (1, 1))


class ChannelMass(NamedTuple):
    """Mass properties of a channel's taxel in SI units; the origin is on the washer's axis, at the pad's underside.

    `moving` is plate, boss, washer and glue with the beams; `window` the plastic that the frame lacks (negative).
    `momentum` (6,) is the force, and the moment about the washer's axis, that the working mode takes for unit
    acceleration of the washer upwards.
    """

    moving: RigidBody
    window: RigidBody
    momentum: np.ndarray


@dataclass(frozen=True, eq=False)
class PadMass:
    """Masses of a pad's parts as rigid bodies in SI units: x and y from the pad's centre, z from its underside."""

    plan: Plan

    @cached_property
    def channels(self) -> tuple[ChannelMass, ...]:
        """The masses of each channel's taxel."""
        return tuple(_channel_mass(self.plan, channel) for channel in self.plan.channels)

    @cached_property
    def pad(self) -> RigidBody:
        """The printed pad with its washers, their glue, and ballast."""
        parts = [self._plate]
        for channel, masses in zip(self.plan.channels, self.channels, strict=True):
            taxels = [taxel for taxel in self.plan.taxels if taxel.channel == channel.index]
            if taxels:
                parts += [_placed(part, channel, taxels) for part in (masses.moving, masses.window)]
        return combine(*parts)

    @property
    def plastic_kg(self) -> float:
        """Mass of the printed pad alone."""
        washer = self.plan.spec.washer_or_magnet
        area_mm2 = pi / 4 * (washer.outer_diameter_mm**2 - washer.inner_diameter_mm**2)
        washer_kg = area_mm2 * washer.thickness_mm * MM**3 * washer.density_g_per_cm3 * G_PER_CM3
        ballast = self.plan.spec.ballast
        ballast_kg = ballast.mass_g * GRAM if ballast else 0.0
        each_kg = washer_kg + ballast_kg + self.plan.spec.taxel.glue_mg * MG
        return float(self.pad.mass) - each_kg * len(self.plan.taxels)

    @cached_property
    def tray(self) -> Tray | None:
        """The tray for the coils; None where there can be none."""
        try:
            return plan_tray(self.plan)
        except InfeasibleError:
            return None

    @property
    def height_mm(self) -> float:
        """Height in mm from the pad's underside down to the bottom of the tray or, without a tray, of the coils."""
        if self.tray:
            return self.tray.height_mm
        coil = self.plan.spec.coil
        return coil.gap_mm + coil.length_mm - self.plan.spec.mover_low_mm

    @cached_property
    def tray_body(self) -> RigidBody | None:
        """Mass, centre of mass and inertia of the printed tray."""
        return combine(*_tray_parts(self.plan, self.tray)) if self.tray else None

    @cached_property
    def coils(self) -> RigidBody:
        """All coils: copper and cores."""
        plan = self.plan
        coil = plan.spec.coil
        top = (plan.spec.mover_low_mm - coil.gap_mm) * MM
        low = top - coil.length_mm * MM
        wire_m = coil.turns * coil.mean_turn_mm * MM
        copper_kg = COPPER_KG_PER_M3 * COPPER_OHM_M * wire_m**2 / coil.resistance_ohm
        winding_m3 = (coil.face_mm2 - coil.bore_mm2) * coil.length_mm * MM**3
        # A wire of another metal than copper would not fit: no winding is heavier than full of copper.
        density = min(copper_kg / winding_m3, COPPER_KG_PER_M3)
        parts = []
        for row in range(plan.coils.rows):
            for column in range(plan.coils.columns):
                x, y = coil_axis_mm(plan.coils, row, column)
                centre = (x * MM, y * MM)
                parts.append(ring(centre, low, top, coil.outer_diameter_mm * MM, coil.inner_diameter_mm * MM, density))
                if coil.core_diameter_mm:
                    parts.append(ring(centre, low, top, coil.core_diameter_mm * MM, 0, IRON_KG_PER_M3))
        return combine(*parts)

    @cached_property
    def board(self) -> RigidBody | None:
        """The laminate of the board that carries the coils, with the strip for its pins; None for wound coils.

        A board that has no room for its tracks or pins, of which the plan has an error, counts with the pad's outline.
        """
        plan = self.plan
        spec = plan.spec
        if spec.coil.kind != "board":
            return None
        half_x = spec.pad.width_mm / 2 + spec.pad.border_mm
        half_y = spec.pad.depth_mm / 2 + spec.pad.border_mm
        outline_mm = (-half_x, -half_y, half_x, half_y)
        with suppress(InfeasibleError):
            outline_mm = board_of(plan).outline_mm
        left, near, right, far = (side * MM for side in outline_mm)
        top = (spec.mover_low_mm - spec.coil.gap_mm) * MM
        low = top - spec.coil.length_mm * MM
        return combine(box((left, near, low), (right, far, top), LAMINATE_KG_PER_M3))

    @cached_property
    def screws(self) -> RigidBody | None:
        """The screws between pad and tray; None without any."""
        if not self.tray or not self.tray.screw:
            return None
        screw = self.tray.screw
        diameter = float(screw.name.removeprefix("M")) * MM
        top = self.plan.spec.pad.frame_thickness_mm * MM
        parts = []
        for x, y in self.tray.holes_mm:
            centre = (x * MM, y * MM)
            parts.append(ring(centre, top - screw.length_mm * MM, top, diameter, 0, IRON_KG_PER_M3))
            parts.append(ring(centre, top, top + HEAD_SHARE * diameter, screw.head_mm * MM, 0, IRON_KG_PER_M3))
        return combine(*parts)

    @cached_property
    def whole(self) -> RigidBody:
        """Pad, washers, tray or board, coils and screws as one."""
        parts = [self.pad, self.coils, self.tray_body, self.board, self.screws]
        return combine(*(part for part in parts if part is not None))

    def momenta(self, centre: np.ndarray) -> np.ndarray:
        """Return each taxel's linear and angular momentum (n, 6) about `centre` (3,) in m, in its mode at unit speed.

        Its washer moves up by 1 m/s.
        """
        force, moment = self._taxel_momenta
        arm = np.array([(taxel.x_mm * MM, taxel.y_mm * MM, 0.0) for taxel in self.plan.taxels]) - centre
        return np.concatenate([force, moment + np.cross(arm, force)], axis=1)

    @cached_property
    def _taxel_momenta(self) -> np.ndarray:
        """Linear and angular momenta (2, n, 3) of taxels, each about its washer, in the working mode at unit speed."""
        plan = self.plan
        turns = np.array([_turn(plan.channels[taxel.channel], taxel) for taxel in plan.taxels])
        momentum = np.array([self.channels[taxel.channel].momentum for taxel in plan.taxels])
        return np.stack([(turns @ part[:, :, None])[:, :, 0] for part in np.split(momentum, 2, axis=1)])

    @cached_property
    def _plate(self) -> RigidBody:
        """The frame and border as a solid plate, windows not cut out."""
        pad = self.plan.spec.pad
        density = self.plan.spec.material.density_g_per_cm3 * G_PER_CM3
        height = pad.frame_thickness_mm * MM
        return combine(*_outline_parts(self.plan, 0.0, height, density), *_holes(self.plan, height, density))


def pad_mass(plan: Plan) -> PadMass:
    """Return the masses of the parts of `plan`'s pad."""
    return PadMass(plan)


def _placed(body: RigidBody, channel: Channel, taxels: Sequence[Taxel]) -> RigidBody:
    """Return one rigid body made of copies of `body`, a part of a taxel, at the places of `taxels` on the pad."""
    turns = np.array([_turn(channel, taxel) for taxel in taxels])
    at = np.array([(taxel.x_mm * MM, taxel.y_mm * MM, 0.0) for taxel in taxels])
    mass = np.full(len(taxels), body.mass)
    return combine_stacked(RigidBody(mass, turns @ body.centroid + at, turns @ body.inertia @ np.swapaxes(turns, 1, 2)))


def _turn(channel: Channel, taxel: Taxel) -> np.ndarray:
    cosine, sine = TURNS[channel.site.along]
    sign = -1 if taxel.turned else 1
    return np.array([[sign * cosine, -sign * sine, 0.0], [sign * sine, sign * cosine, 0.0], [0.0, 0.0, 1.0]])


def _channel_mass(plan: Plan, channel: Channel) -> ChannelMass:
    """Return the mass properties of a channel's taxel: moving body, window cut from the frame, momentum of the mode."""
    model = _model(plan, channel)
    arrangement = model.arrangement
    density = plan.spec.material.density_g_per_cm3 * G_PER_CM3
    washer = model.washer_point_m
    body = RigidBody(*(np.asarray(part, float) for part in model.body))
    length, width = (float(v) * MM for v in arrangement.window_mm)
    window = box((0.0, -width / 2, 0.0), (length, width / 2, plan.spec.pad.frame_thickness_mm * MM), -density)
    parts = [body, _chamfer(plan, density, washer)]
    for path in arrangement.beams:
        section = float(path.width_mm) * float(path.thickness_mm) * MM**2
        fillets = 2 * (1 - pi / 4) * (channel.beam.fillet_mm * MM) ** 2 * float(path.thickness_mm) * MM
        for index, segment in enumerate(path.segments):
            at = _beam_point(path, path.within(index, (np.arange(PIECES) + 0.5) / PIECES))
            mass = np.full(PIECES, density * section * float(segment.length_mm) * MM / PIECES)
            parts.append(combine_stacked(RigidBody(mass, at, np.zeros((PIECES, 3, 3)))))
        parts.append(RigidBody(np.array(density * fillets), _beam_point(path, path.corners[0]), np.zeros((3, 3))))
    if channel.pin.on_beam:
        parts.append(_pin(channel, arrangement.beams[0], density))
    moving = combine(*parts)
    motion = np.array(channel.mode_motions[int(np.argmax(channel.mode_shares))])
    return ChannelMass(
        moving._replace(centroid=moving.centroid - washer),
        window._replace(centroid=window.centroid - washer),
        mode_momentum(plan, channel, motion / motion[2]),
    )


def _pin(channel: Channel, beam: BeamPath, density: float) -> RigidBody:
    """Return the mass of a pin above its beam, with the fillet round its foot, as a point mass at half its height."""
    pin = channel.pin
    foot_mm = float(beam.thickness_mm)
    radius_mm = pin.diameter_mm / 2
    round_mm3 = pi * radius_mm**2 * (pin.top_mm - foot_mm)
    # The fillet's section between foot and quarter circle has its centroid 0.2234 radii from either side.
    fillet_mm3 = 2 * pi * (1 - pi / 4) * pin.fillet_mm**2 * (radius_mm + 0.2234 * pin.fillet_mm)
    at = np.array([pin.x_mm, pin.y_mm, (foot_mm + pin.top_mm) / 2]) * MM
    return RigidBody(np.array(density * (round_mm3 + fillet_mm3) * MM**3), at, np.zeros((3, 3)))


def mode_momentum(plan: Plan, channel: Channel, motion: np.ndarray) -> np.ndarray:
    """Return a taxel's linear and angular momentum (6,) about its washer, where it moves with velocities `motion` (6,).

    Of the beams' momentum, `BEAM_SHARE` of their mass moves with their tips.
    """
    model = _model(plan, channel)
    density = plan.spec.material.density_g_per_cm3 * G_PER_CM3
    washer = model.washer_point_m
    shift, turn = np.split(motion, 2)
    body = RigidBody(*(np.asarray(part, float) for part in model.body))
    centre = body.centroid - washer
    force = body.mass * (shift + np.cross(turn, centre))
    moment = body.inertia @ turn + np.cross(centre, force)
    for path in model.arrangement.beams:
        volume = float(path.width_mm) * float(path.thickness_mm) * float(path.length_mm) * MM**3
        root, tip = (_beam_point(path, point) - washer for point in (path.corners[0], path.corners[-1]))
        part = BEAM_SHARE * density * volume * (shift + np.cross(turn, tip))
        force = force + part
        moment = moment + np.cross(BEAM_MIDDLE * tip + (1 - BEAM_MIDDLE) * root, part)
    return np.concatenate([force, moment])


def _model(plan: Plan, channel: Channel) -> TaxelModel:
    """Return the beam model of a channel's taxel."""
    plate = PlateShape(plan.plate.length_mm, plan.plate.width_mm, plan.plate.thickness_mm)
    beam = channel.beam
    return TaxelModel(plan.spec, beam.topology, plate, BeamShape(beam.width_mm, beam.thickness_mm, beam.length_mm))


def _beam_point(path: BeamPath, point: PathPoint) -> np.ndarray:
    """Return the place (…, 3) in m, at half the beam's thickness, of one or more points of the beam's path."""
    sides = np.broadcast_arrays(point.x_mm, point.y_mm, float(path.thickness_mm) / 2)
    return np.stack(sides, axis=-1).astype(float) * MM


PIECES = 8
BEAM_SHARE = 0.5
BEAM_MIDDLE = 0.7
"""Share of a beam's mass that moves with its tip, and the place of that share's middle on the way from root to tip.

They are those of a beam whose tip does not turn, ``y = 3 s² − 2 s³``. Beams have a few per cent of the body's mass.
"""


def _chamfer(plan: Plan, density: float, washer: np.ndarray) -> RigidBody:
    """Return the plastic that a chamfer takes off the boss, as a negative point mass at the middle of its top."""
    edge = plan.plate.boss_edge_mm * MM
    volume = pi * (plan.plate.boss_diameter_mm * MM - edge * 2 / 3) * edge**2 / 2
    at = washer + np.array([0.0, 0.0, plan.plate.boss_top_mm * MM])
    return RigidBody(np.array(-density * volume), at, np.zeros((3, 3)))


def _outline_parts(plan: Plan, low: float, high: float, density: float) -> Iterator[RigidBody]:
    """Yield bodies that form a plate of the pad's outline from height `low` to `high` in m; cut-outs are negative."""
    pad = plan.spec.pad
    half_x = (pad.width_mm / 2 + pad.border_mm) * MM
    half_y = (pad.depth_mm / 2 + pad.border_mm) * MM
    yield box((-half_x, -half_y, low), (half_x, half_y, high), density)
    corner = (1 - pi / 4) * (pad.border_mm / 2 * MM) ** 2 * (high - low)
    middle = (low + high) / 2
    for sign_x, sign_y in CORNERS:
        at = np.array([sign_x * half_x, sign_y * half_y, middle])
        yield RigidBody(np.array(-density * corner), at, np.zeros((3, 3)))
    groove = corner_groove(plan.spec)
    within = max(groove.y0 * MM, -half_y)
    yield box((groove.x0 * MM, within, low), (groove.x1 * MM, groove.y1 * MM, high), -density)


def _holes(plan: Plan, height: float, density: float) -> Iterator[RigidBody]:
    """Yield the screw holes of the border as cylinders of negative density."""
    pad = plan.spec.pad
    x = (pad.width_mm + pad.border_mm) / 2 * MM
    y = (pad.depth_mm + pad.border_mm) / 2 * MM
    for sign_x, sign_y in CORNERS:
        if pad.hole_diameter_mm:
            yield ring((sign_x * x, sign_y * y), 0.0, height, pad.hole_diameter_mm * MM, 0, -density)


def _tray_parts(plan: Plan, tray: Tray) -> Iterable[RigidBody]:
    """Yield the tray's boxes and cylinders, what is cut out with a negative density."""
    pad = plan.spec.pad
    density = plan.spec.material.density_g_per_cm3 * G_PER_CM3
    floor, socket, top = (height * MM for height in (tray.floor_mm, tray.socket_top_mm, tray.height_mm))
    down = -top

    def at(height: float) -> float:
        """Convert a `height` in m above the tray's bottom to one above the pad's underside (negative: below it)."""
        return height + down

    half_x = pad.width_mm / 2 * MM
    half_y = pad.depth_mm / 2 * MM
    yield from _outline_parts(plan, down, 0.0, density)
    yield box((-half_x, -half_y, at(socket)), (half_x, half_y, 0.0), -density)
    for x, y in tray.coils_mm:
        centre = (x * MM, y * MM)
        yield ring(centre, down, at(floor), tray.seat_hole_mm * MM, 0, -density)
        yield ring(centre, at(floor), at(socket), tray.socket_diameter_mm * MM, 0, -density)
        slot = density * tray.lead.width_mm * tray.lead.reach_mm * MM**2 * (socket - floor)
        reach = (tray.socket_diameter_mm + tray.lead.reach_mm) / 2 * MM / 2**0.5
        place = np.array([centre[0] + reach, centre[1] + reach, at((floor + socket) / 2)])
        yield RigidBody(np.array(-slot), place, np.zeros((3, 3)))
    border = pad.border_mm * MM
    for wires in tray.wire_slots:
        x0, x1 = _within_rim(wires.x0 * MM, wires.x1 * MM, half_x, border)
        y0, y1 = _within_rim(wires.y0 * MM, wires.y1 * MM, half_y, border)
        yield box((x0, y0, at(socket)), (x1, y1, 0.0), -density)
    if tray.screw:
        for x, y in tray.holes_mm:
            depth = tray.screw.hole_depth_mm * MM
            yield ring((x * MM, y * MM), -depth, 0.0, tray.screw.hole_diameter_mm * MM, 0, -density)


def _within_rim(low: float, high: float, half: float, border: float) -> tuple[float, float]:
    """Return a slot's span `low` … `high` in m; if it passes ±`half`, only the part of it in the tray's rim beyond."""
    if low < -half:
        return max(low, -half - border), -half
    if high > half:
        return half, min(high, half + border)
    return low, high
