"""Check the fit of one resonance: refuse data not to be trusted, with errors that say why, and fit a circle as a check.

Also a first look at a spectrum: its largest peak and the noise of a point. Frequencies are of the motion, in Hz.

The second way fits a circle in the complex plane, then the angle over frequency. Near a resonance with viscous damping
the mobility ``s H = −j P / (1 + j x)``, ``x = Q (s − 1/s)``, s = f/f₀, runs on a circle of diameter P through the
origin. Far modes add a constant, which only shifts the circle. Seen from its centre the angle is ``φ₀ − 2 arctan x``
(C. C. Kennedy, C. D. P. Pancu, J. Aeronaut. Sci. 14, 1947, 603-625). (With hysteretic damping the receptance H itself
would be a circle; over one bandwidth the two differ by 1/Q.) The circle is fitted by the method of G. Taubin (IEEE
Trans. PAMI 13, 1991, 1115-1138), which noise does not shrink as it does the plain algebraic fit.
"""

from typing import NamedTuple

import numpy as np

from padgen.core.errors import SolverError, at_least, at_most, number

__all__ = [
    "COMPARABLE",
    "LEAST_GAIN",
    "NEEDED",
    "NEEDED_OF_SPECTRA",
    "CircleFit",
    "ResonanceFit",
    "Seen",
    "circle_resonance",
    "detuning",
    "judge_agreement",
    "point_noise",
    "refuse_ambiguous_peaks",
    "refuse_bad_record",
    "refuse_bad_spectrum",
    "refuse_edge",
    "refuse_few",
    "refuse_no_peak",
    "refuse_no_resonance",
    "rough_peak",
    "taubin_circle",
]

WIDEST_ARC = 2.5
"""Largest |x| of the points that are fitted; larger where fewer than `FEWEST` points would remain."""
FEWEST = 6
VAGUE = 1.0
"""Largest useful sigma, of ln Q and of the frequency in bandwidths: with a larger one the circle has no result."""


class CircleFit(NamedTuple):
    """Frequency and Q of a resonance, each with one sigma."""

    resonance_hz: float
    resonance_error_hz: float
    q: float
    q_error: float


def taubin_circle(points: np.ndarray, weight: np.ndarray) -> tuple[complex, float]:
    """Return centre and radius of the circle through complex `points` (n,), by Taubin's algebraic distance.

    `weight` (n,) is of each squared distance. At least three points must not be on a line.
    """
    share = weight / weight.sum()
    middle = complex((share * points).sum())
    z = points - middle
    square = np.abs(z) ** 2
    mean = float((share * square).sum())
    root = np.sqrt(share)
    columns = np.stack([(square - mean) / (2 * np.sqrt(mean)), z.real, z.imag], axis=1) * root[:, None]
    a, b, c = np.linalg.svd(columns, full_matrices=False)[2][2]
    a = a / (2 * np.sqrt(mean))
    if a == 0:
        return middle, float("inf")
    radius = np.sqrt(b * b + c * c + 4 * a * a * mean) / (2 * abs(a))
    return middle - complex(b, c) / (2 * a), float(radius)


def circle_resonance(
    frequency_hz: np.ndarray,
    response: np.ndarray,
    start_hz: float,
    start_q: float,
    sigma: np.ndarray | float = 1.0,
) -> CircleFit | None:
    """Fit f and Q to the circle of a receptance `response` (n,) near `start_hz`; None where data do not fix them.

    `sigma` is the relative size of each point's noise.
    """
    if len(frequency_hz) < FEWEST:
        return None
    sigma = np.broadcast_to(np.asarray(sigma, float), frequency_hz.shape)
    fit = None
    hz = start_hz
    q = start_q
    for _ in range(2):
        away = np.abs(detuning(frequency_hz, hz, q))
        arc = away <= max(WIDEST_ARC, float(np.sort(away)[FEWEST - 1]))
        s = frequency_hz[arc] / hz
        fit = _fit_angle(frequency_hz[arc], response[arc] * s, hz, q, sigma[arc] * s)
        if fit is None:
            break
        hz = fit.resonance_hz
        q = fit.q
    return fit


def detuning(frequency: np.ndarray, hz: float, q: float) -> np.ndarray:
    """Return the distance (n,) from a resonance in half bandwidths, ``x = Q (f/f₀ − f₀/f)``."""
    return np.asarray(q * (frequency / hz - hz / frequency))


def _fit_angle(frequency: np.ndarray, points: np.ndarray, hz: float, q: float, sigma: np.ndarray) -> CircleFit | None:
    """Fit frequency and Q to the angles of mobilities `points` (n,), as seen from their circle's centre.

    `hz` and `q` are a start; None where the points are on a line or leave either too uncertain.
    """
    from scipy.optimize import least_squares

    centre, radius = taubin_circle(points, sigma**-2)
    if not np.isfinite(radius):
        return None
    arm = points - centre
    angle = np.angle(arm)
    width = 1 / q

    def off(theta: np.ndarray) -> np.ndarray:
        x = detuning(frequency, hz * np.exp(theta[1] * width), q * np.exp(theta[2]))
        return np.asarray(np.angle(np.exp(1j * (angle - theta[0] + 2 * np.arctan(x)))) / sigma)

    start = np.array([angle[np.abs(frequency - hz).argmin()], 0.0, 0.0])
    solution = least_squares(off, start, bounds=([-np.inf, -1 / width, -3], [np.inf, 1 / width, 3]), x_scale="jac")
    inverse = np.linalg.pinv(solution.jac)
    # Noise along the circle turns a point directly. Noise across it moves the centre: a centre that is off by d turns
    # a point by −t·d over the radius, t being the tangent there.
    radial = (np.abs(arm) - radius) / sigma
    along = radius * solution.fun
    variance = float(radial @ radial + along @ along) / max(2 * len(arm) - 6, 1)
    unit = arm / np.abs(arm)
    across = np.stack([unit.real, unit.imag, np.ones(len(arm))], axis=1) / sigma[:, None]
    turn = np.stack([unit.imag, -unit.real, np.zeros(len(arm))], axis=1) / sigma[:, None]
    moved = inverse @ turn @ np.linalg.pinv(across)
    error = np.sqrt(variance * ((inverse**2).sum(1) + (moved**2).sum(1))) / radius
    if not (error[1:] < VAGUE).all() or abs(solution.x[1]) > 0.99 / width or abs(solution.x[2]) > 2.99:
        return None
    hz, q = float(hz * np.exp(solution.x[1] * width)), float(q * np.exp(solution.x[2]))
    return CircleFit(hz, float(hz * error[1] * width), q, float(q * error[2]))


SILENCE = 1e-30
"""Smallest range of a response, in any unit; below it squares underflow."""
FEWEST_POINTS = 12
"""Fewest points of a spectrum, since the model has ten parameters."""
FEWEST_SAMPLES = 32
MOST_POINTS = 1 << 17
"""Most points of a spectrum; these take up to 0.8 s and 250 MB."""
FEWEST_IN_PEAK = 3
"""Fewest points within one bandwidth on either side of the peak."""
LEAST_PEAK = 2.0
"""Smallest peak over the noise of a point: 6 dB."""
LEAST_GAIN = 40.0
"""Least decrease of the sum of squares by the resonance, in variances; 1000 points of noise reach 25 by chance."""
MOST_LEFT = 0.2
"""Largest residual of a fit, over the largest response, that may be more than noise."""
SURE = 3.0
NEEDED = (0.3, 0.1)
NEEDED_OF_SPECTRA = (1.5, np.inf)
"""Sigmas of noise that must be within what re-tuning needs of a recording and, at least, of a spectrum: of the
frequency in halves of the bandwidth, where 0.3 are 0.4 dB, and of Q as a share of it, where 0.1 is 0.9 dB of the level.
"""
MOST_HARDER = 100.0
"""Largest factor by which a measurement is asked to be stronger."""
COMPARABLE = 0.5
"""Share of the first peak from which a second one is as likely to be the right one."""
MOST_APART = 0.25
MOST_APART_Q = 2.0
"""Largest difference of two methods, in bandwidths for the frequency and as a factor for Q; beyond it one is wrong."""
AGREEMENT = 3.0
AGREEMENT_FLOOR = 0.01
"""Two methods agree within this many sigmas, or within this share of the bandwidth, which costs 0.02 % of the
amplitude.
"""


class Seen(NamedTuple):
    """Responses (n,) over frequency in Hz, to be drawn: measured, and of the model (None where there is no fit)."""

    frequency_hz: np.ndarray
    data: np.ndarray
    model: np.ndarray | None


class ResonanceFit(NamedTuple):
    """Frequency, Q and peak of one fitted resonance, each with one sigma, and the result of a second method as a check.

    Fields ending in `_error` are one sigma; `peak` is the amplitude at resonance in the unit of the data. `noise` is
    that of a point; for a driven record, that of a sample over its largest response. `check` is the result of the
    second method (None where it could not be used), `agree` says whether the two agree. `others` are further peaks (Hz,
    amplitude). `power` is 0, 1 or 2 for displacement, velocity or acceleration, None where this is neither stated nor
    recognised.
    """

    resonance_hz: float
    resonance_error_hz: float
    q: float
    q_error: float
    peak: float
    peak_error: float
    noise: float
    check: CircleFit | None
    agree: bool
    others: tuple[tuple[float, float], ...]
    seen: Seen
    power: int | None


def judge_agreement(fit: CircleFit, check: CircleFit | None, needed: tuple[float, float]) -> bool:
    """Return whether a fit agrees with the second method's `check` (None: true); refuse one that is too uncertain.

    The sigmas of `fit` are of noise alone. Refuses a resonance that noise leaves less known than `needed`, and one that
    the second method finds elsewhere.
    """
    hz, hz_error, q, q_error = fit
    needs = [
        (hz_error, needed[0] * hz / (2 * q), "it", 1.0, "Hz"),
        (q_error, needed[1] * q, f"its Q of {number(q)}", 100 / q, "%"),
    ]
    sigma, most, what, per, unit = max(needs, key=lambda need: np.nan_to_num(need[0] / need[1], nan=np.inf))
    if not SURE * sigma <= most:
        times = float(np.nan_to_num(np.minimum(SURE * sigma / most, MOST_HARDER), nan=MOST_HARDER))
        raise SolverError(
            f"noise hides the resonance near {number(hz)} Hz: {what} is known only to ± {SURE * sigma * per:.3g} {unit}"
            f" (three sigma), where ± {most * per:.3g} {unit} are needed; excite, or pluck, {at_least(times)} times as"
            f" hard, average {int(np.ceil(times**2))} measurements (a recording may hold as many plucks), or leave this"
            " taxel out"
        )
    if check is None:
        return True
    near_hz = max(AGREEMENT * float(np.hypot(hz_error, check.resonance_error_hz)), AGREEMENT_FLOOR * hz / q)
    near_q = max(AGREEMENT * float(np.hypot(q_error, check.q_error)), AGREEMENT_FLOOR * q)
    alike = abs(hz - check.resonance_hz) <= near_hz and abs(q - check.q) <= near_q
    far = abs(hz - check.resonance_hz) > MOST_APART * hz / q or not 1 / MOST_APART_Q < q / check.q < MOST_APART_Q
    if far and not alike:
        raise SolverError(
            f"least squares find {number(hz)} Hz with a Q of {number(q)}, the circle {number(check.resonance_hz)} Hz"
            f" with a Q of {number(check.q)}: one is wrong; check that the data are of one resonance, and that no"
            " voltage is read as a current (--excitation voltage)"
        )
    return alike


def refuse_bad_spectrum(frequency_hz: np.ndarray, response: np.ndarray) -> None:
    """Refuse a spectrum with too few or too many points, bad numbers, or frequencies that do not rise."""
    if len(frequency_hz) != len(response) or len(frequency_hz) < FEWEST_POINTS:
        raise SolverError(f"must have at least {FEWEST_POINTS} frequencies, got {len(frequency_hz)}")
    if len(frequency_hz) > MOST_POINTS:
        raise SolverError(
            f"has {len(frequency_hz)} frequencies, at most {MOST_POINTS} are fitted; leave out those far from the peak"
        )
    _refuse_numbers(response + 0 * frequency_hz, "point", "at all frequencies")
    rises = np.diff(frequency_hz) > 0
    if frequency_hz[0] <= 0 or not rises.all():
        at = int(np.argmin(rises)) + 1 if not rises.all() else 0
        raise SolverError(
            f"frequencies must be above 0 and rise, point {at + 1} has {number(float(frequency_hz[at]))} Hz"
        )


def refuse_bad_record(y: np.ndarray) -> None:
    """Refuse a record that is too short, constant or not finite."""
    if len(y) < FEWEST_SAMPLES:
        raise SolverError(f"must have at least {FEWEST_SAMPLES} samples, got {len(y)}")
    _refuse_numbers(y, "sample", "throughout")


def _refuse_numbers(values: np.ndarray, point: str, everywhere: str) -> None:
    """Refuse values that are not finite, or all alike."""
    if not np.isfinite(values).all():
        raise SolverError(f"must be finite numbers, {point} {int(np.argmin(np.isfinite(values))) + 1} is not")
    if np.ptp(values.real) < SILENCE and np.ptp(values.imag) < SILENCE:
        raise SolverError(f"is {number(float(values.real[0]))} {everywhere}: nothing was measured here")


def refuse_no_peak(peak: float, noise: float, gain: float, frequency_hz: np.ndarray, size: np.ndarray) -> None:
    """Refuse a peak hidden by noise; `gain` is how much the peak lowers the sum of squares, in variances."""
    low = float(frequency_hz[0])
    high = float(frequency_hz[-1])
    if peak >= LEAST_PEAK * noise and gain >= LEAST_GAIN:
        return
    ends = max(len(size) // 50, 1)
    largest = int(size.argmax())
    for away, end, place, cure in (
        (largest, "lower", 0, f"start the sweep at {at_most(low / 2)} Hz or below"),
        (len(size) - 1 - largest, "upper", -1, f"end the sweep at {at_least(high * 2)} Hz or above"),
    ):
        if away < ends and size[place] > 3 * np.median(size):
            hz = number(float(frequency_hz[place]))
            raise SolverError(f"the response is largest at the {end} end of the sweep, {hz} Hz, without a peak; {cure}")
    weak = "is no more than noise makes by chance"
    if peak < LEAST_PEAK * noise:
        weak = f"is {20 * np.log10(max(peak / noise, 1e-3)):.1f} dB above the noise of a point, where 6 dB are needed"
    raise SolverError(
        f"shows no resonance between {number(low)} and {number(high)} Hz: the best one {weak};"
        " excite more, average longer, or leave this taxel out"
    )


def refuse_no_resonance(size: np.ndarray, left: float, scatter: float, hz: float) -> None:
    """Refuse a peak of another form than a resonance: the fit leaves `left` (rms), of which `scatter` is noise."""
    if left > MOST_LEFT * float(size.max()) and left > 4 * scatter:
        raise SolverError(
            f"the peak at {number(hz)} Hz is not that of a resonance: the best fit leaves"
            f" {100 * left / float(size.max()):.0f} % of it, where noise is {100 * scatter / float(size.max()):.0f} %;"
            " check that amplitudes are not in decibels and that phases are in degrees, or leave this taxel out"
        )


def refuse_edge(
    low: float, high: float, hz: float, q: float, what: str = "the sweep", it: str = "the sweep", slack: float = 0.0
) -> None:
    """Refuse a resonance beyond an end of the band `what`, or within half a bandwidth of it.

    `slack` in Hz is the uncertainty of the band's ends; `it` names what the user is to start or end elsewhere.
    """
    half = hz / (2 * q)
    slack += 1e-3 * half
    for out, end, bound, cure in (
        (hz - half < low - slack, "lower", low, f"start {it} at {at_most(max(hz - 4 * half, hz / 2))} Hz or below"),
        (hz + half > high + slack, "upper", high, f"end {it} at {at_least(min(hz + 4 * half, hz * 2))} Hz or above"),
    ):
        if out:
            raise SolverError(
                f"the resonance of {number(hz)} Hz (bandwidth {number(2 * half)} Hz) is at the {end} end of {what},"
                f" {number(float(bound))} Hz; {cure}"
            )


def refuse_few(frequency_hz: np.ndarray, hz: float, q: float) -> None:
    """Refuse a peak with too few points."""
    width = hz / q
    inside = int((np.abs(frequency_hz - hz) <= width).sum())
    if inside >= FEWEST_IN_PEAK:
        return
    nearest = int(np.abs(frequency_hz - hz).argmin())
    step = float(np.diff(frequency_hz)[max(nearest - 1, 0) : nearest + 1].max())
    raise SolverError(
        f"has {inside} points within a bandwidth of the peak at {number(hz)} Hz, where {FEWEST_IN_PEAK} are needed:"
        f" the step there is {number(step)} Hz and must be at most {at_most(min(width, step) / 2)} Hz"
    )


def refuse_ambiguous_peaks(hz: float, peak: float, others: tuple[tuple[float, float], ...]) -> None:
    """Refuse data with a second peak at least `COMPARABLE` times as high as the fitted one: it may be the right one."""
    for other_hz, other_peak in others:
        if other_peak >= COMPARABLE * peak:
            low, high = sorted((hz, other_hz))
            raise SolverError(
                f"has two peaks, at {number(low)} and {number(high)} Hz, the smaller {number(other_peak / peak)} times"
                " the larger; sweep only around the taxel's own, or choose the one nearest to the plan"
            )


def rough_peak(frequency: np.ndarray, size: np.ndarray) -> tuple[float, float]:
    """Return the frequency of the largest `size` (n,), and the width in Hz of its peak at 1/√2 of that size."""
    top = int(size.argmax())
    lower = np.flatnonzero(size < size[top] / np.sqrt(2))
    low = frequency[lower[lower < top][-1] if (lower < top).any() else 0]
    high = frequency[lower[lower > top][0] if (lower > top).any() else -1]
    return float(frequency[top]), float(high - low)


def point_noise(data: np.ndarray) -> float:
    """Return the root mean square noise of a point, from the median second difference of the data (n,).

    A narrow peak hardly changes that median. For complex data the noise is of both parts together.
    """
    second = np.abs(data[2:] - 2 * data[1:-1] + data[:-2])
    # The median of a Rayleigh variable over its root mean square is √ln 2, that of a half-normal one 0.6745.
    share = np.sqrt(np.log(2)) if np.iscomplexobj(data) else 0.67448975
    return float(np.median(second) / share / np.sqrt(6))
