"""The examples of the README run unchanged."""

import re
import tomllib
from math import cos, sin
from pathlib import Path

import pytest

from consilience.case.file.reader import load_file

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_the_python_example_runs():
    (code,) = blocks("python")
    assert code.count("assert") >= 3
    exec(compile(code, "README.md", "exec"), {})


def test_the_case_example_loads(tmp_path):
    (text,) = blocks("toml")
    path = tmp_path / "pendulum.toml"
    path.write_text(text)
    (case,) = load_file(path)
    assert case.mechanism.bodies[0].mass == tomllib.loads(text)["body"][0]["mass"]
    assert case.initial_state.quat_WB[0] == pytest.approx([cos(0.25), 0, sin(0.25), 0], abs=1e-15)
