"""What a case file means, and what a reader is told who wrote one wrong: file, field, what is wrong, what is right."""

import numpy as np
import pytest

from consilience.casefile import load_file
from consilience.caseschema import case_schema
from consilience.errors import CannotAssemble, InvalidInput
from consilience.library import load_case, load_cases, shipped_cases

GOOD = """
title = "Door"
sources = ["test"]
gravity = [0.0, 0.0, -9.81]

[[body]]
name = "door"
mass = 2.0
at = [1.0, 2.0, 3.0]
orientation = { quaternion = [0.5, 0.5, 0.5, 0.5] }
com = [0.1, 0.2, 0.3]
inertia = { xx = 0.3, yy = 0.4, zz = 0.5, xy = 0.01 }

[[joint]]
name = "hinge"
kind = "revolute"
predecessor = "ground"
successor = "door"
at = [1.0, 0.0, 0.0]
axis = [0.0, 0.0, 2.0]

[initial]
joints = { hinge = { angle = 0.3 } }
rates = { hinge = { angle = -1.0 } }
"""


@pytest.fixture
def write(tmp_path):
    def writer(text):
        path = tmp_path / "door.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return writer


def changed(old, new):
    assert GOOD.count(old) == 1
    return GOOD.replace(old, new)


def test_the_drawing_is_read_in_world_axes(write):
    (case,) = load_file(write(GOOD))
    door, hinge = case.mechanism.bodies[0], case.mechanism.joints[0]
    assert case.name == "door"
    assert np.array_equal(door.drawing.R @ [1, 0, 0], [0, 1, 0])  # (1, 1, 1, 1)/2 turns x into y, y into z
    assert np.array_equal(door.com, [0.1, 0.2, 0.3])
    assert door.inertia[0, 1] == door.inertia[1, 0] == 0.01
    assert np.array_equal(hinge.F.p, [1, 0, 0])
    assert np.array_equal(door.drawing.p + door.drawing.R @ hinge.M.p, hinge.F.p)
    assert np.array_equal(hinge.F.R[:, 2], [0, 0, 1])
    assert np.allclose(door.drawing.R @ hinge.M.R, hinge.F.R, rtol=0, atol=1e-15)


def test_held_coordinates_and_rates_reach_the_state(write):
    (case,) = load_file(write(GOOD))
    assert np.allclose(case.initial_state.w_WB_W, [[0, 0, -1.0]], rtol=0, atol=1e-14)
    turned = [1 - 2 * np.sin(0.3), 2 * np.cos(0.3), 3.0]  # (0, 2) from the hinge, turned by 0.3 rad
    assert np.allclose(case.initial_state.p_WB, [turned], rtol=0, atol=1e-14)


INVALID = {
    "unknown field": (changed("mass = 2.0", "mass = 2.0\ncolour = 3"), ["body 'door'.colour", "unknown field"]),
    "unknown table": (GOOD + "\n[solver]\nstep = 1\n", ["solver", "unknown field"]),
    "malformed TOML": (changed("mass = 2.0", "mass = "), ["not valid TOML", "line 8"]),
    "no body": (GOOD[: GOOD.index("[[body]]")] + GOOD[GOOD.index("[[joint]]") :], ["body", "the field is missing"]),
    "missing mass": (changed("mass = 2.0\n", ""), ["body 'door'.mass", "the field is missing"]),
    "missing gravity": (changed("gravity = [0.0, 0.0, -9.81]\n", ""), ["gravity", "the field is missing"]),
    "missing component": (changed("-9.81]", "]"), ["gravity", "at least 3 items"]),
    "text for a number": (changed("mass = 2.0", 'mass = "heavy"'), ["body 'door'.mass", "valid number", "heavy"]),
    "infinite gravity": (changed("-9.81", "inf"), ["gravity[2]", "finite"]),
    "zero mass": (changed("mass = 2.0", "mass = 0.0"), ["body 'door': mass", "0.0 kg is not positive"]),
    "negative mass": (changed("mass = 2.0", "mass = -2.0"), ["body 'door': mass", "-2.0 kg is not positive"]),
    "impossible inertia": (
        changed("zz = 0.5, xy = 0.01", "zz = 0.8"),
        ["body 'door': inertia", "0.3, 0.4, 0.8", "triangle inequality", "Ixy = -sum m x y"],
    ),
    "flat inertia": (changed("xx = 0.3", "xx = 0.0"), ["body 'door': inertia", "not all positive"]),
    "quaternion of norm 2": (
        changed("[0.5, 0.5, 0.5, 0.5]", "[1, 1, 1, 1]"),
        ["body 'door'.orientation", "norm 2", "scalar first"],
    ),
    "two orientations": (
        changed("quaternion =", "euler_zxz = [0, 0, 0], quaternion ="),
        ["body 'door'.orientation", "2 ways given"],
    ),
    "points on a line": (
        changed("quaternion = [0.5, 0.5, 0.5, 0.5]", "three_points = [[0, 0, 0], [1, 1, 1], [2, 2, 2]]"),
        ["body 'door': orientation.three_points", "one line"],
    ),
    "body without a joint": (
        changed(
            "[[joint]]", GOOD[GOOD.index("[[body]]") : GOOD.index("[[joint]]")].replace("door", "spare") + "[[joint]]"
        ),
        ["body 'spare'", "no chain of joints connects it to the ground", "kind = 'free'"],
    ),
    "unknown body": (changed('successor = "door"', 'successor = "gate"'), ["joint 'hinge'", "no body 'gate'", "door"]),
    "joint on itself": (changed('"ground"', '"door"'), ["joint 'hinge'", "both sides are 'door'"]),
    "unknown kind": (changed('"revolute"', '"hinged"'), ["joint 'hinge'.kind", "'revolute'", "hinged"]),
    "missing axis": (changed("axis = [0.0, 0.0, 2.0]\n", ""), ["joint 'hinge': axis", "missing", "revolute"]),
    "zero axis": (changed("[0.0, 0.0, 2.0]", "[0, 0, 0]"), ["joint 'hinge': axis", "zero vector"]),
    "parallel second axis": (
        changed("axis = [0.0, 0.0, 2.0]", "axis = [0, 0, 2]\nsecond_axis = [0, 0, 1]"),
        ["joint 'hinge': axis", "parallel"],
    ),
    "end without a rod": (changed("at = [1.0, 0.0, 0.0]", "at = [1, 0, 0]\nto = [2, 0, 0]"), ["joint 'hinge': to"]),
    "universal without its cross": (changed('"revolute"', '"universal"'), ["joint 'hinge': second_axis", "missing"]),
    "rod with an axis": (
        changed('"revolute"', '"rod"').replace("at = [1.0, 0.0", "to = [0, 0, 1]\nat = [1.0, 0.0"),
        ["joint 'hinge': axis", "a rod has none"],
    ),
    "duplicate body": (
        changed("[[joint]]", GOOD[GOOD.index("[[body]]") : GOOD.index("[[joint]]")] + "[[joint]]"),
        ["body 'door'", "the name is used twice"],
    ),
    "body called ground": (
        changed(
            "[[joint]]", GOOD[GOOD.index("[[body]]") : GOOD.index("[[joint]]")].replace("door", "ground") + "[[joint]]"
        ),
        ["body 'ground'", "used twice"],
    ),
    "sample does not divide": (GOOD + "\n[trajectory]\nduration = 1.0\nsample = 0.3\n", ["trajectory", "divide"]),
    "rate of an orientation": (
        changed("hinge = { angle = 0.3 }", "hinge = { angular_velocity = [0, 0, 1] }"),
        ["initial.joints.hinge.angular_velocity", "Use orientation"],
    ),
}


@pytest.mark.parametrize("name", INVALID)
def test_bad_input_names_file_and_field(write, name):
    text, parts = INVALID[name]
    with pytest.raises(InvalidInput) as caught:
        load_file(write(text))
    message = str(caught.value)
    assert "door.toml: " in message
    for part in parts:
        assert part in message
    assert caught.value.remedy


def test_several_problems_are_counted(write):
    text = changed("mass = 2.0", 'mass = "heavy"').replace("title", "titel")
    with pytest.raises(InvalidInput, match=r"2 more problems in this file"):
        load_file(write(text))


def test_not_text(tmp_path):
    path = tmp_path / "door.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InvalidInput, match=r"door\.toml: it is not UTF-8 text"):
        load_file(path)


def test_no_file(tmp_path):
    with pytest.raises(InvalidInput, match=r"absent\.toml: it cannot be read"):
        load_file(tmp_path / "absent.toml")


STRUT = """
[[body]]
name = "strut"
mass = 1.0
at = [1.0, 2.0, 3.0]
inertia = { xx = 1.0, yy = 1.0, zz = 1.0 }

[[joint]]
name = "elbow"
kind = "revolute"
predecessor = "door"
successor = "strut"
at = [1.0, 2.0, 0.0]
axis = [0.0, 0.0, 1.0]

[[joint]]
name = "foot"
kind = "revolute"
predecessor = "ground"
successor = "strut"
at = [1.0, 3.0, 0.0]
axis = [0.0, 0.0, 1.0]
"""


def test_what_cannot_be_assembled_names_the_constraint_and_how_far(write):
    # a door of 2 m and a strut of 1 m span the 3 m between their feet only when they are in line
    text = changed("\n[initial]", STRUT + "\n[initial]")
    (case,) = load_file(write(text))
    with pytest.raises(CannotAssemble) as caught:
        _ = case.initial_state
    assert "mechanism 'door': joint '" in caught.value.where
    assert ", constraint " in caught.value.where or ", held angle" in caught.value.where
    how_far = float(caught.value.what.split(" by ")[1].split()[0])
    assert 0.01 < how_far < 1.0


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("joints = { hinge", "joints = { latch", ["initial.joints", "no joint 'latch'", "hinge"]),
        ("rates = { hinge", "rates = { latch", ["initial.rates", "no joint 'latch'", "hinge"]),
        ("{ angle = 0.3 }", "{ distance = 0.3 }", ["joint 'hinge'", "no 'distance'", "angle"]),
        ("[initial]", "[initial.bodies.gate]\n[initial]", ["initial.bodies", "no body 'gate'", "door"]),
    ],
)
def test_initial_conditions_of_what_is_not_there(write, old, new, parts):
    (case,) = load_file(write(changed(old, new)))
    with pytest.raises(InvalidInput) as caught:
        _ = case.initial_state
    for part in parts:
        assert part in str(caught.value)


def test_rates_that_contradict_the_joints(write):
    # hinge, elbow and foot make a triangle of two bodies and the ground, which cannot move
    text = changed("\n[initial]", STRUT.replace("[1.0, 3.0, 0.0]", "[2.5, 2.5, 0.0]") + "\n[initial]")
    (case,) = load_file(write(text.replace("joints = { hinge = { angle = 0.3 } }\n", "")))
    with pytest.raises(
        CannotAssemble, match=r"mechanism 'door': joint 'hinge', .* its rate stays wrong by .* contradict"
    ):
        _ = case.initial_state


def test_variants_stand_for_the_file(write):
    variant = '\n[variants.fast]\ntitle = "Fast door"\ninitial = { rates = { hinge = { angle = 7.0 } } }\n'
    slow, fast = load_file(write(GOOD + '\n[variants.slow]\ntitle = "Slow door"\n' + variant))
    assert (slow.name, fast.name) == ("door-slow", "door-fast")
    assert slow.initial_state.w_WB_W[0, 2] == pytest.approx(-1.0)
    assert fast.initial_state.w_WB_W[0, 2] == pytest.approx(7.0)
    assert fast.initial.coordinates == {}  # a variant's initial table replaces the file's as a whole


def test_library_by_name():
    assert [case.name for case in load_cases("simple_pendulum")] == ["simple_pendulum-small", "simple_pendulum-large"]
    assert load_case("simple_pendulum-large").title.endswith("(A01)")
    with pytest.raises(InvalidInput, match="Name one: simple_pendulum-small"):
        load_case("simple_pendulum")
    with pytest.raises(InvalidInput, match=r"no shipped case of that name.*four_bar"):
        load_case("five_bar")


@pytest.mark.parametrize("case", shipped_cases(), ids=lambda case: case.name)
def test_shipped_cases_assemble_and_say_what_they_are(case):
    from consilience.kinematics import constraint_jacobian, constraint_residual

    state = case.initial_state
    assert np.max(np.abs(constraint_residual(case.mechanism, state))) < 1e-14
    rates = constraint_jacobian(case.mechanism, state) @ np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
    assert np.max(np.abs(rates)) < 1e-14 * max(1.0, np.max(np.abs(state.w_WB_W)))
    assert len(case.states) == 20
    assert case.sources
    assert "What we chose" in case.remarks
    assert case.tags


def test_schema_names_every_table():
    schema = case_schema()
    assert set(schema["properties"]) >= {"title", "body", "joint", "spring", "initial", "trajectory", "variants"}
    assert schema["additionalProperties"] is False
