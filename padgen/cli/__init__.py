"""Run the ``padgen`` command; no other package of padgen prints or sets exit codes.

Exit codes: 0 done and every check holds; 1 done, but a check fails; 2 bad input or usage. Each command has a function
that declares its options, and one that runs it.
"""

import argparse
import gc
import io
import json
import os
import re
import sys
import warnings
from contextlib import suppress
from typing import Any, NoReturn

from padgen import __version__
from padgen.cli import build, draw, drive, explore, plan, report, retune, small, sweep
from padgen.cli.common import BAD_INPUT, DONE
from padgen.core.errors import LONGEST, EngineMissingError, PadgenError, plain

__all__ = ["main", "run"]

DEBUG = "PADGEN_DEBUG"
"""Environment variable that, when set, shows warnings and tracebacks."""
COMMANDS = {
    "plan": plan.add,
    "build": build.add_build,
    "check": build.add_check,
    "explore": explore.add,
    "report": report.add,
    "draw": draw.add,
    "drive": drive.add_drive,
    "play": drive.add_play,
    "bench": retune.add_bench,
    "retune": retune.add_retune,
    "calibrate": retune.add_calibrate,
    "study": sweep.add_study,
    "sweep": sweep.add_sweep,
    **dict.fromkeys(("cache", "restore", "templates", "init", "schema"), small.add),
}
"""The function that declares each command and its options."""


def main() -> NoReturn:
    """Run the console script and end the process with the command's exit code."""
    # Threads gain nothing on thousands of 6 x 6 matrices, and waiting for them costs time on a busy machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Looking for cycles after every 700 new objects finds next to none, and costs a plan 15 ms.
    gc.set_threshold(50_000)
    if DEBUG not in os.environ and not sys.warnoptions:
        # Warnings of libraries are for programmers; padgen reports problems as findings or refusals.
        warnings.simplefilter("ignore")
        os.environ["PYTHONWARNINGS"] = "ignore"  # for child processes
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # some programs start others with closed streams
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    code = run(sys.argv[1:])
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:
        code = BAD_INPUT
    # Skip the interpreter's clean-up, in which the CAD kernel would need up to half a second.
    os._exit(code)


def run(arguments: list[str]) -> int:
    """Run one command and return its exit code."""
    try:
        options = _parsed(arguments)
        exit_code = int(options.command(options))
        sys.stdout.flush()  # a disk that is full by now gets its sentence
        return exit_code
    except SystemExit:  # --help and --version
        return DONE
    except BrokenPipeError:
        # Redirect standard output, so that the flush at exit does not fail on the closed pipe again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BAD_INPUT
    except PadgenError as error:
        code = error.code
        sentence = str(error).removeprefix("padgen: ")
    except KeyboardInterrupt:
        code = "interrupted"
        sentence = "interrupted; files are as they were"
    except OSError as error:
        code = "file"
        sentence = f"cannot be written ({error.strerror or error})"
    except MemoryError:
        asked = f"this padgen {' '.join(arguments[:1])}"
        code = "memory"
        sentence = f"the machine has not enough memory for {asked}; files are as they were"
    except Exception as error:
        if DEBUG in os.environ:
            raise
        request = "please report it with the command and its files"
        code = "internal"
        sentence = f"internal error ({type(error).__name__}: {error}); {request} ({DEBUG}=1 shows where it is)"
    sentence = plain(sentence, LONGEST)
    if "--json" in arguments:
        with suppress(OSError):
            print(json.dumps({"error": {"code": code, "message": sentence}}, ensure_ascii=False), flush=True)
            return BAD_INPUT
    name = "" if re.match(r"padgen [a-z]+: ", sentence) else "padgen: "
    print(f"{name}{sentence}", file=sys.stderr)
    return BAD_INPUT


def _parsed(arguments: list[str]) -> argparse.Namespace:
    """Parse the command line; accept optional positional arguments after options too, which argparse alone refuses."""
    parser = _parser(arguments[:1])
    options, rest = parser.parse_known_args(arguments)
    name = getattr(options, "late", None)
    if name and not getattr(options, name) and rest and not any(each.startswith("-") for each in rest):
        several = isinstance(getattr(options, name), list)
        if several or len(rest) == 1:
            setattr(options, name, rest if several else rest[0])
            rest = []
    if rest:
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    return options


MISSING = "the following arguments are required: "
"""Beginning of argparse's message on missing arguments; their names follow it."""
NO_VALUE = re.compile(r"argument (\S+): expected (?:one|at least one) argument")
"""Argparse's message on an option without its value."""


class _Parser(argparse.ArgumentParser):
    """A parser that reports wrong usage in one sentence, like all of padgen's refusals."""

    def error(self, message: str) -> NoReturn:
        missing = message.removeprefix(MISSING)
        if missing != message:
            meant = [action.help for action in self._actions if action.metavar == missing and action.help]
            message = f"{missing} {'are' if ',' in missing else 'is'} missing{f': {meant[0]}' if meant else ''}"
        elif no_value := NO_VALUE.fullmatch(message):
            option = no_value[1]
            action = next(action for action in self._actions if option.split("/")[0] in action.option_strings)
            message = f"{option} needs a value, {action.metavar}: {(action.help or '').replace('%%', '%')}"
        raise PadgenError(f"{message}; {self.prog} --help tells more", self.prog)


class _Completion(argparse.Action):
    """Print a script that completes all commands and options in a shell, and exit."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: Any, values: Any, option: str | None = None) -> None:
        try:
            import shtab
        except ImportError as error:
            raise EngineMissingError("needs shtab: pip install 'padgen[completion]'", "--print-completion") from error
        if values not in shtab.SUPPORTED_SHELLS:
            raise PadgenError(f"must be {', '.join(shtab.SUPPORTED_SHELLS)}, got {values!r}", "--print-completion")
        completes = {"DIR": shtab.DIRECTORY, **dict.fromkeys(("SPEC", "FILE", "MESH", "MEASURED", "SWEEP"), shtab.FILE)}
        every = next(action.choices for action in parser._actions if isinstance(action.choices, dict))
        for action in (action for command in every.values() for action in command._actions):
            if action.metavar in completes:
                action.complete = completes[action.metavar]
        print(shtab.complete(parser, values), end="")
        parser.exit()


def _parser(asked: list[str]) -> argparse.ArgumentParser:
    parser = _Parser(
        prog="padgen", description="Vibrotactile pads with more taxels than coils, from a spec to a pad that prints."
    )
    parser.add_argument("--version", action="version", version=f"padgen {__version__}")
    parser.add_argument(
        "--print-completion",
        action=_Completion,
        metavar="SHELL",
        help="print what completes padgen's commands and options in bash, zsh, fish or tcsh (needs padgen[completion])",
    )
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    # To start quickly, only the options of the command that is run are declared.
    for declare in dict.fromkeys(COMMANDS[name] for name in (asked if asked and asked[0] in COMMANDS else COMMANDS)):
        declare(commands)
    return parser
