"""Fixtures that many tests share: plans and pads, made once, and a cache of their own."""

import os
import signal

# A shell's background processes ignore Ctrl-C, and would hand that down to the commands that tests stop.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# As the command does: threads cost more than they bring to small matrices. Before numpy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

import padgen as pg
from padgen.core import seal
from padgen.core.cache import VARIABLE
from padgen.planner import Plan
from padgen.solid.kernel import build123d
from padgen.spec import Spec, load_spec, parse_spec

FOUR_LINES = 'name = "tiny"\nresolution = 4\nband_hz = [50, 200]\nq_min = 15\n'
SMALL = FOUR_LINES + "coil = { grid = [1, 1] }\n[pad]\nwidth_mm = 25\ndepth_mm = 25\n"


# As plans are made: code that means to divide by zero has an errstate of its own.
np.seterr(divide="raise", over="raise", invalid="raise")
# Loaded after the finite-element engine, which carries another OCCT, build123d does not work; before it, it does.
build123d()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--regenerate", action="store_true", help="write the golden texts anew")


LONGEST = (
    "docs",
    "page",
    "touched_prints",
    "explore",
    "templates",
    "limits",
    "slots",
    "explain",
    "elasticity",
    "yield",
)
"""Files whose tests take longest, which begin first, so that no process works on one of them while others are done."""


@pytest.hookimpl(tryfirst=True)  # before pytest leaves out those marked soak
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take longest, and leave to `make soak` what a test's `sample` does not take.

    ``@pytest.mark.sample(3)`` takes three of a test's cases, the first, the last and one half way between.
    """
    items.sort(key=lambda item: item.path.stem.removeprefix("test_") not in LONGEST)
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("sample") and not item.get_closest_marker("soak"):
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for of_test in cases.values():
        count = of_test[0].get_closest_marker("sample").args[0]
        taken = {round(at) for at in np.linspace(0, len(of_test) - 1, count)}
        for number, item in enumerate(of_test):
            if number not in taken:
                item.add_marker("soak")


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Give all tests one cache and one secret, shared between their processes, apart from the user's."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    os.environ[VARIABLE] = str(folder / "shared-cache")
    os.environ[seal.VARIABLE] = str(folder / "shared-state")


@pytest.fixture(scope="session")
def paper_spec() -> Spec:
    return load_spec("paper-32")


@pytest.fixture(scope="session")
def paper_plan(paper_spec: Spec) -> Plan:
    return pg.plan(paper_spec)


@pytest.fixture(scope="session")
def small_plan() -> Plan:
    """Plan a pad of four taxels that is quick to build."""
    return pg.plan(parse_spec(SMALL))


@pytest.fixture(scope="session")
def small_pad(small_plan: Plan):
    from padgen.solid.pad_solid import build_pad

    return build_pad(small_plan)
