"""The comb, its phases and its constant: against brute force, closed forms and the voltage itself.

| model | reference | tolerance | reason |
|---|---|---|---|
| period of the comb | every shorter number of samples tried | exact | the same inequality |
| least constant | grid of 64 points a cycle | curvature · (half a step)²/2 | what a grid can miss |
| phases of two lines | 720 phases tried | 1e-4 of Σ A | their grid |
| phases of harmonics 1, 2, 3 | 180² phases tried | 2e-3 of Σ A | their grid |
| copper loss of 4, 8, 11 lines on 2 Hz | 0.94, 0.62, 0.52 of tones' | 0.0015 for the first | stated to two digits |
| voltage above the band | spectrum at 12 times the rate | 0.5 dB | margin's steps of 4 % |
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from padgen.physics import crest
from padgen.physics.crest import (
    ALIAS_DB,
    EXACT,
    LEAST_SHARE,
    LONGEST_S,
    MOST_OFF,
    SHORTEST_S,
    comb_period_s,
    least_constant,
    low_crest_phases,
    off_resonance,
    on_comb,
    schroeder_phases,
    waveform,
)
from padgen.physics.resonator import relative_energy

SETTINGS = settings(max_examples=60, deadline=None, derandomize=True)
OHM = 62.9
HENRY = 41.7e-3


def even(count, period_s=0.5):
    return np.rint(np.geomspace(20, 1000, count) * period_s).astype(int)


def brute(harmonic, amplitude, phase, per_cycle=64):
    """Return the depth of one state on a fine grid, and the most that the grid can have missed."""
    points = per_cycle * int(np.max(harmonic))
    angle = np.arange(points) * (2 * np.pi / points)
    wave = sum(a * np.cos(k * angle + p) for k, a, p in zip(harmonic, amplitude, phase, strict=True))
    return -wave.min(), np.sum(amplitude * np.square(harmonic, dtype=float)) * (np.pi / points) ** 2 / 2


def constant(harmonic, amplitude):
    """Return F₀/Σ A with the phases of `low_crest_phases`."""
    amplitude = np.asarray(amplitude, float)
    phase = low_crest_phases(harmonic, amplitude)
    return least_constant(harmonic, amplitude, phase)[0] / amplitude.sum()


# The comb


@pytest.mark.parametrize("q", [1.0, 15.0, 100.0])
@pytest.mark.parametrize("step", [1, 2])
@pytest.mark.parametrize("count", [1, 2, 5])
def test_period_is_the_shortest(count, step, q):
    resonance = np.geomspace(31.7, 911.3, count)
    quality = np.full(count, q)
    rate = 4000
    period = comb_period_s(resonance, quality, step, rate)
    samples = round(period * rate)
    assert samples / rate == period
    first = int(np.ceil(max(SHORTEST_S, 2 * step / 31.7) * rate))
    worst = [off_resonance(resonance, quality, m / rate, step).max() for m in range(first, samples + 1)]
    assert worst[-1] <= MOST_OFF
    assert all(off > MOST_OFF for off in worst[:-1])


def test_lines_are_whole_multiples_of_the_step():
    resonance = np.array([3.0, 20.0, 61.0, 999.0])
    for step in (1, 2):
        found = on_comb(resonance, 0.25, step)
        assert (found % step == 0).all() and found[0] == step
        tried = np.arange(1, 400)[:, None] * step
        np.testing.assert_array_equal(found, tried[np.abs(tried / 0.25 - resonance).argmin(0), 0])


def test_sharp_lines_get_the_best_period_up_to_the_longest():
    resonance = np.geomspace(40.3, 777.7, 6)
    rate = 1000
    quality = np.full(6, 1e4)
    period = comb_period_s(resonance, quality, 1, rate)
    tried = np.arange(100, round(LONGEST_S * rate) + 1) / rate
    steps = resonance * tried[:, None]
    worst = (np.abs(np.rint(steps) / steps - 1) * 2e4).max(1)
    assert period == tried[worst.argmin()]
    assert worst.min() > MOST_OFF


def test_a_measured_pad_gets_a_comb_that_any_print_fits():
    random = np.random.default_rng(3)
    resonance = np.geomspace(20, 1000, 11) * np.exp(0.08 * random.standard_normal((64, 11)))
    quality = random.uniform(8, 20, resonance.shape)
    period = comb_period_s(resonance.ravel(), quality.ravel(), 1, 48000)
    assert off_resonance(resonance, quality, period, 1).max() <= MOST_OFF
    assert period <= (quality / resonance).max() / MOST_OFF


@pytest.mark.parametrize("apart, bound_db", [(10, 0.13), (5, 0.22)])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_line_off_by_the_most_changes_little_for_others(apart, bound_db, side):
    """Bound a neighbour's change in motion when a line moves off its resonance and is made stronger for it."""
    q = 1000.0
    own = 100.0
    half = own / (2 * q)
    heard = []
    for line in (own, own + side * MOST_OFF * half):
        made_up = relative_energy(line, own, q)
        heard.append(relative_energy(line, own + apart * half, q) / made_up)
    assert 0.02 < abs(10 * np.log10(heard[1] / heard[0])) <= bound_db


# How deep a sum dips


@SETTINGS
@given(
    st.lists(st.integers(1, 60), min_size=1, max_size=6),
    st.integers(0, 2**31),
    st.integers(1, 3),
)
def test_least_constant_is_the_depth(harmonic, seed, states):
    random = np.random.default_rng(seed)
    amplitude = random.uniform(0, 1, (states, len(harmonic))) ** 4
    phase = random.uniform(-7, 7, len(harmonic))
    found = least_constant(np.array(harmonic), amplitude, phase)
    for value, one in zip(found, amplitude, strict=True):
        depth, missed = brute(harmonic, one, phase)
        assert depth - EXACT * one.sum() - 1e-12 <= value <= depth + missed + 1e-12


@pytest.mark.parametrize("harmonic", [[97, 98, 99, 100], [1, 100], [1, 2, 29999], [500, 501, 999, 1000]])
def test_least_constant_of_narrow_and_long_combs(harmonic):
    """A grid of its density alone would miss 2 % of a dip between its points."""
    k = np.array(harmonic)
    random = np.random.default_rng(1)
    for _ in range(5):
        phase = random.uniform(0, 2 * np.pi, len(k))
        depth, missed = brute(k, np.ones(len(k)), phase)
        assert depth - len(k) * EXACT <= least_constant(k, np.ones(len(k)), phase)[0] <= depth + missed


def test_least_constant_of_known_sums():
    k = np.array([3, 7, 12])
    amplitude = np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0], [0.0, 5.0, 0.0], [1e-9, 0.0, 0.0]])
    np.testing.assert_allclose(least_constant(k, amplitude, np.full(3, np.pi)), [6, 0, 5, 1e-9], rtol=1e-12)
    # cos x + cos 2x = 2 c² + c − 1 is least at c = −1/4.
    assert least_constant(np.array([1, 2]), np.ones((1, 2)), np.zeros(2))[0] == pytest.approx(9 / 8, abs=1e-9)
    assert least_constant(np.zeros(0, int), np.zeros((2, 0)), np.zeros(0)).tolist() == [0, 0]


@SETTINGS
@given(st.integers(0, 2**31))
def test_least_constant_of_states(seed):
    """A shift in time changes nothing, a factor scales it, and blended forces need no more than the blend."""
    random = np.random.default_rng(seed)
    k = random.integers(1, 200, 5)
    one, other = random.uniform(0, 1, (2, 5)) * random.integers(0, 2, (2, 5))
    phase = random.uniform(0, 2 * np.pi, 5)
    shift = random.uniform(0, 2 * np.pi)
    first, second, both, scaled = least_constant(k, np.stack([one, other, one + other, 3.7 * one]), phase)
    scale = (one + other).sum() * EXACT * 4 + 1e-12
    assert both <= first + second + scale
    assert scaled == pytest.approx(3.7 * first, abs=scale)
    assert least_constant(k, one, phase + k * shift)[0] == pytest.approx(first, abs=scale)


def test_many_states_in_blocks(monkeypatch):
    k = even(6)
    random = np.random.default_rng(0)
    amplitude = random.uniform(0, 1, (50, 6))
    phase = random.uniform(0, 6, 6)
    at_once = least_constant(k, amplitude, phase)
    monkeypatch.setattr(crest, "BLOCK", 1 << 14)
    np.testing.assert_allclose(least_constant(k, amplitude, phase), at_once, rtol=1e-12)
    np.testing.assert_allclose([least_constant(k, one, phase)[0] for one in amplitude], at_once, rtol=1e-12)


# Phases


def test_schroeder_phases():
    """Equal lines give a parabola; otherwise each line's group delay is the share of power below it."""
    index = np.arange(7)
    np.testing.assert_allclose(schroeder_phases(np.full(7, 3.0)), -np.pi * index * (index + 1) / 7, atol=1e-12)
    steps = np.diff(schroeder_phases(np.array([1.0, 2.0, 3.0])))
    np.testing.assert_allclose(steps, -2 * np.pi * np.array([1, 5]) / 14, atol=1e-12)


@pytest.mark.sample(8)
@pytest.mark.parametrize("pair", [(1, 2), (1, 3), (3, 5), (2, 6), (10, 25), (7, 9), (4, 4)])
@pytest.mark.parametrize("second", [0.3, 1.0, 2.0])
def test_two_lines_get_their_best_phase(pair, second):
    k = np.array(pair)
    amplitude = np.array([1.0, second])
    found = constant(k, amplitude) * amplitude.sum()
    tried = [least_constant(k, amplitude, np.array([0.0, p]))[0] for p in np.linspace(0, 2 * np.pi, 721)]
    if pair == (4, 4):
        # Opposite phases would take the force away from both.
        assert found == pytest.approx(amplitude.sum(), rel=1e-9)
    else:
        assert found <= min(tried) + 1e-5
        assert found >= min(tried) - 1e-4 * amplitude.sum() * k.max()


def test_three_lines_get_their_best_phases():
    k = np.array([1, 2, 3])
    x = np.arange(96) * (2 * np.pi / 96)
    p = np.linspace(0, 2 * np.pi, 180, endpoint=False)
    second = np.cos(2 * x + p[:, None])
    third = np.cos(3 * x + p[:, None])
    depth = -(np.cos(x) + second[:, None] + third[None]).min(-1)
    found = constant(k, np.ones(3))
    assert found <= depth.min() / 3 + 2e-3
    assert found >= depth.min() / 3 - 2e-3


@pytest.mark.parametrize("count, bar", [(4, 0.9415), (8, 0.62), (11, 0.52)])
def test_copper_loss_of_a_half_second_frame(count, bar):
    """The loss is also clearly below that of a random search of 1000 draws, judged by a grid that flatters them."""
    k = even(count)
    random = np.random.default_rng(0)
    found = constant(k, np.ones(count))
    assert found <= bar
    draws = random.uniform(0, 2 * np.pi, (1000, count))
    x = np.outer(np.arange(4096) * (2 * np.pi / 4096), k)
    table = np.hstack([np.cos(x), np.sin(x)])
    depth = [-(table @ np.hstack([np.cos(d), -np.sin(d)]).T).min(0) for d in np.split(draws, 10)]
    best = draws[np.argsort(np.concatenate(depth))[:5]]
    assert found < min(least_constant(k, np.ones(count), phase)[0] for phase in best) / count
    assert found < least_constant(k, np.ones(count), schroeder_phases(np.ones(count)))[0] / count - 0.005


@pytest.mark.parametrize("exponent", [0, 1])
def test_descent_gains_on_schroeder_and_on_all_alike(exponent):
    k = even(6)
    amplitude = (k / k[0]) ** (2.0 - exponent)
    found = constant(k, amplitude)
    for phase in (np.zeros(6), schroeder_phases(amplitude)):
        assert found < least_constant(k, amplitude, phase)[0] / amplitude.sum()
    # Nearly a local optimum: no small step of any phase gains what a linear program would have seen.
    phase = low_crest_phases(k, amplitude)
    for step in np.concatenate([np.eye(6), -np.eye(6)]) * 0.003:
        assert least_constant(k, amplitude, phase + step)[0] / amplitude.sum() > found - 2e-4


def test_only_the_shape_matters():
    k = np.array([5, 12, 31, 77])
    amplitude = np.array([1.0, 0.5, 2.0, 1.5])
    phase = low_crest_phases(k, amplitude)
    np.testing.assert_array_equal(low_crest_phases(6 * k, 3.7e-13 * amplitude), phase)
    order = np.array([2, 0, 3, 1])
    np.testing.assert_array_equal(low_crest_phases(k[order], amplitude[order]), phase[order])
    crest._phases.cache_clear()
    np.testing.assert_array_equal(low_crest_phases(k, amplitude), phase)
    silent = low_crest_phases(np.array([5, 8, 12, 31, 77]), np.insert(amplitude, 1, 0.0))
    np.testing.assert_array_equal(np.delete(silent, 1), phase)
    assert low_crest_phases(k, np.zeros(4)).tolist() == [0, 0, 0, 0]
    assert low_crest_phases(np.zeros(0, int), np.zeros(0)).shape == (0,)


@settings(SETTINGS, max_examples=20)
@given(st.lists(st.integers(1, 90), min_size=1, max_size=5), st.integers(0, 2**31))
def test_phases_are_never_worse_than_none(harmonic, seed):
    k = np.array(harmonic)
    amplitude = np.random.default_rng(seed).uniform(0.1, 1, len(k))
    # Where many lines share a harmonic they keep one phase.
    assert constant(k, amplitude) <= 1 + 1e-9
    phase = low_crest_phases(k, amplitude)
    assert ((phase >= 0) & (phase <= 6.2832)).all()
    assert all(len(set(phase[k == one])) == 1 for one in k)


def test_a_long_comb_gains_little():
    """In 30 s four lines pass through all phases, so that the constant is that of any phases."""
    assert 0.98 < constant(even(4, 30.0), np.ones(4)) <= 1


# The margin


def margin(k, line, *, rate=48000, period=0.5, henry=HENRY, limit=30.0, bandwidth=None):
    phase = low_crest_phases(k, line)
    return phase, crest.root_margin(
        k,
        line,
        phase,
        period_s=period,
        rate_hz=rate,
        resistance_ohm=OHM,
        inductance_h=henry,
        voltage_limit_v=limit,
        bandwidth_hz=bandwidth,
    )


def state_voltage(k, line, phase, share, level, *, finer=12 * 48000, period=0.5, henry=HENRY):
    """Return the voltage of a state by its definition: the root of the force, differentiated by frequency."""
    points = round(finer * period)
    own = level * line
    force = least_constant(k, own, phase)[0] + share @ own + waveform(k, own[None], phase, points)[0]
    current = np.fft.rfft(np.sqrt(force), norm="forward")
    hz = np.arange(len(current)) / period
    return hz, current * (OHM + 2j * np.pi * hz * henry)


def alias_db(hz, spectrum, band):
    energy = np.abs(spectrum) ** 2
    return 10 * np.log10(energy[hz > band].sum() / energy[1:].max())


@pytest.mark.parametrize("count, exponent", [(1, 2), (2, 0), (5, 1), (11, 2)])
def test_voltage_fits_the_rate_in_every_state(count, exponent):
    k = np.array([500]) if count == 1 else even(count)
    line = 1e-3 * (k / k[-1]) ** (2.0 - exponent)
    random = np.random.default_rng(0)
    phase, found = margin(k, line)
    states = [np.ones(count), *np.eye(count), *random.uniform(0, 1, (2, count)), *random.integers(0, 2, (2, count))]
    reached = []
    peaks = []
    for level in filter(np.any, states):
        hz, spectrum = state_voltage(k, line, phase, found.share, level)
        reached.append(alias_db(hz, spectrum, 24000))
        peaks.append(np.abs(np.fft.irfft(spectrum, norm="forward")).max())
    assert max(reached) <= ALIAS_DB + 0.5
    assert max(reached[: count + 1]) == pytest.approx(found.alias_db, abs=0.5)
    assert found.alias_db > ALIAS_DB - 3
    # The largest voltage is all on's or one channel's.
    assert max(peaks[: count + 1]) == pytest.approx(found.peak_v, rel=1e-3)
    assert max(peaks) <= found.peak_v * 1.001
    least = least_constant(k, line, phase)[0]
    assert found.constant == pytest.approx((least + found.share @ line) / line.sum(), rel=1e-9)
    assert (found.share >= LEAST_SHARE).all()


def test_less_margin_would_not_do():
    k = even(4)
    line = np.full(4, 1e-3)
    phase, found = margin(k, line)
    hz, spectrum = state_voltage(k, line, phase, 0.8 * found.share, np.eye(4)[3])
    assert alias_db(hz, spectrum, 24000) > ALIAS_DB + 5


def test_margin_follows_the_amplifier():
    k = even(4)
    line = np.full(4, 1e-3)
    at_48 = margin(k, line)[1]
    assert margin(k, line, rate=96000)[1].share[-1] < 0.4 * at_48.share[-1]
    narrow = margin(k, line, bandwidth=12000)[1]
    assert narrow.share[-1] > 2 * at_48.share[-1]
    assert margin(k, line, rate=96000, bandwidth=24000)[1].share[-1] == pytest.approx(at_48.share[-1], rel=0.04)
    assert margin(k, line, bandwidth=1e6)[1].share[-1] == at_48.share[-1]
    # Half a decade above the highest line nothing keeps it: the largest margin, and what is reached is said.
    hopeless = margin(k, line, bandwidth=3000)[1]
    assert hopeless.share[-1] == crest.MOST_SHARE and hopeless.alias_db > ALIAS_DB
    assert margin(k, line, henry=0.0)[1].alias_db <= ALIAS_DB


def test_margin_keeps_the_voltage_limit_where_it_can():
    """More margin blunts the cusp of a single high channel, and with it the jump of its voltage."""
    k = np.array([500])
    line = np.array([1e-3])
    free = margin(k, line, limit=1e9)[1]
    margins = np.geomspace(free.share[0], 1.0, 60)
    theta = np.linspace(0, 2 * np.pi, 4096)
    omega = 2 * np.pi * 1000

    def peak(share):
        root = np.sqrt(1e-3 * (1 + share + np.cos(theta)))
        return np.abs(OHM * root - HENRY * 1e-3 * omega * np.sin(theta) / (2 * root)).max()

    peaks = np.array([peak(share) for share in margins])
    assert free.peak_v == pytest.approx(peaks[0], rel=1e-3)
    assert peaks.min() < 0.95 * peaks[0]
    limit = (peaks[0] + peaks.min()) / 2
    kept = margin(k, line, limit=limit)[1]
    assert kept.peak_v <= limit and kept.share[0] > free.share[0]
    assert margin(k, line, limit=0.1)[1].peak_v == pytest.approx(peaks.min(), rel=0.01)


def test_a_long_period_is_judged_by_a_piece(monkeypatch):
    k = even(5, 1.25)
    line = np.full(5, 1e-3)
    whole = margin(k, line, period=1.25)[1]
    monkeypatch.setattr(crest, "MOST_SAMPLES", 1 << 16)
    piece = margin(k, line, period=1.25)[1]
    assert piece.share[-1] == pytest.approx(whole.share[-1], rel=0.05)
    assert piece.alias_db == pytest.approx(whole.alias_db, abs=1)
    assert piece.peak_v == pytest.approx(whole.peak_v, rel=0.01)


def test_no_line_is_without_a_margin():
    """A low channel's dips are so blunt that its share would vanish in the rounding of the constant."""
    share = margin(np.array([1, 500]), np.full(2, 1e-3))[1].share
    assert share[0] == LEAST_SHARE >= 10 * EXACT and share[1] > 0.05


def test_a_silent_coil_needs_no_margin():
    found = crest.root_margin(
        np.array([3, 5]),
        np.zeros(2),
        np.zeros(2),
        period_s=0.5,
        rate_hz=48000,
        resistance_ohm=OHM,
        inductance_h=HENRY,
        voltage_limit_v=30.0,
    )
    assert found.constant == 0 and found.peak_v == 0 and found.share.tolist() == [LEAST_SHARE] * 2
