"""A badge for a README as static SVG: the verdict of an engine in words, by a symbol and by a colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jinja2 import Environment, StrictUndefined

from consilience.compare import Verdict
from consilience.report.exports.digest import QuestionCell, cells, engines
from consilience.report.record import Record
from consilience.report.wording import LOOKS, RANK, counted

COLOURS: dict[Verdict, str] = {
    Verdict.AGREES: "#00664b",
    Verdict.DISCRETISATION: "#00568a",
    Verdict.REGULARISATION: "#00568a",
    Verdict.UNSUPPORTED: "#555555",
    Verdict.UNRESOLVED: "#7a5000",
    Verdict.MODEL: "#a83c00",
    Verdict.FAILED: "#8c2f5c",
}
"""Background of white text, with a contrast of at least 5."""

_CHARACTER, _MARGIN = 6.6, 7.0
"""Width of a character of 11 px, and margin, in px; `textLength` makes the width exact in every font."""

_TEMPLATE = """\
<svg xmlns="http://www.w3.org/2000/svg" width="{{ width }}" height="20" role="img" aria-label="{{ label }}">
  <title>{{ label }}</title>
  <clipPath id="r"><rect width="{{ width }}" height="20" rx="3"/></clipPath>
  <g clip-path="url(#r)">
    <rect width="{{ split }}" height="20" fill="#444444"/>
    <rect x="{{ split }}" width="{{ width - split }}" height="20" fill="{{ colour }}"/>
  </g>
  <g fill="#ffffff" font-family="Verdana,DejaVu Sans,sans-serif" font-size="11">
{% for text, at, length in texts %}    <text x="{{ at }}" y="14" textLength="{{ length }}">{{ text }}</text>
{% endfor %}  </g>
</svg>
"""


@dataclass(frozen=True)
class Badge:
    """Subject, statement and worst verdict of a badge."""

    subject: str
    statement: str
    verdict: Verdict


def render(record: Record) -> str:
    """Write the badge of a record as SVG."""
    return drawn(badge(record))


def badge(record: Record) -> Badge:
    """Make the badge of a record; a record of one engine has a badge with its name."""
    names = engines(record)
    missing = record.header["missing"]
    everyone = [*names, *missing]
    subject = "consilience" if len(everyone) != 1 else f"consilience: {everyone[0]}"
    if missing:
        return Badge(subject, f"! {counted(len(missing), 'engine')} missing", Verdict.FAILED)
    found = [cell for cell in cells(record) if cell.engine in names]
    if not found:
        return Badge(subject, "nothing compared", Verdict.UNRESOLVED)
    worst = max((cell.verdict for cell in found), key=lambda v: RANK[v])
    return Badge(subject, f"{LOOKS[worst].symbol} {_statement(worst, found)}", worst)


def _statement(worst: Verdict, found: Sequence[QuestionCell]) -> str:
    """State the digits if all cells agree, at least in the limit; else the number of cells with the worst verdict."""
    count = sum(cell.verdict is worst for cell in found)
    supported = [cell for cell in found if cell.verdict is not Verdict.UNSUPPORTED]
    digits = [cell.digits for cell in supported if cell.digits is not None]
    if RANK[worst] > RANK[Verdict.UNSUPPORTED]:
        return f"{count} of {len(found)} {worst.removeprefix('differs: ')}"
    said = f"agrees {int(min(digits))} digits" if digits else "agrees"
    if any(cell.verdict in (Verdict.DISCRETISATION, Verdict.REGULARISATION) for cell in supported):
        said += ", more in the limit"
    return said if worst is not Verdict.UNSUPPORTED else f"{said}, {count} unsupported"


def drawn(given: Badge) -> str:
    """Write a badge as SVG."""
    lengths = [round(_CHARACTER * len(text), 1) for text in (given.subject, given.statement)]
    split = round(lengths[0] + 2 * _MARGIN, 1)
    environment = Environment(autoescape=True, undefined=StrictUndefined, keep_trailing_newline=True)
    return environment.from_string(_TEMPLATE).render(
        label=f"{given.subject}: {given.statement}",
        width=round(split + lengths[1] + 2 * _MARGIN, 1),
        split=split,
        colour=COLOURS[given.verdict],
        texts=[(given.subject, _MARGIN, lengths[0]), (given.statement, round(split + _MARGIN, 1), lengths[1])],
    )
