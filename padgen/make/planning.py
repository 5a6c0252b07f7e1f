"""Which spec is meant, and which model plans its pad: decided here, for every command and for `padgen.plan`.

Finite elements are solved only where they were asked for: by ``model = "solid"`` in the spec, or by a tolerance
that the beam model's own estimate does not meet. Elsewhere the plan is the beam model's, and a finding warns where
it may be off by more than ``model.tolerance``. The plan's spec records the model, and all later stages use the one
that the plan in their folder records.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from padgen.core.commit import recover
from padgen.core.errors import PadgenError, SolverError, SpecError
from padgen.spec import Spec, find_spec, load_spec, make_spec
from padgen.spec.load import answers, laid_over, without_none

if TYPE_CHECKING:
    from padgen.planner.plan import Plan

__all__ = ["plan_for", "plan_to_compare", "recorded_spec", "spec_of"]

PLAN = "plan.json"

Progress = Callable[[str], None]


def spec_of(source: "str | Path | Mapping[str, Any] | Spec", fields: Mapping[str, Any] | None = None) -> Spec:
    """Make the `Spec` that `source` means: a template's name, a file, nested tables, or a spec.

    `fields` are laid over it: top-level fields by name, tables as nested mappings of what differs.

    Raises
    ------
    SpecError, FileError
        It is none of these, or a field is unknown or out of its bounds.
    """
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


def recorded_spec(spec: Spec, folder: Path) -> Spec:
    """Take the model that the plan in `folder` records, where it is of the same spec and that names no model itself."""
    if spec.model.structure != "auto":
        return spec
    try:
        recorded = load_spec(str(folder / PLAN))
    except PadgenError:  # none is there
        return spec
    return recorded if answers(recorded, spec) else spec


def plan_for(spec: Spec, tolerance: float | None = None, progress: Progress = lambda step: None) -> "Plan":
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
        spec = _by(spec, spec.model.structure, tolerance)
    progress("planning")
    if spec.model.structure == "solid":
        return _tuned(spec, progress)
    from padgen.planner import make_plan

    plan = make_plan(spec)
    if tolerance is None or spec.model.structure == "beam":
        return plan
    beam = replace(plan, spec=_by(spec, "beam", tolerance))
    if max(channel.model_error for channel in plan.channels) <= tolerance:
        return beam
    try:
        return _tuned(_by(spec, "solid", tolerance), progress)
    except SolverError:
        return beam


def _by(spec: Spec, structure: str, tolerance: float) -> Spec:
    return spec_of(spec, {"model": {"structure": structure, "tolerance": tolerance}})


def _tuned(spec: Spec, progress: Progress) -> "Plan":
    from padgen.make.solid_tuning import plan_tuned_to_solid

    return plan_tuned_to_solid(spec, progress)


def plan_to_compare(spec: str, mesh: Path, progress: Progress = lambda step: None) -> "tuple[Plan, str]":
    """Find the plan that a mesh is compared with, and say which one it is.

    A plan.json is taken as it is recorded, beams and all. The plan of another spec is the one recorded beside the
    mesh where that is of the same spec, by whichever model it was made; elsewhere it is planned as a build does.

    Raises
    ------
    FileError
        A plan.json, given or beside the mesh, holds no plan.
    SpecError, SolverError
        As planning does.
    """
    from padgen.planner import read_plan

    path, beside = find_spec(spec), mesh.parent / PLAN
    if path.suffix == ".json":
        return _named(read_plan(path), spec)
    asked = load_spec(spec)
    recover(mesh.parent)
    if beside.is_file():
        recorded = read_plan(beside)
        if answers(recorded.spec, asked):
            return _named(recorded, str(beside))
    return _named(plan_for(asked, progress=progress), f"{spec}, planned anew")


def _named(plan: "Plan", source: str) -> "tuple[Plan, str]":
    models = " and ".join(sorted({channel.model for channel in plan.channels}))
    return plan, f"{source} ({models} model)"
