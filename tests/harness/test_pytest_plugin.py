"""The pytest plug-in on engines that are right, wrong, dead, unable or missing, and on a real engine."""

import os
import shlex
import sys
from pathlib import Path

import pytest

import consilience.pytest_plugin.items
import consilience.reference.engine  # noqa: F401

pytest_plugins = "pytester"
pytestmark = pytest.mark.usefixtures("answers_kept")

PLUGINS = Path(__file__).parent / "plugins"

# the miniature engines show their faults on a case called `first`
CASE = """
title = "Lumpy pendulum"
sources = ["test"]
tags = ["tree", "two words"]
gravity = [0.0, 0.0, -9.81]
[trajectory]
duration = 0.1
digits = 8
[instant]
states = 2
[[body]]
name = "bob"
mass = 2.0
inertia = { xx = 0.11, yy = 0.12, zz = 0.05, xy = 0.01, xz = -0.02, yz = 0.005 }
at = [0.0, 0.0, 0.0]
com = [0.1, 0.05, -0.4]
[[joint]]
name = "pin"
kind = "revolute"
predecessor = "ground"
successor = "bob"
at = [0.1, 0.0, 0.0]
axis = [0.2, 1.0, 0.1]
[initial.joints.pin]
angle = 0.5
"""
VARIANTS = CASE.replace("[initial.joints.pin]\nangle = 0.5\n", "") + "".join(
    f'[variants.{name}]\ntitle = "{name}"\n[variants.{name}.initial.joints.pin]\nangle = {angle}\n'
    for name, angle in (("small", 0.1), ("large", 1.5))
)
WEIGHTLESS = """
[[known]]
case = "f*"
engine = "weightless_body"
question = "instant"
reason = "the first body floats"
"""


@pytest.fixture
def project(pytester, monkeypatch):
    """A project folder with a case, in which the miniature engines are installed."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(PLUGINS), *sys.path[1:]]))
    # Hypothesis, used by tests of this process before, would warn that it was used before a run within a test began
    monkeypatch.setenv("PYTEST_ADDOPTS", "-p no:hypothesispytest")
    folder = pytester.path / "cases" / "mine"
    folder.mkdir(parents=True)
    (folder / "first.toml").write_text(CASE)
    pytester.makepyprojecttoml("[project]\nname = 'an-engine'\nversion = '1'\n[tool.pytest.ini_options]\n")
    return pytester


def ask(project, *arguments, engines=("honest",)):
    """Run pytest in this process: a new process would spend more time on imports than on the test."""
    chosen = [part for name in engines for part in ("--consilience-engine", name)]
    return project.runpytest_inprocess(*chosen, "--consilience-effort", "quick", "-rA", *arguments)


def test_without_the_option_nothing_is_collected_and_nothing_imported(project):
    program = (
        "import sys, pytest; code = pytest.main(['--collect-only', 'cases']); "
        "assert 'consilience.pytest_plugin' in sys.modules; "
        "assert not {'numpy', 'numba', 'pydantic', 'consilience.case'} & set(sys.modules); sys.exit(code)"
    )
    done = project.run(sys.executable, "-c", program)
    assert done.ret == pytest.ExitCode.NO_TESTS_COLLECTED
    done.stdout.fnmatch_lines(["*no tests collected*"])


def test_cases_and_variants_are_collected_and_other_toml_files_are_not(project):
    (project.path / "cases" / "several.toml").write_text(VARIANTS)
    (project.path / "cases" / "settings.toml").write_text("[joint]\nx = 1\n")
    result = ask(project, "--collect-only", "-q", ".", engines=("honest", "reference:lagrange"))
    nodes = [line for line in result.outlines if "::" in line]
    assert len(nodes) == 3 * 2 * 3
    assert "cases/several.toml::several-large[reference:lagrange-trajectory]" in nodes
    assert "cases/mine/first.toml::first[honest-model]" in nodes
    assert not any("settings" in node or "pyproject" in node for node in nodes)


CHOICES = {
    ("-k", "instant"): 3,
    ("-k", "several and not model"): 4,
    ("-k", "mine"): 3,
    ("-m", "consilience(question='trajectory')"): 3,
    ("-m", "consilience(group='mine') and consilience(tag='two words')"): 3,
    ("-m", "consilience(engine='honest') and not consilience(group='mine')"): 6,
    ("-m", "consilience(case='several-large')"): 3,
    ("-m", "consilience(tag='loop')"): 0,
}


def test_names_groups_and_tags_choose(project):
    (project.path / "cases" / "several.toml").write_text(VARIANTS)
    for choice, count in CHOICES.items():
        result = ask(project, "--collect-only", "-q", "--strict-markers", ".", *choice)
        assert len([line for line in result.outlines if "::" in line]) == count, choice


def test_right_wrong_dead_unable_and_missing_engines(project):
    engines = ("honest", "weightless_body", "aborts", "selective", "cannot_start")
    result = ask(project, "cases", "--junitxml", "junit.xml", engines=engines)
    result.assert_outcomes(passed=9, failed=5, skipped=1)
    result.stdout.fnmatch_lines(
        [
            "consilience: honest, weightless_body, aborts, selective, cannot_start, effort quick",
            "first, instant: weightless_body 1.0: differs: model",
            "  method   descriptor (native): differs: model",
            "  numbers  accelerations: difference *, bar 1e-11: MISSED",
            "  numbers  kinetic energy: difference *: met",
            "  why      accelerations: difference *, above the bar 1e-11",
            "  cause    Other accelerations, *",
            "  report   consilience run cases/mine/first.toml -e weightless_body --quick",
            "first, instant: aborts 1.0: failed",
            "  why      the worker died: signal SIGABRT*",
            "  printed  *corrupted double-linked list*",
            "  again    pytest --consilience-engine aborts --consilience-effort quick 'cases/mine/*aborts-instant]'",
            "engine 'cannot_start' does not start: OSError: no licence server",
            "first, trajectory: honest 1.0: agrees",
            "SKIPPED*: first[[]selective-instant]: unsupported: joint 'j1': this engine knows no spherical joints",
        ]
    )
    failed = {line.split()[1] for line in result.outlines if line.startswith("FAILED")}
    assert {f"cases/mine/first.toml::first[{name}-instant]" for name in ("weightless_body", "aborts")} <= failed
    assert "Traceback" not in result.stdout.str()
    build = (project.path / "junit.xml").read_text()
    assert '<property name="verdict" value="agrees"' in build
    assert '<property name="digits" value="' in build


def test_the_command_of_a_failure_fails_alone_and_alike(project):
    """Only the trajectory is selected, and it is still judged with the model answer of the engine."""
    result = ask(project, "cases", "-k", "trajectory", engines=("centre_of_mass_lost",))
    result.stdout.fnmatch_lines(["  cause    The accelerations are already others, before anything is integrated."])
    (again,) = {line.split("again", 1)[1].strip() for line in result.outlines if line.startswith("  again ")}
    program, *arguments = shlex.split(again)
    assert program == "pytest"
    second = project.runpytest_inprocess(*arguments)
    second.assert_outcomes(failed=1)
    assert [line for line in result.outlines if "numbers" in line] == [
        line for line in second.outlines if "numbers" in line
    ]


def test_the_first_failure_can_be_the_last(project):
    result = ask(project, "cases", "-x", engines=("weightless_body", "aborts"))
    result.assert_outcomes(passed=1, failed=1)


@pytest.mark.slow
def test_two_processes_find_what_one_finds(project):
    (project.path / "cases" / "several.toml").write_text(VARIANTS)
    arguments = ("-n", "2", "--dist", "loadfile", "--consilience-effort", "quick", "-k", "instant", "cases")
    result = project.runpytest_subprocess("--consilience-engine", "weightless_body", *arguments)
    result.assert_outcomes(failed=3)


KNOWN = {
    "weightless_body": ("", "XFAIL *weightless_body-instant] - the first body floats"),
    "honest": ("", "*XPASS(strict)*the first body floats*"),
    "aborts": ("", "known as 'differs: model' (the first body floats), it is now 'failed': *"),
    "selective": ("", "known as 'differs: model' (the first body floats), it is now 'unsupported': *"),
    "acceleration_point": ('verdict = "failed"', "known as 'failed' (*), it is now 'differs: model': *"),
}
"""By engine: more of the entry, and what is said of it."""


def test_known_differences_are_expected_and_fail_where_they_do_not_hold_any_more(project):
    text = "".join(WEIGHTLESS.replace("weightless_body", name) + more + "\n" for name, (more, _) in KNOWN.items())
    (project.path / "known.toml").write_text(text)
    project.makepyprojecttoml("[tool.pytest.ini_options]\nconsilience_known = ['known.toml']\n")
    result = ask(project, "cases", "-k", "instant", engines=KNOWN)
    result.assert_outcomes(xfailed=1, failed=4)
    for _, said in KNOWN.values():
        result.stdout.fnmatch_lines([said])


def test_a_known_difference_that_names_nothing_is_told(project):
    (project.path / "known.toml").write_text(WEIGHTLESS.replace('"f*"', '"renamed"'))
    result = ask(project, "cases", "--collect-only", "--consilience-known", "known.toml", engines=("weightless_body",))
    told = "consilience: no test collected for the known difference: renamed, weightless_body, instant"
    assert told in result.outlines


BAD_KNOWN = {
    "no file": (None, "known.toml: it cannot be read"),
    "no TOML": ("[[known]", "it is not valid TOML"),
    "no reason": (WEIGHTLESS.replace("reason =", "because ="), "known.0.reason: Field required"),
    "no such question": (WEIGHTLESS.replace('"instant"', '"why"'), "known.0.question: Input should be 'model'"),
    "a verdict that passes": (WEIGHTLESS + 'verdict = "agrees"', "'agrees' passes anyway"),
}


@pytest.mark.parametrize("name", BAD_KNOWN)
def test_a_bad_file_of_known_differences_is_one_message(project, name):
    text, message = BAD_KNOWN[name]
    if text is not None:
        (project.path / "known.toml").write_text(text)
    result = ask(project, "--consilience-known", "known.toml")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert message in result.stderr.str()
    assert "Traceback" not in result.stderr.str()


BAD_OPTIONS = {
    "unknown engine": (("--consilience-engine", "adams"), "engine 'adams': it is not installed. Installed engines: "),
    "digits": (("--consilience-digits", "40"), "40 is not from 1 to 15"),
    "limit": (("--consilience-limit", "0"), "0 s is no time limit"),
    "effort": (("--consilience-effort", "huge"), "invalid choice: 'huge'"),
}


@pytest.mark.parametrize("name", BAD_OPTIONS)
def test_bad_options_are_one_message(project, name):
    arguments, message = BAD_OPTIONS[name]
    result = ask(project, *arguments)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert message in result.stderr.str()


def test_a_spoilt_case_is_one_message_with_the_field(project):
    (project.path / "cases" / "mine" / "first.toml").write_text(CASE.replace("mass = 2.0", "mass = -2.0"))
    (project.path / "note.toml").write_text("x = 1\n")
    result = ask(project, "cases", "note.toml")
    result.assert_outcomes(errors=2)
    result.stdout.fnmatch_lines(
        ["first.toml:13: body 'bob': mass: -2.0 kg is not positive. *", "note.toml: title: the field is missing. *"]
    )
    assert "Traceback" not in result.stdout.str()


def test_a_real_engine_agrees_and_more_digits_can_be_asked(project):
    result = ask(project, "cases", "--consilience-digits", "15", engines=("pinocchio",))
    result.assert_outcomes(passed=2, failed=1)
    result.stdout.fnmatch_lines(
        [
            "first, trajectory: pinocchio *",
            "  numbers  motion: difference *, asked 1e-15, *",
            "*--consilience-digits 15*",
        ]
    )
