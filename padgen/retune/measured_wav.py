"""Measurements as WAV files: one channel a taxel, and one more, the first, for the coil's current or voltage."""

import io
import warnings

import numpy as np

from padgen.errors import FileError, SpecError
from padgen.physics.driven_fit import current_of_voltage
from padgen.planner.plan import Plan
from padgen.retune.measurement import Record, Row, Spectrum
from padgen.units import MH

__all__ = ["read_wav"]

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
    driven = count == due + 1
    squared = _squared_current(samples[:, 0], rate, plan, excitation, where) if driven else None
    return [
        Record(taxel, f"{where}, channel {k + 1 + driven} ({taxel})", rate, samples[:, k + driven], squared, False)
        for k, taxel in enumerate(ids)
    ]


def _squared_current(column: np.ndarray, rate: float, plan: Plan, excitation: str, where: str) -> np.ndarray:
    if np.ptp(column) == 0:
        raise FileError("channel 1, the excitation, does not change; leave it out for free decays", where)
    if excitation == "voltage":
        coil = plan.typed_spec.coil
        column = current_of_voltage(rate, column, coil.resistance_ohm, coil.inductance_mh * MH)
        column = column * coil.resistance_ohm
    return np.asarray(column**2)


def _samples(data: bytes, where: str) -> tuple[float, np.ndarray]:
    """Rate in Hz and samples (n, channels), full scale 1."""
    from scipy.io import wavfile

    with warnings.catch_warnings():
        warnings.simplefilter("error", wavfile.WavFileWarning)
        warnings.filterwarnings("ignore", "Chunk .non-data. not understood", wavfile.WavFileWarning)
        try:
            rate, raw = wavfile.read(io.BytesIO(data))
        except wavfile.WavFileWarning as error:
            raise FileError(f"is cut off ({_first(error)}); copy or record it again", where) from error
        except Exception as error:  # a damaged head ends scipy's reader in errors of many kinds
            known = isinstance(error, ValueError)
            what = "is cut off or damaged, not a" if data[:4] in (b"RIFF", b"RIFX", b"RF64") else "is no"
            raise FileError(
                f"{what} WAV file that can be read ({_first(error) if known else 'a part of its head is wrong'})", where
            ) from error
    if not len(raw) or rate <= 0:
        raise FileError(f"holds {len(raw)} samples at {rate} Hz: nothing was recorded", where)
    return float(rate), _scaled(raw.reshape(len(raw), -1), where)


def _first(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:90]


def _scaled(samples: np.ndarray, where: str) -> np.ndarray:
    if samples.dtype.kind == "f":
        if not np.isfinite(samples).all():
            row, column = np.argwhere(~np.isfinite(samples))[0]
            raise FileError(f"channel {column + 1} has no finite number at sample {row + 1}", where)
        return samples.astype(float)
    middle = 128.0 if samples.dtype.kind == "u" else 0.0
    full = 128.0 if samples.dtype.kind == "u" else float(np.iinfo(samples.dtype).max) + 1
    _refuse_clipped(samples, where)
    return (samples.astype(float) - middle) / full


def _refuse_clipped(samples: np.ndarray, where: str) -> None:
    limits = np.iinfo(samples.dtype)
    # 24 bits come in the upper three bytes of 32: their largest value has an empty lowest byte.
    top = limits.max - 255 if samples.dtype == np.int32 else limits.max
    flat = ((samples >= top) | (samples == limits.min)).astype(np.int64)
    total = np.cumsum(np.concatenate([np.zeros((1, flat.shape[1]), np.int64), flat]), axis=0)
    run = total[CLIPPED:] - total[:-CLIPPED] == CLIPPED
    if run.any():
        row, column = np.argwhere(run)[0]
        raise FileError(
            f"channel {column + 1} is clipped at sample {row + 1} ({CLIPPED} or more at full scale in a row);"
            " lower the input's gain",
            where,
        )
