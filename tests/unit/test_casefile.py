"""Case files: meaning of every field, and error messages with file, field, fault and remedy."""

import os
import pickle
import time
from pathlib import Path

import numpy as np
import pytest

from consilience.case import case_files, load_case, load_cases, shipped_cases
from consilience.case.file.problems import InvalidCase
from consilience.case.file.reader import load_file
from consilience.case.file.schema import case_schema
from consilience.case.file.writer import case_table
from consilience.errors import CannotAssemble, InvalidInput
from consilience.mechanism import JOINT_KINDS, Body, Frame, Joint, Mechanism, spanning_tree

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
    assert np.array_equal(door.drawing.R @ [1, 0, 0], [0, 1, 0])  # quaternion (1, 1, 1, 1)/2: x to y, y to z
    assert np.array_equal(door.com, [0.1, 0.2, 0.3])
    assert door.inertia[0, 1] == door.inertia[1, 0] == 0.01
    assert np.array_equal(hinge.F.p, [1, 0, 0])
    assert np.array_equal(door.drawing.p + door.drawing.R @ hinge.M.p, hinge.F.p)
    assert np.array_equal(hinge.F.R[:, 2], [0, 0, 1])
    assert np.allclose(door.drawing.R @ hinge.M.R, hinge.F.R, rtol=0, atol=1e-15)


def test_held_coordinates_and_rates_reach_the_state(write):
    (case,) = load_file(write(GOOD))
    assert np.allclose(case.initial_state.w_WB_W, [[0, 0, -1.0]], rtol=0, atol=1e-14)
    turned = [1 - 2 * np.sin(0.3), 2 * np.cos(0.3), 3.0]  # the vector (0, 2) from the hinge, turned by 0.3 rad
    assert np.allclose(case.initial_state.p_WB, [turned], rtol=0, atol=1e-14)


INVALID = {
    "unknown field": (changed("mass = 2.0", "mass = 2.0\ncolour = 3"), ["body 'door'.colour", "unknown field"]),
    "unknown field beside a bad one": (
        GOOD + "\n[trajectory]\nduration = -1.0\nlength = 2.0\n",
        ["trajectory.duration", "1 more problem"],
    ),
    "unknown fields, deep and shallow": (
        changed("angle = -1.0 } }", "angel = -1.0 } }\nrites = 1"),
        ["initial.rates.hinge.angel", "1 more problem"],
    ),
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
    "inertia as a list": (
        changed("inertia = { xx = 0.3, yy = 0.4, zz = 0.5, xy = 0.01 }", "inertia = [0.3, 0.4, 0.5]"),
        ["body 'door'.inertia", "a list is no inertia of a file; give a table, { xx = 0.1"],
    ),
    "impossible inertia": (
        changed("zz = 0.5, xy = 0.01", "zz = 0.8"),
        ["body 'door': inertia", "0.3, 0.4, 0.8", "triangle inequality", "Ixy = -sum m x y"],
    ),
    "flat inertia": (changed("xx = 0.3", "xx = 0.0"), ["body 'door': inertia", "not all positive"]),
    "inertia of a rod without thickness": (
        changed("xx = 0.3, yy = 0.4, zz = 0.5, xy = 0.01", "xx = 1e-18, yy = 0.5, zz = 0.5"),
        ["body 'door': inertia", "1e-18, 0.5, 0.5", "not all positive beyond rounding", "thickness"],
    ),
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


def _nut(kind, pitch="", axis=True):
    """Return the case with a second body on a joint of the given kind, beside the door's hinge."""
    body = GOOD[GOOD.index("[[body]]") : GOOD.index("[[joint]]")].replace("door", "nut")
    drawn = "axis = [0.0, 0.0, 1.0]\n" if axis else ""
    joint = (
        f'[[joint]]\nname = "thread"\nkind = "{kind}"\npredecessor = "ground"\nsuccessor = "nut"\n'
        f"at = [0.1, 0.2, 0.3]\n{drawn}{pitch}\n"
    )
    return changed("\n[initial]", "\n" + body + joint + "\n[initial]")


DRIVE = '[[drive]]\nname = "turn"\njoint = "hinge"\ncoordinate = "angle"\nmotion = { polynomial = [0.0, 1.0] }\n'
COUPLING = (
    '[[coupling]]\nname = "gear"\ndriver_joint = "hinge"\ndriver_coordinate = "angle"\n'
    'joint = "thread"\ncoordinate = "angle"\nratio = -2.0\n'
)
ROLLING = (
    '[[rolling]]\nname = "wheel"\nbody = "door"\nat = [1.1, 2.2, 3.3]\naxis = [0.0, 2.0, 0.0]\nradius = 0.4\n'
    "rounding = 0.1\npoint = [0.0, 0.0, -1.0]\nnormal = [0.0, 0.0, 3.0]\n"
)
SKATE = '[[skate]]\nname = "edge"\nbody = "door"\nat = [1.1, 2.2, 3.3]\nlateral = [0.0, 2.0, 0.0]\n'
FRICTION = '[[friction]]\nname = "rub"\njoint = "hinge"\ncoordinate = "angle"\ncoulomb = 0.3\nspeed = 0.1\n'
CONTROL = (
    '[[control]]\nname = "hold"\njoint = "hinge"\ncoordinate = "angle"\nproportional = 3.0\nintegral = 2.0\n'
    "derivative = 1.0\ntarget = { harmonics = [[0.5, 2.0, 0.1]] }\n"
)
POINTS = "table = { x = [0, 1, 2, 3, 4, 5], y = [0, 1, 0, 1, 0, 1] }"
LINEAR = "polynomial = [0.0, 1.0]"


def _with(text, old="", new="", base=GOOD):
    """Return the case with further tables, in which one piece of text may be replaced."""
    assert not old or text.count(old) == 1
    return base + "\n" + (text.replace(old, new) if old else text)


def _driven_by(function):
    return _with(DRIVE, LINEAR, function)


INVALID |= {
    "pitch on a revolute": (
        changed("axis = [0.0, 0.0, 2.0]", "axis = [0, 0, 2]\npitch = 0.01"),
        ["joint 'hinge': pitch", "a revolute joint has none", "only a screw"],
    ),
    "screw without a pitch": (_nut("screw"), ["joint 'thread': pitch", "missing", "in a turn"]),
    "screw of no pitch": (_nut("screw", "pitch = 0.0"), ["joint 'thread': pitch", "0.0 m"]),
    **{
        f"{kind} without an axis": (_nut(kind, axis=False), ["joint 'thread': axis", "missing", kind])
        for kind in ("point_on_line", "point_in_plane", "parallel_axes")
    },
    "a table that ends before the trajectory": (
        _driven_by("table = { x = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6], y = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6] }"),
        ["drive 'turn': motion", "reaches from 0 to 0.6 s, the trajectory from 0 to", "a longer table"],
    ),
    "empty function": (
        _driven_by(""),
        ["drive 'turn'.motion", "the function is empty", "polynomial, harmonics, table"],
    ),
    "polynomial without coefficients": (
        _driven_by("polynomial = []"),
        ["drive 'turn'.motion.polynomial", "at least 1 item"],
    ),
    "harmonic of two numbers": (
        _driven_by("harmonics = [[1.0, 2.0]]"),
        ["drive 'turn'.motion.harmonics[0]", "at least 3 items"],
    ),
    "unknown part of a function": (_driven_by("sine = [1, 2, 3]"), ["drive 'turn'.motion.sine", "unknown field"]),
    "endless harmonic": (_driven_by("harmonics = [[1.0, inf, 0.0]]"), ["harmonics[0][1]", "finite"]),
    "table of five points": (
        _driven_by("table = { x = [0, 1, 2, 3, 4], y = [0, 1, 0, 1, 0] }"),
        ["drive 'turn'.motion.table.x", "at least 6 items"],
    ),
    "table that goes back": (
        _driven_by(POINTS.replace("2, 3", "3, 2")),
        ["drive 'turn': motion.table: x", "do not increase", "increasing"],
    ),
    "table with a step": (_driven_by(POINTS.replace("2, 3", "2, 2")), ["drive 'turn': motion.table: x", "do not inc"]),
    "unequal columns": (
        _driven_by(POINTS.replace("5]", "5, 6]")),
        ["drive 'turn'.motion.table", "7 values of x and 6 of y"],
    ),
    "period that does not close": (
        _driven_by(POINTS.replace("1] }", "1], periodic = true }")),
        ["drive 'turn': motion.table: y", "starts at 0 and ends at 1", "where it starts"],
    ),
    "table as long as memory": (
        _driven_by(f"table = {{ x = {list(range(10_001))}, y = {[0] * 10_001} }}"),
        ["drive 'turn'.motion.table.x", "at most 10000 items"],
    ),
    "drive of a ball": (
        _nut("spherical") + DRIVE.replace("hinge", "thread"),
        ["drive 'turn'", "joint 'thread' is spherical", "one axis"],
    ),
    "drive along a hinge": (
        _with(DRIVE, '"angle"', '"distance"'),
        ["drive 'turn'", "a revolute joint has no 'distance'", "angle"],
    ),
    "drive of no joint": (_with(DRIVE, '"hinge"', '"latch"'), ["drive 'turn'", "no joint 'latch'", "hinge"]),
    "drive of an unknown coordinate": (
        _with(DRIVE, '"angle"', '"turn"'),
        ["drive 'turn'.coordinate", "'angle' or 'distance'"],
    ),
    "drive without a motion": (
        _with(DRIVE, "motion = { polynomial = [0.0, 1.0] }", ""),
        ["drive 'turn'.motion", "missing"],
    ),
    "two drives of a name": (GOOD + "\n" + DRIVE + DRIVE, ["element 'turn'", "used twice"]),
    "gear on itself": (
        _with(COUPLING, '"thread"', '"hinge"'),
        ["coupling 'gear'", "angle of joint 'hinge' with itself", "Couple two"],
    ),
    "ratio and law": (
        _with(COUPLING, "ratio = -2.0", "ratio = -2.0\nlaw = { polynomial = [1.0] }"),
        ["coupling 'gear'", "2 of ratio and law given", "exactly one"],
    ),
    "neither ratio nor law": (_with(COUPLING, "ratio = -2.0", ""), ["coupling 'gear'", "0 of ratio and law", "one"]),
    "offset of a law": (
        _with(COUPLING, "ratio = -2.0", "offset = 1.0\nlaw = { polynomial = [1.0] }"),
        ["coupling 'gear'", "an offset goes with a ratio"],
    ),
    "gear with an unknown joint": (GOOD + "\n" + COUPLING, ["coupling 'gear'", "no joint 'thread'", "hinge"]),
    "rolling without a radius": (
        _with(ROLLING, "radius = 0.4\nrounding = 0.1\n", ""),
        ["rolling 'wheel': radius", "nothing to roll on", "positive radius"],
    ),
    "rolling of a negative radius": (_with(ROLLING, "= 0.4", "= -0.4"), ["rolling 'wheel': radius", "positive radius"]),
    "disc without an axis": (_with(ROLLING, "axis = [0.0, 2.0, 0.0]\n", ""), ["rolling 'wheel': axis", "missing"]),
    "disc with an axis of no length": (
        _with(ROLLING, "[0.0, 2.0, 0.0]", "[0, 0, 0]"),
        ["rolling 'wheel': axis", "no le"],
    ),
    "plane without a normal": (
        _with(ROLLING, "[0.0, 0.0, 3.0]", "[0, 0, 0]"),
        ["rolling 'wheel': normal", "no length"],
    ),
    "rolling ground": (_with(ROLLING, '"door"', '"ground"'), ["rolling 'wheel': body", "does not move", "a body"]),
    "rolling of no body": (_with(ROLLING, '"door"', '"gate"'), ["rolling 'wheel': body", "no body 'gate'", "door"]),
    "skate of the ground": (_with(SKATE, '"door"', '"ground"'), ["skate 'edge': body", "does not move"]),
    "skate without a direction": (_with(SKATE, "[0.0, 2.0, 0.0]", "[0, 0, 0]"), ["skate 'edge': lateral", "no length"]),
    "friction of no speed": (_with(FRICTION, "speed = 0.1\n", ""), ["friction 'rub': speed", "missing", "regularises"]),
    "friction of zero speed": (_with(FRICTION, "= 0.1", "= 0.0"), ["friction 'rub': speed", "not positive"]),
    "friction that pushes": (_with(FRICTION, "= 0.3", "= -0.3"), ["friction 'rub'", "negative", "positive"]),
    "control without a target": (
        _with(CONTROL, "target = { harmonics = [[0.5, 2.0, 0.1]] }\n", ""),
        ["control 'hold'.target", "missing"],
    ),
}


@pytest.mark.parametrize("name", INVALID)
def test_bad_input_names_file_and_field(write, name):
    text, parts = INVALID[name]
    with pytest.raises(InvalidInput) as caught:
        load_file(write(text))
    message = str(caught.value)
    assert "door.toml:" in message
    for part in parts:
        assert part in message
    assert caught.value.remedy


def test_joints_beyond_the_basic_ones(write):
    (screw,) = load_file(write(_nut("screw", "pitch = -0.02")))
    assert screw.mechanism.joints[1].pitch == -0.02
    assert screw.mechanism.joints[0].pitch == 0.0
    for kind in ("point_on_line", "point_in_plane", "parallel_axes"):
        (case,) = load_file(write(_nut(kind)))
        nut, thread = case.mechanism.bodies[1], case.mechanism.joints[1]
        assert thread.kind == kind
        assert np.array_equal(thread.F.R[:, 2], [0, 0, 1])
        assert np.allclose(nut.drawing.R @ thread.M.R, thread.F.R, rtol=0, atol=1e-15)
        assert np.allclose(nut.drawing.p + nut.drawing.R @ thread.M.p, [0.1, 0.2, 0.3], rtol=0, atol=1e-15)


def test_a_screw_held_at_several_turns_advances_by_as_many_pitches(write):
    text = _nut("screw", "pitch = -0.02").replace("{ angle = 0.3 } }", "{ angle = 0.3 }, thread = { angle = 14.0 } }")
    (case,) = load_file(write(text))
    nut = case.mechanism.bodies[1]
    assert case.initial_state.p_WB[1, 2] - nut.drawing.p[2] == pytest.approx(-0.02 * 14.0 / (2 * np.pi), abs=1e-14)


def test_elements_that_are_drawn_end_up_in_the_axes_of_their_bodies(write):
    (case,) = load_file(write(GOOD + "\n" + ROLLING + SKATE))
    (wheel,), (edge,) = case.mechanism.rollings, case.mechanism.skates
    # axes x, y, z of the body are y, z, x of the world; the body is drawn at (1, 2, 3)
    for point in (wheel.center, edge.point):
        assert np.allclose(point, [0.2, 0.3, 0.1], rtol=0, atol=1e-15)
    for direction in (wheel.axis, edge.lateral):
        assert np.allclose(direction, [1, 0, 0], rtol=0, atol=1e-15)
    assert (wheel.radius, wheel.rounding) == (0.4, 0.1)
    assert np.array_equal(wheel.point, [0, 0, -1])
    assert np.array_equal(wheel.normal, [0, 0, 1])


def test_a_ball_needs_no_axis(write):
    text = _with(ROLLING, "axis = [0.0, 2.0, 0.0]\nradius = 0.4\n", "")
    (ball,) = load_file(write(text))[0].mechanism.rollings
    assert (ball.radius, ball.rounding) == (0.0, 0.1)


def test_functions_of_time_reach_their_elements(write):
    """Every element has a function of its own, so that swapped functions show."""
    text = _nut("screw", "pitch = 0.02") + DRIVE + COUPLING.replace("ratio = -2.0", "ratio = -2.0\noffset = 0.5")
    text += FRICTION + CONTROL + COUPLING.replace("gear", "cam").replace("ratio = -2.0", "law = { polynomial = [7.0] }")
    places = 'body = "door"\nvector = [0.0, 0.0, 1.0]\nframe = "world"\n'
    ends = 'predecessor = "ground"\nsuccessor = "door"\nat = [0, 0, 0]\nto = [1, 2, 3]\n'
    text += f'[[force]]\nname = "f"\n{places}at = [0, 0, 0]\nhistory = {{ polynomial = [2.0] }}\n'
    text += f'[[torque]]\nname = "t"\n{places}history = {{ polynomial = [3.0] }}\n'
    text += f'[[spring]]\nname = "s"\n{ends}stiffness = 1.0\nfree_length = 1.0\nactuator = {{ polynomial = [4.0] }}\n'
    spring = 'joint = "hinge"\ncoordinate = "angle"\nstiffness = 1.0\nactuator = { polynomial = [5.0] }\n'
    m = load_file(write(text + f'[[joint_spring]]\nname = "k"\n{spring}'))[0].mechanism
    assert [load.history.at(9.0)[0] for load in m.loads] == [2.0, 3.0]
    assert m.springs[0].actuator.at(9.0)[0] == 4.0
    assert m.joint_springs[0].actuator.at(9.0)[0] == 5.0
    assert m.drives[0].motion.at(9.0).tolist() == [9.0, 1.0, 0.0]
    assert [c.law.at(9.0)[0] for c in m.couplings] == [0.5 - 2.0 * 9.0, 7.0]
    assert (m.couplings[0].driver_joint, m.couplings[0].joint) == ("hinge", "thread")
    assert m.controls[0].target.at(1.0)[0] == pytest.approx(0.5 * np.sin(2.1), rel=1e-15)
    assert (m.controls[0].proportional, m.controls[0].integral, m.controls[0].derivative) == (3.0, 2.0, 1.0)
    assert (m.frictions[0].viscous, m.frictions[0].coulomb, m.frictions[0].speed) == (0.0, 0.3, 0.1)


def test_loads_and_springs_without_functions_are_constant(write):
    text = '[[torque]]\nname = "t"\nbody = "door"\nvector = [0.0, 0.0, 1.0]\nframe = "world"\n'
    (case,) = load_file(write(GOOD + "\n" + text))
    assert case.mechanism.loads[0].history is None
    assert set(case.mechanism.features) == {"revolute joint", "load"}


def test_viscous_friction_needs_no_speed(write):
    (case,) = load_file(write(_with(FRICTION, "coulomb = 0.3\nspeed = 0.1", "viscous = 0.2")))
    assert (case.mechanism.frictions[0].viscous, case.mechanism.frictions[0].coulomb) == (0.2, 0.0)


def test_a_table_in_a_case_file_is_the_curve_through_its_points(write):
    (case,) = load_file(write(_driven_by(POINTS)))
    assert [case.mechanism.drives[0].motion.at(x)[0] for x in range(6)] == pytest.approx([0, 1, 0, 1, 0, 1], abs=1e-13)


TANGLED = """titel = "t"
gravity = [0.0, 0.0, 9.81, 0.0] # not three
remarks = '''
mass = 1 is no field: [[body]]
'''
tags = [
  "a", # ]
  "mass = 1",
]

[[body]]
name = "sill"
mass = -2.0
at = [0.0, 0.0, 0.0]
inertia = { xx = 0.3, yy = 0.4, zz = 0.5 }

[[body]]
name = "door"
  mass = "heavy"
at = [0.0, 0.0, 0.0]
inertia = { xx = 0.3, yy = 0.4, zz = 0.5 }
orientation.quaternion = [2.0, 0.0, 0.0, 0.0]

[[joint]]
name = "hinge"
kind = "revolute"
predecessor = "ground"
successor = "door"
at = [1.0, 0.0, 0.0]
"colour" = 'red'

[[joint]]
name = "latch"
kind = "spherical"
predecessor = "door"
successor = "dor"
at = [1.0, 0.0, 0.0]

[[force]]
name = "push"
body = "sil"
vector = [1.0, 0.0, 0.0]
frame = "world"
at = [
  0.0, 0.0, 0.0,
]
"""


def test_all_problems_of_a_file_are_found_at_once_each_with_its_line(write):
    with pytest.raises(InvalidCase) as caught:
        load_file(write(TANGLED))
    assert {problem.where: problem.what.split(",")[0] for problem in caught.value.problems} == {
        "door.toml:1: titel": "unknown field",
        "door.toml: title": "the field is missing",
        "door.toml:2: gravity": "list should have at most 3 items after validation",
        "door.toml:13: body 'sill': mass": "-2.0 kg is not positive",
        "door.toml:19: body 'door'.mass": 'input should be a valid number (given: "heavy")',
        "door.toml:22: body 'door'.orientation": "the quaternion has norm 2; give a unit quaternion",
        "door.toml:30: joint 'hinge'.colour": "unknown field",
        "door.toml:24: joint 'hinge': axis": "the field is missing",
        "door.toml:32: joint 'latch'": "there is no body 'dor'",
        "door.toml:41: force 'push': body": "there is no body 'sil'",
    }
    assert "(9 more problems; `consilience validate`, or `problems` of this error, tells all.)" in str(caught.value)
    assert pickle.loads(pickle.dumps(caught.value)).problems[0].where == caught.value.problems[0].where


BLOCK = """
title = "block"
gravity = [0.0, 0.0, -9.81]
body = [{ name = "block", mass = 2, at = [0.0, 0.0, 0.1], inertia = { xx = 0.03, yy = 0.04, zz = 0.05 } }]
joint = [{ name = "flight", kind = "free", predecessor = "ground", successor = "block", at = [0.0, 0.0, 0.1] }]

[[contact]]
name = "floor"
body = "block"
at = [0.0, 0.0, 0.1]
half_sizes = [0.2, 0.2, 0.1]
point = [0.0, 0.0, 0.0]
normal = [0, 0, 1]
friction = 0.5

[trajectory]
duration = 0.5
sample = 0.05
digits = 8
"""


CIRCLE = 'cone = { kind = "circle"'


@pytest.mark.parametrize(
    ("valid", "given", "message"),
    [
        ("mass = 2", 'mass = "2"', r"body 'block'.mass: input should be a valid number \(given: .2.\)"),
        ("mass = 2", "mass = true", r"body 'block'.mass: input should be a valid number \(given: True\)"),
        ("digits = 8", 'digits = "8"', r"trajectory.digits: input should be a valid integer \(given: .8.\)"),
        ("friction = 0.5", 'associated = "yes"', r"contact 'floor'.associated: input should be a valid boolean"),
        ("friction = 0.5", 'cone = "circle"', r"contact 'floor'.cone: it is a table; give { kind = .circle. }"),
        ("friction = 0.5", "compliance = 1e4", r"contact 'floor'.compliance: it is a table; give { stiffness = 1e4,"),
        ("friction = 0.5", f"{CIRCLE}, facets = 4 }}", r"contact 'floor'.cone: a circle has no facets"),
        ("friction = 0.5", f"{CIRCLE}, tangent = [1, 0, 0] }}", r"contact 'floor'.cone: a circle has no tangent"),
        ("friction = 0.5", 'cone = { kind = "box", offset = 0.1 }', r"contact 'floor'.cone: a box has no offset"),
        ("half_sizes = [0.2, 0.2, 0.1]", "axis = [0, 0, 1]\nradius = 0.0", r"'floor': give a radius above zero"),
        ("half_sizes = [0.2, 0.2, 0.1]", "to = [0, 0, 0.1]\nradius = 0.1", r"the ends of the capsule coincide"),
    ],
)
def test_a_text_that_looks_like_a_number_is_none_and_a_law_that_is_a_table_says_so(write, valid, given, message):
    assert load_file(write(BLOCK))
    with pytest.raises(InvalidCase, match=message):
        load_file(write(BLOCK.replace(valid, given)))


def test_each_element_with_a_problem_is_named_where_the_mechanism_as_a_whole_has_one(write):
    force = '[[force]]\nname = "f"\nbody = "ground"\nvector = [1.0, 0.0, 0.0]\nframe = "world"\nat = [0.0, 0.0, 0.0]\n'
    spring = '[[joint_spring]]\nname = "%s"\njoint = "%s"\ncoordinate = "%s"\nstiffness = 1.0\n'
    dry = '[[dry_friction]]\nname = "d"\njoint = "hinge"\ncoordinate = "angle"\nbound = -0.1\n'
    right, wrong = spring % ("u", "hinge", "angle"), spring % ("t", "hinge", "distance")
    first = GOOD.count("\n") + 1
    with pytest.raises(InvalidCase) as caught:
        load_file(write(GOOD + spring % ("s", "hing", "angle") + force + wrong + right))
    assert [(problem.where, problem.what) for problem in caught.value.problems] == [
        (f"door.toml:{first}: joint spring 's'", "there is no joint 'hing'"),
        (f"door.toml:{first + 11}: joint spring 't'", "a revolute joint has no 'distance'"),
    ]
    with pytest.raises(InvalidCase, match=rf"door.toml:{first + 4}: dry friction 'd': bound: -0.1 is negative"):
        load_file(write(GOOD + dry))


def test_what_strikes_at_the_start_has_no_instant_there(write):
    """An impact has no accelerations: random states take the place of the initial one, and slide or rest."""
    (rests,), (strikes,) = (
        load_file(write(BLOCK + f"[initial.bodies.block]\nvelocity = [0.3, 0.0, {v}]\n")) for v in (0.0, -1.0)
    )
    assert len(rests.states) == len(strikes.states) == rests.instants
    assert rests.states[0].v_WB_W[0, 2] == 0.0
    assert strikes.initial_state.v_WB_W[0, 2] == -1.0
    assert max(abs(state.v_WB_W[0, 2]) for state in strikes.states) < 1e-12


def test_random_states_slide_though_the_samples_of_a_case_are_far_apart(write):
    """Slips of 1e-9 of what a fall leads to are rest for one engine and slip for another."""
    (slow,) = load_file(write(BLOCK.replace("sample = 0.05", "sample = 1e7").replace("= 0.5\ns", "= 1e7\ns")))
    assert max(np.linalg.norm(state.v_WB_W[0]) for state in slow.states) > 1e-6 * np.sqrt(9.81)


def test_a_case_without_sources_is_one(write):
    (case,) = load_file(write(changed('sources = ["test"]', "")))
    assert case.sources == ()
    assert "sources" not in case_table(case)


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


def test_a_failed_assembly_names_the_constraint_and_its_violation(write):
    # a door of 2 m and a strut of 1 m span the 3 m between their feet only if collinear
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
        ("{ angle = 0.3 }", "{ distance = 0.3 }", ["hinge", "no 'distance'", "angle"]),
        ("[initial]", "[initial.bodies.gate]\n[initial]", ["initial.bodies", "no body 'gate'", "door"]),
    ],
)
def test_initial_conditions_of_what_is_not_there(write, old, new, parts):
    """Joints and their coordinates are looked up when the file is read, bodies at assembly."""
    with pytest.raises(InvalidInput) as caught:
        _ = load_file(write(changed(old, new)))[0].initial_state
    for part in parts:
        assert part in str(caught.value)


def test_rates_that_contradict_the_joints(write):
    # hinge, elbow and foot of two bodies and the ground form a rigid triangle
    text = changed("\n[initial]", STRUT.replace("[1.0, 3.0, 0.0]", "[2.5, 2.5, 0.0]") + "\n[initial]")
    (case,) = load_file(write(text.replace("joints = { hinge = { angle = 0.3 } }\n", "")))
    with pytest.raises(
        CannotAssemble,
        match=r"mechanism 'door': joint 'hinge', .* its rate is to be .*, but .* make it 0: .* contradict",
    ):
        _ = case.initial_state


def test_variants_stand_for_the_file(write):
    variant = '\n[variants.fast]\ntitle = "Fast door"\ninitial = { rates = { hinge = { angle = 7.0 } } }\n'
    slow, fast = load_file(write(GOOD + '\n[variants.slow]\ntitle = "Slow door"\n' + variant))
    assert (slow.name, fast.name) == ("door-slow", "door-fast")
    assert slow.initial_state.w_WB_W[0, 2] == pytest.approx(-1.0)
    assert fast.initial_state.w_WB_W[0, 2] == pytest.approx(7.0)
    assert fast.initial.coordinates == {}  # the initial table of a variant replaces that of the file as a whole


def test_library_by_name():
    assert [case.name for case in load_cases("simple_pendulum")] == ["simple_pendulum-small", "simple_pendulum-large"]
    assert load_case("simple_pendulum-large").title.endswith("(A01)")
    with pytest.raises(InvalidInput, match="Name one: simple_pendulum-small"):
        load_case("simple_pendulum")
    with pytest.raises(InvalidInput, match=r"no shipped case of that name.*four_bar"):
        load_case("five_bar")


def test_a_case_knows_what_it_was_asked_for_by(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_bytes(next(path for path in case_files() if path.stem == "double_pendulum").read_bytes())
    assert [case.call for case in load_cases(str(file))] == [str(file)]
    assert [case.call for case in load_cases("chain:bodies=3")] == ["chain:bodies=3"]
    assert load_case("double_pendulum").call == ""


@pytest.mark.parametrize("case", shipped_cases(), ids=lambda case: case.name)
def test_shipped_cases_assemble_and_say_what_they_are(case):
    from consilience.mechanism import constraint_jacobian, constraint_rates, constraint_residual

    state = case.initial_state
    size = max(1.0, np.max(np.abs(state.p_WB)))
    assert np.max(np.abs(constraint_residual(case.mechanism, state)), initial=0.0) < 1e-14 * size
    rates = constraint_jacobian(case.mechanism, state) @ np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
    rates = rates - constraint_rates(case.mechanism)
    assert np.max(np.abs(rates), initial=0.0) < 1e-14 * max(
        1.0, np.max(np.abs(state.w_WB_W)), np.max(np.abs(state.v_WB_W))
    )
    assert len(case.states) == case.instants
    assert case.sources
    assert case.remarks
    assert case.tags
    assert case.group


def test_schema_names_every_table():
    schema = case_schema()
    assert set(schema["properties"]) >= {"title", "body", "joint", "spring", "initial", "trajectory", "variants"}
    assert set(schema["properties"]) >= {"friction", "control", "drive", "coupling", "rolling", "skate"}
    assert set(schema["$defs"]["JointTable"]["properties"]["kind"]["enum"]) == set(JOINT_KINDS)
    assert schema["additionalProperties"] is False


SPHERE = "{ xx = 1, yy = 1, zz = 1 }"

HOSTILE = {
    "lists in lists": ("remarks = " + "[" * 5_000 + "]" * 5_000, "nested too deeply"),
    "tables in tables": ("remarks = " + "{a = " * 5_000, "nested too deeply"),
    "a name of a thousand parts": (".".join(["a"] * 1_000) + " = 1", "a name of 16 parts"),
    "a quoted name of a thousand parts": (' . "a"' * 1_000 + " = 1", "a name of 16 parts"),
    "a number of thousands of digits": ("remarks = " + "9" * 5_000, "a number that cannot be read"),
    "a hexadecimal one": ("remarks = 0x" + "f" * 5_000, "remarks"),
    "a megabyte": ("# " + "x" * 1_000_000, "larger than 1 MB"),
    "more bodies than anybody can solve": (
        "".join(
            f'[[body]]\nname = "b{n}"\nmass = 1\nat = [0, 0, 0]\ninertia = {{ xx = 1, yy = 1, zz = 1 }}\n'
            for n in range(1_001)
        ),
        "body",
    ),
}


@pytest.mark.parametrize(("lines", "message"), HOSTILE.values(), ids=HOSTILE)
def test_what_would_keep_a_parser_busy_is_refused_at_once(write, lines, message):
    start = time.process_time()
    with pytest.raises(InvalidInput, match=message):
        load_file(write(lines + GOOD if "[[body]]" not in lines else GOOD + lines))
    assert time.process_time() - start < 5.0  # a parser that hangs takes minutes


def test_only_regular_files_are_read(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    for path in (tmp_path / "pipe.toml", tmp_path, Path("/dev/zero"), tmp_path / "absent.toml", Path("nul\0.toml")):
        with pytest.raises(InvalidInput):
            load_file(path)


TOO_MUCH = {
    "huge mass": changed("mass = 2.0", "mass = 1e31"),
    "a step between the stars": changed("[1.0, 2.0, 3.0]", "[1e200, 2.0, 3.0]"),
    "a whole number of 400 digits": changed("mass = 2.0", f"mass = 1{'0' * 400}"),
    "samples without number": GOOD + "[trajectory]\nduration = 1e30\nsample = 1e-300\n",
    "bodies times samples": GOOD + "[trajectory]\nduration = 1.0\nsample = 1e-7\n",
    "a negative seed": GOOD + "[instant]\nseed = -1\n",
    "a seed of 70 bits": GOOD + f"[instant]\nseed = {2**70}\n",
    "escape sequence in prose": changed('"Door"', '"Door\\u001b[2J"'),
    "text that turns its direction": changed('"Door"', '"\\u202eDoor"'),
    "prose without end": changed('"Door"', f'"{"x" * 20_001}"'),
    "a body that is a path": changed('successor = "door"', 'successor = "../../door"'),
    "an initial state of a path": changed("joints = { hinge =", 'joints = { "../hinge" ='),
}


@pytest.mark.parametrize("text", TOO_MUCH.values(), ids=TOO_MUCH)
def test_numbers_and_texts_are_bounded(write, text):
    with pytest.raises(InvalidInput):
        load_file(write(text))


def test_a_message_shows_control_characters_and_ends():
    shown = str(InvalidInput("\x1b[2Ja\nb", "\udc80\u202e" + "x" * 10_000, "\x07"))
    assert shown.startswith("\\x1b[2Ja\\nb: \\udc80\\u202exxx")
    assert shown.endswith("...: \\x07".replace(": ", ". "))
    assert len(shown) < 9_000


def test_a_long_chain_is_a_tree_whatever_its_length():
    """A chain of a thousand bodies is deeper than Python's recursion limit."""
    bodies = tuple(Body(f"b{n}", 1.0, np.zeros(3), np.eye(3), Frame(np.zeros(3), np.eye(3))) for n in range(1_000))
    still = Frame(np.zeros(3), np.eye(3))
    joints = tuple(
        Joint(f"j{n}", "revolute", "ground" if n == 0 else f"b{n - 1}", f"b{n}", still, still) for n in range(1_000)
    )
    tree, closing = spanning_tree(Mechanism("chain", np.zeros(3), bodies, joints))
    assert [k for k, _ in tree] == list(range(1_000))
    assert closing == []
