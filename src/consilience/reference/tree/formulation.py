"""Minimal form in relative joint coordinates, as `consilience.reference.formulations.protocol.Formulation`.

The kernels are those of `consilience.reference.tree`. Coordinates ``u = (z, angles, rank)``: the state z of the
tree joints, the joint coordinates that elements read, turns counted, and the rank of the rows that close loops, as in
`consilience.reference.formulations.body_velocities`.
"""

from __future__ import annotations

import numpy as np

from consilience.engine import Unsupported
from consilience.errors import NumericalFailure
from consilience.mechanism import RANK_TOLERANCE, Array, Mechanism, State
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import Workspace, unpack, workspace
from consilience.reference.bodies.canonical import at_origins, joint_wrenches
from consilience.reference.bodies.joint_rows import coordinate
from consilience.reference.bodies.mass_metric import mass_matrix
from consilience.reference.kernel.compiled import kernel
from consilience.reference.kernel.held import hold
from consilience.reference.tree.arrays import BODY, Elements, Rest, Space, flatten_relative, system
from consilience.reference.tree.dynamics import derivative, remember
from consilience.reference.tree.kinematics import orient, place, place_bodies
from consilience.reference.tree.plane import Plane
from consilience.reference.tree.projection import SEEN, find_rank, project
from consilience.reference.tree.records import ACCELERATION
from consilience.reference.tree.state import pack_relative


def unsupported(mechanism: Mechanism) -> tuple[Unsupported, ...]:
    """Nothing: the kernels know every joint and element."""
    return ()


@kernel
def differentiate(
    rest: Rest, space: Space | None, elements: Elements | None, plane: Plane | None, t: float, z: Array, dz: Array
) -> None:
    """`derivative`, for Python."""
    derivative(rest, space, elements, plane, t, z, dz)


@kernel
def close(
    rest: Rest, space: Space | None, elements: Elements | None, plane: Plane | None, t: float, z: Array, seen: bool
) -> None:
    """`project`, for Python."""
    project(rest, space, elements, plane, t, z, seen)


@kernel
def _turning(elements: Elements, y: Array, A: Array, turning: Array) -> None:
    """Derivatives of the angles, bodies as they are placed."""
    for n in range(turning.shape[0]):
        turning[n] = coordinate(elements.model, y, A, n, elements.memory[n]).rate


class RelativeCoordinates:
    """Relative joint coordinates along a spanning tree, loops closed by the rows of cut joints."""

    name = "relative"

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self._links, self._tree, self._model = flatten_relative(mechanism)
        arrays = system(mechanism, self._links, self._tree, self._model)
        assert arrays.space is not None
        self._rest, self._space, self._elements = arrays.rest, arrays.space, arrays.elements
        self._held = hold(arrays.rest), hold(arrays.space), hold(arrays.elements), None

    def coordinates(self, state: State) -> Array:
        """Coordinates u of a consistent state: angles within half a turn of zero, integrals of controllers zero."""
        z = pack_relative(self._links, self._tree, self._model, state)
        self._place(z)
        memory = self._remember(np.zeros(len(self._model.coordinate)))
        find_rank(*self._held, 0.0, z)
        return np.concatenate([z, memory, self._rest.limit])

    def state(self, u: Array) -> State:
        """Canonical state of u."""
        self._place(self._split(u)[0])
        orient(self._space.A, self._space.y)
        return State(*unpack(self.mechanism, self._space.y.copy()))

    def derivative(self, t: float, u: Array) -> Array:
        """``du/dt`` at the time t, shape (n_u,)."""
        z, memory = self._split(u)
        du = np.zeros(len(u))
        dz, turning = self._split(du)
        self._rest.limit[0] = round(u[-1])
        if self._elements is not None:
            self._elements.memory[:] = memory
        differentiate(*self._held, t, z, dz)
        if self._elements is not None:
            _turning(self._held[2], self._space.y, self._space.A, turning)
        return du

    def settle(self, t: float, u: Array) -> Array:
        """New array: u projected onto the closed loops, with the angles and the rank found there."""
        z, memory = self._split(np.array(u, dtype=float))
        if self._elements is not None:
            self._elements.memory[:] = memory
        close(*self._held, t, z, SEEN)
        return np.concatenate([z, self._remember(memory), self._rest.limit])

    def accelerations(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """a_WB_W of the body origins (m/s^2) and alpha_WB_W (rad/s^2), world axes, each shape (n_b, 3).

        Raises
        ------
        NumericalFailure
            If they are not finite, for example at a spring of no length.
        """
        a = self._bodies(state, t)
        return at_origins(self.mechanism, self._space.y, a)

    def reactions(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """Joint reactions from the equations of motion of the bodies, of least norm where rows leave them open."""
        a, ws = self._bodies(state, t), hold(workspace(self._model)._replace(A=self._space.A))
        memory = self._remember(np.zeros(len(self._model.coordinate)))
        constraints.evaluate(self._model, t, self._space.y, memory, ws)
        force = mass_matrix(self._model) @ a - self._forces(t, memory, ws)
        lam: Array = np.linalg.lstsq(ws.Q.T, force, rcond=RANK_TOLERANCE)[0]
        wrench = joint_wrenches(self.mechanism, state, lam)
        return wrench[:, :3], wrench[:, 3:]

    def _forces(self, t: float, memory: Array, ws: Workspace) -> Array:
        forces.evaluate(self._model, t, self._space.y, memory, ws)
        return ws.f

    def _bodies(self, state: State, t: float) -> Array:
        """Accelerations (dv/dt, dw'/dt) of all bodies, shape (6 n_b,), with the bodies placed at the state."""
        u = self.coordinates(state)
        self.derivative(t, u)
        place_bodies(self._links.layout, self._rest.link, self._space.y, self._space.A)
        A, y = self._space.A, self._space.y
        orient(A, y)
        a = np.empty((len(self.mechanism.bodies), 6))
        a[self._links.layout[:, BODY]] = self._rest.link[:-1, ACCELERATION : ACCELERATION + 6]
        a[:, 3:] = np.einsum("bji,bj->bi", A, a[:, 3:])
        if not np.all(np.isfinite(a)):
            raise NumericalFailure(f"reference, {self.name}: the accelerations are not finite")
        return a.ravel()

    def _remember(self, memory: Array) -> Array:
        """Angles that elements read, of the bodies as they are placed, their turns counted from those before."""
        if self._elements is None:
            return memory
        self._elements.memory[:] = memory
        remember(self._held[2], self._space.y, self._space.A)
        return self._elements.memory.copy()

    def _place(self, z: Array) -> None:
        rest, space = self._rest, self._space
        place(rest.layout, rest.link, rest.free, rest.speeds, z, space.y, space.A)

    def _split(self, u: Array) -> tuple[Array, Array]:
        """Views of u: z and the angles."""
        count = len(self._links.kind)
        return u[:count], u[count:-1]
