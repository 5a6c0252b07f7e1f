"""Load a spec by template name, file or tables, and plan it by the beam model or by finite elements; for all commands.

Finite elements are solved only on request: by ``model = "solid"`` in the spec, or by a tolerance that the beam model's
own error estimate exceeds. Otherwise the beam model plans, and a finding warns where its error may exceed
``model.tolerance``. The plan's spec records the model. All later stages use the model recorded by the plan in their
folder.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from padgen import __version__
from padgen.core import cache
from padgen.core.errors import FileError, OlderPlanError, PadgenError, SolverError, SpecError, number
from padgen.core.files import read_as_one, read_manifest, wait_for_commit
from padgen.core.registry import has_extensions
from padgen.spec import Spec, find_spec, load_spec, make_spec
from padgen.spec.load import laid_over, matches_spec, read_table, without_none

if TYPE_CHECKING:
    from padgen.planner.plan import Plan

__all__ = [
    "Progress",
    "parse_tolerance",
    "plan_for",
    "plan_to_compare",
    "recorded_plan",
    "spec_as_recorded",
    "spec_of",
    "with_found_layout",
]

PLAN = "plan.json"

Progress = Callable[[str], None]


def spec_of(source: "str | Path | Mapping[str, Any] | Spec", fields: Mapping[str, Any] | None = None) -> Spec:
    """Return the `Spec` that `source` means: a template's name, a file, nested tables, or a spec.

    `fields` replace those of the source: top-level fields by name, tables as nested mappings with only the changed
    fields.

    Raises
    ------
    SpecError, FileError
        The source is none of these, or a field is unknown or out of its bounds.
    """
    if not isinstance(source, (str, Path, Mapping, Spec)):
        raise SpecError(f"must be a template, a path, tables or a Spec, got {type(source).__name__}", "spec")
    if isinstance(source, Spec) and not fields:
        return source
    home = Path()
    if isinstance(source, Spec):
        tables = without_none(asdict(source))
    elif isinstance(source, Mapping):
        tables = dict(source)
    else:
        path = find_spec(str(source))
        tables = read_table(path, str(source))
        home = path.parent
    flat: dict[str, Any] = {}
    for name, value in (fields or {}).items():
        # By dotted names a table's other fields stay.
        flat |= {f"{name}.{key}": each for key, each in value.items()} if isinstance(value, Mapping) else {name: value}
    # What the source leaves to a part's own default, such as the spread of a printer, follows a changed part.
    return make_spec(laid_over(tables, flat), home)


def parse_tolerance(text: str) -> float:
    """Read a relative error such as '1%' or '0.01'.

    Raises
    ------
    SpecError
        It is no number, or not above 0 and at most 1.
    """
    plain = text.strip()
    try:
        value = float(plain.removesuffix("%")) / (100 if plain.endswith("%") else 1)
    except ValueError:
        raise SpecError(f"must be a relative error such as 1% or 0.01, got {text!r}", "--tolerance") from None
    if not 0 < value <= 1:
        nearest = "; the nearest that would do is 100%" if value > 1 else ", e.g. 1%"
        raise SpecError(f"must be above 0 and at most 1 (100 %), got {number(value)}{nearest}", "--tolerance")
    return value


def spec_as_recorded(spec: Spec, folder: Path) -> Spec:
    """Return `spec` with the model recorded in `folder`'s plan, and its layout too if another padgen version wrote it.

    The spec stays as it is where it names a model itself, or where the plan is of another spec. A layout that this
    version's search chose is found again, with the same cures, where the spec is planned as it was asked for.
    """
    if spec.model.structure != "auto":
        return spec
    recorded = _as_recorded(spec, folder)
    if read_manifest(folder).get("padgen") == __version__:
        return replace(spec, model=recorded.model)
    return recorded


def with_found_layout(spec: Spec, folder: Path) -> Spec:
    """Return `spec` with the layout that a search found, where the plan in `folder` was made from the same spec."""
    recorded = _as_recorded(spec, folder) if spec.leaves_layout_free else spec
    return recorded if recorded.model == spec.model else spec


def _as_recorded(spec: Spec, folder: Path) -> Spec:
    """Return the spec in `folder`/plan.json if it is `spec` but for its model and searched values, else `spec`."""
    wait_for_commit(folder, PLAN)  # else a plan that is half-written would count as none
    try:
        recorded = load_spec(str(folder / PLAN))
    except PadgenError:  # there is no plan
        return spec
    return recorded if matches_spec(recorded, spec) else spec


def plan_for(
    spec: Spec, tolerance: float | None = None, progress: Progress = lambda step: None, keep: bool = False
) -> "Plan":
    """Plan `spec` by its own model, or by the cheapest model that meets `tolerance`.

    If a tolerance needs finite elements that have no answer or are not installed, the plan is the beam model's, and its
    findings state the possible error. With `keep`, a plan by the beam model is kept in the cache, and found there by
    the next command on the same spec.

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
        spec = _with_model(spec, spec.model.structure, tolerance)
    progress("planning")
    if spec.model.structure == "solid":
        return _plan_by_solid(spec, progress)
    plan = _by_beams(spec, keep)
    if tolerance is None or spec.model.structure == "beam":
        return plan
    beam = replace(plan, spec=_with_model(spec, "beam", tolerance))
    if max(channel.model_error for channel in plan.channels) <= tolerance:
        return beam
    try:
        return _plan_by_solid(_with_model(spec, "solid", tolerance), progress)
    except SolverError:
        return beam


KIND = "plan"
"""Kind of the cache's entries that are plans."""


def _by_beams(spec: Spec, keep: bool) -> "Plan":
    """Return the plan by the beam model; with `keep` use the cache, unless registered code may affect the plan.

    Of other packages numpy alone has a part, but for optimised ladders, whose own entries know scipy's version.
    """
    import numpy

    from padgen import planner
    from padgen.planner.plan import plan_from_table

    if not keep or has_extensions():
        return planner.make_plan(spec)
    key = cache.key_of({"spec": asdict(spec), "code": cache.code_hash(), "numpy": numpy.__version__})

    def known() -> "Plan | None":
        try:
            return plan_from_table(cache.load(KIND, key), "the cache")
        except FileError:
            return None

    def made() -> "Plan":
        plan = planner.make_plan(spec)
        cache.store(KIND, key, asdict(plan))
        return plan

    return cache.get_or_compute(KIND, key, known, made)


def _with_model(spec: Spec, structure: str, tolerance: float) -> Spec:
    """Return the spec with this model and tolerance."""
    return spec_of(spec, {"model": {"structure": structure, "tolerance": tolerance}})


def _plan_by_solid(spec: Spec, progress: Progress) -> "Plan":
    """Return the plan by finite elements of the printed solids."""
    from padgen.make.solid_tuning import plan_tuned_to_solid

    return plan_tuned_to_solid(spec, progress)


def recorded_plan(path: Path, progress: Progress = lambda step: None) -> "Plan":
    """Return the plan that a plan.json records; one that an older padgen wrote is planned anew from its spec.

    Raises
    ------
    FileError
        The file holds no plan.
    """
    from padgen.planner import read_plan

    try:
        return read_plan(path)
    except OlderPlanError:
        return plan_for(load_spec(str(path)), progress=progress, keep=True)


def plan_to_compare(spec: str, mesh: Path, progress: Progress = lambda step: None) -> "tuple[Plan, str]":
    """Return the plan with which a mesh is compared, and a text that names its source.

    A plan.json is used as recorded, beams included. For another spec it is the plan recorded beside the mesh, by any
    model, if that plan is of the same spec; otherwise the spec is planned as for a build.

    Raises
    ------
    FileError
        A plan.json, given or beside the mesh, holds no plan.
    SpecError, SolverError
        As planning does.
    """
    path = find_spec(spec)
    beside = mesh.parent / PLAN
    if path.suffix == ".json":
        plan = recorded_plan(path, progress)
        source = spec
    else:
        asked = load_spec(spec)
        is_there = read_as_one(mesh.parent, beside.is_file, PLAN)
        recorded = recorded_plan(beside, progress) if is_there else None
        if recorded and matches_spec(recorded.spec, asked):
            plan = recorded
            source = str(beside)
        else:
            plan = plan_for(asked, progress=progress, keep=True)
            source = f"{spec}, planned anew"
    models = " and ".join(sorted({channel.model for channel in plan.channels}))
    return plan, f"{source} ({models} model)"
