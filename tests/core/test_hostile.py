"""Hostile input: it gets one sentence within seconds and bounded memory, and none of its text steers the terminal."""

import csv
import io
import json
import math
import os
import random
import re
import resource
import struct
import subprocess
import sys
import tomllib
import zipfile
from dataclasses import fields, replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from padgen import cli
from padgen.batch.definition import parse_expression, parse_sweep
from padgen.core import cache
from padgen.core.errors import FileError, Finding, PadgenError, SpecError, at_least, at_most, number, plain, shown
from padgen.core.files import json_line, json_text
from padgen.make.solid_tuning import _from_plain as modes_from_plain
from padgen.physics.ladder import capacity
from padgen.planner import make_plan, plan_to_json
from padgen.planner.plan import Plan
from padgen.report.plans import plan_text
from padgen.solid.mesh import intersecting_pairs
from padgen.solid.parts import bill_of_materials, read_mesh
from padgen.spec import catalogue, load_spec, make_spec, parse_spec, template_paths
from padgen.spec.fields import optional_type
from padgen.spec.load import CATALOGUES, PLAIN_TABLES, SHORTHANDS
from padgen.spec.model import Spec

BASE = 'name = "a"\nresolution = 4\nband_hz = [50, 200]\nq_min = 15\n'
SWEEP = 'name = "s"\nbase = "paper-32"\n'
MEMORY = 3 << 30
SECONDS = 60
"""Limits of a child process: many times what it needs, and far below what hostile input once took."""


def numbered():
    """Return numbers as names of cases whose own text is too long, or too odd, for a name."""
    return map(str, count())


def run(*arguments: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a command in a process with limited memory."""
    return subprocess.run(
        [sys.executable, "-m", "padgen", *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=SECONDS,
        cwd=folder,
        env={**os.environ, **environment},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY)),
    )


def refused(done: subprocess.CompletedProcess[str]) -> str:
    """Return the one sentence of a refusal."""
    assert done.returncode == 2, done
    assert not done.stdout
    assert "Traceback" not in done.stderr
    assert "internal error" not in done.stderr
    (line,) = done.stderr.splitlines()
    assert len(line) < 3000
    return line


# Sentences


@pytest.mark.parametrize(
    "text",
    ["\x1b[2J", "\n", "\r", "\t", "\x00", "\x7f", "\x9b", "\u202e", "\u2066", "\u2028", "\udc80"],
    ids=numbered(),
)
def test_no_sentence_steers_a_terminal(text):
    sentences = [
        str(PadgenError(f"a{text}b", f"c{text}d")),
        Finding("error", "a", f"c{text}d", f"a{text}b").where,
        Finding("error", "a", f"c{text}d", f"a{text}b").message,
        shown(f"a{text}b"),
    ]
    for sentence in sentences:
        assert sentence.isprintable()
        assert "\\" in sentence


def test_sentences_are_cut_in_the_middle():
    error = SpecError(f"must be text, got {'x' * 50_000_000}; the nearest is 3", "y" * 50_000_000)
    assert len(str(error)) < 3000
    assert error.message.startswith("must be text, got xx")
    assert error.message.endswith("xx; the nearest is 3")
    assert plain("größer als 3 µm") == "größer als 3 µm"


def nested(depth: int) -> list:
    value: list = []
    for _ in range(depth):
        value = [value]
    return value


@pytest.mark.parametrize("value", [16**9999, -(16**9999), nested(100_000), {"a": 16**9999}], ids=numbered())
def test_any_value_can_be_shown(value):
    assert shown(value) == "a value too large to be shown"


def test_any_number_can_be_written():
    assert number(16**9999) == "a value too large to be shown"
    for value in (math.inf, math.nan, -math.inf, 0.0, 5e-324, 1e308, 1.0):
        assert at_least(value)
        assert at_most(value)


def test_half_characters_in_json():
    for text in (json_text({"a": ["b\udc80"]}), json_line({"a": ["b\udc80"]})):
        assert json.loads(text.encode()) == {"a": ["b\udc80"]}


# Specs


VALUES = [
    True,
    None,
    16**9999,
    -(16**9999),
    10**30,
    1e300,
    5e-324,
    math.nan,
    math.inf,
    -math.inf,
    "x" * 5000,
    "a\nb",
    "\udc80",
    "",
    [],
    {},
    [[]],
    [math.nan],
    [1] * 20_000,
    {"a": 1},
    nested(50_000),
    *tomllib.loads("a=[1979-05-27, 07:32:00, 1979-05-27T07:32:00Z]")["a"],
]


def all_fields():
    kinds = {**PLAIN_TABLES, **{name: kind for name, (kind, _) in CATALOGUES.items()}}
    for item in fields(Spec):
        yield None, item.name
    for name, kind in kinds.items():
        for item in fields(kind):
            yield name, item.name


@pytest.mark.parametrize("table", [None, *PLAIN_TABLES, *CATALOGUES])
def test_any_value_in_any_field_is_taken_or_refused(table):
    for owner, name in all_fields():
        if owner != table:
            continue
        for value in VALUES:
            whole = tomllib.loads(BASE)
            (whole if owner is None else whole.setdefault(owner, {}))[name] = value
            try:
                make_spec(whole)
            except PadgenError as error:
                assert len(str(error)) < 3000
                assert str(error).isprintable()


@pytest.mark.sample(12)
@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (BASE.replace("= 15", "= 0x" + "f" * 9000), "q_min: must be .* got a value too large"),
        (BASE.replace("= 15", "= 1" + "0" * 9000), "is not TOML"),
        (BASE.replace("= 4", "= 1979-05-27"), "resolution: must be a whole number, got 1979-05-27"),
        (BASE.replace("= 15", "= true"), "q_min: must be a number, got True"),
        (BASE + "x" * 500_000 + " = 1", "there is no key 'xx"),
        (BASE + "x = " + "[" * 100_000, "nested too deeply|is not TOML"),
        (BASE + "[" + "pad." * 30_000 + "pad]\nx = 1", "pad: there is no key 'pad'"),
        (BASE + "resonances_hz = [" + "60, " * 20_000 + "60]", "resonances_hz: must be at most 10000 numbers"),
        (BASE + '[coil]\nname = "=cmd()"', "coil.name: "),
        (BASE + '[material]\nname = "pla"\nsource = "a\\nb"', "material.source: must be a line"),
        (BASE + '[washer]\nname = "iso7092-m2"\nsource = "\\u202e"', "washer.source: must be a line"),
        *(
            (BASE.replace('"a"', f'"{name}"'), "name: must ")
            for name in (
                "../a",
                "a/b",
                "a\\\\b",
                "..",
                "-a",
                "a b",
                "a\\n",
                "a*",
                "con",
                "NUL.txt",
                "Com1",
                "a.",
                "a" * 81,
                "é",
            )
        ),
    ],
    ids=numbered(),
)
def test_what_no_spec_may_hold(text, sentence):
    with pytest.raises(SpecError, match=sentence):
        parse_spec(text)


@pytest.mark.parametrize("name", ["a", "paper-32", "a.b_c", "console", "a" * 80, "0"])
def test_names_that_stay(name):
    assert parse_spec(BASE.replace('"a"', f'"{name}"')).name == name


@pytest.mark.parametrize("suffix", ["toml", "json"])
def test_specs_that_are_no_files(tmp_path, suffix):
    (tmp_path / f"folder.{suffix}").mkdir()
    (tmp_path / f"zero.{suffix}").symlink_to("/dev/zero")
    with (tmp_path / f"sparse.{suffix}").open("wb") as file:
        file.truncate(10**11)
    for name in ("folder", "zero", "sparse", "x" * 300, "a\0b"):
        with pytest.raises(FileError):
            load_spec(str(tmp_path / f"{name}.{suffix}"))


@pytest.mark.parametrize(
    "text",
    [
        '{"spec": ' + "[" * 100_000,
        '{"spec": {"a": ' * 900 + "1" + "}}" * 900,
        '{"spec": {"name": 1' + "0" * 9000 + "}}",
        "[]",
        '{"spec": null}',
        '{"spec": {"name": "\\ud800", "resolution": 1, "band_hz": [1, 2], "q_min": 9}}',
        "\x00",
        '{"spec": NaN}',
    ],
    ids=numbered(),
)
def test_a_plan_that_was_tampered_with(tmp_path, text):
    (tmp_path / "plan.json").write_text(text)
    with pytest.raises(PadgenError):
        load_spec(str(tmp_path / "plan.json"))


def test_a_threshold_that_is_no_file(tmp_path):
    (tmp_path / "a.csv").symlink_to("/dev/zero")
    for name in ("a.csv", ".", "x" * 900):
        with pytest.raises(PadgenError):
            make_spec({**tomllib.loads(BASE), "drive": {"threshold_file": name}}, tmp_path)


def test_a_table_of_parts_stays_a_table(small_plan: Plan):
    spec = small_plan.spec
    odd = replace(small_plan, spec=replace(spec, coil=replace(spec.coil, name='drum, "20"')))
    rows = list(csv.reader(io.StringIO(bill_of_materials(odd, 1.0))))
    assert {len(row) for row in rows} == {4}
    assert rows[2][3].startswith('drum, "20":')


# Plans


BOUNDS = sorted((p for p in template_paths().values()), key=lambda p: p.stem)


def mutated(rng: random.Random) -> dict:
    """Return a template with some fields set anywhere within their bounds, or beyond."""
    table = tomllib.loads(rng.choice(BOUNDS).read_text())
    kinds = {**PLAIN_TABLES, **{name: kind for name, (kind, _) in CATALOGUES.items()}}
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        name = rng.choice(["", *kinds])
        item = rng.choice(fields(kinds[name] if name else Spec))
        kind = optional_type(item.type)[0]
        meta = item.metadata
        if "low" not in meta:
            continue
        low, high = meta["low"], meta["high"]
        drawn = [low, high, rng.uniform(low, high), 1e300]
        if high > 0:
            drawn.append(math.exp(rng.uniform(math.log(max(low, 1e-6)), math.log(high))))
        count = (meta.get("count") or rng.choice([1, 3, 30])) if kind not in (int, float) else 0
        values = [rng.choice(drawn) for _ in range(max(count, 1))]
        if kind is int or item.name == "grid":
            values = [int(value) for value in values]
        owner = table
        if name:
            word = table.get(name, {})
            owner = table[name] = {SHORTHANDS.get(name, "name"): word} if isinstance(word, str) else word
        owner[item.name] = sorted(values) if count else values[0]
    return table


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.soak) for seed in (1, 2))])
def test_specs_from_their_bounds_and_beyond(seed):
    for number_ in range(15):
        table = mutated(random.Random(1000 * seed + number_))
        if table.get("spacing") == "optimised":
            continue  # its search is long by design
        try:
            plan = make_plan(make_spec(table))
        except PadgenError as error:
            assert str(error).isprintable()
            continue
        assert not re.search(r"\b(nan|inf)\b", plan_text(plan)), (seed, number_)
        assert "NaN" not in plan_to_json(plan)


LARGE = {"name": "a", "resolution": 100_000, "band_hz": [50, 200], "q_min": 1e9}
WIDE = {"width_mm": 500, "depth_mm": 500}
DRUM = {**catalogue("coil")["paper"], "outer_diameter_mm": 200}


@pytest.mark.sample(4)
@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({}, "25 coils of 10 mm; .* most 25 channels: 625 taxels before beams are counted; resolution = 48 would do"),
        ({"pad": WIDE}, "62500 taxels before beams are counted; no single change .* that was tried would do"),
        ({"q_min": 15}, "room for plates allow each at most 4 channels: 100 taxels before beams are counted"),
        ({"coil": {"name": "paper", "grid": [2, 2]}}, "the grid has 4 coils"),
        ({"pad": WIDE, "coil": DRUM}, "4 coils of 200 mm"),
        ({"resonances_hz": [50 + k / 2 for k in range(300)]}, "at most 300 channels"),
        ({"resolution": 10**6}, "at most 100000 taxels"),
        ({"resolution": 10**30}, "at most 100000 taxels"),
    ],
)
def test_more_taxels_than_any_pad_holds(changes, sentence):
    with pytest.raises(PadgenError, match=sentence):
        make_plan(make_spec({**LARGE, **changes}))


def test_gaps_of_less_than_a_step_of_length():
    table = tomllib.loads(template_paths()["wide-11"].read_text())
    assert make_plan(make_spec({**table, "printer": {"name": "fdm-0.4", "smallest_gap_mm": 0.0111}})).channels


def test_the_least_ratio_holds_a_finite_number_of_channels():
    least = next(f for f in fields(Spec) if f.name == "delta_y").metadata["low"]
    assert math.isfinite(capacity(0.01, 1e6, 1e9, least))
    with pytest.raises(SpecError, match="delta_y"):
        make_spec({**LARGE, "delta_y": 5e-324})


# Sweeps


@pytest.mark.parametrize(
    "text",
    [
        "round(5, -1000000000) > 1",
        "round(q_min, -1000000000) > 1",
        "round(2**52, -10**15) >= 0",
        "10**10**9 > 1",
        "9**9**9**9 > 1",
        "'a' * 10**9 == 'b'",
        "(9999999999 * 9999999999) ** 30 > 1",
        "max('a' * 9, 'b') > 1",
        "0x" + "f" * 900 + " > q_min",
        "0x" + "f" * 900 + " * 2 > q_min",
        "1e308 * 1e308 > 1",
        "1 / 0 > 1",
        "5 % 0 == 1",
        "-" * 900 + "1 > 0",
        "(" * 150 + "1" + ")" * 150 + " > 0",
        "not " * 200 + "1",
        "1" + " + 1" * 240 + " > 0",
        "round(1e308 * 10) > 1",
        "band_hz[10**18] > 1",
        "band_hz[round(0.4)] > 1",
        "abs(band_hz) > 1",
        "round(1, 1.5) > 0",
        "1j > 0",
        "b'a' > 0",
        "... > 0",
        "min() > 0",
        "'\udc80' == 'a'",
        "round(5, 99999999999999999999) > 0",
        "\0",
        "*".join(["99999999"] * 110) + " > 0",
        "resolution <= 64 " + "and 1 " * 100_000,
    ],
    ids=numbered(),
)
def test_conditions_take_no_time(paper_spec, text):
    try:
        assert parse_expression(text, paper_spec).holds({}, paper_spec) in (True, False)
    except SpecError as error:
        assert len(str(error)) < 3000
        assert str(error).isprintable()


def test_conditions_mean_what_they_did(paper_spec):
    for text in (
        "round(2.5) == 2",
        "round(q_min / 7, 2) == 2.14",
        "band_hz[round(0.4)] == 50",
        "2**10 == 1024",
        "7 // 2 == 3",
    ):
        assert parse_expression(text, paper_spec).holds({}, paper_spec)


def test_random_conditions_are_worked_out_or_refused(paper_spec):
    rng = random.Random(13)
    words = [
        "q_min",
        "resolution",
        "band_hz",
        "10**9",
        "-",
        "+",
        "*",
        "**",
        "//",
        "%",
        "round(",
        "max(",
        "(",
        ")",
        "[0]",
        ",",
        "1e308",
        "0",
        "'a'",
        "<",
        "==",
        " and ",
        " not ",
        "9" * 400,
        "material",
        "~",
        "<<",
        "if",
        "0x" + "f" * 100,
    ]
    worked = 0
    for _ in range(4000):
        text = "".join(rng.choices(words, k=rng.randint(1, 9)))
        try:
            worked += parse_expression(text, paper_spec).holds({}, paper_spec) in (True, False)
        except SpecError:
            continue
    assert worked > 50


@pytest.mark.parametrize(
    "axes",
    [
        *(
            f"[axes]\nq_min = [{v}]"
            for v in ("0x" + "f" * 9000, "inf", "nan", "1979-05-27", "07:00:00", "[[[[[[1]]]]]]", "true")
        ),
        "[axes]\nq_min = {low = 0x" + "f" * 9000 + ", high = 3, steps = 2}",
        "[axes]\nq_min = {low = 1, high = 3, steps = 0x" + "f" * 9000 + "}",
        "[axes]\nq_min = 0x" + "f" * 9000,
        "[axes]\nwasher = [{thickness_mm = 0x" + "f" * 9000 + "}]",
        "[axes]\nwasher = [{" + "a." * 3000 + "a = 1}]",
        "constraints = [0x" + "f" * 9000 + "]\n[axes]\nq_min = [10]",
        "formats = [0x" + "f" * 9000 + "]\n[axes]\nq_min = [10]",
        "formats = [1979-05-27]\n[axes]\nq_min = [10]",
        "[axes]\nq_min = [10]\n[sample]\nseed = 0x" + "f" * 9000,
        "[axes]\nq_min = [10]\n[limits]\ntime_s = nan",
    ],
    ids=numbered(),
)
def test_what_no_sweep_may_hold(axes):
    with pytest.raises(SpecError) as caught:
        parse_sweep(SWEEP + axes)
    assert len(str(caught.value)) < 3000


@pytest.mark.parametrize("base", ["/dev/zero", "x" * 300, "a\\u0000b", ".", "/dev/null"])
def test_a_base_that_is_no_spec(base):
    with pytest.raises(PadgenError):
        parse_sweep(f'name = "s"\nbase = "{base}"\n[axes]\nq_min = [10]')


# Meshes


CORNERS = [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
QUADS = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
CUBE = [tuple(CORNERS[k] for k in part) for a, b, c, d in QUADS for part in ((a, b, c), (a, c, d))]


def stl(triangles) -> bytes:
    rows = [struct.pack("<12fH", 0, 0, 0, *(c for corner in t for c in corner), 0) for t in triangles]
    return bytes(80) + struct.pack("<I", len(rows)) + b"".join(rows)


def scaled(factor, at=0.0):
    return [tuple(tuple(c * factor + at for c in corner) for corner in t) for t in CUBE]


def ply(vertices=4, faces=2, rows="3 0 1 2\n3 0 1 3\n") -> bytes:
    return (
        f"ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n{rows}"
    ).encode()


def prism(corners: int, radius) -> bytes:
    """Return an OBJ of a prism, each end of which is one polygon."""
    at = [
        (radius(k) * math.cos(2 * math.pi * k / corners), radius(k) * math.sin(2 * math.pi * k / corners))
        for k in range(corners)
    ]
    lines = [f"v {x} {y} {z}" for z in (0, 3) for x, y in at]
    faces = [list(range(corners))[::-1], list(range(corners, 2 * corners))]
    faces += [[k, (k + 1) % corners, corners + (k + 1) % corners, corners + k] for k in range(corners)]
    return "\n".join([*lines, *("f " + " ".join(str(k + 1) for k in face) for face in faces)]).encode()


TYPES = (
    '<?xml version="1.0"?><Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
)
RELATIONS = (
    '<?xml version="1.0"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Target="/3D/3dmodel.model" Id="r" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)
TETRAHEDRON = (
    '<mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="10" y="0" z="0"/><vertex x="0" y="10" z="0"/>'
    '<vertex x="0" y="0" z="10"/></vertices><triangles><triangle v1="0" v2="2" v3="1"/><triangle v1="0" v2="1" v3="3"/>'
    '<triangle v1="1" v2="2" v3="3"/><triangle v1="0" v2="3" v3="2"/></triangles></mesh>'
)


def threemf(objects: list[str], items: str, before: str = "", blank: int = 0) -> bytes:
    """Return a 3MF of objects numbered from 1."""
    data = io.BytesIO()
    numbered = "".join(f'<object id="{k}" type="model">{body}</object>' for k, body in enumerate(objects, start=1))
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as package:
        package.writestr("[Content_Types].xml", TYPES)
        package.writestr("_rels/.rels", RELATIONS)
        with package.open("3D/3dmodel.model", "w") as file:
            file.write(f'<?xml version="1.0" encoding="UTF-8"?>{before}<model unit="millimeter" xmlns="'.encode())
            file.write(b'http://schemas.microsoft.com/3dmanufacturing/core/2015/02">')
            for _ in range(blank):
                file.write(b" " * (1 << 20))
            file.write(f"<resources>{numbered}</resources><build>{items}</build></model>".encode())
    return data.getvalue()


def placed(which: int, times: int = 1, transform: str = "") -> str:
    where = f' transform="{transform}"' if transform else ""
    return f'<item objectid="{which}"{where}/>' * times


def within(which: int, times: int = 1, transform: str = "") -> str:
    where = f' transform="{transform}"' if transform else ""
    return "<components>" + f'<component objectid="{which}"{where}/>' * times + "</components>"


def levels(count: int, times: int, transform: str = "", core: str = TETRAHEDRON) -> bytes:
    return threemf([core, *(within(k, times, transform) for k in range(1, count))], placed(count))


LARGER = "10 0 0 0 10 0 0 0 10 0 0 0"
NO_NUMBER = "nan 0 0 0 1 0 0 0 1 0 0 0"
ENTITIES = (
    '<!DOCTYPE m [<!ENTITY a "0000000000">'
    + "".join(f'<!ENTITY {chr(98 + k)} "{f"&{chr(97 + k)};" * 10}">' for k in range(9))
    + "]>"
)
HOSTILE = {
    "vertices apart by nothing.stl": (stl([((1, 1, 1),) * 3] * 10), "holds no triangle whose corners"),
    "a speck.stl": (stl(scaled(1e-7)), "holds no triangle whose corners"),
    "no number.stl": (stl([((math.nan, 0, 0), (1, 0, 0), (0, 1, 0))]), "has coordinates beyond"),
    "far.stl": (stl(scaled(1e30)), "has coordinates beyond"),
    "endless.stl": (stl([((math.inf, 0, 0), (1, 0, 0), (0, 1, 0))]), "has coordinates beyond"),
    "promises.stl": (bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(100), "is cut short"),
    "index.ply": (ply(rows="3 0 1 2\n3 0 1 9\n"), "corners that are none of its 4 vertices"),
    "negative.ply": (ply(rows="3 0 1 2\n3 0 1 -7\n"), "corners that are none of its 4 vertices"),
    "vertices.ply": (ply(vertices=10**12), "holds no triangles|cannot|can be read"),
    "digits.ply": (ply(vertices="9" * 5000), "is not a mesh that can be read"),
    "below.ply": (ply(vertices=-4, faces=-2), "holds no triangles|can be read"),
    "index.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "is not a mesh that can be read|none of its"),
    "large.obj": (b"v 1e400 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "has coordinates beyond"),
    "38 levels of ten.3mf": (levels(38, 10), "places more than 50000 parts"),
    "38 levels of nothing.3mf": (
        levels(38, 10, core="<mesh><vertices/><triangles/></mesh>"),
        "places more than 50000 parts",
    ),
    "never placed.3mf": (
        threemf([TETRAHEDRON, *(within(k, 10) for k in range(1, 38))], placed(1)),
        "places more than 50000",
    ),
    "items.3mf": (threemf([TETRAHEDRON], placed(1, 100_000)), "places more than 50000 parts"),
    "3000 deep.3mf": (levels(3000, 1), "more than 64 deep"),
    "circle.3mf": (threemf([within(2), within(1)], placed(1)), "more than 64 deep"),
    "itself.3mf": (threemf([within(1)], placed(1)), "more than 64 deep"),
    "missing.3mf": (threemf([TETRAHEDRON], placed(7)), "is not a 3MF that can be read"),
    "grows.3mf": (levels(60, 1, LARGER), "has coordinates beyond"),
    "no transform.3mf": (threemf([TETRAHEDRON], placed(1, transform=NO_NUMBER)), "has coordinates beyond"),
    "flattened.3mf": (threemf([TETRAHEDRON], placed(1, transform="0 " * 11 + "0")), "holds no triangle whose corners"),
    "entities.3mf": (threemf([TETRAHEDRON], placed(1), ENTITIES), "declares a document type"),
    "blown up.3mf": (threemf([TETRAHEDRON], placed(1), blank=300), "bytes unpacked"),
    "no zip.3mf": (b"PK\x03\x04" + bytes(500), "is not a 3MF that can be read"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_meshes_that_are_refused(tmp_path, name):
    data, sentence = HOSTILE[name]
    (tmp_path / name).write_bytes(data)
    with pytest.raises(FileError, match=sentence):
        read_mesh(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "data"),
    [("a.3mf", HOSTILE["38 levels of ten.3mf"][0]), ("b.3mf", HOSTILE["blown up.3mf"][0])],
    ids=numbered(),
)
def test_a_mesh_takes_neither_time_nor_memory(tmp_path, name, data):
    (tmp_path / name).write_bytes(data)
    assert "more than" in refused(run("check", name, folder=tmp_path))


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "3mf"])
def test_meshes_that_are_no_files(tmp_path, suffix):
    (tmp_path / f"folder.{suffix}").mkdir()
    os.mkfifo(tmp_path / f"pipe.{suffix}")
    (tmp_path / f"zero.{suffix}").symlink_to("/dev/zero")
    with (tmp_path / f"sparse.{suffix}").open("wb") as file:
        file.truncate(10**11)
    for name in ("folder", "pipe", "zero", "sparse", "x" * 300):
        with pytest.raises(FileError):
            read_mesh(tmp_path / f"{name}.{suffix}")


CORNERS = b"0 0 0\n10 0 0\n0 10 0\n0 0 10\n"
FACES = b"3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"


def ply(*comments, vertices=4, faces=4, kind="uchar", encoding="utf-8"):
    """Return a tetrahedron as PLY text."""
    lines = [
        *("ply", "format ascii 1.0"),
        *(f"comment {comment}" for comment in comments),
        f"element vertex {vertices}",
        *(f"property float {axis}" for axis in "xyz"),
        f"element face {faces}",
        f"property list {kind} int vertex_indices",
        "end_header",
    ]
    return "\n".join(lines).encode(encoding) + b"\n" + CORNERS + FACES


OBJ = b"".join(b"v %s\n" % line for line in CORNERS.splitlines()) + b"f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
NAMING = {
    "texture.ply": ply("TextureFile beside.png"),
    "far.ply": ply("TextureFile ../../../../etc/passwd", "TextureFile /etc/passwd"),
    "other.ply": ply("TextureFile \u00e9\u4e2d.png", "\u00e9"),
    "latin.ply": ply("TextureFile \u00e9.png", encoding="latin-1"),
    "many.ply": ply(vertices=4_000_000_000),
    "minus.ply": ply(vertices=-4),
    "minus faces.ply": ply(faces=-4),
    "kind.ply": ply(kind="TextureFile"),
    "list.ply": ply(kind="uint").replace(b"ascii", b"binary_little_endian").replace(CORNERS + FACES, b"\xff" * 64),
    "short.ply": ply("TextureFile beside.png")[:-30],
    "lib.obj": b"mtllib beside.mtl\nusemtl a\n" + OBJ,
    "far.obj": b"mtllib ../../../../etc/passwd\nmtllib /etc/passwd\nusemtl a\n" + OBJ,
    "other.obj": "mtllib \u00e9.mtl\nusemtl \u00e9\n".encode() + OBJ,
    "latin.obj": b"mtllib \xe9.mtl\n" + OBJ,
    "uv.obj": b"mtllib beside.mtl\nusemtl a\nvt 0 0\n" + OBJ.replace(b"f 1 3 2", b"f 1/1 3/1 2/1"),
    "many.obj": OBJ + b"f 1 2 4000000000\n",
    "minus.obj": OBJ + b"f -9 -8 -7\n",
    "words.stl": b"solid a\nfacet normal a b c\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
    b"endfacet\n",
}
"""Meshes that name other files, count wrongly or are written in another way."""
WATCHED = """
import sys
from pathlib import Path
from padgen.core.errors import MeshFileError
from padgen.solid.parts import read_mesh

def told(path):
    try:
        return f"{len(read_mesh(path).triangles)} triangles"
    except MeshFileError as error:
        return error.message

meshes = [path for path in Path(sys.argv[1]).iterdir() if path.suffix in (".ply", ".obj", ".stl")]
for path in meshes:
    told(path)  # which loads what the readers are
opened = []
sys.addaudithook(lambda event, given: event == "open" and opened.append(str(given[0])))
for path in meshes:
    opened.clear()
    print(path.name, told(path), [name for name in opened if name != str(path)], sep="|")
"""


def test_a_mesh_opens_no_other_file_and_nothing_is_printed_about_it(tmp_path):
    """In a process of its own, as a test's own logging would take what Python prints by itself."""
    for name, data in NAMING.items():
        (tmp_path / name).write_bytes(data)
    for name in ("beside.png", "beside.mtl"):
        (tmp_path / name).write_bytes(b"newmtl a\n")
    ran = subprocess.run([sys.executable, "-c", WATCHED, tmp_path], capture_output=True, text=True, timeout=120)
    assert (ran.returncode, ran.stderr) == (0, "")
    told = [line.split("|") for line in ran.stdout.splitlines()]
    assert {name for name, _, _ in told} == set(NAMING)
    assert [line for line in told if line[2] != "[]"] == []
    read = {name for name, said, _ in told if said == "4 triangles"}
    assert read == {"texture.ply", "far.ply", "other.ply", "lib.obj", "far.obj", "other.obj", "latin.obj", "uv.obj"}


def test_components_still_come_where_they_belong(tmp_path):
    (tmp_path / "a.3mf").write_bytes(
        threemf([TETRAHEDRON, within(1, 1, "1 0 0 0 1 0 0 0 1 30 0 0")], placed(1) + placed(2))
    )
    mesh = read_mesh(tmp_path / "a.3mf")
    assert len(mesh.triangles) == 8
    assert np.ptp(mesh.vertices_mm, axis=0) == pytest.approx([40, 10, 10])


def test_units_places_and_other_parts_of_a_3mf_are_read_as_lib3mf_reads_them(tmp_path):
    """Inches, nested turned components, two items, and an object in another part of the package."""
    from lib3mf import get_wrapper

    turned = "0 1 0 -1 0 0 0 0 1 2 0 1"
    moved = "1 0 0 0 1 0 0 0 2 -3 4 0"
    part = '<component p:path="/3D/other.model" objectid="9" transform="1 0 0 0 1 0 0 0 1 0 7 0"/>'
    objects = [TETRAHEDRON, within(1, 1, turned), f"<components>{part}</components>", within(2, 1, moved)]
    data = threemf(objects, placed(4, 1, "0 0 1 0 1 0 -1 0 0 5 6 7") + placed(3))
    core = 'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"'
    production = 'xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06"'
    other = f'<model unit="inch" {core}><resources><object id="9">{TETRAHEDRON}</object></resources><build/></model>'
    relations = RELATIONS.replace("/3D/3dmodel.model", "/3D/other.model")
    path = tmp_path / "a.3mf"
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            text = old.read(name).decode()
            new.writestr(name, text.replace('"millimeter"', f'"inch" {production}', 1))
        new.writestr("3D/other.model", other)
        new.writestr("3D/_rels/3dmodel.model.rels", relations)
    model = get_wrapper().CreateModel()
    model.QueryReader("3mf").ReadFromFile(str(path))
    box = model.GetOutbox()
    mesh = read_mesh(path)
    assert len(mesh.triangles) == 8
    # lib3mf gives the box in the file's unit, in single precision.
    assert mesh.vertices_mm.min(0) / 25.4 == pytest.approx(list(box.MinCoordinate), abs=1e-5)
    assert mesh.vertices_mm.max(0) / 25.4 == pytest.approx(list(box.MaxCoordinate), abs=1e-5)


def test_a_polygon_of_3000_corners(tmp_path):
    (tmp_path / "a.obj").write_bytes(prism(3000, lambda k: 20))
    assert not len(intersecting_pairs(read_mesh(tmp_path / "a.obj")))


@pytest.mark.parametrize(
    ("name", "triangles", "code"),
    [
        ("within each other", [t for k in range(1500) for t in scaled(10 + k / 1000)], "mesh.intersects"),
        ("on a line", [((0, 0, 0), (1, 0, 0), (2, 0, 0))] * 4, "mesh.closed"),
        ("side by side", [t for k in range(300) for t in scaled(0.5, k)], "mesh.bodies"),
    ],
)
def test_meshes_that_are_judged_all_the_same(tmp_path, capsys, name, triangles, code):
    (tmp_path / "a.stl").write_bytes(stl(triangles))
    assert cli.run(["check", str(tmp_path / "a.stl"), "--json"]) == 1
    assert code in {finding["code"] for finding in json.loads(capsys.readouterr().out)["findings"]}


def test_a_soup_of_triangles_pierces_itself(tmp_path):
    rng = np.random.default_rng(13)
    (tmp_path / "a.stl").write_bytes(stl(rng.uniform(0, 10, (700, 3, 3))))
    assert len(intersecting_pairs(read_mesh(tmp_path / "a.stl"))) > 2000


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "3mf"])
def test_damaged_meshes_are_read_or_refused(tmp_path, suffix):
    whole = {
        "stl": stl(CUBE),
        "obj": prism(8, lambda k: 5),
        "ply": ply(),
        "3mf": threemf([TETRAHEDRON, within(1)], placed(2)),
    }
    rng = random.Random(13)
    path = tmp_path / f"a.{suffix}"
    for _ in range(60):
        data = bytearray(whole[suffix])
        for _ in range(rng.choice([1, 3, 20])):
            data[rng.randrange(len(data))] = rng.choice([0, 0x20, 0x2D, 0x39, 0x65, 0xFF, rng.randrange(256)])
        path.write_bytes(data[: rng.choice([len(data)] * 3 + [rng.randrange(len(data))])])
        try:
            read_mesh(path)
        except PadgenError as error:
            assert str(error).isprintable()


# The cache


@pytest.fixture
def entries(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


WRONG = [
    b"",
    b"null",
    b"{}",
    b"[]",
    b"[1, 2, 3]",
    b"{",
    b"[" * 100_000,
    b"\xff",
    b"1" + b"0" * 9000,
    b'[["a"], 1, 2]',
    b"[[1, NaN], 1, null]",
    b"[[2, 1], 1, null]",
    b"[[1e999, 2], 1, 2]",
    b"PK\x03\x04",
    bytes(1000),
    b"ISO-10303-21;",
]


@pytest.mark.parametrize("data", WRONG, ids=numbered())
def test_entries_that_do_not_fit_count_as_absent(entries, data):
    key = cache.key_of("a")
    cache.store_bytes("b", key, data)
    assert modes_from_plain(cache.load("b", key)) is None


def test_an_entry_that_is_no_file_is_absent(entries):
    key = cache.key_of("a")
    cache.store("b", key, 1)
    (path,) = (path for path in entries.rglob("*.entry"))
    path.unlink()
    os.mkfifo(path)
    assert cache.load("b", key) is None


# The command line


@pytest.mark.parametrize(
    "arguments",
    [
        ["plan", "\x1b[2Jpaper"],
        ["plan", "paper\n32"],
        ["plan", "a\udc80.toml"],
        ["plan", "x" * 5000],
        ["plan", "\u202epad"],
        ["plan", "/dev/zero"],
        ["plan", "a\0b"],
        ["check", "\x1b[2J.stl"],
        ["check", "a\udc80.stl"],
        ["plan", "paper-32", "--seed", "9" * 5000],
        ["plan", "paper-32", "--yield", "9" * 4000],
        ["plan", "paper-32", "--seed", "-" + "9" * 4000],
        ["plan", "paper-32", "--\x1b[2J"],
        ["drive", "paper-32", "--carrier", "nan", "--state", "all"],
        ["drive", "paper-32", "--rate", "9" * 4000, "--state", "all"],
        ["drive", "paper-32", "--seconds", "1e400", "--state", "all"],
        ["drive", "paper-32", "--state", "\x1b[2J"],
        ["sweep", "/dev/zero"],
        ["sweep", "x" * 300],
        ["sweep", "a", "-j", "9" * 5000],
        ["study", "paper-32", "--tolerance", "1e999"],
        ["init", "\x1b[2J"],
        ["retune", "paper-32", "--simulate", "-" + "9" * 4000],
        ["play", "paper-32", "--port", "\x1b[2J", "--repeat", "9" * 4000],
        ["\x1b[2J"],
        ["drive", "paper-32", "--formats", "\x1b[2J"],
        ["build", "paper-32", "--formats", "x" * 100_000],
    ],
    ids=numbered(),
)
@pytest.mark.parametrize("as_json", [False, True])
def test_one_sentence_for_any_arguments(tmp_path, monkeypatch, capsys, arguments, as_json):
    monkeypatch.chdir(tmp_path)
    assert cli.run([*arguments, *["--json"] * as_json]) == 2
    told = capsys.readouterr()
    if as_json and told.out:
        error = json.loads(told.out)["error"]
        assert error["code"] != "internal"
        assert error["message"].isprintable()
    else:
        (line,) = told.err.splitlines()
        assert line.isprintable()
        assert "internal error" not in line
        assert len(line) < 3000
    assert not list(tmp_path.iterdir())


def test_what_is_printed_holds_no_escapes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for folder in ("\x1b[2Jout", "a\nb", "\u202ec", "d\udc80"):
        assert cli.run(["plan", "paper-32", "-o", folder]) in (0, 1)
        told = capsys.readouterr().out
        assert plain(folder) in told
        assert all(line.isprintable() for line in told.split("\n"))
        assert (tmp_path / folder / "plan.json").exists()


def test_a_bug_ends_in_one_sentence(monkeypatch, capsys):
    def broken(*_):
        raise KeyError("a\x1b[2J")

    monkeypatch.setattr("padgen.make.planning.find_spec", broken)
    assert cli.run(["plan", "paper-32"]) == 2
    told = capsys.readouterr()
    assert not told.out
    (line,) = told.err.splitlines()
    assert line.startswith("padgen: internal error (KeyError: ")
    assert "report" in line
    assert line.isprintable()
    monkeypatch.setenv(cli.DEBUG, "1")
    with pytest.raises(KeyError):
        cli.run(["plan", "paper-32"])


def test_warnings_of_libraries_are_not_shown(tmp_path):
    code = (
        "import sys, warnings\nfrom padgen import cli\n"
        "def run(arguments):\n warnings.warn('divide by zero', RuntimeWarning); return 0\n"
        "cli.run = run\nsys.argv = ['padgen']\ncli.main()"
    )
    for debug, shown_ in (({}, False), ({"PADGEN_DEBUG": "1"}, True)):
        environment = {key: value for key, value in os.environ.items() if key != "PYTHONWARNINGS"}
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, env={**environment, **debug}
        )
        assert ("divide by zero" in done.stderr) == shown_


def test_a_spec_without_end_takes_neither_time_nor_memory(tmp_path):
    assert "it is a device" in refused(run("plan", "/dev/zero", folder=tmp_path))


def test_a_condition_takes_neither_time_nor_memory(tmp_path):
    (tmp_path / "s.toml").write_text(
        SWEEP + 'folders = false\nconstraints = ["round(5, -1000000000) > 1"]\n[axes]\nq_min = [10]\n'
    )
    done = run("sweep", "s.toml", "-j", "1", folder=tmp_path)
    assert done.returncode in (0, 2), done
    assert "Traceback" not in done.stderr
