"""The paper's measured pair, state by state: padgen's models beside the measurements.

The pair (60 and 78 Hz over one coil of 62.9 Ω and 41.7 mH) is the template *paper-pair*. The paper's
Fig. 3 is about each taxel's response over frequency, Fig. 6 about spectra in the states 10, 01, 11.
"""

import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from padgen.core.display import COLOURS, INK, plot_bytes, plot_style
from padgen.core.units import GRAM, MH, MM, UM, decibel
from padgen.physics.magnetics import impedance
from padgen.physics.resonator import receptance
from padgen.planner.plan import Plan
from padgen.verify.coupled import from_tones, make_system, simulate
from padgen.verify.propagation import signal, squared, steady_phasors, tones
from tests.finer_models import merged

__all__ = ["Comparison", "PaperFigures", "Spectrum", "draw_paper_figures", "fitted_q", "paper_figures"]

RESONANCES_HZ = np.array([60.0, 78.0])
MEASURED_OFF_DB = (25.0, 20.0)
"""Level of the taxel at 60 Hz, then of the one at 78 Hz, below its own ON level while only the other is on."""
MEASURED_BOTH_DB = -10.0
"""Approximate level of state 11, against the states with one tone."""
STATES = ("10", "01", "11")
SETTLE_S = 2.0
WINDOW_S = 1.0
SAMPLES = 512
"""Fifteen ring-ups, then one second, in which all lines of 30 and 39 Hz are whole multiples of 1 Hz."""


class Spectrum(NamedTuple):
    """Displacement of both taxels (2, ·) in µm in a state (lowest channel first).

    `phasor_um` is that of the linear model at its exact lines `line_hz`; `coupled_um` is that of the coupled system in
    time at `hz`.
    """

    state: str
    line_hz: np.ndarray
    phasor_um: np.ndarray
    hz: np.ndarray
    coupled_um: np.ndarray


class Comparison(NamedTuple):
    """A level in dB as the paper measured it (nan where it gives none) and as padgen computes it."""

    what: str
    measured_db: float
    here_db: float
    note: str


class PaperFigures(NamedTuple):
    """The data of both figures: responses (2, k) in dB over each taxel's peak at force frequencies, and spectra."""

    q: float
    force_hz: np.ndarray
    response_db: np.ndarray
    spectra: tuple[Spectrum, ...]
    comparisons: tuple[Comparison, ...]


def fitted_q() -> float:
    """Return the Q that fits both measured off levels best; they are ``Q (r² − 1)`` and ``Q (1 − 1/r²)``, r = f₂/f₁."""
    ratio = (RESONANCES_HZ[1] / RESONANCES_HZ[0]) ** 2
    shape_db = decibel(ratio - 1) + decibel(1 - 1 / ratio)
    return float(10 ** ((sum(MEASURED_OFF_DB) - shape_db) / 40))


def paper_figures(plan: Plan) -> PaperFigures:
    """Compute both figures for a plan of the paper's pair, with its masses, pull, gap and levels.

    Resonances are the measured ones.

    Raises
    ------
    SolverError
        The coupled model does not converge (a level at which a washer is pulled in).
    """
    q = fitted_q()
    spectra = tuple(_spectrum(plan, q, state) for state in STATES)
    force_hz = np.linspace(40, 100, 601)
    response = np.abs(receptance(force_hz, RESONANCES_HZ[:, None], 1.0, q))
    return PaperFigures(
        q,
        force_hz,
        20 * np.log10(response / response.max(1, keepdims=True)),
        spectra,
        _comparisons(q, spectra),
    )


def _spectrum(plan: Plan, q: float, state: str) -> Spectrum:
    channels = plan.sets[0][:2]
    coil = plan.spec.coil
    on = np.array([bit == "1" for bit in state])
    mass = np.array([c.effective_mass_g for c in channels]) * GRAM
    pull = np.array([c.force_constant_n_per_a2 for c in channels])
    system = make_system(
        RESONANCES_HZ,
        q,
        mass,
        pull,
        [c.pull_exponent for c in channels],
        coil.gap_mm * MM,
        coil.resistance_ohm,
        coil.inductance_mh * MH,
    )
    amps = np.sqrt(2 * np.array([c.line_a2 for c in channels]))[on]
    z = impedance(coil.resistance_ohm, coil.inductance_mh * MH, RESONANCES_HZ[on] / 2)
    current = tones(RESONANCES_HZ[on] / 2, amps, -np.pi / 2)
    lines = merged(squared(current))
    force = lines._replace(amplitude=pull[:, None] * lines.amplitude)
    phasors = np.abs(steady_phasors(RESONANCES_HZ, q, mass, force))
    times = SETTLE_S + np.arange(SAMPLES) * WINDOW_S / SAMPLES
    voltage = current._replace(amplitude=amps * np.abs(z), phase_rad=current.phase_rad + np.angle(z))
    motion = simulate(system, from_tones("voltage", voltage), times, tolerance=1e-6)
    found = np.abs(np.fft.rfft(motion.displacement_m, axis=1)) * 2 / SAMPLES
    found[:, 0] /= 2
    return Spectrum(state, lines.frequency_hz, phasors / UM, np.arange(found.shape[1]) / WINDOW_S, found / UM)


def _comparisons(q: float, spectra: tuple[Spectrum, ...]) -> tuple[Comparison, ...]:
    one, other, both = (s.coupled_um for s in spectra)
    low, high = (int(hz) for hz in RESONANCES_HZ)
    rows = [
        Comparison(
            "taxel of 60 Hz, only 78 Hz on, over its ON level",
            -MEASURED_OFF_DB[0],
            decibel(other[0, high] / one[0, low]),
            "",
        ),
        Comparison(
            "taxel of 78 Hz, only 60 Hz on, over its ON level",
            -MEASURED_OFF_DB[1],
            decibel(one[1, low] / other[1, high]),
            f"one Q = {q:.1f} is fitted to these two",
        ),
    ]
    shared = "paper: about 10 dB; a coil and its washers lose none, so the amplifier or its setting does"
    rows.append(
        Comparison(
            "state 11 over state 10, taxel of 60 Hz at 60 Hz, both tones at full voltage",
            MEASURED_BOTH_DB,
            decibel(both[0, low] / one[0, low]),
            shared,
        )
    )
    for name, level, note in _amplifiers():
        rows.append(Comparison(f"state 11, {name}", MEASURED_BOTH_DB, level, note))
    for kind, hz in (("sum", (low + high) // 2), ("difference", (high - low) // 2)):
        for taxel, own in enumerate((low, high)):
            level = decibel(both[taxel, hz] / both[taxel, own])
            rows.append(
                Comparison(
                    f"state 11, {kind} spur at {hz} Hz on the taxel of {own} Hz, over its own line",
                    float("nan"),
                    level,
                    "read no level from the paper",
                )
            )
    return tuple(rows)


def _amplifiers() -> list[tuple[str, float, str]]:
    """Return how an amplifier's limit lowers the wanted lines in state 11: name, level in dB, remark."""
    time = np.arange(8192) / 8192 / 3
    wave = signal(tones(RESONANCES_HZ / 2, 1.0, -np.pi / 2), time)
    clipped = np.fft.rfft(np.clip(wave, -1, 1) ** 2)[(RESONANCES_HZ / 3).astype(int)]
    level = float(np.abs(clipped).mean()) * 2 / len(time) / 0.5
    return [
        ("both tones halved to keep the peak of the sum", decibel(0.25), "the nearest; 10 dB are both tones at 0.56"),
        ("both tones at 0.71 to keep the copper loss", decibel(0.5), ""),
        ("sum clipped at the peak of one tone", decibel(level), "mean of both lines"),
    ]


def draw_paper_figures(figures: PaperFigures, path: Path) -> None:
    """Draw both figures into an SVG or PNG file, chosen by its name; the same figures give the same bytes."""
    from matplotlib.figure import Figure

    with plot_style():
        figure = Figure(figsize=(9.5, 6.6), layout="constrained")
        axes = figure.subplots(2, 2)
        _draw_response(axes[0, 0], figures)
        for axis, spectrum in zip(axes.flat[1:], figures.spectra, strict=True):
            _draw_spectrum(axis, spectrum)
        for axis in axes.flat:
            axis.grid()
    path.write_bytes(plot_bytes(figure, path.suffix[1:]))


def _draw_response(axis: Any, figures: PaperFigures) -> None:
    for name, line, colour in zip(("60 Hz taxel", "78 Hz taxel"), figures.response_db, COLOURS[:2], strict=True):
        axis.plot(figures.force_hz / 2, line, color=colour, label=name)
    low, high = RESONANCES_HZ / 2
    for at, measured, colour in ((high, MEASURED_OFF_DB[0], COLOURS[0]), (low, MEASURED_OFF_DB[1], COLOURS[1])):
        axis.plot([at], [-measured], "o", color=colour, fillstyle="none")
    axis.plot([], [], "o", color=INK, fillstyle="none", label="measured (paper)")
    axis.set(
        title=f"response over drive frequency, Q = {figures.q:.1f}",
        xlabel="drive frequency, Hz",
        ylabel="displacement, dB of own peak",
    )
    axis.legend(fontsize=8)


def _draw_spectrum(axis: Any, spectrum: Spectrum) -> None:
    for taxel, (name, colour) in enumerate(zip(("60 Hz taxel", "78 Hz taxel"), COLOURS[:2], strict=True)):
        shift = 0.4 * (2 * taxel - 1)
        found = spectrum.coupled_um[taxel]
        upto = (spectrum.hz <= 100) & (found > 1e-4)
        axis.vlines(spectrum.hz[upto] + shift, 1e-4, found[upto], color=colour, label=name)
        axis.plot(spectrum.line_hz + shift, spectrum.phasor_um[taxel], ".", color=colour)
    axis.set(
        title=f"state {spectrum.state} (lines: coupled model, dots: phasors)",
        xlabel="frequency, Hz",
        ylabel="displacement, µm",
        yscale="log",
        xlim=(-3, 100),
        ylim=(1e-4, 30),
    )
    axis.legend(fontsize=8)
