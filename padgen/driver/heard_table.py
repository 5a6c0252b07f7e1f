"""What was heard, as plain data and as findings."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from padgen.core.errors import at_least, number
from padgen.core.finding import Finding
from padgen.driver.ear import Heard

__all__ = ["MISSED_DB", "ear_findings", "heard_table"]

MISSED_DB = 0.5
"""How far an ON taxel may be from its level without a finding."""


def heard_table(heard: Heard) -> dict[str, Any]:
    """All of it for a JSON file: summary, coils, rows, and the levels of every taxel in every span.

    In the summary `tone_low_db`, `tone_high_db` are how far ON taxels' own lines are off what they are to be, `rise_s`
    is the slowest switching on, `peak_um` the largest motion of a washer; currents and losses are of the coil that has
    most; None where no taxel is ON, or OFF.
    """
    return {
        "name": heard.name,
        "with_gap": heard.with_gap,
        "asked_db": heard.asked_db,
        "summary": _summary(heard),
        "coils": list(heard.coils),
        "rows": list(_rows(heard)),
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


def _summary(heard: Heard) -> dict[str, Any]:
    tone, most = _tone_db(heard), {}
    for figure in ("peak_a", "rms_a", "copper_loss_w", "signal_peak", "signal_mean"):
        most[figure] = max((coil[figure] for coil in heard.coils), key=abs)
    return {
        "smallest_on_db": _largest(-_db(heard.on), -1.0),
        "loudest_off_db": _largest(_db(heard.off)),
        "selectivity_db": heard.selectivity_db,
        "tone_low_db": _largest(-tone, -1.0),
        "tone_high_db": _largest(tone),
        "rise_s": _largest(heard.rise_s),
        "peak_um": float(heard.peak_um.max()),
        **most,
        "all_settled": bool(heard.settled.all()),
    }


def _rows(heard: Heard) -> Iterator[dict[str, Any]]:
    """A row for every coil that has taxels in every span, in the order of the file.

    `state` has a sign for every taxel, the lowest line first: 1 is ON, 0 is OFF, + in between. `on_db` is the smallest
    ON level, over what that taxel is to have there, `off_db` the loudest OFF level over the taxel's own ON level; None
    where there is none, -inf is silence.
    """
    on, off = _db(heard.on), _db(heard.off)
    by_line = np.argsort(heard.line_hz, kind="stable")
    for h, span in enumerate(heard.spans):
        for k in np.unique(heard.coil_of).tolist():
            which = by_line[heard.coil_of[by_line] == k]
            quietest = min((i for i in which if span.levels[i] > 0), key=on[h].__getitem__, default=None)
            loudest = max((i for i in which if span.levels[i] <= 0), key=off[h].__getitem__, default=None)
            on_db = None if quietest is None else float(on[h, quietest])
            off_db = None if loudest is None else float(off[h, loudest])
            yield {
                "until_s": span.stop_s,
                "coil": heard.coils[k]["coil"],
                "state": "".join("0" if x <= 0 else "1" if x > 1 - 1e-9 else "+" for x in span.levels[which]),
                "on_db": on_db,
                "on_taxel": "" if quietest is None else heard.ids[quietest],
                "off_db": off_db,
                "off_taxel": "" if loudest is None else heard.ids[loudest],
                "selectivity_db": None if on_db is None or off_db is None else on_db - off_db,
                "settled": bool(heard.settled[h, which].all()),
            }


def ear_findings(heard: Heard, where: str = "drive.wav") -> tuple[Finding, ...]:
    """What is wrong with what was heard in the file called `where`."""
    return tuple(_findings(heard, where))


def _findings(heard: Heard, where: str) -> Iterator[Finding]:
    if heard.pulled_in.any():
        told = (
            f"is pulled onto its coil by {where}, as {int(heard.pulled_in.sum())} of {len(heard.ids)} taxels are;"
            " a lower drive.level_um or a wider coil.gap_mm would do"
        )
        yield Finding("error", "ear.pull_in", heard.ids[int(heard.pulled_in.argmax())], told)
    tone = _tone_db(heard)
    missed = np.abs(tone) > MISSED_DB
    if missed.any():
        h, i = np.unravel_index(int(np.nanargmax(np.abs(tone))), tone.shape)
        span, hurried = heard.spans[h], heard.spans[h].in_turns or not heard.settled[h, i]
        told = (
            f"is to be felt with {number(span.levels[i] * heard.wanted_um[i])} µm in the state that ends at"
            f" {number(span.stop_s)} s, has {number(heard.tone_um[h, i])} µm ({tone[h, i]:+.1f} dB), at most"
            f" {MISSED_DB:g} dB off is meant, which {int(missed.sum())} of {int((heard.shares > 0).sum())} ON levels"
            f" miss; {'frames that last longer' if hurried else 'padgen retune, or a lower level,'} would do"
        )
        yield Finding("warning", "ear.level", heard.ids[i], told)
    asked, kept = heard.asked_db, heard.selectivity_db
    if kept is not None and kept < asked:
        h, i = np.unravel_index(int(np.nanargmax(heard.off)), heard.off.shape)
        told = (
            f"keeps {kept:.1f} dB between the smallest ON and the loudest OFF taxel, {heard.ids[i]} in the state that"
            f" ends at {number(heard.spans[h].stop_s)} s; asked: {asked:.1f} dB (Δy)"
        )
        yield Finding("warning", "ear.selectivity", where, told)
    late = ~heard.settled.all(1)
    if late.any():
        span = heard.spans[int(late.argmax())]
        told = (
            f"holds the state that ends at {number(span.stop_s)} s for {number(span.stop_s - span.start_s)} s, too"
            f" short for taxels to come within 0.1 dB of their levels ({int(late.sum())} of {len(heard.spans)} states"
            f" are); {at_least(heard.needs_s)} s after each switch would do"
        )
        yield Finding("warning", "ear.unsettled", where, told)
    if any(not span.whole and not span.in_turns for span in heard.spans):
        told = (
            f"holds states for less than the comb's period of {number(heard.period_s)} s, so that their levels are"
            " means over a part of it and lines close to each other are not told apart"
        )
        yield Finding("note", "ear.window", where, told)


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
