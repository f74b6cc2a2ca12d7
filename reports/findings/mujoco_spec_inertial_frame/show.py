"""MuJoCo: a body of MjSpec without `ipos` gets its own pose a second time as its inertial frame; `iquat` is dropped.

`ipos` and `iquat` place the inertia in the body. Expected without `ipos`: the inertia at the body's origin, turned by
the `iquat` that was asked. Observed: displaced by the body's `pos` and turned by its `quat`, which are those of the
body in its parent. Second route, by the motion: a hinge through the centre of mass feels no gravity, and a free body
under a torque turns with I^-1 tau. With `ipos` given as zero, and from MJCF, all is as expected.
"""

import sys

import mujoco
import numpy as np

MOMENTS = np.array([1.0, 2.0, 2.5])
POS, QUAT = np.array([1.0, 2.0, 3.0]), np.array([0.5, 0.5, -0.1, 0.7])
QUAT /= np.linalg.norm(QUAT)
TORQUE = np.array([1.0, 0.0, 0.0])


def from_spec(free, **more):
    """Compile the body from MjSpec, on a free joint or on a hinge about y through its origin."""
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(pos=POS, mass=1.0, inertia=MOMENTS, iquat=QUAT, explicitinertial=True, **more)
    if free:
        body.add_freejoint()
    else:
        body.add_joint(axis=[0.0, 1.0, 0.0])
    return spec.compile()


def from_text(free):
    """Compile the same body from MJCF."""
    pos, quat, moments = (" ".join(map(str, numbers)) for numbers in (POS, QUAT, MOMENTS))
    joint = "<freejoint/>" if free else '<joint axis="0 1 0"/>'
    inertial = f'<inertial pos="0 0 0" mass="1" quat="{quat}" diaginertia="{moments}"/>'
    body = f'<body pos="{pos}">{joint}{inertial}</body>'
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")


def accelerations(make):
    """Angular acceleration of the free body under `TORQUE`, and of the hinge under gravity."""
    free, hinged = make(True), make(False)
    data = mujoco.MjData(free)
    data.xfrc_applied[1, 3:] = TORQUE
    mujoco.mj_forward(free, data)
    at_hinge = mujoco.MjData(hinged)
    mujoco.mj_forward(hinged, at_hinge)
    return np.array([*data.qacc[3:], at_hinge.qacc[0]])


R = np.zeros(9)
mujoco.mju_quat2Mat(R, QUAT)
R = R.reshape(3, 3)
expected = np.array([*np.linalg.solve(R @ np.diag(MOMENTS) @ R.T, TORQUE), 0.0])
makers = {
    "MJCF": from_text,
    "MjSpec, ipos given": lambda free: from_spec(free, ipos=[0.0, 0.0, 0.0]),
    "MjSpec, no ipos": from_spec,
}
print(f"mujoco {mujoco.__version__}: body at {POS}")
print(f"{'expected':19s} ipos {np.zeros(3)} iquat {np.round(QUAT, 3)} accelerations {np.round(expected, 4)}")
right = {}
for name, make in makers.items():
    model, found = make(True), accelerations(make)
    ipos, iquat = model.body_ipos[1], model.body_iquat[1]
    print(f"{name:19s} ipos {ipos} iquat {np.round(iquat, 3)} accelerations {np.round(found, 4)}")
    right[name] = all(np.allclose(a, b, atol=1e-12) for a, b in ((ipos, 0.0), (iquat, QUAT), (found, expected)))
observed = makers["MjSpec, no ipos"](True)
twice = np.allclose(observed.body_ipos[1], POS) and np.allclose(observed.body_iquat[1], [1.0, 0.0, 0.0, 0.0])
shown = right["MJCF"] and right["MjSpec, ipos given"] and twice and not right["MjSpec, no ipos"]
print("the pose of the body stands in for that of its inertia" if shown else "as expected, or wrong in another way")
sys.exit(0 if shown else 1)
