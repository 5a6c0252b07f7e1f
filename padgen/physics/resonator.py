"""Response of one resonator (paper Eq. 1-3), and of a taxel with all its modes.

Each mode of a taxel is a resonator of its own. The pull's wrench along the mode's motion excites it. A finger feels the
vertical motion of the boss, as the mean square over the boss' disc of radius a: ``z² + a²/4 (θx² + θy²)``, so that
rolling of the plate counts, too. All modes add as complex amplitudes,

    R(f) = Σ_k g_k / (1 − (f/f_k)² + j f/(f_k Q)),   g_k = (φ_k·W) o(φ_k) / (2π f_k)²,

with the mass-normalised motion φ_k of the washer, the wrench W for one newton of pull, and ``o(φ) = (φ_z, a/2 φ_θx, a/2
φ_θy)``, three parts whose energies add. (Modal superposition with one loss factor: Ewins, *Modal Testing*, 2nd ed.
2000, 2.5.) `TaxelModes` is the common result of all rungs of the structure ladder.
"""

from math import pi, sqrt
from typing import Any, NamedTuple

import numpy as np

__all__ = [
    "HAND_LIMIT_M_PER_S2",
    "LEFT_OUT",
    "STATIC_HZ",
    "UPWARD",
    "ModalTaxels",
    "TaxelModes",
    "felt_energy",
    "felt_gains",
    "felt_response",
    "modal_taxels",
    "natural_frequency",
    "receptance",
    "relative_energy",
    "ring_up_time",
    "rule_stiffness",
    "weighted_acceleration",
    "without_quiet_modes",
]

Array = Any


def natural_frequency(stiffness: Array, mass: Array) -> Array:
    """Return the natural frequency in Hz of a point mass in kg on a spring in N/m (paper Eq. 1)."""
    return np.sqrt(np.divide(stiffness, mass)) / (2 * pi)


def rule_stiffness(modulus: Array, width: Array, thickness: Array, length: Array, end_factor: Array) -> Array:
    """Return the stiffness in N/m of one beam by the point-mass rule ``k = c E w t³/l³`` (paper Eq. 2).

    `end_factor` c is 1/4 for a cantilever with a free end slope and 1 for a guided beam; the stiffnesses of parallel
    beams add. Lengths in m, `modulus` in Pa.
    """
    return end_factor * modulus * width * (np.asarray(thickness) / length) ** 3


def receptance(frequency: Array, resonance: Array, mass: Array, q: Array) -> Array:
    """Return the complex displacement per force in m/N at force `frequency` in Hz.

    ``H = 1/(4π² m) / (f_i² − f² + j f f_i/Q_i)``. The difference of squares is computed as a product, so that a tone
    next to its resonance keeps its digits at large Q.
    """
    frequency = np.asarray(frequency, float)
    resonance = np.asarray(resonance, float)
    detuning = (resonance - frequency) * (resonance + frequency)
    return 1 / (4 * pi**2 * np.asarray(mass)) / (detuning + 1j * frequency * resonance / q)


def relative_energy(frequency: Array, resonance: Array, q: Array, rest: Array = 0.0) -> Array:
    """Return the squared receptance at `frequency` over that at resonance, ``1/((Q (1−s²))² + s²)``, s = f/f_i.

    It is 1 at the resonance and 1/Q² far below. `rest` is the rounding error of `frequency`: the two are subtracted
    from the resonance one after the other, so that the distance of a line to it stays exact.
    """
    # In place and with one division an element: this takes most of the time of a plan, and a third of what it took.
    period = 1 / np.asarray(resonance)
    offset = np.subtract(resonance, frequency) - rest
    share = frequency * period
    energy = offset * (q * period)
    energy *= 1 + share
    energy *= energy
    share *= share
    energy += share
    return np.reciprocal(energy)


def ring_up_time(resonance: Array, q: Array) -> Array:
    """Return the time constant in s with which a vibration grows and decays, ``Q/(π f)``."""
    return np.asarray(q) / (pi * np.asarray(resonance))


UPWARD = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
"""A vertical unit pull at the washer's axis, as forces and moments."""


class TaxelModes(NamedTuple):
    """Modes of one taxel, lowest first.

    `frequency_hz` (k,); `motion` (k, 6) is the mass-normalised motion of the washer as a body: displacement of the
    point of its axis on the bed's plane (z = 0, taxel axes) in kg^-½ and rotation in kg^-½/m. All modes together make
    up the compliance of the washer. A rung that solves for few modes may give the static compliance of the others in
    `rest` (6, 6), in m/N (rad/(N·m)).
    """

    frequency_hz: np.ndarray
    motion: np.ndarray
    rest: np.ndarray | None = None

    def compliances(self, wrench: np.ndarray = UPWARD) -> np.ndarray:
        """Return the static compliance (k,) in m/N of each mode, from a `wrench` (6,) to the washer's vertical motion.

        The wrench acts on the washer; its vertical part is 1, its moments are in m about the axis' point. The motion is
        that at the axis.
        """
        return self.motion[:, 2] * (self.motion @ wrench) / (2 * np.pi * self.frequency_hz) ** 2

    @property
    def working(self) -> int:
        """Index of the channel's own mode: the one that a vertical pull at the washer's axis moves most."""
        return int(self.compliances().argmax())


STATIC_HZ = 1e30
"""Frequency of a mode far above all lines: to rounding it responds as a spring."""
LEFT_OUT = 1e-4
"""Largest joint amplitude of modes that are left out, over an OFF taxel's amplitude by its own mode."""


class ModalTaxels(NamedTuple):
    """k modes of each of n taxels: frequencies, Q, and relative static amplitudes of p components of the felt motion.

    `frequency_hz` (n, k); `q` (n,), one for all modes of a taxel. `gain` (n, k, p) is the felt static amplitude of each
    mode under one newton, over the felt amplitude under one newton at the taxel's own tone; 0 marks an absent mode.
    `left_out` (n,) bounds the relative error of an OFF taxel's amplitude in its worst state.
    """

    frequency_hz: np.ndarray
    q: np.ndarray
    gain: np.ndarray
    left_out: np.ndarray

    @property
    def responses(self) -> int:
        """Number of resonator responses computed for each taxel and spectral line: one of each mode."""
        return self.frequency_hz.shape[1]

    def energy(self, rows: slice, frequency: np.ndarray, rest: np.ndarray | float = 0.0) -> np.ndarray:
        """Return the felt energy (rows, lines) of these taxels under lines of 1 N, over that at each one's own tone."""
        return felt_energy(self, rows, frequency, rest)


def felt_gains(
    modes: TaxelModes, wrench: np.ndarray, rest_motion: np.ndarray, boss_radius_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies (k + 1,) in Hz and felt static amplitudes (k + 1, 3) in m/N of the modes of one taxel.

    `wrench` (6,) is that of one newton of pull, at the washer's axis on the bed's plane. The last entry is
    `rest_motion` (6,), the static motion by modes that were not solved for (`TaxelModes.rest`).
    """
    push = (modes.motion @ wrench) / (2 * np.pi * modes.frequency_hz) ** 2
    motion = np.concatenate([modes.motion * push[:, None], rest_motion[None]])
    return np.append(modes.frequency_hz, STATIC_HZ), motion[:, 2:5] * (1.0, boss_radius_m / 2, boss_radius_m / 2)


def modal_taxels(frequency_hz: np.ndarray, gain: np.ndarray, q: np.ndarray, own_hz: np.ndarray) -> ModalTaxels:
    """Return `ModalTaxels` whose amplitudes `gain` are scaled to 1 at each taxel's own tone `own_hz` (n,).

    `gain` (n, k, p) is the amplitude that is felt of n taxels in k modes by p parts of the motion, in any unit.

    Raises
    ------
    ValueError
        A taxel is not moved by its own tone at all.
    """
    bare = ModalTaxels(frequency_hz, np.asarray(q, float), gain, np.zeros(len(gain)))
    working_energy = felt_energy(bare, slice(None), own_hz[:, None], 0.0)[:, 0]
    if not (working_energy > 0).all():
        raise ValueError("a taxel must be moved by its own tone")
    return bare._replace(gain=gain / np.sqrt(working_energy)[:, None, None])


def felt_energy(taxels: ModalTaxels, rows: slice, frequency: np.ndarray, rest: np.ndarray | float = 0.0) -> np.ndarray:
    """Return the felt vibration energy (rows, lines) under force lines of 1 N, relative to that at each taxel's tone.

    `frequency` is (lines,), or (rows, lines) for lines of each taxel's own; `rest` is its rounding error, as in
    `relative_energy`.
    """
    real, imaginary = felt_response(taxels, rows, frequency, rest)
    return (real * real + imaginary * imaginary).sum(1)


def felt_response(
    taxels: ModalTaxels, rows: slice, frequency: np.ndarray, rest: np.ndarray | float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return motion (rows, 3, lines: up, two tilts) under force lines of 1 N as two arrays: in phase, and 90° behind.

    The parts are those of `felt_gains`: up, and by tilting about both axes. Under ``cos ωt`` a part moves as
    ``real cos ωt + imaginary sin ωt``.
    """
    mode = taxels.frequency_hz[rows, :, None]
    gain = taxels.gain[rows].transpose(0, 2, 1)
    frequency = np.asarray(frequency)[..., None, :]
    rest = np.asarray(rest)
    share = frequency / mode
    # As in `relative_energy`: two subtractions keep a line's exact distance to a mode at large Q.
    stiff = mode - frequency
    stiff -= rest[..., None, :] if rest.ndim else rest
    stiff /= mode
    stiff *= 1 + share
    loss = share
    loss /= taxels.q[rows, None, None]
    scale = stiff * stiff
    scale += loss * loss
    stiff /= scale
    loss /= scale
    return gain @ stiff, gain @ loss


def without_quiet_modes(
    taxels: ModalTaxels, own_hz: np.ndarray, line: np.ndarray, bias_ratio: float = 5.0, most: float = LEFT_OUT
) -> ModalTaxels:
    """Return `taxels` without the modes that are negligible in every drive scheme, and with a bound on their effect.

    That is at most `most` of an OFF taxel's amplitude by its own mode.

    Amplitudes over lines add to at most Σ|line| · |largest response of the mode| (Minkowski). A mode responds with at
    most ``Q/√(1−1/(4Q²))``, and above all lines with at most ``1/(1−(f/f_k)²)``, f being the highest possible line,
    twice the highest tone. The root sum square of all lines (n,) of a scheme is at most twice the sum of the wanted
    ones; for the biased scheme with a constant below half the tone, 1/`bias_ratio` times that sum.
    """
    # Below a Q of 1/√2, as of touched taxels, no response is larger than that at rest.
    peak = np.maximum(taxels.q / np.sqrt(np.maximum(1 - 1 / (4 * taxels.q**2), 0.25)), 1.0)
    above = 1 - (2 * own_hz.max() / taxels.frequency_hz) ** 2
    largest = 1 / np.maximum(above, 1 / peak[:, None])
    size = np.sqrt((taxels.gain**2).sum(-1)) * largest * (max(2.0, 1 / bias_ratio) * line.sum() / line)[:, None]
    # A lower bound of an OFF taxel's amplitude: at a neighbour's tone, over its own ON amplitude.
    heard = np.zeros(len(line))
    for by in (1, -1) if len(line) > 1 else ():
        tone = felt_energy(taxels, slice(None), np.roll(own_hz, by)[:, None])[:, 0]
        heard = np.maximum(heard, np.sqrt(tone) * np.roll(line, by) / line)
    order = np.argsort(size, 1)
    total = np.cumsum(np.take_along_axis(size, order, 1), 1)
    quiet = total <= most * heard[:, None]
    missing = np.where(quiet, total, 0.0).max(1)
    # The loudest first, so that modes left out of all taxels can be cut off.
    order = order[:, ::-1]
    kept = ~quiet[:, ::-1]
    count = int(kept.sum(1).max())
    gain = np.take_along_axis(taxels.gain, order[..., None], 1) * kept[..., None]
    return taxels._replace(
        frequency_hz=np.take_along_axis(taxels.frequency_hz, order, 1)[:, :count],
        gain=gain[:, :count],
        left_out=np.divide(missing, heard, out=np.zeros(len(heard)), where=heard > 0),
    )


HAND_LIMIT_M_PER_S2 = 5.0
"""Daily exposure of a hand to vibration over eight hours, weighted: limit of Directive 2002/44/EC, article 3."""


def weighted_acceleration(hz: float, amplitude_m: float) -> float:
    """Return the root mean square of the acceleration in m/s² of a sine, weighted as ISO 5349-1:2001, annex A, does.

    Above 16 Hz the weight falls as 1/f, so that the figure goes with the velocity.

    >>> third_octaves = (10**0.8, 10**1.2, 10**2.1)  # 6.3, 16 and 125 Hz, of 1 m/s²: table A.2 has 0.727, 0.896, 0.127
    >>> [round(weighted_acceleration(hz, sqrt(2) / (2 * pi * hz) ** 2), 3) for hz in third_octaves]
    [0.727, 0.896, 0.127]
    """
    s = 2j * pi * hz
    low = 2 * pi * 10**0.8
    high = 2 * pi * 10**3.1
    turn = 100.0
    band = s**2 / (s**2 + sqrt(2) * low * s + low**2) * high**2 / (s**2 + sqrt(2) * high * s + high**2)
    weight = abs(band * (s + turn) * turn / (s**2 + turn * s / 0.64 + turn**2))
    return weight * abs(s) ** 2 * amplitude_m / sqrt(2)
