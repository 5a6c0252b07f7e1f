"""Make the JSON schema of a spec, with which editors complete and check spec files."""

from dataclasses import MISSING, fields, is_dataclass
from typing import Any, get_args

from padgen.spec.fields import choices, optional_type
from padgen.spec.load import CATALOGUES, SHORTHANDS, catalogue
from padgen.spec.model import Spec

__all__ = ["spec_schema"]


def spec_schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a spec file, made from the fields' metadata."""
    schema = _object(Spec, required=True)
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "padgen spec"
    for name in CATALOGUES:
        entry = schema["properties"][name]
        entry["properties"]["name"]["examples"] = sorted(catalogue(name))
        word = {"type": "string", "enum": sorted(catalogue(name))}
        schema["properties"][name] = {"anyOf": [word, entry], "description": f"{name}: a catalogue name or a table"}
    for name, key in SHORTHANDS.items():
        entry = schema["properties"][name]
        word = {"type": "string", "enum": entry["properties"][key]["enum"]}
        schema["properties"][name] = {"anyOf": [word, entry], "description": f"{name}: its {key} or a table"}
    return schema


def _object(kind: Any, required: bool = False) -> dict[str, Any]:
    properties = {
        item.name: _object(inner) if is_dataclass(inner := optional_type(item.type)[0]) else _property(item)
        for item in fields(kind)
    }
    schema: dict[str, Any] = {"type": "object", "additionalProperties": False, "properties": properties}
    if required:
        schema["required"] = [f.name for f in fields(kind) if f.default is MISSING and not is_dataclass(f.type)]
    return schema


def _property(item: Any) -> dict[str, Any]:
    meta, kind = item.metadata, optional_type(item.type)[0]
    unit = meta.get("unit", "")
    description = meta["doc"] + (f" ({unit})" if unit not in ("", "1") else "")
    schema = {**_type(kind, meta), "description": description}
    if item.default is not MISSING and item.default is not None:
        schema["default"] = item.default
    return schema


def _type(kind: Any, meta: Any) -> dict[str, Any]:
    if kind in (int, float):
        low = "exclusiveMinimum" if meta["above"] else "minimum"
        return {"type": "integer" if kind is int else "number", low: meta["low"], "maximum": meta["high"]}
    if kind is bool:
        return {"type": "boolean"}
    if kind is str:
        schema: dict[str, Any] = {"type": "string"}
        if known := choices(meta):
            schema["enum"] = list(known)
        if meta.get("pattern"):
            schema["pattern"] = f"^{meta['pattern']}$"
        return schema
    count = meta["count"]
    sizes = {"minItems": count, "maxItems": count} if count else {"minItems": 1}
    return {"type": "array", "items": _type(get_args(kind)[0], meta), **sizes}
