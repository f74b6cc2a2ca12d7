"""Minimal form in relative joint coordinates, as `consilience.reference.formulations.protocol.Formulation`.

Coordinates ``u = (z, turns, rank)``: the state z of `arrays`, the joint coordinates that elements read, turns counted,
and the rank of the rows that close loops, as in `consilience.reference.formulations.body_velocities`.
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
from consilience.reference.kernel.mechanism_record import record_of
from consilience.reference.kernel.operation import BoundOperation
from consilience.reference.steppers.motion import DERIVATIVE, END_STEP
from consilience.reference.tree.arrays import TreeElements, flatten_relative, tree_system
from consilience.reference.tree.dynamics import count_turns
from consilience.reference.tree.kinematics import fill_euler_parameters, place_bodies, place_links_and_bodies
from consilience.reference.tree.projection import find_rank
from consilience.reference.tree.state import pack_relative
from consilience.reference.tree.system import serve, system_record


def unsupported(mechanism: Mechanism) -> tuple[Unsupported, ...]:
    """Return no reason: the kernels support every joint and element."""
    return ()


@kernel
def _angle_rates(elements: TreeElements, y: Array, A: Array, turning: Array) -> None:
    """Compute the rates of the joint coordinates that elements read, from the placed bodies."""
    for n in range(turning.shape[0]):
        turning[n] = coordinate(elements.model, y, A, n, elements.turns[n]).rate


class RelativeCoordinates:
    """Relative joint coordinates along a spanning tree, loops closed by the rows of cut joints."""

    name = "relative"

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self._links, self._tree, self._model = flatten_relative(mechanism)
        arrays = tree_system(mechanism, self._links, self._tree, self._model)
        assert arrays.spatial is not None
        assert arrays.elements is not None
        self._rest, self._space, self._elements = arrays.closure, arrays.spatial, arrays.elements
        self._records = record_of(arrays.closure), record_of(arrays.spatial), record_of(arrays.elements), None
        self._serve = BoundOperation(serve, system_record(arrays, tree_alone=False))
        self._sample = np.empty(arrays.spatial.y.size)

    def coordinates(self, state: State) -> Array:
        """Return u of a consistent state: angles within half a turn of zero, integrals of controllers zero."""
        z = pack_relative(self._links, self._tree, self._model, state)
        self._place(z)
        turns = self._count_turns(np.zeros(len(self._model.coordinate)))
        find_rank(*self._records, 0.0, z)
        return np.concatenate([z, turns, self._rest.rank_limit])

    def state(self, u: Array) -> State:
        """Return the canonical state of u."""
        self._place(self._split(u)[0])
        fill_euler_parameters(self._space.A, self._space.y)
        return State(*unpack(self.mechanism, self._space.y.copy()))

    def derivative(self, t: float, u: Array) -> Array:
        """Return ``du/dt`` at the time t, shape (n_u,)."""
        z, turns = self._split(u)
        du = np.zeros(len(u))
        dz, turning = self._split(du)
        self._rest.rank_limit[0] = round(u[-1])
        self._elements.turns[:] = turns
        self._serve(DERIVATIVE, t, z, dz)
        if self._elements.read_bodies:
            _angle_rates(self._records[2], self._space.y, self._space.A, turning)
        return du

    def settle(self, t: float, u: Array) -> Array:
        """Return u projected onto the constraint manifold, a new array, with the turns and the rank found there."""
        z, turns = self._split(np.array(u, dtype=float))
        self._elements.turns[:] = turns
        self._serve(END_STEP, t, z, self._sample)
        return np.concatenate([z, self._count_turns(turns), self._rest.rank_limit])

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
        """Return joint reactions from the equations of motion of the bodies; of least norm where not determined."""
        a, ws = self._bodies(state, t), record_of(workspace(self._model)._replace(A=self._space.A))
        turns = self._count_turns(np.zeros(len(self._model.coordinate)))
        constraints.evaluate(self._model, t, self._space.y, turns, ws)
        force = mass_matrix(self._model) @ a - self._forces(t, turns, ws)
        lam: Array = np.linalg.lstsq(ws.Q.T, force, rcond=RANK_TOLERANCE)[0]
        wrench = joint_wrenches(self.mechanism, state, lam)
        return wrench[:, :3], wrench[:, 3:]

    def _forces(self, t: float, turns: Array, ws: Workspace) -> Array:
        forces.evaluate(self._model, t, self._space.y, turns, ws)
        return ws.f

    def _bodies(self, state: State, t: float) -> Array:
        """Return the accelerations (dv/dt, dw'/dt) of all bodies, shape (6 n_b,), and place the bodies at the state."""
        u = self.coordinates(state)
        self.derivative(t, u)
        place_bodies(self._links.layout, self._rest.link, self._space.y, self._space.A)
        A, y = self._space.A, self._space.y
        fill_euler_parameters(A, y)
        a = np.empty((len(self.mechanism.bodies), 6))
        a[self._links.layout["body"]] = self._rest.link["acceleration"][:-1].reshape(-1, 6)
        a[:, 3:] = np.einsum("bji,bj->bi", A, a[:, 3:])
        if not np.all(np.isfinite(a)):
            raise NumericalFailure(f"reference, {self.name}: the accelerations are not finite")
        return a.ravel()

    def _count_turns(self, turns: Array) -> Array:
        """Return the joint coordinates that elements read, from the placed bodies, with turns counted."""
        self._elements.turns[:] = turns
        count_turns(self._records[2], self._space.y, self._space.A)
        return self._elements.turns.copy()

    def _place(self, z: Array) -> None:
        closure, spatial = self._rest, self._space
        place_links_and_bodies(closure.layout, closure.link, closure.free, closure.first_speed, z, spatial.y, spatial.A)

    def _split(self, u: Array) -> tuple[Array, Array]:
        """Return views of u: z and the turns."""
        count = len(self._links.kind)
        return u[:count], u[count:-1]
