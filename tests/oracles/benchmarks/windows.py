"""N-four-bar mechanism: problem A02 of the IFToMM library [Bayo & Avello 1994].

N windows (four-bars side by side) of slender rods, 1 m and 1 kg; the N + 1 upright rods are pinned to the ground at
(i, 0). While all windows are parallelograms, all upright rods have one angle theta from upright, with
``theta'' = c sin(theta)``, ``c = g ((N + 1) / 2 + N) / ((N + 1) / 3 + N)``: a pendulum that hangs at theta = pi.
"""

import numpy as np

from consilience.mechanism import GROUND
from oracles.benchmarks.build import X, Y, Z, mechanism, placed, thin_rod
from oracles.closed_forms.pendulum import Pendulum


def windows(count):
    """The mechanism, drawn upright, and its initial state: the upper end of the first rod moves at 1 m/s along x."""
    bodies, joints, velocities = [], [], {}
    for i in range(count + 1):
        bodies.append(thin_rod(f"up{i}", 1.0, (i * X, i * X + Y), 1 / 12))
        joints.append((f"foot{i}", "revolute", GROUND, f"up{i}", i * X, Z))
        velocities[f"up{i}"] = (np.zeros(3), -Z)
    for i in range(count):
        bodies.append(thin_rod(f"over{i}", 1.0, (i * X + Y, (i + 1) * X + Y), 1 / 12))
        joints.append((f"left{i}", "revolute", f"up{i}", f"over{i}", i * X + Y, Z))
        joints.append((f"right{i}", "revolute", f"over{i}", f"up{i + 1}", (i + 1) * X + Y, Z))
        velocities[f"over{i}"] = (X, np.zeros(3))
    plain = mechanism(f"windows{count}", -9.81 * Y, bodies, joints)
    return plain, placed(plain, velocities)


def angle(count, times):
    """theta, with full turns counted, and its rate."""
    c = 9.81 * ((count + 1) / 2 + count) / ((count + 1) / 3 + count)
    phi, rate = Pendulum(np.sqrt(c), -np.pi, 1.0).solve(times)
    return phi + np.pi, rate
