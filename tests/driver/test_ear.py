"""The simulated ear, which computes what fingers feel of a written file, against the plan and other models.

| must agree | with | to | why not exactly |
|---|---|---|---|
| motion from voltages, Q 15 … 1e4 | the equations, DOP853 with tolerance 1e-10 | 2e-5 | what is taken between samples |
| motion from rest, Q 0.3 … 1e4 | exact propagation in closed form | 1e-5 | as above |
| current of a carrier up to 0.4 of the rate | its phasor through R and L | 3e-5 | as above |
| all-state selectivity of files | the plan's, unequal pull and all modes counted | 0.3 dB | lines on a comb |
| levels in a hold | those of the same state for ever | 0.02 dB | 4.5 time constants and more have passed |
| a gap that closes | the coupled system, Radau with tolerance 1e-8 | 0.1 % | 8 kHz samples |
"""

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest

import padgen as pg
import padgen.driver.ear as ear
from padgen.core.errors import FileError
from padgen.core.files import json_text
from padgen.core.units import GRAM, UM
from padgen.core.wav_reader import read_wav
from padgen.driver.ear import AROUND, circuit_filter, ear_findings, hear, heard_table, mode_filter
from padgen.driver.formats.wav import wave_json, write_wave
from padgen.driver.waveform import Timeline, blend, make_drive, ramp_s, steady, timeline
from padgen.measured.tuning import planned_tuning
from padgen.physics.resonator import felt_energy, relative_energy
from padgen.planner.channels import coil_modes, hanging_gap_um
from padgen.planner.drive_scheme import placed_channels
from padgen.report.results import heard_text
from padgen.spec import load_spec, parse_spec
from padgen.verify.coupled import Source, make_system, simulate
from padgen.verify.propagation import propagate, tones

RATE = 48000


@dataclass(frozen=True)
class Samples:
    """Samples (count, channels) with the interface of a WAV file's."""

    rate_hz: int
    samples: np.ndarray

    @property
    def channels(self):
        return self.samples.shape[1]

    @property
    def count(self):
        return len(self.samples)

    def read(self, start, stop):
        return self.samples[start:stop].astype(float)


def plan_of(name, **drive):
    spec = load_spec(name)
    return pg.plan(replace(spec, drive=replace(spec.drive, **drive)))


def found_in(heard):
    return tuple(ear_findings(heard))


def played(plan, drive, line, tmp_path, depth="24", signal="voltage"):
    """Write a WAV file; return it as read back from disk, and its sidecar."""
    path = tmp_path / "drive.wav"
    report = write_wave(path, drive, line, depth, signal)
    return read_wav(path), json.loads(wave_json(plan, drive, line, report))


def all_states(plan, drive):
    """Return levels that put each coil of a pad into another state, until there are no more states."""
    n = len(plan.sets[0])
    levels = np.zeros(len(plan.taxels))
    for k, coil in enumerate(drive.coils):
        levels[coil.taxels] = (np.arange(n) < 0) if k >= 2**n else (k >> np.arange(n)) & 1
    return levels


def db(ratio):
    return 20 * np.log10(ratio)


@pytest.fixture(scope="module")
def pair():
    plan = pg.plan("paper-pair")
    return plan, make_drive(plan, RATE)


@pytest.fixture(scope="module")
def quad():
    plan = pg.plan("quad-64")
    return plan, make_drive(plan, RATE)


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("hz", "q", "henry"), [(60.0, 15.0, 61e-3), (21.0, 1e4, 61e-3), (990.0, 100.0, 61e-3), (60.0, 15.0, 6.0)]
)
def test_motion_is_that_of_the_equations(hz, q, henry):
    from scipy.integrate import solve_ivp
    from scipy.signal import lfilter

    ohm = 12.0
    omega = 2 * np.pi * hz
    seconds = 0.3

    def volts(time_s):
        swell = np.sin(np.pi * time_s / seconds) ** 4
        return swell * (5 + 8 * np.cos(np.pi * hz * time_s) + 6 * np.cos(2 * np.pi * 700.0 * time_s + 1))

    def slope(time_s, state):
        current, motion, speed = state
        return (
            (volts(time_s) - ohm * current) / henry,
            speed,
            omega**2 * (current**2 - motion) - omega / q * speed,
        )

    time_s = np.arange(int(seconds * RATE)) / RATE
    exact = solve_ivp(slope, (0, seconds), [0, 0, 0], "DOP853", time_s, rtol=1e-10, atol=1e-12, max_step=2e-4).y
    late = AROUND - 1
    current = lfilter(*circuit_filter(ohm, henry, RATE), volts(np.append(time_s, seconds + np.arange(late) / RATE)))
    motion = lfilter(*mode_filter(hz, q, RATE), current[late:] ** 2)
    for found, reference in ((current[late:], exact[0]), (motion, exact[1])):
        assert np.abs(found - reference).max() < 2e-5 * np.abs(reference).max()


@pytest.mark.parametrize(("hz", "q"), [(100.0, 0.3), (100.0, 0.7), (60.0, 15.0), (20.0, 1e4)])
def test_motion_from_rest_is_the_closed_form(hz, q):
    from scipy.signal import lfilter

    # i = I sin has i² = I² (1 − cos)/2: a constant and one line, from rest at t = 0.
    drive_hz = 0.49 * hz
    time_s = np.arange(RATE) / RATE
    mass = 1e-3
    felt = lfilter(*mode_filter(hz, q, RATE), np.sin(2 * np.pi * drive_hz * time_s) ** 2)
    force = tones([0.0, 2 * drive_hz], np.array([0.5, -0.5]) * mass * (2 * np.pi * hz) ** 2)
    exact = propagate(np.array([hz]), max(q, 0.5 * (1 + 1e-9)), mass, force, time_s)[0]
    assert np.abs(felt - exact).max() < 1e-5 * np.abs(exact).max()


@pytest.mark.parametrize(("carrier_hz", "tolerance"), [(100.0, 1e-7), (10e3, 2e-5), (19e3, 3e-5)])
def test_the_current_of_a_carrier_is_its_phasors(carrier_hz, tolerance):
    from scipy.signal import freqz

    ohm = 12.0
    henry = 8e-3
    _, answer = freqz(*circuit_filter(ohm, henry, RATE), [carrier_hz], fs=RATE)
    late = np.exp(-2j * np.pi * carrier_hz * (AROUND - 1) / RATE)
    assert answer[0] == pytest.approx(late / (ohm + 2j * np.pi * carrier_hz * henry), rel=tolerance)


def test_in_which_blocks_a_file_is_heard_does_not_matter(pair, tmp_path, monkeypatch):
    plan, drive = pair
    levels = all_states(plan, drive)
    for line in (steady(levels, drive.period_s), timeline(plan, levels, 0.5)):
        wave, sidecar = played(plan, drive, line, tmp_path)
        at_once = hear(plan, wave, sidecar)
        with monkeypatch.context() as patched:
            patched.setattr(ear, "BLOCK", 16 * 701)
            in_blocks = hear(plan, wave, sidecar)
        for figure in ("level_um", "tone_um", "peak_um", "rise_s"):
            assert getattr(in_blocks, figure) == pytest.approx(getattr(at_once, figure), rel=1e-9, nan_ok=True)
        assert [c["rms_a"] for c in in_blocks.coils] == pytest.approx([c["rms_a"] for c in at_once.coils], rel=1e-9)


@pytest.mark.parametrize("name", ["paper-pair", "triple-48", "quad-64"])
def test_files_keep_what_the_plan_says_in_all_states(name, tmp_path):
    plan = pg.plan(name)
    drive = make_drive(plan, RATE)
    levels = all_states(plan, drive)
    assert len({tuple(levels[c.taxels]) for c in drive.coils}) == 2 ** len(plan.sets[0])
    heard = hear(plan, *played(plan, drive, steady(levels, drive.period_s), tmp_path))
    assert heard.selectivity_db == pytest.approx(plan.selectivity.placed_all_states_db, abs=0.3)
    # What is felt is more than the working mode's motion, by other modes and by rolling: a few percent here.
    assert heard.wanted_um == pytest.approx([plan.channels[t.channel].level_um for t in plan.taxels], rel=0.06)
    # Each ON taxel's own line is what was asked for: all of the chain's factors.
    on = heard.shares > 0
    assert (heard.tone_um / heard.wanted_um)[on] == pytest.approx(1, abs=1e-3)


@pytest.mark.sample(1)
@pytest.mark.parametrize("scheme", ["tones", "spur-free", "time-shared"])
def test_other_schemes_keep_what_the_plan_says_of_them(scheme, tmp_path):
    plan = plan_of("quad-64", scheme=scheme)
    drive = make_drive(plan, RATE)
    levels = all_states(plan, drive)
    if scheme == "time-shared":
        levels = np.zeros(len(plan.taxels))
        for k, coil in enumerate(drive.coils):
            levels[coil.taxels[k % 4]] = 1.0
    heard = hear(plan, *played(plan, drive, steady(levels, drive.period_s), tmp_path))
    planned = {figures.scheme: figures for figures in plan.selectivity.schemes}[scheme]
    assert heard.selectivity_db == pytest.approx(planned.placed_all_states_db, abs=0.3)


@pytest.mark.soak
def test_eleven_channels_hear_what_the_modal_model_says(tmp_path):
    plan = pg.plan("wide-11")
    drive = make_drive(plan, RATE)
    spec = plan.spec
    own = plan.sets[0]
    which = placed_channels(spec, own)
    modes = coil_modes(spec, own)
    heard_tones = felt_energy(modes, slice(None), which.resonance_hz) * (which.line / which.line[:, None]) ** 2
    rng = np.random.default_rng(5)
    worst = []
    levels = (rng.random(len(plan.taxels)) < 0.5).astype(float)
    heard = hear(plan, *played(plan, drive, steady(levels, drive.period_s), tmp_path))
    for coil in drive.coils:
        on = levels[coil.taxels] > 0
        expected = np.sqrt(heard_tones @ on)
        worst.append(db(heard.relative[0, coil.taxels][~on].max() / expected[~on].max()))
    assert len(worst) == 4
    assert np.abs(worst).max() < 0.3


def test_state_11_of_the_papers_pair_keeps_both_levels(pair, tmp_path):
    plan, drive = pair
    heard = hear(plan, *played(plan, drive, steady(all_states(plan, drive), drive.period_s), tmp_path))
    rows = {row["state"]: row for row in heard_table(heard)["rows"]}
    own = {state: heard.tone_um[0, drive.coils[k].taxels] for k, state in enumerate(("00", "10", "01", "11"))}
    alone = np.array([own["10"][0], own["01"][1]])
    # The paper loses 10 dB.
    assert db(own["11"] / alone) == pytest.approx([0, 0], abs=0.01)
    assert rows["11"]["off_db"] is None
    assert rows["11"]["on_db"] >= rows["10"]["on_db"]
    assert rows["00"]["off_db"] < -100


def test_a_hold_is_heard_as_the_state_for_ever(quad, tmp_path):
    plan, drive = quad
    rng = np.random.default_rng(3)
    frames = (rng.random((2, len(plan.taxels))) < 0.5) * rng.choice([0.5, 1.0], (2, len(plan.taxels)))
    heard = hear(plan, *played(plan, drive, timeline(plan, frames, 1.2), tmp_path))
    assert heard.settled.all()
    assert [span.whole for span in heard.spans] == [True, True]
    for frame, levels in zip(frames, heard.level_um, strict=True):
        ever = hear(plan, *played(plan, drive, steady(frame, drive.period_s), tmp_path))
        loud = frame > 0
        assert db(levels[loud] / ever.level_um[0, loud]) == pytest.approx(0, abs=0.02)
        assert levels[~loud] == pytest.approx(ever.level_um[0, ~loud], abs=2e-4 * heard.wanted_um.max())
    # Grey: half the line of i² is half the amplitude.
    half = frames[0] == 0.5
    assert (heard.tone_um / heard.wanted_um)[0, half] == pytest.approx(0.5, rel=1e-3)
    # The middle of the ramp at least, its end and 2.3 time constants of the slowest at most.
    slowest = max(channel.ring_up_ms for channel in plan.channels) * 1e-3
    assert ramp_s(plan) / 2 < np.nanmin(heard.rise_s) < np.nanmax(heard.rise_s) < ramp_s(plan) + 2.6 * slowest
    assert np.isnan(heard.rise_s[0, ~(frames[0] > 0)]).all()


def test_a_file_in_which_no_off_taxel_moves_tells_nothing_of_selectivity(pair, tmp_path):
    plan, drive = pair
    on = np.ones(len(plan.taxels))
    heard = hear(plan, *played(plan, drive, timeline(plan, np.stack([0 * on, on]), 0.7), tmp_path))
    assert np.nanmax(heard.off) < 1e-12
    assert heard.selectivity_db is None
    text = heard_text(plan, heard)
    assert "still" in text
    assert "of ON over OFF this file tells nothing" in text


def test_equal_frames_are_one_state(pair, tmp_path):
    plan, drive = pair
    levels = all_states(plan, drive)
    heard = hear(plan, *played(plan, drive, timeline(plan, np.stack([levels, levels]), 0.7), tmp_path))
    (span,) = heard.spans
    assert (span.start_s, span.stop_s) == pytest.approx((ramp_s(plan), 1.4))
    assert heard.settled.all()


def test_in_turns_a_slot_is_too_short_for_the_slowest(tmp_path):
    plan = plan_of("paper-pair", scheme="time-shared")
    drive = make_drive(plan, RATE)
    frame = np.zeros(len(plan.taxels))
    frame[drive.coils[0].taxels[0]] = frame[drive.coils[1].taxels[1]] = 1.0
    frame[drive.coils[2].taxels] = 1.0
    heard = hear(plan, *played(plan, drive, timeline(plan, frame), tmp_path))
    assert [span.in_turns for span in heard.spans] == [True]
    # Up over 2.3 time constants and down again: the force's blend, lagged with each taxel's own.
    half_s = max(channel.ring_down_ms for channel in plan.channels) * 1e-3
    time_s = np.linspace(0, 2 * half_s, 20001)
    level = blend(1 - np.abs(time_s / half_s - 1))
    both = []
    for channel in plan.channels:
        tau_s = channel.ring_up_ms * 1e-3
        both.append(float((np.cumsum(level * np.exp(time_s / tau_s)) * np.exp(-time_s / tau_s)).max()))
    both = np.array(both) * time_s[1] / np.array([channel.ring_up_ms * 1e-3 for channel in plan.channels])
    assert heard.on[0, drive.coils[2].taxels] == pytest.approx(both, abs=0.02)
    assert [f.code for f in found_in(heard)] == ["ear.level", "ear.selectivity"]
    assert heard.selectivity_db == pytest.approx(db(both.min()) + plan.selectivity.placed_all_states_db, abs=0.5)


SETS = """
name = "sets"
resolution = 7
band_hz = [60, 300]
q_min = 40
[pad]
width_mm = 25
depth_mm = 50
[coil]
grid = [2, 1]
reuse = "alternate"
name = "paper"
inductance_mh = 0
"""


def test_two_sets_empty_places_and_no_inductance(tmp_path):
    plan = pg.plan(parse_spec(SETS))
    assert plan.coils.sets == 2
    drive = make_drive(plan, 16000)
    for line in (steady(np.ones(len(plan.taxels)), drive.period_s), timeline(plan, np.eye(len(plan.taxels))[:1], 3.0)):
        heard = hear(plan, *played(plan, drive, line, tmp_path))
        on = heard.shares > 0
        assert (heard.tone_um / heard.wanted_um)[on] == pytest.approx(1, abs=5e-3)


def test_a_file_of_currents_is_heard_as_one_of_voltages(pair, tmp_path):
    plan, drive = pair
    line = timeline(plan, all_states(plan, drive), 1.5)
    volts, amps = (hear(plan, *played(plan, drive, line, tmp_path, signal=s)) for s in ("voltage", "current"))
    assert amps.level_um == pytest.approx(volts.level_um, abs=1e-4 * volts.wanted_um.max())
    assert amps.coils[3]["rms_a"] == pytest.approx(volts.coils[3]["rms_a"], rel=1e-4)


def test_currents_and_losses_are_those_of_the_writer(quad, tmp_path, monkeypatch):
    plan, drive = quad
    monkeypatch.setattr(ear, "BLOCK", 1 << 16)
    path = tmp_path / "drive.wav"
    line = timeline(plan, all_states(plan, drive), 0.8)
    report = write_wave(path, drive, line)
    heard = hear(plan, read_wav(path), json.loads(wave_json(plan, drive, line, report)))
    assert [c["copper_loss_w"] for c in heard.coils] == pytest.approx(report.copper_loss_w, rel=1e-4)
    assert max(c["signal_peak"] for c in heard.coils) == pytest.approx(report.peak, rel=1e-5)
    assert heard_table(heard)["summary"]["rms_a"] == pytest.approx(max(report.rms_current_a), rel=1e-4)


def test_a_print_that_came_out_otherwise(pair, tmp_path):
    plan, drive = pair
    planned = planned_tuning(plan)
    # 4 % higher, half the Q, half the answer that this would give.
    off = replace(
        planned,
        taxels=tuple(
            replace(
                taxel,
                resonance_hz=1.04 * taxel.resonance_hz,
                q=taxel.q / 2,
                response_um_per_a2=taxel.response_um_per_a2 / 4,
            )
            for taxel in planned.taxels
        ),
    )
    levels = np.ones(len(plan.taxels))
    wave, sidecar = played(plan, drive, steady(levels, drive.period_s), tmp_path)
    heard = hear(plan, wave, sidecar, tuning=off)
    line_hz = np.array([entry["force_hz"] for entry in sidecar["taxels"]])
    resonance = np.array([taxel.resonance_hz for taxel in off.taxels])
    expected = np.sqrt(relative_energy(line_hz, resonance, 13.0)) / 4
    # Level law 2: a taxel that came out higher is to move less; other modes move along, a percent of the answer.
    wanted = heard.wanted_um / hear(plan, wave, sidecar).wanted_um
    assert wanted == pytest.approx(1 / 1.04**2, rel=1e-6)
    assert heard.tone_um[0] / heard.wanted_um * wanted == pytest.approx(expected, rel=0.03)
    retuned = make_drive(plan, RATE, tuning=off)
    again = hear(plan, *played(plan, retuned, steady(levels, retuned.period_s), tmp_path), tuning=off)
    assert again.tone_um[0] / again.wanted_um == pytest.approx(1, abs=0.02)


def test_a_gap_that_closes_is_the_coupled_system(tmp_path):
    plan = plan_of("quad-64", level_um=60.0)
    channel = plan.channels[0]
    share = int(np.argmax(channel.mode_shares))
    # The working mode alone, as the coupled system has it.
    alone = replace(
        channel,
        modes_hz=(channel.modes_hz[share],),
        mode_motions=(channel.mode_motions[share],),
        mode_shares=(1.0,),
        pulled_shares=(channel.pulled_shares[share],),
        rest_motion=(0.0,) * 6,
    )
    plan = replace(plan, channels=(alone, *plan.channels[1:]))
    drive = make_drive(plan, 8000)
    levels = np.zeros(len(plan.taxels))
    first = drive.coils[0].taxels[0]
    levels[first] = 1.0
    wave, sidecar = played(plan, drive, timeline(plan, levels, 0.8), tmp_path, "float", "current")
    heard = hear(plan, wave, sidecar, gap=True)
    system = make_system(
        channel.resonance_hz,
        channel.q,
        channel.effective_mass_g * GRAM,
        channel.force_constant_n_per_a2,
        channel.pull_exponent,
        float(hanging_gap_um(plan.spec, channel.sag_um)) * UM,
    )
    from scipy.interpolate import CubicSpline

    samples = wave.read()[:, 0] * sidecar["full_scale"]
    spline = CubicSpline(np.arange(len(samples)) / 8000, samples)
    span = heard.spans[0]
    at_s = np.append(np.arange(0, span.window_s, 2e-4), np.linspace(span.window_s, span.stop_s, 2001)[:-1])
    z = simulate(system, Source("current", spline), at_s, tolerance=1e-8).displacement_m[0]
    last = z[at_s >= span.window_s]
    rolls = np.array(alone.mode_motions[0])[2:5] * (1, 1.25e-3 / 2, 1.25e-3 / 2)
    felt = np.sqrt((rolls**2).sum()) / abs(rolls[0])
    assert heard.level_um[0, first] * UM == pytest.approx(np.sqrt(2) * last.std() * felt, rel=1e-3)
    assert heard.peak_um[0, first] * UM == pytest.approx(z.max(), rel=5e-3)
    # Softening is worth seeing here.
    linear = hear(plan, wave, sidecar)
    assert abs(db(heard.level_um[0, first] / linear.level_um[0, first])) > 1.0


@pytest.mark.soak
def test_with_little_motion_the_gap_changes_nothing(tmp_path):
    plan = plan_of("quad-64", level_um=1e-3)
    drive = make_drive(plan, 8000)
    levels = all_states(plan, drive)
    for line in (steady(levels, drive.period_s), timeline(plan, levels, 0.5)):
        wave, sidecar = played(plan, drive, line, tmp_path, "float")
        linear, closing = (hear(plan, wave, sidecar, gap=gap) for gap in (False, True))
        assert closing.level_um == pytest.approx(linear.level_um, abs=1e-3 * linear.wanted_um.max())
        assert closing.with_gap and not linear.with_gap


def test_a_washer_that_is_pulled_in_is_found(tmp_path):
    plan = plan_of("paper-pair", level_um=4000.0)
    drive = make_drive(plan, 8000)
    wave, sidecar = played(plan, drive, timeline(plan, np.ones(len(plan.taxels)), 1.0), tmp_path, "float")
    heard = hear(plan, wave, sidecar, gap=True)
    assert heard.pulled_in.any()
    assert "ear.pull_in" in [f.code for f in found_in(heard)]
    assert np.isfinite(heard.level_um).all()


def test_findings_name_what_was_missed(pair, tmp_path):
    plan, drive = pair
    wave, sidecar = played(plan, drive, steady(all_states(plan, drive), drive.period_s), tmp_path)
    assert found_in(hear(plan, wave, sidecar)) == ()
    # The amplifier is set 10 % too low: i² falls by 19 %, 1.8 dB.
    (found,) = found_in(hear(plan, wave, sidecar | {"full_scale": 0.9 * sidecar["full_scale"]}))
    assert (found.level, found.code) == ("warning", "ear.level")
    assert "(-1.8 dB; " in found.message and "off by more than that 4 of 4 times" in found.message
    strict = replace(plan, selectivity=replace(plan.selectivity, asked_db=30.0))
    (found,) = found_in(hear(strict, wave, sidecar))
    assert (
        found.code == "ear.selectivity"
        and "has 20.6 dB of ON over OFF" in found.message
        and "asked: 30.0 dB" in found.message
    )


def test_short_holds_are_told(quad, tmp_path):
    plan, drive = quad
    frames = np.stack([np.ones(len(plan.taxels)), np.zeros(len(plan.taxels))])
    heard = hear(plan, *played(plan, drive, timeline(plan, frames, 0.25), tmp_path))
    codes = {f.code: f.message for f in found_in(heard)}
    assert "ear.window" in codes
    assert not heard.settled.all()
    # 4.5 time constants of the lowest resonance at Q 15, and a period of the comb.
    lowest = min(channel.resonance_hz for channel in plan.channels)
    assert f"{4.5 * 15 / (np.pi * lowest) + drive.period_s:.3f}"[:4] in codes["ear.unsettled"]
    # What is shorter than a period is still near the truth, once settled: the fastest taxels.
    fast = [k for k, taxel in enumerate(plan.taxels) if taxel.channel == 3]
    assert heard.on[0, fast] == pytest.approx(1, abs=0.05)


def test_the_table_is_plain_data(pair, tmp_path):
    plan, drive = pair
    heard = hear(plan, *played(plan, drive, steady(all_states(plan, drive), drive.period_s), tmp_path))
    table = json.loads(json_text(heard_table(heard)))
    assert table["summary"]["selectivity_db"] == pytest.approx(heard.selectivity_db)
    assert [row["state"] for row in table["rows"][:4]] == ["00", "10", "01", "11"]
    assert len(table["spans"][0]["level_um"]) == len(plan.taxels)


def test_a_file_that_holds_nothing_is_refused(pair, tmp_path):
    plan, drive = pair
    ones = np.ones(len(plan.taxels))
    none = np.zeros(len(plan.taxels))
    line = Timeline(np.array([0.0, 0.2, 0.4]), np.stack([none, ones, none]), False)
    wave, sidecar = played(plan, drive, line, tmp_path)
    with pytest.raises(FileError, match="holds no state"):
        hear(plan, wave, sidecar)
