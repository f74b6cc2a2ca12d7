"""Methods for mechanisms with contacts, stops or dry friction, and what MuJoCo cannot represent of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from consilience.engine import Method, Profile, Question, Route, Unsupported
from consilience.mechanism import GROUND, Cone, ContactLaw, Mechanism, SphereSphere
from consilience_mujoco.contact_instant import HARD, SOFT
from consilience_mujoco.contact_motion import BOUNCE, BOUNCE_OF_STOPS, RELAXATION
from consilience_mujoco.contacts import IMPEDANCE, bounds
from consilience_mujoco.methods import DEFAULT_STEPS, INVWEIGHT_SCALE, OPTIONS, hard, iterations
from consilience_mujoco.rebound_law import rebound_law
from consilience_mujoco.rows import Equalities

CONTACT_FEATURES = (
    "sphere on plane contact, point on plane contact, sphere on sphere contact, box on plane contact, "
    "capsule on plane contact, moving plane contact, contact friction, contact restitution, stop, stop restitution, "
    "dry friction"
)
"""Features of contacts, stops and dry friction that the adapter translates."""

REASONS = {
    "disc on plane contact": "MuJoCo has no rim, and a thin cylinder has two, with up to four contacts on them",
    "rebound threshold": "MuJoCo's spring and damper have no speed below which nothing rebounds",
    "static friction": "MuJoCo has one coefficient for sticking and sliding",
    "pyramid cone": "MuJoCo's pyramid has axes of its own and lifts what slides: it is left to the profile default",
    "box cone": "MuJoCo has an elliptic and a pyramidal cone, no box",
    "associated cone": "MuJoCo's cones are associated, but soft: sliding lifts to a height, not for ever",
    "Moreau impact": "MuJoCo has a spring and a damper, no law of impact",
    "Poisson impact": "MuJoCo has a spring and a damper, no law of impact",
    "torsional friction": "MuJoCo's cone joins it with sliding friction in one ellipsoid",
    "rolling friction": "MuJoCo's cone joins it with sliding friction in one ellipsoid",
    "compliant contact": "the adapter gives all contacts the gains that lead to rigid ones",
    "dry friction of a reaction": "MuJoCo's frictionloss has a constant bound",
}
"""Features of contacts, stops and dry friction that MuJoCo cannot represent, and why."""

STEPS, BOUNCING_STEPS, EXTRAPOLATED_STEPS = (50, 100, 200), (500, 1000, 2000), (5, 10, 20)
BOUNCING_LOOP_STEPS = (200, 400, 800)
"""Steps of what bounces and is held by welds, whose iterations and ranks make a step ten times as long."""

HALVINGS = 4
"""Number of motions of an extrapolated one, each with half the step of the one before; its order."""
_ONLY_EQUALITIES = ["LIMIT", "FRICTIONLOSS"]
_IMPEDANCES = [IMPEDANCE, IMPEDANCE, 0.001, 0.5, 2.0]
_RATIO = 1e16
"""impratio of a motion: regularisation of the normal direction over that of friction, which is then 1e-4 of the inverse
inertia."""

_LINE_SEARCH = 200
"""Iterations of the line search: by the default of 50, dry friction that sticks creeps at 1e-8."""

_NEWTON: dict[str, Any] = {"opt.solver": "NEWTON", "opt.tolerance": 0.0, "opt.ls_iterations": _LINE_SEARCH}
"""Newton's method. At an instant always: by CG contacts that open beside loops never converge."""

_NEWTON_STEPS = 50
"""Iterations of MuJoCo's Newton solver."""

_NEWTON_SCALE = 1e-5
"""Factor on inverse inertias of drives and couplings beside friction, and of all constraints at an instant: by 2e-11
Newton's method loses their forces."""

_NEWTON_WELDS = 1e-7
"""Factor on those of welds beside friction in a motion: by 1e-9 Newton's method stops at 1e-5 of the forces of a
slider-crank, and CG does at any."""

_REBOUND = "a spring and a damper of the same rebound; rigid as their softness vanishes"
_CIRCLE = "circle; rigid and Coulomb's in the limit of small steps"
_PYRAMID = (
    "pyramid of 4 facets, inscribed, associated and soft; the first tangent is the projection of the world's y, or of "
    "its z where |n_y| >= 0.5"
)
_ELLIPTIC = "circle, associated and soft: sliding lifts"


def refused(mechanism: Mechanism) -> Iterator[Unsupported]:
    """Return the contacts and stops whose laws together MuJoCo cannot represent."""
    for contact in mechanism.contacts:
        if contact.restitution > 0.0 and contact.friction > 0.0:
            reason = "the rebound of MuJoCo's spring and damper depends on friction and on the masses: another law"
            yield Unsupported(f"contact '{contact.name}': restitution with friction", reason)
    for stop in mechanism.stops:
        others = [s for s in mechanism.stops if (s.joint, s.coordinate) == (stop.joint, stop.coordinate)]
        if any(other.restitution != stop.restitution for other in others):
            reason = "MuJoCo has one law for both limits of a joint"
            yield Unsupported(f"stop '{stop.name}': restitution unlike that of the other limit", reason)
        low, high = bounds(mechanism, stop.joint, stop.coordinate)
        if low >= high:
            yield Unsupported(f"stop '{stop.name}': {low:g} above {high:g}", "a limit of MuJoCo has a lower end first")


def _settings(mechanism: Mechanism, equalities: Equalities) -> dict[str, Any]:
    flags = [flag for flag in OPTIONS["opt.disableflags"] if flag != "CONTACT"]
    held = equalities.welds + equalities.joints + equalities.guides
    settings = OPTIONS | {"opt.disableflags": flags} | (hard(equalities) if held else {})
    if by_newton(mechanism, equalities):
        settings |= _NEWTON
    if mechanism.contacts:
        settings |= {"opt.cone": "ELLIPTIC", "pair_solimp": _IMPEDANCES}
    if mechanism.stops:
        settings |= {"jnt_solimp": _IMPEDANCES}
    if mechanism.dry_frictions:
        settings |= {"dof_solimp": _IMPEDANCES}
    if mechanism.stops or mechanism.dry_frictions:
        settings |= {"dof_invweight0, factor": HARD}
    if held and by_newton(mechanism, equalities):
        factors = ("dof_invweight0, factor", "tendon_invweight0, factor")
        settings |= {name: _NEWTON_SCALE for name in factors if name in settings}
        settings |= {"body_invweight0, factor": _NEWTON_WELDS} if equalities.welds else {}
    elif equalities.joints:
        settings |= {"dof_invweight0, factor": INVWEIGHT_SCALE}
    return settings


def by_newton(mechanism: Mechanism, equalities: Equalities) -> bool:
    """Whether MuJoCo solves by Newton's method: CG stops early beside friction, Newton's loses the forces of welds."""
    return _rough(mechanism) or not (equalities.welds or equalities.joints or equalities.guides)


def _rough(mechanism: Mechanism) -> bool:
    """Whether anything can slide with friction."""
    return bool(mechanism.dry_frictions) or any(contact.friction > 0.0 for contact in mechanism.contacts)


def _model(settings: dict[str, Any], law: str) -> Method:
    off = {"opt.disableflags": [*OPTIONS["opt.disableflags"], *_ONLY_EQUALITIES]}
    return Method("mj_forward", Route.TUNED, settings=settings | off, contact_law=law)


def _instant(settings: dict[str, Any], law: str) -> Method:
    settings = settings | {name: _NEWTON_SCALE for name in settings if name.endswith(", factor")} | _NEWTON
    settings = settings | {
        "opt.iterations": _NEWTON_STEPS,
        "pair_margin, jnt_margin": "positive for what is closed",
        "body_invweight0 of contacts": f"times {HARD:g} where they stick, {SOFT:g} where they slide",
        "mjcb_control": "efc_aref",
    }
    return Method("mj_forward", Route.TUNED, settings=settings, contact_law=law)


def _gains(mechanism: Mechanism, restitution: bool) -> dict[str, Any]:
    """Describe the gains of a motion."""
    follow = f"friction 1/h, others 0.6/h with a relaxation in {RELAXATION:g} sample intervals, 1 of stops"
    stiffness = f"stiffness {BOUNCE:g} 1/s^2 over the inertia, {BOUNCE_OF_STOPS:g} of stops"
    bounce = f"; with restitution {stiffness}, damping by the restitution"
    text = follow + (bounce if restitution else "")
    found = {"pair_solref, pair_solreffriction": text} if mechanism.contacts else {}
    found |= {"jnt_solref": text} if mechanism.stops else {}
    return found | ({"dof_solref": text} if mechanism.dry_frictions else {})


def _motions(mechanism: Mechanism, settings: dict[str, Any], equalities: Equalities, law: str) -> Iterator[Method]:
    """Return the methods for a motion."""
    quick = {"opt.tolerance": 1e-20, "opt.iterations": _NEWTON_STEPS}
    solver = {"opt.iterations": iterations(equalities)} if settings["opt.solver"] == "CG" else quick
    bounces = any(element.restitution > 0.0 for element in (*mechanism.contacts, *mechanism.stops))
    settings = settings | solver | {"opt.integrator": "RK4"} | _gains(mechanism, bounces)
    if mechanism.contacts:
        settings |= {"opt.impratio": _RATIO, "pair_margin": "the overlap under the normal force at the start"}
    bouncing = BOUNCING_LOOP_STEPS if equalities.welds else BOUNCING_STEPS
    steps, softness = bouncing if bounces else STEPS, 1.0 if bounces or equalities.welds else None
    solved = rebound_law(mechanism)
    named = _REBOUND if solved is not None else law
    yield Method("RK4", Route.TUNED, 1, steps, settings=settings, softness=softness, contact_law=named, law=solved)
    if mechanism.contacts and not bounces:
        yield Method(
            "RK4, extrapolated in step and gains",
            Route.EXTRAPOLATED,
            HALVINGS,
            EXTRAPOLATED_STEPS,
            settings=settings,
            contact_law=law,
        )
    yield from _defaults(mechanism)


def _defaults(mechanism: Mechanism) -> Iterator[Method]:
    """Return the methods for a motion at MuJoCo's own settings."""
    rough = any(contact.friction > 0.0 for contact in mechanism.contacts)
    at_rest = bool(mechanism.contacts or mechanism.stops)
    plain = Method(
        "Euler, defaults", Route.NATIVE, 1, DEFAULT_STEPS, profile=Profile.DEFAULT, softness=1.0, soft_at_rest=at_rest
    )
    if not rough:
        yield plain
        return
    yield replace(plain, contact_law=_PYRAMID, law=pyramid(mechanism))
    yield replace(plain, name="Euler, defaults but elliptic", settings={"opt.cone": "ELLIPTIC"}, contact_law=_ELLIPTIC)


def pyramid(mechanism: Mechanism) -> ContactLaw | None:
    """Return MuJoCo's pyramid as a law; None where its axes are not the same in all contacts with friction."""
    rough = [contact for contact in mechanism.contacts if contact.friction > 0.0]
    axes = set()
    for contact in rough:
        if isinstance(contact, SphereSphere) or contact.partner != GROUND:
            return None
        axes.add((0.0, 1.0, 0.0) if abs(contact.normal[1]) < 0.5 else (0.0, 0.0, 1.0))
    return ContactLaw(cone=Cone("pyramid", 4, tangent=axes.pop())) if len(axes) == 1 else None


def unilateral_methods(mechanism: Mechanism, question: Question, equalities: Equalities) -> tuple[Method, ...]:
    """Return the methods for a question about a mechanism with contacts, stops or dry friction, the headline first."""
    settings = _settings(mechanism, equalities)
    law = _CIRCLE if mechanism.contacts else ""
    if question is Question.MODEL:
        return (_model(settings, law),)
    if question is Question.INSTANT:
        return (_instant(settings, law),)
    return tuple(_motions(mechanism, settings, equalities, law))
