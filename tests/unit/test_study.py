"""Studies: many parameter sets and many states by one model, against closed forms and mechanisms of their own."""

import io
import sys

import numpy as np
import pytest

import consilience as cs
from consilience.errors import InvalidInput
from consilience.reference.analyses import parameter, with_parameter

AXIS = np.array([2.0, -1.0, 2.0]) / 3.0


def slider(*, spring=True):
    """A mass on a skew rail, released at 0.4 m without gravity."""
    draw = cs.Drawing("slider", gravity=(0.0, 0.0, 0.0))
    draw.body("mass", mass=2.0, com=(0.1, 0.2, 0.3), inertia=(0.1, 0.2, 0.25))
    draw.joint("rail", "prismatic", "ground", "mass", at=(0.3, 0.1, -0.2), axis=AXIS)
    if spring:
        draw.add("joint_spring", "spring", joint="rail", coordinate="distance", stiffness=50.0, damping=0.0, rest=0.0)
    return draw.case(start={"rail": 0.4}, duration=1.0, sample=0.1)


def pendulum():
    draw = cs.Drawing("double", gravity=(0.0, 0.0, -9.81))
    draw.body("upper", cs.bar((0, 0, 0), (0, 0, -1), radius=0.02), density=2700)
    draw.body("lower", cs.bar((0, 0, -1), (0, 0, -1.8), radius=0.02), density=2700)
    draw.joint("shoulder", "revolute", "ground", "upper", at=(0, 0, 0), axis=(0, 1, 0))
    draw.joint("elbow", "revolute", "upper", "lower", at=(0, 0, -1), axis=(0, 1, 0))
    return draw.case(start={"shoulder": 0.8}, duration=0.5, sample=0.1)


def test_sliders_on_springs_swing_at_the_root_of_stiffness_over_mass():
    """x = 0.4 cos(sqrt(k / m) t), for all combinations, and through the names of an xarray."""
    k, m = np.array([20.0, 50.0, 0.0]), np.array([0.5, 3.0])
    study = cs.study(slider(), {"spring.stiffness": k, "mass.mass": m}, tolerance=1e-11)
    x = 0.4 * np.cos(np.sqrt(k[:, None, None] / m[:, None]) * study.time)
    assert (study.shape, study.failures, study.rebuilt) == ((3, 2), {}, ())
    assert study.coordinates("rail") == pytest.approx(x, abs=1e-9)
    p = study.to_xarray().p_WB.sel({"spring.stiffness": 50.0, "mass.mass": 3.0, "body": "mass"})
    assert p.dims == ("time", "axis")
    assert (p.values - p.values[0]) @ AXIS == pytest.approx(x[1, 1] - 0.4, abs=1e-9)
    assert study.values(3) == {"spring.stiffness": 50.0, "mass.mass": 3.0}
    assert study.motion(3).mechanism.bodies[0].mass == 3.0
    assert study.motion(3).coordinates("rail") == pytest.approx(x[1, 1], abs=1e-9)


def test_many_states_of_one_slider_and_rows_of_values():
    case = slider()
    starts = [cs.initial_state(case.mechanism, cs.Initial({"rail": {"distance": x}})) for x in (0.1, -0.2)]
    motions = cs.simulate_many(case, starts, tolerance=1e-11)
    x = np.cos(5.0 * motions.time)
    assert motions.coordinates("rail") == pytest.approx(np.array([0.1 * x, -0.2 * x]), abs=1e-9)
    one = cs.simulate_many(case, starts[1], tolerance=1e-11)  # a state is a list of one
    assert np.array_equal(one.coordinates("rail"), motions.coordinates("rail")[1:])
    rows = {"initial.coordinates.rail.distance": [0.1, -0.2], "mass.mass": [2.0, 8.0]}
    study = cs.study(case, rows, tolerance=1e-11, paired=True)
    expected = np.array([0.1 * x, -0.2 * np.cos(2.5 * motions.time)])
    assert study.coordinates("rail") == pytest.approx(expected, abs=1e-9)
    assert study.to_xarray().sizes["set"] == 2


def test_the_effect_of_gravity_on_a_fall_is_half_the_time_squared(tmp_path):
    """Linear in the parameter: x = 0.4 + g t^2 / 2 along the rail, so regression is exact."""
    g = np.array([-9.0, -5.0, -1.0])
    study = cs.study(slider(spring=False), {"gravity[0]": g, "mass.mass": [1.0, 2.0]}, tolerance=1e-11)
    figure = study.plot("rail")
    bands, effects = figure.axes
    (gravity, mass) = effects.get_lines()
    assert (gravity.get_label(), mass.get_label()) == ("gravity[0]", "mass.mass")
    assert gravity.get_ydata() == pytest.approx(0.5 * AXIS[0] * np.std(g) * study.time**2, abs=1e-9)
    assert np.allclose(mass.get_ydata(), 0.0, atol=1e-9)
    (median,) = bands.get_lines()
    assert median.get_ydata() == pytest.approx(0.4 - 2.5 * AXIS[0] * study.time**2, abs=1e-9)
    figure.savefig(tmp_path / "study.svg")


def test_a_set_of_another_structure_or_without_assembly_costs_the_others_nothing():
    """An elbow that is turned leaves the plane; a rocker of 50 m closes no loop."""
    case = pendulum()
    study = cs.study(case, {"elbow.F.turn[0]": [0.0, 0.3, 0.0, -0.2]})
    assert study.rebuilt == (1, 3)
    for n in range(4):
        alone = with_parameter(case, "joint.elbow.F.turn[0]", study.values(n)["elbow.F.turn[0]"])
        expected = cs.simulate(alone, tolerance=1e-11)
        assert np.allclose(study.motion(n).p_WB, expected.p_WB, rtol=0.0, atol=1e-7)
    loop = cs.load_case("four_bar").with_span(0.5, 0.1)
    path = f"joint.{loop.mechanism.joints[-1].name}.M.p[0]"
    value = parameter(loop, path)
    study = cs.study(loop, {path: [value, 50.0, value]})
    assert list(study.failures) == [1]
    assert "stays violated" in study.failures[1]
    assert np.isnan(study.coordinates(loop.mechanism.joints[0].name)[1]).all()
    expected = cs.simulate(loop, tolerance=1e-11)
    assert np.allclose(study.motion(2).p_WB, expected.p_WB, rtol=0.0, atol=1e-7)
    with pytest.raises(InvalidInput, match="set 1: it has no motion"):
        study.motion(1)


def test_a_place_moves_both_frames_of_a_joint():
    """The drawing stays assembled, and the other coordinates of the place stay."""
    mechanism = with_parameter(pendulum().mechanism, "elbow.place[2]", -0.7)
    assert [parameter(mechanism, f"elbow.place[{k}]") for k in range(3)] == pytest.approx([0.0, 0.0, -0.7])
    state = cs.initial_state(mechanism)
    assert np.allclose(state.p_WB, [body.drawing.p for body in mechanism.bodies], atol=1e-15)
    elbow = mechanism.joints[1]
    assert np.allclose(elbow.F.p, [0.0, 0.0, -0.7])
    assert np.allclose(elbow.M.p, [0.0, 0.0, -0.7])


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"uper.mass": [1.0]}, "Nearest: upper.mass"),
        ({"elbow.place": [1.0]}, "Nearest: elbow.place"),
        ({"upper.mass": [1.0, -1.0]}, "parameter 'upper.mass' = -1: body 'upper': mass: -1.0 kg is not positive"),
        ({"upper.mass": ["heavy"]}, "no array of numbers"),
        ({"upper.mass": []}, "no list of finite numbers"),
        ({}, "there are none"),
    ],
)
def test_a_wrong_parameter_is_refused_by_name(parameters, words):
    with pytest.raises(InvalidInput, match=words):
        cs.study(pendulum(), parameters)


def test_rows_of_different_lengths_are_refused():
    with pytest.raises(InvalidInput, match=r"upper.mass has 2, lower.mass has 1 values"):
        cs.study(pendulum(), {"upper.mass": [1.0, 2.0], "lower.mass": [1.0]}, paired=True)


def test_progress_is_shown_where_somebody_waits(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    for screen, kernel, patience, shown in (
        (Terminal(), False, -1.0, "\r3 of 3 motions\n"),
        (Terminal(), False, 1e3, ""),
        (io.StringIO(), True, -1.0, "\r3 of 3 motions\n"),  # in a notebook
        (io.StringIO(), False, -1.0, ""),
    ):
        monkeypatch.setattr(cs, "_PATIENCE", patience)
        monkeypatch.setattr("sys.stderr", screen)
        monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
        if kernel:
            monkeypatch.setitem(sys.modules, "ipykernel", sys)
        study = cs.study(slider(), {"mass.mass": [1.0, 2.0, 3.0]})
        assert screen.getvalue().endswith(shown)
        assert bool(screen.getvalue()) is bool(shown)
    assert "3 motions of 'slider', 1 s each, over 3 values of mass.mass" in repr(study)
