"""The signals that are played to measure a pad, against calculus and the Fourier transform.

| figure | reference | tolerance | reason |
|---|---|---|---|
| volts | R i + L times the spline's derivative of i | 1e-3 of the peak | the spline at 64 samples per period |
| chirp's i² | frequency from the phase of its analytic signal | 2 % | averaged over 50 ms of a sweep |
| chirp's harmonics of i² | none in twice the band | -60 dB | what fading in and out spreads |
| noise's i² | lines in the band alone | -80 dB | the fades' skirts |
| volts of noise | as above | 1e-2 of the peak | the root is steep where it is small, which the spline rounds |
| noise on a planned taxel | root mean square of its ON motion | 30 % | one record is one sample of a random level |
| chirp on a planned taxel | 0.5 … 1.02 of its ON amplitude | | the sweep is quicker than the ring-up |
"""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import hilbert

import padgen as pg
from padgen.core.errors import SpecError
from padgen.core.units import MH
from padgen.driver.excitation import KINDS, excitation
from padgen.measured.shaking import measuring_band_hz, noise_current_a, ring_s, shaking_line_a2, sweep_s
from padgen.physics.resonator import receptance
from padgen.spec import parse_spec

RATE = 16_000


def plan_of(text="", q=15, taxels=8, coil=""):
    return pg.plan(
        parse_spec(f"""
name = "t"
resolution = {taxels}
band_hz = [50, 200]
q_min = {q}
pad = {{ width_mm = 50, depth_mm = 25 }}
coil = {{ grid = [1, 2], outer_diameter_mm = 24, inner_diameter_mm = 10, core_diameter_mm = 10 {coil} }}
{text}
""")
    )


@pytest.fixture(scope="module")
def plan():
    return plan_of()


def amplitudes_um(plan, played):
    """Return the displacement (channels, samples) in µm of the plan's taxels while the file is played."""
    size = 2 * len(played.current_a)
    force = np.fft.rfft(played.current_a**2, size)
    f = np.fft.rfftfreq(size, 1 / played.rate_hz)
    motions = []
    for c in plan.channels:
        answer = receptance(f, c.resonance_hz, c.effective_mass_g * 1e-3, c.q) * c.force_constant_n_per_a2
        motions.append(np.fft.irfft(force * answer, size)[: len(played.current_a)] * 1e6)
    return np.array(motions)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("inductance", [0, 41.7])
def test_volts_drive_the_current_through_the_coil(kind, inductance):
    plan = plan_of(coil=f", name = 'paper', inductance_mh = {inductance}")
    played = excitation(plan, kind, 64 * 400)
    coil = plan.spec.coil
    assert coil.inductance_mh == inductance
    time = np.arange(len(played.current_a)) / played.rate_hz
    slope = CubicSpline(time, played.current_a)(time, 1)
    expected = coil.resistance_ohm * played.current_a + coil.inductance_mh * MH * slope
    # A root's slope is steepest where it is smallest; the spline rounds that.
    tolerance = 1e-3 if kind == "chirp" else 1e-2
    assert np.abs(played.voltage_v - expected).max() < tolerance * np.abs(expected).max()


def test_the_slope_of_noise_is_its_derivative_while_it_fades_in(plan):
    rate = 20_000
    low = 40.0
    line = shaking_line_a2(plan)
    current, slope = noise_current_a(2 * rate, rate, (low, 60.0), line, 15.0, 0)
    time = np.arange(len(current)) / rate
    fading = (time > 0.02) & (time < 4 / low)
    expected = CubicSpline(time, current)(time, 1)
    assert slope[fading] == pytest.approx(expected[fading], abs=1e-3 * np.abs(slope[fading]).max())


@pytest.mark.parametrize("kind", KINDS)
def test_it_begins_and_ends_in_silence(plan, kind):
    played = excitation(plan, kind, RATE)
    tail = round(played.sweep_s * RATE)
    assert played.current_a[0] == 0
    assert np.abs(played.current_a[tail + 1 :]).max() == 0
    assert len(played.current_a) - tail == pytest.approx(ring_s(plan) * RATE, abs=2)
    assert np.abs(np.diff(played.voltage_v)).max() < 0.2 * np.abs(played.voltage_v).max()


def test_the_square_of_a_chirp_sweeps_the_band_evenly_in_octaves(plan):
    played = excitation(plan, "chirp", RATE, seconds=4)
    low, high = measuring_band_hz(plan)
    assert low < plan.channels[0].resonance_hz / 1.9
    assert high > plan.channels[-1].resonance_hz * 1.9
    square = played.current_a**2
    swept = slice(round(0.8 * RATE), round(3.6 * RATE))
    # Without the slow part, the analytic signal's phase is the force's.
    slow = np.fft.rfft(square)
    slow[np.fft.rfftfreq(len(square), 1 / RATE) < low / 2] = 0
    phase = np.unwrap(np.angle(hilbert(np.fft.irfft(slow, len(square)))))
    time = np.arange(len(square))[swept] / RATE
    frequency = np.gradient(phase)[swept] * RATE / (2 * np.pi)
    smooth = np.convolve(frequency, np.ones(801) / 801, "same")[800:-800]
    assert smooth == pytest.approx((low * (high / low) ** (time / 4))[800:-800], rel=0.02)


def test_the_square_of_a_chirp_has_no_harmonics(plan):
    played = excitation(plan, "chirp", RATE)
    spectrum = np.abs(np.fft.rfft(played.current_a**2))
    f = np.fft.rfftfreq(len(played.current_a), 1 / RATE)
    _, high = played.band_hz
    assert spectrum[f > 2 * high].max() < 1e-3 * spectrum[(f > played.band_hz[0]) & (f < high)].max()


def test_the_square_of_noise_stays_in_the_band(plan):
    played = excitation(plan, "noise", RATE, seed=3)
    spectrum = np.abs(np.fft.rfft(played.current_a**2))
    f = np.fft.rfftfreq(len(played.current_a), 1 / RATE)
    low, high = played.band_hz
    assert spectrum[f > 1.5 * high].max() < 1e-4 * spectrum[(f > low) & (f < high)].max()
    assert (spectrum[(f > low) & (f < high)] > 0).all()


def test_noise_is_seeded(plan):
    first, again, other = (excitation(plan, "noise", RATE, seed=seed).voltage_v for seed in (0, 0, 1))
    assert (first == again).all()
    assert not np.allclose(first, other)


def test_noise_needs_less_constant_than_random_phases_would(plan):
    played = excitation(plan, "noise", RATE)
    square = played.current_a[: round(played.sweep_s * RATE)] ** 2
    # Random phases would swing down to four sigma and more.
    assert square.mean() < 2.5 * square.std()


def test_planned_taxels_move_as_they_are_to(plan):
    chirp = excitation(plan, "chirp", RATE)
    noise = excitation(plan, "noise", RATE, seconds=20)
    level = np.array([c.level_um for c in plan.channels])
    assert chirp.level_share == 1
    swing = np.ptp(amplitudes_um(plan, chirp), axis=1) / 2
    assert (swing < 1.02 * level).all()
    assert (swing > 0.5 * level).all()
    band = amplitudes_um(plan, noise)[:, RATE : 19 * RATE]
    rms = np.array([one[one.size // 8 :].std() for one in band]) * np.sqrt(2)
    assert rms == pytest.approx(level * noise.level_share, rel=0.3)


@pytest.mark.parametrize(
    ("drive", "coil", "limit"),
    [
        ("drive = { voltage_limit_v = 0.5 }", "", "volts"),
        ("", ", power_limit_w = 1e-3", "watts"),
        ("drive = { level_um = 200 }", "", "both"),
    ],
)
@pytest.mark.parametrize("kind", KINDS)
def test_limits_of_amplifier_and_coil_are_kept(drive, coil, limit, kind):
    plan = plan_of(drive, coil=coil)
    played = excitation(plan, kind, RATE)
    spec = plan.spec
    assert played.level_share < 1
    assert np.abs(played.voltage_v).max() <= spec.drive.voltage_limit_v
    assert played.copper_loss_w <= spec.coil.power_limit_w
    watts = (played.current_a**2).mean() * spec.coil.resistance_ohm
    assert played.copper_loss_w == pytest.approx(watts, rel=1e-3)


@pytest.mark.parametrize("together", [True, False])
def test_blocks_play_each_coil_its_turn(plan, together):
    played = excitation(plan, "chirp", RATE, together=together)
    whole = np.concatenate(list(played.blocks()))
    turn = played.voltage_v
    assert whole.shape == (played.samples, 2)
    assert played.seconds == pytest.approx(len(whole) / RATE)
    assert played.coils == ((0, 0), (0, 1))
    if together:
        assert (whole == turn[:, None]).all()
    else:
        n = len(turn)
        assert (whole[:n, 0] == turn).all()
        assert (whole[n:, 1] == turn).all()
        assert not whole[:n, 1].any()
        assert not whole[n:, 0].any()


def test_slow_taxels_of_high_q_take_longer():
    plan = plan_of(q=400)
    assert sweep_s(plan) == pytest.approx(4 * 400 / plan.channels[0].resonance_hz)
    assert excitation(plan, "chirp", RATE).sweep_s == pytest.approx(sweep_s(plan), rel=1e-3)


def test_two_sets_of_channels_share_an_excitation():
    plan = plan_of(taxels=4, coil=', reuse = "alternate"')
    assert plan.coils.sets == 2
    played = excitation(plan, "chirp", RATE)
    assert played.band_hz[0] < min(c.resonance_hz for c in plan.channels)


@pytest.mark.parametrize(
    ("kind", "rate", "seconds", "sentence"),
    [
        ("pluck", RATE, None, "--excite: must be one of chirp, noise, got 'pluck'"),
        ("chirp", 1000, None, r"--rate: must be at least 1\d\d\d Hz, 4 times the highest frequency that is measured"),
        ("noise", RATE, 0.01, r"--seconds: must be at least 0\.\d+ s, Q periods of the slowest taxel, got 0.01 s"),
        ("chirp", RATE, float("nan"), "--seconds: must be at least"),
        ("noise", 1_000_000, 3600, r"--seconds: 3600 s of sweep are too many samples at 1000000 Hz; at most \d"),
    ],
)
def test_refusals(plan, kind, rate, seconds, sentence):
    with pytest.raises(SpecError, match=sentence):
        excitation(plan, kind, rate, seconds)
