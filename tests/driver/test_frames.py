"""Images, tables and states become levels of taxels at their places."""

import os
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

import padgen as pg
from padgen.core.errors import FileError, SpecError
from padgen.driver import frames as frames_module
from padgen.driver.frames import (
    frames_text,
    pattern_frames,
    read_frames,
    state_frames,
    taxel_grid,
    text_frames,
)
from padgen.planner import Plan, drive_scheme, make_plan
from padgen.spec import load_spec, parse_spec

TURNED = (
    'name = "t"\nresolution = 11\nband_hz = [50, 400]\nq_min = 15\n'
    '[pad]\nwidth_mm = 24\ndepth_mm = 40\n[coil]\ngrid = [2, 2]\nreuse = "alternate"\n'
)
"""Two sets of three channels with cells of odd columns turned and one place empty, shown as 6 x 2."""


def turned_plan() -> Plan:
    """Return the plan of `TURNED` with cells of odd columns turned, though others are farther apart unturned."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drive_scheme, "TURNS", ("odd columns",))
        return make_plan(parse_spec(TURNED))


@pytest.fixture(scope="module")
def plan() -> Plan:
    made = turned_plan()
    assert made.reuse.turned == "odd columns" and made.coils.sets == 2 and len(made.taxels) == 11
    return made


def picture(values: np.ndarray, mode: str) -> Image.Image:
    return Image.fromarray(np.asarray(values, np.uint8)).convert(mode)


LEVELS = np.array([[0, 255], [51, 0], [0, 102], [255, 0], [0, 0], [153, 204]])


@pytest.mark.parametrize("name", ["paper-16", "paper-32", "quad-64", "wide-11", "turned"])
def test_a_taxel_is_at_its_place_in_the_image(name):
    """Places are compared with the washers', which lie a quarter of a sub-cell or more inside it."""
    plan = turned_plan() if name == "turned" else pg.plan(load_spec(name))
    grid = taxel_grid(plan)
    pad = plan.spec.pad
    assert sorted(grid[grid >= 0]) == list(range(len(plan.taxels)))
    for index, taxel in enumerate(plan.taxels):
        row = int((pad.depth_mm / 2 - taxel.y_mm) // plan.cell.depth_mm)
        column = int((taxel.x_mm + pad.width_mm / 2) // plan.cell.width_mm)
        assert grid[row, column] == index


def test_grid_of_the_papers_pad(paper_plan):
    """Two channels lie above each other, channel 0 below: the image's last row is channel 0 of the first coils."""
    ids = [[paper_plan.taxels[k].id for k in row] for row in taxel_grid(paper_plan)]
    assert ids[-1] == ["r0c0k0", "r0c1k0", "r0c2k0", "r0c3k0"]
    assert ids[0] == ["r3c0k1", "r3c1k1", "r3c2k1", "r3c3k1"]


def seen(plan: Plan, levels: np.ndarray) -> np.ndarray:
    """Return the levels of taxels as an image, 0 where there is no taxel."""
    grid = taxel_grid(plan)
    return np.where(grid >= 0, levels[grid], 0.0)


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "P", "LA"])
def test_png_of_any_mode(plan, tmp_path, mode):
    picture(LEVELS, mode).save(tmp_path / "a.png")
    found = read_frames(tmp_path / "a.png", plan)
    assert found.levels.shape == (1, 11)
    # Exact: bytes over 255 in double precision.
    assert np.abs(seen(plan, found.levels[0]) - LEVELS * (taxel_grid(plan) >= 0) / 255).max() < 1e-12


def test_png_of_one_and_of_sixteen_bits(plan, tmp_path):
    grid = taxel_grid(plan)
    Image.fromarray(LEVELS > 100).save(tmp_path / "one.png")
    Image.fromarray((LEVELS * 200).astype(np.uint16)).save(tmp_path / "deep.png")
    one, deep = (read_frames(tmp_path / name, plan).levels[0] for name in ("one.png", "deep.png"))
    assert np.array_equal(seen(plan, one), (LEVELS > 100) & (grid >= 0))
    assert np.abs(seen(plan, deep) - LEVELS * 200 * (grid >= 0) / 65535).max() < 1e-12


def test_colour_is_luminance_and_transparent_is_dark(plan, tmp_path):
    pixels = np.zeros((6, 2, 4), np.uint8)
    pixels[3, 0], pixels[3, 1], pixels[4, 0] = (255, 0, 0, 255), (0, 255, 0, 255), (0, 0, 255, 255)
    pixels[4, 1], pixels[5, 0] = (255, 255, 255, 0), (255, 255, 255, 102)
    Image.fromarray(pixels, "RGBA").save(tmp_path / "a.png")
    image = seen(plan, read_frames(tmp_path / "a.png", plan).levels[0])
    assert image[3:].ravel() == pytest.approx([0.299, 0.587, 0.114, 0, 0.4, 0], abs=1e-12)


@pytest.mark.parametrize("suffix", ["png", "gif"])
def test_animations_are_frames(plan, tmp_path, suffix):
    shots = [picture(np.roll(LEVELS, k, axis=0), "L") for k in range(3)]
    shots[0].save(tmp_path / f"a.{suffix}", save_all=True, append_images=shots[1:])
    levels = read_frames(tmp_path / f"a.{suffix}", plan).levels
    assert len(levels) == 3
    for k, frame in enumerate(levels):
        wanted = np.roll(LEVELS, k, axis=0) * (taxel_grid(plan) >= 0) / 255
        assert np.abs(seen(plan, frame) - wanted).max() < 1e-12


def test_the_still_picture_of_an_animation_is_not_played(plan, tmp_path):
    shots = [picture(np.roll(LEVELS, k, axis=0), "L") for k in range(3)]
    shots[0].save(tmp_path / "a.png", save_all=True, append_images=shots[1:], default_image=True)
    levels = read_frames(tmp_path / "a.png", plan).levels
    assert len(levels) == 2
    assert seen(plan, levels[0]) == pytest.approx(np.roll(LEVELS, 1, axis=0) * (taxel_grid(plan) >= 0) / 255)


TABLES = {
    "comma.csv": "0,1\n0.25,0\n0,0\n1,0\n0,0\n0,.5\n\n\n1,1\n1,1\n1,1\n1,1\n1,1\n1,1\n",
    "semicolon.csv": "\ufeff0;1\r\n0.25;0\r\n0; 0\r\n1;0\r\n0;0\r\n0;5e-1\r\n;\r\n" + "\r\n".join(["1;1"] * 6),
    "tab.tsv": "0\t1\n0.25\t0\n0\t0\n1\t0\n0\t0\n0\t0.5\n\n1\t1\n1\t1\n1\t1\n1\t1\n1\t1\n1\t1\n",
    "blank.csv": " 0 1\n0.25  0\n0 0\n1 0\n0 0\n0 0.5\n   \n1 1\n1 1\n1 1\n1 1\n1 1\n1 1\n",
    "numbers.txt": "0,1\n0.25,0\n0,0\n1,0\n0,0\n0,0.5\n\n1,1\n1,1\n1,1\n1,1\n1,1\n1,1\n",
}


@pytest.mark.parametrize("name", TABLES)
def test_tables_of_numbers(plan, tmp_path, name):
    (tmp_path / name).write_bytes(TABLES[name].encode())
    first, second = read_frames(tmp_path / name, plan).levels
    wanted = np.array([[0, 1], [0.25, 0], [0, 0], [1, 0], [0, 0], [0, 0.5]]) * (taxel_grid(plan) >= 0)
    assert np.array_equal(seen(plan, first), wanted)
    assert second.min() == 1


SIGNS = {
    "digits": "01\n10\n00\n11\n00\n01\n",
    "signs": ".#\n#.\n..\n##\n..\n.#\n",
    "apart": "0 1\n1 0 \n0 0\n1 1\n0 0\n0 1\n",
    "blanks": " #\n#\n  \n##\n  \n #\n",
}


@pytest.mark.parametrize("name", SIGNS)
def test_matrices_of_signs(plan, tmp_path, name):
    (tmp_path / "a.txt").write_text(SIGNS[name])
    (levels,) = read_frames(tmp_path / "a.txt", plan).levels
    wanted = np.array([[0, 1], [1, 0], [0, 0], [1, 1], [0, 0], [0, 1]]) * (taxel_grid(plan) >= 0)
    assert np.array_equal(seen(plan, levels), wanted)


@pytest.mark.parametrize(
    ("kind", "full"), [("bool", 1), ("float64", 1), ("float16", 1), ("uint8", 255), (">u2", 65535), ("int64", 1)]
)
def test_numpy_arrays_are_scaled_by_their_kind(plan, tmp_path, kind, full):
    array = (np.arange(36).reshape(3, 6, 2) % 2 * full).astype(kind)
    np.save(tmp_path / "a.npy", np.asfortranarray(array))
    np.save(tmp_path / "b.npy", array[1])
    levels = read_frames([tmp_path / "a.npy", tmp_path / "b.npy"], plan).levels
    assert levels.shape == (4, 11)
    for frame in levels:
        assert np.array_equal(seen(plan, frame), (array[0] > 0) & (taxel_grid(plan) >= 0))


def test_folders_and_patterns_come_in_order(plan, tmp_path):
    for k in (10, 2, 1):
        (tmp_path / f"f{k}.csv").write_text(f"0.{k:02}, 0\n" * 6)
    (tmp_path / "note.md").write_text("not a frame")
    for given_ in (tmp_path, f"{tmp_path}/f*.csv", [f"{tmp_path}/f?.csv", tmp_path / "f10.csv"]):
        levels = read_frames(given_, plan).levels
        assert levels.max(axis=1) == pytest.approx([0.01, 0.02, 0.10])
    with pytest.raises(FileError, match=r"note\.md: is none of the files that hold frames: \.csv"):
        read_frames(tmp_path / "note.md", plan)


def test_light_without_a_taxel_is_counted(plan, tmp_path):
    assert np.argwhere(taxel_grid(plan) < 0).tolist() == [[1, 1]]
    (tmp_path / "a.txt").write_text("00\n01\n00\n00\n00\n00\n\n11\n11\n11\n11\n11\n11\n")
    found = read_frames(tmp_path / "a.txt", plan)
    assert found.levels.tolist() == [[0] * 11, [1] * 11]
    (note,) = found.notes
    assert "left out: 2; the first is" in note and note.endswith("a.txt, frame 1, row 2, column 2")
    (tmp_path / "b.txt").write_text("11\n10\n11\n11\n11\n11\n")
    assert read_frames(tmp_path / "b.txt", plan).notes == ()


ROWS = "0,0\n" * 5
BAD = {
    "a.csv": [
        (b"0,0,0\n0,0,0\n", r"frame 1 has 2 rows of 3; the pad shows 6 rows of 2 pixels: 2 x 2 coils of 3 x 1 taxels"),
        (ROWS.encode() + b"0,nan\n", r"frame 1, row 6, column 2 must be a level in 0 … 1, got nan$"),
        (ROWS.encode() + b"0,1.5\n", r"frame 1, row 6, column 2 must be a level in 0 … 1, got 1.5; 1 would do"),
        (ROWS.encode() + b"-1,0\n", r"frame 1, row 6, column 1 must be a level in 0 … 1, got -1; 0 would do"),
        (
            ROWS.encode() + b"0,0\n\n" + ROWS.encode() + b"0,x\n",
            r"frame 2, row 6, column 2 must be a number in 0 … 1, got 'x'",
        ),
        (
            b"0;0,5\n",
            r"frame 1, row 1, column 2 must be a number in 0 … 1, got '0,5'; decimals take a point|has 1 row of 2",
        ),
        (ROWS.replace(",", ";").encode() + b"0;0,5\n", r"row 6, column 2 .* got '0,5'; decimals take a point"),
        (ROWS.encode() + b"0,\n", r"frame 1, row 6, column 2 must be a number in 0 … 1, is empty"),
        (ROWS.encode() + b"0,1_0\n", r"got '1_0'"),
        (b"0,0\n0,0,0\n", r"frame 1, row 2 has 3 numbers, its row 1 has 2; all must have as many"),
        (b"", r"is empty; a frame is due"),
        (b"\n \n,\n", r"is empty; a frame is due"),
        (b"\xff\xfe0\x00", r"is not text: byte 0 is not UTF-8"),
    ],
    "a.txt": [
        (b"01\n0x\n00\n00\n00\n00\n", r"frame 1, row 2, column 2 must be 1 or # for ON.* got 'x'; numbers go into a"),
        (b"01\n0\n", r"frame 1, row 2 has 1 signs, its row 1 has 2"),
        (b"01\n", r"frame 1 has 1 row of 2; the pad shows 6 rows of 2"),
    ],
    "a.png": [
        (b"", r"is not a PNG or GIF picture"),
        (b"GIF89a", r"picture"),
        (b"no picture at all", r"is not a PNG or GIF picture"),
    ],
    "a.npy": [
        (b"", r"is not a NumPy array of numbers"),
        (b"PK\x03\x04", r"is not a NumPy array|cannot be read"),
        (b"\x93NUMPY\x01\x00", r"is not a NumPy array of numbers"),
    ],
}


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [(name, content, sentence) for name, cases in BAD.items() for content, sentence in cases],
)
def test_bad_files_are_refused_in_a_sentence(plan, tmp_path, name, content, sentence):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FileError, match=sentence) as error:
        read_frames(tmp_path / name, plan)
    assert str(error.value).startswith(str(tmp_path / name))


@pytest.mark.parametrize(
    ("array", "sentence"),
    [
        (np.zeros(11), r"must have the shape \(rows, columns\) or \(frames, rows, columns\), has \(11,\)"),
        (np.zeros((6, 2), complex), r"must be an array of truth values or real numbers, holds complex128"),
        (np.full((6, 2), 2), r"row 1, column 1 must be 0 or 1 in an array of whole numbers .* got 2"),
        (np.full((6, 2), np.inf), r"frame 1, row 1, column 1 must be a level in 0 … 1, got inf; 1 would do"),
        (np.zeros((2, 2, 6)), r"frame 1 has 2 rows of 6; the pad shows 6 rows of 2"),
        (np.array([["a"]]), r"holds <U1"),
    ],
)
def test_bad_arrays_are_refused_in_a_sentence(plan, tmp_path, array, sentence):
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(FileError, match=sentence):
        read_frames(tmp_path / "a.npy", plan)


def test_damaged_pictures_are_refused_in_a_sentence(plan, tmp_path):
    picture(LEVELS, "RGB").save(tmp_path / "whole.png")
    whole = (tmp_path / "whole.png").read_bytes()
    for length in range(8, len(whole) - 24, 7):
        (tmp_path / "a.png").write_bytes(whole[:length])
        with pytest.raises(FileError, match=r"is a damaged picture|is not a PNG or GIF picture"):
            read_frames(tmp_path / "a.png", plan)


@pytest.mark.parametrize("suffix", ["png", "gif", "npy"])
def test_damaged_bytes_end_in_a_sentence_or_in_a_frame(plan, tmp_path, suffix):
    """A decoder may not notice bytes overwritten anywhere, but nothing except a refusal or a frame may result."""
    path = tmp_path / f"a.{suffix}"
    refused = 0
    if suffix == "npy":
        np.save(path, LEVELS.astype(np.uint8))
    else:
        picture(LEVELS, "P").save(path, save_all=True, append_images=[picture(LEVELS[::-1], "P")])
    whole = path.read_bytes()
    random = np.random.default_rng(1)
    for k in range(150):
        spoiled = np.frombuffer(whole, np.uint8).copy()
        spoiled[random.integers(len(whole), size=2)] = random.integers(256, size=2)
        path.write_bytes(spoiled.tobytes()[: random.integers(len(whole)) if k % 3 == 0 else None])
        try:
            read_frames(path, plan)
        except FileError:
            refused += 1
    assert refused > 30


def test_a_vast_picture_is_refused_before_it_is_decoded(plan, tmp_path):
    """The header says 30,000 x 30,000; Pillow only warns of that, and refuses twice as much."""
    picture(LEVELS, "L").save(tmp_path / "a.png")
    whole = bytearray((tmp_path / "a.png").read_bytes())
    import struct
    import zlib

    for side, sentence in (
        (12_000, "frame 1 has 12000 rows of 12000; the pad shows 6 rows of 2"),
        (30_000, "of more pixels"),
    ):
        whole[16:24] = struct.pack(">II", side, side)
        whole[29:33] = struct.pack(">I", zlib.crc32(whole[12:29]))
        (tmp_path / "a.png").write_bytes(whole)
        with pytest.raises(FileError, match=sentence):
            read_frames(tmp_path / "a.png", plan)


@pytest.mark.parametrize(
    ("given_", "sentence"),
    [
        ("nowhere.png", "nowhere.png: there is no such file"),
        ("nowhere*.png", "no file has such a name"),
        ("", "must name a file, got ''"),
        ("a\0b.png", "must name a file"),
        ([], "must name a file, a folder or a pattern"),
    ],
)
def test_files_that_are_not_there(plan, given_, sentence):
    with pytest.raises(FileError, match=sentence):
        read_frames(given_, plan)


def test_an_empty_folder_says_what_would_be_read(plan, tmp_path):
    with pytest.raises(FileError, match=r"holds no frames; \.csv, \.gif, \.npy, \.png, \.tsv, \.txt files are read"):
        read_frames(tmp_path, plan)


def test_too_many_frames(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(frames_module, "MOST_LEVELS", 40)
    np.save(tmp_path / "a.npy", np.zeros((5, 6, 2)))
    with pytest.raises(FileError, match="at most 3 frames of 11 taxels are read at once; frame 4 is one too many"):
        read_frames(tmp_path / "a.npy", plan)
    assert len(state_frames(plan, "000 111 010")) == 3
    with pytest.raises(SpecError, match="must be at most 3 states, got 4"):
        state_frames(plan, "000 111 010 001")


@given(st.lists(st.lists(st.floats(0, 1), min_size=12, max_size=12), min_size=1, max_size=4))
@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_written_is_read(plan, tmp_path, rows):
    images = np.array(rows).reshape(-1, 6, 2)
    text = "\n".join("".join(",".join(map(repr, row)) + "\n" for row in image.tolist()) for image in images)
    (tmp_path / "a.csv").write_text(text)
    levels = read_frames(tmp_path / "a.csv", plan).levels
    for image, frame in zip(images, levels, strict=True):
        assert np.array_equal(seen(plan, frame), image * (taxel_grid(plan) >= 0))


def test_a_state_counts_the_coils_own_channels(plan):
    (levels,) = state_frames(plan, "100")
    on = {taxel.id for taxel, level in zip(plan.taxels, levels, strict=True) if level}
    assert on == {"r0c0k0", "r0c1k0", "r1c0k0", "r1c1k0"}
    grey = state_frames(plan, "0,0.5,1 111")
    assert grey[0].tolist() == [0, 0.5, 1, 0, 0.5, 1, 0, 0.5, 1, 0, 0.5]
    assert grey[1].min() == 1


def test_all_states_are_those_of_the_drivers_table(paper_plan):
    frames = state_frames(paper_plan, "all")
    assert frames[:, :2].tolist() == [[0, 0], [0, 1], [1, 0], [1, 1]]
    assert np.array_equal(frames[2], state_frames(paper_plan, "10")[0])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("01", r"has 3 channels, so a state is 3 digits 0 or 1, or 3 levels 0 … 1 between commas; got '01'"),
        ("0 1 1", r"got '0'"),
        ("0,1,1.5", r"levels must be in 0 … 1, got 1.5 in '0,1,1.5'"),
        ("0,1,nan", r"levels must be in 0 … 1, got nan"),
        ("0,1,", r"a state is 3 digits"),
        ("0,1,1_0", r"a state is 3 digits"),
        ("012", r"a state is 3 digits"),
        ("", r"a state is 3 digits .*; got ''"),
    ],
)
def test_bad_states_are_refused_in_a_sentence(plan, text, sentence):
    with pytest.raises(SpecError, match=sentence) as error:
        state_frames(plan, text)
    assert error.value.where == "--state"


def test_all_states_of_many_channels_are_too_many():
    with pytest.raises(SpecError, match="all states of 11 channels are 2048; at most 64 are played"):
        state_frames(pg.plan("wide-11"), "all")


def test_pictures_in_text(plan, tmp_path):
    levels = state_frames(plan, "0,0.5,1 111")
    text = frames_text(plan, levels)
    assert text == PICTURES
    (tmp_path / "a.txt").write_text(text)
    assert np.array_equal(read_frames(tmp_path / "a.txt", plan).levels, levels)


PICTURES = ".+\n# \n+.\n.+\n##\n+.\n\n##\n# \n##\n##\n##\n##\n"


@pytest.mark.parametrize("suffix", [".csv", ".txt", ".png", ".npy"])
def test_what_is_no_file_holds_no_frames(plan, tmp_path, suffix):
    os.mkfifo(tmp_path / f"pipe{suffix}")
    (tmp_path / f"zero{suffix}").symlink_to("/dev/zero")
    for name in ("pipe", "zero"):
        with pytest.raises(FileError, match=rf"{name}\{suffix}: is not a file"):
            read_frames(tmp_path / f"{name}{suffix}", plan)


def test_vast_texts_are_no_frames(plan, tmp_path):
    path = tmp_path / "a.csv"
    with path.open("wb") as file:
        file.truncate(10**10)
    with pytest.raises(FileError, match="too large for a text of frames: at most 33554432 bytes"):
        read_frames(path, plan)
    path.write_text("1\n" * 100_001)
    with pytest.raises(FileError, match="has a frame of more than 100000 rows"):
        read_frames(path, plan)


# ---- Text, patterns, wiring ----------------------------------------------------------------------------------------


def test_a_letter_is_drawn_as_wide_and_high_as_whole_taxels_allow():
    """Each mark of the letter R is looked for where it must be, on pads that hold it once and more times as large."""
    for name, size, at in (("quad-64", (1, 1), (0, 1)), ("big-512", (4, 2), (2, 3))):
        plan = pg.plan(name)
        (levels,) = text_frames(plan, "r")
        image = seen(plan, levels)[at[0] :, at[1] :][: 7 * size[0] : size[0], : 5 * size[1] : size[1]]
        drawn = ["".join(".#"[int(v)] for v in row) for row in image]
        assert drawn[0] == drawn[3] == "####." and drawn[4:] == ["#.#..", "#..#.", "#...#"], drawn
        assert levels.sum() == image.sum() * size[0] * size[1]


def test_text_scrolls_where_it_does_not_fit(paper_plan):
    quad = pg.plan("quad-64")
    long = text_frames(quad, "\u00e9i!")
    assert len(long) == 3 * 6 - 1 - 8 + 1
    views = [seen(quad, frame) for frame in long]
    assert all(np.array_equal(a[:, 1:], b[:, :-1]) for a, b in pairwise(views))
    assert np.array_equal(text_frames(paper_plan, "I "), text_frames(paper_plan, "i "))
    grey = text_frames(paper_plan, "E")
    assert grey.min() == 0 and grey.max() == 1 and ((grey > 0) & (grey < 1)).any()
    assert grey.sum() == pytest.approx(18 * 4 / 5)  # 18 pixels of 4/5 of a column each


def test_patterns_are_on_everywhere_once(plan):
    grid = taxel_grid(plan)
    for name, count in (("each", 11), ("rows", 6), ("columns", 2), ("checkerboard", 2)):
        frames = pattern_frames(plan, name)
        assert len(frames) == count and (frames.sum(0) == 1).all(), name
    assert np.array_equal(pattern_frames(plan, "each"), np.eye(11))
    first = pattern_frames(plan, "rows")[0]
    assert {k for k in grid[0].tolist() if k >= 0} == set(np.flatnonzero(first).tolist())
    sweep = pattern_frames(plan, "sweep")
    assert len(sweep) == sum(grid.shape) and (sweep.max(0) == 1).all() and set(np.unique(sweep)) == {0, 0.5, 1}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [("\u20ac", "'€' is none of the signs"), (" ", "must have a letter"), ("A" * 10**6, "at most")],
)
def test_text_that_cannot_be_drawn_is_refused(plan, text, sentence):
    with pytest.raises(SpecError, match=sentence):
        text_frames(plan, text)
