"""MuJoCo: a body built through MjSpec loses the orientation of its inertia when `ipos` is not given.

The same body from MJCF text keeps it. `explicitinertial` is set in both.
"""

import sys

import mujoco
import numpy as np

quat = np.array([0.5, 0.5, -0.1, 0.7])
quat /= np.linalg.norm(quat)

spec = mujoco.MjSpec()
spec.worldbody.add_body(name="b", mass=1, inertia=[1, 2, 2.5], iquat=quat, explicitinertial=True).add_freejoint()
without = spec.compile().body_iquat[1]

spec = mujoco.MjSpec()
body = spec.worldbody.add_body(name="b", mass=1, inertia=[1, 2, 2.5], ipos=[0, 0, 0], iquat=quat, explicitinertial=True)
body.add_freejoint()
given = spec.compile().body_iquat[1]

text = f"""<mujoco><worldbody><body name="b"><freejoint/>
<inertial pos="0 0 0" quat="{" ".join(map(str, quat))}" mass="1" diaginertia="1 2 2.5"/></body></worldbody></mujoco>"""
mjcf = mujoco.MjModel.from_xml_string(text).body_iquat[1]

print(f"mujoco {mujoco.__version__}")
for name, found in (("asked", quat), ("MJCF", mjcf), ("MjSpec, ipos given", given), ("MjSpec, ipos left out", without)):
    print(f"{name:22s}", np.round(found, 6))
dropped = np.max(np.abs(without - quat)) > 1e-6
print("dropped without a word" if dropped else "kept")
sys.exit(0 if dropped else 1)
