"""The program, called in the process of the tests, and a valid case file."""

import io
import sys
from contextlib import redirect_stderr, redirect_stdout
from types import SimpleNamespace as Namespace

import pytest

from consilience.cli import terminal
from consilience.cli.main import main

GOOD = """
title = "Pendulum"
sources = ["closed form"]
gravity = [0.0, 0.0, -9.81]
[trajectory]
duration = 0.2
[instant]
states = 3
[[body]]
name = "bob"
mass = 2.0
inertia = { xx = 0.11, yy = 0.12, zz = 0.02 }
at = [0.0, 0.0, 0.0]
com = [0.0, 0.0, -0.4]
[[joint]]
name = "pin"
kind = "revolute"
predecessor = "ground"
successor = "bob"
at = [0.0, 0.0, 0.0]
axis = [0.0, 1.0, 0.0]
[initial.joints.pin]
angle = 0.5
"""


class TerminalText(io.StringIO):
    """Text that a terminal shows."""

    def isatty(self):
        return True


def called(*arguments, cwd, columns=200, to_terminal=False):
    """Call the program in this process: one of its own would spend nearly all its time on imports."""
    told, complaints = (TerminalText() if to_terminal else io.StringIO() for _ in range(2))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(cwd)
        patch.setattr(sys, "argv", ["consilience", *arguments])
        patch.setenv("COLUMNS", str(columns))
        patch.setenv("NO_COLOR", "1")
        for console in (terminal.out, terminal.err):
            patch.setattr(console, "width", columns)
            patch.setattr(console, "_force_terminal", to_terminal or None)
        with redirect_stdout(told), redirect_stderr(complaints), pytest.raises(SystemExit) as ended:
            main()
    return Namespace(returncode=ended.value.code or 0, stdout=told.getvalue(), stderr=complaints.getvalue())
