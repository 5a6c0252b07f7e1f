"""How far OFF taxels stay below ON taxels under plain tones, in every on/off state.

A current i = Σ I_j sin 2πf_j t pulls with i² (paper Eq. 4-5), so channels a and b together make,
besides their wanted lines at r_a and r_b, spurs at (r_a + r_b)/2 and |r_a − r_b|/2 of twice the
geometric mean of the wanted forces. Lines of distinct frequency add as energies.
"""

from typing import NamedTuple

import numpy as np

from padgen.physics.resonator import receptance
from padgen.units import decibel

__all__ = ["Crosstalk", "all_states_db", "crosstalk", "exhaustive_states_db", "one_hot_db", "wanted_force"]


class Crosstalk(NamedTuple):
    """Relative amplitudes, each in units of the receiving taxel's own ON amplitude.

    `tones` (n, n): M_ij, taxel i at the tone of channel j; `spurs` (n, n, n): taxel i under both
    spurs of channels j and k (energies added), symmetric, zero for j = k.
    """

    tones: np.ndarray
    spurs: np.ndarray


def wanted_force(resonance_hz: np.ndarray, mass: np.ndarray, q: np.ndarray, level_law: float) -> np.ndarray:
    """Force amplitudes up to one common factor for ON displacements that fall as 1/f^p.

    ``A_i = D_i 4π² m_i f_i²/Q_i``, here with D_1 = 1 m.
    """
    displacement = (resonance_hz[0] / resonance_hz) ** level_law
    force: np.ndarray = displacement * 4 * np.pi**2 * mass * resonance_hz**2 / q
    return force


def crosstalk(
    resonance_hz: np.ndarray,
    mass: np.ndarray,
    q: np.ndarray,
    level_law: float,
    pull: np.ndarray | None = None,
) -> Crosstalk:
    """Relative amplitudes of all taxels of one coil under all tones and pairs of tones.

    Arrays of shape (n,): resonances in Hz, effective masses in kg, quality factors and, where the
    washers are not all pulled alike by the coil, the force constants `pull` in N/A²: the current
    that drives channel j pulls taxel i with c_i/c_j of the force on taxel j.
    """
    force = wanted_force(resonance_hz, mass, q, level_law)
    pull = np.ones(len(force)) if pull is None else pull
    response = _Response(resonance_hz, mass, q, force)
    tones = response.at(resonance_hz[None, :]) * force * pull[:, None] / pull
    sums = (resonance_hz[:, None] + resonance_hz) / 2
    differences = np.abs(resonance_hz[:, None] - resonance_hz) / 2
    # The spur is c I_j I_k against a wanted line of c I²/2: twice the geometric mean.
    current = np.sqrt(force / pull)
    amplitude = 2 * current[:, None] * current * pull[:, None, None]
    amplitude[:, np.arange(len(force)), np.arange(len(force))] = 0.0
    energy = response.at(sums[None]) ** 2 + response.at(differences[None]) ** 2
    return Crosstalk(tones, np.sqrt(energy) * amplitude)


def one_hot_db(talk: Crosstalk) -> float:
    """Selectivity with one channel on at a time, ``−20 log10 max_{i≠j} M_ij``; inf for one channel."""
    others = talk.tones[~np.eye(len(talk.tones), dtype=bool)]
    return -decibel(float(others.max())) if others.size else float("inf")


def all_states_db(talk: Crosstalk) -> tuple[float, str]:
    """Selectivity over all 2ⁿ states, and the worst state as a bit string (channel 0 first).

    An OFF taxel is loudest when all others are on, since energies only add; so the worst of 2ⁿ
    states is one of n, an O(n³) closed form with the spurs of every pair.
    """
    count = len(talk.tones)
    if count < 2:
        return float("inf"), "1" * count
    # The taxel's own tone and spurs are left out before adding: taken off a sum they would leave its rounding.
    off = ~np.eye(count, dtype=bool)
    total = (talk.tones**2 * off).sum(1) + (talk.spurs**2 * off[:, :, None] * off[:, None, :]).sum((1, 2)) / 2
    worst = int(total.argmax())
    state = "".join("0" if i == worst else "1" for i in range(count))
    return -decibel(float(np.sqrt(total[worst]))), state


def exhaustive_states_db(talk: Crosstalk) -> float:
    """The same figure by trying all 2ⁿ states: smallest ON over largest OFF amplitude (n ≤ 16)."""
    count = len(talk.tones)
    if count > 16:
        raise ValueError(f"2^{count} states are too many to try, at most 2^16")
    states = (np.arange(2**count)[:, None] >> np.arange(count)) & 1
    energy = states @ (talk.tones**2).T
    energy = energy + np.einsum("sj,ijk,sk->si", states, talk.spurs**2, states, optimize=True) / 2
    on = states.astype(bool)
    return float(10 * np.log10(energy[on].min() / energy[~on].max()))


class _Response:
    """Receptance of every taxel relative to its own ON amplitude, per unit force."""

    def __init__(self, resonance: np.ndarray, mass: np.ndarray, q: np.ndarray, force: np.ndarray) -> None:
        self._parts = (resonance, mass, q)
        self._on = np.abs(receptance(resonance, resonance, mass, q)) * force

    def at(self, frequency: np.ndarray) -> np.ndarray:
        """Amplitudes of shape (n, …) for `frequency` of shape (1, …)."""
        extra = (slice(None),) + (None,) * (frequency.ndim - 1)
        resonance, mass, q = (part[extra] for part in self._parts)
        result: np.ndarray = np.abs(receptance(frequency, resonance, mass, q)) / self._on[extra]
        return result
