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

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from padgen.core.errors import FileError, SpecError, at_most, number
from padgen.core.files import read_bounded, reason
from padgen.core.units import MH
from padgen.core.wav_reader import RIFF, Wave, read_wav
from padgen.measured.read_csv import LARGEST, SMALLEST, Measured, Record, Row, Spectrum, lowering, nearest_id, read_csv
from padgen.physics.resonance_fit import MOST_SAMPLES, SENSORS, current_of_voltage
from padgen.planner.plan import Plan

__all__ = ["read_measured", "read_measured_text", "read_records"]

LARGEST_FILE = 1 << 28
"""Most bytes of a file, or of all files in a folder."""


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
    for each in paths:
        try:
            is_folder, is_there = each.is_dir(), each.exists()
        except OSError as error:  # a name that no file can have
            raise FileError(f"cannot be read ({reason(error)})", str(each)) from error
        if not is_there:
            raise FileError("there is no such file or folder", str(each))
    alone = paths[0]
    named = len(paths) == 1 and _taxels_of(alone, plan)
    if len(paths) > 1 or is_folder or named:
        where = str(alone if len(paths) == 1 else alone.parent)
        found, stated = _read_named(_files(alone) if is_folder else paths, plan, excitation, where)
    else:
        where, ids = str(alone), tuple(taxel.id for taxel in plan.taxels)
        data = read_bounded(alone, LARGEST_FILE, "a measurement")
        found, stated = _read(data, alone, ids, plan, excitation, False)
    if sensor is not None:
        power = SENSORS.index(sensor)
        found = [p if isinstance(p, Row) or p.power is not None else replace(p, power=power) for p in found]
    return _ordered(found, stated, where, plan)


def read_measured_text(text: str, plan: Plan, where: str = "measured.csv") -> Measured:
    """Read a measurement from the text of a CSV file; see `read_measured`."""

    found, stated = read_csv(text, where, tuple(taxel.id for taxel in plan.taxels), plan, False)
    return _ordered(found, stated, where, plan)


Found = tuple[list[Row | Spectrum | Record], bool]


def _read(data: bytes, path: Path, ids: tuple[str, ...], plan: Plan, excitation: str, named: bool) -> Found:
    where = str(path)
    if data[:4] in RIFF or path.suffix.lower() in (".wav", ".wave"):
        return read_records(data, path, ids, plan, excitation, named), False
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"is neither WAV nor CSV: byte {error.start} is not UTF-8 text", where) from error
    return read_csv(text, where, ids, plan, named and len(ids) == 1)


def _taxels_of(path: Path, plan: Plan) -> tuple[str, ...]:
    """Return the taxels that a file is named after: one, all of a coil, or none."""
    return tuple(t.id for t in plan.taxels if path.stem in (t.id, f"r{t.coil[0]}c{t.coil[1]}"))


def _read_named(files: Sequence[Path], plan: Plan, excitation: str, where: str) -> Found:
    """Read files that are named after taxels or coils."""
    ids = tuple(taxel.id for taxel in plan.taxels)
    found: dict[str, Row | Spectrum | Record] = {}
    stated, left = [], LARGEST_FILE
    for path in files:
        own = _taxels_of(path, plan)
        if not own:
            end = nearest_id(path.stem, ids)
            raise FileError(f"must be named after a taxel of {plan.name!r}, {path.stem!r} is none{end}", str(path))
        data = read_bounded(path, left, "a measurement" if len(files) == 1 else "a folder of measurements")
        left -= len(data)
        parts, told = _read(data, path, own, plan, excitation, True)
        for part in parts:
            if isinstance(part, Row):
                raise FileError(
                    "is a table, which has all taxels in one file; give that file, not the folder", str(path)
                )
            if part.id in found:
                raise FileError(f"is a second file of {part.id}, beside {found[part.id].where}; keep one", str(path))
            found[part.id] = replace(part, where=str(path)) if len(own) == 1 else part
        stated.append(told)
    if not found:
        raise FileError(f"holds no CSV or WAV file named after a taxel, such as {ids[0]}.csv", where)
    return list(found.values()), all(stated)


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


READ_SAMPLES = 1 << 20
"""Samples of all channels that are read at a time."""
FEW_FULL, MOST_CLIPPED = 3.5, 0.05
"""Number of samples at full scale up to which a channel is not clipped, and the largest share that can be fitted."""


def read_records(
    data: bytes, path: Path, ids: tuple[str, ...], plan: Plan, excitation: str, named: bool = False
) -> list[Row | Spectrum | Record]:
    """Return records of the taxels `ids`, in relative units, from the bytes `data` of the WAV file `path`.

    A file that is `named` after a coil has all of its taxels in one channel.
    """
    where, wave = str(path), read_wav(path, data)
    count, due = wave.channels, len(ids)
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
    factor = lowering(wave.rate_hz, wave.count, ids, plan)
    rate = wave.rate_hz / factor
    if wave.count // factor > MOST_SAMPLES:
        raise FileError(
            f"lasts {number(wave.seconds)} s, at most {at_most(MOST_SAMPLES / rate)} s are read; cut it to the part in"
            " which the excitation passes the resonance and the response rings",
            where,
        )
    columns, held = _averaged(wave, factor, where)
    driven = count == due + 1
    squared = _squared_current(columns[:, 0], rate, plan, excitation, where) if driven else None
    return [
        Record(
            taxel,
            f"{where}, channel {k + 1 + driven} ({'coil of ' * bool(shared)}{taxel})",
            rate,
            columns[:, k + driven],
            squared,
            False,
            clipped=held[:, k + driven] if held[:, k + driven].any() else None,
            shared=shared,
        )
        for k, taxel in enumerate(ids[:due])
    ]


def _squared_current(column: np.ndarray, rate: float, plan: Plan, excitation: str, where: str) -> np.ndarray:
    if np.ptp(column**2) < SMALLEST:
        raise FileError("channel 1, the excitation, does not change; leave it out for free decays", where)
    if excitation == "voltage":
        coil = plan.spec.coil
        column = current_of_voltage(rate, column, coil.resistance_ohm, coil.inductance_mh * MH)
        column = column * coil.resistance_ohm
    return np.asarray(column**2)


def _averaged(wave: Wave, factor: int, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return means over `factor` samples of all channels (n, channels), and where clipped samples are among them.

    Samples that are not finite numbers, and channels with more than `MOST_CLIPPED` clipped ones, are refused.
    """
    step = max(READ_SAMPLES // (factor * wave.channels), 1) * factor
    last, means, marks, peak = wave.count // factor * factor, [], [], 0.0
    # Full scale is the last step below 1. Converters have at most 24 bits, even where files have more, and floats may
    # have been made of 16 bits.
    top = 1 - 2.0 ** (1 - (16 if wave.kind == "float" else min(wave.bits, 24)))
    for start in range(0, last, step):
        values = wave.read(start, min(start + step, last))
        bad = ~(np.abs(values) <= LARGEST)
        if bad.any():
            at, column = (int(k[0]) for k in np.nonzero(bad))
            raise FileError(
                f"channel {column + 1} has no finite number at sample {start + at + 1}, or one beyond {LARGEST:g}",
                where,
            )
        full = (values == -1) | (values >= top)
        means.append(values.reshape(-1, factor, wave.channels).mean(1))
        marks.append(full.reshape(-1, factor, wave.channels).mean(1))
        peak = max(peak, float(np.abs(values).max()))
    # Floats that go beyond 1 have no scale to be at the end of; a single sample at 1 is one that was scaled to it.
    clipped = np.concatenate(marks) * (peak <= 1)
    clipped = clipped * (factor * clipped.sum(0) > FEW_FULL)
    share = clipped.mean(0)
    worst = int(share.argmax())
    if share[worst] > MOST_CLIPPED:
        raise FileError(
            f"channel {worst + 1} is clipped at sample {factor * int((clipped[:, worst] > 0).argmax()) + 1}:"
            f" {share[worst]:.0%} of its samples are at full scale, at most {MOST_CLIPPED:.0%} may be; lower the"
            " input's gain",
            where,
        )
    return np.concatenate(means), clipped > 0
