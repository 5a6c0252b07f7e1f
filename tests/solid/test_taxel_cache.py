"""Caches of taxels and ladders and their keys: known taxels need no CAD kernel, and some parts never need one."""

import json
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from math import pi

import numpy as np
import pytest

from padgen.core import cache
from padgen.make.pad import Pad
from padgen.planner import make_plan, search
from padgen.planner.layout import groove
from padgen.solid import pad_solid, taxel
from padgen.solid.formats import step
from padgen.solid.mesh import ANGLE_RAD, CHORD_MM, as_manifold, signed_volume_mm3, tessellated
from padgen.solid.pad_solid import border_mesh, border_volume_mm3, prism, washer_mesh
from padgen.solid.taxel import washer_solid
from padgen.spec import parse_spec
from padgen.spec.model import DriveTable
from tests.conftest import SMALL

OPTIMISED = SMALL.replace("[pad]", 'spacing = "optimised"\n[pad]')
ALL = ("stl", "3mf", "step", "glb")


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    search._known.cache_clear()
    yield tmp_path / "cache"
    search._known.cache_clear()


def entry_paths(store, kind):
    return sorted((store / kind).rglob("*.entry"))


def no_kernel(*args):
    raise AssertionError("asked for the CAD kernel")


def varied(**changes):
    """Plan the small pad with other values in [pad], or of `width_step_mm`."""
    lines = "".join(f"{name} = {value}\n" for name, value in changes.items())
    return make_plan(parse_spec(SMALL + lines))


def test_a_known_taxel_is_not_modelled_again(store, small_plan, monkeypatch):
    first = pad_solid.build_pad(small_plan)
    assert len(entry_paths(store, taxel.KIND)) == len(small_plan.channels)
    monkeypatch.setattr(taxel, "taxel_solid", no_kernel)
    again = pad_solid.build_pad(small_plan)
    assert np.array_equal(again.mesh.vertices_mm, first.mesh.vertices_mm)
    assert np.array_equal(again.mesh.triangles, first.mesh.triangles)
    assert again.volume_mm3 == first.volume_mm3


@pytest.mark.parametrize("change", [{"border_mm": 8.0}, {"hole_diameter_mm": 0.0}, {"border_mm": 7.25}])
def test_another_layout_has_the_same_taxels(store, small_plan, monkeypatch, change):
    pad_solid.build_pad(small_plan)
    monkeypatch.setattr(taxel, "taxel_solid", no_kernel)
    built = pad_solid.build_pad(varied(**change))
    assert signed_volume_mm3(built.mesh) == pytest.approx(built.volume_mm3, rel=1e-4)


def test_another_taxel_has_another_key(small_plan):
    """The same channel lies in plans that differ in one thing that its solid is made from."""
    channel = small_plan.channels[0]
    plate = small_plan.plate
    thicker = replace(small_plan.spec, pad=replace(small_plan.spec.pad, frame_thickness_mm=4.2))
    others = {
        "frame": replace(small_plan, spec=thicker),
        "outline": replace(small_plan, cell=replace(small_plan.cell, width_mm=small_plan.cell.width_mm + 0.1)),
        "recess": replace(small_plan, plate=replace(plate, recess_depth_mm=plate.recess_depth_mm + 0.05)),
    }
    keys = {name: taxel.taxel_key(plan, channel) for name, plan in others.items()}
    assert len({taxel.taxel_key(small_plan, channel), *keys.values()}) == 1 + len(others), keys


def test_the_key_has_the_beam_the_fineness_and_the_versions(small_plan, monkeypatch):
    channel = small_plan.channels[0]
    key = taxel.taxel_key(small_plan, channel)
    wider = replace(channel, beam=replace(channel.beam, width_mm=channel.beam.width_mm + 1e-3))
    assert taxel.taxel_key(small_plan, wider) != key
    assert taxel.taxel_key(small_plan, channel, chord_mm=0.01) != key
    assert taxel.taxel_key(replace(small_plan, name="other"), channel) == key
    monkeypatch.setattr(cache, "version", lambda name: "another")
    assert taxel.taxel_key(small_plan, channel) != key


def test_a_kept_step_has_the_pads_name_and_the_channels_number(store, small_plan, tmp_path, monkeypatch):
    channel = small_plan.channels[1]
    step.write_taxel_step(small_plan, channel, tmp_path / "first.step")
    monkeypatch.setattr(step, "taxel_solid", no_kernel)
    step.write_taxel_step(small_plan, channel, tmp_path / "again.step")
    step.write_taxel_step(replace(small_plan, name="renamed"), channel, tmp_path / "other.step")
    first, again, other = ((tmp_path / f"{name}.step").read_text() for name in ("first", "again", "other"))
    assert again == first
    assert "tiny taxel 1" in first
    assert other == first.replace("tiny taxel 1", "renamed taxel 1")


BUILD = """
import json, sys
from pathlib import Path
from padgen.make.pad import Pad
from padgen.spec import parse_spec
for text in sys.argv[2:]:
    spec = parse_spec(text)
    pad = Pad(spec)
    before = "PIL" in sys.modules  # the GLB of the last pad
    pad.save(Path(sys.argv[1], spec.name), ("stl", "3mf", "step"))
    pictures = "PIL" in sys.modules and not before
    built = pad.save(Path(sys.argv[1], spec.name), ("stl", "3mf", "step", "glb"))
    heavy = ("OCP", "build123d", "ngsolve")
    loaded = [name for name in sys.modules if name.partition(".")[0] in heavy or name.startswith("padgen.measured")]
    loaded += ["PIL"] * pictures
    print(json.dumps([list(built.files), loaded, [f.code for f in built.findings if f.level == "error"]]))
"""


def test_a_change_of_layout_imports_no_cad_kernel_pictures_or_re_tuning(store, tmp_path):
    first = Pad(parse_spec(SMALL)).save(tmp_path / "first", ALL)
    assert {"pad.stl", "pad.3mf", "pad.glb", "taxel-0.step"} <= set(first.files)
    others = [
        SMALL.replace("tiny", name) + more
        for name, more in (("wider", "border_mm = 8\n"), ("plain", "hole_diameter_mm = 0\n"))
    ]
    ran = subprocess.run([sys.executable, "-c", BUILD, tmp_path, *others], capture_output=True, text=True, timeout=120)
    assert ran.returncode == 0, ran.stderr
    assert [json.loads(line) for line in ran.stdout.splitlines()] == [[list(first.files), [], []]] * 2


def test_a_washers_triangles_are_the_cad_kernels(small_plan):
    for channel in small_plan.channels:
        mesh = washer_mesh(small_plan, channel)
        solid = washer_solid(small_plan, channel)
        low = np.array(tessellated(solid).vertices_mm).min(0)
        high = np.array(tessellated(solid).vertices_mm).max(0)
        # Chords of 0.01 mm.
        assert mesh.vertices_mm.min(0) == pytest.approx(low, abs=0.02)
        assert mesh.vertices_mm.max(0) == pytest.approx(high, abs=0.02)
        assert as_manifold(mesh, "washer").volume() == pytest.approx(float(solid.volume), rel=0.01)


def test_a_disc_is_a_washer_without_a_bore(small_plan):
    disc = replace(small_plan.spec.washer, inner_diameter_mm=0.0)
    plan = replace(small_plan, spec=replace(small_plan.spec, washer=disc))
    volume = pi / 4 * disc.outer_diameter_mm**2 * disc.thickness_mm
    assert as_manifold(washer_mesh(plan, plan.channels[0]), "disc").volume() == pytest.approx(volume, rel=0.01)


@pytest.mark.sample(4)
@pytest.mark.parametrize("change", [{}, {"hole_diameter_mm": 0.0}, {"border_mm": 12.0, "hole_diameter_mm": 6.0}])
@pytest.mark.parametrize("above", [None, False, True])
def test_the_borders_triangles_hold_its_volume(change, above):
    plan = varied(**change)
    cut = None if above is None else groove(plan.spec, -4.0, above)
    mesh = border_mesh(plan, (2, 3), CHORD_MM, ANGLE_RAD, cut)
    assert as_manifold(mesh, "border").volume() == pytest.approx(border_volume_mm3(plan, cut), rel=3e-4)
    fine = border_mesh(plan, (2, 3), 1e-5, ANGLE_RAD, cut)
    assert as_manifold(fine, "border").volume() == pytest.approx(border_volume_mm3(plan, cut), rel=1e-6)
    if cut is not None:
        without = border_volume_mm3(plan)
        pad_ = plan.spec.pad
        deep = min(abs(cut.y0 - cut.y1) / 2, pad_.border_mm)
        assert without - border_volume_mm3(plan, cut) == pytest.approx(
            (cut.x1 - cut.x0) * deep * pad_.frame_thickness_mm, rel=1e-9
        )
        side = mesh.vertices_mm[(mesh.vertices_mm[:, 1] > 0) == above]
        assert np.isclose(side[:, 0], cut.x0).any()


def test_the_borders_inside_has_a_vertex_wherever_tiles_meet(small_plan):
    mesh = border_mesh(small_plan, (2, 3), CHORD_MM, ANGLE_RAD)
    corners = {tuple(point) for point in mesh.vertices_mm.round(9).tolist()}
    size = small_plan.spec.pad
    for x in np.linspace(-size.width_mm / 2, size.width_mm / 2, 4).round(9).tolist():
        for y in (-size.depth_mm / 2, size.depth_mm / 2):
            assert {(x, y, 0.0), (x, y, size.frame_thickness_mm)} <= corners


def test_arcs_are_within_the_chord(small_plan):
    size = small_plan.spec.pad
    radius = small_plan.spec.pad.hole_diameter_mm / 2
    mesh = border_mesh(small_plan, (2, 2), CHORD_MM, ANGLE_RAD)
    centre = np.array([1, 1]) * (size.width_mm + size.border_mm) / 2
    around = mesh.vertices_mm[mesh.vertices_mm[:, 2] == 0][:, :2] - centre
    around = around[np.hypot(*around.T) < radius * 1.01]
    assert np.hypot(*around.T) == pytest.approx(radius, abs=1e-9)
    angle = np.sort(np.arctan2(around[:, 1], around[:, 0]))
    widest = max(b - a for a, b in pairwise(angle))
    assert widest <= ANGLE_RAD
    assert radius * (1 - np.cos(widest / 2)) <= CHORD_MM / 2 + 1e-12


def test_a_prism_whose_rings_meet_is_refused():
    from padgen.core.errors import GeometryError

    square = np.array([(0, 0), (4, 0), (4, 4), (0, 4)], float)
    hole = square[::-1] / 2 + 1
    aside = np.array([3.0, 0.0])
    assert signed_volume_mm3(prism([square, hole], 1.0, 3.0)) == pytest.approx(2 * (16 - 4))
    with pytest.raises(GeometryError, match="the edges of a plate meet its holes"):
        prism([square, hole + aside], 1.0, 3.0)


def test_an_optimised_ladder_is_searched_once(store, monkeypatch):
    spec = parse_spec(OPTIMISED)
    found = search.optimum(spec, 3, 60.0, 200.0)
    search._known.cache_clear()
    monkeypatch.setattr(search, "_searched", no_kernel)
    renamed = replace(spec, name="other", pad=replace(spec.pad, border_mm=9.0))
    assert search.optimum(renamed, 3, 60.0, 200.0) == found
    assert len(entry_paths(store, search.KIND)) == 1


@pytest.mark.parametrize(
    "change",
    [
        {"q_min": 16.0},
        {"delta_y": 9.0},
        {"drive": DriveTable(scheme="time-shared")},
        {"drive": DriveTable(level_law=0.5)},
        {"drive": DriveTable(bias_ratio=1.5)},
        {"drive": DriveTable(threshold_hz=(50.0, 400.0), threshold_um=(1.0, 2.0))},
    ],
    ids=str,
)
def test_what_another_ladder_may_come_from_is_in_its_key(store, monkeypatch, change):
    """Each change alone leads to a search of its own."""
    monkeypatch.setattr(search, "_searched", lambda *args: search.Optimum((60.0, 90.0), 20.0, "tones"))
    spec = parse_spec(OPTIMISED)
    for changed in (spec, replace(spec, **change)):
        search._known.cache_clear()
        search.optimum(changed, 3, 60.0, 200.0)
    assert len(entry_paths(store, search.KIND)) == 2


@pytest.mark.parametrize("other", [(4, 60.0, 200.0), (3, 61.0, 200.0), (3, 60.0, 201.0)])
def test_another_count_or_band_has_another_ladder(store, monkeypatch, other):
    monkeypatch.setattr(search, "_searched", lambda *args: search.Optimum((60.0, 90.0), 20.0, "tones"))
    spec = parse_spec(OPTIMISED)
    for asked in ((3, 60.0, 200.0), other):
        search.optimum(spec, *asked)
    assert len(entry_paths(store, search.KIND)) == 2
