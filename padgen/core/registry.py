"""Places to extend, by name: what padgen brings lies one file each in a package, more may be registered.

Names are read from the files' names, so that telling them imports nothing; a module is imported when it is
first asked for.

What is registered in one process is known to that process. Modules named in the environment variable `PLUGINS` are
imported, and so register theirs, when names are first asked for, here and in every worker, which inherits it.
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
    "FORMATS",
    "PAD_FORMATS",
    "PLUGINS",
    "SCHEMES",
    "SUSPENSIONS",
    "USUAL_FORMATS",
    "Registry",
    "names_in",
    "plugin_code",
    "registered_names",
    "unknown_name",
]

PLUGINS = "PADGEN_PLUGINS"
"""Environment variable: modules, with commas between them, that register things as they are imported."""
T = TypeVar("T")
NAME = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")


class Registry(Generic[T]):
    """The things of one `kind`: the modules of `package`, and registered ones.

    ``time_shared.py`` is ``time-shared``, and ``_3mf.py`` is ``3mf``.

    `reserved` are words that mean something else where a name is asked for. `changes` counts registrations, for the
    keys of caches in memory: the same name may be another thing later.
    """

    def __init__(self, kind: str, package: str, reserved: tuple[str, ...] = ()) -> None:
        self.kind, self.reserved, self.changes = kind, reserved, 0
        self._package = package
        self._registered: dict[str, T] = {}

    def names(self) -> tuple[str, ...]:
        """All names: those of the package by the alphabet, then the registered ones in their order."""
        return (*_names_of_files(self._package), *self.registered)

    def families(self) -> tuple[str, ...]:
        """What several names begin with that end with a hyphen and a number, by the alphabet."""
        stems = [stem for name in self.names() if (stem := name.rpartition("-"))[2].isdigit()]
        return tuple(sorted({stem for stem, _, _ in stems if sum(stem == other for other, _, _ in stems) > 1}))

    def register(self, name: str, thing: T, protocol: type) -> None:
        """Add `thing`, which holds to `protocol`, under `name`; `unregister` takes it away again.

        Raises
        ------
        SpecError
            The name is taken, or not of small letters, digits and hyphens; or the thing lacks something.
        """
        if not NAME.fullmatch(name):
            raise SpecError(f"the name of a {self.kind} must be small letters and digits with hyphens, got {name!r}")
        if name in self.reserved or name in self.names():
            raise SpecError(f"there is a {self.kind} {name!r} already; take another name")
        wanted = [*protocol.__annotations__, *(key for key in vars(protocol) if not key.startswith("_"))]
        missing = [key for key in wanted if not hasattr(thing, key)]
        if missing:
            raise SpecError(f"the {self.kind} {name!r} lacks {', '.join(missing)}")
        self._registered[name] = thing
        self.changes += 1

    def unregister(self, name: str) -> None:
        """Take away what was registered under `name`; what padgen brings stays.

        Raises
        ------
        SpecError
            Nothing was registered under it.
        """
        if name not in self._registered:
            raise unknown_name(name, list(self._registered), f"registered {self.kind}", "")
        del self._registered[name]
        self.changes += 1

    @property
    def registered(self) -> tuple[str, ...]:
        """Names of what was registered, which padgen does not bring."""
        plugin_code()
        return tuple(self._registered)

    def version(self, name: str) -> int:
        """0 for what padgen brings; for what was registered another number each time, for the keys of caches."""
        return self.changes if name in self._registered else 0

    def get(self, name: str, where: str = "") -> T:
        """The thing of that name.

        Raises
        ------
        SpecError
            There is none; the sentence, about the field `where`, tells the nearest name.
        """
        # Names that padgen brings cannot be registered: plugins need not be looked for.
        if name not in _names_of_files(self._package):
            if name not in self.registered:
                raise unknown_name(name, list(self.names()), self.kind, where)
            return self._registered[name]
        return cast(T, _module(self._package, name))


@cache
def _module(package: str, name: str) -> Any:
    """The module of a name, kept: plans ask for it a thousand times, and `import_module` takes its time."""
    return import_module(f"{package}.{'_' * name[0].isdigit()}{name.replace('-', '_')}")


@cache
def _names_of_files(package: str) -> tuple[str, ...]:
    """Names of the modules in a package of padgen.

    One with an underscore before it is private, unless that stands before a digit, with which no module can begin.
    """
    folder = Path(__file__).parents[1].joinpath(*package.split(".")[1:])
    stems = (re.sub(r"^_(?=\d)", "", path.stem) for path in folder.glob("*.py"))
    return tuple(sorted(stem.replace("_", "-") for stem in stems if stem[0] != "_"))


def plugin_code() -> str:
    """Import the modules that `PLUGINS` names; returns a hash of their code, empty where there are none.

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
    """Names, by kind, of the registered things that a plan may depend on."""
    return {registry.kind: registry.registered for registry in (SUSPENSIONS, SCHEMES)}


def unknown_name(name: str, known: list[str], what: str, where: str) -> SpecError:
    """The error for a `name` that is none of `known`, with the nearest one that is."""
    hint = _nearest(name, known) or "known are " + ", ".join(sorted(known))
    return SpecError(f"there is no {what} {shown(name)}; {hint}", where)


def names_in(text: str, known: Iterable[str], where: str, optional: bool = False) -> tuple[str, ...]:
    """Names of a comma-separated list, in the order of `known`; none at all only if that is `optional`.

    >>> names_in("step, stl,", ("stl", "3mf", "step"), "--formats")
    ('stl', 'step')

    Raises
    ------
    SpecError
        A name is none of `known`: the sentence, about the option `where`, tells all and the nearest.
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
    """A question for the one of `known` that is nearest to `name`, empty if none is near."""
    from difflib import get_close_matches

    near = get_close_matches(name[:LONGEST_PART], known, n=1, cutoff=0.5)
    return f"did you mean {near[0]!r}?" if near else ""


SUSPENSIONS: Registry[Any] = Registry("suspension", "padgen.planner.suspensions", reserved=("auto",))
"""Modules or objects that hold to `padgen.planner.suspensions.Suspension`."""
FORMATS: Registry[Any] = Registry("drive format", "padgen.driver.formats")
"""Modules or objects that hold to `padgen.driver.formats.DriveFormat`."""
PAD_FORMATS: Registry[Any] = Registry("pad format", "padgen.solid.formats")
"""Modules or objects that hold to `padgen.solid.formats.PadFormat`."""
USUAL_FORMATS = ("stl", "3mf", "step")
"""Those of `PAD_FORMATS` that a pad is saved in where nothing else is asked for."""
SCHEMES: Registry[Any] = Registry("drive scheme", "padgen.physics.schemes", reserved=("auto",))
"""Modules or objects that hold to `padgen.physics.schemes.DriveScheme`."""
COILS: Registry[Any] = Registry("kind of coil", "padgen.planner.coils")
"""Modules or objects that hold to `padgen.planner.coils.CoilKind`."""
