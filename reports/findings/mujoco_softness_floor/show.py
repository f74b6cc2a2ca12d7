"""MuJoCo: an equality cannot be harder than R = 1e-15, in the units of the model.

Two masses of 4000 and 4002 kg on a rope over a pulley: two sliders, z1 = -z2 as a joint equality. The acceleration is
g (m2 - m1) / (m1 + m2), 2.45e-3 m/s^2, the rope pulls with 3.9e4 N. The softness R follows solimp and dof_invweight0;
made smaller and smaller by the latter it stops at mjMINVAL, and the row J a = -R F with the large force F leaves an
error of acceleration that no setting removes. R is the inverse of a mass: in units in which the masses are 1000 times
smaller the same motion is 1000 times more accurate. Second route: the saddle-point system in NumPy with R = 1e-15
gives MuJoCo's error, with R = 0 none; MuJoCo's CG agrees with Newton.
"""

import sys

import mujoco
import numpy as np

G, FLOOR, SOFTER = 9.81, 1e-15, (1.0, 1e-4, 1e-8, 1e-12, 1e-16)


def text(masses, solver):
    """MJCF of both sliders."""
    bodies = "".join(
        f'<body><joint name="z{n}" type="slide" axis="0 0 1"/>'
        f'<inertial pos="0 0 0" mass="{mass!r}" diaginertia="1 1 1"/></body>'
        for n, mass in enumerate(masses)
    )
    hard = 'solref="-0 -0" solimp="0.9999 0.9999 0.001 0.5 2"'
    return f"""<mujoco><option solver="{solver}" tolerance="0" iterations="100" jacobian="dense" gravity="0 0 -{G}"/>
<worldbody>{bodies}</worldbody>
<equality><joint joint1="z0" joint2="z1" polycoef="0 -1 0 0 0" {hard}/></equality></mujoco>"""


def solve(unit, scale, solver):
    """R, the relative error of the acceleration, and that of NumPy with R and with zero."""
    masses = 4000.0 * unit, 4002.0 * unit
    model = mujoco.MjModel.from_xml_string(text(masses, solver))
    model.dof_invweight0[:] *= scale
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    expected = G * (masses[1] - masses[0]) / (masses[0] + masses[1])
    R, by_hand = float(data.efc_R[0]), []
    for softness in (R, 0.0):
        KKT = np.array([[masses[0], 0.0, -1.0], [0.0, masses[1], -1.0], [1.0, 1.0, softness]])
        by_hand.append(np.linalg.solve(KKT, [-G * masses[0], -G * masses[1], 0.0])[0] / expected - 1.0)
    return R, data.qacc[0] / expected - 1.0, *by_hand


print(f"mujoco {mujoco.__version__}: softness R and relative error of the acceleration")
print("unit of mass, solver  scale    R        error     NumPy with R   with R = 0")
found = {}
for unit in (1.0, 1e-3):
    for solver in ("Newton", "CG"):
        for scale in SOFTER:
            R, error, with_r, without = found[unit, solver, scale] = solve(unit, scale, solver)
            print(f"{unit:9.0e} {solver:10s} {scale:7.0e}  {R:.2e}  {error:8.1e}  {with_r:8.1e}      {without:8.1e}")
shown = all(found[unit, solver, 1e-16][0] == FLOOR for unit in (1.0, 1e-3) for solver in ("Newton", "CG"))
for solver in ("Newton", "CG"):
    last, before = found[1.0, solver, 1e-16], found[1.0, solver, 1e-12]
    shown = shown and abs(last[1]) > 1e-9 and last[1] == before[1] and abs(last[1] / last[2] - 1.0) < 1e-3
    shown = shown and abs(last[3]) < 1e-11 and abs(found[1e-3, solver, 1e-16][1]) < 1e-2 * abs(last[1])
print("the softness stops at mjMINVAL" if shown else "the softness has no such floor")
sys.exit(0 if shown else 1)
