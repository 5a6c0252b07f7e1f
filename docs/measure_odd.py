"""Plan odd specs, fields anywhere within their bounds, and print faults: `python docs/measure_odd.py [SPECS [FIRST]]`.

A fault is an internal error, a warning, a figure that is not finite behind a verdict, or a sentence that only says that
a computation broke down. Plans that take more than `LIMIT_S` of computing time are given up and counted.
"""

import signal
import sys
from collections import Counter

from padgen.ladders.extreme import fault_of, odd_table

SPECS = 20_000
LIMIT_S = 5.0


class TooSlowError(BaseException):
    """A plan took longer than the limit; no `Exception`, so that no code that tries something swallows it."""


def main(specs: int, first: int) -> int:
    """Plan so many specs from number `first` on; the exit code is 1 if an answer has a fault."""

    def give_up(*_: object) -> None:
        raise TooSlowError

    signal.signal(signal.SIGVTALRM, give_up)
    counts: Counter[str] = Counter()
    for number in range(first, first + specs):
        try:
            signal.setitimer(signal.ITIMER_VIRTUAL, LIMIT_S)
            fault = fault_of(odd_table(number))
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        except TooSlowError:
            fault = ""
            counts["too slow"] += 1
            print(f"{number}: more than {LIMIT_S:g} s", flush=True)
        if fault:
            print(f"{number}: {fault}", flush=True)
        counts["faulty" if fault else "answered"] += 1
        if sum((counts["faulty"], counts["answered"])) % 100 == 0:
            print(f"{number + 1 - first} specs: {dict(counts)}", flush=True)
    print(f"{specs} specs from number {first} on: {dict(counts)}")
    return int(counts["faulty"] > 0)


if __name__ == "__main__":
    asked = [*map(int, sys.argv[1:]), SPECS, 0]
    sys.exit(main(asked[0], asked[1] if len(sys.argv) > 2 else 0))
