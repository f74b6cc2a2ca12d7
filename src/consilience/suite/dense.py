"""One motion of a case by a chosen method at its finest level, and at samples close enough to draw."""

from __future__ import annotations

import math
from dataclasses import replace

from consilience.case import Case
from consilience.engine import EngineInfo, Profile, Question, Run, Status
from consilience.engine.worker.client import EngineHandle
from consilience.errors import InvalidInput, nearest
from consilience.suite.engine_runs import EngineCase, open_plan
from consilience.suite.store import Store

CLOSE = 1000
"""Least number of sample intervals of a motion that is drawn."""

TOUCHING = 100
"""The same where bodies touch: motions with contact take a step to each sample."""


def densely_sampled(case: Case) -> Case:
    """Return the case with its sample halved until there are `CLOSE` intervals: a peak between samples is not drawn."""
    m = case.mechanism
    intervals = TOUCHING if m.contacts or m.stops or m.dry_frictions else CLOSE
    halvings = max(0, math.ceil(math.log2(intervals * case.sample / case.duration)))
    return case.with_span(None, case.sample / 2**halvings)


def finest_motion(
    worker: EngineHandle,
    case: Case,
    method: str | None = None,
    profile: Profile = Profile.MATCHED,
    store: Store | None = None,
    info: EngineInfo | None = None,
) -> Run:
    """Return the motion by a method at its finest level, or why there is none.

    Parameters
    ----------
    worker : EngineHandle
    case : Case
    method : str, optional
        Name; default: the first method of the profile.
    profile : Profile
    store : Store, optional
        Store of answers, which are not asked for again, with the `info` of the engine.
    info : EngineInfo, optional

    Raises
    ------
    InvalidInput
        If the engine has no such method for the case.
    """
    question = Question.TRAJECTORY
    plan = open_plan(worker, case)
    if isinstance(plan, str):
        return Run(case.name, worker.engine, question, None, 0, None, Status.FAILED, reason=plan)
    if plan.refusals(question):
        return next(EngineCase(worker, case, plan).question(question))
    known = [m for m in plan.methods[question] if m.profile is profile]
    own = [m for m in known if method in (None, m.name)]
    if not own and (method is not None or profile is not Profile.MATCHED):
        what = f"it has no method '{method}'" if method is not None else f"it has no method of the profile {profile}"
        names = [f"{m.name} ({m.profile})" for m in plan.methods[question]]
        raise InvalidInput(f"engine '{worker.engine}'", what, nearest(method or "", names, "Methods"))
    chosen = replace(plan, methods={**plan.methods, question: tuple(own[:1]) or plan.methods[question]})
    return EngineCase(worker, case, chosen, store=store, info=info).finest(question)
