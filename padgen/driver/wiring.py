"""Find out which coil each amplifier output is connected to, from what is felt or recorded while it plays.

The pattern 'each' plays one taxel after the other. Where coils have two sets of resonances, an output that is connected
to a coil of the other set then moves nothing; so the pattern 'crossed' has each output play the tones of a neighbour,
which is of the other set. What an output then plays is named as its taxels are, with an x for the k: r0c0x0, r0c0x1.
"""

import csv
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from padgen.core.errors import FileError, Finding, SpecError
from padgen.core.registry import unknown_name
from padgen.driver.frames import CROSSED, read_text
from padgen.driver.waveform import CoilDrive, PadDrive
from padgen.planner.plan import Plan
from padgen.planner.printed_pads import coils_of

__all__ = ["crossed", "crossed_frames", "crossed_names", "wiring_findings"]

LARGEST_FELT = 1 << 24
"""Bytes of a table of what was felt."""
LEAST_HEARD = 1 / 3
"""Least answer of a taxel over the middle one's of its channel: coils around move it by a tenth at most."""
Coil = tuple[int, int]


def _neighbour(coil: Coil, rows: int, columns: int) -> Coil | None:
    """Return the adjacent coil with which `coil` forms a pair; None for the one left over on an odd-by-odd grid."""
    row, column = coil
    if column != columns - 1 or columns % 2 == 0:
        return row, column + 1 - 2 * (column % 2)
    if row != rows - 1 or rows % 2 == 0:
        return row + 1 - 2 * (row % 2), column
    return None


def crossed(plan: Plan, drive: PadDrive) -> PadDrive:
    """Return the drive in which each output plays the lines of its paired neighbour coil, or silence without one."""
    by_place = {(coil.row, coil.column): coil for coil in drive.coils}
    coils = []
    for place, coil in by_place.items():
        beside = _neighbour(place, plan.coils.rows, plan.coils.columns)
        played = replace(by_place[beside], row=coil.row, column=coil.column) if beside else _silenced(coil)
        coils.append(played)
    return replace(drive, coils=tuple(coils))


def _silenced(coil: CoilDrive) -> CoilDrive:
    lines = ("taxels", "force_hz", "harmonic", "line_a2", "phase_rad", "margin")
    return replace(coil, bias_a=0.0, **{name: getattr(coil, name)[:0] for name in lines})


def crossed_frames(plan: Plan) -> np.ndarray:
    """Return levels (k, taxels) of k frames, each playing one tone of one `crossed` output, its lowest tone first.

    Raises
    ------
    SpecError
        All coils of the pad have the same resonances, so that the pattern 'each' tells all.
    """
    if plan.coils.sets == 1:
        raise SpecError(
            f"{CROSSED!r} is for pads whose coils have two sets of resonances; those of {plan.name} are all alike, and"
            " 'each' tells where they are connected",
            "--pattern",
        )
    return np.eye(len(plan.taxels))[[taxel for _, _, taxel in _crossed_tones(plan)]]


def crossed_names(plan: Plan) -> tuple[str, ...]:
    """Return the name of the tone in each of `crossed_frames`: r0c0x1 is the second tone on coil r0c0's output."""
    return tuple(name for name, _, _ in _crossed_tones(plan))


def _crossed_tones(plan: Plan) -> list[tuple[str, Coil, int]]:
    """Return name, output's coil and taxel index of each tone of the pattern 'crossed', in the order of play."""
    taxels = coils_of(plan)
    tones = []
    for coil in sorted(taxels):
        beside = _neighbour(coil, plan.coils.rows, plan.coils.columns)
        for k, taxel in enumerate(taxels.get(beside, ()) if beside else ()):
            tones.append((f"r{coil[0]}c{coil[1]}x{k}", coil, taxel))
    return tones


def wiring_findings(plan: Plan, path: Path) -> list[Finding]:
    """Judge which coils are swapped, by a table ``played,felt`` of taxels; `felt` is empty where nothing was felt.

    A *played* with an x for the k is of the pattern 'crossed'. A WAV, or a folder of recordings named after taxels as
    `padgen.measured.read` reads them, tells it too: a taxel moves where it answers to its own coil's current about as
    the others of its channel do. Swapped leads of one coil cannot be felt and do no harm: it pulls with the square of
    its current.

    Raises
    ------
    FileError
        The file is no such table, or names a taxel that the pad does not have.
    """
    taxels = {taxel.id: taxel for taxel in plan.taxels}
    coil_of = {name: taxel.coil for name, taxel in taxels.items()}
    if plan.coils.sets > 1:
        coil_of |= {name: coil for name, coil, _ in _crossed_tones(plan)}
    # What was felt of each output's own tones, and of the other set's: the coil of each taxel that moved.
    played_own: dict[Coil, list[Coil | None]] = {}
    played_crossed: dict[Coil, list[Coil | None]] = {}
    findings = []
    heard = path.is_dir() or path.suffix.lower() in (".wav", ".wave")
    for row, (played, got) in (_recorded_rows if heard else _felt_rows)(plan, path):
        for name, known in ((played, coil_of), (got, taxels)):
            if name and name not in known:
                raise FileError(unknown_name(name, list(taxels), "taxel", "").message, f"{path}, row {row}")
        coil = coil_of[played]
        rows_of = played_own if played in taxels else played_crossed
        rows_of.setdefault(coil, []).append(taxels[got].coil if got else None)
        if got and got != played and taxels[got].coil == coil:
            sentence = (
                f"was felt as {got} of the same coil: the two resonances are exchanged, or {played} is far off its own;"
                " measure the print (padgen retune)"
            )
            findings.append(Finding("warning", "wiring.taxel", played, sentence))
    places: dict[Coil, Coil] = {}
    silent = []
    sense = "heard" if heard else "felt"
    for coil in played_own | played_crossed:
        answers = [tones.get(coil, []) for tones in (played_own, played_crossed)]
        at = sorted({place for tones in answers for place in tones if place})
        if not at:
            silent.append(coil)
            continue
        if len(at) > 1:
            tables = {"each": played_own, CROSSED: played_crossed}
            patterns = [pattern for pattern, tones in tables.items() if any(tones.get(coil, []))]
            sentence = (
                f"its taxels were felt at {' and '.join(map(_coil, at))}: play them again"
                f" (--pattern {' and '.join(patterns)}), and correct the table"
            )
            findings.append(Finding("error", "wiring.mixed", _coil(coil), sentence))
            continue
        places[coil] = at[0]
        # The coil where it is has one of the two sets; of the other nothing is to be felt.
        of_its_set = next(tones for tones in answers if any(tones))
        if None in of_its_set:
            count = f"{of_its_set.count(None)} of its {len(of_its_set)} taxels"
            sentence = f"{count} were not felt: are their washers glued in, and free?"
            findings.append(Finding("warning", "wiring.silent", _coil(coil), sentence))
    findings += _silent_findings(plan, silent, places, set(played_crossed), sense)
    findings += _moved_findings(plan, places)
    if untried := plan.coils.rows * plan.coils.columns - len(played_own):
        findings.append(Finding("note", "wiring.untried", "coils", f"{untried} of them are not in the table"))
    return findings


Rows = Iterator[tuple[int, tuple[str, str]]]


def _recorded_rows(plan: Plan, path: Path) -> Rows:
    """Yield (row number, (played taxel, felt taxel)) of each recording; felt is '' if the played taxel hardly moved."""
    from padgen.measured.fits import fitted
    from padgen.measured.read import read_measured

    measured = read_measured(path, plan)
    if any(getattr(part, "squared_current_a2", None) is None for part in measured.taxels):
        raise FileError("must hold the current of a coil and the motion of its taxel in every recording", str(path))
    channel = {taxel.id: taxel.channel for taxel in plan.taxels}
    size = {c.id: 0.0 if c.cause else float(np.abs(c.seen.data).max()) for c in fitted(measured, plan)[1]}
    for row, (name, heard_sizes) in enumerate(size.items(), start=1):
        usual = np.median([other for at, other in size.items() if other and channel[at] == channel[name]] or [0.0])
        yield row, (name, name if heard_sizes > LEAST_HEARD * usual else "")


def _felt_rows(plan: Plan, path: Path) -> Rows:
    lines = read_text(path, LARGEST_FELT, "a table of what was felt").splitlines()
    rows = [(k, [cell.strip() for cell in row]) for k, row in enumerate(csv.reader(lines), start=1) if any(row)]
    if rows and rows[0][1] == ["played", "felt"]:
        del rows[0]
    for k, row in rows:
        if len(row) != 2 or not row[0]:
            raise FileError(
                f"must have the taxel that was played and the one that was felt, has {len(row)} cells",
                f"{path}, row {k}",
            )
        yield k, (row[0], row[1])
    if not rows:
        raise FileError("has no rows of played,felt", str(path))


def _silent_findings(
    plan: Plan, silent: list[Coil], places: dict[Coil, Coil], other: set[Coil], sense: str
) -> Iterator[Finding]:
    """Yield what may be wrong with coils of which nothing was felt.

    `places` has the coil where each of the others was felt, `other` the coils whose outputs played 'crossed'.
    """
    sets = plan.coils.sets
    cure = "look at its wire, its plug and its amplifier channel"
    # Exchanged with a coil of the other set, an output's own tones move nothing; nor does a sensor at its own taxels
    # hear them wherever else they go.
    hidden = [coil for coil in silent if coil not in other and (sets > 1 or sense == "heard")]
    unlike = len(hidden) == 2 and sum(hidden[0]) % sets != sum(hidden[1]) % sets
    if len(silent) == len(hidden) == 2 and places and (unlike or sense == "heard"):
        sentence = "are the only silent ones: if both are connected, their plugs are exchanged"
        yield Finding("error", "wiring.swapped", " and ".join(map(_coil, silent)), sentence)
    elif sense == "felt" and hidden and not other:
        where = "all coils" if len(hidden) == plan.coils.rows * plan.coils.columns else ", ".join(map(_coil, hidden))
        sentence = (
            f"nothing was felt of {'them' if len(hidden) > 1 else 'it'}: plugs of coils with the two sets of resonances"
            f" may be exchanged; play --pattern {CROSSED} and add its rows to tell"
        )
        yield Finding("error", "wiring.hidden", where, sentence)
        silent = [coil for coil in silent if coil not in hidden]
    unreached = {taxel.coil for taxel in plan.taxels} - set(places.values())
    for coil in silent:
        sentence = f"nothing was {sense} when it was played: {cure}"
        if other and coil in hidden and len(unreached - {coil}) == 1:
            at = _coil(*(unreached - {coil}))
            sentence = f"nothing was felt when it was played: if it is connected, its plug is at {at}; else {cure}"
        yield Finding("error", "wiring.silent", _coil(coil), sentence)


def _moved_findings(plan: Plan, places: dict[Coil, Coil]) -> Iterator[Finding]:
    """Yield findings on misplaced plugs: one if all are in a wrong order, else one for each swapped pair or coil.

    `places` has the coil where each output was felt.
    """
    moved = {coil: at for coil, at in places.items() if at != coil}
    for wording, place in _whole_orders(plan.coils.rows, plan.coils.columns).items():
        if len(moved) > 2 and all(at == place(*coil) for coil, at in places.items()):
            yield Finding("error", "wiring.order", "coils", f"are all connected {wording}")
            return
    for coil, at in moved.items():
        if moved.get(at) != coil:
            wording = f"its amplifier channel is connected to {_coil(at)}"
            yield Finding("error", "wiring.swapped", _coil(coil), wording)
        elif coil < at:
            pair = f"{_coil(coil)} and {_coil(at)}"
            yield Finding("error", "wiring.swapped", pair, "are swapped: exchange their plugs")


def _whole_orders(rows: int, columns: int) -> dict[str, Callable[[int, int], Coil]]:
    """Return wrong ways to plug in all outputs, by description: functions from an output's (row, column) to coil."""
    count = rows * columns
    orders: dict[str, Callable[[int, int], Coil]] = {
        "in the opposite order, the last first": lambda r, c: (rows - 1 - r, columns - 1 - c),
        "with left and right exchanged, as seen from the coils' side": lambda r, c: (r, columns - 1 - c),
        "with the first row of coils at the top, where it belongs at the bottom": lambda r, c: (rows - 1 - r, c),
        "column by column, where they belong row by row": lambda r, c: divmod(c * rows + r, columns),
        "one place further on, the last to the first": lambda r, c: divmod((r * columns + c + 1) % count, columns),
        "one place back, the first to the last": lambda r, c: divmod((r * columns + c - 1) % count, columns),
    }
    if rows == columns:
        orders |= {
            "a quarter turn on, counter-clockwise as seen from the touch side": lambda r, c: (c, columns - 1 - r),
            "a quarter turn on, clockwise as seen from the touch side": lambda r, c: (rows - 1 - c, r),
            "column by column, the last first": lambda r, c: (rows - 1 - c, columns - 1 - r),
        }
    return orders


def _coil(coil: Coil) -> str:
    return f"coil r{coil[0]}c{coil[1]}"
