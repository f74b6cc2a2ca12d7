"""Origins of the cases of single joints: Lagrange's equations in joint coordinates, Newton-Euler, closed forms."""

import numpy as np

from oracles.benchmarks import chrono_joints
from oracles.closed_forms.oscillator import oscillator
from oracles.closed_forms.pendulum import Pendulum
from oracles.origins import lagrange, newton_euler

KINDS = (
    "revolute",
    "prismatic",
    "cylindrical",
    "universal",
    "spherical",
    "planar",
    "screw",
    "free",
    "point_on_line",
    "point_in_plane",
    "parallel_axes",
    "rod",
    "rigid",
)

COMPUTED = (lagrange.values, newton_euler.values)


def _picked(published, motion):
    """Expected values in the order of `published`; `motion(time)` gives each observable."""
    return np.array([motion(known.time)[known.observable][known.component] for known in published])


def _chrono(name):
    """Pendulum, fall along the axis, or both, of Project Chrono; body origin at the centre of mass."""

    def values(case, published):
        def motion(t):
            r, w = chrono_joints.pendulum_motion(name, [t])
            return {"p_WB": r[0], "w_WB_W": w[0]}

        return _picked(published, motion)

    return values


def _chrono_slide(case, published):
    """Fall from rest along (0, 1, 1)."""
    axis = np.array([0.0, 1.0, 1.0]) / np.sqrt(2)
    start = np.array([3.0, 2.0, 3.0])

    def motion(t):
        v = -chrono_joints.G / np.sqrt(2) * t * axis
        return {"p_WB": start + v * t / 2, "v_WB_W": v}

    return _picked(published, motion)


def _chrono_distance(case, published):
    """Simple pendulum of 2 m in the yz plane, released at the level of its pivot."""

    def motion(t):
        angle, rate = (x[0] for x in Pendulum(np.sqrt(chrono_joints.G / 2), np.pi / 2, 0.0).solve([t]))
        s, c = np.sin(angle), np.cos(angle)
        return {"p_WB": 2 * np.array([0.0, s, -c]), "v_WB_W": 2 * rate * np.array([0.0, c, s])}

    return _picked(published, motion)


def _chrono_oscillator(case, published):
    """A mass on a damped vertical spring, released at the free length."""
    middle = -chrono_joints.G / 10

    def motion(t):
        z, rate = (x[0] for x in oscillator(1.0, 0.5, 10.0, -middle, 0.0, [t]))
        return {"p_WB": np.array([0.0, 0.0, middle + z]), "v_WB_W": np.array([0.0, 0.0, rate])}

    return _picked(published, motion)


ORIGINS = {f"single_{kind}": COMPUTED for kind in KINDS} | {
    "adams_revolute_01": (_chrono("Revolute_01"),),
    "adams_revolute_02": (_chrono("Revolute_02"),),
    "adams_spherical_02": (_chrono("Spherical_02"),),
    "adams_cylindrical_03": (_chrono("Cylindrical_03"),),
    "adams_prismatic_02": (_chrono_slide,),
    "adams_distance_01": (_chrono_distance,),
    "adams_tran_spring_01": (_chrono_oscillator,),
    "adams_universal_03": COMPUTED,
    "adams_distance_03": COMPUTED,
    "adams_rot_spring": COMPUTED,
    "adams_tran_spring_02": COMPUTED,
}
