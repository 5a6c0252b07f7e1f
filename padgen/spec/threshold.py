"""Read and check the user's curve of detection thresholds over frequency: a CSV file, or two lists in the spec."""

import io
from dataclasses import fields
from itertools import pairwise
from pathlib import Path

from padgen.core.errors import FileError, SpecError, number
from padgen.core.files import read_bounded
from padgen.spec.fields import build
from padgen.spec.model import Drive, Spec

__all__ = ["refuse_threshold", "with_threshold"]


LARGEST_FILE = 1 << 20
"""Most bytes of a file with a curve."""


def with_threshold(drive: Drive, folder: Path) -> Drive:
    """Return `drive` with the curve of its `threshold_file` in place of the file's name.

    Raises
    ------
    FileError
        The file cannot be read, or a line of it is not two numbers.
    SpecError
        The spec has both a file and a list, or a number is out of bounds.
    """
    name = drive.threshold_file
    if name is None:
        return drive
    if drive.threshold_hz is not None or drive.threshold_um is not None:
        raise SpecError("must stand without drive.threshold_hz and drive.threshold_um, or they without it", _WHERE)
    hz, um = zip(*_points(_text(folder, name), name), strict=True)
    lists = {"threshold_hz": list(hz), "threshold_um": list(um)}
    values = {f.name: getattr(drive, f.name) for f in fields(Drive)} | {"threshold_file": None}
    filled: Drive = build(Drive, lists, "drive", values)
    return filled


_WHERE = "drive.threshold_file"


def _text(folder: Path, name: str) -> str:
    if not name.strip() or "\0" in name:
        raise SpecError(f"must name a file, got {name!r}", _WHERE)
    path = folder / name
    where = f"{_WHERE} {str(path)!r}"
    try:
        return read_bounded(path, LARGEST_FILE, "a threshold").decode("utf-8-sig")
    except FileError as error:
        missing = isinstance(error.__cause__, FileNotFoundError)
        raise FileError("there is no such file" if missing else error.message, where) from error
    except UnicodeDecodeError as error:
        raise FileError(f"is not CSV: byte {error.start} is not UTF-8 text", where) from error


def _points(text: str, where: str) -> list[tuple[float, float]]:
    points: list[tuple[float, float]] = []
    headings = 0
    for line, raw in enumerate(io.StringIO(text, newline=None), start=1):
        raw = raw.rstrip("\n")
        cells = [cell.strip() for cell in raw.split(",")]
        if not raw.strip() or raw.lstrip().startswith("#"):
            continue
        values = [value for cell in cells if (value := _number(cell)) is not None]
        if len(cells) == len(values) == 2:
            points.append((values[0], values[1]))
        elif len(cells) == 2 and not points and not headings and not any(c.isdigit() for c in raw):
            headings = line
        else:
            shown = raw if len(raw) <= 40 else raw[:40] + "…"
            raise FileError(f"line {line} must be a frequency in Hz and a threshold in µm, got {shown!r}", where)
    if not points:
        raise FileError("holds no points; each line must be a frequency in Hz and a threshold in µm", where)
    return points


def _number(cell: str) -> float | None:
    import re

    plain = re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?", cell, re.ASCII)
    return float(cell) if plain else None


def refuse_threshold(spec: Spec) -> None:
    """Raise `SpecError` for a curve that does not rise in frequency, or does not cover the band."""
    hz, um = spec.drive.threshold_hz, spec.drive.threshold_um
    if hz is None and um is None:
        return
    where = "drive.threshold_hz"
    if hz is None or um is None or len(hz) != len(um):
        raise SpecError(
            f"must have as many entries as drive.threshold_um, got {len(hz or ())} and {len(um or ())}", where
        )
    if len(hz) < 2:
        raise SpecError(f"must have two points or more, got {len(hz)}", where)
    for (low, high), value in zip(pairwise(hz), um, strict=False):
        if not 0 < low < high:
            raise SpecError(f"must be positive and rise, got {number(low)} before {number(high)} Hz", where)
        if not 0 < value < float("inf"):
            raise SpecError(f"must be positive, got {number(value)} µm at {number(low)} Hz", "drive.threshold_um")
    if not 0 < um[-1] < float("inf"):
        raise SpecError(f"must be positive, got {number(um[-1])} µm at {number(hz[-1])} Hz", "drive.threshold_um")
    low, high = spec.band_hz
    if hz[0] > low or hz[-1] < high:
        common = max(low, hz[0]), min(high, hz[-1])
        raise SpecError(
            f"must cover the band of {number(low)} … {number(high)} Hz, got {number(hz[0])} … {number(hz[-1])} Hz",
            where,
            [{"band_hz": list(common)}] if common[0] < common[1] else (),
        )
