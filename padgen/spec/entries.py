"""Read the catalogues of materials, printers, their spreads, washers, coils and amplifiers."""

import csv
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

from padgen.spec.fields import optional_type
from padgen.spec.model import Amplifier, Coil, Material, Printer, Spread, Washer

__all__ = ["CATALOGUES", "catalogue"]

CATALOGUES = {
    "material": (Material, "materials.csv"),
    "printer": (Printer, "printers.csv"),
    "spread": (Spread, "spreads.csv"),
    "washer": (Washer, "washers.csv"),
    "coil": (Coil, "coils.csv"),
    "amplifier": (Amplifier, "amplifiers.csv"),
}


@cache
def catalogue(table: str) -> dict[str, dict[str, Any]]:
    """Return the entries of one catalogue by name, with values of their fields' types."""
    kind, filename = CATALOGUES[table]
    types = {f.name: optional_type(f.type)[0] for f in fields(kind)}
    with open(Path(__file__).with_name("catalogue") / filename, encoding="utf-8", newline="") as lines:
        rows = csv.DictReader(lines)
        return {row["name"]: {key: types[key](value) for key, value in row.items()} for row in rows}
