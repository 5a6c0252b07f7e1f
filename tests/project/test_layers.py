"""Imports go one way between rooms and within them, and every module states its public names."""

import ast
import importlib
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2] / "padgen"
LAYERS = [
    {"core"},
    {"spec", "physics"},
    {"planner"},
    {"measured", "sliced"},
    {"solid", "driver", "verify"},
    {"make"},
    {"ladders"},
    {"batch"},
    {"report"},
    {"api"},
    {"cli"},
    {"__main__"},
]
ONLY = {"cli": {"api", "report", "core"}}
"""The rooms that a room may import, where these are not all below it: commands call the public functions."""
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}
MODULES = sorted(ROOT.rglob("*.py"))
FACES = {("planner/plan.py", "report"), ("make/pad.py", "report"), ("ladders/study.py", "report")}
"""Imports within a method by which a noun shows itself to a notebook or a plot."""


@cache
def tree(path: Path) -> ast.Module:
    """Return a module's syntax tree."""
    return ast.parse(path.read_text())


def room(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return parts[0]


def imported_rooms(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(tree(path)):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative imports hide the direction"
            names = [node.module or ""]
        found |= {name.split(".")[1] for name in names if name.startswith("padgen.")}
    return found


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_go_one_way(path):
    own = room(path)
    if own == "__init__":
        return
    faces = {room for module, room in FACES if module == str(path.relative_to(ROOT))}
    for other in imported_rooms(path) - {own} - faces:
        assert LEVEL[other] < LEVEL[own], f"{own} must not import {other}"
        assert other in ONLY.get(own, LEVEL), f"{own} must import {', '.join(sorted(ONLY[own]))} only, not {other}"


def module_name(path: Path, root: Path = ROOT) -> str:
    return ".".join(path.relative_to(root.parent).with_suffix("").parts).removesuffix(".__init__")


def run_imports(node: ast.AST) -> Iterator[str]:
    """Return names that may be modules, imported when a module is loaded or one of its functions runs."""
    if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
        for child in node.orelse:
            yield from run_imports(child)
        return
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        yield node.module
        yield from (f"{node.module}.{alias.name}" for alias in node.names)
    for child in ast.iter_child_nodes(node):
        yield from run_imports(child)


def circles(root: Path) -> list[str]:
    """Return one circle of imports for each room that has any."""
    rooms = defaultdict(dict)
    for path in root.rglob("*.py"):
        place = path.relative_to(root).parts
        rooms[place[0]][module_name(path, root)] = set(run_imports(tree(path)))
    found = []
    for modules in rooms.values():
        graph = {name: (imported & modules.keys()) - {name} for name, imported in modules.items()}
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:
            found.append(" <- ".join(error.args[1]))
    return found


def test_no_circles_within_a_room():
    assert circles(ROOT) == []


LATER = "def f():\n    from toy.room{}"
ONLY_TYPES = "import typing\nif typing.TYPE_CHECKING:\n    from toy.room.a import x\n"


@pytest.mark.parametrize(
    "b, c, circle",
    [
        ("x = 1", "x = 1", False),
        ("import toy.room.c", "from toy.room.a import x", True),
        ("from toy.room import c", LATER.format(".a import x"), True),
        (LATER.format(" import a"), "x = 1", True),
        (ONLY_TYPES, "x = 1", False),
        (f"{ONLY_TYPES}else:\n    import toy.room.a", "x = 1", True),
        ("from toy.other.d import x", "x = 1", False),
    ],
)
def test_circles_are_found(tmp_path, b, c, circle):
    """A circle a → b → c counts, also by imports within functions, but not by types alone or through another room."""
    for name, text in {
        "room/a": "from toy.room.b import x",
        "room/b": b,
        "room/c": c,
        "other/d": "import toy.room.a",
    }.items():
        path = tmp_path / "toy" / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    found = circles(tmp_path / "toy")
    assert len(found) == circle, found


def test_file_names_tell_modules_apart():
    """No two rooms have a file of the same name; `cli` has one for each command, figures and coils have their names."""
    places = defaultdict(list)
    for path in MODULES:
        if path.stem != "__init__" and room(path) != "cli" and path.parent.name not in ("figures", "coils"):
            places[path.name].append(str(path.relative_to(ROOT)))
    assert [same for same in places.values() if len(same) > 1] == []


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_all_is_true(path):
    name = module_name(path)
    if name.endswith("__main__"):
        return
    module = importlib.import_module(name)
    if path.name == "__init__.py" and not hasattr(module, "__all__"):
        return
    assert len(set(module.__all__)) == len(module.__all__)
    for public in module.__all__:
        assert hasattr(module, public)
