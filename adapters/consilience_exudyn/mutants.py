"""Mutants of this adapter, for `consilience mutate`: known errors of users and adapters of Exudyn.

Only the campaign imports this module; the vocabulary of `consilience.audit.mutate` stays out of the adapter itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from consilience.audit.mutate import (
    CONTACTS,
    FINE,
    FRACTION,
    MOTION,
    WHOLE,
    Mutant,
    Planting,
    contact_mutants,
    decades,
    inside,
    preconditions,
    replaced,
    wrapped,
)
from consilience.engine import Engine, Question
from consilience.mechanism import skew
from consilience_exudyn import engine, maximal

M, I, T = Question.MODEL, Question.INSTANT, Question.TRAJECTORY

SOLVER = "pointwise"


def _about_the_centre(original: Any, magnitude: float, body: Any) -> Any:
    right = original(body)
    return right + magnitude * (body.inertia - right)


def _order(original: Any, magnitude: float, inertia: Any) -> Any:
    xx, yy, zz, yz, xz, xy = original(inertia)
    return [xx, yy, zz, yz + magnitude * (xy - yz), xz, xy + magnitude * (yz - xy)]


def _tree_about_origin(original: Any, magnitude: float, mechanism: Any) -> Any:
    tree = original(mechanism)
    links = []
    for link in tree.links:
        S = skew(link.com)
        links.append(replace(link, inertia=link.inertia - magnitude * link.mass * S @ S))
    return replace(tree, links=tuple(links))


@contextmanager
def _redundant_rows(planted: Engine, magnitude: float) -> Iterator[Engine]:
    """Keep every row of every joint, dependent or not, at any magnitude."""
    del magnitude
    with replaced(engine, "independent_axes", lambda _: maximal.full_axes):
        yield planted


def _integration(of: Callable[[float], Any], *knobs: str) -> Planting:
    """Change settings of ``timeIntegration`` with which a trajectory runs."""

    def change(original: Any, magnitude: float, settings: Any) -> Any:
        return original({**settings, **{f"timeIntegration.{knob}": of(magnitude) for knob in knobs}})

    return inside(("trajectory", "simulation_settings", wrapped(change)))


def _default_steps(original: Any, magnitude: float, system: Any, integration: Any, times: Any, step: float) -> Any:
    """Take a hundred steps for the whole run, whatever the step.

    Parameters
    ----------
    original : callable
        Function of the adapter, of the parameters after `magnitude`.
    magnitude : float
        Not used.
    system, integration, times, step
        As in `trajectory.solve`.
    """
    del magnitude, step
    return original(system, integration, times, (times[-1] - times[0]) / 100.0)


MUTANTS = (
    Mutant(3, "inertia about the centre", "ObjectRigidBody takes the tensor about its origin", FINE, FRACTION, M,
           inside(("maximal", "inertia_about_origin", wrapped(_about_the_centre)))),
    Mutant(3, "order of the products", "xy and yz exchanged in the vector of six", FINE, FRACTION, M,
           inside(("maximal", "inertia_vector", wrapped(_order)))),
    Mutant(3, "KinematicTree about the origin", "inertia of links about their origin", MOTION, FRACTION, T,
           inside(("kinematic_tree", "to_elementary_tree", wrapped(_tree_about_origin))), preconditions.tree,
           methods="KinematicTree"),
    Mutant(20, "redundant rows", "every row of every joint given to Exudyn's integrators", WHOLE, "", T,
           _redundant_rows, preconditions.redundant, methods="TrapezoidalIndex2"),
    Mutant(21, "loose Newton iteration", "its tolerances", decades(0, -10, 2), "", T,
           _integration(float, "newton.relativeTolerance", "newton.absoluteTolerance"), methods="GeneralizedAlpha"),
    Mutant(21, "steps by default", "hundred for the whole run, whatever step was asked", WHOLE, "", T,
           inside(("trajectory", "solve", wrapped(_default_steps))), methods="GeneralizedAlpha"),
    Mutant(21, "adaptive step", "on, as it is by default: steps are halved where Newton's iteration fails, here never",
           WHOLE, "", T, _integration(lambda e: True, "adaptiveStep"), methods="GeneralizedAlpha", harmless=True),
    Mutant(21, "spectral radius", "one minus this; 0.9 is the default, every one is of order two", (0.5, 0.2), "", T,
           _integration(lambda e: 1.0 - e, "generalizedAlpha.spectralRadius"), methods="GeneralizedAlpha",
           harmless=True),
    Mutant(21, "initial accelerations", "not computed: the integration starts from zero", WHOLE, "", T,
           _integration(lambda e: False, "generalizedAlpha.computeInitialAccelerations"), methods="GeneralizedAlpha"),
)  # fmt: skip


def _hunt_crossley(original: Any, magnitude: float, restitution: float) -> Any:
    del magnitude
    law = original(restitution)
    return law | {"impactModel": 1} if law["impactModel"] else law


CONTACT_MUTANTS = (
    *contact_mutants("Exudyn"),
    Mutant(CONTACTS, "Hunt and Crossley's restitution", "impactModel 1", WHOLE, "", T,
           inside(("contacts", "_impact", wrapped(_hunt_crossley)))),
)  # fmt: skip
"""Errors in contacts, which `tests/conformance/test_contact_exudyn.py` plants, too."""
