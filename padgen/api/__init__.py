"""The public functions: what a command does, a notebook does by a function.

Their modules import what is heavy only when a function is called; `padgen` loads a function when it is first used.
"""

__all__ = ["MODULES"]

MODULES = {
    "bench": "prints",
    "build": "pads",
    "cache_info": "house",
    "calibrate": "prints",
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
    "write_report": "pads",
    "restore": "house",
    "retune": "prints",
    "run_sweep": "studies",
    "save_plan": "pads",
    "save_printer": "prints",
    "save_retuned": "prints",
    "simulate_print": "prints",
    "spec_schema": "house",
    "study": "studies",
    "study_extreme": "studies",
    "sweep": "studies",
    "template_names": "pads",
    "template_text": "pads",
    "use_cache": "house",
}
"""The module of this room that each public function is in."""
