"""Read a spec, the description of the wanted pad, from TOML and check it field by field."""

from padgen.spec.load import catalogue, find_spec, load_spec, make_spec, parse_spec, template_paths
from padgen.spec.model import (
    Amplifier,
    Coil,
    DriveTable,
    Material,
    MountTable,
    PadTable,
    Printer,
    SoundCard,
    Spec,
    Spread,
    SuspensionTable,
    TaxelTable,
    Washer,
)

__all__ = [
    "Amplifier",
    "Coil",
    "DriveTable",
    "Material",
    "MountTable",
    "PadTable",
    "Printer",
    "SoundCard",
    "Spec",
    "Spread",
    "SuspensionTable",
    "TaxelTable",
    "Washer",
    "catalogue",
    "find_spec",
    "load_spec",
    "make_spec",
    "parse_spec",
    "template_paths",
]
