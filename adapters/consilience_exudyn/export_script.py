"""Code of exported scripts; the constants before it are those of `export`."""

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
    """Integrals of the controllers: rates of coordinates without mechanical meaning."""
    if not INTEGRALS:
        return []
    node = OBJECTS[INTEGRATOR[0]]["nodeNumbers"][0]
    return np.atleast_1d(SYSTEM.GetNodeOutput(node, exu.OutputVariableType.Coordinates_t))


def effort(law):
    """Exudyn's force pulls the ends together; an effort acts on the successor."""

    def force(_, t, __, q, rate, *more):
        total = sum(jet(f, t)[0] for f in law["actuators"])
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
    """Add all items, in the order in which they refer to one another."""
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


def settings():
    """Settings for terms at a state; go on with `exu.SimulationSettings` of your own and `SYSTEM.SolveDynamic`."""
    found = exu.SimulationSettings()
    for name, value in SETTINGS.items():
        *groups, knob = name.split(".")
        setattr(reduce(getattr, groups, found), knob, value)
    return found


build()
SOLVER = exu.MainSolverImplicitSecondOrder()
SOLVER.InitializeSolver(SYSTEM, settings())
CONSTRAINTS = JOINTS + [disc["object"] for disc in DISCS] + [int(number) for number in CONNECTIONS]
ROWS = [row for number in CONSTRAINTS for row in DATA.GetObjectLTGAE(number)]
NATIVE = sum(len(DATA.GetObjectLTGAE(number)) for number in JOINTS)
LENGTHS = np.zeros(SOLVER.GetAEsize())
for number, length in RODS:
    LENGTHS[DATA.GetObjectLTGAE(number)] = length


def algebraic(velocity_level):
    SOLVER.ComputeAlgebraicEquations(SYSTEM, velocityLevel=velocity_level)
    return np.array(SOLVER.GetSystemResidual())[len(Q) :]


def convective():
    """``c = d/ds C'(q + s v, v)`` by a central stencil that is exact for polynomials of degree four.

    In Euler parameters the constraints of joints are such; that of a rod is one times its length.
    """
    q, v = np.array(Q), np.array(V)
    step = 0.25 / max(1.0, np.max(np.abs(v)))
    rod, total = LENGTHS > 0.0, np.zeros(len(LENGTHS))
    for point, weight in ((-2.0, 1.0), (-1.0, -8.0), (1.0, 8.0), (2.0, -1.0)):
        place(q + point * step * v, v)
        distance = np.where(rod, LENGTHS + algebraic(False), 1.0)
        total += weight * distance * algebraic(True)
    place(q, v)
    return (total / (12.0 * step) / np.where(rod, LENGTHS, 1.0))[ROWS]


def body_state(b):
    """Rotation, ``G`` of ``w' = 2 G dp/dt`` and angular velocity in the world, of a body."""
    w, x, y, z = QUATERNIONS[b]  # Q lacks a bit or two of them: it has them less one
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
    """Let `held` see the bodies where the script starts."""
    ANGLES.clear()
    for b, body in enumerate(BODIES):
        R, _, w = body_state(b)
        PLACES[body] = np.array(Q[7 * b : 7 * b + 3]), R, np.array(V[7 * b : 7 * b + 3]), w


def contact(disc):
    """Acceleration that the accelerations of the body's origin and of its angle must make up for at the contact."""
    R, _, w = body_state(disc["body"])
    rho, rho_dot = rolling_contact(R @ disc["axis"], np.array(disc["normal"]), w, disc["radius"], 0.0)
    return np.cross(w, np.cross(w, rho) - rho_dot) - np.cross(w, np.cross(w, R @ disc["center"] + rho))


def accelerations():
    """Acceleration of the origin and angular acceleration of each body, world axes."""
    c, T = convective(), velocity_map()
    ANGLES.clear()  # the stencil went far
    SOLVER.ComputeMassMatrix(SYSTEM)
    M = np.array(SOLVER.GetSystemMassMatrix())[:SIZE, :SIZE]
    # the first call sets the whole matrix to zero, the second adds to it
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
    a = solve(T.T @ M @ T, T.T @ f, J, gamma).reshape(-1, 6)
    return {body: {"a": row[:3].tolist(), "alpha": row[3:].tolist()} for body, row in zip(BODIES, a, strict=True)}


if __name__ == "__main__":
    print(json.dumps(accelerations(), indent=1))
'''
