"""Options of commands have the help and default of a public function's parameter; the few others say why not."""

import argparse
import inspect

import pytest

import padgen as pg
from padgen.cli import COMMANDS, _parser
from padgen.cli.common import add_option

OF_THE_COMMAND_LINE = {
    "--help": "is argparse's",
    "--json": "is how the answer is printed",
    "--verbose": "is how the answer is printed",
    "--output": "has a default by the spec's name",
    "--model": "is a field of the spec",
    "--tolerance": "goes with --model",
    "--cache": "is set before all else",
    "--explain": "calls a function of its own",
    "--yield": "calls a function of its own",
    "--extreme": "calls a function of its own",
    "--excite": "calls a function of its own",
    "--time-limit": "of padgen study ends the process as Ctrl-C does",
    "--no-browser": "is of a terminal",
    "--gcode": "takes the place of the mesh",
    "--spec": "is a check's other file",
    "--port": "of padgen play chooses between two functions",
    "--audio": "chooses between two functions",
    "--jobs": "is called workers in Python",
    "--coils": "is of the loop at a bench",
    "--tries": "is of the loop at a bench",
    "--formats": "is of what a pad or drive saves",
    "--instances": "is of what a pad saves",
    "--report": "is of what a pad saves",
    "--force": "is of what a pad saves",
    "--depth": "is of what a drive saves",
    "--hear": "is of what a drive saves",
    "--gap": "is of what a drive saves",
}
"""Why an option has no parameter that it is of."""


def options_of(command):
    parser = _parser([command])
    commands = next(action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    pending = [commands.choices[command]]
    while pending:
        for action in pending.pop()._actions:
            if isinstance(action, argparse._SubParsersAction):
                pending += action.choices.values()
            elif action.option_strings:
                yield action


@pytest.mark.parametrize("command", COMMANDS)
def test_options_are_parameters(command):
    for action in options_of(command):
        name = action.option_strings[-1] if action.option_strings[-1].startswith("--") else action.option_strings[0]
        parameter = getattr(action, "parameter", None)
        if parameter is None:
            assert action.option_strings[-1] in OF_THE_COMMAND_LINE or name in OF_THE_COMMAND_LINE, f"{command} {name}"
            continue
        function, _, argument = parameter.partition(".")
        default = inspect.signature(getattr(pg, function)).parameters[argument].default
        assert action.default == (None if default is inspect.Parameter.empty else default), f"{command} {name}"
        assert action.help.removesuffix(".")[:1], f"{command} {name}"


def test_an_option_has_its_parameters_help_and_default():
    def shown(levels, frame_s=0.5, loop=False):
        """Show levels.

        Parameters
        ----------
        levels : array
            Levels in 0 … 1.
        frame_s, other : float
            Duration of a frame,
            in s.
        loop : bool
            LEDs repeat 100 % of it.
        """

    parser = argparse.ArgumentParser()
    add_option(parser, shown, "frame_s", "--seconds", type=float)
    add_option(parser, shown, "loop")
    seconds, loop = parser._actions[1:]
    assert (seconds.help, seconds.default) == ("duration of a frame, in s (default: 0.5)", 0.5)
    assert (loop.help, loop.default, loop.nargs) == ("LEDs repeat 100 %% of it", False, 0)
    with pytest.raises(AssertionError, match="does not say what frames is"):
        add_option(parser, lambda frames=1: None, "frames")
