"""Random mechanisms of a fuzzing campaign: the sorts, their shares, and the case of a seed.

A mechanism is drawn, written as a case file and read again before engines are asked, so that the file reproduces the
mechanism to the last bit.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from consilience.audit.random_contacts import random_contacts
from consilience.audit.random_mechanisms import MOST_BODIES, Recipe, random_mechanism
from consilience.case import Case
from consilience.case.file.reader import cases_from_tables
from consilience.case.file.writer import case_text
from consilience.mechanism import (
    JOINT_KINDS,
    Cone,
    DiscPlane,
    Initial,
    Mechanism,
    State,
    drawing_state,
    free_directions,
    initial_state,
    random_states,
)

COMMON = tuple(kind for kind in JOINT_KINDS if kind != "screw")
"""Joint kinds with a chain of elementary joints, which every adapter translates."""

STATES = 2
"""States of a case: the drawn pose in motion, and a second pose."""

MOTION, CONTACT_MOTION = (1.0, 0.05), (0.2, 0.04)
"""Duration of a motion and time between samples, s, without and with contacts, whose motions campaigns ask for."""

SPEED = 2.0
"""Standard deviation of the velocity components along the free directions, m/s and rad/s."""

COMMON_LAWS = 0.8
"""Share of mechanisms with contacts whose laws and shapes most adapters translate: circles of friction, no rebound."""

Draw = Callable[[np.random.Generator], Mechanism]


@dataclass(frozen=True)
class Sort:
    """A sort of mechanisms: its share, and the function that draws one."""

    share: float
    draw: Draw


def _seed(rng: np.random.Generator) -> int:
    return int(rng.integers(2**32))


def _bodies(rng: np.random.Generator, least: int = 1, most: int = MOST_BODIES) -> int:
    return int(rng.integers(least, most + 1))


def _common(rng: np.random.Generator) -> Mechanism:
    return random_mechanism(_seed(rng), _bodies(rng), Recipe(COMMON, plain=True))


def _with_all_elements(rng: np.random.Generator) -> Mechanism:
    seed = _seed(rng)
    return with_nonlinear_springs(random_mechanism(seed, _bodies(rng), Recipe(plain=False)), seed)


def with_nonlinear_springs(mechanism: Mechanism, seed: int, share: float = 0.3) -> Mechanism:
    """Give a share of the joint springs coefficients of higher degree, at random; large angles harden the springs."""
    rng, springs = np.random.default_rng([seed, 2]), []
    for spring in mechanism.joint_springs:
        k1, k2, c1, c2 = rng.normal(), rng.uniform(0.1, 1.0), rng.uniform(0.0, 0.5), rng.uniform(0.0, 0.2)
        higher = replace(spring, higher_stiffness=(k1, k2), higher_damping=(c1, c2))
        springs.append(higher if rng.random() < share else spring)
    return replace(mechanism, joint_springs=tuple(springs))


def _of_unequal_masses(rng: np.random.Generator) -> Mechanism:
    """Draw masses over two to six decades; bodies keep their radii of gyration."""
    mechanism = _common(rng)
    scales = 10.0 ** (rng.uniform(2.0, 6.0) * rng.uniform(-0.5, 0.5, size=len(mechanism.bodies)))
    bodies = tuple(
        replace(body, mass=float(scale * body.mass), inertia=scale * body.inertia)
        for body, scale in zip(mechanism.bodies, scales, strict=True)
    )
    return replace(mechanism, bodies=bodies)


def _near_singular(rng: np.random.Generator) -> Mechanism:
    """Draw flat linkages near a singular pose: the least singular value is at least 1e-6 of the largest."""
    recipe = Recipe(COMMON, plain=True, linkages=0.8, flat=10.0 ** rng.uniform(-2.5, -0.5))
    return random_mechanism(_seed(rng), _bodies(rng, 3, 7), recipe)


def _long_chain(rng: np.random.Generator) -> Mechanism:
    """Draw chains of 13 to 100 bodies without free joints, uniform in the logarithm of the length."""
    kinds = tuple(kind for kind in COMMON if kind != "free")
    bodies = round(np.exp(rng.uniform(np.log(MOST_BODIES + 1), np.log(100))))
    return random_mechanism(_seed(rng), bodies, Recipe(kinds, plain=True, chain=True, linkages=0.0))


SORTS: dict[str, Sort] = {
    "common": Sort(0.4, _common),
    "all elements": Sort(0.15, _with_all_elements),
    "unequal masses": Sort(0.2, _of_unequal_masses),
    "near singular": Sort(0.2, _near_singular),
    "long chain": Sort(0.05, _long_chain),
}
"""Sorts of mechanisms. All but "all elements" have springs, joint springs and constant loads as their only elements."""


CONTACTS = "contacts"
"""Sort of mechanisms with contacts, stops and dry friction, which a campaign draws alone."""


@dataclass(frozen=True, eq=False)
class Specimen:
    """A random mechanism as a case.

    Attributes
    ----------
    seed : int
    sort : str
        Key of `SORTS`, or `CONTACTS`.
    case : Case
    text : str
        Text of the case file.
    """

    seed: int
    sort: str
    case: Case
    text: str


def specimen(seed: int, contacts: bool = False) -> Specimen:
    """Draw the specimen of a seed, of `SORTS` or with contacts."""
    rng, name = np.random.default_rng([seed, 1]), f"fuzz_{seed}"
    if contacts:
        drawn = random_contacts(seed)[0]
        sort, mechanism = CONTACTS, replace(_common_laws(drawn) if rng.random() < COMMON_LAWS else drawn, name=name)
        initial = _sliding(mechanism, seed)
    else:
        sort = str(rng.choice(list(SORTS), p=[s.share for s in SORTS.values()]))
        mechanism = replace(SORTS[sort].draw(rng), name=name)
        initial = in_motion(mechanism, rng)
    duration, sample = CONTACT_MOTION if contacts else MOTION
    case = Case(
        name=mechanism.name,
        file=f"{mechanism.name}.toml",
        title=f"Random mechanism {seed}, {sort}",
        mechanism=mechanism,
        initial=initial,
        duration=duration,
        sample=sample,
        digits=6,
        instants=STATES,
        seed=seed,
        sources=(replay(seed, sort),),
        tags=(sort,),
    )
    text = case_text(case)
    return Specimen(seed, sort, read_text(text, name), text)


def replay(seed: int, sort: str) -> str:
    """Return the command that fuzzes the mechanism of a seed again."""
    return f"consilience fuzz --seed {seed} --mechanisms 1{' --contacts' if sort == CONTACTS else ''}"


def in_motion(mechanism: Mechanism, rng: np.random.Generator) -> Initial:
    """Draw random velocities along the free directions; assembly projects them onto the constraints."""
    free = free_directions(mechanism, drawing_state(mechanism))
    # a projection is the same for every basis of the null space; which basis an SVD returns depends on the machine
    velocity = (free @ (free.T @ rng.normal(scale=SPEED, size=len(free)))).reshape(-1, 6)
    return Initial(velocities={b.name: (v[:3], v[3:]) for b, v in zip(mechanism.bodies, velocity, strict=True)})


def _common_laws(mechanism: Mechanism) -> Mechanism:
    """Give all contacts and stops common laws, and leave out discs unless there is nothing else."""
    common: dict[str, Any] = {"restitution": 0.0, "cone": Cone(), "torsional": 0.0, "rolling": 0.0, "compliance": None}
    kept = [c for c in mechanism.contacts if not isinstance(c, DiscPlane)] or mechanism.contacts
    stops = tuple(replace(stop, restitution=0.0) for stop in mechanism.stops)
    return replace(mechanism, contacts=tuple(replace(c, **common) for c in kept), stops=stops)


def _sliding(mechanism: Mechanism, seed: int) -> Initial:
    """Draw random velocities with which closed contacts neither approach nor part: an impact has no accelerations."""
    start: State = initial_state(mechanism)
    (state,) = random_states(mechanism, start, 1, seed, SPEED)
    moving = zip(mechanism.bodies, state.v_WB_W, state.w_WB_W, strict=True)
    return Initial(velocities={body.name: (v, w) for body, v, w in moving})


def read_text(text: str, name: str) -> Case:
    """Read a case from the text of a case file.

    Raises
    ------
    InvalidInput
        If the text is no valid case file.
    """
    (case,) = cases_from_tables(name, f"{name}.toml", tomllib.loads(text))
    return case
