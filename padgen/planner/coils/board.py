"""A spiral on the layers of a printed circuit board, under the taxels of its cell.

::

    |<------- outer ------->|
    ==== ==== ====  = ==== ==   0: top copper          = : tracks
    ---- ---- ----  = ---- --      inner copper, thinner on most boards
    ---- ---- ----  = ---- --
    ==== ==== ====  = ==== ==   -length: the board's thickness
              |bore|            with a via for each pair of layers

A spec gives sizes and the rules of a house, or nothing but ``kind = "board"``; turns, resistance, inductance and the
heat that it bears are worked out (`padgen.physics.board_coil`). Where it gives no outer diameter, the search tries the
widest coils that a layout's cells have room for, and then narrower ones.
"""

from dataclasses import asdict
from functools import lru_cache
from typing import Any

from padgen.core.errors import SpecError, at_least, at_most, number, shown
from padgen.core.registry import unknown_name
from padgen.core.units import MH, MM, UM
from padgen.physics.board_coil import (
    BoardCoil,
    board_layers,
    board_source,
    bore_needed,
    corner_leg,
    heat_limit,
    inductance,
    resistance,
)
from padgen.physics.magnetics import CoilSource
from padgen.spec import Coil, PadTable, catalogue
from padgen.spec.fields import build

__all__ = [
    "DEFAULT_CONNECTOR",
    "HEAD_MM",
    "beside_mm",
    "board_coil",
    "completed",
    "connector_of",
    "given_fields",
    "house_of",
    "narrowest_mm",
    "resized",
    "source",
    "widest_mm",
]

DEFAULT_CONNECTOR = "header-2.54"
DEFAULTS: dict[str, Any] = {
    "name": "board",
    "house": "coil-0.15",
    "connector": DEFAULT_CONNECTOR,
    "layers": 4,
    "outer_diameter_mm": 9.6,
}
USUAL_THICKNESS_MM = 1.6
WORKED_OUT = ("turns", "resistance_ohm", "inductance_mh")
"""Fields that follow from the others."""
AS_WORKED_OUT = 1e-9
"""Relative difference by which a recorded one may differ."""
LEAST_TURNS = 1.0
HEAD_MM = 1.0
"""Room round a mounting hole for the head of its screw, beyond the hole's edge."""


def source(coil: Coil) -> CoilSource:
    """Return the windings of the layers, in m."""
    return board_source(board_coil(coil))


def house_of(coil: Coil) -> dict[str, Any]:
    """Return the design rules of the board house that makes the printed circuit board of a coil.

    Raises
    ------
    SpecError
        There is no such house.
    """
    return _entry("board_house", coil.house, "house in board_houses.csv", "coil.house")


def connector_of(coil: Coil) -> dict[str, Any]:
    """Return the catalogue's entry of what the coils of a board are plugged to.

    Raises
    ------
    SpecError
        There is no such connector.
    """
    return _entry("connector", coil.connector, "connector in connectors.csv", "coil.connector")


def _entry(table: str, name: str, what: str, where: str) -> dict[str, Any]:
    """Return a catalogue's entry; raise `SpecError` for `what` it does not have, in the field `where`."""
    entries = catalogue(table)
    if name not in entries:
        raise unknown_name(name, list(entries), what, where)
    return entries[name]


@lru_cache(maxsize=64)
def board_coil(coil: Coil) -> BoardCoil:
    """Return the sizes of a board coil in SI units, with the stack of its layers.

    Four layers lie in the usual way, a prepreg below each outer one and a core between; any others are evenly spaced.
    """
    house = house_of(coil)
    assert coil.layers and coil.track_mm and coil.space_mm and coil.copper_um and coil.inner_copper_um
    inner = [coil.inner_copper_um * UM] * (coil.layers - 2)
    copper = (coil.copper_um * UM, *inner, coil.copper_um * UM)
    last = coil.length_mm * MM - copper[-1]
    if coil.layers == 4:
        second = copper[0] + house["prepreg_mm"] * MM
        depth: tuple[float, ...] = (0.0, second, last - house["prepreg_mm"] * MM - copper[2], last)
    else:
        depth = tuple(last * k / (coil.layers - 1) for k in range(coil.layers))
    return BoardCoil(
        outer_diameter=coil.outer_diameter_mm * MM,
        inner_diameter=coil.inner_diameter_mm * MM,
        track=coil.track_mm * MM,
        space=coil.space_mm * MM,
        drill=house["drill_mm"] * MM,
        via=house["via_mm"] * MM,
        plating=house["plating_um"] * UM,
        copper=copper,
        depth=depth,
        parallel=coil.wiring == "parallel" and coil.layers > 2,
        outer_depth=0.0 if coil.shape == "round" else coil.sides_mm[1] * MM,
    )


def beside_mm(coil: Coil, rows: int) -> tuple[float, float]:
    """Return the least gaps in mm between coils: along x (holding connector tracks of `rows` coils) and along y."""
    assert coil.track_mm and coil.space_mm
    return rows * coil.track_mm + (rows + 1) * coil.space_mm, 2 * coil.space_mm


def widest_mm(coil: Coil, pad: PadTable, rows: int, columns: int) -> tuple[float, float]:
    """Return the largest sides in mm of coils with which coils, tracks and screws have room on the board of a pad."""
    beside_x, beside_y = beside_mm(coil, rows)
    pitch_x = pad.width_mm / columns
    # The tracks of the last column pass between its coils and the screws' heads.
    before_screws = pitch_x + pad.border_mm - pad.hole_diameter_mm - 2 * HEAD_MM - 2 * beside_x
    x_mm = min(pitch_x - beside_x, before_screws)
    y_mm = pad.depth_mm / rows - beside_y
    return (x_mm, y_mm) if coil.shape == "rectangular" else (min(x_mm, y_mm),) * 2


def narrowest_mm(coil: Coil) -> float:
    """Return the least side in mm that has room for a turn on every layer round a coil's bore."""
    board = board_coil(coil)
    turn_mm = coil.inner_diameter_mm + 2 * (2 * board.pitch + board.track) / MM
    # The cuts of two corners leave some of each side.
    return turn_mm if board.is_round else max(turn_mm, 2 * (corner_leg(board) + board.track) / MM)


def given_fields(coil: Coil) -> dict[str, Any]:
    """Return the fields of a board coil that do not follow from others or from its house, as a spec may give them."""
    board = board_coil(coil)
    follow = _of_house(house_of(coil)) | {"inner_diameter_mm": _bore_mm(coil), "power_limit_w": heat_limit(board)}
    worked_out = {*WORKED_OUT, "sizing", *(key for key, value in follow.items() if getattr(coil, key) == value)}
    if coil.sizing == "auto":
        worked_out |= {"outer_diameter_mm", "outer_depth_mm"}
    return {key: value for key, value in asdict(coil).items() if value is not None and key not in worked_out}


@lru_cache(maxsize=1024)
def resized(coil: Coil, sides_mm: tuple[float, float]) -> Coil:
    """Return a board coil with other sides along x and y, and the figures that follow from them.

    Raises
    ------
    SpecError
        There is no room for a turn on every layer.
    """
    sides = {"outer_diameter_mm": sides_mm[0]}
    if coil.shape == "rectangular":
        sides["outer_depth_mm"] = sides_mm[1]
    return completed(given_fields(coil) | sides)


def _of_house(house: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a board coil that its house decides where the spec does not."""
    sold_mm = house["thickness_mm"]
    usual_mm = USUAL_THICKNESS_MM if USUAL_THICKNESS_MM in sold_mm else sold_mm[0]
    return {"length_mm": usual_mm} | {
        key: house[key] for key in ("track_mm", "space_mm", "copper_um", "inner_copper_um")
    }


def _bore_mm(coil: Coil) -> float:
    """Return the smallest bore in mm with room for a coil's vias."""
    return round(bore_needed(board_coil(coil)) / MM, 6)


def completed(given: dict[str, Any]) -> Coil:
    """Return the board coil of the spec table `given`, missing fields taken from the board house's rules or computed.

    Raises
    ------
    SpecError
        A field is out of bounds, the house does not make such a board, or there is no room for vias or turns.
    """
    unknown = dict.fromkeys((*WORKED_OUT, "inner_diameter_mm", "length_mm"), 1.0)
    air = {"core_diameter_mm": 0.0, "core_relative_permeability": 1.0, "core_coercivity_a_per_m": 0.0}
    stated = {key: value for key, value in given.items() if key not in WORKED_OUT}
    coil: Coil = build(Coil, stated, "coil", {**DEFAULTS, **unknown, **air})
    _refuse_depth(given)
    house = house_of(coil)
    values = _of_house(house) | stated | {"sizing": _sizing(given)}
    coil = build(Coil, values, "coil", {**DEFAULTS, **unknown, **air})
    _refuse(coil, house)
    connector_of(coil)
    bore_mm = _bore_mm(coil)
    if "inner_diameter_mm" not in given:
        values["inner_diameter_mm"] = bore_mm
        coil = build(Coil, values, "coil", {**DEFAULTS, **unknown, **air})
    if coil.sizing == "auto" and coil.outer_diameter_mm < narrowest_mm(coil):
        values["outer_diameter_mm"] = float(at_least(narrowest_mm(coil)))
        coil = build(Coil, values, "coil", {**DEFAULTS, **unknown, **air})
    _refuse_room(coil, bore_mm)
    board = board_coil(coil)
    layers = board_layers(board)
    turns = sum(layer.turns for layer in layers) * (2 / len(layers) if board.parallel else 1.0)
    worked_out = {
        "turns": turns,
        "resistance_ohm": resistance(board),
        "inductance_mh": inductance(board) / MH,
    }
    for key, value in worked_out.items():
        recorded = given.get(key, value)
        if not isinstance(recorded, (int, float)) or not abs(recorded / value - 1) <= AS_WORKED_OUT:
            raise SpecError(
                f"of a board coil is worked out, as {number(value)} here, got {shown(recorded)}",
                f"coil.{key}",
                [{f"coil.{key}": None}],
            )
    values |= worked_out
    values.setdefault("power_limit_w", heat_limit(board))
    made: Coil = build(Coil, values, "coil", {**DEFAULTS, **air})
    return made


def _refuse_depth(given: dict[str, Any]) -> None:
    """Raise `SpecError` for an `outer_depth_mm` in a `[coil]` table of round coils, or one that is given alone."""
    depth_mm = given.get("outer_depth_mm")
    if given.get("shape", "round") != "rectangular":
        if depth_mm is not None:
            rectangular = {"coil.shape": "rectangular"}
            rectangular |= {} if "outer_diameter_mm" in given else {"coil.outer_diameter_mm": depth_mm}
            raise SpecError(
                f"is of coils whose coil.shape is 'rectangular', got {shown(depth_mm)} mm",
                "coil.outer_depth_mm",
                [{"coil.outer_depth_mm": None}, rectangular],
            )
    elif depth_mm is not None and "outer_diameter_mm" not in given:
        raise SpecError(
            f"takes coil.outer_diameter_mm, the size along x, which is not given, got {shown(depth_mm)} mm",
            "coil.outer_depth_mm",
            [{"coil.outer_depth_mm": None}, {"coil.outer_diameter_mm": depth_mm}],
        )


def _sizing(given: dict[str, Any]) -> str:
    """Return 'given' for a `[coil]` table with an outer diameter, else 'auto'; raise where it says the other."""
    has_diameter = "outer_diameter_mm" in given
    sizing = "given" if has_diameter else "auto"
    if given.get("sizing", sizing) == sizing:
        return sizing
    if has_diameter:
        sentence = "'auto' leaves the outer diameter to the search, but coil.outer_diameter_mm gives one"
        cures: list[dict[str, Any]] = [{"coil.outer_diameter_mm": None}, {"coil.sizing": "given"}]
    else:
        sentence = "'given' takes coil.outer_diameter_mm, which is not given"
        cures = [{"coil.sizing": "auto"}, {"coil.outer_diameter_mm": DEFAULTS["outer_diameter_mm"]}]
    raise SpecError(sentence, "coil.sizing", cures)


def _refuse(coil: Coil, house: dict[str, Any]) -> None:
    """Raise `SpecError` for a board coil whose layers, thickness, tracks, copper or core its house does not make."""
    name = house["name"]
    for key, unit in (("layers", ""), ("thickness_mm", " mm")):
        field = "length_mm" if key == "thickness_mm" else key
        made = house[key]
        asked = getattr(coil, field)
        if asked not in made:
            listed = ", ".join(number(value) for value in made)
            nearest = min(made, key=lambda value: abs(value - asked))
            raise SpecError(
                f"must be one of {listed}{unit} on boards of {name!r}, got {number(asked)}{unit}",
                f"coil.{field}",
                [{f"coil.{field}": int(nearest) if key == "layers" else nearest}],
            )
    houses = catalogue("board_house").values()
    for key in ("track_mm", "space_mm"):
        asked = getattr(coil, key)
        if asked < house[key] - 1e-9:
            finer = [other["name"] for other in houses if other[key] <= asked + 1e-9]
            cures: list[dict[str, Any]] = [{f"coil.{key}": house[key]}]
            cures += [{"coil.house": other} for other in finer[:1]]
            raise SpecError(
                f"must be at least {number(house[key])} mm on boards of {name!r}, got {number(asked)} mm",
                f"coil.{key}",
                cures,
            )
    for key in ("copper_um", "inner_copper_um"):
        if getattr(coil, key) > house[key] + 1e-9:
            raise SpecError(
                f"must be at most {number(house[key])} µm on boards of {name!r}, whose tracks are for that, got"
                f" {number(getattr(coil, key))} µm",
                f"coil.{key}",
                [{f"coil.{key}": house[key]}],
            )
    if coil.core_diameter_mm:
        raise SpecError(
            f"must be 0 of a board coil, got {number(coil.core_diameter_mm)} mm",
            "coil.core_diameter_mm",
            [{"coil.core_diameter_mm": 0.0}],
        )


def _refuse_room(coil: Coil, bore_mm: float) -> None:
    """Raise for a bore without room for the vias, or a ring without room for turns on every layer."""
    if coil.inner_diameter_mm < bore_mm - 1e-9:
        raise SpecError(
            f"must be at least {at_least(bore_mm)} mm, which the vias of {coil.layers} layers need, got"
            f" {number(coil.inner_diameter_mm)} mm",
            "coil.inner_diameter_mm",
            [{"coil.inner_diameter_mm": None}],
        )
    board = board_coil(coil)
    too_narrow = min(coil.sides_mm) < narrowest_mm(coil) and not board.is_round
    if too_narrow or min(layer.turns for layer in board_layers(board)) < LEAST_TURNS:
        needed_mm = narrowest_mm(coil)
        width_mm, depth_mm = coil.sides_mm
        where = "coil.outer_depth_mm" if depth_mm < width_mm else "coil.outer_diameter_mm"
        side_mm = min(width_mm, depth_mm)
        narrower_mm = side_mm - (needed_mm - coil.inner_diameter_mm)
        cures: list[dict[str, Any]] = [{where: float(at_least(needed_mm))}]
        if coil.outer_depth_mm == width_mm:
            cures = [dict.fromkeys(("coil.outer_diameter_mm", "coil.outer_depth_mm"), float(at_least(needed_mm)))]
        if narrower_mm > bore_mm:
            cures.append({"coil.inner_diameter_mm": float(at_most(narrower_mm))})
        raise SpecError(
            f"must be at least {at_least(needed_mm)} mm for a turn on every layer round a bore of"
            f" {number(coil.inner_diameter_mm)} mm, got {number(side_mm)} mm",
            where,
            cures,
        )
