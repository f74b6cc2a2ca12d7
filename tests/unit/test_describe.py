"""The page of a case names everything that acts on its mechanism."""

import dataclasses

import pytest

from consilience.assembly import Initial
from consilience.case import Case
from consilience.errors import InvalidInput
from consilience.mechanism import Rolling, Skate
from consilience.report.summary import describe_case
from mechanisms import ELEMENTS

GROUPS = (
    "joints",
    "springs",
    "joint_springs",
    "loads",
    "frictions",
    "controls",
    "drives",
    "couplings",
    "rollings",
    "skates",
)


@pytest.mark.parametrize("name", ELEMENTS)
def test_every_joint_and_element_has_a_line(name):
    mechanism = ELEMENTS[name]
    text = describe_case(
        Case(name, f"{name}.toml", "title", mechanism, Initial(), 1.0, 0.1, 8, 2, 1, ("here",), "", ())
    )
    for group in GROUPS:
        for element in getattr(mechanism, group):
            assert any(f" {element.name}: " in line for line in text.splitlines()), element.name


@pytest.mark.parametrize("element", [Rolling("r", "ground", [0, 0, 0], [1, 0, 0], 1.0, [0, 0, 0], [0, 0, 1])])
def test_the_ground_does_not_roll(element):
    with pytest.raises(InvalidInput, match=r"rolling 'r': body: the ground does not move"):
        dataclasses.replace(ELEMENTS["skating"], rollings=(element,))


def test_the_ground_does_not_skate():
    with pytest.raises(InvalidInput, match=r"skate 's': body: the ground does not move"):
        dataclasses.replace(ELEMENTS["skating"], skates=(Skate("s", "ground", [0, 0, 0], [1, 0, 0]),))
