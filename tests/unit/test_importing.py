"""Imports from URDF and MJCF: what is translated, reported and refused; joints in series merged into one."""

import tomllib
from itertools import pairwise

import numpy as np
import pytest

from consilience.case.file.reader import load_file
from consilience.case.importing import import_model, imported_text
from consilience.case.importing.compound import recognise
from consilience.cli.commands.import_model import import_
from consilience.engine.native import NativeJoint
from consilience.engine.native.parts import inertia_of_several
from consilience.errors import InvalidInput

X, Y, Z = np.eye(3)
HERE, THERE = np.array([0.3, -0.2, 0.5]), np.array([0.1, 0.4, -0.6])


def motions(*rows):
    return [NativeJoint(f"m{n}", kind, at, axis) for n, (kind, at, axis) in enumerate(rows)]


SKEW = np.array([0.6, 0.0, 0.8])

ROWS = {
    "universal": (("R", HERE, X), ("R", HERE + Y, Y)),
    "cylindrical": (("R", HERE, SKEW), ("P", THERE, -SKEW)),
    "planar": (("P", HERE, X), ("R", THERE, Y), ("P", HERE, SKEW)),
    "spherical": (("R", HERE, X), ("R", HERE - 2 * SKEW, SKEW), ("R", HERE + Y, Y)),
    "free": (("P", HERE, X), ("P", HERE, Y), ("P", HERE, SKEW), ("S", THERE, Z)),
    None: (("R", HERE, X), ("R", HERE, SKEW)),
}


@pytest.mark.parametrize("kind", ROWS)
def test_motions_in_a_row_are_the_joint_they_make(kind):
    found = recognise(motions(*ROWS[kind]))
    assert (found and found.kind) == kind


@pytest.mark.parametrize(
    "row",
    [
        (("R", HERE, X), ("R", THERE, Y)),  # perpendicular, but not intersecting
        (("R", HERE, X), ("P", HERE, Y)),  # a slide perpendicular to the hinge axis
        (("P", HERE, X), ("P", THERE, X), ("R", HERE, Z)),  # two parallel slides
        (("P", HERE, X), ("P", HERE, Z), ("R", HERE, Z)),  # a slide out of the plane
        (("R", HERE, X), ("R", HERE, SKEW), ("R", HERE, Z)),  # three coplanar axes
        (("R", HERE, X), ("R", THERE, Y), ("R", HERE, Z)),  # axes not through one point
        (("P", HERE, X), ("P", HERE, -X)),
    ],
)
def test_a_row_that_only_looks_like_a_joint_is_none(row):
    assert recognise(motions(*row)) is None


def test_where_the_axes_of_hinges_meet():
    found = recognise(motions(*ROWS["spherical"]))
    assert np.allclose(found.at, HERE, atol=1e-12)


def test_a_slide_against_its_hinge_counts_backwards():
    assert recognise(motions(*ROWS["cylindrical"])).coordinates == {"m0": ("angle", 1.0), "m1": ("distance", -1.0)}


def test_inertia_of_points_is_that_of_their_definition():
    """``I = sum m (d^2 1 - d d^T)`` of point masses about their centre, for any grouping of the points."""
    rng = np.random.default_rng(4)
    points, masses = rng.normal(size=(6, 3)), rng.uniform(0.5, 2.0, 6)
    groups = [
        inertia_of_several((m, p, np.zeros((3, 3))) for m, p in zip(masses[i:j], points[i:j], strict=True))
        for i, j in pairwise((0, 2, 3, 6))
    ]
    mass, com, inertia = inertia_of_several(groups)
    centre = masses @ points / masses.sum()
    d = points - centre
    expected = np.einsum("n,nij->ij", masses, np.eye(3) * np.sum(d * d, 1)[:, None, None] - d[:, :, None] * d[:, None])
    assert np.isclose(mass, masses.sum(), rtol=1e-15)
    assert np.allclose(com, centre, atol=1e-14)
    assert np.allclose(inertia, expected, atol=1e-13)


# ---------------------------------------------------------------- URDF

INERTIAL = (
    '<inertial><origin xyz="0.1 0 0" rpy="0.2 0 0"/><mass value="2"/>'
    '<inertia ixx="0.1" iyy="0.2" izz="0.15" ixy="0" ixz="0" iyz="0"/></inertial>'
)
TWO = """<link name="base"/><link name="arm">{inertial}{more}</link>
  <joint name="j" type="{kind}"><parent link="base"/><child link="arm"/>{joint}</joint>"""


def urdf(kind="revolute", inertial=INERTIAL, more="", joint="", robot=""):
    return f'<robot name="r">{TWO.format(kind=kind, inertial=inertial, more=more, joint=joint)}{robot}</robot>'


def read(tmp_path, text, free_base=False):
    path = tmp_path / "model.urdf"
    path.write_text(text)
    return import_model(path, free_base)


def test_everything_left_out_is_named(tmp_path):
    text = urdf(
        more="<visual/><collision/>",
        joint='<limit lower="-1"/><dynamics damping="0.4" friction="0.2"/><axis xyz="0 0 2"/>',
        robot='<transmission name="motor"/><gazebo reference="arm"/><camera name="eye"/><link name="tool-1">'
        + INERTIAL
        + "</link>"
        '<joint name="k" type="fixed"><parent link="arm"/><child link="tool-1"/></joint>'
        '<link name="flag"/><joint name="f" type="revolute"><parent link="arm"/><child link="flag"/></joint>',
    )
    imported = read(tmp_path, text)
    lines = imported.notes.lines()
    told = {reason.split(",")[0].split(":")[0]: elements for reason, elements in imported.notes.left_out.items()}
    assert told == {
        "axis that is not a unit vector": ["j"],
        "Coulomb friction": ["j"],
        "shapes": ["arm"],
        "limits": ["j"],
        "transmissions and motors": ["motor"],
        "extensions for Gazebo": ["arm"],
        "<camera>": ["eye"],
        "gravity": ["mechanism"],
        "fixed": ["base", "tool-1"],
        "without mass": ["flag"],
    }
    heading = imported_text(imported)
    assert all(f"# {line}" in heading for line in lines)


def test_damping_becomes_a_damper_and_the_case_can_be_read(tmp_path):
    imported = read(tmp_path, urdf(joint='<dynamics damping="0.4"/>'))
    (spring,) = imported.case.mechanism.joint_springs
    assert (spring.joint, spring.coordinate, spring.damping, spring.stiffness) == ("j", "angle", 0.4, 0.0)
    assert tomllib.loads(imported_text(imported))["joint_spring"][0]["damping"] == 0.4


def test_names_a_case_cannot_have_are_changed_and_said(tmp_path):
    imported = read(tmp_path, urdf().replace('"arm"', '"ground"').replace('"j"', '"1/j"'))
    assert [b.name for b in imported.case.mechanism.bodies] == ["ground_2"]
    assert imported.notes.left_out["body with a new name"] == ["ground is ground_2"]
    assert imported.notes.left_out["joint with a new name"] == ["1/j is joint_1_j"]


FLAT = '<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.2" izz="0.31" ixy="0" ixz="0" iyz="0"/></inertial>'
POINT = '<inertial><mass value="2"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial>'
LIGHT = '<inertial><mass value="0"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
CHILD = (
    '<link name="{0}">{1}</link><joint name="to_{0}" type="revolute"><parent link="{2}"/><child link="{0}"/></joint>'
)

REFUSED = {
    "triangle inequality": urdf(inertial=FLAT),
    "not all positive": urdf(inertial=POINT),
    "moments of inertia and no mass": urdf(inertial=LIGHT, robot=CHILD.format("b", INERTIAL, "arm")),
    "it carries b and c": urdf(
        inertial="", robot=CHILD.format("b", INERTIAL, "arm") + CHILD.format("c", INERTIAL, "arm")
    ),
    r"2 joints in a row \(R R\)": urdf(inertial="", robot=CHILD.format("b", INERTIAL, "arm")),
    "no joint type 'hinge'": urdf(kind="hinge"),
    "its axis has no length": urdf(joint='<axis xyz="0 0 0"/>'),
    "'xyz' is not 3 finite numbers": urdf(joint='<axis xyz="0 nan 1"/>'),
    "link 'arm': 'value' is missing": urdf(inertial="<inertial/>"),
    "link 'arm': 'ixy' is missing": urdf(inertial=INERTIAL.replace('ixy="0"', "")),
    "'iyz' is not 1 finite number": urdf(inertial=INERTIAL.replace('iyz="0"', 'iyz="none"')),
    "no link of this file has an <inertial>": urdf(inertial="", more="<visual/>"),
    "mass is -1 kg": urdf(inertial=INERTIAL.replace('value="2"', 'value="-1"')),
    "there is no link 'hand'": urdf(
        robot='<joint name="k" type="fixed"><parent link="arm"/><child link="hand"/></joint>'
    ),
    "two links have this name": urdf(robot='<link name="arm"/>'),
    "two joints lead to it": urdf(
        robot='<joint name="k" type="fixed"><parent link="base"/><child link="arm"/></joint>'
    ),
    "2 links have no parent": urdf(robot='<link name="other"/>'),
    "it mimics 'k', which is no other joint": urdf(joint='<mimic joint="k"/>'),
    "it mimics 'j', which is no other joint": urdf(joint='<mimic joint="j"/>'),
    "nothing with mass moves": urdf(kind="fixed"),
    "document type": '<!DOCTYPE robot [<!ENTITY a "b">]>' + urdf(),
    "no XML": "<robot>",
    "its root is <sdf>": "<sdf/>",
    "xacro": '<robot xmlns:x="http://wiki.ros.org/xacro"><x:include/></robot>',
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_no_case_can_express_is_refused(tmp_path, what):
    with pytest.raises(InvalidInput, match=what):
        read(tmp_path, REFUSED[what])


def test_all_that_is_refused_is_told_at_once(tmp_path):
    with pytest.raises(InvalidInput, match=r"arm: principal moments 0\.1.*b: principal moments 0, 0, 0"):
        read(tmp_path, urdf(inertial=FLAT, robot=CHILD.format("b", POINT, "arm")))


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InvalidInput, match="cannot be read"):
        import_model(tmp_path / "none.urdf")


def test_the_command_writes_a_case_and_overwrites_nothing(tmp_path, capsys):
    (tmp_path / "model.urdf").write_text(urdf(more="<visual/>"))
    target = tmp_path / "case.toml"
    import_(tmp_path / "model.urdf", target)
    assert "- shapes, not read: a `contact` states which pairs touch: arm" in capsys.readouterr().out
    (case,) = load_file(target)
    assert case.initial_state.p_WB.shape == (1, 3)
    with pytest.raises(InvalidInput, match="nothing is overwritten"):
        import_(tmp_path / "model.urdf", target)
    with pytest.raises(InvalidInput, match=r"end with \.toml"):
        import_(tmp_path / "model.urdf", tmp_path / "case.xml")


# ---------------------------------------------------------------- MJCF

BODY = '<body name="a"><joint name="j"{joint}/><geom size="0.1" mass="1"/>{inside}</body>'


def mjcf(joint="", inside="", world="", more=""):
    return f"<mujoco><worldbody>{BODY.format(joint=joint, inside=inside)}{world}</worldbody>{more}</mujoco>"


def read_mjcf(tmp_path, text, free_base=False):
    pytest.importorskip("mujoco")
    path = tmp_path / "model.xml"
    path.write_text(text)
    return import_model(path, free_base)


def test_everything_of_a_mjcf_left_out_is_named(tmp_path):
    text = mjcf(
        ' armature="0.1" frictionloss="0.2" range="-1 1" limited="true"',
        inside='<body name="tool"><geom size="0.1"/></body>',
        world='<body name="hand" mocap="true"/>',
        more='<actuator><motor name="m" joint="j"/></actuator><sensor><jointpos name="s" joint="j"/></sensor>'
        '<keyframe><key name="home" qpos="1"/></keyframe><option viscosity="0.1"/>',
    )
    told = {r.split(",")[0].split(":")[0]: e for r, e in read_mjcf(tmp_path, text).notes.left_out.items()}
    assert told == {
        "motors and muscles": ["m"],
        "sensors": ["s"],
        "keyframes": ["home"],
        "limits": ["j"],
        "armature": ["j"],
        "Coulomb friction": ["j"],
        "bodies moved by the user (mocap)": ["hand"],
        "shapes and their contacts": ["mechanism"],
        "the medium": ["mechanism"],
        "fixed": ["tool", "hand"],
    }


MJCF_REFUSED = {
    "MuJoCo refuses it": "<mujoco><worldbody><body/></worldbody><nonsense/></mujoco>",
    "its inertia is that of the mesh 'm', which is not there": mjcf(
        inside='<body name="b"><joint/><geom type="mesh" mesh="m"/></body>',
        more='<asset><mesh name="m" file="shell.stl"/></asset>',
    ),
    "an equality of tendons": mjcf(
        more='<tendon><fixed name="t"><joint joint="j" coef="1"/></fixed></tendon>'
        "<equality><tendon tendon1='t'/></equality>"
    ),
}


@pytest.mark.parametrize("what", MJCF_REFUSED)
def test_what_of_a_mjcf_no_case_can_express_is_refused(tmp_path, what):
    with pytest.raises(InvalidInput, match=what):
        read_mjcf(tmp_path, MJCF_REFUSED[what])


def test_everything_of_a_tendon_left_out_is_named(tmp_path):
    sites = '<site name="w"/>', '<site name="s" pos="0.2 0 0"/>'
    tendon = (
        '<tendon><spatial name="t" stiffness="7" armature="0.5" frictionloss="2" limited="true" range="0 3">'
        '<site site="w"/><site site="s"/></spatial></tendon>'
    )
    found = read_mjcf(tmp_path, mjcf(' actuatorfrcrange="-1 1"', sites[1], sites[0], tendon))
    told = {reason.split(",")[0].split(":")[0]: elements for reason, elements in found.notes.left_out.items()}
    assert told == {
        "limits of motors": ["j"],
        "limits": ["t"],
        "armature": ["t"],
        "Coulomb friction": ["t"],
        "shapes and their contacts": ["mechanism"],
    }
    assert len(found.case.mechanism.springs) == 1


def test_a_mesh_that_is_not_there_matters_only_for_inertia(tmp_path):
    inertial = '<inertial pos="0.1 0 0" mass="1" diaginertia="0.01 0.02 0.03"/>'
    text = mjcf(
        inside=f'<body name="b">{inertial}<joint/><geom type="mesh" mesh="m"/></body>',
        more='<asset><mesh name="m" file="shell.stl"/></asset>',
    )
    found = read_mjcf(tmp_path, text)
    assert found.notes.left_out["meshes that are not there: shapes are not read"] == ["m"]
    np.testing.assert_allclose(found.case.mechanism.bodies[1].inertia, np.diag([0.01, 0.02, 0.03]), atol=1e-17)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (f"{mjcf()}\n\\ ", ["text behind the last element, not read"]),
        (mjcf(world=" loose "), ["text between elements, not read"]),
        (f"\n{mjcf()}", []),
    ],
)
def test_text_outside_of_elements_is_told_and_says_nothing_of_a_mjcf(tmp_path, text, told):
    found = read_mjcf(tmp_path, text)
    assert len(found.case.mechanism.bodies) == 1
    assert [reason for reason in found.notes.left_out if reason.startswith("text")] == told


@pytest.mark.parametrize(
    "text",
    [
        "\n" + '<?xml version="1.0"?>' + urdf(),
        urdf().replace("<robot ", '<robot xmlns="http://www.ros.org" '),
        urdf() + " end",
    ],
)
def test_what_engines_overlook_in_a_urdf_is_overlooked(tmp_path, text):
    assert len(read(tmp_path, text).case.mechanism.bodies) == 1


def test_an_equality_that_is_off_is_left_out(tmp_path):
    text = mjcf(more='<equality><joint name="e" joint1="j" active="false"/></equality>')
    assert read_mjcf(tmp_path, text).notes.left_out["equality that is not active"] == ["e"]


def test_a_mjcf_says_itself_what_floats(tmp_path):
    with pytest.raises(InvalidInput, match="what floats"):
        read_mjcf(tmp_path, mjcf(), free_base=True)


def test_a_loop_that_is_open_as_drawn_is_refused(tmp_path):
    text = mjcf(
        inside='<site name="s"/><body name="b"><joint/><geom size="0.1"/></body>',
        world='<site name="w" pos="0.5 0 0"/>',
        more='<equality><connect name="c" site1="s" site2="w"/></equality>',
    )
    with pytest.raises(InvalidInput, match="apart in the drawing"):
        imported_text(read_mjcf(tmp_path, text))
