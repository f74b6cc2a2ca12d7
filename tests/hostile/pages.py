"""Checks of rendered pages: only the elements of the template, and data only as text."""

import gzip
import json
import re
from base64 import b64decode
from html.parser import HTMLParser
from itertools import accumulate
from xml.etree import ElementTree

from consilience.report.picture import DARK

TAGS = {
    *("html", "head", "meta", "title", "style", "body", "script"),
    *("header", "main", "nav", "section", "article", "details", "summary", "figure", "figcaption", "noscript"),
    *("form", "fieldset", "legend", "label", "input", "button", "output"),
    *("svg", "rect", "line"),
    *("h1", "h2", "h3", "h4", "p", "strong", "em", "code", "pre", "a", "br", "wbr", "span", "div"),
    *("small", "b", "i", "s", "u", "colgroup", "col"),
    *("table", "caption", "thead", "tbody", "tr", "th", "td", "dl", "dt", "dd", "ul", "li"),
}
ATTRIBUTES = {
    *("lang", "charset", "http-equiv", "content", "name", "class", "href", "id", "scope", "rowspan", "title"),
    *("aria-labelledby", "aria-label", "aria-hidden", "aria-current", "role", "tabindex", "type", "hidden", "open"),
    *("for", "value", "placeholder", "autocomplete", "data-copy", "data-figure", "data-question", "data-name"),
    *("data-tags", "data-engine", "data-case", "data-still", "data-key", "data-keys", "data-value", "data-digits"),
    *("data-text", "data-blind", "aria-sort", "colspan", "span", "style"),
    *("viewbox", "preserveaspectratio", "x", "y", "x1", "x2", "y1", "y2", "width", "height"),
}
SITE_TAGS = {"img", "polyline", "circle", "text"}
SITE_ATTRIBUTES = {"src", "alt", "points", "cx", "cy", "r", "text-anchor"}
SITE_LINK = (
    r"(\.\./)*[\w~-]+[\w~/.-]*(#[\w~.-]+)?|data:image/svg\+xml;base64,[A-Za-z0-9+/=]+|https://github\.com/[\w./-]+"
)
SVG_TAGS = {"svg", "title", "rect", "text", "g", "polyline", "circle", "path", "line", "tspan", "clipPath"}


class Elements(HTMLParser):
    """Elements, attributes and scripts of a page, as parsed by a browser."""

    def __init__(self, page):
        super().__init__(convert_charrefs=True)
        self.tags, self.attributes, self.scripts, self.links, self.text = set(), set(), [], [], []
        self._inside, self.styles = [], []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}
        self.styles += [value for name, value in attrs if name == "style"]
        self.links += [value for name, value in attrs if name in ("href", "src", "action", "formaction", "data")]
        self._inside.append(tag)
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag):
        while self._inside and self._inside.pop() != tag:
            pass

    def handle_data(self, data):
        if self._inside and self._inside[-1] == "script":
            self.scripts[-1] += data
        elif not self._inside or self._inside[-1] != "style":
            self.text.append(data)

    def handle_comment(self, data):
        self.tags.add(f"comment {data[:40]}")

    def handle_pi(self, data):
        self.tags.add(f"instruction {data[:40]}")


def unpacked(page, name):
    """Text of a packed element, as the script of the page unpacks it."""
    pack = re.search(rf'<script type="application/gzip" id="{name}">([A-Za-z0-9+/=]*)</script>', page)[1]
    return gzip.decompress(b64decode(pack)).decode()


def opened(page):
    """Contents of the unfolded parts of a page by anchor."""
    pack = json.loads(unpacked(page, "pages"))
    return {name: "\n".join(pack["lines"][n] for n in numbers) for name, numbers in pack["pages"].items()}


def plotted(page):
    """Figures of a page by the place that each is drawn in, their curves as numbers."""
    pack = json.loads(unpacked(page, "figures"))
    curves = [curve(**given) for given in pack["curves"]]
    for trace in (trace for figure in pack["figures"].values() for trace in figure["data"]):
        trace |= {axis: curves[trace[axis]] for axis in ("x", "y") if axis in trace}
    return pack["figures"]


def curve(log, level, changes):
    """Numbers of a curve, None in its gaps."""
    sums = accumulate(change or 0 for change in changes)
    numbers = (10.0 ** (level * n) if log else level * n for n in sums)
    return [None if change is None else number for change, number in zip(changes, numbers, strict=True)]


def check_html(page, script):
    """Fail where data has become more than text; `script` is the page's own script."""
    found = Elements(page)
    assert found.tags <= TAGS, found.tags - TAGS
    assert found.attributes <= ATTRIBUTES, found.attributes - ATTRIBUTES
    assert all(link.startswith("#") for link in found.links), found.links
    assert all(re.fullmatch(r"(width|left):[0-9.]+%", style) for style in found.styles), found.styles
    *packs, own = found.scripts
    assert all(re.fullmatch(r"[A-Za-z0-9+/=]*", pack) for pack in packs)
    assert own.strip() == script.strip()
    for text in (page, *opened(page).values()):
        assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e]", text)
    for text in opened(page).values():
        inner = Elements(text)
        assert inner.tags <= TAGS - {"script"}, inner.tags - TAGS
        assert inner.attributes <= ATTRIBUTES - {"style"}, inner.attributes - ATTRIBUTES
        assert all(link.startswith("#") for link in inner.links), inner.links


def check_site(files):
    """Fail where data has become more than text on a page of the site; `files` are texts by address."""
    for address, text in files.items():
        assert re.fullmatch(r"[\w~-]+(/[\w~-]+)*(/index)?\.(html|svg|json)", address), address
        if address.endswith(".svg"):
            check_svg(text)
        if address.endswith(".html"):
            found = Elements(text)
            assert found.tags <= (TAGS - {"script"}) | SITE_TAGS, found.tags - TAGS - SITE_TAGS
            assert found.attributes <= ATTRIBUTES | SITE_ATTRIBUTES, found.attributes - ATTRIBUTES - SITE_ATTRIBUTES
            assert all(re.fullmatch(r"max-width: \d+rem", style) for style in found.styles), found.styles
            assert all(re.fullmatch(SITE_LINK, link) for link in found.links), found.links
            assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e]", text)


def check_markdown(page):
    """Fail where data has become an element, a link, a mention or a table row."""
    assert set(re.findall(r"<[^>]{0,40}>?", page)) <= {"<br>"}
    assert not re.search(r"(?<!\\)\]\(|(?<!\\)!\[", page)
    assert not re.search(r"\w://|www\.|@", page)
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e]", page)
    for block in page.split("\n\n"):
        rows = [line for line in block.splitlines() if line.startswith("|")]
        assert len({len(re.findall(r"(?<!\\)\|", row)) for row in rows}) <= 1


def check_svg(picture):
    """Fail where a picture is not XML or holds elements that a drawing does not need."""
    for element in ElementTree.fromstring(picture).iter():
        if element.tag == "{http://www.w3.org/2000/svg}style":
            assert element.text == DARK
            continue
        assert element.tag.removeprefix("{http://www.w3.org/2000/svg}") in SVG_TAGS, element.tag
        assert not [name for name in element.attrib if name.startswith("on") or "href" in name]


def check_terminal(text):
    """Fail where text contains control sequences of a terminal."""
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\ud800-\udfff]", text), repr(text)[:300]
