"""Lagrange's equations in relative coordinates, derived from positions alone.

A coordinate turns or shifts all bodies beyond its joint about or along the axis drawn in the world: a displacement
``x -> R x + d``. The displacement of a body is the product of the displacements of the joints between the ground and
the body; no other kinematics is used. The remaining joints close loops: equations ``c(q, t) = 0``. Energies are written
in terms of positions; CasADi takes every derivative:

    d/dt T_v - T_q = Q + C^T lam,    C = c_q

The package's kinematics, assembly, constraint rows and forces are not used; only the data of the case are.
"""

from functools import cache

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from consilience.mechanism import GROUND
from oracles.planar import drawn_frame

_COORDINATES = {  # displacements: turns (R) and shifts (T) along x, y, z of the drawn frame, in order
    "revolute": (("angle", "R", 2),),
    "prismatic": (("distance", "T", 2),),
    "cylindrical": (("distance", "T", 2), ("angle", "R", 2)),
    "universal": (("angle1", "R", 2), ("angle2", "R", 0)),
    "planar": (("x", "T", 0), ("y", "T", 1), ("angle", "R", 2)),
    "spherical": (("wx", "R", 0), ("wy", "R", 1), ("wz", "R", 2)),
    "free": (("x", "T", 0), ("y", "T", 1), ("z", "T", 2), ("wx", "R", 0), ("wy", "R", 1), ("wz", "R", 2)),
    "rigid": (),
}
_VECTORS = {"position": ("x", "y", "z"), "orientation": ("wx", "wy", "wz")}


def _turn(axis, point, angle):
    """Displacement by a rotation about an axis through a point."""
    K = ca.skew(ca.DM(axis))
    R = ca.SX.eye(3) + ca.sin(angle) * K + (1 - ca.cos(angle)) * K @ K
    return R, ca.DM(point) - R @ ca.DM(point)


def _after(first, second):
    """Product of displacements: `second` acts first."""
    return first[0] @ second[0], first[0] @ second[1] + first[1]


def _inverse(displacement):
    R, d = displacement
    return R.T, -R.T @ d


def _scalars(name, value):
    """Scalar coordinates of a held vector of a case: an orientation equal to the drawing's, or an angular velocity."""
    if name not in _VECTORS:
        return [(name, value)]
    if len(value) == 4:  # a quaternion
        assert np.array_equal(value, [1, 0, 0, 0])
        value = np.zeros(3)
    return zip(_VECTORS[name], value, strict=True)


def _value(function, x):
    """A function of a case file as a CasADi expression."""
    assert function.table is None
    return sum((c * x**k for k, c in enumerate(function.polynomial)), start=ca.SX(0)) + sum(
        a * ca.sin(w * x + phi) for a, w, phi in function.harmonics
    )


class Relative:
    """Lagrange's equations of a mechanism with some joints cut.

    Parameters
    ----------
    mechanism : Mechanism
    cut : sequence of str
        Joints that close loops. The others, in their order, must connect every body to the ground, except bodies that
        only rods hold: these have six free coordinates, and their rods are loop equations.
    """

    def __init__(self, mechanism, cut=()):
        self.mechanism = mechanism
        self.names, self.symbols, self.moved = [], [], {GROUND: (ca.SX.eye(3), ca.SX.zeros(3))}
        self.t = ca.SX.sym("t")
        left = self._grow([j for j in mechanism.joints if j.name not in cut])
        assert all(j.kind == "rod" for j in left), [j.name for j in left]
        for body in mechanism.bodies:
            if body.name not in self.moved:
                assert any(body.name in (j.predecessor, j.successor) for j in left), body.name
                point = body.drawing.p + body.drawing.R @ body.com
                self.moved[body.name] = self._displacement(body.name, "free", point, np.eye(3))
        self.q = ca.vertcat(*self.symbols)
        self.v = ca.SX.sym("v", self.q.numel())
        self.index = {name: n for n, name in enumerate(self.names)}
        self.closure = self._closure([*left, *(mechanism.joints[mechanism.joint_index[c]] for c in cut)])
        self.integrals = ca.SX.sym("s", len(mechanism.controls))
        self._equations()

    def _grow(self, joints):
        while True:
            grown = [
                j for j in joints if j.kind != "rod" and (j.predecessor in self.moved) != (j.successor in self.moved)
            ]
            if not grown:
                return joints
            j = grown[0]
            own = self._displacement(j.name, j.kind, *drawn_frame(self.mechanism, j))
            if j.predecessor in self.moved:
                self.moved[j.successor] = _after(self.moved[j.predecessor], own)
            else:
                self.moved[j.predecessor] = _after(self.moved[j.successor], _inverse(own))
            joints = [k for k in joints if k is not j]

    def _displacement(self, name, kind, point, axes):
        product = (ca.SX.eye(3), ca.SX.zeros(3))
        for coordinate, what, k in _COORDINATES[kind]:
            q = ca.SX.sym(f"{name}.{coordinate}")
            self.names.append((name, coordinate))
            self.symbols.append(q)
            own = _turn(axes[:, k], point, q) if what == "R" else (ca.SX.eye(3), ca.DM(axes[:, k]) * q)
            product = _after(product, own)
        return product

    def point(self, body, drawn):
        R, d = self.moved[body]
        return R @ ca.DM(drawn) + d

    def _closure(self, joints):
        rows = []
        for j in joints:
            at, axes = drawn_frame(self.mechanism, j)
            R_i, R_j = self.moved[j.predecessor][0], self.moved[j.successor][0]
            x, y, z = axes.T
            if j.kind == "rod":
                to = at + j.length * z
                apart = self.point(j.successor, to) - self.point(j.predecessor, at)
                rows.append(ca.dot(apart, apart) - j.length**2)
                continue
            apart = self.point(j.successor, at) - self.point(j.predecessor, at)
            square = {
                (a, b): ca.dot(R_i @ ca.DM(u), R_j @ ca.DM(w))
                for a, u in zip("xyz", axes.T, strict=True)
                for b, w in zip("xyz", axes.T, strict=True)
            }
            across = [ca.dot(R_i @ ca.DM(u), apart) for u in (x, y)]
            parallel = [square["x", "z"], square["y", "z"]]
            rows += {
                "revolute": [apart, *parallel],
                "spherical": [apart],
                "universal": [apart, square["z", "x"]],
                "prismatic": [*across, *parallel, square["x", "y"]],
                "cylindrical": [*across, *parallel],
            }[j.kind]
        for d in self.mechanism.drives:
            rows.append(self.symbols[self.index[d.joint, d.coordinate]] - _value(d.motion, self.t))
        for c in self.mechanism.couplings:
            driver = self.symbols[self.index[c.driver_joint, c.driver_coordinate]]
            rows.append(self.symbols[self.index[c.joint, c.coordinate]] - _value(c.law, driver))
        return ca.vertcat(*rows) if rows else ca.SX(0, 1)

    def _spin(self, body):
        """Angular velocity of a body, in the drawing's axes turned with the body."""
        R = self.moved[body][0]
        rate = ca.reshape(ca.jtimes(ca.vec(R), self.q, self.v), 3, 3)
        return ca.inv_skew(R.T @ rate)

    def _efforts(self):
        """Generalised forces except gravity, and the errors that the controllers integrate."""
        m, q, v, t, Q = self.mechanism, self.q, self.v, self.t, ca.SX.zeros(self.q.numel())
        for s in m.springs:
            ends = []
            for name, own in ((s.predecessor, s.point_predecessor), (s.successor, s.point_successor)):
                drawing = None if name == GROUND else m.bodies[m.body_index[name]].drawing
                ends.append(self.point(name, own if drawing is None else drawing.p + drawing.R @ own))
            length = ca.norm_2(ends[1] - ends[0])
            force = -s.stiffness * (length - s.free_length) - s.damping * ca.jtimes(length, q, v)
            Q += ca.gradient(length, q) * (force + (_value(s.actuator, t) if s.actuator else 0))
        integrands = [c.target.at(0)[0] for c in m.controls]
        for s in m.joint_springs:
            n = self.index[s.joint, s.coordinate]
            Q[n] += -s.stiffness * (q[n] - s.rest) - s.damping * v[n] + (_value(s.actuator, t) if s.actuator else 0)
        for f in m.frictions:
            n = self.index[f.joint, f.coordinate]
            Q[n] -= f.viscous * v[n] + f.coulomb * ca.tanh(v[n] / f.speed)
        for k, c in enumerate(m.controls):
            n = self.index[c.joint, c.coordinate]
            target = _value(c.target, t)
            integrands[k] = target - q[n]
            Q[n] += c.proportional * (target - q[n]) + c.integral * self.integrals[k]
            Q[n] += c.derivative * (ca.jacobian(target, t) - v[n])
        for load in m.loads:
            drawing = m.bodies[m.body_index[load.body]].drawing
            R = self.moved[load.body][0]
            vector = ca.DM(load.vector) if load.frame == "world" else R @ ca.DM(drawing.R @ load.vector)
            vector = vector * (_value(load.history, t) if load.history else 1)
            if load.kind == "force":
                Q += ca.jtimes(self.point(load.body, drawing.p + drawing.R @ load.point), q, vector, True)
            else:
                Q += ca.jacobian(R @ self._spin(load.body), v).T @ vector
        return Q, integrands

    def _equations(self):
        m, q, v, t = self.mechanism, self.q, self.v, self.t
        T, V, outputs = 0, 0, []
        for body in m.bodies:
            p, R0 = body.drawing.p, body.drawing.R
            c = self.point(body.name, p + R0 @ body.com)
            cdot, w = ca.jtimes(c, q, v), self._spin(body.name)
            T += body.mass * ca.dot(cdot, cdot) / 2 + ca.dot(w, ca.DM(R0 @ body.inertia @ R0.T) @ w) / 2
            V -= body.mass * ca.dot(ca.DM(m.gravity), c)
            R, origin = self.moved[body.name][0], self.point(body.name, p)
            outputs += [origin, ca.vec(R @ ca.DM(R0)), ca.jtimes(origin, q, v), R @ w, c, cdot]
        Q, integrands = self._efforts()
        momentum = ca.gradient(T, v)
        M = ca.jacobian(momentum, v)
        f = Q - ca.gradient(V, q) - ca.jtimes(momentum, q, v) + ca.gradient(T, q)
        C = ca.jacobian(self.closure, q)
        rate = C @ v + ca.jacobian(self.closure, t)
        gamma = -ca.jtimes(rate, q, v) - ca.jacobian(rate, t)
        s = self.integrals
        self.terms = ca.Function(
            "terms", [t, q, v, s], [M, f, C, gamma, ca.vertcat(*integrands) if integrands else s], {"cse": True}
        )
        self.loop = ca.Function("loop", [t, q, v], [self.closure, C, ca.jacobian(self.closure, t)])
        self.read = ca.Function(
            "read", [q, v], [ca.horzcat(*[ca.vertcat(*outputs[6 * i : 6 * i + 6]) for i in range(len(m.bodies))])]
        )
        a = ca.SX.sym("a", q.numel())
        origins = ca.horzcat(*[outputs[6 * i + 2] for i in range(len(m.bodies))])
        spins = ca.horzcat(*[outputs[6 * i + 3] for i in range(len(m.bodies))])
        rates = [ca.jtimes(x, q, v) + ca.jtimes(x, v, a) for x in (origins, spins)]
        self.accelerate = ca.Function("accelerate", [q, v, a], rates)

    def _acceleration(self, t, q, v, s):
        M, f, C, gamma, integrands = (np.array(x) for x in self.terms(t, q, v, s))
        n, k = len(M), len(C)
        if not k:
            return np.linalg.solve(M, f)[:, 0], integrands[:, 0]
        # Lagrange's equations projected on the free directions of the loops, so that dependent equations do no harm
        U, S, Vt = np.linalg.svd(C)
        rank = int(np.sum(1e-9 * S[0] < S))
        particular = Vt[:rank].T @ ((U[:, :rank].T @ gamma) / S[:rank, None])
        N = Vt[rank:].T
        a = particular
        if n > rank:
            a = particular + N @ np.linalg.solve(N.T @ M @ N, N.T @ (f - M @ particular))
        return a[:, 0], integrands[:, 0]

    def start(self, initial):
        """Coordinates and rates at time zero: as the case holds them, the others from the loop equations."""
        q, v = np.zeros(len(self.names)), np.zeros(len(self.names))
        held, rated = {}, {}
        for values, found in ((initial.coordinates, held), (initial.rates, rated)):
            for joint, by_name in values.items():
                for name, value in by_name.items():
                    found |= {self.index[joint, n]: float(x) for n, x in _scalars(name, value)}
        for n, x in held.items():
            q[n] = x
        loose = [n for n in range(len(q)) if n not in held]
        for _ in range(30):
            c, C, _ = (np.array(x) for x in self.loop(0.0, q, v))
            if not len(c):
                break
            q[loose] -= np.linalg.lstsq(C[:, loose], c[:, 0], rcond=1e-10)[0]
        for n, x in rated.items():
            v[n] = x
        loose = [n for n in range(len(q)) if n not in rated]
        _, C, c_t = (np.array(x) for x in self.loop(0.0, q, v))
        if len(C):
            # rank at the closed pose: off the closed pose dependent equations look independent
            self.rank = int(np.linalg.matrix_rank(C, tol=1e-9 * np.linalg.norm(C)))
            v[loose] = np.linalg.lstsq(C[:, loose], -c_t[:, 0] - C @ v, rcond=1e-10)[0]
        return q, v

    def motion(self, initial, times, tolerance=1e-12):
        """Coordinates, rates and controllers' integrals at the times, shape (n_t, 2 n_q + n_c)."""
        n, k = len(self.names), len(self.mechanism.controls)
        y0 = np.concatenate([*self.start(initial), np.zeros(k)])

        def rhs(t, y):
            a, integrands = self._acceleration(t, y[:n], y[n : 2 * n], y[2 * n :])
            return np.concatenate([y[n : 2 * n], a, integrands])

        samples, now, y = [], 0.0, y0
        for time in times:
            if time > now:
                solution = solve_ivp(
                    rhs,
                    (now, time),
                    y,
                    method="DOP853",
                    rtol=tolerance,
                    atol=tolerance,
                    t_eval=[time],
                    first_step=min(1e-3, time - now),  # SciPy's own may leave the poses where loops close
                    max_step=0.02,
                )
                assert solution.success, solution.message
                y, now = solution.y[:, -1], time
            samples.append(y)
        return np.array(samples)

    def values(self, case, published):
        """Expected values, in the order of `published`."""
        times = sorted({p.time for p in published})
        rows = dict(zip(times, self.motion(case.initial, times), strict=True))
        return np.array([self._value(p, rows[p.time]) for p in published])

    def _value(self, known, y):
        n = len(self.names)
        q, v = y[:n], y[n : 2 * n]
        if (known.of, known.observable.removesuffix("_rate")) in self.index:
            coordinate = self.index[known.of, known.observable.removesuffix("_rate")]
            return (v if known.observable.endswith("_rate") else q)[coordinate]
        i = self.mechanism.body_index[known.of]
        if known.observable in ("a_WB_W", "alpha_WB_W"):
            a, _ = self._acceleration(0.0, q, v, y[2 * n :])
            found = np.array(self.accelerate(q, v, a)[("a_WB_W", "alpha_WB_W").index(known.observable)])
            return found[known.component, i]
        column = np.array(self.read(q, v))[:, i]
        first = {
            "p_WB": 0,
            "x_axis": 3,
            "y_axis": 6,
            "z_axis": 9,
            "v_WB_W": 12,
            "w_WB_W": 15,
            "p_WBcm": 18,
            "v_WBcm_W": 21,
        }
        return column[first[known.observable] + known.component]


def lagrange(*cut):
    """Origin: Lagrange's equations, with the named joints cut to open the loops."""
    build = cache(lambda mechanism: Relative(mechanism, cut))

    def origin(case, published):
        return build(case.mechanism).values(case, published)

    return origin
