"""Try every cure that plans and refusals of random specs name: `python docs/measure_cures.py [SPECS]`.

Prints how many cures of each kind do what they say, and each that does not.
"""

import sys
from collections import Counter

from padgen.ladders.extreme import random_table
from tests.planner.test_cures import cures_of

SPECS = 300


def main(specs: int) -> int:
    """Try the cures of so many specs; the exit code is 1 where one is false."""
    right = Counter[str]()
    wrong = 0
    for number in range(specs):
        for cured, fault in cures_of(random_table(number)):
            right[cured] += not fault
            wrong += bool(fault)
            if fault:
                print(f"random {number}: {cured}: {fault}", flush=True)
    for cured, count in sorted(right.items()):
        print(f"{count:4d}  {cured}")
    print(f"{right.total()} cures of {specs} specs do what they say, {wrong} do not")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else SPECS))
