"""Exported files: their content, read back by their own and by other libraries, and the same bytes every time."""

import csv
import io
import json
import os
import subprocess
import sys
import zipfile
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from padgen.core.errors import GeometryError, SpecError
from padgen.make.pad import Pad, current_build, parse_formats
from padgen.solid.checks import check_pad
from padgen.solid.formats import ExportJob, Part, _3mf, verify_written
from padgen.solid.formats._3mf import pack_3mf, read_3mf
from padgen.solid.formats.stl import stl_blocks
from padgen.solid.kernel import build123d
from padgen.solid.mesh import Mesh, signed_volume_mm3
from padgen.solid.parts import bill_of_materials
from padgen.solid.scene import scene_parts
from padgen.spec import parse_spec
from tests.conftest import SMALL
from tests.tampering import stl_mesh

ALL = ("3mf", "glb", "step", "stl")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("out") / "tiny"
    Pad(parse_spec(SMALL)).save(path, ALL)
    return path


def test_what_lies_in_the_folder(folder):
    names = {p.name for p in folder.iterdir()}
    assert names == {
        "plan.json", "drive.csv", "drive.json", "bom.csv", "checks.json", "manifest.json",
        "pad.stl", "pad.3mf", "pad.glb", "pad.ini", "pad-orca.json", "slicer-settings.txt",
        *(f"taxel-{i}.step" for i in range(4)),
    }  # fmt: skip


def test_same_spec_same_bytes(folder, tmp_path):
    """The files are made in another process, with another hash seed, in another folder."""
    (tmp_path / "tiny.toml").write_text(SMALL)
    formats = "--formats=" + ",".join(ALL)
    command = [
        sys.executable,
        "-m",
        "padgen",
        "build",
        str(tmp_path / "tiny.toml"),
        "-o",
        str(tmp_path / "again"),
        formats,
    ]
    subprocess.run(command, check=True, capture_output=True, env={**os.environ, "PYTHONHASHSEED": "7"})
    for path in folder.iterdir():
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes(), path.name


def test_same_bytes_in_one_process(folder, tmp_path):
    """OCCT goes on counting the parts of assemblies throughout a process."""
    Pad(parse_spec(SMALL)).save(tmp_path / "again", ("step",))
    for path in folder.glob("*.step"):
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes()


def test_changed_code_builds_again(folder, monkeypatch):
    import padgen.make.pad

    assert current_build(parse_spec(SMALL), folder, ALL, False)
    monkeypatch.setattr(padgen.make.pad, "code_hash", lambda: "other")
    assert current_build(parse_spec(SMALL), folder, ALL, False) is None


def test_stl_is_read_alike_by_trimesh(folder, small_pad):
    mesh = trimesh.load(folder / "pad.stl")
    assert mesh.is_watertight
    # Single precision.
    assert mesh.volume == pytest.approx(signed_volume_mm3(small_pad.mesh), rel=1e-5)
    assert mesh.bounds[:, 2] == pytest.approx([0, 5])


def test_3mf_is_one_named_object_with_its_metadata(folder, small_pad):
    package = zipfile.ZipFile(folder / "pad.3mf")
    model = package.read("3D/3dmodel.model").decode()
    assert 'unit="millimeter"' in model
    assert model.count("<object ") == 1
    assert 'name="tiny"' in model
    for word in ("SpecHash", "padgen 0.", "Apache-2.0", "PrintSettings"):
        assert word in model
    assert package.read("Metadata/thumbnail.png").startswith(b"\x89PNG")
    assert {info.date_time for info in package.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    assert signed_volume_mm3(read_3mf(folder / "pad.3mf")) == pytest.approx(signed_volume_mm3(small_pad.mesh), rel=1e-5)


def test_3mf_with_instances_holds_each_distinct_taxel_once(small_plan, small_pad, tmp_path):
    whole = Part("pad", "tiny", "", small_pad.mesh, None, check_pad(small_pad, small_plan))
    path = tmp_path / "instances.3mf"
    pack_3mf(ExportJob(small_plan, whole, "0", small_pad, True), path)
    model = zipfile.ZipFile(path).read("3D/3dmodel.model").decode()
    assert model.count("<mesh>") == len(small_plan.channels) + 1
    assert model.count("<component ") == len(small_plan.taxels) + 1
    # Tiles keep the faces where they meet, so the parts' volumes add up to the pad's.
    assert signed_volume_mm3(read_3mf(path)) == pytest.approx(signed_volume_mm3(small_pad.mesh), rel=1e-4)


@pytest.mark.parametrize("fault", ["vertex", "triangle", "fewer", "more"])
def test_a_3mf_that_is_not_its_mesh_is_refused(small_plan, small_pad, tmp_path, fault, monkeypatch):
    """Also where rows and blocks that are read end at different places."""
    monkeypatch.setattr(_3mf, "BLOCK_BYTES", 1000)
    mesh = small_pad.mesh
    written = {
        "vertex": mesh._replace(
            vertices_mm=mesh.vertices_mm + [[0.0, 0.0, 1.0]] * (np.arange(len(mesh.vertices_mm)) == 7)[:, None]
        ),
        "triangle": mesh._replace(triangles=np.roll(mesh.triangles, 1, axis=1)),
        "fewer": mesh._replace(triangles=mesh.triangles[:-1]),
        "more": mesh._replace(triangles=np.concatenate([mesh.triangles, mesh.triangles[:1]])),
    }[fault]
    path = tmp_path / "pad.3mf"
    report = check_pad(small_pad, small_plan)
    pack_3mf(ExportJob(small_plan, Part("pad", "tiny", "", mesh, None, report), "0"), path)
    _3mf.verify_rows("pad.3mf", mesh, path)
    pack_3mf(ExportJob(small_plan, Part("pad", "tiny", "", written, None, report), "0"), path)
    with pytest.raises(GeometryError, match=r"^pad.3mf: read back, it"):
        _3mf.verify_rows("pad.3mf", mesh, path)


def test_step_holds_the_printed_part_and_its_washer(folder, small_plan, small_pad):
    whole = build123d().import_step(folder / "taxel-0.step")
    solids = sorted(whole.solids(), key=lambda s: -s.volume)
    assert len(solids) == 2
    assert solids[0].volume == pytest.approx(small_pad.tiles[0].volume_mm3)
    text = (folder / "taxel-0.step").read_text()
    assert "'printed'" in text
    assert "'washer'" in text


def test_glb_has_a_node_for_every_taxel_washer_and_coil(folder, small_plan):
    scene = trimesh.load(folder / "pad.glb")
    taxels = [taxel.id for taxel in small_plan.taxels]
    parts = [name for name in scene.graph.nodes_geometry if not name.startswith(("frame", "tray"))]
    assert sorted(parts) == sorted([*taxels, *(f"washer-{id}" for id in taxels), "border", "core-1", "winding-1"])
    assert len(scene.geometry) == len(scene_parts(small_plan)), "copies share their meshes"
    # Metres, y up: 37 x 5 x 37 mm over the coil and its tray.
    assert scene.extents[[0, 2]] == pytest.approx([0.037, 0.037], rel=1e-3)
    assert scene.bounds[1][1] == pytest.approx(0.005, rel=1e-3)
    for taxel in small_plan.taxels:
        for name, material in ((f"washer-{taxel.id}", "steel"), (taxel.id, "pad")):
            transform, geometry = scene.graph[name]
            assert scene.geometry[geometry].visual.material.name == material
            top = scene.geometry[geometry].vertices
            corners = trimesh.transform_points(top[top[:, 2] > top[:, 2].max() - 1e-6], transform)
            x, _, depth = (corners.min(0) + corners.max(0)) / 2 * 1e3
            # Chords of the rim of washer or boss.
            assert (x, -depth) == (pytest.approx(taxel.x_mm, abs=0.02), pytest.approx(taxel.y_mm, abs=0.02))


def test_bill_of_materials(small_plan):
    rows = list(csv.DictReader(io.StringIO(bill_of_materials(small_plan, 3.21))))
    counts = {"washer": "4", "coil": "1", "plastic": "3.21", "screw": "4"}
    counts |= {"amplifier channel": "1", "sound card": "1", "wire": "2", "glue": "4"}
    assert {r["item"]: r["quantity"] for r in rows} == counts
    told = {r["item"]: r["what"] for r in rows}
    named = "; or ".join(f"{count} x {name}" for name, count in small_plan.parts.amplifiers.items())
    assert told["amplifier channel"].endswith(f"({named})")
    cards = "; or ".join(small_plan.parts.sound_cards)
    assert told["sound card"].startswith(f"1 outputs: {cards}; or a board with as many converters")


def test_a_file_that_reads_back_otherwise_is_refused(small_pad):
    good = stl_mesh(b"".join(stl_blocks(small_pad.mesh, "x")))
    verify_written("pad.stl", small_pad.mesh, good)
    with pytest.raises(GeometryError, match="read back, it has"):
        verify_written("pad.stl", small_pad.mesh, Mesh(good.vertices_mm, good.triangles[1:]))
    with pytest.raises(GeometryError, match="a corner has moved"):
        verify_written("pad.stl", small_pad.mesh, Mesh(good.vertices_mm * 1.01, good.triangles))


def test_manifest_holds_hashes_and_versions(folder):
    manifest = json.loads((folder / "manifest.json").read_text())
    assert set(manifest["files"]) == {p.name for p in folder.iterdir()} - {"manifest.json"}
    assert manifest["inputs"]["versions"]["numpy"] == np.__version__


def test_formats_are_parsed_in_order():
    assert parse_formats("stl, step") == ("step", "stl")
    with pytest.raises(SpecError, match=r"must be among 3mf, board, glb, step, stl, got 'stp'; did you mean 'step'\?"):
        parse_formats("stp")
    with pytest.raises(SpecError, match="must name"):
        parse_formats(",")


def test_picture_shows_the_nearer_part(monkeypatch):
    """From above a small level plate lies over a large tilted one, which is lit less, though it is drawn later."""
    from PIL import Image

    monkeypatch.setattr(_3mf, "AZIMUTH", 0.0)
    monkeypatch.setattr(_3mf, "ELEVATION", np.pi / 2)

    def plate(half, low, high):
        return [[-half, -half, low], [half, -half, high], [half, half, high], [-half, half, low]]

    def pixels(*plates):
        triangles = [[4 * k, 4 * k + corner, 4 * k + corner + 1] for k in range(len(plates)) for corner in (1, 2)]
        data = _3mf.picture_png(Mesh(np.concatenate(plates).astype(float), np.array(triangles)), (60, 40))
        assert data == _3mf.picture_png(Mesh(np.concatenate(plates).astype(float), np.array(triangles)), (60, 40))
        return np.asarray(Image.open(io.BytesIO(data)))

    level = plate(1, 6, 6)
    tilted = plate(3, -5, 5)
    image = pixels(level, tilted)
    assert image.shape == (40, 60, 3)
    assert image[20, 30].tolist() == pixels(level)[20, 30].tolist()
    assert image[20, 42].tolist() == pixels(tilted)[20, 30].tolist() < image[20, 30].tolist()
    assert image[2, 2].tolist() == [255, 255, 255]


def test_dropped_formats_leave_no_stale_files(tmp_path):
    spec = replace(parse_spec(SMALL), resonances_hz=None)
    path = tmp_path / "tiny"
    Pad(spec).save(path, ("stl", "step"))
    Pad(spec).save(path, ("stl",))
    assert not list(path.glob("*.step"))
