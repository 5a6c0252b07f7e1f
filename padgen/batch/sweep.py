"""Run a sweep over any executor: a bounded window of tasks, every record kept at once, whatever breaks down.

The code path is one: what is submitted makes variants in a watched worker process (`padgen.core.runner`),
on this machine or wherever the executor's own workers are.
"""

import errno
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from padgen.batch.definition import Sweep
from padgen.batch.events import Clock, Event, Tell
from padgen.batch.folder_lock import FolderLock
from padgen.batch.index import INDEX, PARETO_FILES, Journal, write_index
from padgen.batch.points import count_points, variant_name, variants
from padgen.batch.variant import Record, Task, is_whole, run_task, task_of, writes_folders
from padgen.batch.window import LostError, StoppedError, Window, records_of
from padgen.batch.worker import IMPORTS, Work, broken, make_variants, run_tasks
from padgen.core.cache import limit_bytes
from padgen.core.errors import FileError, SpecError
from padgen.core.files import remove_unchanged, take_away
from padgen.core.runner import Runner, core_count, refuse_unshared, uninterrupted
from padgen.make.pad import parse_formats

__all__ = ["SweepResult", "run_sweep"]

AHEAD = 4
"""Tasks that wait for each worker of our own."""
FOREIGN_AHEAD = 256
TICK_S = 1.0
"""Between signs of life when no variant ends."""
DISK_FULL = tuple(os.strerror(code) for code in (errno.ENOSPC, errno.EDQUOT))
MOST_LOST = 8
"""Tasks in a row that an executor may lose before it is given up."""
NOTHING, TO_RUN, TO_REPLACE = 0, 1, 2
"""What is left of a variant: nothing; to make it; to make it over what an earlier run left."""


@dataclass(frozen=True, slots=True)
class SweepResult:
    """What a sweep came to.

    ``total = done + refused + failed + left``; `kept` of them were finished by an earlier run. `stopped` is
    the sentence why variants are left, empty when none is; `interrupted`, whether that was Ctrl-C.
    """

    folder: Path
    index: Path
    total: int
    done: int
    refused: int
    failed: int
    kept: int
    left: int
    seconds: float
    stopped: str
    interrupted: bool


def run_sweep(
    sweep: Sweep,
    folder: Path,
    executor: Any = None,
    workers: int | None = None,
    resume: bool = True,
    retry: bool = False,
    on_event: Tell = lambda event: None,
    work: Work = run_task,
    chunk: int = 1,
) -> SweepResult:
    """Make all variants of `sweep` in `folder`, and `index.csv` with a row for each.

    Parameters
    ----------
    executor : concurrent.futures.Executor, optional
        Where variants are made; by default in processes of this machine. It is not shut down, and what it is at
        when the sweep is interrupted it may still finish.
    workers : int, optional
        How many processes of this machine; by default as many as there are cores.
    resume : bool
        Whether variants that are finished (done or refused) with the same inputs are left as they are; failed
        ones are told again, and tried again only with `retry`.
    work : callable
        What makes a variant; importable by name.
    chunk : int
        Variants a task: more than one where an executor takes long to start a task, as a cluster's queue.

    Raises
    ------
    SpecError
        The sweep cannot be laid out; nothing is written.
    FileError
        Another sweep writes into the folder, or it cannot be written to; what is done is kept.
    """
    formats = parse_formats(sweep.settings.formats)
    limit_bytes()  # refused here rather than by each variant
    refuse_unshared()
    numbers, folder = count_points(sweep), folder.absolute()
    # All of them where a constraint may not be worked out for one, so that nothing is written then.
    if not (sum(1 for _ in variants(sweep)) if sweep.constraints else numbers):
        raise SpecError(f"leave none of {numbers} variants; loosen one", "constraints")
    with FolderLock(folder), Journal(folder, numbers) as journal:
        run = _Run(sweep, folder, formats, journal, on_event)
        with _place(executor, workers or core_count(), prepared=0 if journal.lines else numbers) as place:
            run.survey(resume, retry)
            if run.replaces:
                # So that a killed run leaves no index of what is not there any more.
                write_index(journal, sweep, folder)
                remove_unchanged(folder, PARETO_FILES)
            run.tell("start")
            run.tell_failed()
            window = Window(place.pool, place.most, place.function, work, sweep.limits)
            try:
                _run_all(run, window, chunk)
            except KeyboardInterrupt:
                run.stopped, run.interrupted = "interrupted", True
            except StoppedError as error:
                run.stopped = str(error)
            finally:
                with uninterrupted():
                    try:
                        # Before the workers are ended, as what they were at would come back as failed.
                        _harvest(run, window)
                    finally:
                        place.close()
                        _conclude(run)
        run.tell("end")
        return run.result()


def _conclude(run: "_Run") -> None:
    """Write the index; where the sweep has been stopped already, that it cannot be written is one more reason."""
    try:
        run.journal.refuse_removed()
        write_index(run.journal, run.sweep, run.folder)
        run.journal.compact()
    except FileError as error:
        if not run.stopped:
            raise
        run.stopped += f"; {error}"


class _Place(NamedTuple):
    """Where variants are made: what tasks are submitted to, how many at a time, and what is called there."""

    pool: Any
    most: int
    function: Callable[..., list[Record]]
    close: Callable[[], None] = lambda: None


@contextmanager
def _place(executor: Any, workers: int, prepared: int) -> Iterator[_Place]:
    """The caller's executor, or processes of this machine, of which up to `prepared` are started at once."""
    if executor is not None:
        yield _Place(executor, FOREIGN_AHEAD, run_tasks)
        return
    with Runner(workers, IMPORTS) as own:
        own.prepare(min(workers, prepared))
        yield _Place(own.threads, AHEAD * workers, partial(make_variants, own), own.close)


class _Run:
    """The state of a running sweep: what each variant is at, and how many are."""

    def __init__(self, sweep: Sweep, folder: Path, formats: tuple[str, ...], journal: Journal, on_event: Tell) -> None:
        self.sweep, self.folder, self.journal = sweep, folder, journal
        self.stopped, self.interrupted = "", False
        self.counts = {"done": 0, "refused": 0, "failed": 0}
        self.total = self.kept = 0
        self._formats, self._on_event = formats, on_event
        self._folders = writes_folders(sweep)
        self._todo = bytearray(journal.numbers)
        self._clock = Clock(time.monotonic)

    @property
    def left(self) -> int:
        """Variants without a record of this sweep."""
        return self.total - sum(self.counts.values())

    @property
    def replaces(self) -> bool:
        """Whether a variant is to be made over what an earlier run left."""
        return TO_REPLACE in self._todo

    def survey(self, resume: bool, retry: bool) -> None:
        """Find out which variants there are and which are finished; leave out the others' records."""
        present = bytearray(len(self._todo))
        for variant in variants(self.sweep):
            number = variant.number
            present[number] = 1
            self.total += 1
            status = ""
            if self.journal.known(number):
                task = task_of(self.sweep, variant, self._formats, self.folder)
                status = self._kept_status(task)
            if not status or not resume or (retry and status == "failed"):
                self._todo[number] = TO_REPLACE if self.journal.known(number) else TO_RUN
            else:
                self.counts[status] += 1
                self.kept += 1
            if not status:
                self.journal.forget(number)
        for number, there in enumerate(present):
            if not there:
                self.journal.forget(number)

    def _kept_status(self, task: Task) -> str:
        status = self.journal.status(task.number, task.key)
        lost = status == "done" and task.out and not is_whole(Path(task.out), task.stage)
        return "" if lost else status

    def tasks(self) -> Iterator[Task]:
        """The variants that are to be made, as they are asked for."""
        for variant in variants(self.sweep):
            if self._todo[variant.number] == TO_REPLACE:
                self.journal.disown(variant.number)
            if self._todo[variant.number]:
                yield task_of(self.sweep, variant, self._formats, self.folder)

    def keep(self, record: Record) -> None:
        """Take in what came of a variant."""
        if not self._todo[record.number]:
            return  # told twice: an executor ran its task again
        if any(reason in record.sentence for reason in DISK_FULL):
            raise StoppedError(record.sentence)  # not the variant's fault: the next run makes it
        if record.status != "done" or not self._folders:
            take_away(self.folder / variant_name(self.sweep, record.number))
        self.journal.add(record)
        self._todo[record.number] = NOTHING
        self.counts[record.status] += 1
        self._clock.tick()
        self.tell(record.status, record)

    def tell_failed(self) -> None:
        """The failed variants of earlier runs that are not tried again, each with its sentence."""
        for number in self.journal.numbers_of("failed"):
            if not self._todo[number]:
                self.tell("failed", self.journal.record(number), True)

    def tell(self, kind: str, record: Record | None = None, reused: bool = False) -> None:
        """Tell the caller."""
        eta_s = self._clock.eta_s(self.left)
        self._on_event(Event(kind, **self._told(), eta_s=eta_s, record=record, reused=reused))

    def result(self) -> SweepResult:
        """What it came to."""
        return SweepResult(
            self.folder, self.folder / INDEX, **self._told(), stopped=self.stopped, interrupted=self.interrupted
        )

    def _told(self) -> dict[str, Any]:
        left = {"kept": self.kept, "left": self.left}
        return {"total": self.total, **self.counts, **left, "seconds": self._clock.seconds}


def _run_all(run: _Run, window: Window, chunk: int) -> None:
    """Keep the executor busy until all variants have a record."""
    tasks = run.tasks()
    tried_once: set[int] = set()
    alone: list[list[Task]] = []
    lost = 0
    while True:
        while not window.full and (batch := alone.pop() if alone else list(islice(tasks, chunk))):
            window.give(batch)
        if not len(window):
            return
        taken = window.take(TICK_S)
        if taken is None:
            run.tell("progress")
            continue
        try:
            records = records_of(*taken)
        except LostError as error:
            lost += 1
            if lost >= MOST_LOST:
                raise StoppedError(f"does not make variants ({error})", "executor") from error
            records = [broken(task, f"its worker was lost ({error})") for task in taken[1] if task.number in tried_once]
            # One by one, so that the next loss costs one variant.
            alone += [[task] for task in taken[1] if task.number not in tried_once]
            tried_once |= {task.number for task in taken[1]}
        else:
            lost = 0
        for record in records:
            run.keep(record)


def _harvest(run: _Run, window: Window) -> None:
    for taken in window.rest():
        with suppress(LostError, StoppedError, FileError):
            for record in records_of(*taken):
                run.keep(record)
