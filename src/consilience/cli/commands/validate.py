"""The command ``consilience validate``: facts of cases, and the plan of every engine, before anything runs."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

import typer

from consilience.case import Case, load_cases
from consilience.case.file.problems import InvalidCase
from consilience.cli.options import CaseFiles, EngineNames, Form, MessageLimit, OutputFormat, chosen_engines
from consilience.cli.terminal import say
from consilience.engine import EngineInfo, Method, Question
from consilience.engine.worker.client import Worker, in_parallel
from consilience.engine.worker.requests import Plan, Request
from consilience.errors import InvalidInput, visible
from consilience.report.anatomy import anatomy, dependency_lines, expected_lines, freedom_line, warnings
from consilience.report.wording import counted


def load_all(names: Sequence[str]) -> tuple[list[Case], list[dict[str, Any]]]:
    """Load cases: those that can be assembled, and a finding for each that cannot."""
    sound: list[Case] = []
    invalid: list[dict[str, Any]] = []
    for name in names:
        try:
            cases = load_cases(name)
        except InvalidInput as error:
            invalid.append(refused(name, error))
            continue
        for case in cases:
            try:
                _ = case.states
            except InvalidInput as error:
                invalid.append(refused(case.name, error))
            else:
                sound.append(case)
    return sound, invalid


def refused(name: str, error: InvalidInput) -> dict[str, Any]:
    """Describe what is wrong with a case: all problems of its file, each with place and remedy."""
    found = error.problems if isinstance(error, InvalidCase) else (error,)
    problems = [{"where": one.where, "what": one.what, "remedy": one.remedy} for one in found]
    return {"case": name, "valid": False, "problems": problems}


def examine(case: Case) -> dict[str, Any]:
    """Describe a case that can be assembled: facts, expected values with their provenance, warnings."""
    facts = asdict(anatomy(case.mechanism, case.initial_state))
    values = [
        {"name": k.name, "value": k.value, "uncertainty": k.uncertainty, "origin": k.origin, "source": k.source}
        for k in case.published
    ]
    about = {"case": case.name, "file": case.file, "valid": True, "title": case.title, "samples": len(case.times)}
    return (
        about
        | facts
        | {"expected": values, "expected_lines": expected_lines(case), "warnings": warnings(case), "engines": {}}
    )


def ask_plans(worker: Worker, cases: Sequence[Case]) -> list[dict[str, Any]]:
    """Ask one engine for its plan of each case; a crash is the finding of one case."""
    with worker:
        reply = worker.ask(Request())
        if not isinstance(reply.value, EngineInfo):
            return [{"version": None, "problem": f"does not start: {reply.reason}"} for _ in cases]
        version, found = reply.value.version, []
        for case in cases:
            # with the start, as a run asks: units, and laws in them, depend on it
            planned = worker.ask(Request(case.mechanism, states=[case.initial_state]))
            if isinstance(planned.value, Plan):
                found.append({"version": version, **_plan(planned.value, case)})
            else:
                reason = planned.reason or f"it plans a {type(planned.value).__name__}"
                found.append({"version": version, "problem": reason})
        return found


def _plan(plan: Plan, case: Case) -> dict[str, Any]:
    approximated = list(plan.manifest.approximated)
    questions = {}
    for question in Question:
        refused = [{"feature": u.feature, "reason": u.reason} for u in plan.unsupported[question]]
        verdict = "unsupported" if refused else "approximated" if approximated else "exact"
        methods = [] if refused else [_method(m, case) for m in plan.methods[question]]
        questions[str(question)] = {"verdict": verdict, "unsupported": refused, "methods": methods}
    return {"exact": list(plan.manifest.exact), "approximated": approximated, "questions": questions}


def _method(method: Method, case: Case) -> dict[str, Any]:
    own = {name: getattr(method, name) for name in ("name", "order", "settings", "softness", "route", "profile")}
    return own | {"steps": [case.sample / n for n in method.substeps], "tolerances": list(method.tolerances)}


def validate_cases(names: Sequence[str], engines: Sequence[str], limit: float, jobs: int = 2) -> list[dict[str, Any]]:
    """Describe cases and the plans of engines for them, before anything runs.

    Parameters
    ----------
    names : sequence of str
        Names, files, members of families.
    engines : sequence of str
    limit : float, s
        Time limit of one message to an engine.
    jobs : int
        Engines asked at a time.

    Returns
    -------
    list of dict
        One for each case or variant, and one for each name that is no case.
    """
    sound, invalid = load_all(names)
    found = [examine(case) for case in sound]
    if sound:
        asked = in_parallel(lambda worker: ask_plans(worker, sound), [Worker(name, limit) for name in engines], jobs)
        for engine, plans in zip(engines, asked, strict=True):
            for one, plan in zip(found, plans, strict=True):
                one["engines"][engine] = plan
    return [*found, *invalid]


# ---------------------------------------------------------------- as text


def text(found: dict[str, Any]) -> str:
    """Write the findings of one case as text for the terminal."""
    if not found["valid"]:
        problems = [f"  {one['where']}: {one['what']}. {one['remedy']}" for one in found["problems"]]
        return "\n".join([f"{found['case']}: invalid, {counted(len(problems), 'problem')}", *problems, ""])
    lines = [f"{found['case']}: valid: {found['title']}", *(f"  {line}" for line in health_lines(found))]
    lines += [f"  warning: {w}" for w in found["warnings"]]
    lines += ["  not checked: growth of small errors; `consilience run` measures it", ""]
    for engine, plan in found["engines"].items():
        lines += list(_engine_lines(engine, plan))
    return "\n".join([*lines, ""])


def health_lines(found: dict[str, Any]) -> Iterator[str]:
    """State assembly, freedom, redundancy, open reactions and provenance, a line each."""
    yield f"assembles: joints satisfied to {found['residual']:.1g}"
    yield freedom_line(found["freedom"], found["rows"], found["redundant"])
    yield from dependency_lines(found["dependent"], found["undetermined"], found["singular"])
    yield "needs of an engine: " + ", ".join(found["features"])
    yield from (f"expected: {line}" for line in found["expected_lines"] or ["nothing"])


def _engine_lines(engine: str, plan: dict[str, Any]) -> Iterator[str]:
    version = f" {plan['version']}" if plan["version"] else ""
    if "problem" in plan:
        yield f"  {engine}{version}: no plan: {' '.join(plan['problem'].split())}"
        return
    yield f"  {engine}{version}"
    for question, own in plan["questions"].items():
        if own["unsupported"]:
            reasons = "; ".join(f"{u['feature']}: {u['reason']}" for u in own["unsupported"])
            yield f"    {question:<11}unsupported: {reasons}"
            continue
        yield f"    {question:<11}{own['verdict']}"
        yield from (f"      {_method_line(method)}" for method in own["methods"])
    yield from (f"    approximated: {what}" for what in plan["approximated"])


def _method_line(method: dict[str, Any]) -> str:
    parts = [method["route"]]
    if method["order"] is not None:
        parts.append(f"order {method['order']}")
    if method["steps"]:
        parts.append("steps " + ", ".join(f"{1e3 * step:.3g}" for step in method["steps"]) + " ms")
    if method["tolerances"]:
        parts.append("tolerances " + ", ".join(f"{t:.0e}" for t in method["tolerances"]))
    if method["profile"] == "default":
        parts.append("engine's defaults")
    return f"{method['name']} ({'; '.join(parts)})"


def validate(
    cases: CaseFiles, engine: EngineNames = None, form: Form = OutputFormat.TEXT, limit: MessageLimit = 180.0
) -> None:
    """Check cases, and say what every engine will make of them before anything runs."""
    found = validate_cases(cases, chosen_engines(engine), limit)
    if form is OutputFormat.JSON:
        sys.stdout.write(json.dumps({"cases": found}, indent=2, default=str) + "\n")
    elif form is OutputFormat.MARKDOWN:
        sys.stdout.write("".join(f"```text\n{text(one)}```\n" for one in found))
    else:
        for one in found:
            say(visible(text(one)))
    raise typer.Exit(0 if all(one["valid"] for one in found) else 2)
