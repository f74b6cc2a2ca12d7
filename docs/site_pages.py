"""Pages of the site that are generated at every build: the gallery of cases, the findings, the API reference."""

from __future__ import annotations

import re
from pathlib import Path

import draw_architecture
from site_choice import choice
from site_contact import contact_page
from site_gallery import front, gallery

from consilience.cli.explanations import Topic, read_explanations

FINDINGS = Path(__file__).parents[1] / "reports" / "findings"

OFFERS = ("reference", "reference.analyses", "reference.contact")
"""Packages whose names come from their modules."""

API: dict[str, tuple[str, tuple[str, ...]]] = {
    "Library": (
        "library",
        ("", "case.drawing", "mechanism.solids", "report.simulation", "report.study", "report.agreement"),
    ),
    "Mechanisms": (
        "mechanisms",
        tuple(f"mechanism.{name}" for name in ("model", "elements", "contacts", "functions", "joints", "assembly")),
    ),
    "Cases": (
        "cases",
        ("case.case", "case.file.reader", "case.file.writer", "case.library", "case.published", "errors"),
    ),
    "Engines": (
        "engines",
        (
            *("engine.protocol", "engine.answers", "engine.harness_solvers", "engine.worker.client"),
            *("engine.worker.requests", "mechanism.elementary_tree"),
        ),
    ),
    "Suites": ("suites", ("suite.suite", "suite.engine_runs", "suite.store")),
    "Comparison": (
        "comparison",
        tuple(
            f"compare.{name}"
            for name in (
                "result",
                "rules",
                "uncertainty",
                "softness",
                "horizon",
                "motion",
                "instant",
                "trajectory",
                "judge",
            )
        ),
    ),
    "Reference solver": ("reference", OFFERS),
    "Mechanics": (
        "mechanics",
        (
            *("mechanism.spatial", "mechanism.joint_rows", "mechanism.constraints", "mechanism.observables"),
            *("mechanism.applied_forces", "mechanism.conditioning", "compare.energies"),
        ),
    ),
    "Files and frames": (
        "files",
        ("report.trajectory_files", "report.dataframes", "report.record"),
    ),
}
"""Pages of the reference: title, file, modules of `consilience`."""


def write(docs: Path) -> None:
    """Write all generated pages into `docs/generated`, which git does not keep, and the drawings beside the pages."""
    draw_architecture.write()
    folder = docs / "generated"
    pages = {"library.md": gallery(), "front.html": front(), "explained.md": explained(), "choose.md": choice()}
    pages["contact.md"] = contact_page()
    pages |= findings() | api()
    for name, text in pages.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:  # an unchanged page is not built again
            path.write_text(text, encoding="utf-8")
    for path in folder.rglob("*.*"):
        if str(path.relative_to(folder)) not in pages:
            path.unlink()


def cell(text: object) -> str:
    """Escape a text for a cell of a Markdown table."""
    return re.sub(r"([|<>\[\]*_`])", r"\\\1", str(text).replace("\n", " "))


def explained() -> str:
    """Return the page of all entries of `consilience explain`."""
    lines = ["# Verdicts, terms and traps", "", "What `consilience explain` prints, all of it.", ""]
    for kind in Topic:
        lines += [f"## {kind.title}", ""]
        for entry in read_explanations():
            if entry.kind is kind:
                lines += [f"### {cell(entry.name)}", "", f"**{cell(entry.rule)}**", "", cell(entry.theory), ""]
                if entry.met:
                    lines += [f"Met: {cell('; '.join(entry.met))}", ""]
    return "\n".join(lines)


def findings() -> dict[str, str]:
    """Return the overview of the findings, and a page for each with its script."""
    pages = {"findings/index.md": _linked(FINDINGS / "README.md")}
    names = sorted(path.parent.name for path in FINDINGS.glob("*/README.md"))
    toc = "\n".join(["", "```{toctree}", ":hidden:", "", *names, "```", ""])
    pages["findings/index.md"] += toc
    for name in names:
        script = (FINDINGS / name / "show.py").read_text(encoding="utf-8")
        text = (FINDINGS / name / "README.md").read_text(encoding="utf-8")
        pages[f"findings/{name}.md"] = f"{text}\n## show.py\n\n```python\n{script}```\n"
    return pages


def _linked(path: Path) -> str:
    """Return the text of the overview, with links to pages in place of links to folders."""
    return re.sub(r"\((\w+)/README\.md\)", r"(\1.md)", path.read_text(encoding="utf-8"))


def api() -> dict[str, str]:
    """Return the pages of the API reference, one for each part of the library."""
    pages = {}
    for title, (name, modules) in API.items():
        text = "".join(
            f"\n## {path}\n\n```{{eval-rst}}\n.. automodule:: {path}\n"
            f"   :members:\n{'   :imported-members:' if module in OFFERS else ''}\n```\n"
            for module in modules
            for path in [f"consilience.{module}".rstrip(".")]
        )
        pages[f"api/{name}.md"] = f"# {title}\n{text}"
    toc = "\n".join(["```{toctree}", ":maxdepth: 1", "", *(name for name, _ in API.values()), "```", ""])
    about = "From the docstrings. By name and signature: [Names of the library](../../api.md)."
    pages["api/index.md"] = f"# API reference\n\n{about}\n\n{toc}"
    return pages
