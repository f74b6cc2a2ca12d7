"""Impact equations against a dense solution and identities of mechanics; simulation with impacts."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Joint,
    JointSpring,
    Mechanism,
    PointPlane,
    SpherePlane,
    SphereSphere,
    State,
    body_point,
    constraint_jacobian,
    constraint_residual,
    determinate_reactions,
    initial_state,
    kinetic_energy,
    potential_energy,
    quaternion_from_rotation,
    reaction_map,
    rotation_from_quaternion,
    skew,
    world_inertias,
)
from consilience.mechanism.observables import linear_momentum
from consilience.reference import NumericalFailure, simulate
from consilience.reference.contact import contact_motion, simulate_with_contacts, simulate_with_impacts, solve_impact
from mechanisms import ELEMENTS, LOOPS, TREES, four_bar, lumpy_body, rotation, states_of

ONE, ZERO = np.eye(3), np.zeros(3)
X, Y, Z = ONE
AT_HOME = Frame(ZERO, ONE)


# --- geometry -------------------------------------------------------------------------------------------------------


def in_body(mechanism, state, body, point_W):
    if body == GROUND:
        return point_W
    i = mechanism.body_index[body]
    return rotation_from_quaternion(state.quat_WB[i]).T @ (point_W - state.p_WB[i])


def turned_into(mechanism, state, body, vector_W):
    if body == GROUND:
        return vector_W
    return rotation_from_quaternion(state.quat_WB[mechanism.body_index[body]]).T @ vector_W


def contact_between(mechanism, state, kind, body, partner, rng, name="c", gap=0.0):
    """Return a contact at a random place of the body, with the given gap at the state, and random law."""
    centre = rng.normal(scale=0.3, size=3)
    at, _ = body_point(mechanism, state, body, centre)
    n = rotation(rng)[:, 0]
    r1, r2 = rng.uniform(0.1, 0.3, size=2)
    law = {"restitution": rng.uniform(0.0, 1.0), "friction": rng.choice([0.0, rng.uniform(0.05, 1.5)])}
    if kind is SphereSphere:
        other = in_body(mechanism, state, partner, at - (r1 + r2 + gap) * n)
        return SphereSphere(name, body, centre, r1, partner, other, r2, **law)
    shape = (centre, r1) if kind is SpherePlane else (centre,)
    below = at - (gap + (r1 if kind is SpherePlane else 0.0)) * n + np.cross(n, rng.normal(size=3))
    plane = in_body(mechanism, state, partner, below)
    return kind(name, body, *shape, partner, plane, turned_into(mechanism, state, partner, n), **law)


@pytest.mark.parametrize("kind", [SpherePlane, PointPlane, SphereSphere])
@pytest.mark.parametrize(("body", "partner"), [("hand", "leaf"), (GROUND, "tail"), ("arm", GROUND)])
def test_rate_of_the_gap_is_its_derivative_along_the_motion(kind, body, partner):
    mechanism = TREES["branched"]
    for seed, state in enumerate(states_of(mechanism)):
        rng = np.random.default_rng(seed)
        contact = contact_between(mechanism, state, kind, body, partner, rng, gap=0.2)
        motion = contact_motion(mechanism, state, contact)
        assert abs(motion.gap - 0.2) < 1e-12
        np.testing.assert_allclose(motion.on_body - motion.on_partner, 0.2 * motion.normal, rtol=0, atol=1e-12)
        h = 1e-5
        gaps = []
        for step in (-h, h):
            w = step * state.w_WB_W / 2
            length = np.linalg.norm(w, axis=1)
            half = np.column_stack([np.cos(length), np.sinc(length / np.pi)[:, None] * w])
            moved = np.array([hamilton(a, b) for a, b in zip(half, state.quat_WB, strict=True)])
            there = State(state.p_WB + step * state.v_WB_W, moved, state.v_WB_W, state.w_WB_W)
            gaps.append(contact_motion(mechanism, there, contact).gap)
        assert abs((gaps[1] - gaps[0]) / (2 * h) - motion.rate) < 1e-7 * max(1.0, abs(motion.rate))


def hamilton(a, b):
    q = np.concatenate([[a[0] * b[0] - a[1:] @ b[1:]], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])
    return q / np.linalg.norm(q)


# --- the equation against a dense solution --------------------------------------------------------------------------


def dense_impact(mechanism, state, contacts, hit):
    """Return velocities of all body origins after impact, (n_b, 6), in the modes of `hit`, by dense least squares.

    Unknowns are the velocities, the multipliers of all joint rows and the impulses of the contacts; mass matrix and
    joint rows are about the body origins and from the kinematics module, not from the reference solver.
    """
    n_b = len(mechanism.bodies)
    M = mass_matrix(mechanism, state)
    Q = constraint_jacobian(mechanism, state)
    v = np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
    impulses, velocities, asked = [], [], []
    for name, mode in zip(hit.contacts, hit.modes, strict=True):
        contact = next(c for c in contacts if c.name == name)
        J, n = point_rows(mechanism, state, contact)
        u = J @ v
        vt = u - (n @ u) * n
        slip = np.linalg.norm(vt)
        b = -contact.restitution * min(n @ u, 0.0)
        d = vt / slip if slip > 1e-9 else ZERO
        k = hit.contacts.index(name)
        if mode == "starting":
            d = -hit.tangential[k] / np.linalg.norm(hit.tangential[k])
        tangents = np.linalg.svd(n[None])[2][1:]
        table = {
            "released": [],
            "frictionless": [(n, n, b)],
            "unopposed": [(n, n, b)],
            "sliding": [(n - contact.friction * d, n, b)],
            "starting": [(n - contact.friction * d, n, b)],
            "halted": [(n, n, b), (d, d, 0.0)],
            "sticking": [(n, n, b), (tangents[0], tangents[0], 0.0), (tangents[1], tangents[1], 0.0)],
        }
        for impulse, velocity, value in table[mode]:
            impulses.append(J.T @ impulse)
            velocities.append(velocity @ J)
            asked.append(value)
    S = np.array(impulses).reshape(-1, 6 * n_b).T
    E = np.array(velocities).reshape(-1, 6 * n_b)
    q, m = len(Q), len(E)
    K = np.block([[M, -Q.T, -S], [Q, np.zeros((q, q + m))], [E, np.zeros((m, q + m))]])
    right = np.concatenate([M @ v, Q @ v, asked])
    scale = 1.0 / np.max(np.abs(K), axis=1)
    return np.linalg.lstsq(K * scale[:, None], right * scale, rcond=1e-11)[0][: 6 * n_b].reshape(-1, 6)


def mass_matrix(mechanism, state):
    R, inertias = rotation_from_quaternion(state.quat_WB), world_inertias(mechanism, state)
    M = np.zeros((6 * len(R), 6 * len(R)))
    for i, body in enumerate(mechanism.bodies):
        C, b = skew(R[i] @ body.com), slice(6 * i, 6 * i + 6)
        M[b, b] = np.block([[body.mass * ONE, -body.mass * C], [body.mass * C, inertias[i] - body.mass * C @ C]])
    return M


def point_rows(mechanism, state, contact):
    """Return the rows of the relative contact velocity over (v_WB_W, w_WB_W) of all bodies, and the normal."""
    motion = contact_motion(mechanism, state, contact)
    points = [
        (1.0, contact.body, in_body(mechanism, state, contact.body, motion.on_body)),
        (-1.0, contact.partner, in_body(mechanism, state, contact.partner, motion.on_partner)),
    ]
    columns = []
    for unit in np.eye(6 * len(mechanism.bodies)):
        v = unit.reshape(-1, 6)
        moving = State(state.p_WB, state.quat_WB, v[:, :3], v[:, 3:])
        columns.append(sum(sign * body_point(mechanism, moving, body, p)[1] for sign, body, p in points))
    return np.array(columns).T, motion.normal


MECHANISMS = TREES | LOOPS


@cache
def random_states_of(name, count):
    return states_of(MECHANISMS[name], count)


def random_contacts(mechanism, state, rng):
    bodies = [b.name for b in mechanism.bodies]
    contacts = []
    for n in range(rng.integers(1, 4)):
        kind = (SpherePlane, PointPlane, SphereSphere)[rng.integers(3)]
        body = bodies[rng.integers(len(bodies))]
        partner = rng.choice([b for b in (GROUND, *bodies) if b != body])
        contact = contact_between(mechanism, state, kind, body, str(partner), rng, f"c{n}")
        if contact_motion(mechanism, state, contact).rate < 0:
            contacts.append(contact)
    return tuple(contacts)


@cache
def random_hits(name, count):
    """Impacts of random contacts at random states; wedged mechanisms are skipped, and their number is limited."""
    mechanism, hits = MECHANISMS[name], []
    wedged = 0
    for seed, state in enumerate(random_states_of(name, count)):
        contacts = random_contacts(mechanism, state, np.random.default_rng(seed))
        if not contacts:
            continue
        try:
            hits.append((mechanism, contacts, solve_impact(mechanism, state, contacts)))
        except NumericalFailure:
            wedged += 1
    assert wedged <= count // 4
    return hits


@pytest.mark.parametrize("name", MECHANISMS)
def test_impact_agrees_with_a_dense_solution_and_with_the_balance_of_momentum(name):
    for mechanism, contacts, hit in random_hits(name, 12):
        state = hit.before
        v = np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
        after = np.hstack([hit.after.v_WB_W, hit.after.w_WB_W])
        scale = max(np.max(np.abs(after)), np.max(np.abs(v)))
        np.testing.assert_allclose(after, dense_impact(mechanism, state, contacts, hit), rtol=0, atol=1e-9 * scale)
        assert np.max(np.abs(constraint_jacobian(mechanism, state) @ after.ravel()), initial=0) < 1e-11 * scale
        given = np.zeros_like(v)
        for k, contact_name in enumerate(hit.contacts):
            contact = next(c for c in contacts if c.name == contact_name)
            J, n = point_rows(mechanism, state, contact)
            given += J.T @ (hit.normal[k] * n + hit.tangential[k])
            np.testing.assert_allclose(J @ after.ravel(), hit.velocity_after[k], rtol=0, atol=1e-10 * scale)
        given += joint_impulses(mechanism, state, hit)
        M = mass_matrix(mechanism, state)
        np.testing.assert_allclose(M @ (after.ravel() - v), given, rtol=0, atol=1e-10 * np.max(np.abs(M)) * scale)


def joint_impulses(mechanism, state, hit):
    """Return the wrenches of the recorded joint impulses on the bodies, about their origins."""
    wrench = np.zeros((len(mechanism.bodies), 6))
    for joint, force_F, torque_F in zip(mechanism.joints, hit.force_F, hit.torque_F, strict=True):
        i, j = mechanism.body_index[joint.predecessor], mechanism.body_index[joint.successor]
        U = joint.F.R if i < 0 else rotation_from_quaternion(state.quat_WB[i]) @ joint.F.R
        point, _ = body_point(mechanism, state, joint.successor, joint.M.p)
        for b, sign in ((i, -1.0), (j, 1.0)):
            if b >= 0:
                force = sign * U @ force_F
                wrench[b, :3] += force
                wrench[b, 3:] += sign * U @ torque_F + np.cross(point - state.p_WB[b], force)
    return wrench.ravel()


@pytest.mark.parametrize("name", MECHANISMS)
def test_modes_are_what_their_conditions_say_and_energy_does_not_grow(name):
    for _, contacts, hit in random_hits(name, 12):
        law = [next(c for c in contacts if c.name == n) for n in hit.contacts]
        n, before, after = hit.directions, hit.velocity_before, hit.velocity_after
        vn, wn = np.sum(before * n, axis=1), np.sum(after * n, axis=1)
        slack = 1e-7 * np.max(np.abs(np.hstack([hit.before.v_WB_W, hit.before.w_WB_W])))
        push = 1e-7 * max(np.max(np.abs(hit.normal)), np.max(np.abs(hit.tangential)))
        for k, contact in enumerate(law):
            assert hit.normal[k] >= -push
            assert np.linalg.norm(hit.tangential[k]) <= contact.friction * hit.normal[k] + push
            assert wn[k] >= -contact.restitution * vn[k] - slack
            assert hit.modes[k] == "released" or abs(wn[k] + contact.restitution * vn[k]) <= slack
            d = before[k] - vn[k] * n[k]
            d /= np.linalg.norm(d)
            if hit.modes[k] == "sliding":
                expected = -contact.friction * hit.normal[k] * d
                np.testing.assert_allclose(hit.tangential[k], expected, rtol=0, atol=push)
                assert d @ after[k] >= -slack
            if hit.modes[k] == "sticking":
                np.testing.assert_allclose(after[k], wn[k] * n[k], rtol=0, atol=slack)
            if hit.modes[k] in ("halted", "unopposed"):
                assert d @ after[k] <= slack
        loss = hit.energy_before - hit.energy_after
        assert min(hit.restitution_loss, hit.friction_loss) >= -1e-10 * hit.energy_before
        assert abs(loss - hit.restitution_loss - hit.friction_loss) <= 1e-10 * hit.energy_before


@pytest.mark.parametrize("name", ["backward_screw", "coupled", "rolling_torus", "skating"])
def test_screws_couplings_rolling_and_skates_hold_through_an_impact(name):
    mechanism = ELEMENTS[name]
    for seed, state in enumerate(states_of(mechanism, 4)):
        contacts = random_contacts(mechanism, state, np.random.default_rng(seed))
        hit = solve_impact(mechanism, state, contacts)
        after = np.hstack([hit.after.v_WB_W, hit.after.w_WB_W])
        scale = np.max(np.abs(after))
        np.testing.assert_allclose(after, dense_impact(mechanism, state, contacts, hit), rtol=0, atol=1e-9 * scale)
        loss = hit.energy_before - hit.energy_after
        assert abs(loss - hit.restitution_loss - hit.friction_loss) <= 1e-10 * hit.energy_before


def test_every_mode_of_contacts_that_slide_before_occurs_at_random_contacts():
    hits = [hit for name in ("branched", "single_free", "long_chain") for _, _, hit in random_hits(name, 25)]
    found = {mode for hit in hits for mode in hit.modes}
    assert found == {"frictionless", "sliding", "sticking", "halted", "unopposed", "released"}


@pytest.mark.parametrize("mu", [0.02, 0.1, 0.3, 2.0])
@pytest.mark.parametrize("seed", range(4))
def test_contact_without_sliding_before_sticks_or_slides_against_friction(seed, mu):
    rng = np.random.default_rng(seed)
    mechanism = TREES["single_free"]
    state = states_of(mechanism)[seed]
    contact = replace(contact_between(mechanism, state, PointPlane, mechanism.bodies[0].name, GROUND, rng), friction=mu)
    motion = contact_motion(mechanism, state, contact)
    straight = state.v_WB_W - motion.velocity - 1.5 * motion.normal  # the corner now approaches along the normal
    state = State(state.p_WB, state.quat_WB, straight, state.w_WB_W)
    hit = solve_impact(mechanism, state, (contact,))
    vt = hit.velocity_after[0] - (hit.velocity_after[0] @ hit.directions[0]) * hit.directions[0]
    if hit.modes == ("sticking",):
        np.testing.assert_allclose(vt, 0.0, rtol=0, atol=1e-12)
        assert np.linalg.norm(hit.tangential[0]) <= mu * hit.normal[0]
    else:
        assert hit.modes == ("starting",)
        expected = -mu * hit.normal[0] * vt / np.linalg.norm(vt)
        np.testing.assert_allclose(hit.tangential[0], expected, rtol=0, atol=1e-10)
    after = np.hstack([hit.after.v_WB_W, hit.after.w_WB_W])
    np.testing.assert_allclose(after, dense_impact(mechanism, state, (contact,), hit), rtol=0, atol=1e-9)
    assert hit.restitution_loss >= 0
    assert hit.friction_loss >= -1e-14
    assert (mu == 2.0) <= (hit.modes == ("sticking",))


def test_impulses_that_a_tree_determines_are_determined_and_match_reactions():
    """In a tree without redundant rows, joint impulses follow from the change of momentum outboard of the joint."""
    for mechanism, _, hit in random_hits("long_chain", 6):
        assert np.all(determinate_reactions(mechanism, hit.before))
        last = mechanism.joints[-1]
        frames = reaction_map(mechanism, hit.before, last)
        wrench = np.concatenate([hit.force_F[-1], hit.torque_F[-1]])
        along = np.linalg.lstsq(frames, wrench, rcond=None)[0]
        np.testing.assert_allclose(frames @ along, wrench, rtol=0, atol=1e-12 * max(1.0, np.max(np.abs(wrench))))


# --- several contacts, one body -------------------------------------------------------------------------------------


def floating(*bodies, gravity=ZERO):
    joints = tuple(Joint(f"free_{b.name}", "free", GROUND, b.name, AT_HOME, AT_HOME) for b in bodies)
    return Mechanism("floating", gravity, bodies, joints)


def ball(name, mass=1.0, radius=0.1):
    return Body(name, mass, ZERO, 0.4 * mass * radius**2 * ONE, AT_HOME)


def at_rest(*p):
    return State(np.array(p, float), np.tile([1.0, 0, 0, 0], (len(p), 1)), np.zeros((len(p), 3)), np.zeros((len(p), 3)))


def moving(p, v):
    return replace(at_rest(*p), v_WB_W=np.array(v, float))


def floor(body, restitution, normal=Z, radius=0.1, name="floor"):
    return SpherePlane(name, body, ZERO, radius, GROUND, ZERO, normal, restitution=restitution)


@pytest.mark.parametrize("friction", [0.0, 0.1, 5.0])
def test_twelve_corners_of_a_prism_that_lands_flat_act_as_one(friction):
    m, s, v = 2.0, 0.4, np.array([0.8, 0.3, -1.7])
    prism = Body("prism", m, ZERO, np.diag([0.1, 0.12, 0.2]), AT_HOME)
    angles = 2 * np.pi * np.arange(12) / 12
    corners = [np.array([0.5 * np.cos(a), 0.5 * np.sin(a), 0.0]) for a in angles]
    contacts = tuple(
        PointPlane(f"c{n}", "prism", c, GROUND, ZERO, Z, restitution=s, friction=friction)
        for n, c in enumerate(corners)
    )
    hit = solve_impact(floating(prism), moving([ZERO], [v]), contacts)
    N = m * (1 + s) * 1.7
    slip = np.hypot(0.8, 0.3)
    left = max(0.0, 1 - friction * N / (m * slip))
    np.testing.assert_allclose(hit.after.v_WB_W[0], [0.8 * left, 0.3 * left, s * 1.7], rtol=0, atol=1e-9)
    np.testing.assert_allclose(hit.after.w_WB_W[0], ZERO, rtol=0, atol=1e-9)
    assert abs(np.sum(hit.normal) - N) < 1e-9


def test_restitution_that_differs_between_corners_is_met_where_it_asks_most():
    """Two corners of a slide that only translates have the coefficients 0.2 and 0.9: the larger one holds."""
    slide = Body("slide", 1.0, ZERO, np.diag([0.1, 0.1, 0.1]), AT_HOME)
    mechanism = Mechanism("m", ZERO, (slide,), (Joint("j", "prismatic", GROUND, "slide", AT_HOME, AT_HOME),))
    contacts = tuple(
        PointPlane(f"c{n}", "slide", np.array([x, 0, 0]), GROUND, ZERO, Z, restitution=s)
        for n, (x, s) in enumerate([(-0.3, 0.2), (0.3, 0.9)])
    )
    hit = solve_impact(mechanism, moving([ZERO], [-2 * Z]), contacts)
    assert hit.modes == ("released", "frictionless")
    np.testing.assert_allclose(hit.after.v_WB_W[0], 1.8 * Z, rtol=0, atol=1e-12)


# --- simulation -----------------------------------------------------------------------------------------------------


def states_at(answer):
    arrays = (answer.p_WB, answer.quat_WB, answer.v_WB_W, answer.w_WB_W)
    return [State(*(a[n] for a in arrays)) for n in range(len(answer.time))]


@pytest.fixture(scope="module")
def stopped_linkage():
    """Return a four-bar with a stop that a point of its coupler reaches 0.437 s after release."""
    mechanism = four_bar()
    start = initial_state(mechanism)
    free = states_at(simulate(mechanism, start, np.array([0.0, 0.437])))[-1]
    point = np.array([0.1, -0.2, 0.15])
    p, v = body_point(mechanism, free, "coupler", point)
    stop = PointPlane("stop", "coupler", point, GROUND, p, -v, restitution=0.7, friction=0.3)
    times = np.linspace(0.0, 2.4, 49)
    return mechanism, start, stop, times, *simulate_with_impacts(mechanism, start, times, (stop,))


def test_linkage_reaches_its_stop_when_the_free_motion_does(stopped_linkage):
    mechanism, start, _, times, answer, impacts = stopped_linkage
    assert len(impacts) >= 2
    assert abs(impacts[0].time - 0.437) < 1e-10
    before = times[times < 0.437]
    free = simulate(mechanism, start, before)
    np.testing.assert_allclose(answer.p_WB[: len(before)], free.p_WB, rtol=0, atol=1e-10)
    np.testing.assert_allclose(answer.w_WB_W[: len(before)], free.w_WB_W, rtol=0, atol=1e-10)


def test_linkage_with_a_stop_goes_on_as_the_free_linkage_from_the_velocities_after(stopped_linkage):
    mechanism, _, _, times, answer, impacts = stopped_linkage
    between = times[(times > impacts[0].time) & (times < impacts[1].time)]
    free = simulate(mechanism, impacts[0].after, np.concatenate([[impacts[0].time], between]))
    first = int(np.searchsorted(times, impacts[0].time))
    np.testing.assert_allclose(answer.p_WB[first : first + len(between)], free.p_WB[1:], rtol=0, atol=1e-10)
    np.testing.assert_allclose(answer.w_WB_W[first : first + len(between)], free.w_WB_W[1:], rtol=0, atol=1e-10)


def test_linkage_with_a_stop_balances_its_energy_and_keeps_its_joints(stopped_linkage):
    mechanism, start, stop, times, answer, impacts = stopped_linkage
    energy = kinetic_energy(mechanism, start) + potential_energy(mechanism, start)
    for t, s in zip(times, states_at(answer), strict=True):
        lost = sum(i.restitution_loss + i.friction_loss for i in impacts if i.time <= t)
        now = kinetic_energy(mechanism, s) + potential_energy(mechanism, s)
        assert abs(now + lost - energy) < 1e-10 * abs(energy)
        assert np.max(np.abs(constraint_residual(mechanism, s))) < 1e-12
        rate = constraint_jacobian(mechanism, s) @ np.hstack([s.v_WB_W, s.w_WB_W]).ravel()
        assert np.max(np.abs(rate)) < 1e-11
        assert contact_motion(mechanism, s, stop).gap > -1e-12
    for hit in impacts:
        assert abs(contact_motion(mechanism, hit.before, stop).gap) < 1e-14
        after = dense_impact(mechanism, hit.before, (stop,), hit)
        np.testing.assert_allclose(np.hstack([hit.after.v_WB_W, hit.after.w_WB_W]), after, rtol=0, atol=1e-9)


def test_rotated_world_gives_the_rotated_motion():
    rng = np.random.default_rng(4)
    R = rotation(rng)
    bodies = [lumpy_body(name, rng) for name in "ab"]
    poses, w = [rotation(rng) for _ in bodies], rng.normal(size=(2, 3))
    p, v = np.array([[0.0, 0, 0.6], [0.1, 0.2, 1.7]]), np.array([[0.4, 0, 0], [-0.1, 0.2, -1]])
    answers = []
    for turn in (ONE, R):
        mechanism = floating(*bodies, gravity=-9.81 * turn[:, 2])
        start = State(p @ turn.T, quaternion_from_rotation(turn @ poses), v @ turn.T, w @ turn.T)
        contacts = (
            SpherePlane("fa", "a", ZERO, 0.3, GROUND, ZERO, turn[:, 2], restitution=0.8, friction=0.3),
            SpherePlane("fb", "b", ZERO, 0.3, GROUND, ZERO, turn[:, 2], restitution=0.7, friction=0.2),
            SphereSphere("ab", "a", ZERO, 0.3, "b", ZERO, 0.3, restitution=0.9, friction=0.4),
        )
        answers.append(simulate_with_impacts(mechanism, start, np.linspace(0, 0.8, 9), contacts))
    (one, hits), (two, turned) = answers
    assert [h.contacts for h in hits] == [h.contacts for h in turned]
    assert {c for h in hits for c in h.contacts} == {"fa", "fb", "ab"}
    np.testing.assert_allclose([h.time for h in hits], [h.time for h in turned], rtol=0, atol=1e-11)
    np.testing.assert_allclose(one.p_WB @ R.T, two.p_WB, rtol=0, atol=1e-9)
    np.testing.assert_allclose(one.w_WB_W @ R.T, two.w_WB_W, rtol=0, atol=1e-8)


def test_free_bodies_keep_their_momentum_and_an_action_has_its_reaction():
    rng = np.random.default_rng(9)
    mechanism = floating(lumpy_body("a", rng), lumpy_body("b", rng))
    start = moving([ZERO, [2.0, 0.1, 0]], [X, -X])
    contact = SphereSphere("ab", "a", ZERO, 0.4, "b", ZERO, 0.4, restitution=0.5, friction=0.6)
    answer, impacts = simulate_with_impacts(mechanism, start, np.array([0.0, 2.0]), (contact,))
    assert impacts
    end = states_at(answer)[-1]
    expected = linear_momentum(mechanism, start)
    np.testing.assert_allclose(linear_momentum(mechanism, end), expected, rtol=0, atol=1e-12)


def test_equal_falls_make_one_simultaneous_impact_and_other_falls_another():
    mechanism = floating(ball("a"), ball("b"), ball("c"), gravity=-9.81 * Z)
    start = at_rest([0, 0, 1.1], [1, 0, 1.1], [2, 0, 1.2])
    contacts = tuple(floor(n, 0.5, name=f"f{n}") for n in "abc")
    _, impacts = simulate_with_impacts(mechanism, start, np.array([0.0, 0.5]), contacts)
    assert [i.contacts for i in impacts] == [("fa", "fb"), ("fc",)]


def test_a_contact_thrown_together_by_an_impact_follows_at_the_same_instant():
    balls = [ball(n) for n in "abc"]
    contacts = tuple(SphereSphere(f"{p}{q}", p, ZERO, 0.1, q, ZERO, 0.1, restitution=1.0) for p, q in ("ab", "bc"))
    start = moving([[-0.2, 0, 0], ZERO, [0.2, 0, 0]], [2 * X, ZERO, 0.5 * X])  # b and c are in contact, but separating
    answer, impacts = simulate_with_impacts(floating(*balls), start, np.array([0.0, 1.0]), contacts)
    assert [(i.time, i.contacts) for i in impacts] == [(0.0, ("ab",)), (0.0, ("bc",))]
    np.testing.assert_allclose(answer.v_WB_W[-1], [ZERO, 0.5 * X, 2 * X], rtol=0, atol=1e-12)


def test_spheres_that_stick_together_without_force_go_on_together():
    contact = SphereSphere("ab", "a", ZERO, 0.1, "b", ZERO, 0.1)
    start = moving([ZERO, [1.0, 0, 0]], [X, ZERO])
    answer, impacts = simulate_with_impacts(floating(ball("a"), ball("b")), start, np.array([0.0, 5.0]), (contact,))
    assert len(impacts) == 1
    np.testing.assert_allclose(answer.v_WB_W[-1], [0.5 * X, 0.5 * X], rtol=0, atol=1e-12)


def test_sample_at_the_instant_of_an_impact_has_the_velocities_after():
    start = moving([[0, 0, 1.1]], [-2 * Z])
    answer, (hit,) = simulate_with_impacts(floating(ball("a")), start, np.array([0.0, 0.5, 0.75]), (floor("a", 0.5),))
    assert hit.time == pytest.approx(0.5, abs=1e-14)
    np.testing.assert_allclose(answer.v_WB_W[1, 0], Z, rtol=0, atol=1e-12)


def test_an_apex_that_just_touches_the_ceiling_is_no_impact():
    ceiling = floor("a", 0.5, normal=-Z)
    start = moving([[0, 0, -1.1]], [np.sqrt(2 * 9.81) * Z])
    mechanism = floating(ball("a"), gravity=-9.81 * Z)
    answer, impacts = simulate_with_impacts(mechanism, start, np.array([0.0, 0.7]), (ceiling,))
    assert impacts == ()
    assert abs(answer.p_WB[-1, 0, 2] - (-1.1 + np.sqrt(2 * 9.81) * 0.7 - 0.5 * 9.81 * 0.49)) < 1e-12


def test_turns_of_a_joint_spring_are_remembered_through_impacts():
    """The angle of a wound-up rotor is counted on through the impacts of a ball without connection to the rotor."""
    rotor = Body("rotor", 1.0, ZERO, np.diag([0.1, 0.1, 0.15]), AT_HOME)
    joints = (
        Joint("axle", "revolute", GROUND, "rotor", AT_HOME, AT_HOME),
        Joint("free", "free", GROUND, "a", AT_HOME, AT_HOME),
    )
    spring = JointSpring("coil", "axle", "angle", 0.05, 0.0, 0.0)
    mechanism = Mechanism("m", -9.81 * Z, (rotor, ball("a")), joints, joint_springs=(spring,))
    start = at_rest(ZERO, [0, 0, 0.5])
    start = replace(start, w_WB_W=np.array([7 * Z, ZERO]))
    times = np.linspace(0.0, 2.5, 11)
    answer, impacts = simulate_with_impacts(mechanism, start, times, (floor("a", 0.9),))
    assert len(impacts) > 3
    rate = np.sqrt(0.05 / 0.15)
    assert 7 / rate > 3 * np.pi
    np.testing.assert_allclose(answer.w_WB_W[:, 0, 2], 7 * np.cos(rate * times), rtol=0, atol=1e-9)


# --- refusals -------------------------------------------------------------------------------------------------------


def test_bounces_that_accumulate_end_at_their_limit_and_the_ball_stays_on_the_floor():
    mechanism, start = floating(ball("a"), gravity=-9.81 * Z), at_rest([0, 0, 1.1])
    fall = np.sqrt(2 / 9.81)
    rest = fall * (1 + 2 * 0.5 / (1 - 0.5))
    mechanism = replace(mechanism, contacts=(floor("a", 0.5),))
    answer, events = simulate_with_contacts(mechanism, start, np.array([0.0, 1.35, 2.0]))
    assert {event.kind for event in events} == {"impact", "bounces end"}
    assert abs(events[-1].time - rest) < 1e-9
    assert answer.contact_mode.tolist() == [[0], [0], [1]]
    np.testing.assert_allclose(answer.p_WB[-1, 0], 0.1 * Z, rtol=0, atol=1e-11)
    np.testing.assert_allclose(answer.v_WB_W[-1, 0], ZERO, rtol=0, atol=1e-11)
    assert abs(np.sum(answer.contact_impulse[:, 0, 2]) - 9.81 * mechanism.bodies[0].mass * 2.0) < 1e-10


def test_a_rebound_up_to_the_threshold_is_none():
    """The third rebound of a fall from 1 m at e = 0.5 would have 0.5^3 sqrt(2 g) = 0.5537 m/s."""
    fall = np.sqrt(2 / 9.81)
    instants = fall * np.array([1.0, 2.0, 2.5])  # and the third impact is the last
    laws = {0.553: 4, 0.554: 3}
    for threshold, count in laws.items():
        contact = replace(floor("a", 0.5), rebound_threshold=threshold)
        mechanism = replace(floating(ball("a"), gravity=-9.81 * Z), contacts=(contact,))
        answer, events = simulate_with_contacts(mechanism, at_rest([0, 0, 1.1]), np.array([0.0, 2.0]))
        hits = [event.time for event in events if event.kind == "impact"]
        assert len(hits) == count
        np.testing.assert_allclose(hits[:3], instants, rtol=0, atol=1e-11)
        np.testing.assert_allclose(answer.p_WB[-1, 0], 0.1 * Z, rtol=0, atol=1e-11)
        assert answer.contact_mode[-1].tolist() == [1]


def test_a_body_at_rest_on_the_floor_stays_with_its_weight_as_the_force():
    mechanism = replace(floating(ball("a"), gravity=-9.81 * Z), contacts=(floor("a", 0.5),))
    answer, events = simulate_with_contacts(mechanism, at_rest([0, 0, 0.1]), np.array([0.0, 2.0]))
    assert not events
    np.testing.assert_allclose(answer.p_WB[-1, 0], 0.1 * Z, rtol=0, atol=1e-15)
    assert abs(answer.contact_impulse[-1, 0, 2] - 2.0 * 9.81 * mechanism.bodies[0].mass) < 1e-12


def test_overlap_at_the_start_is_refused_with_its_depth():
    with pytest.raises(InvalidInput, match=r"contact 'floor': 'a' and 'ground' overlap by 0\.03 m"):
        simulate_with_impacts(floating(ball("a")), at_rest([0, 0, 0.07]), np.array([0.0, 1.0]), (floor("a", 0.5),))


def test_body_that_cannot_give_way_is_refused_as_wedged():
    post = Mechanism("m", ZERO, (ball("a"),), (Joint("j", "rigid", GROUND, "a", AT_HOME, AT_HOME),))
    with pytest.raises(
        NumericalFailure, match=r"t = 3 s: no combination .* is admissible for .* wedged, .* a compliance"
    ):
        solve_impact(post, moving([[0, 0, 0.1]], [-Z]), (floor("a", 0.5),), time=3.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"restitution": 1.1}, "restitution: 1.1 is out of range"),
        ({"restitution": -0.1}, "restitution"),
        ({"friction": -1.0}, "friction"),
        ({"radius": 0.0}, "radius"),
        ({"normal": ZERO}, "normal: it is the zero vector"),
        ({"center": np.zeros(2)}, "center"),
        ({"partner": "a"}, "both sides are 'a'"),
    ],
)
def test_contact_that_makes_no_sense_is_refused(change, message):
    with pytest.raises(InvalidInput, match=f"contact 'floor'.*{message}"):
        replace(floor("a", 0.5), **change)


def test_contacts_of_unknown_bodies_or_with_equal_names_are_refused():
    mechanism, start = floating(ball("a")), at_rest([0, 0, 1.0])
    with pytest.raises(InvalidInput, match="there is no body 'b'"):
        solve_impact(mechanism, start, (floor("b", 0.5),))
    with pytest.raises(InvalidInput, match="'floor': the name is used twice"):
        simulate_with_impacts(mechanism, start, np.array([0.0, 1.0]), (floor("a", 0.5), floor("a", 0.6)))


@pytest.mark.parametrize(("times", "tolerance"), [([0.0, 1.0], 1e-15), ([0.0, 0.0], 1e-12), ([1.0, 0.0], 1e-12)])
def test_times_and_tolerances_out_of_order_are_refused(times, tolerance):
    with pytest.raises(InvalidInput):
        simulate_with_impacts(floating(ball("a")), at_rest([0, 0, 1.0]), np.array(times), (), tolerance)
