"""What one process of several needs: a single thread for its mathematics, and its own peak of memory."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import current_thread, main_thread

__all__ = ["ONE_THREAD", "PROCESSES", "core_count", "peak_mb", "reset_peak", "uninterrupted"]

ONE_THREAD = dict.fromkeys(
    (
        "OPENBLAS_NUM_THREADS",
        "OMP_NUM_THREADS",
        "MKL_NUM_THREADS",
        "NGS_NUM_THREADS",
        "NUMEXPR_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
    ),
    "1",
)
"""Environment of a process beside others: threads inside them would only get in each other's way."""

PROCESSES = "PADGEN_PROCESSES"
"""Environment variable: how many processes of its own a process may use at a time; all cores by default."""


def core_count() -> int:
    """Cores that this process may use."""
    named = os.environ.get(PROCESSES, "")
    if named.isdecimal() and int(named):
        return int(named)
    allowed = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed else os.cpu_count() or 1


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ignore Ctrl-C meanwhile, where this is the thread that gets it."""
    if current_thread() is not main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def reset_peak() -> None:
    """Let the peak count from now on, where the system can (Linux)."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_bytes(b"5")


def peak_mb() -> float | None:
    """Peak resident memory of this process in MB (10⁶ bytes); None where the system does not tell."""
    with suppress(OSError):
        # ru_maxrss would start with what the parent held.
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    try:
        import resource
    except ImportError:
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
