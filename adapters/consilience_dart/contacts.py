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
from math import dist
from typing import Any

import dartpy
import numpy as np

from consilience.mechanism import GROUND, Array, Contact, SphereSphere, State, contact_gap, contact_parts
from consilience_dart.pressing import Pressing
from consilience_dart.state import read
from consilience_dart.translation import Model, set_inertia

INSIDE = 1e-12

CLOSED = 1e-9
"""Gap in m, and its rate, up to which a contact is closed."""

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


Vector = list[float]

Motion = tuple[Vector, Vector, Vector]
"""Position, velocity and angular velocity, world axes, as numbers: arrays of three are several times slower."""

_AT_ORIGIN: Motion = [0.0] * 3, [0.0] * 3, [0.0] * 3


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _velocity(of: Motion, arm: Vector) -> Vector:
    """Return the velocity of the point at an arm from the origin."""
    _, (vx, vy, vz), (wx, wy, wz) = of
    x, y, z = arm
    return [vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x]


class _Pad:
    """Node of one side of a contact, at the centre of mass of its body, in axes of the body; at the ground's origin."""

    def __init__(self, model: Model, ground: Any, body: str, name: str) -> None:
        index = model.mechanism.body_index[body]
        self._center = np.zeros(3) if index < 0 else model.mechanism.bodies[index].com
        self.at_rest = index < 0
        if self.at_rest:
            joint, self.node = ground.createWeldJointAndBodyNodePair()
        else:
            carrier = model.carriers[index]
            joint, self.node = model.skeleton.createWeldJointAndBodyNodePair(model.nodes[carrier])
            frame = model.tree.links[carrier].body_frame
            joint.setTransformFromParentBodyNode(_frame(frame.R, frame.p + frame.R @ self._center))
            set_inertia(self.node, 0.0, np.zeros(3), np.zeros((3, 3)))
        self.node.setName(name)

    def add(self, shape: Any, position: Array, law: Contact, restitution: float) -> Any:
        """Add a shape at a position in axes of the body, and return its node."""
        node = self.node.createShapeNode(shape)
        node.setRelativeTranslation(position - self._center)
        node.createCollisionAspect()
        node.createDynamicsAspect()
        aspect = node.getDynamicsAspect()
        aspect.setFrictionCoeff(law.friction)
        aspect.setRestitutionCoeff(restitution)
        return node

    def motion(self) -> Motion:
        """Return position, velocity and angular velocity of the node, world axes."""
        if self.at_rest:
            return _AT_ORIGIN
        return (
            self.node.getWorldTransform().translation().tolist(),
            self.node.getLinearVelocity().tolist(),
            self.node.getAngularVelocity().tolist(),
        )


def _shapes(pads: tuple[_Pad, _Pad], contact: Contact) -> list[Pressing]:
    """Give the shapes of a contact to its pads; the restitution stands on the body's side, 1 on the partner's."""
    body, partner = pads
    parts = contact_parts(contact)
    first = parts[0]
    if isinstance(first, SphereSphere):
        normal, offset = None, first.partner_radius
        other = partner.add(dartpy.dynamics.SphereShape(offset), first.partner_center, contact, 1.0)
    else:
        normal, offset = first.normal, float(first.normal @ first.point)
        other = partner.add(dartpy.dynamics.PlaneShape(normal, offset), np.zeros(3), contact, 1.0)
    found = []
    for part in parts:
        sphere = dartpy.dynamics.SphereShape(part.radius + INSIDE)
        node = body.add(sphere, part.center, contact, contact.restitution)
        found.append(Pressing(node, other, partner.at_rest, INSIDE, normal, offset))
    return found


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
        spheres = [_shapes(pads, c) for pads, c in zip(self._pads, model.mechanism.contacts, strict=True)]
        self._spheres = {one.name: one for of in spheres for one in of}
        self._sides = {one.name: (n, 1.0) for n, of in enumerate(spheres) for one in of}
        self._sides |= {of[0].other_name: (n, -1.0) for n, of in enumerate(spheres)}
        self._pressing: set[str] = set()
        self._kept: set[str] = set()
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
        forces, modes = [[0.0, 0.0, 0.0] for _ in self._pads], [SEPARATED] * self._count
        motions, rates = self._motions(), list[float]()
        self._pressing = set()
        for contact in self._world.getLastCollisionResult().getContacts():
            name = contact.collisionObject1.getShapeFrame().getName()
            n, sign = self._sides[name]
            force, normal, point = contact.force.tolist(), contact.normal.tolist(), contact.point.tolist()
            if _dot(force, normal) == 0.0:
                continue
            self._pressing.add(name if sign > 0.0 else contact.collisionObject2.getShapeFrame().getName())
            before, after = self._slip(n, point, self._before[n]), self._slip(n, point, motions[n])
            forces[n] = [old + sign * f for old, f in zip(forces[n], force, strict=True)]
            self.points[n] = point
            self.slip_rate = max(self.slip_rate, dist(after, before) / step)
            self.loss -= step * sign * (_dot(force, before) + _dot(force, after)) / 2.0
            rate = _dot(normal, after)
            rates.append(rate)
            slides = dist(after, [rate * x for x in normal]) > AT_REST
            if slides or modes[n] == SEPARATED:
                modes[n] = SLIDING if slides else STICKING
        alike = len(rates) == len(self._rates)
        self.opening = max([abs(new - old) / step for new, old in zip(rates, self._rates, strict=alike)], default=0.0)
        self.forces, self.modes = np.array(forces).reshape(-1, 3), np.array(modes, dtype=int)
        self.impulse += step * self.forces
        self._before, self._rates = motions, rates

    def keep_pressing(self) -> None:
        """Keep the spheres that pressed in the last step in touch, and no others."""
        for name in self._pressing:
            self._spheres[name].keep()
        for name in self._kept - self._pressing:
            self._spheres[name].release()
        self._kept = self._pressing

    def slip(self, n: int, point: Array) -> Array:
        """Return the velocity of the body's material point at a point relative to the partner's.

        Parameters
        ----------
        n : int
            Number of the contact.
        point : ndarray, shape (3,), m
            At the state last noted.
        """
        return np.array(self._slip(n, point.tolist(), [pad.motion() for pad in self._pads[n]]))

    def _motions(self) -> list[list[Motion]]:
        return [[pad.motion() for pad in pads] for pads in self._pads]

    def _slip(self, n: int, point: Vector, motions: list[Motion]) -> Vector:
        """Return the slip at a point of the start of a step, by motions of the pads at either end of the step."""
        body, partner = (
            _velocity(of, [point[0] - start[0], point[1] - start[1], point[2] - start[2]])
            for of, (start, _, _) in zip(motions, self._before[n], strict=True)
        )
        return [body[0] - partner[0], body[1] - partner[1], body[2] - partner[2]]

    def jacobian(self, n: int, point: Array) -> Array:
        """Return the Jacobian (3, dofs) of the slip of a contact at a point, world axes."""
        skeleton = self._model.skeleton
        J = np.zeros((3, skeleton.getNumDofs()))
        for pad, sign in zip(self._pads[n], (1.0, -1.0), strict=True):
            if pad.node.getSkeleton().getName() != GROUND:
                at = pad.node.getWorldTransform().inverse().multiply(point)
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
