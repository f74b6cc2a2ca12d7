"""Code of exported scripts, which follows the constants of `export`."""

CODE = '''
exu.config.printToConsole = False
CONTAINER = exu.SystemContainer()
SYSTEM = CONTAINER.AddSystem()
SIZE = 7 * len(BODIES)
DATA = SYSTEM.systemData


def history(law):
    return lambda _, t, __: jet(law["f"], t)[0] * np.array(law["vector"])


def actuator(law):
    return lambda _, t, *__: -jet(law, t)[0]


def integrals():
    """Integrals of the controllers, which are rates of coordinates without mechanical meaning."""
    if not INTEGRALS:
        return []
    node = OBJECTS[INTEGRATOR[0]]["nodeNumbers"][0]
    return np.atleast_1d(SYSTEM.GetNodeOutput(node, exu.OutputVariableType.Coordinates_t))


def effort(law):
    """User function of a connector, whose force pulls the ends together; an effort acts on the successor."""

    def force(_, t, __, q, rate, *more):
        total = sum(jet(f, t)[0] for f in law["actuators"])
        total += sum(spring_damper_law(q - rest, rate, *both)[0] for rest, *both in law["springs"])
        total += sum(friction_law(rate, *friction)[0] for friction in law["frictions"])
        for c in law["controls"]:
            target, target_rate, _bend = jet(c["f"], t)
            total += c["P"] * (target - q) + c["D"] * (target_rate - rate)
            total += c["I"] * integrals()[c["place"]] if c["place"] >= 0 else 0.0
        return -total

    return force


def errors(_, t, *__):
    """Rates of the integrals."""
    kinds = exu.OutputVariableType
    measured = [
        float(SYSTEM.GetObjectOutput(i["connector"], kinds.Rotation if i["turns"] else kinds.DisplacementLocal))
        for i in INTEGRALS
    ]
    return np.array([jet(i["f"], t)[0] - value for i, value in zip(INTEGRALS, measured, strict=True)])


def functions_of(number):
    """User functions of an object."""
    if str(number) in CONNECTIONS:
        return connection(*CONNECTIONS[str(number)])
    if number in INTEGRATOR:
        return {"forceUserFunction": errors}
    if str(number) in ACTUATORS:
        return {"springForceUserFunction": actuator(ACTUATORS[str(number)])}
    if str(number) in EFFORTS:
        law = EFFORTS[str(number)]
        return {"springTorqueUserFunction" if law["angle"] else "springForceUserFunction": effort(law)}
    return {}


def build():
    """Add all items, each after the items to which it refers."""
    for node in NODES:
        SYSTEM.AddNode(node)
    for number, item in enumerate(OBJECTS):
        SYSTEM.AddObject(item | functions_of(number))
    for marker in MARKERS:
        SYSTEM.AddMarker(marker)
    for number, load in enumerate(LOADS):
        law = HISTORIES.get(str(number))
        SYSTEM.AddLoad(load | ({"loadVectorUserFunction": history(law)} if law else {}))
    SYSTEM.Assemble()
    for configuration in (exu.ConfigurationType.Initial, exu.ConfigurationType.Current):
        place(np.array(Q), np.array(V), configuration)
        if TURNS:
            DATA.SetDataCoordinates(TURNS, configuration=configuration)
    ANGLES.clear()


def place(q, v, configuration=exu.ConfigurationType.Current):
    DATA.SetODE2Coordinates(q, configuration=configuration)
    DATA.SetODE2Coordinates_t(v, configuration=configuration)


build()
SOLVER = exu.MainSolverImplicitSecondOrder()  # for a motion: `SYSTEM.SolveDynamic` with settings of your own
SOLVER.InitializeSolver(SYSTEM, simulation_settings(SETTINGS))
CONSTRAINTS = JOINTS + [disc["object"] for disc in DISCS] + [int(number) for number in CONNECTIONS]
ROWS = [row for number in CONSTRAINTS for row in DATA.GetObjectLTGAE(number)]
NATIVE = sum(len(DATA.GetObjectLTGAE(number)) for number in JOINTS)
LENGTHS = np.zeros(SOLVER.GetAEsize())
for number, length in RODS:
    LENGTHS[DATA.GetObjectLTGAE(number)] = length


def algebraic(velocity_level):
    SOLVER.ComputeAlgebraicEquations(SYSTEM, velocityLevel=velocity_level)
    return np.array(SOLVER.GetSystemResidual())[len(Q) :]


def body_state(b):
    """Rotation, ``G`` of ``w' = 2 G dp/dt`` and angular velocity in the world, of a body."""
    w, x, y, z = QUATERNIONS[b]  # all digits: in Q the first parameter is stored less one
    R = rotation(QUATERNIONS[b])
    G = np.array([[-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]])
    return R, G, R @ (2.0 * G @ np.array(V[7 * b + 3 : 7 * b + 7]))


def velocity_map():
    """T of ``q' = T (v, w)``, world axes."""
    T = np.zeros((SIZE, 6 * len(BODIES)))
    for b in range(len(BODIES)):
        R, G, _ = body_state(b)
        T[7 * b : 7 * b + 3, 6 * b : 6 * b + 3] = np.eye(3)
        T[7 * b + 3 : 7 * b + 7, 6 * b + 3 : 6 * b + 6] = 0.5 * G.T @ R.T
    return T


def look():
    """Set the places of the bodies for `held` to the initial state."""
    ANGLES.clear()
    for b, body in enumerate(BODIES):
        R, _, w = body_state(b)
        PLACES[body] = np.array(Q[7 * b : 7 * b + 3]), R, np.array(V[7 * b : 7 * b + 3]), w


def contact(disc):
    """Right-hand side of the acceleration of the point of contact, less the terms of the body's velocities."""
    R, _, w = body_state(disc["body"])
    rho, rho_dot = rolling_contact(R @ disc["axis"], np.array(disc["normal"]), w, disc["radius"], 0.0)
    return np.cross(w, np.cross(w, rho) - rho_dot) - np.cross(w, np.cross(w, R @ disc["center"] + rho))


def accelerations():
    """Acceleration of the origin and angular acceleration of each body, world axes."""
    q, v, T = np.array(Q), np.array(V), velocity_map()
    c = convective_terms(q, v, LENGTHS, LENGTH, place, algebraic)[ROWS]
    place(q, v)
    ANGLES.clear()  # the stencil has counted turns of distant states
    SOLVER.ComputeMassMatrix(SYSTEM)
    M = np.array(SOLVER.GetSystemMassMatrix())[:SIZE, :SIZE]
    # the first call sets the whole matrix to zero, the second adds the rows
    SOLVER.ComputeJacobianODE2RHS(SYSTEM, scalarFactor_ODE2=0.0, scalarFactor_ODE2_t=0.0, scalarFactor_ODE1=0.0)
    SOLVER.ComputeJacobianAE(
        SYSTEM, scalarFactor_ODE2=1.0, scalarFactor_ODE2_t=1.0, scalarFactor_ODE1=1.0, velocityLevel=False
    )
    J = np.array(SOLVER.GetSystemJacobian())[len(Q) :, :SIZE][ROWS] @ T
    gamma = -c
    for n, disc in enumerate(DISCS):
        rows, first = slice(NATIVE + 3 * n, NATIVE + 3 * n + 3), 6 * disc["body"]
        gamma[rows] = J[rows, first : first + 3] @ contact(disc)
    look()
    gamma[NATIVE + 3 * len(DISCS) :] = held(0.0)[1]
    SOLVER.ComputeODE2RHS(SYSTEM)
    f = np.array(SOLVER.GetSystemResidual())[:SIZE]
    a, _ = solve_constrained(T.T @ M @ T, T.T @ f, J, gamma)
    pairs = zip(BODIES, a.reshape(-1, 6), strict=True)
    return {body: {"a": row[:3].tolist(), "alpha": row[3:].tolist()} for body, row in pairs}


if __name__ == "__main__":
    print(json.dumps(accelerations(), indent=1))
'''
