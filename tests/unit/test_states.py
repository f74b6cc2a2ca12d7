"""Compiled single states, and parameter sets that share arrays: as in NumPy, and as mechanisms of their own."""

from dataclasses import replace

import numpy as np
import pytest

import consilience.mechanism as plain
from consilience.case import load_case
from consilience.errors import CannotAssemble
from consilience.mechanism import JOINT_KINDS, Frame, Initial, in_units, quaternion_from_rotation_vector
from consilience.mechanism import rotation_from_quaternion as rotation
from consilience.reference import accelerations, formulation, initial_state, simulate, solver
from consilience.reference.analyses import with_parameter
from consilience.reference.states import assembly
from consilience.reference.states.instants import instants
from consilience.reference.tree.parameter_sets import OtherStructure, ParameterSets
from mechanisms import ELEMENTS, LOOPS, TREES, chain, states_of

ALL = TREES | LOOPS | ELEMENTS


def drawn_off(mechanism, rng):
    """Poses of the bodies a little off their joints, and velocities that break them."""
    poses, velocities = {}, {}
    for body in mechanism.bodies:
        turn = rotation(quaternion_from_rotation_vector(3e-4 * rng.normal(size=3)))
        poses[body.name] = Frame(body.drawing.p + 3e-4 * rng.normal(size=3), turn @ body.drawing.R)
        velocities[body.name] = rng.normal(size=3), rng.normal(size=3)
    return poses, velocities


def held(mechanism):
    """Coordinates of the first joint, off the drawing; none where elements hold them."""
    joint = mechanism.joints[0]
    if mechanism.drives or mechanism.rollings or joint.pitch:
        return {}
    values = {"position": [0.1, 0.05, -0.1], "orientation": [0.96, 0.0, 0.28, 0.0]}
    return {joint.name: {name: values.get(name, 0.1) for name in JOINT_KINDS[joint.kind].coordinates}}


@pytest.mark.parametrize("name", ALL)
def test_compiled_assembly_is_that_in_numpy(name, monkeypatch):
    """The same least displacement and change of velocities, by rows about other points."""
    mechanism, rng = ALL[name], np.random.default_rng(3)
    poses, velocities = drawn_off(mechanism, rng)
    initial = Initial(coordinates=held(mechanism), poses=poses, velocities=velocities)
    expected = plain.initial_state(mechanism, initial)
    monkeypatch.setattr(assembly, "assemble", None)  # the compiled method itself
    found = initial_state(mechanism, initial)
    for field in ("p_WB", "R_WB", "v_WB_W", "w_WB_W"):
        assert np.allclose(getattr(found, field), getattr(expected, field), rtol=0.0, atol=1e-9), field


def test_compiled_assembly_takes_long_steps_on_a_long_way(monkeypatch):
    """A body of some millimetres on a slide of 500 m."""
    mechanism = in_units(chain("prismatic", seed=97), length=3e-3)
    initial = Initial(coordinates={"j0": {"distance": 500.0}})
    expected = plain.initial_state(mechanism, initial)
    monkeypatch.setattr(assembly, "assemble", None)
    np.testing.assert_allclose(initial_state(mechanism, initial).p_WB, expected.p_WB, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    "initial",
    [
        Initial(coordinates={"j0": {"angle": 2.0}, "j1": {"angle": -2.0}}),  # out of reach
        Initial(rates={"j0": {"angle": 1.0}, "j1": {"angle": 5.0}}),  # more rates than freedoms
    ],
)
def test_refusals_are_those_of_the_method_in_numpy(initial):
    mechanism = LOOPS["four_bar"]
    with pytest.raises(CannotAssemble) as expected:
        plain.initial_state(mechanism, initial)
    with pytest.raises(CannotAssemble) as found:
        initial_state(mechanism, initial)
    assert str(found.value) == str(expected.value)
    assert initial_state(mechanism).p_WB.shape == (3, 3), "the next answer does not know of it"


@pytest.mark.parametrize("name", ALL)
def test_compiled_instants_are_those_of_the_formulation_state_by_state(name):
    """Accelerations, reactions of least norm, and energies of NumPy; nothing is in doubt."""
    mechanism, states = ALL[name], states_of(ALL[name], 3)
    found, sound = instants(mechanism, states, 0.3)
    assert sound.all()
    equations = formulation("descriptor", mechanism)
    for n, state in enumerate(states):
        expected = [*equations.accelerations(state, 0.3), *equations.reactions(state, 0.3)]
        for field, value in zip(("a_WB_W", "alpha_WB_W", "force_F", "torque_F"), expected, strict=True):
            assert np.allclose(
                getattr(found, field)[n], value, rtol=1e-9, atol=1e-9 * max(1.0, np.max(np.abs(value)))
            ), field
        assert found.kinetic[n] == pytest.approx(plain.kinetic_energy(mechanism, state), rel=1e-12)
        assert found.potential[n] == pytest.approx(plain.potential_energy(mechanism, state), rel=1e-12, abs=1e-12)


def test_a_state_in_doubt_is_left_to_the_formulation(monkeypatch):
    """It alone, and its answer is that of the formulation."""
    mechanism, states, asked = LOOPS["four_bar"], states_of(LOOPS["four_bar"], 3), []
    expected, _ = instants(mechanism, states, 0.0)
    own = solver._accelerations

    def doubted(mechanism, states, t):
        return replace(expected, a_WB_W=np.zeros_like(expected.a_WB_W)), np.array([True, False, True])

    monkeypatch.setattr("consilience.reference.states.instants.instants", doubted)
    monkeypatch.setattr(solver, "_accelerations", lambda m, s, *more: asked.append(s) or own(m, s, *more))
    found = accelerations(mechanism, states)
    assert asked == [[states[1]]]
    assert np.allclose(found.a_WB_W[1], expected.a_WB_W[1], atol=1e-9)
    assert not found.a_WB_W[0].any()


CHANGES = {
    "four_bar": {"body.coupler.mass": (0.5, 3.0), "body.crank.com[1]": (-0.1, 0.2)},
    "loop_spherical": {"body.b.inertia[0,1]": (0.01, -0.01), "gravity[1]": (-9.0, 3.0)},
    "forced_chain": {"body.b2.mass": (0.5, 3.0), "joint.j2.F.p[0]": (0.1, -0.2), "spring.s.stiffness": (5.0, 50.0)},
    "driven": {"body.b1.com[0]": (0.1, -0.2), "joint.j1.M.turn[1]": (0.3, -0.4)},
    "skating": {"body.b1.com[0]": (0.1, -0.2), "skate.edge.point[1]": (0.3, -0.4)},
}
"""Parameters of planar and spatial mechanisms, with and without loops and elements."""


@pytest.mark.parametrize("name", CHANGES)
def test_a_parameter_set_moves_as_a_mechanism_of_its_own(name):
    """In any order: nothing of one set is left in the arrays for the next."""
    mechanism, times = ALL[name], np.linspace(0.0, 0.4, 5)
    changed = [with_parameter(mechanism, path, value) for path, values in CHANGES[name].items() for value in values]
    states = [plain.initial_state(m) for m in changed]
    sets = ParameterSets(mechanism, changed)
    for n in [*range(len(changed)), 0]:
        sets.select(n)
        found = sets.simulate(states[n], times, 1e-10)
        expected = simulate(changed[n], states[n], times, 1e-10, "relative")
        assert np.allclose(found.p_WB, expected.p_WB, rtol=0.0, atol=1e-8), n
        assert np.allclose(found.w_WB_W, expected.w_WB_W, rtol=0.0, atol=1e-7), n


def test_a_set_that_leaves_the_plane_of_the_first_is_another_structure():
    mechanism = load_case("double_pendulum").mechanism
    with pytest.raises(OtherStructure):
        ParameterSets(mechanism, [with_parameter(mechanism, f"joint.{mechanism.joints[1].name}.F.turn[0]", 0.1)])
