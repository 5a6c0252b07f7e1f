"""Extensions registered from outside: a suspension with bent beams, defined here, passes through all of padgen."""

import csv
import json
import os
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from hashlib import sha256
from math import pi
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import padgen as pg
from padgen import cli
from padgen.batch.definition import parse_sweep
from padgen.core.errors import FileError, GeometryError, SpecError
from padgen.core.registry import PAD_FORMATS, PLUGINS, USUAL_FORMATS, names_in
from padgen.core.rules import Rule
from padgen.driver import formats as drive_formats
from padgen.driver import players
from padgen.driver.drive_folder import Drive, parse_formats
from padgen.driver.loads import SIGNAL_RULES, refuse_frames
from padgen.make.pad import parse_formats as parse_pad_formats
from padgen.make.solid_tuning import solid_taxel
from padgen.measured.fits import RECORDING_RULES, fit_measured
from padgen.measured.read import read_measured_text
from padgen.physics import schemes
from padgen.physics.magnetics import SteelRing, solenoid
from padgen.physics.pull import pull
from padgen.physics.schemes import tones
from padgen.planner import coils, make_plan, plan_from_json, plan_to_json
from padgen.planner.judge import PLAN_RULES
from padgen.planner.movers.washer import magnetic_parts
from padgen.planner.sizing import reach
from padgen.planner.suspensions import (
    Arrangement,
    BeamPath,
    BeamShape,
    Block,
    Room,
    Segment,
    allowed,
    arc,
    names,
    register,
    suspension,
    unregister,
)
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.solid import formats as pad_formats
from padgen.solid.checks import MESH_RULES, check_pad
from padgen.solid.formats.step import write_taxel_step
from padgen.solid.measure import measured
from padgen.solid.mesh import as_manifold
from padgen.solid.pad_solid import build_pad
from padgen.solid.taxel import taxel_key, taxel_solid
from padgen.spec import parse_spec
from padgen.spec.load import SPEC_RULES, spec_schema
from padgen.verify.elasticity import solve_modes
from padgen.verify.frame import frame_modes
from padgen.verify.taxel_frame import taxel_frame
from tests.conftest import SMALL
from tests.solid.test_solid import volume_by_hand

NAME = "toy-spiral"
SPEC = f"""
name = "toy"
resolution = 2
band_hz = [40, 400]
q_min = 15
resonances_hz = [150, 300]
material = "pla"
pad = {{ width_mm = 32, depth_mm = 32 }}
coil = {{ grid = [1, 1] }}
suspension = {{ topology = "{NAME}" }}
"""
SERPENTINES = tuple(f"serpentine-{legs}" for legs in (3, 5, 7))
ALONG = pi / 4 + 0.5
"""Length of path that the bends take, over its distance from the plate's middle."""


def arrange(plate, beam, gap_mm):
    """Arrange two arms, each along the plate and round its end into its middle, the second turned by 180°."""
    aside = plate.width_mm / 2 + gap_mm + beam.width_mm / 2
    into = 2 * gap_mm
    along = beam.length_mm - ALONG * aside - into
    bend = arc(aside / 4, 90)
    segments = (Segment(along), bend, Segment(aside / 2), bend, Segment(into))
    middle = along - into - plate.length_mm / 2
    half_x = plate.length_mm / 2
    half_y = plate.width_mm / 2
    return Arrangement(
        beams=(
            BeamPath((0.0 * along, -aside), (1.0, 0.0), segments, beam.width_mm, beam.thickness_mm),
            BeamPath((2 * middle, aside), (-1.0, 0.0), segments, beam.width_mm, beam.thickness_mm),
        ),
        blocks=(Block(middle - half_x, middle + half_x, -half_y, half_y, plate.thickness_mm),),
        window_mm=(2 * middle, 2 * (aside + beam.width_mm / 2 + gap_mm)),
        washer_x_mm=middle,
        root_clearance_mm=0.0 * along + gap_mm / 2,
    )


def longest(room, plate, gap_mm):
    side = min(room.length_mm, 2 * room.before_washer_mm, 2 * room.behind_washer_mm)
    return (side + plate.length_mm) / 2 + 4 * gap_mm + ALONG * (plate.width_mm / 2 + gap_mm)


def widest(room, plate, gap_mm):
    return min((plate.width_mm + 2 * gap_mm) / 3, (room.width_mm - plate.width_mm) / 2 - 2 * gap_mm)


def shortest(plate, gap_mm):
    width = (plate.width_mm + 2 * gap_mm) / 3
    aside = plate.width_mm / 2 + gap_mm + width / 2
    return aside / 4 + width / 2 + 7 * gap_mm + plate.length_mm + ALONG * aside


def thinned(plate, beam, gap_mm):
    """Arrange the same paths with each beam 0.03 mm narrower."""
    made = arrange(plate, beam, gap_mm)
    return made._replace(beams=tuple(path._replace(width_mm=path.width_mm - 0.03) for path in made.beams))


def shifted(plate, beam, gap_mm):
    """Arrange beams of the same width and ends, with the part between the bends moved out by 0.05 mm."""
    made = arrange(plate, beam, gap_mm)
    beams = []
    for path in made.beams:
        first, bend, middle, _, last = path.segments
        segments = (Segment(first.length_mm + 0.05), bend, middle, bend, Segment(last.length_mm + 0.05))
        beams.append(path._replace(segments=segments))
    return made._replace(beams=tuple(beams))


def toy_like(arranged):
    return SimpleNamespace(END_FACTOR=1.0, BEAMS=2, arrange=arranged, longest=longest, widest=widest, shortest=shortest)


@contextmanager
def registered(name, thing):
    register(name, thing)
    try:
        yield
    finally:
        unregister(name)


@pytest.fixture(scope="module")
def plan():
    with registered(NAME, toy_like(arrange)):
        yield make_plan(parse_spec(SPEC))


def model(plan, channel):
    size = BeamShape(channel.beam.width_mm, channel.beam.thickness_mm, channel.beam.length_mm)
    return TaxelModel(plan.spec, channel.beam.topology, plate_shape(plan.spec), size)


def hung_by(plan, topology):
    """Return the plan with the beams of another suspension of the same dimensions."""
    return replace(plan, channels=tuple(replace(c, beam=replace(c.beam, topology=topology)) for c in plan.channels))


def test_a_registered_suspension_plans(plan):
    assert [c.beam.topology for c in plan.channels] == [NAME, NAME]
    assert [c.resonance_hz for c in plan.channels] == pytest.approx([150, 300], rel=2e-3)
    for channel in plan.channels:
        for path in plan.arrangement(channel).beams:
            assert path.length_mm == pytest.approx(channel.beam.length_mm, rel=1e-12)
    text = plan_to_json(plan)
    assert plan_to_json(plan_from_json(text)) == text


def test_auto_tries_what_is_registered(plan):
    assert allowed("auto")[-1] == NAME
    assert {"cantilever", "folded", "bridge"} < set(allowed("auto"))
    assert allowed(NAME) == [NAME]


def test_schema_and_refusals_name_what_is_registered(plan):
    def schema_names():
        word, table = spec_schema()["properties"]["suspension"]["anyOf"]
        assert word["enum"] == table["properties"]["topology"]["enum"]
        return word["enum"]

    assert schema_names()[0] == "auto"
    assert schema_names()[-1] == NAME
    assert {"serpentine", "bridge", "cantilever", "folded", *SERPENTINES} < set(schema_names())
    with pytest.raises(SpecError, match="did you mean 'toy-spiral'"):
        parse_spec(SPEC.replace(NAME, "toy-spirl"))
    with pytest.raises(
        SpecError,
        match=f"known are auto, bridge, cantilever, folded, serpentine, {', '.join(SERPENTINES)}, toy-spiral",
    ):
        parse_spec(SPEC.replace(NAME, "xyz"))
    text = plan_to_json(plan)
    unregister(NAME)
    try:
        assert NAME not in schema_names()
        with pytest.raises(SpecError, match="no choice 'toy-spiral'"):
            parse_spec(SPEC)
        with pytest.raises(FileError, match=r"is not a plan .*no choice 'toy-spiral'"):
            plan_from_json(text)
    finally:
        register(NAME, toy_like(arrange))


@pytest.mark.parametrize("name", ["folded", "auto", NAME, "Toy", "toy_spiral", ""])
def test_a_name_that_is_taken_or_none_is_refused(plan, name):
    before = names()
    with pytest.raises(SpecError):
        register(name, toy_like(arrange))
    assert names() == before


def test_what_lacks_something_is_refused():
    with pytest.raises(SpecError, match="'half' lacks END_FACTOR, widest"):
        register("half", SimpleNamespace(BEAMS=1, arrange=arrange, longest=longest, shortest=shortest))
    with pytest.raises(SpecError, match="no registered suspension 'folded'"):
        unregister("folded")
    assert suspension("folded").BEAMS == 2


def test_another_suspension_of_the_same_name_is_another(plan):
    def stiffer(plate, beam, gap_mm):
        made = arrange(plate, beam, gap_mm)
        return made._replace(beams=tuple(path._replace(width_mm=2 * path.width_mm) for path in made.beams))

    spec = parse_spec(SPEC.replace(NAME, "folded"))
    hung = [replace(spec, suspension=replace(spec.suspension, topology="brief")) for _ in range(2)]
    spans = []
    for spec, arranged in zip(hung, (arrange, stiffer), strict=True):
        with registered("brief", toy_like(arranged)):
            spans.append(reach(spec, "brief", Room(15.0, 15.0)).span_hz)
    assert spans[1][0] > 1.2 * spans[0][0]


def test_built_as_planned_and_what_is_not_is_found(plan):
    for channel in plan.channels:
        assert float(taxel_solid(plan, channel).volume) == pytest.approx(volume_by_hand(plan, channel), rel=1e-9)
    pad = build_pad(plan)
    report = check_pad(pad, plan)
    assert not [finding for finding in report.findings if finding.level == "error"]
    assert report.figures["largest_difference_from_plan_mm"] < 0.01
    named = {d.name for d in measured(plan, as_manifold(pad.mesh, "pad"))}
    assert {"beam 1 length", "beam 2 width", "beam 1 offset from its path", "beam 2 thickness"} <= named
    keys = {taxel_key(plan, plan.channels[0])}
    for name, arranged, found in (("thin", thinned, "width is"), ("aside", shifted, "offset from its path is")):
        with registered(name, toy_like(arranged)):
            other = hung_by(plan, name)
            keys.add(taxel_key(other, other.channels[0]))
            messages = [f.message for f in check_pad(build_pad(other), plan).findings if f.code == "built.planned"]
        assert any(found in message for message in messages), name
    assert len(keys) == 3


@pytest.mark.soak
def test_model_frame_and_solid_agree(plan, tmp_path):
    """Beam and frame agree to 0.6 %, the error of arcs as chords; the solid within the model's stated error.

    The solid is solved coarsely, 0.5 % too high.
    """
    channel = plan.channels[0]
    taxel = model(plan, channel)
    assert float(taxel.resonance_hz) == pytest.approx(channel.resonance_hz, rel=1e-9)
    frame = frame_modes(taxel_frame(taxel)).frequency_hz
    assert np.abs(frame[:4] / taxel.modes.frequency_hz[:4] - 1).max() < 0.006
    write_taxel_step(plan, channel, tmp_path / "taxel.step")
    with ProcessPoolExecutor(1, get_context("spawn")) as solver:
        solved = solver.submit(solve_modes, solid_taxel(plan, channel, tmp_path / "taxel.step"), 3, 0).result().modes
    # What is stated for bends, and what the frame behind the roots, deeper than half a rib, adds.
    assert 0.013 <= channel.model_error < 0.05
    assert not taxel.in_range
    assert abs(solved.frequency_hz[solved.working] / channel.resonance_hz - 1) < channel.model_error
    assert np.abs(solved.frequency_hz[:4] / taxel.modes.frequency_hz[:4] - 1).max() < channel.model_error


def test_an_arc_that_is_too_tight_for_its_beam_is_refused(plan):
    def tight(plate, beam, gap_mm):
        made = arrange(plate, beam, gap_mm)
        bend = arc(0.4 * beam.width_mm, 90)
        sharp = [path._replace(segments=(path.segments[0], bend, *path.segments[2:])) for path in made.beams]
        return made._replace(beams=tuple(sharp))

    with registered("tight", toy_like(tight)):
        other = hung_by(plan, "tight")
        with pytest.raises(GeometryError, match="must have at least half of the beam's width"):
            taxel_solid(other, other.channels[0])


def test_lists_of_names_are_read_in_the_order_of_the_known():
    known = ("stl", "3mf", "step")
    assert names_in(" step,stl ,,stl", known, "--formats") == ("stl", "step")
    assert names_in(" , ", known, "--parts", optional=True) == ()
    with pytest.raises(SpecError, match=r"^--formats: must name one or more of stl, 3mf, step$"):
        names_in(" , ", known, "--formats")
    with pytest.raises(SpecError, match=r"^--formats: must be among stl, 3mf, step, got 'stp'; did you mean 'step'\?$"):
        names_in("stl,stp", known, "--formats")
    with pytest.raises(SpecError, match=r"must be among stl, 3mf, step, got 'obj'$"):
        names_in("obj", known, "--formats")


FORMAT = "toy-text"


def toy_format(made_of="plan"):
    def write(out, job):
        out.write("toy.txt", f"{job.plan.name}, {job.timeline.seconds if job.timeline else 0} s\n")

    return SimpleNamespace(FILE="toy.txt", MADE_OF=made_of, write=write)


@contextmanager
def registered_format(thing):
    drive_formats.register(FORMAT, thing)
    try:
        yield
    finally:
        drive_formats.unregister(FORMAT)


@pytest.mark.sample(2)
@pytest.mark.parametrize("made_of", ["plan", "drive", "frames", "host"])
def test_a_registered_format_is_written_alone_and_beside_others(small_plan, tmp_path, made_of):
    frame = np.ones((1, len(small_plan.taxels)))
    with registered_format(toy_format(made_of)):
        driven = Drive(small_plan, frame).save_folder(tmp_path / "alone", (FORMAT,))
        assert driven.files == ("plan.json", "toy.txt")
        formats = parse_formats(f"{FORMAT},wav,csv")
        driven = Drive(small_plan, frame).save_folder(tmp_path / "beside", formats)
        assert driven.files == ("plan.json", "drive.csv", "drive.wav", "drive-wave.json", "toy.txt")
    assert (tmp_path / "beside/toy.txt").read_text() == (tmp_path / "alone/toy.txt").read_text()
    assert float((tmp_path / "alone/toy.txt").read_text().split()[-2]) > 0


class ToyPlayer:
    PLAYS = "frames"
    ADDRESS = "PLACE"
    ABOUT = "where the toy lies"

    def __init__(self):
        self.jobs = []

    def play(self, job):
        self.jobs.append(job)
        job.on_shown(len(job.levels))
        return f"{len(job.levels)} frames shown on {job.address}"

    def outcome(self, played):
        return played, {"place": self.jobs[-1].address}


@pytest.fixture
def toy_player():
    player = ToyPlayer()
    players.register("toy", player)
    yield player
    players.unregister("toy")


def test_a_registered_player_is_an_option_of_play(toy_player, capsys):
    assert cli.run(["play", "paper-32", "--toy", "here", "--state", "10", "--repeat", "3", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["place"] == "here"
    assert cli.run(["play", "paper-32", "--toy", "there", "--state", "01"]) == 0
    assert capsys.readouterr().out == "1 frames shown on there\n"
    (first, second) = toy_player.jobs
    assert first.levels.shape == (3, 32) and first.levels.sum() == 3 * 16
    assert np.array_equal(second.levels[0], 1 - first.levels[0])
    assert cli.run(["play", "--help"]) == 0
    assert "--toy PLACE" in capsys.readouterr().out


def test_a_player_plays_frames_or_a_wav_and_not_the_other(toy_player, small_plan):
    with pytest.raises(SpecError, match=r"^player: 'toy' plays frames, not wav$"):
        pg.play_wav("a.wav", "here", player="toy")
    with pytest.raises(SpecError, match=r"^player: 'audio' plays wav, not frames$"):
        pg.play(small_plan, "here", state="1", player="audio")
    with pytest.raises(SpecError, match="there is no player 'toys'; "):
        pg.play(small_plan, "here", state="1", player="toys")


def test_a_file_is_saved_in_the_format_whose_files_end_so(small_plan, tmp_path):
    drive = Drive(small_plan, np.ones((1, len(small_plan.taxels))))
    with registered_format(toy_format()):
        for name in ("a.txt", "a.h", "a.py", "a.csv", "A.CSV"):
            assert drive.save(tmp_path / name).files == (name,)
        assert (tmp_path / "a.txt").read_text().startswith(small_plan.name)
        assert "#define PADGEN_SCHEME" in (tmp_path / "a.h").read_text()
    toy = toy_format()
    toy.FILE = "toy.csv"
    with registered_format(toy):
        drive.save(tmp_path / "b.csv")
    assert (tmp_path / "b.csv").read_text() == (tmp_path / "a.csv").read_text()
    with pytest.raises(SpecError, match=r"a\.txt: must end with one of \.csv, .*\.wav, got '\.txt'$"):
        drive.save(tmp_path / "a.txt")


def test_a_format_may_need_something_to_show_and_may_refuse(small_plan, tmp_path):
    def refuse(job):
        raise SpecError("is too long for a toy", "--seconds")

    thing = toy_format("frames")
    with registered_format(thing):
        with pytest.raises(SpecError, match="toy-text needs something to show; add --state or --frames"):
            Drive(small_plan).save_folder(tmp_path / "d", (FORMAT,))
        thing.refuse = refuse
        with pytest.raises(SpecError, match="too long for a toy"):
            Drive(small_plan, np.ones((1, len(small_plan.taxels)))).save_folder(tmp_path / "d", (FORMAT,))
    assert not (tmp_path / "d").exists()


def test_help_and_refusals_name_the_formats(capsys):
    def told():
        assert cli.run(["drive", "--help"]) == 0
        return " ".join(capsys.readouterr().out.split())

    with registered_format(toy_format()):
        assert "of c, csv, hjif, json, syntacts, wav, toy-text" in told()
        with pytest.raises(SpecError, match="got 'toy-txt'; did you mean 'toy-text'"):
            parse_formats("csv,toy-txt")
        with pytest.raises(SpecError, match="there is a drive format 'toy-text' already"):
            drive_formats.register(FORMAT, toy_format())
    assert FORMAT not in told()
    with pytest.raises(SpecError, match=r"--formats: must be among c, csv, hjif, json, syntacts, wav, got 'toy-text'"):
        parse_formats(FORMAT)
    with pytest.raises(SpecError, match="'half' lacks MADE_OF, write"):
        drive_formats.register("half", SimpleNamespace(FILE="half.txt"))


PAD_FORMAT = "toy-points"


def write_points(out, job):
    """Write the corners of a part, one per line."""
    rows = [f"{x:.3f} {y:.3f} {z:.3f}" for x, y, z in job.part.mesh.vertices_mm]
    path = out.write(f"{job.part.name}.points", f"{job.part.title}, {job.spec_hash[:8]}\n" + "\n".join(rows))
    assert path.read_text().count("\n") == len(rows)


@contextmanager
def registered_pad_format():
    pad_formats.register(PAD_FORMAT, SimpleNamespace(write=write_points))
    try:
        yield
    finally:
        pad_formats.unregister(PAD_FORMAT)


def listed(folder):
    return json.loads((folder / "manifest.json").read_text())["files"]


def test_a_pad_and_its_parts_are_saved_in_a_registered_format(small_plan, tmp_path):
    with registered_pad_format():
        pad = pg.build(small_plan, parts=["tray"])
        built = pad.save(tmp_path / "a", formats=[PAD_FORMAT, "stl"])
        assert {"pad.points", "tray.points", "pad.stl", "tray.stl"} <= {*built.files} <= {*listed(tmp_path / "a")}
        lines = (tmp_path / "a/pad.points").read_text().splitlines()
        assert lines[0].startswith(f"{small_plan.name}, ") and len(lines) == 1 + len(pad.mesh.vertices_mm)
        # What another process registered under the name is in no hash.
        assert not pad.save(tmp_path / "a", formats=[PAD_FORMAT, "stl"]).up_to_date
        pad.save(tmp_path / "a", formats=["stl"])
        assert not {"pad.points", "tray.points"} & {path.name for path in (tmp_path / "a").iterdir()}


def test_the_build_command_writes_a_registered_format_and_a_new_plan_makes_it_stale(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("tiny.toml").write_text(SMALL)
    with registered_pad_format():
        assert cli.run(["build", "tiny.toml", "--formats", PAD_FORMAT, "-o", "o"]) in (0, 1)
        digest = sha256(Path("o/pad.points").read_bytes()).hexdigest()
        assert listed(Path("o"))["pad.points"] == digest
    Path("tiny.toml").write_text(SMALL.replace("[50, 200]", "[60, 300]"))
    assert cli.run(["plan", "tiny.toml", "-o", "o"]) in (0, 1)
    assert "are of an earlier plan" in capsys.readouterr().out and Path("o/pad.points").exists()
    assert cli.run(["build", "tiny.toml", "--formats", "stl", "-o", "o"]) in (0, 1)
    assert "pad.points" not in {path.name for path in Path("o").iterdir()}


def test_files_of_a_registered_drive_format_go_with_their_plan(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with registered_format(toy_format()):
        assert cli.run(["drive", "paper-pair", "--formats", FORMAT, "-o", "o"]) in (0, 1)
    assert Path("o/toy.txt").exists()
    assert cli.run(["plan", "paper-32", "-o", "o"]) in (0, 1)
    assert {path.name for path in Path("o").iterdir()} == {"manifest.json", "plan.json"}


def test_help_and_refusals_name_the_pad_formats(capsys):
    def told():
        assert cli.run(["build", "--help"]) == 0
        return " ".join(capsys.readouterr().out.split())

    assert "of 3mf, board, glb, step, stl (default: stl,3mf,step)" in told()
    assert {*USUAL_FORMATS} < {*PAD_FORMATS.names()}
    with registered_pad_format():
        assert f"of 3mf, board, glb, step, stl, {PAD_FORMAT} (default" in told()
        with pytest.raises(SpecError, match="got 'toy-point'; did you mean 'toy-points'"):
            parse_pad_formats("stl,toy-point")
        with pytest.raises(SpecError, match="there is a pad format '3mf' already"):
            pad_formats.register("3mf", SimpleNamespace(write=write_points))
        assert parse_sweep(SWEEP).settings.formats == PAD_FORMAT
    with pytest.raises(SpecError, match=r"formats: must be among 3mf, board, glb, step, stl, got 'toy-points'"):
        parse_sweep(SWEEP)
    with pytest.raises(SpecError, match="'half' lacks write"):
        pad_formats.register("half", SimpleNamespace())


SWEEP = f"""
name = "s"
base = "paper-pair"
stage = "build"
formats = "{PAD_FORMAT}"
[axes]
q_min = [15]
"""
SCHEME = "toy-whisper"
FOUR = """
name = "toy"
resolution = 16
band_hz = [50, 300]
resonances_hz = [60, 90, 135, 200]
delta_y = 10
q_min = 30
material = "pla"
pad = { width_mm = 64, depth_mm = 64 }
coil = { grid = [2, 2] }
drive = { scheme = "NAME" }
"""


def toy_scheme(spurs):
    """Return a scheme of plain tones that makes `spurs` times the usual spurs."""
    alike = {key: getattr(tones, key) for key in ("current_lines_a", "mean_square_a2", "peak_current_a")}
    return SimpleNamespace(
        CURRENT="tones",
        TAKES_TURNS=False,
        HAS_PAIR_SPURS=True,
        pair_square=lambda scheme, a, b, strongest: spurs**2 * tones.pair_square(scheme, a, b, strongest),
        peak_voltage_v=tones.peak_voltage_v,
        **alike,
    )


@contextmanager
def registered_scheme(thing):
    schemes.register(SCHEME, thing)
    try:
        yield
    finally:
        schemes.unregister(SCHEME)


def test_a_registered_scheme_plans_and_drives(tmp_path):
    plain = make_plan(parse_spec(FOUR.replace("NAME", "tones")))
    kept = []
    exact = []
    for spurs in (1e-6, 1.0):
        with registered_scheme(toy_scheme(spurs)):
            plan = make_plan(parse_spec(FOUR.replace("NAME", SCHEME)))
            assert plan.selectivity.drive == plan.scheme.name == SCHEME
            kept.append(plan.selectivity.all_states_db)
            exact.append(plan.capacity.exact)
            assert plan.load == plain.load
            driven = Drive(plan, np.ones((1, len(plan.taxels)))).save_folder(
                tmp_path, ("csv", "json", "c", "wav", "syntacts")
            )
            assert driven.report.scheme == SCHEME
            assert "#define PADGEN_SCHEME PADGEN_TONES" in (tmp_path / "pad_drive.h").read_text()
    # What was computed for one scheme is not taken for another of its name.
    assert exact[0] > exact[1] == plain.capacity.exact
    figures = {figure.scheme: figure.all_states_db for figure in plain.selectivity.schemes}
    assert figures["tones"] < figures["spur-free"] - 10
    assert kept == pytest.approx([figures["spur-free"], figures["tones"]], abs=1e-6)


def test_auto_takes_a_registered_scheme_where_no_simpler_one_will_do():
    thing = toy_scheme(1e-6)
    with registered_scheme(thing):
        assert schemes.simplest_first() == ("tones", "biased", "spur-free", SCHEME, "time-shared")
        assert make_plan(parse_spec(FOUR.replace("NAME", "auto"))).selectivity.drive == "biased"
        thing.SIMPLICITY = 0.5
        plan = make_plan(parse_spec(FOUR.replace("NAME", "auto")))
        assert plan.selectivity.drive == SCHEME
        assert [figure.scheme for figure in plan.selectivity.schemes][-1] == SCHEME


def test_schema_and_refusals_name_the_schemes():
    with registered_scheme(toy_scheme(0.5)):
        assert SCHEME in str(spec_schema()["properties"]["drive"])
        with pytest.raises(SpecError, match="did you mean 'toy-whisper'"):
            parse_spec(FOUR.replace("NAME", "toy-wisper"))
    assert SCHEME not in str(spec_schema())
    with pytest.raises(SpecError, match="no choice 'toy-whisper'"):
        parse_spec(FOUR.replace("NAME", SCHEME))
    with pytest.raises(SpecError, match="there is a drive scheme 'auto' already"):
        schemes.register("auto", toy_scheme(1))
    with pytest.raises(SpecError, match="'half' lacks TAKES_TURNS, HAS_PAIR_SPURS, pair_square"):
        schemes.register("half", SimpleNamespace(CURRENT="tones"))


PLUGIN = """
from types import SimpleNamespace
from padgen.physics import schemes
from padgen.physics.schemes import tones

names = ("current_lines_a", "mean_square_a2", "peak_current_a", "peak_voltage_v")
thing = {name: getattr(tones, name) for name in names} | {"CURRENT": "tones", "TAKES_TURNS": False}
square = lambda scheme, a, b, strongest: 1e-12 * tones.pair_square(scheme, a, b, strongest)
schemes.register("toy-whisper", SimpleNamespace(HAS_PAIR_SPURS=True, pair_square=square, **thing))
"""


@pytest.fixture
def plugin_folder(tmp_path):
    """A folder with a module, and a sweep of two variants that needs it."""
    (tmp_path / "toy_plugin.py").write_text(PLUGIN)
    (tmp_path / "toy.toml").write_text(FOUR.replace("NAME", SCHEME))
    (tmp_path / "two.toml").write_text('name = "two"\nbase = "toy.toml"\n[axes]\nq_min = [30, 31]\n')
    return tmp_path


def padgen_in(folder, plugins, *arguments):
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), *sys.path]), PLUGINS: plugins}
    command = [sys.executable, "-m", "padgen", *arguments]
    return subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, timeout=120)


def test_workers_know_what_a_plugin_registers_and_its_code_is_part_of_the_inputs(plugin_folder):
    def swept(say):
        ran = padgen_in(plugin_folder, "toy_plugin", "sweep", "two.toml", "-j", "1", "--json")
        assert ran.returncode == 0, ran.stderr
        return json.loads(ran.stdout.splitlines()[-1])[say]

    assert (swept("done"), swept("kept")) == (2, 2)
    with (plugin_folder / "out/two/index.csv").open(newline="") as file:
        found = list(csv.DictReader(file))
    assert {(row["status"], row["scheme"]) for row in found} == {("done", SCHEME)}
    (plugin_folder / "toy_plugin.py").write_text(PLUGIN.replace("1e-12", "1e-6"))
    assert swept("kept") == 0


def test_without_its_plugin_a_name_is_unknown_and_a_plugin_that_breaks_is_told(plugin_folder):
    ran = padgen_in(plugin_folder, "", "sweep", "two.toml")
    assert ran.returncode == 2 and "no choice 'toy-whisper'" in ran.stderr
    (plugin_folder / "toy_plugin.py").write_text("1 / 0")
    ran = padgen_in(plugin_folder, "toy_plugin", "plan", "toy.toml")
    assert ran.returncode == 2 and len(ran.stderr.splitlines()) == 1
    assert "PADGEN_PLUGINS: cannot import 'toy_plugin' (ZeroDivisionError: division by zero)" in ran.stderr


def test_what_workers_would_not_know_is_refused_before_they_start(tmp_path):
    plan = make_plan(parse_spec(FOUR.replace("NAME", "tones")))
    # The module's spiral, which a fixture registers, comes first where it is there.
    name = "(suspension 'toy-spiral'|drive scheme 'toy-whisper')"
    refusal = rf"^the {name} is known to this process alone, .* environment variable PADGEN_PLUGINS$"
    with registered_scheme(toy_scheme(1)):
        with pytest.raises(SpecError, match=refusal):
            pg.sweep("paper-32", folder=tmp_path / "out", q_min=[12])
        with pytest.raises(SpecError, match=refusal):
            pg.study(plan, only=["structure"])
    assert not (tmp_path / "out").exists()


COIL = "toy-spiral-coil"
FLAT = f"""
name = "toy"
resolution = 2
band_hz = [40, 400]
q_min = 15
resonances_hz = [100, 200]
material = "pla"
pad = {{ width_mm = 30, depth_mm = 30 }}
[coil]
name = "paper"
kind = "{COIL}"
grid = [1, 1]
length_mm = 1.6
turns = 40
core_diameter_mm = 0
gap_mm = 1.5
"""
COPPER_MM = 0.035


def flat_spirals(coil):
    """Return a coil on a printed circuit board, half of its turns on either face, without a core."""
    sizes = coil.outer_diameter_mm * 1e-3, coil.inner_diameter_mm * 1e-3
    tops = 0.0, (COPPER_MM - coil.length_mm) * 1e-3
    return coils.CoilSource(tuple(coils.Winding(*sizes, top, top - COPPER_MM * 1e-3, coil.turns / 2) for top in tops))


@contextmanager
def registered_coil(source):
    coils.register(COIL, SimpleNamespace(source=source))
    try:
        yield
    finally:
        coils.unregister(COIL)


def field_of_spirals(spec, points_m, turns_by=20, arcs=360):
    """Return the flux density in T per A by Biot and Savart, each turn a circle of straight pieces on two faces."""
    coil = spec.coil
    field = np.zeros(points_m.shape)
    inner = coil.inner_diameter_mm / 2e3
    outer = coil.outer_diameter_mm / 2e3
    angle = np.arange(arcs) * 2 * pi / arcs
    along = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], -1) * 2 * pi / arcs
    for top in (0.0, COPPER_MM - coil.length_mm):
        for turn in range(turns_by):
            radius = inner + (turn + 0.5) / turns_by * (outer - inner)
            wire = np.stack(
                [radius * np.cos(angle), radius * np.sin(angle), 0 * angle + (top - COPPER_MM / 2) * 1e-3], -1
            )
            arm = points_m[..., None, :] - wire
            each = np.cross(radius * along, arm) / np.linalg.norm(arm, axis=-1)[..., None] ** 3
            field += 1e-7 * each.sum(-2) * coil.turns / 2 / turns_by
    return field


def weak_pull(spec, washer, offset_m):
    """Return c in N/A² on a weakly magnetic washer, ``−χ/2μ0 d/dz ∫B² dV``, with the field by Biot and Savart."""
    node, weight = np.polynomial.legendre.leggauss(4)
    inner = washer.inner_diameter / 2
    outer = washer.outer_diameter / 2
    radius = np.sqrt(inner**2 + (node + 1) / 2 * (outer**2 - inner**2))
    angle = (np.arange(16) + 0.5) * pi / 8
    volume = pi * (outer**2 - inner**2) * washer.thickness
    energy = []
    for dz in (-1e-5, 1e-5):
        at_z = spec.coil.gap_mm * 1e-3 + dz + (node + 1) / 2 * washer.thickness
        r, a, z = np.meshgrid(radius, angle, at_z, indexing="ij")
        square = (field_of_spirals(spec, np.stack([offset_m + r * np.cos(a), r * np.sin(a), z], -1)) ** 2).sum(-1)
        energy.append(np.einsum("ijk,i,k->", square, weight / 2, weight / 2) / 16 * volume)
    return (washer.permeability - 1) / (2 * 4e-7 * pi) * (energy[0] - energy[1]) / 2e-5


@pytest.mark.parametrize("offset_mm", [0.0, 3.0])
def test_a_registered_coil_pulls_as_the_law_of_biot_and_savart_has_it(offset_mm):
    """The pulls agree to 0.5 %, since the sum's winding is circles of 20 turns."""
    with registered_coil(flat_spirals):
        spec = parse_spec(FLAT)
        source, washer = magnetic_parts(spec)
        weak = washer._replace(permeability=1.001)
        pulled = -pull(source, weak, spec.coil.gap_mm * 1e-3, offset_mm * 1e-3).axial
        assert pulled == pytest.approx(weak_pull(spec, weak, offset_mm * 1e-3), rel=0.005)


def test_a_registered_coil_plans_and_drives(tmp_path):
    with registered_coil(flat_spirals):
        plan = make_plan(parse_spec(FLAT))
        assert plan.spec.coil.kind == COIL
        text = plan_to_json(plan)
        assert plan_to_json(plan_from_json(text)) == text
        Drive(plan).save_folder(tmp_path, ("csv", "json"))
        assert (tmp_path / "drive.csv").read_text().count("\n") > len(plan.channels)
        pulls = [channel.force_constant_n_per_a2 for channel in plan.channels]
    twice = FLAT.replace("turns = 40", "turns = 80")
    with registered_coil(flat_spirals):
        more = [channel.force_constant_n_per_a2 for channel in make_plan(parse_spec(twice)).channels]
    assert more == pytest.approx([4 * each for each in pulls], rel=1e-9)
    # What was computed for one kind is not taken for another of its name.
    with registered_coil(lambda coil: flat_spirals(coil)._replace(windings=flat_spirals(coil).windings[:1])):
        fewer = [channel.force_constant_n_per_a2 for channel in make_plan(parse_spec(FLAT)).channels]
    assert all(0.25 * both < less < 0.8 * both for less, both in zip(fewer, pulls, strict=True))


def test_schema_and_refusals_name_the_coils():
    def kinds():
        return spec_schema()["properties"]["coil"]["anyOf"][1]["properties"]["kind"]["enum"]

    with registered_coil(flat_spirals):
        assert {"board", "solenoid", COIL} <= set(kinds())
        with pytest.raises(SpecError, match=r"^coil\.kind: .*did you mean 'toy-spiral-coil'"):
            parse_spec(FLAT.replace(COIL, "toy-spiral-coli"))
        with pytest.raises(SpecError, match="there is a kind of coil 'solenoid' already"):
            coils.register("solenoid", SimpleNamespace(source=flat_spirals))
    assert COIL not in kinds()
    with pytest.raises(SpecError, match="no choice 'toy-spiral-coil'; known are board, "):
        parse_spec(FLAT)
    with pytest.raises(SpecError, match="'half' lacks source"):
        coils.register("half", SimpleNamespace())


def test_a_solenoid_of_two_windings_is_the_same_solenoid():
    """A winding, and the same one cut in two by height or by radius, have the same field solution."""
    pytest.importorskip("ngsolve", exc_type=ImportError)
    from padgen.verify.field_solid import axisymmetric_force

    whole = solenoid(10e-3, 4e-3, 10e-3, 1000, 4e-3, 1000)
    stacked = (coils.Winding(10e-3, 4e-3, 0.0, -3e-3, 300), coils.Winding(10e-3, 4e-3, -3e-3, -10e-3, 700))
    nested = (coils.Winding(7e-3, 4e-3, 0.0, -10e-3, 500), coils.Winding(10e-3, 7e-3, 0.0, -10e-3, 500))
    washer = SteelRing(4e-3, 2e-3, 0.5e-3, 1000)
    force = axisymmetric_force(whole, washer, 1e-3).force_n
    for windings in (stacked, nested):
        cut = whole._replace(windings=windings)
        assert axisymmetric_force(cut, washer, 1e-3).force_n == pytest.approx(force, rel=2e-3)
        assert pull(cut, washer, 1e-3, 0.0).axial == pytest.approx(force, rel=2e-3)


@contextmanager
def registered_rule(book, function):
    book.register("toy", function)
    try:
        with pytest.raises(SpecError, match=f"there is a rule 'toy' of the {book.kind} already"):
            book.register("toy", function)
        yield
    finally:
        book.unregister("toy")


def test_a_registered_rule_of_specs_refuses_them_with_its_cure(tmp_path, monkeypatch, capsys):
    def low_bands(spec):
        broken = f"must be below 2 Hz, got {spec.band_hz[0]:g} Hz"
        yield Rule(spec.band_hz[0] < 2, "band_hz", broken, [{"band_hz": [1, spec.band_hz[1]]}])

    monkeypatch.chdir(tmp_path)
    Path("tiny.toml").write_text(SMALL)
    with registered_rule(SPEC_RULES, low_bands):
        assert cli.run(["plan", "tiny.toml"]) == 2
        assert "band_hz: must be below 2 Hz, got 50 Hz; band_hz = [1, 200] would do" in capsys.readouterr().err
        assert not Path("out").exists()
    assert cli.run(["plan", "tiny.toml"]) in (0, 1)


def test_registered_rules_of_plans_meshes_and_signals_are_findings(small_plan, tmp_path):
    def few_taxels(plan):
        yield Rule(len(plan.taxels) < 2, "pad", "has more than one taxel", (), "toy.taxels", "warning")

    def coarse(printed):
        most = len(printed.mesh.triangles) - 1
        yield Rule(len(printed.mesh.triangles) <= most, "mesh", f"has over {most} triangles", code="toy.triangles")

    def silent(signal):
        yield Rule(signal.load.level.max() < 0.5, signal.where, "is louder than half", code="toy.loud")

    def codes(findings):
        return [(finding.code, finding.level) for finding in findings if finding.code.startswith("toy.")]

    with registered_rule(PLAN_RULES, few_taxels):
        assert codes(make_plan(small_plan.spec).findings) == [("toy.taxels", "warning")]
    with registered_rule(MESH_RULES, coarse):
        assert codes(check_pad(build_pad(small_plan), small_plan).findings) == [("toy.triangles", "error")]
    loud = np.ones((1, len(small_plan.taxels)))
    with registered_rule(SIGNAL_RULES, silent):
        for frames in (loud, 0.4 * loud):
            driven = Drive(small_plan, frames, held=True).save_folder(tmp_path / "d", ("wav",))
            assert codes(driven.findings) == ([("toy.loud", "error")] if frames is loud else [])
        with pytest.raises(SpecError, match=r"is not played: is louder than half; no lower drive.level_um"):
            refuse_frames(small_plan, loud)
    for findings in (make_plan(small_plan.spec).findings, driven.findings):
        assert not codes(findings)


def test_a_registered_rule_of_recordings_refuses_them(small_plan):
    def of_all(recording):
        due = len(recording.channels)
        yield Rule(len(recording.measured.taxels) == due, recording.measured.where, f"must be of all {due} taxels")

    taxel = small_plan.taxels[0]
    text = f"taxel,resonance_hz\n{taxel.id},{small_plan.channels[taxel.channel].resonance_hz:.3f}\n"
    measured = read_measured_text(text, small_plan, "m.csv")
    refusal = rf"^m\.csv: must be of all {len(small_plan.taxels)} taxels$"
    with registered_rule(RECORDING_RULES, of_all), pytest.raises(FileError, match=refusal):
        fit_measured(measured, small_plan)
    assert [fit.id for fit in fit_measured(measured, small_plan)] == [taxel.id]
