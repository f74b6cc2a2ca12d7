"""Code of the script beside an exported MJCF file, which follows the constants of `export`."""

CODE = '''
MODEL = mujoco.MjModel.from_xml_path(str(Path(__file__).with_name("model.xml")))
for name, factor in FACTORS.items():  # softness of constraints, for which MJCF has no attribute
    getattr(MODEL, name)[:] *= factor
# MuJoCo's compiler takes frames for equal that differ by less than 1e-6
MODEL.body_sameframe[:] = MODEL.site_sameframe[:] = 0


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
    """View of the Jacobian of the constraints."""
    return data.efc_J[: data.nefc * MODEL.nv].reshape(-1, MODEL.nv)


def set_right_hand_side(data, rows, residual, rate, gamma):
    """Write the right-hand sides of rows from their residuals, rates and gamma."""
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


def plane_axes(rolling):
    return axes_of_plane(rolling.normal)


def guide_body(data, guide):
    """Write the rows of a body that rolls or skates."""
    site = MODEL.site(guide["site"]).id
    body, twist, J = int(MODEL.site_bodyid[site]), np.zeros(6), np.zeros((3, MODEL.nv))
    mujoco.mj_objectVelocity(MODEL, data, mujoco.mjtObj.mjOBJ_SITE, site, twist, 0)
    p, R = data.site_xpos[site], data.site_xmat[site].reshape(3, 3)
    element = SimpleNamespace(**{name: np.array(value) for name, value in guide["element"].items()})
    hold = hold_skate if "lateral" in guide["element"] else hold_rolling
    arm, directions, residual, gamma = hold(element, p, R, twist[3:], twist[:3])
    mujoco.mj_jac(MODEL, data, J, None, p + arm, body)
    bias = velocity_term(MODEL, data, body, moving_dofs(MODEL, body), p + arm)
    at = rows_of(data, guide["equalities"])
    jacobian(data)[at] = directions @ J
    set_right_hand_side(data, at, residual, directions @ J @ data.qvel, gamma - directions @ bias)


def answer(_, data):
    """Callback of MuJoCo at every stage of a step."""
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
