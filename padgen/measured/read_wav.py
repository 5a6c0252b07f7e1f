"""Measurements as WAV files: one channel a taxel, and one more, the first, for the coil's current or voltage."""

from pathlib import Path

import numpy as np

from padgen.core.errors import FileError, SpecError, at_most
from padgen.core.units import MH
from padgen.core.wav_reader import Wave, read_wav
from padgen.measured.measurement import LARGEST, SMALLEST, Record, Row, Spectrum
from padgen.physics.resonance_fit import current_of_voltage
from padgen.planner.plan import Plan

__all__ = ["read_records"]

MOST_SAMPLES = 1 << 25
"""Samples of a channel: as many as an excitation has at most."""
CLIPPED = 4
"""Samples at full scale in a row that tell of an overdriven input."""


def read_records(
    data: bytes, path: Path, ids: tuple[str, ...], plan: Plan, excitation: str
) -> list[Row | Spectrum | Record]:
    """Records of the taxels `ids` from the bytes of the WAV file `path`, in relative units."""
    if excitation not in ("current", "voltage"):
        raise SpecError(f"must be current or voltage, got {excitation!r}", "--excitation")
    where, wave = str(path), read_wav(path, data)
    count, due, rate = wave.channels, len(ids), float(wave.rate_hz)
    if not wave.count:
        raise FileError(f"holds 0 samples at {wave.rate_hz} Hz: nothing was recorded", where)
    if count not in (due, due + 1):
        what = "is mono" if count == 1 else f"has {count} channels"
        raise FileError(
            f"{what} where {due} are due, one a taxel{'' if due == 1 else ' in the order of the plan'}"
            f" (or {due + 1}, the excitation first); some taxels alone go to a folder of files named after them",
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
    """One channel of the samples, full scale 1, in single precision where that holds it."""
    values = wave.channel(column, compact=True)
    if wave.kind == "float":
        bad = ~(np.abs(values) <= LARGEST)
        if bad.any():
            raise FileError(
                f"channel {column + 1} has no finite number at sample {bad.argmax() + 1}, or one beyond {LARGEST:g}",
                where,
            )
        return values
    # The last step below full scale, of 24 bits where there are more: converters have no more.
    full = (values >= 1 - 2.0 ** (1 - min(wave.bits, 24))) | (values == -1)
    run = np.logical_and.reduce([full[k : len(full) - CLIPPED + 1 + k] for k in range(CLIPPED)])
    if run.any():
        raise FileError(
            f"channel {column + 1} is clipped at sample {run.argmax() + 1} ({CLIPPED} or more at full scale in a row);"
            " lower the input's gain",
            where,
        )
    return values
