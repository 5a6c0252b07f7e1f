"""`Finding`: one verdict on a pad, as data that only the command line prints."""

from dataclasses import dataclass

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
    """

    level: str
    code: str
    where: str
    message: str

    def __post_init__(self) -> None:
        if self.level not in LEVELS:
            raise ValueError(f"level must be one of {LEVELS}, got {self.level!r}")
        for name in ("where", "message"):
            object.__setattr__(self, name, plain(getattr(self, name), LONGEST))
