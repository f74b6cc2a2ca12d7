"""Code of exported scripts, which follows the constants of `export`."""

LOAD = """
MODEL = pin.buildModelFromUrdf(str(Path(__file__).with_name("model.urdf")))
MODEL.gravity = pin.Motion(np.array(GRAVITY), np.zeros(3))  # URDF has no gravity
for name, (p, R) in PLACEMENTS.items():  # URDF has angles, which lose the last digit
    MODEL.jointPlacements[MODEL.getJointId(name)] = pin.SE3(np.array(R), np.array(p))
"""

BUILD = '''
def build():
    """Build the model joint by joint, because URDF has no balls, screws or loops."""
    model = pin.Model()
    model.gravity = pin.Motion(np.array(GRAVITY), np.zeros(3))
    for name, carrier, kind, pitch, p, R in JOINTS:
        joint = getattr(pin, kind)(pitch) if pitch else getattr(pin, kind)()
        model.addJoint(model.getJointId(carrier), joint, pin.SE3(np.array(R), np.array(p)), name)
    for carrier, p, R, mass, com, inertia in MASSES:
        share = pin.Inertia(mass, np.array(com), np.array(inertia))
        model.appendBodyToJoint(model.getJointId(carrier), share, pin.SE3(np.array(R), np.array(p)))
    return model


MODEL = build()
'''

CODE = '''
DATA = MODEL.createData()
WORLD = pin.LOCAL_WORLD_ALIGNED
COUNT = MODEL.nv


def start():
    """Configuration and velocity of the initial state."""
    q, v = np.zeros(MODEL.nq), np.zeros(MODEL.nv)
    for name, (q_joint, v_joint) in START.items():
        j = MODEL.getJointId(name)
        q[MODEL.idx_qs[j] : MODEL.idx_qs[j] + MODEL.nqs[j]] = q_joint
        v[MODEL.idx_vs[j] : MODEL.idx_vs[j] + MODEL.nvs[j]] = v_joint
    return q, v


def frame(owner, p):
    """Joint, and a frame at a point of its moving frame."""
    return MODEL.getJointId(owner), pin.SE3(np.eye(3), p)


def pose(owner):
    placement = DATA.oMi[MODEL.getJointId(owner)]
    return placement.translation, placement.rotation


def jacobian(owner, p):
    place = frame(owner, p)
    return pin.getFrameJacobian(MODEL, DATA, *place, WORLD) if place[0] else np.zeros((6, COUNT))


def motion(owner, p):
    return pin.getFrameVelocity(MODEL, DATA, *frame(owner, p), WORLD).vector


def drift(owner, p):
    return pin.getFrameClassicalAcceleration(MODEL, DATA, *frame(owner, p), WORLD).vector


def coordinate(owner, sign):
    j = MODEL.getJointId(owner)
    k, row = MODEL.idx_vs[j], np.zeros(COUNT)
    row[k] = sign
    return sign * NOW[0][MODEL.idx_qs[j]], sign * NOW[1][k], row, 0.0


NOW = start()
'''

RUN = '''
def contacts():
    """Closed loops and drives as constraints of Pinocchio's."""
    models, contacts_data, kind, local = [], pin.StdVec_RigidConstraintData(), pin.ContactType.CONTACT_6D, pin.LOCAL
    for pair in WELDS:
        ends = [x for owner, p, R in pair for x in (MODEL.getJointId(owner), pin.SE3(np.array(R), np.array(p)))]
        models.append(pin.RigidConstraintModel(kind, MODEL, *ends, local))
    for (owner, _), _ in DRIVES:
        j = MODEL.getJointId(owner)
        ends = j, pin.SE3.Identity(), MODEL.parents[j], MODEL.jointPlacements[j]
        models.append(pin.RigidConstraintModel(kind, MODEL, *ends, local))
    found = pin.StdVec_RigidConstraintModel()
    for model in models:
        found.append(model)
        contacts_data.append(model.createData())
    pin.initConstraintDynamics(MODEL, DATA, found, contacts_data)
    return found, contacts_data


CONTACTS = contacts()
OWN_ROWS = bool(COUPLINGS or ROLLINGS or SKATES)


def with_contacts(q, v, t, tau):
    """Accelerations by `pin.constraintDynamics`; driven joints get their accelerations relative to their carriers."""
    for n, ((owner, sign), law) in enumerate(DRIVES, len(WELDS)):
        S = np.array(DATA.joints[MODEL.getJointId(owner)].S).ravel()
        CONTACTS[1][n].contact_acceleration_desired = pin.Motion(sign * jet(law, t)[2] * S)
    settings = pin.ProximalSettings(1e-14, 1e-8, 20)
    return np.array(pin.constraintDynamics(MODEL, DATA, q, v, tau, *CONTACTS, settings))


def with_rows(q, v, tau, J, gamma):
    """Accelerations by `pin.forwardDynamics`, whose mu regularises dependent rows.

    Repetition with the last multipliers on the right-hand side removes the error of mu.
    """
    pin.computeAllTerms(MODEL, DATA, q, v)
    mu, multipliers = 1e-8, np.zeros(len(gamma))
    for _ in range(20):
        a = np.array(pin.forwardDynamics(MODEL, DATA, tau, J, -gamma - mu * multipliers, mu))
        change = mu * np.max(np.abs(DATA.lambda_c - multipliers))
        multipliers = np.array(DATA.lambda_c)
        if change < 1e-14:
            break
    return a


def joint_accelerations(q, v, t=0.0, integrals=(0.0,) * len(CONTROLS)):
    """Joint accelerations: of a tree by `pin.aba`, else with Pinocchio's constraints, or with rows of the script."""
    NOW[0][:], NOW[1][:] = q, v
    pin.forwardKinematics(MODEL, DATA, q, v, np.zeros(COUNT))
    pin.computeJointJacobians(MODEL, DATA, q)
    tau = applied(t, integrals)
    if OWN_ROWS:
        return with_rows(q, v, tau, *held(t))
    return with_contacts(q, v, t, tau) if WELDS or DRIVES else pin.aba(MODEL, DATA, q, v, tau)


def accelerations(q, v):
    """Acceleration of the origin and angular acceleration of each body, world axes."""
    pin.forwardKinematics(MODEL, DATA, q, v, joint_accelerations(q, v))
    both = {body: drift(owner, np.array(p)).tolist() for body, (owner, p, _) in BODIES.items()}
    return {body: {"a": found[:3], "alpha": found[3:]} for body, found in both.items()}


if __name__ == "__main__":
    print(json.dumps(accelerations(*start()), indent=1))
'''
