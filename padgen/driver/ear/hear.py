"""The pass through a file, one coil after the other: currents, motions, levels."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from padgen.core.errors import FileError
from padgen.core.units import MH, UM
from padgen.driver.ear.current import Circuit, Squared, Stretch, squared_current, stretches
from padgen.driver.ear.gap import STEPS_PER_PERIOD, gap_taxels, held_squares, step_gap
from padgen.driver.ear.motion import HeardTaxel, answer, grid, lines_needed, move, periodic_states
from padgen.driver.ear.score import Score
from padgen.driver.ear.tally import Span, Tally
from padgen.planner.channels import hanging_gap_um
from padgen.planner.plan import Plan

__all__ = ["CoilHeard", "Found", "Played", "listen"]

MOST_ANSWERS = 64
"""Tables of answers that are kept: coils share their kinds of taxels."""
GAP_MEMORY = 1 << 25
"""Numbers of i² that are held at a time when taxels are stepped."""
GAP_TAUS = 5.0
"""Time constants in which a loop that is stepped comes to rest, from where it would be without the gap."""
MOST_GAP_STEPS = 1 << 20
"""Steps for that, at most."""


class Played(Protocol):
    """A WAV file, as `padgen.driver.wav_file.Wave`, or samples from elsewhere."""

    @property
    def rate_hz(self) -> int:
        """Samples per second."""

    @property
    def channels(self) -> int:
        """How many channels there are."""

    @property
    def count(self) -> int:
        """Samples of each."""

    def channel(self, index: int) -> np.ndarray:
        """The samples (count,) of one, full scale 1."""


@dataclass(frozen=True, slots=True)
class CoilHeard:
    """What flows in one coil over the whole file; `signal_peak`, `signal_mean` in V, or A if the file holds that."""

    coil: tuple[int, int]
    peak_a: float
    rms_a: float
    copper_loss_w: float
    signal_peak: float
    signal_mean: float


class Found(NamedTuple):
    """Figures of `Heard`, (h, n) and (n,) in SI units, and the coils'."""

    level_m: np.ndarray
    tone_m: np.ndarray
    peak_m: np.ndarray
    rise_s: np.ndarray
    pulled_in: np.ndarray
    coils: tuple[CoilHeard, ...]


class _Lap(NamedTuple):
    """i² of one stretch; `listens` tells whether it is the last time through the file, `ends` that the file ends."""

    stretch: Stretch
    squared: Squared
    listens: bool
    ends: bool


def listen(
    plan: Plan, wave: Played, score: Score, spans: tuple[Span, ...], taxels: Sequence[HeardTaxel], gap: bool, where: str
) -> Found:
    """Every taxel in every span; `gap` tells to step them in time, with the pull that grows as it closes.

    Raises
    ------
    FileError
        A sample is not a number.
    """
    coil = plan.spec.coil
    circuit = Circuit(coil.resistance_ohm, coil.inductance_mh * MH, score.by_voltage)
    ear: _Ear = _GapEar(score, taxels, spans, *_gaps(plan)) if gap else _Ear(score, taxels, spans)
    coils = []
    for k in range(score.channels):
        signal = wave.channel(k) * score.full_scale
        if not np.isfinite(signal).all():
            raise FileError(f"has samples in channel {k} that are no numbers", where)
        square, peak = 0.0, 0.0
        for lap in _laps(signal, score, circuit):
            ear.hear(k, lap)
            if lap.listens:
                square += lap.squared.mean_square_a2 * (lap.stretch.stop - lap.stretch.start) / len(signal)
                peak = max(peak, lap.squared.peak_a)
        loss, volts = square * circuit.resistance_ohm, float(np.abs(signal).max(initial=0.0))
        coils.append(CoilHeard(score.coils[k], peak, float(np.sqrt(square)), loss, volts, float(signal.mean())))
    return ear.found(tuple(coils))


def _gaps(plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Gaps in m below the washers as they hang, and how the pulls grow, both (taxels,)."""
    own = [plan.channels[taxel.channel] for taxel in plan.taxels]
    sag_um = np.array([channel.sag_um for channel in own])
    return hanging_gap_um(plan.spec, sag_um) * UM, np.array([channel.pull_exponent for channel in own])


def _laps(signal: np.ndarray, score: Score, circuit: Circuit) -> Iterator[_Lap]:
    """A coil's i², stretch by stretch; a loop of several is gone through twice, to come to rest."""
    parts, enters_a = stretches(len(signal), score.loops), 0.0
    rounds = 2 if score.loops and not parts[0].repeats else 1
    for lap in range(rounds):
        for part in parts:
            squared = squared_current(_cut(signal, part, score.loops), part, score.rate_hz, circuit, enters_a)
            enters_a = squared.leaves_a
            yield _Lap(part, squared, lap == rounds - 1, part is parts[-1])


def _cut(signal: np.ndarray, part: Stretch, loops: bool) -> np.ndarray:
    """The samples (size,) of a stretch with its guards, from the loop's other end or silence where there are none."""
    if part.repeats:
        return signal
    cut, first, last = np.zeros(part.size), part.start - part.lead, part.stop + part.lead
    if loops:
        cut[: last - first] = np.take(signal, np.arange(first, last), mode="wrap")
    else:
        low, high = max(first, 0), min(last, len(signal))
        cut[low - first : high - first] = signal[low:high]
    return cut


class _Ear:
    """Levels of all taxels, coil after coil; their modes are linear."""

    def __init__(self, score: Score, taxels: Sequence[HeardTaxel], spans: tuple[Span, ...]) -> None:
        self.score, self.taxels, self.spans = score, taxels, spans
        self.own = [np.flatnonzero(score.channel == k).tolist() for k in range(score.channels)]
        self.tallies = [Tally(spans, score.line_hz[which]) if len(which) else None for which in self.own]
        self.pulled_in = np.zeros(len(taxels), bool)
        self._state: list[np.ndarray] = []
        self._answers: dict[tuple[int, int, int], np.ndarray] = {}

    def hear(self, coil: int, lap: _Lap) -> None:
        """Take in a stretch of a coil's i²."""
        tally, which = self.tallies[coil], self.own[coil]
        if tally is None:
            return
        if lap.stretch.start == 0 and (not self.score.loops or not lap.listens or lap.stretch.repeats):
            self._state = [np.zeros(len(self.taxels[i].pole), complex) for i in which]
        step_hz = self.score.rate_hz / lap.stretch.size
        needed = lines_needed([self.taxels[i] for i in which], lap.squared.lines, step_hz)
        lines, at = lap.squared.lines[:needed], grid(lap.stretch, self.score.rate_hz, needed)
        if lap.listens:
            start_s = lap.stretch.start / self.score.rate_hz
            tally.begin(start_s + at.first_s, at.step_s, at.own.stop - at.own.start)
        for k, i in enumerate(which):
            moved = move(self.taxels[i], self._answer(i, needed, step_hz, lap), lines, lap.stretch, at, self._state[k])
            self._state[k] = moved.state
            if lap.listens:
                tally.add(k, moved.felt_m)
        if lap.ends and not lap.listens:  # the state of endless rounds, from the one after the first
            seconds = self.score.count / self.score.rate_hz
            poles = [self.taxels[i].pole for i in which]
            self._state = [y / -np.expm1(p * seconds) for y, p in zip(self._state, poles, strict=True)]

    def _answer(self, taxel: int, needed: int, step_hz: float, lap: _Lap) -> np.ndarray:
        key = id(self.taxels[taxel]), needed, lap.stretch.size
        if key not in self._answers:
            if len(self._answers) >= MOST_ANSWERS:
                self._answers.clear()
            self._answers[key] = answer(self.taxels[taxel], step_hz * np.arange(needed))
        return self._answers[key]

    def found(self, coils: tuple[CoilHeard, ...]) -> Found:
        """All figures, when all has been taken in."""
        shape = len(self.spans), len(self.taxels)
        found = Found(np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape), self.pulled_in, coils)
        for which, tally in zip(self.own, self.tallies, strict=True):
            if tally is not None:
                parts = tally.level_m(), tally.tone_m(), tally.peak_m, tally.rise_s()
                for all_taxels, part in zip(found[:4], parts, strict=True):
                    all_taxels[:, which] = part
        return found


class _GapEar(_Ear):
    """As `_Ear`, the pull growing as the gap closes: i² is gathered, then the taxels of many coils stepped at once."""

    def __init__(
        self,
        score: Score,
        taxels: Sequence[HeardTaxel],
        spans: tuple[Span, ...],
        gap_m: np.ndarray,
        exponent: np.ndarray,
    ) -> None:
        super().__init__(score, taxels, spans)
        self._gap_m, self._exponent = gap_m, exponent
        self._per_s = STEPS_PER_PERIOD * float(score.line_hz.max())
        self._squares: dict[int, list[np.ndarray]] = {}
        self._start: dict[int, np.ndarray] = {}
        self._step_s = 0.0

    def hear(self, coil: int, lap: _Lap) -> None:
        if self.tallies[coil] is None or not lap.listens:
            return
        at = grid(lap.stretch, self.score.rate_hz, 0, self._per_s)
        step_hz = self.score.rate_hz / lap.stretch.size
        square = held_squares(lap.squared.lines, at.points, 1 / at.step_s, step_hz)
        self._squares.setdefault(coil, []).append(square[at.own])
        self._step_s = at.step_s
        if lap.stretch.repeats:
            for i in self.own[coil]:
                lines = lap.squared.lines[: at.points // 2]
                each = self._answer(i, len(lines), step_hz, lap) * lines
                self._start[i] = periodic_states(self.taxels[i], each, step_hz, (0.0,))[0]
        if lap.ends and sum(len(part) for parts in self._squares.values() for part in parts) > GAP_MEMORY:
            self._step()

    def found(self, coils: tuple[CoilHeard, ...]) -> Found:
        self._step()
        return super().found(coils)

    def _step(self) -> None:
        """Step the taxels of all coils that were gathered."""
        if not self._squares:
            return
        squares = np.stack([np.concatenate(parts) for parts in self._squares.values()], 1)
        which = [i for coil in self._squares for i in self.own[coil]]
        column = np.repeat(np.arange(len(self._squares)), [len(self.own[coil]) for coil in self._squares])
        taxels = [self.taxels[i] for i in which]
        stepped = gap_taxels(taxels, self._gap_m[which], self._exponent[which], self._step_s)
        state = np.zeros(stepped.keep.shape, complex)
        for row, i in enumerate(which):
            starts = self._start.pop(i, np.zeros(0))
            state[row, : len(starts)] = starts / self.taxels[i].omega[: len(starts)] ** 2
        for _ in range(self._rounds(taxels, len(squares))):
            for _ in step_gap(stepped, squares, column, self.score.loops, state):
                pass
        self._listen(which, step_gap(stepped, squares, column, self.score.loops, state))
        self._squares = {}

    def _rounds(self, taxels: Sequence[HeardTaxel], steps: int) -> int:
        """How often a loop is gone through before it is listened to."""
        if not self.score.loops:
            return 0
        slowest_s = max(taxel.q / (np.pi * float(taxel.frequency_hz.min())) for taxel in taxels)
        return min(int(np.ceil(GAP_TAUS * slowest_s / (steps * self._step_s))), max(MOST_GAP_STEPS // steps, 1))

    def _listen(self, which: list[int], blocks: Iterator[tuple[np.ndarray, np.ndarray]]) -> None:
        """Add what blocks of steps let taxels `which` be felt."""
        gathered = []
        for felt_m, pulled_in in blocks:
            self.pulled_in[which] |= pulled_in
            gathered.append(felt_m)
        felt_m, row = np.concatenate(gathered, axis=2), 0
        for coil in self._squares:
            tally = self.tallies[coil]
            assert tally is not None
            tally.begin(0.0, self._step_s, felt_m.shape[2])
            for k in range(len(self.own[coil])):
                tally.add(k, felt_m[row])
                row += 1
