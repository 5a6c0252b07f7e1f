"""Where coils are connected, by what is felt of them: wirings are made and read by a model of plugs of this file."""

import re
from random import Random

import numpy as np
import pytest
from scipy.io import wavfile

import padgen as pg
from padgen.core.errors import FileError
from padgen.driver.waveform import RATES_HZ, drive_at
from padgen.driver.wiring import _whole_orders, crossed, crossed_frames, crossed_names, wiring_findings
from padgen.planner import Plan
from padgen.spec import parse_spec
from tests.recordings import recorded

NINE = (
    'name = "nine"\nresolution = 18\nband_hz = [50, 250]\nq_min = 15\n'
    '[pad]\nwidth_mm = 45\ndepth_mm = 45\n[coil]\ngrid = [3, 3]\nreuse = "alternate"\n'
)


def felt(plan: Plan, path, place, is_crossed=True) -> list:
    """Return the findings where the output of each coil is connected to the coil `place` (None: to none).

    A coil's taxels move under the tones of their own channels alone, whichever output they come from.
    """
    at_coil = {(taxel.coil, taxel.channel): taxel.id for taxel in plan.taxels}
    rows = ["played,felt"]
    played = [(taxel.id, taxel.coil, taxel.channel) for taxel in plan.taxels]
    if plan.coils.sets > 1 and is_crossed:
        frames = crossed_frames(plan)
        coils = [tuple(map(int, re.findall(r"\d+", name)[:2])) for name in crossed_names(plan)]
        channels = [plan.taxels[int(frame.argmax())].channel for frame in frames]
        played += zip(crossed_names(plan), coils, channels, strict=True)
    for name, coil, channel in played:
        at = place(*coil)
        rows.append(f"{name},{at_coil.get((at, channel), '')}")
    path.write_text("\n".join(rows))
    return wiring_findings(plan, path)


@pytest.mark.parametrize(
    ("place", "told"),
    [
        (lambda r, c: (r, c), []),
        (lambda r, c: (3 - r, 3 - c), ["coils: are all connected in the opposite order"]),
        (lambda r, c: (r, 3 - c), ["coils: are all connected with left and right exchanged"]),
        (lambda r, c: (3 - r, c), ["coils: are all connected with the first row of coils at the top"]),
        (lambda r, c: (c, r), ["coils: are all connected column by column"]),
        (
            lambda r, c: {(0, 1): (2, 3), (2, 3): (0, 1), (3, 3): None}.get((r, c), (r, c)),
            ["coil r3c3: nothing was felt", "coil r0c1 and coil r2c3: are swapped"],
        ),
        (
            lambda r, c: {(0, 0): (0, 1), (0, 1): (0, 2), (0, 2): (0, 0)}.get((r, c), (r, c)),
            [f"coil r0c{k}: its amplifier channel is connected to coil r0c{(k + 1) % 3}" for k in range(3)],
        ),
        (lambda r, c: (c, 3 - r), ["coils: are all connected a quarter turn on, counter-clockwise"]),
        (lambda r, c: divmod((4 * r + c + 1) % 16, 4), ["coils: are all connected one place further on"]),
        # Two exchanged pairs are not a mirrored pad.
        (
            lambda r, c: (r, 3 - c) if r < 2 and c in (0, 3) else (r, c),
            ["coil r0c0 and coil r0c3: are swapped", "coil r1c0 and coil r1c3: are swapped"],
        ),
        # Whole orders are told although one coil is silent.
        (
            lambda r, c: None if (r, c) == (1, 1) else (r, 3 - c),
            ["coil r1c1: nothing was felt", "coils: are all connected with left and right exchanged"],
        ),
    ],
)
def test_swapped_coils_are_found_by_what_was_felt(paper_plan, tmp_path, place, told):
    found = [f"{f.where}: {f.message}" for f in felt(paper_plan, tmp_path / "felt.csv", place) if f.level == "error"]
    assert len(found) == len(told) and all(map(str.startswith, found, told)), found


def wired(random: Random, rows: int, columns: int) -> dict:
    """Return a wrong wiring: for each output that is not at its own coil, the one where it is, or None."""
    coils = [(r, c) for r in range(rows) for c in range(columns)]
    kind = random.choice(["exchanged", "mirrored", "turned", "cyclic", "silent", "random"])
    if kind == "mirrored":
        wired = random.choice([lambda r, c: (r, columns - 1 - c), lambda r, c: (rows - 1 - r, c)])
        return {coil: wired(*coil) for coil in coils}
    if kind == "turned":
        return {(r, c): (rows - 1 - r, columns - 1 - c) for r, c in coils}
    few = random.sample(coils, {"exchanged": 2, "cyclic": random.choice([3, 4, 5])}.get(kind, random.randint(1, 4)))
    if kind == "silent":
        return dict.fromkeys(few)
    places = random.sample(few, len(few)) if kind == "random" else few[1:] + few[:1]
    return dict(zip(few, places, strict=True))


@pytest.mark.parametrize("name", ["paper-32", "pad-32", "triple-48"])
def test_two_hundred_wrong_wirings_are_named_and_none_wrongly(tmp_path, name):
    plan = pg.plan(name)
    rows = plan.coils.rows
    columns = plan.coils.columns
    random = Random(1)
    for _ in range(200):
        at = {coil: place for coil, place in wired(random, rows, columns).items() if coil != place}
        found = [
            finding
            for finding in felt(plan, tmp_path / "felt.csv", lambda r, c, at=at: at.get((r, c), (r, c)))
            if finding.level == "error"
        ]
        named = {}
        for finding in found:
            coils = [
                tuple(map(int, pair)) for pair in re.findall(r"r(\d+)c(\d+)", f"{finding.where} {finding.message}")
            ]
            if finding.code == "wiring.order":
                words = [w for w, order in _whole_orders(rows, columns).items() if w in finding.message]
                order = _whole_orders(rows, columns)[words[0]]
                named |= {coil: order(*coil) for coil in at}
            elif finding.code == "wiring.silent":
                named[coils[0]] = None
            else:
                assert finding.code == "wiring.swapped"
                named[coils[0]] = coils[1]
                if "exchange their plugs" in finding.message:
                    named[coils[1]] = coils[0]
        assert named == at, [f.message for f in found]


def test_two_silent_coils_of_both_sets_are_called_exchanged(tmp_path):
    plan = pg.plan("pad-32")

    def told(place):
        return [f for f in felt(plan, tmp_path / "felt.csv", place, is_crossed=False) if f.level == "error"]

    one, two = told(lambda r, c: {(0, 0): (2, 1), (2, 1): (0, 0)}.get((r, c), (r, c)))[:2]
    assert (one.where, one.code) == ("coil r0c0 and coil r2c1", "wiring.swapped")
    assert two.code == "wiring.silent"
    # Two of one set would have been felt at each other's.
    alike = told(lambda r, c: None if (r, c) in ((0, 0), (1, 1)) else (r, c))
    assert [(f.where, f.code) for f in alike] == [("coil r0c0, coil r1c1", "wiring.hidden")]
    (all_of_them,) = told(lambda r, c: (r, 3 - c))
    assert all_of_them.where == "all coils"
    assert "play --pattern crossed" in all_of_them.message


def test_a_crossed_wave_plays_each_output_the_tones_of_its_neighbour(tmp_path):
    """Read back as a file: the output's strongest line is a tone that no taxel of its own coil has."""
    plan = pg.plan("pad-32")
    drive = pg.drive(plan, pattern="crossed", seconds=1.0)
    drive.save(tmp_path / "drive.wav")
    rate, samples = wavfile.read(tmp_path / "drive.wav")
    own_hz = {t.coil: {} for t in plan.taxels}
    for taxel in plan.taxels:
        own_hz[taxel.coil][taxel.channel] = plan.channels[taxel.channel].resonance_hz
    for k, name in enumerate(drive.played[:8]):
        row, column, index = map(int, re.findall(r"\d+", name))
        frame = samples[k * rate : (k + 1) * rate].astype(float)
        power = (frame**2).sum(0)
        output = row * plan.coils.columns + column
        assert power.argmax() == output
        # A spur-free current's largest line beside its constant is at the force's frequency.
        spectrum = np.abs(np.fft.rfft((frame[:, output] - frame[:, output].mean()) * np.hanning(rate)))
        heard_hz = 20 + spectrum[20:400].argmax()
        beside = next(hz for coil, hz in own_hz.items() if coil == (row, column + 1 - 2 * (column % 2)))
        assert heard_hz == pytest.approx(list(beside.values())[index], abs=1.5)


def test_an_output_without_a_neighbour_plays_nothing(tmp_path):
    """Of 3 x 3 coils the last has none; its plug is told by the coil that no other output reaches."""
    plan = pg.plan(parse_spec(NINE))
    assert not [name for name in crossed_names(plan) if name.startswith("r2c2")]
    drive = crossed(plan, drive_at(plan, RATES_HZ, 8000, None, None))
    assert [len(coil.taxels) for coil in drive.coils] == [2] * 8 + [0]
    found = felt(plan, tmp_path / "felt.csv", lambda r, c: {(2, 2): (0, 1), (0, 1): (2, 2)}.get((r, c), (r, c)))
    told = {f.where: f.message for f in found if f.level == "error"}
    assert "if it is connected, its plug is at coil r0c1" in told["coil r2c2"]
    assert told["coil r0c1"].endswith("is connected to coil r2c2")


def test_swapped_coils_are_found_by_recordings(paper_plan, tmp_path):
    rng = np.random.default_rng(1)
    channel = {t.id: paper_plan.channels[t.channel] for t in paper_plan.taxels}
    # The sensor hears little at r0c1k0, whose coil is not the one that plays, and nothing at r1c0k0.
    for name, share in (("r0c0k0", 1.0), ("r0c1k0", 0.1), ("r0c2k0", 0.8), ("r1c0k0", 0.0), ("r1c1k0", 1.2)):
        made = recorded(rng, (channel[name].resonance_hz,), (15.0,), seconds=3.0, rate=2000)
        motion = share * made.motion + 1e-3 * rng.standard_normal(len(made.motion))
        columns = np.stack([made.reference / 2 / np.abs(made.reference).max(), motion / 2 / np.abs(made.motion).max()])
        wavfile.write(tmp_path / f"{name}.wav", made.rate, columns.T.astype(np.float32))
    found = [f for f in wiring_findings(paper_plan, tmp_path) if f.level == "error"]
    assert [(f.code, f.where) for f in found] == [
        ("wiring.swapped", "coil r0c1 and coil r1c0"),
        ("wiring.silent", "coil r0c1"),
        ("wiring.silent", "coil r1c0"),
    ]


def test_what_was_felt_at_other_taxels_or_is_no_table(paper_plan, tmp_path):
    path = tmp_path / "felt.csv"
    path.write_text("r0c0k0,r0c0k1\nr0c1k0,r0c1k0\nr0c1k1,\nr0c2k0,r0c3k0\nr0c2k1,r1c2k1\n")
    found = {f.code: f for f in wiring_findings(paper_plan, path)}
    assert set(found) == {"wiring.taxel", "wiring.silent", "wiring.mixed", "wiring.untried"}
    assert found["wiring.silent"].message.startswith("1 of its 2 taxels were not felt")
    assert "were felt at coil " in found["wiring.mixed"].message
    assert "play them again (--pattern each)" in found["wiring.mixed"].message
    assert "13 of them" in found["wiring.untried"].message
    for text, sentence in (
        ("r0c0k0,r0c0k9", "row 1: there is no taxel 'r0c0k9'"),
        ("played,felt\nr0c0k0", "row 2: must have the taxel that was played"),
        ("", "has no rows"),
        ("played,felt", "has no rows"),
    ):
        path.write_text(text)
        with pytest.raises(FileError, match=sentence):
            wiring_findings(paper_plan, path)
