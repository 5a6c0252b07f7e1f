"""padgen: vibrotactile pads with more taxels than coils.

A pad is a TOML spec; everything else is derived from it by pure functions, in one direction::

    spec.toml -> Spec -> Plan -> Pad (solids, meshes, checks) -> files
                          +----> Drive: tables, waveforms, firmware   <- Tuning: a print as measured

Functions: `plan`, `build`, `check`, `drive`, `retune`, `calibrate`, `study`, `sweep`; each works as the command of the
same name. Nouns: `Spec`, `Plan`, `Pad`, `Drive`, `Tuning`, `Finding`. Names are loaded when they are first used.

>>> import padgen as pg
>>> plan = pg.plan("paper-32", q_min=20)
>>> plan.coils.rows, len(plan.taxels)
(4, 32)
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from padgen.api import (
        build,
        calibrate,
        check,
        draw,
        drive,
        plan,
        read_plan,
        read_tuning,
        retune,
        study,
        sweep,
        template_names,
    )
    from padgen.core.errors import FileError, Finding, InfeasibleError, PadgenError, SolverError, SpecError
    from padgen.driver.drive_folder import Drive
    from padgen.make.pad import Pad
    from padgen.measured.tuning import Tuning
    from padgen.planner.plan import Plan
    from padgen.spec.model import Spec

__version__ = "0.11.0"
__all__ = [
    "Drive",
    "FileError",
    "Finding",
    "InfeasibleError",
    "Pad",
    "PadgenError",
    "Plan",
    "SolverError",
    "Spec",
    "SpecError",
    "Tuning",
    "__version__",
    "build",
    "calibrate",
    "check",
    "draw",
    "drive",
    "plan",
    "read_plan",
    "read_tuning",
    "retune",
    "study",
    "sweep",
    "template_names",
]

_NOUNS = {
    "Drive": "driver.drive_folder",
    "Finding": "core.errors",
    "Pad": "make.pad",
    "Plan": "planner.plan",
    "Spec": "spec.model",
    "Tuning": "measured.tuning",
}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'padgen' has no attribute {name!r}")
    home = "core.errors" if name.endswith("Error") else _NOUNS.get(name, "api")
    value = getattr(import_module(f"padgen.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
