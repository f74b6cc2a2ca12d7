"""What the command ``consilience site`` says: the score, and what changed from one version to the next."""

from __future__ import annotations

from pathlib import Path

from consilience.report.site.views import Front
from consilience.report.statement import Statement
from consilience.report.wording import counted


def site_statement(view: Front, output: Path) -> Statement:
    """State a site: its contents, the scores, and the cells that are worse in a version than in the one before."""
    labels, worse = view.labels, [step for step in view.steps if step.worse]
    score_rows: list[tuple[str, ...]] = [
        (labels[s.engine], *(s.shares or ["-"] * len(view.digits)), s.note) for s in view.scores
    ]
    step_rows = [
        (
            step.cell.case,
            labels[step.cell.engine],
            step.after.version,
            step.before.look.verdict,
            step.after.look.verdict,
        )
        for step in worse
    ]
    sentences = [f"{view.headline}: {output / 'index.html'}"]
    sentences += [f"{name} is left out: {why}" for name, why in view.left_out.items()]
    data = {
        "site": str(output / "index.html"),
        "edition": view.edition.name,
        "scores": {s.engine: {"of": s.of, "digits": s.digits_agreed} for s in view.scores},
        "worse": [list(row) for row in step_rows],
        "left_out": dict(view.left_out),
    }
    heads = ("engine", *(counted(n, "digit") for n in view.digits), "of")
    score = (f"interop score, edition {view.edition.name}", heads, score_rows)
    steps = ("worse than in the version before", ("case", "engine", "version", "before", "verdict"), step_rows)
    return Statement(sentences, [score, steps], data)
