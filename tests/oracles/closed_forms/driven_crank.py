"""Slider-crank with a crank of constant speed: kinematics in closed form.

Crank r, connecting rod l, slide along x at the offset e: with the crank angle theta = theta0 + w t

    s = r cos(theta) + u,    u = sqrt(l^2 - h^2),    h = r sin(theta) - e,    sin(beta) = -h / l,
    s' = -r w (sin(theta) + h cos(theta) / u),
    s'' = -r w^2 (cos(theta) + (r cos(theta)^2 - h sin(theta)) / u + r h^2 cos(theta)^2 / u^3),

beta is the angle of the rod from x.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class DrivenCrank:
    """Lengths r, l, e in m, angle theta0 at time zero and speed w of the crank in rad/s."""

    crank: float
    rod: float
    offset: float
    start: float
    speed: float

    def angle(self, times):
        """theta, shape (n_t,)."""
        return self.start + self.speed * np.asarray(times)

    def piston(self, times):
        """s, s' and s'', each shape (n_t,)."""
        r, w, theta = self.crank, self.speed, self.angle(times)
        sin, cos = np.sin(theta), np.cos(theta)
        h = r * sin - self.offset
        u = np.sqrt(self.rod**2 - h**2)
        s = r * cos + u
        rate = -r * w * (sin + h * cos / u)
        return s, rate, -r * w**2 * (cos + (r * cos**2 - h * sin) / u + r * h**2 * cos**2 / u**3)

    def rod_motion(self, times):
        """beta and its first and second rate, each shape (n_t,)."""
        r, w, theta = self.crank, self.speed, self.angle(times)
        beta = -np.arcsin((r * np.sin(theta) - self.offset) / self.rod)
        rate = -r * w * np.cos(theta) / (self.rod * np.cos(beta))
        # (l sin beta)'' = -h''
        acceleration = (r * w**2 * np.sin(theta) / self.rod + np.sin(beta) * rate**2) / np.cos(beta)
        return beta, rate, acceleration
