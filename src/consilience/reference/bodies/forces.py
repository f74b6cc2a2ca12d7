"""Applied and gyroscopic forces, compiled [MASS (30)-(36)].

The generalised force of a body belongs to the velocities (v, w'): force at the centre of mass in world axes, torque
about the centre of mass in body axes, including the gyroscopic term ``-w' x I' w'``. An effort in a joint coordinate q
(force or torque) has the virtual power effort times q', so that it acts by the coefficients of q' in the velocities.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.mechanism.elements import NO_LENGTH
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.joint_rows import CoordinateRow, coordinate
from consilience.reference.bodies.motion import ZERO, arm, motion, rotations
from consilience.reference.kernel import functions
from consilience.reference.kernel.compiled import fused, inlined, kernel
from consilience.reference.kernel.vectors import (
    Vector,
    accumulate,
    add,
    cross,
    dot,
    load,
    rotate,
    rotate_back,
    scale,
    sub,
)


@fused
def _push(f: Array, A: Array, body: int, force: Vector, s: Vector, torque: Vector) -> None:
    """Add a force at the arm s from the centre of mass, and a torque, to the generalised forces of a body.

    Parameters
    ----------
    f : ndarray, shape (6 n_b,)
        Generalised forces, added to.
    A : ndarray, shape (n_b, 3, 3)
    body : int
        -1 for the ground.
    force, s, torque : Vector, N, m and N m
        World axes.
    """
    if body >= 0:
        accumulate(f[6 * body : 6 * body + 3], force)
        accumulate(f[6 * body + 3 : 6 * body + 6], rotate_back(A[body], add(torque, cross(s, force))))


@fused
def _add_effort(f: Array, A: Array, q: CoordinateRow, effort: float) -> None:
    """Add an effort in a joint coordinate: on the successor, its opposite on the predecessor."""
    e = scale(effort, q.row.e)
    _push(f, A, q.j, e, ZERO, scale(effort, q.row.c_j))
    _push(f, A, q.i, scale(-1.0, e), ZERO, scale(effort, q.row.c_i))


@inlined
def _factor(model: Model, function: int, t: float, otherwise: float) -> float:
    """Return the value of a function of time, or a constant if the element has no function."""
    return functions.evaluate(model.functions, function, t)[0] if function >= 0 else otherwise


@fused
def friction_effort(law: Vector, rate: float) -> float:
    """Return the regularised friction effort ``-(d q' + F tanh(q' / v))`` for law = (d, F, v)."""
    return -law[0] * rate - law[1] * np.tanh(rate / law[2])


@fused
def joint_spring_effort(push: float, law: Vector, higher: Array, q: float, rate: float) -> float:
    """Return the effort ``f(t) - (k x + k1 x^2 + k2 x^3) - (c + c1 |v| + c2 v^2) v`` of a joint spring.

    Parameters
    ----------
    push : float, N or N m
        Effort f of the actuator.
    law : (k, c, q0)
    higher : ndarray, shape (4,)
        k1, k2, c1 and c2.
    q, rate : float
        Coordinate, ``x = q - q0``, and its rate v.
    """
    x, speed = q - law[2], abs(rate)
    stiffness = law[0] + (higher[0] + higher[1] * x) * x
    damping = law[1] + (higher[2] + higher[3] * speed) * speed
    return push - stiffness * x - damping * rate


@inlined
def _joint_elements(model: Model, t: float, y: Array, turns: Array, ws: Workspace) -> None:
    """Add the efforts of joint springs, friction and controllers.

    Parameters
    ----------
    model, t, y, turns, ws
        As in `constraints.evaluate`.
    """
    for n in range(model.joint_spring.shape[0]):
        spring = model.joint_spring[n]
        q = coordinate(model, y, ws.A, spring.coordinate, turns[spring.coordinate])
        push, law = _factor(model, spring.actuator, t, 0.0), (spring.stiffness, spring.damping, spring.rest)
        _add_effort(ws.f, ws.A, q, joint_spring_effort(push, law, spring.higher, q.value, q.rate))
    for n in range(model.friction.shape[0]):
        c, law = model.friction[n].coordinate, model.friction[n]
        q = coordinate(model, y, ws.A, c, turns[c])
        _add_effort(ws.f, ws.A, q, friction_effort((law.viscous, law.coulomb, law.speed), q.rate))
    for n in range(model.control.shape[0]):
        control = model.control[n]
        q = coordinate(model, y, ws.A, control.coordinate, turns[control.coordinate])
        target, target_rate, _ = functions.evaluate(model.functions, control.target, t)
        P, I, D = control.proportional, control.integral, control.derivative
        integral = y[model.mass.shape[0] + n // 13, n % 13]
        _add_effort(ws.f, ws.A, q, P * (target - q.value) + I * integral + D * (target_rate - q.rate))


@kernel
def control_errors(model: Model, t: float, y: Array, turns: Array, ws: Workspace, dy: Array) -> None:
    """Write the control errors ``target(t) - q``, the rates of the controllers' integrals, into the last rows of dy.

    Parameters
    ----------
    model, t, y, turns, ws
        As in `constraints.evaluate`.
    dy : ndarray, shape (n_b + n_e, 13)
        Its rows after those of the bodies are overwritten.
    """
    for n in range(model.control.shape[0]):
        c = model.control[n].coordinate
        target = functions.evaluate(model.functions, model.control[n].target, t)[0]
        q = coordinate(model, y, ws.A, c, turns[c])
        dy[model.mass.shape[0] + n // 13, n % 13] = target - q.value


@kernel
def count_turns(model: Model, y: Array, ws: Workspace, turns: Array) -> None:
    """Replace the joint coordinates that elements read by their values at y, angles nearest to the old ones."""
    rotations(y, ws.A)
    for n in range(turns.shape[0]):
        turns[n] = coordinate(model, y, ws.A, n, turns[n]).value


@kernel
def read(model: Model, y: Array, A: Array, near: Array, value: Array, rate: Array) -> None:
    """Evaluate the joint coordinates that elements read, angles within half a turn of `near`, and their rates.

    Parameters
    ----------
    model : Model
    y : ndarray, shape (n_b + n_e, 13)
    A : ndarray, shape (n_b, 3, 3)
    near : ndarray, shape (n_c,), m or rad
    value, rate : ndarray, shape (n_c,)
        Overwritten.
    """
    for n in range(near.shape[0]):
        q = coordinate(model, y, A, n, near[n])
        value[n], rate[n] = q.value, q.rate


@fused
def spring_force(law: Vector, push: float, d: Vector, v: Vector) -> Vector:
    """Return the force ``(k (L - L0) + c L' - f(t)) e`` on the predecessor for law = (k, c, L0).

    At L = 0 it is the limit along the relative velocity of the points; a force without a direction is not a number.
    """
    L = np.sqrt(dot(d, d))
    if L > NO_LENGTH:
        e = scale(1.0 / L, d)
        return scale(law[0] * (L - law[2]) + law[1] * dot(e, v) - push, e)
    return scale(law[1] if law[0] * law[2] + push == 0.0 else np.nan, v)


@inlined
def _springs(model: Model, t: float, y: Array, A: Array, f: Array) -> None:
    """Add ``F = (k (L - L0) + c L' - f(t)) e`` on the predecessor, the opposite on the successor [MASS (31)].

    Parameters
    ----------
    model, t, y
        As in `constraints.evaluate`.
    A : ndarray, shape (n_b, 3, 3)
    f : ndarray, shape (6 n_b,)
        Generalised forces, added to.
    """
    for n in range(model.spring.shape[0]):
        spring = model.spring[n]
        i, j = spring.i, spring.j
        s_i, s_j = arm(A, i, load(spring.arm_i)), arm(A, j, load(spring.arm_j))
        r_i, v_i, w_i = motion(y, A, i)
        r_j, v_j, w_j = motion(y, A, j)
        d = sub(add(r_j, s_j), add(r_i, s_i))
        v = sub(add(v_j, cross(w_j, s_j)), add(v_i, cross(w_i, s_i)))
        push, law = _factor(model, spring.actuator, t, 0.0), (spring.stiffness, spring.damping, spring.rest)
        force = spring_force(law, push, d, v)
        _push(f, A, i, force, s_i, ZERO)
        _push(f, A, j, scale(-1.0, force), s_j, ZERO)


@inlined
def _loads(model: Model, t: float, A: Array, f: Array) -> None:
    """Add forces and torques fixed in the world or in a body."""
    for n in range(model.load.shape[0]):
        applied = model.load[n]
        b = applied.body
        vector = scale(_factor(model, applied.history, t, 1.0), load(applied.vector))
        if applied.on_body:
            vector = arm(A, b, vector)
        if applied.is_torque:
            _push(f, A, b, ZERO, ZERO, vector)
        else:
            _push(f, A, b, vector, arm(A, b, load(applied.arm)), ZERO)


@kernel
def evaluate(model: Model, t: float, y: Array, turns: Array, ws: Workspace) -> None:
    """Evaluate all applied and gyroscopic forces into ``ws.f``, shape (6 n_b,).

    Parameters as in `constraints.evaluate`; ``ws.external`` holds further forces of the caller.
    """
    for n in range(ws.f.shape[0]):  # element by element: array assignment compiles slowly
        ws.f[n] = ws.external[n]
    gravity = load(model.gravity)
    for b in range(model.mass.shape[0]):
        w = load(y[b, 10:13])
        accumulate(ws.f[6 * b : 6 * b + 3], scale(model.mass[b], gravity))
        accumulate(ws.f[6 * b + 3 : 6 * b + 6], scale(-1.0, cross(w, rotate(model.inertia[b], w))))
    if model.spring.shape[0]:
        _springs(model, t, y, ws.A, ws.f)
    if turns.shape[0]:
        _joint_elements(model, t, y, turns, ws)
    if model.load.shape[0]:
        _loads(model, t, ws.A, ws.f)
