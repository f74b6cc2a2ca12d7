"""Origins of the cases of group `hard`."""

import numpy as np

from oracles.origins import newton_euler
from oracles.origins.mechanisms import angle_after, axis_of, closed, moment_of_inertia, turned
from oracles.origins.planar_newton import planar
from oracles.origins.relative import lagrange
from oracles.planar import Plane

# ---------------------------------------------------------------- links in a row


class Row:
    """A planar row of equal links in their absolute angles: pin n is at the sum of the links before it.

    M_jl = sum_n m Re(conj(b_nj) b_nl) + I, with b_nj the velocity of the centre of mass n for a unit rate of link j. A
    ring adds two closure equations: the sum of all links is zero.
    """

    def __init__(self, mechanism, ring):
        self.plane, self.ring, n = Plane(mechanism, "pin_1"), ring, len(mechanism.bodies)
        pins = np.array([self.plane.pin(f"pin_{k + 1}") for k in range(n)])
        # beyond the last link of a chain there is no pin: its length has no effect
        self.link = np.roll(pins, -1) - pins
        self.index = {b.name: k for k, b in enumerate(mechanism.bodies)}
        bodies = list(self.plane.bodies())
        self.center = np.array([b.com for b in bodies]) - pins
        self.mass, self.inertia = (np.array([getattr(b, name) for b in bodies]) for name in ("mass", "inertia"))
        self.before = np.tril(np.ones((n, n)), -1)

    def acceleration(self, y):
        a, w = np.split(y, 2)
        turn = np.exp(1j * a)
        arms = self.before * (self.link * turn) + np.diag(self.center * turn)
        B = 1j * arms
        M = (B.conj().T @ (self.mass[:, None] * B)).real + np.diag(self.inertia)
        weight = self.plane.gravity + arms @ w**2  # gravity minus centripetal acceleration
        f = (B.conj().T @ (self.mass * weight)).real
        if not self.ring:
            return np.linalg.solve(M, f)
        loop = 1j * self.link * turn
        C, gamma = np.array([loop.real, loop.imag]), (self.link * turn) @ w**2
        K = np.block([[M, -C.T], [C, np.zeros((2, 2))]])
        return np.linalg.solve(K, np.concatenate([f, [gamma.real, gamma.imag]]))[: len(a)]

    def values(self, case, published):
        """Values at the start; the mechanism is at rest."""
        assert all(known.at_start for known in published)
        assert not case.initial.coordinates
        assert not case.initial.rates
        return np.array([self._value(known, np.zeros(2 * len(self.link))) for known in published])

    def _value(self, known, y):
        (a, w), k, plane = np.split(y, 2), self.index[known.of], self.plane
        alpha = self.acceleration(y)
        rise = np.sum(((1j * alpha - w**2) * self.link * np.exp(1j * a))[:k])
        return {"a_WB_W": rise.real * plane.e1 + rise.imag * plane.e2, "alpha_WB_W": alpha[k] * plane.normal}[
            known.observable
        ][known.component]


def row(ring):
    return lambda case, published: Row(case.mechanism, ring).values(case, published)


# ---------------------------------------------------------------- platform on parallel bars


def _five_bars(case, known):
    """The platform translates only: equation of a compound pendulum; time is a quadrature over its angle."""
    m = case.mechanism
    _, normal = axis_of(case, "pivot_1")
    J, pull = 0.0, np.zeros(3)
    arm = axis_of(case, "pin_1")[0] - axis_of(case, "pivot_1")[0]
    for body in m.bodies:
        if body.name == "platform":
            J, pull = J + body.mass * arm @ arm, pull + body.mass * arm
            continue
        pivot, _ = axis_of(case, body.name.replace("bar", "pivot"))
        out = body.drawing.p + body.drawing.R @ body.com - pivot
        J += moment_of_inertia(body, pivot, normal)
        pull += body.mass * (out - normal * (normal @ out))
    first, rate = case.initial.coordinates["pivot_1"]["angle"], case.initial.rates["pivot_1"]["angle"]
    down, side = m.gravity @ pull, m.gravity @ np.cross(normal, pull)

    def acceleration(q):
        return (side * np.cos(q) - down * np.sin(q)) / J

    def potential(q):
        return -(down * np.cos(q) + side * np.sin(q)) / J

    if known.time == 0:
        q, speed = first, rate
    else:
        # q = middle + half sin(s) makes the quadrature regular at the turning points, so that it can pass them
        energy = rate**2 / 2 + potential(first)
        middle = np.arctan2(side, down)
        half = np.arccos(-energy * J / np.hypot(down, side))
        k = np.sin(half / 2)
        # sin((q - middle) / 2) = k sin(s), s' = w sqrt(1 - k^2 sin(s)^2)
        w = np.sqrt(np.hypot(down, side) / J)
        start = np.arcsin(np.sin((first - middle) / 2) / k)

        def slowness(s):
            return 1 / (w * np.sqrt(1 - k**2 * np.sin(start + s) ** 2))

        s = start + angle_after(known.time, slowness)
        q = middle + 2 * np.arcsin(k * np.sin(s))
        speed = 2 * w * k * np.cos(s)
    alpha, spin = acceleration(q) * normal, speed * normal
    body = m.bodies[m.body_index[known.of]]
    swung = turned(arm, normal, q)
    if known.of == "platform":
        value = {
            "p_WB": body.drawing.p + swung - arm,
            "v_WB_W": np.cross(spin, swung),
            "a_WB_W": np.cross(alpha, swung) - speed**2 * swung,
            "w_WB_W": np.zeros(3),
        }
    else:
        value = {"w_WB_W": spin, "alpha_WB_W": alpha}
    return value[known.observable][known.component]


NEWTON_EULER = newton_euler.values

ORIGINS = {
    "chaotic_double_pendulum": (lagrange(), planar("shoulder")),
    "mass_ratio": (lagrange(), NEWTON_EULER),
    "stiff_spring": (lagrange(), NEWTON_EULER),
    "collinear_four_bar": (lagrange("rocker_pin"), planar("crank_pivot")),
    "five_bar_platform": (closed(_five_bars, None),),
    "chain_of_100": (row(ring=False), planar("pin_1")),
    "ring_of_50": (row(ring=True), planar("pin_1")),
}
