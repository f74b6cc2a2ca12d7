"""Code of exported scripts, which follows the constants of `export`."""

CODE = '''
SKELETON, NODES = dartpy.dynamics.Skeleton("exported"), {"": None}
SKELETON.setGravity(np.array(GRAVITY))
SKELETON.setTimeStep(0.0)  # joint springs act at the present state; World sets its own step


def isometry(p, R):
    transform = dartpy.math.Isometry3()
    transform.set_rotation(np.array(R))
    transform.set_translation(np.array(p))
    return transform


def build():
    """Add all links; DART warns of massless links."""
    for name, parent, creator, has_axis, pitch, p, R, mass, com, inertia in LINKS:
        joint, node = getattr(SKELETON, creator)(NODES[parent])
        node.setName(name)
        joint.setName(f"to {name}")
        node.setInertia(dartpy.dynamics.Inertia(mass, np.array(com), np.array(inertia)))
        if has_axis:
            joint.setAxis(np.array([0.0, 0.0, 1.0]))
        if pitch:
            joint.setPitch(pitch)
        joint.setTransformFromParentBodyNode(isometry(p, R))
        NODES[name] = node
    for name, stiffness, damping, rest in JOINT_SPRINGS:
        joint = NODES[name].getParentJoint()
        joint.setSpringStiffness(0, stiffness)
        joint.setDampingCoefficient(0, damping)
        joint.setRestPosition(0, rest)


build()
COUNT = SKELETON.getNumDofs()


def pose(owner):
    if not owner:
        return np.zeros(3), np.eye(3)
    T = NODES[owner].getWorldTransform()
    return T.translation(), T.rotation()


def jacobian(owner, p):
    if not owner:
        return np.zeros((6, COUNT))
    node = NODES[owner]
    return np.vstack([SKELETON.getLinearJacobian(node, p), SKELETON.getAngularJacobian(node)])


def motion(owner, p):
    node = NODES[owner]
    return np.concatenate([node.getLinearVelocity(p), node.getAngularVelocity()]) if owner else np.zeros(6)


def drift(owner, p):
    """Present accelerations of the skeleton; those of its coordinates are set to zero before."""
    node = NODES[owner]
    return np.concatenate([node.getLinearAcceleration(p), node.getAngularAcceleration()]) if owner else np.zeros(6)


def coordinate(owner, sign):
    joint = NODES[owner].getParentJoint()
    row = np.zeros(COUNT)
    row[joint.getIndexInSkeleton(0)] = sign
    return sign * joint.getPosition(0), sign * joint.getVelocity(0), row, 0.0
'''

RUN = '''
def start():
    """Put the skeleton into the initial state."""
    SKELETON.setPositions(np.array(POSITIONS))
    SKELETON.setVelocities(np.array(VELOCITIES))


def joint_accelerations(t=0.0, integrals=(0.0,) * len(CONTROLS)):
    """Accelerations at the present state of the skeleton: of a tree by DART, else solved from DART's terms."""
    SKELETON.setAccelerations(np.zeros(COUNT))
    tau = applied(t, integrals)
    J, gamma = held(t)
    if len(J):
        SKELETON.computeInverseDynamics(True, True, True)
        a, _ = solve_constrained(SKELETON.getMassMatrix(), tau - SKELETON.getForces(), J, gamma)
        SKELETON.setAccelerations(a)
        return a
    SKELETON.setForces(tau)
    SKELETON.computeForwardDynamics()
    return SKELETON.getAccelerations()


def accelerations():
    """Acceleration of the origin and angular acceleration of each body, world axes."""
    joint_accelerations()
    both = {body: drift(owner, np.array(p)).tolist() for body, (owner, p, _) in BODIES.items()}
    return {body: {"a": found[:3], "alpha": found[3:]} for body, found in both.items()}


if __name__ == "__main__":
    start()
    print(json.dumps(accelerations(), indent=1))
'''
