"""Specs drawn from the whole space of specs, and whether padgen answers one well."""

import re
from dataclasses import fields, is_dataclass
from random import Random
from typing import Any

from padgen.core.errors import PadgenError
from padgen.make.planning import plan_for
from padgen.spec import Spec, catalogue, make_spec
from padgen.spec.fields import choices

MOST_ODD = 4
"""Fields, at most, that are drawn from all that they may be, the others being of the catalogues or usual."""
LONGEST_SENTENCE = 1000
FREE = (
    "resolution",
    "threshold_file",
    "threshold_hz",
    "threshold_um",
    "resonances_hz",
    "structure",
    "name",
    "source",
    "power_w",
)
"""Fields of the spec that are not drawn among the odd ones: without bounds, or drawn always."""


def random_table(number: int, most_odd: int = MOST_ODD) -> dict[str, Any]:
    """Draw spec number `number`, as a table; the same on every machine."""
    random = Random(number)
    draw = random.random
    low, side_mm = 10 * 20 ** draw(), 30 * 5 ** draw()
    material, made = random.choice(sorted(catalogue("material").items()))
    printers = [name for name, entry in sorted(catalogue("printer").items()) if entry["process"] == made["process"]]
    table: dict[str, Any] = {
        "name": f"random-{number}",
        "resolution": 1 + int((side_mm / 12) ** 2 * draw()),
        "band_hz": [low, low * 2 * 10 ** draw()],
        "q_min": 3 * 30 ** draw(),
        "material": material,
        "printer": random.choice(printers),
        "washer": random.choice(sorted(catalogue("washer"))),
        "pad": {"width_mm": side_mm, "depth_mm": side_mm},
        "suspension": {"topology": random.choice(["auto", "cantilever", "folded", "bridge"])},
    }
    for _ in range(int(draw() * (most_odd + 1))):
        name, item = random.choice(DRAWN)
        meta = item.metadata
        if known := choices(meta):
            value: Any = random.choice(known)
        elif meta["low"] > 0:
            value = meta["low"] * (meta["high"] / meta["low"]) ** draw()
        else:
            value = meta["high"] * draw() ** 4
        entry = table.setdefault(name, {}) if name else table
        if isinstance(entry, str):
            entry = table[name] = {"name": entry}
        entry[item.name] = int(value) if item.type == "int" or item.type is int else value
    return table


def _is_drawn(item: Any) -> bool:
    single = "low" in item.metadata and "count" not in item.metadata
    return item.name not in FREE and (single or bool(choices(item.metadata)))


DRAWN = [
    (name, item)
    for name, table in [("", Spec), *((part.name, part.type) for part in fields(Spec) if is_dataclass(part.type))]
    for item in fields(table)
    if _is_drawn(item)
]
"""The tables of a spec ("" is the top level) and their fields, those that have bounds or choices."""


def outcome(table: dict[str, Any]) -> str:
    """Return the fault of the answer to a spec, empty where it is a plan of finite figures or one sentence.

    A plan that finds an error in itself, as where a coil does not pull its washer, may have infinite figures.
    """
    try:
        plan = plan_for(make_spec(table))
    except PadgenError as error:
        return "its refusal is no sentence" if "\n" in str(error) or len(str(error)) > LONGEST_SENTENCE else ""
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    honest = any(finding.level == "error" for finding in plan.findings)
    lost = re.search(r"(\w+)\W+(nan|inf)\b", repr(vars(plan)))
    return f"{lost[1]} is no number" if lost and not honest else ""
