"""A detection threshold over frequency that the user supplies: a CSV file, or two lists in the spec."""

import csv
import io
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from padgen.errors import FileError, SpecError, number
from padgen.spec.model import Drive, Spec

__all__ = ["refuse_threshold", "with_threshold"]


def with_threshold(drive: Drive, folder: Path) -> Drive:
    """`drive` with the curve of its `threshold_file` filled in, unless the lists are there already.

    Raises
    ------
    FileError
        The file cannot be read, or a line of it is not two numbers.
    """
    if drive.threshold_file is None or drive.threshold_hz is not None:
        return drive
    path = folder / drive.threshold_file
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise FileError(f"cannot be read ({error.strerror})", f"drive.threshold_file {str(path)!r}") from error
    except UnicodeDecodeError as error:
        raise FileError(
            f"is not CSV: byte {error.start} is not UTF-8 text", f"drive.threshold_file {str(path)!r}"
        ) from error
    points = _points(text, drive.threshold_file)
    return replace(drive, threshold_hz=tuple(f for f, _ in points), threshold_um=tuple(um for _, um in points))


def _points(text: str, where: str) -> list[tuple[float, float]]:
    points: list[tuple[float, float]] = []
    for line, cells in enumerate(csv.reader(io.StringIO(text)), start=1):
        if not any(cell.strip() for cell in cells) or cells[0].lstrip().startswith("#"):
            continue
        try:
            hz, um = (float(cell) for cell in cells)
        except ValueError as error:
            if not points and line == 1:
                continue  # headings
            raise FileError(
                f"line {line} must be a frequency in Hz and a threshold in µm, got {','.join(cells)!r}", where
            ) from error
        points.append((hz, um))
    return points


def refuse_threshold(spec: Spec) -> None:
    """Raise `SpecError` for a curve that is none, or that leaves a part of the band without a threshold."""
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
        raise SpecError(
            f"must cover the band of {number(low)} … {number(high)} Hz, got {number(hz[0])} … {number(hz[-1])} Hz;"
            f" a band of [{number(max(low, hz[0]))}, {number(min(high, hz[-1]))}] would do",
            where,
        )
