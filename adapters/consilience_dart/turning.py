"""Rates of the directions of contacts, which the rows of `World.step` lack.

A step holds velocities J v of contacts where accelerations ``J a + gamma`` are asked for, gamma those at constant rates
of the coordinates: of a turning corner, of a sphere that rolls on another. From ``v + h x`` with ``J x = gamma`` the
step of the length h holds ``h (J a + gamma)``. The next step does so by itself: its rows have turned.
"""

from __future__ import annotations

import numpy as np

from consilience.engine import CannotRepresent
from consilience.mechanism import Array, ElementaryContact, State, contact_parts, nearest_points
from consilience_dart.constraints import weld_terms
from consilience_dart.contacts import CLOSED, Touching
from consilience_dart.state import Coordinates, read, send
from consilience_dart.translation import Model

DIFFERENCE = 1e-4
"""Time over which directions are differenced, s. They only tell which contacts act in the first step."""

UNTURNED = 1e-6
"""Largest rate in m/s^2 that is none."""

APART = 1e-4
"""Part of the rates that no motion may have: closed contacts that part or overlap as the bodies turn."""

_INDEPENDENT = 1e-9
"""Least eigenvalue of the inverse inertia of contacts and welds that counts, over the largest."""


def _slips(model: Model, touching: Touching, parts: list[tuple[int, ElementaryContact]]) -> list[tuple[Array, Array]]:
    """Return the slip of each part at its nearest points, and its normal, world axes."""
    state, found = State(*read(model)), []
    touching.note()
    for n, part in parts:
        nearest = nearest_points(model.mechanism, state, part)
        found.append((touching.slip(n, nearest.on_body), nearest.normal))
    return found


def _contact_terms(model: Model, touching: Touching, c: Coordinates) -> tuple[Array, Array, list[str], float]:
    """Return rows J of the closed contacts, the rates gamma of their velocities, and the name of the contact of each.

    Rows are normal and, where the contact is at rest, across the normal. The last result is the largest inverse inertia
    of a contact in any direction: joints may hold all that rows tell of.
    """
    send(model, c)
    state = State(*read(model))
    every = [(n, part) for n, contact in enumerate(model.mechanism.contacts) for part in contact_parts(contact)]
    closed = [(n, part) for n, part in every if nearest_points(model.mechanism, state, part).gap <= CLOSED]
    rates = [float(normal @ u) for u, normal in _slips(model, touching, closed)]
    parts = [one for one, rate in zip(closed, rates, strict=True) if rate <= CLOSED]
    slips = []
    for time in (-DIFFERENCE, 0.0, DIFFERENCE):
        send(model, c)
        model.skeleton.integratePositions(time)
        slips.append(_slips(model, touching, parts))
    send(model, c)
    touching.note()
    J, gamma, names, size = [np.zeros((0, len(c.v)))], list[float](), list[str](), 0.0
    W = model.skeleton.getInvMassMatrix()
    for (n, part), (u0, n0), (u, normal), (u1, n1) in zip(parts, *slips, strict=True):
        rows = touching.jacobian(n, nearest_points(model.mechanism, state, part).on_body)
        size = max(size, float(np.max(np.diag(rows @ W @ rows.T))))
        slides = float(np.linalg.norm(u - normal * (normal @ u))) > CLOSED
        across = np.zeros((0, 3)) if slides else np.linalg.svd(normal[None])[2][1:]
        J.append(np.array([normal, *across]) @ rows)
        gamma += [
            float(n1 @ u1 - n0 @ u0) / (2.0 * DIFFERENCE),
            *(float(t @ (u1 - u0)) / (2.0 * DIFFERENCE) for t in across),
        ]
        names += [part.name] * (1 + len(across))
    return np.vstack(J), np.array(gamma), names, size


def turning(model: Model, touching: Touching, c: Coordinates) -> Array:
    """Return x, shape (n,), zero where nothing turns; the skeleton is at the state then.

    Raises
    ------
    CannotRepresent
        Closed contacts turn apart.
    """
    J, gamma, names, size = _contact_terms(model, touching, c)
    if np.max(np.abs(gamma), initial=0.0) <= UNTURNED:
        return np.zeros(len(c.v))
    model.skeleton.setAccelerations(np.zeros(len(c.v)))
    welded, bias = weld_terms(model)
    J, gamma = np.vstack([J, welded]), np.concatenate([gamma, bias])
    by_mass = model.skeleton.getInvMassMatrix() @ J.T
    sizes, axes = np.linalg.eigh(J @ by_mass)
    kept = sizes > _INDEPENDENT * max(size, sizes[-1])
    x = by_mass @ (axes[:, kept] / sizes[kept] @ (axes[:, kept].T @ gamma))
    left = np.abs(J @ x - gamma)[: len(names)]
    if np.max(left) > APART * np.max(np.abs(gamma)):
        worst = int(np.argmax(left))
        what = f"its gap accelerates by {left[worst]:.3g} m/s^2 as the bodies turn, whatever their accelerations are"
        raise CannotRepresent(f"contact '{names[worst]}'", what)
    return np.asarray(x)
