"""Contrast of frames over their whole slots, and the brake, against integrations that know nothing of the model.

| must agree | with | to | why not exactly |
|---|---|---|---|
| amplitudes and their energies | ``τ a' = g − a`` by DOP853 | 3e-4 | the blend is taken as straight in 128 steps |
| a braked resonator | at rest | 3 % | its envelope is of first order in 1/Q |
| contrast of files, stated and heard | an integration of the bytes | 0.5 dB, braked 0.25 | lines on a comb, beats |
| the plan's worst case | frames that swap two taxels | 0.6 dB | the taxel's hearing of the other is as if held |
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete, lfilter

import padgen as pg
from padgen import cli
from padgen.core.errors import SpecError
from padgen.driver.drive_folder import levels_of
from padgen.driver.loads import judge_limits, load_of
from padgen.driver.waveform import blocks, brake_of, braked_s, drive_at, ramp_s, steady, timeline
from padgen.physics.switching import blend, brake_for, follow, keyframes, overlap
from padgen.planner.plan import plan_from_json, plan_to_json
from tests.slot_integrator import slot_contrast_db

TAUS = np.array([0.01, 0.09, 0.5])


def level_at(time, time_s, levels):
    """Return the level at a time between keyframes."""
    k = int(np.clip(np.searchsorted(time_s, time, side="right") - 1, 0, len(time_s) - 2))
    share = blend(np.clip((time - time_s[k]) / (time_s[k + 1] - time_s[k]), 0, 1))
    return (1 - share) * levels[k] + share * levels[k + 1]


def test_amplitudes_and_energies_are_those_of_the_envelopes_equation():
    time_s = np.array([0.0, 0.15, 0.4, 0.48, 0.6])
    levels = np.array([0.0, 1.0, 1.0, -0.6, 0.0])[:, None] * np.ones(3)
    amplitude, energy = follow(time_s, levels, TAUS, 0.2)
    for taxel, tau_s in enumerate(TAUS):

        def slope(time, state, tau_s=tau_s):
            return ((level_at(time, time_s, levels[:, 0]) - state[0]) / tau_s, state[0] ** 2)

        exact = solve_ivp(slope, (0, 0.6), [0.2, 0], "DOP853", time_s, rtol=1e-9, atol=1e-11, max_step=2e-3).y
        assert amplitude[:, taxel] == pytest.approx(exact[0], abs=3e-4)
        assert energy[:, taxel] == pytest.approx(np.diff(exact[1]), abs=3e-4 * 0.15)


def test_overlaps_are_integrals_of_the_levels():
    time_s = np.array([0.0, 0.1, 0.3])
    first = np.array([[0.0], [1.0], [0.4]])
    second = np.array([[1.0], [0.5], [0.0]])
    fine = np.linspace(0, 0.3, 30001)
    product = [level_at(t, time_s, first[:, 0]) * level_at(t, time_s, second[:, 0]) for t in fine]
    assert overlap(time_s, first, second).sum() == pytest.approx(np.trapezoid(product, fine), rel=1e-5)


@pytest.mark.parametrize("through_zero", [False, True])
def test_a_brake_stops_a_resonator(through_zero):
    """By its own equation of motion under a line of constant frequency, in phase and in counter-phase."""
    hz = 60.0
    q = 15.0
    rate = 20000
    tau_s = np.array([q / (np.pi * hz)])
    brake = brake_for(tau_s, 0.075, through_zero)
    counter = brake.counter(np.ones(1), np.ones(1), tau_s)
    assert 0.1 < counter[0] <= 1
    time_s, levels = keyframes(np.array([[1.0], [0.0]]), 1.5, 0.15, brake, tau_s)
    assert levels.min() == pytest.approx(-counter[0], abs=1e-4)  # a frame of 1.5 s has its level, but for e^-14
    at_s = np.arange(int(3 * rate)) / rate
    force = np.array([level_at(t, time_s, levels[:, 0]) for t in at_s]) * np.cos(2 * np.pi * hz * at_s)
    omega = 2 * np.pi * hz
    num, den, _ = cont2discrete(([omega**2 / q], [1.0, omega / q, omega**2]), 1 / rate, "foh")
    motion = np.abs(lfilter(num.ravel(), den, force))
    assert motion[round(1.1 * rate) : round(1.2 * rate)].max() == pytest.approx(1, abs=0.01)
    assert motion[round(1.5 * rate) :].max() < 0.03
    # Unbraked it would have e^-(0.15/τ) left at least.
    assert np.exp(-brake.seconds / tau_s[0]) > 0.05


def test_a_slower_taxel_takes_a_longer_brake():
    short, long = (brake_for(np.array([tau_s]), 0.05, False) for tau_s in (0.02, 0.5))
    assert short.blend_s == 0.05
    assert long.blend_s > 0.05
    assert long.counter(np.ones(1), np.ones(1), np.array([0.5]))[0] == pytest.approx(1, abs=0.1)


SHOWN = [
    ("paper-32", {"text": "HI"}, False),
    ("pad-32", {"text": "HI"}, True),
    pytest.param("triple-48", {"text": "HI"}, False, marks=pytest.mark.soak),
    pytest.param("quad-64", {"text": "OK"}, True, marks=pytest.mark.soak),
    pytest.param("wide-11", {"pattern": "rows"}, False, marks=pytest.mark.soak),
    pytest.param("paper-32", {"text": "HI"}, True, marks=pytest.mark.soak),
    pytest.param("pad-32", {"text": "HI"}, False, marks=pytest.mark.soak),
    pytest.param("triple-48", {"text": "HI"}, True, marks=pytest.mark.soak),
    pytest.param("quad-64", {"text": "OK"}, False, marks=pytest.mark.soak),
    pytest.param("wide-11", {"pattern": "rows"}, True, marks=pytest.mark.soak),
]


@pytest.mark.sample(1)
@pytest.mark.parametrize(("name", "shown", "brake"), SHOWN)
def test_bytes_keep_over_their_slots_what_is_stated(name, shown, brake, tmp_path):
    plan = pg.plan(name)
    driven = pg.drive(plan, **shown, brake=brake).save(tmp_path, formats=("wav",), hear=True)
    frames = levels_of(plan, None, **shown)
    stated = driven.contrast
    slots, _ = slot_contrast_db(plan, frames, stated.frame_s, tmp_path)
    # Braked, ON and OFF lie so far apart that other modes and the comb count, but no ringing does.
    tolerance_db = 0.25 if brake else 0.5
    assert stated.slot_db == pytest.approx(np.nanmin(slots), abs=tolerance_db)
    assert driven.heard.slot_contrast[0] == pytest.approx(np.nanmin(slots), abs=tolerance_db)
    table = json.loads((tmp_path / "hear.json").read_text())
    assert table["summary"]["slot_db"] == pytest.approx(driven.heard.slot_contrast[0])
    assert len(table["frames"]) == len(frames)
    assert table["frame_s"] == pytest.approx(stated.frame_s)
    # The brake is worth it, at the frame rate that the plan states for it.
    codes = [finding.code for finding in driven.findings]
    assert ("frames.slot" in codes) == (not brake)
    assert not any(finding.level == "error" for finding in driven.findings)


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", ["paper-32", "quad-64"])
@pytest.mark.parametrize("brake", [False, True], ids=["as it is", "braked"])
def test_the_plans_worst_case_is_that_of_frames_which_swap_taxels(name, brake, tmp_path):
    plan = pg.plan(name)
    rate = next(one for one in plan.refresh if one.scheme == plan.selectivity.drive)
    frames = np.zeros((4, len(plan.taxels)))
    for index, taxel in enumerate(plan.taxels):
        frames[:, index] = [(taxel.channel == 0) == (k == 3) for k in range(4)]
    seconds = 1 / (rate.braked_frames_per_s if brake else rate.frames_per_s)
    driven = pg.drive(plan, frames=frames, seconds=seconds, brake=brake).save(tmp_path, formats=("wav",))
    slots, _ = slot_contrast_db(plan, frames, seconds, tmp_path)
    said = rate.braked_db if brake else rate.slot_db
    assert said - 0.6 < np.nanmin(slots)
    assert driven.contrast.slot_db == pytest.approx(np.nanmin(slots), abs=0.5)
    if not brake:
        assert said > np.nanmin(slots) - 3


def test_rates_of_the_plan_keep_what_they_say():
    plan = pg.plan("quad-64")
    rate = next(one for one in plan.refresh if one.scheme == plan.selectivity.drive)
    assert rate.kept_db == 10.0
    assert rate.kept_frames_per_s < rate.frames_per_s < rate.braked_frames_per_s * 2
    assert rate.slot_db < 1 < 10 < rate.end_db < plan.selectivity.kept_db
    assert rate.braked_db > 10
    # A blend's integral is half: on average a transition of R costs R/2, and lags by τ.
    assert 1 / rate.braked_frames_per_s == pytest.approx(braked_s(plan), rel=1e-6)
    # An older plan has no such figures, and is read.
    table = json.loads(plan_to_json(plan))
    for entry in table["refresh"]:
        for key in [key for key in entry if key not in ("scheme", "frames_per_s")]:
            del entry[key]
    older = plan_from_json(json.dumps(table))
    assert older.refresh[0].slot_db is None
    assert older.refresh[0].frames_per_s == pytest.approx(plan.refresh[0].frames_per_s)


def test_the_warnings_cures_do(capsys, tmp_path):
    plan = pg.plan("pad-32")
    driven = pg.drive(plan, text="HI").save(tmp_path, formats=("wav",))
    (finding,) = [f for f in driven.findings if f.code == "frames.slot"]
    cures = [part.strip().split() for part in finding.message.split(";")[-1].removesuffix(" would do").split(" or ")]
    assert len(cures) == 2
    assert [words[0] for words in cures] == ["--seconds", "--brake"]
    for words in cures:
        seconds = float(words[words.index("--seconds") + 1]) if "--seconds" in words else None
        brake = "--brake" in words
        cured = pg.drive(plan, text="HI", seconds=seconds, brake=brake).save(tmp_path, formats=("wav",))
        assert cured.contrast.slot_db >= 10
        assert not [f for f in cured.findings if f.code == "frames.slot"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--text", "HI", "--brake", "--formats", "wav,hjif"], "--brake: is in a WAV only; hjif of --formats"),
        (["--text", "HI", "--brake", "--formats", "c"], "--brake: is in a WAV only"),
        (["--brake"], "--brake: is of a WAV"),
        (["--state", "10", "--brake", "--loop"], "--brake: is for the end of a frame"),
        (["--text", "HI", "--brake", "--seconds", "0.2"], "to be switched in, held and braked, got 0.2 s"),
        (["--excite", "chirp", "--brake"], "--brake does not go with it"),
    ],
)
def test_what_a_brake_does_not_go_with_is_refused(words, told, tmp_path, capsys):
    assert cli.run(["drive", "paper-pair", *words, "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert told in " ".join(said.split())
    assert "Traceback" not in said
    assert not (tmp_path / "out").exists()


def test_channels_that_take_turns_have_no_brake():
    plan = pg.plan("paper-pair", drive="time-shared")
    with pytest.raises(SpecError, match="takes turns"):
        brake_of(plan)
    rate = next(one for one in plan.refresh if one.scheme == "time-shared")
    assert (rate.end_db, rate.braked_frames_per_s) == (None, None)
    assert rate.slot_db > 5


@pytest.mark.parametrize("name", ["paper-32", "quad-64", "wide-11"])
def test_a_braked_file_is_within_what_it_is_judged_by(name):
    """Its peaks, played, are within the bounds; a limit just below what it takes is an error."""
    plan = pg.plan(name)
    frames = np.zeros((3, len(plan.taxels)))
    frames[0] = 1.0
    frames[1, ::2] = 1.0
    drive = drive_at(plan, (48000,))
    shown = timeline(plan, frames, brake=True)
    assert shown.levels.min() < -0.2
    load = load_of(plan, drive, shown)
    most_v, most_a = (
        max(float(np.abs(samples).max()) for samples, _ in blocks(drive, shown, signal))
        for signal in ("voltage", "current")
    )
    assert most_v <= load.peak_v
    assert most_a <= load.peak_a
    assert load.level.max() == 1.0
    beyond = judge_limits("drive.wav", plan, replace(drive, voltage_limit_v=0.9 * most_v), shown)
    assert not beyond  # the limit is the spec's
    tight = replace(plan, spec=replace(plan.spec, drive=replace(plan.spec.drive, voltage_limit_v=0.9 * most_v)))
    beyond = judge_limits("drive.wav", tight, replace(drive, voltage_limit_v=0.9 * most_v), shown)
    assert "coil.voltage" in {finding.code for finding in beyond}
    assert ramp_s(plan) > brake_of(plan).blend_s


@pytest.mark.parametrize("name", ["paper-32", "pad-32", "quad-64"])
def test_a_level_below_0_turns_its_line_of_the_squared_current_over(name):
    plan = pg.plan(name)
    drive = drive_at(plan, (48000,))
    coil = drive.coils[0]
    lines = []
    for sign in (1, -1):
        levels = np.zeros(len(plan.taxels))
        levels[coil.taxels[0]] = sign
        current = np.concatenate([a for a, _ in blocks(drive, steady(levels, drive.period_s), "current")])[:, 0]
        lines.append(np.fft.rfft(current**2)[coil.harmonic[0]] * 2 / len(current))
    assert lines[1] == pytest.approx(-lines[0], rel=1e-6)
    assert abs(lines[0]) == pytest.approx(coil.line_a2[0], rel=1e-3)
