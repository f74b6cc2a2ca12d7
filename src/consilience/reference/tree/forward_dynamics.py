"""Forward dynamics in joint coordinates: accelerations at one state, at many states, for many sets of parameters.

Trees use the articulated-body algorithm [Featherstone 2008, table 7.1], loops the equations of `dynamics`.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np

from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import Array, Mechanism, State
from consilience.reference.bodies.arrays import unpack
from consilience.reference.bodies.canonical import at_origins
from consilience.reference.bodies.smooth_equations import refuse_contacts
from consilience.reference.kernel.compiled import kernel, threaded
from consilience.reference.kernel.mechanism_record import record_of
from consilience.reference.tree.arrays import (
    LoopClosure,
    Spatial,
    SpatialArrays,
    TreeArrays,
    TreeElements,
    flatten_relative,
    link_records,
    tree_system,
)
from consilience.reference.tree.articulated import tree_accelerations
from consilience.reference.tree.dynamics import accelerations, count_turns
from consilience.reference.tree.kinematics import fill_euler_parameters, place_bodies, place_links_and_bodies
from consilience.reference.tree.projection import find_rank
from consilience.reference.tree.records import FREE, LINK, constants_of
from consilience.reference.tree.state import pack_relative


@kernel
def _tree_accelerations_at(words: Array, free_words: Array, q: Array, v: Array, out: Array) -> bool:
    """Compute the accelerations of a tree; return False if the numbers of coordinates are wrong.

    Links and free directions are given as floats: Numba takes longer to know the type of records than a sweep takes.
    """
    link, free = words.view(LINK), free_words.view(FREE)
    n = free.shape[0]
    if len(q) != link[link.shape[0] - 1].coordinate or len(v) != n or len(out) != n:
        return False
    tree_accelerations(link, free, q, v, out)
    return True


@threaded
def _tree_accelerations_each(
    link: Array, free: Array, own: Array, constants: Array, q: Array, v: Array, out: Array
) -> None:
    """Compute the accelerations of a tree at each row of q and v.

    Parameters
    ----------
    link, free : see `arrays`
    own : ndarray, shape (n_b + 1, 31)
        The view `constants_of` the links.
    constants : ndarray, shape (n, n_b + 1, 31)
        Constants of the tree at row i; empty to keep those of the links.
    q, v, out : ndarray, shapes (n, n_q), (n, n_v), (n, n_v)
        Coordinates, speeds, accelerations; `out` is overwritten.
    """
    for i in range(q.shape[0]):
        if constants.shape[0]:
            for k in range(link.shape[0]):
                for n in range(constants.shape[2]):
                    own[k, n] = constants[i, k, n]
        tree_accelerations(link, free, q[i], v[i], out[i])


@threaded
def _accelerations_each(
    closure: LoopClosure,
    spatial: SpatialArrays,
    elements: TreeElements,
    t: float,
    q: Array,
    v: Array,
    z: Array,
    out: Array,
) -> None:
    """Compute the accelerations of any mechanism at each row of q and v; select independent rows at each state."""
    for i in range(q.shape[0]):
        for n in range(q.shape[1]):
            z[n] = q[i, n]
        for n in range(v.shape[1]):
            z[closure.first_speed + n] = v[i, n]
        place_links_and_bodies(closure.layout, closure.link, closure.free, closure.first_speed, z, spatial.y, spatial.A)
        elements.turns[:] = 0.0
        count_turns(elements, spatial.y, spatial.A)
        closure.best[0].rank, closure.best[0].pivot, closure.best[0].elimination_pivot = 0, 0.0, 0.0
        find_rank(closure, spatial, elements, None, t, z)
        accelerations(closure, spatial, elements, None, t, z)
        for n in range(v.shape[1]):
            out[i, n] = closure.u[n]


_PARTS = 8
"""Number of parts into which the states of a batch are divided for each thread."""


class ForwardDynamics:
    """Accelerations of one mechanism in the coordinates of its joints, by articulated bodies.

    The joints are those of a spanning tree, in the order of `joints`; each contributes to the coordinates q and to the
    speeds v, in this order,

    - the displacements of M along the free axes of F (x before y before z), m,
    - revolute, cylindrical, planar: the angle about z of F, rad; universal: the angles about z of F and x of M;
    - spherical, free: to q the Euler parameters of M relative to F, scalar first, of any length but zero; to v the
      angular velocity of M relative to F, axes of F, rad/s.

    All other v are rates of their q. Joints that close loops (and rods, screws, drives, couplings, rolling, skates) add
    equations: q and v have to satisfy them, as those of `coordinates` do, and accelerations do then. Elements act;
    angles that they read are within half a turn of zero and integrals of controllers zero.

    The cost is that of the number of bodies, plus that of the loops. An object has its own working arrays: give each
    thread its own.

    Parameters
    ----------
    mechanism : Mechanism

    Attributes
    ----------
    joints : tuple of str
        Names of the joints of the tree.
    n_q, n_v : int
        Numbers of coordinates and of speeds.

    Raises
    ------
    InvalidInput
        A mechanism with contacts, stops or dry friction, whose forces the equations do not have.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        refuse_contacts(mechanism)
        self.mechanism = mechanism
        self._links, self._tree, self._model = flatten_relative(mechanism)
        self.joints = tuple(mechanism.joints[k].name for k in self._tree.joint)
        self.n_q, self.n_v = self._links.first_speed, self._links.first_integral - self._links.first_speed
        self._systems = [self._new_system()]
        self._placed = self._systems[0][0]
        self._link, self._free, self._is_tree = self._placed.link, self._placed.free, self._links.bare_tree
        self._words = self._link.view(float), self._free.view(float)
        if self._is_tree:
            _compile_once(*self._words, self.n_q, self.n_v)

    def coordinates(self, state: State) -> tuple[Array, Array]:
        """q, shape (n_q,), and v, shape (n_v,), of a consistent canonical state; angles within half a turn of zero."""
        z = pack_relative(self._links, self._tree, self._model, state)
        return z[: self.n_q], z[self.n_q : self.n_q + self.n_v]

    def state(self, q: Array, v: Array) -> State:
        """Canonical state of coordinates q, shape (n_q,), and speeds v, shape (n_v,)."""
        z = np.concatenate(self._checked(q, v))
        place_links_and_bodies(self._links.layout, self._link, self._free, self.n_q, z, self._placed.y, self._placed.A)
        fill_euler_parameters(self._placed.A, self._placed.y)
        return State(*unpack(self.mechanism, self._placed.y.copy()))

    def accelerations(self, q: Array, v: Array, t: float = 0.0, out: Array | None = None) -> Array:
        """Rates of the speeds.

        Parameters
        ----------
        q, v : ndarray, shapes (n_q,) and (n_v,)
        t : float, s
            Of functions of time.
        out : ndarray of float, shape (n_v,), optional
            Overwritten and returned, in place of a new array.

        Returns
        -------
        ndarray, shape (n_v,), m/s^2 and rad/s^2

        Raises
        ------
        InvalidInput
            Wrong shapes.
        """
        if out is None:
            out = np.empty(self.n_v)
        if self._is_tree:
            try:
                if _tree_accelerations_at(*self._words, q, v, out):
                    return out
            except TypeError:  # not contiguous arrays of floats
                pass
        q, v = self._checked(q, v)
        if out.shape != (self.n_v,):
            raise InvalidInput("out", f"shape {out.shape}", f"Give ({self.n_v},).")
        self._fill(0, q[None], v[None], t, np.empty((0, 0, 0)), out[None])
        return out

    def body_accelerations(self, q: Array, v: Array, t: float = 0.0) -> tuple[Array, Array]:
        """a_WB_W of the body origins (m/s^2) and alpha_WB_W (rad/s^2), world axes, each shape (n_b, 3).

        Raises
        ------
        NumericalFailure
            If they are not finite, for example at a spring of no length.
        """
        self.accelerations(q, v, t)
        y, A = self._placed.y, self._placed.A
        place_bodies(self._links.layout, self._link, y, A)
        fill_euler_parameters(A, y)
        a = np.empty((len(self.mechanism.bodies), 6))
        a[self._links.layout["body"]] = self._link["acceleration"][:-1].reshape(-1, 6)
        if not np.all(np.isfinite(a)):
            raise NumericalFailure("forward dynamics: the accelerations are not finite")
        a[:, 3:] = np.einsum("bji,bj->bi", A, a[:, 3:])
        return at_origins(self.mechanism, y, a.ravel())

    def accelerations_of(
        self, q: Array, v: Array, parameters: Array | None = None, t: float = 0.0, threads: int | None = None
    ) -> Array:
        """Rates of the speeds at many states, or of many sets of parameters.

        Parameters
        ----------
        q, v : ndarray, shapes (n, n_q) and (n, n_v)
            One state in each row.
        parameters : ndarray, shape (n, n_b + 1, 31), optional
            From `parameters`: row i of q and v belongs to mechanism i.
        threads : int, optional
            Number of threads; as many as there are processors if not given.

        Returns
        -------
        ndarray, shape (n, n_v)

        Raises
        ------
        InvalidInput
            Wrong shapes.
        """
        q, v = (np.ascontiguousarray(x, dtype=float) for x in (q, v))
        if q.ndim != 2 or q.shape[1] != self.n_q or v.shape != (len(q), self.n_v):
            raise InvalidInput("q, v", f"shapes {q.shape}, {v.shape}", f"Give (n, {self.n_q}) and (n, {self.n_v}).")
        constants = np.empty((0, 0, 0)) if parameters is None else np.ascontiguousarray(parameters, dtype=float)
        wanted = (len(q), *constants_of(self._link).shape)
        if parameters is not None and (not self._is_tree or constants.shape != wanted):
            raise InvalidInput("parameters", f"shape {constants.shape}", f"Give what parameters() answers, {wanted}.")
        out = np.empty(v.shape)
        count = max(1, min(threads or os.cpu_count() or 1, len(q)))
        while len(self._systems) < count:
            self._systems.append(self._new_system())
        bounds = [len(q) * n // (count * _PARTS) for n in range(count * _PARTS + 1)]
        parts = iter([slice(first, last) for first, last in pairwise(bounds) if first < last])

        def work(n: int) -> None:
            for part in parts:  # threads take parts in turn, because they are not equally fast
                self._fill(n, q[part], v[part], t, constants[part], out[part])

        if count == 1:
            work(0)
        else:
            with ThreadPoolExecutor(count) as pool:
                for done in [pool.submit(work, n) for n in range(count)]:
                    done.result()
        return out

    def parameters(self, mechanisms: Sequence[Mechanism]) -> Array:
        """Constants of mechanisms that differ from this one in numbers alone, shape (n, n_b + 1, 31).

        Masses, centres of mass, inertias, frames of the joints and gravity may differ.

        Raises
        ------
        InvalidInput
            If this mechanism is not a tree without elements, or one of the others has another tree, or contacts.
        """
        if not self._is_tree:
            raise InvalidInput(
                self.mechanism.name, "it has loops or elements", "Make one ForwardDynamics for each mechanism."
            )
        return np.array([self._constants(other) for other in mechanisms])

    def _constants(self, other: Mechanism) -> Array:
        refuse_contacts(other)
        links, tree, _ = flatten_relative(other)
        same = links.bare_tree and all(
            np.array_equal(a, b)
            for a, b in (
                (links.layout, self._links.layout),
                (links.direction, self._links.direction),
                (tree.joint, self._tree.joint),
            )
        )
        if not same:
            raise InvalidInput(other.name, f"its tree is not that of {self.mechanism.name}", "Change numbers only.")
        return constants_of(link_records(links, other.gravity))

    def _checked(self, q: Array, v: Array) -> tuple[Array, Array]:
        q, v = np.array(q, dtype=float), np.array(v, dtype=float)
        if q.shape != (self.n_q,) or v.shape != (self.n_v,):
            raise InvalidInput("q, v", f"shapes {q.shape}, {v.shape}", f"Give ({self.n_q},) and ({self.n_v},).")
        return q, v

    def _new_system(self) -> tuple[TreeArrays, LoopClosure, Spatial, TreeElements | None]:
        """Return the tree and the records of all other arrays, with arrays of their own."""
        tree, closure, spatial, elements, _ = tree_system(self.mechanism, self._links, self._tree, self._model)
        return tree, record_of(closure), record_of(spatial), record_of(elements)

    def _fill(self, n: int, q: Array, v: Array, t: float, constants: Array, out: Array) -> None:
        """Compute accelerations at rows of states, with the n-th set of work arrays."""
        tree, *others = self._systems[n]
        if self._is_tree:
            # the constants of parameter sets must not stay in the table
            link = tree.link.copy() if len(constants) else tree.link
            _tree_accelerations_each(link, tree.free, constants_of(link), constants, q, v, out)
            return
        _accelerations_each(*others, float(t), q, v, np.zeros(len(self._links.kind)), out)


def _compile_once(words: Array, free_words: Array, n_q: int, n_v: int) -> None:
    """Compile `_tree_accelerations_at` for contiguous arrays of floats alone: other arrays are converted."""
    _tree_accelerations_at(words, free_words, np.ones(n_q), np.zeros(n_v), np.empty(n_v))
    if hasattr(_tree_accelerations_at, "disable_compile"):  # a plain function where Numba is disabled
        _tree_accelerations_at.disable_compile()
