"""A LaTeX table for a paper: correct digits of every case and engine, set with booktabs.

Each question has a group of columns. Verdicts other than plain agreement have a symbol, explained in the note.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from consilience.compare import Verdict
from consilience.engine import Question
from consilience.report.exports.digest import QuestionCell, cells, engines
from consilience.report.record import Record
from consilience.report.wording import digits_text

SYMBOLS: dict[Verdict, str] = {
    Verdict.AGREES: "",
    Verdict.DISCRETISATION: r"$\approx$",
    Verdict.REGULARISATION: r"$\propto$",
    Verdict.UNSUPPORTED: "--",
    Verdict.UNRESOLVED: "?",
    Verdict.MODEL: r"$\neq$",
    Verdict.FAILED: "!",
}
"""Symbols before the digits: those of `Look` where every font of LaTeX has them."""

_SPECIAL = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "{": r"\{",
        "}": r"\}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        **{character: f"\\{character}" for character in "&%$#_"},
    }
)


def escaped(text: str) -> str:
    """Escape the special characters of LaTeX."""
    return text.translate(_SPECIAL)


def render(record: Record) -> str:
    """Write a record as a table environment; the table needs ``booktabs``."""
    found = {(cell.case, cell.engine, cell.question): cell for cell in cells(record)}
    questions, names = _questions(record), engines(record)
    rows = [
        [r"\texttt{" + escaped(case["name"]) + "}"]
        + [_entry(found.get((case["name"], name, question))) for question in questions for name in names]
        for case in record.cases
    ]
    shown = [cell for key, cell in found.items() if key[1] in names and key[2] in questions]
    return "\n".join(_lines(record, questions, names, rows, list(_notes(shown)))) + "\n"


def _questions(record: Record) -> list[str]:
    """List the questions that have columns: all but `model`, whose answers say nothing about accuracy."""
    asked: list[str] = record.header["questions"]
    return [q for q in asked if q != Question.MODEL] or asked


def _entry(cell: QuestionCell | None) -> str:
    if cell is None:
        return ""
    digits = "" if cell.digits is None else digits_text(cell.digits)
    return f"{SYMBOLS[cell.verdict]} {digits}".strip()


def _notes(shown: Sequence[QuestionCell]) -> Iterator[str]:
    """Explain the symbols that occur."""
    occurring = {cell.verdict for cell in shown}
    for verdict, symbol in SYMBOLS.items():
        if symbol and verdict in occurring:
            yield f"{symbol}~{escaped(verdict)}"


def _lines(
    record: Record, questions: Sequence[str], names: Sequence[str], rows: Sequence[list[str]], notes: Sequence[str]
) -> Iterator[str]:
    """Write the lines of the table environment.

    Parameters
    ----------
    record : Record
    questions : sequence of str
        Questions that have columns.
    names : sequence of str
        Engines, the columns of each question.
    rows : sequence of list of str
        Cells of each case, escaped.
    notes : sequence of str
        Explanations of the symbols that occur.
    """
    versions = ", ".join(f"{name} {record.header['engines'][name]['version']}" for name in names)
    yield "% needs \\usepackage{booktabs}"
    yield r"\begin{table}"
    yield r"  \centering"
    caption = f"Correct digits with matched settings, the fewest of all methods: {versions}; "
    caption += f"reference and comparison by Consilience {record.header['packages']['consilience']}."
    yield rf"  \caption{{{escaped(caption)}}}"
    yield r"  \label{tab:consilience}"
    yield rf"  \begin{{tabular}}{{l{('r' * len(names)) * len(questions)}}}"
    yield r"    \toprule"
    yield "    " + " & ".join(["", *(rf"\multicolumn{{{len(names)}}}{{c}}{{{q}}}" for q in questions)]) + r" \\"
    first = [2 + k * len(names) for k in range(len(questions))]
    yield "    " + " ".join(rf"\cmidrule(lr){{{k}-{k + len(names) - 1}}}" for k in first)
    yield "    " + " & ".join(["case", *(escaped(name) for _ in questions for name in names)]) + r" \\"
    yield r"    \midrule"
    yield from (f"    {' & '.join(row)} \\\\" for row in rows)
    yield r"    \bottomrule"
    yield r"  \end{tabular}"
    if notes:
        yield r"  \par\smallskip\footnotesize " + ", ".join(notes)
    yield r"\end{table}"
