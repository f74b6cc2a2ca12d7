"""Joint springs and dampers with coefficients of higher degree: their law, and all that is derived from the law."""

import json
import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from scipy.optimize import brentq

from consilience.audit.fuzz.population import read_text, with_nonlinear_springs
from consilience.audit.fuzz.reductions import AS_IS, knobs, simplified
from consilience.case import load_case
from consilience.case.file.reader import load_file
from consilience.case.file.schema import CaseTable
from consilience.case.file.writer import case_text
from consilience.compare.energies import energies_over_time
from consilience.engine import Question
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Friction,
    Function,
    Initial,
    JointSpring,
    Mechanism,
    applied_wrenches,
    conservative_part,
    fastest_rate,
    initial_state,
    joint_spring_motion,
    potential_energy,
    rough_dampers,
    spring_damper_law,
)
from consilience.mechanism.perturbation import physical_parameters
from consilience.mechanism.units import Units, in_units
from consilience.reference import accelerations, simulate
from consilience.reference.analyses import (
    linearise,
    linearise_steady_motion,
    parameter_paths,
    static_equilibrium,
    trajectory_sensitivity,
    with_parameter,
)
from consilience.reference.engine import ReferenceEngine
from consilience.report.anatomy import fastest
from consilience.report.summary import describe_case
from mechanisms import TREES, drawn_joint, four_bar, lumpy_body, rotation, slider_crank, states_of
from oracles.closed_forms.nonlinear_springs import cubic

HARDENING = TREES["hardening_chain"]
AXES = ((0, "angle"), (1, "distance"), (2, "angle"))
NONE = {"higher_stiffness": (), "higher_damping": ()}
K, K1, K2, C, C1, C2, REST = 3.0, 2.0, 5.0, 0.1, 0.5, 0.7, 0.2


def spring(joint: str = "pin", coordinate: str = "angle", **changed) -> JointSpring:
    given = {"stiffness": K, "damping": C, "rest": REST, "higher_stiffness": (K1, K2), "higher_damping": (C1, C2)}
    return JointSpring(f"on_{joint}", joint, coordinate, **(given | changed))


def rotor(*springs: JointSpring, gravity=(0.0, 0.0, 0.0), **elements) -> tuple[Mechanism, float]:
    """Return a lumpy body on a skew pin, and its moment of inertia about the pin."""
    rng = np.random.default_rng(71)
    body = lumpy_body("rotor", rng)
    axes = rotation(rng)
    pin = drawn_joint("pin", "revolute", {"rotor": body}, GROUND, "rotor", np.array([0.3, -0.2, 0.5]), axes)
    axis, arm = body.drawing.R.T @ axes[:, 2], body.com - pin.M.p
    moment = axis @ body.inertia @ axis + body.mass * (arm @ arm - (arm @ axis) ** 2)
    return Mechanism("rotor", np.array(gravity), (body,), (pin,), joint_springs=springs, **elements), float(moment)


def placed(mechanism: Mechanism, angle: float, rate: float = 0.0):
    return initial_state(mechanism, Initial({"pin": {"angle": angle}}, {"pin": {"angle": rate}}))


# ---------------------------------------------------------------- law


@pytest.mark.parametrize(
    ("x", "v", "effort"),
    [
        # by hand; MuJoCo 4.0.0 gives the same for stiffness="3 2" and damping=".1 .5"
        (-0.2, 0.0, 3.0 * 0.2 - 2.0 * 0.04),
        (0.2, 0.0, -3.0 * 0.2 - 2.0 * 0.04),
        (0.0, 0.7, -(0.1 + 0.5 * 0.7) * 0.7),
        (0.0, -0.7, (0.1 + 0.5 * 0.7) * 0.7),
    ],
)
def test_the_part_of_k1_is_even_and_dampers_are_odd(x, v, effort):
    assert spring_damper_law(x, v, (3.0, 2.0, 0.0), (0.1, 0.5, 0.0))[0] == pytest.approx(effort, rel=1e-15)


@pytest.mark.parametrize("v", [-0.8, 0.0, 0.6])
def test_the_damping_is_minus_the_slope(v):
    laws, h = spring().laws, 1e-5
    ahead, behind = (spring_damper_law(0.3, v + s * h, *laws)[0] for s in (1.0, -1.0))
    bar = 1e-9 + (C1 * h if v == 0.0 else 0.0)  # at zero |v| v has no second derivative
    assert spring_damper_law(0.3, v, *laws)[1] == pytest.approx((behind - ahead) / (2.0 * h), abs=bar)


def test_the_potential_is_the_integral_of_the_effort():
    """``V(q) - V(q0) = - integral of the effort``, by Gauss quadrature, which is exact for a cubic."""
    own, q = spring(), -0.9
    x, w = leggauss(4)
    middle, half = 0.5 * (REST + q), 0.5 * (q - REST)
    work = half * sum(
        b * spring_damper_law(middle + half * a - REST, 0.0, *own.laws)[0] for a, b in zip(x, w, strict=True)
    )
    assert own.potential(q) == pytest.approx(-work, rel=1e-14)
    assert own.potential(np.array([REST, q])) == pytest.approx([0.0, -work], rel=1e-14)


@pytest.mark.parametrize(
    ("given", "what"),
    [
        ({"higher_stiffness": (1.0, 2.0, 3.0)}, "higher_stiffness: there are 3 coefficients"),
        ({"higher_damping": (1.0, math.nan)}, "higher_damping: .* is not finite"),
        ({"higher_damping": 0.5}, "higher_damping: 0.5 is no sequence of numbers"),
        ({"higher_stiffness": ["a"]}, "higher_stiffness: .* is no sequence of numbers"),
    ],
)
def test_other_coefficients_are_refused(given, what):
    with pytest.raises(InvalidInput, match=f"joint spring 'on_pin': {what}.* Give up to two finite numbers"):
        spring(**given)


def test_what_is_left_out_is_zero_and_a_softening_spring_is_a_spring():
    own = spring(higher_stiffness=[-1], higher_damping=())
    assert (own.higher_stiffness, own.laws) == ((-1.0,), ((K, -1.0, 0.0), (C, 0.0, 0.0)))
    assert [s.is_linear for s in (own, spring(higher_stiffness=(), higher_damping=(0.0,)))] == [False, True]


# ---------------------------------------------------------------- mechanisms


def linear_twin(mechanism: Mechanism, zeros: tuple[float, ...]) -> Mechanism:
    springs = (replace(s, higher_stiffness=zeros, higher_damping=zeros) for s in mechanism.joint_springs)
    return replace(mechanism, joint_springs=tuple(springs))


def test_coefficients_of_zero_leave_the_linear_spring_to_the_last_bit():
    plain, padded = (linear_twin(HARDENING, zeros) for zeros in ((), (0.0, 0.0)))
    state, times = states_of(plain, 1)[0], np.linspace(0.0, 0.3, 4)
    for formulation in ("relative", "descriptor"):
        one, other = (simulate(m, state, times, 1e-10, formulation) for m in (plain, padded))
        assert np.array_equal(one.p_WB, other.p_WB)
        assert np.array_equal(one.v_WB_W, other.v_WB_W)
    assert plain.features == padded.features
    assert "nonlinear joint spring" in HARDENING.features.keys() - plain.features.keys()


@pytest.mark.parametrize("base", [four_bar(), slider_crank()], ids=lambda m: m.name)
def test_planar_kernels_move_as_those_in_space(base):
    """The relative form of a planar loop has kernels of its own for springs; the descriptor form is in space."""
    last = base.joints[-1]
    along = spring(last.name, "distance" if last.kind == "prismatic" else "angle", stiffness=40.0)
    mechanism = replace(base, joint_springs=(spring(base.joints[0].name), along))
    state, times = states_of(mechanism, 2)[1], np.linspace(0.0, 0.4, 5)
    one, other = (simulate(mechanism, state, times, 1e-12, form) for form in ("relative", "descriptor"))
    assert np.max(np.abs(one.v_WB_W - other.v_WB_W)) < 1e-9 * np.max(np.abs(one.v_WB_W))


def test_energy_falls_by_what_dampers_take():
    """``d(T + V)/dt = - sum (c + c1 |v| + c2 v^2) v^2 + power of the loads``; here without loads."""
    mechanism = replace(HARDENING, loads=(), springs=())
    state = states_of(mechanism, 3)[2]
    answer = accelerations(mechanism, [state])
    force = applied_wrenches(mechanism, state).total
    kept = applied_wrenches(conservative_part(mechanism), state).total
    speeds = np.hstack([state.v_WB_W, state.w_WB_W])
    expected = 0.0
    for s in mechanism.joint_springs:
        _, v = joint_spring_motion(mechanism, state, s.joint, s.coordinate)
        c, c1, c2 = s.laws[1]
        expected -= (c + c1 * abs(v) + c2 * v * v) * v * v
    assert np.sum((force - kept) * speeds) == pytest.approx(expected, rel=1e-12)
    assert answer.potential[0] == pytest.approx(potential_energy(mechanism, state), rel=1e-13)


def test_a_motion_without_dampers_keeps_its_energy():
    mechanism = conservative_part(HARDENING)
    times = np.linspace(0.0, 1.0, 6)
    motion = simulate(mechanism, states_of(mechanism, 1)[0], times, 1e-12, "relative")
    kinetic, potential = energies_over_time(mechanism, motion, range(len(times)))
    assert np.ptp(potential) > 1.0
    assert np.max(np.abs(kinetic + potential - kinetic[0] - potential[0])) < 1e-9 * np.ptp(potential)


def test_rough_dampers_end_gauss_collocation_alone():
    assert [s.name for s in rough_dampers(HARDENING)] == ["k_j0", "k_j2"]
    state = states_of(HARDENING, 1)[0]
    with pytest.raises(InvalidInput, match="integrator: gauss cannot follow the damper of joint spring 'k_j0'"):
        simulate(HARDENING, state, np.array([0.0, 0.1]), 1e-10, "relative", "gauss")


def test_their_reference_motion_is_bounded_by_radau_in_place_of_gauss():
    engine, state, times = ReferenceEngine(), states_of(HARDENING, 2)[1], np.linspace(0.0, 0.5, 6)
    methods = {m.name: m for m in engine.methods(HARDENING, Question.TRAJECTORY)}
    assert list(methods) == ["relative", "null_space", "relative, Radau"]
    assert "relative, Gauss" in [m.name for m in engine.methods(linear_twin(HARDENING, ()), Question.TRAJECTORY)]
    motions = [engine.trajectory(HARDENING, state, times, methods[n], 1e-12) for n in ("relative", "relative, Radau")]
    assert np.max(np.abs(motions[0].v_WB_W - motions[1].v_WB_W)) < 1e-10


# ---------------------------------------------------------------- what is derived


def test_units_and_sense_of_the_coordinate():
    """The effort in new units, the opposite one in the opposite sense, is that of the converted coefficients."""
    units, sense = Units(2.0, 3.0, 0.7), {"j0": -1.0, "j1": -1.0}
    new = in_units(HARDENING, *units, sign=sense)
    for old, own in zip(HARDENING.joint_springs, new.joint_springs, strict=True):
        sign = sense.get(old.joint, 1.0)
        size = sign * (units.length if old.coordinate == "distance" else 1.0)
        x, v = 0.37, -0.83
        effort = units.mass * units.length**2 / units.time**2 / size * spring_damper_law(x, v, *old.laws)[0]
        found = spring_damper_law(size * x, size * v / units.time, *own.laws)[0]
        assert found == pytest.approx(effort, rel=1e-13)


def test_each_coefficient_is_a_parameter_and_may_be_wrong():
    own = HARDENING.joint_springs[0]
    named = [f"joint_spring.k_j0.higher_{name}[{n}]" for name in ("stiffness", "damping") for n in (0, 1)]
    assert [path for path in parameter_paths(HARDENING) if path.startswith("joint_spring.k_j0.higher")] == named
    changed = with_parameter(HARDENING, named[1], 9.0).joint_springs[0]
    assert (changed.higher_stiffness, changed.higher_damping) == ((own.higher_stiffness[0], 9.0), own.higher_damping)
    states = states_of(HARDENING, 1)
    wrong = {p.of: p for p in physical_parameters(HARDENING, states[0]) if "higher" in p.of}
    assert list(wrong)[:4] == [
        f"higher {name}[{n}] of joint spring 'k_j0'" for name in ("stiffness", "damping") for n in (0, 1)
    ]
    first = wrong["higher damping[0] of joint spring 'k_j0'"].perturbed(HARDENING, states, 0.1)[0].joint_springs[0]
    assert first.higher_damping == (0.9 * own.higher_damping[0], own.higher_damping[1])
    # coefficients that are zero are no parameters that may be wrong
    assert "higher stiffness[0] of joint spring 'k_j2'" not in wrong


def test_sensitivities_of_a_motion_are_those_of_its_closed_form():
    """To k2 of Duffing's oscillator, and to k1, which is zero: by a sixth-order difference of the closed form."""
    case, t = load_case("nonlinear_springs"), np.array([0.0, 1.0, 2.5])
    (mass, along), h = (case.mechanism.bodies[0].mass, np.array([2.0, -1.0, 2.0]) / 3.0), 0.5
    weights = {1: 0.75, 2: -0.15, 3: 1.0 / 60.0}
    steps = [(w * sign, n * sign * h) for n, w in weights.items() for sign in (1.0, -1.0)]
    slope = sum(w * cubic(mass, 20.0, 300.0 + dk, 0.4, t)[0] for w, dk in steps) / h
    paths = [f"joint_spring.hardening.higher_stiffness[{n}]" for n in (0, 1)]
    found = trajectory_sensitivity(case, lambda c: c.initial_state, t, paths, 1e-12)
    assert found.p_WB[1, :, 0] @ along == pytest.approx(slope, abs=1e-9)
    assert np.max(np.abs(found.p_WB[0, :, 0])) > 1e-3


@pytest.mark.parametrize("x", [-0.3, 0.0, 0.4])
def test_the_fastest_rate_is_that_of_the_tangent(x):
    mechanism, moment = rotor(spring(damping=0.0, higher_damping=()))
    tangent = np.sqrt((K + 2.0 * K1 * x + 3.0 * K2 * x**2) / moment)
    state = placed(mechanism, REST + x)
    assert fastest_rate(mechanism, state) == pytest.approx(tangent, rel=1e-7)
    assert fastest(mechanism, state) == (pytest.approx(tangent, rel=1e-12), "joint spring 'on_pin'")


def test_an_equilibrium_is_a_root_of_the_cubic_and_is_linearised_there():
    torque, friction = 1.7, Friction("f", "pin", "angle", 0.2, 0.6, 0.25)
    push = Function(np.array([torque]))
    mechanism, moment = rotor(spring(actuator=push), frictions=(friction,))
    x = brentq(lambda x: K * x + K1 * x**2 + K2 * x**3 - torque, 0.0, 2.0, xtol=1e-15)
    found = static_equilibrium(mechanism, placed(mechanism, 0.3))
    assert joint_spring_motion(mechanism, found, "pin", "angle")[0] == pytest.approx(REST + x, abs=1e-12)
    modes = linearise(mechanism, found)
    stiffness, damping = K + 2.0 * K1 * x + 3.0 * K2 * x**2, C + friction.viscous + friction.coulomb / friction.speed
    expected = np.roots([moment, damping, stiffness])
    assert np.sort_complex(modes.eigenvalues) == pytest.approx(
        np.sort_complex(expected[expected.imag >= 0.0]), rel=1e-8
    )


def test_a_steady_spin_decays_at_the_slope_of_the_damper():
    """``J w' = f - (c + c1 w + c2 w^2) w``: perturbations of the speed decay at ``(c + 2 c1 w + 3 c2 w^2) / J``."""
    w = 1.3
    push = Function(np.array([(C + C1 * w + C2 * w**2) * w]))
    mechanism, moment = rotor(spring(stiffness=0.0, higher_stiffness=(), actuator=push))
    found = linearise_steady_motion(mechanism, placed(mechanism, 0.0, w), [("pin", "angle")])
    decay = -(C + 2.0 * C1 * w + 3.0 * C2 * w**2) / moment
    assert np.min(found.eigenvalues.real) == pytest.approx(decay, rel=1e-9)


def test_random_mechanisms_get_some_and_stay_as_they_are_otherwise():
    base = replace(HARDENING, joint_springs=tuple(spring(f"j{n}", coordinate, **NONE) for n, coordinate in AXES))
    drawn = with_nonlinear_springs(base, 5, 1.0)
    assert [s.is_linear for s in drawn.joint_springs] == [False] * 3
    assert [s.laws for s in drawn.joint_springs] == [s.laws for s in with_nonlinear_springs(base, 5, 1.0).joint_springs]
    assert [(s.stiffness, s.damping, s.rest) for s in drawn.joint_springs] == [(K, C, REST)] * 3
    assert all(s.is_linear for s in with_nonlinear_springs(base, 5, 0.0).joint_springs)


@pytest.mark.parametrize(("choice", "stiffness"), [(0, 1.0), (1, [3.0, 2.0]), (2, [3.1, 2.5])])
def test_a_list_is_simplified_entry_by_entry_and_at_last_to_a_number(choice, stiffness):
    table = tomllib.loads(TOML.format(stiffness="[3.14, 2.46]", damping="0.1"))
    choices = [choice if n == len(knobs(table)) - 1 else AS_IS for n in range(len(knobs(table)))]
    assert simplified(table, choices)["joint_spring"][0]["stiffness"] == stiffness


# ---------------------------------------------------------------- files

TOML = """title = "rotor"
gravity = [0.0, 0.0, -9.8]
[[body]]
name = "rotor"
mass = 1.3
inertia = {{ xx = 0.2, yy = 0.3, zz = 0.25 }}
at = [0.1, 0.2, -0.3]
com = [0.1, -0.2, 0.05]
[[joint]]
name = "pin"
kind = "revolute"
predecessor = "ground"
successor = "rotor"
at = [0.1, 0.0, 0.0]
axis = [0.0, 0.6, 0.8]
second_axis = [1.0, 0.0, 0.0]
[[joint_spring]]
name = "k"
joint = "pin"
coordinate = "angle"
stiffness = {stiffness}
damping = {damping}
[trajectory]
duration = 1.0
sample = 0.1
digits = 8
[instant]
states = 2
seed = 1
"""


@pytest.mark.parametrize(
    ("stiffness", "damping", "laws"),
    [
        ("3.0", "0.1", ((3.0, 0.0, 0.0), (0.1, 0.0, 0.0))),
        ("[3]", "[0.1, 0.5]", ((3.0, 0.0, 0.0), (0.1, 0.5, 0.0))),
        ("[3, -2, 5]", "0", ((3.0, -2.0, 5.0), (0.0, 0.0, 0.0))),
    ],
)
def test_a_case_file_has_a_number_or_a_list(stiffness, damping, laws):
    case = read_text(TOML.format(stiffness=stiffness, damping=damping), "rotor")
    assert case.mechanism.joint_springs[0].laws == laws
    again = read_text(case_text(case), "rotor").mechanism.joint_springs[0]
    own = case.mechanism.joint_springs[0]
    assert (again.higher_stiffness, again.higher_damping) == (own.higher_stiffness, own.higher_damping)
    assert again.laws == laws


@pytest.mark.parametrize(
    ("stiffness", "what"),
    [
        ("[1, 2, 3, 4]", r"joint_spring 'k'.stiffness: list should have at most 3 items"),
        ("[]", r"joint_spring 'k'.stiffness: list should have at least 1 item"),
        ("[1, inf]", r"joint_spring 'k'.stiffness\[1\]: input should be (a finite number|less than)"),
        ("'soft'", r"joint_spring 'k'.stiffness: input should be a valid number"),
    ],
)
def test_a_wrong_list_is_refused_with_its_place(tmp_path, stiffness, what):
    path, text = tmp_path / "rotor.toml", TOML.format(stiffness=stiffness, damping=0.1)
    path.write_text(text)
    line = text[: text.index("stiffness")].count("\n") + 1
    with pytest.raises(InvalidInput, match=f"rotor.toml:{line}: {what}"):
        load_file(path)


def test_the_schema_knows_both():
    fields = CaseTable.model_json_schema()["$defs"]["JointSpringTable"]["properties"]
    for name in ("stiffness", "damping"):
        assert [way["type"] for way in fields[name]["anyOf"]] == ["number", "array"]
    assert fields["damping"]["default"] == 0.0
    assert json.dumps(fields)


def test_a_description_has_all_coefficients():
    text = describe_case(read_text(TOML.format(stiffness="[3, 2]", damping="[0.1, 0.5]"), "rotor"))
    assert "joint spring k: about pin, [3, 2], damping [0.1, 0.5]" in text
    assert "joint spring k: about pin, 3\n" in describe_case(
        read_text(TOML.format(stiffness="3", damping="0.1"), "rotor")
    )
