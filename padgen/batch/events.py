"""What a sweep tells while it runs: how many variants are done, failed and left, and when it will be over."""

from collections.abc import Callable
from typing import Any, NamedTuple

from padgen.batch.variant import Record

__all__ = ["Clock", "Event", "Tell", "event_table"]

MEMORY = 50
"""Variants over which the pace is averaged."""


class Event(NamedTuple):
    """One step of a sweep.

    ``start`` comes first, with what is known from before counted; then one of ``done``, ``refused`` and
    ``failed`` for each variant that ends, with its `record`, and ``progress`` when a second went by without
    one; ``end`` comes last. A failed variant of an earlier run that is not tried again is told as ``failed``
    with `reused` true. `total` is all variants of the sweep, `kept` those that were finished before,
    `left` those that are still to come, `seconds` since the start, `eta_s` the time left (None: not known yet).
    """

    kind: str
    total: int
    done: int
    refused: int
    failed: int
    kept: int
    left: int
    seconds: float
    eta_s: float | None
    record: Record | None = None
    reused: bool = False


Tell = Callable[[Event], None]


class Clock:
    """Seconds since the start, and how many are left at the pace of the last variants.

    `now` tells seconds that never run backwards, as `time.monotonic`; the time of day may jump.
    """

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._start = self._last = now()
        self._finished, self._gap_s = 0, 0.0

    @property
    def seconds(self) -> float:
        """Since the start."""
        return self._now() - self._start

    def tick(self) -> None:
        """A variant has ended now."""
        now = self._now()
        self._finished += 1
        self._gap_s += (now - self._last - self._gap_s) / min(self._finished, MEMORY)
        self._last = now

    def eta_s(self, left: int) -> float | None:
        """Seconds until `left` more variants have ended; None before the first."""
        return left * self._gap_s if self._finished else None


def event_table(event: Event) -> dict[str, Any]:
    """An event as plain data, for one line of JSON; of the record what a reader of the stream needs."""
    table: dict[str, Any] = event._asdict()
    record = table.pop("record")
    if record is None:
        del table["reused"]
        return table
    told = ("number", "sentence", "values", "figures", "errors", "warnings", "findings", "peak_memory_mb")
    return table | {"variant": {name: getattr(record, name) for name in told} | {"seconds": record.seconds}}
