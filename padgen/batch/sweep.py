"""Run a sweep on any executor: submit a limited number of tasks at a time, save each result at once, survive failures.

What is submitted makes variants in a watched worker process (`padgen.core.runner`), on this machine or wherever the
executor's own workers are. Of an executor only ``submit`` is used; of its futures ``result``, ``done`` and, where
there is one, ``add_done_callback``. So `concurrent.futures`, Dask, executorlib and submitit will do.

`connect` makes an executor of a Dask cluster whose workers would make the same variants as this machine.
"""

import errno
import logging
import os
import socket
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from html import escape
from importlib import import_module
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any

from padgen.batch.definition import Sweep, Variant, VariantLimits, count_points, variants
from padgen.batch.index import INDEX, Journal, Overview, overview_of, write_index
from padgen.batch.variant import Task, VariantRecord, recover_and_check_files, run_task, task_of, writes_folders
from padgen.core.cache import code_hash, limit_bytes, version, versions
from padgen.core.errors import LONGEST_PART, EngineMissingError, FileError, PadgenError, SpecError, number
from padgen.core.files import answer_within, locked, open_plain, reason, remove_own_files
from padgen.core.registry import PLUGINS, plugin_code
from padgen.core.runner import Runner, core_count, interrupted_later, refuse_unshared, uninterrupted

__all__ = [
    "IMPORTS",
    "Counts",
    "Event",
    "LostError",
    "StoppedError",
    "SweepResult",
    "SweepTable",
    "Window",
    "Work",
    "connect",
    "error_text",
    "failed_record",
    "fingerprint",
    "make_variants",
    "records_of",
    "run_sweep",
    "run_tasks",
    "run_to_table",
    "sole_sweep",
]


Work = Callable[[Task], VariantRecord]
POLL_S = 0.1
"""Between two looks at futures that do not call back."""
IMPORTS = ("padgen.planner",)
"""Modules that every variant needs, loaded before its limit of time counts."""


class StoppedError(PadgenError):
    """The sweep cannot go on: its executor makes no more variants, or its disk is full."""


class LostError(PadgenError):
    """The executor lost a task, for whatever reason, but may still be able to run other tasks."""


class Window:
    """An executor and the lists of tasks submitted to it; the caller lets at most `most` lists be unfinished at once.

    For each list of tasks it calls ``function(tasks, *rest)``.
    """

    def __init__(self, executor: Any, most: int, function: Callable[..., list[VariantRecord]], *rest: Any) -> None:
        self.most = most
        self._executor = executor
        self._function = function
        self._rest = rest
        self.pending: dict[int, tuple[Any, list[Task]]] = {}
        # A queue in C: Ctrl-C amid `Event` or `Future.done` would leave their locks held, and all threads stuck.
        self._finished: SimpleQueue[int] = SimpleQueue()

    def give(self, tasks: list[Task]) -> None:
        """Submit a list of tasks to the executor.

        Raises
        ------
        StoppedError
            The executor takes none.
        """
        with interrupted_later():
            try:
                future = self._executor.submit(self._function, tasks, *self._rest)
            except Exception as error:
                raise StoppedError(f"takes no more tasks ({error_text(error)})", "executor") from error
            self.pending[id(future)] = future, tasks
            if hasattr(future, "add_done_callback"):
                future.add_done_callback(lambda future: self._finished.put(id(future)))

    def take(self, wait_s: float) -> tuple[Any, list[Task]] | None:
        """Return a future that is finished, with its tasks; None when `wait_s` went by without one."""
        end = time.monotonic() + wait_s
        while (wait := end - time.monotonic()) > 0:
            try:
                return self.pending.pop(self._finished.get(timeout=min(wait, POLL_S)))
            except Empty:
                for key, (future, _) in self.pending.items():
                    if not hasattr(future, "add_done_callback") and future.done():
                        self._finished.put(key)
        return None

    def rest(self, cancels: bool = True) -> Iterator[tuple[Any, list[Task]]]:
        """Yield each finished future that `take` has not returned yet, with its tasks; cancel the unfinished ones.

        Without `cancels` those are left: a pool that has broken down ends its futures itself, and before Python 3.13
        its thread dies of one that was cancelled meanwhile.
        """
        for future, tasks in self.pending.values():
            if future.done():
                yield future, tasks
            elif cancels and hasattr(future, "cancel"):
                future.cancel()


def records_of(future: Any, tasks: list[Task]) -> list[VariantRecord]:
    """Return the records of a finished future, one a task.

    Raises
    ------
    StoppedError
        The executor has broken down or was shut down, or no worker can be started.
    LostError
        Anything else came instead.
    """
    # An executor that cancels as asyncio does has loaded it; we need not.
    cancelled = getattr(sys.modules.get("asyncio"), "CancelledError", CancelledError)
    try:
        records = future.result()
    except (CancelledError, cancelled) as error:
        raise StoppedError("has ended (it was shut down, or the connection to it was lost)", "executor") from error
    except (BrokenExecutor, PadgenError) as error:
        raise StoppedError(f"has ended ({error_text(error)})", "executor") from error
    except Exception as error:
        raise LostError(error_text(error)) from error
    asked = [(task.number, task.key) for task in tasks]
    if not isinstance(records, list) or [(r.number, r.key) for r in records if isinstance(r, VariantRecord)] != asked:
        raise LostError("what came back is not what was asked for")
    return records


def error_text(error: Any) -> str:
    """Return an error's message on one line, preceded by the error's type unless it is a `PadgenError`."""
    text = " ".join(str(error).split())
    return str(error) if isinstance(error, PadgenError) else f"{type(error).__name__}: {text}".rstrip(": ")


def run_tasks(tasks: list[Task], work: Work, limits: VariantLimits) -> list[VariantRecord]:
    """Make the variants of `tasks` in a worker process of the process that calls this, and return their records."""
    return make_variants(_own_runner(os.getpid()), tasks, work, limits)


@cache
def _own_runner(process: int) -> Runner:
    """Return this process's pool of workers, cached by process id, as a fork must not use the pool of its parent."""
    import atexit

    runner = Runner(imports=IMPORTS)
    atexit.register(runner.close)
    return runner


def make_variants(runner: Runner, tasks: list[Task], work: Work, limits: VariantLimits) -> list[VariantRecord]:
    """Make variants one after the other in a worker; return a record for each, also where one breaks down.

    Raises
    ------
    SolverError
        A worker's interpreter cannot be started, or cannot import padgen.
    """
    made = []
    for task in tasks:
        answer = runner.run(work, task, time_s=limits.time_s, most_mb=limits.memory_mb)
        record = answer.value
        if answer.kind != "value":
            sentence = answer.sentence + (f" (limits.{answer.limit})" if answer.limit else "")
            if answer.kind == "refused":
                sentence = f"broke down ({type(answer.error).__name__}: {sentence})"
            record = failed_record(task, sentence, answer.seconds, answer.peak_mb)
        elif isinstance(record, VariantRecord) and record.seconds is None:
            record = replace(record, seconds=answer.seconds, peak_memory_mb=answer.peak_mb)
        made.append(record)
    return made


def failed_record(
    task: Task, sentence: str, seconds: float | None = None, memory_mb: float | None = None
) -> VariantRecord:
    """Return the record of a variant whose worker broke down or was lost."""
    return VariantRecord(task.number, task.key, "failed", sentence, task.values, {}, 0, 0, (), seconds, memory_mb)


AHEAD = 4
"""Tasks that wait for each worker of our own."""
FOREIGN_AHEAD = 256
TICK_S = 1.0
"""Between signs of life when no variant ends."""
DISK_FULL = tuple(os.strerror(code) for code in (errno.ENOSPC, errno.EDQUOT))
MOST_LOST = 8
"""Tasks in a row that an executor may lose before it is given up."""
ABSENT, KEPT, TO_RUN, TO_REPLACE = range(4)
"""States of a variant number: no such variant; recorded; to be made; to be made over what an earlier run left."""
LOCK = ".lock"
LOCK_S = 0.1
TOLD = ("number", "sentence", "values", "figures", "errors", "warnings", "findings", "seconds", "peak_memory_mb")
"""Keys of a record that a progress event repeats."""


@dataclass(frozen=True)
class Counts:
    """Counts of a sweep's variants: ``total = done + refused + failed + left``.

    `kept` of them were finished by an earlier run; `seconds` since the start.
    """

    total: int
    done: int
    refused: int
    failed: int
    kept: int
    left: int
    seconds: float


@dataclass(frozen=True)
class Event(Counts):
    """An event of a running sweep: it starts, a variant ends, a second passes in which none ends, or the sweep ends.

    ``start`` comes first, and counts what earlier runs have finished; then one of ``done``, ``refused`` and
    ``failed`` for each variant that ends, with its `record`, and ``progress`` when a second went by without
    one; ``end`` comes last. A failed variant of an earlier run that is not tried again is told as ``failed``
    with `reused` true. `eta_s` is the time left (None: not known yet).
    """

    kind: str
    eta_s: float | None
    record: VariantRecord | None = None
    reused: bool = False

    def table(self) -> dict[str, Any]:
        """Return the event as a dict for one line of JSON, with the main fields of its variant's record, if any."""
        table = {"kind": self.kind, **vars(self)}
        record = table.pop("record")
        if record is None:
            del table["reused"]
            return table
        return table | {"variant": {name: getattr(record, name) for name in TOLD}}


@dataclass(frozen=True)
class SweepResult(Counts):
    """The result of a sweep: counts of variants, files, a summary of the index, and why variants are left, if any are.

    `stopped` is the sentence why variants are left, empty when none is; `interrupted`, whether that was Ctrl-C.
    `overview` is of the index, empty where that could not be written.
    """

    folder: Path
    index: Path
    stopped: str
    interrupted: bool
    overview: Overview


@dataclass(frozen=True)
class SweepTable:
    """The variants of a sweep, in the order of their numbers; made by `padgen.sweep`."""

    name: str
    rows: tuple[dict[str, Any], ...]

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of variants by status: done, refused, failed."""
        return dict(Counter(row["status"] for row in self.rows))

    def table(self) -> list[dict[str, Any]]:
        """Return a dict for each variant: name, status, sentence, varied fields and figures, with their units."""
        return [dict(row) for row in self.rows]

    def __repr__(self) -> str:
        counts = ", ".join(f"{count} {status}" for status, count in self.counts.items())
        return f"<Sweep {self.name}: {counts}>"

    def _repr_html_(self) -> str:
        columns = list(dict.fromkeys(name for row in self.rows for name in row))
        head = "".join(f"<th>{escape(name)}</th>" for name in columns)
        lines = ("".join(f"<td>{escape(str(row.get(name, '')))}</td>" for name in columns) for row in self.rows)
        return f"<p>{escape(repr(self))}</p><table><tr>{'</tr><tr>'.join([head, *lines])}</tr></table>"


def run_sweep(
    sweep: Sweep,
    folder: Path,
    executor: Any = None,
    workers: int | None = None,
    resume: bool = True,
    retry: bool = False,
    on_event: Callable[[Event], None] = lambda event: None,
    work: Work = run_task,
    chunk: int = 1,
) -> SweepResult:
    """Make all variants of `sweep` in `folder`, and `index.csv` with a row for each.

    Parameters
    ----------
    executor : concurrent.futures.Executor, optional
        Where variants are made; by default in processes of this machine. It is not shut down; after an interruption
        it may still finish the variants that it has begun.
    workers : int, optional
        How many processes of this machine; by default as many as there are cores.
    resume : bool
        Whether variants that are finished (done or refused) with the same inputs are left as they are; failed
        ones are reported again, and tried again only with `retry`.
    work : callable
        What makes a variant; importable by name.
    chunk : int
        Variants per task: more than one suits an executor that takes long to start a task, such as a cluster's queue.

    Raises
    ------
    SpecError
        The sweep cannot be laid out, or something was registered that its workers do not know; nothing is written.
    FileError
        Another sweep writes into the folder, or it cannot be written to; what is done is kept.
    """
    limit_bytes()  # refused here rather than by each variant
    refuse_unshared()
    numbers = count_points(sweep)
    folder = folder.absolute()
    count = workers or core_count()
    # All of them where a constraint may not be worked out for one, so that nothing is written then.
    if not (sum(1 for _ in variants(sweep)) if sweep.constraints else numbers):
        raise SpecError(f"leave none of {numbers} variants; loosen one", "constraints")
    processes = Runner(count, IMPORTS) if executor is None else nullcontext()
    with sole_sweep(folder), Journal(folder, numbers) as journal, processes as pool:
        run = _Run(sweep, folder, journal, on_event)
        if pool:
            window = Window(pool.threads, AHEAD * count, partial(make_variants, pool), work, sweep.limits)
        else:
            window = Window(executor, FOREIGN_AHEAD, run_tasks, work, sweep.limits)
        run.survey(resume, retry)
        if pool:
            pool.prepare(min(count, run.todo.count(TO_RUN) + run.todo.count(TO_REPLACE)))
        if TO_REPLACE in run.todo:
            # So that a killed run leaves no index of what is not there any more.
            write_index(journal, sweep, folder)
        run.tell("start")
        for record in journal.records():
            if run.todo[record.number] == KEPT and record.status == "failed":
                run.tell("failed", record, True)
        overview = overview_of((), ())
        stopped = ""
        interrupted = False
        broken = False
        try:
            _run_all(run, window, chunk)
        except KeyboardInterrupt:
            stopped = "interrupted"
            interrupted = True
        except StoppedError as error:
            stopped = str(error)
            broken = isinstance(error.__cause__, BrokenExecutor)
        finally:
            with uninterrupted():
                try:
                    # Before the workers are ended, as what they were at would come back as failed.
                    for taken in window.rest(cancels=not broken):
                        with suppress(LostError, StoppedError, FileError):
                            for record in records_of(*taken):
                                run.keep(record)
                finally:
                    if pool:
                        pool.close()
                    try:
                        journal.refuse_removed()
                        overview = write_index(journal, sweep, folder)
                    except FileError as error:
                        if not stopped:
                            raise
                        stopped += f"; {error}"  # one more reason
        run.tell("end")
        return SweepResult(
            **run.counts_now,
            folder=folder,
            index=folder / INDEX,
            stopped=stopped,
            interrupted=interrupted,
            overview=overview,
        )


def run_to_table(sweep: Sweep, folder: Path | None, workers: int | None) -> SweepTable:
    """Run a sweep in `folder`, or in a temporary folder, and return its variants; raise what `run_sweep` raises."""
    if folder is None:
        with TemporaryDirectory(prefix="padgen-sweep-") as aside:
            return run_to_table(sweep, Path(aside) / sweep.settings.name, workers)
    run_sweep(sweep, folder, workers=workers)
    with Journal(folder, count_points(sweep)) as journal:
        rows = [
            {"name": sweep.name_of(record.number), "status": record.status, "sentence": record.sentence}
            | record.values
            | record.figures
            for record in journal.records()
        ]
    return SweepTable(sweep.settings.name, tuple(rows))


@contextmanager
def sole_sweep(folder: Path) -> Iterator[None]:
    """Lock a folder against other sweeps during the block, and make the folder if it is not there.

    The lock is the system's: there are no stale ones. On a file system without locks the word in its file takes its
    place; after a power cut that has to be removed by hand, and the sentence says so.

    Raises
    ------
    FileError
        Another sweep has the folder, or it cannot be made or written to.
    """
    lock = folder / LOCK
    with ExitStack() as held:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            has_lock = held.enter_context(locked(lock, LOCK_S))
            with os.fdopen(open_plain(lock, os.O_RDWR), "r+", errors="replace") as word:
                holder = "" if has_lock else word.read(LONGEST_PART)
                if holder or has_lock is False:
                    advice = "name another folder" if has_lock is False else f"if it no longer runs, remove {LOCK}"
                    raise FileError(
                        f"another sweep writes into it ({holder}); wait until it has ended, or {advice}", str(folder)
                    )
                word.truncate(0)
                word.write(
                    f"process {os.getpid()} on {socket.gethostname()} since {time.strftime('%Y-%m-%d %H:%M:%S')}"
                )
        except OSError as error:
            raise FileError(f"cannot be written to ({reason(error)})", str(folder)) from error
        if has_lock is None:
            held.callback(lock.unlink, missing_ok=True)
        yield


class _Run:
    """A running sweep: which variants are recorded or to be made, and the counts of done, refused and failed ones."""

    def __init__(self, sweep: Sweep, folder: Path, journal: Journal, on_event: Callable[[Event], None]) -> None:
        self.sweep = sweep
        self.folder = folder
        self.journal = journal
        self.on_event = on_event
        self.counts = {"done": 0, "refused": 0, "failed": 0}
        self.total = self.kept = 0
        self.todo = bytearray(count_points(sweep))
        self._start = time.monotonic()

    def survey(self, resume: bool, retry: bool) -> None:
        """Find all variants and which are finished; ignore a record if the variant's inputs or files have changed."""
        for variant in variants(self.sweep):
            record = self.journal.record(variant.number)
            self.total = self.total + 1
            holds = record is not None and self._holds(record, variant)
            if record and holds and resume and not (retry and record.status == "failed"):
                self.todo[variant.number] = KEPT
                self.counts[record.status] += 1
            else:
                self.todo[variant.number] = TO_REPLACE if record else TO_RUN
            if not holds:
                self.journal.forget(variant.number)
        self.kept = sum(self.counts.values())
        for absent, state in enumerate(self.todo):
            if state == ABSENT:
                self.journal.forget(absent)

    def _holds(self, record: VariantRecord, variant: Variant) -> bool:
        """Tell whether a variant's record is still valid: its inputs are the same and its files are all there."""
        task = task_of(self.sweep, variant, self.folder)
        whole = record.status != "done" or not task.out or recover_and_check_files(Path(task.out), task.stage)
        return record.key == task.key and whole

    def tasks(self) -> Iterator[Task]:
        """Yield the task of each variant that is to be made, lazily, and invalidate its old record just before."""
        for variant in variants(self.sweep):
            if self.todo[variant.number] == TO_REPLACE:
                self.journal.invalidate(variant.number)
            if self.todo[variant.number] >= TO_RUN:
                yield task_of(self.sweep, variant, self.folder)

    def keep(self, record: VariantRecord) -> None:
        """Add a variant's record to journal and counts; remove its folder if it failed, was refused or is to have none.

        A second record of a variant is ignored. Raise StoppedError where the disk is full.
        """
        if self.todo[record.number] < TO_RUN:
            return  # told twice: an executor ran its task again
        if any(full in record.sentence for full in DISK_FULL):
            raise StoppedError(record.sentence)  # not the variant's fault: the next run makes it
        if record.status != "done" or not writes_folders(self.sweep):
            remove_own_files(self.folder / self.sweep.name_of(record.number))
        self.journal.add(record)
        self.todo[record.number] = KEPT
        self.counts[record.status] += 1
        self.tell(record.status, record)

    def tell(self, kind: str, record: VariantRecord | None = None, reused: bool = False) -> None:
        """Report an event to the caller; the time left is estimated from the variants made so far."""
        notify = self.counts_now
        made = self.total - self.kept - notify["left"]
        eta_s = notify["left"] * notify["seconds"] / made if made else None
        self.on_event(Event(**notify, kind=kind, eta_s=eta_s, record=record, reused=reused))

    @property
    def counts_now(self) -> dict[str, Any]:
        """Counts of variants (total, done, refused, failed, kept from earlier runs, left), and seconds since start."""
        left = self.total - sum(self.counts.values())
        seconds = time.monotonic() - self._start
        return {"total": self.total, **self.counts, "kept": self.kept, "left": left, "seconds": seconds}


def _run_all(run: _Run, window: Window, chunk: int) -> None:
    """Keep the executor busy until all variants have a record."""
    tasks = run.tasks()
    tried_once: set[int] = set()
    alone: list[list[Task]] = []
    lost = 0
    while True:
        while len(window.pending) < window.most and (batch := alone.pop() if alone else list(islice(tasks, chunk))):
            window.give(batch)
        if not window.pending:
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
            records = [
                failed_record(task, f"its worker was lost ({error})") for task in taken[1] if task.number in tried_once
            ]
            # One by one, so that the next loss costs one variant.
            alone += [[task] for task in taken[1] if task.number not in tried_once]
            tried_once |= {task.number for task in taken[1]}
        else:
            lost = 0
        for record in records:
            run.keep(record)


TIMEOUT_S = 10.0
"""For the scheduler to answer, and again for it to have a worker."""
GRACE_S = 0.5
"""Time in s added to Dask's own limits, so that it may give up by itself, which it does not before a first answer."""
SLOW = 6
"""Factor on the time that workers may take to answer, since they load padgen for it."""
PROBE = "__import__('importlib').import_module('padgen.batch.sweep').fingerprint()"
"""Evaluated in a worker: text, since a worker that lacks padgen cannot receive a function of padgen."""


@contextmanager
def connect(address: str, timeout_s: float = TIMEOUT_S) -> Iterator[Executor]:
    """Yield an executor for `run_sweep` whose tasks the cluster of a Dask scheduler runs; leave the cluster running.

    Parameters
    ----------
    address : str
        Of the scheduler, as ``tcp://host:8786``.
    timeout_s : float
        For the scheduler to answer, and again for it to have a worker.

    Raises
    ------
    EngineMissingError
        The package distributed is not installed.
    PadgenError
        There is no scheduler, it has no worker, or a worker cannot import padgen or has other code or versions.
    """
    where = f"scheduler {address}"
    try:
        dask = import_module("distributed")
    except ImportError as error:
        raise EngineMissingError(
            f"needs the package distributed ({error}); pip install 'padgen[dask]' brings it", where
        ) from error
    # Dask's client writes tracebacks of a lost connection; a sentence tells of it.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    client = _client(dask, address, timeout_s, where)
    try:
        wait = partial(client.wait_for_workers, 1, timeout=timeout_s)
        late = f"has no worker; dask worker {address} starts one"
        _within(timeout_s + GRACE_S, wait, late, "does not tell its workers ({})", where)
        here = fingerprint()
        seconds = SLOW * timeout_s
        slow = f"has workers that do not answer within {number(seconds)} s"
        ask = partial(client.run, eval, PROBE, on_error="return")
        for worker, answer in sorted(_within(seconds, ask, slow, "cannot ask its workers ({})", where).items()):
            place = f"worker {worker}"
            if not isinstance(answer, dict):
                raise PadgenError(f"cannot import padgen ({error_text(answer)}); install the same padgen there", place)
            if name := next((name for name, mine in here.items() if answer.get(name) != mine), ""):
                sentences = {
                    "padgen": "another padgen than this machine; install the same one on both",
                    PLUGINS: f"other modules in {PLUGINS} than this machine; name the same ones on both",
                }
                version_ = f"{name} {answer.get(name)}, this machine {here[name]}; install the same version on both"
                raise PadgenError(f"has {sentences.get(name, version_)}", place)
        # Not pure: a task that was lost is run again, not answered from what is known of it.
        yield client.get_executor(pure=False)
    finally:
        with suppress(Exception):  # the scheduler may be gone; what it said is told already
            client.close(timeout=2)


def fingerprint() -> dict[str, str]:
    """Return hashes of the code and versions of the packages, which must agree between machines that share a sweep."""
    return {"padgen": code_hash(), PLUGINS: plugin_code(), **versions(), "distributed": version("distributed")}


def _client(dask: Any, address: str, timeout_s: float, where: str) -> Any:
    import asyncio

    async def reach() -> None:
        security = dask.Security().get_connection_args("client")
        comm = await asyncio.wait_for(dask.comm.connect(address, timeout=timeout_s, **security), timeout_s)
        await comm.close()

    def opened() -> Any:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about versions, which `connect` compares
            return dask.Client(address, timeout=timeout_s, set_as_default=False, name="padgen")

    late = f"does not answer within {number(timeout_s)} s; is it running?"
    other = "cannot be used ({}); an address is like tcp://host:8786"
    # First, as a client that finds no scheduler may wait for ever, and is slow to go.
    _within(timeout_s + GRACE_S, lambda: asyncio.run(reach()), late, other, where)
    return _within(timeout_s + GRACE_S, opened, late, other, where)


def _within(seconds: float, act: Callable[[], Any], late: str, other: str, where: str) -> Any:
    """Call `act`; raise `PadgenError` with the text `late` on a timeout or OSError, with `other` on any other error."""
    try:
        return answer_within(seconds, act)
    except OSError as error:  # timeouts are, and what cannot be reached
        raise PadgenError(late, where) from error
    except Exception as error:
        raise PadgenError(other.format(error_text(error)), where) from error
