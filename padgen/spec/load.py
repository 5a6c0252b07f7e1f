"""Load a `Spec` from a TOML file or a template, and fill in its catalogue entries."""

import json
from copy import deepcopy
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from padgen.core.errors import FileError, SpecError, shown
from padgen.core.files import read_bounded, reason, recover
from padgen.spec.entries import CATALOGUES, catalogue
from padgen.spec.fields import build, unknown_name
from padgen.spec.model import Drive, Limits, Model, Pad, Printer, Spec, Suspension, Taxel
from padgen.spec.refusals import refuse_contradictions
from padgen.spec.threshold import with_threshold

__all__ = [
    "CARRIED_HEADROOM",
    "SHORTHANDS",
    "answers",
    "find_spec",
    "laid_over",
    "load_spec",
    "make_spec",
    "parse_spec",
    "parse_toml",
    "read_table",
    "read_toml",
    "spread_of",
    "template_paths",
    "without_none",
]

LARGEST_TOML, LARGEST_PLAN = 1 << 20, 1 << 25
"""Most bytes of a spec or sweep, and of a plan.json; that of 100,000 taxels takes a third of this."""
DEFAULTS = {"printer": "fdm-0.4", "washer": "iso7092-m1.6", "coil": "paper"}
OWN_AMPLIFIER = "own"
"""Name of an amplifier that a spec gives none."""
CARRIED_HEADROOM = 1.0
"""Spur-free headroom where an AC-coupled amplifier needs a carrier: lines about it have less room, so bends are blunter
(the largest margin that `padgen.physics.root_margin` tries)."""
CALIBRATED = ("printer", "spread", "material")
"""Tables that the file of a calibrated printer may have."""
WINDING = ("turns", "resistance_ohm", "inductance_mh")
"""Fields that describe one winding and so must be given together."""
DEFAULT_GAP_MM = 1.0
DEFAULT_MATERIALS = {"fdm": "pla", "resin": "tough-resin"}
DEFAULT_PRINTERS = {"fdm": "fdm-0.4", "resin": "resin-0.05"}
PLAIN_TABLES = {"pad": Pad, "taxel": Taxel, "suspension": Suspension, "drive": Drive, "model": Model, "limits": Limits}


SHORTHANDS = {"drive": "scheme", "model": "structure"}
"""Tables that a spec may give as one word, and the field that this word sets."""


def template_paths() -> dict[str, Path]:
    """Return the files of the templates by name: at the top of a checkout, inside the package of an installed wheel."""
    here = Path(__file__).resolve().parents[1]
    for folder in (here / "templates", here.parent / "templates"):
        if folder.is_dir():
            return {path.stem: path for path in sorted(folder.glob("*.toml"))}
    return {}


def find_spec(spec: str) -> Path:
    """Return the file of a spec, given by its path or by the name of a template.

    Raises
    ------
    FileError
        There is neither such a file nor such a template.
    """
    path = Path(spec)
    if not spec.strip():
        raise FileError("must name a TOML file or a template, got nothing", "SPEC")
    try:
        recover(path.parent)
        if path.is_dir():
            raise FileError("is a folder, must be a TOML file or the name of a template", spec)
        if path.exists():
            return path
    except OSError as error:
        raise FileError(f"cannot be read ({reason(error)})", spec) from error
    templates = template_paths()
    if spec in templates:
        return templates[spec]
    if path.suffix or len(path.parts) > 1:
        raise FileError("there is no such file", spec)
    raise FileError(unknown_name(spec, list(templates), "file or template", "").message, "spec")


def load_spec(spec: str) -> Spec:
    """Read a `Spec` from a path or the name of a template; from a ``plan.json``, the spec of that plan."""
    path = find_spec(spec)
    return make_spec(read_table(path, spec), path.parent)


def read_table(path: Path, where: str) -> dict[str, Any]:
    """Return the tables of a spec's file, TOML or the ``plan.json`` of a pad; errors name the file `where`."""
    if path.suffix != ".json":
        return read_toml(path, where)
    data = _read(path, LARGEST_PLAN, "a plan.json", where)
    try:
        table = without_none(json.loads(data).get("spec"))
    except (ValueError, AttributeError, RecursionError):
        table = None
    if not isinstance(table, dict):
        raise FileError("is no plan.json, which would have the spec of its pad", where)
    return table


def _read(path: Path, most_bytes: int, what: str, where: str) -> bytes:
    try:
        return read_bounded(path, most_bytes, what)
    except FileError as error:
        raise FileError(error.message, where) from error


def without_none(value: Any) -> Any:
    """Return nested tables without entries of None, which TOML cannot write."""
    if isinstance(value, dict):
        return {key: without_none(entry) for key, entry in value.items() if entry is not None}
    return value


def laid_over(base: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of a spec with `values` set, which are given by the fields' dotted names."""
    table = deepcopy(base)
    # Whole tables are set first, so that a catalogue entry and one of its fields may both be changed.
    for name, value in sorted(values.items(), key=lambda pair: pair[0].count(".")):
        *path, last = name.split(".")
        inner = table
        for part in path:
            entry = inner.get(part, {})
            # A catalogue entry or a drive scheme may be given as one word.
            inner[part] = entry if isinstance(entry, dict) else {SHORTHANDS.get(part, "name"): entry}
            inner = inner[part]
        inner[last] = value
    return table


def parse_spec(text: str, where: str = "spec", folder: Path = Path()) -> Spec:
    """Make a `Spec` from TOML text; `where` names the text in errors, and files that it names lie in `folder`.

    Raises
    ------
    SpecError
        The text is not TOML, or a field is unknown, missing or out of bounds.
    """
    return make_spec(parse_toml(text, where), folder)


def read_toml(path: Path, where: str) -> dict[str, Any]:
    """Return the tables of a TOML file; errors name it `where`."""
    try:
        text = _read(path, LARGEST_TOML, "a TOML file", where).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"is not TOML: byte {error.start} is not UTF-8 text", where) from error
    return parse_toml(text, where)


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Return the tables of TOML text; errors name it `where`."""
    import tomllib

    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SpecError(f"is not TOML: {error}", where) from error
    except ValueError as error:  # a number with thousands of digits
        raise SpecError(f"is not TOML that can be read: {error}", where) from error
    except RecursionError as error:
        raise SpecError("cannot be read: its values are nested too deeply", where) from error


def make_spec(table: dict[str, Any], folder: Path = Path()) -> Spec:
    """Make a `Spec` from the nested tables of a TOML file; files that the tables name lie in `folder`."""
    table = _with_printer_file(dict(table), folder)
    for name, key in SHORTHANDS.items():
        value = table.get(name, {})
        if isinstance(value, str):
            table[name] = {key: value}
        elif not isinstance(value, dict):
            raise SpecError(f"must be the name of its {key} or a table, got {shown(value)}", name)
    limited = "voltage_limit_v" in table.get("drive", {})
    parts: dict[str, Any] = {name: build(kind, table.pop(name, {}), name) for name, kind in PLAIN_TABLES.items()}
    parts["printer"] = _catalogue_entry("printer", table.pop("printer", {}), DEFAULTS["printer"])
    parts["material"] = _catalogue_entry(
        "material", table.pop("material", {}), DEFAULT_MATERIALS[parts["printer"].process]
    )
    parts["spread"] = _catalogue_entry("spread", table.pop("spread", {}), spread_of(parts["printer"]))
    for name in ("washer", "coil"):
        parts[name] = _catalogue_entry(name, table.pop(name, {}), DEFAULTS[name])
    if (amplifier := table.pop("amplifier", None)) is not None:
        parts["amplifier"] = amplifier = _catalogue_entry("amplifier", amplifier, OWN_AMPLIFIER)
        limit_v = min(parts["drive"].voltage_limit_v if limited else amplifier.voltage_v, amplifier.voltage_v)
        headroom = parts["drive"].headroom
        if amplifier.coupling == "AC":
            headroom = max(headroom, CARRIED_HEADROOM)
        parts["drive"] = replace(parts["drive"], voltage_limit_v=limit_v, headroom=headroom)
    parts["drive"] = with_threshold(parts["drive"], folder)
    spec: Spec = build(Spec, table, "", parts)
    if not spec.leaves_layout_free:
        gap_mm, reuse = spec.coil.gap_mm or DEFAULT_GAP_MM, spec.coil.reuse.replace("auto", "same")
        spec = replace(spec, coil=replace(spec.coil, gap_mm=gap_mm, reuse=reuse))
    refuse_contradictions(spec)
    return spec


def _with_printer_file(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return `table` with printer, spread and material from the file of a calibrated printer, if it names one."""
    name = table.get("printer")
    if not isinstance(name, str) or not name.endswith(".toml"):
        return table
    told = read_toml(folder / name, f"printer: {name}")
    if unknown := sorted(set(told) - set(CALIBRATED)):
        raise SpecError(f"has no place in a printer's file, which has {', '.join(CALIBRATED)}", f"{name}: {unknown[0]}")
    if "printer" not in told:
        raise SpecError("is missing; padgen calibrate writes it", f"{name}: printer")
    for key in ("spread", "material"):
        if key in table and key in told and table[key] != told[key]:
            raise SpecError(f"is in the printer's file {name} as well; leave it out of one of the two", key)
    return {**table, **told}


def answers(recorded: Spec, asked: Spec) -> bool:
    """Return whether the spec recorded in a plan is the `asked` one.

    The model may differ, and values that `asked` leaves to the search are taken from the plan.
    """
    own = recorded.coil
    coil = replace(
        asked.coil,
        gap_mm=asked.coil.gap_mm or own.gap_mm,
        reuse=own.reuse if asked.coil.reuse == "auto" else asked.coil.reuse,
    )
    drive = replace(asked.drive, scheme=recorded.drive.scheme) if asked.drive.scheme == "auto" else asked.drive
    return replace(recorded, model=asked.model) == replace(asked, coil=coil, drive=drive)


def spread_of(printer: Printer) -> str:
    """Return the name of the typical spread of `printer` in the catalogue, or of its process if it has none."""
    own = f"{printer.name}-typical"
    return own if own in catalogue("spread") else f"{DEFAULT_PRINTERS[printer.process]}-typical"


def _catalogue_entry(table: str, value: Any, default: str) -> Any:
    """Return a catalogue entry, given by its name or by a table that may override its fields."""
    kind = CATALOGUES[table][0]
    entries = catalogue(table)
    overrides = {"name": value} if isinstance(value, str) else value
    if not isinstance(overrides, dict):
        raise SpecError(f"must be a name or a table, got {shown(value)}", table)
    name = overrides.get("name", default)
    given = [key for key in WINDING if key in overrides]
    # A resistance or an inductance alone corrects the catalogue's coil; turns, or two of the three, mean another coil.
    other = len(given) > 1 or given == ["turns"]
    if table == "coil" and "name" not in overrides and other and len(given) < len(WINDING):
        raise SpecError(
            f"must have {', '.join(WINDING)} together, got {', '.join(given)} alone; of a coil that is like a"
            " catalogue's but for that, give its name as well",
            table,
        )
    if not isinstance(name, str):
        raise SpecError(f"must be text, got {shown(name)}", f"{table}.name")
    if name in entries:
        return build(kind, overrides, table, entries[name])
    required = {f.name for f in fields(kind)} & set(next(iter(entries.values()))) - {"source"}
    if required <= set(overrides) | {"name"} or name == OWN_AMPLIFIER:
        return build(kind, {"name": name, **overrides}, table)
    raise unknown_name(name, list(entries), table, f"{table}.name")
