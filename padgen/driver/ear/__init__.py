"""The simulated ear on the finger: what is felt when a written file is played on a pad.

`heard` is the door; `current` → `motion` (with the gap: `gap`) → `tally` is the way of a sample, `run` takes
coils through it, `score` reads what the file says of itself, `table` makes plain data and findings.
"""

from padgen.driver.ear.heard import Heard, hear

__all__ = ["Heard", "hear"]
