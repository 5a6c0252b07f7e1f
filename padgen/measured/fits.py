"""Fits of resonance, Q and response, each with one sigma, to the measured data of every taxel."""

from dataclasses import dataclass
from math import log

import numpy as np

from padgen.core.errors import FileError, SolverError, number
from padgen.core.units import MS
from padgen.measured.read_csv import Measured, Record, Row, Spectrum
from padgen.physics.resonance_fit import fit_decay, fit_driven, fit_spectrum, rough_hz
from padgen.physics.resonance_judge import ResonanceFit
from padgen.planner.plan import Channel, Plan

__all__ = ["MethodFit", "TaxelFit", "fit_measured"]

TABLE_HZ_SHARE = 0.05
"""One sigma of a resonance from a table that states none, over its bandwidth: the error of reading it off a curve."""
TABLE_Q_SHARE, PLANNED_Q_SHARE = 0.1, 0.3
"""Relative one sigma of a Q from a table, and of the plan's Q where the table has none."""
TABLE_RESPONSE_SHARE = 0.1
"""Relative one sigma of a response from a table."""
QUIET_SHARE = 1e-3
"""Share of the largest i² below which a coil counts as silent, whatever noise its record has."""
BEFORE_S, RINGING_TAUS = 0.1, 12.0
"""Silence that is kept before the coil's turn (s) and after it (ring-up time constants of the planned taxel)."""
FEWEST_LEFT = 64
SLOWEST = 5.0
"""Largest planned resonance over the sampling rate. A print's resonance, at least a tenth of it, is then still seen."""
SAMPLES_OF_PLANNED = 64
"""Samples per period of the planned resonance that are enough, wherever the print's resonance is."""
KILO_HZ = 1e-3
MOST_NAMED = 5


@dataclass(frozen=True, slots=True)
class MethodFit:
    """The resonance and Q that one method found in a taxel's data; errors are one sigma."""

    method: str
    resonance_hz: float
    resonance_error_hz: float
    q: float
    q_error: float


@dataclass(frozen=True, slots=True)
class TaxelFit:
    """The resonance, Q and response of one measured taxel; `_error` fields are one sigma.

    `response_um_per_a2` is the amplitude at resonance per amplitude of the line of i² there, None where the
    measurement is in relative units. `q_measured` is False where a table left Q out: then Q is the plan's, with a wide
    error. `methods` has the figures of each method (none for a table); the first method's are used. `agree` is False
    where the methods differ by more than their errors. `snr_db` is the peak over the noise of one point.
    """

    id: str
    resonance_hz: float
    resonance_error_hz: float
    q: float
    q_error: float
    response_um_per_a2: float | None
    response_error: float | None
    q_measured: bool
    agree: bool
    snr_db: float | None
    methods: tuple[MethodFit, ...]


def fit_measured(measured: Measured, plan: Plan, nearest: bool = False) -> tuple[TaxelFit, ...]:
    """Fit every measured taxel, in the plan's order; taxels that were not measured have no entry.

    Data with two comparable peaks are refused; with `nearest`, the peak nearest to the plan is taken instead.

    Raises
    ------
    FileError
        The data of a taxel do not show one resonance, or nearly all frequencies look like kHz, mHz, or frequencies of
        the current.
    """
    channels = {taxel.id: plan.channels[taxel.channel] for taxel in plan.taxels}
    if not measured.stated:
        _refuse_units(measured, channels)
    fits, refused = [], []
    for part in measured.taxels:
        try:
            fits.append(_fit(part, channels[part.id], nearest))
        except SolverError as error:
            refused.append((part, error))
    if refused:
        raise _refusal(refused)
    return tuple(fits)


def _refusal(refused: list[tuple[Row | Spectrum | Record, SolverError]]) -> FileError:
    part, error = refused[0]
    more = [other.id for other, _ in refused[1:]]
    named = ", ".join(more[:MOST_NAMED]) + (" …" if len(more) > MOST_NAMED else "")
    rest = f" ({len(more)} more cannot be fitted: {named})" if more else ""
    return FileError(error.message + rest, part.where)


def _fit(part: Row | Spectrum | Record, channel: Channel, nearest: bool) -> TaxelFit:
    near = channel.resonance_hz if nearest else None
    if isinstance(part, Row):
        return _from_row(part, channel)
    if isinstance(part, Spectrum):
        return _from_fit(part.id, fit_spectrum(part.frequency_hz, part.response, near), part.absolute)
    _refuse_rate(part, channel)
    if part.squared_current_a2 is None:
        return _from_fit(part.id, fit_decay(part.rate_hz, part.displacement, near), False)
    rate_hz, square, moved = _thinned(part, channel)
    driven = fit_driven(rate_hz, square, moved, near, ring_s=channel.ring_up_ms * MS)
    return _from_fit(part.id, driven, part.absolute)


def _refuse_rate(part: Record, channel: Channel) -> None:
    """Refuse a record that is too short, or sampled too slowly, to show the resonance of any print of the plan."""
    planned, seconds = channel.resonance_hz, len(part.displacement) / part.rate_hz
    if seconds * planned < 1 or part.rate_hz < planned / SLOWEST:
        raise SolverError(
            f"lasts {number(seconds)} s at {number(part.rate_hz)} samples a second, in which {number(planned)} Hz, as"
            " planned, cannot be seen: is the sampling rate right?"
        )


def _thinned(part: Record, channel: Channel) -> tuple[float, np.ndarray, np.ndarray]:
    """Return rate, i² and displacement of a driven record, cut and resampled to what its resonance needs.

    Silence before the coil's turn and long after it is cut; a rate far above the resonance is lowered.
    """
    square = np.asarray(part.squared_current_a2)
    loud = np.flatnonzero(square > QUIET_SHARE * square.max())
    rings = RINGING_TAUS * channel.ring_up_ms * MS
    start = max(int(loud[0] - BEFORE_S * part.rate_hz), 0) if len(loud) else 0
    stop = int(loud[-1] + rings * part.rate_hz) if len(loud) else len(square)
    both = square[start:stop], part.displacement[start:stop]
    # At a rate that is wrong by thousands, at least FEWEST_LEFT samples must be left.
    factor = min(int(part.rate_hz / (SAMPLES_OF_PLANNED * channel.resonance_hz)), len(both[0]) // FEWEST_LEFT)
    if factor < 2:
        return part.rate_hz, *both
    from scipy.signal import resample_poly

    # A mean would make the filter ring at both ends.
    return (part.rate_hz / factor, *(resample_poly(v - v.mean(), 1, factor) for v in both))


def _from_row(row: Row, channel: Channel) -> TaxelFit:
    q = channel.q if row.q is None else row.q
    q_error = q * (PLANNED_Q_SHARE if row.q is None else TABLE_Q_SHARE)
    error = row.resonance_error_hz
    error = TABLE_HZ_SHARE * row.resonance_hz / q if error is None else error
    response = row.response_um_per_a2
    response_error = None if response is None else TABLE_RESPONSE_SHARE * response
    measured = row.q is not None
    return TaxelFit(row.id, row.resonance_hz, error, q, q_error, response, response_error, measured, True, None, ())


def _from_fit(taxel: str, fit: ResonanceFit, absolute: bool) -> TaxelFit:
    own = MethodFit("least squares", fit.resonance_hz, fit.resonance_error_hz, fit.q, fit.q_error)
    check = MethodFit(fit.check, fit.check_resonance_hz, fit.check_resonance_error_hz, fit.check_q, fit.check_q_error)
    return TaxelFit(
        taxel,
        fit.resonance_hz,
        fit.resonance_error_hz,
        fit.q,
        fit.q_error,
        fit.peak if absolute else None,
        fit.peak_error if absolute else None,
        True,
        fit.agree,
        float(20 * np.log10(fit.peak / fit.noise)) if fit.noise > 0 else None,
        (own, check) if fit.check else (own,),
    )


# Units


def _refuse_units(measured: Measured, channels: dict[str, Channel]) -> None:
    """Refuse frequencies that are nearly all a thousand times, a thousandth or half of the plan's."""
    roughs = [_rough_hz(part, channels[part.id]) for part in measured.taxels]
    ratios = np.array(
        [rough / channels[part.id].resonance_hz for rough, part in zip(roughs, measured.taxels, strict=True) if rough]
    )
    if not len(ratios):
        return
    ratio = float(np.median(ratios))
    spread = float(np.median([channels[part.id].print_spread for part in measured.taxels]))
    part = measured.taxels[0]
    rough, planned = roughs[0], channels[part.id].resonance_hz
    shown = f"the largest response of {part.id} is at {number(rough)} Hz, planned is {number(planned)} Hz"
    if isinstance(part, Row):
        shown = f"{part.id} is at {number(rough)} Hz, planned is {number(planned)} Hz"
    for factor, wrong in ((KILO_HZ, _KILO[_axis(part)]), (1 / KILO_HZ, _MILLI[_axis(part)])):
        if abs(log(ratio / factor)) < log(3):
            raise FileError(f"{shown}: {wrong}", measured.where)
    if _axis(part) != "time" and abs(log(2 * ratio)) < 0.2 and log(1 / ratio) > 2 * spread:
        raise FileError(
            f"{shown}, half of it as for nearly all taxels: these look like frequencies of the current, half"
            " of those of the motion; say '# frequency: drive' in the first line, or '# frequency: motion' if they are"
            " right",
            measured.where,
        )


_KILO = {
    "frequency": "the frequencies look like kHz; multiply them by 1000",
    "time": "the times look like ms, or the sampling rate is wrong by 1000; they must be in s",
}
_MILLI = {
    "frequency": "the frequencies look like mHz; divide them by 1000",
    "time": "the times look 1000 times too small, or the sampling rate too large; they must be in s",
}


def _axis(part: Row | Spectrum | Record) -> str:
    return "time" if isinstance(part, Record) else "frequency"


def _rough_hz(part: Row | Spectrum | Record, channel: Channel) -> float:
    """Return the frequency in Hz of the largest response, 0 where there is none."""
    if isinstance(part, Row):
        return part.resonance_hz
    if isinstance(part, Spectrum):
        return float(part.frequency_hz[int((np.abs(part.response) * part.frequency_hz).argmax())])
    if part.squared_current_a2 is None or np.ptp(part.displacement) == 0:
        return rough_hz(part.rate_hz, part.displacement)
    rate_hz, square, moved = _thinned(part, channel)
    return rough_hz(rate_hz, moved, square)
