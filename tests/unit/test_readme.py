"""The examples of the README run unchanged."""

import re
import tomllib
from math import cos, sin
from pathlib import Path

import numpy as np
import pytest

from consilience import engine
from consilience.case.file.reader import load_file

ENGINES = ("dart", "exudyn", "mujoco", "pinocchio")
README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


@pytest.mark.slow
def test_the_python_example_draws_moves_and_compares(tmp_path, monkeypatch, capsys):
    """Twelve lines at most; the motion conserves energy, its plot is written, all engines mean the same model."""
    (code,) = blocks("python")
    assert len([line for line in code.splitlines() if line.strip()]) <= 12
    monkeypatch.chdir(tmp_path)
    # engines of other tests may have been found by this process
    monkeypatch.setattr(engine, "installed", lambda: dict.fromkeys(ENGINES))
    names = {}
    exec(compile(code, "README.md", "exec"), names)
    energy = names["motion"].energy()
    assert np.ptp(energy["total"]) < 1e-9 * np.max(energy["kinetic"])
    assert (tmp_path / "motion.svg").read_text().count("<svg") == 1
    heading, _, row, *_ = capsys.readouterr().out.splitlines()
    assert heading.split() == ["case", *ENGINES]
    assert "≠" not in row
    assert "!" not in row


def test_the_case_example_loads(tmp_path):
    (text,) = blocks("toml")
    path = tmp_path / "pendulum.toml"
    path.write_text(text)
    (case,) = load_file(path)
    assert case.mechanism.bodies[0].mass == tomllib.loads(text)["body"][0]["mass"]
    assert case.initial_state.quat_WB[0] == pytest.approx([cos(0.25), 0, sin(0.25), 0], abs=1e-15)
