"""Contact problems of one lumpy body that touches at points: a row is the acceleration of a point, G = J M^-1 J^T."""

from dataclasses import replace

import numpy as np

from consilience.mechanism import skew
from consilience.reference.contact.problem import ContactProblem, FrictionSet

g = 9.81
LUMPY = np.array([[0.031, 0.004, -0.006], [0.004, 0.042, 0.003], [-0.006, 0.003, 0.055]])
CORNERS = np.array([[x, y, -0.1] for x in (-0.3, 0.3) for y in (-0.2, 0.2)])
FEET = np.array([[0.3, 0.02, -0.1], [-0.14, 0.26, -0.1], [-0.16, -0.25, -0.1]])
FLOOR = np.eye(3)[[2, 0, 1]]
"""Rows n, t1, t2 of a floor."""


def touching(points, mass, inertia, wrench, mu, frames=FLOOR, cone="circle", slip=(0.0, 0.0), angle=0.0):
    """Contact problem of one body at points relative to its centre of mass, slip in the tangents of each frame."""
    frames = np.broadcast_to(frames, (len(points), 3, 3))
    J = np.vstack([np.hstack([R, -R @ skew(s)]) for R, s in zip(frames, points, strict=True)])
    weight = np.zeros((6, 6))
    weight[:3, :3], weight[3:, 3:] = np.eye(3) / mass, np.linalg.inv(inertia)
    friction = []
    for k in range(len(points)):
        n, t = 3 * k, (3 * k + 1, 3 * k + 2)
        if cone == "box":
            friction += [FrictionSet(f"p{k}", (row,), mu, mu, n) for row in t]
        else:
            facets = {"circle": 0, "diamond": 4, "octagon": 8}[cone]
            friction.append(FrictionSet(f"p{k}", t, mu, mu, n, facets=facets, angle=angle))
    names = tuple(f"p{k // 3}" for k in range(3 * len(points)))
    normals = tuple(range(0, 3 * len(points), 3))
    sliding = np.tile([0.0, *slip], len(points))
    return ContactProblem(J @ weight @ J.T, J @ weight @ np.asarray(wrench), names, normals, tuple(friction), sliding)


def total(problem, force, frames=FLOOR):
    """Sum of the forces of all points, axes of the body."""
    frames = np.broadcast_to(frames, (len(problem.normals), 3, 3))
    return np.einsum("kji,kj->i", frames, force.reshape(-1, 3))


def weight_on_incline(mass, slope):
    return np.array([mass * g * np.sin(slope), 0.0, -mass * g * np.cos(slope), 0.0, 0.0, 0.0])


def rod(angle, mu, rate=0.0, slip=1.0):
    """Slender rod of half-length 1, mass 1, its tip on the floor sliding towards +x, centre behind it."""
    tip = np.array([np.cos(angle), 0.0, -np.sin(angle)])
    inertia = np.diag([1.0, 1.0, 1.0]) / 3.0
    problem = touching([tip], 1.0, inertia, [0.0, 0.0, -g, 0.0, 0.0, 0.0], mu, slip=(slip, 0.0))
    return replace(problem, free=problem.free + np.array([rate**2 * np.sin(angle), 0.0, 0.0]))
