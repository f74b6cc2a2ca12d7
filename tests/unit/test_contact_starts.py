"""Starts and states of contacts that cannot be used: each is refused by name, those of a file with the line."""

from dataclasses import replace

import numpy as np
import pytest

import consilience as cs
from consilience.case.file.reader import load_file
from consilience.errors import InvalidInput
from contact_problems import BALL, LEVEL, Lab

FILE = """title = "A ball and a slide"
sources = ["own"]
gravity = [0.0, 0.0, -9.81]
body = [
  { name = "ball", mass = 2.0, at = [0.0, 0.0, 0.1], inertia = { xx = 0.01, yy = 0.01, zz = 0.01 } },
  { name = "arm", mass = 1.0, at = [0.0, 0.0, 1.0], inertia = { xx = 0.01, yy = 0.01, zz = 0.01 } },
]

[[joint]]
name = "flight"
kind = "free"
predecessor = "ground"
successor = "ball"
at = [0.0, 0.0, 0.1]

[[joint]]
name = "slide"
kind = "prismatic"
predecessor = "ground"
successor = "arm"
at = [0.0, 0.0, 1.0]
axis = [1.0, 0.0, 0.0]

[[contact]]
name = "floor"
body = "ball"
at = [0.0, 0.0, 0.1]
radius = 0.1
point = [0.0, 0.0, 0.0]
normal = [0.0, 0.0, 1.0]

[[stop]]
name = "end"
joint = "slide"
coordinate = "distance"
lower = -0.1
"""


@pytest.mark.parametrize(
    ("given", "instead", "table", "told"),
    [
        ("point = [0.0, 0.0, 0.0]", "point = [0.0, 0.0, 0.05]", "[[contact]]", "contact 'floor': ball and ground over"),
        (
            "radius = 0.1",
            "radius = 0.1\naxis = [0.0, 0.0, 2.0]",
            "[[contact]]",
            "contact 'floor': the disc is parallel",
        ),
        ("lower = -0.1", "lower = 0.1", "[[stop]]", "stop 'end': distance 0 of 'slide' is beyond the limit 0.1 by 0.1"),
    ],
)
def test_a_start_that_contacts_forbid_is_refused_with_the_line_of_the_file(tmp_path, given, instead, table, told):
    path = tmp_path / "start.toml"
    path.write_text(FILE)
    assert not load_file(path)[0].unassembled
    path.write_text(FILE.replace(given, instead))
    line = FILE.split("\n").index(table) + 1
    assert load_file(path)[0].unassembled.startswith(f"start.toml:{line}: {told}")


def test_accelerations_with_contacts_refuse_a_state_that_is_not_consistent(tmp_path):
    """As motions do: off a joint, with a rate that the joint forbids, and where shapes overlap by 1 mm."""
    path = tmp_path / "start.toml"
    path.write_text(FILE)
    case = load_file(path)[0]
    start, across = case.initial_state, np.array([[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]])
    assert cs.accelerations(case.mechanism, start).contact_force[0, 0, 2] == pytest.approx(2.0 * 9.81)
    for state in (replace(start, p_WB=start.p_WB + across), replace(start, v_WB_W=start.v_WB_W + across)):
        with pytest.raises(InvalidInput, match=r"state of mechanism 'start': at t = 0 s joint 'slide', constraint"):
            cs.accelerations(case.mechanism, state)
    lab = Lab()
    sunk = lab.free_body(2.0, BALL, LEVEL, [lab.sphere(0.1)])
    with pytest.raises(InvalidInput, match=r"contact 'ball': 'body' and 'ground' overlap by 0\.001 m\. Give"):
        cs.accelerations(sunk, lab.state((0.0, 0.0, 0.099), (0.0, 0.0, 0.0)))
