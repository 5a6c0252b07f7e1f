"""Boards as files: one piece of copper a coil, Gerbers that are the layout, and KiCad's own design rules."""

import json
import re
import subprocess
from dataclasses import replace
from itertools import pairwise, product
from math import floor, hypot
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import KDTree

import padgen as pg
from padgen.core.errors import InfeasibleError
from padgen.core.units import COPPER_OHM_M
from padgen.planner.board_layout import arc_centre, board_findings, board_of, coil_path
from padgen.planner.coils.board import board_coil, completed, house_of, resized, widest_mm
from padgen.planner.fixtures import board_parts, plan_spacer, spacer_findings
from padgen.planner.layout import coil_axis_mm
from padgen.planner.pad_mass import PadMass
from padgen.solid.formats import board as board_format
from padgen.solid.gerber import gerber_files
from padgen.solid.kicad import pcb_text, project_text
from padgen.solid.parts import _parts, check_foreign
from padgen.solid.spacer import build_spacer, check_spacer
from padgen.spec import catalogue, load_spec
from tests import gerber_pixels
from tests.board_oracles import points_of

PAD = {"name": "board", "resolution": 32, "band_hz": [80, 320], "q_min": 15, "delta_y": 5, "magnet": "disc-3x1"}


@pytest.fixture(scope="module")
def plan():
    return pg.plan({**PAD, "coil": {"kind": "board", "outer_diameter_mm": 9.6, "grid": [5, 4]}})


def pieces(board, net):
    """Return the number of pieces that a net's copper is in; vias and pins join all layers."""
    parent = {}

    def top(node):
        while parent.setdefault(node, node) != node:
            node = parent[node]
        return node

    for track in board.tracks:
        if track.net == net:
            parent[top((track.layer, track.start_mm))] = top((track.layer, track.end_mm))
    for joined in (*board.vias, *board.pins):
        if joined.net == net:
            for a, b in pairwise(range(board.layers)):
                parent[top((a, joined.at_mm))] = top((b, joined.at_mm))
    return len({top(node) for node in list(parent)})


def test_a_coil_is_one_piece_of_copper(plan):
    board = board_of(plan)
    assert [pieces(board, k + 1) for k in range(len(board.nets))] == [1] * len(board.nets)
    assert len(board.pins) == 2 * len(board.nets)
    for k in range(len(board.vias)):
        fewer = replace(board, vias=board.vias[:k] + board.vias[k + 1 :])
        assert pieces(fewer, board.vias[k].net) > 1
    fewer = replace(board, tracks=board.tracks[1:])
    assert pieces(fewer, board.tracks[0].net) > 1


def network_ohm(board, coil, net):
    """Return the resistance in Ω between a net's pins, by Kirchhoff's laws for all its tracks and plated holes."""
    ohm_m = 1.72e-8
    resistors = []
    for track in board.tracks:
        if track.net == net:
            length_mm = hypot(*np.subtract(track.end_mm, track.start_mm))
            if track.middle_mm is not None:
                centre = arc_centre(track.start_mm, track.middle_mm, track.end_mm)
                angles = [
                    np.arctan2(*np.subtract(p, centre)[::-1]) for p in (track.start_mm, track.middle_mm, track.end_mm)
                ]
                sweeps = [(later - first + np.pi) % (2 * np.pi) - np.pi for first, later in pairwise(angles)]
                length_mm = hypot(*np.subtract(track.start_mm, centre)) * abs(sum(sweeps))
            section = track.width_mm * 1e-3 * coil.copper[track.layer]
            ends = (track.layer, track.start_mm), (track.layer, track.end_mm)
            resistors.append((*ends, ohm_m * length_mm * 1e-3 / section))
    for hole in (*board.vias, *board.pins):
        if hole.net == net:
            drill = coil.drill if hasattr(hole, "size_mm") else board.connector.drill_mm * 1e-3
            barrel = np.pi * (drill - coil.plating) * coil.plating
            for a, b in pairwise(range(board.layers)):
                ohm = ohm_m * (coil.depth[b] - coil.depth[a]) / barrel
                resistors.append(((a, hole.at_mm), (b, hole.at_mm), ohm))
    nodes = {node: k for k, node in enumerate({node for *ends, _ in resistors for node in ends})}
    admittance = np.zeros((len(nodes), len(nodes)))
    for one, other, ohm in resistors:
        a = nodes[one]
        b = nodes[other]
        admittance[[a, b], [a, b]] += 1 / ohm
        admittance[[a, b], [b, a]] -= 1 / ohm
    first, last = (nodes[0, pin.at_mm] for pin in board.pins if pin.net == net)
    kept = [k for k in range(len(nodes)) if k != last]
    current = np.zeros(len(nodes))
    current[first] = 1.0
    return np.linalg.solve(admittance[np.ix_(kept, kept)], current[kept])[kept.index(first)]


@pytest.mark.parametrize("wiring", ["series", "parallel"])
def test_resistances_between_pins_are_those_of_all_that_is_drawn(plan, wiring):
    """A coil's own and its tracks' to the pins, within 0.5 %: the via in the bore of a parallel coil is a bound."""
    of_coil = completed({"kind": "board", "wiring": wiring, "gap_mm": plan.spec.coil.gap_mm})
    plan = replace(plan, spec=replace(plan.spec, coil=of_coil))
    board = board_of(plan)
    assert max(board.leads_ohm) > 0.05 * of_coil.resistance_ohm
    for net in (1, 4, len(board.nets)):
        stated = of_coil.resistance_ohm + board.leads_ohm[net - 1]
        assert network_ohm(board, board_coil(of_coil), net) == pytest.approx(stated, rel=0.005)


@pytest.mark.parametrize("shape", ["round", "rectangular"])
@pytest.mark.parametrize(
    ("wiring", "house"), [("series", "coil-0.15"), ("series", "fine-0.1"), ("parallel", "coil-0.15")]
)
def test_tracks_to_the_pins_keep_clear_of_the_turns(plan, wiring, house, shape):
    """KiCad does not look at distances within a net: all but the coil's last half turn is as far as the house asks."""
    given = {"kind": "board", "wiring": wiring, "house": house, "shape": shape, "gap_mm": plan.spec.coil.gap_mm}
    of_coil = completed(given)
    board = board_of(replace(plan, spec=replace(plan.spec, coil=of_coil)))
    for net, layer in product((1, 4, len(board.nets)), (0, board.layers - 1)):
        own = [track for track in board.tracks if (track.net, track.layer) == (net, layer)]
        row, column = divmod(net - 1, plan.coils.columns)
        path, _ = coil_path(board_coil(of_coil), net, coil_axis_mm(plan.coils, row, column))
        coils_own = [track for track in path if track.layer == layer]
        leads = [track for track in own if track not in coils_own]
        # Without the links to vias, and the last half turn.
        spiral = coils_own[: -1 - (wiring == "parallel")]
        turns = spiral[: -1 if shape == "round" else -4]
        assert len(leads) >= 3
        copper = KDTree(np.concatenate([points_of(track, 0.02) for track in turns]))
        for lead in leads:
            apart = copper.query(points_of(lead, 0.02))[0].min()
            assert apart - (lead.width_mm + of_coil.track_mm) / 2 > of_coil.space_mm - 0.005, (net, layer, lead)


def drawn(text):
    """Return what a Gerber file draws, as (start, middle, end) in mm with the middle of arcs, and its flashes."""
    at, turn, lines, flashes = None, None, [], 0
    for command in re.findall(r"^(?:G0[123]|X.*)\*$", text, re.M):
        if command.startswith("G"):
            turn = command[:3]
            continue
        x, y, i, j, code = re.fullmatch(r"X(-?\d+)Y(-?\d+)(?:I(-?\d+)J(-?\d+))?(D0[123])\*", command).groups()
        to = np.array([int(x), int(y)]) / 1e6
        if code == "D01":
            middle = None
            if i is not None:
                centre = at + np.array([int(i), int(j)]) / 1e6
                radius = hypot(*(at - centre))
                assert abs(radius - hypot(*(to - centre))) < 2e-6
                first, last = (np.arctan2(*(p - centre)[::-1]) for p in (at, to))
                sweep = (last - first) % (2 * np.pi) if turn == "G03" else -((first - last) % (2 * np.pi))
                middle = centre + radius * np.array([np.cos(first + sweep / 2), np.sin(first + sweep / 2)])
            lines.append((at, middle, to))
        flashes += code == "D03"
        at = to
    return lines, flashes


def test_gerbers_are_the_layout(plan):
    board = board_of(plan)
    files = gerber_files(board)
    for k in range(board.layers):
        lines, flashes = drawn(files[f"copper-{k + 1}.gbr"])
        own = [track for track in board.tracks if track.layer == k]
        assert len(lines) == len(own) and flashes == len(board.vias) + len(board.pins)
        for (start, middle, end), track in zip(lines, own, strict=True):
            assert start == pytest.approx(track.start_mm, abs=1e-6) and end == pytest.approx(track.end_mm, abs=1e-6)
            assert (middle is None) == (track.middle_mm is None)
            if middle is not None:
                assert middle == pytest.approx(track.middle_mm, abs=5e-6)
    holes = files["plated.drl"].count("\nX")
    assert holes == len(board.vias) + len(board.pins) and files["holes.drl"].count("\nX") == 4


def test_files_are_written_and_the_same_again(plan):
    written = []
    for _ in range(2):
        files = {}
        job = SimpleNamespace(plan=plan, pad=True)
        board_format.write(SimpleNamespace(write=files.__setitem__), job)
        written.append(files)
    assert written[0] == written[1]
    assert {"board.kicad_pcb", "board.kicad_pro", "board.svg", "board.txt", "board-parts.csv"} < written[0].keys()
    text = written[0]["board.kicad_pcb"]
    assert text.count("(") == text.count(")")
    rules = json.loads(written[0]["board.kicad_pro"])["board"]["design_settings"]["rules"]
    house = catalogue("board_house")["coil-0.15"]
    assert (rules["min_clearance"], rules["min_track_width"]) == (house["space_mm"], house["track_mm"])


def test_connectors_of_the_catalogue(plan):
    """JST's PHD: rows and pins 2 mm apart, 4 to 17 columns; pads as wide as the house's ring round a hole asks."""
    for house, pad_mm in (("coil-0.15", 1.2), ("heavy-0.2", 1.26)):
        coil = completed({"kind": "board", "house": house, "gap_mm": 1.0, "connector": "jst-phd"})
        coil = resized(coil, (9.6, 9.6)) if house == "coil-0.15" else resized(coil, (8.0, 8.0))
        spec = replace(plan.spec, coil=coil)
        four = replace(plan, spec=spec, coils=replace(plan.coils, rows=4, columns=4))
        board = board_of(four)
        assert len(board.pins) == 32 and board.connector.pad_mm == pad_mm
        first, second = (np.array([pin.at_mm for pin in board.pins if pin.row == row]) for row in (0, 1))
        assert np.diff(first[:, 0]) == pytest.approx([2.0] * 15)
        assert first - second == pytest.approx(np.tile([0.0, 2.0], (16, 1)))
        text = gerber_files(board)["plated.drl"]
        assert "C0.75" in text
        sockets, spacers = board_parts(four)
        assert sockets == ("connector", 1, "pieces", "JST B32B-PHDSS, vertical; plug PHDR-32VS with wires crimped")
        assert spacers[:2] == ("spacer", 4) and spacers[3].startswith("0.9 mm")
    few = replace(plan, spec=spec, coils=replace(plan.coils, rows=1, columns=3))
    with pytest.raises(InfeasibleError, match=r"coil\.connector: must be one of fewer pins than 'jst-phd'"):
        board_of(few)
    (finding,) = board_findings(few)
    assert finding.code == "board.room" and {"coil.connector": "header-2.54"} in finding.cures


def test_refusals_of_boards(plan):
    wound = replace(plan, spec=replace(plan.spec, coil=replace(plan.spec.coil, kind="solenoid")))
    with pytest.raises(InfeasibleError, match=r"coil\.kind: must be 'board'"):
        board_of(wound)
    wide = replace(plan, spec=replace(plan.spec, pad=replace(plan.spec.pad, width_mm=450.0)))
    with pytest.raises(InfeasibleError, match=r"pad\.width_mm: must be at most 400 mm long"):
        board_of(wide)
    close = replace(plan, coils=replace(plan.coils, pitch_x_mm=10.0))
    with pytest.raises(InfeasibleError, match=r"coil\.outer_diameter_mm: must be at most .* room for 5 tracks"):
        board_of(close)
    many = replace(plan, coils=replace(plan.coils, rows=50, columns=5))
    with pytest.raises(InfeasibleError, match=r"coil"):
        board_of(many)


def drc(*boards):
    script = "tests/kicad_drc.py"
    ran = subprocess.run(["/usr/bin/python3", script, *map(str, boards)], capture_output=True, text=True, check=True)
    return [json.loads(line) for line in ran.stdout.splitlines() if line.startswith("{")]


def save(folder, name, board, house):
    (folder / f"{name}.kicad_pro").write_text(project_text(board, house))
    path = folder / f"{name}.kicad_pcb"
    path.write_text(pcb_text(board))
    return path


def random_plan(plan, rng, is_widest):
    """Return a plan of random board coils, or the widest, on a random grid; only what the board is made of."""
    house = catalogue("board_house")[rng.choice(list(catalogue("board_house")))]
    rows, columns = int(rng.integers(1, 6)), int(rng.integers(1, 7))
    coil = completed(
        {
            "kind": "board",
            "house": house["name"],
            "layers": int(rng.choice(house["layers"])),
            "wiring": str(rng.choice(["series", "parallel"])),
            "shape": str(rng.choice(["round", "rectangular"])),
            "connector": "jst-phd" if 4 <= rows * columns <= 17 and rng.random() < 0.5 else "header-2.54",
            "outer_diameter_mm": float(rng.uniform(7, 14)),
            "length_mm": float(rng.choice(house["thickness_mm"])),
        }
    )
    beside = rows * coil.track_mm + (rows + 1) * coil.space_mm
    pitch_x = coil.outer_diameter_mm + beside * float(rng.uniform(1.1, 3))
    pitch_y = coil.outer_diameter_mm + 2 * coil.space_mm + float(rng.uniform(0, 3))
    coils = replace(plan.coils, rows=rows, columns=columns, pitch_x_mm=pitch_x, pitch_y_mm=pitch_y)
    pad = replace(plan.spec.pad, width_mm=columns * pitch_x, depth_mm=rows * pitch_y)
    if is_widest:
        widest = widest_mm(coil, pad, rows, columns)
        coil = resized(coil, tuple(floor(side_mm * 10) / 10 for side_mm in widest))
    return replace(plan, spec=replace(plan.spec, coil=coil, pad=pad), coils=coils)


@pytest.mark.kicad
def test_kicad_finds_nothing_on_boards(plan, tmp_path):
    rng = np.random.default_rng(36)
    templates = [pg.plan(name) for name in ("board-32", "fingertip-board-24")]
    paths = [save(tmp_path, each.name, board_of(each), house_of(each.spec.coil)) for each in templates]
    refused = 0
    while len(paths) < 32:
        other = random_plan(plan, rng, is_widest=len(paths) % 2 == 0)
        try:
            board = board_of(other)
        except InfeasibleError:
            refused += 1
            continue
        assert [pieces(board, k + 1) for k in range(len(board.nets))] == [1] * len(board.nets)
        paths.append(save(tmp_path, f"random-{len(paths)}", board, house_of(other.spec.coil)))
    print(f"{refused} random boards were refused")
    found = drc(*paths)
    assert len(found) == len(paths)
    assert [one for one in found if one["counts"] != [0, 0, 0] or one["clearance_nm"] <= 0] == []


@pytest.mark.kicad
def test_kicad_finds_what_is_broken(plan, tmp_path):
    board = board_of(plan)
    house = house_of(plan.spec.coil)
    lane = max(
        (k for k, track in enumerate(board.tracks) if track.middle_mm is None),
        key=lambda k: hypot(*np.subtract(board.tracks[k].end_mm, board.tracks[k].start_mm)),
    )
    track = board.tracks[lane]
    wider = (*board.tracks[:lane], track._replace(width_mm=track.width_mm + 0.2), *board.tracks[lane + 1 :])
    broken = {
        "clearance": replace(board, tracks=wider),
        "open": replace(board, tracks=board.tracks[:lane] + board.tracks[lane + 1 :]),
        "via": replace(board, vias=board.vias[1:]),
    }
    found = drc(*(save(tmp_path, name, each, house) for name, each in broken.items()))
    kinds = [set(one["kinds"]) for one in found]
    assert "clearance" in kinds[0] and found[0]["counts"][0] > 0
    assert found[1]["counts"][1] > 0 and found[2]["counts"][1] > 0


@pytest.mark.kicad
@pytest.mark.parametrize(
    ("coil", "reader"),
    [
        ({"outer_diameter_mm": 6}, gerber_pixels.picture),
        ({"outer_diameter_mm": 8, "house": "heavy-0.2", "wiring": "parallel"}, gerber_pixels.gerbonara_picture),
        ({"outer_diameter_mm": 6, "shape": "rectangular"}, gerber_pixels.gerbonara_picture),
        (
            {"outer_diameter_mm": 8, "outer_depth_mm": 7, "house": "heavy-0.2", "shape": "rectangular"},
            gerber_pixels.picture,
        ),
    ],
)
def test_nets_have_their_resistance_in_pictures_of_the_gerbers(coil, reader, tmp_path):
    """Within 3 %: in a lattice of 5 µm curved tracks resist some 1 % too much, and pads round holes shorten the way."""
    plan = pg.plan({**PAD, "resolution": 1, "coil": {"kind": "board", "grid": [1, 1], **coil}, "pad": {"width_mm": 28}})
    board = board_of(plan)
    copper = board_coil(plan.spec.coil)
    for name, text in gerber_files(board).items():
        (tmp_path / name).write_text(text)
    left, near, right, far = board.outline_mm
    pixel_mm = 0.005
    layers = [
        reader(tmp_path / f"copper-{k + 1}.gbr", (left, near), (right - left, far - near), pixel_mm)
        for k in range(board.layers)
    ]
    holes = []
    for hole in (*board.vias, *board.pins):
        drill_mm = hole.drill_mm if hole in board.vias else board.connector.drill_mm
        barrel = gerber_pixels.barrel_ohms(copper.depth, drill_mm * 1e-3, copper.plating, COPPER_OHM_M)
        holes.append((*hole.at_mm, drill_mm, barrel))
    sheet_ohm = [COPPER_OHM_M / thickness for thickness in copper.copper]
    pins = (len(holes) - 2, len(holes) - 1)
    seen_ohm = gerber_pixels.pixel_ohm(layers, sheet_ohm, holes, (left, near), pixel_mm, pins)
    assert seen_ohm == pytest.approx(plan.spec.coil.resistance_ohm + board.leads_ohm[0], rel=0.03)


def test_a_board_weighs_what_its_outline_says(plan):
    """Laminate of 1.85 g/cm³ within the outline's file, its screw holes not drilled."""
    board = board_of(plan)
    corners = np.array(re.findall(r"X(-?\d+)Y(-?\d+)D0[12]\*", gerber_files(board)["outline.gbr"]), float) / 1e6
    x, y = corners.T
    area_mm2 = abs((x * np.roll(y, 1) - y * np.roll(x, 1)).sum()) / 2
    body = PadMass(plan).board
    assert body.mass == pytest.approx(area_mm2 * plan.spec.coil.length_mm * 1.85e-6, rel=1e-9)
    assert body.centroid[1] == pytest.approx((y.min() + y.max()) / 2 * 1e-3)  # nearer to the pins than the pad's centre
    assert PadMass(plan).whole.mass == pytest.approx(PadMass(plan).pad.mass + PadMass(plan).coils.mass + body.mass)


def test_a_spacer_lies_between_board_and_pad(plan):
    """Its volume by hand; a mesh that is higher, or has narrower holes, is told; turned it is recognised."""
    spacer = build_spacer(plan)
    sizes = spacer.spacer
    pad = plan.spec.pad
    assert (sizes.height_mm, sizes.gap_mm) == pytest.approx((0.9, plan.spec.coil.gap_mm))
    x_mm, y_mm = (side + 2 * pad.border_mm for side in (pad.width_mm, pad.depth_mm))
    corner = 4 - np.pi
    area_mm2 = x_mm * y_mm - corner * (pad.border_mm / 2) ** 2 - pad.width_mm * pad.depth_mm
    area_mm2 -= np.pi * pad.hole_diameter_mm**2
    groove = sizes.groove
    area_mm2 -= (groove.x1 - groove.x0) * (groove.y1 - max(groove.y0, -y_mm / 2))
    assert spacer.volume_mm3 == pytest.approx(area_mm2 * 0.9, rel=1e-6)
    assert not [one for one in check_spacer(spacer, plan).findings if one.level != "note"]
    mesh = spacer.mesh
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = mesh._replace(vertices_mm=mesh.vertices_mm @ turn.T + 20.0)
    assert check_foreign(turned, plan.spec, plan).figures["part"] == "spacer"
    higher = mesh._replace(vertices_mm=mesh.vertices_mm * [1.0, 1.0, 1.1])
    narrow = build_spacer(replace(plan, spec=replace(plan.spec, pad=replace(pad, hole_diameter_mm=3.0)))).mesh
    for other, size in ((higher, "height"), (narrow, "hole diameter")):
        told = [one for one in check_spacer(spacer, plan, other).findings if one.code == "spacer.built"]
        assert told and all(size in one.message for one in told)


def test_a_spacer_in_other_layers_makes_another_gap(plan):
    finer = replace(plan, spec=replace(plan.spec, coil=replace(plan.spec.coil, gap_mm=0.84)))
    assert plan_spacer(finer).height_mm == pytest.approx(0.7)  # in layers of 0.1 mm, the first of 0.2
    between = replace(plan, spec=replace(plan.spec, coil=replace(plan.spec.coil, gap_mm=0.85)))
    assert plan_spacer(between).height_mm == pytest.approx(0.8)
    (finding,) = spacer_findings(finer, plan_spacer(finer))
    assert finding.code == "spacer.gap" and "gap comes out as 0.8 mm" in finding.message
    wound = replace(plan, spec=replace(plan.spec, coil=replace(plan.spec.coil, kind="solenoid")))
    with pytest.raises(InfeasibleError, match="wound coils need no spacer"):
        plan_spacer(wound)
    touching = replace(plan, spec=replace(plan.spec, coil=replace(plan.spec.coil, gap_mm=0.1)))
    with pytest.raises(InfeasibleError, match=r"coil\.gap_mm: must be at least 0\.3 mm for a layer between"):
        plan_spacer(touching)
    assert [name for name, *_ in _parts(touching)] == ["pad", "coupon"]  # a mesh is still compared with those it has
    assert [one.code for one in board_findings(touching)] == ["board.room"]
    close = replace(plan, spec=replace(plan.spec, coil=replace(plan.spec.coil, gap_mm=0.4)))
    loud = replace(close, channels=tuple(replace(channel, level_um=320.0) for channel in close.channels))
    assert [one.code for one in spacer_findings(loud, plan_spacer(loud))] == ["spacer.clear"]


def test_a_plan_tells_that_its_board_has_no_room_for_tracks():
    """Beside the last column, the heads of the screws leave less than three tracks of 0.2 mm and their spaces take."""
    spec = load_spec("fingertip-board-24")
    narrow = replace(spec, coil=replace(spec.coil, grid=(3, 4)), pad=replace(spec.pad, width_mm=54.0, depth_mm=46.0))
    finding = next(one for one in pg.plan(narrow).findings if one.code == "board.room")
    assert finding.level == "error"
    assert "tracks beside a column of coils" in finding.message
    assert all(one.code != "board.room" for one in pg.plan(spec).findings)
