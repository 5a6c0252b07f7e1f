"""What workers do in the tests of sweeps, in place of making variants: quick, or misbehaving on purpose.

A module of its own, so that a worker need not load the tests.
"""

import os
import signal
import time
from pathlib import Path

from padgen.batch.variant import Record, Task
from padgen.core.errors import FileError

PLACE = "PADGEN_TEST_FOLDER"
"""Environment variable: where `counted` leaves a line for each variant that it makes."""


def made(task: Task, **figures) -> Record:
    told = {"taxels": task.number + 1, **figures}
    return Record(task.number, task.key, "done", "", task.values, told, 0, 0, (), 0.001, 1.0)


def counted(task: Task) -> Record:
    """Quick; leaves word that it ran."""
    with open(Path(os.environ[PLACE], "ran"), "a") as file:
        file.write(f"{task.number}\n")
    return made(task)


def slow(task: Task) -> Record:
    time.sleep(0.05)
    return counted(task)


def brief(task: Task) -> Record:
    """A tenth of a second each; of what may take one."""
    time.sleep(0.1)
    return counted(task)


def uneven(task: Task) -> Record:
    """Later variants are quicker, so that they end in another order; each second has another figure."""
    time.sleep(0.02 * (5 - task.number % 6))
    return made(task, **({"odd": 1.5} if task.number % 2 else {"even": "x"}))


def killed(task: Task) -> Record:
    """The system ends the process of variant 3, and a kernel crashes in variant 5."""
    if task.number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    if task.number == 5:
        os.kill(os.getpid(), signal.SIGSEGV)
    return counted(task)


def hungry(task: Task) -> Record:
    """Variant 2 takes memory without end, variant 4 time."""
    hoard = []
    while task.number == 2:
        hoard.append(b"x" * 10_000_000)
        time.sleep(0.002)
    if task.number == 4:
        time.sleep(600)
    return counted(task)


def clumsy(task: Task) -> Record:
    """Breaks down in every way that Python knows, and prints."""
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


def failing(task: Task) -> Record:
    """Variant 1 fails as long as there is a file ``broken``."""
    record = counted(task)
    if task.number == 1 and Path(os.environ[PLACE], "broken").exists():
        return Record(task.number, task.key, "failed", "it is broken", task.values, {}, 0, 0, (), 0.001, 1.0)
    return record


def full(task: Task) -> Record:
    """Finds the disk full from variant 3 on, as long as there is a file ``full``."""
    if task.number >= 3 and Path(os.environ[PLACE], "full").exists():
        sentence = "out/s-00003: cannot be written (No space left on device)"
        return Record(task.number, task.key, "failed", sentence, task.values, {}, 0, 0, (), 0.001, 1.0)
    return counted(task)


def tiny(task: Task) -> Record:
    return made(task)


def held(task: Task) -> Record:
    """Variant 4 waits until there is a file ``go``."""
    while task.number == 4 and not Path(os.environ[PLACE], "go").exists():
        time.sleep(0.01)
    return counted(task)
