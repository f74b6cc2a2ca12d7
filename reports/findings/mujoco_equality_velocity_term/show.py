"""MuJoCo: tendon equalities and curved joint equalities lack the velocity term J' v of their acceleration.

A mass circles at r = 0.5 m with 2 m/s on a tendon of fixed length: -v^2 / r = -8 m/s^2. A bead runs at 2 m/s through
the lowest point of the parabola y = 3 x^2: 2 c v^2 = 24 m/s^2. Both come back with 0. Second route: `connect`, which
has the term, on a body that circles in the same way; and J' v by a finite difference of MuJoCo's own Jacobian of the
tendon. Impedance 0.9999 leaves a softness of 1e-4, so that `connect` shows 7.9992.
"""

import sys

import mujoco
import numpy as np

HARD = 'solref="-0 -0" solimp="0.9999 0.9999 0.001 0.5 2"'
HEAD = '<mujoco><option gravity="0 0 0"/><worldbody><site name="o"/>'
MASS = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><site name="p"/>'
PLANE = '<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>'
TENDON = f"""{HEAD}<body pos="0.5 0 0">{PLANE}{MASS}</body></worldbody>
<tendon><spatial name="t"><site site="o"/><site site="p"/></spatial></tendon>
<equality><tendon tendon1="t" {HARD}/></equality></mujoco>"""
PARABOLA = f"""{HEAD}<body>{PLANE}{MASS}</body></worldbody>
<equality><joint joint1="y" joint2="x" polycoef="0 0 3 0 0" {HARD}/></equality></mujoco>"""
CONNECT = f"""{HEAD}<body pos="0.5 0 0"><freejoint/>{MASS}<site name="s" pos="-0.5 0 0"/></body></worldbody>
<equality><connect site1="s" site2="o" {HARD}/></equality></mujoco>"""


def evaluate(text, v, shift=None):
    """Data after mj_forward, at the initial position, or at it moved by `shift`."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    if shift is not None:
        data.qpos[:] += shift
    data.qvel[:] = v
    mujoco.mj_forward(model, data)
    return data


circle = np.array([0.0, 2.0])
tendon = evaluate(TENDON, circle).qacc[0]
bead = evaluate(PARABOLA, [2.0, 0.0]).qacc[1]
connect = evaluate(CONNECT, [0.0, 2.0, 0.0, 0.0, 0.0, 4.0]).qacc[0]
h = 1e-5
rows = [np.array(evaluate(TENDON, circle, sign * h * circle).efc_J[:2]) for sign in (1.0, -1.0)]
by_difference = (rows[0] - rows[1]) @ circle / (2.0 * h)

print(f"mujoco {mujoco.__version__}")
print(f"tendon of fixed length   expected  -8   observed {tendon + 0.0:8.4f} m/s^2")
print(f"bead on a parabola       expected  24   observed {bead + 0.0:8.4f} m/s^2")
print(f"connect, the same circle expected  -8   observed {connect:8.4f} m/s^2")
print(f"J' v of the tendon by finite differences {by_difference:.6f} m/s^2: J a should be its negative")
shown = abs(tendon) < 1e-12 and abs(bead) < 1e-12 and abs(connect + 8.0) < 1e-2 and abs(by_difference - 8.0) < 1e-6
print("the term is missing" if shown else "the term is there")
sys.exit(0 if shown else 1)
