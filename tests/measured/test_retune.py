"""Re-tuning against the plan, the Fourier transform and prints that are known exactly.

| figure | reference | tolerance | reason |
|---|---|---|---|
| a print as planned, re-tuned | the plan's figures in all states | 1e-4 dB | modes that none hears |
| planned tones on a print | `off_energy` of many prints at once | 1e-12 | the same sums in another order |
| ON and OFF in all states | lines of i² by FFT, complex receptances, every state | 1e-9 | rounding |
| drive table of a print as planned | `drive.csv` | its six digits | another way to the same formulas |
| prints scaled to a spread | sigma of ln f of new prints | 4 sigma | sampling |
| frequency from spectra at 30 dB | the print | 0.3 % median | the bar that was set; 0.05 % is what noise allows |
| selectivity from spectra | the same with the print known exactly | 1 dB | the bar that was set |
| advised weight | the smallest of a finer search | 8 % | steps of 6 % |
"""

import json
import re
from dataclasses import asdict, replace
from functools import cache
from itertools import combinations, product
from pathlib import Path
from random import Random

import numpy as np
import pytest

from padgen.core.errors import FileError, PadgenError, SpecError
from padgen.core.files import json_text
from padgen.driver.formats.csv import drive_csv
from padgen.driver.waveform import make_drive
from padgen.measured.fits import MethodFit, TaxelFit, fit_measured
from padgen.measured.read import read_measured_text
from padgen.measured.tune import measured_rows, needed_db, retuned, trims, tuned_drive_csv, tuned_rows, tuning_of
from padgen.measured.tuning import (
    SIMULATED,
    levels_um,
    planned_response_um_per_a2,
    planned_tuning,
    predicted,
    printed_channels,
    read_tuning,
    simulate_print,
    simulated_measurement,
    taxel_energies,
    tones_at,
    tuning_from_json,
    tuning_to_json,
    worst_db,
)
from padgen.physics.resonator import receptance
from padgen.physics.schemes import in_order
from padgen.physics.selectivity import Channels, Scheme, off_energy
from padgen.planner.make import choose, finish
from padgen.planner.printed_pads import Spreads, design_of, drawn_prints, sensitivities
from padgen.spec import parse_spec
from tests.retuned_loop import spreads_for

SCHEMES = in_order()
FOUR = (50.0, 70.0, 105.0, 160.0)


@cache
def plan_of(hz=FOUR, scheme="spur-free", q=30.0, coils=(2, 2), taxels=None, reuse="same", delta_y=5.0, level_um=10.0):
    """Plan a pad of 25 mm cells with channels at `hz`."""
    rows, columns = coils
    sets = 2 if reuse == "alternate" else 1
    taxels = taxels or rows * columns * len(hz) // sets
    spec = parse_spec(f"""
name = "t"
resolution = {taxels}
band_hz = [{min(hz) * 0.7}, {max(hz) * 1.4}]
q_min = {q}
delta_y = {delta_y}
resonances_hz = {list(hz)}
pad = {{ width_mm = {25 * columns}, depth_mm = {25 * rows} }}
drive = {{ scheme = "{scheme}", level_um = {level_um} }}
[coil]
grid = [{rows}, {columns}]
outer_diameter_mm = 24
inner_diameter_mm = 10
core_diameter_mm = 10
reuse = "{reuse}"
""")
    return finish(choose(spec))


def fits_of(tuning, but=(), error=0.0):
    """Return fits that agree with `tuning`, without the taxels `but`."""
    return [
        TaxelFit(
            t.id,
            t.resonance_hz,
            error * t.resonance_hz,
            t.q,
            error * t.q,
            t.response_um_per_a2,
            error * t.response_um_per_a2,
            True,
            True,
            30.0,
            (),
        )
        for t in tuning.taxels
        if t.id not in but
    ]


def moved(tuning, **hz):
    """Return a tuning with other resonances, by other stiffness and the same mass."""
    taxels = [
        replace(t, resonance_hz=hz[t.id], response_um_per_a2=t.response_um_per_a2 * (t.resonance_hz / hz[t.id]) ** 2)
        if t.id in hz
        else t
        for t in tuning.taxels
    ]
    return replace(tuning, taxels=tuple(taxels))


def codes(result):
    return {finding.code for finding in result.findings}


# What is predicted


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("reuse", ["same", "alternate"])
def test_a_print_as_planned_keeps_what_the_plan_says(scheme, reuse):
    plan = plan_of(scheme=scheme, reuse=reuse)
    tuning = planned_tuning(plan)
    figures = predicted(plan, tuning, tones_at(plan, planned_tuning(plan)))
    assert len(figures) == 4
    assert worst_db(figures) == pytest.approx(plan.selectivity.placed_all_states_db, abs=1e-4)
    one_hot = min(coil.one_hot_db for coil in figures)
    assert one_hot == pytest.approx(plan.selectivity.placed_one_hot_db, abs=1e-4)
    assert all(coil.smallest_on == pytest.approx(1) for coil in figures)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_detuned_tones_agree_with_the_yield_of_prints(scheme):
    rng = np.random.default_rng(1)
    of = Scheme(scheme)
    hz = np.array(FOUR)[:, None] * rng.uniform(0.9, 1.1, (4, 50))
    line = rng.uniform(1, 2, (4, 50))
    q = rng.uniform(10, 40, (4, 1))
    tones = Channels(hz * rng.uniform(0.95, 1.05, hz.shape), q, line * rng.uniform(0.8, 1.2, line.shape))
    expected = off_energy(Channels(hz, q, line), of, drivers=tones)
    for k in range(50):
        which, drive = (
            Channels(part.resonance_hz[:, k], q[:, 0], part.line[:, k]) for part in (Channels(hz, q, line), tones)
        )
        assert taxel_energies(which, drive, of).off == pytest.approx(expected[:, k], rel=1e-12)


@pytest.mark.parametrize("scheme", ["tones", "biased"])
def test_on_and_off_are_those_of_the_square_of_the_current(scheme):
    """Every state's current is squared and Fourier-transformed, without any formula of a spur."""
    samples = 4096
    tone_hz = np.array([400.0, 566.0, 813.0])  # whole periods in a second; even ones, so that halves fit too
    truth = Channels(tone_hz * [1.03, 0.98, 1.05], np.array([8.0, 12.0, 20.0]), np.array([1.0, 1.6, 0.7]))
    line = np.array([1.1, 1.5, 0.9])
    time = np.arange(2 * samples) / samples
    bias = np.sqrt(5.0 * line.max() / 2)
    mass = truth.q * truth.line / truth.resonance_hz**2  # so that the own line moves each by one
    energies = []
    for state in product([0, 1], repeat=3):
        if scheme == "tones":
            current = sum(
                s * np.sqrt(2 * a) * np.sin(np.pi * f * time) for s, a, f in zip(state, line, tone_hz, strict=True)
            )
        else:
            current = bias + sum(
                s * a / (2 * bias) * np.sin(2 * np.pi * f * time) for s, a, f in zip(state, line, tone_hz, strict=True)
            )
        lines = np.abs(np.fft.rfft(current**2 + 0 * time))[1:] / samples
        f = np.fft.rfftfreq(2 * samples, 1 / samples)[1:]
        answer = np.abs(receptance(f[:, None], truth.resonance_hz, mass, truth.q)) * 4 * np.pi**2
        energies.append(((answer * lines[:, None]) ** 2).sum(0))
    states = np.array(list(product([0, 1], repeat=3)), bool)
    result = taxel_energies(truth, Channels(tone_hz, truth.q, line), Scheme(scheme))
    energies = np.array(energies)
    assert result.off == pytest.approx([energies[~states[:, i], i].max() for i in range(3)], rel=1e-9)
    if scheme == "tones":
        alone = [energies[np.flatnonzero(states[:, i] & (states.sum(1) == 1))[0], i] for i in range(3)]
        assert result.on == pytest.approx(alone, rel=1e-9)


def test_a_detuned_taxel_loses_level_and_retuning_restores_it():
    plan = plan_of()
    truth = moved(planned_tuning(plan), r0c0k1=74.0)
    result = retuned(plan, fits_of(truth))
    coil = result.coils[0]
    assert coil.before.smallest_on_taxel == "r0c0k1"
    # The planned line, on a stiffer spring, at a frequency beside its resonance.
    planned = plan.channels[1]
    true = truth.taxels[1]
    answer = np.abs(receptance(planned.resonance_hz, 74.0, 1.0, true.q) / receptance(74.0, 74.0, 1.0, true.q))
    share = answer * true.response_um_per_a2 / planned_tuning(plan).taxels[1].response_um_per_a2
    assert coil.before.smallest_on == pytest.approx(share, rel=1e-3)  # other modes
    assert coil.after.smallest_on == pytest.approx(1)
    assert result.coils[3].before == result.coils[3].after
    assert result.before_db < result.after_db - 3
    row = measured_rows(plan, result.tuning)[1]
    assert (row["taxel"], row["planned_hz"], row["resonance_hz"]) == ("r0c0k1", pytest.approx(70, abs=0.1), 74.0)
    level = row["response_um_per_a2"] * row["line_a2"]
    assert level == pytest.approx(row["level_um"])
    assert row["level_um"] == pytest.approx(10 * plan.channels[0].resonance_hz / 74)


def test_modes_of_a_print_move_with_its_resonance():
    plan = plan_of()
    channels = printed_channels(plan, moved(planned_tuning(plan), r0c0k1=84.0))
    as_planned = plan.channels[1]
    printed = channels[1]
    x = 84.0 / as_planned.resonance_hz
    assert printed.modes_hz == pytest.approx([x * f for f in as_planned.modes_hz])
    assert printed.stiffness_n_per_m == pytest.approx(x**2 * as_planned.stiffness_n_per_m)
    assert printed.force_constant_n_per_a2 == pytest.approx(as_planned.force_constant_n_per_a2)
    assert printed.sag_um == pytest.approx(as_planned.sag_um / x**2)


# What is measured, and what is not


def test_unmeasured_taxels_stay_as_planned_and_are_named():
    plan = plan_of()
    truth = simulate_print(plan, 5)
    result = retuned(plan, fits_of(truth, but={"r0c0k2", "r1c1k0"}))
    for taxel, planned, true in zip(result.tuning.taxels, planned_tuning(plan).taxels, truth.taxels, strict=True):
        left = taxel.id in ("r0c0k2", "r1c1k0")
        assert taxel.measured == (not left)
        assert taxel.resonance_hz == (planned if left else true).resonance_hz
        assert taxel.response_um_per_a2 == (planned if left else true).response_um_per_a2
    finding = next(f for f in result.findings if f.code == "retune.unmeasured")
    assert finding.where == "r0c0k2, r1c1k0"
    assert "2 of 16 taxels were not measured and keep their planned tones" in finding.message
    assert finding.message.endswith("measure the rest, or add --estimate-rest")
    assert finding.level == "warning"


def test_nothing_measured_is_the_plan():
    plan = plan_of()
    result = retuned(plan, [])
    assert result.after_db == pytest.approx(plan.selectivity.placed_all_states_db, abs=1e-4)
    assert result.before_db == result.after_db
    assert tuned_drive_csv(plan, result.tuning) == tuned_drive_csv(plan, planned_tuning(plan))


def test_a_level_that_was_not_measured_follows_from_the_mass():
    plan = plan_of()
    fit = replace(fits_of(planned_tuning(plan))[1], resonance_hz=77.0, q=25.0, response_um_per_a2=None)
    taxel = tuning_of(plan, [fit]).taxels[1]
    assert not taxel.level_measured
    assert taxel.response_um_per_a2 == pytest.approx(planned_response_um_per_a2(plan.channels[1], 77.0, 25.0))
    assert taxel.response_error > 0.09 * taxel.response_um_per_a2


def test_errors_of_the_measurement_cost_what_prints_within_them_lose():
    plan = plan_of()
    truth = simulate_print(plan, 1, spreads_for(plan, 0.05))
    exact, fair, poor = (retuned(plan, fits_of(truth, error=error)) for error in (0.0, 1e-3, 1e-2))
    assert exact.after_db == fair.after_db == poor.after_db
    assert exact.after_low_db == pytest.approx(exact.after_db, abs=1e-9)
    assert fair.after_db - 1 < fair.after_low_db < fair.after_db - 0.01
    assert poor.after_low_db < fair.after_low_db - 1


def test_five_of_a_hundred_prints_within_the_errors_keep_less():
    plan = plan_of()
    truth = simulate_print(plan, 1, spreads_for(plan, 0.05))
    result = retuned(plan, fits_of(truth, error=1e-2))
    rng = np.random.default_rng(7)
    below = 0
    for _ in range(100):
        hz, q, response = np.exp(1e-2 * rng.standard_normal((3, len(truth.taxels))))
        taxels = (
            replace(t, resonance_hz=t.resonance_hz * a, q=t.q * b, response_um_per_a2=t.response_um_per_a2 * c)
            for t, a, b, c in zip(truth.taxels, hz, q, response, strict=True)
        )
        tried = predicted(plan, replace(truth, taxels=tuple(taxels)), tones_at(plan, truth))
        below += sum(
            figures.all_states_db < coil.after_low_db for figures, coil in zip(tried, result.coils, strict=True)
        )
    # 400 coils, and 5 % quantiles of 200 draws: 5 % within 4 sigma of both.
    assert 0.01 < below / 400 < 0.11


def test_a_tuning_survives_its_file():
    plan = plan_of()
    tuning = retuned(plan, fits_of(simulate_print(plan, 2), error=1e-3)).tuning
    assert tuning_from_json(tuning_to_json(tuning), plan) == tuning_from_json(
        tuning_to_json(tuning_from_json(tuning_to_json(tuning), plan)), plan
    )


def spoilt(**figures):
    """Return the text of a tuning with figures of its first taxel replaced."""
    table = json.loads(tuning_to_json(planned_tuning(plan_of())))
    table["taxels"][0] |= figures
    return json.dumps(table)


TUNING = json.loads(spoilt())
FIRST, SECOND, *REST = TUNING["taxels"]
BAD_TUNINGS = {
    "empty": ("", "is not a tuning of 't'"),
    "text": ("taxel,resonance_hz", "is not a tuning of 't'"),
    "deep": ("[" * 100_000, "recursion"),
    "deep tables": ('{"taxels":' * 100_000, "recursion"),
    "null": ("null", "tuning must be a table"),
    "list": ("[]", "tuning must be a table"),
    "number": ("5", "tuning must be a table"),
    "no taxels": ('{"name": "t"}', "taxels is missing"),
    "taxels of a kind": ('{"name": "t", "taxels": {}}', "taxels must be a list"),
    "name of a kind": ('{"name": 5, "taxels": []}', "name must be "),
    "taxel of a kind": (
        json.dumps({**TUNING, "taxels": [None, SECOND, *REST]}),
        r"taxels.0. must be a table",
    ),
    "other pad": (json.dumps({**TUNING, "name": "u"}), "has 16 taxels of 'u', must have the 16 of 't'"),
    "surrogate": ('{"name": "\\ud800", "taxels": []}', "has 0 taxels of '.ud800'"),
    "missing": (json.dumps({**TUNING, "taxels": [SECOND, *REST]}), "has 15 taxels of 't', must have the 16"),
    "twice": (json.dumps({**TUNING, "taxels": [FIRST, FIRST, *REST]}), "taxel 2 must be 'r0c0k1', .* it is 'r0c0k0'"),
    "order": (json.dumps({**TUNING, "taxels": [SECOND, FIRST, *REST]}), "taxel 1 must be 'r0c0k0', .* it is 'r0c0k1'"),
    "unknown": (spoilt(id="r9c9k9"), "taxel 1 must be 'r0c0k0', .* it is 'r9c9k9'"),
    "digits": (
        spoilt(resonance_hz=7).replace(": 7,", f": {'7' * 5000},"),
        r"taxels.0..resonance_hz must be a number",
    ),
    "infinity": (spoilt(resonance_hz=float("inf")), r"taxels.0..resonance_hz must be a number"),
    "no number": (spoilt(q=float("nan")), r"taxels.0..q must be a number"),
    "huge": (spoilt(resonance_hz=1e308), "must be 5.\\d+ … 500\\S* Hz .planned: 50.\\d+ Hz., got 1e.308"),
    "tiny": (spoilt(resonance_hz=5e-324), "must be 5.\\d+ … 500\\S* Hz .planned: 50.\\d+ Hz., got 4.9407e-324"),
    "zero": (spoilt(resonance_hz=0), "must be 5.\\d+ … 500\\S* Hz .planned: 50.\\d+ Hz., got 0"),
    "negative": (spoilt(q=-30), "must be 0.5 … 1e.09, got -30"),
    "huge q": (spoilt(q=1e300), "must be 0.5 … 1e.09, got 1e.300"),
    "huge level": (spoilt(response_um_per_a2=1e300), "response_um_per_a2 of r0c0k0 must be .*, got 1e.300"),
    "tiny level": (spoilt(response_um_per_a2=5e-324), "response_um_per_a2 of r0c0k0 must be .*, got 4.9407e-324"),
    "negative level": (spoilt(response_um_per_a2=-1), "response_um_per_a2 of r0c0k0 must be .*, got -1"),
    "negative error": (spoilt(resonance_error_hz=-1), "resonance_error_hz of r0c0k0 must be 0 … .*, got -1"),
    "error without a number": (spoilt(q_error=float("nan")), r"taxels.0..q_error must be a number"),
    "huge error": (spoilt(response_error=1e308), "response_error of r0c0k0 must be 0 … .*, got 1e.308"),
    "true as a number": (spoilt(resonance_hz=True), r"taxels.0..resonance_hz must be a number"),
    "text as a number": (spoilt(q="30"), r"taxels.0..q must be a number"),
    "null as a number": (spoilt(q=None), "a figure is null"),
    "number as true": (spoilt(measured=1), r"taxels.0..measured must be true or false"),
}


@pytest.mark.parametrize("name", BAD_TUNINGS)
def test_bad_tunings(name):
    text, sentence = BAD_TUNINGS[name]
    with pytest.raises(FileError, match=sentence) as refused:
        tuning_from_json(text, plan_of(), "a.json")
    assert str(refused.value).startswith("a.json: ")
    assert len(str(refused.value)) < 300


def test_bad_files_of_tunings(tmp_path):
    path = tmp_path / "a.json"
    path.write_bytes(b"\xef\xbb\xbf" + spoilt().encode())
    assert read_tuning(path, plan_of()) == tuning_from_json(spoilt(), plan_of())
    path.write_bytes(b'{"name": "\xff"}')
    with pytest.raises(FileError, match="byte 10 is not UTF-8"):
        read_tuning(path, plan_of())
    with path.open("wb") as file:
        file.truncate(10**10)
    with pytest.raises(FileError, match="too large for a tuning of 16 taxels: at most"):
        read_tuning(path, plan_of())
    with pytest.raises(FileError, match="it is a device"):
        read_tuning(Path("/dev/zero"), plan_of())


def test_spoilt_tunings_are_refused_or_drive():
    plan = plan_of(coils=(1, 1))
    rng = Random(0)
    good = tuning_to_json(planned_tuning(plan_of(coils=(1, 1))))
    values = 'NaN -Infinity 1e308 5e-324 -1 0 1 true null {} [] "r0c0k0" 1e9 0.5 1e-9 [[[[ "\\ud800" , }'
    refused = 0
    for _ in range(400):
        text = good
        for _ in range(rng.choice((1, 1, 2, 5))):
            numbers = list(re.finditer(r"(?<=: )[^\s,]+|[\[\]{},:]", text))
            at = rng.choice(numbers)
            text = text[: at.start()] + rng.choice(values.split()) + text[at.end() :]
        try:
            tuned = tuning_from_json(text, plan)
            tuned_drive_csv(plan, tuned)
            make_drive(plan, 48000, tuned)
        except PadgenError as error:
            refused += 1
            assert len(str(error)) < 500
    assert 200 < refused < 400


def test_a_print_that_no_tuning_can_tell_is_refused():
    plan = plan_of()
    with pytest.raises(FileError, match=r"what was measured: resonance_hz of r0c0k1 must be 6\.999 … 699\.8 Hz"):
        retuned(plan, fits_of(moved(planned_tuning(plan), r0c0k1=701.0)))


@pytest.mark.parametrize("coils", [(1, 1), (2, 2)])
def test_a_coil_of_one_channel_has_levels_and_no_selectivity(coils):
    plan = plan_of(hz=(60.0,), scheme="tones", coils=coils)
    result = retuned(plan, fits_of(moved(planned_tuning(plan), r0c0k0=66.0)))
    assert (result.before_db, result.after_db, result.after_low_db) == (None, None, None)
    assert result.coils[0].before.smallest_on < 0.5
    assert result.coils[0].after.smallest_on == pytest.approx(1)


def test_empty_places_are_no_taxels():
    plan = plan_of(hz=(60.0, 90.0), taxels=7)
    assert len(plan.taxels) == 7
    result = retuned(plan, fits_of(simulate_print(plan, 3)))
    assert len(result.tuning.taxels) == len(measured_rows(plan, result.tuning)) == 7
    assert len(result.coils) == 4
    assert [coil.after.all_states_db is None for coil in result.coils] == [False, False, False, True]


@pytest.mark.sample(4)
@pytest.mark.parametrize("q", [1.0, 1e4])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_any_q_gives_finite_figures(q, scheme):
    plan = plan_of(hz=(60.0, 90.0, 150.0), scheme=scheme, q=q, coils=(1, 1), delta_y=q / 20 if q > 100 else q)
    result = retuned(plan, fits_of(simulate_print(plan, 4, spreads_for(plan, 0.05)), error=1e-5))
    assert all(np.isfinite(db) for db in (result.before_db, result.after_db, result.after_low_db))
    json.loads(json_text(asdict(result)))


def test_the_rest_follows_from_what_a_print_has_in_common():
    plan = plan_of(coils=(3, 3))
    spreads = Spreads(0.05, 0.03, 0.0, 0.005, 0.0, 0.0, 0.0, 0.0)
    left = {t.id for t in plan.taxels if t.coil not in ((0, 0), (2, 2))}
    errors = {True: [], False: []}
    for seed in range(6):
        truth = simulate_print(plan, seed, spreads)
        for estimate in (True, False):
            tuning = retuned(plan, fits_of(truth, but=left), estimate_rest=estimate).tuning
            errors[estimate] += [
                t.resonance_hz / true.resonance_hz - 1
                for t, true in zip(tuning.taxels, truth.taxels, strict=True)
                if t.id in left
            ]
    assert np.std(errors[True]) < 0.25 * np.std(errors[False])


def test_the_stated_error_of_the_rest_is_its_error():
    """With the spreads that the estimate assumes, errors over stated sigmas are standard normal numbers."""
    plan = plan_of(coils=(3, 3))
    left = {t.id for t in plan.taxels if t.channel in (1, 3) or t.coil == (1, 1)}
    pulls = []
    for seed in range(15):
        truth = simulate_print(plan, seed)
        tuning = retuned(plan, fits_of(truth, but=left, error=1e-3), estimate_rest=True).tuning
        pulls += [
            (t.resonance_hz - true.resonance_hz) / t.resonance_error_hz
            for t, true in zip(tuning.taxels, truth.taxels, strict=True)
            if t.id in left
        ]
        untouched = [t for t in tuning.taxels if t.id not in left]
        assert untouched == [t for t in tuning_of(plan, fits_of(truth, error=1e-3)).taxels if t.id not in left]
    # Taxels of a print share what its measured ones do not tell; the model's error, assumed, is not in these prints.
    assert 0.6 < np.std(pulls) < 1.2


def test_a_coupon_tells_of_the_pad():
    plan = plan_of(coils=(3, 3))
    truth = moved(planned_tuning(plan), **{t.id: plan.channels[t.channel].resonance_hz * 1.1 for t in plan.taxels})
    coupon = {
        t.channel: fit for t, fit in zip(plan.taxels, fits_of(truth, error=1e-3), strict=True) if t.coil == (0, 0)
    }
    result = retuned(plan, [], coupon=coupon)
    ratio = [
        t.resonance_hz / plan.channels[p.channel].resonance_hz
        for t, p in zip(result.tuning.taxels, plan.taxels, strict=True)
    ]
    # A thinner beam moves more with the layers' height: what four taxels have in common is not 10 % for each.
    assert np.mean(ratio) == pytest.approx(1.09, abs=0.02)
    assert all(1.05 < r < 1.14 for r in ratio)
    finding = next(f for f in result.findings if f.code == "retune.unmeasured")
    assert "get tones that the measured ones make likely" in finding.message


# The tables


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_table_of_a_print_as_planned_is_the_planned_one(scheme):
    plan = plan_of(scheme=scheme)
    head, *planned = drive_csv(plan).splitlines()
    own_head, *own = tuned_drive_csv(plan, planned_tuning(plan)).splitlines()
    assert own_head == "taxel," + head
    count = len(plan.taxels)
    for taxel, line in zip(plan.taxels, own[:count], strict=True):
        assert line == f"{taxel.id},{planned[taxel.channel]}"
    bias = planned[4:]
    assert own[count:] == [f"r{r}c{c},{line}" for r in (0, 1) for c in (0, 1) for line in bias]


def test_a_tone_of_the_table_moves_its_taxel_by_its_level():
    plan = plan_of(scheme="tones")
    tuning = simulate_print(plan, 6)
    level = levels_um(plan, np.array([t.resonance_hz for t in tuning.taxels]))
    for taxel, (_, row), um in zip(tuning.taxels, tuned_rows(plan, tuning), level, strict=True):
        assert row.drive_hz == taxel.resonance_hz / 2
        assert (row.current_ma_peak * 1e-3) ** 2 / 2 * taxel.response_um_per_a2 == pytest.approx(um)


# Findings


def test_two_taxels_too_close_are_told_with_a_trim_that_parts_them():
    plan = plan_of(hz=(50.0, 70.0, 105.0), scheme="spur-free")
    truth = moved(planned_tuning(plan), r0c1k0=66.0)
    result = retuned(plan, fits_of(truth))
    finding = next(f for f in result.findings if f.code == "retune.close")
    assert finding.where == "coil r0c1"
    assert "r0c1k0 at 66 Hz is moved most by the tone of r0c1k1 at 69.99 Hz" in finding.message
    assert "5.7% apart with a bandwidth of 3.3%" in finding.message
    assert "lower r0c1k0 to" in finding.message
    (trim,) = result.trims
    assert (trim.row, trim.column, trim.is_sufficient) == (0, 1, True)
    (step,) = trim.steps
    # What the advice says is what the print then does.
    weighed = replace(
        truth, taxels=tuple(replace(t, resonance_hz=step.to_hz) if t.id == step.id else t for t in truth.taxels)
    )
    again = retuned(plan, fits_of(weighed))
    assert again.coils[1].after.all_states_db == pytest.approx(trim.after_db, abs=1e-9)
    assert trim.before_db < needed_db(plan) <= trim.after_db
    assert not again.trims


def test_the_trim_is_the_lightest_of_one_taxel():
    plan = plan_of(hz=(50.0, 70.0, 105.0))
    truth = moved(planned_tuning(plan), r0c1k0=66.0)
    (trim,) = retuned(plan, fits_of(truth)).trims
    (step,) = trim.steps
    mass_mg = plan.channels[0].effective_mass_g * 1e3
    assert step.add_mg == pytest.approx(mass_mg * ((step.from_hz / step.to_hz) ** 2 - 1))
    lightest = np.inf
    for name in ("r0c1k0", "r0c1k1", "r0c1k2"):
        taxel = next(t for t in truth.taxels if t.id == name)
        for share in np.geomspace(1e-2, 0.25, 100):
            hz = taxel.resonance_hz * (1 - share)
            tuning = replace(
                truth, taxels=tuple(replace(t, resonance_hz=hz) if t.id == name else t for t in truth.taxels)
            )
            if predicted(plan, tuning, tones_at(plan, tuning))[1].all_states_db >= needed_db(plan):
                mass = plan.channels[int(name[-1])].effective_mass_g * 1e3
                lightest = min(lightest, mass * ((1 - share) ** -2 - 1))
                break
    assert step.add_mg == pytest.approx(lightest, rel=0.08)


def test_two_taxels_are_lowered_where_one_is_not_enough():
    plan = plan_of(hz=(50.0, 75.0, 110.0, 160.0), q=40.0)
    truth = moved(planned_tuning(plan), r0c0k0=72.0, r0c0k2=155.0)
    (trim,) = retuned(plan, fits_of(truth)).trims
    assert len(trim.steps) == 2
    assert trim.is_sufficient
    # The lightest of all pairs on a finer grid, other modes left out.
    taxels = truth.taxels[:4]
    mass = np.array([c.effective_mass_g for c in plan.channels])[:, None] * 1e3
    hz, q, response = (
        np.array([getattr(t, name) for t in taxels])[:, None] for name in ("resonance_hz", "q", "response_um_per_a2")
    )
    one, other = (v.ravel() for v in np.meshgrid(*[np.geomspace(3e-3, 0.25, 60)] * 2))
    lightest = np.inf
    for a, b in combinations(range(4), 2):
        share = np.zeros((4, len(one)))
        share[a] = one
        share[b] = other
        lower = hz * (1 - share)
        which = Channels(lower, q, levels_um(plan, lower.ravel()).reshape(lower.shape) / response)
        kept = -10 * np.log10(off_energy(which, Scheme("spur-free")).max(0))
        weight = (mass * ((1 - share) ** -2 - 1)).sum(0)
        lightest = min(lightest, weight[kept >= needed_db(plan)].min(initial=np.inf))
    assert sum(step.add_mg for step in trim.steps) < 1.15 * lightest


def test_filing_follows_the_beam_model():
    plan = plan_of(hz=(50.0, 70.0, 105.0))
    (trim,) = retuned(plan, fits_of(moved(planned_tuning(plan), r0c1k0=66.0))).trims
    (step,) = trim.steps
    channel = plan.channels[0]
    width, thickness, *_ = sensitivities(plan)[0]
    ratio = step.to_hz / step.from_hz
    thin = (1 - step.file_thickness_mm / channel.beam.thickness_mm) ** thickness
    narrow = (1 - step.file_width_mm / channel.beam.width_mm) ** width
    assert (thin, narrow) == (pytest.approx(ratio), pytest.approx(ratio))


def test_good_coils_get_no_advice():
    plan = plan_of()
    tuning = planned_tuning(plan)
    assert trims(plan, tuning, predicted(plan, tuning, tones_at(plan, planned_tuning(plan)))) == ()
    assert not retuned(plan, fits_of(tuning)).findings


def test_another_drive_is_named_where_it_would_keep_enough():
    plan = plan_of(hz=(60.0, 90.0, 190.0), scheme="tones", delta_y=3.0)
    # The spur at half the difference of the upper two falls on the lowest.
    result = retuned(plan, fits_of(moved(planned_tuning(plan), r0c1k0=50.5)))
    figures = dict(result.schemes_db)
    assert figures["spur-free"] > needed_db(plan) > figures["tones"]
    finding = next(f for f in result.findings if f.code == "retune.close")
    assert "drive = 'spur-free' would keep enough" in finding.message


FINDINGS = {
    "retune.order": lambda t: moved(t, r0c0k0=72.0),
    "retune.far": lambda t: moved(t, r0c0k0=5.01),
    "retune.q": lambda t: replace(t, taxels=(replace(t.taxels[0], q=20.0), *t.taxels[1:])),
    "retune.pull": lambda t: replace(t, taxels=(replace(t.taxels[0], response_um_per_a2=0.0), *t.taxels[1:])),
    "retune.level": lambda t: replace(t, taxels=(replace(t.taxels[0], response_um_per_a2=1.0), *t.taxels[1:])),
}


@pytest.mark.parametrize("code", FINDINGS)
def test_what_is_odd_is_told(code):
    plan = plan_of()
    result = retuned(plan, fits_of(FINDINGS[code](planned_tuning(plan))))
    finding = next(f for f in result.findings if f.code == code)
    assert "r0c0" in finding.where
    assert finding.level == {"retune.order": "note", "retune.pull": "error"}.get(code, "warning")


def test_a_coarse_measurement_is_told():
    plan = plan_of()
    fits = fits_of(planned_tuning(plan), error=1e-2)
    assert "retune.uncertain" in codes(retuned(plan, fits))
    assert "retune.uncertain" not in codes(retuned(plan, fits_of(planned_tuning(plan), error=1e-3)))


def test_methods_that_differ_are_told():
    plan = plan_of()
    first, *rest = fits_of(planned_tuning(plan))
    methods = (MethodFit("circle", 50.1, 0.01, 30, 1), MethodFit("least squares", 52.0, 0.01, 30, 1))
    finding = next(
        f
        for f in retuned(plan, [replace(first, agree=False, methods=methods), *rest]).findings
        if f.code == "retune.fit"
    )
    assert finding.where == "r0c0k0"
    assert "circle 50.1 Hz, least squares 52 Hz" in finding.message


def test_the_level_that_would_do_does():
    plan = plan_of(level_um=10.0)
    weak = replace(
        planned_tuning(plan),
        taxels=tuple(replace(t, response_um_per_a2=t.response_um_per_a2 / 500) for t in planned_tuning(plan).taxels),
    )
    result = retuned(plan, fits_of(weak))
    level = min(coil.load.reachable_level_um for coil in result.coils)
    assert f"drive.level_um = {level:.3g}"[:-1] in next(f for f in result.findings if f.code == "retune.level").message
    lower = plan_of(level_um=float(f"{level * 0.99:.4g}"))
    assert "retune.level" not in codes(retuned(lower, fits_of(weak)))


# A print in the computer


def test_prints_are_seeded_and_scatter_as_asked():
    plan = plan_of()
    spreads = spreads_for(plan, 0.08)
    first, again, other = (simulate_print(plan, seed, spreads) for seed in (0, 0, 1))
    assert first == again
    assert first != other
    hz = np.array([c.resonance_hz for c in plan.channels])
    channel = [taxel.channel for taxel in plan.taxels]
    log = np.array(
        [np.log([t.resonance_hz for t in simulate_print(plan, s, spreads).taxels] / hz[channel]) for s in range(60)]
    )
    many = drawn_prints(design_of(plan, None), spreads, 9, 0, 4000).log_x[2]
    assert np.sqrt((many**2).mean()) == pytest.approx(0.08, rel=0.05)
    # Most of it is common to a print: as many independent numbers as prints.
    assert np.sqrt((log**2).mean()) == pytest.approx(0.08, rel=4 / np.sqrt(2 * 60))


def test_q_and_pull_of_prints_scatter():
    plan = plan_of()
    prints = [simulate_print(plan, seed) for seed in range(40)]
    q = np.log([[t.q / 30 for t in tuning.taxels] for tuning in prints])
    pull = np.log(
        [
            [
                t.response_um_per_a2 / planned_response_um_per_a2(plan.channels[p.channel], t.resonance_hz, t.q)
                for t, p in zip(tuning.taxels, plan.taxels, strict=True)
            ]
            for tuning in prints
        ]
    )
    for part in (q, pull):
        assert part.std() == pytest.approx(0.10, rel=4 / np.sqrt(2 * part.size))
    assert abs(np.corrcoef(q.ravel(), pull.ravel())[0, 1]) < 4 / np.sqrt(q.size)


@pytest.mark.parametrize("kind", SIMULATED)
def test_measurements_are_tables_of_all_taxels(kind):
    plan = plan_of(coils=(1, 1))
    truth = simulate_print(plan, 7)
    text = simulated_measurement(plan, truth, 7, kind)
    assert text == simulated_measurement(plan, truth, 7, kind)
    assert text != simulated_measurement(plan, truth, 8, kind)
    head = next(line for line in text.splitlines() if not line.startswith("#"))
    assert all(any(name.startswith(t.id) for name in head.split(",")) for t in plan.taxels)


def measured_again(plan, truth, seed, kind="spectrum"):
    return fit_measured(read_measured_text(simulated_measurement(plan, truth, seed, kind), plan), plan)


def test_prints_measured_by_spectra_are_retuned_as_well_as_if_they_were_known():
    plan = plan_of(coils=(1, 1))
    spreads = spreads_for(plan, 0.08)
    errors = []
    lost = []
    for seed in range(5):
        truth = simulate_print(plan, seed, spreads)
        fits = measured_again(plan, truth, seed)
        errors += [abs(fit.resonance_hz / t.resonance_hz - 1) for fit, t in zip(fits, truth.taxels, strict=True)]
        tuning = retuned(plan, fits).tuning
        reached, best = (worst_db(predicted(plan, truth, tones_at(plan, which))) for which in (tuning, truth))
        lost.append(best - reached)
    assert np.median(errors) < 1e-3
    assert max(errors) < 3e-3
    assert max(lost) < 1.0
    assert np.median(lost) < 0.3


@pytest.mark.parametrize("kind", ["chirp", "pluck"])
def test_time_series_are_fitted_too(kind):
    plan = plan_of(coils=(1, 1))
    truth = simulate_print(plan, 11, spreads_for(plan, 0.08))
    fits = measured_again(plan, truth, 11, kind)
    assert [fit.id for fit in fits] == [t.id for t in truth.taxels]
    for fit, true in zip(fits, truth.taxels, strict=True):
        assert fit.resonance_hz == pytest.approx(true.resonance_hz, rel=3e-3)
        assert fit.q == pytest.approx(true.q, rel=0.1)
        if kind == "chirp":
            assert fit.response_um_per_a2 == pytest.approx(true.response_um_per_a2, rel=0.1)
        else:
            assert fit.response_um_per_a2 is None


@pytest.mark.parametrize(
    ("q", "kind", "sentence"),
    [
        (30.0, "hum", "--kind: must be one of spectrum, chirp, pluck, got 'hum'"),
        (
            1e5,
            "chirp",
            "--kind: chirp would take a file of .* numbers, at most 20000000 are written; spectrum would do",
        ),
    ],
)
def test_measurements_that_cannot_be_made_are_refused(q, kind, sentence):
    plan = plan_of(hz=(60.0, 90.0, 150.0), coils=(1, 1))
    sharp = replace(plan, channels=tuple(replace(channel, q=q) for channel in plan.channels))
    with pytest.raises(SpecError, match=sentence):
        simulated_measurement(sharp, planned_tuning(sharp), 0, kind)
