"""Bounds on the error from terms that a plan's models leave out: closed forms of a few operations each.

SI units. An error is the left-out term over the figure without it: 1 is all of the figure, infinite means that the
bound does not hold there. `docs/measure_left_out.py` compares each bound with a finer model.
"""

from math import inf, pi, sqrt
from typing import Any, NamedTuple

import numpy as np

from padgen.physics.beams import BeamSection, largest_inverse_square, tip_mass
from padgen.physics.magnetics import MU_0, CoilSource, SteelRing, charged_core, flux_density, ring_factor
from padgen.physics.modes import BeamPlacement, to_tip

__all__ = [
    "Magnetised",
    "beam_inertia",
    "core_echo",
    "core_eddies",
    "core_polarisation",
    "motional_voltage",
    "mutual_shielding",
    "ring_down_error",
    "saturation_loss",
    "washer_eddies",
    "washer_magnetised",
]

LOCAL_PEAK = 1.5
"""Polarisation of a wide washer above the rim of a core, over the estimate from two points of the washer (from field
solutions).
"""
ARMS = 1.7
"""Mean polarisation of a ring in an even field along its plane, weighted with its square, over the mean one: the arms
beside the hole carry what its ends do not (``8/3π`` over one half, since it goes with the sine round the ring)."""


def beam_inertia(
    beams: list[BeamPlacement],
    motion: np.ndarray,
    reference: np.ndarray,
    frequency: np.ndarray,
    working: np.ndarray,
    modulus: float,
    poisson: float,
    density: float,
) -> np.ndarray:
    """Bound the relative error (n,) of the resonance of mode `working` (n,) from inertia that `tip_mass` omits.

    `frequency` (n, m) in Hz and `motion` (n, m, 6) are those of all modes of the body; the motion is mass-normalised,
    at its point `reference` (n, 3), as in `modes.Modes`. A beam that is condensed to its tip lacks, as shares of the
    mode's kinetic energy:

    - its own modes between held ends: between 0 and ``T ω²/(ω₁² − ω²)``, with the beam's share T and the lowest of
      these modes ω₁ (the exact dynamic stiffness in partial fractions, in which the shares of the modes in T add to 1);
    - the rotary inertia of its sections;
    - the change of its deflection, by compliance of its ends and by shear, from the cubic between held ends.

    ω₁ is a lower bound after Dunkerley, from bending, shear and rotary inertia. The missing energy also mixes the mode
    with each other mode ω_k, which adds ``d² ω²/(ω_k² − ω²)``: d is the energy that the two miss together, at most by
    Cauchy's inequality where only its size is known. Infinite where the mode is not below ω₁.
    """
    at = np.arange(len(working)), working
    square = (2 * pi * frequency[at]) ** 2
    # The modes one by one, then each together with the working one: (2 m, n, 6).
    motions = np.concatenate([motion, motion + motion[at][:, None]], 1).swapaxes(0, 1)
    of_beams = [
        _missed_energy(
            beam.section, (to_tip(beam, reference) @ motions[..., None])[..., 0], square, modulus, poisson, density
        )
        for beam in beams
    ]
    missed, either, more = (np.asarray(sum(parts)) for parts in zip(*of_beams, strict=True))
    missed, together = np.split(missed, 2)
    unsure = np.split(either + more, 2)[0]
    first = missed[at[::-1]]
    ratio = square / (2 * pi * frequency.T) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        shared = np.abs(together - missed - first) / 2 + np.sqrt(unsure * unsure[at[::-1]])
        mixed = np.nan_to_num(shared**2 * ratio / (1 - ratio), posinf=inf, neginf=-inf)
    mixed[at[::-1]] = 0.0
    least = first - either[at[::-1]] + np.minimum(mixed, 0).sum(0)
    most = first + unsure[at[::-1]] + np.maximum(mixed, 0).sum(0)
    return np.asarray(np.maximum(1 - np.sqrt(np.maximum(1 + least, 0)), np.sqrt(np.maximum(1 + most, 0)) - 1))


def _missed_energy(
    section: BeamSection, tip: np.ndarray, square: np.ndarray, modulus: float, poisson: float, density: float
) -> tuple[Any, Any, Any]:
    """Return the kinetic energy of a beam that `tip_mass` omits, over its mode's: estimate, ± doubt, possible excess.

    The second counts either way, the third only upwards. `tip` (…, 6) is the motion of the beam's tip.
    """
    if section.path:
        # The mass of a bent beam includes rotary inertia, compliance of its ends and shear already.
        energy = np.einsum("...i,...ij,...j->...", tip, tip_mass(section, density, poisson), tip)
        more = _dynamic(energy, square * largest_inverse_square(section, modulus, poisson, density))
        return 0.0 * energy, 0.0 * energy, more
    width, thickness, length = (np.asarray(v, float) for v in section[:3])
    # Stiffness across the layers is a lower bound for upward shear and twist.
    shear_modulus = modulus / (2 * (1 + poisson)) * section.across
    shear_speed = 10 * (1 + poisson) / (12 + 11 * poisson) * shear_modulus / density
    line = density * width * thickness
    missed = doubt = shear_doubt = 0.0 * length
    ends = section.ends
    bends = (
        (thickness, 2, 4, -1, ends.root, ends.tip, ends.shear),
        (width, 1, 5, 1, ends.lateral_root, ends.lateral_tip, ends.lateral_shear),
    )
    for height, shift, turn, sign, root, end, slip in bends:
        deflected, held = _deflections(tip[..., shift], sign * tip[..., turn] * length, root / length, end / length)
        bending_speed = modulus / density * height**2 / 12
        # 1/ω₁²: bending between held, compliant ends, plus shear, plus rotary inertia.
        slow = (
            (length + root + end) ** 4 / (4.730**4 * bending_speed)
            + length * (length + 2 * slip) / (pi**2 * shear_speed)
            + length**2 * density / (pi**2 * modulus)
        )
        sheared = 12 * bending_speed * (length + 2 * slip) / (shear_speed * length**3)
        energy = line * length * _squared_deflection(deflected)
        missed = missed + energy - line * length * _squared_deflection(held)
        missed = missed + line * height**2 / 12 / length * _squared_slope(deflected)
        shear_doubt = shear_doubt + 0.5 * energy * sheared / (1 + sheared)
        doubt = doubt + _dynamic(energy, square * slow)
    along = line * length / 3
    polar = (width**2 + thickness**2) / 12
    a, b = (np.maximum(width, thickness), np.minimum(width, thickness))
    twist = a * b**3 / 3 * (1 - 0.63 * b / a) * shear_modulus  # a lower bound of the torsion constant
    wave = square * (length / pi) ** 2
    doubt = doubt + _dynamic(along * tip[..., 0] ** 2, wave * density / modulus)
    doubt = doubt + _dynamic(along * polar * tip[..., 3] ** 2, wave * line * polar / twist)
    return missed, shear_doubt, doubt


def _deflections(shift: Any, turn: Any, root: Any, tip: Any) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Return two triples (root slope, tip shift, tip slope) of a unit-length beam: with compliant and with rigid ends.

    `shift` and `turn` are the body's. `root` and `tip` are the ends' compliances in beam lengths: an end of compliance
    ``g`` turns by ``g w''``.
    """
    determinant = (1 + 4 * root) * (1 + 4 * tip) - 4 * root * tip
    at_root = (6 * root * shift * (1 + 4 * tip) - 2 * root * (turn + 6 * tip * shift)) / determinant
    at_tip = ((turn + 6 * tip * shift) * (1 + 4 * root) - 12 * tip * root * shift) / determinant
    return (at_root, shift, at_tip), (0.0 * shift, shift, turn)


def _squared_deflection(deflection: tuple[Any, ...]) -> Any:
    """Return ∫ w² along a unit-length beam of cubic deflection w, given its root slope, tip shift and tip slope."""
    a, w, b = deflection
    return 13 / 35 * w**2 - 11 / 105 * w * b + (a**2 + b**2) / 105 + 13 / 210 * a * w - a * b / 70


def _squared_slope(deflection: tuple[Any, ...]) -> Any:
    """Return ∫ w'² along a unit-length beam of cubic deflection w, given its root slope, tip shift and tip slope."""
    a, w, b = deflection
    return (36 * w**2 - 6 * w * (a + b) + 4 * (a**2 + b**2) - 2 * a * b) / 30


def _dynamic(energy: Any, slowness: Any) -> Any:
    """Return `energy` times ω²/(ω₁² − ω²), from `slowness` = (ω/ω₁)²: infinite for ω ≥ ω₁, but 0 for zero energy."""
    share = np.where(slowness < 1, slowness / np.maximum(1 - slowness, 1e-300), inf)
    return np.multiply(energy, share, out=np.zeros(np.broadcast(energy, share).shape), where=energy != 0)


class Magnetised(NamedTuple):
    """Magnetisation of washers (n,) in a coil's field, per ampere.

    `field` (n,) in T/A is that along its plane, in which flat steel is polarised. `share` (2, n) are the whole field's
    shares at the washer's side nearest to the coil's axis and farthest from it. `polarisation` (n,) in T/A is the
    largest in the washer, for saturation; `chi_n` (n,) is χN, by which demagnetisation weakens the effect of saturation
    on the force.
    """

    field: np.ndarray
    share: np.ndarray
    polarisation: np.ndarray
    chi_n: np.ndarray


def washer_magnetised(
    coil: CoilSource, washer: SteelRing, gap: float, offset: np.ndarray, dipole: np.ndarray
) -> Magnetised:
    """Estimate how a coil magnetises washers `offset` (n,) m off its axis, from its field at three points of each.

    Two points lie on the middle line of the ring, nearest to and farthest from the coil's axis, on the washer's
    underside, the third between them. Demagnetisation depends on direction: the mean field along the line through them,
    which drives flux through both arms of the ring as the drop of potential does, meets the whole ring, its remainder
    the width of the ring, the axial field the thickness. The polarisation is at least that of a ring with each washer's
    `dipole` (n,) in A·m²/A.
    """
    outer = washer.outer_diameter / 2
    inner = washer.inner_diameter / 2
    at = offset + np.array([[-1.0], [0.0], [1.0]]) * (outer + inner) / 2
    radial, axial = flux_density(coil, np.maximum(np.abs(at), 1e-6 * outer), np.full_like(at, gap))
    radial = radial * np.sign(at)
    one_sided = np.array([1, 4, 1]) / 6 @ radial  # Simpson's rule
    radial = radial[::2]
    axial = axial[::2]
    ring_share = (outer - inner) / (outer - inner + washer.thickness)
    share = np.array([ring_factor(washer), 1 - ring_share, ring_share])
    chi = washer.permeability - 1
    eased = chi / (1 + chi * share)
    field = np.stack([np.broadcast_to(one_sided, radial.shape), radial - one_sided, axial])  # (3, 2, n)
    polarisation = eased[:, None, None] * field
    energy = (polarisation * field).mean(1)
    size = np.hypot(polarisation[0] + polarisation[1], polarisation[2])
    volume = pi * (outer**2 - inner**2) * washer.thickness
    weight = energy / energy.sum(0)
    local = np.hypot(radial, axial)
    return Magnetised(
        np.sqrt((radial**2).mean(0)),
        local / local.sum(0),
        LOCAL_PEAK * np.maximum(size.max(0), ARMS * MU_0 * dipole / volume),
        1 / (weight / (chi * share[:, None])).sum(0) if chi > 0 else np.full(len(offset), inf),
    )


def core_polarisation(coil: CoilSource) -> tuple[float, float]:
    """Return the mean polarisation in T/A of the core's most polarised section, and χ times its demagnetising factor N.

    The flux through a section is the magnetic charge on the core above it. It rises by 1/(1 + χN) of a relative rise of
    χ: a charge ``σ = −S⁻¹ (1/χ + P)⁻¹ P u`` (`steel_body`) rises by ``σ + R S σ`` per d ln χ. (A uniform field along
    the core gives an N that is larger by half and more.) Without a core the result is 0 and inf.
    """
    charged = charged_core(coil)
    if charged is None:
        return 0.0, inf
    core, charge = charged
    rise = charge + core.response[0] @ (core.uniform @ charge)
    order = np.argsort(-core.height, kind="stable")
    flux, more = (np.cumsum((core.area * each)[order]) for each in (charge, rise))
    at = int(np.abs(flux).argmax())
    return MU_0 * float(abs(flux[at])) / (pi / 4 * coil.core_diameter**2), float(abs(flux[at] / more[at])) - 1


def saturation_loss(polarised_share: Any, chi_n: Any) -> Any:
    """Return the share of a body's magnetisation lost to saturation at `polarised_share` = J/J_s.

    By Fröhlich's law a steel has ``χ(1 − J/J_s)`` in place of χ. With the demagnetising factor N the magnetisation
    ``χ/(1 + χN)`` then falls by ``s/(1 + χN(1 − s))``, s = J/J_s. s is taken a quarter larger, since edges saturate
    first. The loss is 1 where that reaches 1.
    """
    s = 1.25 * np.asarray(polarised_share, float)
    return np.where(s < 1, s / (1 + chi_n * np.maximum(1 - s, 0)), 1.0)


def core_eddies(coil: CoilSource, resistivity: float, frequency: float) -> float:
    """Bound the relative change of the core's field by eddy currents at `frequency` in Hz; `resistivity` in Ω·m.

    The effective permeability of a long round rod is μ times ``R = 2J₁(ka)/(ka J₀(ka))``, ``k² = −jωμ/ρ``. By the
    partial fractions of ``z J₀/2J₁``, 1/R differs from 1 by at most ``(a/δ)²/4``, and by the size of 1/R also by at
    most ``a/(√2 δ) + 1``, δ being the skin depth. Demagnetisation divides this by ``1 + χN``. Eddies at the ends of a
    core of finite length add half of diameter over length, as a share.
    """
    _, chi_n = core_polarisation(coil)
    depths = coil.core_diameter / 2 / _skin_depth(resistivity, coil.core_permeability, frequency)
    ends = 1 + coil.core_diameter / (coil.core_length or inf) / 2
    return ends * min(depths**2 / 4, depths / sqrt(2) + 1) / (1 + chi_n)


def washer_eddies(washer: SteelRing, resistivity: float, frequency: float) -> float:
    """Bound the relative change of a washer's field by eddy currents at `frequency` in Hz; `resistivity` in Ω·m.

    For a field along its plane a sheet responds as ``tanh x/x``, ``x = (1+j) t/2δ``, whose inverse differs from 1 by at
    most ``2 (t/2δ)²/3``. Against a field through its plane a disc screens by at most ``μ0 ω t r/(2ρ)``.
    """
    chi_n = (washer.permeability - 1) * ring_factor(washer)
    depths = washer.thickness / 2 / _skin_depth(resistivity, washer.permeability, frequency)
    along = 2 * depths**2 / 3 / (1 + chi_n)
    through = MU_0 * 2 * pi * frequency * washer.thickness * washer.outer_diameter / 4 / resistivity
    return along + through


def _skin_depth(resistivity: float, permeability: float, frequency: float) -> float:
    return sqrt(resistivity / (pi * frequency * MU_0 * permeability)) if frequency > 0 else inf


def motional_voltage(
    pull: np.ndarray, amplitude: np.ndarray, resonance: np.ndarray, drive: np.ndarray, bias: np.ndarray, coil: Any
) -> np.ndarray:
    """Bound the relative error (n,) of the channels' currents if voltages are set without the motion's back-EMF.

    The washer's motion z adds ``2 c z i`` to the coil's flux: c is its `pull` in N/A², `amplitude` in m that of z, at
    `resonance` in Hz. With a line of the current at `drive` in Hz this induces voltages at the sum and the difference
    of the two frequencies; with a constant current, `bias` times that line, one at the resonance. `coil` is the coil's
    impedance in Ω as a function of frequency. Errors at all frequencies are added, and so are the errors that these
    cause in turn; infinite where that series diverges.
    """
    flux = pull * amplitude
    error = np.zeros(len(pull))
    for beside in (resonance + drive, np.abs(resonance - drive)):
        error += flux * 2 * pi * beside / np.abs(coil(beside))
    error += 2 * bias * flux * 2 * pi * resonance / np.abs(coil(resonance))
    return np.where(error < 1, error / np.maximum(1 - error, 1e-300), inf)


def ring_down_error(
    static: np.ndarray, pulse: np.ndarray, resonance: np.ndarray, q: np.ndarray, quiet: np.ndarray, lag: float
) -> np.ndarray:
    """Bound the relative error (n,) of ring-down times that neglect the mean pull's release and the current's decay.

    Beside its vibration the taxel is released from the mean pull, `static` over its ON amplitude, and still pushed by
    the decaying current. The current falls with the time constant `lag` = L/R in s, and the pull with L/2R, from the
    static deflection `pulse` over the ON amplitude. `quiet` is the ratio of ON amplitude to the one that counts as
    quiet. Ring-down from a displacement and a velocity is at most ``√(2Q/(2Q − 1))`` times the two together, for strong
    damping. Infinite where nothing rings down, or where the current outlasts the vibration.
    """
    angular = 2 * pi * resonance
    ring_up = q / (pi * resonance)
    fall = (2 / lag if lag > 0 else inf) - 1 / ring_up
    kick = pulse * angular / np.sqrt(np.maximum(fall, 0) ** 2 + angular**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        rung = np.log1p(static + kick) - 0.5 * np.log1p(-0.5 / q)
        return np.where((fall > 0) & (quiet > 1), rung / np.log(quiet), inf)


def core_echo(coil: CoilSource, gap: float, place: np.ndarray) -> np.ndarray:
    """Return a factor in m^-3/2 per washer (n,); two factors' product is the field that the core passes between both.

    The washers are at `place` (n, 2). A core answers a field as a dipole of ``V χ/(1 + χN)`` in its middle. The field
    of washer k at washer n grows by the product of both figures, in units of ``μ0 m/2π``.
    """
    volume = pi / 4 * coil.core_diameter**2 * coil.core_length
    _, chi_n = core_polarisation(coil)
    drawn = volume * (coil.core_permeability - 1) / (2 * pi * (1 + chi_n))
    return sqrt(drawn) / np.hypot(np.linalg.norm(place, axis=-1), gap + coil.core_length / 2 - coil.core_top) ** 3


def mutual_shielding(
    moment: np.ndarray, field: np.ndarray, share: np.ndarray, place: np.ndarray, middle: float, echo: np.ndarray
) -> np.ndarray:
    """Bound the relative error (n,) in a coil's pull on each of its washers that the field of the others causes.

    The others are dipoles of `moment` (n,) in A·m²/A at `place` (n, 2) in m from the coil's axis, each taken to point
    along the line to the disturbed washer, where its field is ``μ0 m/(2π d³)``. The error is their sum over the coil's
    own `field` (n,) there. Each washer counts by its four quarters on the circle of radius `middle` in m; the quarters
    towards the axis and away from it are weighted with their `share` (2, n) of the field. `echo` (n,) is the core's
    (`core_echo`).
    """
    away = np.linalg.norm(place, axis=-1, keepdims=True)
    out = np.divide(place, away, out=np.tile([1.0, 0.0], (len(place), 1)), where=away > 0)
    aside = out[:, ::-1] * (-1, 1)
    quarters = place + middle * np.stack([-out, out, -aside, aside])
    weight = np.concatenate([share / 2, np.full_like(share, 0.25)])
    apart = np.linalg.norm(quarters[:, None, :, None] - quarters[None, :, None], axis=-1)
    apart[..., np.eye(len(place), dtype=bool)] = inf
    near = np.einsum("an,bk,abnk->nk", weight, weight, 1 / apart**3)
    near += echo[:, None] * echo * ~np.eye(len(place), dtype=bool)
    return np.asarray((near * MU_0 * moment / (2 * pi)).sum(-1) / np.where(field > 0, field, inf))
