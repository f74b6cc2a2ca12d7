"""MuJoCo: the default solver, Newton, returns wrong accelerations for very stiff equalities; CG does not; no warning.

A hanging chain of 20 hinges whose end is connected to the world, consistent velocities. The softness is scaled by
`body_invweight0`. Expected: the solution of the regularised problem that MuJoCo states, M a = f + J^T lam,
J a + R lam = a_ref, by a saddle-point solve in NumPy with MuJoCo's own M, f, J, R, a_ref. Second route: MuJoCo's CG.
"""

import sys

import mujoco
import numpy as np

LINKS, SCALES = 20, (1.0, 1e-4, 1e-6, 1e-8, 1e-10)


def text(solver):
    """MJCF of the chain."""
    inertial = '<inertial pos="0.05 0 0" mass="1" diaginertia="0.001 0.001 0.001"/>'
    bodies = [f'<body pos="{0.1 if i else 0} 0 0"><joint axis="0 1 0"/>{inertial}' for i in range(LINKS)]
    chain = "".join(bodies) + '<site name="end" pos="0.1 0 0"/>' + "</body>" * LINKS
    hard = 'solref="-0 -0" solimp="0.9999 0.9999 0.001 0.5 2"'
    return f"""<mujoco><option solver="{solver}" tolerance="0" iterations="100" jacobian="dense"/>
<worldbody><site name="hook"/>{chain}</worldbody>
<equality><connect site1="end" site2="hook" {hard}/></equality></mujoco>"""


def solve(solver, scale):
    """Relative error of the accelerations, and the warnings MuJoCo counted."""
    model = mujoco.MjModel.from_xml_string(text(solver))
    model.body_invweight0[:] *= scale
    data = mujoco.MjData(model)
    n = np.arange(LINKS)
    data.qpos[:] = 0.4 * np.sin(n + 0.3)
    mujoco.mj_forward(model, data)
    model.site("hook").pos[:] = data.site("end").xpos
    mujoco.mj_forward(model, data)
    J = data.efc_J[: data.nefc * model.nv].reshape(-1, model.nv).copy()
    v = np.cos(1.7 * n)
    data.qvel[:] = v - np.linalg.lstsq(J, J @ v, rcond=1e-10)[0]
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    held = np.max(np.abs(J), axis=1) > 1e-9  # the chain is planar: the row across its plane is empty
    J, R, target = J[held], data.efc_R[: data.nefc][held], data.efc_aref[: data.nefc][held]
    KKT = np.block([[M, -J.T], [J, np.diag(R)]])
    expected = np.linalg.solve(KKT, np.concatenate([data.qfrc_smooth, target]))[: model.nv]
    error = np.max(np.abs(data.qacc - expected)) / np.max(np.abs(expected))
    return error, int(np.sum(data.warning.number))


print(f"mujoco {mujoco.__version__}: relative error of the accelerations, expected about 1e-12; warnings")
print("scale of softness   Newton             CG")
found = {(solver, scale): solve(solver, scale) for scale in SCALES for solver in ("Newton", "CG")}
for scale in SCALES:
    (newton, warned), (cg, _) = found["Newton", scale], found["CG", scale]
    print(f"{scale:9.0e}           {newton:.1e} ({warned})        {cg:.1e}")
shown = found["Newton", 1e-6][0] < 1e-6 and found["Newton", 1e-8][0] > 1e-2 and found["Newton", 1e-8][1] == 0
shown = shown and all(found["CG", scale][0] < 1e-6 for scale in SCALES)
print("Newton is wrong, without a warning" if shown else "both are right, or it warns")
sys.exit(0 if shown else 1)
