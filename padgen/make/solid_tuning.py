"""Tune the width of beams until the printed solids resonate at their planned frequencies.

The planner's beam model proposes widths, and finite elements of the printed solid decide: each distinct taxel's width
is corrected by a secant that starts from the beam model's slope. Solutions are kept (`padgen.core.cache`), so that a
plan whose taxels are all known loads neither a CAD kernel nor an engine.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, replace
from math import exp, log, pi
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from padgen.core import cache
from padgen.core.display import Step
from padgen.core.errors import EngineMissingError, SolverError, SpecError, number, plural
from padgen.core.units import G_PER_CM3, GPA, GRAM
from padgen.physics.resonator import TaxelModes
from padgen.planner.layout import room, shape_inputs
from padgen.planner.make import Choice, choose, finish, with_cures
from padgen.planner.plan import Channel, Plan
from padgen.planner.sizing import SizedChannel, printable_widths_mm, steps_are_coarse
from padgen.planner.suspensions import suspension
from padgen.planner.taxel_model import asked_error, plate_shape, solved_model
from padgen.spec import Spec

if TYPE_CHECKING:
    from padgen.core.runner import Answer, Runner

__all__ = ["TaxelSolver", "plan_tuned_to_solid", "solid_taxel", "solve_step"]

WIDER = 1.01
"""Width over the first one, of the beam model's taxel from which the secant has its first slope."""
STEEPEST = 2.0
FLATTEST = 0.1
ROUNDS = 5
MISS_SHARE = 0.5
"""Share of the solver's tolerance within which a resonance counts as on its target."""
KIND = "taxel-modes"
MODES = 6
WORKERS = 8
ENGINE = ("ngsolve", "padgen.verify.elasticity")
"""Modules that a solving process loads while the first taxel is modelled."""
STEEL_GPA = 200.0
STEEL_POISSON = 0.3
"""Elastic constants of washer and ballast, which are forty times stiffer than the print and hardly bend."""
CODE = ("physics/resonator.py", "planner/suspensions/__init__.py", "planner/layout.py", "solid/taxel.py", "verify")
Progress = Callable[[str], None]
Task = tuple[Channel, int]
"""The channel whose taxel is to be solved, and the first setting to try."""


class SolvedTaxel(NamedTuple):
    """Modes of one taxel by finite elements, their estimated relative error, and the index of the mesh setting used.

    The setting is the index in `verify.elasticity.SETTINGS`.
    """

    modes: TaxelModes
    error: float
    setting: int = 0

    @property
    def resonance_hz(self) -> float:
        """Resonance of the working mode in Hz."""
        return float(self.modes.frequency_hz[self.modes.working])


class Trial(NamedTuple):
    """A beam width tried for a channel: its modes, and the distance from the target, ``ln(goal/resonance)``."""

    sized: SizedChannel
    solved: SolvedTaxel
    miss: float


def plan_tuned_to_solid(spec: Spec, progress: Progress = lambda step: None) -> Plan:
    """Return the plan of `spec` with beam widths tuned until finite elements give the channels' target resonances.

    A channel keeps the beam model's figures where the solid's error estimate is no smaller than the beam model's;
    findings name such channels, and those whose error exceeds `asked_error`.

    Raises
    ------
    SpecError, InfeasibleError, GeometryError
        As planning and modelling do.
    SolverError
        A solid cannot be meshed or solved.
    EngineMissingError
        The finite-element package is not installed.
    """
    if spec.printer.z_offset_mm or spec.printer.width_offset_mm:
        raise SpecError(
            f"'solid' solves beams as they are drawn, but printer {spec.printer.name!r} prints them"
            f" {number(spec.printer.z_offset_mm)} mm thicker and {number(spec.printer.width_offset_mm)} mm wider; use"
            " 'beam', which includes that",
            "model.structure",
        )
    asked = spec
    choice = choose(spec)
    spec = choice.spec
    beams = choice.channels
    tolerance = asked_error(spec)
    # With coarse printer steps the goal is the printable resonance.
    coarse = steps_are_coarse(spec) and not spec.resonances_hz
    goals = [float(c.model.resonance_hz) if coarse else c.target_hz for c in beams]
    trials: list[list[Trial]] = [[] for _ in goals]
    with TaxelSolver(tolerance, progress) as solver:
        for _ in range(ROUNDS):
            # The next width needs the same setting as the last one.
            settings = [tried[-1].solved.setting if tried else 0 for tried in trials]
            answers = solver.solve(finish(choice, quick=True), settings)
            for tried, sized, goal, solved in zip(trials, choice.channels, goals, answers, strict=True):
                tried.append(Trial(sized, solved, log(goal / solved.resonance_hz)))
            channels = tuple(_next_trial(spec, choice, tried, tolerance * MISS_SHARE) for tried in trials)
            if channels == choice.channels:
                break
            choice = choice._replace(channels=channels)
    best = list(beams)
    for index, tried in enumerate(trials):
        sized, solved, _ = min(tried, key=lambda trial: abs(trial.miss))
        if solved.error < beams[index].model.error_estimate:
            best[index] = replace(sized, model=solved_model(sized.model, solved.modes, solved.error))
    return with_cures(asked, choice._replace(channels=tuple(best)))


def _next_trial(spec: Spec, choice: Choice, tried: Sequence[Trial], enough: float) -> SizedChannel:
    """Return the channel with the width to try next, or the same channel once its best width is found."""
    last = tried[-1]
    if min(abs(trial.miss) for trial in tried) <= enough:
        return last.sized
    width = last.sized.beam.width_mm * exp(last.miss / _slope(spec, tried))
    plate = plate_shape(spec)
    widest = suspension(last.sized.topology).widest(room(spec, choice.layout), plate, spec.printer.smallest_gap_mm)
    beam = last.sized.beam._replace(width_mm=float(printable_widths_mm(spec, width, widest)))
    if any(beam == trial.sized.beam for trial in tried):
        return last.sized
    model = type(last.sized.model)(spec, last.sized.topology, plate, beam)
    return SizedChannel(last.sized.target_hz, last.sized.topology, beam, model)


def _slope(spec: Spec, tried: Sequence[Trial]) -> float:
    """Return d ln(resonance) / d ln(width) from the last two trials or, after only one, from the beam model."""
    last = tried[-1].sized
    if len(tried) < 2:
        wider = last.beam._replace(width_mm=last.beam.width_mm * WIDER)
        model = type(last.model)(spec, last.topology, plate_shape(spec), wider)
        step = log(WIDER)
        rise = log(float(model.resonance_hz / last.model.resonance_hz))
    else:
        before = tried[-2]
        step = log(last.beam.width_mm / before.sized.beam.width_mm)
        rise = before.miss - tried[-1].miss
    return float(np.clip(rise / step, FLATTEST, STEEPEST)) if step else FLATTEST


class TaxelSolver:
    """Finite-element solver of plans' taxels, each distinct one once, in other processes; a context manager.

    The engine's libraries and the CAD kernel's have different versions and must not be in one process. Processes are
    started with the first taxel that the cache does not hold. The elements are refined until their estimated error is
    below `tolerance`, or no further refinement is possible.
    """

    def __init__(self, tolerance: float, progress: Progress) -> None:
        self.tolerance = tolerance
        self._progress = progress
        self._runner: Runner | None = None

    def __enter__(self) -> "TaxelSolver":
        return self

    def __exit__(self, *_: object) -> None:
        if self._runner:
            self._runner.close()

    def solve(self, plan: Plan, settings: Sequence[int]) -> list[SolvedTaxel]:
        """Return the modes of every channel's taxel; `settings` has for each the mesh setting to start from."""
        tasks = list(zip(plan.channels, settings, strict=True))
        keys = [cache.key_of(self._inputs(plan, *task)) for task in tasks]
        known = _from_cache(keys)
        unknown = set(keys) - set(known)
        if unknown:
            with cache.claimed(KIND, unknown):
                known |= _from_cache(unknown)  # others may have stored them during the wait
                missing = {key: task for key, task in zip(keys, tasks, strict=True) if key not in known}
                if missing:
                    known |= dict(zip(missing, self._computed(plan, list(missing.values())), strict=True))
                for key in missing:
                    cache.store(KIND, key, _to_plain(known[key]))
        return [known[key] for key in keys]

    def _inputs(self, plan: Plan, channel: Channel, setting: int) -> dict[str, Any]:
        """Return all inputs on which the modes depend."""
        spec = plan.spec
        packages = ("build123d", "cadquery-ocp-novtk", "netgen-mesher", "ngsolve")
        return {
            **shape_inputs(plan, channel),
            "material": asdict(spec.material),
            "washer": asdict(spec.washer_or_magnet),
            **({"ballast": asdict(spec.ballast)} if spec.ballast else {}),
            "glue_mg": spec.taxel.glue_mg,
            "tolerance": self.tolerance,
            "setting": setting,
            "code": cache.code_hash(*CODE),
            "versions": [cache.version(name) for name in packages],
        }

    def _computed(self, plan: Plan, tasks: Sequence[Task]) -> list[SolvedTaxel]:
        """Return the modes of the tasks' taxels: model each as a STEP file and solve several at a time."""
        if self._runner is None:
            from padgen.core.runner import Runner, core_count
            from padgen.verify import require

            require("ngsolve")
            workers = min(len(tasks), core_count(), WORKERS)
            self._runner = Runner(workers, ENGINE)
            # Its processes load the engine while this one loads the CAD kernel.
            self._runner.prepare(workers)
        from padgen.solid.formats.step import write_taxel_step

        with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            jobs = []
            count = f"{len(tasks)} taxel{plural(len(tasks))}"
            self._progress(f"modelling {count}")
            for channel, setting in tasks:
                path = Path(folder) / f"taxel-{channel.index}.step"
                write_taxel_step(plan, channel, path)
                jobs.append(self._runner.submit(solve_step, solid_taxel(plan, channel, path), self.tolerance, setting))
            solved: list[SolvedTaxel] = []
            for job, (channel, _) in zip(jobs, tasks, strict=True):
                self._progress(Step(f"solving {count} by finite elements", len(solved) / len(jobs)))
                solved.append(_modes_of(job.result(), channel))
            return solved


def _modes_of(answer: "Answer", channel: Channel) -> SolvedTaxel:
    """Return the modes in a worker's answer, or raise the error that it holds.

    Raises
    ------
    PadgenError
        The error of the process, or a `SolverError` where it broke down.
    """
    error = answer.error
    if isinstance(error, SolverError) and not isinstance(error, EngineMissingError):
        lost = f'the finite elements have no answer: {error.message}; model = "beam" plans without them'
        cause = lost if answer.kind == "failed" else error.message
        raise SolverError(cause, f"channel {channel.index}") from error
    if error:
        raise error
    solved: SolvedTaxel = answer.value
    return solved


def solid_taxel(plan: Plan, channel: Channel, step: Path) -> Any:
    """Return the input of the finite elements (`verify.elasticity.SolidTaxel`): the STEP file with its materials."""
    from padgen.verify.elasticity import Elastic, SolidTaxel, layered

    spec = plan.spec
    material = spec.material
    washer = spec.washer_or_magnet
    ballast = spec.ballast
    printed = Elastic(material.modulus_gpa * GPA, material.poisson_ratio, material.density_g_per_cm3 * G_PER_CM3)
    ring_mm2 = pi / 4 * (washer.outer_diameter_mm**2 - washer.inner_diameter_mm**2)
    return SolidTaxel(
        step,
        layered(printed, material.cross_layer_ratio),
        Elastic(STEEL_GPA * GPA, STEEL_POISSON, washer.density_g_per_cm3 * G_PER_CM3),
        ring_mm2 * washer.thickness_mm,
        float(plan.arrangement(channel).washer_x_mm),
        spec.taxel.glue_mg * 1e-3 * GRAM,
        name=f"{plan.name}, channel {channel.index}",
        ballast=Elastic(STEEL_GPA * GPA, STEEL_POISSON, ballast.density_g_per_cm3 * G_PER_CM3) if ballast else None,
        ballast_volume_mm3=ballast.area_mm2 * ballast.height_mm if ballast else 0.0,
    )


def solve_step(taxel: Any, tolerance: float, setting: int) -> SolvedTaxel:
    """Return the modes of the taxel in one STEP file by finite elements; called in a separate process."""
    from padgen.verify.elasticity import converged_modes

    modes = converged_modes(taxel, tolerance, MODES, setting)
    return SolvedTaxel(modes.modes, modes.working_error, modes.setting)


def _to_plain(solved: SolvedTaxel) -> dict[str, Any]:
    """Return a solution as plain data for the cache."""
    modes = solved.modes
    rest = np.zeros((6, 6)) if modes.rest is None else modes.rest
    return {
        "frequency_hz": modes.frequency_hz.tolist(),
        "motion": modes.motion.tolist(),
        "rest": rest.tolist(),
        "error": solved.error,
        "setting": solved.setting,
    }


def _from_cache(keys: Iterable[str]) -> dict[str, SolvedTaxel]:
    """Return the cached solutions by key, without the keys that the cache lacks."""
    return {key: solved for key in keys if (solved := _from_plain(cache.load(KIND, key)))}


def _from_plain(entry: Any) -> SolvedTaxel | None:
    """Return a solution from the cache's data, None where the data are not a taxel's modes."""
    try:
        frequency, motion, rest = (np.array(entry[key], float) for key in ("frequency_hz", "motion", "rest"))
        error = float(entry["error"])
        setting = int(entry["setting"])
    except (KeyError, OverflowError, TypeError, ValueError):
        return None
    shapes = (frequency.shape, motion.shape, rest.shape)
    is_sound = shapes == ((MODES,), (MODES, 6), (6, 6)) and frequency.min() > 0
    is_sound = is_sound and all(np.isfinite(v).all() for v in (frequency, motion, rest, error))
    return SolvedTaxel(TaxelModes(frequency, motion, rest), error, setting) if is_sound else None
