"""Extreme cases of the selectivity: Q up to 1e7, thousands of channels, lines that all but meet.

Each figure is held to the same formula in 60 digits, at the frequencies that the doubles stand for.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from padgen.physics.ladder import capacity, geometric_ladder
from padgen.physics.levels import LevelLaw
from padgen.physics.selectivity import Channels, Scheme, channels, off_energy
from padgen.verify.engines import engine
from padgen.verify.extreme import Answer, ExtremeCase

__all__ = ["selectivity_cases"]

DIGITS = 60
ROUNDING = float(np.finfo(float).eps)
PER_LINE = 16
"""Roundings that one line's energy may take, and one more for each time that the sum doubles."""


def selectivity_cases() -> Iterator[ExtremeCase]:
    """Energy of one OFF taxel in the worst state of the others, and the paper's capacity."""
    for q in (1.0, 15.0, 1e3, 1e5, 1e7):
        yield _energy(f"32 channels in 20 … 1000 Hz, Q = {q:g}", (20.0, 1000.0), 32, q, "spur-free", 16)
    wide = "of 2,048 channels over 10⁴ in frequency, Q ="
    for q, off in ((1.0, 1023), (1e7, 0), (1e7, 1023), (1e7, 2047)):
        yield _energy(f"number {off} {wide} {q:g}", (0.1, 1000.0), 2048, q, "spur-free", off)
    for scheme in ("tones", "biased"):
        for off in (0, 31, 63):
            name = f"number {off} of 64 channels with spurs, Q = 1e7"
            yield _energy(name, (20.0, 1000.0), 64, 1e7, scheme, off)
    for scheme in ("tones", "spur-free"):
        name = "8 channels within 1e-9 of each other, Q = 1e7"
        yield _energy(name, (100.0, 100.0 * (1 + 1e-9)), 8, 1e7, scheme, 4)
    for q, delta_y in ((15.0, 10.0), (1e7, 10.0), (1e7, 1e-3), (1.0, 3.9999)):
        yield _capacity(q, delta_y)


def _case(name: str, model: str, value: Callable[[], float], stated: float, exact: Callable[[], Any]) -> ExtremeCase:
    def reference() -> np.ndarray:
        with engine("mpmath").workdps(DIGITS):
            return np.array([float(exact())])

    source = f"the same sums in {DIGITS} digits (mpmath)"
    return ExtremeCase(name, "selectivity", model, lambda: Answer(np.array([value()]), stated), reference, source)


def _energy(name: str, band_hz: tuple[float, float], count: int, q: float, scheme: str, off: int) -> ExtremeCase:
    def value() -> float:
        return float(off_energy(_which(band_hz, count, q), Scheme(scheme))[off])

    def exact() -> Any:
        which, mpf = _which(band_hz, count, q), engine("mpmath").mpf
        hz, line = ([mpf(float(v)) for v in part] for part in (which.resonance_hz, which.line))
        return _summed(engine("mpmath"), hz, line, mpf(q), Scheme(scheme), off)

    return _case(name, scheme, value, (PER_LINE + float(np.log2(count))) * ROUNDING, exact)


def _capacity(q: float, delta_y: float) -> ExtremeCase:
    def exact() -> Any:
        mp = engine("mpmath")
        share = mp.mpf(delta_y) / (4 * mp.mpf(q))
        return mp.log(mp.mpf(1000) / 20) / mp.log((1 + share) / (1 - share))

    name = f"channels in 20 … 1000 Hz, Q = {q:g}, Δy = {delta_y:g}"
    return _case(name, "Eq. 12", lambda: capacity(20.0, 1000.0, q, delta_y), 8 * ROUNDING, exact)


def _which(band_hz: tuple[float, float], count: int, q: float) -> Channels:
    resonance_hz = geometric_ladder(*band_hz, count)
    return channels(resonance_hz, q, LevelLaw(1.0)(resonance_hz))


def _summed(mp: Any, hz: list[Any], line: list[Any], q: Any, scheme: Scheme, off: int) -> Any:
    def heard(frequency: Any, amplitude: Any) -> Any:
        share = frequency / hz[off]
        return (amplitude / line[off]) ** 2 / ((q * (1 - share**2)) ** 2 + share**2)

    others = [j for j in range(len(hz)) if j != off]
    total = sum(heard(hz[j], line[j]) for j in others)
    if not scheme.has_pair_spurs:
        return total
    half = 2 if scheme.name == "tones" else 1
    biased = 2 * mp.mpf(scheme.bias_ratio) * max(line)
    for place, a in enumerate(others):
        if scheme.is_biased:
            total += heard(2 * hz[a], line[a] ** 2 / (2 * biased))
        for b in others[place + 1 :]:
            both = 2 * mp.sqrt(line[a] * line[b]) if scheme.name == "tones" else line[a] * line[b] / biased
            total += heard((hz[a] + hz[b]) / half, both) + heard(abs(hz[a] - hz[b]) / half, both)
    return total
