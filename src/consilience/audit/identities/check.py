"""The table of identities, and the check of engines, cases and methods against the table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from consilience.audit.identities import contact, dynamics
from consilience.audit.identities.asking import Ask, Asker
from consilience.audit.identities.contact_motion import measure_contact_motion
from consilience.audit.identities.invariance import INVARIANCES
from consilience.audit.identities.motion import SAMPLES, measure_drift
from consilience.audit.identities.result import (
    Finding,
    IdentityOutcome,
    NotApplicableError,
    Residual,
    UnansweredError,
    worst,
)
from consilience.audit.identities.subject import IdentitySubject
from consilience.case import Case
from consilience.engine import EngineInfo, Method, Profile, Question
from consilience.engine.worker.client import Request, Worker, in_parallel
from consilience.mechanism import Mechanism

Measure = Callable[[IdentitySubject], Iterable[Residual]]

_Measured = Residual | NotApplicableError | UnansweredError


@dataclass(frozen=True)
class Identity:
    """An equation that the answers of every sound engine satisfy.

    Attributes
    ----------
    name : str
    shows : str
        Errors that violate the identity.
    measure : callable or None
        Residuals over the states of a subject; None of an identity along a motion.
    """

    name: str
    shows: str
    measure: Measure | None


IDENTITIES: tuple[Identity, ...] = (
    Identity(
        "forward after inverse",
        "inertia, centre of mass, frames, forces, accelerations of another point",
        dynamics.forward_after_inverse,
    ),
    Identity("mobility symmetric", "terms that depend on the order of elimination, stale parts", dynamics.symmetry),
    Identity("mobility positive", "signs of inertia or loads", dynamics.positivity),
    Identity("mobility inverse of the mass matrix", "armature, inertia, mass, frames of loads", dynamics.inverse_mass),
    Identity("linear in the loads", "saturation, friction and limits nobody asked for", dynamics.linearity),
    Identity("power balance", "gravity, springs, damping nobody asked for", dynamics.power),
    Identity("energy balance", "the engine's account of its energies", dynamics.energy),
    Identity("momentum", "outer forces, reactions of the ground", dynamics.momentum),
    Identity("balance of each body", "sign, frame or point of reactions, gyroscopic terms", dynamics.balance),
    Identity(
        "constraints on accelerations", "ignored or softened constraints, stabilisation left on", dynamics.constraint
    ),
    *(Identity(name, "words that change the physics", measure) for name, measure in INVARIANCES.items()),
    Identity("constraints on positions", "drift that smaller steps do not cure", None),
    Identity("constraints on velocities", "drift that smaller steps do not cure", None),
)

CONTACT_IDENTITIES: tuple[Identity, ...] = (
    Identity("no pull", "contacts that hold, normals of the wrong body, signs of forces", contact.no_pull),
    Identity("friction cone", "another coefficient, another cone, tangents turned", contact.friction_cone),
    Identity("friction against slip", "signs and directions of friction", contact.friction_against_slip),
    Identity("gap times force", "forces across gaps, margins, contacts that are missed", contact.complementarity),
    Identity("no overlap", "shapes that sink into one another at any step", None),
    Identity("no power of the normal force", "normals that are not those of the surface, creep into it", None),
    Identity("impulses within the cone", "contacts that hold, another coefficient, another cone", None),
    Identity("energy never grows", "impacts and penetration that feed energy, restitution above one", None),
)
"""Identities of mechanisms with contacts, stops or dry friction; `IDENTITIES` are equations of smooth motion."""


def identities_of(mechanism: Mechanism) -> tuple[Identity, ...]:
    """Return the identities of a mechanism."""
    touches = mechanism.contacts or mechanism.stops or mechanism.dry_frictions
    return CONTACT_IDENTITIES if touches else IDENTITIES


ALONG_A_MOTION = tuple(i.name for i in (*IDENTITIES, *CONTACT_IDENTITIES) if i.measure is None)


@dataclass
class Checks:
    """Findings of all engines.

    Attributes
    ----------
    missing : dict
        Reason by engine that does not start.
    """

    engines: dict[str, EngineInfo] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)


def check_engines(
    cases: Sequence[Case],
    engines: Sequence[str],
    states: int = 3,
    jobs: int = 2,
    limit: float = 180.0,
    progress: Callable[[str, str], None] | None = None,
) -> Checks:
    """Check every engine on every case, each engine in a worker of its own.

    Parameters
    ----------
    cases : sequence of Case
    engines : sequence of str
        Names of installed engines or variants.
    states : int
        Number of states of the question `instant`.
    jobs : int
        Number of engines that run at a time.
    limit : float, s
        Time limit of one request to a worker.
    progress : callable, optional
        Called with the names of engine and case after each case.
    """
    for case in cases:
        _ = case.states  # assembled before any worker starts: a failure is bad input

    def work(worker: Worker) -> tuple[EngineInfo | str, list[Finding]]:
        """Check one engine on all cases; return its description, or why there is none, and the findings."""
        with worker:
            info = worker.ask(Request()).info
            found: list[Finding] = []
            for case in cases if isinstance(info, EngineInfo) else ():
                found += check_case(worker.ask, worker.engine, case, states)
                if progress is not None:
                    progress(worker.engine, case.name)
        return info, found

    checks = Checks()
    results = in_parallel(work, [Worker(name, limit) for name in engines], jobs)
    for name, (info, found) in zip(engines, results, strict=True):
        if isinstance(info, EngineInfo):
            checks.engines[name] = info
            checks.findings += found
        else:
            checks.missing[name] = info
    return checks


def check_case(ask: Ask, engine: str, case: Case, states: int) -> list[Finding]:
    """Check all identities for all methods of one engine on one case."""
    asker, identities = Asker(ask), identities_of(case.mechanism)
    measures = {i.name: i.measure for i in identities if i.measure is not None}
    along = tuple(i.name for i in identities if i.measure is None)
    along_motion = measure_drift if identities is IDENTITIES else measure_contact_motion

    def at_instants(method: Method) -> list[_Measured]:
        subject = IdentitySubject(case.mechanism, case.states[:states], asker, method)
        return [_measured(measure, subject) for measure in measures.values()]

    def along_a_motion(method: Method) -> Sequence[_Measured]:
        try:
            return along_motion(asker, case.mechanism, case.initial_state, case.times[: SAMPLES + 1], method)
        except (NotApplicableError, UnansweredError) as reason:
            return [reason] * len(along)

    found = []
    for question, names, measured in (
        (Question.INSTANT, tuple(measures), at_instants),
        (Question.TRAJECTORY, along, along_a_motion),
    ):
        context = _FindingContext(case.name, engine, question)
        try:
            methods = asker.methods(case.mechanism, question)
        except (NotApplicableError, UnansweredError) as reason:
            found += [context.finding(name, None, reason) for name in names]
            continue
        for method in methods:
            pairs = zip(names, measured(method), strict=True)
            found += [context.finding(name, method, residual) for name, residual in pairs]
    return found


def _measured(measure: Measure, subject: IdentitySubject) -> _Measured:
    try:
        found = list(measure(subject))
    except (NotApplicableError, UnansweredError) as reason:
        return reason
    return worst(found) if found else NotApplicableError("no state has what the identity is about")


@dataclass(frozen=True)
class _FindingContext:
    """Common fields of all findings about one question."""

    case: str
    engine: str
    question: Question

    def finding(self, identity: str, method: Method | None, found: _Measured) -> Finding:
        """Return the finding of one identity and one method."""
        name, route = (method.name, method.route) if method else ("", None)
        profile = method.profile if method else Profile.MATCHED
        common = (self.case, self.engine, self.question, name, route, profile, identity)
        if isinstance(found, Residual):
            outcome = IdentityOutcome.HOLDS if found.ratio <= 1.0 else IdentityOutcome.VIOLATED
            return Finding(*common, outcome, found.value, found.bar, found.remark)
        unanswered = isinstance(found, UnansweredError)
        outcome = IdentityOutcome.NO_ANSWER if unanswered else IdentityOutcome.NOT_APPLICABLE
        return Finding(*common, outcome, remark=str(found))
