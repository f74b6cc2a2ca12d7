"""MuJoCo: inertial frames and sites within 2e-6 rad, or 1e-6 m, of the frame of the body are taken for it.

A free body with moments 0.1, 0.2, 0.25 about axes tilted by 1e-7 rad to 1e-5 rad. Expected: the products of inertia in
the mass matrix, and the turn of a site, are in proportion to the tilt: 0.12 kg m^2 and 0.8 for each rad, by hand. A
site 1e-7 m to 1e-5 m from the origin of the body is that far from it.
"""

import sys

import mujoco
import numpy as np


def compiled(tilt, offset):
    """Model and data of a free body whose inertial axes and site are tilted, with a second site at an offset."""
    spec = mujoco.MjSpec()
    quat = [np.cos(tilt / 2), 0.6 * np.sin(tilt / 2), 0.8 * np.sin(tilt / 2), 0.0]
    body = spec.worldbody.add_body(mass=2.0, inertia=[0.1, 0.2, 0.25], iquat=quat, explicitinertial=True)
    body.ipos = [0.0, 0.0, 0.0]
    body.add_freejoint()
    body.add_site(name="tilted", quat=quat)
    body.add_site(name="moved", pos=[offset, 0.0, 0.0])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def products(model, data):
    """Largest product of inertia in the mass matrix."""
    M = np.zeros((6, 6))
    mujoco.mj_fullM(model, data, M)
    turning = M[3:, 3:]
    return np.max(np.abs(turning - np.diag(np.diag(turning))))


print(f"mujoco {mujoco.__version__}: per rad of tilt expected 0.12 and 0.8, per m of offset 1")
shown = {}
for size in (1e-7, 1e-6, 1e-5, 1e-4):
    model, data = compiled(size, size)
    turned = np.max(np.abs(data.site("tilted").xmat.reshape(3, 3) - np.eye(3))) / size
    moved = np.linalg.norm(data.site("moved").xpos - data.xpos[1]) / size
    shown[size] = products(model, data) / size, turned, moved
    print(f"size {size:.0e}: product of inertia {shown[size][0]:.3f}, turn {turned:.3f}, offset {moved:.3f}")
lost = max(shown[1e-7]) == 0.0
right = np.allclose(shown[1e-4], (0.12, 0.8, 1.0), rtol=1e-3)
sys.exit(0 if lost and right else 1)
