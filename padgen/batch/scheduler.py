"""A Dask cluster as an executor, after a look at whether its workers would make the same variants as this machine."""

import asyncio
import logging
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module
from threading import Thread
from typing import Any

from padgen.batch.sweep import told
from padgen.core.cache import code_hash, version, versions
from padgen.core.errors import EngineMissingError, PadgenError, number
from padgen.core.registry import PLUGINS, plugin_code

__all__ = ["connect", "fingerprint"]

TIMEOUT_S = 10.0
"""For the scheduler to answer, and again for it to have a worker."""
GRACE_S = 0.5
"""Dask is let to give up by itself; it never does while it waits for a first word."""
SLOW = 6
"""How many times as long workers may take, which load padgen for the answer."""
PROBE = "__import__('importlib').import_module('padgen.batch.scheduler').fingerprint()"
"""For `eval` in a worker: a function of ours could not even be named there if padgen is missing."""


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
        dask = import_module("distributed")  # before `_quiet`, as loading it sets the level of its log
    except ImportError as error:
        raise EngineMissingError(
            f"needs the package distributed ({error}); pip install 'padgen[dask]' brings it", where
        ) from error
    with _quiet():
        client = _client(dask, address, timeout_s, where)
        try:
            wait = partial(client.wait_for_workers, 1, timeout=timeout_s)
            late = f"has no worker; dask worker {address} starts one"
            _within(timeout_s + GRACE_S, wait, late, "does not tell its workers ({})", where)
            here, seconds = fingerprint(), SLOW * timeout_s
            slow = f"has workers that do not answer within {number(seconds)} s"
            ask = partial(client.run, eval, PROBE, on_error="return")
            for worker, answer in sorted(_within(seconds, ask, slow, "cannot ask its workers ({})", where).items()):
                place = f"worker {worker}"
                if not isinstance(answer, dict):
                    raise PadgenError(f"cannot import padgen ({told(answer)}); install the same padgen there", place)
                for name, mine in here.items():
                    if answer.get(name) != mine:
                        other = {
                            "padgen": "another padgen than this machine; install the same one on both",
                            PLUGINS: f"other modules in {PLUGINS} than this machine; name the same ones on both",
                        }.get(name, f"{name} {answer.get(name)}, this machine {mine}; install the same version on both")
                        raise PadgenError(f"has {other}", place)
            # Not pure: a task that was lost is run again, not answered from what is known of it.
            yield client.get_executor(pure=False)
        finally:
            with suppress(Exception):  # the scheduler may be gone; what it said is told already
                client.close(timeout=2)


def fingerprint() -> dict[str, str]:
    """Return hashes of the code and versions of the packages, which must agree between machines that share a sweep."""
    return {"padgen": code_hash(), PLUGINS: plugin_code(), **versions(), "distributed": version("distributed")}


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's client from writing tracebacks of a lost connection; a sentence tells of it."""
    logger = logging.getLogger("distributed.client")
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(before)


def _client(dask: Any, address: str, timeout_s: float, where: str) -> Any:
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
    """Call `act` with a time limit: raise `late` if it takes longer (then left to itself), `other` if it fails."""
    answer: Future[Any] = Future()

    def run() -> None:
        try:
            answer.set_result(act())
        except BaseException as error:
            answer.set_exception(error)

    Thread(target=run, daemon=True).start()
    try:
        return answer.result(seconds)
    except OSError as error:  # timeouts are, and what cannot be reached
        raise PadgenError(late, where) from error
    except Exception as error:
        raise PadgenError(other.format(told(error)), where) from error
