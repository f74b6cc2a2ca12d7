"""``consilience validate``: what a case file holds, and what every engine will make of it, before anything runs."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Annotated, Any

import typer
from rich.console import Console

from consilience.case import Case, cases_like, load_cases
from consilience.cli.formats import Format, SheetFormat
from consilience.engine import EngineInfo, Method, Question, engines_like, installed, require_installed
from consilience.engine.worker.client import Plan, Request, Worker, in_parallel
from consilience.errors import InvalidInput, visible
from consilience.report.anatomy import anatomy, expected_lines, listed, warnings

Findings = dict[str, Any]
"""What was found, as JSON has it."""


def load_all(names: Sequence[str]) -> tuple[list[Case], list[Findings]]:
    """Cases that can be assembled, and what is wrong with the others."""
    sound: list[Case] = []
    invalid: list[Findings] = []
    for name in names:
        try:
            cases = load_cases(name)
        except InvalidInput as error:
            invalid.append({"case": name, "valid": False, "problem": str(error)})
            continue
        for case in cases:
            try:
                _ = case.states
            except InvalidInput as error:
                invalid.append({"case": case.name, "valid": False, "problem": str(error)})
            else:
                sound.append(case)
    return sound, invalid


def examine(case: Case) -> Findings:
    """Health of a case that can be assembled: facts, expected values with their provenance, warnings."""
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


def ask_plans(worker: Worker, cases: Sequence[Case]) -> list[Findings]:
    """What one engine would do with each case; a crash is the reason of one case."""
    with worker:
        reply = worker.ask(Request())
        if not isinstance(reply.value, EngineInfo):
            return [{"version": None, "problem": f"does not start: {reply.reason}"} for _ in cases]
        version, found = reply.value.version, []
        for case in cases:
            planned = worker.ask(Request(case.mechanism))
            if isinstance(planned.value, Plan):
                found.append({"version": version, **_plan(planned.value, case)})
            else:
                reason = planned.reason or f"it plans a {type(planned.value).__name__}"
                found.append({"version": version, "problem": reason})
        return found


def _plan(plan: Plan, case: Case) -> Findings:
    approximated = list(plan.manifest.approximated)
    questions = {}
    for question in Question:
        refused = [{"feature": u.feature, "reason": u.reason} for u in plan.unsupported[question]]
        verdict = "unsupported" if refused else "approximated" if approximated else "exact"
        methods = [] if refused else [_method(m, case) for m in plan.methods[question]]
        questions[str(question)] = {"verdict": verdict, "unsupported": refused, "methods": methods}
    return {"exact": list(plan.manifest.exact), "approximated": approximated, "questions": questions}


def _method(method: Method, case: Case) -> Findings:
    steps = [case.sample / n for n in method.substeps]
    known = ("name", "order", "settings", "softness")
    own = {name: getattr(method, name) for name in known}
    return own | {
        "route": str(method.route),
        "profile": str(method.profile),
        "steps": steps,
        "tolerances": list(method.tolerances),
    }


def validate_cases(names: Sequence[str], engines: Sequence[str], limit: float, jobs: int = 2) -> list[Findings]:
    """Everything there is to say about the cases of some names before they run.

    Parameters
    ----------
    names : sequence of str
        Names, files, members of families.
    limit : float, s
        Time limit of one message to an engine.
    jobs : int
        Engines asked at a time.

    Returns
    -------
    list of dict
        One for each case, variants apart, and one for each name that is none.
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


def text(found: Findings) -> str:
    """What was found about one case, for the terminal."""
    if not found["valid"]:
        return f"{found['case']}: invalid\n  {found['problem']}\n"
    lines = [f"{found['case']}: valid: {found['title']}", *(f"  {line}" for line in health_lines(found))]
    lines += [f"  warning: {w}" for w in found["warnings"]]
    lines += ["  not checked: growth of small errors; `consilience run` measures it", ""]
    for engine, plan in found["engines"].items():
        lines += list(_engine_lines(engine, plan))
    return "\n".join([*lines, ""])


def health_lines(found: Findings) -> Iterator[str]:
    """Assembly, freedom, redundancy, open reactions and provenance, a line each."""
    yield f"assembles: joints satisfied to {found['residual']:.1g}"
    yield (
        f"{found['freedom']} degree{'s' * (found['freedom'] != 1)} of freedom, {found['rows']} constraint rows, "
        f"{found['redundant']} of them dependent"
    )
    if found["dependent"]:
        yield "rows that depend on one another: " + listed(found["dependent"], " ")
    if found["undetermined"]:
        yield "reactions that equilibrium does not determine: " + listed(found["undetermined"], ", ")
    yield "needs of an engine: " + ", ".join(found["features"])
    yield from (f"expected: {line}" for line in found["expected_lines"] or ["nothing"])


def _engine_lines(engine: str, plan: Findings) -> Iterator[str]:
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


def _method_line(method: Findings) -> str:
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
    cases: Annotated[
        list[str],
        typer.Argument(metavar="FILE...", help="Case files, names, or families.", autocompletion=cases_like),
    ],
    engine: Annotated[
        list[str] | None,
        typer.Option("-e", "--engine", help="Engine; repeat it. Default: all.", autocompletion=engines_like),
    ] = None,
    form: SheetFormat = Format.TEXT,
    limit: Annotated[float, typer.Option(min=0.1, help="Time limit of one message to an engine in s.")] = 180.0,
) -> None:
    """Check cases, and say what every engine will make of them before anything runs."""
    for name in engine or []:
        require_installed(name)
    engines = list(dict.fromkeys(engine or installed()))
    found = validate_cases(cases, engines, limit)
    if form is Format.JSON:
        sys.stdout.write(json.dumps({"cases": found}, indent=2, default=str) + "\n")
    elif form is Format.MARKDOWN:
        sys.stdout.write("".join(f"```text\n{text(one)}```\n" for one in found))
    else:
        for one in found:
            Console().print(visible(text(one)), soft_wrap=True, highlight=False, markup=False)
    raise typer.Exit(0 if all(one["valid"] for one in found) else 2)
