"""The 3-D scene of a pad: the circuit board under it, with its copper where the board's files have it."""

from math import dist

import numpy as np
import pytest

import padgen as pg
from padgen.planner.board_layout import board_of, coil_path
from padgen.planner.coils.board import board_coil
from padgen.solid.formats.glb import COLOURS
from padgen.solid.mesh import signed_volume_mm3
from padgen.solid.scene import scene_parts


@pytest.fixture(scope="module")
def plan():
    return pg.plan("board-32")


@pytest.fixture(scope="module")
def parts(plan):
    return {part.name: part for part in scene_parts(plan)}


def length_mm(track):
    """Return the length of a track: of an arc by the angle that its chord and its middle span."""
    straight = dist(track.start_mm, track.end_mm)
    if track.middle_mm is None:
        return straight
    half = dist(track.start_mm, track.middle_mm)
    other = dist(track.middle_mm, track.end_mm)
    # Circle through three points: the product of the sides over four times the triangle's area.
    (ax, ay), (bx, by), (cx, cy) = track.start_mm, track.middle_mm, track.end_mm
    area = abs((bx - ax) * (cy - ay) - (cx - ax) * (by - ay)) / 2
    radius = straight * half * other / (4 * area)
    return 2 * radius * (np.arcsin(half / 2 / radius) + np.arcsin(other / 2 / radius))


def test_the_board_lies_the_gap_below_the_magnets(plan, parts):
    top_mm = plan.spec.mover_low_mm - plan.spec.coil.gap_mm
    board, winding, spacer = (parts[name].mesh.vertices_mm for name in ("board", "winding", "spacer"))
    assert winding[:, 2].max() == pytest.approx(top_mm, abs=1e-6)
    assert winding[:, 2].min() == pytest.approx(board[:, 2].max(), abs=1e-6)
    assert board[:, 2].min() == pytest.approx(top_mm - plan.spec.coil.length_mm, abs=1e-6)
    assert (spacer[:, 2].min(), spacer[:, 2].max()) == pytest.approx((top_mm, 0.0), abs=1e-6)
    low_x, low_y, high_x, high_y = board_of(plan).outline_mm
    assert [*board.min(0)[:2], *board.max(0)[:2]] == pytest.approx([low_x, low_y, high_x, high_y], abs=1e-6)
    coils = plan.coils.rows * plan.coils.columns
    assert len(parts["winding"].places) == len({place.name for place in parts["winding"].places}) == coils


def test_a_spiral_has_the_copper_of_its_tracks(plan, parts):
    coil = board_coil(plan.spec.coil)
    tracks = [track for track in coil_path(coil, 1, (0.0, 0.0))[0] if track.layer == 0]
    volume_mm3 = sum(map(length_mm, tracks)) * tracks[0].width_mm * coil.copper[0] * 1e3
    assert len(tracks) > 20
    # Sixteen chords of half a circle are 0.2 % short, and the track is 0.5 % narrower between their ends.
    assert signed_volume_mm3(parts["winding"].mesh) == pytest.approx(volume_mm3, rel=0.012)


def test_lanes_reach_the_pins(plan, parts):
    """Every pin whose track comes in on top is met by copper."""
    board = board_of(plan)
    corners = parts["lanes"].mesh.vertices_mm[:, :2]
    ends = {end for track in board.tracks if track.layer == 0 for end in (track.start_mm, track.end_mm)}
    on_top = [pin.at_mm for pin in board.pins if pin.at_mm in ends]
    assert len(on_top) >= len(board.pins) / 4
    for at in on_top:
        assert np.hypot(*(corners - at).T).min() < board.tracks[0].width_mm * 4


def test_only_pads_with_board_coils_have_a_board_and_all_parts_a_colour(plan, parts, small_plan):
    wound = scene_parts(small_plan)
    assert "board" not in {part.material for part in wound}
    assert {part.material for part in (*parts.values(), *wound)} <= COLOURS.keys()
    assert "tray" not in {part.material for part in parts.values()}
