"""Modes of random contact problems whose solution was chosen first, and of joints with stops and dry friction."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.case import load_cases
from consilience.engine import Question, load_engine
from consilience.errors import InvalidInput, NumericalFailure
from consilience.reference.contact.decision import decide
from consilience.reference.contact.inclusion import residual
from consilience.reference.contact.joint_friction import JointReaction, decide_with_reactions
from consilience.reference.contact.layout import layout_of
from consilience.reference.contact.problem import ContactProblem, FrictionSet


def violated(problem, force, acceleration):
    """Largest violation of Signorini's and Coulomb's laws (circles), written down again, in units of the largest."""
    size, rate = np.max(np.abs(force)) or 1.0, np.max(np.abs(problem.free))
    found = [0.0]
    for n in problem.normals:
        N, a = force[n], acceleration[n]
        found += [-N / size, -a / rate, abs(N * a) / (size * rate)]
    for f in problem.friction:
        rows = list(f.rows)
        T, bound, w, u = force[rows], f.kinetic * force[f.load], acceleration[rows], problem.sliding[rows]
        if np.any(u):
            found.append(np.max(np.abs(T + bound * u / np.linalg.norm(u))) / size)
        else:
            found += [(np.linalg.norm(T) - bound) / size, (T @ w + bound * np.linalg.norm(w)) / (size * rate)]
    return max(found)


def planted(rng, contacts, mu):
    """Problem of up to four lumpy bodies between walls with a solution chosen first, and that solution."""
    m, bodies = 3 * contacts, 1 + contacts // 2
    K = rng.normal(size=(m, 6 * bodies)) * rng.uniform(0.5, 2.0, size=6 * bodies)
    G = K @ K.T
    force, acceleration, sliding = np.zeros(m), np.zeros(m), np.zeros(m)
    for n in range(0, m, 3):
        t = slice(n + 1, n + 3)
        mode, heading = rng.choice(["open", "stick", "start", "slide"]), rng.normal(size=2)
        force[n], direction = rng.uniform(0.5, 2.0), heading / np.linalg.norm(heading)
        if mode == "open":
            force[n], acceleration[n], acceleration[t] = 0.0, rng.uniform(0.5, 2.0), heading
        elif mode == "stick":
            force[t] = rng.uniform(0.0, 0.9) * mu * force[n] * direction
        else:
            force[t], acceleration[t] = -mu * force[n] * direction, rng.uniform(0.5, 2.0) * direction
            if mode == "slide":
                sliding[t], acceleration[t] = heading, rng.normal(size=2)
    friction = tuple(FrictionSet(f"c{n // 3}", (n + 1, n + 2), mu, mu, n) for n in range(0, m, 3))
    names = tuple(f"c{row // 3}" for row in range(m))
    problem = ContactProblem(G, acceleration - G @ force, names, tuple(range(0, m, 3)), friction, sliding)
    return problem, force, acceleration


@pytest.mark.parametrize("contacts", [1, 2, 3, 8])
def test_planted_solutions_are_found(contacts):
    rng = np.random.default_rng(350 + contacts)
    for _ in range(6):
        problem, force, acceleration = planted(rng, contacts, mu=0.5)
        assert violated(problem, force, acceleration) < 1e-12
        found = decide(problem, exhaustive=contacts < 4)
        assert violated(problem, found.force, found.acceleration) < 1e-10
        size = np.max(np.abs(problem.free))
        answers = [found.acceleration, *(other.acceleration for other in found.others)]
        distances = [np.max(np.abs(answer - acceleration)) for answer in answers]
        assert found.unique is None or min(distances) < 1e-8 * size


@pytest.mark.parametrize(("cone", "contacts"), [("diamond", 2), ("diamond", 8), ("box", 2), ("box", 8)])
def test_planted_solutions_of_pyramids_and_boxes_are_found(cone, contacts):
    # the forces of the planted circles are replaced by those of greatest dissipation in the other cone
    rng = np.random.default_rng(351)
    for _ in range(6):
        problem, force, acceleration = planted(rng, contacts, mu=0.5)
        sets = []
        for f in problem.friction:
            rows, u, N = list(f.rows), problem.sliding[list(f.rows)], force[f.load]
            heading = u if np.any(u) else acceleration[rows]
            if cone == "box":
                sets += [replace(f, rows=(row,)) for row in rows]
                signs = np.where(heading == 0.0, -force[rows] / max(0.5 * N, 1e-300), np.sign(heading))
                force[rows] = -0.5 * N * signs
            else:
                sets.append(replace(f, facets=4))
                corners = 0.5 * N * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
                force[rows] = corners[np.argmin(corners @ heading)] if np.any(heading) else 0.5 * force[rows]
        problem = replace(problem, friction=tuple(sets), free=acceleration - problem.delassus @ force)
        found = decide(problem)
        assert np.max(np.abs(residual(problem, found.force, found.acceleration))) < 1e-11
        if found.unique:
            np.testing.assert_allclose(found.acceleration, acceleration, atol=1e-8 * np.max(np.abs(problem.free)))


def test_without_friction_the_accelerations_are_unique():
    # G positive semidefinite: two solutions differ by d with d . G d <= 0
    rng = np.random.default_rng(3)
    for _ in range(20):
        K = rng.normal(size=(8, 5))
        force = np.where(rng.random(8) < 0.5, rng.uniform(0.5, 2.0, 8), 0.0)
        acceleration = np.where(force > 0.0, 0.0, rng.uniform(0.5, 2.0, 8))
        problem = ContactProblem(K @ K.T, acceleration - K @ (K.T @ force), tuple("abcdefgh"), tuple(range(8)))
        found = decide(problem)
        assert found.unique
        np.testing.assert_allclose(found.acceleration, acceleration, atol=1e-9)


def test_joint_with_stop_and_dry_friction():
    # one coordinate of inertia 0.5, bound 0.2: it rests, is pressed on a stop, or slides against the bound
    def hinge(torque, stop, rate=0.0):
        G, names = np.full((2, 2), 2.0), ("stop", "dry")
        dry = FrictionSet("dry", (1,), 1.0, 1.0, offset=0.2)
        if stop:
            return ContactProblem(G, 2.0 * torque * np.ones(2), names, (0,), (dry,), np.array([0.0, rate]))
        return ContactProblem(
            G[1:, 1:], 2.0 * torque * np.ones(1), names[1:], (), (replace(dry, rows=(0,)),), np.array([rate])
        )

    assert decide(hinge(0.15, False)).force[0] == pytest.approx(-0.15, rel=1e-12)
    assert decide(hinge(0.5, False)).acceleration[0] == pytest.approx(2.0 * 0.3, rel=1e-12)
    assert decide(hinge(0.5, False, -1.0)).acceleration[0] == pytest.approx(2.0 * 0.7, rel=1e-12)
    pressed = decide(hinge(-0.5, True))
    np.testing.assert_allclose(pressed.acceleration, 0.0, atol=1e-12)
    assert np.sum(pressed.force) == pytest.approx(0.5, rel=1e-12)
    assert pressed.undetermined.shape[1] == 1  # stop and friction share the effort


def test_dry_friction_of_a_reaction():
    # slide of 2 kg driven by 7 N, reaction (3, 5 + 0.8 T) N, mu 0.4, T = -mu |F|: b^2 (1 - 0.32^2) + 3.2 b - 34 = 0
    dry = FrictionSet("dry", (0,), 0.4, 0.4)
    reactions = {0: JointReaction(np.array([3.0, 5.0]), np.array([[0.0], [0.8]]))}
    slides = ContactProblem(np.array([[0.5]]), np.array([3.5]), ("dry",), (), (dry,), np.array([0.2]))
    bound = (-3.2 + np.sqrt(3.2**2 + 4.0 * 34.0 * (1.0 - 0.32**2))) / (2.0 * (1.0 - 0.32**2))
    _, found = decide_with_reactions(slides, reactions, decide)
    np.testing.assert_allclose(found.force, [-0.4 * bound], rtol=1e-13)
    # at rest and driven by 1.5 N it sticks, T = -1.5 within 0.4 |(3, 3.8)|
    rests = replace(slides, free=np.array([0.75]), sliding=np.zeros(1))
    problem, found = decide_with_reactions(rests, reactions, decide)
    np.testing.assert_allclose(found.force, [-1.5], rtol=1e-13)
    assert problem.friction[0].offset == pytest.approx(np.hypot(3.0, 3.8), rel=1e-13)
    # friction that raises its own reaction faster than its bound
    locked = {0: JointReaction(np.array([3.0, 5.0]), np.array([[0.0], [-3.0]]))}
    with pytest.raises(NumericalFailure, match="dry: the joint locks itself"):
        decide_with_reactions(slides, locked, decide)


def test_laws_without_equations_are_refused_by_name():
    # an answer without the rebound, or without the lift, would be one to another question
    mechanism = load_cases("bowling")[0].mechanism
    contacts = tuple(replace(c, associated=True, restitution=0.3) for c in mechanism.contacts)
    mechanism = replace(mechanism, contacts=contacts)
    engine = load_engine("reference")
    assert [one.feature for one in engine.unsupported(mechanism, Question.TRAJECTORY)] == ["contact 'floor'"]
    assert engine.unsupported(mechanism, Question.MODEL) == ()
    with pytest.raises(InvalidInput, match="contact 'floor': an associated cone is a circle, without rebound"):
        layout_of(mechanism)
