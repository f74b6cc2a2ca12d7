"""DART: two rotors joined by the coupler of a MIMIC joint are no gear pair, and swing without end above ratio one.

Rotor 2 mimics rotor 1, q2 = m q1, with MimicConstraintType.Coupler; both have inertia 1, no forces act, the speeds
match at the start: (1, m). A gear pair goes on as it is. The coupler asks for v2 = (m q1 - q2) / h, the error of
position alone, without the speed m v1 of rotor 1, and weighs the impulse as if rotor 1 did not move: the first step
stops rotor 2 and hands its momentum to rotor 1, (1 + m^2, 0), and then the deviation is multiplied by -m^2 in each
step, however small. Second route: that recurrence by hand gives DART's speeds. Third: with the roles exchanged and
ratio 1 / m the same gear pair settles.
"""

import sys

import dartpy
import numpy as np

d, STEPS = dartpy.dynamics, 12


def run(m, speeds, h):
    """Speeds of both rotors after each step."""
    skeleton, joints = d.Skeleton("pair"), []
    for _ in range(2):
        joint, body = skeleton.createRevoluteJointAndBodyNodePair()
        joint.setAxis([0.0, 0.0, 1.0])
        body.setInertia(d.Inertia(1.0, np.zeros(3), np.eye(3)))
        joints.append(joint)
    mimic = d.MimicDofProperties()
    mimic.mReferenceJoint, mimic.mReferenceDofIndex, mimic.mMultiplier, mimic.mOffset = joints[0], 0, m, 0.0
    mimic.mConstraintType = d.MimicConstraintType.Coupler
    properties = joints[1].getRevoluteJointProperties()
    properties.mMimicDofProps = [mimic]
    properties.mActuatorType = d.ActuatorType.MIMIC
    joints[1].setProperties(properties)
    world = dartpy.simulation.World()
    world.addSkeleton(skeleton)
    world.setGravity(np.zeros(3))
    world.setTimeStep(h)
    skeleton.setVelocities(speeds)
    found = []
    for _ in range(STEPS):
        world.step()
        found.append(np.array(skeleton.getVelocities()))
    return np.array(found)


def by_hand(m, speeds, h):
    """The recurrence: rotor 2 takes the speed that removes the error of position, the impulse acts on both."""
    (v1, v2), q1, q2, found = speeds, 0.0, 0.0, []
    for _ in range(STEPS):
        wanted = (m * q1 - q2) / h
        v1, v2 = v1 - m * (wanted - v2), wanted
        q1, q2 = q1 + h * v1, q2 + h * v2
        found.append((v1, v2))
    return np.array(found)


print(f"dartpy {dartpy.__version__}: speeds of two equal rotors, expected (1, m) throughout")
last, apart = {}, []
for m in (0.5, 0.9, 1.1, 2.0):
    for h in (1e-3, 1e-5):
        found, recurrence = run(m, [1.0, m], h), by_hand(m, (1.0, m), h)
        apart.append(np.max(np.abs(found - recurrence)) / np.max(np.abs(recurrence)))
        last[m, h] = found[-1]
        print(f"m = {m}, step {h}: after 1, 2 and {STEPS} steps", *(np.round(found[n], 3) for n in (0, 1, -1)))
exchanged = run(0.5, [2.0, 1.0], 1e-3)[-1]
print(f"m = 2 with the roles exchanged: after {STEPS} steps {np.round(exchanged, 3)}, expected (2, 1)")
print(f"largest relative distance from the recurrence by hand: {max(apart):.0e}")
shown = max(apart) < 1e-6 and min(np.max(np.abs(last[2.0, h])) for h in (1e-3, 1e-5)) > 1e6
shown = shown and np.allclose(exchanged, [2.0, 1.0], atol=1e-3)
print("the coupler leaves out the speed of what it follows" if shown else "the coupler is a gear pair")
sys.exit(0 if shown else 1)
