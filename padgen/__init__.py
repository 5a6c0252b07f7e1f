"""padgen: vibrotactile pads with more taxels than coils.

A pad is a TOML spec; everything else is derived from it by pure functions, in one direction::

    spec.toml -> Spec -> Plan -> Pad (solids, meshes, checks) -> files
                          +----> Drive: tables, waveforms, firmware   <- Tuning: a print as measured

Functions: `plan`, `build`, `check`, `draw`, `drive`, `retune`, `calibrate`, `study`, `sweep` and others; what a command
does, one of them does. Nouns: `Spec`, `Plan`, `Pad`, `Drive`, `Tuning`, `Finding`. Names are loaded when they are
first used.

>>> import padgen as pg
>>> plan = pg.plan("paper-32", q_min=20)
>>> plan.coils.rows, len(plan.taxels)
(4, 32)
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from padgen.api.drives import check_wiring, drive, excite, play, play_wav, read_frames, read_tuning
    from padgen.api.house import cache_info, clear_cache, restore, spec_schema, use_cache
    from padgen.api.pads import (
        build,
        check,
        draw,
        explain,
        explore,
        plan,
        print_yield,
        read_plan,
        read_spec,
        recoil,
        save_plan,
        template_names,
        template_text,
        write_report,
    )
    from padgen.api.prints import (
        bench,
        calibrate,
        fit_touch,
        retune,
        save_printer,
        save_retuned,
        save_touch,
        simulate_print,
    )
    from padgen.api.studies import read_sweep, run_sweep, study, study_extreme, sweep
    from padgen.core.errors import FileError, Finding, InfeasibleError, PadgenError, SolverError, SpecError
    from padgen.driver.drive_folder import Drive
    from padgen.make.pad import Pad
    from padgen.measured.tuning import Tuning
    from padgen.planner.plan import Plan
    from padgen.spec.model import Spec

__version__ = "0.15.0"
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
    "bench",
    "build",
    "cache_info",
    "calibrate",
    "check",
    "check_wiring",
    "clear_cache",
    "draw",
    "drive",
    "excite",
    "explain",
    "explore",
    "fit_touch",
    "plan",
    "play",
    "play_wav",
    "print_yield",
    "read_frames",
    "read_plan",
    "read_spec",
    "read_sweep",
    "read_tuning",
    "recoil",
    "restore",
    "retune",
    "run_sweep",
    "save_plan",
    "save_printer",
    "save_retuned",
    "save_touch",
    "simulate_print",
    "spec_schema",
    "study",
    "study_extreme",
    "sweep",
    "template_names",
    "template_text",
    "use_cache",
    "write_report",
]

_FUNCTIONS = {
    "bench": "prints",
    "build": "pads",
    "cache_info": "house",
    "calibrate": "prints",
    "fit_touch": "prints",
    "check": "pads",
    "check_wiring": "drives",
    "clear_cache": "house",
    "draw": "pads",
    "drive": "drives",
    "excite": "drives",
    "explain": "pads",
    "explore": "pads",
    "plan": "pads",
    "play": "drives",
    "play_wav": "drives",
    "print_yield": "pads",
    "read_frames": "drives",
    "read_plan": "pads",
    "read_spec": "pads",
    "read_sweep": "studies",
    "read_tuning": "drives",
    "recoil": "pads",
    "write_report": "pads",
    "restore": "house",
    "retune": "prints",
    "run_sweep": "studies",
    "save_plan": "pads",
    "save_printer": "prints",
    "save_retuned": "prints",
    "save_touch": "prints",
    "simulate_print": "prints",
    "spec_schema": "house",
    "study": "studies",
    "study_extreme": "studies",
    "sweep": "studies",
    "template_names": "pads",
    "template_text": "pads",
    "use_cache": "house",
}
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
    home = f"api.{_FUNCTIONS[name]}" if name in _FUNCTIONS else _NOUNS.get(name, "core.errors")
    value = getattr(import_module(f"padgen.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
