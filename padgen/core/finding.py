"""`Finding`: one verdict on a pad, as data that only the command line prints."""

from dataclasses import dataclass, field
from typing import Any

from padgen.core.errors import LONGEST, plain

__all__ = ["LEVELS", "Finding"]

LEVELS = ("note", "warning", "error")


@dataclass(frozen=True, slots=True)
class Finding:
    """One verdict.

    Parameters
    ----------
    level : {'note', 'warning', 'error'}
        An error means that the pad does not meet the spec; commands then exit with 1.
    code : str
        Stable dotted name, e.g. ``'print.gap'``.
    where : str
        The judged object: a channel, a taxel, a file.
    message : str
        One sentence with the value, its bound and the nearest value that would pass.
    cures : tuple of dict
        Changes of the spec, fields by their dotted names, that the planner has tried: with each the finding is gone and
        none is worse. The message ends with them.
    """

    level: str
    code: str
    where: str
    message: str
    cures: tuple[dict[str, Any], ...] = field(default=(), hash=False)

    def __post_init__(self) -> None:
        if self.level not in LEVELS:
            raise ValueError(f"level must be one of {LEVELS}, got {self.level!r}")
        object.__setattr__(self, "cures", tuple(self.cures))
        for name in ("where", "message"):
            object.__setattr__(self, name, plain(getattr(self, name), LONGEST))
