"""Written waveforms: lines and spurs of i², transitions, and volts, against formulas written out here.

Agreement:

===========================  ============================================  =========================================
figure                       against                                       tolerance
===========================  ============================================  =========================================
volts, all schemes           i(t) written out, its slope by differences    1e-7 of the peak: the differences' error
wanted lines of a file       line_a2 times the level                       2e-5; wide-11 in 24 bit 1e-4: by rounding
                                                                           its smallest line, 1/3,300 of the largest,
                                                                           scatters by 2.3e-5 (unrounded 1e-11)
all other lines of i²        0                                             −80 dB of the wanted (24 bit), −100 (float)
lines of tones and biased    the scheme's spurs, spelled out               1e-6 of the largest
ringing after a switch       0                                             −50 dB of the taxel's ON amplitude
===========================  ============================================  =========================================
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import padgen as pg
from padgen.core.errors import FileError, SpecError
from padgen.core.wav_reader import read_wav
from padgen.driver import waveform
from padgen.driver.formats.wav import WavWriter, full_scale, wave_json, write_wave
from padgen.driver.loads import load_of
from padgen.driver.waveform import (
    Timeline,
    blend,
    blend_slope,
    blocks,
    coil_lines,
    constant_a2,
    frame_s,
    make_drive,
    ramp_s,
    sample_count,
    steady,
    timeline,
    volts,
)
from padgen.measured.tuning import planned_tuning
from padgen.physics.schemes import formula
from padgen.spec import parse_spec

RATE = 48000
PAIR = 'name = "pair"\nresolution = 8\nband_hz = [50, 200]\nq_min = 15\nresonances_hz = [56, 76]\n'
PAIR += "[pad]\nwidth_mm = 25\ndepth_mm = 25\n[coil]\ngrid = [2, 2]\n"
SCHEMES = ("tones", "spur-free", "biased", "time-shared")
TEMPLATES = Path(__file__).parents[2] / "templates"


def template(name, scheme=""):
    """Plan a template with another drive than its own."""
    lines = (TEMPLATES / f"{name}.toml").read_text().splitlines()
    if scheme:
        own = "[drive]" in lines
        chosen = f'[drive]\nscheme = "{scheme}"' if own else f'drive = "{scheme}"'
        other = [line for line in lines if not line.startswith(("drive = ", "scheme = "))]
        lines = [chosen if line == "[drive]" else line for line in other]
        lines = lines if own else [chosen, *lines]
    return pg.plan(parse_spec("\n".join(lines)))


@pytest.fixture(scope="module")
def wide():
    return pg.plan("wide-11")


@pytest.fixture(scope="module")
def quads():
    """Plans of four channels a coil, in every scheme."""
    return {name: template("quad-64", name) for name in SCHEMES}


@pytest.fixture(scope="module")
def pair():
    return pg.plan(parse_spec(PAIR))


def current_a(drive, line, coil, levels, fed, t):
    """Return i(t) of a coil by the scheme's formula, with levels (n, len(t)), at any times."""
    angle = 2 * np.pi * coil.force_hz[:, None] * t + coil.phase_rad[:, None]
    lines = coil.line_a2[:, None] * levels
    if drive.scheme.name == "spur-free":
        (before, rest), (after, share) = line
        constant = constant_a2(coil, before)[0] * rest + constant_a2(coil, after)[0] * share
        root = np.sqrt(np.maximum(constant + (lines * np.cos(angle)).sum(0), 0))
        return root if drive.carrier_hz is None else np.sqrt(2) * root * np.cos(2 * np.pi * drive.carrier_hz * t)
    if drive.scheme.name == "biased":
        bias = coil.bias_a * np.sqrt(fed)
        with np.errstate(invalid="ignore", divide="ignore"):
            tones = np.where(fed > 0, lines / (2 * bias), 0.0)
        return bias + (tones * np.cos(angle)).sum(0)
    return (np.sqrt(2 * lines) * np.cos(angle / 2)).sum(0)


def written_out(drive, times, t):
    """Return the volts (len(t), coils) by the formulas, with di/dt by differences of fourth order."""
    result = np.zeros((len(t), len(drive.coils)))
    last = len(times.time_s) - 1
    step = 1e-6
    for k in range(last):
        inside = (t >= times.time_s[k]) & (t < times.time_s[k + 1])
        now = t[inside]
        for c, coil in enumerate(drive.coils):
            if not len(coil.taxels) or not inside.any():
                continue
            before = times.levels[k][coil.taxels]
            after = times.levels[k + 1][coil.taxels]
            on = [times.loops or j not in (0, last) or times.levels[j].any() for j in (k, k + 1)]

            def at(shift, coil=coil, before=before, after=after, on=on, now=now, k=k):
                share = (now + shift - times.time_s[k]) / (times.time_s[k + 1] - times.time_s[k])
                rest = blend(1 - np.clip(share, 0, 1))
                share = blend(np.clip(share, 0, 1))
                levels = before[:, None] * rest + after[:, None] * share
                fed = on[0] * rest + on[1] * share
                return current_a(drive, ((before, rest), (after, share)), coil, levels, fed, now + shift)

            slope = (8 * (at(step) - at(-step)) - (at(2 * step) - at(-2 * step))) / (12 * step)
            result[inside, c] = drive.resistance_ohm * at(0.0) + drive.inductance_h * slope
    return result


def played(drive, times, **options):
    return np.concatenate(list(volts(drive, times, **options)))


def all_on(plan):
    return np.ones(len(plan.taxels))


def some_frames(plan, kind, count=3):
    rng = np.random.default_rng(7)
    frames = rng.random((count, len(plan.taxels)))
    return np.round(frames) if kind == "on/off" else frames


@pytest.mark.sample(4)
@pytest.mark.parametrize("kind", ["on/off", "grey"])
@pytest.mark.parametrize("name", SCHEMES)
def test_volts_are_those_of_the_formula(quads, name, kind):
    plan = quads[name]
    drive = make_drive(plan, RATE)
    times = timeline(plan, some_frames(plan, kind, 1 if name == "time-shared" else 3))
    got = played(drive, times)
    assert got.shape == (sample_count(drive, times), 16)
    # Every 97th sample, away from the keyframes, where the differences would reach over.
    t = np.arange(len(got)) / RATE
    pick = np.arange(0, len(got), 97)
    far = np.abs(t[pick][:, None] - times.time_s).min(1) > 1e-4
    due = written_out(drive, times, t[pick][far])
    np.testing.assert_allclose(got[pick][far], due, rtol=0, atol=1e-7 * np.abs(due).max())
    assert np.abs(due).max() > 1


@pytest.mark.parametrize("text", ["", "[coil]\nname = 'paper'\ninductance_mh = 0\n"])
def test_coils_that_differ_are_each_their_own(text):
    # Measured pads: every coil has other frequencies; one coil has a taxel too few, one has none.
    spec = PAIR.replace("resolution = 8", "resolution = 8").replace("[coil]\n", text or "[coil]\n")
    plan = pg.plan(parse_spec('drive = "spur-free"\n' + spec))
    rng = np.random.default_rng(2)
    print_ = planned_tuning(plan)
    taxels = tuple(replace(x, resonance_hz=x.resonance_hz * rng.uniform(0.95, 1.05)) for x in print_.taxels)
    drive = make_drive(plan, 8000, replace(print_, taxels=taxels))
    left = [drive.coils[0], drive.coils[1], _without(drive.coils[2], 1), _without(drive.coils[3], 2)]
    drive = replace(drive, coils=tuple(left))
    assert len({tuple(c.harmonic) for c in left[:2]}) == 2
    times = timeline(plan, some_frames(plan, "grey"))
    got = played(drive, times)
    t = np.arange(sample_count(drive, times)) / 8000
    due = written_out(drive, times, t)
    far = np.abs(t[:, None] - times.time_s).min(1) > 1e-4
    np.testing.assert_allclose(got[far], due[far], rtol=0, atol=1e-7 * np.abs(due).max())
    assert not got[:, 3].any()
    assert (np.abs(got).max(0)[:3] > 0.1).all()


def _without(coil, count):
    keep = slice(0, len(coil.taxels) - count)
    parts = ("taxels", "force_hz", "harmonic", "line_a2", "phase_rad", "margin")
    return replace(coil, **{part: getattr(coil, part)[keep] for part in parts})


@pytest.mark.parametrize("name", ["spur-free", "tones"])
def test_two_sets_of_channels(name):
    plan = pg.plan(
        parse_spec(f'drive = "{name}"\n' + PAIR.replace("resonances_hz = [56, 76]\n", "") + 'reuse = "alternate"\n')
    )
    drive = make_drive(plan, 4000)
    assert len({tuple(coil.harmonic) for coil in drive.coils}) == 2
    times = steady(some_frames(plan, "grey", 1)[0], drive.period_s)
    due = written_out(drive, times, np.arange(drive.period_samples) / 4000)
    np.testing.assert_allclose(played(drive, times), due, rtol=0, atol=1e-7 * np.abs(due).max())


def test_blocks_join_whatever_their_size(quads, monkeypatch):
    plan = quads["biased"]
    drive = make_drive(plan, 8000)
    times = timeline(plan, some_frames(plan, "grey", 2))
    whole = played(drive, times)
    # Their rows begin elsewhere: the same but for the last digits.
    monkeypatch.setattr(waveform, "BLOCK", 1)
    monkeypatch.setattr(waveform, "ROW", 50)
    np.testing.assert_allclose(played(drive, times), whole, rtol=0, atol=1e-12 * np.abs(whole).max())
    assert max(len(samples) for samples, _ in blocks(drive, times)) == 100


def test_phases_hold_for_ten_minutes(pair):
    drive = make_drive(pg.plan(parse_spec('drive = "spur-free"\n' + PAIR)), 1000)
    times = steady(all_on(pair), round(600 / drive.period_s) * drive.period_s)
    got = played(drive, times)
    n = drive.period_samples
    assert len(got) >= 590_000
    np.testing.assert_allclose(got[-n:], got[:n], rtol=0, atol=1e-9 * np.abs(got).max())


# ---- Lines of written files


def lines_of(path, drive, report, over=1):
    """Return amplitudes (lines, coils) of i² of one period of a file of volts, by Fourier transforms alone."""
    read = read_wav(path)
    voltage = read.read() * report.full_scale
    count = len(voltage)
    hz = np.arange(count // 2 + 1) * read.rate_hz / count
    z = drive.resistance_ohm + 2j * np.pi * hz[:, None] * drive.inductance_h
    current = np.fft.irfft(np.fft.rfft(voltage, axis=0) / z, count * over, axis=0) * over
    lines = np.abs(np.fft.rfft(current**2, axis=0)) / (count * over) * 2
    lines[0] /= 2
    return lines


def spur_db(plan, drive, path, levels, depth, over):
    """Return the largest unwanted line over its coil's smallest wanted one in dB, and the wanted lines' error."""
    report = write_wave(path, drive, steady(levels, drive.period_s), depth)
    lines = lines_of(path, drive, report, over)
    worst = []
    off = []
    for k, coil in enumerate(drive.coils):
        wanted = coil.line_a2 * levels[coil.taxels]
        off.append(np.abs(lines[coil.harmonic, k] / wanted - 1).max())
        spurs = lines[1:, k].copy()
        spurs[coil.harmonic - 1] = 0
        worst.append(20 * np.log10(spurs.max() / wanted.min()))
    return max(worst), max(off)


@pytest.mark.parametrize("over", [1, 2])
@pytest.mark.parametrize("depth, bar", [("24", -80), ("float", -100)])
@pytest.mark.parametrize("name", ["wide-11", "quad-64"])
def test_a_spur_free_file_has_no_spurs(tmp_path, wide, quads, name, depth, bar, over):
    plan = wide if name == "wide-11" else quads["spur-free"]
    drive = make_drive(plan, RATE)
    db, off = spur_db(plan, drive, tmp_path / "a.wav", all_on(plan), depth, over)
    # Over the smallest wanted line, which is 1/3,300 of the largest with wide-11's unequal pulls.
    assert db <= bar + (16 if name == "wide-11" else 0)
    # Rounding to 24 bit alone scatters that line by 2.3e-5, one standard deviation over shifts of less than a step.
    assert off < (1e-4 if name == "wide-11" and depth == "24" else 2e-5)


@pytest.mark.parametrize("depth, bar", [("24", -80), ("float", -100)])
@pytest.mark.parametrize("name", ["wide-11", "quad-64"])
def test_nor_at_mixed_levels(tmp_path, wide, quads, name, depth, bar):
    plan = wide if name == "wide-11" else quads["spur-free"]
    levels = np.random.default_rng(3).uniform(0.3, 1, len(plan.taxels))
    db, off = spur_db(plan, make_drive(plan, RATE), tmp_path / "a.wav", levels, depth, 2)
    # Over the smallest wanted line, which is 1/3,300 of the largest with wide-11's unequal pulls.
    assert db <= bar + (16 if name == "wide-11" else 0)
    assert off < (1e-4 if name == "wide-11" else 2e-5)


@pytest.mark.parametrize("name", ["tones", "biased"])
def test_lines_and_spurs_of_the_other_schemes(tmp_path, quads, name):
    plan = quads[name]
    drive = make_drive(plan, RATE)
    levels = np.random.default_rng(4).uniform(0.2, 1, len(plan.taxels))
    report = write_wave(tmp_path / "a.wav", drive, steady(levels, drive.period_s), "float")
    lines = lines_of(tmp_path / "a.wav", drive, report)
    for k, coil in enumerate(drive.coils):
        due = np.zeros(len(lines), complex)
        a = coil.line_a2 * levels[coil.taxels]
        phase = np.exp(1j * coil.phase_rad)
        h = coil.harmonic
        if name == "tones":
            current = np.sqrt(2 * a) * np.sqrt(phase)
            tone = h // 2
            due[0] = a.sum()
        else:
            current = a / (2 * coil.bias_a) * phase
            tone = h
            due[0] = coil.bias_a**2 + (np.abs(current) ** 2).sum() / 2
            due[h] += a * phase
        for i in range(len(a)):
            due[2 * tone[i]] += current[i] ** 2 / 2
            for j in range(i):
                due[tone[i] + tone[j]] += current[i] * current[j]
                due[abs(tone[i] - tone[j])] += current[i] * current[j].conj()
        if name == "tones":  # the root of the phase is one of two: compare what does not depend on it
            np.testing.assert_allclose(lines[h, k], a, rtol=1e-5)
        np.testing.assert_allclose(lines[:, k], np.abs(due), rtol=0, atol=1e-6 * a.max())


@pytest.mark.parametrize("name", SCHEMES)
def test_samples_have_the_lines_and_the_mean_square_that_are_judged(quads, name):
    plan = quads[name]
    drive = make_drive(plan, RATE)
    levels = np.zeros(len(plan.taxels))
    for coil in drive.coils:
        levels[coil.taxels[: 1 if drive.scheme.takes_turns else 3]] = 0.7
    line = steady(levels, drive.period_s)
    current = np.concatenate(list(volts(drive, line, signal="current")))[: drive.period_samples]
    found = np.fft.rfft(current**2 if name == "spur-free" else current, axis=0) / len(current) * 2
    for k, coil in enumerate(drive.coils):
        harmonic, amplitude = coil_lines(drive, coil)
        share = levels[coil.taxels] if drive.scheme.has_constant else np.sqrt(levels[coil.taxels])
        np.testing.assert_allclose(
            found[harmonic, k], share * amplitude, rtol=0, atol=1e-12 * np.abs(found[:, k]).max()
        )
    np.testing.assert_allclose(load_of(plan, drive, line).square_a2, (current**2).mean(0), rtol=1e-12)
    assert [each for each in SCHEMES if formula(quads[each].scheme) == formula(plan.scheme)] == [name]


def test_on_a_carrier_the_lines_are_the_same(tmp_path, quads):
    plan = quads["spur-free"]
    spec = replace(plan.spec, drive=replace(plan.spec.drive, voltage_limit_v=500.0))
    plan = pg.plan(spec)
    drive = make_drive(plan, 96000, carrier_hz=6000)
    levels = np.random.default_rng(5).uniform(0.3, 1, len(plan.taxels))
    report = write_wave(tmp_path / "a.wav", drive, steady(levels, drive.period_s), "float")
    lines = lines_of(tmp_path / "a.wav", drive, report, 2)
    centre = round(2 * drive.carrier_hz * drive.period_s)
    for k, coil in enumerate(drive.coils):
        wanted = coil.line_a2 * levels[coil.taxels]
        np.testing.assert_allclose(lines[coil.harmonic, k], wanted, rtol=1e-4)
        for side in (1, -1):
            np.testing.assert_allclose(lines[centre + side * coil.harmonic, k], wanted / 2, rtol=1e-3)
        rest = lines[1:, k].copy()
        rest[np.concatenate([coil.harmonic, [centre], centre + coil.harmonic, centre - coil.harmonic]) - 1] = 0
        assert 20 * np.log10(rest.max() / wanted.max()) < -80
    voltage = read_wav(tmp_path / "a.wav").read()
    assert np.abs(voltage.mean(0)).max() < 1e-3 * np.abs(voltage).max()
    assert not any(finding.code == "wave.dc" for finding in report.findings)


# ---- Switching


def ringing(plan, drive, times, coil, j):
    """Return what taxel j adds to its steady motion after the end of each transition, over its ON amplitude.

    It is computed by exact steps of the taxel's mode.
    """
    t = np.arange(sample_count(drive, times)) / drive.rate_hz
    amperes = np.concatenate([samples[:, coil] for samples, _ in blocks(drive, times, signal="current")])
    own = drive.coils[coil]
    channel = plan.channels[plan.taxels[drive.coils[coil].taxels[j]].channel]
    omega = 2 * np.pi * channel.resonance_hz
    q = channel.q
    pole = omega * (-1 / (2 * q) + 1j * np.sqrt(1 - 1 / (4 * q * q)))
    # x'' + 2σx' + ω²x = ω² i²: its one complex mode, forced by straight pieces of i².
    h = 1 / drive.rate_hz
    e = np.exp(pole * h)
    low = (e - 1) / pole - (e - 1 - pole * h) / (pole**2 * h)
    high = (e - 1 - pole * h) / (pole**2 * h)
    from scipy.signal import lfilter

    state = lfilter([high, low], [1, -e], amperes**2)
    x = (state * omega**2 / (1j * pole.imag)).real

    def answer(hz):
        return 1 / (1 - (hz * 2 * np.pi / omega) ** 2 + 1j * hz * 2 * np.pi / omega / q)

    calm = np.zeros(len(t))
    over = np.zeros(len(t), bool)
    for k in range(len(times.time_s) - 1):
        inside = slice(*np.searchsorted(t, times.time_s[k : k + 2]))
        now = t[inside]
        share = blend(np.clip((now - times.time_s[k]) / (times.time_s[k + 1] - times.time_s[k]), 0, 1))
        for levels, part in ((times.levels[k], 1 - share), (times.levels[k + 1], share)):
            level = levels[own.taxels]
            mean = constant_a2(own, level)[0] if drive.scheme.name == "spur-free" else level @ own.line_a2
            force = np.full(len(now), mean)
            for i in np.flatnonzero(level):
                turn = np.exp(1j * (2 * np.pi * own.force_hz[i] * now + own.phase_rad[i]))
                force = force + level[i] * own.line_a2[i] * (answer(own.force_hz[i]) * turn).real
            calm[inside] += part * force
        over[inside] = k % 2 == 1
    return np.abs(x - calm)[over].max() / (own.line_a2[j] * q)


def test_an_off_taxel_hears_no_switch(pair, wide, quads):
    # One taxel OFF throughout, all others of its coil on and off again, in frames as fast as planned.
    for plan in (wide, quads["spur-free"], pair):
        drive = make_drive(plan, RATE)
        for j in range(1 if plan is pair else 2):
            levels = all_on(plan)
            levels[drive.coils[0].taxels[j]] = 0
            once = timeline(plan, np.stack([levels, 0 * levels]))
            # Of wide-11's unequal pulls the nearest washer hears all others' changes.
            assert 20 * np.log10(ringing(plan, drive, once, 0, j)) < (-40 if plan is wide else -50), (plan.name, j)


def test_nor_does_a_close_neighbour_of_high_q():
    # The beat with the neighbour, not the lowest resonance, says how long the transition is.
    plan = pg.plan(parse_spec(PAIR.replace("q_min = 15", "q_min = 60").replace("[56, 76]", "[100, 109]")))
    assert ramp_s(plan) == pytest.approx(2.5 / 9, rel=0.01)
    drive = make_drive(plan, RATE)
    levels = all_on(plan)
    levels[drive.coils[0].taxels[0]] = 0
    assert 20 * np.log10(ringing(plan, drive, timeline(plan, np.stack([levels, 0 * levels])), 0, 0)) < -50


@pytest.mark.parametrize("name", SCHEMES)
def test_switching_makes_no_step_and_no_peak(quads, name):
    plan = quads[name]
    drive = make_drive(plan, RATE)
    on = all_on(plan)
    whole = np.abs(played(drive, steady(on, drive.period_s)))
    jump = np.abs(np.diff(played(drive, steady(on, drive.period_s)), axis=0)).max()
    got = played(drive, timeline(plan, np.stack([on, 0 * on, on])))
    assert np.abs(got[0]).max() < 1e-100
    assert np.abs(got[-1]).max() < 1e-3 * whole.max()
    # The envelope's own slope adds L √b' to the voltage: a per cent.
    assert np.abs(np.diff(got, axis=0)).max() < 1.02 * jump
    assert np.abs(got).max() < 1.02 * whole.max()


def test_a_taxel_that_stays_on_neither_dips_nor_swells(quads):
    # Its line of i² is the same in every piece of a period, whatever else switches.
    plan = quads["spur-free"]
    drive = make_drive(plan, RATE)
    own = drive.coils[0]
    levels = np.zeros((2, len(plan.taxels)))
    levels[:, own.taxels[3]] = 1
    levels[1, own.taxels[:3]] = 1
    times = Timeline(np.array([0.0, 1.0]), levels, False)
    amperes = np.concatenate([samples[:, 0] for samples, _ in blocks(drive, times, signal="current")])
    share = blend(np.arange(len(amperes)) / RATE)
    angle = 2 * np.pi * own.force_hz[:, None] * np.arange(len(amperes)) / RATE + own.phase_rad[:, None]
    constant = [constant_a2(own, level[own.taxels])[0] for level in levels]
    rest = constant[0] * (1 - share) + constant[1] * share + share * (own.line_a2[:3] @ np.cos(angle[:3]))
    np.testing.assert_allclose(amperes**2 - rest, own.line_a2[3] * np.cos(angle[3]), atol=1e-12 * own.line_a2.max())


def test_the_smooth_step():
    s = np.linspace(0, 1, 10_001)
    np.testing.assert_allclose(blend(s) + blend(1 - s), 1, atol=1e-13)
    np.testing.assert_allclose(np.gradient(blend(s), s)[1:-1], blend_slope(s)[1:-1], atol=1e-6)
    # After RAMP_PERIODS, and any longer, 1e-4 of a step of the mean pull; after RAMP_BEATS, -38 dB of a tone's.
    for least, bar in ((9.0, 1e-4), (2.5, 10 ** (-38 / 20))):
        left = [np.abs(np.trapezoid(blend_slope(s) * np.exp(2j * np.pi * x * s), s)) for x in np.arange(least, 30, 0.1)]
        assert max(left) < bar


# ---- Files and what is said beside them


def test_a_file_is_read_back(tmp_path, pair, monkeypatch):
    drive = make_drive(pair, 4000)
    times = steady(all_on(pair), drive.period_s)
    write = WavWriter.write

    def flawed(self, samples):
        write(self, samples)
        self._file.seek(-7, 1)
        self._file.write(b"\x55")
        self._file.seek(6, 1)

    monkeypatch.setattr(WavWriter, "write", flawed)
    with pytest.raises(FileError, match="read back is not what was written"):
        write_wave(tmp_path / "a.wav", drive, times)


@pytest.mark.parametrize("depth", ["24", "float"])
def test_nothing_is_clipped_above_the_limit(tmp_path, pair, depth):
    drive = replace(make_drive(pair, 8000), voltage_limit_v=2.0)
    times = timeline(pair, np.stack([0.1 * all_on(pair), all_on(pair)]))
    report = write_wave(tmp_path / "a.wav", drive, times, depth)
    top = np.abs(played(drive, times)).max()
    assert report.peak == pytest.approx(top, rel=1e-12)
    assert 2 < report.peak < report.full_scale == 5.0
    np.testing.assert_allclose(read_wav(tmp_path / "a.wav").read() * 5, played(drive, times), atol=5 * 2.0**-23)


@pytest.mark.parametrize("name", SCHEMES)
def test_a_file_of_amperes(tmp_path, quads, name):
    plan = quads[name]
    drive = make_drive(plan, 8000)
    times = timeline(plan, np.stack([all_on(plan)]))
    report = write_wave(tmp_path / "a.wav", drive, times, "float", "current")
    read = read_wav(tmp_path / "a.wav")
    amperes = read.read() * report.full_scale
    assert report.signal == "current" and report.full_scale == full_scale(drive, "current") < 2.5 * report.peak
    assert read.comment.startswith(f"sample 1 = {report.full_scale:g} A")
    np.testing.assert_allclose(report.rms_current_a, np.sqrt((amperes**2).mean(0)), rtol=1e-5)
    np.testing.assert_allclose(report.copper_loss_w, np.array(report.rms_current_a) ** 2 * 62.9, rtol=1e-9)
    still = drive if name != "spur-free" else replace(drive, inductance_h=0.0)
    if name != "spur-free":
        still = replace(drive, inductance_h=0.0)
    np.testing.assert_allclose(played(still, times) / 62.9, amperes, atol=2.0**-22)


def test_copper_loss_against_plain_tones(tmp_path, quads):
    # Tones are themselves; without spurs the mean of i² is the constant.
    tones = make_drive(quads["tones"], RATE)
    plan = quads["spur-free"]
    free = make_drive(plan, RATE)
    on = all_on(plan)
    one = write_wave(tmp_path / "a.wav", tones, steady(on, tones.period_s))
    assert one.loss_over_tones == pytest.approx(1, abs=1e-9)
    two = write_wave(tmp_path / "b.wav", free, steady(on, free.period_s))
    coil = free.coils[0]
    assert two.loss_over_tones == pytest.approx(constant_a2(coil, np.ones(4))[0] / coil.line_a2.sum(), abs=1e-9)
    assert two.loss_over_tones < 1


def test_the_sidecar(tmp_path, quads):
    plan = quads["spur-free"]
    drive = make_drive(plan, 8000)
    times = timeline(plan, some_frames(plan, "grey", 2))
    report = write_wave(tmp_path / "a.wav", drive, times)
    text = wave_json(plan, drive, times, report)
    table = json.loads(text)
    (tmp_path / "b").mkdir()
    assert text == wave_json(plan, drive, times, write_wave(tmp_path / "b" / "a.wav", drive, times))
    assert (tmp_path / "a.wav").read_bytes() == (tmp_path / "b" / "a.wav").read_bytes()
    assert table["name"] == plan.name and table["unit"] == "V" and table["full_scale"] == 30
    assert table["wave"] == "drive.wav"
    assert (table["rate_hz"], table["count"], table["depth"]) == (8000, sample_count(drive, times), "24")
    assert table["seconds"] == pytest.approx(times.seconds, abs=1 / 8000)
    assert [entry["coil"] for entry in table["coils"]] == [[c.row, c.column] for c in drive.coils]
    assert [entry["id"] for entry in table["taxels"]] == [taxel.id for taxel in plan.taxels]
    for entry, taxel in zip(table["taxels"], plan.taxels, strict=True):
        coil = drive.coils[entry["wav_channel"]]
        assert (coil.row, coil.column) == taxel.coil
        assert entry["drive_hz"] == entry["force_hz"]
        assert entry["force_hz"] == pytest.approx(plan.channels[taxel.channel].resonance_hz, rel=0.1 / 15)
    turned = json.loads(wave_json(plan, replace(drive, coils=drive.coils[::-1]), times, report))
    assert [entry["id"] for entry in turned["taxels"]] == [taxel.id for taxel in plan.taxels]
    np.testing.assert_allclose([k["time_s"] for k in table["keyframes"]], times.time_s, rtol=1e-9)
    np.testing.assert_allclose([k["levels"] for k in table["keyframes"]], times.levels, rtol=1e-9)
    assert [f["code"] for f in table["findings"]] == ["wave.dc"]
    assert len(text.splitlines()) < 750


def test_a_file_that_cannot_be_written(tmp_path, pair, monkeypatch):
    drive = make_drive(pair, 4000)

    def full(self, samples):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch, pytest.raises(FileError, match="No space left"):
        patch.setattr(WavWriter, "write", full)
        write_wave(tmp_path / "a.wav", drive, steady(all_on(pair), drive.period_s))
    with pytest.raises(FileError, match="cannot be written"):
        write_wave(tmp_path / "no" / "a.wav", drive, steady(all_on(pair), drive.period_s))


# ---- Drives


def test_every_line_moves_its_taxel_at_its_level(quads):
    # A tuned taxel that answers half as much gets twice the line; one whose line lies off its resonance a little more.
    plan = quads["spur-free"]
    half = tuple(replace(x, response_um_per_a2=x.response_um_per_a2 / 2) for x in planned_tuning(plan).taxels)
    one = make_drive(plan, 8000)
    two = make_drive(plan, 8000, replace(planned_tuning(plan), taxels=half))
    for a, b in zip(one.coils, two.coils, strict=True):
        np.testing.assert_allclose(b.line_a2, 2 * a.line_a2, rtol=1e-12)
    for coil in one.coils:
        assert (np.diff(coil.force_hz) > 0).all()
        for index, hz, line in zip(coil.taxels, coil.force_hz, coil.line_a2, strict=True):
            channel = plan.channels[plan.taxels[index].channel]
            s = hz / channel.resonance_hz
            answer = channel.q / np.hypot(channel.q * (1 - s * s), s) / channel.stiffness_n_per_m
            assert line * channel.force_constant_n_per_a2 * answer == pytest.approx(channel.level_um * 1e-6, rel=1e-9)


def test_coils_alike_share_the_work(monkeypatch):
    plan = template("big-512")
    shaped = []
    phases = waveform.low_crest_phases
    monkeypatch.setattr(waveform, "low_crest_phases", lambda *lines: shaped.append(lines) or phases(*lines))
    drive = make_drive(plan, RATE)
    assert len(drive.coils) == 256
    # Its coils alternate between two sets of resonances.
    assert len(shaped) == 2
    assert len(list(waveform._groups(drive, steady(all_on(plan), 1.0), "voltage"))) == 2


@pytest.mark.parametrize(
    "options, sentence",
    [
        ({"rate_hz": 500}, "must be 6.. … 1000000 Hz, 8 times the highest resonance"),
        ({"rate_hz": 2_000_000}, "got 2000000 Hz"),
        ({"carrier_hz": 1000}, "is for the spur-free drive only, this one is 'tones'"),
    ],
)
def test_drives_that_cannot_be(pair, options, sentence):
    with pytest.raises(SpecError, match=sentence):
        make_drive(pair, **{"rate_hz": 8000, **options})


@pytest.mark.parametrize(
    "rate, carrier, sentence",
    [(48000, 500, "times the highest"), (48000, 23000, "got 23000"), (4000, 900, "needs a rate")],
)
def test_carriers_that_cannot_be(quads, rate, carrier, sentence):
    with pytest.raises(SpecError, match=sentence):
        make_drive(quads["spur-free"], rate, carrier_hz=carrier)


def test_a_taxel_that_is_not_pulled_cannot_be_driven(pair):
    print_ = planned_tuning(pair)
    deaf = (replace(print_.taxels[0], response_um_per_a2=0.0), *print_.taxels[1:])
    with pytest.raises(SpecError, match="is not pulled by its coil"):
        make_drive(pair, 8000, replace(print_, taxels=deaf))


# ---- Timelines


def test_frames_go_from_silence_to_silence(quads):
    plan = quads["spur-free"]
    frames = some_frames(plan, "grey", 2)
    times = timeline(plan, frames, 0.5)
    ramp = ramp_s(plan)
    np.testing.assert_allclose(times.time_s, [0, ramp, 0.5, 0.5 + ramp, 1, 1 + ramp])
    silence = 0 * frames[0]
    np.testing.assert_array_equal(times.levels, [silence, frames[0], frames[0], frames[1], frames[1], silence])


@pytest.mark.sample(4)
@pytest.mark.parametrize("name", ["paper-16", "paper-32", "paper-pair", "quad-64", "triple-48", "wide-11"])
@pytest.mark.parametrize("scheme", ["", "time-shared"])
def test_planned_frames_hold_their_transitions(name, scheme):
    plan = template(name, scheme)
    times = timeline(plan, np.zeros((2, len(plan.taxels))))
    assert (np.diff(times.time_s) >= -1e-12).all()
    lowest = min(channel.resonance_hz for channel in plan.channels)
    assert ramp_s(plan) >= 4 / lowest
    rate = {f.scheme: f.frames_per_s for f in plan.refresh}[plan.selectivity.drive]
    assert frame_s(plan) == pytest.approx(1 / rate)


def test_turns_are_one_after_the_other(quads):
    plan = quads["time-shared"]
    times = timeline(plan, np.stack([all_on(plan)]))
    assert len(times.time_s) == 9
    for coil in {taxel.coil for taxel in plan.taxels}:
        own = [i for i, taxel in enumerate(plan.taxels) if taxel.coil == coil]
        assert ((times.levels[:, own] > 0).sum(1) == [0, 1, 0, 1, 0, 1, 0, 1, 0]).all()


@pytest.mark.parametrize(
    "frames, seconds, sentence",
    [
        (np.full((1, 8), 1.2), None, r"levels must be in 0 … 1, got 1.2 for .* in frame 0"),
        (np.full((2, 8), -0.1), None, "got -0.1"),
        (np.full((1, 8), np.nan), None, "got nan"),
        (np.zeros((1, 7)), None, "rows of 8 levels, got 1 x 7"),
        (np.zeros((0, 8)), None, "one or more rows"),
        (np.zeros((1, 2, 8)), None, "got 1 x 2 x 8"),
        (np.zeros((1, 8)), 0.05, "--seconds: a frame of .* needs at least 0.16.* s to switch in, got 0.05 s"),
        (np.zeros((1, 8)), float("inf"), "got inf s"),
        (np.zeros((1, 8)), -1.0, "got -1 s"),
    ],
)
def test_frames_that_cannot_be(pair, frames, seconds, sentence):
    with pytest.raises(SpecError, match=sentence):
        timeline(pair, frames, seconds)


def test_slots_that_are_too_short(quads):
    with pytest.raises(SpecError, match=r"needs at least .* s for 4 channels in turn"):
        timeline(quads["time-shared"], np.zeros((1, 64)), 0.1)
