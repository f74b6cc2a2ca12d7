"""Messages of the library about arguments that are not what a function needs: the field, and what would be right."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import consilience as c
from consilience.case.file.reader import load_file
from consilience.errors import InvalidInput
from consilience.mechanism import require_states
from mechanisms import TREES, states_of

HERE = c.Frame(np.zeros(3), np.eye(3))
BALL, HINGE = TREES["single_spherical"], TREES["single_revolute"]
(STATE,) = states_of(HINGE, 1)
TWO = TREES["rigid_between"]


def body(mass=1.0, com=(0.0, 0.0, 0.0), inertia=((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)), drawing=HERE):
    return c.Body("arm", mass, com, inertia, drawing)


def joint(F=HERE):
    return c.Joint("pin", "revolute", "ground", "arm", F, HERE)


def start(mechanism, **given):
    name = mechanism.joints[0].name
    return c.initial_state(mechanism, c.Initial(**{what: {name: value} for what, value in given.items()}))


REFUSED = {
    r"body 'arm': inertia: shape \(2,\)\..*Three moments or the six": lambda: body(inertia=[1, 1]),
    r"body 'arm': inertia: it is no array of numbers": lambda: body(inertia=[[1, 2], [3]]),
    r"body 'arm': com: shape \(\)\. Give an array of shape \(3,\)": lambda: body(com=0.0),
    r"body 'arm': com: a component is not finite": lambda: body(com=[0, 0, np.nan]),
    r"body 'arm': mass: it is a str.*in kg": lambda: body(mass="1"),
    r"body 'arm': drawing: it is a tuple, not a Frame": lambda: body(drawing=(np.zeros(3), np.eye(3))),
    r"joint 'pin': F: it is a ndarray, not a Frame": lambda: joint(np.zeros(3)),
    r"frame: R: shape \(4,\).*quaternion": lambda: c.Frame([0, 0, 0], [1, 0, 0, 0]),
    r"mechanism 'm': gravity: shape \(\)": lambda: c.Mechanism("m", -9.81, (body(),), (joint(),)),
    r"mechanism 'm': bodies: it is a Body.*sequence of Body": lambda: c.Mechanism("m", [0, 0, 0], body(), ()),
    r"bodies\[0\]: it is a Joint, not a Body": lambda: c.Mechanism("m", [0, 0, 0], [joint()], [body()]),
    r"state: p_WB: shape \(3,\).*One row is one body": lambda: c.State(*np.zeros((4, 3))),
    r"state: quat_WB: shape \(1, 3\)": lambda: c.State(*np.zeros((4, 1, 3))),
    r"states: it is one state.*Give a list: \[state\]": lambda: require_states(HINGE, STATE),
    r"state: it has 1 bodies, mechanism .* has 3": lambda: c.accelerations(TWO, [STATE]),
    r"state: it is a list, not a State": lambda: c.simulate(HINGE, [STATE], np.arange(3.0)),
    r"mechanism: it is a Case.*case.mechanism": lambda: c.initial_state(c.load_case("double_pendulum")),
    r"case: it is a NoneType": lambda: c.load_case(None),
    r"initial: it is a dict.*Give Initial": lambda: c.initial_state(HINGE, {"j0": {"angle": 1.0}}),
    r"initial.joints: joint 'j0': it is a float.*by coordinate: angle": lambda: start(HINGE, coordinates=1.0),
    r"joint 'j0': angle: it is no array of numbers": lambda: start(HINGE, coordinates={"angle": "a"}),
    r"joint 'j0': orientation: shape \(3,\).*quaternion": lambda: start(BALL, coordinates={"orientation": [0, 0, 1]}),
    r"joint 'j0': orientation: shape \(4,\).*angular vel": lambda: start(BALL, rates={"orientation": [1, 0, 0, 0]}),
    r"a spherical joint has no 'angular_velocity'.*orientation": lambda: start(
        BALL, coordinates={"angular_velocity": [0, 0, 1]}
    ),
    r"joint 'j0': orientation: the quaternion has norm 2.*unit": lambda: start(
        BALL, coordinates={"orientation": [2, 0, 0, 0]}
    ),
    r"the matrix is not a rotation": lambda: start(BALL, coordinates={"orientation": 2.0 * np.eye(3)}),
    r"velocities: body 'b0': shape \(3,\).*v_WB_W, then": lambda: c.initial_state(
        HINGE, c.Initial(velocities={"b0": [0, 0, 1]})
    ),
    r"poses: body 'b0': it is a ndarray": lambda: c.initial_state(HINGE, c.Initial(poses={"b0": np.zeros(3)})),
    r"drive 'd': motion: it is a float.*Function\(polynomial": lambda: c.Drive("d", "pin", "angle", 1.0),
    r"coupling 'c': law: it is a float": lambda: c.Coupling("c", "a", "angle", "b", "angle", 2.0),
    r"spring 's': point_predecessor: shape": lambda: c.Spring("s", "ground", "arm", 0.0, [0, 0, 0], 1.0, 0.0, 1.0),
    r"cases: it is one str.*sequence of Case": lambda: c.run_suite("double_pendulum", []),
    r"cases: it is a str, not a Case": lambda: c.run_suite(["double_pendulum"], []),
    r"cases: there are none": lambda: c.compare([]),
    r"case 'double_pendulum': 2 cases have this name.*of its own": lambda: c.compare(
        2 * [c.load_case("double_pendulum")], ["reference"]
    ),
    r"integrator 'taylr': relative takes none.*Nearest: taylor. Integrators: rkf45.* gauss": lambda: c.simulate(
        HINGE, STATE, np.arange(3.0), integrator="taylr"
    ),
    r"integrator 'taylor': lagrange takes none.*bdf\.": lambda: c.simulate(
        HINGE, STATE, np.arange(3.0), formulation="lagrange", integrator="taylor"
    ),
    r"engines: it is one str": lambda: c.run_suite([c.load_case("double_pendulum")], "an engine"),
    r"engine: it is a NoneType": lambda: c.load_engine(None),
    r"tolerance: 'fine' is no number.*1e-12": lambda: c.simulate(HINGE, STATE, [0.0, 1.0], "fine"),
    r"forces: 3 is no function": lambda: c.simulate(HINGE, STATE, [0.0, 1.0], forces=3),
    r"integrator '3': relative takes none": lambda: c.simulate(HINGE, STATE, [0.0, 1.0], integrator=3),
    r"parameters: it is a list, not a Mapping": lambda: c.study(c.load_case("double_pendulum"), ["gravity[2]"]),
    r"parameter 'gravity\[2\]': it is no array of numbers": lambda: c.study(
        c.load_case("double_pendulum"), {"gravity[2]": [1j]}
    ),
    r"states: it is a int, not an Iterable": lambda: c.simulate_many(HINGE, 3),
    r"contact 'floor': the compiled model of many.*one by one: \[consilience.simulate": lambda: c.simulate_many(
        c.load_case("bouncing_sphere"), c.load_case("bouncing_sphere").initial_state
    ),
    r"duration: inf is out of range": lambda: c.Case.of(HINGE, duration=np.inf),
    r"duration: 'long' is no number": lambda: c.Case.of(HINGE, duration="long"),
    r"count: 1.5 is no integer": lambda: c.random_states(HINGE, STATE, 1.5, 1),
    r"seed: 'a' is no integer": lambda: c.random_states(HINGE, STATE, 1, "a"),
    r"speed: nan is out of range": lambda: c.random_states(HINGE, STATE, 1, 1, np.nan),
    r"function: polynomial: it is no array of numbers": lambda: c.constant("a"),
    r"function: harmonics: it is no array of numbers": lambda: c.sine("a", 1.0),
    r"table: x: it is no array of numbers": lambda: c.through("abc", np.arange(6.0)),
    r"body 'arm': com: it is no array of numbers": lambda: body(com=["0", "0", "1"]),
    r"state of mechanism.*joint 'j0', constraint . is violated": lambda: c.accelerations(
        HINGE, replace(STATE, p_WB=STATE.p_WB + 0.1)
    ),
    r"state of mechanism.*joint 'j0', constraint . has a wrong rate": lambda: c.accelerations(
        HINGE, replace(STATE, v_WB_W=STATE.v_WB_W + 0.1), "relative"
    ),
    r"joint 'r': length: the ends of the rod coincide": lambda: c.Joint("r", "rod", "ground", "arm", HERE, HERE, 0.0),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_an_argument_needs_is_said(message):
    with pytest.raises(InvalidInput, match=message):
        REFUSED[message]()


@pytest.mark.parametrize("name", ["double_pendulum", "bouncing_sphere"])
@pytest.mark.parametrize(
    ("times", "what"),
    [
        *((given, "it is no array of numbers") for given in ("abc", ["a"], ["0", "1"], [False, True], [0.0, 1j], {})),
        *((given, "it is no array of numbers") for given in ([[0.0], [1.0, 2.0]], object())),
        *((given, "they have shape") for given in (1.0, [[0.0, 1.0], [2.0, 3.0]])),
        *((given, "they do not increase") for given in ([], [1.0, 0.0], [0.0, 0.0], [0.0, np.nan], [0.0, np.inf])),
    ],
)
def test_times_are_finite_increasing_numbers(name, times, what):
    with pytest.raises(InvalidInput, match=f"^times: {what}.*Give finite, increasing sample times in s"):
        c.simulate(c.load_case(name), times=times)


@pytest.mark.parametrize("name", ["double_pendulum", "bouncing_sphere"])
@pytest.mark.parametrize("t", ["0", None, 1j, [1.0, 2.0], np.nan, np.inf])
def test_the_time_of_an_instant_is_a_finite_number(name, t):
    with pytest.raises(InvalidInput, match=r"^t: .* is (no number|out of range). Give a time in s"):
        c.accelerations(c.load_case(name), t=t)


CASE = """title = "t"
sources = ["s"]
gravity = [0.0, 0.0, -9.81]
body = [{ name = "a", mass = 1.0, at = [0.0, 0.0, 0.0], inertia = { xx = 1.0, yy = 1.0, zz = 1.0 } }]
joint = [{ name = "j", predecessor = "ground", successor = "a", at = [0.0, 0.0, 0.0], %s }]
trajectory = { duration = 1.0 }
"""


def test_a_case_is_loaded_from_a_path(tmp_path, monkeypatch):
    path = tmp_path / "ball"
    path.write_text(CASE % 'kind = "spherical"')
    assert c.load_case(path).mechanism.joints[0].kind == "spherical"
    monkeypatch.chdir(tmp_path)
    assert c.load_case(Path("ball")).mechanism.joints[0].name == "j"


@pytest.mark.parametrize(
    ("joint", "more", "message"),
    [
        ('kind = "rod", to = [0.0, 0.0, 0.0]', "", r"joint 'j': to: the ends of the rod coincide"),
        (
            'kind = "spherical"',
            "[initial.rates]\nj = { orientation = [1.0, 0.0, 0.0] }",
            r"under rates an angular_velocity",
        ),
    ],
)
def test_a_case_file_says_what_was_meant(tmp_path, joint, more, message):
    path = tmp_path / "case.toml"
    path.write_text(CASE % joint + more)
    with pytest.raises(InvalidInput, match=message):
        load_file(path)
