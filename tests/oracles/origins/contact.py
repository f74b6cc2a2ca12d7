"""Origins of the cases with contact, stops and dry friction: closed forms between events (`oracles.closed_forms`).

Each function returns the observables at a time by name; a value of all bodies has the shape (n_b, 3). Only the data
that a formula needs are read from the case.
"""

import numpy as np

from oracles.closed_forms import collisions, events, sliding
from oracles.origins.impacts import _values
from oracles.origins.moving import about_hinge
from oracles.planar import held

# --- one body on a plane --------------------------------------------------------------------------------------------


def _axes(normal, first):
    """Axes (columns) t1 along the projection of a direction, t2 = n x t1, and n."""
    n = normal / np.linalg.norm(normal)
    t1 = first - (n @ first) * n
    t1 = t1 / np.linalg.norm(t1)
    return np.stack([t1, np.cross(n, t1), n], axis=1)


def _first(case):
    """Contact, axes of its plane and its cone, centre of mass, its velocity, and the spin, in the world."""
    start, body, contact = case.initial_state, case.mechanism.bodies[0], case.mechanism.contacts[0]
    arm = start.R_WB[0] @ body.com
    w = start.w_WB_W[0]
    E = _axes(contact.normal, np.array(contact.cone.tangent or [1.0, 0.0, 0.0]))
    return contact, E, start.p_WB[0] + arm, start.v_WB_W[0] + np.cross(w, arm), w


def _gravity(case, E):
    """Gravity along the plane in its axes, (2,), and against its normal."""
    own = E.T @ case.mechanism.gravity
    return own[:2], -own[2]


def _vertices(cone):
    if cone.kind == "box":
        return np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    turns = cone.offset + np.arange(cone.facets) * 2 * np.pi / cone.facets
    return np.stack([np.cos(turns), np.sin(turns)], axis=1)


def _slid(case, t):
    """A body that slides without turning, under the cone of its contact."""
    contact, E, p, v, _ = _first(case)
    A, g = _gravity(case, E)
    u, B = (E.T @ v)[:2], contact.friction * g
    if contact.cone.kind == "circle":
        u, way, _ = sliding.coulomb_slide(A, B, u, t)
    else:
        u, way, _ = sliding.polygon_slide(_vertices(contact.cone), B, u, t)
    return {"p_WBcm": p + E[:, :2] @ way, "v_WBcm_W": E[:, :2] @ u}


def _pushed(case, t):
    """A body at rest that a growing push breaks away, in the direction of the push."""
    contact, E, p, _, _ = _first(case)
    (load,), (body,) = case.mechanism.loads, case.mechanism.bodies
    growth = np.linalg.norm(load.vector) * load.history.polynomial[1]
    along = load.vector / np.linalg.norm(load.vector)
    x, v = collisions.push_that_grows(body.mass, contact.friction, _gravity(case, E)[1], growth, t)
    return {"p_WBcm": p + x * along, "v_WBcm_W": v * along}


def _rolled(case, t):
    """A homogeneous ball that slides, then rolls."""
    contact, E, p, v, w = _first(case)
    A, g = _gravity(case, E)
    found = sliding.ball_slide(A, contact.friction * g, contact.radius, E.T @ v, E.T @ w, t)
    return {"p_WBcm": p + E @ found[0], "v_WBcm_W": E @ found[1], "w_WB_W": E @ found[2]}


def _bounced(case, t):
    """A homogeneous ball that bounces on a plane across gravity, to rest or not."""
    contact, E, p, v, w = _first(case)
    height = E[:, 2] @ (p - contact.point) - contact.radius
    g = _gravity(case, E)[1]
    law = contact.radius, contact.restitution, contact.friction
    q, u, spin = sliding.bouncing_ball(g, *law, height, E.T @ v, E.T @ w, t)
    return {"p_WBcm": p + E @ (q - [0.0, 0.0, height]), "v_WBcm_W": E @ u, "w_WB_W": E @ spin}


def _dropped(case, t):
    """A box that lands flat: its centre bounces as a point does, without spin."""
    contact, E, p, v, _ = _first(case)
    rise = E[:, 2] @ (p - contact.point) - contact.half_sizes[2]
    law = 1.0, contact.restitution, 0.0
    q, u, _ = sliding.bouncing_ball(_gravity(case, E)[1], *law, rise, E.T @ v, np.zeros(3), t)
    return {"p_WBcm": p + E @ (q - [0.0, 0.0, rise]), "v_WBcm_W": E @ u, "w_WB_W": np.zeros(3)}


def _in_corner(case, t):
    """A ball in a corner: it spins to rest against the wall, or runs away from it."""
    floor, wall = case.mechanism.contacts
    _, E, p, v, w = _first(case)
    E = _axes(floor.normal, wall.normal)
    spin, g = (E.T @ w)[1], _gravity(case, E)[1]
    if spin < 0:
        _, rate = collisions.spin_in_corner(case.mechanism.bodies[0].mass, floor.radius, g, floor.friction, spin, t)
        N = case.mechanism.bodies[0].mass * g / (1 + floor.friction**2)
        up, across = (
            N * E[:, 2] - floor.friction * N * E[:, 0],
            floor.friction * N * (E[:, 0] + floor.friction * E[:, 2]),
        )
        rest = {"p_WBcm": p, "v_WBcm_W": np.zeros(3), "w_WB_W": rate * E[:, 1]}
        return rest | {"contact_force": np.array([up, across])}
    q, u, w, _ = sliding.ball_slide([0.0, 0.0], floor.friction * g, floor.radius, E.T @ v, E.T @ w, t)
    return {"p_WBcm": p + E @ q, "v_WBcm_W": E @ u, "w_WB_W": E @ w}


def _in_trough(case, t):
    """A ball between two walls that runs down their line of intersection."""
    left, right = case.mechanism.contacts
    _, _, p, _, _ = _first(case)
    along = np.cross(left.normal, right.normal)
    along /= np.linalg.norm(along)
    along *= np.sign(along @ case.mechanism.gravity)
    up = (left.normal + right.normal) / np.linalg.norm(left.normal + right.normal)
    half = np.arccos(left.normal @ up)
    g = np.linalg.norm(case.mechanism.gravity)
    slope = np.arcsin(along @ case.mechanism.gravity / g)
    a, turn = collisions.ball_in_trough(slope, half, left.radius, g, left.friction)
    axis = np.cross(up, along)
    return {"p_WBcm": p + a * t**2 / 2 * along, "v_WBcm_W": a * t * along, "w_WB_W": turn * t * axis}


def _disc(case, t):
    """A disc with its centre at rest: steady precession about the normal, spin about its axis, no slip."""
    contact, E, p, _, _ = _first(case)
    start, n = case.initial_state, E[:, 2]
    axis = start.R_WB[0] @ contact.axis
    tilt = np.arccos(axis @ n)
    precession, _ = collisions.disc_at_rest(contact.radius, _gravity(case, E)[1], tilt)
    turn = lambda x: x * np.cos(s) + np.cross(n, x) * np.sin(s) + (n @ x) * n * (1 - np.cos(s))  # noqa: E731
    s = precession * t
    # relative to the precession the disc turns by -Omega cos about its axis: the angular velocity is in its plane
    return {"p_WBcm": p, "v_WBcm_W": np.zeros(3), "w_WB_W": precession * (n - np.cos(tilt) * turn(axis))}


# --- tables, belts, several bodies ----------------------------------------------------------------------------------


def _normal(case):
    """Normal of the plane of the first contact in the world, at the start."""
    contact = case.mechanism.contacts[0]
    return case.initial_state.R_WB[case.mechanism.body_index[contact.partner]] @ contact.normal


def _on_belt(case, t):
    """A block on a belt, with a spring along it."""
    (spring,), (drive,), contact = case.mechanism.springs, case.mechanism.drives, case.mechanism.contacts[0]
    block = case.mechanism.body_index["block"]
    mass, start = case.mechanism.bodies[block].mass, case.initial_state
    com = start.p_WB[block] + start.R_WB[block] @ case.mechanism.bodies[block].com
    line = com - spring.point_predecessor
    along = line / np.linalg.norm(line)
    weight = -mass * _normal(case) @ case.mechanism.gravity / spring.stiffness
    static = contact.friction if contact.static_friction is None else contact.static_friction
    lengths = contact.friction * weight, static * weight
    belt = drive.motion.polynomial[1]
    x0 = np.linalg.norm(line) - spring.free_length
    v0 = float(along @ start.v_WB_W[block])
    x, v = events.on_belt(np.sqrt(spring.stiffness / mass), *lengths, belt, x0, v0, t)
    everything = {"p_WBcm": np.zeros((2, 3)), "v_WBcm_W": np.zeros((2, 3))}
    everything["p_WBcm"][block], everything["v_WBcm_W"][block] = com + (x - x0) * along, v * along
    return everything


def _on_table(case, t):
    """A block on a table that shakes along it, or a ball on one that shakes up and down."""
    (drive,), contact = case.mechanism.drives, case.mechanism.contacts[0]
    amplitude, frequency, _ = drive.motion.harmonics[0]
    joint = case.mechanism.joints[case.mechanism.joint_index[drive.joint]]
    along, g = joint.F.R[:, 2], np.linalg.norm(case.mechanism.gravity)
    if abs(along @ _normal(case)) < 0.5:
        x, v = events.on_shaken_table(amplitude, frequency, contact.friction * g, t)
    else:
        x, v = events.on_bouncing_table(amplitude, frequency, g, t)
    i = case.mechanism.body_index[contact.body]
    start = case.initial_state
    com = start.p_WB[i] + start.R_WB[i] @ case.mechanism.bodies[i].com
    found = {"p_WBcm": np.zeros((2, 3)), "v_WBcm_W": np.zeros((2, 3))}
    found["p_WBcm"][i], found["v_WBcm_W"][i] = com + x * along, v * along
    return found


def _pulled(case, t):
    """Two boxes, of which a growing force pulls the lower one."""
    floor, between = case.mechanism.contacts
    (load,), bodies = case.mechanism.loads, case.mechanism.bodies
    growth, along = load.history.polynomial[1] * np.linalg.norm(load.vector), load.vector / np.linalg.norm(load.vector)
    mu, g = (floor.friction, between.friction), np.linalg.norm(case.mechanism.gravity)
    x, v = collisions.pulled_boxes([b.mass for b in bodies], mu, g, growth, t)
    start = case.initial_state
    com = np.array([p + R @ b.com for p, R, b in zip(start.p_WB, start.R_WB, bodies, strict=True)])
    return {"p_WBcm": com + np.outer(x, along), "v_WBcm_W": np.outer(v, along)}


def _collided(case, t):
    """Two rough spheres that meet once."""
    start, (contact,), bodies = case.initial_state, case.mechanism.contacts, case.mechanism.bodies
    arms = np.array([R @ b.com for R, b in zip(start.R_WB, bodies, strict=True)])
    p, v, w = start.p_WB + arms, start.v_WB_W + np.cross(start.w_WB_W, arms), start.w_WB_W
    d, u = p[0] - p[1], v[0] - v[1]
    a, b, c = u @ u, d @ u, d @ d - (contact.radius + contact.partner_radius) ** 2
    hit = (-b - np.sqrt(b**2 - a * c)) / a
    s = min(t, hit)
    p = p + s * v
    if t > hit:
        n = (d + hit * u) / np.linalg.norm(d + hit * u)
        mass, inertia = [b.mass for b in bodies], [b.inertia[0, 0] for b in bodies]
        radii = [contact.radius, contact.partner_radius]
        v, w = collisions.rough_spheres(mass, radii, inertia, contact.restitution, contact.friction, v, w, n)
        p = p + (t - hit) * v
    return {"p_WBcm": p, "v_WBcm_W": v, "w_WB_W": w}


def _in_line(case, t):
    """Balls on a line; the first one moves."""
    start, bodies = case.initial_state, case.mechanism.bodies
    com = np.array([p + R @ b.com for p, R, b in zip(start.p_WB, start.R_WB, bodies, strict=True)])
    speed = np.linalg.norm(start.v_WB_W[0])
    along = start.v_WB_W[0] / speed
    gaps = [
        np.linalg.norm(com[k + 1] - com[k]) - c.radius - c.partner_radius for k, c in enumerate(case.mechanism.contacts)
    ]
    gaps = np.where(np.abs(gaps) < 1e-12, 0.0, gaps)
    e = case.mechanism.contacts[0].restitution
    x, v = collisions.balls_in_line([b.mass for b in bodies], gaps, e, speed, t)
    return {"p_WBcm": com + np.outer(x, along), "v_WBcm_W": np.outer(v, along)}


def _off_ball(case, t):
    """A ball that rolls off a fixed ball, in the vertical plane through both centres."""
    (contact,) = case.mechanism.contacts
    start, body = case.initial_state, case.mechanism.bodies[0]
    com = start.p_WB[0] + start.R_WB[0] @ body.com
    d = com - contact.partner_center
    up = -case.mechanism.gravity / np.linalg.norm(case.mechanism.gravity)
    out = d - (d @ up) * up
    out /= np.linalg.norm(out)
    reach = contact.radius + contact.partner_radius
    g = np.linalg.norm(case.mechanism.gravity)
    tilt = np.arctan2(d @ out, d @ up)
    th, rate, spin = events.ball_off_ball(contact.partner_radius, contact.radius, g, contact.friction, tilt, t)
    n, along = np.cos(th) * up + np.sin(th) * out, np.cos(th) * out - np.sin(th) * up
    place = contact.partner_center + reach * n
    return {"p_WBcm": place, "v_WBcm_W": reach * rate * along, "w_WB_W": spin * np.cross(up, out)}


# --- joints ---------------------------------------------------------------------------------------------------------


def _swing(case, joint):
    """Moment of inertia and restoring moment of one body about a level hinge, and its start; zero hangs."""
    u, J, arm = about_hinge(case, joint)
    pull = case.mechanism.gravity - (case.mechanism.gravity @ u) * u
    moment = case.mechanism.bodies[0].mass * np.linalg.norm(pull) * np.linalg.norm(arm)
    assert abs(u @ np.cross(pull, arm)) < 1e-12 * np.linalg.norm(pull) * np.linalg.norm(arm)
    return J, moment, held(case, joint)


def _pendulum_at_a_stop(case, t):
    J, moment, (angle, rate) = _swing(case, "hinge")
    (stop,) = case.mechanism.stops
    limit = stop.lower if stop.upper is None else stop.upper
    found = events.stopped_pendulum(np.sqrt(moment / J), angle, rate, limit, stop.restitution, t)
    return dict(zip(("angle", "angle_rate"), found, strict=True))


def _dry_pendulum(case, t):
    J, moment, (angle, _) = _swing(case, "hinge")
    (friction,) = case.mechanism.dry_frictions
    return dict(zip(("angle", "angle_rate"), events.dry_pendulum(moment, friction.bound, J, angle, t), strict=True))


def _between_stops(case, t):
    _, J, _ = about_hinge(case, "hinge")
    (stop,), (friction,) = case.mechanism.stops, case.mechanism.dry_frictions
    found = events.coasting_between_stops(
        *held(case, "hinge"), friction.bound / J, stop.lower, stop.upper, stop.restitution, t
    )
    return dict(zip(("angle", "angle_rate"), found, strict=True))


def _dry_spring(case, t):
    (spring,), (friction,), (body,) = case.mechanism.joint_springs, case.mechanism.dry_frictions, case.mechanism.bodies
    start = case.initial.coordinates["slide"]["distance"]
    found = events.dry_oscillator(
        np.sqrt(spring.stiffness / body.mass), friction.bound / spring.stiffness, start - spring.rest, t
    )
    return {"distance": spring.rest + found[0], "distance_rate": found[1]}


def _bead(case, t):
    (friction,), (drive,) = case.mechanism.dry_frictions, case.mechanism.drives
    r, rate = (held["rod"]["distance"] for held in (case.initial.coordinates, case.initial.rates))
    found = events.bead_on_rod(drive.motion.polynomial[1], friction.coefficient, r, rate, t)
    return dict(zip(("distance", "distance_rate"), found, strict=True))


def _rocking(case, t):
    """Tilt of a block about the edge at which it starts; the joint is planar, its angle the tilt."""
    left, right = case.mechanism.contacts
    width = np.linalg.norm(left.corner - right.corner) / 2
    body = case.mechanism.bodies[0]
    height = abs(left.normal @ (case.initial_state.R_WB[0] @ (body.com - (left.corner + right.corner) / 2)))
    tilt, _ = held(case, "plane")
    height = np.sqrt(np.linalg.norm(body.com - left.corner) ** 2 - width**2)
    found = events.rocking(width, height, np.linalg.norm(case.mechanism.gravity), abs(tilt), t)
    sign = np.sign(tilt)
    return {"angle": sign * found[0], "angle_rate": sign * found[1]}


def _ladder(case, t):
    foot, head = case.mechanism.contacts
    half = np.linalg.norm(foot.corner - head.corner) / 2
    start = case.initial_state.R_WB[0] @ (head.corner - foot.corner)
    th0 = np.arcsin(start @ foot.normal / (2 * half))
    _, rate, x, z = events.ladder(half, np.linalg.norm(case.mechanism.gravity), th0, t)
    at = foot.point + head.normal * (x + head.normal @ (head.point - foot.point)) + foot.normal * z
    side = np.cross(foot.normal, head.normal)
    at += side * (side @ (case.initial_state.p_WB[0] - foot.point))
    return {"p_WBcm": at, "w_WB_W": -rate * np.cross(head.normal, foot.normal)}


def _crank_at_a_stop(case, t):
    bodies, (stop,) = {b.name: b for b in case.mechanism.bodies}, case.mechanism.stops
    crank, rod, slider = (bodies[name] for name in ("crank", "rod", "slider"))
    drawn = np.linalg.norm(slider.drawing.p)
    found = collisions.slider_crank_with_stop(
        0.1,
        0.3,
        [crank.mass, rod.mass, slider.mass],
        [crank.inertia[2, 2], rod.inertia[2, 2]],
        np.pi / 2 + held(case, "hinge")[0],
        held(case, "hinge")[1],
        drawn + stop.upper,
        stop.restitution,
        t,
    )
    return {"angle": found[0] - np.pi / 2, "angle_rate": found[1]}


def _hit_floor(case, t):
    """A rod without spin whose tip hits the floor, without gravity."""
    (contact,), (body,), start = case.mechanism.contacts, case.mechanism.bodies, case.initial_state
    R, v = start.R_WB[0], start.v_WB_W[0]
    com, arm = start.p_WB[0] + R @ body.com, R @ (contact.corner - body.com)
    n, half = contact.normal, np.linalg.norm(arm)
    x = arm - (n @ arm) * n
    x /= np.linalg.norm(x)
    hit = (com + arm - contact.point) @ n / -(v @ n)
    if t <= hit:
        return {"p_WBcm": com + v * t, "v_WBcm_W": v, "w_WB_W": np.zeros(3)}
    law = contact.friction, contact.restitution, (v @ x, v @ n), contact.impact_law
    F, N = collisions.rod_impact(half, body.mass, np.arcsin(-(n @ arm) / half), *law)
    J = F * x + N * n
    after = v + J / body.mass
    w = np.cross(arm, J) / (body.mass * half**2 / 3)
    return {"p_WBcm": com + v * hit + after * (t - hit), "v_WBcm_W": after, "w_WB_W": w}


def _on_spring(case, t):
    """A ball that falls onto a soft floor."""
    contact, E, p, _, _ = _first(case)
    height = E[:, 2] @ (p - contact.point) - contact.radius
    mass, k = case.mechanism.bodies[0].mass, contact.compliance.stiffness
    z, v = collisions.ball_on_spring(mass, _gravity(case, E)[1], k, height, t)
    return {"p_WBcm": p + (z - height) * E[:, 2], "v_WBcm_W": v * E[:, 2]}


def _tipping(case, t):
    """Accelerations of a box at rest that starts to tip about its lower edge, at the start alone."""
    contact, E, _, _, _ = _first(case)
    body, (A, _) = case.mechanism.bodies[0], _gravity(case, E)
    down = E[:, :2] @ A / np.linalg.norm(A)
    reach = np.abs((case.initial_state.R_WB[0] @ contact.orientation).T @ down) @ contact.half_sizes
    arm = contact.half_sizes[2] * E[:, 2] - reach * down  # from the edge to the centre
    axis = np.cross(E[:, 2], down)
    J = axis @ case.initial_state.R_WB[0] @ body.inertia @ case.initial_state.R_WB[0].T @ axis
    alpha = axis @ np.cross(arm, body.mass * case.mechanism.gravity) / (J + body.mass * arm @ arm)
    a = alpha * np.cross(axis, arm)  # the origin of the body is its centre of mass
    force = body.mass * (a - case.mechanism.gravity)
    return {"alpha_WB_W": alpha * axis, "a_WB_W": a, "contact_force": force}


ORIGINS = {
    name: (_values(motion),)
    for motion, names in {
        _slid: (
            *("block_incline-down", "block_incline-up", "block_slides_back", "thrown_across_stops"),
            *(
                "thrown_across_slides",
                "skew_slide_circle",
                "skew_slide_pyramid",
                "skew_slide_octagon",
                "skew_slide_box",
            ),
        ),
        _pushed: ("breakaway",),
        _rolled: (
            *("bowling-hook", "bowling-backspin", "bowling-skid", "ball_across_incline", "ball_rolls", "ball_slips"),
        ),
        _bounced: ("bounces_to_rest", "bounces_that_slide", "bounces_that_grip"),
        _dropped: ("flat_box_drop",),
        _in_corner: ("ball_in_corner-stays", "ball_in_corner-leaves"),
        _in_trough: ("trough_rolls", "trough_slides"),
        _disc: ("eulers_disc",),
        _on_belt: ("belt_catch", "belt_stick_slip"),
        _on_table: ("shaken_table", "bouncing_table"),
        _pulled: ("pulled_boxes",),
        _collided: ("rough_spheres_slip", "rough_spheres_grip"),
        _in_line: ("balls_touching", "balls_apart"),
        _off_ball: ("ball_off_ball",),
        _pendulum_at_a_stop: ("pendulum_at_a_stop", "pendulum_rests_on_a_stop"),
        _dry_pendulum: ("pendulum_dry_friction",),
        _between_stops: ("hinge_between_stops", "wheel_caught_by_stop"),
        _dry_spring: ("dry_spring",),
        _bead: ("bead_on_turning_rod-outward", "bead_on_turning_rod-inward"),
        _rocking: ("rocking_block",),
        _ladder: ("ladder_leaves_wall",),
        _crank_at_a_stop: ("crank_at_a_stop",),
        _hit_floor: ("rod_hits_floor-forward", "rod_hits_floor-backward", "rod_hits_floor_poisson"),
        _on_spring: ("ball_on_spring",),
        _tipping: ("box_tips",),
    }.items()
    for name in names
}
