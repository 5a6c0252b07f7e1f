"""The ``padgen`` command: the only place that prints and sets exit codes.

Exit codes: 0 done and every check holds; 1 done, but a check fails; 2 bad input or usage. One module a
command, each with ``add`` (its options) and a function that runs it.
"""

import argparse
import io
import json
import os
import sys
import warnings
from contextlib import suppress
from typing import Any, NoReturn

from padgen import __version__
from padgen.cli import build, cache, calibrate, drive, plan, play, retune, small, study, sweep
from padgen.cli.common import BAD_INPUT, DONE
from padgen.core.errors import LONGEST, EngineMissingError, PadgenError, plain

__all__ = ["main", "run"]

DEBUG = "PADGEN_DEBUG"
"""The variable that lets warnings and tracebacks through."""
COMMANDS = (plan, build, drive, play, retune, calibrate, study, sweep, cache, small)


def main() -> NoReturn:
    """Entry point of the console script."""
    # Thousands of 6 x 6 matrices gain nothing from threads, and wait for them under load.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if DEBUG not in os.environ and not sys.warnoptions:
        # Those of libraries are for who writes programs; what they warn of is judged, and said in a sentence.
        warnings.simplefilter("ignore")
        os.environ["PYTHONWARNINGS"] = "ignore"  # of processes that are started
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed, as some that start programs leave them
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
    # The CAD kernel takes up to half a second to take itself apart, for nothing.
    os._exit(code)


def run(arguments: list[str]) -> int:
    """Run one command and return its exit code."""
    as_json = "--json" in arguments
    try:
        options = _parsed(arguments)
        code: int = options.command(options)
        return code
    except SystemExit:  # --help and --version
        return DONE
    except PadgenError as error:
        return _refused(str(error).removeprefix("padgen: "), error.code, as_json)
    except KeyboardInterrupt:
        return _refused("interrupted; files are as they were", "interrupted", as_json)
    except BrokenPipeError:
        # So that the flush at exit does not meet the closed pipe again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BAD_INPUT
    except OSError as error:
        return _refused(f"cannot be written ({error.strerror or error})", "file", as_json)
    except MemoryError:
        asked = " ".join(arguments[:1])
        return _refused(
            f"the machine has not enough memory for this padgen {asked}; files are as they were", "memory", as_json
        )
    except Exception as error:
        if DEBUG in os.environ:
            raise
        told = f"{type(error).__name__}: {error}"
        return _refused(
            f"internal error ({told}); please report it with the command and its files ({DEBUG}=1 shows where it is)",
            "internal",
            as_json,
        )


def _refused(sentence: str, code: str, as_json: bool) -> int:
    sentence = plain(sentence, LONGEST)
    if as_json:
        with suppress(OSError):
            print(json.dumps({"error": {"code": code, "message": sentence}}, ensure_ascii=False), flush=True)
            return BAD_INPUT
    print(f"padgen: {sentence}", file=sys.stderr)
    return BAD_INPUT


def _parsed(arguments: list[str]) -> argparse.Namespace:
    """The options; argparse loses an optional positional that comes after an option."""
    parser = _parser(arguments[:1])
    options, rest = parser.parse_known_args(arguments)
    name = getattr(options, "late", None)
    if name and getattr(options, name) is None and len(rest) == 1 and not rest[0].startswith("-"):
        setattr(options, name, rest.pop())
    if rest:
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    return options


class _Parser(argparse.ArgumentParser):
    """Says what is wrong with the usage in one sentence, as all of padgen does."""

    def error(self, message: str) -> NoReturn:
        raise PadgenError(f"{message}; {self.prog} --help tells more", self.prog)


class _Completion(argparse.Action):
    """Print a shell's completion of all commands and options, and end."""

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
    # The options of the others need not be known to run one command.
    own = [module for module in COMMANDS if asked == [module.__name__.rpartition(".")[2]]]
    for module in own or COMMANDS:
        module.add(commands)
    return parser
