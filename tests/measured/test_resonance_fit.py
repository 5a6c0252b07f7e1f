"""Fits of a resonance against the one that made the data.

| figure | reference | tolerance | reason |
|---|---|---|---|
| f, Q, peak without noise | the model's own | 1e-8 | rounding and the search's end |
| f, complex at 30 dB, Q 2 … 30 | the model's own | median 0.3 % | the bar of re-tuning |
| error over sigma, 150 fits | 1 | 0.7 … 1.4 | sampling is 6 %; the rest is the linear rule |
| circle and least squares | each other | 3 sigma | the same data |
| magnitude against complex | the model's own | 0.3 %, pulls 0.7 … 1.4 | as above, 50 fits: sampling 10 % |
| decay, driven record | the model's own | pulls 0.6 … 1.5 | 40 fits: sampling 11 % |
| driven record | receptance at every line by FFT | 1e-3 of f and Q, 1 % of the peak | straight lines between samples |
| current of a voltage | V/Z at a steady tone | 1 % | straight lines between 80 samples a period |
| Taubin's circle | the points' own | 1e-12 | no noise |
"""

import tracemalloc
from contextlib import suppress

import numpy as np
import pytest

from padgen.core.errors import SolverError
from padgen.physics.resonance_fit import _correlation, current_of_voltage, fit_decay, fit_driven, fit_spectrum
from padgen.physics.resonance_judge import (
    NEEDED,
    NEEDED_OF_SPECTRA,
    CircleFit,
    circle_resonance,
    judge_agreement,
    point_noise,
    taubin_circle,
)

SWEEP = np.linspace(40.0, 160.0, 100)
FINE = np.linspace(40.0, 160.0, 200)


def receptance(frequency, hz, q, peak=1.0, far=0.0, low=0.0):
    s = frequency / hz
    clean = peak / (q * (1 - s * s) + 1j * s) + far
    return clean + low / s**2 if low else clean


def noise(rng, count, sigma):
    return sigma / np.sqrt(2) * (rng.standard_normal(count) + 1j * rng.standard_normal(count))


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def pulls(fit, hz, q, peak):
    return [
        (fit.resonance_hz - hz) / fit.resonance_error_hz,
        (fit.q - q) / fit.q_error,
        (fit.peak - peak) / fit.peak_error,
    ]


@pytest.mark.parametrize("q", [1.2, 5, 40])
def test_clean_spectrum_gives_back_the_model(q):
    frequency = np.linspace(20, 200, 400)
    fit = fit_spectrum(frequency, receptance(frequency, 80.0, q, 3 * np.exp(0.7j), 0.02j, 0.01))
    assert (fit.resonance_hz, fit.q, fit.peak) == pytest.approx((80, q, 3), rel=1e-8)
    assert fit.agree


def test_high_q_and_any_unit():
    frequency = np.linspace(79.9, 80.1, 120)
    data = 1e-9 * (receptance(frequency, 80.004, 1e4) + noise(np.random.default_rng(1), 120, 0.03))
    fit = fit_spectrum(frequency, data)
    assert abs(fit.resonance_hz - 80.004) < 4 * fit.resonance_error_hz < 1e-3
    assert abs(fit.q / 1e4 - 1) < 0.1
    assert fit.peak == pytest.approx(1e-9, rel=0.05)


@pytest.mark.soak
@pytest.mark.sample(1)
@pytest.mark.parametrize("q", [2, 15, 30])
def test_error_at_30_db_and_honest_sigmas(q):
    rng = np.random.default_rng(q)
    off = []
    pull = []
    agreed = 0
    for _ in range(50):
        hz = 80 * np.exp(0.08 * rng.standard_normal())
        data = receptance(SWEEP, hz, q, np.exp(0.3j), 0.1 / q, -0.05 / q) + noise(rng, len(SWEEP), 1 / 31.6)
        fit = fit_spectrum(SWEEP, data)
        off.append(abs(fit.resonance_hz / hz - 1))
        pull.append(pulls(fit, hz, q, 1.0))
        agreed += fit.agree
    assert np.median(off) <= 0.003
    assert all(0.7 < rms(column) < 1.4 for column in np.transpose(pull))
    assert agreed >= 47


def test_magnitude_alone():
    rng = np.random.default_rng(4)
    off = []
    pull = []
    agreed = 0
    for _ in range(25):
        hz = 80 * np.exp(0.05 * rng.standard_normal())
        size = np.abs(receptance(FINE, hz, 15, 2.0, 0.01, -0.005) + noise(rng, len(FINE), 2 / 31.6))
        fit = fit_spectrum(FINE, size)
        off.append(abs(fit.resonance_hz / hz - 1))
        pull.append(pulls(fit, hz, 15, 2.0))
        agreed += fit.agree
    assert np.median(off) <= 0.003
    assert all(0.7 < rms(column) < 1.4 for column in np.transpose(pull))
    assert agreed >= 23


def test_magnitudes_know_their_noise_floor():
    rng = np.random.default_rng(16)
    frequency = np.linspace(20, 320, 1500)
    mean = np.zeros(2)
    for _ in range(8):
        fit = fit_spectrum(frequency, np.abs(receptance(frequency, 80, 15) + noise(rng, 1500, 0.25)))
        mean += np.array([(fit.q - 15) / fit.q_error, fit.noise / 0.25 - 1]) / 8
    assert abs(mean[0]) < 1.2
    # Where noise is all there is, a magnitude scatters less than a part of the complex response.
    assert -0.25 < mean[1] < 0.05


def test_a_small_second_mode_does_not_pull():
    data = receptance(FINE, 80, 20) + receptance(FINE, 92, 25, 0.3)
    data += noise(np.random.default_rng(2), len(FINE), 0.01)
    fit = fit_spectrum(FINE, data)
    assert abs(fit.resonance_hz - 80) < 4 * fit.resonance_error_hz < 0.1
    assert [round(hz) for hz, _ in fit.others] == [92]


def test_a_stiffening_spring_is_flagged():
    """A bent peak is no resonance of the model: the two methods disagree, and the fit reports it."""
    x = 20 * (FINE / 80 - 80 / FINE)
    size = 1 / np.sqrt(1 + x * x)
    for _ in range(200):
        size = 0.5 * size + 0.5 / np.sqrt(1 + (x + size**2) ** 2)
    bent = size * np.exp(-1j * (np.pi / 2 + np.arctan(x + size**2)))
    assert not fit_spectrum(FINE, bent + noise(np.random.default_rng(3), len(FINE), 0.01)).agree


NOISE = noise(np.random.default_rng(5), len(FINE), 0.03)
TWO = receptance(FINE, 70, 20) + receptance(FINE, 110, 20, 0.8)
BAD = {
    "no peak": (NOISE, "shows no resonance between 40 and 160 Hz"),
    "lower edge": (receptance(FINE, 40.4, 20) + NOISE, "at the lower end of the sweep, 40 Hz; start the sweep at 3"),
    "upper edge": (receptance(FINE, 159, 20) + NOISE, "at the upper end of the sweep, 160 Hz; end the sweep at 17"),
    "above": (receptance(FINE, 175, 20) + NOISE, "upper end of the sweep"),
    "two peaks": (TWO + NOISE, "has two peaks, at 7"),
    "too few points": (
        receptance(FINE, 80, 200),
        "points within a bandwidth of the peak at [78].*, where 3 are needed",
    ),
    "turned phase": (receptance(FINE, 80, 20).conj() + NOISE, "the phase rises through the peak at [78]"),
    "radians": (
        np.abs(receptance(FINE, 80, 20)) * np.exp(1j * np.radians(np.angle(receptance(FINE, 80, 20)))),
        "does not fall by 180°",
    ),
    "zero": (np.zeros(len(FINE)), "is 0 at all frequencies"),
    "constant": (np.full(len(FINE), 3.0), "is 3 at all frequencies"),
    "nan": (np.where(np.arange(len(FINE)) == 6, np.nan, NOISE), "point 7 is not"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_spectra(name):
    data, sentence = BAD[name]
    with pytest.raises(SolverError, match=sentence):
        fit_spectrum(FINE, data)


@pytest.mark.parametrize("name", ["no peak", "lower edge", "upper edge", "two peaks", "too few points", "zero"])
def test_bad_magnitudes(name):
    data, sentence = BAD[name]
    with pytest.raises(SolverError, match=sentence):
        fit_spectrum(FINE, np.abs(data))


def test_bad_frequencies():
    with pytest.raises(SolverError, match="point 4 has 42"):
        fit_spectrum(np.concatenate([[40, 41, 43, 42], np.arange(44.0, 60)]), NOISE[:20])
    with pytest.raises(SolverError, match="at least 12 frequencies, got 5"):
        fit_spectrum(FINE[:5], NOISE[:5])


@pytest.mark.parametrize("fit", [fit_spectrum, lambda f, h, near: fit_spectrum(f, np.abs(h), near)])
def test_nearest_of_two_peaks(fit):
    assert fit(FINE, TWO + NOISE, 75.0).resonance_hz == pytest.approx(70, rel=0.01)
    assert fit(FINE, TWO + NOISE, 105.0).resonance_hz == pytest.approx(110, rel=0.01)


def test_noise_alone_is_never_a_resonance():
    rng = np.random.default_rng(6)
    for count in (30, 100, 400) * 2:
        with pytest.raises(SolverError):
            fit_spectrum(np.linspace(40, 160, count), noise(rng, count, 1.0))


def test_a_peak_below_6_db_is_refused_however_many_points_show_it():
    frequency = np.linspace(40, 160, 4000)
    data = receptance(frequency, 80, 10) + noise(np.random.default_rng(15), 4000, 10 ** (-3 / 20))
    with pytest.raises(SolverError, match=r"is [23]\.\d dB above the noise of a point, where 6 dB are needed"):
        fit_spectrum(frequency, data)


# Circles and the parts


def test_taubin_circle_of_points_on_one():
    points = 3 - 2j + 5 * np.exp(1j * np.linspace(0.3, 2.0, 9))
    centre, radius = taubin_circle(points, np.linspace(1, 2, 9))
    assert abs(centre - (3 - 2j)) < 1e-12
    assert radius == pytest.approx(5, rel=1e-12)


def test_circle_sigmas_are_honest():
    rng = np.random.default_rng(7)
    frequency = np.linspace(70, 90, 80)
    pull = []
    for _ in range(200):
        data = receptance(frequency, 80, 20, 1j) + noise(rng, 80, 0.03)
        found = circle_resonance(frequency, data, 80.3, 17)
        pull.append([(found.resonance_hz - 80) / found.resonance_error_hz, (found.q - 20) / found.q_error])
    assert all(0.7 < rms(column) < 1.4 for column in np.transpose(pull))


def test_correlated_residuals_widen():
    white = np.random.default_rng(9).standard_normal(4000)
    alike = np.convolve(white, np.ones(9) / 3, "same")
    assert _correlation(white) == 1
    assert _correlation(alike) == pytest.approx(np.sqrt((1 + 8 / 9) / (1 - 8 / 9)), rel=0.1)


def test_point_noise_of_a_peak():
    data = receptance(FINE, 80, 10) + noise(np.random.default_rng(10), len(FINE), 0.05)
    assert point_noise(data) == pytest.approx(0.05, rel=0.2)


# Records


def decay(rate, seconds, hz, q):
    time = np.arange(int(rate * seconds)) / rate
    return np.exp(-np.pi * hz / q * time) * np.cos(2 * np.pi * hz * np.sqrt(1 - 1 / (4 * q * q)) * time)


@pytest.mark.sample(2)
@pytest.mark.parametrize(("q", "seconds"), [(3, 0.5), (15, 0.2), (60, 2), (1e4, 5)])
def test_free_decay(q, seconds):
    rng = np.random.default_rng(11)
    pull = []
    for _ in range(10):
        hz = 80 * np.exp(0.1 * rng.standard_normal())
        y = decay(2000, seconds, hz, q)
        fit = fit_decay(2000.0, 0.3 + y + (0.02 if q < 5 else 0.03) * rng.standard_normal(len(y)))
        assert abs(fit.resonance_hz / hz - 1) < 0.02
        pull.append([(fit.resonance_hz - hz) / fit.resonance_error_hz, (fit.q - q) / fit.q_error])
        assert fit.agree
    f_pull, q_pull = (rms(column) for column in np.transpose(pull))
    # The recorder's clock, and a gain that drifts as damping does, count for more where a decay is long.
    least = 0.4 if q < 50 else 0.0
    assert least < f_pull < 1.7
    assert least < q_pull < 1.7


def test_clean_decay_beside_a_second_mode_before_a_quiet_start():
    y = np.concatenate([np.zeros(100), decay(2000, 1, 80, 20) + 0.2 * decay(2000, 1, 210, 30)])
    fit = fit_decay(2000.0, y)
    assert (fit.resonance_hz, fit.q) == pytest.approx((80, 20), rel=1e-5)
    assert fit.others[0][0] == pytest.approx(210, rel=1e-6)


@pytest.mark.parametrize(
    ("y", "sentence"),
    [
        (decay(2000, 1, 80, 20)[::-1], "a free decay starts at its largest"),
        (decay(2000, 1, 80, 20) + 0.9 * decay(2000, 1, 130, 20), "has two peaks, at 80"),
        (np.zeros(500), "is 0 throughout"),
        (np.ones(10), "at least 32 samples, got 10"),
        (np.random.default_rng(12).standard_normal(2000), "shows no free decay|starts at its largest|is known only"),
        (decay(2000, 0.03, 80, 20), "periods of|is known only"),
    ],
)
def test_bad_decays(y, sentence):
    with pytest.raises(SolverError, match=sentence):
        fit_decay(2000.0, y)


def answer(x, rate, hz, q, peak):
    """Return the displacement by the receptance at every line of x, over twice the time so that nothing wraps round."""
    frequency = np.fft.rfftfreq(2 * len(x), 1 / rate)
    return np.fft.irfft(np.fft.rfft(x, 2 * len(x)) * receptance(frequency, hz, q, peak))[: len(x)]


def chirp(rate, seconds, low=20.0, high=400.0):
    time = np.arange(int(rate * seconds)) / rate
    phase = 2 * np.pi * low * seconds / np.log(high / low) * ((high / low) ** (time / seconds) - 1)
    return 0.01 * (1 - np.cos(phase)) * np.minimum(1, 20 * (1 - time / seconds))


@pytest.mark.parametrize(("q", "seconds"), [(3, 2), (15, 3), (200, 6)])
def test_driven_clean(q, seconds):
    x = chirp(1000.0, seconds)
    fit = fit_driven(1000.0, x, answer(x, 1000.0, 80, q, 50.0))
    assert (fit.resonance_hz, fit.q) == pytest.approx((80, q), rel=1e-3)
    assert fit.peak == pytest.approx(50, rel=1e-2)


def test_driven_sigmas_are_honest():
    rng = np.random.default_rng(13)
    x = chirp(1000.0, 3)
    pull = []
    for _ in range(20):
        hz = 80 * np.exp(0.1 * rng.standard_normal())
        y = answer(x, 1000.0, hz, 15, 50.0)
        fit = fit_driven(1000.0, x, y + 0.03 * np.abs(y).max() * rng.standard_normal(len(y)))
        pull.append(pulls(fit, hz, 15, 50.0))
        assert fit.agree
    assert all(0.6 < rms(column) < 1.5 for column in np.transpose(pull))


@pytest.mark.parametrize(
    ("y", "sentence"),
    [
        (0.1 * np.random.default_rng(14).standard_normal(3000), "shows no answer to the excitation|is known only"),
        (
            answer(chirp(1000.0, 3), 1000.0, 80, 30, 50.0) + answer(chirp(1000.0, 3), 1000.0, 140, 30, 45.0),
            "has two peaks, at 80",
        ),
    ],
)
def test_bad_driven(y, sentence):
    with pytest.raises(SolverError, match=sentence):
        fit_driven(1000.0, chirp(1000.0, 3), y)


def test_driven_without_an_excitation():
    with pytest.raises(SolverError, match="does not change"):
        fit_driven(1000.0, np.ones(3000), chirp(1000.0, 3))


@pytest.mark.parametrize("inductance", [0.0, 1e-9, 0.0417])
def test_current_of_a_voltage(inductance):
    rate = 8000.0
    hz = 100.0
    ohm = 62.9
    time = np.arange(8000) / rate
    z = ohm + 2j * np.pi * hz * inductance
    current = current_of_voltage(rate, np.sin(2 * np.pi * hz * time), ohm, inductance)
    steady = (np.exp(2j * np.pi * hz * time) / z).imag
    assert current[4000:] == pytest.approx(steady[4000:], abs=0.01 / abs(z))


def test_a_low_resonance_in_a_sweep_that_is_mostly_noise():
    """Two decades above the resonance there is only noise; the fit starts at the peak of the magnitude."""
    frequency = np.geomspace(20, 9000, 1200)
    for seed in range(12):
        rng = np.random.default_rng(seed)
        s = frequency / 52.9
        clean = 1 / (15 * (1 - s) * (1 + s) + 1j * s) + 0.3 / (15 * (1 - s / 4) * (1 + s / 4) + 0.25j * s)
        noise = rng.standard_normal((2, len(s))) / 31.6 / 2**0.5
        fit = fit_spectrum(frequency, clean + noise[0] + 1j * noise[1])
        # Four sigmas of a fit at 30 dB with some 40 points in the bandwidth.
        assert fit.resonance_hz == pytest.approx(52.9, rel=2e-3)


# Bounds


def peak_bytes(run):
    tracemalloc.start()
    with suppress(SolverError):
        run()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


@pytest.mark.parametrize("q", [1e4, 1e6])
def test_memory_goes_with_the_record_not_with_q(q):
    x = chirp(2000.0, 3, 20.0, 250.0)
    y = answer(x, 2000.0, 60, q, 50.0)
    assert peak_bytes(lambda: fit_driven(2000.0, x, np.round(3e4 * y / np.abs(y).max()))) < 3e7
    assert peak_bytes(lambda: fit_decay(2000.0, decay(2000, 3, 60, q))) < 3e7


def test_a_decay_that_outlasts_its_record():
    x = chirp(1000.0, 3)
    for q in (2e3, 2e5):
        fit = fit_driven(1000.0, x, answer_from_rest(x, 1000.0, 80, q))
        assert (fit.resonance_hz, fit.q) == (pytest.approx(80, rel=1e-6), pytest.approx(q, rel=1e-2))


def answer_from_rest(x, rate, hz, q):
    """Return the displacement by an impulse response that outlasts the record."""
    time = np.arange(len(x)) / rate
    own = 2 * np.pi * hz * np.sqrt(1 - 1 / (4 * q * q))
    return np.convolve(x, np.exp(-np.pi * hz / q * time) * np.sin(own * time))[: len(x)]


def test_records_and_spectra_that_are_too_long_are_refused_at_once():
    x = np.tile(chirp(1000.0, 3), 1000)
    with pytest.raises(SolverError, match=r"lasts 3000 s; at most 786.4 s of it can be fitted: cut it"):
        fit_driven(1000.0, x, x)
    frequency = np.linspace(1, 100, 200_000)
    for fit in (fit_spectrum,):
        with pytest.raises(SolverError, match="has 200000 frequencies, at most 131072 are fitted"):
            fit(frequency, np.abs(receptance(frequency, 50, 15)))


def test_a_long_decay_is_fitted_by_its_beginning():
    y = np.zeros(4_000_000)
    fits = []
    y[:20_000] = decay(2000, 10, 80, 20)
    assert peak_bytes(lambda: fits.append(fit_decay(2000.0, y))) < 4e8
    assert (fits[0].resonance_hz, fits[0].q) == pytest.approx((80, 20), rel=1e-4)


def test_methods_a_bandwidth_apart_are_refused_and_errors_apart_are_not():
    def beside(hz, q):
        return judge_agreement(CircleFit(60, 1e-3, 15, 1e-3), CircleFit(hz, 1e-3, q, 1e-3), NEEDED)

    assert not beside(60.9, 20)
    for hz, q in ((61.1, 15), (58.9, 15), (60, 31), (60, 7)):
        with pytest.raises(SolverError, match=f"least squares find 60 Hz with a Q of 15, the circle {hz} Hz"):
            beside(hz, q)


def test_what_noise_hides_is_refused_with_how_much_more_is_needed():
    """Ten percent of Q, and 0.3 of half a bandwidth, must be three sigma of noise."""

    def known(error_hz, q_error, needed=NEEDED):
        return judge_agreement(CircleFit(60, error_hz, 15, q_error), None, needed)

    assert known(0.19, 0.49)
    with pytest.raises(SolverError, match=r"noise hides .* it is known only to ± 0.63 Hz .* where ± 0.6 Hz are needed"):
        known(0.21, 0.49)
    with pytest.raises(
        SolverError, match=r"its Q of 15 .* ± 20 % .* ± 10 % .*pluck, 2\.0?\d* times as hard, average 5 "
    ):
        known(0.19, 1.0001)
    with pytest.raises(SolverError, match="100 times as hard"):
        known(0.19, np.nan)
    # A spectrum was averaged by whoever made it.
    assert known(0.9, 3.0, NEEDED_OF_SPECTRA)


@pytest.mark.parametrize("bend", [0.1, -0.1])
def test_a_drift_that_looks_like_damping_is_in_the_interval_of_q(bend):
    y = decay(2000, 3, 80, 20)
    drifted = y * np.linspace(1 - bend / 2, 1 + bend / 2, len(y))
    fits = [fit_decay(2000.0, each) for each in (y, drifted)]
    assert 0.3 < abs(fits[1].q - 20) / fits[1].q_error < 1.96
    # No line of the residual shows it: so it is there without any drift, too, and larger in a shorter record.
    assert fits[0].q_error == pytest.approx(fits[1].q_error, rel=0.05)
    assert fit_decay(2000.0, y[:3000]).q_error == pytest.approx(2 * fits[0].q_error, rel=0.05)


def test_a_drift_that_noise_shows_is_fitted():
    rng = np.random.default_rng(17)
    x = 1 + 0.3 * rng.standard_normal(8000)
    y = answer(x - 1, 1000.0, 80, 15, 50.0)
    slow = np.linspace(-1, 1, 8000)
    for gain in (1 + 0.05 * slow, 1 - 0.05 * slow**2):
        fit = fit_driven(1000.0, x, y * gain)
        assert (fit.resonance_hz, fit.q) == (pytest.approx(80, rel=1e-4), pytest.approx(15, rel=1e-3))
        assert fit.q_error < 0.02


def test_further_plucks_are_fitted_together():
    rng = np.random.default_rng(18)
    one = [decay(2000, seconds, 80, 15) for seconds in (1.0, 1.3, 0.9, 1.1)]
    for low in (0.6, 0.2):  # the last one weaker, or too weak to be a pluck
        y = np.concatenate([k * each for k, each in zip((0.8, 1, 0.9, low), one, strict=True)])
        y = y + 0.02 * rng.standard_normal(len(y))
        alone = fit_decay(2000.0, y[:2000])
        all_of_them = fit_decay(2000.0, y)
        # By 1, 1.25 and 1.125 times the first, the noise is that of 2.5 such plucks or more.
        assert all_of_them.resonance_error_hz < 0.6 * alone.resonance_error_hz
        assert abs(all_of_them.resonance_hz - 80) < 3 * all_of_them.resonance_error_hz


def test_clipped_samples_beyond_what_can_be_restored_are_refused():
    x = np.tile(chirp(1000.0, 3), 40)
    y = answer(x, 1000.0, 80, 15, 50.0)
    clipped = np.zeros(len(x), bool)
    clipped[1000:6000] = True
    with pytest.raises(
        SolverError, match=r"has \d{4} clipped samples, at most 4000 can be restored: lower the input's"
    ):
        fit_driven(1000.0, x, y, clipped=clipped)


def test_a_constant_between_silence_hides_no_noise():
    rng = np.random.default_rng(9)
    x = np.zeros(10_000)
    x[1000:9000] = 1 + 0.15 * rng.standard_normal(8000)
    fit = fit_driven(1000.0, x, answer(x, 1000.0, 80, 15, 50.0), ring_s=0.06)
    assert (fit.resonance_hz, fit.q) == (pytest.approx(80, rel=1e-3), pytest.approx(15, rel=1e-2))
