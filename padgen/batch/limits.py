"""What a variant may take: run time and memory, watched from outside its process.

From outside, as a kernel that holds Python's lock for a minute would hold a watching thread as well; by
resident memory, as a limit on addresses (``RLIMIT_AS``) also counts what OpenBLAS and OCCT only reserve.
"""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

from padgen.batch.definition import Limits
from padgen.core.errors import number

__all__ = ["excess", "memory_mb"]

PS_TIMEOUT_S = 2.0


def excess(limits: Limits, used_mb: float | None, seconds: float) -> str:
    """The sentence for a process that takes more than it may, after `seconds`; empty when it does not."""
    if seconds > limits.time_s:
        return f"took longer than {number(limits.time_s)} s (limits.time_s)"
    if (used_mb or 0.0) > limits.memory_mb:
        return f"took more than {number(limits.memory_mb)} MB (limits.memory_mb)"
    return ""


def memory_mb(pid: int) -> float | None:
    """Resident memory of a process and of those that it started; None where the system does not tell."""
    if sys.platform == "linux":
        return _linux_mb(pid)
    return _ps_mb(pid)


def _linux_mb(pid: int) -> float | None:
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_bytes().split()[1])
        threads = list(Path(f"/proc/{pid}/task").iterdir())
    except (OSError, IndexError, ValueError):
        return None
    total = pages * os.sysconf("SC_PAGE_SIZE") / 1e6
    for thread in threads:
        try:
            children = (thread / "children").read_text().split()
        except OSError:  # it has just ended, or this kernel does not tell
            continue
        total += sum(_linux_mb(int(child)) or 0.0 for child in children)
    return total


def _ps_mb(pid: int) -> float | None:
    """By ``ps``, where there is one: the process alone."""
    if not _has_ps():
        return None
    try:
        told = subprocess.run(
            ["ps", "-o", "rss=", "-p", str(pid)], capture_output=True, timeout=PS_TIMEOUT_S, check=False
        )
        return int(told.stdout) * 1024 / 1e6
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return None


@cache
def _has_ps() -> bool:
    from shutil import which

    return which("ps") is not None
