"""Code of exported scripts: constraints that are user functions, beside `consilience.engine.native.ROWS`.

The functions give values and Jacobians to Exudyn's integrators, and right-hand sides for accelerations at a state.
"""

CONNECTIONS = '''
PLACES = {GROUND: (np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3))}  # origin, axes, velocity, angular velocity
ANGLES = {}  # last angles of joints, from which full turns are counted
COUNT = 6 * len(BODIES)


def pose(owner):
    return PLACES[owner][:2]


def jacobian(owner, p):
    J = np.zeros((6, COUNT))
    if owner != GROUND:
        at = 6 * list(BODIES).index(owner)
        J[:, at : at + 6] = np.eye(6)
        J[:3, at + 3 : at + 6] = np.cross(np.eye(3), pose(owner)[1] @ p).T
    return J


def motion(owner, p):
    _, R, v, w = PLACES[owner]
    return np.concatenate([v + np.cross(w, R @ p), w])


def drift(owner, p):
    _, R, _, w = PLACES[owner]
    return np.concatenate([np.cross(w, np.cross(w, R @ p)), np.zeros(3)])


def coordinate(joint, kind):
    """Distance along, or angle about, z of the frame on the predecessor; turns of a screw are those of its distance."""
    (i, p, R_i), (j, r, R_j), pitch = FRAMES[joint]
    p, r, U = np.array(p), np.array(r), pose(i)[1] @ R_i
    here, there, relative = jacobian(i, p), jacobian(j, r), motion(j, r) - motion(i, p)
    d = pose(j)[0] + pose(j)[1] @ r - pose(i)[0] - pose(i)[1] @ p
    u, w = U[:, 2], motion(i, p)[3:]
    u_dot = np.cross(w, u)
    if kind == "distance":
        row = u @ (there - here)[:3] + np.cross(u, d) @ here[3:]
        bend = u @ (drift(j, r) - drift(i, p))[:3] + 2.0 * u_dot @ relative[:3] + np.cross(w, u_dot) @ d
        return u @ d, u @ relative[:3] + u_dot @ d, row, bend
    turn, x = 2.0 * math.pi, U.T @ pose(j)[1] @ np.array(R_j)[:, 0]
    near, angle = turn * (u @ d) / pitch if pitch else ANGLES.get(joint, 0.0), math.atan2(x[1], x[0])
    ANGLES[joint] = angle + turn * round((near - angle) / turn)
    return ANGLES[joint], u @ relative[3:], u @ (there - here)[3:], u_dot @ relative[3:]


def gap(place, wanted):
    """Difference of a coordinate from its wanted value, for an angle within half a turn."""
    found = coordinate(*place)[0] - wanted
    return math.remainder(found, 2.0 * math.pi) if place[1] == "angle" else found


def height(r):
    """Height of the point of contact over the plane."""
    (p, R), n = pose(r["body"]), np.array(r["normal"])
    rho, _ = rolling_contact(R @ r["axis"], n, np.zeros(3), r["radius"], r["rounding"])
    return n @ (p + R @ r["center"] + rho - r["point"])


EQUATIONS = {  # of row n of a kind at a time: coefficients; values, None for rows of velocities; rates
    "drive": (
        lambda n, t: drive_row(t, *DRIVES[n])[0],
        lambda n, t: [gap(DRIVES[n][0], jet(DRIVES[n][1], t)[0])],
        lambda n, t: [jet(DRIVES[n][1], t)[1]],
    ),
    "coupling": (
        lambda n, _: coupling_row(*COUPLINGS[n])[0],
        lambda n, _: [gap(COUPLINGS[n][0], jet(COUPLINGS[n][2], coordinate(*COUPLINGS[n][1])[0])[0])],
        lambda *_: [0.0],
    ),
    "contact": (lambda n, _: rolling_rows(ROLLINGS[n])[0][:1], lambda n, _: [height(ROLLINGS[n])], lambda *_: [0.0]),
    "slip": (lambda n, _: rolling_rows(ROLLINGS[n])[0][1:], None, lambda *_: [0.0, 0.0]),
    "skate": (lambda n, _: skate_rows(SKATES[n])[0], None, lambda *_: [0.0]),
}


def connection(kind, n, bodies):
    """User functions of a constraint, of positions and Euler parameters of its bodies."""
    coefficients, values, rates = EQUATIONS[kind]

    def look(q):
        for k, body in enumerate(bodies):
            p, e = np.array(q[7 * k : 7 * k + 3]), q[7 * k + 3 : 7 * k + 7]
            PLACES[body] = p, rotation(e), np.zeros(3), np.zeros(3)

    def slopes(_, t, __, q, *more):
        look(q)
        J, found = coefficients(n, t), []
        for k, body in enumerate(bodies):
            at, e = 6 * list(BODIES).index(body), q[7 * k + 3 : 7 * k + 7]
            found += [J[:, at : at + 3], J[:, at + 3 : at + 6] @ rate_map(e)]
        return np.hstack(found)

    def residual(system, t, item, q, q_t, velocity_level):
        if velocity_level:
            return slopes(system, t, item, q) @ np.array(q_t) - np.array(rates(n, t))
        look(q)
        return np.array(values(n, t))

    return {"constraintUserFunction": residual, "jacobianUserFunction": slopes}
'''
