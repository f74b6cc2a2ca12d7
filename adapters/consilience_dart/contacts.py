"""Contacts and stops in DART's world: pads with shapes, the pairs that may collide, and what each step leaves.

Each side of a contact is a pad: a massless node welded to its body, with the shapes of this contact alone. All pairs of
pads but the declared ones are on DART's black list, which knows nodes and not shapes. So a contact has its own friction
and restitution, although DART combines those of shapes: friction by the minimum, restitution by the product.

All spheres are `INSIDE` larger than they are, because DART does not take a gap of zero, with rounding, for a contact; a
point is a sphere of this radius.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any

import dartpy
import numpy as np

from consilience.mechanism import GROUND, Array, Contact, SphereSphere, State, contact_gap, contact_parts, cross
from consilience_dart.state import read
from consilience_dart.translation import Model, set_inertia

INSIDE = 1e-12

SEPARATED, SLIDING, STICKING = range(3)

AT_REST = 1e-6
"""Slip in m/s below which a contact sticks: DART's force mixing of 1e-5 lets it creep."""

FrictionSolver = tuple[str, str, int, float]
"""Class in `dartpy.constraint`, its option for the largest number of iterations, that number, and the tolerance."""

FRICTION: tuple[FrictionSolver, ...] = (
    ("NsgsFrictionSolver", "maxSweeps", 100, 1e-11),
    ("FbfFrictionSolver", "maxOuterIterations", 100, 1e-9),
    ("FbfFrictionSolver", "maxOuterIterations", 2000, 1e-9),
)
"""Solvers of friction in motions. A step whose friction one has not solved is repeated by the next: DART's substitute
has boxes in place of cones, by which what slides goes astray. The first has two digits more than the second, which by
1e-10 fails where a ball rolls between two walls, whose forces are not determined; the second solves boxes that slide on
several corners, where the first may not converge."""

TOO_MANY = 0.05
"""Part of the solutions of friction that may fail: where a body with several contacts rests, and forces of friction are
not determined, a few do, and DART's substitute holds the body."""


def _frame(R: Array, p: Array) -> Any:
    transform = dartpy.math.Isometry3()
    transform.set_rotation(R)
    transform.set_translation(p)
    return transform


Motion = tuple[Array, Array, Array]
"""Position, velocity and angular velocity, world axes."""


class _Pad:
    """Node of one side of a contact, at the centre of mass of its body, in axes of the body."""

    def __init__(self, model: Model, ground: Any, body: str, name: str) -> None:
        index = model.mechanism.body_index[body]
        self._center = np.zeros(3) if index < 0 else model.mechanism.bodies[index].com
        if index < 0:
            joint, self.node = ground.createWeldJointAndBodyNodePair()
        else:
            carrier = model.carriers[index]
            joint, self.node = model.skeleton.createWeldJointAndBodyNodePair(model.nodes[carrier])
            frame = model.tree.links[carrier].body_frame
            joint.setTransformFromParentBodyNode(_frame(frame.R, frame.p + frame.R @ self._center))
            set_inertia(self.node, 0.0, np.zeros(3), np.zeros((3, 3)))
        self.node.setName(name)

    def add(self, shape: Any, position: Array, law: Contact, restitution: float) -> None:
        """Add a shape at a position in axes of the body."""
        node = self.node.createShapeNode(shape)
        node.setRelativeTranslation(position - self._center)
        node.createCollisionAspect()
        node.createDynamicsAspect()
        aspect = node.getDynamicsAspect()
        aspect.setFrictionCoeff(law.friction)
        aspect.setRestitutionCoeff(restitution)

    def motion(self) -> Motion:
        """Return position, velocity and angular velocity of the node, world axes."""
        return (
            np.array(self.node.getWorldTransform().translation()),
            np.array(self.node.getLinearVelocity()),
            np.array(self.node.getAngularVelocity()),
        )


def _shapes(pads: tuple[_Pad, _Pad], contact: Contact) -> None:
    """Give the shapes of a contact to its pads; the restitution stands on the body's side, 1 on the partner's."""
    body, partner = pads
    parts = contact_parts(contact)
    for part in parts:
        body.add(dartpy.dynamics.SphereShape(part.radius + INSIDE), part.center, contact, contact.restitution)
    first = parts[0]
    if isinstance(first, SphereSphere):
        partner.add(dartpy.dynamics.SphereShape(first.partner_radius), first.partner_center, contact, 1.0)
        return
    plane = dartpy.dynamics.PlaneShape(first.normal, float(first.normal @ first.point))
    partner.add(plane, np.zeros(3), contact, 1.0)


class Touching:
    """Contacts of a model in a world, and their samples.

    Attributes
    ----------
    mechanism : Mechanism
    impulse, forces : ndarray, shape (n_c, 3)
        On the bodies, world axes: N s since it was last set to zero, and N in the last step.
    points : ndarray, shape (n_c, 3), m
        One of each contact, when it last had a force.
    modes : ndarray, shape (n_c,)
        In the last step: 0 separated, 1 sliding, 2 sticking.
    loss : float, J
    slip_rate : float, m/s^2
        Largest rate of a slip in a step.
    opening : float, m/s^2
        Largest rate of a normal velocity where a force acts, from the step before to the last one. The velocities are
        those that DART's rows hold: of the end of a step, at points and normals of its start.

    Parameters
    ----------
    model : Model
    world : dartpy World
    cones : bool
        Solve for friction on circular cones, by `FRICTION`; otherwise by DART's default, a box.
    """

    def __init__(self, model: Model, world: Any, cones: bool) -> None:
        self._model, self._world, self.mechanism = model, world, model.mechanism
        self._count = len(model.mechanism.contacts)
        ground = dartpy.dynamics.Skeleton(GROUND)
        self._pads = [
            (_Pad(model, ground, c.body, f"pad {2 * n}"), _Pad(model, ground, c.partner, f"pad {2 * n + 1}"))
            for n, c in enumerate(model.mechanism.contacts)
        ]
        for pads, contact in zip(self._pads, model.mechanism.contacts, strict=True):
            _shapes(pads, contact)
        model.skeleton.enableSelfCollisionCheck()
        if ground.getNumBodyNodes():
            world.addSkeleton(ground)
        solver = world.getConstraintSolver()
        solver.setCollisionDetector(dartpy.collision.DARTCollisionDetector())
        self._solvers: list[Any] = []
        self._pivoting = solver.getBoxedLcpSolver()
        if cones:
            self.solve_by(*FRICTION)
            solver.setSplitImpulseEnabled(True)  # corrections of overlaps stay out of the velocities
        declared = {(body.node.getName(), partner.node.getName()) for body, partner in self._pads}
        listed = solver.getCollisionOption().collisionFilter
        for one, other in combinations([pad.node for pads in self._pads for pad in pads], 2):
            if (one.getName(), other.getName()) not in declared:
                listed.addBodyNodePairToBlackList(one, other)
        self._numbers = {pad.node.getName(): n for n, pads in enumerate(self._pads) for pad in pads}
        self.restart()

    def solve_by_pivoting(self) -> None:
        """Take DART's default solver, which has no rounding of iterations, but boxes in place of cones."""
        self._solvers = []
        self._world.getConstraintSolver().setBoxedLcpSolver(self._pivoting)

    def solve_by(self, *solvers: FrictionSolver) -> None:
        """Take a solver of friction, and others that repeat a step which those before have not solved."""
        self._solvers, self._unsolved = [], 0
        for name, bound, most, tolerance in solvers:
            friction = getattr(dartpy.constraint, name)()
            options = friction.getOptions()  # a copy
            setattr(options, bound, most)
            options.tolerance = tolerance
            friction.setOptions(options)
            self._solvers.append(friction)
        self._failures = [0] * len(solvers)
        self._world.getConstraintSolver().setBoxedLcpSolver(self._solvers[0])

    def repetitions(self) -> Iterator[None]:
        """Take the next solver of friction, for a repetition of the step, as long as the last one has failed."""
        n = 0
        for n, friction in enumerate(self._solvers):
            before, self._failures[n] = self._failures[n], int(friction.getStats().numFailed)
            if self._failures[n] == before:
                break
            if n + 1 == len(self._solvers):
                self._unsolved += self._failures[n] - before
                break
            self._world.getConstraintSolver().setBoxedLcpSolver(self._solvers[n + 1])
            yield
        if n:
            self._world.getConstraintSolver().setBoxedLcpSolver(self._solvers[0])

    def restart(self) -> None:
        """Set all sums to zero."""
        self.impulse, self.forces, self.points = np.zeros((3, self._count, 3))
        self.modes = np.full(self._count, SEPARATED)
        self.loss = self.slip_rate = self.opening = 0.0
        self._rates: list[float] = []
        self.note()

    def note(self) -> None:
        """Keep the motion of the pads before a step."""
        self._before = self._motions()

    def add(self, step: float) -> None:
        """Add the forces of the step that was taken.

        DART's contacts have points and normals of the start of the step, and its force on the first object.
        """
        self.forces = np.zeros((self._count, 3))
        self.modes = np.full(self._count, SEPARATED)
        motions, rates = self._motions(), list[float]()
        for contact in self._world.getLastCollisionResult().getContacts():
            name = contact.collisionObject1.getShapeFrame().getBodyNode().getName()
            n = self._numbers[name]
            force = np.asarray(contact.force)
            if name != self._pads[n][0].node.getName():
                force = -force
            normal, point = np.asarray(contact.normal), np.asarray(contact.point)
            if abs(force @ normal) == 0.0:
                continue
            before, after = self._slip(n, point, self._before[n]), self._slip(n, point, motions[n])
            self.forces[n] += force
            self.points[n] = point
            self.slip_rate = max(self.slip_rate, float(np.linalg.norm(after - before)) / step)
            self.loss -= step * float(force @ (before + after)) / 2.0
            slides = float(np.linalg.norm(after - normal * (normal @ after))) > AT_REST
            rates.append(float(normal @ after))
            if slides or self.modes[n] == SEPARATED:
                self.modes[n] = SLIDING if slides else STICKING
        alike = len(rates) == len(self._rates)
        self.opening = max((abs(new - old) / step for new, old in zip(rates, self._rates, strict=alike)), default=0.0)
        self.impulse += step * self.forces
        self._before, self._rates = motions, rates

    def slip(self, n: int, point: Array) -> Array:
        """Return the velocity of the body's material point at a point relative to the partner's.

        Parameters
        ----------
        n : int
            Number of the contact.
        point : ndarray, shape (3,), m
            At the state last noted.
        """
        return self._slip(n, point, [pad.motion() for pad in self._pads[n]])

    def _motions(self) -> list[list[Motion]]:
        return [[pad.motion() for pad in pads] for pads in self._pads]

    def _slip(self, n: int, point: Array, motions: list[Motion]) -> Array:
        """Return the slip at a point of the start of a step, by motions of the pads at either end of the step."""
        (origin, _, _), (origin_P, _, _) = self._before[n]
        (_, v, w), (_, v_P, w_P) = motions
        return v + cross(w, point - origin) - v_P - cross(w_P, point - origin_P)

    def jacobian(self, n: int) -> Array:
        """Return the Jacobian (3, dofs) of the slip of a contact, at its point in the last step."""
        skeleton = self._model.skeleton
        J = np.zeros((3, skeleton.getNumDofs()))
        for pad, sign in zip(self._pads[n], (1.0, -1.0), strict=True):
            if pad.node.getSkeleton().getName() != GROUND:
                at = pad.node.getWorldTransform().inverse().multiply(self.points[n])
                J += sign * skeleton.getLinearJacobian(pad.node, at)
        return J

    def failed(self) -> int:
        """Return the number of solutions of friction that failed.

        Raises
        ------
        ArithmeticError
            It is more than a few.
        """
        if not self._solvers:
            return 0
        solved = int(self._solvers[0].getStats().numSolves)
        if self._unsolved > max(1.0, TOO_MANY * solved):
            raise ArithmeticError(f"DART's solvers of friction fail {self._unsolved} of {solved} times")
        return self._unsolved

    def gaps(self) -> Array:
        """Return the gaps in m, by the poses of DART."""
        state = State(*read(self._model))
        return np.array([contact_gap(self._model.mechanism, state, c) for c in self._model.mechanism.contacts])
