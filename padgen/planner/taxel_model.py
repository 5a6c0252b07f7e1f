"""Model one taxel by beam theory: from dimensions in mm to resonance, mass, modes and stress.

This module turns dimensions in mm into the SI arrays of `padgen.physics`. Everything takes arrays of beam shapes, so
that a grid of candidates costs one call. `SolvedModel` has modes that finite elements solved for the printed solid in
place of the beam model's.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, wraps
from typing import Any

import numpy as np

from padgen.core.units import G_PER_CM3, GPA, MM
from padgen.physics.beams import BeamSection, Surroundings, YokeSize, fitted, on_elastic_ends
from padgen.physics.modes import (
    BENT,
    FLOOR,
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
    uncertain_energies,
)
from padgen.physics.resonator import TaxelModes, natural_frequency, rule_stiffness
from padgen.planner.suspensions import Arrangement, BeamShape, Block, PlateShape, suspension
from padgen.spec import Spec

__all__ = [
    "STRAIGHT",
    "Exponents",
    "SolvedModel",
    "TaxelModel",
    "asked_error",
    "fillet_mm",
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
    """Return the plate: as the spec says, else the boss or the washer's recess with a wall around, if larger."""
    walled = recess_mm(spec)[0] + 2 * spec.printer.line_width_mm
    taxel = spec.taxel
    return PlateShape(
        taxel.plate_length_mm or max(walled, taxel.boss_diameter_mm),
        taxel.plate_width_mm or max(walled, taxel.boss_diameter_mm),
        taxel.plate_thickness_mm,
    )


def shortest_mm(spec: Spec, topology: str) -> float:
    """Return the length in mm of the shortest beam that fits the plate and that the printer lays as drawn."""
    least = suspension(topology).shortest(plate_shape(spec), spec.printer.smallest_gap_mm)
    return max(least, spec.printer.shortest_beam_mm)


def recess_mm(spec: Spec) -> tuple[float, float]:
    """Return diameter and depth in mm of the recess in the plate's underside."""
    return spec.washer.outer_diameter_mm + spec.taxel.washer_clearance_mm, spec.recess_depth_mm


def post_diameter_mm(spec: Spec) -> float:
    """Return the diameter in mm of the recess's centre post, 0 where it has none."""
    bore = spec.washer.inner_diameter_mm - spec.taxel.washer_clearance_mm
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


def _from_array(method: "Callable[[TaxelModel], np.ndarray]") -> "Callable[[TaxelModel], np.ndarray]":
    """Make a method take its value from the array's model where the taxel belongs to one (`member_of`)."""

    @wraps(method)
    def value(model: "TaxelModel") -> np.ndarray:
        if not model.member_of:
            return method(model)
        array, index = model.member_of
        return getattr(array, method.__name__)[index]

    return value


@dataclass(frozen=True, eq=False)
class TaxelModel:
    """One taxel, or an array of taxels of one topology, by the beam model.

    `frame_depth_mm` is the depth of the frame behind a root up to where it is held, half a rib by default. `member_of`
    is the model of an array of taxels and this taxel's index in it: slow steps are computed for the whole array at
    once.
    """

    spec: Spec
    topology: str
    plate: PlateShape
    beam: BeamShape
    frame_depth_mm: Any = field(default=None, kw_only=True)
    member_of: "tuple[TaxelModel, int] | None" = field(default=None, kw_only=True, compare=False, repr=False)

    @cached_property
    def arrangement(self) -> Arrangement:
        """Beams, blocks and window of the taxel, in mm."""
        return suspension(self.topology).arrange(
            self.plate, BeamShape(*(np.asarray(v, float) for v in self.beam)), self.spec.printer.smallest_gap_mm
        )

    @property
    def plastic_share(self) -> Any:
        """Plastic in the printed plate and boss over that drawn: 1 here, where nothing is known of a print."""
        return 1.0

    @cached_property
    def body(self) -> RigidBody:
        """The rigid moving body without the beams: plate, boss, washer and glue, less the recess."""
        return self.body_of(self.arrangement.blocks)

    def body_of(self, blocks: Sequence[Block]) -> RigidBody:
        """Return one rigid body made of `blocks`, boss, washer and glue, less the recess."""
        spec = self.spec
        taxel = self.spec.taxel
        density = spec.material.density_g_per_cm3 * G_PER_CM3 * self.plastic_share
        top = taxel.plate_thickness_mm * MM
        boss_top = (spec.pad.frame_thickness_mm + taxel.boss_protrusion_mm) * MM
        diameter, depth = (v * MM for v in recess_mm(spec))
        low = depth - spec.washer.thickness_mm * MM
        high = depth
        outer = spec.washer.outer_diameter_mm * MM
        bore = spec.washer.inner_diameter_mm * MM
        washer_at = (self.arrangement.washer_x_mm * MM, 0.0)
        parts = [
            *(
                box((x0 * MM, y0 * MM, 0), (x1 * MM, y1 * MM, height * MM), density)
                for x0, x1, y0, y1, height in blocks
            ),
            ring(washer_at, top, boss_top, taxel.boss_diameter_mm * MM, 0, density),
            ring(washer_at, 0, depth, diameter, post_diameter_mm(spec) * MM, -density),
            ring(washer_at, low, high, outer, bore, spec.washer.density_g_per_cm3 * G_PER_CM3),
        ]
        if taxel.glue_mg:
            glue_density = taxel.glue_mg * 1e-6 / (np.pi / 4 * (outer**2 - bore**2) * (high - low))
            parts.append(ring(washer_at, low, high, outer, bore, glue_density))
        return combine(*parts)

    @cached_property
    def placements(self) -> list[BeamPlacement]:
        """The beams in SI units: sections, and places and directions of their tips at the body."""
        fillet = fillet_mm(self.spec, self.arrangement) * MM
        placements: list[BeamPlacement] = []
        for path in self.arrangement.beams:
            width = (path.width_mm + self.spec.printer.width_offset_mm) * MM
            thickness = (path.thickness_mm + self.spec.printer.z_offset_mm) * MM
            pieces = () if path.is_straight else tuple((s.length_mm * MM, s.turn_rad) for s in path.segments)
            across = self.spec.material.cross_layer_ratio
            bare = BeamSection(width, thickness, path.length_mm * MM, fillet, path=pieces, across=across)
            section = on_elastic_ends(bare, self._surroundings, self.spec.material.poisson_ratio)
            tip = path.corners[-1]
            x, y, z, *along = np.broadcast_arrays(tip.x_mm * MM, tip.y_mm * MM, thickness / 2, *tip[2:])
            placements.append(BeamPlacement(section, np.stack([x, y, z], -1), np.stack(along, -1)))
        return placements

    @cached_property
    def _surroundings(self) -> Surroundings:
        """Sizes in m of the parts that hold the beams' ends."""
        diameter, depth = recess_mm(self.spec)
        frame = self.spec.pad.rib_mm / 2 if self.frame_depth_mm is None else self.frame_depth_mm
        wall = max((self.plate.length_mm - diameter) / 2, THINNEST_WALL_MM)
        yoke = self.arrangement.yoke
        size = YokeSize(*(v * MM for v in yoke)) if yoke else None
        return Surroundings(frame * MM, wall * MM, depth * MM, diameter / 2 * MM, size)

    def beside_yoke(self, section: BeamSection) -> BeamSection:
        """Return a beam section with the compliance of its ends, except that of the yoke at its tip."""
        around = self._surroundings._replace(yoke=YokeSize(0.0, 1.0, 1.0, 0.0, 1.0))
        return on_elastic_ends(section, around, self.spec.material.poisson_ratio)

    @property
    def elastic(self) -> tuple[float, float, float]:
        """Young's modulus in Pa, Poisson's ratio and density in kg/m³."""
        material = self.spec.material
        return (
            material.youngs_modulus_gpa * GPA,
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
        """Place (…, 3) in m of the washer's axis at z = 0, where the pull acts and the finger touches."""
        x = np.asarray(self.arrangement.washer_x_mm * MM)
        return np.stack([x, 0 * x, 0 * x], -1)

    @cached_property
    @_from_array
    def compliances(self) -> np.ndarray:
        """Static compliance (…, 6) in m/N that each mode adds to a vertical force at the washer."""
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
        """Mass (…,) of the working mode at the washer."""
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
        """Frequency in Hz and share of the static compliance of the mode nearest to the working one; for one taxel.

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
        """Exponents a, b, c of one taxel's ``f ∝ w^a t^b l^c``: `STRAIGHT`, or numerical where beams have bends."""
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
        """True (…,) where the beams are within the range that the model was fitted to; elsewhere solve the solid."""
        return np.asarray(self.is_straight & fitted(*(np.asarray(side, float) for side in self.beam)))

    @cached_property
    @_from_array
    def mode_errors(self) -> np.ndarray:
        """Relative error (…, 6) within which each mode's frequency most likely lies (`padgen.physics.modes`)."""
        modulus, poisson, _ = self.elastic
        length, width, thickness = (side * MM for side in self.plate)
        roof = max(thickness - recess_mm(self.spec)[1] * MM, thickness / 10)
        plate = RigidPlate(length, width, roof)
        energies = sum(uncertain_energies(beam, self.modes, modulus, poisson, plate) for beam in self.placements)
        floor = FLOOR if self.is_straight else BENT
        return relative_error(np.asarray(energies), self.modes.frequency_hz, self.working, floor)

    @cached_property
    @_from_array
    def sag_error(self) -> np.ndarray:
        """Relative error (…,) within which the sag most likely lies: of modes and of the beams' weight."""
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
        """Relative error within which one taxel's stress per displacement most likely lies; without notches."""
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
        """Coefficient α of the working mode's force ``k z (1 + α z²)`` at the washer, by beams that stretch."""
        modes = self.modes
        scaled = modes.shape / (2 * np.pi * modes.frequency_hz[..., None, :])
        compliance = scaled @ np.swapaxes(scaled, -1, -2)
        return hardening(self.placements, self._working_motion, modes.reference, compliance, self.elastic[:2])

    def root_stress_pa(self, level_m: np.ndarray) -> np.ndarray:
        """Return the largest bending stress in Pa of the beams in the working mode, for `level_m` at the washer."""
        return np.asarray(self.stress_pa_per_m * level_m)


STATIC = 2.5
"""Error of a static answer over that of its resonance: 2 from the stiffness, more since the shape is off, too.

This and the next two were chosen on the first 41 taxels of `docs/measure_campaign.py`'s cells (docs/accuracy.md).
"""
SHAPE_ERROR = 0.03
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
        """Relative error within which the sag most likely lies: the beam model's, less what the stiffness corrects."""
        return self.beam_model.sag_error + STATIC * (self.solver_error - float(self.beam_model.error_estimate))

    @property
    def stress_error(self) -> float:
        """Relative error within which the stress most likely lies: the beam model's shape, the solved stiffness."""
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
        """Hardening in 1/m² by beams that stretch, from the beam model."""
        return self.beam_model.hardening_per_m2

    def root_stress_pa(self, level_m: np.ndarray) -> np.ndarray:
        """Return the largest bending stress in Pa of the beams when the washer moves by `level_m`."""
        return np.asarray(self.beam_model.root_stress_pa(level_m) * self._stiffness_ratio)

    @property
    def _stiffness_ratio(self) -> np.ndarray:
        return np.asarray(self.stiffness_n_per_m / self.beam_model.stiffness_n_per_m)


def solved_model(model: TaxelModel, solved: TaxelModes, solver_error: float) -> SolvedModel:
    """Return `model` with its modes replaced by the solved ones."""
    return SolvedModel(model.spec, model.topology, model.plate, model.beam, solved, solver_error)


def asked_error(spec: Spec) -> float:
    """Return the relative error within which a solid's resonance must be known to count as tuned."""
    return min(FINEST, spec.model.tolerance)
