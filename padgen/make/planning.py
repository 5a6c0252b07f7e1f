"""Which model plans a pad: decided here, for every command and for `padgen.plan`.

Finite elements are solved only where they were asked for: by ``model = "solid"`` in the spec, or by a
tolerance that the beam model's own estimate does not meet. Elsewhere the plan is the beam model's, and a
finding warns where it may be off by more than ``model.tolerance``. The plan's spec records the model, so
that all later stages use the same one.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from padgen.core.errors import SolverError, SpecError
from padgen.planner import make_plan
from padgen.planner.plan import Plan
from padgen.spec import Spec, load_spec, make_spec
from padgen.spec.load import laid_over, without_none

__all__ = ["plan_for", "spec_of"]

Progress = Callable[[str], None]


def spec_of(source: "str | Path | Mapping[str, Any] | Spec | Plan", fields: Mapping[str, Any] | None = None) -> Spec:
    """Make the `Spec` that `source` means: a template's name, a file, nested tables, a spec, or a plan's spec.

    `fields` are laid over it: top-level fields by name, tables as nested mappings of what differs.

    Raises
    ------
    SpecError, FileError
        It is none of these, or a field is unknown or out of its bounds.
    """
    if isinstance(source, Plan):
        source = source.spec
    if not isinstance(source, (str, Path, Mapping, Spec)):
        raise SpecError(f"must be a template, a path, tables or a Spec, got {type(source).__name__}", "spec")
    if isinstance(source, Mapping):
        source = make_spec(dict(source))
    elif not isinstance(source, Spec):
        source = load_spec(str(source))
    return make_spec(laid_over(without_none(asdict(source)), _dotted(fields))) if fields else source


def _dotted(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Tables by their fields' dotted names, so that what they do not name stays."""
    flat: dict[str, Any] = {}
    for name, value in fields.items():
        flat |= (
            {f"{name}.{key}": entry for key, entry in value.items()} if isinstance(value, Mapping) else {name: value}
        )
    return flat


def plan_for(spec: Spec, tolerance: float | None = None, progress: Progress = lambda step: None) -> Plan:
    """Plan `spec` by the model that it asks for, or by the cheapest that meets an asked `tolerance`.

    Where a tolerance was asked for and finite elements have no answer, or are not installed, the plan stays the
    beam model's, whose findings tell how far off it may be.

    Raises
    ------
    InfeasibleError
        No pad meets the spec.
    SolverError, GeometryError
        The spec asks for the solid, and it cannot be meshed, does not converge, or cannot be made.
    EngineMissingError
        The spec asks for the solid, and the finite-element package is not installed.
    """
    if tolerance is not None:
        spec = replace(spec, model=replace(spec.model, tolerance=tolerance))
    if spec.model.structure == "solid":
        return _tuned(spec, progress)
    plan = make_plan(spec)
    met = tolerance is None or max(channel.model_error for channel in plan.channels) <= tolerance
    if met or spec.model.structure == "beam":
        return plan
    try:
        return _tuned(replace(spec, model=replace(spec.model, structure="solid")), progress)
    except SolverError:
        return plan


def _tuned(spec: Spec, progress: Progress) -> Plan:
    from padgen.make.solid_tuning import plan_tuned_to_solid

    return plan_tuned_to_solid(spec, progress)
