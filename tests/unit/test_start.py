"""Start of the command line without numerical libraries; `simulate` with the reference in the same process."""

import json
import subprocess
import sys

import numpy as np
import pytest

from consilience.case import load_case
from consilience.suite import simulate_case

HEAVY = {"numpy", "scipy", "numba", "plotly"}

UNUSED = {"jinja2", "plotly", "consilience.report.record", "scipy.integrate", "consilience.reference.contact"}
UNUSED |= {"consilience.case.families", "consilience.reference.formulations.descriptor"}
UNUSED |= {"consilience.reference.states.instants"}
"""Not needed by a motion without contact, and slow to import."""


def run(code, cwd):
    return subprocess.run(
        [sys.executable, "-c", code], cwd=cwd, capture_output=True, text=True, check=True, timeout=300
    )


@pytest.mark.parametrize(
    ("arguments", "heavy"),
    [([], HEAVY | {"email"}), (["--help"], HEAVY | {"email", "rich"}), (["simulate", "--help"], HEAVY)],
    ids=["import", "help", "simulate help"],
)
def test_the_command_line_starts_without_numpy(arguments, heavy, tmp_path):
    call = f"sys.argv[1:] = {arguments}\ntry:\n    main()\nexcept SystemExit:\n    pass" if arguments else ""
    code = f"import sys\nfrom consilience.cli.main import main\n{call}\nprint('loaded', {heavy} & set(sys.modules))"
    assert run(code, tmp_path).stdout.splitlines()[-1] == "loaded set()"


@pytest.mark.parametrize(
    ("name", "case"), [("double-pendulum", "double_pendulum"), ("n-four-bar-one-short", "n_four_bar_one-short")]
)
def test_hyphens_and_underscores_of_a_name_are_the_same(name, case):
    assert load_case(name).name == case


def test_simulate_needs_a_case_alone_and_starts_no_process(tmp_path):
    code = (
        "import os, sys\nbefore = os.getpid()\nfrom consilience.cli.main import main\n"
        "import multiprocessing.process as processes\n"
        "def refuse(self): raise SystemExit('a process was started')\n"
        "processes.BaseProcess.start = refuse\n"
        "sys.argv[1:] = ['simulate', 'double-pendulum', '--duration', '0.1']\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        f"print('loaded', {UNUSED} & set(sys.modules))"
    )
    assert run(code, tmp_path).stdout.splitlines()[-1] == "loaded set()"
    motion = json.loads((tmp_path / "double_pendulum.json").read_text())
    case = load_case("double_pendulum").with_span(0.1, None)
    answer, how = simulate_case(case, "reference", 60.0)
    assert how.startswith("relative")
    np.testing.assert_array_equal(motion["time"], answer.time)
