"""Answers of the reference about mechanisms with the laws of contact that the methods of an engine solve."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from typing import Any

from consilience.case import Case
from consilience.compare.judge import REFERENCE
from consilience.compare.other_laws import hardened
from consilience.engine import Question, Run, Status
from consilience.engine.worker.client import EngineHandle
from consilience.engine.worker.requests import Plan, Request
from consilience.mechanism import LAWS_OF_IMPACT, Contact, ContactLaw, Mechanism, SurfaceLaw
from consilience.suite.engine_runs import EngineCase, levels_of
from consilience.suite.store import Store


def with_law(mechanism: Mechanism, law: ContactLaw) -> Mechanism:
    """Return the mechanism with another law: a cone where there is friction, of impact where shapes are rigid."""
    given: dict[str, Any] = {field.name: getattr(law, field.name) for field in fields(law)}
    given = {name: value for name, value in given.items() if value is not None}
    given.pop("regularisation", None)  # of the method, in place of rigid contacts
    of_friction = {name: given.pop(name) for name in ("cone", "associated", "impact_law") if name in given}
    none = {name: getattr(SurfaceLaw, name) for name in LAWS_OF_IMPACT}

    def laws(contact: Contact) -> dict[str, Any]:
        soft = contact.compliance is not None or "compliance" in given
        return given | (of_friction if contact.friction > 0.0 else {}) | (none if soft else {})

    return replace(mechanism, contacts=tuple(replace(c, **laws(c)) for c in mechanism.contacts))


def laws_to_solve(runs: Sequence[Run]) -> list[tuple[Question, ContactLaw]]:
    """Return the laws of contact that methods with answers declare, with their questions, each once.

    Those of soft contacts count where the softness was varied, without which no verdict depends on them. A compliance
    is asked about far harder, too.
    """
    levels = [run for run in runs if not run.coprime]
    answered = [run for run in levels if run.status is Status.ANSWERED and run.method is not None]
    asked: list[tuple[Question, ContactLaw]] = []
    for run in answered:
        assert run.method is not None
        soft = None if run.method.softness in (None, 1.0) else run.method.soft_law
        for law in (run.method.law, hardened(run.method.law), soft):
            if law is not None and run.question is not Question.MODEL and (run.question, law) not in asked:
                asked.append((run.question, law))
    return asked


def runs_under_other_laws(
    reference: EngineHandle, case: Case, runs: Sequence[Run], store: Store | None = None
) -> Iterator[Run]:
    """Ask the reference again with each law of contact that a method of an engine declares.

    Parameters
    ----------
    reference : EngineHandle
    case : Case
    runs : sequence of Run
        Answered and other runs of the engine.
    store : Store, optional
        Store of answers.
    """
    asked = laws_to_solve(runs)
    plan = reference.ask(Request(case.mechanism)).value if asked else None
    if not isinstance(plan, Plan):
        return
    for question, law in asked:
        if not plan.methods.get(question):  # the case is none of the reference's
            continue
        method = replace(plan.methods[question][0], law=law)
        subject = with_law(case.mechanism, law), case.states if question.at_states else [case.initial_state]
        levels = levels_of(case, question, method)
        run = EngineCase(reference, case, plan, store=store).once(
            question, method, len(levels) - 1, levels[-1], subject
        )
        if run.status is Status.ANSWERED:
            yield replace(run, engine=REFERENCE)
