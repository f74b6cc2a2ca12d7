"""DART and Pinocchio: the articulated-body algorithm loses digits as the square of a mass ratio.

Three bodies in a chain of ball joints, the last one of mass and inertia r. Expected: M a = f by each engine's own mass
matrix and bias, which lose r times the rounding unit, and which agree between the engines. Observed: both engines'
articulated-body algorithms lose about r^2 times the rounding unit. So it is the algorithm, not one of the codes; a
chain of hinges does not show it.
"""

import sys

import dartpy as dart
import numpy as np
import pinocchio as pin

KINDS = {
    "S": ("createBallJointAndBodyNodePair", pin.JointModelSpherical, 3),
    "R": ("createRevoluteJointAndBodyNodePair", pin.JointModelRZ, 1),
}
GRAVITY = np.array([1.0, -7.0, 5.0])


def chain(kinds, ratio, seed):
    """The same chain in DART, with its state set, and in Pinocchio, with its coordinates and velocities."""
    rng = np.random.default_rng(seed)
    skeleton, model = dart.dynamics.Skeleton(), pin.Model()
    skeleton.setGravity(GRAVITY)
    model.gravity = pin.Motion(GRAVITY, np.zeros(3))
    node, joint, angles, q, v = None, 0, [], [], []
    for i, kind in enumerate(kinds):
        create, joint_model, freedom = KINDS[kind]
        mass = ratio if i == len(kinds) - 1 else 1.0
        A, com = rng.normal(size=(3, 3)), rng.uniform(-0.3, 0.3, 3)
        inertia = mass * (0.05 * A @ A.T + 0.1 * np.eye(3))
        place, turn = rng.uniform(-0.5, 0.5, 3), pin.exp3(rng.uniform(-2.0, 2.0, 3))
        dart_joint, node = getattr(skeleton, create)(node)
        node.setInertia(dart.dynamics.Inertia(mass, com, inertia))
        frame = dart.math.Isometry3()
        frame.set_rotation(turn)
        frame.set_translation(place)
        dart_joint.setTransformFromParentBodyNode(frame)
        if kind == "R":
            dart_joint.setAxis([0.0, 0.0, 1.0])
        joint = model.addJoint(joint, joint_model(), pin.SE3(turn, place), str(i))
        model.appendBodyToJoint(joint, pin.Inertia(mass, com, inertia), pin.SE3.Identity())
        phi = rng.uniform(-1.0, 1.0, freedom)
        angles, v = [*angles, *phi], [*v, *rng.uniform(-1.0, 1.0, freedom)]
        q += list(pin.Quaternion(pin.exp3(phi)).coeffs()) if kind == "S" else list(phi)
    skeleton.setPositions(angles)
    skeleton.setVelocities(v)
    return skeleton, model, np.array(q), np.array(v)


def differences(kinds, ratio, seed):
    """Relative to Pinocchio's M a = f: DART's M a = f, DART's and Pinocchio's articulated bodies."""
    skeleton, model, q, v = chain(kinds, ratio, seed)
    data, zero = model.createData(), np.zeros(model.nv)
    M, b = pin.crba(model, data, q).copy(), pin.nle(model, data, q, v).copy()
    truth = np.linalg.solve(M, -b)
    skeleton.computeForwardDynamics()
    articulated = np.array(skeleton.getAccelerations())
    matrix = np.linalg.solve(skeleton.getMassMatrix(), -skeleton.getCoriolisAndGravityForces())
    by_pin = pin.aba(model, data, q, v, zero)
    return [np.max(np.abs(a - truth)) / np.max(np.abs(truth)) for a in (matrix, articulated, by_pin)]


print(
    f"dartpy {dart.__version__}, pin {pin.__version__}: worst relative difference from Pinocchio's M a = f, 10 chains"
)
print("joints   ratio    DART M a = f   DART articulated   Pinocchio aba")
worst = {}
for kinds in ("SSS", "RRR"):
    for ratio in (1.0, 1e2, 1e4, 1e6):
        worst[kinds, ratio] = np.max([differences(kinds, ratio, seed) for seed in range(10)], axis=0)
        matrix, by_dart, by_pin = worst[kinds, ratio]
        print(f"{kinds:6s}   {ratio:5.0e}      {matrix:7.1e}          {by_dart:7.1e}           {by_pin:7.1e}")
balls, hinges = worst["SSS", 1e6], worst["RRR", 1e6]
shown = balls[0] < 1e-7 and min(balls[1:]) > 1e-6 and min(balls[1:]) > 100.0 * balls[0] and max(hinges) < 1e-9
print("both lose more than their mass matrices" if shown else "no such loss")
sys.exit(0 if shown else 1)
