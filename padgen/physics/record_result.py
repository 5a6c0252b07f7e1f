"""What fits of a free decay and of a driven record share: poles, verdicts, the result."""

import numpy as np

from padgen.core.errors import SolverError, at_least, number
from padgen.physics.circle_fit import CircleFit
from padgen.physics.resonance_judge import (
    COMPARABLE,
    LEAST_GAIN,
    LEAST_PEAK,
    SILENCE,
    ResonanceFit,
    agreement,
    refuse_contradiction,
    refuse_vague,
)
from padgen.physics.separable_fit import SeparableFit, correlation_factor

__all__ = [
    "LARGEST_Q",
    "LEAST_Q",
    "MOST_MODES",
    "MOST_SAMPLES",
    "SAMPLES_PER_PERIOD",
    "main_mode",
    "poles",
    "record_result",
    "refuse_noise",
    "refuse_record",
    "refuse_short",
    "structured",
    "worth_a_mode",
]

FEWEST_PERIODS = 4.0
SAMPLES_PER_PERIOD = 24.0
"""Kept where a record has many more."""
MOST_SAMPLES = 1 << 17
"""Samples that are fitted, beyond which a fit takes minutes and gigabytes."""
MOST_MODES = 4
WORTH = 40.0
"""What a further mode must take off the sum of squares, in variances."""
LEAST_Q, LARGEST_Q = 0.55, 1e7


def poles(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poles λ (m,) of ln f₀, ln Q in turn, and their slopes over ln Q; those over ln f₀ are λ itself."""
    omega, q = 2 * np.pi * np.exp(theta[::2]), np.exp(theta[1::2])
    root = np.sqrt(1 - 1 / (4 * q * q))
    return omega * (-1 / (2 * q) + 1j * root), omega * (1 / (2 * q) + 1j / (4 * q * q * root))


def structured(fit: SeparableFit) -> bool:
    """Whether what is left of a record has a line that stands out of noise, or is alike at neighbours."""
    power = np.abs(np.fft.rfft(fit.residual - fit.residual.mean()))[1:-1] ** 2
    # A line of white noise is above m times the mean with probability exp(-m).
    return bool(power.max() > power.mean() * (np.log(len(power)) + 5) or correlation_factor(fit.residual) > 1)


def worth_a_mode(more: SeparableFit, fit: SeparableFit, seconds: float) -> bool:
    """Whether a further mode is worth its numbers and stands apart from the others."""
    gain = float(fit.residual @ fit.residual) - float(more.residual @ more.residual)
    hz, q = np.exp(more.theta[::2]), np.exp(more.theta[1::2])
    near = np.abs(hz[:-1] - hz[-1]) < 0.5 * np.maximum(hz[:-1] / q[:-1], max(hz[-1] / q[-1], 1 / seconds))
    return gain >= WORTH * more.noise**2 and not near.any()


def record_result(
    fit: SeparableFit,
    main: int,
    peak: float,
    peak_error: float,
    circle: CircleFit | None,
    others: tuple[tuple[float, float], ...],
    noise: float | None = None,
) -> ResonanceFit:
    widened = correlation_factor(fit.residual)
    hz, q = float(np.exp(fit.theta[2 * main])), float(np.exp(fit.theta[2 * main + 1]))
    hz_error, q_error = (widened * s for s in np.sqrt(np.diag(fit.covariance))[2 * main : 2 * main + 2])
    errors = float(hz * hz_error), float(q * q_error)
    refuse_vague(hz, errors[0], q)
    check: tuple[str, float, float, float, float] = ("", np.nan, np.nan, np.nan, np.nan)
    agree = True
    if circle is not None:
        check = ("circle", *circle[:4])
        agree = agreement((hz, errors[0]), (q, errors[1]), (check[1], check[2]), (check[3], check[4]))
        if not agree:
            refuse_contradiction(hz, q, "circle", check[1], check[3])
    noise = fit.noise if noise is None else noise
    return ResonanceFit(hz, errors[0], q, errors[1], peak, float(widened * peak_error), noise, *check, agree, others)


def main_mode(hz: np.ndarray, peak: np.ndarray, near_hz: float | None) -> int:
    if near_hz is None:
        return int(peak.argmax())
    return int(np.where(peak >= COMPARABLE * peak.max(), np.abs(np.log(hz / near_hz)), np.inf).argmin())


def refuse_record(y: np.ndarray) -> None:
    if len(y) < 32:
        raise SolverError(f"must have at least 32 samples, got {len(y)}")
    if not np.isfinite(y).all():
        raise SolverError(f"must be finite numbers, sample {int(np.argmin(np.isfinite(y))) + 1} is not")
    if np.ptp(y) < SILENCE:
        raise SolverError(f"is {number(float(y[0]))} throughout: nothing was measured here")


def refuse_short(seconds: float, hz: float) -> None:
    if seconds * hz < FEWEST_PERIODS:
        raise SolverError(
            f"holds {number(float(seconds * hz))} periods of {number(hz)} Hz; record at least"
            f" {at_least(FEWEST_PERIODS / hz)} s"
        )


def refuse_noise(peak: float, noise: float, gain: float, what: str) -> None:
    if peak < LEAST_PEAK * noise or gain < LEAST_GAIN:
        stands = f"{20 * np.log10(max(peak / noise, 1e-3)):.1f} dB" if noise > 0 else "nothing"
        raise SolverError(
            f"shows no {what}: the best one stands {stands} over the noise of a sample, at least 6 dB are needed;"
            " excite more, or leave this taxel out"
        )
