"""Filters of the matrix against the record, evaluated here by code other than the page's."""

from itertools import combinations

from opened import until

from consilience.compare import Verdict
from consilience.report.wording import LOOKS

BOX = "[...document.querySelectorAll(`input[name=${k}]`)].find(b => b.value === v)"


def tests_of(view):
    """Predicates on cells for each value of each filter."""
    tags = {case.name: set(case.tags) for case in view.cases}
    return {
        "verdict": {look.key: lambda c, look=look: c.look is look for look in LOOKS.values()},
        "engine": {e.name: lambda c, e=e: c.engine == e.name for e in view.engines},
        "question": {q: lambda c, q=q: any(a.question == q for a in c.matched) for q in view.questions},
        "blind": {"1": lambda c: c.blind},
        "tag": {t: lambda c, t=t: t in tags[c.case] for t, _ in view.tags},
    }


def compared(opened, cells, asked, what):
    """Check that the page shows exactly the cells that satisfy a predicate, and their cases."""
    found, expected = opened.matched(), [c for c in cells if all(test(c) for test in asked)]
    if found != len(expected):
        yield f"{what}: {found} cells, {len(expected)} in the record"
    if sorted(opened.rows()) != sorted({c.case for c in expected}):
        yield f"{what}: other cases than in the record"


def filters(opened, view, told):
    """Every filter alone and pairs of kinds of filters, against the record; the page address restores them."""
    cells = [c for c in view.cells if c.engine != "reference"]
    kinds = tests_of(view)
    yield from alone(opened, cells, kinds)
    pairs = [
        ((one, a), (other, b))
        for one, other in combinations(("verdict", "engine", "tag"), 2)
        for a in list(kinds[one])[:4]
        for b in list(kinds[other])[:4]
    ]
    for (one, a), (other, b) in pairs:
        opened.go(f"#?{one}={a}&{other}={b}".replace(" ", "+"))
        asked = [kinds[one][a], kinds[other][b]]
        yield from compared(opened, cells, asked, f"{one} {a} and {other} {b} from the address")
    yield from lone(opened, view, cells)
    yield from search(opened, view)
    told(f"{sum(map(len, kinds.values()))} filters and {len(pairs)} pairs against the record")


def alone(opened, cells, kinds):
    """Each filter alone, and the number of cells that the page shows beside it."""
    page = opened.go()
    page.evaluate("document.querySelectorAll('#filters details').forEach((d) => { d.open = true; })")
    until(page, "[...document.querySelectorAll('.count')].every((c) => c.textContent !== '')")
    for kind, values in kinds.items():
        for value, test in values.items():
            tick(page, kind, value)
            yield from compared(opened, cells, [test], f"{kind} {value}")
            shown = page.evaluate(f"([k, v]) => {BOX}.parentElement.querySelector('.count').textContent", [kind, value])
            number = len({c.case for c in cells if test(c)}) if kind == "tag" else sum(map(test, cells))
            if shown != f"({number})":
                yield f"{kind} {value}: {shown} beside it, {number} in the record"
            if f"{kind}=" not in page.url:
                yield f"{kind} {value} is not in the address"
            tick(page, kind, value)


def search(opened, view):
    """Search for a part of a name, then clear the search."""
    page = opened.go()
    part = view.cases[0].name[:4].lower()
    page.fill("#find", part)
    texts = {c.name: " ".join((c.name, c.title, *c.tags)).lower() for c in view.cases}
    if sorted(opened.rows()) != sorted(n for n, text in texts.items() if part in text) or "find=" not in page.url:
        yield "the search for a name finds other cases, or is not in the address"
    page.click("button[type=reset]")
    until(page, "!location.hash.includes('find')")
    if len(opened.rows()) != len(view.cases):
        yield "not everything is shown again"
    page.fill("#find", "no case is called this")
    if opened.rows() or not page.is_visible("#no-match"):
        yield "a filter without matches does not say so"


def tick(page, kind, value):
    """Click the box of a filter, and wait until the page address contains the filter."""
    page.evaluate(f"([k, v]) => {BOX}.click()", [kind, value])


def lone(opened, view, cells):
    """The filter for cases in which only one engine means another model."""
    page = opened.go()
    tick(page, "lone", "1")
    expected = []
    for case in view.cases:
        answered = [c for c in cells if c.case == case.name and c.look in LOOKS.values()]
        answered = [c for c in answered if c.look not in (LOOKS[Verdict.UNSUPPORTED], LOOKS[Verdict.FAILED])]
        apart = [c for c in answered if any(a.look is LOOKS[Verdict.MODEL] for a in c.counting)]
        expected += [case.name] if len(apart) == 1 and len(answered) > 1 else []
    if sorted(opened.rows()) != sorted(expected):
        yield f"only one engine means another model: {len(opened.rows())} cases, {len(expected)} in the record"
    page.reload()
    until(page, "document.getElementById('shown').textContent !== ''")
    if "lone=1" not in page.url or sorted(opened.rows()) != sorted(expected):
        yield "loaded again, the page has lost its filters"
