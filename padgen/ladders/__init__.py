"""Error against run time: every ladder of models measured alike (`padgen study`).

Names are fetched when they are asked for: every rung's own process passes by here, and needs none.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from padgen.ladders.study import (
        ExtremeStudy,
        Study,
        measured_study,
        parse_only,
        parse_tolerance,
        run_extreme,
        run_study,
    )

__all__ = ["ExtremeStudy", "Study", "measured_study", "parse_only", "parse_tolerance", "run_extreme", "run_study"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from padgen.ladders import study as run

    return getattr(run, name)
