"""MuJoCo: rows of contacts lack the velocity term J' v of the acceleration of the gap.

The lower end of a slender rod of 1 m and 1 kg is on a smooth floor; the rod leans by 0.7 rad and turns at 2 rad/s. The
centre is at the height 1/2 cos th: N = (g - 1/2 th'^2 cos th) / (1 + 3 sin^2 th). The contact is as hard as MuJoCo has
it, and does not separate. Second routes: the same rod at rest, where the term vanishes; J' v by a finite difference of
MuJoCo's own row.
"""

import sys

import mujoco
import numpy as np

G, LEAN, RATE, POINT = 9.81, 0.7, 2.0, 1e-9
XML = f"""<mujoco><option gravity="0 0 -{G}" cone="elliptic" jacobian="dense" tolerance="0" iterations="50"/>
<worldbody><geom name="floor" type="plane" size="0 0 1" contype="0" conaffinity="0"/>
<body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="0.0833333333333333 0.0833333333333333 0.001"/>
<geom name="tip" type="sphere" size="{POINT}" pos="0 0 -0.5" mass="0" contype="0" conaffinity="0"/></body></worldbody>
<contact><pair geom1="floor" geom2="tip" condim="1" margin="1e-3" solref="-0 -0" solimp="0.9999 0.9999 0.001 0.5 2"/>
</contact></mujoco>"""

model = mujoco.MjModel.from_xml_string(XML)
model.body_invweight0[:] *= 1e-6  # harder than the impedance allows
data = mujoco.MjData(model)


def place(rate, time=0.0):
    """Evaluate the rod at a rate, after it has turned for a time about its end."""
    th = LEAN + rate * time
    data.qpos[:] = [0, 0, 0.5 * np.cos(th) + POINT, np.cos(th / 2), 0, np.sin(th / 2), 0]
    data.qvel[:] = [0, 0, -0.5 * np.sin(th) * rate, 0, rate, 0]
    mujoco.mj_forward(model, data)
    return np.array(data.efc_J[: model.nv])


def normal(rate):
    """Normal force by MuJoCo, and by the balance of momentum."""
    place(rate)
    sine, cosine = np.sin(LEAN), np.cos(LEAN)
    return float(data.efc_force[0]), (G - 0.5 * rate**2 * cosine) / (1.0 + 3.0 * sine**2)


at_rest, right_at_rest = normal(0.0)
turning, right = normal(RATE)
step = 1e-6
term = (place(RATE, step) - place(RATE, -step)) @ np.array([0, 0, -0.5 * np.sin(LEAN) * RATE, 0, RATE, 0]) / (2 * step)
print(f"mujoco {mujoco.__version__}")
print(f"at rest          expected {right_at_rest:.6f} N  observed {at_rest:.6f}")
print(f"turning          expected {right:.6f} N  observed {turning:.6f}: {turning / right - 1.0:.1%}")
print(f"J' v of the row by finite differences {term:.6f} m/s^2, 1/2 th'^2 cos th = {0.5 * RATE**2 * np.cos(LEAN):.6f}")
missing = abs(turning - right_at_rest) < 1e-4 and abs(at_rest - right_at_rest) < 1e-4
print("the term is missing" if missing and abs(term) > 1.0 else "the term is there")
sys.exit(0 if missing and abs(term) > 1.0 else 1)
