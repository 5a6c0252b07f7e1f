"""What padgen is made of and where it runs: `make sbom` and `make wheels`.

``python docs/supply.py sbom FILE`` writes the software bill of materials of the environment (CycloneDX 1.6): the
packages of padgen and of the extras that users install, with licences and the lock's hashes, and the report page's
scripts. ``python docs/supply.py wheels`` installs a wheel in a fresh environment of each Python, plans a pad there, and
compares the plans byte by byte.
"""

import base64
import json
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import padgen

ROOT = Path(__file__).parents[1]
LOCKED = re.compile(r"^([\w.-]+)==([^\s;]+)[^\n]*\\\n((?:[ ]+--hash=sha256:[0-9a-f]{64}(?: \\)?\n)+)", re.M)
NOT_USERS = ("dev", "docs")
"""Extras of those who work on padgen."""
PYTHONS = ("3.11", "3.12", "3.13")
PACKED = ("padgen", "templates", "pyproject.toml", "setup.py", "README.md", "LICENSE")
PAD = "pad-32"


def locked() -> dict[str, tuple[str, str, list[str]]]:
    """Return version, whole entry and SHA-256 hashes of each package in the lock file, by its canonical name."""
    text = (ROOT / "requirements.lock").read_text()
    found = LOCKED.finditer(text)
    return {
        str(canonicalize_name(entry[1])): (entry[2], entry[0], re.findall("sha256:([0-9a-f]{64})", entry[3]))
        for entry in found
    }


def needed(requirements: list[str]) -> set[str]:
    """Return the canonical names of all installed packages that these requirements bring."""
    names: set[str] = set()
    seen: set[tuple[str, str]] = set()
    left = [(Requirement(text), "") for text in requirements]
    while left:
        requirement, extra = left.pop()
        name = str(canonicalize_name(requirement.name))
        if requirement.marker and not requirement.marker.evaluate({"extra": extra}):
            continue
        for wanted in {"", *requirement.extras}:
            if (name, wanted) in seen:
                continue
            seen.add((name, wanted))
            names.add(name)
            left += [(Requirement(text), wanted) for text in distribution(name).requires or ()]
    return names


def sbom(path: Path) -> None:
    """Write the bill of materials, after it was found valid."""
    from cyclonedx.schema import SchemaVersion
    from cyclonedx.validation.json import JsonStrictValidator

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    required = needed(project["dependencies"])
    for_users = needed([text for name in extras.keys() - set(NOT_USERS) for text in extras[name]])
    command = [sys.executable, "-m", "cyclonedx_py", "environment", "--pyproject", ROOT / "pyproject.toml"]
    options = ["--output-reproducible", "--no-validate", "--spec-version", "1.6", "--output-file", "-", sys.executable]
    told = subprocess.run([*map(str, command), *options], check=True, capture_output=True, text=True).stdout
    bom: dict[str, Any] = json.loads(told)
    root = bom["metadata"]["component"]
    root |= {"version": padgen.__version__, "purl": f"pkg:pypi/padgen@{padgen.__version__}"}
    lock = locked()
    components = []
    for component in bom["components"]:
        name = str(canonicalize_name(component["name"]))
        if name not in required | for_users:
            continue
        component["scope"] = "required" if name in required else "optional"
        version, _, hashes = lock.get(name, ("", "", []))
        if version == component["version"]:
            component["externalReferences"] = [
                *component.get("externalReferences", ()),
                _files(component["purl"], [("SHA-256", each) for each in hashes]),
            ]
        components.append(component)
    modules = json.loads((ROOT / "padgen/report/page/package-lock.json").read_text())["packages"]
    for place, module in sorted(modules.items()):
        if not place or module.get("dev"):
            continue
        name = place.removeprefix("node_modules/")
        purl = f"pkg:npm/{name}@{module['version']}"
        algorithm, encoded = module["integrity"].split("-", 1)
        digest = base64.b64decode(encoded).hex()
        components.append(
            {
                "type": "library",
                "bom-ref": purl,
                "name": name,
                "version": module["version"],
                "purl": purl,
                "scope": "required",
                "description": "bundled in padgen/report/page/page.min.js",
                "licenses": [{"license": {"id": module["license"]}}],
                "externalReferences": [_files(purl, [(algorithm.replace("sha", "SHA-"), digest)])],
            }
        )
    bom["components"] = components
    known = {component["bom-ref"] for component in components}
    direct = {str(canonicalize_name(Requirement(text).name)) for text in project["dependencies"]}
    for name in extras.keys() - set(NOT_USERS):
        direct |= {str(canonicalize_name(Requirement(text).name)) for text in extras[name]}
    links = {entry["ref"]: [ref for ref in entry.get("dependsOn", ()) if ref in known] for entry in bom["dependencies"]}
    links[root["bom-ref"]] = [
        component["bom-ref"]
        for component in components
        if component["purl"].startswith("pkg:npm/") or canonicalize_name(component["name"]) in direct
    ]
    bom["dependencies"] = [
        {"ref": ref, "dependsOn": sorted(links.get(ref, ()))} for ref in sorted({root["bom-ref"], *known})
    ]
    text = json.dumps(bom, indent=1, sort_keys=True, ensure_ascii=False) + "\n"
    fault = JsonStrictValidator(SchemaVersion.V1_6).validate_str(text)
    if fault is not None:
        raise SystemExit(f"sbom: not valid CycloneDX 1.6: {fault}")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    print(f"{path}: {len(components)} components, CycloneDX 1.6, valid")


def _files(purl: str, hashes: list[tuple[str, str]]) -> dict[str, Any]:
    """Return a reference to a release's files, one of which is installed, by their hashes."""
    return {
        "type": "distribution",
        "url": purl,
        "comment": "hashes of the release's files, of which one is installed",
        "hashes": [{"alg": algorithm, "content": digest} for algorithm, digest in hashes],
    }


def wheels() -> None:
    """Plan a pad by an installed wheel under each Python that this machine has, and compare the plans."""
    uv = shutil.which("uv", path=str(Path(sys.executable).parent)) or "uv"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lock = locked()
    entries = [lock[name][1] for name in sorted(needed(project["dependencies"]))]
    plans: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory() as folder:
        aside = Path(folder)
        source = aside / "padgen"
        source.mkdir()
        for name in PACKED:
            copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
            copy(ROOT / name, source / name)
        pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check"]
        offline = ["--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", folder, str(source)]
        subprocess.run([*pip, *offline], check=True)
        (wheel,) = aside.glob("*.whl")
        print(wheel.name)
        (aside / "runtime.lock").write_text("".join(entries))
        for version in PYTHONS:
            python = _python(uv, version)
            if python is None:
                print(f"Python {version}: missing on this machine, not tried")
                continue
            place = aside / version
            _run(uv, "venv", "--quiet", "--python", python, place)
            into = (uv, "pip", "install", "--quiet", "--python", place / "bin/python")
            _run(*into, "--require-hashes", "--only-binary", ":all:", "-r", aside / "runtime.lock")
            _run(*into, "--no-deps", "--no-index", wheel)
            told = _run(place / "bin/padgen", "--version").strip()
            if not told.endswith(padgen.__version__):
                raise SystemExit(f"Python {version}: padgen --version says {told!r}, must be {padgen.__version__}")
            _run(place / "bin/padgen", "plan", PAD, "-o", place / "out", may_find=True)
            plans[version] = (place / "out/plan.json").read_bytes()
            full = _run(place / "bin/python", "-c", "import platform; print(platform.python_version())").strip()
            print(f"Python {full}: {told}, planned {PAD}")
    if not plans:
        raise SystemExit(f"wheels: none of Python {', '.join(PYTHONS)} is on this machine")
    first = next(iter(plans))
    other = [version for version in plans if plans[version] != plans[first]]
    if other:
        raise SystemExit(f"wheels: plan.json of {PAD} under Python {', '.join(other)} differs from that under {first}")
    print(f"plan.json is the same under Python {', '.join(plans)}")


def _python(uv: str, version: str) -> str | None:
    """Return the path of a Python on this machine, from Debian's packages where it was missing, or None."""
    find = [uv, "python", "find", "--system", "--no-python-downloads", "--no-project", version]
    done = subprocess.run(find, capture_output=True, text=True)
    if done.returncode == 0:
        return done.stdout.strip()
    if shutil.which("pyenv"):  # whose programs on the path start one version only
        root = Path(_run("pyenv", "root").strip())
        for found in sorted(root.glob(f"versions/{version}.*/bin/python{version}")):
            return str(found)
    if shutil.which("apt-get"):
        names = [f"python{version}", f"python{version}-venv"]
        subprocess.run(["apt-get", "install", "-y", "-qq", "--no-install-recommends", *names], capture_output=True)
        return shutil.which(f"python{version}", path="/usr/bin")
    return None


def _run(*command: object, may_find: bool = False) -> str:
    """Run a command and return what it prints; end with its complaint where it fails.

    Exit code 1 of padgen, a finding, is no failure where `may_find`.
    """
    done = subprocess.run([*map(str, command)], capture_output=True, text=True)
    if done.returncode > (1 if may_find else 0) or done.returncode < 0:
        raise SystemExit(f"{' '.join(map(str, command))}: exit code {done.returncode}\n{done.stderr}")
    return done.stdout


if __name__ == "__main__":
    if sys.argv[1:2] == ["sbom"] and len(sys.argv) == 3:
        try:
            sbom(Path(sys.argv[2]))
        except PackageNotFoundError as error:
            raise SystemExit(f"sbom: the package {error.name} is not installed; make setup installs all") from error
    elif sys.argv[1:] == ["wheels"]:
        wheels()
    else:
        raise SystemExit("usage: python docs/supply.py sbom FILE | wheels")
