"""The wheels that pip installs, of a checkout and of its sdist, in an environment without the checkout."""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PIP = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
NOT_PACKED = (".*", "__pycache__", "*.egg-info", "build", "dist", "docs", "out", "tests")


def pip_wheel(source: Path, folder: Path) -> Path:
    """Build a wheel with the installed setuptools, so that no network is needed."""
    command = [*PIP, "wheel", "--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", folder, source]
    subprocess.run([*map(str, command)], check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A copy of the checkout, since building leaves folders behind."""
    copy = tmp_path_factory.mktemp("checkout") / "padgen"
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*NOT_PACKED))
    return copy


@pytest.fixture(scope="module")
def wheel(checkout, tmp_path_factory):
    return pip_wheel(checkout, tmp_path_factory.mktemp("wheel"))


def environment(folder: Path) -> Path:
    """Make an empty environment that finds this one's packages, but no editable ones; return its folder of programs."""
    venv.create(folder, with_pip=False)
    paths = {name: sysconfig.get_path(name) for name in ("purelib", "platlib")}
    (site,) = folder.glob("lib/python*/site-packages")
    (site / "others.pth").write_text("\n".join(dict.fromkeys(paths.values())) + "\n")
    return folder / "bin"


def ran(*command: object, cwd: Path) -> str:
    own = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run([*map(str, command)], cwd=cwd, env=own, check=True, capture_output=True, text=True)
    return done.stdout


def works_in(programs: Path, cwd: Path) -> None:
    cwd.mkdir()
    told = ran(programs / "padgen", "templates", cwd=cwd).splitlines()
    assert [line.split()[0] for line in told] == sorted(path.stem for path in (ROOT / "templates").glob("*.toml"))
    ran(programs / "padgen", "plan", "paper-32", cwd=cwd)
    assert (cwd / "out/paper-32/plan.json").is_file()


def test_a_wheel_has_all_that_is_no_code(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    beside = {path for path in (ROOT / "padgen").rglob("*") if path.is_file() and "__pycache__" not in path.parts}
    assert names >= {path.relative_to(ROOT).as_posix() for path in beside}
    assert names >= {f"padgen/templates/{path.name}" for path in (ROOT / "templates").iterdir()}
    assert "padgen/py.typed" in names
    assert {name.split("/")[0] for name in names if ".dist-info" not in name} == {"padgen"}


def test_an_installed_wheel_works_without_a_checkout(wheel, tmp_path):
    programs = environment(tmp_path / "venv")
    install = [*PIP, "--python", programs / "python", "install", "--no-deps", "--no-index", wheel]
    ran(*install, cwd=tmp_path)
    works_in(programs, tmp_path / "empty")
    where = ran(programs / "python", "-c", "import padgen; print(padgen.__file__)", cwd=tmp_path)
    assert Path(where.strip()).is_relative_to(tmp_path / "venv")
    ran(programs / "padgen", "drive", "paper-32", "--formats", "c", cwd=tmp_path / "empty")
    assert (tmp_path / "empty/out/paper-32/padgen_drive.c").is_file()


@pytest.mark.soak
def test_the_wheel_of_an_sdist_is_the_same(checkout, wheel, tmp_path):
    make = "import sys; from setuptools import build_meta; print(build_meta.build_sdist(sys.argv[1]))"
    done = subprocess.run(
        [sys.executable, "-c", make, str(tmp_path)], cwd=checkout, check=True, capture_output=True, text=True
    )
    again = pip_wheel(tmp_path / done.stdout.split()[-1], tmp_path / "wheel")
    assert zipfile.ZipFile(again).namelist() == zipfile.ZipFile(wheel).namelist()


@pytest.mark.soak
def test_an_editable_install_finds_its_templates(checkout, tmp_path):
    programs = environment(tmp_path / "venv")
    install = ["install", "--no-deps", "--no-build-isolation", "--no-index", "--editable", checkout]
    subprocess.run([*map(str, [*PIP, "--python", programs / "python", *install])], check=True, capture_output=True)
    works_in(programs, tmp_path / "empty")
