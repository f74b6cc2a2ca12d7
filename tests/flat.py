"""Mechanisms whose bodies move in parallel planes that are skew in the world."""

from dataclasses import replace

import numpy as np

from consilience.mechanism import (
    GROUND,
    Control,
    Coupling,
    Drive,
    Friction,
    Function,
    JointSpring,
    Load,
    Mechanism,
    Spring,
    linear,
    quaternion_from_rotation_vector,
    rotation_from_quaternion,
    sine,
)
from mechanisms import GRAVITY, drawn_joint, lumpy_body, rotation


def axes_for(kind, R, rng):
    """Axes of a joint that moves in the plane with the last column of R as normal; their free angle is random."""
    turn = rng.uniform(0.0, 2.0 * np.pi)
    sense = rng.choice([-1.0, 1.0])
    along = np.array([np.cos(turn), np.sin(turn), 0.0])
    z = np.array([0.0, 0.0, sense])
    if kind == "prismatic":  # a slide moves along the plane; its other two axes are turned at random about the slide
        first = rotation_from_quaternion(quaternion_from_rotation_vector(turn * along)) @ np.cross(along, z)
        return R @ np.column_stack([first, np.cross(along, first), along])
    return R @ np.column_stack([along, np.cross(z, along), z])


def flat_chain(*kinds, seed, backwards=(), parents=None, closing=()):
    """Chain of bodies that move in a skew plane; `closing` lists joints that close loops: (kind, body, body)."""
    rng = np.random.default_rng(seed)
    R = rotation(rng)
    bodies = {f"b{n}": lumpy_body(f"b{n}", rng) for n in range(len(kinds))}
    names = [GROUND, *bodies]
    joints = []
    for n, kind in enumerate(kinds):
        i, j = names[n if parents is None else parents[n]], names[n + 1]
        i, j = (j, i) if n in backwards else (i, j)
        at = R @ np.append(rng.normal(scale=0.5, size=2), rng.normal(scale=0.2))
        joints.append(drawn_joint(f"j{n}", kind, bodies, i, j, at, axes_for(kind, R, rng)))
    for n, (kind, i, j) in enumerate(closing):
        at = R @ np.append(rng.normal(scale=0.5, size=2), 0.1)
        to = at + 0.6 * R @ np.array([0.6, 0.0, 0.8]) if kind == "rod" else None
        axes = axes_for("prismatic" if kind == "point_on_line" else kind, R, rng)
        if to is not None:
            z = (to - at) / np.linalg.norm(to - at)
            axes = np.column_stack([R[:, 1], np.cross(z, R[:, 1]), z])
        joints.append(drawn_joint(f"c{n}", kind, bodies, i, j, at, axes, to))
    return Mechanism("_".join(kinds), GRAVITY, tuple(bodies.values()), tuple(joints))


def powered(seed=3):
    """A planar chain with every kind of force element and a controller."""
    base, rng = flat_chain("revolute", "prismatic", "revolute", seed=seed, backwards=(1,)), np.random.default_rng(seed)
    wave, at = sine(2.0, 3.0, 0.4), rng.normal(scale=0.3, size=(6, 3))
    return replace(
        base,
        name="powered",
        springs=(
            Spring("s", GROUND, "b2", at[0], at[1], 12.0, 0.7, 0.4, wave),
            Spring("r", "b0", "b2", at[2], at[3], 5.0, 0.2, 0.1),
        ),
        joint_springs=(
            JointSpring("k0", "j0", "angle", 3.0, 0.2, 0.1, wave),
            JointSpring("k1", "j1", "distance", 4.0, 0.3, 0.2),
        ),
        loads=tuple(
            Load(f"{kind}_{frame}", kind, "b1", rng.normal(size=3), frame, at[4], Function(np.array([1.0, -0.4])))
            for kind in ("force", "torque")
            for frame in ("world", "body")
        ),
        frictions=(Friction("f0", "j2", "angle", 0.3, 1.1, 0.2), Friction("f1", "j1", "distance", 0.5, 2.0, 0.4)),
        controls=(
            Control("u", "j2", "angle", sine(0.5, 2.0), 20.0, 7.0, 1.5),
            Control("w", "j1", "distance", sine(0.3, 1.0), 9.0, 3.0, 0.5),
        ),
    )


def branches(seed=4):
    """Three branches, each in a plane of its own, with couplings between their coordinates; one branch only slides."""
    rng = np.random.default_rng(seed)
    bodies = {f"b{n}": lumpy_body(f"b{n}", rng) for n in range(4)}
    kinds = [("revolute", GROUND, "b0"), ("revolute", GROUND, "b1"), ("prismatic", "b1", "b2")]
    planes = [rotation(rng), rotation(rng)]
    planes.append(planes[1])
    joints = [
        drawn_joint(f"j{n}", kind, bodies, i, j, rng.normal(size=3), axes_for(kind, R, rng))
        for n, ((kind, i, j), R) in enumerate(zip(kinds, planes, strict=True))
    ]
    joints.append(drawn_joint("j3", "prismatic", bodies, "b3", GROUND, rng.normal(size=3), rotation(rng)))
    couplings = (
        Coupling("gears", "j0", "angle", "j1", "angle", linear(-2.5, 0.1)),
        Coupling("cam", "j3", "distance", "j0", "angle", Function(np.zeros(1), np.array([[0.3, 1.0, 0.2]]))),
    )
    return Mechanism("branches", GRAVITY, tuple(bodies.values()), tuple(joints), couplings=couplings)


def driven(seed=5):
    base = flat_chain("revolute", "revolute", "prismatic", seed=seed, backwards=(2,))
    drives = (
        Drive("turn", "j1", "angle", Function(np.array([0.2, 1.5]), np.array([[0.3, 4.0, 0.1]]))),
        Drive("push", "j2", "distance", sine(0.2, 5.0)),
    )
    return replace(base, name="driven", drives=drives)


PLANAR = {
    "pendulum": flat_chain("revolute", seed=10),
    "slide": flat_chain("prismatic", seed=11),
    "chain": flat_chain("revolute", "prismatic", "planar", "rigid", "revolute", seed=12),
    "backward": flat_chain("revolute", "prismatic", "planar", "prismatic", "revolute", seed=13, backwards=(0, 1, 2, 4)),
    "branched": flat_chain("planar", "revolute", "prismatic", "revolute", seed=14, parents=(0, 1, 1, 2)),
    **{
        f"closed_{kind}": flat_chain(
            *("revolute", "revolute", "prismatic", "revolute"),
            seed=20 + n,
            backwards=(1,),
            parents=(0, 1, 0, 3),
            closing=[(kind, "b1", "b3")],
        )
        for n, kind in enumerate(("revolute", "prismatic", "point_on_line", "rod"))
    },
    "closed_on_ground": flat_chain("revolute", "planar", "revolute", seed=25, closing=[("revolute", GROUND, "b2")]),
    "two_loops": flat_chain(
        *("revolute",) * 6, seed=30, closing=[("revolute", "b2", GROUND), ("revolute", "b5", "b2")], parents=None
    ),
    "powered": powered(),
    "driven": driven(),
    "branches": branches(),
}
