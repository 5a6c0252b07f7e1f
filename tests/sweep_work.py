"""Stand-ins for making variants, used by the workers in tests of sweeps: quick, or misbehaving on purpose.

They are a module of their own, so that a worker need not load the tests.
"""

import os
import signal
import time
from concurrent.futures import Future
from pathlib import Path

from padgen.batch.variant import Task, VariantRecord
from padgen.core.errors import FileError

PLACE = "PADGEN_TEST_FOLDER"
"""Environment variable with the folder in which `counted` adds a line for each variant that it makes."""


def made(task: Task, **figures) -> VariantRecord:
    told = {"taxels": task.number + 1, **figures}
    return VariantRecord(task.number, task.key, "done", "", task.values, told, 0, 0, (), 0.001, 1.0)


def counted(task: Task) -> VariantRecord:
    """Make a variant at once, and note its number in a file."""
    with open(Path(os.environ[PLACE], "ran"), "a") as file:
        file.write(f"{task.number}\n")
    return made(task)


def slow(task: Task) -> VariantRecord:
    time.sleep(0.05)
    return counted(task)


def brief(task: Task) -> VariantRecord:
    """Make a variant in a tenth of a second, for tests that allow a second."""
    time.sleep(0.1)
    return counted(task)


def uneven(task: Task) -> VariantRecord:
    """Make later variants sooner, so that they end in another order; odd and even ones have different figures."""
    time.sleep(0.1 * (5 - task.number % 6))
    return made(task, **({"odd": 1.5} if task.number % 2 else {"even": "x"}))


def killed(task: Task) -> VariantRecord:
    """Kill the process at variant 3, and crash it at variant 5."""
    if task.number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    if task.number == 5:
        os.kill(os.getpid(), signal.SIGSEGV)
    return counted(task)


def hungry(task: Task) -> VariantRecord:
    """Take memory without end at variant 2, and time without end at variant 4."""
    hoard = []
    while task.number == 2:
        hoard.append(b"x" * 10_000_000)
        time.sleep(0.002)
    if task.number == 4:
        time.sleep(600)
    return counted(task)


def clumsy(task: Task) -> VariantRecord:
    """Fail in a different way at each variant, and print noise."""
    print("noise", flush=True)
    os.write(1, b"more noise")
    if task.number == 0:
        raise OSError(5, "Input/output error")
    if task.number == 1:
        raise SystemExit(3)
    if task.number == 2:
        raise FileError("cannot be written (Input/output error)", "out/x")
    if task.number == 3:
        return made(task, unsendable=lambda: None)
    if task.number == 4:
        return made(task, nan=float("nan"), text="two\nlines")
    return made(task)


def failing(task: Task) -> VariantRecord:
    """Fail variant 1 as long as there is a file ``broken``."""
    record = counted(task)
    if task.number == 1 and Path(os.environ[PLACE], "broken").exists():
        return VariantRecord(task.number, task.key, "failed", "it is broken", task.values, {}, 0, 0, (), 0.001, 1.0)
    return record


def full(task: Task) -> VariantRecord:
    """Report a full disk from variant 3 on, as long as there is a file ``full``."""
    if task.number >= 3 and Path(os.environ[PLACE], "full").exists():
        sentence = "out/s-00003: cannot be written (No space left on device)"
        return VariantRecord(task.number, task.key, "failed", sentence, task.values, {}, 0, 0, (), 0.001, 1.0)
    return counted(task)


def tiny(task: Task) -> VariantRecord:
    return made(task)


def held(task: Task) -> VariantRecord:
    """Wait at variant 4 until there is a file ``go``."""
    while task.number == 4 and not Path(os.environ[PLACE], "go").exists():
        time.sleep(0.01)
    return counted(task)


class Inline:
    """An executor that runs a task when it is submitted, in this process."""

    def __init__(self, work=tiny) -> None:
        self.work = work

    def submit(self, function, tasks, *rest):
        future = Future()
        future.set_result([self.work(task) for task in tasks])
        return future
