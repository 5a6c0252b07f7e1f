"""Limits of coils and amplifiers, judged before anything is written or played.

| what | must equal | to | because |
|---|---|---|---|
| judged volts of a file | the samples of the file, or of the script | 1 % | between samples a peak is a little higher |
| judged volts of the firmware | the compiled firmware, uncut, all states | 4 % | steps between states are bounded |
| judged watts | R i², i from the volts through R and L | 1 % | a whole period of a state that is held |
| judged heat | lag of R i² of a file's bytes, from the limit on | 0.2, 30 % | lines beat; changes count as the larger |
"""

import json
import re
from dataclasses import replace
from functools import cache
from itertools import combinations_with_replacement
from math import ceil
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import padgen as pg
from padgen import cli
from padgen.core.errors import Finding, InfeasibleError, SpecError
from padgen.core.wav_reader import read_wav
from padgen.driver import loads, sound_card, waveform
from padgen.driver.drive_folder import Drive, Driven, write_excitation
from padgen.driver.excitation import KINDS, excitation
from padgen.driver.formats.c import boards_in_time, c_header, sample_mhz
from padgen.driver.frames import state_frames
from padgen.driver.loads import HEAT_S, excitation_load, judge_limits, judge_load, least_thermal_time_s, load_of
from padgen.driver.serial_line import frame_message
from padgen.driver.signs import PlayedPad, choose_signs
from padgen.driver.waveform import (
    CONTROLLER_RATES_HZ,
    RATES_HZ,
    Timeline,
    drive_at,
    make_drive,
    ramp_s,
    steady,
    timeline,
    volts,
)
from padgen.measured.shaking import measuring_band_hz
from padgen.measured.tuning import planned_tuning
from padgen.planner import Plan, plan_to_json, read_plan
from padgen.planner import limits as limit_table
from padgen.planner.cures import varied
from padgen.planner.limits import Limit
from padgen.spec import Amplifier, Coil, catalogue, load_spec, parse_spec
from tests.driver.test_play import Card
from tests.driver.test_syntacts import library, rendered  # noqa: F401
from tests.firmware_host import compiled, feed
from tests.hjif_reader import read_hjif

FOUR = (
    'name = "four"\nresolution = 16\nband_hz = [50, 400]\nq_min = 15\nprinter = "fdm-0.25"\n'
    "[pad]\nwidth_mm = 25\ndepth_mm = 25\nrib_mm = 0.6\n[coil]\ngrid = [2, 2]\n{coil}\n[drive]\n{drive}\n"
)
SCHEMES = ("tones", "spur-free", "biased", "time-shared")
BEYOND = {
    "voltage": ("", "scheme = 'biased'\nvoltage_limit_v = 3", "coil.voltage"),
    "heat": ("", "scheme = 'biased'\nlevel_um = 60", "coil.heat"),
    "travel": (
        "gap_mm = 1.5\npower_limit_w = 1e4",
        "scheme = 'tones'\nlevel_um = 300\nvoltage_limit_v = 1e4",
        "gap.travel",
    ),
    "pull-in": ("power_limit_w = 1e4", "scheme = 'tones'\nlevel_um = 400\nvoltage_limit_v = 1e5", "coil.pull_in"),
}
FORMATS = ("csv", "json", "wav", "c", "hjif", "syntacts")


@cache
def planned(coil: str = "", drive: str = "") -> Plan:
    return pg.plan(parse_spec(FOUR.format(coil=coil, drive=drive)))


def written(plan: Plan, folder: Path, formats: str, state: str = "1111", **more) -> Driven:
    frames = state_frames(plan, state) if state else None
    return Drive(plan, frames, held=True, **more).save_folder(folder, formats.split(","))


def watts(plan: Plan, volts_held: np.ndarray, rate_hz: int) -> float:
    """Return R times the mean i² of the warmest coil, from volts (samples, coils) over whole periods."""
    coil = plan.spec.coil
    count = len(volts_held)
    omega = 2 * np.pi * np.arange(count // 2 + 1) * rate_hz / count
    current = np.fft.rfft(volts_held, axis=0) / (coil.resistance_ohm + 1j * omega * coil.inductance_mh * 1e-3)[:, None]
    square = (np.fft.irfft(current, count, axis=0) ** 2).mean(0)
    return float(coil.resistance_ohm * square.max())


def asked_in(finding: Finding) -> float:
    """Return the figure that a finding about a limit says is asked."""
    return float(re.search(r" (?:is|rise by|rise by at least) ([\d.e+-]+)", finding.message).group(1))


def figure(driven: Driven, code: str) -> float:
    (finding,) = (f for f in driven.findings if f.code == code)
    return asked_in(finding)


# ---- Every format and player ---------------------------------------------------------------------------------------


@pytest.mark.sample(8)
@pytest.mark.parametrize("formats", FORMATS)
@pytest.mark.parametrize("limit", BEYOND)
def test_every_format_says_what_is_beyond_and_ends_with_1(tmp_path, capsys, limit, formats):
    coil, drive, code = BEYOND[limit]
    (tmp_path / "s.toml").write_text(FOUR.format(coil=coil, drive=drive))
    shown = [] if formats in ("c", "csv", "json") else ["--state", "1111"]
    arguments = ["drive", str(tmp_path / "s.toml"), "--formats", formats, *shown, "-o", str(tmp_path / "o"), "--json"]
    assert cli.run(arguments) == 1
    told = json.loads(capsys.readouterr().out)
    assert (code, "error") in {(f["code"], f["level"]) for f in told["findings"]}
    # The files are there to look at.
    assert all((tmp_path / "o" / name).exists() for name in told["files"])


@pytest.mark.sample(8)
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("formats", FORMATS)
def test_within_all_limits_nothing_is_said(tmp_path, formats, scheme):
    driven = written(planned(drive=f"scheme = '{scheme}'\nlevel_um = 3"), tmp_path / "o", formats)
    assert not [f for f in driven.findings if f.level == "error"]


@pytest.mark.parametrize("formats", ["csv", "hjif", "wav"])
def test_what_is_shown_is_judged_and_not_what_might_be(tmp_path, formats):
    coil, drive, _ = BEYOND["heat"]
    plan = planned(coil, drive.replace("biased", "tones"))
    # A WAV is judged by its warmth, too, as if it were played over and over.
    warm = ["pad.hot"] if formats == "wav" else []
    assert [f.code for f in written(plan, tmp_path / "a", formats, "1111").findings] == ["coil.heat", *warm]
    assert [f.code for f in written(plan, tmp_path / "b", formats, "0001").findings] == warm
    # A host may show all.
    assert [f.code for f in written(plan, tmp_path / "c", "c", "0001").findings] == ["coil.heat"]


def test_level_that_is_named_fits_when_it_is_planned(tmp_path):
    for limit in ("voltage", "heat", "pull-in"):
        coil, drive, code = BEYOND[limit]
        (finding, *_) = written(planned(coil, drive), tmp_path / "a", "c", "").findings
        assert finding.code == code
        level = re.search(r"drive.level_um of ([\d.]+) would fit", finding.message).group(1)
        lower = re.sub(r"\nlevel_um = \d+", "", drive) + f"\nlevel_um = {level}"
        assert not written(planned(coil, lower), tmp_path / "b", "c", "").findings


@pytest.mark.parametrize("limit", BEYOND)
def test_nothing_beyond_a_limit_is_played_over_a_port(tmp_path, capsys, limit):
    coil, drive, _ = BEYOND[limit]
    (tmp_path / "s.toml").write_text(FOUR.format(coil=coil, drive=drive))
    # The refusal comes before the port is opened.
    assert cli.run(["play", str(tmp_path / "s.toml"), "--port", "/dev/no-such-port", "--state", "1111"]) == 2
    said = capsys.readouterr().err
    assert "four: is not played: the " in said and "no-such-port" not in said
    if "tones" in drive:
        assert cli.run(["play", str(tmp_path / "s.toml"), "--port", "/dev/no-such-port", "--state", "0000"]) == 2
        assert "no-such-port: cannot be opened" in capsys.readouterr().err


@pytest.mark.parametrize("signal", ["voltage", "current"])
@pytest.mark.parametrize("limit", BEYOND)
def test_nothing_beyond_a_limit_is_played_over_a_sound_card(tmp_path, monkeypatch, limit, signal):
    card = Card()
    monkeypatch.setattr(sound_card, "import_module", lambda name: card)
    coil, drive, _ = BEYOND[limit]
    driven = written(planned(coil, drive), tmp_path / "o", "wav", signal=signal)
    path = (tmp_path / "o" / "drive.wav").rename(tmp_path / "else.wav")
    with pytest.raises(SpecError, match=re.escape(f"is not played: {driven.findings[0].message}")):
        sound_card.play_wave(path)
    assert not card.blocks
    written(planned(), tmp_path / "o", "wav", "1000", signal=signal)
    sound_card.play_wave(tmp_path / "o" / "drive.wav")
    assert card.blocks


# ---- Figures -------------------------------------------------------------------------------------------------------


@pytest.mark.sample(4)
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("state", ["1111", "1,0.3,0.5,0", "0,0,1,0"])
def test_judged_volts_are_those_of_the_file(tmp_path, scheme, state):
    plan = planned("", f"scheme = '{scheme}'\nvoltage_limit_v = 0.1")
    driven = written(plan, tmp_path / "o", "wav", state)
    peak = np.abs(read_wav(tmp_path / "o" / "drive.wav").read()).max() * driven.report.full_scale
    assert peak <= figure(driven, "coil.voltage") * (1 + 1e-4)  # five digits
    assert peak == pytest.approx(figure(driven, "coil.voltage"), rel=0.01)


@pytest.mark.parametrize("scheme", SCHEMES[:3])
@pytest.mark.parametrize("state", ["1111", "1,0.3,0.5,0", "0,0,1,0"])
def test_judged_watts_are_those_of_the_file(tmp_path, scheme, state):
    plan = planned("power_limit_w = 1e-4", f"scheme = '{scheme}'")
    driven = written(plan, tmp_path / "o", "wav", state)
    wave = read_wav(tmp_path / "o" / "drive.wav")
    ramp = ramp_s(plan)
    period = round(driven.report.period_s * wave.rate_hz)
    # The last period before the way down.
    end = wave.count - int(np.ceil(ramp * wave.rate_hz))
    held = wave.read(end - period, end) * driven.report.full_scale
    assert figure(driven, "coil.heat") == pytest.approx(watts(plan, held, wave.rate_hz), rel=0.01)


def test_judged_watts_of_turns_are_those_of_the_warmest(tmp_path):
    plan = planned("power_limit_w = 1e-4", "scheme = 'time-shared'")
    driven = written(plan, tmp_path / "o", "wav")
    drive = drive_at(plan, RATES_HZ)
    found = []
    for channel in range(4):
        alone = np.array([float(taxel.channel == channel) for taxel in plan.taxels])
        played = np.concatenate(list(volts(drive, steady(alone, drive.period_s))))
        found.append(watts(plan, played, drive.rate_hz))
    assert load_of(plan, drive, timeline(plan, np.ones(16))).square_a2.max() * plan.spec.coil.resistance_ohm == (
        pytest.approx(max(found), rel=0.01)
    )
    # One slot after the other: the mean up to each one's end, what was before counting less and less.
    weight = np.exp(
        driven.report.count / driven.report.rate_hz / 4 / least_thermal_time_s(plan.spec.coil)
    ) ** np.arange(4)
    warmest = max(np.average(found[: n + 1], weights=weight[: n + 1]) for n in range(4))
    assert figure(driven, "coil.heat") == pytest.approx(warmest, rel=0.01)


# ---- Bursts --------------------------------------------------------------------------------------------------------


def test_a_coils_heat_lags_by_what_its_copper_stores():
    coil = planned().spec.coil
    # 1000 turns of 22 m in all; 62.9 Ω of them are 0.0874 mm thick and weigh 1.18 g; 471 mm² give off 100 W/(m² K).
    assert least_thermal_time_s(coil) == pytest.approx(1.18e-3 * 385 / (100 * 471e-6), rel=0.01)
    assert least_thermal_time_s(replace(coil, resistance_ohm=629.0)) == pytest.approx(least_thermal_time_s(coil) / 10)
    # A winding of 2 mm that is all copper, whatever its resistance; a large one.
    small = replace(coil, outer_diameter_mm=2.0, inner_diameter_mm=1.0, length_mm=2.0, resistance_ohm=1e-3)
    assert least_thermal_time_s(small) == pytest.approx(3.45e6 * 1.5e-9 * np.pi / (100 * 6e-6 * np.pi), rel=1e-9)
    assert (
        least_thermal_time_s(replace(coil, resistance_ohm=1.0)) == HEAT_S
        and least_thermal_time_s(replace(coil, resistance_ohm=1e6)) == 0.01
    )


@pytest.mark.parametrize("ohm", [62.9, 1200.0, 1e6])
def test_the_firmware_averages_heat_over_no_longer(ohm):
    plan = planned(f"name = 'paper'\nresistance_ohm = {ohm}\npower_limit_w = 100", "scheme = 'tones'\nlevel_um = 0.01")
    for rate in (8000, 48_000):
        header = c_header(plan, make_drive(plan, rate))
        averaged = 2 ** int(re.search(r"define PADGEN_HEAT_SHIFT (\d+)", header).group(1)) / rate
        assert least_thermal_time_s(plan.spec.coil) / 2 < averaged <= least_thermal_time_s(plan.spec.coil)


def test_a_burst_after_a_pause_may_be_stronger_than_what_is_held_for_ever():
    plan = planned("", "scheme = 'tones'")
    drive, lag = drive_at(plan, CONTROLLER_RATES_HZ), least_thermal_time_s(plan.spec.coil)
    held = load_of(plan, drive, steady(np.ones(16), drive.period_s))
    assert (held.warm_a2 == held.square_a2).all()

    def share(*times_s: float, on: tuple[int, ...]) -> float:
        load = load_of(plan, drive, Timeline(np.array([0.0, *times_s]), np.outer(on, np.ones(16)), False))
        assert load.square_a2 == pytest.approx(held.square_a2)
        return float((load.warm_a2 / held.warm_a2).max())

    # Without a pause before: no more than what is held. Off for 3 s and on for 1 s; and a second burst 0.2 s later.
    assert share(1.0, 1.01, 4.0, on=(1, 1, 0, 0)) == pytest.approx(1)
    pause = 1 - np.exp(-4 / lag)
    burst = 1 - np.exp(-1 / lag)
    assert share(3.0, 3.0, 4.0, on=(0, 0, 1, 1)) == pytest.approx(burst / pause)
    # A change counts as the larger of both.
    for times_s, on in (((3.0, 4.0), (0, 0, 1)), ((3.0, 3.0, 4.0), (0, 0, 1, 0))):
        assert share(*times_s, on=on) == pytest.approx(burst / pause)
    both = burst * (1 + np.exp(-1.2 / lag)) / (1 - np.exp(-5.2 / lag))
    assert share(3.0, 3.0, 4.0, 4.0, 4.2, 4.2, 5.2, on=(0, 0, 1, 1, 0, 0, 1, 1)) == pytest.approx(both)


def test_files_played_on_end_keep_a_coil_within_its_limit():
    """Ten plays of one file, from a coil as warm as it may be, with its heat integrated in small steps."""
    plan = planned("", "scheme = 'tones'")
    lag = least_thermal_time_s(plan.spec.coil)
    step_s = 1e-3
    drive = drive_at(plan, CONTROLLER_RATES_HZ)
    rng = np.random.default_rng(5)
    times = np.concatenate([[0.0], np.cumsum(np.repeat(rng.uniform(0.2, 3.0, 6), 2) * np.tile([1.0, 0.05], 6))])
    on = np.repeat([0, 1, 0, 1, 0, 1, 0], 2)[:13]
    load = load_of(plan, drive, Timeline(times, np.outer(on, np.ones(16)), False))
    limit_a2 = load.warm_a2[0]
    held_a2 = load.square_a2[0]
    assert limit_a2 < 0.99 * held_a2
    warmest = heat = limit_a2
    for _ in range(10):
        for t in np.arange(0, times[-1], step_s):
            heat += step_s / lag * (held_a2 * np.interp(t, times, on) ** 2 - heat)
            warmest = max(warmest, heat)
    # The steps' own error is some 1e-4.
    assert warmest <= limit_a2 * 1.001


@pytest.mark.sample(2)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_no_coil_gets_warmer_than_it_may_by_the_bytes_of_a_file(tmp_path, scheme):
    """Heat is integrated from a file's bytes, from as warm as it may be on: a coil at its limit comes near to it."""
    plan = planned("name = 'paper'\nresistance_ohm = 800", f"scheme = '{scheme}'\nlevel_um = 3\nvoltage_limit_v = 1000")
    coil = plan.spec.coil
    drive = drive_at(plan, RATES_HZ, 48_000)
    frames = np.zeros((12, 16))
    frames[[5, 6, 9]] = np.array([[1.0], [0.5], [1.0]])
    Drive(plan, frames, rate_hz=48_000).save_folder(tmp_path / "o", ["wav"], depth="float")
    load = load_of(plan, drive, timeline(plan, frames))
    assert load.warm_a2.max() < (0.99 if scheme == "biased" else 0.7) * load.square_a2.max()
    _, ampere = integrated(tmp_path / "o", coil)
    stays = np.exp(-1 / (least_thermal_time_s(coil) * 48_000))
    heat, _ = lfilter(
        [1 - stays], [1, -stays], ampere**2 / load.warm_a2, axis=0, zi=np.full((1, ampere.shape[1]), stays)
    )
    after = 5 * len(ampere) // 12
    assert heat.max() < 1.002 and heat[after:].max(0).min() > (0.5 if plan.scheme.takes_turns else 0.7)
    # The limit itself is what decides, and so does the level that is named.
    for power_w, codes in ((1.001, []), (0.999, ["coil.heat"])):
        power_w *= coil.resistance_ohm * load.warm_a2.max()
        bears = replace(plan, spec=replace(plan.spec, coil=replace(coil, power_limit_w=power_w)))
        found = judge_limits("x", bears, drive, timeline(plan, frames))
        assert [finding.code for finding in found] == codes
    assert 2.9 < float(re.search(r"drive.level_um of ([\d.]+) would fit", found[0].message).group(1)) < 3.0


@pytest.mark.parametrize("carrier_hz", [None, 3000.0, 9000.0])
def test_judged_volts_are_those_of_the_script(tmp_path, library, carrier_hz):  # noqa: F811
    plan = planned("", "scheme = 'spur-free'\nvoltage_limit_v = 1")
    driven = written(plan, tmp_path / "o", "syntacts", carrier_hz=carrier_hz, rate_hz=48_000, seconds=0.3)
    count = round(0.3 * 48_000)
    peak = np.abs(rendered((tmp_path / "o" / "drive_syntacts.py").read_text(), count)).max()
    # At 9 kHz some 5 samples make a period, and between them the peak is up to 5 % higher.
    assert peak <= 1.001 * figure(driven, "coil.voltage")
    assert peak == pytest.approx(figure(driven, "coil.voltage"), rel=0.01 if carrier_hz is None else 0.05)


def test_a_peak_between_samples_is_judged(monkeypatch):
    plan = planned("", "scheme = 'spur-free'\nvoltage_limit_v = 1")
    # Three samples a cycle, always at the same places of it.
    monkeypatch.setattr(waveform, "comb_period_s", lambda *_: 0.25)
    drive = make_drive(plan, 48_000, carrier_hz=16_000.0)
    shown = steady(np.ones(16), drive.period_s)
    coarse, fine = (
        max(np.abs(block).max() for block in volts(replace(drive, rate_hz=rate), shown)) for rate in (48_000, 960_000)
    )
    assert coarse < 0.9 * fine
    assert load_of(plan, drive, shown).peak_v == pytest.approx(fine, rel=0.01)


@pytest.mark.sample(2)
@pytest.mark.parametrize("scheme", [*SCHEMES, "carrier"])
def test_judged_volts_are_those_of_the_firmware_in_all_states(tmp_path, scheme):
    text = f"scheme = '{'spur-free' if scheme == 'carrier' else scheme}'\nvoltage_limit_v = 1"
    plan = planned("power_limit_w = 1e-3", text)
    drive = make_drive(plan, 16_000, carrier_hz=3000.0 if scheme == "carrier" else None)
    found = {f.code: f for f in judge_limits("x", plan, drive)}
    judged_v = asked_in(found["coil.voltage"])
    judged_w = asked_in(found["coil.heat"])
    states = np.stack([state_frames(plan, f"{k:04b}")[0] for k in range(16)])
    for name, limit_v in (("uncut", 1000.0), ("cut", 1.0)):
        (tmp_path / name).mkdir()
        pad = compiled(
            plan,
            replace(drive, voltage_limit_v=limit_v),
            tmp_path / name,
            # Coils that bear any heat, so that nothing but volts is cut.
            lambda text: re.sub(r"(COIL|PAD)_LIMIT_UW \d+", r"\1_LIMIT_UW 1000000000000", text),
        )
        each = pad.number("PADGEN_STEP_SAMPLES") * pad.number("PADGEN_SLOTS") + 2 * drive.period_samples
        script = "".join(feed(frame_message(f, k)) + pad.wait(each) for k, f in enumerate(states))
        run = pad.run(pad.hello + script)
        peak = np.abs(run.volts).max()
        if name == "cut":
            assert peak == 1.0
            continue
        assert peak <= judged_v * (1 + 1e-5)
        assert peak == pytest.approx(judged_v, rel=0.04)
        if scheme != "time-shared":
            held = [run.volts[end - drive.period_samples : end] for end in each * np.arange(1, 17)]
            loss = max(watts(plan, part, drive.rate_hz) for part in held)
            assert judged_w == pytest.approx(loss, rel=0.01)


def test_the_widest_template_is_judged_by_what_it_takes():
    spec = load_spec("wide-11")
    plan = pg.plan(replace(spec, drive=replace(spec.drive, level_um=100.0)))
    drive = drive_at(plan, CONTROLLER_RATES_HZ)
    # The state that needs most has few taxels off, but not none.
    peaks_v = []
    for off in combinations_with_replacement(drive.coils[0].taxels, 2):
        levels = np.ones(len(plan.taxels))
        levels[list(off)] = 0.0
        peaks_v += [np.abs(block).max() for block in volts(drive, steady(levels, drive.period_s))]
    # Above it, points between samples (0.5 %) and the slope of a blend (0.8 %) are bounded.
    assert max(peaks_v) <= load_of(plan, drive).peak_v <= 1.015 * max(peaks_v)
    # Sag and level take the softest taxel further than a third of the gap.
    assert {f.code for f in judge_limits("x", plan, drive)} == {"coil.voltage", "coil.heat", "gap.travel"}


def test_a_bound_of_many_states_is_one(monkeypatch):

    plan = planned("", "scheme = 'spur-free'\nvoltage_limit_v = 1")
    for carrier_hz in (None, 3000.0):
        drive = make_drive(plan, 16_000, carrier_hz=carrier_hz)
        seen = load_of(plan, drive)
        for name, value in (("MOST_CHANNELS", 3), ("MOST_POINTS", 0)):
            with monkeypatch.context() as patch:
                patch.setattr(loads, name, value)
                bound = load_of(plan, drive)
            assert seen.peak_v <= bound.peak_v < 1.6 * seen.peak_v
            assert (seen.square_a2 <= bound.square_a2 + 1e-15).all()


def test_grey_levels_and_changes_are_never_above_what_is_judged():
    rng = np.random.default_rng(1)
    for scheme in SCHEMES[:3]:
        plan = planned("power_limit_w = 1e-3", f"scheme = '{scheme}'\nvoltage_limit_v = 1")
        drive = make_drive(plan, 16_000)
        any_load = load_of(plan, drive)
        for _ in range(3):
            shown = timeline(plan, rng.choice([0, 0.02, 0.3, 0.7, 1.0], (4, 16)))
            load = load_of(plan, drive, shown)
            assert load.peak_v <= any_load.peak_v * (1 + 1e-9)
            assert (load.square_a2 <= any_load.square_a2 * (1 + 1e-9)).all()


@pytest.mark.parametrize("scheme", SCHEMES[:3])
def test_a_change_that_is_quick_is_never_above_what_is_judged(monkeypatch, scheme):

    plan = planned("power_limit_w = 1e-3", f"scheme = '{scheme}'\nvoltage_limit_v = 1")
    drive = make_drive(plan, 48_000)
    quick_s = 5e-4
    monkeypatch.setattr(loads, "ramp_s", lambda plan: quick_s)
    held = 0.0213
    on = np.ones((1, 16))
    times = np.cumsum([0.0, *[quick_s, held] * 10])
    levels = np.concatenate([0 * on, *[on, on, 0 * on, 0 * on] * 5])
    changes = load_of(plan, drive, Timeline(times, levels, False))
    steadily = max(np.abs(block).max() for block in volts(drive, steady(on[0], drive.period_s)))
    assert 1.02 * steadily < changes.peak_v <= load_of(plan, drive).peak_v


def integrated(folder: Path, coil: Coil) -> tuple[np.ndarray, np.ndarray]:
    """Return volts and amperes (samples, coils) of ``drive.wav``, by own reading and integration of its bytes.

    The voltage is taken as straight between samples.
    """
    raw = (folder / "drive.wav").read_bytes()
    told = json.loads((folder / "drive-wave.json").read_text())
    at = raw.index(b"data") + 8
    data = np.frombuffer(raw[at : at + int.from_bytes(raw[at - 4 : at], "little")], "<f4")
    volt = data.reshape(-1, len(told["coils"])) * told["full_scale"]
    turns = coil.resistance_ohm / (coil.inductance_mh * 1e-3) / told["rate_hz"]
    decay = np.exp(-turns)
    mean = -np.expm1(-turns) / turns
    return volt, lfilter(np.array([1 - mean, mean - decay]) / coil.resistance_ohm, [1, -decay], volt, axis=0)


def judged_and_found(plan: Plan, rng: np.random.Generator, folder: Path, carrier_hz: float | None = None):
    """Save a file of random frames; return largest V, A, W of a coil and W in all, as judged and as in its bytes."""
    # Limits that nothing keeps: peaks are then looked for and not bounded.
    own = replace(plan.spec.drive, voltage_limit_v=0.01)
    plan = replace(plan, spec=replace(plan.spec, drive=own, amplifier=Amplifier("least", 9999, "DC", 0.01, 1e-4)))
    frames = rng.choice([0.0, 0.2, 0.5, 1.0], (3, len(plan.taxels)), p=[0.4, 0.1, 0.1, 0.4])
    drive = drive_at(plan, RATES_HZ, 48_000, carrier_hz=carrier_hz)
    turns = plan.scheme.takes_turns
    each_s = None if turns else ramp_s(plan) + drive.period_s
    Drive(plan, frames, each_s, rate_hz=48_000, carrier_hz=carrier_hz).save_folder(
        folder, ["wav", "hjif"], depth="float"
    )
    held_s = timeline(plan, frames, each_s).frame_s - ramp_s(plan) / 2
    signs = choose_signs(PlayedPad(plan, drive, None), frames, held_s, turns)
    shown = timeline(plan, frames, each_s, signs=signs)
    load = load_of(plan, drive, shown)
    ohm = plan.spec.coil.resistance_ohm
    volt, ampere = integrated(folder, plan.spec.coil)
    # The last period of each frame, over which beats even out; of turns, each sine's last before the way down.
    drive_hz = [channel.drive_hz for channel in plan.channels]
    if turns:
        keys = range(1, len(shown.time_s) - 1, 2)
        sounding_hz = [drive_hz[plan.taxels[int(shown.levels[key].argmax())].channel] for key in keys]
        # As many whole periods as there are in one of the lowest channel.
        periods = [round(48_000 * (hz // drive_hz[0]) / hz) for hz in sounding_hz]
    else:
        keys = range(2, len(shown.time_s), 2)
        periods = [drive.period_samples] * len(keys)
    ends = [int(np.ceil(shown.time_s[key] * 48_000)) for key in keys]
    watt = ohm * np.stack([(ampere[end - n : end] ** 2).mean(0) for end, n in zip(ends, periods, strict=True)])
    haptics = read_hjif((folder / "drive.hjif").read_text())
    reached = [channel.level.max(initial=0.0) for channel in haptics.channels]
    np.testing.assert_allclose(reached, load.level, atol=1e-6)
    judged = (load.peak_v, load.peak_a, ohm * load.square_a2.max(), ohm * load.total_a2)
    return np.array(judged), np.array([np.abs(volt).max(), np.abs(ampere).max(), watt.max(), watt.sum(1).max()])


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["paper-pair", "triple-48", "quad-64", *range(4)])
def test_no_file_exceeds_what_is_judged_of_it(tmp_path, name):
    """The bytes of a file of random frames stay within 0.1 % of what is judged, and come near to it."""
    rng = np.random.default_rng(name if isinstance(name, int) else 7)
    if isinstance(name, int):
        drive = f"scheme = '{SCHEMES[name]}'\nlevel_um = {rng.uniform(1, 40):.3g}"
        plan = planned(f"gap_mm = {rng.uniform(0.6, 1.2):.2g}", drive)
    else:
        plan = pg.plan(name)
    judged, found = judged_and_found(plan, rng, tmp_path / "o")
    least = np.array([0.98, 0.98, 0.7, 0.7] if plan.scheme.takes_turns else [0.98, 0.98, 0.999, 0.999])
    assert (least * judged <= found).all() and (found <= 1.001 * judged).all(), found / judged


@pytest.mark.parametrize(
    ("code", "table", "told"),
    [
        (
            "coil.current",
            "[amplifier]\nchannels = 4\ncoupling = 'DC'\nvoltage_v = 30\ncurrent_a = 0.02",
            "current_a = 0.02 A",
        ),
        ("limits.power", "[limits]\npower_w = 0.05", "power_w = 0.05 W"),
        (
            "beam.stress",
            "level_um = 120\nvoltage_limit_v = 1e4\n[material]\nname = 'pla'\nfatigue_stress_mpa = 7",
            "fatigue_stress_mpa = 7 MPa",
        ),
        (
            "skin.level",
            "level_um = 190\nvoltage_limit_v = 1e4",
            "above 5 m/s², what Directive 2002/44/EC allows for eight hours a day",
        ),
    ],
)
def test_limits_of_amplifier_pad_beams_and_skin_are_judged_with_a_level_that_fits(code, table, told):
    text = f"scheme = 'tones'\n{table}"
    plan = planned("power_limit_w = 1e4\ngap_mm = 3", text)
    (finding,) = (f for f in judge_limits("x", *with_level(plan, plan.spec.drive.level_um)) if f.code == code)
    assert told in finding.message
    level = re.search(r"drive.level_um of ([\d.]+) would fit", finding.message).group(1)
    assert not judge_limits("x", *with_level(plan, float(level)))
    if code != "skin.level":  # at that level beams bend too far, too
        assert code in {f.code for f in judge_limits("x", *with_level(plan, float(level) * 1.2))}
    if code == "beam.stress":
        assert asked_in(finding) == pytest.approx(max(c.root_stress_mpa for c in plan.channels), rel=1e-4)
    if code == "skin.level":  # by the velocity, which ISO 5349-1 weighs alike above 16 Hz: 1/16 s of a sine
        worst = max(plan.channels, key=lambda c: c.level_um * c.resonance_hz)
        velocity = np.sqrt(2) * np.pi * worst.resonance_hz * worst.level_um * 1e-6
        assert asked_in(finding) == pytest.approx(100 * velocity, rel=0.05)


JERK = Limit(
    "toy.jerk",
    "plate",
    "the jerk of a plate",
    "m/s³",
    "what the toy bears",
    lambda spec: 10.0 * spec.drive.level_um,
    lambda _, one: (2 * np.pi * one.channel.resonance_hz) ** 3 * one.level * one.channel.level_um * 1e-6,
    of_taxels=True,
    firmware="PADGEN_JERK_LIMIT_U",
)


def test_a_new_limit_is_one_row_for_plans_files_firmware_and_benches(tmp_path):
    limit_table.register(JERK)
    try:
        plan = planned("", "scheme = 'tones'\nlevel_um = 10.5")  # not planned before, without the limit
        most = max((2 * np.pi * c.resonance_hz) ** 3 * c.level_um * 1e-6 for c in plan.channels)
        (found,) = (f for f in plan.findings if f.code == "toy.jerk")
        assert found.level == "error" and plan.verdict.limit == "toy.jerk"
        assert asked_in(found) == pytest.approx(most, rel=1e-4)  # five digits
        driven = written(plan, tmp_path / "o", "wav,c")
        assert [f.code for f in driven.findings if f.where == "drive.wav"].count("toy.jerk") == 1
        header = "".join(path.read_text() for path in (tmp_path / "o").rglob("*.h"))
        assert "#define PADGEN_JERK_LIMIT_U 105000000\n" in header  # 10 times 10.5 µm, in millionths
        _, beyond = write_excitation(plan, tmp_path / "e", "chirp", 8000, "24", None, True)
        assert "toy.jerk" in {f.code for f in beyond}
        with pytest.raises(SpecError, match=r"there is a limit 'toy.jerk' already"):
            limit_table.register(JERK)
    finally:
        limit_table.unregister("toy.jerk")


def test_the_page_of_limits_lists_the_table():
    page = Path(__file__).parents[2] / "docs" / "limits.md"
    rows = [line.split("|")[1:-1] for line in page.read_text().splitlines() if line.startswith("| `")]
    told = [[cell.strip() for cell in row][:4] for row in rows]
    assert told == [[f"`{one.code}`", one.quantity, one.unit, one.bound_name] for one in limit_table.LIMITS]


def with_level(plan: Plan, level_um: float) -> tuple:
    lower = replace(plan, spec=replace(plan.spec, drive=replace(plan.spec.drive, level_um=level_um)))
    return lower, drive_at(lower, CONTROLLER_RATES_HZ)


# ---- Excitation, tuning, carriers ----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_an_excitation_is_judged_too(tmp_path, kind):
    def excited(name: str, plan: Plan) -> list[str]:
        _, findings = write_excitation(plan, tmp_path / name, kind, 8000, "24", None, True)
        return [finding.code for finding in findings]

    assert not excited("a", planned())
    assert not excited("b", planned(*BEYOND["heat"][:2]))
    coil, drive, _ = BEYOND["pull-in"]
    parts = {code.partition(".")[0] for code in excited("c", planned(coil, drive))}
    assert parts <= {"coil", "gap", "beam", "skin"}
    with pytest.raises(SpecError, match=r"is not played: the (mean pull|travel|.*stress|acceleration)"):
        sound_card.play_wave(tmp_path / "c" / "excitation.wav")


@pytest.mark.parametrize("kind", KINDS)
def test_what_an_excitation_reaches_between_samples_counts(kind):
    plan = planned()
    coarse, fine = (excitation(plan, kind, rate, 2.0, together=True) for rate in (8_000, 48_000))
    loud = replace(coarse, voltage_v=40 * coarse.voltage_v, current_a=5 * coarse.current_a)
    load = excitation_load(plan, loud)
    assert [f.code for f in judge_load("x", plan, load)][:2] == ["coil.voltage", "coil.heat"]
    assert load.square_a2[0] == pytest.approx(25 * (coarse.current_a[: 2 * 8000] ** 2).mean())
    assert load.peak_v >= 40 * np.abs(coarse.voltage_v).max()
    if kind == "chirp":
        assert load.peak_v / 40 == pytest.approx(np.abs(fine.voltage_v).max(), rel=0.01)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("inductance", [0, 40])
def test_no_voltage_between_samples_is_above_the_one_that_is_judged(kind, inductance):
    # At the lowest rate, and so weak an amplifier that it limits the level; 16 points between two samples.
    plan = planned(f"inductance_mh = {inductance}", "voltage_limit_v = 0.5")
    played = excitation(plan, kind, ceil(4 * measuring_band_hz(plan)[1]))
    count = len(played.voltage_v)
    reached = np.abs(np.fft.irfft(np.fft.rfft(played.voltage_v), 16 * count)).max() * 16
    judged = excitation_load(plan, played).peak_v
    assert np.abs(played.voltage_v).max() < reached < 1.001 * judged
    assert judged <= 0.5 * (1 + 1e-9)


def test_a_tuned_print_is_judged_by_its_own_drive():
    plan = planned("", "scheme = 'tones'\nlevel_um = 10")
    print_ = planned_tuning(plan)
    # A print that answers a tenth as strongly takes ten times the heat.
    weak = replace(
        print_, taxels=tuple(replace(t, response_um_per_a2=t.response_um_per_a2 / 10) for t in print_.taxels)
    )
    assert not judge_limits("x", plan, drive_at(plan, RATES_HZ))
    (finding,) = judge_limits("x", plan, drive_at(plan, RATES_HZ, tuning=weak), tuning=weak)
    assert finding.code == "coil.heat"


@pytest.mark.parametrize(("drive", "keeps"), [("level_um = 2", True), ("level_um = 10", False)])
def test_a_carrier_that_is_named_was_tried(tmp_path, drive, keeps):
    plan = planned("", f"scheme = 'spur-free'\n{drive}")
    (note,) = (f for f in written(plan, tmp_path / "o", "wav").findings if f.code == "wave.dc")
    hz = float(re.search(r"--carrier ([\d.]+)", note.message).group(1))
    assert ("keeps all limits" in note.message) == keeps
    tried = written(plan, tmp_path / "o", "wav,c", carrier_hz=hz)
    assert bool([f for f in tried.findings if f.level == "error" and f.where == "drive.wav"]) != keeps
    if not keeps:
        said = float(re.search(r"voltage of a coil is ([\d.]+) V, above", note.message).group(1))
        assert said == pytest.approx(tried.report.peak, rel=0.01)


def test_a_carrier_that_the_plan_knows_nothing_of_is_judged_by_what_it_heats():
    """Lines about a carrier have less room, the root's bends are blunter, and the constant exceeds the headroom's."""
    plan = planned("", "scheme = 'spur-free'\nlevel_um = 1\nvoltage_limit_v = 100")
    hz = 5000.0
    alone, carried = (load_of(plan, drive_at(plan, RATES_HZ, carrier_hz=each)) for each in (None, hz))
    between = plan.spec.coil.resistance_ohm * float(alone.square_a2.max() + carried.square_a2.max()) / 2
    plan = planned(f"power_limit_w = {between}", "scheme = 'spur-free'\nlevel_um = 1\nvoltage_limit_v = 100")
    assert not judge_limits("x", plan, drive_at(plan, RATES_HZ))
    (finding,) = judge_limits("x", plan, drive_at(plan, RATES_HZ, carrier_hz=hz))
    assert (finding.level, finding.code) == ("error", "coil.heat")


@pytest.mark.sample(2)
@pytest.mark.parametrize("carrier_hz", [1715.0, 3000.0, 9000.0, 20000.0])
def test_a_carrier_is_accepted_by_every_format(tmp_path, carrier_hz):
    plan = planned("", "scheme = 'spur-free'\nlevel_um = 0.1")
    hz = max(carrier_hz, 5 * max(c.resonance_hz for c in plan.channels))
    driven = written(plan, tmp_path / "o", "csv,json,wav,c,hjif,syntacts", carrier_hz=hz)
    assert "pad_drive.h" in driven.files and "drive.wav" in driven.files


@pytest.mark.parametrize("carrier_hz", [1.0, 1e5, 1e300, np.inf, -np.inf, np.nan])
@pytest.mark.parametrize("formats", ["wav", "c"])
def test_a_carrier_that_cannot_be_is_refused_with_its_bounds(tmp_path, formats, carrier_hz):
    with pytest.raises(SpecError, match="--carrier: must be") as refused:
        written(planned("", "scheme = 'spur-free'"), tmp_path / "o", formats, carrier_hz=carrier_hz)
    low, high = re.search(r"must be (\S+) … (\S+) Hz", str(refused.value)).groups()
    assert not (tmp_path / "o").exists()
    assert float(high) > float(low)
    if np.isnan(carrier_hz):  # the bound is the same of all, and writing firmware takes seconds
        driven = written(planned("", "scheme = 'spur-free'"), tmp_path / "o", "c", "", carrier_hz=float(low))
        assert "pad_drive.h" in driven.files


# ---- Amplifiers ----------------------------------------------------------------------------------------------------

EIGHT = (
    'name = "eight"\nresolution = {taxels}\nband_hz = [50, 400]\nq_min = 15\ndelta_y = 5\nprinter = "fdm-0.25"\n'
    "[pad]\nwidth_mm = 60\ndepth_mm = 60\nrib_mm = 0.6\n"
    '[amplifier]\nchannels = {channels}\ncoupling = "{coupling}"\nvoltage_v = {volts}\ncurrent_a = {amperes}\n'
)


def amplified(taxels=64, channels=16, coupling="AC", volts=10, amperes=0.5, more="") -> str:
    return EIGHT.format(taxels=taxels, channels=channels, coupling=coupling, volts=volts, amperes=amperes) + more


def test_too_few_channels_are_refused_with_what_was_tried_and_does():
    spec = parse_spec(amplified(channels=8))
    with pytest.raises(InfeasibleError, match=r"8 channels, one for each coil; .* would do") as error:
        pg.plan(spec)
    assert [set(cure) for cure in error.value.cures] == [{"amplifier.channels"}, {"resolution"}]
    for cure in error.value.cures:
        plan = pg.plan(varied(spec, cure))
        assert not plan.scheme.has_constant
        assert plan.coils.rows * plan.coils.columns <= plan.spec.amplifier.channels
        assert plan.load.voltage_peak_v <= 10 and plan.load.current_peak_ma <= 500
        assert plan.prints.good_share >= plan.spec.print_share
    with pytest.raises(InfeasibleError, match=r"has channels for 8 coils .* amplifier.channels = 16 would do"):
        pg.plan(parse_spec(amplified(channels=8, more="[coil]\ngrid = [4, 4]\n")))


def test_what_an_amplifier_lacks_is_told_with_a_level_that_fits():
    for limit_v, amperes, code in ((1, 0.5, "coil.voltage"), (30, 0.01, "coil.current")):
        spec = parse_spec(amplified(16, 4, "DC", limit_v, amperes, "[coil]\ngrid = [2, 2]\n"))
        (finding,) = (f for f in pg.plan(spec).findings if f.code == code)
        lower = pg.plan(varied(spec, finding.cures[0]))
        assert code not in {f.code for f in lower.findings}
        assert lower.load.voltage_peak_v <= limit_v and lower.load.current_peak_ma <= 1e3 * amperes


def test_a_spur_free_drive_is_carried_through_an_amplifier_without_direct_current(tmp_path):
    grid = "[coil]\ngrid = [2, 2]\n[drive]\nscheme = 'spur-free'\n"
    plan = pg.plan(parse_spec(amplified(16, 4, "AC", 60, more=grid)))
    frames = np.stack([np.ones(16), state_frames(plan, "0101")[0]])
    driven = Drive(plan, frames, held=True, rate_hz=48_000).save_folder(tmp_path / "o", ["csv", "wav", "c"])
    assert not [f for f in driven.findings if f.level == "error" or f.code == "wave.dc"]
    wave = read_wav(tmp_path / "o" / "drive.wav")
    volts_out = wave.read() * driven.report.full_scale
    assert np.abs(volts_out.mean(0)).max() < 1e-5 * np.abs(volts_out).max()
    assert np.abs(volts_out).max() <= plan.load.voltage_peak_v
    coil = plan.spec.coil
    omega = 2 * np.pi * np.fft.rfftfreq(len(volts_out), 1 / wave.rate_hz)[:, None]
    lines = np.fft.rfft(volts_out, axis=0) / (coil.resistance_ohm + 1j * omega * coil.inductance_mh * 1e-3)
    current = np.fft.irfft(lines, len(volts_out), axis=0)
    assert 0.5 < 1e3 * np.abs(current).max() / plan.load.current_peak_ma <= 1
    with pytest.raises(SpecError, match="of noise has a constant part"):
        excitation(plan, "noise", 8000)
    assert abs(excitation(plan, "chirp", 8000).voltage_v.mean()) < 0.01
    rows = (tmp_path / "o" / "drive.csv").read_text().splitlines()
    assert len(rows) == 5 and "bias" not in rows[-1]


@pytest.mark.parametrize("seed", range(6))
def test_no_plan_asks_more_of_an_amplifier_than_it_has_without_saying_so(seed):
    rng = np.random.default_rng(seed)
    coupling = ("AC", "DC")[seed % 2]
    limit_v = float(rng.choice([1.5, 5, 40]))
    amperes = float(rng.choice([0.03, 1]))
    grid = "[coil]\ngrid = [2, 2]\n"
    plan = pg.plan(parse_spec(amplified(int(rng.choice([8, 12, 16])), 4, coupling, limit_v, amperes, grid)))
    codes = {f.code for f in plan.findings}
    assert coupling == "DC" or not plan.scheme.is_biased
    assert (plan.load.voltage_peak_v > limit_v) == ("coil.voltage" in codes)
    assert (plan.load.current_peak_ma > 1e3 * amperes) == ("coil.current" in codes)


def test_an_amplifier_is_a_table_of_its_own(tmp_path):
    spec = parse_spec(amplified(volts=12))
    assert spec.drive.voltage_limit_v == 12 and spec.amplifier.name == "own"
    assert parse_spec(amplified(volts=12, more="[drive]\nvoltage_limit_v = 5\n")).drive.voltage_limit_v == 5
    assert parse_spec(amplified(volts=12, more="[drive]\nvoltage_limit_v = 25\n")).drive.voltage_limit_v == 12
    assert varied(spec, {"amplifier.voltage_v": 20.0}).drive.voltage_limit_v == 20
    assert varied(spec, {"amplifier.coupling": "DC"}) == parse_spec(amplified(volts=12, coupling="DC"))
    assert "amplifier" not in json.loads(plan_to_json(planned()))["spec"]
    made = pg.plan(spec)
    (tmp_path / "plan.json").write_text(plan_to_json(made))
    assert read_plan(tmp_path / "plan.json").spec == made.spec
    bare = FOUR.split("[pad]")[0]
    catalogued = parse_spec(bare + '[amplifier]\nname = "tpa3116d2"\nchannels = 16')
    assert catalogued.amplifier.coupling == "AC" and catalogued.amplifier.channels == 16
    for text, sentence in (
        ("[amplifier]\nchannels = 8", "amplifier.coupling: is missing"),
        ('amplifier = "none"', "there is no amplifier 'none'"),
        ('[amplifier]\nname = "tpa3116d2"\n[drive]\nscheme = "biased"', "which the AC-coupled amplifier 'tpa3116d2'"),
    ):
        with pytest.raises(SpecError, match=sentence):
            parse_spec(bare + text)


def test_parts_of_the_catalogues_are_named_where_they_suffice():
    """The smallest first, by the rows of the catalogues, which may grow."""
    tones = planned(drive="scheme = 'tones'")
    biased = planned(drive="scheme = 'biased'")
    for plan, passed in ((tones, ("AC", "DC")), (biased, ("DC",))):  # the others pass no direct current
        suffice = {
            name: -(-4 // row["channels"])
            for name, row in catalogue("amplifier").items()
            if row["coupling"] in passed
            and row["voltage_v"] >= plan.load.voltage_peak_v
            and row["current_a"] * 1e3 >= plan.load.current_peak_ma
        }
        assert plan.parts.amplifiers == suffice and "l272" in suffice
        watts = [catalogue("amplifier")[name] for name in plan.parts.amplifiers]
        watts = [row["voltage_v"] * row["current_a"] for row in watts]
        assert watts == sorted(watts)
        cards = {name: row for name, row in catalogue("sound_card").items() if row["coupling"] in passed}
        cards = {name: row for name, row in cards.items() if row["channels"] >= 4}
        assert set(plan.parts.sound_cards) == set(cards)
        channels = [cards[name]["channels"] for name in plan.parts.sound_cards]
        assert channels == sorted(channels)
    loud = planned("power_limit_w = 1e4", "scheme = 'tones'\nlevel_um = 400\nvoltage_limit_v = 1e5")
    assert loud.load.voltage_peak_v > 28.2 and not loud.parts.amplifiers
    # Of 16 coils few sound cards have the outputs.
    found = pg.plan("paper-16").parts.sound_cards
    assert "motu-24ao" in found
    assert "es-9" not in found


def test_an_amplifier_that_is_named_feeds_the_plan_of_a_spec_with_it():
    drive = "scheme = 'spur-free'\nlevel_um = 10"
    named = planned(drive=drive).parts.amplifiers
    for name, entry in catalogue("amplifier").items():
        limit = f"voltage_limit_v = {entry['voltage_v']}\nheadroom = {0.25 if entry['coupling'] == 'DC' else 1}"
        plan = planned(drive=f"{drive}\n{limit}\n[amplifier]\nname = '{name}'\nchannels = 4")
        fed = plan.load.voltage_peak_v <= entry["voltage_v"] and plan.load.current_peak_ma <= 1e3 * entry["current_a"]
        # Those that pass no direct current need a carrier, which the plan without them has not.
        assert (name in named) == (fed and entry["coupling"] == "DC")
        assert (name in plan.parts.amplifiers) == fed
    assert 1 < len(named) < len(catalogue("amplifier"))


def test_boards_of_the_catalogue_are_named_where_they_are_in_time(tmp_path):
    assert boards_in_time(drive_at(planned(drive="scheme = 'tones'"), CONTROLLER_RATES_HZ)) == list(catalogue("board"))
    # As docs/measure_firmware.py counts: 63 MHz of paper-32, 81 of wide-11, 960 of big-512.
    needed = {name: drive_at(pg.plan(name), CONTROLLER_RATES_HZ) for name in ("wide-11", "big-512")}
    assert 81 < sample_mhz(needed["wide-11"]) < 90 and "itsybitsy-m4" not in boards_in_time(needed["wide-11"])
    assert 960 < sample_mhz(needed["big-512"]) < 1000 and not boards_in_time(needed["big-512"])
    (finding,) = Drive(pg.plan("big-512")).save_folder(tmp_path / "o", ["c"]).findings
    assert (finding.level, finding.code) == ("warning", "firmware.time")
