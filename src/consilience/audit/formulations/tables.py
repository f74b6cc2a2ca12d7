"""Markdown tables of a cross-check of formulations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

from consilience.audit.formulations.compare import QUANTITIES, Difference, Examination, disagreements
from consilience.compare import markdown_table


def formulation_table(examinations: Sequence[Examination]) -> str:
    """Tabulate mechanisms, states and the worst distance from the median of each formulation."""
    names = list(dict.fromkeys(name for e in examinations for name in e.refusals))
    heads = ("formulation", "mechanisms", "refused", "states without answer", "worst accelerations", "worst reactions")
    rows = []
    for name in names:
        able = sum(not e.refusals[name] for e in examinations)
        missing = sum(x.formulation == name for e in examinations for x in e.exempt)
        known = [d for e in examinations for d in e.differences if name in d.distances]
        worst = [_worst([(d.distances[name], d) for d in known if d.quantity == q]) for q in QUANTITIES]
        rows.append([f"`{name}`", able, len(examinations) - able, missing, *worst])
    return "\n".join(markdown_table(heads, rows, "lrrrrr"))


def _worst(sizes: Sequence[tuple[float, Difference]]) -> str:
    """Describe the largest of some sizes relative to the bars of their differences."""
    if not sizes:
        return "none"
    size, worst = max(sizes, key=lambda pair: pair[0] / pair[1].bar)
    return f"{size:.1e} ({size / worst.bar:.1g} of the bar; {worst.seed}/{worst.state})"


def summary(examinations: Sequence[Examination]) -> str:
    """Tabulate the largest differences by kind of mechanism."""
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
        cells += [_worst([(d.spread, d) for d in found if d.quantity == q]) for q in QUANTITIES]
        rows.append([*cells, len(disagreements(chosen))])
    return "\n".join(markdown_table(heads, rows, "lrrrrrrr"))


def exceptions(examinations: Sequence[Examination]) -> str:
    """Tabulate refusals, states not compared with reasons, disagreements and failures."""
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
    """Remove the element's name from a feature: ``joint 'j1': screw`` becomes ``joint: screw``."""
    parts = feature.split("'")
    return feature if len(parts) < 3 else (parts[0].strip() + parts[2]).strip()


def report(examinations: Sequence[Examination]) -> str:
    """Return all tables of a campaign."""
    return "\n\n".join([summary(examinations), formulation_table(examinations), exceptions(examinations)]) + "\n"
