"""How strongly taxels vibrate in each span of a file: levels over whole periods, and their course.

A *level* is √2 times the root mean square of what is felt, without its mean: for one line its amplitude, for
several the root of the sum of their squares, as the plan adds them. It is taken over the last whole period of the
comb in a hold, in which all lines are orthogonal; in a hold shorter than that, over what has settled of it, with a
Hann window, whose error is that of lines nearer to each other than two over its length.

The *course* is the same figure in a Hann window of `COURSE_PERIODS` periods of the coil's lowest line, less a
parabola: what moves with the mean pull is no vibration. Where the channels take turns, a frame's level is the
largest of its course, reached in the slot of an ON taxel, anywhere in the frame for one that is OFF.
"""

from typing import NamedTuple

import numpy as np

__all__ = ["COURSE_PERIODS", "Span", "Tally"]

COURSE_PERIODS = 4.0
RISEN = 0.9
"""Share of its last level at which a taxel counts as switched on."""


class Span(NamedTuple):
    """One state in the file: switching begins at `begin_s`, it is held from `start_s` to `stop_s`.

    Levels are taken from `window_s` on, over a `whole` number of the comb's periods or not. `in_turns` tells that
    it is a frame of slots. `levels` (taxels,) are shares of the ON amplitudes.
    """

    begin_s: float
    start_s: float
    stop_s: float
    window_s: float
    whole: bool
    in_turns: bool
    levels: np.ndarray


class _Window(NamedTuple):
    """The points of one stretch that are in a span's window, with weights that sum to its share of it."""

    span: int
    points: slice
    weight: np.ndarray
    time_s: np.ndarray


class Tally:
    """Sums of one coil's taxels (n,) over spans (h,)."""

    def __init__(self, spans: tuple[Span, ...], line_hz: np.ndarray) -> None:
        shape = len(spans), len(line_hz)
        self.spans, self.line_hz = spans, line_hz
        self.mean, self.square = np.zeros((*shape, 3)), np.zeros((*shape, 3))
        self.tone = np.zeros((*shape, 3), complex)
        self.peak_m = np.zeros(shape)
        self._course: list[list[np.ndarray]] = [[] for _ in line_hz]
        self._course_s: list[np.ndarray] = []
        self._windows: list[_Window] = []
        self._held: list[tuple[int, slice]] = []

    def begin(self, first_s: float, step_s: float, count: int) -> None:
        """What is added next are points of a stretch, `count` from `first_s` on."""
        self._windows, self._held = [], []
        for k, span in enumerate(self.spans):
            held = _points(first_s, step_s, count, span.begin_s, span.stop_s)
            if held.stop > held.start:
                self._held.append((k, held))
            points = _points(first_s, step_s, count, span.window_s, span.stop_s)
            if points.stop > points.start:
                self._windows.append(_window(k, span, points, first_s, step_s))
        self._lay_course(first_s, step_s, count)

    def _lay_course(self, first_s: float, step_s: float, count: int) -> None:
        width = max(min(round(COURSE_PERIODS / float(self.line_hz.min()) / step_s), count), 4)
        starts = np.append(np.arange(0, max(count - width, 0), max(width // 2, 1)), max(count - width, 0))
        at = (np.arange(width) + 0.5) / width - 0.5
        weight = np.cos(np.pi * at) ** 2
        root = np.sqrt(weight / weight.sum())
        basis = np.linalg.qr(root[:, None] * at[:, None] ** np.arange(3))[0]
        self._slices, self._root, self._basis = starts, root, basis
        self._course_s.append(first_s + (starts + width / 2) * step_s)

    def add(self, taxel: int, felt_m: np.ndarray) -> None:
        """The motion (3, count) of a taxel over the stretch."""
        for k, points in self._held:
            largest = float(np.abs(felt_m[0, points]).max())
            self.peak_m[k, taxel] = max(self.peak_m[k, taxel], largest)
        for span, points, weight, time_s in self._windows:
            part = felt_m[:, points]
            self.mean[span, taxel] += part @ weight
            self.square[span, taxel] += (part * part) @ weight
            self.tone[span, taxel] += part @ (weight * np.exp(-2j * np.pi * self.line_hz[taxel] * time_s))
        self._course[taxel].append(self._course_of(felt_m))

    def _course_of(self, felt_m: np.ndarray) -> np.ndarray:
        width = len(self._root)
        if felt_m.shape[1] < width:
            return np.zeros(len(self._slices))
        every = np.lib.stride_tricks.sliding_window_view(felt_m, width, axis=1)
        parts = every[:, self._slices] * self._root
        energy = (parts * parts).sum((0, 2)) - ((parts @ self._basis) ** 2).sum((0, 2))
        return np.asarray(np.sqrt(2 * np.maximum(energy, 0.0)))

    def level_m(self) -> np.ndarray:
        """Felt levels (h, n); in turns, the largest of the course."""
        level: np.ndarray = np.sqrt(2 * np.maximum((self.square - self.mean**2).sum(-1), 0.0))
        course, time_s = self.course()
        for k, span in enumerate(self.spans):
            if span.in_turns:
                inside = (time_s > span.start_s) & (time_s <= span.stop_s)
                level[k] = course[:, inside].max(1, initial=0.0)
        return level

    def tone_m(self) -> np.ndarray:
        """Felt amplitudes (h, n) of each taxel's own line; in turns, the level."""
        tone: np.ndarray = 2 * np.sqrt((np.abs(self.tone) ** 2).sum(-1))
        turns = np.array([span.in_turns for span in self.spans], bool)
        return np.where(turns[:, None], self.level_m(), tone)

    def course(self) -> tuple[np.ndarray, np.ndarray]:
        """Felt amplitudes (n, t) in m in the course of the file, and their times (t,)."""
        return np.array([np.concatenate(parts) for parts in self._course]), np.concatenate(self._course_s)

    def rise_s(self) -> np.ndarray:
        """Time (h, n) from when switching begins until a taxel has nine tenths of its level; NaN where it never has."""
        level, (course, time_s) = self.level_m(), self.course()
        rise = np.full(level.shape, np.nan)
        for k, span in enumerate(self.spans):
            after = np.flatnonzero(time_s > span.begin_s)
            risen = course[:, after] >= RISEN * level[k][:, None]
            found = risen.any(1) & (level[k] > 0)
            rise[k, found] = time_s[after[risen.argmax(1)[found]]] - span.begin_s
        return rise


def _points(first_s: float, step_s: float, count: int, start_s: float, stop_s: float) -> slice:
    """Points of which some of the time until the next is within a span."""
    low = int(np.floor((start_s - first_s) / step_s + 1e-9))
    high = int(np.ceil((stop_s - first_s) / step_s - 1e-9))
    return slice(min(max(low, 0), count), min(max(high, 0), count))


def _window(k: int, span: Span, points: slice, first_s: float, step_s: float) -> _Window:
    time_s = first_s + step_s * np.arange(points.start, points.stop)
    length = span.stop_s - span.window_s
    inside = np.minimum(time_s + step_s, span.stop_s) - np.maximum(time_s, span.window_s)
    weight = np.clip(inside, 0.0, step_s) / length
    if not span.whole:
        weight *= 2 * np.sin(np.pi * np.clip((time_s + step_s / 2 - span.window_s) / length, 0.0, 1.0)) ** 2
    return _Window(k, points, weight, time_s)
