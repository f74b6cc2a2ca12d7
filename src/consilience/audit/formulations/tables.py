"""What a cross-check of formulations found, as Markdown tables, and the command that runs it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import typer

from consilience.audit.formulations.compare import QUANTITIES, Difference, Examination, agrees, campaign, disagreements
from consilience.compare import markdown_table
from consilience.reference.formulations import registry


def formulation_table(examinations: Sequence[Examination]) -> str:
    """Markdown: for each formulation mechanisms and states, and the worst distance from the median, with its place."""
    names = list(dict.fromkeys(name for e in examinations for name in e.refusals))
    heads = ("formulation", "mechanisms", "refused", "states without answer", "worst accelerations", "worst reactions")
    rows = []
    for name in names:
        able = sum(not e.refusals[name] for e in examinations)
        missing = sum(x.formulation == name for e in examinations for x in e.exempt)
        worst = [_worst(examinations, name, quantity) for quantity in QUANTITIES]
        rows.append([f"`{name}`", able, len(examinations) - able, missing, *worst])
    return "\n".join(markdown_table(heads, rows, "lrrrrr"))


def _worst(examinations: Sequence[Examination], name: str, quantity: str) -> str:
    """Worst distance from the median relative to the bar: value, ratio, and where."""
    found = [d for e in examinations for d in e.differences if d.quantity == quantity and name in d.distances]
    if not found:
        return "none"
    worst = max(found, key=lambda d: d.distances[name] / d.bar)
    distance = worst.distances[name]
    return f"{distance:.1e} ({distance / worst.bar:.1g} of the bar; {worst.seed}/{worst.state})"


def summary(examinations: Sequence[Examination]) -> str:
    """Markdown: what was examined, each with each, by kind of mechanism."""
    groups: dict[str, Callable[[Examination], bool]] = {
        "trees": lambda e: e.loops == 0,
        "loops": lambda e: e.loops > 0,
        "all": lambda _: True,
    }
    heads = (
        *("mechanisms", "number", "bodies", "states", "compared"),
        *("worst accelerations", "worst reactions", "above the bar"),
    )
    rows = []
    for title, member in groups.items():
        chosen = [e for e in examinations if member(e)]
        if not chosen:
            continue
        bodies = [e.bodies for e in chosen]
        found = [d for e in chosen for d in e.differences]
        cells = [title, len(chosen), f"{min(bodies)} to {max(bodies)}", sum(e.states for e in chosen)]
        cells.append(sum(d.quantity == QUANTITIES[0] for d in found))
        cells += [_widest([d for d in found if d.quantity == q]) for q in QUANTITIES]
        rows.append([*cells, len(disagreements(chosen))])
    return "\n".join(markdown_table(heads, rows, "lrrrrrrr"))


def _widest(found: Sequence[Difference]) -> str:
    if not found:
        return "none"
    worst = max(found, key=lambda d: d.spread / d.bar)
    return f"{worst.spread:.1e} ({worst.spread / worst.bar:.1g} of the bar; {worst.seed}/{worst.state})"


def exceptions(examinations: Sequence[Examination]) -> str:
    """Markdown: refusals and states not compared, counted with their reasons, then every disagreement and failure."""
    refused = Counter(
        (name, _feature_kind(feature))
        for e in examinations
        for name, features in e.refusals.items()
        for feature in {_feature_kind(f) for f in features}
    )
    counted = [(f"`{name}`", feature, count) for (name, feature), count in sorted(refused.items())]
    exempt = [
        (f"`{x.formulation}`" if x.formulation else "all", f"{x.seed}/{x.state}", "**failed**: " * x.failure + x.reason)
        for e in examinations
        for x in e.exempt
    ]
    above = [
        (f"{d.seed}/{d.state}", d.quantity, f"{d.spread:.1e}", f"{d.bar:.1e}", f"`{d.farthest}`")
        for d in disagreements(examinations)
    ]
    lines = [
        *markdown_table(("formulation", "cannot represent", "mechanisms"), counted, "llr"),
        "",
        *markdown_table(("formulation", "state (mechanism/state)", "not compared because"), exempt),
        "",
        *markdown_table(
            ("above the bar (mechanism/state)", "quantity", "difference", "bar", "farthest"), above, "llrrl"
        ),
    ]
    return "\n".join(lines)


def _feature_kind(feature: str) -> str:
    """A feature without the name of the one that has it: ``joint 'j1': screw`` to ``joint: screw``."""
    parts = feature.split("'")
    return feature if len(parts) < 3 else (parts[0].strip() + parts[2]).strip()


def report(examinations: Sequence[Examination]) -> str:
    """Markdown: all tables of a campaign."""
    return "\n\n".join([summary(examinations), formulation_table(examinations), exceptions(examinations)]) + "\n"


def main(
    mechanisms: Annotated[int, typer.Option(help="Number of random mechanisms.")] = 200,
    states: Annotated[int, typer.Option(help="States of each.")] = 20,
    seed: Annotated[int, typer.Option(help="Seed of the first mechanism; the others follow.")] = 1,
    formulations: Annotated[list[str] | None, typer.Option("-f", "--formulation", help="Only these.")] = None,
    jobs: Annotated[int, typer.Option(help="Processes.")] = 1,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Markdown file for the tables.")] = None,
) -> None:
    """Compare all formulations with one another on random mechanisms; exit code 1 if any two disagree."""
    names = formulations or list(registry.FORMULATIONS)
    for name in names:
        registry.entry(name)
    found = []
    for examination in campaign(range(seed, seed + mechanisms), states, names, jobs):
        found.append(examination)
        typer.echo(f"\r{len(found)} of {mechanisms} mechanisms", nl=False, err=True)
    typer.echo(err=True)
    text = report(found)
    if output is not None:
        output.write_text(text, encoding="utf-8")
    typer.echo(summary(found) if output is not None else text)
    raise typer.Exit(0 if agrees(found) else 1)
