"""Public functions that run long: study, study_extreme, sweep and run_sweep."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from padgen.core.errors import SpecError

if TYPE_CHECKING:
    from padgen.batch.definition import Sweep
    from padgen.batch.sweep import Event, SweepResult, SweepTable
    from padgen.ladders.study import ExtremeStudy, Study
    from padgen.planner.plan import Plan
    from padgen.spec.model import Spec

__all__ = ["read_sweep", "run_sweep", "study", "study_extreme", "sweep"]

MOST_WORKERS = 1024

Progress = Callable[[str], None]


def _silent(step: str) -> None:
    """Ignore a progress message."""


def study(
    plan: "Plan | str | Path | Mapping[str, Any] | Spec",
    *,
    only: Sequence[str] | None = None,
    tolerance: float | str | None = None,
    folder: "str | Path | None" = None,
    progress: Progress = _silent,
) -> "Study":
    """Measure the error and run time of each model behind a plan, from coarse to fine, each in a process of its own.

    After an interruption (Ctrl-C) the measured part is returned, and ``.missing`` names the rungs that were not run.
    Times are the best of a few runs in a process that has imported its modules (``.about["times"]``).

    Parameters
    ----------
    plan : Plan, or what `padgen.plan` takes
        The plan whose models are measured.
    only : sequence of str, optional
        Names of ladders, of allocation, geometry, dynamics, force, skin, structure and pad; by default all.
    tolerance : float or str, optional
        Recommend models for this relative error too, as 0.01 or 1%.
    folder : path, optional
        Where tables and plots of the study are written; without it nothing is.
    progress : callable
        Called with one line of text at each step.

    Returns
    -------
    Study
        ``.ladders``, ``.picks`` (the quickest rung for each tolerance) and ``.plot()``.

    Raises
    ------
    SpecError
        A name is no ladder's, or the tolerance is not above 0 and at most 1.
    """
    from padgen.api.pads import is_plan
    from padgen.api.pads import plan as planned
    from padgen.ladders.study import measured_study, parse_only, run_study
    from padgen.make.planning import parse_tolerance

    largest = None if tolerance is None else parse_tolerance(str(tolerance))
    ladders = parse_only(None if only is None else ",".join(only))
    made = plan if is_plan(plan) else planned(plan, progress=progress)
    if folder is None:
        return measured_study(made, ladders, largest, progress)
    return run_study(made, Path(folder), ladders, largest, progress)


def study_extreme(folder: "str | Path", *, progress: Progress = _silent) -> "ExtremeStudy":
    """Compare each model's error in extreme cases with the error that it states, and write verdicts to a folder.

    After an interruption (Ctrl-C) the cases that were left are 'not run'.

    Raises
    ------
    FileError
        The folder cannot be written; what was there stays.
    """
    from padgen.ladders.study import run_extreme

    return run_extreme(Path(folder), progress)


def sweep(
    base: "str | Path | Mapping[str, Any] | Spec",
    *,
    stage: str = "plan",
    folder: "str | Path | None" = None,
    workers: int | None = None,
    **axes: Any,
) -> "SweepTable":
    """Plan, or also build or study, a variant of a spec for each combination of field values, on all cores by default.

    Parameters
    ----------
    base : str, path, mapping or Spec
        The spec to vary, as `padgen.plan` takes it.
    stage : {'plan', 'yield', 'build', 'study'}
        Last stage made of each variant.
    folder : path, optional
        Folder for the index and, with `stage` 'build' or 'study', a folder of each variant. Without it a temporary
        folder is used and removed.
    workers : int, optional
        Processes at a time.
    **axes
        Lists of values by field, fields of tables in mappings (``coil={"gap_mm": [0.8, 1.0]}``).

    Returns
    -------
    SweepTable
        ``.table()`` is a list with a dict for each variant, ``.counts`` the numbers of done, refused and failed ones.

    Raises
    ------
    SpecError
        A field is unknown, or holds no list of values that it may take.

    Examples
    --------
    >>> import padgen as pg
    >>> [row["selectivity_db"] > 10 for row in pg.sweep("paper-pair", q_min=[15, 20]).table()]
    [True, True]
    """
    if stage in ("build", "study") and folder is None:
        raise SpecError(f"needs a folder for stage {stage!r}, whose files would go with it", "sweep")
    from padgen.batch.definition import sweep_over
    from padgen.batch.sweep import run_to_table
    from padgen.make.planning import spec_of

    return run_to_table(sweep_over(spec_of(base), axes, stage), None if folder is None else Path(folder), workers)


def read_sweep(path: "str | Path") -> "Sweep":
    """Read a sweep's TOML file: a base spec, and what is varied.

    Raises
    ------
    FileError, SpecError
        It cannot be read, or a field of it or of its base is unknown, missing or out of bounds.
    """
    from padgen.batch.definition import load_sweep

    return load_sweep(str(path))


class RanSweep(NamedTuple):
    """Result of `run_sweep`, names of the files with its Pareto front, and the reason if that front was not plotted."""

    result: "SweepResult"
    files: tuple[str, ...]
    note: str


def run_sweep(
    sweep: "Sweep | str | Path",
    folder: "str | Path",
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = True,
    retry: bool = False,
    on_event: "Callable[[Event], None]" = lambda event: None,
) -> RanSweep:
    """Compute a sweep's variants, and write a table of them, their Pareto front and, by default, a folder for each.

    Parameters
    ----------
    sweep : Sweep or path
        The file, or what `read_sweep` made of it.
    folder : path
        It is made if it is not there; variants that are finished in it are kept.
    workers : int, optional
        Processes at a time, 1 to 1024; by default one per core.
    scheduler : str, optional
        Address of a Dask cluster to run on, as 'tcp://host:8786'.
    resume : bool
        Keep variants that were finished before from the same inputs, or make all again.
    retry : bool
        Make variants that failed before once more.
    on_event : callable
        Called with every event: a variant that was made, kept, refused or failed.

    Raises
    ------
    SpecError, FileError
        The sweep or an argument is bad, or the folder cannot be written or is in use.
    EngineMissingError
        The extra ``dask`` is not installed.
    """
    if workers is not None and not 1 <= workers <= MOST_WORKERS:
        raise SpecError(f"must be 1 … {MOST_WORKERS} processes, got {workers}", "--jobs")
    if workers is not None and scheduler is not None:
        raise SpecError("does not go with --scheduler: the cluster has the workers that it has", "--jobs")
    from padgen.batch.index import write_pareto
    from padgen.batch.sweep import connect
    from padgen.batch.sweep import run_sweep as run
    from padgen.core.runner import uninterrupted

    read = read_sweep(sweep) if isinstance(sweep, (str, Path)) else sweep
    # Without a Dask cluster, this machine's processes work.
    cluster = nullcontext() if scheduler is None else connect(scheduler)
    with cluster as executor:
        result = run(read, Path(folder), executor, workers, resume, retry, on_event)
    with uninterrupted() if result.interrupted else nullcontext():
        return RanSweep(result, *write_pareto(Path(folder), read.settings.name, result.overview))
