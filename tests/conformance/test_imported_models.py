"""Imported URDF and MJCF against what Pinocchio and MuJoCo load from the same text."""

import numpy as np
import pytest

pytest.importorskip("pinocchio")
pytest.importorskip("mujoco")

import mujoco

from consilience import accelerations, initial_state
from consilience.case.importing import import_model
from imported import BAR, difference

INERTIAL = """<inertial><origin xyz="{com}" rpy="0.3 -0.5 0.8"/><mass value="{mass}"/>
  <inertia ixx="0.021" iyy="0.034" izz="0.027" ixy="0.002" ixz="-0.003" iyz="0.0015"/></inertial>"""


def link(name, mass=None, com="0.03 -0.02 0.05"):
    return f'<link name="{name}">{INERTIAL.format(mass=mass, com=com) if mass else ""}</link>'


def joint(name, kind, parent, child, axis="0.48 -0.6 0.64", more="", xyz="0.1 0.25 -0.2", rpy="0.4 -0.7 1.1"):
    return f"""<joint name="{name}" type="{kind}"><origin xyz="{xyz}" rpy="{rpy}"/><parent link="{parent}"/>
      <child link="{child}"/><axis xyz="{axis}"/><limit effort="1" velocity="1" lower="-1" upper="1"/>{more}</joint>"""


def robot(*parts):
    return f'<robot name="r">{"".join(parts)}</robot>'


DAMPED = '<dynamics damping="0.3"/>'

URDF = {
    "skew axes": robot(
        *(link(n, 1.0 + i) for i, n in enumerate("abcd")),
        joint("ab", "revolute", "a", "b"),
        joint("bc", "prismatic", "b", "c", "-0.6 0 0.8"),
        joint("cd", "continuous", "c", "d", "0 0.28 0.96"),
    ),
    "axis by default": robot(
        link("a"),
        link("b", 2.0),
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><limit effort="1" velocity="1"/></joint>',
    ),
    "axis that is no unit vector": robot(link("a"), link("b", 2.0), joint("j", "revolute", "a", "b", "1 2 -2")),
    "damping": robot(
        *(link(n, 1.0) for n in "abc"),
        joint("ab", "revolute", "a", "b", more=DAMPED),
        joint("bc", "prismatic", "b", "c", more=DAMPED),
    ),
    "fixed links": robot(
        link("w"),
        link("a", 3.0),
        link("b", 1.0),
        link("tool", 0.7, "0.2 0 0.1"),
        link("frame"),
        joint("wa", "fixed", "w", "a"),
        joint("ab", "revolute", "a", "b"),
        joint("bt", "fixed", "b", "tool"),
        joint("tf", "fixed", "tool", "frame"),
    ),
    "mimic": robot(
        *(link(n, 1.0) for n in "abcd"),
        joint("ab", "revolute", "a", "b", more=DAMPED),
        joint("ac", "prismatic", "a", "c", more='<mimic joint="ab" multiplier="-0.7" offset="0.2"/>' + DAMPED),
        joint("cd", "revolute", "c", "d", more='<mimic joint="ac" multiplier="1.5"/>'),
    ),
    "cross without mass": robot(
        link("a"),
        link("cross"),
        link("b", 1.3),
        link("c", 0.8),
        joint("one", "revolute", "a", "cross", "1 0 0"),
        joint("two", "revolute", "cross", "b", "0 0 1", xyz="0 0 0", rpy="0 0 0"),
        joint("three", "revolute", "b", "c"),
    ),
    "three hinges through a point": robot(
        link("a"),
        link("x"),
        link("y"),
        link("b", 1.3),
        joint("one", "revolute", "a", "x", "1 0 0"),
        joint("two", "revolute", "x", "y", "0 0.6 0.8", xyz="0 0 0", rpy="0 0 0"),
        joint("three", "revolute", "y", "b", "0 0 1", xyz="0 0 0", rpy="0 0 0"),
    ),
    "slides and a hinge": robot(
        link("a"),
        link("x"),
        link("y"),
        link("b", 1.3),
        joint("one", "prismatic", "a", "x", "1 0 0"),
        joint("two", "prismatic", "x", "y", "0.6 0.8 0", rpy="0 0 0"),
        joint("three", "revolute", "y", "b", "0 0 1", rpy="0 0 0"),
    ),
    "slide along a hinge": robot(
        link("a"),
        link("x"),
        link("b", 1.3),
        joint("one", "revolute", "a", "x", "0 0.6 0.8", more=DAMPED),
        joint("two", "prismatic", "x", "b", "0 -0.6 -0.8", xyz="0 0 0", rpy="0 0 0", more=DAMPED),
    ),
    "mimic of a slide that its joint counts backwards": robot(
        link("a"),
        link("x"),
        link("b", 1.3),
        link("c", 0.7),
        joint("one", "revolute", "a", "x", "0 0.6 0.8"),
        joint("two", "prismatic", "x", "b", "0 -0.6 -0.8", xyz="0 0 0", rpy="0 0 0"),
        joint("three", "revolute", "b", "c", more='<mimic joint="two" multiplier="0.8" offset="0.1"/>'),
    ),
    "mimic of one of two hinges through a point": robot(
        link("a", 2.0),
        link("x"),
        link("b", 1.3),
        link("c", 0.7),
        joint("wa", "fixed", "w", "a"),
        link("w"),
        joint("one", "continuous", "a", "x", "0 0 2"),
        joint("two", "revolute", "x", "b", "1 0 0", xyz="0 0 0", rpy="0 0 0", more=DAMPED),
        joint("three", "prismatic", "b", "c", more='<mimic joint="two" multiplier="0.5" offset="0.1"/>'),
    ),
    "damped hinges that miss one another, on a moving link": robot(
        link("a"),
        link("b", 1.3),
        link("x"),
        link("c", 0.7),
        joint("ab", "revolute", "a", "b"),
        joint("one", "revolute", "b", "x", more=DAMPED),
        joint("two", "revolute", "x", "c", "0 0.28 0.96", more=DAMPED),
    ),
    "slide across a hinge, on a moving link": robot(
        link("a"),
        link("b", 1.3),
        link("x"),
        link("c", 0.7),
        joint("ab", "revolute", "a", "b"),
        joint("one", "prismatic", "b", "x", "0.6 0 0.8", more=DAMPED),
        joint("two", "revolute", "x", "c", "0 1 0", more=DAMPED),
    ),
    "nothing on a frame that moves": robot(
        link("a"), link("b", 1.3), link("flag"), joint("ab", "revolute", "a", "b"), joint("bf", "revolute", "b", "flag")
    ),
    "in a plane": robot(link("a"), link("b", 1.3), joint("j", "planar", "a", "b", "0 0 1")),
    "floating": robot(
        link("a"), link("b", 1.3), link("c", 0.6), joint("j", "floating", "a", "b"), joint("k", "revolute", "b", "c")
    ),
}

BODY = '<inertial pos="0.03 -0.02 0.05" mass="{mass}" fullinertia="0.021 0.034 0.027 0.002 -0.003 0.0015"/>'


def body(name, joints, *inside, mass=1.3):
    return f"""<body name="{name}" pos="0.1 0.25 -0.2" euler="0.4 -0.7 1.1">{BODY.format(mass=mass)}{joints}
      {"".join(inside)}</body>"""


def world(*bodies, more="", option='gravity="1 -3 -9"'):
    return f"""<mujoco><compiler angle="radian"/><option {option}/>
      <worldbody>{"".join(bodies)}</worldbody>{more}</mujoco>"""


HINGE = """<joint name="{0}" pos="0.1 -0.2 0.05" axis="0.48 -0.6 0.64" stiffness="3" springref="0.4" damping="0.2"
  ref="0.3"/>"""
SLIDE = '<joint name="{0}" type="slide" axis="-0.6 0 0.8" stiffness="30" damping="2"/>'

POLYNOMIAL = HINGE.replace('"3"', '"3 2 1"').replace('damping="0.2"', 'damping="0.2 0.5"')

MJCF = {
    "chain with springs": world(
        body("a", HINGE.format("j"), body("b", SLIDE.format("k"), body("c", HINGE.format("l"))))
    ),
    "ball and free": world(
        body("a", '<joint type="ball" pos="0.1 0 0.2"/>'), body("b", "<freejoint/>", body("c", HINGE.format("j")))
    ),
    "welded bodies": world(body("a", HINGE.format("j"), body("tool", "", mass=0.4)), body("post", "")),
    "inertia from shapes": world(
        '<body pos="0 0.1 0"><joint axis="0 1 0"/><geom type="capsule" size="0.05" fromto="0 0 0 0.3 0.1 0.2"/>'
        '<body pos="0.3 0.1 0.2"><joint axis="1 0 0"/><geom type="box" size="0.1 0.2 0.05" euler="0.3 0.2 0.1"/>'
        "</body></body>"
    ),
    "hinges through a point": world(
        body(
            "a",
            '<joint axis="1 0 0" pos="0 0 0.1"/><joint axis="0 -0.6 0.8" pos="0 0 0.1"/>',
            body("b", HINGE.format("j")),
        )
    ),
    "three hinges": world(body("a", '<joint axis="1 0 0"/><joint axis="0 0.6 0.8"/><joint axis="0 0 1"/>')),
    "slides and a hinge": world(
        body(
            "a",
            '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>',
            body("b", HINGE.format("j")),
        )
    ),
    "spring on a slide that its joint counts backwards": world(
        body("a", '<joint axis="0 0.6 0.8"/><joint type="slide" axis="0 -0.6 -0.8" stiffness="30" springref="0.2"/>')
    ),
    "polynomials": world(body("a", POLYNOMIAL.format("j"), body("b", SLIDE.format("k").replace('"30"', '"0 20 50"')))),
    "polynomial on a slide that its joint counts backwards": world(
        body(
            "a",
            '<joint axis="0 0.6 0.8" stiffness="1 0.4" damping="0 0.2"/><joint type="slide" axis="0 -0.6 -0.8" '
            'stiffness="30 -20 40" springref="0.2" damping="0.1 0.5 0.7"/>',
        )
    ),
    "coupled": world(
        body("a", HINGE.format("j")),
        body("b", SLIDE.format("k")),
        more='<equality><joint joint1="k" joint2="j" polycoef="0.1 -0.4 0 0 0"/></equality>',
    ),
    "held at a constant": world(
        body("a", HINGE.format("j"), body("b", SLIDE.format("k"))),
        more='<equality><joint joint1="k" polycoef="0.1 0 0 0 0"/></equality>',
    ),
    "two slides": world(
        body(
            "a",
            '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0.6 0.8 0"/>',
            body("b", HINGE.format("j")),
        )
    ),
    "three slides": world(
        body(
            "a",
            '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0.6 0.8 0"/><joint type="slide"/>',
            body("b", HINGE.format("j")),
        )
    ),
    "made-up names that others have": world(
        body("body_2", HINGE.format("joint_1"), '<body pos="0.3 0 0">' + BODY.format(mass=0.4) + "<joint/></body>")
    ),
    "weld that holds no rotation, a loop": world(
        body("a", "<freejoint/>"), more='<equality><weld body1="a" anchor="0.1 0.2 0" torquescale="0"/></equality>'
    ),
    "tendon as a spring": world(
        body("a", HINGE.format("j"), '<site name="s" pos="0.2 0.1 0"/>'),
        '<site name="g" pos="0.5 1 0"/>',
        more='<tendon><spatial stiffness="40" damping="3" springlength="0.5"><site site="g"/><site site="s"/></spatial>'
        "</tendon>",
    ),
    "loop closed by a ball": world(
        body(
            "a",
            '<joint axis="0 0.6 0.8"/>',
            body("b", '<joint type="ball" pos="0.2 0.3 0.1"/>', body("c", '<joint type="ball" pos="-0.2 0.1 0.3"/>')),
        ),
        more='<equality><connect body1="c" anchor="0.4 0.1 -0.2"/></equality>',
    ),
    "loop closed by a weld": world(
        body(
            "a",
            '<joint axis="0 0.6 0.8"/>',
            body(
                "b",
                '<joint type="ball" pos="0.2 0.3 0.1"/>',
                body("c", '<joint type="ball" pos="-0.2 0.1 0.3"/>', body("d", '<joint type="ball"/>')),
            ),
        ),
        more='<equality><weld body1="d" anchor="0.1 0.2 0"/></equality>',
    ),
}


def write(tmp_path, text, suffix):
    path = tmp_path / f"model{suffix}"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", URDF)
def test_accelerations_of_an_imported_urdf_are_those_of_pinocchio(tmp_path, name):
    worst, violated, _ = difference(write(tmp_path, URDF[name], ".urdf"))
    assert worst < BAR
    assert violated < 1e-12


def test_a_free_base_floats_as_in_pinocchio(tmp_path):
    worst, violated, imported = difference(write(tmp_path, URDF["skew axes"], ".urdf"), free_base=True)
    assert len(imported.case.mechanism.bodies) == 4
    assert max(worst, violated) < BAR


@pytest.mark.parametrize("name", MJCF)
def test_accelerations_of_an_imported_mjcf_are_those_of_mujoco(tmp_path, name):
    loops = "loop" in name
    worst, violated, _ = difference(
        write(tmp_path, MJCF[name], ".xml"), formulation="descriptor" if loops else "relative"
    )
    assert worst < BAR
    assert violated < 1e-12


def test_polynomials_of_joints_are_imported_and_those_of_tendons_and_balls_are_noted(tmp_path):
    tendon = MJCF["tendon as a spring"].replace('stiffness="40"', 'name="t" stiffness="40 3"')
    notes = {}
    for name, text in {"joint": MJCF["polynomials"], "tendon": tendon}.items():
        imported = import_model(write(tmp_path, text, ".xml"))
        notes[name] = imported.notes.left_out.get("spring or damper with a polynomial, its linear part kept")
        springs = imported.case.mechanism.joint_springs
        if name == "joint":
            assert [s.laws for s in springs] == [
                ((3.0, 2.0, 1.0), (0.2, 0.5, 0.0)),
                ((0.0, 20.0, 50.0), (2.0, 0.0, 0.0)),
            ]
    assert notes == {"joint": None, "tendon": ["t"]}
    ball = world(body("a", '<joint name="b" type="ball" stiffness="0 2" damping="0 0.5"/>'))
    imported = import_model(write(tmp_path, ball, ".xml"))
    assert imported.case.mechanism.joint_springs == ()
    assert imported.notes.left_out["spring or damping left out: the joint it became has no such coordinate"] == ["b"]


def test_two_sprung_hinges_of_one_body_are_two_joints(tmp_path):
    """At rest as drawn; the body between the hinges is no body of the file."""
    second = '<joint name="k" axis="0 1 0" stiffness="2" damping="0.1" springref="0.2"/>'
    path = write(tmp_path, world(body("a", HINGE.format("j").replace('ref="0.3"', "") + second)), ".xml")
    mechanism = import_model(path).case.mechanism
    assert [joint.kind for joint in mechanism.joints] == ["revolute", "revolute"]
    assert len(mechanism.joint_springs) == 2
    model = mujoco.MjModel.from_xml_path(str(path))
    data, expected = mujoco.MjData(model), np.zeros(6)
    mujoco.mj_forward(model, data)
    mujoco.mj_rnePostConstraint(model, data)
    mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_XBODY, model.body("a").id, expected, 0)
    found = accelerations(mechanism, [initial_state(mechanism)])
    a = mechanism.body_index["a"]
    np.testing.assert_allclose(found.alpha_WB_W[0, a], expected[:3], atol=1e-10)
    np.testing.assert_allclose(found.a_WB_W[0, a], expected[3:] + model.opt.gravity, atol=1e-10)
    assert np.max(np.abs(expected[:3])) > 1.0
