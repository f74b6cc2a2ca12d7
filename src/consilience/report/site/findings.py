"""Findings on the site: their texts as pages, with links to the threads upstream that they cite."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

from markdown_it import MarkdownIt
from markupsafe import Markup

from consilience.report.findings import finding_text

_THREAD = re.compile(r"(?<![\w/])(?P<project>[\w.-]+/[\w.-]+)?#(?P<number>\d+)\b")


@dataclass(frozen=True)
class Thread:
    """A thread upstream: an issue or a pull request, ``owner/name#number``."""

    name: str
    address: str


@dataclass(frozen=True)
class FindingPage:
    """A finding: its text as HTML, and the threads that it cites."""

    name: str
    title: str
    body: Markup
    threads: tuple[Thread, ...]

    @property
    def address(self) -> str:
        """Address within the site."""
        return f"finding/{self.name}"


@cache
def finding_page(name: str) -> FindingPage | None:
    """Return the page of a finding; None where the installation does not have its text."""
    text = finding_text(name)
    if text is None:
        return None
    title, _, rest = text.partition("\n")
    # a link between findings is text here: the site has pages of those alone that show
    plain = re.sub(r"\[([^\]]*)\]\((?!https?:)[^)]*\)", r"\1", rest)
    body = Markup(MarkdownIt("commonmark", {"html": False}).enable("table").render(plain))
    return FindingPage(name, title.removeprefix("# ").replace("`", ""), body, threads(text))


def threads(text: str) -> tuple[Thread, ...]:
    """List the threads that a text cites; a bare ``#12`` is of the project named before it."""
    found, project = dict[str, Thread](), ""
    for cited in _THREAD.finditer(text):
        project = cited["project"] or project
        if project:
            name = f"{project}#{cited['number']}"
            found[name] = Thread(name, f"https://github.com/{project}/issues/{cited['number']}")
    return tuple(found.values())
