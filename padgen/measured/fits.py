"""Fit every taxel's data by `physics/resonance_fit.py`: resonance, Q and response with their errors; draw the fits."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import log
from textwrap import fill
from typing import NamedTuple

import numpy as np

from padgen.core.display import COLOURS, PALE, plot_bytes, plot_style
from padgen.core.errors import FileError, SolverError, number
from padgen.core.rules import Rule, RuleBook
from padgen.core.units import MS
from padgen.measured.read import Measured, Spectrum, TaxelRecord, TaxelRow
from padgen.physics.resonance_fit import SENSORS, fit_decay, fit_driven, fit_spectrum, rough_hz, unfitted_response
from padgen.physics.resonance_judge import ResonanceFit, Seen
from padgen.planner.plan import Channel, Plan

__all__ = ["Curve", "MethodFit", "TaxelFit", "fit_measured", "fitted", "tuning_picture"]

TABLE_HZ_SHARE = 0.05
"""One sigma of a resonance from a table that states none, over its bandwidth: the error of reading it off a curve."""
TABLE_Q_SHARE = 0.1
PLANNED_Q_SHARE = 0.3
"""Relative one sigma of a Q from a table, and of the plan's Q where the table has none."""
TABLE_RESPONSE_SHARE = 0.1
"""Relative one sigma of a response from a table."""
SLOWEST = 5.0
"""Largest planned resonance over the sampling rate. A print's resonance, at least a tenth of it, is then still seen."""
SHARED_PEAK = 0.05
"""Least height of a peak in a record of a whole coil, over the largest one's, that counts as a taxel's."""
CLEAR = 4.0
"""Least difference in squared sigmas of the two best ways to give such peaks to taxels; below it, none is taken."""
ALONE_SPREAD = 0.05
"""Relative one sigma of a resonance, once the factor by which all of a print are off the plan is taken out."""
SAME_HZ = 0.02
"""Largest relative difference of a taxel's resonance alone from its peak in a record of the coil."""
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
    where the methods differ by more than their errors. `snr_db` is the peak over the noise of one point. `sensor` is
    what the data are of, as stated or recognised, '' where that is unknown. `order_assumed` is True where a recording
    of the whole coil has its peak and no recording of one taxel alone tells whose it is.
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
    sensor: str = ""
    order_assumed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Measured data of a taxel and their fit, to be drawn; `cause` is why it was refused, '' where it was fitted."""

    id: str
    seen: Seen
    cause: str


def fit_measured(measured: Measured, plan: Plan, nearest: bool = False) -> tuple[TaxelFit, ...]:
    """Fit every measured taxel, in the plan's order; taxels that were not measured have no entry.

    Data with two comparable peaks are refused; with `nearest`, the peak nearest to the plan is taken instead.

    Raises
    ------
    FileError
        The data of a taxel do not show one resonance, or nearly all frequencies look like kHz, mHz, or frequencies of
        the current.
    """
    fits, _, refused = fitted(measured, plan, nearest)
    if refused is not None:
        raise refused
    return fits


def fitted(
    measured: Measured, plan: Plan, nearest: bool = False
) -> tuple[tuple[TaxelFit, ...], tuple[Curve, ...], FileError | None]:
    """Return the taxels' fits, the measured and fitted curves, and the error that `fit_measured` would raise (or None).

    Raises
    ------
    FileError
        Nearly all frequencies look like kHz, mHz, or frequencies of the current.
    """
    channels = {taxel.id: plan.channels[taxel.channel] for taxel in plan.taxels}
    RECORDING_RULES.refuse(Recording(measured, channels), FileError)
    fits: dict[str, TaxelFit] = {}
    curves = []
    refused = []
    # Taxels that are recorded alone come first: they tell which peaks of their coil are theirs.
    for part in sorted(measured.taxels, key=lambda part: isinstance(part, TaxelRecord) and bool(part.shared)):
        try:
            alone_hz = {taxel: fit.resonance_hz for taxel, fit in fits.items()}
            for taxel, near_hz in _taxels_in(part, plan, nearest, alone_hz):
                if isinstance(part, TaxelRow):
                    fits[taxel] = _from_row(part, channels[taxel])
                elif taxel not in alone_hz:
                    fit = _fit(part, channels[taxel], near_hz)
                    fits[taxel] = _from_fit(taxel, fit, part, alone_hz)
                    curves.append(Curve(taxel, fit.seen, ""))
        except SolverError as error:
            assert not isinstance(part, TaxelRow)  # a table states its resonances
            refused.append((part, error.message))  # the error itself would keep the fit's arrays alive
            if isinstance(part, Spectrum):
                seen = Seen(part.frequency_hz, part.response, None)
            else:
                seen = unfitted_response(part.rate_hz, part.displacement, part.squared_current_a2)
            curves.append(Curve(part.id, seen, error.message))
    ordered = tuple(fits[taxel.id] for taxel in plan.taxels if taxel.id in fits)
    if not refused:
        return ordered, tuple(curves), None
    (part, cause), *others = refused
    named = ", ".join(other.id for other, _ in others[:MOST_NAMED]) + (" …" if len(others) > MOST_NAMED else "")
    rest = f" ({len(others)} more cannot be fitted: {named})" if others else ""
    return ordered, tuple(curves), FileError(cause + rest, part.where)


def _fit(part: Spectrum | TaxelRecord, channel: Channel, near_hz: float | None) -> ResonanceFit:
    if isinstance(part, Spectrum):
        return fit_spectrum(part.frequency_hz, part.response, near_hz, part.power)
    square = part.squared_current_a2
    moved = part.displacement
    exact = bool(part.shared)
    # Too short, or sampled too slowly, to show the resonance of any print of the plan.
    planned = channel.resonance_hz
    seconds = len(moved) / part.rate_hz
    if seconds * planned < 1 or part.rate_hz < planned / SLOWEST:
        raise SolverError(
            f"lasts {number(seconds)} s at {number(part.rate_hz)} samples a second, in which {number(planned)} Hz, as"
            " planned, cannot be seen: is the sampling rate right?"
        )
    if square is None:
        return fit_decay(part.rate_hz, moved, near_hz, exact, part.clipped)
    rings_s = channel.ring_up_ms * MS
    return fit_driven(
        part.rate_hz, square, moved, near_hz, part.power, rings_s, part.clipped, exact, current=part.current_a
    )


def _taxels_in(
    part: TaxelRow | Spectrum | TaxelRecord, plan: Plan, nearest: bool, alone_hz: dict[str, float]
) -> list[tuple[str, float | None]]:
    """Return the taxels that a part of a measurement holds, each with the frequency in Hz to fit near (or None).

    Peaks in a record of a whole coil go to its taxels in their planned order, so that they are off the plan by about
    one factor; some may be missing, and peaks may be left over. A taxel of known `alone_hz` has the peak that is there.

    Raises
    ------
    SolverError
        Two ways to name the peaks are about as likely.
    """
    channel = {taxel.id: plan.channels[taxel.channel] for taxel in plan.taxels}
    if isinstance(part, TaxelRow | Spectrum) or not part.shared:
        return [(part.id, channel[part.id].resonance_hz if nearest else None)]
    planned = sorted((channel[taxel].resonance_hz, taxel) for taxel in part.shared)
    first = _fit(part, channel[planned[0][1]], planned[0][0])
    peaks = [(first.resonance_hz, first.peak), *first.others]
    peaks_hz = sorted(hz for hz, size in peaks if size > SHARED_PEAK * max(p[1] for p in peaks))
    settled: list[tuple[str, float | None]] = []
    for taxel in (each for each in part.shared if each in alone_hz):
        hz = min(peaks_hz, key=lambda peak_hz: abs(log(peak_hz / alone_hz[taxel])), default=0.0)
        if not hz or abs(log(hz / alone_hz[taxel])) > SAME_HZ:
            raise SolverError(f"shows no resonance at {number(alone_hz[taxel])} Hz, where {taxel} has its own alone")
        settled.append((taxel, hz))
        peaks_hz.remove(hz)
        planned = [each for each in planned if each[1] != taxel]
    count = min(len(peaks_hz), len(planned))
    if not count:
        return settled
    ways: list[tuple[float, list[tuple[str, float | None]]]] = []
    for chosen_hz in combinations(peaks_hz, count):
        for taxels in combinations(planned, count):
            off = np.log(np.array(chosen_hz) / [hz for hz, _ in taxels])
            common = float(off.mean()) / channel[taxels[0][1]].print_spread
            likely = common**2 + float(((off - off.mean()) ** 2).sum()) / ALONE_SPREAD**2
            ways.append((likely, [(taxel, hz) for hz, (_, taxel) in zip(chosen_hz, taxels, strict=True)]))
    ways.sort(key=lambda way: way[0])
    if len(ways) > 1 and ways[1][0] - ways[0][0] < CLEAR and len(peaks_hz) < len(planned):
        listed = ", ".join(f"{number(hz)} Hz" for hz in peaks_hz)
        raise SolverError(
            f"shows {len(peaks_hz)} resonances ({listed}) of {len(planned)} taxels,"
            " and it is not clear which are missing; record these alone, each in a file of its name"
        )
    return settled + ways[0][1]


def _from_row(row: TaxelRow, channel: Channel) -> TaxelFit:
    error = row.resonance_error_hz
    response = row.response_um_per_a2
    q, q_share = (channel.q, PLANNED_Q_SHARE) if row.q is None else (row.q, TABLE_Q_SHARE)
    return TaxelFit(
        row.id,
        row.resonance_hz,
        TABLE_HZ_SHARE * row.resonance_hz / q if error is None else error,
        q,
        q * q_share,
        response,
        None if response is None else TABLE_RESPONSE_SHARE * response,
        q_measured=row.q is not None,
        agree=True,
        snr_db=None,
        methods=(),
    )


def _from_fit(taxel: str, fit: ResonanceFit, part: Spectrum | TaxelRecord, alone_hz: dict[str, float]) -> TaxelFit:
    by_least_squares = MethodFit("least squares", fit.resonance_hz, fit.resonance_error_hz, fit.q, fit.q_error)
    unit = (2 * np.pi * fit.resonance_hz) ** (fit.power or 0)
    return TaxelFit(
        taxel,
        fit.resonance_hz,
        fit.resonance_error_hz,
        fit.q,
        fit.q_error,
        fit.peak / unit if part.absolute else None,
        fit.peak_error / unit if part.absolute else None,
        True,
        fit.agree,
        float(20 * np.log10(fit.peak / fit.noise)) if fit.noise > 0 else None,
        (by_least_squares, MethodFit("circle", *fit.check)) if fit.check else (by_least_squares,),
        "" if fit.power is None else SENSORS[fit.power],
        isinstance(part, TaxelRecord) and len(part.shared) > 1 and not alone_hz.keys() & set(part.shared),
    )


# Units


class Recording(NamedTuple):
    """All measurements of one print, and a dictionary from each taxel's name to its planned channel."""

    measured: Measured
    channels: dict[str, Channel]


def _unit_rules(recording: Recording) -> Iterator[Rule]:
    """Yield rules that refuse a measurement whose frequencies seem to be in kHz or mHz, or to be the current's."""
    measured, channels = recording
    if measured.stated:
        return
    roughs = [_rough_hz(part) for part in measured.taxels]
    ratios = np.array(
        [rough / channels[part.id].resonance_hz for rough, part in zip(roughs, measured.taxels, strict=True) if rough]
    )
    if not len(ratios):
        return
    ratio = float(np.median(ratios))
    spread = float(np.median([channels[part.id].print_spread for part in measured.taxels]))
    part = measured.taxels[0]
    rough = roughs[0]
    planned = channels[part.id].resonance_hz
    peak = part.id if isinstance(part, TaxelRow) else f"the largest response of {part.id}"
    shown = f"{peak} is at {number(rough)} Hz, planned is {number(planned)} Hz"
    is_time = isinstance(part, TaxelRecord)
    for factor, *wrong in WRONG_UNITS:
        yield Rule(abs(log(ratio / factor)) >= log(3), measured.where, f"{shown}: {wrong[is_time]}")
    yield Rule(
        is_time or abs(log(2 * ratio)) >= 0.2 or log(1 / ratio) <= 2 * spread,
        measured.where,
        f"{shown}, half of it as for nearly all taxels: these look like frequencies of the current, half"
        " of those of the motion; say '# frequency: drive' in the first line, or '# frequency: motion' if they are"
        " right",
    )


RECORDING_RULES: RuleBook[Recording] = RuleBook("recording", _unit_rules)
"""Rules that a whole recording must keep before any taxel of it is fitted."""


WRONG_UNITS = (
    (
        1e-3,
        "the frequencies look like kHz; multiply them by 1000",
        "the times look like ms, or the sampling rate is wrong by 1000; they must be in s",
    ),
    (
        1e3,
        "the frequencies look like mHz; divide them by 1000",
        "the times look 1000 times too small, or the sampling rate too large; they must be in s",
    ),
)
"""Ratios of measured to planned resonances that tell of a wrong unit, with the words for frequencies and for times."""


def _rough_hz(part: TaxelRow | Spectrum | TaxelRecord) -> float:
    """Return a taxel's rough resonance in Hz without a fit: from its table row, else where its velocity is largest."""
    if isinstance(part, TaxelRow):
        return part.resonance_hz
    if isinstance(part, Spectrum):
        return float(part.frequency_hz[int((np.abs(part.response) * part.frequency_hz).argmax())])
    is_still = np.ptp(part.displacement) == 0
    return rough_hz(part.rate_hz, part.displacement, None if is_still else part.squared_current_a2)


MOST_PANELS = 12
COLUMNS = 3
MOST_POINTS = 400
FLOOR_DB = -60.0


def tuning_picture(curves: Sequence[Curve]) -> bytes:
    """Return a PNG of up to `MOST_PANELS` taxels, a panel each: refused ones first, then by largest residual."""
    from matplotlib.figure import Figure

    shown = sorted(curves, key=lambda curve: (not curve.cause, -_misfit(curve)))[:MOST_PANELS]
    rows = -(-len(shown) // COLUMNS)
    with plot_style():
        # Margins are given, not found: matplotlib's search for them takes as long as the drawing.
        height_in = 1.0 + 2.4 * rows
        figure = Figure(figsize=(11, height_in))
        figure.subplots_adjust(0.065, 0.6 / height_in, 0.985, 1 - 0.65 / height_in, wspace=0.06, hspace=0.3)
        axes = figure.subplots(rows, COLUMNS, squeeze=False, sharey=True).ravel()
        for axis in axes[len(shown) :]:
            axis.set_axis_off()
        for axis, curve in zip(axes, shown, strict=False):
            frequency, data, model = curve.seen
            keep = slice(None, None, -(-len(frequency) // MOST_POINTS))
            top = float(np.abs(data if model is None else model).max()) or 1.0
            lines = [(data, ".", PALE, "measured")]
            if model is not None:
                lines += [(model, "-", COLOURS[0], "fit"), (np.abs(data) - np.abs(model), "-", COLOURS[1], "residual")]
            for values, mark, colour, name in lines:
                level = 20 * np.log10(np.maximum(np.abs(values) / top, 10 ** (FLOOR_DB / 20)))
                axis.plot(frequency[keep], level[keep], mark, color=colour, markersize=3, linewidth=1, label=name)
            axis.set_ylim(FLOOR_DB, 10)
            axis.set_title(curve.id + (": refused" if curve.cause else ""), fontsize=9)
            if curve.cause:
                axis.text(0.02, 0.03, fill(curve.cause, 48), transform=axis.transAxes, fontsize=8, color=COLOURS[1])
        axes[0].legend(fontsize=8, loc="upper right")
        left = f", {len(shown)} of {len(curves)} taxels" if len(shown) < len(curves) else ""
        figure.supxlabel("frequency of the motion, Hz", fontsize=9, y=0.12 / height_in, va="bottom")
        figure.supylabel("dB of the peak", fontsize=9, x=0.012)
        figure.suptitle(f"measured responses and their fits{left}", fontsize=10, y=1 - 0.12 / height_in, va="top")
        return plot_bytes(figure, "png")


def _misfit(curve: Curve) -> float:
    """Return the largest residual divided by the largest response of the fitted curve, 0 where there is no fit."""
    if curve.seen.model is None:
        return 0.0
    return float(np.abs(curve.seen.data - curve.seen.model).max() / np.abs(curve.seen.model).max())
