"""Reader of measurements of a print: CSV and WAV files, or a folder of them, into `Measured`.

CSV has one line of headings; lines with ``#`` before it may say ``# unit: …`` and ``# frequency: …``. Columns may
come in any order. Taxels may be left out; they stay as planned. IDs are the plan's, such as ``r0c0k1``.

============  =====================================================================================================
a table       ``taxel, resonance_hz`` and, where known, ``q``, ``resonance_error_hz`` (one sigma), ``level_um`` with
              ``line_a2``: the amplitude at resonance, and of the line of i² that made it; cells of these may be empty
spectra       ``frequency_hz`` and per taxel ``ID`` or ``ID_mag`` (magnitude), ``ID_db``, either with ``ID_deg``, or
              ``ID_re`` and ``ID_im``; ``# unit: um_per_a2`` where it is µm per A² of the line of i², else relative
time series   ``time_s`` in even steps, ``ID`` (displacement), and ``current_a`` or ``voltage_v`` of the coil where it
              was driven; without these a free decay; ``# unit: um`` where it is µm, else relative
WAV           one channel a taxel, in the plan's order: free decays; one more, the first: the coil's current (or, by
              `excitation`, voltage); relative
a folder      of files ``ID.csv`` and ``ID.wav``, each of one taxel, with columns named ``ID…`` or ``response…``
============  =====================================================================================================

All frequencies are those of the motion, which is twice the frequency of a plain tone's current. ``# frequency: drive``
doubles those of a table or of spectra; ``# frequency: motion`` says that they are right however far from the plan's. A
driven record holds taxels of one coil, those that its current moves.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from padgen.core.errors import FileError, SpecError, at_most
from padgen.core.files import read_bounded, reason, recover
from padgen.core.units import MH
from padgen.core.wav_reader import RIFF, Wave, read_wav
from padgen.measured.read_csv import LARGEST, SMALLEST, Measured, Record, Row, Spectrum, nearest_id, read_csv
from padgen.physics.resonance_fit import current_of_voltage
from padgen.planner.plan import Plan

__all__ = ["read_measured", "read_measured_text", "read_records"]

LARGEST_FILE = 1 << 28
"""Most bytes of a file, or of all files in a folder."""


def read_measured(path: Path, plan: Plan, excitation: str = "current") -> Measured:
    """Read a measurement of `plan`'s print: a CSV or WAV file, or a folder of them, one a taxel.

    A WAV file with one channel more than taxels has the excitation first; `excitation` says if that is the coil's
    'current' or 'voltage'.

    Raises
    ------
    FileError
        A file cannot be read, or does not follow the table above; the message names line and column.
    """
    recover(path)
    recover(path.parent)
    try:
        is_folder, is_there = path.is_dir(), path.exists()
    except OSError as error:  # a name that no file can have
        raise FileError(f"cannot be read ({reason(error)})", str(path)) from error
    if not is_there:
        raise FileError("there is no such file or folder", str(path))
    if is_folder:
        return _read_folder(path, plan, excitation)
    ids = tuple(taxel.id for taxel in plan.taxels)
    data = read_bounded(path, LARGEST_FILE, "a measurement")
    return _ordered(*_read(data, path, ids, plan, excitation, False), str(path), plan)


def read_measured_text(text: str, plan: Plan, where: str = "measured.csv") -> Measured:
    """Read a measurement from the text of a CSV file; see `read_measured`."""

    found, stated = read_csv(text, where, tuple(taxel.id for taxel in plan.taxels), plan, False)
    return _ordered(found, stated, where, plan)


Found = tuple[list[Row | Spectrum | Record], bool]


def _read(data: bytes, path: Path, ids: tuple[str, ...], plan: Plan, excitation: str, alone: bool) -> Found:
    where = str(path)
    if data[:4] in RIFF or path.suffix.lower() in (".wav", ".wave"):
        return read_records(data, path, ids, plan, excitation), False
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"is neither WAV nor CSV: byte {error.start} is not UTF-8 text", where) from error
    return read_csv(text, where, ids, plan, alone)


def _read_folder(folder: Path, plan: Plan, excitation: str) -> Measured:
    ids = tuple(taxel.id for taxel in plan.taxels)
    found: dict[str, Row | Spectrum | Record] = {}
    stated, left = [], LARGEST_FILE
    for path in _files(folder):
        where = str(path)
        if path.stem not in ids:
            end = nearest_id(path.stem, ids)
            raise FileError(f"must be named after a taxel of {plan.name!r}, {path.stem!r} is none{end}", where)
        if path.stem in found:
            raise FileError(f"is a second file of {path.stem}, beside {found[path.stem].where}; keep one", where)
        data = read_bounded(path, left, "a folder of measurements")
        left -= len(data)
        part, told = _read(data, path, (path.stem,), plan, excitation, True)
        if isinstance(part[0], Row):
            raise FileError("is a table, which has all taxels in one file; give that file, not the folder", where)
        found[path.stem] = replace(part[0], where=where)
        stated.append(told)
    if not found:
        raise FileError(f"holds no CSV or WAV file named after a taxel, such as {ids[0]}.csv", str(folder))
    return _ordered(list(found.values()), all(stated), str(folder), plan)


def _files(folder: Path) -> list[Path]:
    try:
        entries = sorted(folder.iterdir())
    except OSError as error:
        raise FileError(f"cannot be read ({error.strerror})", str(folder)) from error
    return [p for p in entries if p.suffix.lower() in (".csv", ".wav", ".wave") and not p.name.startswith(".")]


def _ordered(found: list[Row | Spectrum | Record], stated: bool, where: str, plan: Plan) -> Measured:
    by_id = {part.id: part for part in found}
    taxels = tuple(by_id[taxel.id] for taxel in plan.taxels if taxel.id in by_id)
    missing = tuple(taxel.id for taxel in plan.taxels if taxel.id not in by_id)
    kinds = {_kind(part) for part in taxels}
    return Measured(kinds.pop() if len(kinds) == 1 else "mixed", where, taxels, missing, stated)


def _kind(part: Row | Spectrum | Record) -> str:
    if isinstance(part, Row):
        return "table"
    if isinstance(part, Spectrum):
        return "spectrum"
    return "decay" if part.squared_current_a2 is None else "driven"


MOST_SAMPLES = 1 << 25
"""Most samples of a channel; no excitation of padgen is longer."""
CLIPPED = 4
"""Number of samples in a row at full scale that count as clipping."""


def read_records(
    data: bytes, path: Path, ids: tuple[str, ...], plan: Plan, excitation: str
) -> list[Row | Spectrum | Record]:
    """Return records of the taxels `ids`, in relative units, from the bytes `data` of the WAV file `path`."""
    if excitation not in ("current", "voltage"):
        raise SpecError(f"must be current or voltage, got {excitation!r}", "--excitation")
    where, wave = str(path), read_wav(path, data)
    count, due, rate = wave.channels, len(ids), float(wave.rate_hz)
    if not wave.count:
        raise FileError(f"holds 0 samples at {wave.rate_hz} Hz: nothing was recorded", where)
    if count not in (due, due + 1):
        what = "is mono" if count == 1 else f"has {count} channels"
        raise FileError(
            f"{what}, must have {due}, one for each taxel{'' if due == 1 else ' in the order of the plan'}, or"
            f" {due + 1}, the excitation first; to give some taxels alone, put files named after them into a folder",
            where,
        )
    if wave.count > MOST_SAMPLES:
        raise FileError(
            f"has {wave.count} samples a channel, at most {MOST_SAMPLES}, {at_most(MOST_SAMPLES / rate)} s, are read;"
            " cut it to where the taxels move",
            where,
        )
    driven = count == due + 1
    columns = [_channel(wave, column, where) for column in range(count)]
    squared = _squared_current(columns[0], rate, plan, excitation, where) if driven else None
    return [
        Record(taxel, f"{where}, channel {k + 1 + driven} ({taxel})", rate, columns[k + driven], squared, False)
        for k, taxel in enumerate(ids)
    ]


def _squared_current(column: np.ndarray, rate: float, plan: Plan, excitation: str, where: str) -> np.ndarray:
    column = column.astype(float)
    if np.ptp(column**2) < SMALLEST:
        raise FileError("channel 1, the excitation, does not change; leave it out for free decays", where)
    if excitation == "voltage":
        coil = plan.spec.coil
        column = current_of_voltage(rate, column, coil.resistance_ohm, coil.inductance_mh * MH)
        column = column * coil.resistance_ohm
    return np.asarray(column**2)


def _channel(wave: Wave, column: int, where: str) -> np.ndarray:
    """Return one channel of the samples, full scale 1, in single precision where that suffices.

    Clipped samples, and samples that are not finite numbers, are refused.
    """
    values = wave.channel(column, compact=True)
    if wave.kind == "float":
        bad = ~(np.abs(values) <= LARGEST)
        if bad.any():
            raise FileError(
                f"channel {column + 1} has no finite number at sample {bad.argmax() + 1}, or one beyond {LARGEST:g}",
                where,
            )
        return values
    # Full scale is the last step below 1. Converters have at most 24 bits, even where files have more.
    full = (values >= 1 - 2.0 ** (1 - min(wave.bits, 24))) | (values == -1)
    run = np.logical_and.reduce([full[k : len(full) - CLIPPED + 1 + k] for k in range(CLIPPED)])
    if run.any():
        raise FileError(
            f"channel {column + 1} is clipped at sample {run.argmax() + 1} ({CLIPPED} or more at full scale in a row);"
            " lower the input's gain",
            where,
        )
    return values
