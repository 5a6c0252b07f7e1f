"""How far OFF taxels stay below ON taxels, for every drive scheme and in every on/off state.

A coil pulls with the square of its current, so that a drive scheme is a recipe for the lines of i².
Each channel has its wanted line at its resonance r; what else a scheme makes are spurs:

=============  ==========================================  ================================
scheme         current                                     spurs of channels a, b
=============  ==========================================  ================================
tones          sum of sines at r/2 (paper Eq. 4-5)         (r_a + r_b)/2 and abs(r_a − r_b)/2
spur-free      square root of the wanted force             none
biased         a constant and sines at r                   r_a + r_b, abs(r_a − r_b) and 2 r_a
time-shared    one channel at a time, a sine at r/2        none, and never two tones at once
=============  ==========================================  ================================

All figures are of the steady state: currents are switched in ramps that are slow against the
ring-down of the taxels (time-shared, in every slot). Lines of distinct frequency add as energies,
and energies only add: an OFF taxel is loudest when all others are on. So the worst of 2ⁿ states is
one of n (or one pair, where channels take turns).

A taxel is one resonator, or all the modes of `padgen.physics.modal`, whose amplitudes add at each line: what it
hears of a line is another number then, and the lines' energies still only add.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from padgen.physics.modal import ModalTaxels, felt_energy
from padgen.physics.resonator import relative_energy

__all__ = [
    "SCHEMES",
    "AllStates",
    "Channels",
    "Scheme",
    "all_states",
    "channels",
    "exhaustive_states_db",
    "loudest_line",
    "off_energy",
    "one_hot_db",
    "pair_lines",
    "tone_energy",
]

SCHEMES = ("tones", "spur-free", "biased", "time-shared")
BLOCK = 1 << 15
"""Lines that are worked on at a time: what stays in a core's cache."""


class Scheme(NamedTuple):
    """A drive scheme; `bias_ratio` is the constant current over the largest tone's (biased only)."""

    name: str
    bias_ratio: float = 5.0

    @property
    def has_pair_spurs(self) -> bool:
        """Whether two channels make lines that neither wants."""
        return self.name in ("tones", "biased")

    @property
    def has_constant(self) -> bool:
        """Whether the current has a constant part, so that a channel's line of it is at its resonance."""
        return self.name in ("spur-free", "biased")

    @property
    def takes_turns(self) -> bool:
        """Whether one channel plays at a time."""
        return self.name == "time-shared"


class Channels(NamedTuple):
    """The channels of one coil, arrays of shape (n,).

    `line` is the amplitude of a channel's wanted line of i², up to one common factor: the force
    ``A = D 4π² m f²/Q`` that its ON displacement D takes, over what the coil pulls its washer with.
    """

    resonance_hz: np.ndarray
    q: np.ndarray
    line: np.ndarray


class AllStates(NamedTuple):
    """Selectivity over all states in dB, a worst state as bits (channel 0 first), the OFF taxel of it."""

    db: float
    state: str
    off: int


def channels(
    resonance_hz: np.ndarray,
    q: np.ndarray | float,
    level: np.ndarray,
    mass: np.ndarray | float = 1.0,
    pull: np.ndarray | float = 1.0,
) -> Channels:
    """`Channels` from ON displacements `level`, effective masses and force constants `pull`.

    Each up to a common factor; the defaults take all plates as alike and all washers as pulled alike.
    """
    resonance = np.asarray(resonance_hz, float)
    quality = np.broadcast_to(np.asarray(q, float), resonance.shape)
    line = level * mass * resonance**2 / (quality * pull)
    return Channels(resonance, quality, line)


def tone_energy(receivers: Channels, drivers: Channels) -> np.ndarray:
    """M_ij² (receivers, drivers): energy of taxel i at the tone of channel j over that of its own ON state."""
    response = relative_energy(drivers.resonance_hz, receivers.resonance_hz[:, None], receivers.q[:, None])
    energy: np.ndarray = response * (drivers.line / receivers.line[:, None]) ** 2
    return energy


def pair_lines(
    which: Channels, scheme: Scheme, strongest: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spurs of all pairs: frequencies (2, p), what rounding took off them (2, p), amplitudes (p,).

    Pairs in the order of ``np.triu_indices(n, 1)``; first the sums, then the differences. Amplitudes
    in the unit of `Channels.line`, of which `strongest`, the one that sets the bias, is the largest
    unless `which` are not all of the coil's channels.
    """
    a, b = _pairs(len(which.line))
    low, high = np.minimum(*which.resonance_hz[[a, b]]), np.maximum(*which.resonance_hz[[a, b]])
    # A spur on a resonance of high Q needs its frequency to better than the last digit of a double.
    total, difference = high + low, high - low
    rest = np.stack([low - (total - high), (high - difference) - low])
    frequency = np.stack([total, difference])
    if scheme.name == "tones":
        # I_a I_b against wanted lines of I²/2: twice the geometric mean.
        return frequency / 2, rest / 2, 2 * np.sqrt(which.line[a] * which.line[b])
    strongest = which.line.max() if strongest is None else strongest
    return frequency, rest, which.line[a] * which.line[b] / (2 * scheme.bias_ratio * strongest)


def off_energy(which: Channels, scheme: Scheme, modes: ModalTaxels | None = None) -> np.ndarray:
    """Largest energy (n,) of each OFF taxel over all states, over that of its own ON state.

    O(n²) without spurs, O(n³) with, times the number of modes; memory O(n²) at most.
    """
    count = len(which.line)
    own = _own_energies(which, scheme, modes)
    if scheme.has_pair_spurs and count > 2:
        own += _pair_energies(which, scheme, modes)
    return own


def all_states(which: Channels, scheme: Scheme, modes: ModalTaxels | None = None) -> AllStates:
    """Selectivity over all 2ⁿ states: smallest ON amplitude over largest OFF amplitude, a closed form."""
    count = len(which.line)
    if count < 2:
        return AllStates(float("inf"), "1" * count, 0)
    energy = off_energy(which, scheme, modes)
    worst = int(energy.argmax())
    on = set(range(count)) - {worst}
    if scheme.takes_turns:
        on = {_strongest_driver(which, worst, modes)}
    state = "".join("1" if i in on else "0" for i in range(count))
    return AllStates(_below_db(float(energy[worst])), state, worst)


def one_hot_db(which: Channels, scheme: Scheme, modes: ModalTaxels | None = None) -> float:
    """Selectivity with one channel on at a time, ``−20 log10 max_{i≠j} M_ij``; inf for one channel."""
    if len(which.line) < 2:
        return float("inf")
    alone = scheme if scheme.name == "biased" else Scheme("time-shared")
    return _below_db(float(_own_energies(which, alone, modes, together=False).max()))


def exhaustive_states_db(which: Channels, scheme: Scheme, modes: ModalTaxels | None = None) -> float:
    """The figure of `all_states` by trying all 2ⁿ states (n ≤ 16)."""
    count = len(which.line)
    if count > 16:
        raise ValueError(f"2^{count} states are too many to try, at most 2^16")
    tones, spurs = _tables(which, scheme, modes)
    states = ((np.arange(2**count)[:, None] >> np.arange(count)) & 1).astype(float)
    if scheme.takes_turns:
        energy = (states[:, None] * tones).max(-1)
    else:
        energy = states @ tones.T + np.einsum("sj,ijk,sk->si", states, spurs, states, optimize=True) / 2
    on = states.astype(bool)
    return float(10 * np.log10(energy[on].min() / energy[~on].max()))


def loudest_line(which: Channels, scheme: Scheme, off: int) -> tuple[tuple[int, ...], str]:
    """The channels and the kind ('tone', 'sum', 'difference') of the line that an OFF taxel hears loudest."""
    tones = tone_energy(_only(which, off), which)[0]
    tones[off] = 0.0
    loudest = float(tones.max())
    found: tuple[tuple[int, ...], str] = (int(tones.argmax()),), "tone"
    if scheme.has_pair_spurs and len(which.line) > 2:
        frequency, rest, amplitude = pair_lines(which, scheme)
        a, b = _pairs(len(which.line))
        response = relative_energy(frequency, which.resonance_hz[off], which.q[off], rest)
        energy = response * (amplitude / which.line[off]) ** 2 * ((a != off) & (b != off))
        kind, pair = np.unravel_index(int(energy.argmax()), energy.shape)
        if energy[kind, pair] > loudest:
            found = (int(a[pair]), int(b[pair])), ("sum", "difference")[kind]
    return found


@lru_cache(maxsize=64)
def _pairs(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Both channels of every pair."""
    pairs = np.triu_indices(count, 1)
    for part in pairs:
        part.setflags(write=False)
    return pairs[0], pairs[1]


def _only(which: Channels, index: int) -> Channels:
    return Channels(*(part[index : index + 1] for part in which))


def _response(
    which: Channels, modes: ModalTaxels | None, rows: slice, frequency: np.ndarray, rest: np.ndarray | float = 0.0
) -> np.ndarray:
    """Energy (rows, lines) of taxels under lines (lines,) as large as their own, over that of their ON state."""
    if modes is not None:
        return felt_energy(modes, rows, frequency, rest)
    energy: np.ndarray = relative_energy(frequency, which.resonance_hz[rows, None], which.q[rows, None], rest)
    return energy


def _tones(which: Channels, modes: ModalTaxels | None, rows: slice) -> np.ndarray:
    """`tone_energy` (rows, n) of some of the taxels."""
    heard = _response(which, modes, rows, which.resonance_hz)
    energy: np.ndarray = heard * (which.line / which.line[rows, None]) ** 2
    return energy


def _harmonic_energy(which: Channels, modes: ModalTaxels | None, rows: slice, scheme: Scheme) -> np.ndarray:
    """Energy of the second harmonic that each tone beside a constant current makes.

    On the taxel itself it is no disturbance: it is there only when the taxel is ON.
    """
    amplitude = which.line**2 / (4 * scheme.bias_ratio * which.line.max())
    heard = _response(which, modes, rows, 2 * which.resonance_hz)
    energy: np.ndarray = heard * (amplitude / which.line[rows, None]) ** 2
    return energy


def _own_energies(
    which: Channels, scheme: Scheme, modes: ModalTaxels | None = None, together: bool = True
) -> np.ndarray:
    """Energy (n,) of each OFF taxel by the lines that single channels make: summed, or the largest."""
    count, result = len(which.line), np.empty(len(which.line))
    rows = max(BLOCK // (count * _depth(modes)), 1)
    for start in range(0, count, rows):
        part = slice(start, min(start + rows, count))
        energy = _tones(which, modes, part)
        if scheme.name == "biased":
            energy += _harmonic_energy(which, modes, part, scheme)
        energy[np.arange(part.stop - start), np.arange(start, part.stop)] = 0.0
        result[part] = energy.sum(1) if together and not scheme.takes_turns else energy.max(1)
    return result


def _depth(modes: ModalTaxels | None) -> int:
    """Numbers that one response takes."""
    return 1 if modes is None else modes.frequency_hz.shape[1]


def _pair_energies(which: Channels, scheme: Scheme, modes: ModalTaxels | None) -> np.ndarray:
    """Energy (n,) of each OFF taxel by the spurs of all pairs of other channels."""
    count = len(which.line)
    frequency, rest, amplitude = pair_lines(which, scheme)
    square = amplitude**2
    a, b = _pairs(count)
    result, taxel = np.zeros(count), np.arange(count)[:, None]
    block = max(BLOCK // _depth(modes), 1)
    for start in range(0, len(square), block):
        part = slice(start, start + block)
        lines = frequency[:, part].ravel(), rest[:, part].ravel()
        # All taxels at once where there are few lines.
        rows = max(block // len(lines[0]), 1)
        for first in range(0, count, rows):
            own = slice(first, min(first + rows, count))
            energy = _response(which, modes, own, *lines).reshape(own.stop - first, 2, -1).sum(1)
            # Pairs with the taxel itself are left out before adding: taken off a sum they would leave its rounding.
            others = (a[part] != taxel[own]) & (b[part] != taxel[own])
            result[own] += (energy * np.where(others, square[part], 0.0)).sum(1)
    scaled: np.ndarray = result / which.line**2
    return scaled


def _tables(which: Channels, scheme: Scheme, modes: ModalTaxels | None) -> tuple[np.ndarray, np.ndarray]:
    """Energies (n, n) of every channel's own lines and (n, n, n) of every pair's, symmetric."""
    count = len(which.line)
    tones, spurs = _tones(which, modes, slice(None)), np.zeros((count, count, count))
    if scheme.name == "biased":
        tones += _harmonic_energy(which, modes, slice(None), scheme) * ~np.eye(count, dtype=bool)
    if scheme.has_pair_spurs:
        a, b = _pairs(count)
        frequency, rest, amplitude = pair_lines(which, scheme)
        for i in range(count):
            heard = _response(which, modes, slice(i, i + 1), frequency.ravel(), rest.ravel())
            response = heard.reshape(2, -1).sum(0)
            spurs[i, a, b] = spurs[i, b, a] = response * (amplitude / which.line[i]) ** 2
    return tones, spurs


def _strongest_driver(which: Channels, off: int, modes: ModalTaxels | None) -> int:
    energy = _tones(which, modes, slice(off, off + 1))[0]
    energy[off] = -1.0
    return int(energy.argmax())


def _below_db(energy: float) -> float:
    """How far an OFF energy lies below the smallest of an ON taxel: 1, alone on, since others only add."""
    return float(-10 * np.log10(energy)) if energy > 0 else float("inf")
