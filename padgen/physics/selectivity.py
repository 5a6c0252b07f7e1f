"""Selectivity: the vibration of OFF taxels against that of ON taxels, for every drive scheme and every on/off state.

A coil pulls with the square of its current, so that a drive scheme determines the lines of i². Each channel has its
wanted line at its resonance r; all other lines are spurs:

===========  =======================================  ==================================
scheme       current                                  spurs of channels a, b
===========  =======================================  ==================================
tones        sum of sines at r/2 (paper Eq. 4-5)      (r_a + r_b)/2 and abs(r_a − r_b)/2; r_a/2
spur-free    square root of the wanted force          none
biased       a constant and sines at r                r_a + r_b, abs(r_a − r_b) and 2 r_a
time-shared  one channel at a time, a sine at r/2     r_a/2, and never two tones at once
===========  =======================================  ==================================

The lines at r/2 are of steel that has kept some magnetisation, so that the pull has a part that goes with the current
itself (`padgen.physics.remanence`); with a constant current that part is at the resonances, and only changes levels.

All figures are of the steady state: currents are switched in ramps that are slow against the ring-down of the taxels
(time-shared, in every slot). Lines of distinct frequency add as energies, and energies only add, so that an OFF taxel
is loudest when all others are on. The worst of 2ⁿ states is therefore one of n (or one pair, where channels take
turns).

A taxel is one resonator, or several modes (`padgen.physics.resonator`), whose amplitudes add at each line. With modes
its response to each line differs, but the lines' energies still only add.
"""

from collections.abc import Callable, Iterator
from functools import lru_cache
from itertools import islice
from math import erfc
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from padgen.core.registry import SCHEMES
from padgen.physics.resonator import relative_energy

if TYPE_CHECKING:
    from padgen.physics.schemes import DriveScheme

__all__ = [
    "AllStates",
    "Channels",
    "Lines",
    "Responses",
    "Scheme",
    "all_states",
    "channels",
    "estimated_print_share",
    "line_energy",
    "loudest_line",
    "off_energy",
    "one_hot_db",
    "own_lines",
    "pair_lines",
    "scheme_lines",
    "tone_energy",
]

BLOCK = 1 << 15
"""Responses computed at a time: few enough for a core's cache."""
MANY = 1 << 62
FARTHEST_SIGMA = 8.0
LEAST = 1e-300
"""Beyond so many sigma nothing comes too near; what stands for no energy at all."""


SQUARE = 2
"""Order in the current of the pull on steel, which goes with its square; that on a magnet is of order 1."""


class Scheme(NamedTuple):
    """A drive scheme; `bias_ratio` is the constant current / the largest tone's peak current (biased scheme only).

    `version` distinguishes, in caches, schemes that were registered one after the other under one name. `remanence` is
    ρ² over the coil's largest wanted line, for a pull as i² + ρ i (`padgen.physics.remanence`).
    """

    name: str
    bias_ratio: float = 5.0
    version: int = 0
    remanence: float = 0.0

    @property
    def kind(self) -> "DriveScheme":
        """The scheme's implementation, from its file or as registered."""
        return SCHEMES.get(self.name, "drive.scheme")

    @property
    def has_pair_spurs(self) -> bool:
        """True where two channels together make unwanted lines."""
        return self.kind.HAS_PAIR_SPURS

    @property
    def pair_scale(self) -> float:
        """Ratio of the frequency of a pair's spur to the sum or difference of the pair's resonances: 1 or 0.5."""
        return 1.0 if self.at_resonance else 0.5

    @property
    def force_order(self) -> int:
        """Power of the current that the scheme's forces are proportional to: 1 or 2."""
        return int(getattr(self.kind, "FORCE_ORDER", SQUARE))

    @property
    def at_resonance(self) -> bool:
        """True where a channel's line of current is at its resonance, false where it is at half of that."""
        return self.kind.CURRENT != "tones"

    def pair_square(self, a: np.ndarray, b: np.ndarray, strongest: np.ndarray | float) -> np.ndarray:
        """Return the squared amplitude of the spurs of two channels whose wanted lines have the amplitudes a and b.

        `strongest` is the line that sets the bias.
        """
        return self.kind.pair_square(self, a, b, strongest)

    @property
    def is_root(self) -> bool:
        """True where the current is the root of the wanted force."""
        return self.kind.CURRENT == "root"

    @property
    def is_biased(self) -> bool:
        """True where the current is a constant and tones."""
        return self.kind.CURRENT == "biased"

    @property
    def goes_with_level(self) -> bool:
        """True where a current tone is proportional to its taxel's level, false where to that level's square root."""
        return self.kind.CURRENT in ("biased", "linear")

    @property
    def has_constant(self) -> bool:
        """True where the current has a constant part."""
        return self.kind.CURRENT in ("biased", "root")

    @property
    def takes_turns(self) -> bool:
        """True where one channel plays at a time."""
        return self.kind.TAKES_TURNS


class Channels(NamedTuple):
    """Each channel's resonance in Hz, Q, and amplitude of its wanted line: (n,) for one coil, (n, …) for many coils.

    `line` is the amplitude of a channel's wanted line of i², up to one common factor: the force ``A = D 4π² m f²/Q``
    for its ON displacement D, over the coil's force constant for its washer.
    """

    resonance_hz: np.ndarray
    q: np.ndarray
    line: np.ndarray


class Responses(Protocol):
    """Interface to responses of taxels that are no single resonators: those with all their modes, or touched ones."""

    @property
    def responses(self) -> int:
        """Number of resonator responses computed for each taxel and spectral line."""

    def energy(self, rows: slice, frequency: np.ndarray, rest: np.ndarray | float = 0.0) -> np.ndarray:
        """Return taxels' energy (rows, lines) under spectral lines, divided by that at their own tone when untouched.

        All lines have one amplitude.
        """


class Lines(NamedTuple):
    """Spectral lines of i² and the channels that make them.

    `hz` are the frequencies (k, l, …), `rest` their rounding errors, `square` the squared amplitudes in the unit of
    `Channels.line`. Each of l channels or pairs makes k lines; `makers` has one array (l,) of channels, or two.
    """

    hz: np.ndarray
    rest: np.ndarray
    square: np.ndarray
    makers: tuple[np.ndarray, ...]


class AllStates(NamedTuple):
    """Selectivity in dB over all on/off states, a worst state as bits (channel 0 first), and its loudest OFF taxel."""

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
    """Return `Channels` from ON displacements `level`, effective masses and force constants `pull`.

    Each may have any common factor. The defaults are equal masses and equal force constants.
    """
    resonance = np.asarray(resonance_hz, float)
    quality = np.broadcast_to(np.asarray(q, float), resonance.shape)
    return Channels(resonance, quality, level * mass * resonance**2 / (quality * pull))


def tone_energy(receivers: Channels, drivers: Channels) -> np.ndarray:
    """Return M_ij² (receivers, drivers): taxel i's energy under channel j's tone, divided by its energy when ON."""
    response = relative_energy(drivers.resonance_hz, receivers.resonance_hz[:, None], receivers.q[:, None])
    return response * (drivers.line / receivers.line[:, None]) ** 2


def own_lines(of: Channels, scheme: Scheme, most: int = MANY) -> Iterator[Lines]:
    """Yield the lines each channel (n, …) makes alone: wanted lines, 2nd harmonics of biased tones, lines by remanence.

    Each yield has up to `most` channels.
    """
    each = np.arange(len(of.line))
    for start in range(0, len(each), most):
        block = slice(start, start + most)
        hz = of.resonance_hz[None, block]
        line = of.line[None, block]
        square = line**2
        if scheme.is_biased:
            hz = np.concatenate([hz, 2 * hz])
            square = np.concatenate([square, scheme.pair_square(line, line, of.line.max(0)) / 4])
        elif scheme.remanence and not scheme.has_constant:
            # A tone of i whose square has the line a is √2a strong.
            hz = np.concatenate([hz, hz / 2])
            square = np.concatenate([square, 2 * scheme.remanence * of.line.max(0) * line])
        yield Lines(hz, np.zeros(1), square, (each[block],))


def scheme_lines(of: Channels, scheme: Scheme, most: int = MANY) -> Iterator[Lines]:
    """Yield all lines of i², up to `most` channels or pairs at a time: `own_lines`, then sums and differences of pairs.

    Two channels alone have no lines of pairs, since there is no third taxel to hear them.
    """
    yield from own_lines(of, scheme, most)
    a, b = _pairs(len(of.line))
    for start in range(0, len(a) if scheme.has_pair_spurs and len(of.line) > 2 else 0, most):
        yield pair_lines(of, scheme, (a[start : start + most], b[start : start + most]))


def pair_lines(
    of: Channels,
    scheme: Scheme,
    makers: tuple[np.ndarray, np.ndarray] | None = None,
    strongest: np.ndarray | float | None = None,
) -> Lines:
    """Return the sum and difference spurs of the channel pairs `makers` (two arrays (l,) of channels; None: all pairs).

    `strongest`, by default the largest of all lines, sets the bias.
    """
    a, b = makers = makers or _pairs(len(of.line))
    low = np.minimum(of.resonance_hz[a], of.resonance_hz[b])
    high = np.maximum(of.resonance_hz[a], of.resonance_hz[b])
    # A spur on a resonance of high Q needs its frequency to better than the last digit of a double.
    total = high + low
    difference = high - low
    hz = np.stack([total, difference])
    rest = np.stack([low - (total - high), (high - difference) - low])
    square = scheme.pair_square(of.line[a], of.line[b], of.line.max(0) if strongest is None else strongest)
    return Lines(hz * scheme.pair_scale, rest * scheme.pair_scale, square[None], makers)


def line_energy(which: Channels, part: Lines, modes: Responses | None = None) -> np.ndarray:
    """Return the energy (n, k, l) of each taxel under each spectral line, divided by its energy when ON."""
    return _line_response(which, part, modes, slice(None)) / which.line[:, None, None] ** 2


def off_energy(
    which: Channels,
    scheme: Scheme,
    modes: Responses | None = None,
    drivers: Channels | None = None,
    one_hot: bool = False,
    weight: Callable[[np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Return each taxel's largest energy (n, …) among all states in which it is OFF, divided by its energy when ON.

    Further axes are further coils (prints, candidates), without `modes`. The `drivers` (None: the channels themselves)
    need not be at the taxels' resonances; ``which.line`` is then the line that moves a taxel by its level at its own
    resonance, ``drivers.line`` the one that is played. With `one_hot`, only states with one other channel on count. A
    line's energy counts `weight` times, a function of its frequency in Hz.

    O(n²) without spurs, O(n³) with them, times the number of modes; memory O(n²) at most.
    """
    drivers = which if drivers is None else drivers
    result = np.zeros(np.broadcast(which.resonance_hz, *drivers).shape)
    parts = own_lines if one_hot else scheme_lines
    join = np.maximum if one_hot or scheme.takes_turns else np.add
    each = result[0].size * (1 if modes is None else modes.responses)
    for part in parts(drivers, scheme, max(BLOCK // each, 1)):
        rows = max(BLOCK // (each * part.hz.shape[0] * part.hz.shape[1]), 1)
        for start in range(0, len(result), rows):
            block = slice(start, start + rows)
            lines = part if rows > 1 else _made_by_others(part, start)
            if not lines.hz.size:
                continue
            response = _line_response(which, lines, modes, block)
            heard = (response if weight is None else response * weight(lines.hz)).sum(1)
            # A taxel's own lines are left out before adding; subtracting them later would leave rounding errors.
            for maker in lines.makers:
                there = np.flatnonzero((maker >= start) & (maker < start + rows))
                heard[maker[there] - start, there] = 0.0
            # In a fixed order, so that one coil's result does not depend on the number of other coils.
            heard[:, 0] = join(heard[:, 0], result[block])
            result[block] = join.reduce(heard, 1)
    return result / which.line**2


def _made_by_others(part: Lines, taxel: int) -> Lines:
    """Return those of the spectral lines `part` to which the tone of `taxel` does not contribute."""
    others = np.all([maker != taxel for maker in part.makers], axis=0)
    if others.all():
        return part
    rest = np.broadcast_to(part.rest, part.hz.shape)
    makers = tuple(maker[others] for maker in part.makers)
    return Lines(part.hz[:, others], rest[:, others], part.square[:, others], makers)


def all_states(which: Channels, scheme: Scheme, modes: Responses | None = None) -> AllStates:
    """Return the selectivity over all 2ⁿ states: smallest ON amplitude over largest OFF amplitude, in closed form."""
    count = len(which.line)
    if count < 2:
        return AllStates(float("inf"), "1" * count, 0)
    energy = off_energy(which, scheme, modes)
    worst = int(energy.argmax())
    on = set(range(count)) - {worst}
    if scheme.takes_turns:
        on = set(loudest_line(which, scheme, worst, modes)[0])
    state = "".join("1" if i in on else "0" for i in range(count))
    return AllStates(_below_db(float(energy[worst])), state, worst)


def one_hot_db(which: Channels, scheme: Scheme, modes: Responses | None = None) -> float:
    """Return the selectivity in dB with one channel on at a time, ``−20 log10 max_{i≠j} M_ij``; inf for one channel."""
    if len(which.line) < 2:
        return float("inf")
    return _below_db(float(off_energy(which, scheme, modes, one_hot=True).max()))


def loudest_line(
    which: Channels, scheme: Scheme, off: int, modes: Responses | None = None
) -> tuple[tuple[int, ...], str]:
    """Return the channels that make the spectral line which moves an OFF taxel most, and that line's kind.

    The kind is 'tone', 'harmonic', 'remanence', 'sum' or 'difference'.
    """
    loudest = -1.0
    loudest_of = (tuple[int, ...]((off,)), "tone")
    for part in scheme_lines(which, scheme):
        heard = _line_response(which, part, modes, slice(off, off + 1))[0]
        heard[:, np.any([maker == off for maker in part.makers], axis=0)] = -1.0
        kind, at = np.unravel_index(int(heard.argmax()), heard.shape)
        if heard[kind, at] > loudest:
            loudest = heard[kind, at]
            single = ("tone", "harmonic" if scheme.has_constant else "remanence")
            kinds = single if len(part.makers) == 1 else ("sum", "difference")
            loudest_of = tuple(int(maker[at]) for maker in part.makers), kinds[kind]
    return loudest_of


def estimated_print_share(
    of: Channels, scheme: Scheme, need: float, coils: int, followed: float, missed: float = 0.0, share: float = 0.9
) -> float:
    """Estimate in closed form the share of prints with `coils` coils that keep an ON/OFF energy ratio of `need`.

    Eq. 12 with a guard band for the print. A line may come as near to an OFF taxel as `need` allows, all other lines
    staying where they are: in logarithms ``x = arsinh(√(P/b − 1)/2Q)``, P being its energy at the taxel's resonance
    over that of the ON state and b what the other lines leave of 1/need. For one line of a taxel beside it that is
    Eq. 12's ``2 artanh(Δy/4Q)`` but for its approximation. Lines that are drawn d apart come nearer than x in
    ``Φ((x − d)/s)`` of the prints, and pads are good in which none does.

    `followed` is the sigma of each taxel's own ln f that tones follow, so that s is the spread of a ratio (√2
    `followed` between neighbours). `missed` is the sigma that they do not follow: of a taxel beside its own tone, which
    also makes ON taxels quieter; `share` is of the pads that lose no more by it than is counted.

    Notes
    -----
    After Mohammadi et al. (Eq. 6-12). Geometric ladders, against Monte-Carlo: `docs/yield.md`.
    """
    if missed:
        from statistics import NormalDist

        sigmas = NormalDist().inv_cdf((1 + share ** (1 / (coils * len(of.line)))) / 2)
        need = need * (1 + (2 * float(of.q.max()) * np.sinh(sigmas * missed)) ** 2)
    hz = of.resonance_hz[:, None, None]
    q = of.q[:, None, None]
    parts = [(part, line_energy(of, part)) for part in scheme_lines(of, scheme)]
    for part, heard in parts:
        for maker in part.makers:
            heard[maker, :, np.arange(len(maker))] = 0.0
    total = sum(heard.sum((1, 2), keepdims=True) for _, heard in parts)
    log_share = 0.0
    for part, heard in parts:
        left = np.maximum(1 / need - (0.0 if scheme.takes_turns else total - heard), LEAST)
        apart = np.abs(np.log(part.hz / hz))
        peak = heard * (1 + (2 * q * np.sinh(apart)) ** 2)
        closest = np.arcsinh(np.sqrt(np.maximum(peak / left - 1, 0)) / (2 * q))
        moves = 1.0
        if len(part.makers) > 1:
            moves = scheme.pair_scale**2 * sum(of.resonance_hz[maker] ** 2 for maker in part.makers) / part.hz**2
        elif not missed:  # Of two neighbours each hears the other, but there is one gap between them.
            closest[:, 0] = np.triu(np.maximum(closest[:, 0], closest[:, 0].T))
        spread = np.broadcast_to(np.sqrt(missed**2 + followed**2 * (1 + moves) + LEAST), heard.shape)
        near = (closest > 0) & (apart - closest < FARTHEST_SIGMA * spread)
        low, high = ((apart + sign * closest)[near] / spread[near] / 2**0.5 for sign in (-1, 1))
        # Of a narrow gap the area under the bell curve is its height times the width, to 1e-5.
        narrow = high - low < NARROW
        middle = (low + high)[narrow] / 2
        fails = np.exp(-(middle**2)) * (high - low)[narrow] / np.pi**0.5
        log_share += float(np.log(np.maximum(1 - fails, LEAST)).sum())
        ends = zip(low[~narrow].tolist(), high[~narrow].tolist(), strict=True)
        while some := list(islice(ends, AT_A_TIME)):
            fails = np.array([(erfc(a) - erfc(b)) / 2 for a, b in some])
            log_share += float(np.log(np.maximum(1 - fails, LEAST)).sum())
            if coils * log_share < LEAST_LOG_SHARE:  # as more lines only make it less
                return 0.0
    return float(np.exp(coils * log_share))


NARROW = 1e-3
"""Width of a gap in sigmas, times √2, below which the bell curve is taken as level across it."""
AT_A_TIME = 4096
"""Pairs of a line and a taxel after which it is seen whether any good pad is left."""
LEAST_LOG_SHARE = -50.0
"""Logarithm of a share that is none: with 1e-22 no pad is good."""


@lru_cache(maxsize=64)
def _pairs(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and the second channel of every pair."""
    return np.triu_indices(count, 1)


def _line_response(which: Channels, part: Lines, modes: Responses | None, rows: slice) -> np.ndarray:
    """Return taxels' energy (rows, k, l, …) under lines, divided by that under a line of 1 at their own resonance."""
    if modes is None:
        hz = which.resonance_hz[rows, None, None]
        q = which.q[rows, None, None]
        response = relative_energy(part.hz, hz, q, part.rest)
    else:
        response = modes.energy(rows, part.hz.ravel(), part.rest.ravel()).reshape(-1, *part.hz.shape)
    return response * part.square


def _below_db(energy: float) -> float:
    """Return in dB how far an OFF energy lies below 1, which is the energy of a taxel that is ON alone."""
    return float(-10 * np.log10(energy)) if energy > 0 else float("inf")
