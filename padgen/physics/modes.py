"""The six modes of a rigid body on massive beams: the model that sizes the taxels; and hardening of beams that stretch.

It is one rung above the point mass: Timoshenko beams with consistent mass carry a rigid body with centroid offset and
rotary inertia. It gives all six rigid-body modes for any arrangement of beams. Bodies are composed of boxes and rings.

Beams that must stretch to bend, such as those of a bridge, are a cubic spring (Duffing). A bending beam gets shorter
along its axis. It is stretched as far as the taxel's other motions cannot compensate, and the working mode's force
becomes ``k z (1 + α z²)``. For beams guided between two rigid ends ``α = 0.72/t²`` (fixed cubic shape, Timoshenko,
Vibration Problems in Engineering, on bars with immovable ends).

The error of a frequency is estimated from the energy of its mode in each uncertain part (`relative_error`). A part
with the relative uncertainty u that holds the share s of a mode's energy moves the frequency to ``f/√(1 − u s)``: by u
s/2 to first order (Rayleigh), and by more where one part holds nearly all the energy. Uncertain are the fitted
compliances (`padgen.physics.beams`) and the effects that the model leaves out. The uncertainties were fitted to the
errors of random taxels against 3-D elasticity (`docs/measure_campaign.py`): the error of a working mode is within the
estimate in about 94 of 100 cases (docs/accuracy.md).
"""

from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from padgen.core.units import GRAVITY_M_PER_S2
from padgen.physics.beams import (
    BeamSection,
    EndCompliance,
    anticlastic_reduction,
    doubtful_energies,
    flexibility,
    largest_stress,
    pin_motion,
    root_load,
    tip_matrices,
    tip_stiffness,
)

__all__ = [
    "BENT",
    "FLOOR",
    "UNCERTAINTY",
    "BeamPlacement",
    "Modes",
    "RigidBody",
    "RigidPlate",
    "bending_stress",
    "box",
    "combine",
    "combine_stacked",
    "hardening",
    "jump_amplitude",
    "level_kept",
    "relative_error",
    "resonance_rise",
    "ring",
    "suspended_modes",
    "to_tip",
    "uncertain_energies",
]

Array = Any


class RigidBody(NamedTuple):
    """A rigid body: `mass` (…) in kg, `centroid` (…, 3) in m, `inertia` (…, 3, 3) about it in kg·m²."""

    mass: np.ndarray
    centroid: np.ndarray
    inertia: np.ndarray


def box(low: tuple[Array, Array, Array], high: tuple[Array, Array, Array], density: float) -> RigidBody:
    """Return a box between two corners in m, `density` in kg/m³; a negative density cuts it out."""
    x, y, z = (np.subtract(h, b) for b, h in zip(low, high, strict=True))
    mass = density * (x * y * z)
    share = mass / 12
    moments = share * (y**2 + z**2), share * (x**2 + z**2), share * (x**2 + y**2)
    return _upright(mass, tuple(np.add(h, b) / 2 for b, h in zip(low, high, strict=True)), moments)


def ring(
    centre: tuple[Array, Array], z_low: Array, z_high: Array, outer: Array, inner: Array, density: float
) -> RigidBody:
    """Return a ring round a vertical axis (a disc for `inner` = 0) by its diameters in m; `density` in kg/m³."""
    height = np.subtract(z_high, z_low)
    mass = density * np.pi / 4 * (np.square(outer) - np.square(inner)) * height
    square = np.square(outer) + np.square(inner)
    radial = mass * (square / 16 + height**2 / 12)
    return _upright(mass, (*centre, np.add(z_low, z_high) / 2), (radial, radial, mass * square / 8))


def _upright(mass: Array, centre: tuple[Array, ...], moments: tuple[Array, ...]) -> RigidBody:
    """Return a body with main axes of inertia along x, y and z, with all parts broadcast to one shape."""
    shape = np.broadcast_shapes(*(np.shape(part) for part in (mass, *centre, *moments)))
    whole = np.empty(shape)
    at = np.empty((*shape, 3))
    inertia = np.zeros((*shape, 3, 3))
    whole[...] = mass
    for i in range(3):
        at[..., i] = centre[i]
        inertia[..., i, i] = moments[i]
    return RigidBody(whole, at, inertia)


def combine(*bodies: RigidBody) -> RigidBody:
    """Return one rigid body with the mass, centroid and inertia of all given bodies together."""
    return combine_stacked(RigidBody(*(np.stack(np.broadcast_arrays(*parts)) for parts in zip(*bodies, strict=True))))


def combine_stacked(bodies: RigidBody) -> RigidBody:
    """Return the bodies along the first axis of the arrays as one rigid body, by Steiner's theorem."""
    mass = bodies.mass.sum(0)
    centroid = (bodies.mass[..., None] * bodies.centroid).sum(0) / mass[..., None]
    arm = bodies.centroid - centroid
    square = (arm * arm).sum(-1)[..., None, None] * np.eye(3)
    apart = bodies.mass[..., None, None] * (square - arm[..., :, None] * arm[..., None, :])
    return RigidBody(mass, centroid, (bodies.inertia + apart).sum(0))


class BeamPlacement(NamedTuple):
    """A beam and its place on the body: `tip` (…, 3) in m, `direction` (…, 2) of the beam there, away from its root.

    `pin` is the rigid pin that stands on it, in axes at the middle of the beam's thickness below it; None without one.
    """

    section: BeamSection
    tip: np.ndarray
    direction: np.ndarray
    pin: RigidBody | None = None


class Modes(NamedTuple):
    """Modes of a suspended body, lowest first.

    `frequency_hz` (…, 6); `shape` (…, 6, 6), one column per mode, mass-normalised, referred to
    `reference` (…, 3), the centroid of the rigid body.
    """

    frequency_hz: np.ndarray
    shape: np.ndarray
    reference: np.ndarray

    def at_point(self, point: np.ndarray) -> np.ndarray:
        """Return, per mode, the mass-normalised displacement (…, 3, 6) in kg^-½ of the body's `point` (…, 3) in m."""
        # Without np.cross, which takes ten times as long on small arrays.
        arm = (point - self.reference)[..., None]
        x, y, z = arm[..., 0, :], arm[..., 1, :], arm[..., 2, :]
        a, b, c = (self.shape[..., row, :] for row in (3, 4, 5))
        motion: np.ndarray = self.shape[..., :3, :] + np.zeros_like(arm)
        motion[..., 0, :] += b * z - c * y
        motion[..., 1, :] += c * x - a * z
        motion[..., 2, :] += a * y - b * x
        return motion

    def sag(self, point: np.ndarray) -> np.ndarray:
        """Return the static sag (…) in m of a `point` of the body under gravity: the sum over all modes."""
        return np.asarray(self.sag_parts(point).sum(-1))

    def sag_parts(self, point: np.ndarray) -> np.ndarray:
        """Return what each mode adds (…, 6) in m to the static sag of a `point` of the body under gravity.

        Mode k has the share in the load M g e_z that is the k-th entry of ``shape⁻¹ e_z``.
        """
        lift = np.broadcast_to(np.eye(6)[2], self.frequency_hz.shape)[..., None]
        part = np.linalg.solve(self.shape, lift)[..., 0]
        angular = 2 * np.pi * self.frequency_hz
        return np.asarray(self.at_point(point)[..., 2, :] * part / angular**2 * GRAVITY_M_PER_S2)


def suspended_modes(
    body: RigidBody, beams: "list[BeamPlacement]", modulus: float, poisson: float, density: float
) -> Modes:
    """Return the modes of `body` on `beams` of one material, in SI units, for arrays of taxels at once.

    Raises
    ------
    numpy.linalg.LinAlgError
        The stiffness is not positive definite: a beam of no length or thickness.
    """
    stiffness: Any = 0.0
    mass: Any = _inertia(body)
    # Most beams share a section, and with it the matrices.
    sections = {id(beam.section): beam.section for beam in beams}
    at_pins = {key: pin_motion(section, modulus, poisson) for key, section in sections.items() if section.pin}
    known = {
        key: tip_matrices(section, modulus, poisson, density, at_pins.get(key)) for key, section in sections.items()
    }
    for beam in beams:
        key = id(beam.section)
        at_tip, tip_masses = known[key]
        carry = to_tip(beam, body.centroid)
        carried = np.swapaxes(carry, -1, -2)
        stiffness = stiffness + carried @ at_tip @ carry
        mass = mass + carried @ tip_masses @ carry
        if beam.pin:
            ridden = _origin_to_centroid(beam.pin) @ at_pins[key].shape @ carry
            mass = mass + np.swapaxes(ridden, -1, -2) @ _inertia(beam.pin) @ ridden
    # Of the flexibility form M φ = (1/ω²) K φ the largest values are the lowest modes, which are exact to rounding
    # however far above them the stiffest mode is.
    root = np.linalg.inv(np.linalg.cholesky(stiffness))
    rooted = np.swapaxes(root, -1, -2)
    symmetric = root @ mass @ rooted
    inverse, vectors = np.linalg.eigh((symmetric + np.swapaxes(symmetric, -1, -2)) / 2)
    angular = 1 / np.sqrt(np.maximum(inverse[..., ::-1], 1e-300))
    return Modes(angular / (2 * np.pi), rooted @ vectors[..., ::-1] * angular[..., None, :], body.centroid)


def _inertia(body: RigidBody) -> np.ndarray:
    """Return the mass matrix (…, 6, 6) of a body for motions at its centroid."""
    mass = np.zeros((*np.shape(body.mass), 6, 6))
    mass[..., [0, 1, 2], [0, 1, 2]] = body.mass[..., None]
    mass[..., 3:, 3:] = body.inertia
    return mass


def _origin_to_centroid(body: RigidBody) -> np.ndarray:
    """Return the matrix (…, 6, 6) from a rigid body's motion at its origin to that at its centroid right above."""
    height = body.centroid[..., 2]
    carry = np.zeros((*np.shape(height), 6, 6))
    carry[..., range(6), range(6)] = 1.0
    carry[..., 0, 4] = height
    carry[..., 1, 3] = -height
    return carry


def bending_stress(
    beam: BeamPlacement, displacement: np.ndarray, reference: np.ndarray, modulus: float, poisson: float
) -> np.ndarray:
    """Return the largest stress in Pa along `beam` for a `displacement` (…, 6) of the body at `reference`."""
    tip = to_tip(beam, reference) @ displacement[..., None]
    load = (tip_stiffness(beam.section, modulus, poisson) @ tip)[..., 0]
    return np.asarray(largest_stress(beam.section, load))


def to_tip(beam: BeamPlacement, reference: np.ndarray) -> np.ndarray:
    """Return the matrix (…, 6, 6) from the body's motion at `reference` to the tip's motion in beam axes."""
    arm = beam.tip - reference
    x, y, z = arm[..., 0], arm[..., 1], arm[..., 2]
    c = beam.direction[..., 0]
    s = beam.direction[..., 1]
    carry = np.zeros((*x.shape, 6, 6))
    for first in (0, 3):
        carry[..., first, first] = carry[..., first + 1, first + 1] = c
        carry[..., first, first + 1] = s
        carry[..., first + 1, first] = -s
        carry[..., first + 2, first + 2] = 1
    # The rotation into beam axes, times the cross product with the arm.
    carry[..., 0, 3], carry[..., 0, 4], carry[..., 0, 5] = -s * z, c * z, s * x - c * y
    carry[..., 1, 3], carry[..., 1, 4], carry[..., 1, 5] = -c * z, -s * z, c * x + s * y
    carry[..., 2, 3] = y
    carry[..., 2, 4] = -x
    return carry


RELIEVED = 1e-9
"""Share of the stretching below which it counts as rounding: other motions then relieve all of it."""
BISECTIONS = 60


def hardening(
    beams: list[BeamPlacement], motion: np.ndarray, reference: np.ndarray, compliance: np.ndarray, elastic: Any
) -> np.ndarray:
    """Return the hardening coefficient α (…) in 1/m² of taxels' working mode, with force ``k z (1 + α z²)``.

    `motion` (…, 6) is the body's at `reference` (…, 3) for 1 m of z. `compliance` (…, 6, 6) is that of the suspended
    body there under static loads. `elastic` is Young's modulus in Pa and Poisson's ratio. Bent beams count as straight.
    """
    load = np.zeros_like(motion)
    kept = np.zeros(motion.shape[:-1])
    for beam in beams:
        carry = to_tip(beam, reference)
        length = np.asarray(beam.section.length, float)
        tip = (carry @ motion[..., None])[..., 0]
        # Shortening of a cubic, ½ ∫ w'² dx, from displacement and slope of its tip, in both planes.
        shorter: Any = sum(
            (36 * w**2 - 6 * length * w * slope + 4 * length**2 * slope**2) / (60 * length)
            for w, slope in ((tip[..., 2], -tip[..., 4]), (tip[..., 1], tip[..., 5]))
        )
        along = tip_stiffness(beam.section, *elastic)[..., 0, 0]
        load += (along * shorter)[..., None] * carry[..., 0, :]
        kept += along * shorter**2
    softness = (motion * np.linalg.solve(compliance, motion[..., None])[..., 0]).sum(-1)
    left = kept - (load * (compliance @ load[..., None])[..., 0]).sum(-1)
    return np.where(left > RELIEVED * kept, 2 * left / softness, 0.0)


def resonance_rise(alpha: Any, amplitude: Any, offset: Any = 0.0) -> Any:
    """Return the relative rise of the resonance at an `amplitude` about a static `offset`, all lengths in one unit.

    ``ω²/ω₀² = 1 + α (3/4 a² + 3 z²)`` (harmonic balance). `offset` is the deflection without hardening; z is that with
    it, the real root of ``z + α z³ = offset``.
    """
    return np.sqrt(1 + 0.75 * alpha * np.square(amplitude) + _offset_stiffening(alpha, offset)) - 1


def _offset_stiffening(alpha: Any, offset: Any) -> Any:
    """Return 3 α z², the rise of ω²/ω₀² by a static `offset` alone (`resonance_rise`)."""
    steep = np.sqrt(3 * np.asarray(alpha, float))
    # z = 2/√(3α) sinh(asinh(3/2 √(3α) offset)/3); α z² from it without dividing by α.
    square = 4 / 3 * np.sinh(np.arcsinh(1.5 * steep * offset) / 3) ** 2
    return 3 * square


def jump_amplitude(alpha: float, q: float) -> float:
    """Return the amplitude, in the unit of 1/√α, from which a response jumps between two levels; inf for α ≤ 0.

    It is the peak of the first response with a vertical tangent, ``a² = 32/(9 √3 α Q)`` (Nayfeh and Mook, Nonlinear
    Oscillations, 4.1).
    """
    return sqrt(32 / (9 * sqrt(3) * alpha * q)) if alpha > 0 else float("inf")


def level_kept(alpha: Any, q: float, amplitude: Any, offset: Any = 0.0) -> Any:
    """Return the share of the wanted amplitude that a hardening taxel keeps with its tone at the linear resonance.

    It is 1 without hardening; otherwise the root y of ``y² ((2 Q rise(y))² + 1) = 1``, which is unique since the tone
    lies below the resonance.
    """
    high = np.ones(np.broadcast(alpha, amplitude, offset).shape)
    low = np.zeros_like(high)
    stiffening = _offset_stiffening(alpha, offset)
    for _ in range(BISECTIONS):
        share = (low + high) / 2
        rise = np.sqrt(1 + 0.75 * alpha * np.square(share * amplitude) + stiffening) - 1
        off = 2 * q * rise
        above = share**2 * (off**2 + 1) > 1
        low = np.where(above, low, share)
        high = np.where(above, share, high)
    return high


FLOOR = 0.0075
"""Relative error that remains for slender beams: mass of the flares, rounding of the edges, the references' own error.
"""
OTHERS = 2.5
OTHERS_FLOOR = 0.02
OTHERS_RISE = 0.008
"""For all modes but the working one: a factor on the error from the uncertainties, its floor, and the floor's rise per
unit of frequency ratio to the working mode.
"""
BENT = 0.012
"""Floor for beams that bend round corners, from serpentines (docs/accuracy.md). Modes where the beams themselves swing,
far above the working one, may be off by more (`padgen.physics.bounds.beam_inertia`).
"""
UNCERTAINTY = {
    "root": 0.11,
    "tip": 0.19,
    "mount": 0.32,
    "crossbar": 0.13,
    "yoke": 0.7,
    "curl": 0.066,
    "lateral root": 0.81,
    "lateral tip": 0.81,
    "shear": 0.85,
    "lateral shear": 1.1,
    "twist": 0.54,
    "plate": 0.155,
    "yoke pulled": 0.45,
    "yoke sideways": 0.7,
    "layers": 0.16,
    "bends": 0.6,
    "warping": 0.32,
}
"""Relative uncertainty of each flexibility, in the order of `uncertain_energies`; the last two are `doubtful_energies`.

'mount' is the wall between the plate's edge and the recess, 'crossbar' the twist and 'yoke' the bending of what takes
its place. Root and wall are less certain by thickness over width, since their laws are those of wide strips.
What a yoke gives when it is pulled and sideways counts in other modes than the working one; 'layers' is what ends and
shear of a print whose layers hold less well to each other add to that of an isotropic one.
"""
YOKE_SIDE = 4.0
"""Share of a beam's lateral flexibility that neck and joints of a yoke may add, over width per length; at most 1."""
PLATE = list(UNCERTAINTY).index("plate")
"""Place of the plate among them."""

HELD_BAR = 2.5
"""Weight of what held warping takes from the crossbar's twist, in the twist that is uncertain."""

MOST_SOFTER = 0.8
"""Largest share of all flexibility that is taken as missing."""


class RigidPlate(NamedTuple):
    """Dimensions in m of a taxel's plate, which is taken as rigid; `thickness` is that of the part above the recess.

    `neck` is the length of the neck that runs back to it from the beams' tips; None where the beams meet the plate.
    """

    length: Array
    width: Array
    thickness: Array
    neck: Array | None = None


def uncertain_energies(
    beam: BeamPlacement, modes: Modes, modulus: float, poisson: float, plate: RigidPlate
) -> np.ndarray:
    """Return twice the strain energy (…, 6, parts) in 1/s² of each mode in each uncertain flexibility of one beam.

    The modes are mass-normalised; the parts are those of `UNCERTAINTY`, in its order.
    """
    width, thickness, length, fillet = (_with_mode_axis(v) for v in beam.section[:4])
    ends = EndCompliance(*(_with_mode_axis(v) for v in beam.section.ends))
    path = tuple((_with_mode_axis(length), _with_mode_axis(turn)) for length, turn in beam.section.path)
    across, beads = (_with_mode_axis(v) for v in (beam.section.across, beam.section.beads))
    section = BeamSection(width, thickness, length, fillet, ends, path, across, beads)
    tip = to_tip(beam, modes.reference) @ modes.shape
    load = np.swapaxes(tip_stiffness(beam.section, modulus, poisson) @ tip, -1, -2)
    parts = flexibility(section, modulus, poisson)
    along, side, up, about_x, about_y, about_z = np.moveaxis(load, -1, 0)
    _, root_y, root_z = np.moveaxis(root_load(section, load)[..., 3:], -1, 0)
    at_tip = (about_y - ends.tip_height * along) ** 2
    mount = parts.tip * ends.mount / np.where(ends.tip, ends.tip, 1.0)
    mounted = mount * at_tip
    bending = modulus * width * thickness**3 / 12
    plate_bending = _with_mode_axis(modulus * plate.width * plate.thickness**3 / 12)
    # Moments at the plate's edge and at the washer's axis, between which they change evenly.
    backwards = plate.neck is not None
    edge = about_y - _with_mode_axis(plate.neck) * up if backwards else about_y
    half = _with_mode_axis(plate.length) / 2
    axis = edge - half * up if backwards else edge + half * up
    plate_bent = half / 3 * (edge**2 + edge * axis + axis**2) / plate_bending

    curled = _bent_energy(anticlastic_reduction(section), up, about_y) / bending
    yoked = _bent_energy((ends.yoke_turn, ends.yoke_both, ends.yoke_lift), up, about_y) / bending
    narrow = 1 + thickness / width
    side0, side1, side2 = parts.side
    bent_sideways = side2 * side**2 + 2 * side1 * side * about_z + side0 * about_z**2
    at_root = parts.root * (root_y - ends.root_height * along) ** 2
    weak = at_root + parts.tip * at_tip + (parts.shear + parts.end_shear) * up**2
    energies = [
        narrow * at_root,
        (parts.tip - mount) * at_tip,
        0.0 * up if backwards else narrow * mounted,
        mounted * (1 + HELD_BAR * ends.mount_held / ends.mount) if backwards else 0.0 * up,
        yoked,
        0.0 * up if path else curled,
        parts.lateral_root * root_z**2,
        parts.lateral_tip * about_z**2,
        parts.end_shear * up**2,
        parts.lateral_end_shear * side**2,
        parts.twist * np.minimum(np.maximum(width, thickness) / length, 1) * about_x**2,
        plate_bent,
        ends.stretch / (width * thickness * modulus) * along**2,
        np.where(ends.stretch > 0, np.minimum(YOKE_SIDE * width / length, 1), 0.0) * bent_sideways,
        np.maximum(1 - section.across, 0) * weak,
        *(doubtful_energies(section, load, modulus, poisson) if path else (0.0 * up, 0.0 * up)),
    ]
    return np.stack(np.broadcast_arrays(*energies), -1)


def _bent_energy(integrals: tuple[Array, Array, Array], up: Array, about_y: Array) -> Array:
    """Return 2 EI × a beam's bending energy, from ∫ (l−s)^p ds (p = 0, 1, 2), tip force `up`, tip moment `about_y`."""
    turn, both, lift = integrals
    return lift * up**2 - 2 * both * up * about_y + turn * about_y**2


def relative_error(
    energies: np.ndarray, frequency_hz: np.ndarray, working: np.ndarray, floor: Array = FLOOR
) -> np.ndarray:
    """Estimate the relative error (…, 6) of each frequency from all beams' `uncertain_energies` (…, 6, parts).

    It is at least `floor`. For modes other than the `working` one (…,) the model leaves out more: how yoke, wall and
    plate yield along and across the beam, and the beams' inertia. Their estimate is larger accordingly.
    """
    share = energies / (2 * np.pi * frequency_hz[..., None]) ** 2 / 2
    share[..., PLATE] /= 1 + share[..., PLATE]  # first order in the plate's share would overrate a very flexible plate
    moved = np.sqrt(((np.array(list(UNCERTAINTY.values())) * share) ** 2).sum(-1))
    at = np.asarray(working)[..., None]
    ratio = frequency_hz / np.take_along_axis(frequency_hz, at, -1)
    others = np.hypot(OTHERS * moved, np.maximum(OTHERS_FLOOR + OTHERS_RISE * ratio, floor))
    softened = 1 / np.sqrt(1 - np.minimum(2 * moved, MOST_SOFTER)) - 1
    return np.asarray(np.where(np.arange(6) == at, np.hypot(softened, floor), others))


def _with_mode_axis(value: Array) -> np.ndarray:
    """Return the value as an array with a last axis of length 1, for the modes."""
    return np.asarray(value, float)[..., None]
