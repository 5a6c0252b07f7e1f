"""Measure the copper loss tables of docs/waveforms.md: `.venv/bin/python docs/measure_waveforms.py`."""

import time
from collections.abc import Callable, Iterator

import numpy as np

from padgen.physics import crest
from padgen.physics.crest import (
    RootMargin,
    comb_period_s,
    least_constant,
    low_crest_phases,
    off_resonance,
    root_margin,
    schroeder_phases,
    waveform,
)

LOW_HZ = 20.0
HIGH_HZ = 1000.0
FRAMES_S = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
COUNTS = (4, 8, 11)
DRAWS = 10_000
# Force lines over frequency: equal, or for ON displacements ∝ 1/f^p of equal masses and Q.
LAWS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "equal force lines (p = 2)": np.ones_like,
    "p = 1, equal velocity": lambda f: f,
    "p = 0, equal displacement": lambda f: f**2,
}
OHM = 62.9
HENRY = 41.7e-3
LIMIT_V = 30.0


def lines(count: int, period_s: float, law: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the harmonics of a comb nearest to an even ladder, and amplitudes that sum to 1."""
    harmonic = np.rint(np.geomspace(LOW_HZ, HIGH_HZ, count) * period_s).astype(int)
    amplitude = LAWS[law](harmonic / period_s)
    return harmonic, amplitude / amplitude.sum()


def random_search(harmonic: np.ndarray, amplitude: np.ndarray) -> float:
    """Return the least constant of `DRAWS` random phases: all on a grid, the best 20 of them exactly."""
    random = np.random.default_rng(1)
    points = 1 << (8 * int(harmonic.max()) - 1).bit_length()
    draws = random.uniform(0, 2 * np.pi, (DRAWS, len(harmonic)))
    depth = [-waveform(harmonic, amplitude[None], phase, points).min() for phase in draws]
    best = draws[np.argsort(depth)[:20]]
    return min(float(least_constant(harmonic, amplitude, phase)[0]) for phase in best)


def constant(harmonic: np.ndarray, amplitude: np.ndarray, phase: np.ndarray) -> float:
    return float(least_constant(harmonic, amplitude, phase)[0])


def frames() -> Iterator[str]:
    yield "| lines | n | " + " | ".join(f"{frame:g} s" for frame in FRAMES_S) + " |"
    yield "|" + "---|" * (2 + len(FRAMES_S))
    for law in LAWS:
        for count in COUNTS:
            cells = []
            for frame in FRAMES_S:
                harmonic, amplitude = lines(count, frame, law)
                found = constant(harmonic, amplitude, low_crest_phases(harmonic, amplitude))
                cells.append(f"**{found:.3f}** / {random_search(harmonic, amplitude):.3f}")
            yield f"| {law} | {count} | " + " | ".join(cells) + " |"


def with_margin(harmonic: np.ndarray, amplitude: np.ndarray, period_s: float, rate_hz: int) -> RootMargin:
    phase = low_crest_phases(harmonic, amplitude)
    line_a2 = 0.02 * amplitude
    return root_margin(
        harmonic,
        line_a2,
        phase,
        period_s=period_s,
        rate_hz=rate_hz,
        resistance_ohm=OHM,
        inductance_h=HENRY,
        voltage_limit_v=LIMIT_V,
    )


def margins(period_s: float = 0.5) -> Iterator[str]:
    yield "| lines | n | no phases | Schroeder | 10⁴ random | found | with margin, 48 kHz | 96 kHz | h at 48, 96 kHz |"
    yield "|" + "---|" * 9
    for law in LAWS:
        for count in COUNTS:
            harmonic, amplitude = lines(count, period_s, law)
            cells = [np.zeros(count), schroeder_phases(amplitude), low_crest_phases(harmonic, amplitude)]
            none, schroeder, found = (constant(harmonic, amplitude, phase) for phase in cells)
            kept = [with_margin(harmonic, amplitude, period_s, rate) for rate in (48000, 96000)]
            yield (
                f"| {law} | {count} | {none:.3f} | {schroeder:.3f} | {random_search(harmonic, amplitude):.3f} |"
                f" **{found:.3f}** | **{kept[0].constant:.3f}** | {kept[1].constant:.3f} |"
                f" {kept[0].share[-1]:.3f}, {kept[1].share[-1]:.3f} |"
            )


def combs() -> Iterator[str]:
    yield "| n | Q | step | period s | off, half bandwidths |"
    yield "|---|---|---|---|---|"
    for count in (2, *COUNTS, 20):
        for q in (15.0, 100.0, 1000.0):
            for step in (1, 2):
                resonance = np.geomspace(LOW_HZ, HIGH_HZ, count)
                quality = np.full(count, q)
                period = comb_period_s(resonance, quality, step, 48000)
                off = off_resonance(resonance, quality, period, step).max()
                yield f"| {count} | {q:g} | {step} | {period:.3g} | {off:.2f} |"


def times() -> Iterator[str]:
    low_crest_phases(np.array([1, 2, 3]), np.ones(3))
    yield "| n | period s | phases ms | constant of 1 state ms | of 100 states ms | margin ms |"
    yield "|---|---|---|---|---|---|"
    for count, period in ((3, 0.5), (4, 0.5), (8, 0.5), (11, 0.5), (11, 5.0), (11, 30.0), (20, 0.5), (40, 0.5)):
        spent = times_ms(*lines(count, period, "equal force lines (p = 2)"), period)
        yield f"| {count} | {period:g} | " + " | ".join(f"{ms:.1f}" for ms in spent) + " |"


def times_ms(harmonic: np.ndarray, amplitude: np.ndarray, period_s: float) -> list[float]:
    states = np.random.default_rng(0).uniform(0, 1, (100, len(harmonic)))
    phase = low_crest_phases(harmonic, amplitude)
    crest._phases.cache_clear()
    found = [milliseconds(lambda: low_crest_phases(harmonic, amplitude))]
    found.append(milliseconds(lambda: least_constant(harmonic, amplitude, phase)))
    found.append(milliseconds(lambda: least_constant(harmonic, states, phase)))
    return [*found, milliseconds(lambda: with_margin(harmonic, amplitude, period_s, 48000))]


def milliseconds(work: Callable[[], object]) -> float:
    """Return the processor time in ms, which other work on the machine influences little."""
    start = time.process_time()
    work()
    return 1e3 * (time.process_time() - start)


def main() -> None:
    tables = {
        "Copper loss over plain tones', half-second frame": margins(),
        "By frame length: found / best of 10⁴ random": frames(),
        "Periods of the comb": combs(),
        "Processor time": times(),
    }
    for title, rows in tables.items():
        print(f"\n## {title}\n")
        for row in rows:
            print(row, flush=True)


if __name__ == "__main__":
    main()
