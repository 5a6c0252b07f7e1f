"""Reader of measurements of a print: CSV and WAV files, one, several or a folder of them, into `Measured`.

CSV has one line of headings; lines with ``#`` before it may say ``# unit: …``, ``# sensor: …`` and ``# frequency: …``.
Columns may come in any order. Taxels may be left out; they stay as planned. IDs are the plan's, such as ``r0c0k1``.

============  =====================================================================================================
a table       ``taxel, resonance_hz`` and, where known, ``q``, ``resonance_error_hz`` (one sigma), ``level_um`` with
              ``line_a2``: the amplitude at resonance, and of the line of i² that made it; cells of these may be empty
spectra       ``frequency_hz`` and per taxel ``ID`` or ``ID_mag`` (magnitude), ``ID_db``, either with ``ID_deg``, or
              ``ID_re`` and ``ID_im``; ``# unit: um_per_a2`` where it is µm per A² of the line of i², else relative
time series   ``time_s`` in even steps, ``ID`` (the sensor), and ``current_a`` or ``voltage_v`` of the coil where it
              was driven; without these a free decay; ``# unit: um`` where it is µm, else relative
WAV           one channel a taxel, in the plan's order: free decays; one more, the first: the coil's current (or, by
              `excitation`, voltage); relative
by name       files ``ID.csv`` and ``ID.wav``, each of one taxel, with columns named ``ID…`` or ``response…``; a WAV
              named after a coil, as ``r0c1.wav``, with one channel of motion in which all of its taxels are heard
============  =====================================================================================================

All frequencies are those of the motion, which is twice the frequency of a plain tone's current. ``# frequency: drive``
doubles those of a table or of spectra; ``# frequency: motion`` says that they are right however far from the plan's. A
driven record holds taxels of one coil, those that its current moves. WAV files are read in blocks; a rate far above
what the taxels need is lowered by means over some samples, of current and motion alike.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import partial
from pathlib import Path

import numpy as np

from padgen.core.errors import FileError, SpecError, at_most, number
from padgen.core.files import read_as_one, read_bounded, reason
from padgen.core.rules import Rule, refuse
from padgen.core.units import MH
from padgen.core.wav_reader import Wave, read_wav
from padgen.physics.resonance_fit import MOST_SAMPLES, SENSORS, current_of_voltage
from padgen.planner.plan import Plan

__all__ = ["Measured", "Spectrum", "TaxelRecord", "TaxelRow", "read_measured", "read_measured_text"]

LARGEST_FILE = 1 << 28
"""Most bytes of a file, or of all files in a folder."""
SMALLEST = 1e-30
LARGEST = 1e30
"""Bounds of measured values, whose fourth powers are still floating-point numbers; smaller values count as silence."""
LONGEST_NAME = 80


@dataclass(frozen=True, slots=True)
class TaxelRow:
    """One taxel's row of a measured table; values that the row leaves out are None."""

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
class TaxelRecord:
    """A taxel's motion (n,) over time: in µm (or µm/s, µm/s²) if `absolute`, else relative; for `power` see `Spectrum`.

    `squared_current_a2` (n,) is the coil's i², None for a free decay, `current_a` its i where the sensor may pick that
    up beside the answer to i². `clipped` (n,) marks samples of the motion at the
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
    current_a: np.ndarray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A measurement of a print: the measured taxels in the plan's order.

    `stated` is True where the file says what its frequencies are of; then they need not be near the plan's.
    """

    where: str
    taxels: "tuple[Part, ...]"
    stated: bool


Part = TaxelRow | Spectrum | TaxelRecord
Found = tuple[list[Part], bool]


def read_measured(
    path: Path | Sequence[Path], plan: Plan, excitation: str = "current", sensor: str | None = None
) -> Measured:
    """Read a measurement of `plan`'s print: a CSV or WAV file, several that are named after taxels, or a folder.

    A WAV file with one channel more than taxels has the excitation first; `excitation` says if that is the coil's
    'current' or 'voltage'. `sensor` is 'displacement', 'velocity' or 'acceleration' where the files do not say.

    Raises
    ------
    FileError
        A file cannot be read, or does not follow the table above; the message names line and column.
    """
    if excitation not in ("current", "voltage"):
        raise SpecError(f"must be current or voltage, got {excitation!r}", "--excitation")
    if sensor not in (*SENSORS, None):
        raise SpecError(f"must be {', '.join(SENSORS)}, got {sensor!r}", "--sensor")
    paths = [path] if isinstance(path, Path) else [*path]
    files: list[Path] = []
    for each in paths:
        try:
            if not each.exists():
                raise FileError("there is no such file or folder", str(each))
            inside = read_as_one(each, partial(_sorted, each)) if each.is_dir() else ()
        except OSError as error:  # or a name that no file can have
            raise FileError(f"cannot be read ({reason(error)})", str(each)) from error
        known = [p for p in inside if p.suffix.lower() in (".csv", ".wav", ".wave") and not p.name.startswith(".")]
        files += known if each.is_dir() else [each]
    alone = paths[0]
    where = str(alone.parent if len(paths) > 1 else alone)
    if len(paths) > 1 or files != paths or _taxels_of(alone, plan):
        parts, stated = _read_named(files, plan, excitation, where)
    else:
        data = read_bounded(alone, LARGEST_FILE, "a measurement")
        parts, stated = _read(data, alone, tuple(taxel.id for taxel in plan.taxels), plan, excitation, False)
    if sensor is not None:
        power = SENSORS.index(sensor)
        parts = [p if isinstance(p, TaxelRow) or p.power is not None else replace(p, power=power) for p in parts]
    return _ordered(parts, stated, where, plan)


def _sorted(folder: Path) -> list[Path]:
    return sorted(folder.iterdir())


def read_measured_text(text: str, plan: Plan, where: str = "measured.csv") -> Measured:
    """Read a measurement from the text of a CSV file; see `read_measured`."""
    parts, stated = _csv(text, where, tuple(taxel.id for taxel in plan.taxels), plan, False)
    return _ordered(parts, stated, where, plan)


def _read(data: bytes, path: Path, ids: tuple[str, ...], plan: Plan, excitation: str, named: bool) -> Found:
    where = str(path)
    if data[:4] == b"RIFF" or path.suffix.lower() in (".wav", ".wave"):
        return _records(data, path, ids, plan, excitation, named), False
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"is neither WAV nor CSV: byte {error.start} is not UTF-8 text", where) from error
    return _csv(text, where, ids, plan, named and len(ids) == 1)


def _taxels_of(path: Path, plan: Plan) -> tuple[str, ...]:
    """Return the taxels that a file is named after: one, all of a coil, or none."""
    return tuple(t.id for t in plan.taxels if path.stem in (t.id, f"r{t.coil[0]}c{t.coil[1]}"))


def _read_named(files: Sequence[Path], plan: Plan, excitation: str, where: str) -> Found:
    """Read files that are named after taxels or coils."""
    ids = tuple(taxel.id for taxel in plan.taxels)
    named: dict[str, Part] = {}
    stated = []
    left = LARGEST_FILE
    for path in files:
        taxel_ids = _taxels_of(path, plan)
        if not taxel_ids:
            raise FileError(
                f"must be named after a taxel of {plan.name!r}, {path.stem!r} is none{_nearest(path.stem, ids)}",
                str(path),
            )
        data = read_bounded(path, left, "a measurement" if len(files) == 1 else "a folder of measurements")
        left -= len(data)
        parts, is_stated = _read(data, path, taxel_ids, plan, excitation, True)
        for part in parts:
            if isinstance(part, TaxelRow):
                raise FileError(
                    "is a table, which has all taxels in one file; give that file, not the folder", str(path)
                )
            # A taxel may be recorded alone beside its coil: it tells which of the coil's peaks is its own.
            name = part.id if len(taxel_ids) == 1 else path.stem
            if name in named:
                raise FileError(f"is a second file of {name}, beside {named[name].where}; keep one", str(path))
            named[name] = replace(part, where=str(path)) if len(taxel_ids) == 1 else part
        stated.append(is_stated)
    if not named:
        raise FileError(f"holds no CSV or WAV file named after a taxel, such as {ids[0]}.csv", where)
    return list(named.values()), all(stated)


def _ordered(parts: list[Part], stated: bool, where: str, plan: Plan) -> Measured:
    place = {taxel.id: k for k, taxel in enumerate(plan.taxels)}
    known = [part for part in parts if part.id in place]
    return Measured(where, tuple(sorted(known, key=lambda part: place[part.id])), stated)


def _nearest(name: str, known: tuple[str, ...]) -> str:
    """Return the end of an error message: the known name most like `name`, or if none is like it the first and last."""
    close = get_close_matches(name[:LONGEST_NAME], known, 1, 0.5)
    return f"; the nearest is {close[0]!r}" if close else f"; they run from {known[0]!r} to {known[-1]!r}"


SAMPLES_OF_PLANNED = 40
FEWEST_LEFT = 64
"""Samples per period of the highest planned resonance that are kept, and the fewest of a record."""


def _averaging_factor(rate_hz: float, count: int, ids: tuple[str, ...], plan: Plan) -> int:
    """Return how many samples of a record may be averaged into one and still show the resonances of taxels `ids`."""
    highest = max(plan.channels[taxel.channel].resonance_hz for taxel in plan.taxels if taxel.id in ids)
    return max(min(int(rate_hz / (SAMPLES_OF_PLANNED * highest)), count // FEWEST_LEFT), 1)


def _current(column: np.ndarray, rate: float, plan: Plan, kind: str, what: str, where: str) -> np.ndarray:
    """Return the coil's current, to an arbitrary scale, from a recorded column of the `kind` 'current' or 'voltage'.

    The sentence about silence begins with `what`.
    """
    if np.ptp(column**plan.spec.force_order) < SMALLEST:
        raise FileError(f"{what} is {number(float(abs(column[0])))} throughout; leave it out for a free decay", where)
    if kind == "voltage":
        coil = plan.spec.coil
        return current_of_voltage(rate, column, coil.resistance_ohm, coil.inductance_mh * MH)
    return column


def _with_current(record: TaxelRecord, current: np.ndarray | None, plan: Plan) -> TaxelRecord:
    """Return a record with the coil's i² added (i, if the force is proportional to i); unchanged if no `current`."""
    if current is None:
        return record
    order = plan.spec.force_order
    return replace(record, squared_current_a2=current**order, current_a=current if order == 2 else None)


# WAV


READ_SAMPLES = 1 << 20
"""Samples of all channels that are read at a time."""
FEW_FULL = 3.5
MOST_CLIPPED = 0.05
"""Number of samples at full scale up to which a channel is not clipped, and the largest share that can be fitted."""


def _records(
    data: bytes, path: Path, ids: tuple[str, ...], plan: Plan, excitation: str, named: bool = False
) -> list[Part]:
    """Return records of the taxels `ids`, in relative units, from the bytes `data` of the WAV file `path`.

    A file that is `named` after a coil has all of its taxels in one channel.
    """
    where = str(path)
    wave = read_wav(path, data)
    count = wave.channels
    due = len(ids)
    if not wave.count:
        raise FileError(f"holds 0 samples at {wave.rate_hz} Hz: nothing was recorded", where)
    coils = {taxel.coil for taxel in plan.taxels if taxel.id in ids}
    shared = ids if len(coils) == 1 < due and count < due + named else ()
    due = 1 if shared else due
    if count not in (due, due + 1):
        what = "is mono" if count == 1 else f"has {count} channels"
        raise FileError(
            f"{what}, must have {due}, one for each taxel{'' if due == 1 else ' in the order of the plan'}, or"
            f" {due + 1}, the excitation first; name a file of one taxel {ids[0]}.wav, one in which all of a coil are"
            f" heard {ids[0].partition('k')[0]}.wav",
            where,
        )
    factor = _averaging_factor(wave.rate_hz, wave.count, ids, plan)
    rate = wave.rate_hz / factor
    if wave.count // factor > MOST_SAMPLES:
        raise FileError(
            f"lasts {number(wave.seconds)} s, at most {at_most(MOST_SAMPLES / rate)} s are read; cut it to the part in"
            " which the excitation passes the resonance and the response rings",
            where,
        )
    columns, held = _averaged(wave, factor, where)
    driven = count == due + 1
    current = None
    if driven:
        current = _current(columns[:, 0], rate, plan, excitation, "channel 1, the excitation,", where)
    return [
        _with_current(
            TaxelRecord(
                taxel,
                f"{where}, channel {k + 1 + driven} ({'coil of ' if shared else ''}{taxel})",
                rate,
                columns[:, k + driven],
                None,
                False,
                clipped=held[:, k + driven] if held[:, k + driven].any() else None,
                shared=shared,
            ),
            current,
            plan,
        )
        for k, taxel in enumerate(ids[:due])
    ]


def _averaged(wave: Wave, factor: int, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return means over `factor` samples (n, channels), and a mask of those that hold clipped samples.

    Samples that are not finite numbers, and channels with more than `MOST_CLIPPED` clipped ones, are refused by the
    name `where`.
    """
    step = max(READ_SAMPLES // (factor * wave.channels), 1) * factor
    last = wave.count // factor * factor
    peak = 0.0
    means = np.empty((wave.count // factor, wave.channels))
    marks = np.empty(means.shape, bool)
    count = np.zeros(wave.channels, np.int64)
    # Full scale is the last step below 1. Converters have at most 24 bits, even where files have more, and floats may
    # have been made of 16 bits.
    top = 1 - 2.0 ** (1 - (16 if wave.kind == "float" else min(wave.bits, 24)))
    for start in range(0, last, step):
        values = wave.read(start, min(start + step, last))
        largest = float(np.abs(values).max())
        if not largest <= LARGEST:
            at, column = np.argwhere(~(np.abs(values) <= LARGEST))[0].tolist()
            raise FileError(
                f"channel {column + 1} has no finite number at sample {start + at + 1}, or one beyond {LARGEST:g}",
                where,
            )
        full = (values == -1) | (values >= top)
        part = slice(start // factor, (start + step) // factor)
        # Ten times as quick as the mean over an axis, to the same bytes.
        means[part] = sum(values[k::factor] for k in range(factor)) / factor
        marks[part] = np.logical_or.reduceat(full, np.arange(0, len(full), factor))
        count += full.sum(0)
        peak = max(peak, largest)
    # Floats that go beyond 1 have no scale to be at the end of; a single sample at 1 is one that was scaled to it.
    is_clipped = (count > FEW_FULL) & (peak <= 1)
    share = is_clipped * count / last
    marks &= is_clipped
    worst = int(share.argmax())
    if share[worst] > MOST_CLIPPED:
        raise FileError(
            f"channel {worst + 1} is clipped at sample {factor * int(marks[:, worst].argmax()) + 1}:"
            f" {share[worst]:.0%} of its samples are at full scale, at most {MOST_CLIPPED:.0%} may be; lower the"
            " input's gain",
            where,
        )
    return means, marks


# CSV


TABLE = ("taxel", "resonance_hz", "q", "resonance_error_hz", "level_um", "line_a2")
SUFFIXES = {
    "frequency_hz": ({"mag"}, {"db"}, {"mag", "deg"}, {"db", "deg"}, {"re", "im"}),
    "time_s": ({"mag"},),
}
"""Sets of columns that a taxel may have; a name without a suffix stands for 'mag'."""
UNITS = {
    "frequency_hz": ("um_per_a2", "um_per_s_per_a2", "um_per_s2_per_a2"),
    "time_s": ("um", "um_per_s", "um_per_s2"),
}
"""Units of displacement, velocity and acceleration."""
RELATIVE = "relative"
DRIVE = "drive"
MOTION = "motion"
UNEVEN = 0.05
"""Largest deviation of a time step from the median step, over the latter; rounding in files explains as much."""
LARGEST_OF = {"resonance_hz": 1e6, "resonance_error_hz": 1e6, "q": 1e9}
MOST_LINES = 1_000_000
MOST_CHARACTERS = 1 << 26
LONGEST_LINE = 1 << 22


@dataclass(frozen=True, slots=True, eq=False)
class _Sheet:
    """A CSV file: its notes (from lines with ``#``), its headings, and the numbered lines of its body.

    Each of `lines` is its number and its raw text.
    """

    where: str
    notes: dict[str, str]
    names: tuple[str, ...]
    lines: list[tuple[int, str]]

    @property
    def factor(self) -> float:
        """Factor from frequencies in the file to those of the motion: 2 where the file has the current's, else 1."""
        return 2.0 if self.notes.get("frequency") == DRIVE else 1.0

    def cells(self, line: int, raw: str) -> list[str]:
        """Return the cells of a line; raise FileError unless there are as many as headings."""
        cells = _cells(raw)
        if len(cells) != len(self.names):
            raise FileError(
                f"line {line} has {len(cells)} columns, the headings {len(self.names)}; is the file cut off there?",
                self.where,
            )
        return cells

    def number(self, line: int, name: str, cell: str) -> float:
        """Return the number in a cell."""
        try:
            value = float("" if "_" in cell else cell)  # which Python takes in numbers
        except ValueError:
            value = np.nan
        if not abs(value) <= LARGEST:
            raise FileError(
                f"line {line}, column {name!r} must be a finite number of at most {LARGEST:g}, got {cell[:30]!r};"
                " leave out the line, or the taxel's columns",
                self.where,
            )
        return value

    def numbers(self) -> np.ndarray:
        """Return the body as numbers (lines, columns)."""
        shape = len(self.lines), len(self.names)
        try:
            values = np.loadtxt([line for _, line in self.lines], delimiter=",", comments=None, ndmin=2)
        except ValueError:
            values = np.full(shape, np.nan)
        if values.shape != shape or not np.abs(values).max() <= LARGEST:
            rows = ((line, self.cells(line, raw)) for line, raw in self.lines)
            values = np.array(
                [[self.number(n, *pair) for pair in zip(self.names, row, strict=True)] for n, row in rows]
            )
        return values


def _csv(text: str, where: str, ids: tuple[str, ...], plan: Plan, alone: bool) -> Found:
    """Return the data of the taxels `ids` in a CSV text, and whether it says if frequencies are of current or motion.

    With `alone` the file belongs to the one taxel in `ids`, whose columns may be named 'response'.
    """
    sheet = _sheet(text, where, ids[0] if alone else "")
    for kind, read in (("taxel", _table), ("frequency_hz", _spectra), ("time_s", _series)):
        if kind in sheet.names:
            return read(sheet, ids, plan), "frequency" in sheet.notes
    raise FileError(
        "the heading must have a column 'frequency_hz' (spectra), 'time_s' (time series) or 'taxel' (a table),"
        f" it has {', '.join(sheet.names)[:60]!r}; frequencies must be in Hz and times in s",
        where,
    )


def _sheet(text: str, where: str, alone: str) -> _Sheet:
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    count = text.count("\n")
    shorter = "shorter records would do, or a WAV"
    refuse(
        Rule(
            len(text) <= MOST_CHARACTERS,
            where,
            f"has {len(text) / 1e6:.0f} million characters, at most {MOST_CHARACTERS / 1e6:.0f} million are read;"
            f" {shorter}",
        ),
        Rule(count <= MOST_LINES, where, f"has {count} lines, at most {MOST_LINES} are read; {shorter}"),
        error=FileError,
    )
    notes: dict[str, str] = {}
    lines = []
    for line, raw in enumerate(text.split("\n"), start=1):
        if len(raw) > LONGEST_LINE:
            raise FileError(f"line {line} has {len(raw)} characters, at most {LONGEST_LINE} are read", where)
        if note := re.match(r"\s*#\s*(unit|frequency|sensor)\s*:\s*(\S+)\s*$", raw, re.IGNORECASE):
            notes[note[1].lower()] = note[2].lower()
        elif raw.strip() and not raw.lstrip().startswith("#"):
            lines.append((line, raw))
    if not lines:
        raise FileError("is empty; the first line must be the headings", where)
    (_, heading), *body = lines
    names = tuple(_cells(heading))
    if alone:
        names = tuple(re.sub(r"^response(?=$|_)", alone, name) for name in names)
    most_common, count = Counter(names).most_common(1)[0]
    separated = "its columns are separated by"
    by_commas = "they must be by commas (and decimals by points)"
    frequency = notes.get("frequency", MOTION)
    refuse(
        Rule("," in heading or ";" not in heading, where, f"{separated} semicolons, {by_commas}"),
        Rule("," in heading or "\t" not in heading, where, f"{separated} tabs, {by_commas}"),
        Rule(
            not all(re.fullmatch(r"[-+.\de]+", name) for name in names),
            where,
            f"has no headings: the first line is {heading[:40]!r}; it must name the columns",
        ),
        Rule(bool(body), where, "has headings, but no lines of numbers below them"),
        Rule(frequency in (DRIVE, MOTION), where, f"'# frequency:' must be {DRIVE} or {MOTION}, got {frequency!r}"),
        Rule(count == 1, where, f"has {count} columns named {most_common!r}; keep one"),
        error=FileError,
    )
    return _Sheet(where, notes, names, body)


def _cells(line: str) -> list[str]:
    return [cell.strip().strip('"') for cell in line.split(",")]


def _unit(sheet: _Sheet, axis: str) -> tuple[bool, int | None]:
    """Return True if responses have an absolute unit, and which derivative of displacement they are (0 to 2, None)."""
    unit = sheet.notes.get("unit", RELATIVE)
    sensor = sheet.notes.get("sensor")
    refuse(
        Rule(
            unit in (*UNITS[axis], RELATIVE),
            sheet.where,
            f"'# unit:' must be {', '.join(UNITS[axis])} or {RELATIVE}, got {unit!r}",
        ),
        Rule(sensor in (*SENSORS, None), sheet.where, f"'# sensor:' must be {', '.join(SENSORS)}, got {sensor!r}"),
        error=FileError,
    )
    if unit != RELATIVE:
        return True, UNITS[axis].index(unit)
    return False, None if sensor is None else SENSORS.index(sensor)


def _table(sheet: _Sheet, ids: tuple[str, ...], plan: Plan) -> list[Part]:
    known = f"{', '.join(TABLE[:2])} and, where known, {', '.join(TABLE[2:])}"
    where = sheet.where
    refuse(
        *(
            Rule(name in TABLE, where, f"a table has no column {name!r}; its columns are {known}")
            for name in sheet.names
        ),
        Rule("resonance_hz" in sheet.names, where, "a table must have a column 'resonance_hz', in Hz"),
        Rule(
            ("level_um" in sheet.names) == ("line_a2" in sheet.names),
            where,
            "'level_um' and 'line_a2' (of the line of i² that made it) must stand together",
        ),
        error=FileError,
    )
    rows: dict[str, TaxelRow] = {}
    for line, raw in sheet.lines:
        cells = dict(zip(sheet.names, sheet.cells(line, raw), strict=True))
        taxel = cells.pop("taxel")
        if taxel not in ids:
            raise FileError(f"line {line}: {plan.name!r} has no taxel {taxel!r}{_nearest(taxel, ids)}", sheet.where)
        if taxel in rows:
            raise FileError(f"line {line} is a second line of {taxel}; keep one", sheet.where)
        values = {name: _positive(sheet, line, name, cell) for name, cell in cells.items() if cell}
        refuse(
            Rule("resonance_hz" in values, where, f"line {line}, column 'resonance_hz' is empty; leave out the line"),
            Rule(
                ("level_um" in values) == ("line_a2" in values),
                where,
                f"line {line} has one of 'level_um' and 'line_a2'; give both or none",
            ),
            error=FileError,
        )
        rows[taxel] = TaxelRow(
            taxel,
            f"{sheet.where}, line {line}",
            sheet.factor * values["resonance_hz"],
            sheet.factor * values["resonance_error_hz"] if "resonance_error_hz" in values else None,
            values.get("q"),
            values["level_um"] / values["line_a2"] if "level_um" in values else None,
        )
    # Swapped columns: Q reads like the planned resonances, and resonances do not.
    planned = {taxel.id: plan.channels[taxel.channel].resonance_hz for taxel in plan.taxels}
    both = [(row.resonance_hz / planned[row.id], row.q / planned[row.id]) for row in rows.values() if row.q]
    off, swapped = np.median(np.abs(np.log(both or [(1.0, 1.0)])), axis=0)
    if off > np.log(1.5) and swapped < np.log(1.5):
        first = next(row for row in rows.values() if row.q)
        raise FileError(
            f"columns 'q' and 'resonance_hz' look swapped: {first.id} has a q of {number(float(first.q or 0))} and a"
            f" resonance of {number(first.resonance_hz)} Hz, planned is {number(planned[first.id])} Hz; swap them back",
            sheet.where,
        )
    return list(rows.values())


def _positive(sheet: _Sheet, line: int, name: str, cell: str) -> float:
    value = sheet.number(line, name, cell)
    low = 0.5 * (name == "q")
    high = LARGEST_OF.get(name, LARGEST)
    if not low < value <= high:
        raise FileError(
            f"line {line}, column {name!r} must be above {number(low)} and at most {number(high)}, got {number(value)}",
            sheet.where,
        )
    return value


def _spectra(sheet: _Sheet, ids: tuple[str, ...], plan: Plan) -> list[Part]:
    columns = _taxel_columns(sheet, ids, plan, ("frequency_hz",))
    unit = _unit(sheet, "frequency_hz")
    values = sheet.numbers()
    axis = sheet.names.index("frequency_hz")
    skip = 0
    if values[0, axis] == 0 and len(values) > 1:
        values = values[1:]
        skip = 1
    _refuse_not_rising(sheet, values, skip, axis, "Hz")
    spectra: list[Part] = []
    for taxel, at in columns.items():
        parts = {part: values[:, k] for part, k in at.items()}
        if "re" in parts:
            response: np.ndarray = parts["re"] + 1j * parts["im"]
        else:
            response = parts["mag"] if "mag" in parts else 10 ** (parts["db"] / 20)
            if (response < 0).any():
                k = int(np.argmax(response < 0))
                raise FileError(
                    f"line {sheet.lines[k + skip][0]}, column {sheet.names[at['mag']]!r} is a magnitude and must be at"
                    f" least 0, got {number(float(response[k]))}; decibels go to {taxel}_db, real parts to {taxel}_re"
                    f" beside {taxel}_im",
                    sheet.where,
                )
            if "deg" in parts:
                response = response * np.exp(1j * np.radians(parts["deg"]))
        spectra.append(Spectrum(taxel, f"{sheet.where}, {taxel}", sheet.factor * values[:, axis], response, *unit))
    return spectra


def _taxel_columns(
    sheet: _Sheet, ids: tuple[str, ...], plan: Plan, quantities: tuple[str, ...]
) -> dict[str, dict[str, int]]:
    """Return, for each taxel, a dictionary from its columns' suffixes to their indices; `quantities` are skipped."""
    columns_of: dict[str, dict[str, int]] = {}
    forms = SUFFIXES[quantities[0]]
    for at, name in enumerate(sheet.names):
        taxel, _, suffix = name.partition("_")
        if name in quantities:
            continue
        if taxel not in ids or (suffix or "mag") not in set().union(*forms) or name.endswith("_"):
            raise FileError(
                f"column {name!r} is no taxel of {plan.name!r} and none of"
                f" {', '.join(quantities)}{_nearest(taxel, ids)}",
                sheet.where,
            )
        columns_of.setdefault(taxel, {})[suffix or "mag"] = at
    if not columns_of:
        raise FileError(f"has no taxel's column, such as {ids[0]!r}", sheet.where)
    for taxel, parts in columns_of.items():
        if set(parts) not in forms:
            got = ", ".join(sheet.names[at] for at in parts.values())
            raise FileError(
                f"{taxel} must have one column ({taxel}, {taxel}_mag or {taxel}_db), either with {taxel}_deg,"
                f" or {taxel}_re and {taxel}_im; it has {got}",
                sheet.where,
            )
    return columns_of


def _refuse_not_rising(sheet: _Sheet, values: np.ndarray, skip: int, axis: int, unit: str) -> None:
    """Raise FileError if times or frequencies do not rise, or a frequency is not above 0.

    `skip` is the number of lines of the sheet before the first of `values`.
    """
    column = values[:, axis]
    name = sheet.names[axis]
    bad = np.flatnonzero(np.diff(column, prepend=0.0 if unit == "Hz" else -np.inf) <= 0)
    if len(bad):
        at = int(bad[0])
        rising = [k for k in range(values.shape[1]) if k != axis and (np.diff(values[:, k]) > 0).all()]
        other = f"; column {sheet.names[rising[0]]!r} does: are the two swapped?" if rising else "; sort the lines"
        before = f" after {number(float(column[at - 1]))}" if at else ""
        rule = "must be above 0 and rise" if unit == "Hz" else "must rise"
        raise FileError(
            f"line {sheet.lines[at + skip][0]}, column {name!r} {rule}, got {number(float(column[at]))}{before}"
            f" {unit}{other}",
            sheet.where,
        )


def _series(sheet: _Sheet, ids: tuple[str, ...], plan: Plan) -> list[Part]:
    columns = _taxel_columns(sheet, ids, plan, ("time_s", "current_a", "voltage_v"))
    drives = [name for name in ("current_a", "voltage_v") if name in sheet.names]
    if len(drives) > 1:
        raise FileError("has both 'current_a' and 'voltage_v'; leave one out, best the voltage", sheet.where)
    unit = _unit(sheet, "time_s")
    values = sheet.numbers()
    current = None
    if len(values) < 2:
        raise FileError("has one line of numbers; a record needs at least 32", sheet.where)
    axis = sheet.names.index("time_s")
    _refuse_not_rising(sheet, values, 0, axis, "s")
    time = values[:, axis]
    steps = np.diff(values[:, axis])
    step = float(np.median(steps))
    off = np.abs(steps - step) > UNEVEN * step + 4e-10 * np.abs(time[1:])
    if off.any():
        at = int(np.argmax(off))
        raise FileError(
            f"line {sheet.lines[at + 1][0]}, column 'time_s' must go in even steps of {number(step)} s, got a step of"
            f" {number(float(steps[at]))} s; resample it, or cut the record there",
            sheet.where,
        )
    rate = float((len(time) - 1) / (time[-1] - time[0]))
    factor = _averaging_factor(rate, len(values), tuple(columns), plan)
    values = values[: len(values) // factor * factor].reshape(-1, factor, values.shape[1]).mean(1)
    rate = rate / factor
    for name in drives:
        column = values[:, sheet.names.index(name)]
        kind = name.partition("_")[0]
        current = _current(column, rate, plan, kind, f"column {name!r}", sheet.where)
    records = (
        TaxelRecord(taxel, f"{sheet.where}, {taxel}", rate, values[:, parts["mag"]], None, *unit)
        for taxel, parts in columns.items()
    )
    return [_with_current(record, current, plan) for record in records]
