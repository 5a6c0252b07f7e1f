"""Measurements as WAV files: one channel a taxel, and one more, the first, for the coil's current or voltage."""

import io
import struct
import warnings

import numpy as np

from padgen.core.errors import FileError, SpecError, at_most
from padgen.core.units import MH
from padgen.measured.measurement import LARGEST, SMALLEST, Record, Row, Spectrum
from padgen.physics.driven_fit import current_of_voltage
from padgen.planner.plan import Plan

__all__ = ["read_wav"]

RIFF = b"RIFF", b"RIFX", b"RF64"
MOST_CHUNKS = 1000
MOST_SAMPLES = 1 << 25
"""Samples of a channel: as many as an excitation has at most."""
CLIPPED = 4
"""Samples at full scale in a row that tell of an overdriven input."""


def read_wav(
    data: bytes, where: str, ids: tuple[str, ...], plan: Plan, excitation: str
) -> list[Row | Spectrum | Record]:
    """Records of the taxels `ids` from the bytes of a WAV file, in relative units."""
    if excitation not in ("current", "voltage"):
        raise SpecError(f"must be current or voltage, got {excitation!r}", "--excitation")
    rate, samples = _samples(data, where)
    count, due = samples.shape[1], len(ids)
    if count not in (due, due + 1):
        what = "is mono" if count == 1 else f"has {count} channels"
        raise FileError(
            f"{what} where {due} are due, one a taxel{'' if due == 1 else ' in the order of the plan'}"
            f" (or {due + 1}, the excitation first); some taxels alone go to a folder of files named after them",
            where,
        )
    if len(samples) > MOST_SAMPLES:
        raise FileError(
            f"has {len(samples)} samples a channel, at most {MOST_SAMPLES}, {at_most(MOST_SAMPLES / rate)} s, are read;"
            " cut it to where the taxels move",
            where,
        )
    driven = count == due + 1
    columns = [_channel(samples, column, where) for column in range(count)]
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


def _samples(data: bytes, where: str) -> tuple[float, np.ndarray]:
    """Rate in Hz and samples (n, channels) as the file has them."""
    from scipy.io import wavfile

    _refuse_many_chunks(data, where)
    with warnings.catch_warnings():
        warnings.simplefilter("error", wavfile.WavFileWarning)
        warnings.filterwarnings("ignore", "Chunk .non-data. not understood", wavfile.WavFileWarning)
        try:
            rate, raw = wavfile.read(io.BytesIO(data))
        except wavfile.WavFileWarning as error:
            raise FileError(f"is cut off ({_first(error)}); copy or record it again", where) from error
        except Exception as error:  # a damaged head ends scipy's reader in errors of many kinds
            known = isinstance(error, ValueError)
            what = "is cut off or damaged, not a" if data[:4] in RIFF else "is no"
            raise FileError(
                f"{what} WAV file that can be read ({_first(error) if known else 'a part of its head is wrong'})", where
            ) from error
    if not len(raw) or rate <= 0:
        raise FileError(f"holds {len(raw)} samples at {rate} Hz: nothing was recorded", where)
    return float(rate), raw.reshape(len(raw), -1)


def _refuse_many_chunks(data: bytes, where: str) -> None:
    """Refuse a head that takes minutes to walk through."""
    start, count, order = 12, 0, ">I" if data[:4] == b"RIFX" else "<I"
    while data[:4] in RIFF and start + 8 <= len(data):
        count += 1
        if count > MOST_CHUNKS:
            raise FileError(f"is damaged: a WAV file has a few parts, this one more than {MOST_CHUNKS}", where)
        size = struct.unpack(order, data[start + 4 : start + 8])[0]
        start += 8 + size + size % 2


def _first(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:90]


def _channel(samples: np.ndarray, column: int, where: str) -> np.ndarray:
    """One channel of the samples, full scale 1, in single precision where that holds it."""
    raw = samples[:, column]
    if raw.dtype.kind == "f":
        bad = ~(np.abs(raw) <= LARGEST)
        if bad.any():
            raise FileError(
                f"channel {column + 1} has no finite number at sample {bad.argmax() + 1}, or one beyond {LARGEST:g}",
                where,
            )
        return raw
    _refuse_clipped(raw, column, where)
    middle, full = (128, 128.0) if raw.dtype.kind == "u" else (0, float(np.iinfo(raw.dtype).max) + 1)
    exact = "f4" if raw.dtype.itemsize < 4 or not (raw & 0xFF).any() else "f8"
    values: np.ndarray = raw.astype(exact)
    return (values - middle) / full


def _refuse_clipped(raw: np.ndarray, column: int, where: str) -> None:
    limits = np.iinfo(raw.dtype)
    # 24 bits come in the upper three bytes of 32: their largest value has an empty lowest byte.
    top = limits.max - 255 if raw.dtype == np.int32 else limits.max
    full = (raw >= top) | (raw == limits.min)
    run = np.logical_and.reduce([full[k : len(full) - CLIPPED + 1 + k] for k in range(CLIPPED)])
    if run.any():
        raise FileError(
            f"channel {column + 1} is clipped at sample {run.argmax() + 1} ({CLIPPED} or more at full scale in a row);"
            " lower the input's gain",
            where,
        )
