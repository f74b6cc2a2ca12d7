"""Code of the script beside an exported MJCF file; the constants before it are those of `export`."""

CODE = '''
MODEL = mujoco.MjModel.from_xml_path(str(Path(__file__).with_name("model.xml")))
for name, factor in FACTORS.items():  # how soft constraints are: no attribute of MJCF goes so far
    getattr(MODEL, name)[:] *= factor


def control_of(signal, t, length, rate):
    """Control of an actuator."""
    if signal["kind"] == "coulomb":
        return friction_law(rate, 0.0, signal["force"], signal["speed"])[0]
    value, slope, _ = jet(signal["f"], t)
    if signal["kind"] == "servo":
        return signal["P"] * value + signal["D"] * slope
    return value - length if signal["kind"] == "error" else value


def rows_of(data, names):
    """Rows of equalities of one row each."""
    ids = data.efc_id[: data.nefc]
    return np.searchsorted(ids, [MODEL.equality(name).id for name in names])


def jacobian(data):
    """Jacobian of the constraints, which may be written to."""
    return data.efc_J[: data.nefc * MODEL.nv].reshape(-1, MODEL.nv)


def set_right_hand_side(data, rows, residual, rate, gamma):
    """What J a is to be."""
    K, B, d, _ = data.efc_KBIP[rows].T
    data.efc_aref[rows] = gamma - B * rate - K * d * residual


def hold(data, row):
    """Write a row ``q = sign f(x)``, x the time or the coordinate of another joint."""
    name, sign = row["held"]
    joint = MODEL.joint(name)
    x, x_dot, turn, dof = data.time, 1.0, 0.0, None
    if row["driver"] is not None:
        driver, turn = row["driver"]
        dof = MODEL.joint(driver).dofadr[0]
        x, x_dot = turn * data.qpos[MODEL.joint(driver).qposadr[0]], turn * data.qvel[dof]
    f, slope, bend = jet(row["f"], x)
    residual = data.qpos[joint.qposadr[0]] - sign * f
    if row["angle"]:
        residual -= 2.0 * math.pi * round(residual / (2.0 * math.pi))
    rate = data.qvel[joint.dofadr[0]] - sign * slope * x_dot
    at = rows_of(data, [row["equality"]])
    set_right_hand_side(data, at, residual, rate, sign * bend * x_dot**2)
    if row["written"]:
        jacobian(data)[at, dof] = -sign * turn * slope


def contact_of(guide, p, R, v, w):
    """Arm of the point held, directions, violations, accelerations of the point along them."""
    if "lateral" in guide:
        arm, lateral = R @ guide["point"], R @ guide["lateral"]
        return arm, lateral[None], np.zeros(1), np.array([-np.cross(w, lateral) @ (v + np.cross(w, arm))])
    n = np.array(guide["normal"])
    rho, rho_dot = rolling_contact(R @ guide["axis"], n, w, guide["radius"], guide["rounding"])
    arm, plane = R @ guide["center"] + rho, axes_of_plane(n)
    height = n @ (p + arm - guide["point"])
    return arm, plane, np.array([height, 0.0, 0.0]), plane @ np.cross(w, np.cross(w, rho) - rho_dot)


def guide_body(data, guide):
    """Write the rows of a body that rolls or skates."""
    site = MODEL.site(guide["site"]).id
    body, twist, J = MODEL.site_bodyid[site], np.zeros(6), np.zeros((3, MODEL.nv))
    mujoco.mj_objectVelocity(MODEL, data, mujoco.mjtObj.mjOBJ_SITE, site, twist, 0)
    p, R, w, v = data.site_xpos[site], data.site_xmat[site].reshape(3, 3), twist[:3], twist[3:]
    arm, directions, residual, gamma = contact_of(guide, p, R, v, w)
    mujoco.mj_jac(MODEL, data, J, None, p + arm, body)
    dofs = np.flatnonzero([MODEL.dof_bodyid[i] in carriers(body) for i in range(MODEL.nv)])
    angular, linear = (data.cdof_dot[dofs].T @ data.qvel[dofs]).reshape(2, 3)
    spin, speed = data.cvel[body].reshape(2, 3)
    lever = p + arm - data.subtree_com[MODEL.body_rootid[body]]
    bias = linear + np.cross(angular, lever) + np.cross(spin, speed + np.cross(spin, lever))
    at = rows_of(data, guide["equalities"])
    jacobian(data)[at] = directions @ J
    set_right_hand_side(data, at, residual, directions @ J @ data.qvel, gamma - directions @ bias)


def carriers(body):
    """A body and all that carry it."""
    found = [body]
    while found[-1]:
        found.append(MODEL.body_parentid[found[-1]])
    return found


def answer(_, data):
    """What MuJoCo asks for at every stage of a step."""
    for signal in SIGNALS:
        n = MODEL.actuator(signal["actuator"]).id
        data.ctrl[n] = control_of(signal, data.time, data.actuator_length[n], data.actuator_velocity[n])
    for row in ROWS:
        hold(data, row)
    for guide in GUIDES:
        guide_body(data, guide)


if SIGNALS or ROWS or GUIDES:
    mujoco.set_mjcb_control(answer)


def start():
    """Data in the initial state; go on with `mujoco.mj_step(MODEL, data)`."""
    data = mujoco.MjData(MODEL)
    mujoco.mj_resetDataKeyframe(MODEL, data, MODEL.key("initial").id)
    return data


def accelerations(data):
    """Acceleration of the origin and angular acceleration of each body, world axes."""
    mujoco.mj_forward(MODEL, data)
    mujoco.mj_rnePostConstraint(MODEL, data)
    found = {}
    for body, site in BODIES.items():
        both = np.zeros(6)
        mujoco.mj_objectAcceleration(MODEL, data, mujoco.mjtObj.mjOBJ_SITE, MODEL.site(site).id, both, 0)
        found[body] = {"a": (both[3:] + MODEL.opt.gravity).tolist(), "alpha": both[:3].tolist()}
    return found


if __name__ == "__main__":
    print(json.dumps(accelerations(start()), indent=1))
'''
