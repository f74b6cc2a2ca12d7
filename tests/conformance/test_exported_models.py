"""Native models that adapters export, run by the engine alone in a new process."""

from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("exudyn")
pytest.importorskip("pinocchio")
pytest.importorskip("mujoco")
pytest.importorskip("dartpy")

import exported
import truth
from consilience.case import load_case
from consilience.cli.commands.translate import translate
from consilience.cli.native_files import exporter, native_files, write_native
from consilience.engine.native import JET, function_data, literal, script
from consilience.errors import InvalidInput
from consilience.mechanism import (
    State,
    constraint_jacobian,
    constraint_rates,
    constraint_residual,
    count_turns,
    elementary_rotation,
    euler_parameter_matrix,
    rotation_from_quaternion,
    sine,
    through,
)
from consilience_pinocchio.export import roll_pitch_yaw
from mechanisms import ELEMENTS, TREES, states_of

BAR = exported.BAR
ENGINES = ("mujoco", "pinocchio", "dart", "exudyn")

CASES = (
    "single_universal",  # massless links
    "stewart_platform",  # loops
    "robot_arm",  # controllers with integrals
    "rolling_disc",
    "four_bar_driven",  # a drive in a loop
)
LUMPY = ("hardening_chain", "powered", "coupled", "rolling_torus", "rolling_disc", "skating", "backward_screw")


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("engine", ENGINES)
def test_an_exported_model_accelerates_as_through_the_adapter(tmp_path, engine, name):
    case = load_case(name)
    state = case.initial_state if name == "four_bar_driven" else case.states[1]
    assert exported.difference(case, engine, state, tmp_path) < BAR


def test_angles_of_a_urdf_cost_stiff_springs_no_digits(tmp_path):
    case = load_case("flyball_governor")  # 8e5 N/m at a frame that angles turn by a rounding error: 8.9e-12
    assert exported.difference(case, "pinocchio", case.initial_state, tmp_path) < BAR


@pytest.mark.parametrize("name", LUMPY)
@pytest.mark.parametrize("engine", ENGINES)
def test_an_exported_model_accelerates_as_newton_and_euler_say(tmp_path, engine, name):
    mechanism = (TREES | ELEMENTS)[name]
    state = states_of(mechanism, 1)[0]
    write_native(exporter(engine)(name, mechanism, state), tmp_path)
    told = exported.results(tmp_path)
    a, alpha, _, _ = truth.solve(mechanism, state)
    scale = max(np.max(np.abs(a)), np.max(np.abs(alpha)))
    assert np.allclose([told[b.name]["a"] for b in mechanism.bodies], a, rtol=0.0, atol=1e-9 * scale)
    assert np.allclose([told[b.name]["alpha"] for b in mechanism.bodies], alpha, rtol=0.0, atol=1e-9 * scale)


GO_ON = """
simulation = exu.SimulationSettings()
simulation.timeIntegration.endTime = 0.1
simulation.timeIntegration.numberOfSteps = 160
simulation.timeIntegration.newton.useModifiedNewton = False
simulation.timeIntegration.newton.relativeTolerance = 1e-10
simulation.solution.file.write = False
simulation.timeIntegration.verboseMode = 0
assert SYSTEM.SolveDynamic(simulation)
DATA = SYSTEM.systemData
print(json.dumps([np.reshape(x, (-1, 7)).tolist() for x in (DATA.GetODE2Coordinates(), DATA.GetODE2Coordinates_t())]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["driven", "coupled", "rolling_torus", "skating", "backward_screw"])
def test_exudyn_goes_on_with_a_script_and_holds_what_is_held(tmp_path, name):
    mechanism = ELEMENTS[name]
    start = states_of(mechanism, 1)[0]
    text = exporter("exudyn")(name, mechanism, start)["run.py"]
    write_native({"run.py": text.partition("if __name__")[0] + GO_ON}, tmp_path)
    q, q_t = np.array(exported.results(tmp_path))
    quaternions = q[:, 3:] + [1.0, 0.0, 0.0, 0.0]  # unit length to the tolerance of Exudyn's solver
    turned = rotation_from_quaternion
    w = [turned(e) @ (2.0 * euler_parameter_matrix(e) @ e_t) for e, e_t in zip(quaternions, q_t[:, 3:], strict=True)]
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    state = State(q[:, :3], quaternions, q_t[:, :3], np.array(w))
    assert np.max(np.abs(state.p_WB - start.p_WB)) > 1e-3
    angles = count_turns(mechanism, start, {})
    assert np.max(np.abs(constraint_residual(mechanism, state, 0.1, angles)), initial=0.0) < 1e-6
    speeds = np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
    # generalized-alpha of index 3 holds poses to rounding, and velocities with order two in the step
    slip = constraint_jacobian(mechanism, state, t=0.1) @ speeds - constraint_rates(mechanism, 0.1)
    assert np.max(np.abs(slip)) < 1e-4


def test_numbers_of_an_mjcf_have_all_their_digits():
    mechanism = TREES["single_revolute"]
    root = ElementTree.fromstring(exporter("mujoco")("t", mechanism, states_of(mechanism, 1)[0])["model.xml"])
    assert float(root.find(".//inertial").get("mass")) == mechanism.bodies[0].mass
    assert [float(x) for x in root.find("option").get("gravity").split()] == list(mechanism.gravity)


URDF = {"single_revolute": True, "single_free": True, "single_cylindrical": True, "single_spherical": False}


@pytest.mark.parametrize("name", URDF)
def test_a_tree_without_balls_has_a_urdf(name):
    mechanism = TREES[name]
    assert ("model.urdf" in exporter("pinocchio")("t", mechanism, states_of(mechanism, 1)[0])) == URDF[name]


@pytest.mark.parametrize("pitch", [0.3, np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9])
def test_angles_of_a_urdf_give_the_rotation_back(pitch):
    R = elementary_rotation(2, 0.7) @ elementary_rotation(1, pitch) @ elementary_rotation(0, -1.9)
    roll, tilt, yaw = roll_pitch_yaw(R)
    back = elementary_rotation(2, yaw) @ elementary_rotation(1, tilt) @ elementary_rotation(0, roll)
    assert np.max(np.abs(back - R)) < 1e-15


X = np.linspace(0.0, 2.0, 9)


@pytest.mark.parametrize("function", [sine(1.3, 2.0, 0.4), through(X, X**3 - X), through(X, np.sin(np.pi * X), True)])
def test_functions_of_a_script_are_those_of_the_mechanism(function):
    scope = {}
    exec("import math\n" + JET + f"\nf = {literal(function_data(function))}\n", scope)
    for x in (0.0, 0.31, 1.2, 2.0, *([-0.7, 5.3] if function.table is None or function.table.periodic else [])):
        assert np.allclose(scope["jet"](scope["f"], x), function.jet(x), rtol=1e-13, atol=1e-13)


def test_a_title_cannot_end_the_text_of_a_script():
    scope = {}
    exec(script('a""" + 1 \\', "", {"A": np.float64(0.1)}), scope)
    assert scope["A"] == 0.1


def test_what_an_engine_does_not_know_is_refused():
    with pytest.raises(InvalidInput, match="contact"):
        native_files(load_case("bouncing_sphere"), "mujoco")
    with pytest.raises(InvalidInput, match="writes no native models"):
        native_files(load_case("double_pendulum"), "reference")
    with pytest.raises(InvalidInput, match="not installed"):
        native_files(load_case("double_pendulum"), "nothing")


def test_the_command_writes_the_model_with_its_manifest_and_overwrites_nothing(tmp_path, capsys):
    translate("double_pendulum", "pinocchio", tmp_path / "model")
    assert {p.name for p in (tmp_path / "model").iterdir()} == {"run.py", "model.urdf", "manifest.md"}
    assert "run.py" in capsys.readouterr().out
    manifest = (tmp_path / "model" / "manifest.md").read_text()
    assert "for Pinocchio " in manifest
    assert "python run.py" in manifest
    with pytest.raises(InvalidInput, match="something in it"):
        translate("double_pendulum", "pinocchio", tmp_path / "model")


def test_the_table_of_all_cases_has_a_row_for_each(capsys):
    assert exported.main(["mujoco", "double_pendulum", "bouncing_sphere"]) == 0
    told = capsys.readouterr()
    rows = told.out.splitlines()[2:]
    assert rows[0].startswith("| double_pendulum | ")
    assert "contact 'floor'" in rows[1]
    assert told.err.startswith("1 of 2 cases written; the largest difference is ")


def test_an_exported_model_that_differs_fails_the_table_of_all_cases(monkeypatch, capsys):
    monkeypatch.setattr(exported, "difference", lambda *_: 1.1 * BAR)
    assert exported.main(["mujoco", "double_pendulum"]) == 1
    with pytest.raises(SystemExit, match="2"):
        exported.main(["nowhere"])
    assert "it is not installed" in capsys.readouterr().err
