"""MuJoCo: the force of an actuator on a site is counted as a force of the joint, in cfrc_int and in force sensors.

A body of 2 kg slides along x; an actuator on a site pushes it up with 5 N. Statics: the joint holds 19.62 - 5 N up.
Second route: the same 5 N by `xfrc_applied`, or by an actuator on a tendon, are counted rightly. The motion is not
affected.
"""

import sys

import mujoco
import numpy as np

BODY = """<worldbody><site name="o" pos="0 0 1"/><body><joint type="slide" axis="1 0 0"/>
<inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/><site name="s"/></body></worldbody>
<sensor><force site="s"/></sensor>"""
ON_SITE = '<actuator><general site="s" gear="0 0 1 0 0 0" biastype="affine" biasprm="5"/></actuator>'
ON_TENDON = """<tendon><spatial name="t"><site site="o"/><site site="s"/></spatial></tendon>
<actuator><general tendon="t" biastype="affine" biasprm="-5"/></actuator>"""


def held(more, push=0.0):
    """Force along z between the world and the body, by cfrc_int and by a sensor."""
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{BODY}{more}</mujoco>")
    data = mujoco.MjData(model)
    data.xfrc_applied[1, 2] = push
    mujoco.mj_forward(model, data)
    return np.array([data.cfrc_int[1, 5], data.sensordata[2]])


expected = 2.0 * 9.81 - 5.0
found = {"xfrc_applied": held("", 5.0), "actuator on a tendon": held(ON_TENDON), "actuator on a site": held(ON_SITE)}
print(f"mujoco {mujoco.__version__}: force of the joint on the body along z, expected {expected:.2f} N")
for name, (internal, sensor) in found.items():
    print(f"{name:21s} cfrc_int {internal:.2f}, force sensor {sensor:.2f}")
right = [np.max(np.abs(values - expected)) < 1e-9 for values in found.values()]
sys.exit(0 if right == [True, True, False] else 1)
