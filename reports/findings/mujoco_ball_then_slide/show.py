"""MuJoCo: `mj_jacDot` is wrong for a body on a ball joint and then a slide, and with it connect and weld.

A point at x = 0.5 m slides outwards at 1 m/s on what turns about z at 1 rad/s: its velocity term J' v has the
accelerations of Coriolis, 2 w x v = (0, 2, 0) m/s^2, and towards the axis, (-0.5, 0, 0). With a hinge below the slide
both are there; with a ball the former comes back halved: the derivative of the ball's axes is taken with the velocity
of the body, in which that of the slide is already.

Second route: without forces a body of twice the mass moves as the body itself does. A free twin in the same state,
held to the body by a weld, must not change its acceleration; with a ball below the slide it does. The impedance
0.9999 leaves a softness of 1e-4. Third: a finite difference of MuJoCo's own Jacobian.

The documentation allows a ball with slides on one body ("Combining ball joints with slide joints in the same body
is allowed", XML reference of `joint`).
"""

import sys

import mujoco
import numpy as np

HARD = 'solref="-0 -0" solimp="0.9999 0.9999 0.001 0.5 2"'
MASS = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
POINT = np.array([0.5, 0.0, 0.0])
LOWER = {"hinge": '<joint type="hinge" axis="0 0 1"/>', "ball": '<joint type="ball"/>'}


def body(lower, twin):
    """Model of a body at x = 0.5 m on a joint at the origin and a slide along x; with its free twin or without."""
    free = f'<body pos="0.5 0 0"><freejoint/>{MASS}<site name="b"/></body>' if twin else ""
    weld = f'<equality><weld site1="a" site2="b" {HARD}/></equality>' if twin else ""
    text = f"""<mujoco><option gravity="0 0 0"/><worldbody><body pos="0.5 0 0">
    {LOWER[lower].replace("/>", ' pos="-0.5 0 0"/>')}<joint type="slide" axis="1 0 0"/>{MASS}<site name="a"/></body>
    {free}</worldbody>{weld}</mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    n = model.nv - 6 if twin else model.nv
    data.qvel[n - 2 : n] = 1.0  # turning about z and sliding
    data.qvel[n:] = [1.0, 0.5, 0.0, 0.0, 0.0, 1.0][: model.nv - n]  # the twin: the same motion
    mujoco.mj_forward(model, data)
    return model, data, n


def velocity_term(lower):
    """J' v of the point, by mj_jacDot and by a finite difference of mj_jac."""
    model, data, _ = body(lower, twin=False)
    dJ, turning = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jacDot(model, data, dJ, turning, POINT, 1)
    v, q, h, rates = np.array(data.qvel), np.array(data.qpos), 1e-6, []
    for sign in (1.0, -1.0):
        data.qpos[:] = q
        mujoco.mj_integratePos(model, data.qpos, v, sign * h)
        mujoco.mj_forward(model, data)
        J = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, J, turning, data.xpos[1], 1)
        rates.append(J @ v)
    return dJ @ v, (rates[0] - rates[1]) / (2.0 * h)


print(f"mujoco {mujoco.__version__}")
error = {}
for lower in LOWER:
    found, difference = velocity_term(lower)
    _, alone, n = body(lower, twin=False)
    _, held, _ = body(lower, twin=True)
    a, b = np.array(alone.qacc[n - 2 : n]), np.array(held.qacc[n - 2 : n])
    error[lower] = (np.max(np.abs(found - difference)), np.max(np.abs(a - b)))
    print(f"{lower} then slide: J' v expected {np.round(difference, 6)} observed {np.round(found, 6)} m/s^2")
    print(f"   turning and sliding acceleration, alone {np.round(a, 4)}, with a welded twin {np.round(b, 4)}")
shown = max(error["hinge"]) < 1e-3 and min(error["ball"]) > 0.1
print("a ball before a slide spoils the velocity term" if shown else "the velocity term is right")
sys.exit(0 if shown else 1)
