"""The spec: its defaults, its refusals and their messages."""

import json
import tomllib
from dataclasses import MISSING, FrozenInstanceError, fields
from math import sqrt

import pytest

from padgen.core.errors import FileError, SpecError
from padgen.planner import make_plan, plan_to_json
from padgen.spec import catalogue, load_spec, make_spec, parse_spec, template_paths
from padgen.spec.load import CATALOGUES, PARTS, laid_over, spec_schema

BASE = 'name = "a"\nresolution = 4\nband_hz = [50, 200]\nq_min = 15\n'


def test_four_lines_are_a_spec():
    spec = parse_spec(BASE)
    assert (spec.pad.width_mm, spec.pad.depth_mm) == (50, 50)
    assert spec.material.name == "pla"
    with pytest.raises(FrozenInstanceError):
        spec.resolution = 5


def test_a_resin_printer_brings_its_material():
    assert parse_spec(BASE + 'printer = "resin-0.05"\n').material.name == "tough-resin"


def test_entries_are_overridden_field_by_field():
    spec = parse_spec(BASE + '[washer]\nname = "iso7089-m2"\nthickness_mm = 0.4\n')
    assert (spec.washer.outer_diameter_mm, spec.washer.thickness_mm) == (5.0, 0.4)


def test_a_new_entry_needs_all_its_fields():
    coil = (
        "[coil]\nname = 'mine'\nouter_diameter_mm = 8\ninner_diameter_mm = 3\nlength_mm = 9\nturns = 700\n"
        "resistance_ohm = 30\ninductance_mh = 12\ncore_diameter_mm = 3\ncore_relative_permeability = 500\n"
    )
    assert parse_spec(BASE + coil).coil.turns == 700
    with pytest.raises(SpecError, match=r"coil\.name: there is no coil 'mine'"):
        parse_spec(BASE + coil.replace("turns = 700\n", ""))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "name: is missing"),
        (BASE.replace("resolution", "resolutoin"), "there is no key 'resolutoin'; did you mean 'resolution'?"),
        (BASE.replace("= 4", "= 0"), "resolution: must be at least 1 .* got 0 taxels; resolution = 1 would do"),
        (BASE.replace("= 4", "= 1000000"), "resolution: .* at most 100000 taxels, got 1000000"),
        (BASE.replace("= 4", "= 4.5"), "resolution: must be a whole number, got 4.5"),
        (BASE.replace("= 4", "= true"), "resolution: must be a whole number, got True"),
        (BASE.replace("= 4", '= "4"'), "resolution: must be a whole number"),
        (BASE.replace("[50, 200]", "[200, 50]"), r"band_hz: must run from low to high.*band_hz = \[50, 200\] would do"),
        (BASE + "[coil]\ngap_mm = 30\n", "coil.gap_mm: must be at most .* of 10 mm, .*; coil.gap_mm = 10 would do"),
        (BASE.replace("[50, 200]", "[50, 50]"), r"band_hz: must run from low to high, got \[50, 50\] Hz$"),
        (BASE.replace("[50, 200]", "[]"), "band_hz: must be a list of 2 numbers in Hz"),
        (BASE.replace("[50, 200]", "[0, 200]"), r"band_hz\[0\]: must be at least 0.01"),
        (BASE.replace("[50, 200]", "[50, nan]"), r"band_hz\[1\]: must be at least"),
        (BASE.replace("= 15", "= 2.5"), "q_min: must be above 2.5 .delta_y/4. .* at delta_y = 10, got 2.5; .*"),
        (BASE + "delta_db = 40\n", "q_min: must be above 25 .* at delta_db = 40, got 15; delta_db = 29.54 would do"),
        (BASE.replace("= 15", "= inf"), "q_min: must be at least 0.5"),
        (BASE + "[suspension]\nlength_mm = 3000\n", "suspension.length_mm: .* at most 300 mm, got 3000 mm"),
        (BASE + "[pad]\nwidth_mm = -5\n", "pad.width_mm: must be at least 5"),
        (BASE + "pad = 3\n", "pad: must be a table, got 3"),
        (BASE + "[pads]\n", "there is no key 'pads'; did you mean 'pad'?"),
        (
            BASE + "active_area_mm = 50\n",
            "spec: there is no key 'active_area_mm'; known are .* the active area is pad.width_mm and pad.depth_mm",
        ),
        (BASE + "deltadb = 20\n", "spec: there is no key 'deltadb'; did you mean 'delta_db'"),
        (
            BASE + 'spacing = "loose"\n',
            "spacing: there is no spacing of the resonances 'loose'; known are closest, optimised, spread; did you",
        ),
        (BASE + 'material = "plaa"\n', "material.name: there is no material 'plaa'; did you mean 'pla'?"),
        (BASE + "material = 3\n", "material: must be a name or a table"),
        (BASE + 'material = "tough-resin"\n', "material: 'tough-resin' is for resin printers"),
        (BASE + 'washer = "iso7089-m2-a2"\n', "washer: .* is not magnetic"),
        (
            BASE + 'washer = "iso7089-m6"\n',
            "washer: .* spans 12.25 mm, fdm-0.4 bridges 10 mm; washer = 'iso7089-m4', or taxel.centre_post",
        ),
        (BASE + "[washer]\ninner_diameter_mm = 9\n", "washer.inner_diameter_mm: must be below the outer diameter"),
        (BASE + "[coil]\ncore_diameter_mm = 5\n", "coil.core_diameter_mm: must fit the winding's bore of 4 mm"),
        (BASE + "[coil]\ngrid = [4]\n", "coil.grid: must be a list of 2 numbers"),
        (BASE + "[coil]\ngrid = [4, 2.5]\n", r"coil.grid\[1\]: must be a whole number"),
        (BASE + "[taxel]\nplate_thickness_mm = 0.5\n", "taxel.plate_thickness_mm: must be at least 0.6 mm"),
        (BASE + "[taxel]\nplate_thickness_mm = 9\n", "taxel.plate_thickness_mm: must not exceed the frame"),
        (BASE + "[taxel]\nboss_edge_mm = 2\n", "taxel.boss_edge_mm: must be at most"),
        (BASE + "[taxel]\nplate_width_mm = 3\n", "taxel.plate_width_mm: must be at least 4.65 mm"),
        (BASE + "[pad]\nrib_mm = 0.3\n", "pad.rib_mm: must be at least a line of 0.45 mm"),
        ("a = " + "[" * 5000 + "]" * 5000, "nested too deeply"),
        (BASE + "[pad]\nhole_diameter_mm = 8\n", "pad.hole_diameter_mm: must leave a line of wall"),
        (BASE + "[suspension]\nthickness_mm = 0.35\n", "suspension.thickness_mm: must be a whole number of layers"),
        (BASE + "[suspension]\nthickness_mm = 5\n", "suspension.thickness_mm: must stay a layer below the plate"),
        (BASE + "resonances_hz = [76, 56]\n", "resonances_hz: must rise from channel to channel"),
        (BASE + "resonances_hz = [56, 500]\n", "resonances_hz: must lie in the band"),
        (BASE + '[drive]\nscheme = "tonez"\n', "drive.scheme: there is no choice 'tonez'; did you mean 'tones'?"),
        (BASE.replace('"a"', '"../a"'), "name: must match"),
        ("name = ", "is not TOML"),
    ],
)
def test_refusals_are_one_clear_sentence(text, sentence):
    with pytest.raises(SpecError, match=sentence) as refusal:
        parse_spec(text)
    assert "\n" not in str(refusal.value)


def test_files_that_are_none(tmp_path):
    with pytest.raises(FileError, match="is a folder"):
        load_spec(str(tmp_path))
    with pytest.raises(FileError, match="there is no such file"):
        load_spec(str(tmp_path / "none.toml"))
    with pytest.raises(FileError, match="did you mean 'paper-32'"):
        load_spec("paper-23")


def test_a_folder_with_the_name_of_a_template_hides_no_template(tmp_path, monkeypatch):
    """As after ``padgen build pad-32 --out pad-32``."""
    spec = load_spec("pad-32")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pad-32").mkdir()
    assert load_spec("pad-32") == spec
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileError, match="is not TOML: byte 0"):
        load_spec(str(binary))


def test_every_field_says_what_it_is():
    spec = parse_spec(BASE)
    for part in (spec, spec.pad, spec.taxel, spec.material, spec.printer, spec.washer, spec.coil, spec.drive):
        for item in fields(part):
            assert item.metadata.get("doc") or item.name in type(spec).__dataclass_fields__


@pytest.mark.parametrize("table", PARTS)
def test_other_parts_have_figures_and_a_source(table):
    for entry in catalogue(table).values():
        assert len(entry["source"]) > 20 and entry.get("channels", 1) > 0 and entry.get("clock_mhz", 1) > 0
        assert entry.get("coupling", "") in ("", "AC", "DC")


@pytest.mark.parametrize("table", CATALOGUES)
def test_catalogue_entries_pass_their_own_checks(table):
    for name, entry in catalogue(table).items():
        assert entry["source"], f"{table} {name} has no source"
        extra = ""
        if table in ("material", "spread"):
            extra = f'printer = "{"fdm-0.4" if entry["process"] == "fdm" else "resin-0.05"}"\n'
        if table == "magnet":
            extra = 'coil = "air-10"\n'
        if (name != "iso7089-m2-a2" and entry.get("outer_diameter_mm", 0) < 9.8) or table == "coil":
            high = "plate_thickness_mm = 16\n[pad]\nframe_thickness_mm = 16\n" if table == "ballast" else ""
            parse_spec(BASE + extra + f'{table} = "{name}"\n[taxel]\n{high}')


def test_schema_accepts_every_template_and_refuses_a_slip():
    import jsonschema  # takes 3 s

    schema = spec_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    for path in template_paths().values():
        jsonschema.validate(tomllib.loads(path.read_text()), schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(tomllib.loads(BASE + "[pad]\nwidth = 50\n"), schema)


def test_a_plan_stands_for_its_spec(tmp_path):
    spec = load_spec("resin-fine")
    path = tmp_path / "plan.json"
    path.write_text(plan_to_json(make_plan(spec)))
    assert load_spec(str(path)) == spec
    for content in ("{}", "[1]", '{"spec": 3}', "{"):
        path.write_text(content)
        with pytest.raises(FileError, match=r"plan\.json: is no plan\.json"):
            load_spec(str(path))


def test_materials_are_planned_by_their_modulus_in_use():
    """As by a material of that modulus, to rounding: nothing else of a plan knows of the ratio."""
    pla = catalogue("material")["pla"]
    static = pla["youngs_modulus_gpa"]
    for fields_in_use, ratio in (
        ({"dynamic": True}, pla["dynamic_ratio"]),
        ({"wet": True}, pla["wet_ratio"]),
        ({"dynamic": True, "wet": True}, pla["dynamic_ratio"] * pla["wet_ratio"]),
        ({}, 1.0),
    ):
        table = tomllib.loads(BASE) | {"material": {"name": "pla", **fields_in_use}}
        plan = make_plan(make_spec(table))
        like = make_plan(make_spec({**table, "material": {"name": "pla", "youngs_modulus_gpa": static * ratio}}))
        for channel, other in zip(plan.channels, like.channels, strict=True):
            assert channel.resonance_hz == pytest.approx(other.resonance_hz, rel=1e-9)
            assert channel.beam.length_mm == pytest.approx(other.beam.length_mm, rel=1e-9)
            assert channel.stiffness_n_per_m == pytest.approx(other.stiffness_n_per_m, rel=1e-9)
        bounds = {entry.term: entry for entry in plan.left_out}
        for name, term in (("dynamic", "modulus at the frequency of use"), ("wet", "moisture")):
            entry = bounds[term]
            assert entry.computed == (name in fields_in_use)
            if not entry.computed:  # f goes with the root of the modulus
                assert entry.bound == pytest.approx(abs(sqrt(pla[f"{name}_ratio"]) - 1))


def test_a_material_of_ones_own_needs_no_figure_that_has_a_default():
    own = {"name": "mine", "process": "fdm", "youngs_modulus_gpa": 3, "poisson_ratio": 0.36}
    own |= {"density_g_per_cm3": 1.24, "fatigue_stress_mpa": 12}
    table = tomllib.loads(BASE)
    plan = make_plan(make_spec({**table, "material": own}))
    unbounded = {entry.term for entry in plan.left_out if entry.status == "unbounded"}
    assert {"moisture", "modulus at the frequency of use"} <= unbounded
    for name in ("wet", "dynamic"):
        with pytest.raises(SpecError, match=f"by which material.{name} = true plans 'mine'") as refused:
            make_spec({**table, "material": {**own, name: True}})
        assert refused.value.cures == ({f"material.{name}": False},)


def test_a_suspension_may_be_one_word():
    """As a drive scheme may; the schema that editors read takes it, too."""
    spec = parse_spec(BASE + 'suspension = "folded"\n')
    assert spec == parse_spec(BASE + 'suspension.topology = "folded"\n')
    assert "folded" in str(spec_schema()["properties"]["suspension"])
    with pytest.raises(SpecError, match=r"suspension.topology: there is no choice 'foldd'; did you mean 'folded'"):
        parse_spec(BASE + 'suspension = "foldd"\n')


def test_the_asked_ratio_may_be_given_in_decibels():
    four = {"name": "four", "resolution": 32, "band_hz": [50, 200], "q_min": 15}
    assert make_spec({**four, "delta_db": 14}).delta_y == pytest.approx(10**0.7, rel=1e-12)
    for value in ("14", True, float("nan"), 900):
        with pytest.raises(SpecError, match="delta_db: must be a number from -120 to 180 dB"):
            make_spec({**four, "delta_db": value})
    with pytest.raises(SpecError, match="delta_db: says the same as delta_y"):
        make_spec({**four, "delta_db": 14, "delta_y": 5})
    # What is set later takes the other's place, as by --set and in sweeps.
    assert make_spec(laid_over({**four, "delta_db": 14}, {"delta_y": 3.0})).delta_y == 3.0
    assert make_spec(laid_over({**four, "delta_y": 3.0}, {"delta_db": 20})).delta_y == pytest.approx(10)


def test_a_printer_of_one_s_own_is_given_by_its_nozzle():
    """Lengths that a nozzle sets go with it; the bed and what a slicer adds are the nearest catalogue printer's."""
    lines = 'name = "a"\nresolution = 4\nband_hz = [50, 200]\nq_min = 15\n'
    known = parse_spec(lines + '[printer]\nname = "fdm-0.4"\n').printer
    own = parse_spec(lines + '[printer]\nname = "my-0.6"\nnozzle_mm = 0.6\nbed_x_mm = 300\n').printer
    assert (own.name, own.nozzle_mm, own.bed_x_mm, own.bed_y_mm) == ("my-0.6", 0.6, 300, known.bed_y_mm)
    for field in ("line_width_mm", "smallest_beam_mm", "layer_mm", "first_layer_mm", "smallest_pin_mm"):
        assert getattr(own, field) == pytest.approx(1.5 * getattr(known, field), abs=1e-4)
    assert "in proportion to the nozzle" in own.source
    # One that has all its fields takes nothing from the catalogue.
    whole = {f.name: getattr(own, f.name) for f in fields(own) if f.default is MISSING}
    table = "".join(f"{name} = {json.dumps(value)}\n" for name, value in whole.items())
    assert parse_spec(lines + "[printer]\n" + table).printer.hole_loss_mm == 0 < own.hole_loss_mm
    # One of the catalogue with another nozzle keeps its bed, and lays lines of that nozzle.
    other = parse_spec(lines + '[printer]\nname = "ender-3-0.4"\nnozzle_mm = 0.6\nlayer_mm = 0.2\n').printer
    assert (other.name, other.nozzle_mm, other.layer_mm) == ("ender-3-0.4", 0.6, 0.2)
    ender = parse_spec(lines + 'printer = "ender-3-0.4"\n').printer
    wide = parse_spec(lines + 'printer = "fdm-0.6"\n').printer
    assert (other.bed_x_mm, other.bed_y_mm) == (ender.bed_x_mm, ender.bed_y_mm)
    assert (other.line_width_mm, other.smallest_gap_mm) == (wide.line_width_mm, wide.smallest_gap_mm)
    assert ender.line_width_mm < other.line_width_mm
    pixel = parse_spec(lines + '[printer]\nname = "my-resin"\nprocess = "resin"\nnozzle_mm = 0.04\n').printer
    assert pixel.process == "resin"
    assert pixel.line_width_mm < known.line_width_mm
    with pytest.raises(SpecError, match=r"there is no printer 'my-0.6' in .* lacks process, nozzle_mm, .*nozzle"):
        parse_spec(lines + '[printer]\nname = "my-0.6"\nbed_x_mm = 300\n')
    with pytest.raises(SpecError, match=r"printer.nozzle_mm: must be at least 0.01 and at most 2 mm, got -1"):
        parse_spec(lines + '[printer]\nname = "my-0.6"\nnozzle_mm = -1\nprocess = "fdm"\n')


@pytest.mark.parametrize(
    ("field", "most", "beyond"),
    [("line_width_mm", 0.8, 0.81), ("layer_mm", 0.32, 0.33), ("first_layer_mm", 0.32, 0.33)],
)
def test_lines_and_layers_go_with_their_nozzle(field, most, beyond):
    lines = 'name = "a"\nresolution = 4\nband_hz = [50, 200]\nq_min = 15\n'
    printer = '[printer]\nname = "fdm-0.4"\n'
    assert getattr(parse_spec(f"{lines}{printer}{field} = {most}\n").printer, field) == most
    with pytest.raises(SpecError, match=rf"printer.{field}: must be at most .* the nozzle of 0.4 mm, so {most} mm"):
        parse_spec(f"{lines}{printer}{field} = {beyond}\n")
