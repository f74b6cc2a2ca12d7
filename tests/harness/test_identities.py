"""Identities of mechanics: a correct engine fulfils all of them; each identity detects some engine with an error."""

import ast
import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import consilience.audit.identities
from consilience.audit.identities.check import ALONG_A_MOTION, IDENTITIES, Checks, check_case
from consilience.audit.identities.equations import Equations
from consilience.audit.identities.result import Finding, IdentityOutcome, exit_code
from consilience.audit.identities.tables import write
from consilience.audit.random_mechanisms import Recipe, random_mechanism
from consilience.case import Case, load_case
from consilience.cli.commands.check import check
from consilience.engine import CannotRepresent, Profile, Question, load_engine
from consilience.engine.worker.client import Reply
from consilience.engine.worker.requests import Plan, perform
from consilience.errors import InvalidInput
from consilience.mechanism import GROUND, Initial, JointSpring, Load, drawing_state, skew, spanning_tree
from mechanisms import ELEMENTS, LOOPS, TREES, chain, drawn_joint, four_bar, lumpy_body, rotation, states_of

ALL = TREES | LOOPS | ELEMENTS
NAMES = [identity.name for identity in IDENTITIES]


def case_of(mechanism, states=2, rates=None):
    initial = Initial(rates=rates or {})
    return Case(mechanism.name, "test", "test", mechanism, initial, 1.0, 0.05, 8, states, 3)


def asked(engine):
    """The engine in this process at matched settings; an exception becomes a failed reply, as in a worker."""

    def ask(request):
        try:
            value = perform(engine, request)
        except ArithmeticError as error:
            return Reply(None, returned=False, reason=str(error))
        if isinstance(value, Plan):
            matched = {q: tuple(m for m in ways if m.profile is Profile.MATCHED) for q, ways in value.methods.items()}
            value = replace(value, methods=matched)
        return Reply(value, returned=True)

    return ask


def outcomes(engine, mechanism, states=2, rates=None):
    """Finding of each identity for the headline method."""
    found = {}
    for finding in check_case(asked(engine), "test", case_of(mechanism, states, rates), states):
        found.setdefault(finding.identity, finding)
    return found


def violated(findings):
    return {name for name, finding in findings.items() if finding.outcome is IdentityOutcome.VIOLATED}


# ---------------------------------------------------------------- a correct engine

CHOSEN = [
    *LOOPS,
    *ELEMENTS,
    *("single_free", "single_rod", "backward_universal", "backward_rod", "backward_rigid", "backward_point_on_line"),
    *("floating_chain", "forced_chain", "branched"),
]


@pytest.mark.parametrize("name", CHOSEN)
def test_an_honest_engine_obeys_every_identity_that_applies(name):
    findings = outcomes(load_engine("honest"), ALL[name])
    assert list(findings) == NAMES
    assert not [f for f in findings.values() if f.outcome in (IdentityOutcome.VIOLATED, IdentityOutcome.NO_ANSWER)]
    assert all(f.remark for f in findings.values() if f.outcome is IdentityOutcome.NOT_APPLICABLE)
    assert sum(f.outcome is IdentityOutcome.HOLDS for f in findings.values()) >= 14


def test_what_does_not_apply_says_why():
    reasons = {
        "single_free": {"constraints on accelerations": "no constraints", "bodies and joints reordered": "one order"},
        "forced_chain": {"loops cut elsewhere": "no order"},
        "driven": {"power balance": "drives do work", "energy balance": "drives do work"},
        "skating": {"energy balance": "non-holonomic"},
    }
    for name, expected in reasons.items():
        findings = outcomes(load_engine("honest"), ALL[name], states=1)
        for identity, why in expected.items():
            assert findings[identity].outcome is IdentityOutcome.NOT_APPLICABLE
            assert why in findings[identity].remark


# ---------------------------------------------------------------- engines with one error


class Crooked:
    """The honest engine with one error: in the mechanism that it is given, in its answers, or in its motions."""

    def __init__(self, mechanism=None, instant=None, trajectory=None):
        self._honest = load_engine("honest")
        self._mechanism = mechanism or (lambda m: m)
        self._instant = instant or (lambda m, states, answer: answer)
        self._trajectory = trajectory or (lambda answer: answer)

    def __getattr__(self, name):
        return getattr(self._honest, name)

    def instant(self, mechanism, states, method):
        answer = self._honest.instant(self._mechanism(mechanism), states, method)
        return self._instant(mechanism, states, answer)

    def trajectory(self, mechanism, state, times, method, step):
        return self._trajectory(self._honest.trajectory(self._mechanism(mechanism), state, times, method, step))


def each_body(change):
    return lambda m: replace(m, bodies=tuple(change(b) for b in m.bodies))


def each_load(change):
    return lambda m: replace(m, loads=tuple(replace(x, vector=change(x.vector)) for x in m.loads))


def about_the_origin(body):
    S = skew(body.com)
    return replace(body, inertia=body.inertia - body.mass * S @ S)


def of_body(index, **factors):
    """One body with some of its numbers multiplied by factors."""

    def change(m):
        body = m.bodies[index]
        changed = replace(body, **{name: getattr(body, name) * factor for name, factor in factors.items()})
        return replace(m, bodies=tuple(changed if b is body else b for b in m.bodies))

    return change


def damped(m):
    joint = next(j for j in m.joints if j.kind == "revolute")
    return replace(m, joint_springs=(*m.joint_springs, JointSpring("hidden", joint.name, "angle", 0.0, 0.01, 0.0)))


def last_joint_loose(m):
    """The last joint of the loop constrains its bodies to the plane only."""
    return replace(m, joints=tuple(replace(j, kind="point_in_plane") if j.name == "j3" else j for j in m.joints))


def pulled_to_the_world_origin(m, states, answer):
    engine = load_engine("honest")
    (method, *_) = engine.methods(m, Question.INSTANT)
    a, alpha = np.array(answer.a_WB_W), np.array(answer.alpha_WB_W)
    for n, s in enumerate(states):
        pull = Load("pull", "force", m.bodies[-1].name, -0.01 * s.p_WB[-1], "world")
        pulled = engine.instant(replace(m, loads=(*m.loads, pull)), [s], method)
        a[n], alpha[n] = pulled.a_WB_W[0], pulled.alpha_WB_W[0]
    return replace(answer, a_WB_W=a, alpha_WB_W=alpha)


def cut_body_heavier(m):
    closing = spanning_tree(m)[1]
    joint = m.joints[closing[0]] if closing else None
    return of_body(m.body_index[joint.successor], mass=1.01)(m) if joint and joint.successor != GROUND else m


def welded_part_light(m):
    light = {j.successor for j in m.joints if j.kind == "rigid"}
    return replace(m, bodies=tuple(replace(b, inertia=0.9 * b.inertia) if b.name in light else b for b in m.bodies))


def at_the_centre_of_mass(m, states, answer):
    a = answer.a_WB_W.copy()
    for n, s in enumerate(states):
        a[n] += np.cross(answer.alpha_WB_W[n], Equations(m, s).arms)
    return replace(answer, a_WB_W=a)


def reaction(change):
    return lambda m, states, answer: replace(
        answer, force_F=change(answer.force_F), torque_F=change(answer.torque_F, answer.force_F)
    )


def turn_reactions(force, *_):
    return force @ rotation(np.random.default_rng(1)).T


def along(**shift):
    return lambda answer: replace(answer, **{name: getattr(answer, name) + d for name, d in shift.items()})


TWIST = np.eye(3) + 1e-3 * skew([1.0, 2.0, -1.0])

# engine: its error, and the identities that it must violate
PLANTED = {
    "inertia about the origin": (
        {"mechanism": each_body(about_the_origin)},
        {"forward after inverse", "mobility inverse of the mass matrix", "power balance", "balance of each body"},
    ),
    "armature": (
        {"mechanism": each_body(lambda b: replace(b, inertia=b.inertia + 1e-4 * np.eye(3)))},
        {"forward after inverse", "mobility inverse of the mass matrix", "other units"},
    ),
    "loads the wrong way": ({"mechanism": each_load(lambda v: -v)}, {"mobility positive", "forward after inverse"}),
    "loads in a frame that is turned": ({"mechanism": each_load(lambda v: TWIST @ v)}, {"mobility symmetric"}),
    "loads that saturate": ({"mechanism": each_load(lambda v: 30.0 * np.tanh(v / 30.0))}, {"linear in the loads"}),
    "damping nobody asked for": ({"mechanism": damped}, {"power balance", "balance of each body"}),
    "gravity the other way": (
        {"mechanism": lambda m: replace(m, gravity=-m.gravity)},
        {"power balance", "momentum", "balance of each body"},
    ),
    "gravity along z only": (
        {"mechanism": lambda m: replace(m, gravity=m.gravity * [0.0, 0.0, 1.0])},
        {"rotated world", "momentum"},
    ),
    "kinetic energy wrong": (
        {"instant": lambda m, states, answer: replace(answer, kinetic=answer.kinetic * (1 + 1e-6))},
        {"energy balance"},
    ),
    "potential energy of the wrong sign": (
        {"instant": lambda m, states, answer: replace(answer, potential=-answer.potential)},
        {"energy balance"},
    ),
    "reactions on the predecessor": (
        {"instant": reaction(lambda f, *_: -f)},
        {"balance of each body", "momentum", "forward after inverse"},
    ),
    "reactions in other axes": (
        {"instant": reaction(turn_reactions)},
        {"balance of each body", "momentum", "forward after inverse", "sides of joints swapped"},
    ),
    "reactions at another point": (
        {"instant": reaction(lambda x, force=None: x if force is None else x + np.cross([0.0, 0.01, 0.0], force))},
        {"balance of each body", "momentum", "forward after inverse"},
    ),
    "accelerations of the centres of mass": (
        {"instant": at_the_centre_of_mass},
        {"constraints on accelerations", "forward after inverse", "energy balance"},
    ),
    "a constraint ignored": (
        {"mechanism": last_joint_loose},
        {"constraints on accelerations", "constraints on positions", "constraints on velocities"},
    ),
    "the first body of the list is heavier": ({"mechanism": of_body(0, mass=1.001)}, {"bodies and joints reordered"}),
    "a pull to the origin of the world": ({"instant": pulled_to_the_world_origin}, {"moved world", "power balance"}),
    "a rest angle without its sign": (
        {"mechanism": lambda m: replace(m, joint_springs=tuple(replace(s, rest=abs(s.rest)) for s in m.joint_springs))},
        {"sides of joints swapped"},
    ),
    "a body that is cut is heavier": ({"mechanism": cut_body_heavier}, {"loops cut elsewhere"}),
    "a welded part is lighter": ({"mechanism": welded_part_light}, {"a body in two welded parts"}),
    "bodies set aside": ({"trajectory": along(p_WB=np.array([1e-6, 0.0, 0.0]))}, {"constraints on positions"}),
    "velocities set aside": ({"trajectory": along(v_WB_W=np.array([0.0, 1e-6, 0.0]))}, {"constraints on velocities"}),
}


@cache
def subject():
    """A loop of lumpy bodies with an arm on its coupler and springs on two joints, so that every identity applies."""
    base, rng = four_bar(), np.random.default_rng(91)
    arm = lumpy_body("arm", rng)
    bodies = {b.name: b for b in (*base.bodies, arm)}
    shoulder = drawn_joint("shoulder", "universal", bodies, "coupler", "arm", np.array([0.3, 0.2, 0.1]), rotation(rng))
    springs = tuple(JointSpring(f"k{n}", f"j{n}", "angle", 3.0, 0.2, 0.3) for n in (0, 1))
    return replace(base, bodies=(*base.bodies, arm), joints=(*base.joints, shoulder), joint_springs=springs)


MOVING = {"j0": {"angle": 1.5}, "shoulder": {"angle1": -2.0, "angle2": 1.0}}


@pytest.fixture(scope="module")
def judged():
    """Identities that each engine with an error violates."""
    return {name: violated(outcomes(Crooked(**error), subject(), 1, MOVING)) for name, (error, _) in PLANTED.items()}


@pytest.mark.parametrize("name", PLANTED)
def test_an_error_is_caught_by_the_identities_that_show_it(judged, name):
    assert PLANTED[name][1] <= judged[name]


def test_the_engine_they_descend_from_obeys_all_of_them_on_the_same_mechanism():
    findings = outcomes(Crooked(), subject(), 1, MOVING)
    assert {f.outcome for f in findings.values()} == {IdentityOutcome.HOLDS}


@pytest.mark.parametrize("identity", NAMES)
def test_every_identity_can_be_violated(judged, identity):
    assert any(identity in expected and identity in judged[name] for name, (_, expected) in PLANTED.items())


def test_an_error_of_accounts_alone_shows_in_the_accounts_alone(judged):
    assert judged["kinetic energy wrong"] == {"energy balance"}


def test_errors_of_motions_do_not_touch_what_is_asked_at_instants(judged):
    for name in ("bodies set aside", "velocities set aside"):
        assert judged[name] <= set(ALONG_A_MOTION)


@pytest.mark.parametrize("size", [1e-3, 1e-6, 1e-9])
def test_a_mass_that_is_slightly_wrong_is_caught(size):
    """The bars follow rounding error: a mass error in the ninth digit is far above them."""
    mechanism = TREES["long_chain"]
    findings = outcomes(Crooked(mechanism=of_body(0, mass=1.0 + size)), mechanism, states=1)
    assert {"mobility inverse of the mass matrix", "forward after inverse"} <= violated(findings)
    assert findings["mobility inverse of the mass matrix"].residual < 10 * size


def test_an_answer_that_is_wrong_by_orders_does_not_widen_its_own_bar():
    mechanism = chain("revolute", "spherical", seed=90)
    honest = outcomes(load_engine("honest"), mechanism, states=1)
    far = Crooked(instant=lambda m, s, a: replace(a, a_WB_W=1e12 * a.a_WB_W))
    wrong = outcomes(far, mechanism, states=1)
    for name in ("momentum", "balance of each body", "power balance"):
        assert wrong[name].bar == pytest.approx(honest[name].bar)
    assert {"constraints on accelerations", "balance of each body"} <= violated(wrong)


# ---------------------------------------------------------------- the solution without an engine, and the bars


@pytest.mark.parametrize("name", ["long_chain", "four_bar", "powered", "coupled", "rolling_torus", "driven"])
def test_the_neutral_solution_is_that_of_the_dense_oracle(name):
    import truth

    mechanism = ALL[name]
    for state in states_of(mechanism, 2):
        a, alpha, force, torque = truth.solve(mechanism, state)
        eq = Equations(mechanism, state)
        expected = eq.motion(a, alpha)
        assert np.max(np.abs(eq.solution.x - expected)) < 1e-11 * np.max(np.abs(expected))
        found, known = -eq.reaction_map @ eq.solution.mu, eq.determined
        reactions = eq.scaled_reactions(force, torque)
        assert np.max(np.abs((found - reactions)[known])) < 1e-10 * np.max(np.abs(reactions))


def test_bars_grow_with_what_amplifies_errors_and_do_not_depend_on_units():
    from consilience.audit.identities.descriptions import scaled_units

    mechanism = TREES["long_chain"]
    (state,) = states_of(mechanism, 1)
    eq = Equations(mechanism, state)
    other = scaled_units(mechanism, 8.0, 0.25, 2.0)
    same = Equations(other.mechanism, other.state(state))
    from consilience.engine import Route

    def bar(e):
        return e.acceleration_error(e.solution, Route.NATIVE) / np.max(np.abs(e.solution.x))

    assert bar(same) == pytest.approx(bar(eq), rel=1e-9)
    light = Equations(of_body(-1, mass=1e-6, inertia=1e-6)(mechanism), state)
    # the flatter a linkage, the more its constraint forces amplify
    kinds = ("revolute", "prismatic", "spherical")
    flat, flatter = (random_mechanism(5, 3, Recipe(kinds, True, linkages=1.0, flat=f)) for f in (1e-1, 1e-4))
    assert bar(Equations(flatter, drawing_state(flatter))) > 50 * bar(Equations(flat, drawing_state(flat)))
    assert bar(light) < 1e-6
    assert bar(eq) < 1e-10
    assert bar(eq) < Equations.acceleration_error(eq, eq.solution, Route.EXTRAPOLATED)


def test_identities_do_not_know_the_reference():
    folder = Path(consilience.audit.identities.__file__).parent
    for path in folder.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                assert not (node.module or "").startswith("consilience.reference"), path.name


# ---------------------------------------------------------------- installed engines and the command


@pytest.mark.slow
@pytest.mark.parametrize("name", ["spatial_pendulum", "simple_pendulum-large", "four_bar"])
@pytest.mark.parametrize("engine", ["exudyn", "pinocchio", "mujoco", "dart"])
def test_installed_engines_obey_the_identities_on_shipped_cases(engine, name):
    case = load_case(name).with_span(0.05, None)
    findings = check_case(asked(load_engine(engine)), engine, case, 2)
    assert not [f for f in findings if f.outcome in (IdentityOutcome.VIOLATED, IdentityOutcome.NO_ANSWER)]
    assert sum(f.outcome is IdentityOutcome.HOLDS for f in findings) >= 15


def finding(outcome, profile=Profile.MATCHED):
    return Finding("case", "engine", Question.INSTANT, "method", None, profile, NAMES[0], outcome)


@pytest.mark.parametrize(
    ("findings", "missing", "code"),
    [
        ([], 0, 0),
        ([finding(IdentityOutcome.HOLDS), finding(IdentityOutcome.NOT_APPLICABLE)], 0, 0),
        ([finding(IdentityOutcome.HOLDS)], 1, 3),
        ([finding(IdentityOutcome.NO_ANSWER)], 0, 3),
        ([finding(IdentityOutcome.NO_ANSWER), finding(IdentityOutcome.VIOLATED)], 1, 1),
        ([finding(IdentityOutcome.VIOLATED, Profile.DEFAULT), finding(IdentityOutcome.HOLDS)], 0, 0),
    ],
)
def test_exit_codes(findings, missing, code):
    assert exit_code(findings, missing) == code


@pytest.fixture
def app():
    made = typer.Typer()
    made.command()(check)
    return made


@pytest.mark.slow
def test_the_command_checks_engines_in_workers_and_writes_what_it_found(app, tmp_path):
    """Engines: an honest one, one with reactions of wrong sign, one that does not start, one that fails to plan."""
    target = tmp_path / "found.json"
    engines = ["honest", "reaction_sign", "cannot_start"]
    options = [part for name in engines for part in ("-e", name)]
    result = CliRunner().invoke(app, ["double_pendulum", *options, "--states", "1", "-o", str(target)])
    assert result.exit_code == 1, result.output
    document = json.loads(target.read_text())
    assert document["exit_code"] == 1
    assert set(document["engines"]) == {"honest", "reaction_sign"}
    assert "no licence server" in document["missing"]["cannot_start"]
    bad = [f for f in document["findings"] if f["outcome"] == "violated"]
    assert {f["engine"] for f in bad} == {"reaction_sign"}
    assert {f["identity"] for f in bad} >= {"balance of each body", "momentum"}
    assert {f["identity"] for f in document["findings"]} == set(NAMES)
    assert "balance of each body" in result.output
    again = CliRunner().invoke(app, ["double_pendulum", *options, "--states", "1", "-f", "json"])
    assert json.loads(again.stdout)["findings"] == document["findings"]


def test_an_engine_that_raises_gives_no_answer_and_the_evidence(tmp_path):
    def trips(m, states, answer):
        raise ArithmeticError("the mass matrix is singular")

    checks = Checks({"test": load_engine("honest").info()}, {})
    case = case_of(TREES["single_revolute"])
    checks.findings = check_case(asked(Crooked(instant=trips)), "test", case, 1)
    of_instants = [f for f in checks.findings if f.identity not in ALONG_A_MOTION]
    assert {f.outcome for f in of_instants} == {IdentityOutcome.NO_ANSWER, IdentityOutcome.NOT_APPLICABLE}
    assert {f.remark for f in of_instants if f.outcome is IdentityOutcome.NO_ANSWER} == {"the mass matrix is singular"}
    write(checks, tmp_path / "found.md")
    text = (tmp_path / "found.md").read_text()
    assert "the mass matrix is singular" in text
    assert "| energy balance | no answer" in text


def test_a_state_that_the_engine_cannot_represent_has_no_identities():
    def refuses(m, states, answer):
        raise CannotRepresent("state", "no such state")

    found = check_case(asked(Crooked(instant=refuses)), "test", case_of(TREES["single_revolute"]), 1)
    of_instants = [f for f in found if f.identity not in ALONG_A_MOTION]
    assert {f.outcome for f in of_instants} == {IdentityOutcome.NOT_APPLICABLE}
    assert "state: no such state" in {f.remark for f in of_instants}


def test_a_file_name_that_names_no_format_is_refused(app, tmp_path):
    result = CliRunner().invoke(app, ["double_pendulum", "-o", str(tmp_path / "found.txt")])
    assert isinstance(result.exception, InvalidInput)
