"""Case files that are written and read again: same mechanism, same initial state, same questions."""

from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from consilience.audit.random_mechanisms import random_mechanism
from consilience.case import Case, shipped_cases
from consilience.case.file.reader import load_file
from consilience.case.file.writer import case_text
from consilience.errors import InvalidInput
from consilience.mechanism import GROUND, Frame, Initial, Joint, Mechanism, initial_state
from consilience.suite import store
from mechanisms import GRAVITY, chain, lumpy_body, rotation

ROUNDING = 1e-14
"""Points and axes are rotated to the drawing and back: rounding of products with coordinates of at most some 10 m."""


def written_and_read(case, folder):
    path = folder / f"{case.name}.toml"
    path.write_text(case_text(case, "What it shows.\nAnd how to see it."), encoding="utf-8")
    (found,) = load_file(path)
    return found


def a_case(mechanism, initial=None):
    spans = {"duration": 1.5, "sample": 0.25, "digits": 7, "instants": 3, "seed": 12}
    return Case(mechanism.name, "x.toml", 'With "quotes" \\ and ü', mechanism, initial or Initial(), **spans)


def assert_same(found, expected, where):
    """Compare dataclasses, tuples and mappings recursively, numbers up to rounding; frames of rods may differ."""
    if isinstance(expected, dict):
        assert set(found) == set(expected), where
        for name in expected:
            assert_same(found[name], expected[name], f"{where}.{name}")
    elif is_dataclass(expected):
        assert type(found) is type(expected), where
        for name in (f.name for f in fields(expected)):
            assert_same(getattr(found, name), getattr(expected, name), f"{where}.{name}")
    elif isinstance(expected, tuple) and expected and not isinstance(expected[0], float):
        assert len(found) == len(expected), where
        for n, (one, other) in enumerate(zip(found, expected, strict=True)):
            assert_same(one, other, f"{where}[{n}]")
    elif isinstance(expected, str | bool | int | None):
        assert found == expected, where
    else:
        scale = max(1.0, float(np.max(np.abs(expected), initial=0.0)))
        np.testing.assert_allclose(found, expected, rtol=0, atol=10 * scale * ROUNDING, err_msg=where)


def as_a_file_has_it(mechanism):
    """Return the mechanism in the file's conventions: rods along z, no point for a torque, forces before torques."""
    joints = (
        replace(j, F=Frame(j.F.p, np.eye(3)), M=Frame(j.M.p, np.eye(3))) if j.kind == "rod" else j
        for j in mechanism.joints
    )
    loads = [load if load.kind == "force" else replace(load, point=np.zeros(3)) for load in mechanism.loads]
    return replace(mechanism, joints=tuple(joints), loads=tuple(sorted(loads, key=lambda load: load.kind)))


@pytest.mark.parametrize("seed", range(1, 60))
def test_a_random_mechanism_comes_back(seed, tmp_path):
    case = a_case(random_mechanism(seed))
    found = written_and_read(case, tmp_path)
    assert_same(as_a_file_has_it(found.mechanism), as_a_file_has_it(case.mechanism), "mechanism")


@pytest.mark.parametrize("case", shipped_cases(), ids=lambda c: c.name)
def test_a_shipped_case_comes_back_whole(case, tmp_path):
    """Random states are not compared: they depend on the last bit of a null-space basis."""
    found = written_and_read(case, tmp_path)
    own = {"file": case.file, "group": case.group, "file_digest": case.file_digest, "lines": case.lines}  # another text
    assert_same(replace(found, **own, mechanism=replace(found.mechanism, name=case.mechanism.name)), case, "")
    for name in ("p_WB", "R_WB", "v_WB_W", "w_WB_W"):  # the quaternion may return with the opposite sign
        one, other = (getattr(c.initial_state, name) for c in (found, case))
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12, err_msg=name)


def test_held_coordinates_and_guesses_come_back(tmp_path):
    mechanism = chain("free", "revolute", seed=2)
    poses = {b.name: Frame(b.drawing.p + 0.1, b.drawing.R.T) for b in mechanism.bodies}
    velocities = {b.name: (np.arange(3.0), np.arange(3.0) - 0.1) for b in mechanism.bodies}
    held = {mechanism.joints[0].name: {"orientation": np.array([0.6, 0.8, 0.0, 0.0]), "position": np.arange(3.0)}}
    case = a_case(
        mechanism, Initial(held, {mechanism.joints[0].name: {"orientation": np.arange(3.0)}}, poses, velocities)
    )
    assert_same(written_and_read(case, tmp_path).initial, case.initial, "initial")


def test_what_the_file_says_first_is_the_heading():
    assert case_text(a_case(random_mechanism(1)), "one\ntwo").startswith("# one\n# two\ntitle = ")


def apart_in_the_drawing():
    """A loop of a rod and a screw whose frames are anywhere on their bodies, by all digits of a float."""
    rng = np.random.default_rng(5)
    bodies = [lumpy_body(name, rng) for name in ("a", "b")]
    frames = [Frame(rng.normal(size=3), rotation(rng)) for _ in range(6)]
    joints = (
        Joint("turn", "spherical", GROUND, "a", *frames[:2]),
        Joint("thread", "screw", "b", "a", *frames[2:4], pitch=0.1),
        Joint("bar", "rod", GROUND, "b", *frames[4:], length=4.0),
    )
    return Mechanism("apart", GRAVITY, tuple(bodies), joints)


def test_a_mechanism_apart_in_its_drawing_comes_back_digit_by_digit(tmp_path):
    mechanism = apart_in_the_drawing()
    (found,) = load_file(mechanism.save(tmp_path / "apart.toml"))
    pairs = [*zip(found.mechanism.bodies, mechanism.bodies, strict=True)]
    for one, other in pairs:
        for name in ("com", "inertia"):
            assert np.array_equal(getattr(one, name), getattr(other, name)), name
    frames = [(one.drawing, other.drawing) for one, other in pairs]
    for one, other in zip(found.mechanism.joints, mechanism.joints, strict=True):
        assert (one.kind, one.length, one.pitch) == (other.kind, other.length, other.pitch)
        frames += [(one.F, other.F), (one.M, other.M)]
    for one, other in frames:
        assert np.array_equal(one.p, other.p)
        assert np.array_equal(one.R, other.R)
    assert np.array_equal(found.initial_state.p_WB, initial_state(mechanism).p_WB)
    assert store._digest(found.mechanism) == store._digest(mechanism), (
        "the answers of one are those of the other, in a store"
    )


FRAME = "{ at = [0.0, 0.0, 0.0] }"


@pytest.mark.parametrize(
    ("field", "words"),
    [
        (f"F = {FRAME}", "joint 'turn': M: the field is missing"),
        (f"F = {FRAME}\nM = {FRAME}\nat = [0.0, 0.0, 0.0]", "joint 'turn': at: it is drawn, and has frames"),
        (f"F = {FRAME}\nM = {FRAME}\nlength = 1.0", "joint 'turn': length"),
        ("F = { at = [0, 0, 0], orientation = { rows = [[1, 0, 0], [0, 1, 0], [0, 1, 1]] } }", "no rotation"),
        ("", "joint 'turn': at: the field is missing"),
    ],
)
def test_half_a_pair_of_frames_is_refused(tmp_path, field, words):
    mechanism = chain("spherical", seed=2)
    text = case_text(a_case(replace(mechanism, joints=(replace(mechanism.joints[0], name="turn"),))))
    head, _, rest = text.partition("[[joint]]")
    table = f'[[joint]]\nname = "turn"\nkind = "spherical"\npredecessor = "ground"\nsuccessor = "b0"\n{field}\n\n'
    path = tmp_path / "one.toml"
    path.write_text(head + table + rest[rest.index("[trajectory]") :], encoding="utf-8")
    with pytest.raises(InvalidInput, match=words):
        load_file(path)


def test_joints_that_are_not_assembled_in_the_drawing_are_refused_where_people_read_them():
    mechanism = random_mechanism(2, bodies=1)
    apart = replace(mechanism.joints[0], M=Frame(mechanism.joints[0].M.p + 0.1, mechanism.joints[0].M.R))
    with pytest.raises(InvalidInput, match=f"joint '{apart.name}': its frames are .* apart in the drawing"):
        case_text(a_case(replace(mechanism, joints=(apart,))))
