"""Reader of measurements in CSV: tables of resonances, spectra, time series; `padgen.measured.read` has the columns.

What was read is plain data: for each taxel a row of a table, a spectrum or a record in time.
"""

import csv
import re
from collections import Counter
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from padgen.core.errors import FileError, number
from padgen.core.units import MH
from padgen.physics.resonance_fit import SENSORS, current_of_voltage
from padgen.planner.plan import Plan

__all__ = ["LARGEST", "SMALLEST", "Measured", "Record", "Row", "Spectrum", "lowering", "nearest_id", "read_csv"]

SMALLEST, LARGEST = 1e-30, 1e30
"""Bounds of measured values, whose fourth powers are still floating-point numbers; smaller values count as silence."""
LONGEST_NAME = 80


@dataclass(frozen=True, slots=True)
class Row:
    """A taxel's line of a table; values that were left out are None."""

    id: str
    where: str
    resonance_hz: float
    resonance_error_hz: float | None
    q: float | None
    response_um_per_a2: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """A taxel's response (n,), complex or a magnitude, over `frequency_hz` (n,).

    It is in µm (µm/s, µm/s²) per A² of the line of i² where `absolute`, else relative. `power` is 0 for displacement, 1
    for velocity, 2 for acceleration, None where the file does not say.
    """

    id: str
    where: str
    frequency_hz: np.ndarray
    response: np.ndarray
    absolute: bool
    power: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """A taxel's motion (n,) over time, in µm (µm/s, µm/s²) where `absolute`, else relative; `power` as of `Spectrum`.

    `squared_current_a2` (n,) is the coil's i², None for a free decay. `clipped` (n,) marks samples of the motion at the
    ends of the scale. `shared` names all taxels that a record of a whole coil may hold; `id` is the first of them.
    """

    id: str
    where: str
    rate_hz: float
    displacement: np.ndarray
    squared_current_a2: np.ndarray | None
    absolute: bool
    power: int | None = None
    clipped: np.ndarray | None = None
    shared: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A measurement of a print: the measured taxels in the plan's order, and the IDs of the missing ones.

    `kind` is 'table', 'spectrum', 'decay', 'driven', or 'mixed' (a folder). `stated` is True where the file says what
    its frequencies are of; then they need not be near the plan's.
    """

    kind: str
    where: str
    taxels: tuple[Row | Spectrum | Record, ...]
    missing: tuple[str, ...]
    stated: bool


def nearest_id(name: str, known: tuple[str, ...]) -> str:
    """Return the end of a sentence that names the known name most like `name`, or the first and the last one."""
    close = get_close_matches(name[:LONGEST_NAME], known, 1, 0.5)
    return f"; the nearest is {close[0]!r}" if close else f"; they run from {known[0]!r} to {known[-1]!r}"


SAMPLES_OF_PLANNED, FEWEST_LEFT = 40, 64
"""Samples per period of the highest planned resonance that are kept, and the fewest of a record."""


def lowering(rate_hz: float, count: int, ids: tuple[str, ...], plan: Plan) -> int:
    """Return the number of samples of a record of `count` whose mean is enough for the taxels `ids`."""
    highest = max(plan.channels[taxel.channel].resonance_hz for taxel in plan.taxels if taxel.id in ids)
    return max(min(int(rate_hz / (SAMPLES_OF_PLANNED * highest)), count // FEWEST_LEFT), 1)


TABLE = ("taxel", "resonance_hz", "q", "resonance_error_hz", "level_um", "line_a2")
PARTS = {
    frozenset({""}): "mag",
    frozenset({"mag"}): "mag",
    frozenset({"db"}): "db",
    frozenset({"", "deg"}): "mag",
    frozenset({"mag", "deg"}): "mag",
    frozenset({"db", "deg"}): "db",
    frozenset({"re", "im"}): "re",
}
UNITS = {
    "frequency_hz": ("um_per_a2", "um_per_s_per_a2", "um_per_s2_per_a2"),
    "time_s": ("um", "um_per_s", "um_per_s2"),
}
"""Units of displacement, velocity and acceleration."""
RELATIVE = "relative"
DRIVE, MOTION = "drive", "motion"
UNEVEN = 0.05
"""Largest deviation of a time step from the median step, over the latter; rounding in files explains as much."""
LARGEST_HZ = 1e6
LARGEST_Q = 1e9
MOST_LINES, LONGEST_LINE = 2_000_000, 1 << 22
LINE_ENDS = "\n\r\v\f\x1c\x1d\x1e\x85\u2028\u2029"
"""All characters that ``str.splitlines`` takes for the end of a line."""
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?", re.ASCII)


@dataclass(frozen=True, slots=True, eq=False)
class _Sheet:
    """A CSV file: its notes (from lines with ``#``), its headings, and the numbered lines of its body."""

    where: str
    notes: dict[str, str]
    names: tuple[str, ...]
    lines: tuple[tuple[int, str], ...]


def read_csv(
    text: str, where: str, ids: tuple[str, ...], plan: Plan, alone: bool
) -> tuple[list[Row | Spectrum | Record], bool]:
    """Return the data of the taxels `ids` in a CSV text, and whether it states what its frequencies are of.

    With `alone` the file belongs to the one taxel in `ids`, whose columns may be named 'response'.
    """
    sheet = _sheet(text, where)
    for kind, read in (("taxel", _table), ("frequency_hz", _spectra), ("time_s", _series)):
        if kind in sheet.names:
            if alone:
                names = tuple(re.sub(r"^response(?=$|_)", ids[0], name) for name in sheet.names)
                sheet = _Sheet(where, sheet.notes, names, sheet.lines)
            _refuse_twice(sheet)
            return read(sheet, ids, plan), "frequency" in sheet.notes
    shown = ", ".join(sheet.names)[:60]
    raise FileError(
        "the heading must have a column 'frequency_hz' (spectra), 'time_s' (time series) or 'taxel' (a table),"
        f" it has {shown!r}; frequencies must be in Hz and times in s",
        where,
    )


def _sheet(text: str, where: str) -> _Sheet:
    notes: dict[str, str] = {}
    heading: str | None = None
    body = []
    count = sum(text.count(sign) for sign in LINE_ENDS)
    if count > MOST_LINES:
        raise FileError(f"has {count} lines, at most {MOST_LINES} are read; shorter records would do, or a WAV", where)
    for line, raw in enumerate(text.splitlines(), start=1):
        if not raw.strip():
            continue
        if len(raw) > LONGEST_LINE:
            raise FileError(f"line {line} has {len(raw)} characters, at most {LONGEST_LINE} are read", where)
        if raw.lstrip().startswith("#"):
            note = re.match(r"#\s*(unit|frequency|sensor)\s*:\s*(\S+)\s*$", raw.strip(), re.IGNORECASE)
            if note and heading is None:
                notes[note[1].lower()] = note[2].lower()
        elif heading is None:
            heading = raw
        else:
            body.append((line, raw))
    if heading is None:
        raise FileError("is empty; the first line must be the headings", where)
    names = tuple(cell.strip() for cell in _cells(heading))
    _refuse_heading(heading, names, where)
    if not body:
        raise FileError("has headings, but no lines of numbers below them", where)
    if notes.get("frequency", MOTION) not in (DRIVE, MOTION):
        raise FileError(f"'# frequency:' must be {DRIVE} or {MOTION}, got {notes['frequency']!r}", where)
    return _Sheet(where, notes, names, tuple(body))


def _refuse_heading(heading: str, names: tuple[str, ...], where: str) -> None:
    for sign, name in ((";", "semicolons"), ("\t", "tabs")):
        if sign in heading and "," not in heading:
            raise FileError(
                f"its columns are separated by {name}, they must be by commas (and decimals by points)", where
            )
    if all(_is_number(name) for name in names):
        raise FileError(f"has no headings: the first line is {heading[:40]!r}; it must name the columns", where)


def _refuse_twice(sheet: _Sheet) -> None:
    for name, count in Counter(sheet.names).items():
        if count > 1:
            raise FileError(f"has {count} columns named {name!r}; keep one", sheet.where)


def _cells(line: str) -> list[str]:
    try:
        return next(csv.reader([line])) if '"' in line else line.split(",")
    except csv.Error:
        return line.split(",")


def _is_number(cell: str) -> bool:
    return bool(NUMBER.fullmatch(cell.strip()))


def _numbers(sheet: _Sheet) -> np.ndarray:
    """Return the body as numbers (lines, columns), all of them finite and at most `LARGEST` in size."""
    try:
        values = np.loadtxt([line for _, line in sheet.lines], delimiter=",", comments=None, ndmin=2)
    except ValueError:
        values = None
    shape = len(sheet.lines), len(sheet.names)
    if values is None or values.shape != shape or not np.abs(values).max() <= LARGEST:
        values = np.empty(shape)
        for k, (line, raw) in enumerate(sheet.lines):
            values[k] = _line_numbers(sheet, line, raw)
    return values


def _line_numbers(sheet: _Sheet, line: int, raw: str) -> list[float]:
    cells = _cells(raw)
    if len(cells) != len(sheet.names):
        raise FileError(
            f"line {line} has {len(cells)} columns, the headings {len(sheet.names)}; is the file cut off there?",
            sheet.where,
        )
    return [_number(sheet, line, name, cell) for name, cell in zip(sheet.names, cells, strict=True)]


def _number(sheet: _Sheet, line: int, name: str, cell: str) -> float:
    value = float(cell) if _is_number(cell) else float("nan")
    if not abs(value) <= LARGEST:
        raise FileError(
            f"line {line}, column {name!r} must be a finite number of at most {LARGEST:g}, got {cell.strip()[:30]!r};"
            " leave out the line, or the taxel's columns",
            sheet.where,
        )
    return value


def _unit(sheet: _Sheet, axis: str) -> tuple[bool, int | None]:
    """Return whether the responses are absolute, with a unit of `UNITS`, and the power that the file states."""
    unit, sensor = sheet.notes.get("unit", RELATIVE), sheet.notes.get("sensor")
    if unit not in (*UNITS[axis], RELATIVE):
        raise FileError(f"'# unit:' must be {', '.join(UNITS[axis])} or {RELATIVE}, got {unit!r}", sheet.where)
    if sensor not in (*SENSORS, None):
        raise FileError(f"'# sensor:' must be {', '.join(SENSORS)}, got {sensor!r}", sheet.where)
    if unit != RELATIVE:
        return True, UNITS[axis].index(unit)
    return False, None if sensor is None else SENSORS.index(sensor)


# Tables


def _table(sheet: _Sheet, ids: tuple[str, ...], plan: Plan) -> list[Row | Spectrum | Record]:
    for name in sheet.names:
        if name not in TABLE:
            known = f"{', '.join(TABLE[:2])} and, where known, {', '.join(TABLE[2:])}"
            raise FileError(f"a table has no column {name!r}; its columns are {known}", sheet.where)
    if "resonance_hz" not in sheet.names:
        raise FileError("a table must have a column 'resonance_hz', in Hz", sheet.where)
    if ("level_um" in sheet.names) != ("line_a2" in sheet.names):
        raise FileError("'level_um' and 'line_a2' (of the line of i² that made it) must stand together", sheet.where)
    rows: dict[str, Row] = {}
    for line, raw in sheet.lines:
        row = _row(sheet, line, raw, ids, plan)
        if row.id in rows:
            raise FileError(f"line {line} is a second line of {row.id}; keep one", sheet.where)
        rows[row.id] = row
    _refuse_swapped(sheet, rows, plan)
    return list(rows.values())


def _row(sheet: _Sheet, line: int, raw: str, ids: tuple[str, ...], plan: Plan) -> Row:
    cells = [cell.strip() for cell in _cells(raw)]
    if len(cells) != len(sheet.names):
        raise FileError(
            f"line {line} has {len(cells)} columns, the headings {len(sheet.names)}; leave cells empty between commas",
            sheet.where,
        )
    table = dict(zip(sheet.names, cells, strict=True))
    taxel = table["taxel"]
    if taxel not in ids:
        raise FileError(f"line {line}: {plan.name!r} has no taxel {taxel!r}{nearest_id(taxel, ids)}", sheet.where)
    values = {name: _positive(sheet, line, name, cell) for name, cell in table.items() if name != "taxel"}
    hz, error, q = (values.get(name) for name in ("resonance_hz", "resonance_error_hz", "q"))
    level, drive = values.get("level_um"), values.get("line_a2")
    if hz is None:
        raise FileError(f"line {line}, column 'resonance_hz' is empty; leave out the line", sheet.where)
    if (level is None) != (drive is None):
        raise FileError(f"line {line} has one of 'level_um' and 'line_a2'; give both or none", sheet.where)
    factor = 2.0 if sheet.notes.get("frequency") == DRIVE else 1.0
    response = None if level is None or drive is None else level / drive
    where = f"{sheet.where}, line {line}"
    return Row(taxel, where, factor * hz, None if error is None else factor * error, q, response)


def _positive(sheet: _Sheet, line: int, name: str, cell: str) -> float | None:
    if not cell:
        return None
    value = _number(sheet, line, name, cell)
    low = 0.5 if name == "q" else 0.0
    high = LARGEST_HZ if name.endswith("_hz") else LARGEST_Q if name == "q" else LARGEST
    if not low < value <= high:
        raise FileError(
            f"line {line}, column {name!r} must be above {number(low)} and at most {number(high)}, got {number(value)}",
            sheet.where,
        )
    return value


def _refuse_swapped(sheet: _Sheet, rows: dict[str, Row], plan: Plan) -> None:
    """Refuse a table whose Q reads like the planned resonances and whose resonances do not."""
    planned = {taxel.id: plan.channels[taxel.channel].resonance_hz for taxel in plan.taxels}
    both = [(row.resonance_hz / planned[row.id], row.q / planned[row.id]) for row in rows.values() if row.q]
    if not both:
        return
    off, swapped = np.median(np.abs(np.log(both)), axis=0)
    if off > np.log(1.5) and swapped < np.log(1.5):
        first = next(row for row in rows.values() if row.q)
        raise FileError(
            f"columns 'q' and 'resonance_hz' look swapped: {first.id} has a q of {number(float(first.q or 0))} and a"
            f" resonance of {number(first.resonance_hz)} Hz, planned is {number(planned[first.id])} Hz; swap them back",
            sheet.where,
        )


# Spectra


def _spectra(sheet: _Sheet, ids: tuple[str, ...], plan: Plan) -> list[Row | Spectrum | Record]:
    columns = _taxel_columns(sheet, ids, plan, ("frequency_hz",), ("re", "im", "mag", "db", "deg"))
    told = _unit(sheet, "frequency_hz")
    values = _numbers(sheet)
    axis = sheet.names.index("frequency_hz")
    lines = [line for line, _ in sheet.lines]
    if values[0, axis] == 0 and len(values) > 1:
        values, lines = values[1:], lines[1:]
    frequency = values[:, axis]
    _refuse_not_rising(sheet, values, lines, axis, "Hz")
    factor = 2.0 if sheet.notes.get("frequency") == DRIVE else 1.0
    found: list[Row | Spectrum | Record] = []
    for taxel, parts in columns.items():
        response = _response(sheet, taxel, {part: values[:, at] for part, at in parts.items()}, lines)
        found.append(Spectrum(taxel, f"{sheet.where}, {taxel}", factor * frequency, response, *told))
    return found


def _response(sheet: _Sheet, taxel: str, parts: dict[str, np.ndarray], lines: list[int]) -> np.ndarray:
    form = PARTS.get(frozenset(parts))
    if form is None:
        got = ", ".join(sorted(f"{taxel}_{part}" if part else taxel for part in parts))
        raise FileError(
            f"{taxel} must have one column ({taxel}, {taxel}_mag or {taxel}_db), either with {taxel}_deg,"
            f" or {taxel}_re and {taxel}_im; it has {got}",
            sheet.where,
        )
    if form == "re":
        return np.asarray(parts["re"] + 1j * parts["im"])
    name = next(part for part in ("", "mag", "db") if part in parts)
    size = 10 ** (parts[name] / 20) if form == "db" else parts[name]
    if form == "mag" and (size < 0).any():
        at = int(np.argmax(size < 0))
        raise FileError(
            f"line {lines[at]}, column {f'{taxel}_{name}'.rstrip('_')!r} is a magnitude and must be at least 0, got"
            f" {number(float(size[at]))}; decibels go to {taxel}_db, real parts to {taxel}_re beside {taxel}_im",
            sheet.where,
        )
    return np.asarray(size * np.exp(1j * np.radians(parts["deg"])) if "deg" in parts else size)


def _taxel_columns(
    sheet: _Sheet, ids: tuple[str, ...], plan: Plan, own: tuple[str, ...], suffixes: tuple[str, ...]
) -> dict[str, dict[str, int]]:
    """Return the numbers of each taxel's columns, by their suffix."""
    found: dict[str, dict[str, int]] = {}
    for at, name in enumerate(sheet.names):
        if name in own:
            continue
        taxel, _, suffix = name.partition("_")
        if taxel not in ids or (suffix and suffix not in suffixes) or name.endswith("_"):
            known = ids if taxel not in ids else tuple(f"{taxel}_{part}" for part in suffixes) or (taxel,)
            raise FileError(
                f"column {name!r} is no taxel of {plan.name!r} and none of {', '.join(own)}"
                f"{nearest_id(name if taxel in ids else taxel, known)}",
                sheet.where,
            )
        found.setdefault(taxel, {})[suffix] = at
    if not found:
        raise FileError(f"has no taxel's column, such as {ids[0]!r}", sheet.where)
    return found


def _refuse_not_rising(sheet: _Sheet, values: np.ndarray, lines: list[int], axis: int, unit: str) -> None:
    column, name = values[:, axis], sheet.names[axis]
    bad = np.flatnonzero(np.diff(column) <= 0)
    if not len(bad) and (column[0] > 0 or unit != "Hz"):
        return
    at = int(bad[0]) + 1 if len(bad) else 0
    rising = [k for k in range(values.shape[1]) if k != axis and (np.diff(values[:, k]) > 0).all()]
    other = f"; column {sheet.names[rising[0]]!r} does: are the two swapped?" if rising else "; sort the lines"
    before = f" after {number(float(column[at - 1]))}" if at else ""
    rule = "must be above 0 and rise" if unit == "Hz" else "must rise"
    raise FileError(
        f"line {lines[at]}, column {name!r} {rule}, got {number(float(column[at]))}{before} {unit}{other}", sheet.where
    )


# Time series


def _series(sheet: _Sheet, ids: tuple[str, ...], plan: Plan) -> list[Row | Spectrum | Record]:
    own = ("time_s", "current_a", "voltage_v")
    columns = _taxel_columns(sheet, ids, plan, own, ())
    if "current_a" in sheet.names and "voltage_v" in sheet.names:
        raise FileError("has both 'current_a' and 'voltage_v'; leave one out, best the voltage", sheet.where)
    told = _unit(sheet, "time_s")
    values = _numbers(sheet)
    rate = _rate_hz(sheet, values)
    factor = lowering(rate, len(values), tuple(columns), plan)
    values, rate = values[: len(values) // factor * factor].reshape(-1, factor, values.shape[1]).mean(1), rate / factor
    squared = _squared_current(sheet, values, rate, plan)
    return [
        Record(taxel, f"{sheet.where}, {taxel}", rate, values[:, parts[""]], squared, *told)
        for taxel, parts in columns.items()
    ]


def _rate_hz(sheet: _Sheet, values: np.ndarray) -> float:
    axis = sheet.names.index("time_s")
    lines = [line for line, _ in sheet.lines]
    if len(values) < 2:
        raise FileError("has one line of numbers; a record needs at least 32", sheet.where)
    _refuse_not_rising(sheet, values, lines, axis, "s")
    time = values[:, axis]
    step = float(np.median(np.diff(time)))
    off = np.abs(np.diff(time) - step) > UNEVEN * step + 4e-10 * np.abs(time[1:])
    if off.any():
        at = int(np.argmax(off)) + 1
        raise FileError(
            f"line {lines[at]}, column 'time_s' must go in even steps of {number(step)} s, got a step of"
            f" {number(float(time[at] - time[at - 1]))} s; resample it, or cut the record there",
            sheet.where,
        )
    return float((len(time) - 1) / (time[-1] - time[0]))


def _squared_current(sheet: _Sheet, values: np.ndarray, rate: float, plan: Plan) -> np.ndarray | None:
    name = next((name for name in ("current_a", "voltage_v") if name in sheet.names), None)
    if name is None:
        return None
    column = values[:, sheet.names.index(name)]
    if np.ptp(column**2) < SMALLEST:
        raise FileError(
            f"column {name!r} is {number(float(abs(column[0])))} throughout; leave it out for a free decay", sheet.where
        )
    if name == "voltage_v":
        coil = plan.spec.coil
        column = current_of_voltage(rate, column, coil.resistance_ohm, coil.inductance_mh * MH)
    return np.asarray(column**2)
