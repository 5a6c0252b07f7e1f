"""What was heard, as plain data: rows, a summary, findings."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from padgen.core.errors import at_least, number
from padgen.core.finding import Finding
from padgen.driver.ear.heard import Heard

__all__ = ["MISSED_DB", "HeardRow", "HeardSummary", "ear_findings", "heard_rows", "heard_summary", "heard_table"]

MISSED_DB = 0.5
"""How far an ON taxel may be from its level without a finding."""


@dataclass(frozen=True, slots=True)
class HeardRow:
    """One coil in one span of the file, which is heard until `until_s`.

    `state` has a sign for every taxel, the lowest channel first: 1 is ON, 0 is OFF, + in between. `on_db` is the
    smallest ON level, over what that taxel is to have there, `off_db` the loudest OFF level over the taxel's own ON
    level; None where there is none, -inf is silence.
    """

    until_s: float
    coil: tuple[int, int]
    state: str
    on_db: float | None
    on_taxel: str
    off_db: float | None
    off_taxel: str
    selectivity_db: float | None
    settled: bool


@dataclass(frozen=True, slots=True)
class HeardSummary:
    """The file in a few numbers; None where no taxel is ON, or OFF.

    `tone_low_db`, `tone_high_db`: how far ON taxels' own lines are off what they are to be. `rise_s` is the slowest
    switching on, `peak_um` the largest motion of a washer, both of all taxels; currents and losses are of the coil
    that has most.
    """

    smallest_on_db: float | None
    loudest_off_db: float | None
    selectivity_db: float | None
    tone_low_db: float | None
    tone_high_db: float | None
    rise_s: float | None
    peak_um: float
    peak_a: float
    rms_a: float
    copper_loss_w: float
    signal_peak: float
    signal_mean: float
    all_settled: bool


def heard_summary(heard: Heard) -> HeardSummary:
    """What `heard` comes to."""
    tone = _tone_db(heard)
    return HeardSummary(
        smallest_on_db=_largest(-_db(heard.on), -1.0),
        loudest_off_db=_largest(_db(heard.off)),
        selectivity_db=heard.selectivity_db,
        tone_low_db=_largest(-tone, -1.0),
        tone_high_db=_largest(tone),
        rise_s=_largest(heard.rise_s),
        peak_um=float(heard.peak_um.max(initial=0.0)),
        peak_a=max(coil.peak_a for coil in heard.coils),
        rms_a=max(coil.rms_a for coil in heard.coils),
        copper_loss_w=max(coil.copper_loss_w for coil in heard.coils),
        signal_peak=max(coil.signal_peak for coil in heard.coils),
        signal_mean=max((coil.signal_mean for coil in heard.coils), key=abs),
        all_settled=bool(heard.settled.all()),
    )


def heard_table(heard: Heard) -> dict[str, Any]:
    """All of it for a JSON file: summary, coils, rows, and the levels of every taxel in every span."""
    return {
        "name": heard.name,
        "with_gap": heard.with_gap,
        "asked_db": heard.asked_db,
        "summary": asdict(heard_summary(heard)),
        "coils": [asdict(coil) for coil in heard.coils],
        "rows": [asdict(row) for row in heard_rows(heard)],
        "taxels": list(heard.ids),
        "wanted_um": heard.wanted_um.tolist(),
        "spans": [
            {
                "start_s": span.start_s,
                "stop_s": span.stop_s,
                "heard_from_s": span.window_s,
                "whole_periods": span.whole,
                "in_turns": span.in_turns,
                "levels": span.levels.tolist(),
                "level_um": heard.level_um[h].tolist(),
                "tone_um": heard.tone_um[h].tolist(),
                "peak_um": heard.peak_um[h].tolist(),
                "rise_s": heard.rise_s[h].tolist(),
                "settled": heard.settled[h].tolist(),
            }
            for h, span in enumerate(heard.spans)
        ],
    }


def heard_rows(heard: Heard) -> tuple[HeardRow, ...]:
    """A row for every coil that has taxels in every span, in the order of the file."""
    on, off = _db(heard.on), _db(heard.off)
    own = [np.flatnonzero(heard.coil_of == k) for k in range(len(heard.coils))]
    # The lowest channel is the lowest line.
    own = [which[np.argsort(heard.line_hz[which], kind="stable")] for which in own]
    return tuple(
        _row(heard, h, k, which, on[h, which], off[h, which])
        for h in range(len(heard.spans))
        for k, which in enumerate(own)
        if len(which)
    )


def _row(heard: Heard, h: int, coil: int, which: np.ndarray, on_db: np.ndarray, off_db: np.ndarray) -> HeardRow:
    span = heard.spans[h]
    signs = "".join("0" if level <= 0 else "1" if level > 1 - 1e-9 else "+" for level in span.levels[which])
    smallest = None if np.isnan(on_db).all() else int(np.nanargmin(on_db))
    loudest = None if np.isnan(off_db).all() else int(np.nanargmax(off_db))
    both = smallest is not None and loudest is not None
    return HeardRow(
        until_s=span.stop_s,
        coil=heard.coils[coil].coil,
        state=signs,
        on_db=None if smallest is None else float(on_db[smallest]),
        on_taxel="" if smallest is None else heard.ids[which[smallest]],
        off_db=None if loudest is None else float(off_db[loudest]),
        off_taxel="" if loudest is None else heard.ids[which[loudest]],
        selectivity_db=float(on_db[smallest] - off_db[loudest]) if both else None,
        settled=bool(heard.settled[h, which].all()),
    )


def ear_findings(heard: Heard, where: str = "drive.wav") -> tuple[Finding, ...]:
    """What is wrong with what was heard in the file called `where`."""
    return tuple(_findings(heard, where))


def _findings(heard: Heard, where: str) -> Iterator[Finding]:
    if heard.pulled_in.any():
        which = heard.ids[int(heard.pulled_in.argmax())]
        yield Finding(
            "error",
            "ear.pull_in",
            which,
            f"is pulled onto its coil by {where}, as {int(heard.pulled_in.sum())} of {len(heard.ids)} taxels are;"
            " a lower drive.level_um or a wider coil.gap_mm would do",
        )
    yield from _missed(heard)
    asked, kept = heard.asked_db, heard.selectivity_db
    if kept is not None and kept < asked:
        h, i = np.unravel_index(int(np.nanargmax(heard.off)), heard.off.shape)
        yield Finding(
            "warning",
            "ear.selectivity",
            where,
            f"keeps {kept:.1f} dB between the smallest ON and the loudest OFF taxel, {heard.ids[i]} in the state that"
            f" ends at {number(heard.spans[h].stop_s)} s; asked: {asked:.1f} dB (Δy)",
        )
    yield from _hurried(heard, where)


def _missed(heard: Heard) -> Iterator[Finding]:
    tone = _tone_db(heard)
    missed = np.abs(tone) > MISSED_DB
    if not missed.any():
        return
    h, i = np.unravel_index(int(np.nanargmax(np.abs(tone))), tone.shape)
    span, share = heard.spans[h], heard.spans[h].levels[i]
    cure = "frames that last longer" if span.in_turns or not heard.settled[h, i] else "padgen retune, or a lower level,"
    yield Finding(
        "warning",
        "ear.level",
        heard.ids[i],
        f"is to be felt with {number(share * heard.wanted_um[i])} µm in the state that ends at {number(span.stop_s)} s,"
        f" has {number(heard.tone_um[h, i])} µm ({tone[h, i]:+.1f} dB), at most {MISSED_DB:g} dB off is meant, which"
        f" {int(missed.sum())} of {int((heard.shares > 0).sum())} ON levels miss; {cure} would do",
    )


def _hurried(heard: Heard, where: str) -> Iterator[Finding]:
    late = ~heard.settled.all(1)
    if late.any():
        span = heard.spans[int(late.argmax())]
        held_s = span.stop_s - span.start_s
        yield Finding(
            "warning",
            "ear.unsettled",
            where,
            f"holds the state that ends at {number(span.stop_s)} s for {number(held_s)} s, too short"
            " for taxels to come within 0.1 dB of their levels"
            f" ({int(late.sum())} of {len(heard.spans)} states are);"
            f" {at_least(heard.needs_s)} s after each switch would do",
        )
    if any(not span.whole and not span.in_turns for span in heard.spans):
        yield Finding(
            "note",
            "ear.window",
            where,
            f"holds states for less than the comb's period of {number(heard.period_s)} s, so that their levels are"
            " means over a part of it and lines close to each other are not told apart",
        )


def _tone_db(heard: Heard) -> np.ndarray:
    """Own lines (h, n) of ON taxels over what they are to be, in dB; NaN for OFF ones."""
    wanted = heard.shares * heard.wanted_um
    return _db(np.divide(heard.tone_um, wanted, out=np.full(wanted.shape, np.nan), where=wanted > 0))


def _db(ratio: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return np.asarray(20 * np.log10(ratio))


def _largest(values: np.ndarray, sign: float = 1.0) -> float | None:
    """The largest that is a number, times `sign`; None where none is."""
    return None if np.isnan(values).all() else sign * float(np.nanmax(values))
