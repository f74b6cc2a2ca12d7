"""Newton-Euler equations in a plane: each body has a centre of mass and an angle, each pin two constraint equations.

    m c'' = F,  I a'' = T,    pins: c_i + turn_i arm_i = c_j + turn_j arm_j

in complex numbers. The multipliers are the pins' forces. Only for mechanisms whose points all move parallel to one
plane; joints may be revolute (across the plane) and prismatic (along it), elements joint springs, springs, frictions,
drives, and constant forces and torques fixed in the world.
"""

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu

from consilience.mechanism import GROUND
from oracles.planar import Plane, drawn_frame

_SPARSE_FROM = 60  # equations


class PlanarNewton:
    """Equations of a planar mechanism.

    Parameters
    ----------
    pin : str
        Name of a revolute joint; its axis is the normal of the plane.
    """

    def __init__(self, mechanism, pin):
        self.mechanism = mechanism
        self.plane = Plane(mechanism, pin)
        self.bodies = list(self.plane.bodies())
        self.count = len(self.bodies)
        self.drawn = np.array([b.com for b in self.bodies])
        mass, inertia = (np.array([getattr(b, name) for b in self.bodies]) for name in ("mass", "inertia"))
        self.weights = np.stack([mass, mass, inertia], axis=1)
        self.joints = [self._joint(j) for j in mechanism.joints]
        self.by_name = {j.name: own for j, own in zip(mechanism.joints, self.joints, strict=True)}

    def _body(self, name):
        return -1 if name == GROUND else self.mechanism.body_index[name]

    def _joint(self, joint):
        at, axes = drawn_frame(self.mechanism, joint)
        along = self.plane.flat(axes[:, 2])
        assert (joint.kind == "revolute") == (abs(along) < 1e-9), joint.name
        assert joint.kind in ("revolute", "prismatic")
        return joint.kind, self._body(joint.predecessor), self._body(joint.successor), self.plane.flat(at), along

    def _state(self, y):
        """Centres of mass, angles and their rates; the last entry is the ground."""
        x, v = y.reshape(2, self.count, 3)
        return (
            np.append(x[:, 0] + 1j * x[:, 1], 0),
            np.append(x[:, 2], 0),
            np.append(v[:, 0] + 1j * v[:, 1], 0),
            np.append(v[:, 2], 0),
        )

    def _arm(self, i, point, angle):
        """Vector from the centre of mass (ground: from the origin) to a point of a body, turned by the body's angle."""
        return np.exp(1j * angle[i]) * (point - (self.drawn[i] if i >= 0 else 0))

    def rows(self, t, y):
        """Constraint equations of joints and drives: residuals, entries (row, column, number), gamma."""
        c, a, cd, ad = self._state(y)
        value, entries, gamma = [], [], []

        def add(columns, residual, g):
            entries.extend((len(value), k, x) for k, x in columns if k >= 0)
            value.append(residual)
            gamma.append(g)

        def point(i, arm, direction, sign):
            """Columns of the component along `direction` of a point of body i."""
            if i < 0:
                return []
            return [
                (3 * i, sign * direction.real),
                (3 * i + 1, sign * direction.imag),
                (3 * i + 2, sign * (np.conj(direction) * 1j * arm).real),
            ]

        for kind, i, j, at, along in self.joints:
            r, s = self._arm(i, at, a), self._arm(j, at, a)
            apart = c[j] + s - c[i] - r
            turning = -(ad[j] ** 2) * s + ad[i] ** 2 * r
            if kind == "revolute":
                for e in (1, 1j):
                    add(point(j, s, e, 1) + point(i, r, e, -1), (np.conj(e) * apart).real, -(np.conj(e) * turning).real)
                continue
            across = 1j * np.exp(1j * a[i]) * along  # fixed in the predecessor
            rate = cd[j] + 1j * ad[j] * s - cd[i] - 1j * ad[i] * r
            # second derivative of Re(conj(across) apart); `across` rotates with the predecessor
            columns = point(j, s, across, 1) + point(i, r, across, -1)
            columns += [(3 * i + 2, (np.conj(1j * across) * apart).real)] if i >= 0 else []
            g = (np.conj(across) * turning + 2 * np.conj(1j * ad[i] * across) * rate).real
            g -= ad[i] ** 2 * (np.conj(across) * apart).real
            add(columns, (np.conj(across) * apart).real, -g)
            add([(3 * j + 2, 1.0), (3 * i + 2 if i >= 0 else -1, -1.0)], a[j] - a[i], 0.0)
        for d in self.mechanism.drives:
            columns, q, _, g = self._coordinate(d.joint, y)
            f, _, second = d.motion.at(t)
            add(columns, q - f, second - g)
        return np.array(value), entries, np.array(gamma)

    def _coordinate(self, name, y):
        """Columns, value, rate of a joint coordinate, and the part of its second derivative without accelerations."""
        c, a, cd, ad = self._state(y)
        kind, i, j, at, along = self.by_name[name]
        if kind == "revolute":
            columns = [(k, x) for k, x in ((3 * j + 2, 1.0), (3 * i + 2, -1.0)) if k >= 0]
            return columns, a[j] - a[i], ad[j] - ad[i], 0.0
        assert i < 0, "sliding on the ground only"
        arm = self._arm(j, at, a)
        columns = [(3 * j, along.real), (3 * j + 1, along.imag)]  # a slide does not rotate
        return columns, (np.conj(along) * (c[j] + arm - at)).real, (np.conj(along) * cd[j]).real, 0.0

    def forces(self, y, t):
        m, f = self.mechanism, np.zeros(3 * self.count)
        c, a, cd, ad = self._state(y)
        weight = self.plane.gravity * self.weights[:, 0]
        f[0::3], f[1::3] = weight.real, weight.imag

        def push(i, arm, force):
            if i >= 0:
                f[3 * i : 3 * i + 3] += [force.real, force.imag, (np.conj(1j * arm) * force).real]

        for s in [*m.joint_springs, *m.frictions]:
            columns, q, rate, _ = self._coordinate(s.joint, y)
            if hasattr(s, "stiffness"):
                effort = -s.stiffness * (q - s.rest) - s.damping * rate + (s.actuator.at(t)[0] if s.actuator else 0.0)
            else:
                effort = -s.viscous * rate - s.coulomb * np.tanh(rate / s.speed)
            for k, x in columns:
                f[k] += x * effort
        for s in m.springs:
            ends = []
            for name, own in ((s.predecessor, s.point_predecessor), (s.successor, s.point_successor)):
                i = self._body(name)
                drawing = None if i < 0 else m.bodies[i].drawing
                arm = self._arm(i, self.plane.flat(own if i < 0 else drawing.p + drawing.R @ own), a)
                ends.append((i, arm, c[i] + arm, cd[i] + 1j * ad[i] * arm))
            apart, rate = ends[1][2] - ends[0][2], ends[1][3] - ends[0][3]
            e = apart / abs(apart)
            force = s.stiffness * (abs(apart) - s.free_length) + s.damping * (np.conj(e) * rate).real
            force -= s.actuator.at(t)[0] if s.actuator else 0.0
            push(ends[0][0], ends[0][1], force * e)
            push(ends[1][0], ends[1][1], -force * e)
        for load in m.loads:
            assert load.frame == "world"
            i, factor = self._body(load.body), load.history.at(t)[0] if load.history else 1.0
            if load.kind == "torque":
                f[3 * i + 2] += factor * self.plane.normal @ load.vector
            else:
                drawing = m.bodies[i].drawing
                arm = self._arm(i, self.plane.flat(drawing.p + drawing.R @ load.point), a)
                push(i, arm, factor * self.plane.flat(load.vector))
        return f

    def acceleration(self, t, y):
        _, entries, gamma = self.rows(t, y)
        w = self.weights.ravel()
        free = self.forces(y, t) / w
        row, column, number = zip(*entries, strict=True)
        C = csr_matrix((number, (row, column)), shape=(len(gamma), len(w)))
        S, b = C.multiply(1 / w) @ C.T, gamma - C @ free
        many = len(gamma) > _SPARSE_FROM
        lam = splu(S.tocsc()).solve(b) if many else np.linalg.lstsq(S.toarray(), b, rcond=1e-11)[0]
        return free + C.T @ lam / w

    def start(self, held, rated):
        """Consistent initial state: joint coordinates held as given, everything else nearest to the drawing."""
        y = np.zeros(6 * self.count)
        half = 3 * self.count
        y[0:half:3], y[1:half:3] = self.drawn.real, self.drawn.imag

        def system():
            value, entries, _ = self.rows(0.0, y)
            columns = [self._coordinate(name, y) for name in held]
            C = np.zeros((len(value) + len(held), half))
            for r, k, x in entries:
                C[r, k] += x
            for n, (own, *_) in enumerate(columns):
                for k, x in own:
                    C[len(value) + n, k] += x
            return np.append(value, [q - held[name] for name, (_, q, *_) in zip(held, columns, strict=True)]), C

        for _ in range(20):
            value, C = system()
            y[:half] -= np.linalg.lstsq(C, value, rcond=1e-11)[0]
        _, C = system()
        target = np.zeros(len(C))
        joints = len(C) - len(held)
        target[joints - len(self.mechanism.drives) : joints] = [d.motion.at(0.0)[1] for d in self.mechanism.drives]
        target[joints:] = [rated[name] for name in held]
        y[half:] = np.linalg.lstsq(C, target, rcond=1e-11)[0]
        return y

    def motion(self, case, times, tolerance=1e-12):
        rated = {name: value for name, by in case.initial.rates.items() for value in by.values()}
        held = {name: 0.0 for name in rated}
        held |= {name: value for name, by in case.initial.coordinates.items() for value in by.values()}
        y = self.start(held, {name: 0.0 for name in held} | rated)
        half, now, samples = 3 * self.count, 0.0, []
        for time in times:
            if time > now:
                solution = solve_ivp(
                    lambda t, y: np.concatenate([y[half:], self.acceleration(t, y)]),
                    (now, time),
                    y,
                    method="DOP853",
                    rtol=tolerance,
                    atol=tolerance,
                    t_eval=[time],
                )
                assert solution.success, solution.message
                y, now = solution.y[:, -1], time
            samples.append(y)
        return samples

    def values(self, case, published):
        times = sorted({p.time for p in published})
        at = dict(zip(times, self.motion(case, times), strict=True))
        return np.array([self._value(p, at[p.time]) for p in published])

    def _value(self, known, y):
        if known.of in self.by_name:
            _, q, rate, _ = self._coordinate(known.of, y)
            return rate if known.observable.endswith("_rate") else q
        plane, i = self.plane, self.mechanism.body_index[known.of]
        drawing = self.mechanism.bodies[i].drawing
        c, a, cd, ad = self._state(y)
        acceleration = self.acceleration(known.time, y).reshape(-1, 3)[i] if known.at_start else np.zeros(3)

        def space(flat):
            return flat.real * plane.e1 + flat.imag * plane.e2

        arm = self._arm(i, plane.flat(drawing.p), a)
        height = plane.normal @ drawing.p * plane.normal
        center = plane.normal @ (drawing.p + drawing.R @ self.mechanism.bodies[i].com) * plane.normal
        turn = np.exp(1j * a[i])

        def axis(k):
            e = drawing.R[:, k]
            return space(turn * plane.flat(e)) + plane.normal @ e * plane.normal

        vectors = {
            "p_WB": space(c[i] + arm) + height,
            "v_WB_W": space(cd[i] + 1j * ad[i] * arm),
            "w_WB_W": ad[i] * plane.normal,
            "p_WBcm": space(c[i]) + center,
            "v_WBcm_W": space(cd[i]),
            "x_axis": axis(0),
            "y_axis": axis(1),
            "z_axis": axis(2),
            "a_WB_W": space(complex(*acceleration[:2]) + (1j * acceleration[2] - ad[i] ** 2) * arm),
            "alpha_WB_W": acceleration[2] * plane.normal,
        }
        return vectors[known.observable][known.component]


def planar(pin):
    """Origin: Newton-Euler equations in the plane perpendicular to the axis of a revolute joint."""
    build = cache(lambda mechanism: PlanarNewton(mechanism, pin))

    def origin(case, published):
        return build(case.mechanism).values(case, published)

    return origin
