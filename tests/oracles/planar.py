"""Planar mechanisms in complex numbers, from the drawing alone.

All points move parallel to one plane. Data are the drawn poses of the bodies and the drawn points of the joints; the
package's assembly and kinematics are not used.
"""

from dataclasses import dataclass

import numpy as np

from consilience.mechanism import GROUND, Frame


def drawn_frame(mechanism, joint):
    """Frame F of a joint in the drawing: its origin and its axes as columns, in the world."""
    drawings = {GROUND: Frame(np.zeros(3), np.eye(3))} | {b.name: b.drawing for b in mechanism.bodies}
    body, frame = drawings[joint.predecessor], joint.F
    return body.p + body.R @ frame.p, body.R @ frame.R


def held(case, joint):
    """Initial angle and rate at which the case holds a joint; zero where it holds none."""
    return (
        float(case.initial.coordinates.get(joint, {}).get("angle", 0.0)),
        float(case.initial.rates.get(joint, {}).get("angle", 0.0)),
    )


@dataclass(frozen=True)
class PlanarBody:
    """Mass, inertia and drawn centre of mass of a body in the plane.

    Attributes
    ----------
    mass, inertia : float
        Inertia about the normal through the centre of mass, kg m^2.
    com : complex
        Centre of mass in the drawing, m.
    """

    mass: float
    inertia: float
    com: complex


class Plane:
    """The plane perpendicular to the axis of the revolute joint `name`, through the world's origin."""

    def __init__(self, mechanism, name):
        self.mechanism = mechanism
        _, axes = drawn_frame(mechanism, mechanism.joints[mechanism.joint_index[name]])
        self.e1, self.e2, self.normal = axes.T
        self.gravity = self.flat(mechanism.gravity)
        for joint in mechanism.joints:
            if joint.kind == "revolute":
                assert np.allclose(drawn_frame(mechanism, joint)[1][:, 2], self.normal, rtol=0, atol=1e-15)

    def flat(self, vector):
        """Components in the plane of a vector in world axes."""
        return complex(self.e1 @ vector, self.e2 @ vector)

    def pin(self, name):
        """Drawn position of a joint in the plane."""
        return self.flat(drawn_frame(self.mechanism, self.mechanism.joints[self.mechanism.joint_index[name]])[0])

    def bodies(self):
        """All bodies, in the order of the mechanism."""
        for body in self.mechanism.bodies:
            R, p = body.drawing.R, body.drawing.p
            inertia = self.normal @ R @ body.inertia @ R.T @ self.normal
            yield PlanarBody(body.mass, float(inertia), self.flat(p + R @ body.com))

    def place(self, index, drawn_anchor, anchor, turn):
        """World poses of one body, turned out of the drawing by the unit numbers `turn`.

        Parameters
        ----------
        drawn_anchor : complex
            A point of the body in the drawing.
        anchor, turn : complex ndarray, shape (n_t,)
            Where that point is now; ``exp(i angle)``.

        Returns
        -------
        p_WB : ndarray, shape (n_t, 3)
        R_WB : ndarray, shape (n_t, 3, 3)
        """
        drawing = self.mechanism.bodies[index].drawing
        flat = anchor + turn * (self.flat(drawing.p) - drawn_anchor)
        height = self.normal @ drawing.p
        p_WB = flat.real[:, None] * self.e1 + flat.imag[:, None] * self.e2 + height * self.normal
        axes = np.column_stack([self.e1, self.e2, self.normal])
        spin = np.zeros((len(turn), 3, 3))
        spin[:, 0, 0] = spin[:, 1, 1] = turn.real
        spin[:, 1, 0], spin[:, 0, 1] = turn.imag, -turn.imag
        spin[:, 2, 2] = 1.0
        return p_WB, axes @ spin @ (axes.T @ drawing.R)


def dot(a, b):
    """Scalar product of two vectors of the plane."""
    return (np.conj(a) * b).real


def components(a, b, c):
    """Real x, y with ``x a + y b = c``: a vector of the plane in a skew basis."""
    return (c * np.conj(b)).imag / (a * np.conj(b)).imag, (c * np.conj(a)).imag / (b * np.conj(a)).imag
