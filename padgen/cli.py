"""The ``padgen`` command: the only place that prints and sets exit codes.

Exit codes: 0 done and every check holds; 1 done, but a check fails; 2 bad input or usage.
"""

import argparse
import io
import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, NoReturn

from padgen import __version__
from padgen.errors import FileError, PadgenError, SpecError

__all__ = ["main", "run"]

DONE, CHECK_FAILED, BAD_INPUT = 0, 1, 2
MOST_PADS = 10_000_000
LADDER_NAMES = ("allocation", "structure", "force", "dynamics", "geometry", "pad")
SMALLEST_SPEC = {"name": "default", "resolution": 1, "band_hz": [50, 200], "q_min": 15}


def main() -> NoReturn:
    """Entry point of the console script."""
    # Thousands of 6 x 6 matrices gain nothing from threads, and wait for them under load.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    code = run(sys.argv[1:])
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:
        code = BAD_INPUT
    # The CAD kernel takes up to half a second to take itself apart, for nothing.
    os._exit(code)


def run(arguments: list[str]) -> int:
    """Run one command and return its exit code."""
    parser = _parser()
    try:
        options = parser.parse_args(arguments)
    except SystemExit as stop:
        return BAD_INPUT if stop.code else DONE
    as_json = getattr(options, "json", False)
    try:
        code: int = options.command(options)
        return code
    except PadgenError as error:
        return _refused(str(error), error.code, as_json)
    except KeyboardInterrupt:
        return _refused("interrupted; files are as they were", "interrupted", as_json)
    except BrokenPipeError:
        # So that the flush at exit does not meet the closed pipe again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BAD_INPUT
    except OSError as error:
        return _refused(f"cannot be written ({error.strerror or error})", "file", as_json)
    except MemoryError:
        return _refused("the machine has not enough memory for this pad; ask for fewer taxels", "memory", as_json)


def _refused(sentence: str, code: str, as_json: bool) -> int:
    if as_json:
        print(json.dumps({"error": {"code": code, "message": sentence}}, ensure_ascii=False))
    else:
        print(f"padgen: {sentence}", file=sys.stderr)
    return BAD_INPUT


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="padgen", description="Vibrotactile pads with more taxels than coils, from a spec to a pad that prints."
    )
    parser.add_argument("--version", action="version", version=f"padgen {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    plan = commands.add_parser("plan", help="frequency allocation, beams, selectivity, feasibility")
    plan.add_argument("spec", metavar="SPEC", help="a TOML file or the name of a template")
    plan.add_argument("--explain", action="store_true", help="which limit binds, and what the cheapest changes buy")
    plan.add_argument(
        "--yield",
        dest="pads",
        metavar="PADS",
        type=int,
        nargs="?",
        const=100_000,
        help="print it so many times in the computer (default: %(const)s): how many come out selective, and why not",
    )
    plan.add_argument("--seed", type=int, default=0, help="of --yield; the same seed, the same figures (default: 0)")
    _model(plan)
    _output(plan)
    plan.set_defaults(command=_plan)

    build = commands.add_parser("build", help="the pad, its checks and its driver table")
    build.add_argument("spec", metavar="SPEC", help="a TOML file or the name of a template")
    build.add_argument("--formats", default="stl,3mf,step", help="of stl, 3mf, step, glb (default: %(default)s)")
    build.add_argument(
        "--instances", action="store_true", help="3MF with one mesh per distinct taxel, placed many times"
    )
    build.add_argument("--force", action="store_true", help="build again even if nothing changed")
    _model(build)
    _output(build)
    build.set_defaults(command=_build)

    check = commands.add_parser("check", help="print validation of any STL or 3MF")
    check.add_argument("mesh", metavar="MESH", help="an STL, 3MF, OBJ or PLY file")
    check.add_argument(
        "--spec", metavar="SPEC", help="compare with the plan of this spec, and take its printer's limits"
    )
    check.add_argument("--json", action="store_true", help="one JSON object on standard output")
    check.set_defaults(command=_check)

    study = commands.add_parser(
        "study",
        help="error against run time of every model behind a plan",
        description="Run every model behind a plan, each in a process of its own, and tell which is enough for which"
        " error. All ladders take some minutes; needs the extra padgen[study].",
    )
    study.add_argument("spec", metavar="SPEC", nargs="?", help="a TOML file or the name of a template")
    study.add_argument("--only", metavar="LADDERS", help=f"some of {', '.join(LADDER_NAMES)}, with commas between")
    study.add_argument("--tolerance", metavar="SHARE", help="recommend for this relative error too, as 1%% or 0.01")
    study.add_argument("--extreme", action="store_true", help="hold every model to what it states in extreme cases")
    _output(study)
    study.set_defaults(command=_study)

    templates = commands.add_parser("templates", help="list the templates, or show one")
    templates.add_argument("name", metavar="NAME", nargs="?")
    templates.set_defaults(command=_templates)

    init = commands.add_parser("init", help="copy a template to standard output")
    init.add_argument("name", metavar="NAME")
    init.set_defaults(command=_init)

    schema = commands.add_parser("schema", help="the JSON schema of a spec, for editors")
    schema.set_defaults(command=_schema)
    return parser


def _model(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--model",
        metavar="beam|solid",
        help="where resonances come from: the beam model, or finite elements of the printed solid, to which the beams"
        " are then tuned (default: the spec's)",
    )
    parser.add_argument(
        "--tolerance",
        metavar="SHARE",
        help="relative error of a resonance that will do, as 1%% or 0.01; finite elements where the beam model's own"
        " estimate is more (default: the spec's, 2%%, and in a plan the beam model)",
    )


def _with_model(spec: Any, options: argparse.Namespace) -> Any:
    """The spec with what the command line says about its model."""
    from dataclasses import replace

    from padgen.spec.fields import build
    from padgen.spec.model import Model

    asked: dict[str, Any] = {}
    if options.model is not None:
        asked["structure"] = options.model
    if options.tolerance is not None:
        from padgen.study.run import parse_tolerance

        asked["tolerance"] = parse_tolerance(options.tolerance)
    return replace(spec, model=build(Model, asked, "model", asdict(spec.model))) if asked else spec


def _output(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--output", metavar="DIR", help="folder of the results (default: out/NAME)")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")


def _folder(options: argparse.Namespace, name: str) -> Path:
    return Path(options.output) if options.output else Path("out") / name


def _plan(options: argparse.Namespace) -> int:
    from padgen.files import PLAN_FILES, YIELD_FILE, OutputFolder, differs, json_text, stale_files
    from padgen.planner import plan_to_json
    from padgen.spec import load_spec

    if options.pads is not None and not 1 <= options.pads <= MOST_PADS:
        raise SpecError(f"must be 1 … {MOST_PADS} pads, got {options.pads}", "--yield")
    if options.seed < 0:
        raise SpecError(f"must be 0 or more, got {options.seed}", "--seed")
    spec = _with_model(load_spec(options.spec), options)
    plan = _planned(spec, options)
    text = plan_to_json(plan)
    explanation = _explained(spec, plan) if options.explain else None
    printed = _printed(plan, options) if options.pads else None
    folder = _folder(options, plan.name)
    with OutputFolder(folder) as out:
        out.write("plan.json", text)
        if printed:
            out.write(YIELD_FILE, json_text(asdict(printed)))
        stale = stale_files(folder, text)
        out.commit(remove=PLAN_FILES if differs(folder, "plan.json", text) else ())
    if options.json:
        parts = {"explain": explanation, "yield": printed}
        present = {key: asdict(part) for key, part in parts.items() if part}
        print(json_text({**json.loads(text), **present}) if present else text, end="")
    else:
        _print_plan(plan, explanation, printed)
        print(f"\nwritten: {folder / 'plan.json'}{f'  {YIELD_FILE}' if printed else ''}")
        if stale:
            print(f"the other files in {folder} are of an earlier plan; padgen build makes them anew")
    return _code(plan.findings)


def _planned(spec: Any, options: argparse.Namespace) -> Any:
    """The beam model's plan, in an instant, unless finite elements or a tolerance were asked for."""
    if spec.model.structure != "solid" and options.tolerance is None:
        from padgen.planner import make_plan

        return make_plan(spec)
    from padgen.loop import planned

    with _progress() as progress:
        return planned(spec, progress)


def _print_plan(plan: Any, explanation: Any, printed: Any) -> None:
    from padgen.tell import explanation_text, findings_text, plan_text, yield_text

    _show(plan_text(plan))
    _show(findings_text(plan.findings))
    if explanation:
        _show(f"\n{explanation_text(explanation)}")
    if printed:
        _show(f"\n{yield_text(printed)}")


def _printed(plan: Any, options: argparse.Namespace) -> Any:
    from padgen.planner.print_yield import print_yield

    with _progress() as progress:
        progress(f"printing {options.pads} pads")
        return print_yield(plan, options.pads, options.seed)


def _explained(spec: Any, plan: Any) -> Any:
    from padgen.planner.explain import explain_plan

    with _progress() as progress:
        return explain_plan(spec, plan, progress)


def _build(options: argparse.Namespace) -> int:
    from padgen.build import build, parse_formats, up_to_date
    from padgen.files import json_text
    from padgen.spec import load_spec

    spec = _with_model(load_spec(options.spec), options)
    formats = parse_formats(options.formats)
    folder = _folder(options, spec.name)
    built = None if options.force else up_to_date(spec, folder, formats, options.instances)
    if built is None:
        with _progress() as progress:
            built = build(spec, folder, formats, options.instances, progress)
    if options.json:
        print(json_text({**asdict(built), "folder": str(built.folder)}), end="")
    else:
        from padgen.tell import built_text, findings_text

        _show(built_text(built))
        _show(findings_text(built.findings))
    return _code(built.findings)


def _check(options: argparse.Namespace) -> int:
    from padgen.spec import load_spec, make_spec

    with _progress() as progress:
        progress("reading")
        from padgen.solid.foreign import check_file

        # Without a spec, the limits are the default printer's.
        spec = load_spec(options.spec) if options.spec else make_spec(SMALLEST_SPEC)
        report = check_file(Path(options.mesh), spec, bool(options.spec), progress)
    if options.json:
        from padgen.files import json_text

        print(json_text(asdict(report)), end="")
    else:
        from padgen.tell import figures_text, findings_text

        print(figures_text(report.figures))
        print(findings_text(report.findings))
    return _code(report.findings)


def _study(options: argparse.Namespace) -> int:
    if options.extreme:
        return _extreme_study(options)
    if options.spec is None:
        raise SpecError("is missing; name a TOML file or a template, or ask for --extreme", "SPEC")
    from padgen.spec import load_spec
    from padgen.study import parse_only, parse_tolerance, run_study

    tolerance = None if options.tolerance is None else parse_tolerance(options.tolerance)
    only, spec = parse_only(options.only), load_spec(options.spec)
    with _progress() as progress:
        study = run_study(spec, _folder(options, spec.name), only, tolerance, progress)
    if options.json:
        print((study.folder / "study.json").read_text(encoding="utf-8"), end="")
    else:
        from padgen.study.tell import study_text

        _show(study_text(study))
        print(f"\nwritten to {study.folder}: {'  '.join(study.files)}")
    return DONE


def _extreme_study(options: argparse.Namespace) -> int:
    if any(value is not None for value in (options.spec, options.only, options.tolerance)):
        raise SpecError("has its own cases and takes no SPEC, --only or --tolerance", "--extreme")
    from padgen.study import run_extreme

    with _progress() as progress:
        study = run_extreme(_folder(options, "extreme"), progress)
    if options.json:
        print((study.folder / "extreme.json").read_text(encoding="utf-8"), end="")
    else:
        from padgen.study.tell import extreme_text

        _show(extreme_text(study))
        print(f"\nwritten to {study.folder}: {'  '.join(study.files)}")
    return DONE if study.holds else CHECK_FAILED


def _templates(options: argparse.Namespace) -> int:
    from padgen.spec import template_paths

    if options.name:
        return _init(options)
    for name, path in template_paths().items():
        first = path.read_text(encoding="utf-8").splitlines()[0].lstrip("# ")
        print(f"{name:<12}  {first}")
    return DONE


def _init(options: argparse.Namespace) -> int:
    from padgen.spec.fields import unknown_name
    from padgen.spec.load import template_paths

    templates = template_paths()
    if options.name not in templates:
        raise FileError(unknown_name(options.name, list(templates), "template", "").message, "NAME")
    print(templates[options.name].read_text(encoding="utf-8"), end="")
    return DONE


def _schema(options: argparse.Namespace) -> int:
    from padgen.spec.schema import spec_schema

    print(json.dumps(spec_schema(), indent=1, ensure_ascii=False))
    return DONE


def _show(text: str) -> None:
    """Print for people: on a terminal, sentences wrapped to its width; tables and pipes as they are."""
    if sys.stdout.isatty():
        import shutil
        import textwrap

        width = max(shutil.get_terminal_size().columns, 60)
        # Columns of a table stand two spaces apart.
        text = "\n".join(
            line if "  " in line.strip() else textwrap.fill(line, width, subsequent_indent="  ")
            for line in text.splitlines()
        )
    print(text)


def _code(findings: Any) -> int:
    return CHECK_FAILED if any(finding.level == "error" for finding in findings) else DONE


@contextmanager
def _progress() -> Iterator[Any]:
    """A line that says what is being done, on a terminal only."""
    if not sys.stderr.isatty():
        yield lambda step: None
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("")
        yield lambda step: bar.update(task, description=step)
