"""Registries of extensions by name: padgen's own are one file each in a package; others may be registered.

Names come from file names, so that listing them imports nothing. A module is imported when it is first needed.

A registration holds within its process. Modules named in the environment variable `PLUGINS` are imported, and register
their extensions, when names are first needed, in this process and in every worker, which inherits the variable.
"""

import os
import re
from collections.abc import Iterable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

from padgen.core.errors import LONGEST_PART, SpecError, shown

__all__ = [
    "COILS",
    "CONTACTS",
    "FIGURES",
    "FORMATS",
    "MOVERS",
    "PAD_FORMATS",
    "PLAYERS",
    "PLUGINS",
    "SCHEMES",
    "SUSPENSIONS",
    "USUAL_FORMATS",
    "Registry",
    "has_extensions",
    "names_in",
    "new_extension_table",
    "plugin_code",
    "registered_names",
    "unknown_name",
]

PLUGINS = "PADGEN_PLUGINS"
"""Environment variable: names of modules, separated by commas, that register extensions when imported."""
T = TypeVar("T")
NAME = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")


_tables: list[dict[str, Any]] = []
"""All that is registered in this process: a table for each kind of thing."""


def new_extension_table() -> dict[str, Any]:
    """Return a new dict for extensions; `has_extensions` returns True as soon as any dict made here has an entry."""
    table: dict[str, Any] = {}
    _tables.append(table)
    return table


def has_extensions() -> bool:
    """Return whether this process has registered extensions; their code may change results but is in no cache key."""
    plugin_code()
    return any(_tables)


class Registry(Generic[T]):
    """The extensions of one `kind`: the modules of `package`, and registered objects.

    `protocol` is the name in `package` of the class whose members each of them has. ``time_shared.py`` is ``time-
    shared``, and ``_3mf.py`` is ``3mf``. `reserved` names have another meaning where a name is given. `changes`
    counts registrations, for keys of caches in memory: a name may later belong to another object.
    """

    def __init__(self, kind: str, package: str, protocol: str, reserved: tuple[str, ...] = ()) -> None:
        self.kind = kind
        self.reserved = reserved
        self.changes = 0
        self._package = package
        self._protocol = protocol
        self._registered: dict[str, T] = new_extension_table()

    def names(self) -> tuple[str, ...]:
        """Return all names: padgen's own in alphabetic order, then the registered ones in their order."""
        return (*_own_extensions(self._package), *self.registered)

    def families(self) -> tuple[str, ...]:
        """Return the names of families, such as ``NAME`` of ``NAME-3`` and ``NAME-5``, in alphabetical order."""
        stems = [stem for name in self.names() if (stem := name.rpartition("-"))[2].isdigit()]
        return tuple(sorted({stem for stem, _, _ in stems if sum(stem == other for other, _, _ in stems) > 1}))

    def register(self, name: str, thing: T) -> None:
        """Register `thing`, which has all members of the protocol, under `name`; `unregister` removes it.

        Raises
        ------
        SpecError
            The name is taken or has characters other than small letters, digits and hyphens, or the thing lacks a name.
        """
        if not NAME.fullmatch(name):
            raise SpecError(f"the name of a {self.kind} must be small letters and digits with hyphens, got {name!r}")
        if name in self.reserved or name in self.names():
            raise SpecError(f"there is a {self.kind} {name!r} already; take another name")
        protocol = getattr(import_module(self._package), self._protocol)
        wanted = [*protocol.__annotations__, *(key for key in vars(protocol) if not key.startswith("_"))]
        missing = [key for key in wanted if not hasattr(thing, key)]
        if missing:
            raise SpecError(f"the {self.kind} {name!r} lacks {', '.join(missing)}")
        self._registered[name] = thing
        self.changes += 1

    def unregister(self, name: str) -> None:
        """Remove the extension registered under `name`; padgen's own cannot be removed.

        Raises
        ------
        SpecError
            Nothing is registered under the name.
        """
        if name not in self._registered:
            raise unknown_name(name, list(self._registered), f"registered {self.kind}", "")
        del self._registered[name]
        self.changes += 1

    @property
    def registered(self) -> tuple[str, ...]:
        """Names of the registered extensions, without padgen's own."""
        plugin_code()
        return tuple(self._registered)

    def version(self, name: str) -> int:
        """Return a number for cache keys: 0 for padgen's extensions, else one that changes with each registration."""
        return self.changes if name in self._registered else 0

    def get(self, name: str, where: str = "") -> T:
        """Return the extension of that name.

        Raises
        ------
        SpecError
            There is none; the sentence, about the field `where`, has the nearest name.
        """
        # Padgen's own names cannot be registered, so that plugins need not be imported for them.
        if name not in _own_extensions(self._package):
            if name not in self.registered:
                raise unknown_name(name, list(self.names()), self.kind, where)
            return self._registered[name]
        return cast(T, _extension(self._package, name))


@cache
def _extension(package: str, name: str) -> Any:
    """Import and return an extension's module, or a family's member; cached, since `import_module` is slow."""
    stem, number = _own_extensions(package)[name]
    module = import_module(f"{package}.{stem}")
    return module.member(number) if number else module


@cache
def _own_extensions(package: str) -> dict[str, tuple[str, int]]:
    """Return a dict from extension name, in alphabetic order, to its module and its number in a family (0: none).

    A file with an underscore before a digit has the name without it, since no module can begin with a digit. Other
    files with an underscore are private. A file that ends with several numbers, ``NAME_3_5.py``, is the family
    ``NAME-3`` and ``NAME-5``: its function `member` makes them.
    """
    defined_in: dict[str, tuple[str, int]] = {}
    for path in Path(__file__).parents[1].joinpath(*package.split(".")[1:]).glob("*.py"):
        stem = re.sub(r"^_(?=\d)", "", path.stem)
        family, *numbers = re.split(r"_(?=\d)", stem)
        if len(numbers) > 1:
            defined_in |= {f"{family}-{number}": (path.stem, int(number)) for number in numbers}
        elif stem[0] != "_":
            defined_in[stem.replace("_", "-")] = path.stem, 0
    return dict(sorted(defined_in.items()))


def plugin_code() -> str:
    """Import the modules that ``PADGEN_PLUGINS`` lists; return a hash of their code, empty if it lists none.

    Raises
    ------
    SpecError
        One of them cannot be imported.
    """
    named = os.environ.get(PLUGINS, "")
    return _code_of(tuple(name.strip() for name in named.split(",") if name.strip())) if named else ""


@cache
def _code_of(modules: tuple[str, ...]) -> str:
    from hashlib import sha256

    code = sha256()
    for name in modules:
        try:
            code.update(Path(import_module(name).__file__ or "").read_bytes())
        except Exception as error:
            raise SpecError(f"cannot import {name!r} ({type(error).__name__}: {error})", PLUGINS) from error
    return code.hexdigest()


def registered_names() -> dict[str, tuple[str, ...]]:
    """Return the names of registered suspensions and drive schemes, by kind of extension."""
    return {registry.kind: registry.registered for registry in (SUSPENSIONS, SCHEMES)}


FEW = 5
"""Most names that are all listed beside the nearest one: a guess alone would hide what else there is."""


def unknown_name(name: str, known: list[str], what: str, where: str) -> SpecError:
    """Return the error for a `name` not in `known`: it tells the nearest one, and all if few or none is near."""
    nearest = _nearest(name, known)
    every = "" if nearest and len(known) > FEW else "known are " + ", ".join(sorted(known))
    hints = "; ".join(hint for hint in (every, nearest) if hint)
    return SpecError(f"there is no {what} {shown(name)}; {hints}", where)


def names_in(text: str, known: Iterable[str], where: str, optional: bool = False) -> tuple[str, ...]:
    """Return the names of a comma-separated list in the order of `known`; an empty list only if it is `optional`.

    >>> names_in("step, stl,", ("stl", "3mf", "step"), "--formats")
    ('stl', 'step')

    Raises
    ------
    SpecError
        A name is none of `known`: the sentence, about the option `where`, lists all and has the nearest.
    """
    known = list(known)
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in known:
            hint = _nearest(name, known)
            raise SpecError(f"must be among {', '.join(known)}, got {shown(name)}{'; ' if hint else ''}{hint}", where)
    if not (names or optional):
        raise SpecError(f"must name one or more of {', '.join(known)}", where)
    return tuple(name for name in known if name in names)


def _nearest(name: str, known: list[str]) -> str:
    """Return the hint ``did you mean …?`` with the name in `known` nearest to `name`, empty where none is near."""
    from difflib import get_close_matches

    near = get_close_matches(name[:LONGEST_PART], known, n=1, cutoff=0.5)
    return f"did you mean {near[0]!r}?" if near else ""


SUSPENSIONS: Registry[Any] = Registry("suspension", "padgen.planner.suspensions", "Suspension", reserved=("auto",))
"""Modules or objects with the names of `padgen.planner.suspensions.Suspension`."""
FORMATS: Registry[Any] = Registry("drive format", "padgen.driver.formats", "DriveFormat")
"""Modules or objects with the names of `padgen.driver.formats.DriveFormat`."""
PLAYERS: Registry[Any] = Registry("player", "padgen.driver.players", "Player")
"""Modules or objects with the names of `padgen.driver.players.Player`; their names are options of `padgen play`."""
PAD_FORMATS: Registry[Any] = Registry("pad format", "padgen.solid.formats", "PadFormat")
"""Modules or objects with the names of `padgen.solid.formats.PadFormat`."""
USUAL_FORMATS = ("stl", "3mf", "step")
"""Formats of `PAD_FORMATS` in which a pad is saved by default."""
SCHEMES: Registry[Any] = Registry("drive scheme", "padgen.physics.schemes", "DriveScheme", reserved=("auto",))
"""Modules or objects with the names of `padgen.physics.schemes.DriveScheme`."""
MOVERS: Registry[Any] = Registry("mover", "padgen.planner.movers", "Mover")
"""Modules or objects with the names of `padgen.planner.movers.Mover`."""
OTHER_PICTURES = ("pad", "section", "exploded", "prints", "overview")
OTHER_SECTIONS = ("bom", "checks", "drive", "figures", "manual", "origin", "study", "taxels", "view")
FIGURES: Registry[Any] = Registry(
    "figure", "padgen.report.figures", "FigureKind", reserved=(*OTHER_PICTURES, *OTHER_SECTIONS)
)
"""Modules or objects with the names of `padgen.report.figures.FigureKind`; drawings and sections are no figures."""
COILS: Registry[Any] = Registry("kind of coil", "padgen.planner.coils", "CoilKind")
"""Modules or objects with the names of `padgen.planner.coils.CoilKind`."""
CONTACTS: Registry[Any] = Registry("contact model", "padgen.physics.contact", "ContactModel", reserved=("none",))
"""Modules or objects with the names of `padgen.physics.contact.ContactModel`."""
