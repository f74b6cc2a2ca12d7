"""Mechanisms for tests: lumpy bodies (off-centre mass, full inertia), skew frames, all joints, trees and loops."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from consilience.mechanism import (
    GROUND,
    JOINT_KINDS,
    Body,
    Control,
    Coupling,
    Drive,
    Frame,
    Friction,
    Function,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    Rolling,
    Skate,
    Spring,
    State,
    constant,
    initial_state,
    linear,
    quaternion_from_rotation_vector,
    random_states,
    rotation_from_quaternion,
    sine,
    through,
)

GRAVITY = np.array([1.3, -2.1, -9.4])
PITCH = -0.31


def rotation(rng: np.random.Generator) -> np.ndarray:
    return rotation_from_quaternion(quaternion_from_rotation_vector(rng.normal(size=3)))


def is_conservative(mechanism: Mechanism) -> bool:
    """Tell whether kinetic plus potential energy is constant: nothing dissipates or does work from outside."""
    elastic = [*mechanism.springs, *mechanism.joint_springs]
    working = (mechanism.frictions, mechanism.drives, mechanism.controls, mechanism.contacts)
    return not (
        any(working)
        or any(s.damping != 0 or s.actuator is not None for s in elastic)
        or any(any(s.higher_damping) for s in mechanism.joint_springs)
        or any(x.kind != "force" or x.frame != "world" or x.history is not None for x in mechanism.loads)
    )


def lumpy_body(name: str, rng: np.random.Generator) -> Body:
    """Body with mass near 1 kg, off-centre mass, and the inertia of a random cloud of points, hence a physical one."""
    points = rng.normal(scale=0.3, size=(8, 3))
    masses = rng.uniform(0.1, 0.3, size=8)
    com = masses @ points / masses.sum()
    c = points - com
    inertia = np.einsum("n,nij->ij", masses, np.eye(3) * np.sum(c * c, 1)[:, None, None] - c[:, :, None] * c[:, None])
    return Body(name, float(masses.sum()), com, inertia, Frame(rng.normal(scale=0.5, size=3), rotation(rng)))


def drawn_joint(name: str, kind: str, bodies: dict[str, Body], i: str, j: str, at, axes, to=None) -> Joint:
    """Joint with given origin and axes in the world of the drawing."""
    ground = Frame(np.zeros(3), np.eye(3))
    start = ground if i == GROUND else bodies[i].drawing
    end = ground if j == GROUND else bodies[j].drawing
    to = at if to is None else to
    return Joint(
        name,
        kind,
        i,
        j,
        Frame(start.R.T @ (at - start.p), start.R.T @ axes),
        Frame(end.R.T @ (to - end.p), end.R.T @ axes),
        float(np.linalg.norm(to - at)) if kind == "rod" else 0.0,
        PITCH if kind == "screw" else 0.0,
    )


def chain(*kinds: str, seed: int = 0, backwards: tuple[int, ...] = (), forces: bool = False) -> Mechanism:
    """Serial chain from the ground; the joints at the positions `backwards` have predecessor and successor swapped."""
    rng = np.random.default_rng(seed)
    bodies = {f"b{n}": lumpy_body(f"b{n}", rng) for n in range(len(kinds))}
    names = [GROUND, *bodies]
    joints = []
    for n, kind in enumerate(kinds):
        at, axes = rng.normal(scale=0.5, size=3), rotation(rng)
        to = at + 0.7 * axes[:, 2] if kind == "rod" else None
        i, j = names[n], names[n + 1]
        if n in backwards:
            i, j = j, i
        joints.append(drawn_joint(f"j{n}", kind, bodies, i, j, at, axes, to))
    extra = force_elements(joints, list(bodies), rng) if forces else {}
    return Mechanism("_".join(kinds), GRAVITY, tuple(bodies.values()), tuple(joints), **extra)


def force_elements(joints: list[Joint], bodies: list[str], rng: np.random.Generator) -> dict:
    """Spring-dampers from the ground to the last body and on each one-axis joint, and one load of every kind."""
    springs = (Spring("s", GROUND, bodies[-1], rng.normal(size=3), rng.normal(scale=0.3, size=3), 12.0, 0.7, 0.4),)
    coordinate = {"revolute": "angle", "prismatic": "distance", "cylindrical": "angle"}
    joint_springs = tuple(
        JointSpring(f"k_{j.name}", j.name, coordinate[j.kind], 3.0, 0.2, 0.1) for j in joints if j.kind in coordinate
    )
    loads = tuple(
        Load(f"{kind}_{frame}", kind, bodies[-1], rng.normal(size=3), frame, rng.normal(scale=0.3, size=3))
        for kind in ("force", "torque")
        for frame in ("world", "body")
    )
    return {"springs": springs, "joint_springs": joint_springs, "loads": loads}


def four_bar(seed: int = 5, closing: str = "revolute") -> Mechanism:
    """Planar four-bar in a skew plane with lumpy bodies; the last joint is of kind `closing`."""
    rng = np.random.default_rng(seed)
    R = rotation(rng)
    corners = [R @ np.array(p) for p in ([0, 0, 0], [0.3, 0.8, 0], [1.6, 1.1, 0], [1.4, 0, 0])]
    bodies = {n: lumpy_body(n, rng) for n in ("crank", "coupler", "rocker")}
    names = [GROUND, "crank", "coupler", "rocker", GROUND]
    joints = [
        drawn_joint(f"j{n}", closing if n == 3 else "revolute", bodies, names[n], names[n + 1], corners[n], R)
        for n in range(4)
    ]
    return Mechanism("four_bar", GRAVITY, tuple(bodies.values()), tuple(joints))


def slider_crank(seed: int = 6) -> Mechanism:
    """Slider-crank in a skew plane with lumpy bodies: three revolutes and a prismatic joint."""
    rng = np.random.default_rng(seed)
    R = rotation(rng)
    corners = [R @ np.array(p) for p in ([0, 0, 0], [0.3, 0.4, 0], [1.3, 0.1, 0])]
    bodies = {n: lumpy_body(n, rng) for n in ("crank", "rod", "slider")}
    along_x = R @ np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    joints = [
        drawn_joint("a", "revolute", bodies, GROUND, "crank", corners[0], R),
        drawn_joint("b", "revolute", bodies, "crank", "rod", corners[1], R),
        drawn_joint("c", "revolute", bodies, "rod", "slider", corners[2], R),
        drawn_joint("d", "prismatic", bodies, GROUND, "slider", corners[2], along_x),
    ]
    return Mechanism("slider_crank", GRAVITY, tuple(bodies.values()), tuple(joints))


def spatial_loop(seed: int = 7, coupler: str = "spherical") -> Mechanism:
    """Spatial loop without dependent rows: revolute, spherical, `coupler`, revolute."""
    rng = np.random.default_rng(seed)
    bodies = {n: lumpy_body(n, rng) for n in ("a", "b", "c")}
    p = [np.array(x) for x in ([0.0, 0, 0], [0.2, 0.5, 0.3], [1.0, 0.7, 0.8], [1.3, -0.2, 0.1])]
    axes = [rotation(rng) for _ in p]
    to = p[2] if coupler != "rod" else None
    if coupler == "rod":  # the coupler body hangs on the first ball joint; the rod connects it to the last body
        end = p[2] + np.array([0.2, 0.1, -0.4])
        z = (end - p[2]) / np.linalg.norm(end - p[2])
        x = np.cross(z, [0, 0, 1.0])
        x /= np.linalg.norm(x)
        axes[2], to = np.column_stack([x, np.cross(z, x), z]), end
    joints = [
        drawn_joint("j0", "revolute", bodies, GROUND, "a", p[0], axes[0]),
        drawn_joint("j1", "spherical", bodies, "a", "b", p[1], axes[1]),
        drawn_joint("j2", coupler, bodies, "b", "c", p[2], axes[2], to),
        drawn_joint("j3", "revolute", bodies, "c", GROUND, p[3], axes[3]),
    ]
    return Mechanism(f"loop_{coupler}", GRAVITY, tuple(bodies.values()), tuple(joints))


def branched(seed: int = 8) -> Mechanism:
    """A tree with branches whose bodies are listed out of order."""
    rng = np.random.default_rng(seed)
    names = ["leaf", "root", "arm", "hand", "tail"]
    bodies = {n: lumpy_body(n, rng) for n in names}
    edges = [
        ("root", "arm", "universal"),
        (GROUND, "root", "free"),
        ("root", "tail", "spherical"),
        ("arm", "hand", "prismatic"),
        ("tail", "leaf", "revolute"),
    ]
    joints = [
        drawn_joint(f"j{n}", kind, bodies, i, j, rng.normal(scale=0.5, size=3), rotation(rng))
        for n, (i, j, kind) in enumerate(edges)
    ]
    return Mechanism("branched", GRAVITY, tuple(bodies.values()), tuple(joints))


def powered(seed: int = 30) -> Mechanism:
    """A chain with every force element that is not constant: actuators, time functions, friction, controls."""
    base = chain("revolute", "prismatic", "cylindrical", "spherical", seed=seed, forces=True)
    wave = sine(2.0, 3.0, 0.4)
    table = through(np.linspace(-1.0, 4.0, 9), [0.3, 1.0, -0.5, 0.2, 0.9, 1.4, 0.1, -0.7, 0.5])
    return replace(
        base,
        name="powered",
        springs=tuple(replace(s, actuator=wave) for s in base.springs),
        joint_springs=tuple(replace(s, actuator=table) for s in base.joint_springs),
        loads=tuple(replace(load, history=Function(np.array([1.0, -0.4, 0.3]))) for load in base.loads),
        frictions=(Friction("f0", "j0", "angle", 0.3, 1.1, 0.2), Friction("f1", "j1", "distance", 0.5, 2.0, 0.4)),
        controls=(
            Control("c0", "j0", "angle", sine(0.5, 2.0), 20.0, 7.0, 1.5),
            Control("c2", "j2", "distance", constant(0.2), 30.0, 4.0, 2.0),
        ),
    )


def hardening(seed: int = 24, backwards: tuple[int, ...] = (1, 2)) -> Mechanism:
    """A chain whose joint springs are polynomials: one that hardens, one that softens, one of a cube alone."""
    base = chain("revolute", "prismatic", "cylindrical", seed=seed, backwards=backwards, forces=True)
    higher = (((2.0, 1.5), (0.3, 0.2)), ((-1.2, -0.4), (0.0, 0.15)), ((0.0, 2.5), (0.4,)))
    springs = (
        replace(s, higher_stiffness=stiffness, higher_damping=damping)
        for s, (stiffness, damping) in zip(base.joint_springs, higher, strict=True)
    )
    first, second, last = springs
    return replace(base, name="hardening", joint_springs=(first, second, replace(last, stiffness=0.0, rest=-0.2)))


def driven(seed: int = 31) -> Mechanism:
    """A chain with two drives: one on an angle and one on a distance."""
    base = chain("revolute", "spherical", "cylindrical", seed=seed)
    drives = (
        Drive("turn", "j0", "angle", Function(np.array([0.2, 1.5]), np.array([[0.3, 4.0, 0.1]]))),
        Drive("push", "j2", "distance", sine(0.2, 5.0)),
    )
    return replace(base, name="driven", drives=drives)


def coupled(seed: int = 32) -> Mechanism:
    """Gear pair, rack and pinion, and a cam with its follower, on three branches."""
    base = chain("revolute", "revolute", "prismatic", "cylindrical", seed=seed)
    profile = through(np.linspace(0.0, 2 * np.pi, 13), 0.2 * np.sin(np.linspace(0.0, 2 * np.pi, 13)) ** 2, True)
    couplings = (
        Coupling("gears", "j0", "angle", "j1", "angle", linear(-2.5, 0.1)),
        Coupling("rack", "j1", "angle", "j2", "distance", linear(0.2)),
        Coupling("cam", "j0", "angle", "j3", "distance", profile),
    )
    return replace(base, name="coupled", couplings=couplings)


def rolling(seed: int = 33, radius: float = 0.4, rounding: float = 0.07) -> Mechanism:
    """A lumpy body that rolls as a torus (disc or ball in the limits) on a skew plane and carries a pendulum."""
    rng = np.random.default_rng(seed)
    base = chain("free", "revolute", seed=seed)
    normal = rotation(rng)[:, 2]
    contact = Rolling(
        "contact", "b0", rng.normal(scale=0.1, size=3), rng.normal(size=3), radius, rng.normal(size=3), normal, rounding
    )
    return replace(base, name="rolling", rollings=(contact,))


def skating(seed: int = 34) -> Mechanism:
    """A body with a knife edge that moves on a skew plane and carries a pendulum."""
    base = chain("planar", "revolute", seed=seed)
    M = base.joints[0].M
    lateral = M.R @ np.array([np.cos(0.3), np.sin(0.3), 0.0])
    return replace(base, name="skating", skates=(Skate("edge", "b0", M.p + M.R @ np.array([0.2, 0.1, 0.0]), lateral),))


TREES = {
    **{f"single_{kind}": chain(kind, seed=n) for n, kind in enumerate(JOINT_KINDS) if kind not in ("rigid", "screw")},
    **{
        f"backward_{kind}": chain("revolute", kind, seed=40 + n, backwards=(1,))
        for n, kind in enumerate(JOINT_KINDS)
        if kind != "screw"
    },
    "rigid_between": chain("revolute", "rigid", "spherical", seed=20),
    "long_chain": chain("revolute", "prismatic", "spherical", "revolute", "universal", seed=21),
    "floating_chain": chain("free", "cylindrical", "planar", "revolute", seed=22),
    "forced_chain": chain("revolute", "prismatic", "spherical", "cylindrical", seed=23, forces=True),
    "hardening_chain": hardening(),
    "branched": branched(),
}

LOOPS = {
    "four_bar": four_bar(),
    "slider_crank": slider_crank(),
    "four_bar_spherical": four_bar(closing="spherical"),
    "four_bar_cylindrical": four_bar(closing="cylindrical"),
    **{f"loop_{kind}": spatial_loop(coupler=kind) for kind in ("spherical", "universal", "rod")},
}

ELEMENTS = {
    "single_screw": chain("screw", seed=35),
    "backward_screw": chain("revolute", "screw", seed=36, backwards=(1,)),
    "powered": powered(),
    "driven": driven(),
    "coupled": coupled(),
    "rolling_torus": rolling(),
    "rolling_disc": rolling(seed=37, rounding=0.0),
    "rolling_ball": rolling(seed=38, radius=0.0, rounding=0.5),
    "skating": skating(),
}
"""Screws and elements beyond constant forces: what the reference represents and an engine may refuse."""


def states_of(mechanism: Mechanism, count: int = 5, seed: int = 3) -> list[State]:
    """Consistent random states; assembled once, because many tests ask for those of the same mechanism."""
    return list(_states(mechanism, count, seed))


@lru_cache(maxsize=1024)
def _states(mechanism: Mechanism, count: int, seed: int) -> tuple[State, ...]:
    return tuple(random_states(mechanism, initial_state(mechanism), count, seed))
