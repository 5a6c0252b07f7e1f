"""`Score`: what the sidecar of a WAV file says that it plays, checked against the plan; and the spans to listen to."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from padgen.core.errors import FileError, number
from padgen.driver.ear.tally import COURSE_PERIODS, Span
from padgen.physics.selectivity import Scheme
from padgen.planner.plan import Plan

__all__ = ["SETTLED_TAUS", "Score", "read_score", "score_spans"]

SETTLED_TAUS = 4.5
"""Time constants in which a vibration comes within 0.1 dB of its last level: ``1 − e^-4.5`` is −0.1 dB."""
SAME_LEVEL = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """What is played: sample 1 is `full_scale` V, or A unless `by_voltage`.

    Taxels (n,) in the plan's order: the `channel` of the file, the wanted line of i². Keyframes (k,): `time_s`,
    `levels` (k, n). `period_s` is the comb's.
    """

    rate_hz: int
    count: int
    channels: int
    full_scale: float
    by_voltage: bool
    loops: bool
    in_turns: bool
    period_s: float
    coils: tuple[tuple[int, int], ...]
    channel: np.ndarray
    line_hz: np.ndarray
    time_s: np.ndarray
    levels: np.ndarray


def read_score(sidecar: Mapping[str, Any], plan: Plan, where: str = "drive-wave.json") -> Score:
    """The score of a sidecar (`padgen.driver.formats.wav`).

    Raises
    ------
    FileError
        It is none, or one of another plan.
    """
    try:
        score = _read(sidecar)
        named = [str(entry["id"]) for entry in sidecar["taxels"]]
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(f"does not tell what a WAV file plays ({type(error).__name__}: {error})", where) from error
    planned = [taxel.id for taxel in plan.taxels]
    if named != planned:
        raise FileError(
            f"is of {len(named)} taxels of {sidecar.get('name')!r}, not of the {len(planned)} of {plan.name!r}", where
        )
    coils = [taxel.coil for taxel in plan.taxels]
    if any(
        not 0 <= k < len(score.coils) or score.coils[k] != coil for k, coil in zip(score.channel, coils, strict=True)
    ):
        raise FileError(f"has taxels at other coils than {plan.name!r}", where)
    _refuse(score, len(planned), where)
    return score


def _read(sidecar: Mapping[str, Any]) -> Score:
    frames, taxels = sidecar["keyframes"], sidecar["taxels"]
    coils = sorted(sidecar["coils"], key=lambda entry: int(entry["wav_channel"]))
    return Score(
        rate_hz=int(sidecar["rate_hz"]),
        count=int(sidecar["count"]),
        channels=len(coils),
        full_scale=float(sidecar["full_scale"]),
        by_voltage={"voltage": True, "current": False}[sidecar["signal"]],
        loops=bool(sidecar["loops"]),
        in_turns=Scheme(sidecar["scheme"]).takes_turns,
        period_s=float(sidecar["period_s"]),
        coils=tuple((int(entry["coil"][0]), int(entry["coil"][1])) for entry in coils),
        channel=np.array([int(entry["wav_channel"]) for entry in taxels], int),
        line_hz=np.array([float(entry["force_hz"]) for entry in taxels]),
        time_s=np.array([float(frame["time_s"]) for frame in frames]),
        levels=np.array([[float(level) for level in frame["levels"]] for frame in frames]),
    )


def _refuse(score: Score, taxels: int, where: str) -> None:
    for name, value in (("rate_hz", score.rate_hz), ("full_scale", score.full_scale), ("period_s", score.period_s)):
        if not (isfinite(value) and value > 0):
            raise FileError(f"{name} must be above 0, got {number(value)}", where)
    if not (score.line_hz > 0).all() or not np.isfinite(score.line_hz).all():
        raise FileError("force_hz of every taxel must be above 0", where)
    if score.levels.shape != (len(score.time_s), taxels) or len(score.time_s) < 2:
        raise FileError(f"must have two keyframes or more of {taxels} levels each", where)
    rises = np.isfinite(score.time_s).all() and (np.diff(score.time_s) > 0).all() and score.time_s[0] >= 0
    if not rises or abs(score.time_s[-1] - score.count / score.rate_hz) > 1.5 / score.rate_hz:
        raise FileError(
            f"must have keyframes that rise to the end of the file at {number(score.count / score.rate_hz)} s", where
        )
    if not ((score.levels >= 0) & (score.levels <= 1)).all():
        raise FileError("must have levels of 0 … 1", where)


def score_spans(score: Score, slots: int, tau_s: float) -> tuple[Span, ...]:
    """The states that are held; where channels take turns, frames of so many `slots`, unless all is one state.

    `tau_s` is the slowest taxel's time constant: windows begin, where they can, once it has settled.
    """
    if score.in_turns and len(score.time_s) > 2:
        return _frames(score, slots)
    return tuple(_window(score, span, tau_s) for span in _holds(score))


def _holds(score: Score) -> list[Span]:
    same = np.abs(np.diff(score.levels, axis=0)).max(1) <= SAME_LEVEL
    spans: list[Span] = []
    begin_s, merge = float(score.time_s[0]), False
    for k, held in enumerate(same.tolist()):
        start_s, stop_s = float(score.time_s[k]), float(score.time_s[k + 1])
        if held and merge:
            spans[-1] = spans[-1]._replace(stop_s=stop_s)
        elif held:
            spans.append(Span(begin_s, start_s, stop_s, start_s, False, False, score.levels[k]))
        if held:
            begin_s = stop_s
        merge = held
    return spans


def _window(score: Score, span: Span, tau_s: float) -> Span:
    """The last whole period of the comb; where there is none in the hold, what has settled of it, or half of it."""
    if span.stop_s - span.start_s >= score.period_s * (1 - 1e-6):
        return span._replace(window_s=span.stop_s - score.period_s, whole=True)
    slowest_s = COURSE_PERIODS / float(score.line_hz.min())
    window_s = max(span.start_s + SETTLED_TAUS * tau_s, span.start_s)
    if window_s > span.stop_s - slowest_s:
        window_s = max(min(span.stop_s - slowest_s, (span.start_s + span.stop_s) / 2), span.start_s)
    return span._replace(window_s=window_s)


def _frames(score: Score, slots: int) -> tuple[Span, ...]:
    """Frames of 2 · `slots` intervals; a taxel's level is the largest that it is given in the frame."""
    each = 2 * slots if (len(score.time_s) - 1) % (2 * slots) == 0 else 2
    edges = range(0, len(score.time_s) - each, each)
    return tuple(
        Span(
            float(score.time_s[k]),
            float(score.time_s[k]),
            float(score.time_s[k + each]),
            float(score.time_s[k]),
            False,
            True,
            score.levels[k : k + each + 1].max(0),
        )
        for k in edges
    )
