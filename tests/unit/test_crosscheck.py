"""Cross-check of all formulations: the formulations agree, and a wrong one is found."""

from dataclasses import replace

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import truth
from consilience.audit.formulations import compare, tables, trajectories
from consilience.audit.formulations.trajectories import (
    AMPLIFYING,
    BAR,
    DRIFTING,
    LONG_BAR,
    amplification,
    differences,
    drift_table,
    exceptions,
    follow,
    table,
    violation,
)
from consilience.audit.random_mechanisms import Recipe, random_mechanism
from consilience.case import load_case
from consilience.cli.commands.crosscheck import crosscheck
from consilience.engine import TrajectoryAnswer
from consilience.errors import NumericalFailure
from consilience.mechanism import GROUND, Mechanism, determinate_reactions, initial_state
from consilience.mechanism.conditioning import reaction_condition
from consilience.reference import FORMULATIONS, formulation, simulate
from consilience.reference.formulations import registry
from consilience.reference.formulations.coordinates import VARIANTS
from mechanisms import ELEMENTS, LOOPS, TREES, chain, drawn_joint, lumpy_body, rotation, states_of

SEEDS = (1, 8, 12, 14, 18)
"""Seeds of a tree, planar and spherical linkages, loops, and elements of many kinds."""


@pytest.fixture(scope="module")
def examinations():
    return list(compare.campaign(SEEDS, 1))


# ---------------------------------------------------------------- single states


def test_all_formulations_agree_on_random_mechanisms(examinations):
    assert not compare.disagreements(examinations)
    assert not compare.failures(examinations)
    assert compare.agrees(examinations)
    compared = [set(d.distances) for e in examinations for d in e.differences]
    assert set.union(*compared) == set(FORMULATIONS)
    assert all(set(e.refusals) == set(FORMULATIONS) for e in examinations)


@pytest.mark.parametrize("mechanism", [*TREES.values(), *LOOPS.values(), *ELEMENTS.values()], ids=lambda m: m.name)
def test_the_median_is_the_truth_of_plain_numpy(mechanism):
    """The tests' own dense solution, added as one more formulation, stays within the bar."""
    state = states_of(mechanism, 1)
    names = ("descriptor", "articulated_body", "descriptor_euler_parameters")
    found = compare.compare(mechanism, state, names, 0)
    a, alpha, force, torque = truth.solve(mechanism, state[0])
    answers = compare._answers({n: formulation(n, mechanism) for n in names}, state[0], 0.0, 0, 0)[0]
    answers["truth"] = np.hstack([a, alpha]).ravel(), np.hstack([force, torque])
    determined = determinate_reactions(mechanism, state[0]) & compare._carried(mechanism)
    for quantity, values in zip(compare.QUANTITIES, compare._compared(answers, determined), strict=True):
        if values["truth"].size:
            bar = next(d.bar for d in found.differences if d.quantity == quantity)
            assert compare._difference(0, 0, quantity, values, bar).agrees


class Wrong:
    """A formulation with wrong accelerations or reactions."""

    def __init__(self, equations, accelerations=0.0, reactions=0.0):
        self.equations, self.error, self.reaction_error = equations, accelerations, reactions

    def accelerations(self, state, t=0.0):
        a, alpha = self.equations.accelerations(state, t)
        return a, alpha * (1 + self.error)

    def reactions(self, state, t=0.0):
        force, torque = self.equations.reactions(state, t)
        return force * (1 + self.reaction_error), torque


@pytest.mark.parametrize(("part", "quantity"), [("accelerations", "accelerations"), ("reactions", "reactions")])
def test_a_wrong_formulation_is_found_and_the_others_agree(monkeypatch, part, quantity):
    make = registry.formulation
    wrong = "null_space_qr"

    def broken(name, mechanism):
        return Wrong(make(name, mechanism), **{part: 1e-8}) if name == wrong else make(name, mechanism)

    monkeypatch.setattr(registry, "formulation", broken)
    names = ("descriptor", "null_space", "null_space_qr", "lagrange")
    mechanism = LOOPS["slider_crank"]
    found = compare.compare(mechanism, states_of(mechanism, 2), names, 7)
    bad = compare.disagreements([found])
    assert {(d.quantity, d.farthest) for d in bad} == {(quantity, wrong)}
    assert {(d.seed, d.state) for d in bad} == {(7, 0), (7, 1)}
    assert all(d.distances[name] < d.bar for d in bad for name in names if name != wrong)
    assert not compare.agrees([found])
    assert f"| 7/0 | {quantity} |" in tables.exceptions([found])


def test_an_answer_that_is_not_finite_is_no_agreement():
    values = {"one": np.array([1.0, 2.0]), "two": np.array([1.0, 2.0]), "three": np.array([1.0, np.nan])}
    difference = compare._difference(0, 0, "accelerations", values, 1e-10)
    assert not difference.agrees
    assert difference.farthest == "three"
    assert difference.distances["one"] == 0.0


def test_a_singular_orientation_is_an_exception_with_its_reason():
    """Body axes parallel to those of the world: theta = 0, where Euler angles z-x-z are singular."""
    mechanism = chain("free", seed=3)
    (state,) = states_of(mechanism, 1)
    upright = replace(state, quat_WB=np.array([[1.0, 0.0, 0.0, 0.0]]))
    names = ("descriptor", "descriptor_euler_angles", "descriptor_bryant_angles")
    found = compare.compare(mechanism, [upright], names, 5)
    (missing,) = found.exempt
    assert (missing.seed, missing.state, missing.formulation) == (5, 0, "descriptor_euler_angles")
    assert missing.reason == "Euler angles z-x-z singular at theta"
    assert not missing.failure
    (difference,) = found.differences  # a free joint has no reaction to compare
    assert difference.quantity == "accelerations"
    assert set(difference.distances) == {"descriptor", "descriptor_bryant_angles"}


def test_saddle_points_near_a_singular_pose_are_an_exception_with_its_reason():
    """A linkage near a singular pose: saddle-point systems lose digits, orthogonal factors do not."""
    mechanism = random_mechanism(2, 4, Recipe(plain=True, linkages=1.0, flat=1e-4))
    state = initial_state(mechanism)
    assert reaction_condition(mechanism, state) > compare.STEEP
    found = compare.compare(mechanism, [state], tuple(FORMULATIONS), 2)
    assert compare.agrees([found])
    assert found.exempt
    assert all("saddle-point system" in x.reason and x.formulation in VARIANTS for x in found.exempt)
    assert {"descriptor", "articulated_body"} <= set(found.differences[0].distances)


def test_reactions_that_equilibrium_leaves_open_are_not_compared():
    """In a planar four-bar, least-norm multipliers of all rows differ from those of the rows of the cut joint alone."""
    mechanism = LOOPS["four_bar"]
    states = states_of(mechanism, 2)
    names = ("descriptor", "lagrange", "point_coordinates")
    assert compare.agrees([compare.compare(mechanism, states, names, 0)])
    one, other = (np.hstack(formulation(name, mechanism).reactions(states[0])) for name in names[:2])
    open_ones = ~determinate_reactions(mechanism, states[0])
    assert np.max(np.abs(one - other)[open_ones]) > 1e-3 * np.max(np.abs(one))


class Broken:
    """A formulation that raises an exception."""

    def accelerations(self, state, t=0.0):
        raise np.linalg.LinAlgError("Singular matrix")


def test_a_computation_that_breaks_down_is_a_failure(monkeypatch):
    make = registry.formulation
    monkeypatch.setattr(registry, "formulation", lambda n, m: Broken() if n == "null_space" else make(n, m))
    mechanism = LOOPS["slider_crank"]
    found = compare.compare(mechanism, states_of(mechanism, 1), ("descriptor", "null_space", "composite_body"), 0)
    (failed,) = compare.failures([found])
    assert (failed.formulation, failed.reason) == ("null_space", "Singular matrix")
    assert not compare.disagreements([found])
    assert not compare.agrees([found])
    assert "**failed**: Singular matrix" in tables.exceptions([found])


@pytest.mark.parametrize(("error", "exempt"), [(1e-9, True), (1e-3, False)])
def test_near_singular_coordinates_are_a_reason_for_rounding_but_not_for_errors(monkeypatch, error, exempt):
    """Rodrigues parameters 4 mrad before their singularity at a half turn; the tangent of half the angle is 500."""
    mechanism = chain("free", seed=3)
    (state,) = states_of(mechanism, 1)
    angle = np.pi - 4e-3
    turned = replace(
        state, quat_WB=np.array([[np.cos(angle / 2), np.sin(angle / 2), 0.0, 0.0]]), w_WB_W=np.array([[2.0, -3.0, 1.5]])
    )
    wrong, make = "descriptor_rodrigues_parameters", registry.formulation

    def broken(name, mechanism):
        return Wrong(make(name, mechanism), accelerations=error) if name == wrong else make(name, mechanism)

    monkeypatch.setattr(registry, "formulation", broken)
    names = ("descriptor", "null_space", "descriptor_euler_parameters", wrong)
    found = compare.compare(mechanism, [turned], names, 0)
    assert bool(compare.disagreements([found])) == (not exempt)
    assert [x.formulation for x in found.exempt] == [wrong] * exempt
    assert all("2.0e-03 from a singularity" in x.reason for x in found.exempt)


def parallelogram(angle):
    """Return a planar parallelogram with the given crank angle; at zero it can change into an antiparallelogram."""
    rng = np.random.default_rng(9)
    R, crank = rotation(rng), np.array([np.cos(angle), np.sin(angle), 0.0])
    base = np.array([2.0, 0.0, 0.0])
    corners = [R @ p for p in (np.zeros(3), crank, crank + base, base)]
    bodies = {n: lumpy_body(n, rng) for n in ("crank", "coupler", "rocker")}
    names = [GROUND, *bodies, GROUND]
    joints = tuple(drawn_joint(f"j{n}", "revolute", bodies, names[n], names[n + 1], corners[n], R) for n in range(4))
    return Mechanism("parallelogram", np.array([1.0, 2.0, 3.0]), tuple(bodies.values()), joints)


@pytest.mark.parametrize(("angle", "exempt"), [(1e-7, True), (0.5, False)])
def test_a_state_near_a_singular_pose_is_an_exception_for_all(angle, exempt):
    mechanism = parallelogram(angle)
    found = compare.compare(mechanism, [initial_state(mechanism)], ("descriptor", "null_space"), 0)
    assert [(x.formulation, x.failure) for x in found.exempt] == [("", False)] * exempt
    assert all(x.reason.startswith("near a singular pose") for x in found.exempt)
    assert len(found.differences) == (0 if exempt else 2)


def test_the_tables_tell_what_was_compared(examinations):
    text = tables.report(examinations)
    states = sum(e.states for e in examinations)
    assert f"| all | {len(SEEDS)} | " in text
    assert f"| {states} |" in tables.summary(examinations)
    refused = sum(bool(e.refusals["lagrange"]) for e in examinations)
    assert f"| `lagrange` | {len(SEEDS) - refused} | {refused} | 0 |" in tables.formulation_table(examinations)
    assert "element 'c_" not in text
    assert "| `lagrange` | joint: screw | " in tables.exceptions(examinations)


def test_processes_change_nothing():
    one, two = (list(compare.campaign((11, 20), 1, ("descriptor", "null_space"), jobs)) for jobs in (1, 2))
    assert one == two


def test_the_command_writes_the_tables_and_says_by_its_exit_code_whether_all_agree(tmp_path, monkeypatch):
    app = typer.Typer()
    app.command()(crosscheck)
    file = tmp_path / "tables.md"
    arguments = ["--mechanisms", "1", "--states", "1", "--seed", "11", "--jobs", "1"]
    result = CliRunner().invoke(app, [*arguments, "-o", str(file)])
    assert result.exit_code == 0
    assert "| `null_space` | 1 | 0 | 0 |" in file.read_text()
    make = registry.formulation
    wrong = lambda name, m: Wrong(make(name, m), accelerations=1e-8 * (name == "null_space"))  # noqa: E731
    monkeypatch.setattr(registry, "formulation", wrong)
    assert CliRunner().invoke(app, arguments).exit_code == 1


# ---------------------------------------------------------------- motions


def test_formulations_follow_the_same_motion():
    case = load_case("double_pendulum")
    names = ("null_space", "composite_body", "lagrange", "descriptor_rotation_vector", "descriptor_unprojected")
    found = follow(case.name, case.mechanism, case.initial_state, names, duration=1.0, samples=5)
    assert [path.formulation for path in found.motions] == list(names)
    assert all(path.agrees and path.steps > 1 for path in found.motions)
    assert all(path.error <= BAR and path.violation < 1e-12 for path in found.motions)
    assert {path.formulation for path in found.motions if path.bar == np.inf} == DRIFTING & set(names)
    assert "| `descriptor_unprojected` |" in drift_table([found])
    assert "| *amplification* |" in table([found])


def test_coordinates_that_fail_on_the_way_are_an_exception_with_its_reason(monkeypatch):
    """Bryant angles of the four-bar pass through beta = pi / 2; rotation vectors meet no singularity."""

    def stopped(mechanism, state, times, tolerance, formulation="descriptor"):
        if formulation != "descriptor":
            raise NumericalFailure("the step size fell")
        return simulate(mechanism, state, times, tolerance, formulation)

    monkeypatch.setattr(trajectories, "simulate", stopped)
    case = load_case("four_bar")
    names = ("descriptor_bryant_angles", "descriptor_rotation_vector", "null_space")
    found = follow(case.name, case.mechanism, case.initial_state, names, 0.2, 3)
    assert [path.exempt for path in found.motions] == [True, False, False]
    assert [path.agrees for path in found.motions] == [True, False, False]
    assert "passes its singular orientations" in found.motions[0].refusal
    assert exceptions([found]).count("**failed**") == 2
    assert "singular" in table([found])


def test_coordinates_that_fail_at_once_are_an_exception_with_its_reason():
    """The arm starts at theta = 0, where Euler angles are singular."""
    case = load_case("rotating_end_pendulum")
    found = follow(case.name, case.mechanism, case.initial_state, ("descriptor_euler_angles",), 0.2, 3)
    assert found.motions[0].exempt
    assert "theta = 0.0" in found.motions[0].refusal
    assert "theta" in exceptions([found])


def test_a_mechanism_that_is_refused_has_the_reason():
    mechanism = ELEMENTS["driven"]
    (state,) = states_of(mechanism, 1)
    found = follow("driven", mechanism, state, ("lagrange",), 0.1, 2)
    assert found.motions[0].exempt
    assert "turn" in found.motions[0].refusal


@pytest.mark.parametrize(("error", "agrees"), [(1e-10, True), (1e-8, False)])
def test_a_motion_that_is_wrong_is_found(monkeypatch, error, agrees):
    def bent(mechanism, state, times, tolerance, formulation="descriptor"):
        motion = simulate(mechanism, state, times, tolerance, formulation)
        return replace(motion, v_WB_W=motion.v_WB_W + error) if formulation == "null_space" else motion

    monkeypatch.setattr(trajectories, "simulate", bent)
    case = load_case("spatial_pendulum")
    found = follow(case.name, case.mechanism, case.initial_state, ("null_space",), 0.2, 3)
    assert found.motions[0].bar == BAR
    assert found.motions[0].agrees == agrees
    assert ("**" in table([found])) != agrees


@pytest.mark.parametrize("error", [0.0, 1e-3])
def test_gears_are_not_violated_after_full_turns(error):
    """Two wheels geared 1 to -0.1 over two turns of the first; the last sample of the second has a known error."""
    mechanism = load_case("gear_pair").mechanism
    first = np.linspace(0.0, 4.0 * np.pi, 41)
    angles = np.stack([first, -0.1 * first + np.where(first == first[-1], error, 0.0)], axis=1)
    quats = np.stack([np.cos(angles / 2), 0.0 * angles, 0.0 * angles, np.sin(angles / 2)], axis=2)
    still, p = np.zeros((41, 2, 3)), np.tile([[0.0, 0.0, 0.0], [1.1, 0.0, 0.0]], (41, 1, 1))
    motion = TrajectoryAnswer(np.linspace(0.0, 1.0, 41), p, quats, still, still)
    assert violation(mechanism, motion) == pytest.approx(error, rel=1e-9, abs=1e-14)


def test_amplification_of_a_body_at_rest_in_space_is_the_time():
    """A change d of the initial velocity displaces the body by d t; no other change grows as fast."""
    mechanism = replace(chain("free", seed=3), gravity=np.zeros(3))
    state = initial_state(mechanism)
    state = replace(state, p_WB=0.1 * state.p_WB)
    times = np.linspace(0.0, 5.0, 3)
    assert amplification(mechanism, state, times, simulate(mechanism, state, times)) == pytest.approx(5.0, rel=1e-6)


def test_the_bar_is_the_longer_one_where_the_motion_amplifies_more():
    mechanism = replace(chain("free", seed=3), gravity=np.zeros(3))
    state = replace(initial_state(mechanism), p_WB=np.zeros((1, 3)))
    bars = [
        follow("x", mechanism, state, ("null_space",), T, 3).motions[0].bar
        for T in (0.9 * AMPLIFYING, 1.1 * AMPLIFYING)
    ]
    assert bars == [BAR, LONG_BAR]


def test_differences_are_relative_to_the_largest_value_or_to_one():
    case = load_case("simple_pendulum-small")
    motion = simulate(case.mechanism, case.initial_state, np.array([0.0, 0.1]))
    far = replace(motion, p_WB=motion.p_WB * 0 + 100.0)
    assert differences(replace(far, p_WB=far.p_WB + 1.0), far)["p_WB"] == pytest.approx(0.01)
    resting = replace(motion, w_WB_W=0 * motion.w_WB_W)
    assert differences(replace(resting, w_WB_W=resting.w_WB_W + 0.5), resting)["w_WB_W"] == pytest.approx(0.5)
