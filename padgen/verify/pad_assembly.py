"""A pad put together from reduced tiles on a lattice: numbering, products with its mass, loads.

The lattice is the pad's sub-cells with the border around them: columns along x, rows along y. Unknowns
are the interface functions of the lattice's vertices and faces, then the modes of each tile.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from padgen.verify.pad_interface import VERTICES, Function
from padgen.verify.pad_tiles import ReducedTile

__all__ = ["Assembly", "Key", "PlacedTile", "assembly"]

Place = tuple[str, int, int]
Key = tuple[str, int, int]
"""Kind of a tile, its channel (-1 where it has none), quarter turns."""


class PlacedTile(NamedTuple):
    """A tile of the lattice: the `key` of its reduction, and where its unknowns are in the pad's, -1 where held."""

    key: Key
    column: int
    row: int
    interface: np.ndarray
    modes: np.ndarray


@dataclass(frozen=True)
class Assembly:
    """Reduced tiles on a lattice of `shape` (rows, columns).

    `places` (b,) says of each interface unknown where it is: ('vertex', column, row) counts lattice
    lines, ('south', column, row) and ('west', column, row) are faces of the tile there. The mode unknowns follow.
    """

    kinds: Mapping[Key, ReducedTile]
    tiles: tuple[PlacedTile, ...]
    places: tuple[Place, ...]
    functions: tuple[Function, ...]
    shape: tuple[int, int]
    size: int

    @cached_property
    def square(self) -> np.ndarray:
        """``(2πf)²`` of the tiles' modes, in the order of their unknowns."""
        return np.concatenate([np.empty(0), *(self.kinds[tile.key].square for tile in self.tiles)])

    @cached_property
    def without_modes(self) -> "Assembly":
        """The same pad with its tiles' own modes held still."""
        kinds = {
            key: kind._replace(coupling=kind.coupling[:, :0], square=kind.square[:0])
            for key, kind in self.kinds.items()
        }
        tiles = tuple(tile._replace(modes=tile.modes[:0]) for tile in self.tiles)
        return replace(self, kinds=kinds, tiles=tiles, size=len(self.places))

    def times_mass(self, vectors: np.ndarray) -> np.ndarray:
        """The pad's mass times (n, k)."""
        result = np.zeros_like(vectors)
        for tile in self.tiles:
            kind = self.kinds[tile.key]
            on = tile.interface >= 0
            held = tile.interface[on]
            edge, inner = vectors[held], vectors[tile.modes]
            coupling = kind.coupling[on]
            result[held] += kind.mass[np.ix_(on, on)] @ edge + coupling @ inner
            result[tile.modes] += coupling.T @ edge + inner
        return result

    def pull(self, tile: PlacedTile) -> np.ndarray:
        """Load (n,) of a unit vertical force on the washer of `tile`, and the row that takes a
        displacement to the washer's mean vertical motion."""
        kind, load = self.kinds[tile.key], np.zeros(self.size)
        on = tile.interface >= 0
        load[tile.interface[on]] = kind.pull[: len(on)][on]
        load[tile.modes] = kind.pull[len(on) :]
        return load


def assembly(kinds: Mapping[Key, ReducedTile], keys: Sequence[Sequence[Key]]) -> Assembly:
    """Number the unknowns of a lattice; `keys`, rows of columns, names the kind of each tile.

    A function is held where one of the tiles that touch its place has it not: a clamped face.
    """
    rows, columns = len(keys), len(keys[0])
    touching = _touching(rows, columns)
    listed: dict[tuple[Place, Function], int] = defaultdict(int)
    for row, column in np.ndindex(rows, columns):
        for function in kinds[keys[row][column]].functions:
            listed[_global(function, column, row)] += 1
    live = sorted((name for name, count in listed.items() if count == touching[name[0]]), key=_order)
    number = {name: index for index, name in enumerate(live)}
    tiles, size = [], len(live)
    for row, column in np.ndindex(rows, columns):
        kind = kinds[keys[row][column]]
        interface = np.array([number.get(_global(f, column, row), -1) for f in kind.functions], dtype=np.int64)
        modes = np.arange(size, size + len(kind.square))
        tiles.append(PlacedTile(keys[row][column], column, row, interface, modes))
        size += len(kind.square)
    places, functions = [place for place, _ in live], [function for _, function in live]
    return Assembly(dict(kinds), tuple(tiles), tuple(places), tuple(functions), (rows, columns), size)


def _global(function: Function, column: int, row: int) -> tuple[Place, Function]:
    """Where a tile's function is on the lattice, and itself with its place forgotten."""
    place = function.place
    if isinstance(place, int):
        x, y = VERTICES[place]
        spot: Place = ("vertex", column + (x > 0), row + (y > 0))
    elif place in ("south", "north"):
        spot = ("south", column, row + (place == "north"))
    else:
        spot = ("west", column + (place == "east"), row)
    return spot, function._replace(place=0)


def _order(name: tuple[Place, Function]) -> tuple:
    (kind, column, row), function = name
    return row, column, kind, function[1:]


def _touching(rows: int, columns: int) -> dict[Place, int]:
    """Number of tiles at each place of the lattice."""
    count: dict[Place, int] = defaultdict(int)
    for row, column in np.ndindex(rows, columns):
        for x, y in VERTICES:
            count["vertex", column + (x > 0), row + (y > 0)] += 1
        for place in (
            ("south", column, row),
            ("south", column, row + 1),
            ("west", column, row),
            ("west", column + 1, row),
        ):
            count[place] += 1
    return count
