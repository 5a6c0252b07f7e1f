"""The lock file, `constraints.txt` and `pyproject.toml` say the same, and each locked package has its hashes."""

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[2]
ENTRY = re.compile(r"([\w.-]+)==([^\s;]+)(?: ; ([^\\]+?))?(?: --hash=sha256:[0-9a-f]{64})+")


def lock():
    """Return version and marker of each entry of the lock file, which has nothing else but its two first lines."""
    text = (ROOT / "requirements.lock").read_text()
    logical = re.sub(r" \\\n +", " ", text).splitlines()
    assert [line[0] for line in logical[:2]] == ["#", "#"]
    entries = [ENTRY.fullmatch(line) for line in logical[2:]]
    wrong = [line[:80] for line, entry in zip(logical[2:], entries, strict=True) if entry is None]
    assert not wrong, "each line is a name, an exact version, a marker perhaps, and SHA-256 hashes"
    return [(canonicalize_name(entry[1]), Version(entry[2]), entry[3]) for entry in entries]


def constraints():
    pinned = [Requirement(line) for line in (ROOT / "constraints.txt").read_text().splitlines()]
    assert all(len(each.specifier) == 1 and str(each.specifier).startswith("==") for each in pinned)
    assert not any(each.marker or each.url for each in pinned)
    return {canonicalize_name(each.name): Version(str(each.specifier)[2:]) for each in pinned}


def direct():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"].values()
    return [Requirement(text) for texts in (project["dependencies"], *extras) for text in texts]


def test_the_lock_names_the_versions_of_the_constraints():
    locked = lock()
    assert len({name for name, _, _ in locked}) == len(locked), "one version for every Python and platform"
    assert {name: version for name, version, _ in locked} == constraints(), "run make lock"


def test_direct_dependencies_are_locked_within_their_bounds():
    locked = {name: version for name, version, _ in lock()}
    for requirement in direct():
        assert locked[canonicalize_name(requirement.name)] in requirement.specifier, requirement.name


def test_direct_dependencies_are_locked_for_every_platform():
    markers = {name: marker for name, _, marker in lock()}
    limited = [requirement.name for requirement in direct() if markers[canonicalize_name(requirement.name)]]
    assert not limited


def test_the_build_takes_what_is_locked():
    needs = tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"]["requires"]
    locked = {name: version for name, version, _ in lock()}
    for requirement in map(Requirement, needs):
        assert locked[canonicalize_name(requirement.name)] in requirement.specifier


def test_neither_file_names_an_address():
    for name in ("requirements.lock", "constraints.txt"):
        assert "://" not in (ROOT / name).read_text()
        assert "--index" not in (ROOT / name).read_text()
