"""Checks of a report in a browser; each check is a generator of the errors that it finds."""

import json
import statistics

from opened import DRAWN, until

FIRST_VIEW = 1.5
FILTERED = 0.1
LOADS = 5
SIZE = 10e6
FURTHER = 4
"""Number of pages that are turned."""


def opens(opened, view, told):
    """The first view: loading time, size, and no network request."""
    page, seen, ready = opened.page, [], []
    for _ in range(LOADS):
        opened.go()
        until(page, "performance.getEntriesByName('first-contentful-paint').length")
        paints = "performance.getEntriesByType('paint').map(p => [p.name, p.startTime])"
        seen.append(dict(page.evaluate(paints))["first-contentful-paint"] / 1000)
        ready.append(page.evaluate("performance.getEntriesByType('navigation')[0].domContentLoadedEventEnd") / 1000)
    first, usable = statistics.median(seen), statistics.median(ready)
    filtered = page.evaluate(
        """() => { const find = document.getElementById('find'), start = performance.now();
        find.value = 'pendulum'; find.dispatchEvent(new Event('input', { bubbles: true }));
        document.body.offsetHeight; return (performance.now() - start) / 1000; }"""
    )
    told(f"first view {first:.2f} s, filters ready {usable:.2f} s (medians of {LOADS}), filtered in {filtered:.3f} s")
    if filtered > FILTERED:
        yield f"filtered in {filtered:.3f} s"
    if first > FIRST_VIEW:
        yield f"first view after {first:.2f} s"
    if page.locator("table.matrix tbody tr").count() != len(view.cases):
        yield "the matrix has not a row for each case"


def drill_down(opened, view, told):
    """Every cell opens its layers in order: verdicts, numbers, manifest, settings and command."""
    opened.go()
    page, layers, settings, gauges = opened.page, 0, 0, 0
    for cell in view.cells:
        opened.turn(f"#{cell.anchor}")
        name = json.dumps(f"{cell.case} on {cell.engine} ")
        until(page, f"document.querySelector('#page h2').textContent.startsWith({name})")
        found = page.evaluate(
            """() => ({
              layers: [...document.querySelectorAll('#page .layer > summary h3')].map(e => e.textContent),
              open: document.querySelectorAll('#page .layer[open]').length,
              command: document.querySelector('#page .copy').dataset.copy,
              manifest: document.querySelectorAll('#page .manifest div').length,
              answers: document.querySelectorAll('#page article').length,
              settings: [...document.querySelectorAll('#page article details summary')]
                .filter(e => e.textContent.includes('setting')).length,
              gauges: document.querySelectorAll('#page .gauge').length,
            })"""
        )
        asked = [q for q in ("model", "instant", "trajectory") if any(a.question == q for a in cell.answers)]
        if found["layers"] != asked:
            yield f"{cell.anchor}: layers {found['layers']}, not {asked}"
        if asked and not found["open"]:
            yield f"{cell.anchor}: no layer is open"
        if found["command"] != cell.command:
            yield f"{cell.anchor}: another command"
        if found["manifest"] != len(cell.exact) + len(cell.approximated):
            yield f"{cell.anchor}: another manifest"
        if found["answers"] != len(cell.answers):
            yield f"{cell.anchor}: not every answer"
        layers, settings, gauges = layers + len(asked), settings + found["settings"], gauges + found["gauges"]
    told(f"{len(view.cells)} cells, {layers} layers, {gauges} scales with bars, settings of {settings} answers")


SCROLLED = """[...document.querySelectorAll('#page .legend .scrollbar')]
  .filter((bar) => bar.getBoundingClientRect().height > 0).length"""
"""Number of legends of which a plot shows a part."""


def plots(opened, view, told):
    """Every kind of plot is drawn, on all case pages and for one cell each."""
    opened.go()
    drawn, kinds = 0, set()
    for case in view.cases:
        cell = next((c for c in case.cells if c.figures), case.cells[0])
        for anchor in (case.anchor, cell.anchor):
            opened.turn(f"#{anchor}", f"#page h2:has-text({case.name!r})")
            drawn += opened.plots_drawn()
            if opened.page.evaluate(SCROLLED):
                yield f"{anchor}: a legend has no room"
            kinds |= set(
                opened.page.eval_on_selector_all(
                    "#page [data-figure]", "all => all.map(p => p.dataset.figure.split('.')[0])"
                )
            )
    told(f"{drawn} plots of {len(kinds)} kinds: {', '.join(sorted(kinds))}")
    missing = {"difference", "energy", "drift", "work", "steps", "reactions", "horizon"} - kinds
    if missing:
        yield f"no plot of {', '.join(sorted(missing))}"


def replay(opened, view, told):
    """A replay plays, stops, follows its sliders, tells its contacts, shows and hides ghosts, and has four views."""
    opened.go()
    page, tried = opened.page, 0
    for case in view.cases:
        opened.turn(f"#{case.anchor}", f"#page h2:has-text({case.name!r})")
        place = page.locator("#page .replay")
        if not place.count():
            continue
        place.scroll_into_view_if_needed()
        page.wait_for_selector("#page .replay canvas")
        tried += 1
        if tried > 3:
            continue  # every case loads without an error: three are operated
        frame = "Number(document.querySelector('.replay').dataset.frame)"
        time = "Number(document.getElementById('replay-time').value)"
        page.click("#page .replay button:text-is('play')")
        until(page, f"{frame} > 1")
        page.click("#page .replay button:text-is('pause')")
        held = page.evaluate(time)
        until(page, f"Math.abs({frame} - {time}) < 0.01")  # the drawn frame must reach the time of the slider
        page.wait_for_timeout(300)
        if page.evaluate(time) != held:
            yield f"{case.name}: it goes on after a pause"
        pictures = {}
        last = page.evaluate("document.getElementById('replay-time').max")
        acts = {
            "end": lambda last=last: slide(page, "time", last),
            "above": lambda: page.click("text=from above"),
            "right": lambda: page.click("text=from the right"),
        }
        if page.locator("#page .phases").count() and not page.inner_text(".replay .contacts"):
            yield f"{case.name}: it tells no contacts"
        if page.locator("#replay-factor").count():  # an engine exists for comparison
            acts["enlarged"] = lambda: slide(page, "factor", 1)
            acts["no ghosts"] = lambda: [box.uncheck() for box in page.locator(".replay input[type=checkbox]").all()]
        for name, act in acts.items():
            act()
            page.wait_for_timeout(300)
            pictures[name] = page.locator(".replay canvas").screenshot()
        if len(set(pictures.values())) < len(pictures) - 1:  # bitwise equal answers leave no difference to magnify
            yield f"{case.name}: a control of the replay changes nothing"
    told(f"{tried} replays made, {min(tried, 3)} handled")
    if not tried:
        yield "there is no replay"


PLANE = """() => {
  const texts = [...document.scripts].map((script) => script.textContent);
  const text = texts.find((one) => one.includes('function planes('));
  const source = text.slice(text.indexOf('function planes('), text.indexOf('// arrows and gaps'));
  const lineOf = (points) => new THREE.BufferGeometry().setFromPoints(points), Z = () => new THREE.Vector3(0, 0, 1);
  const planes = new Function('lineOf', 'Z', `${source}; return planes;`)(lineOf, Z), drawn = new THREE.Group();
  const points = [[2, 0, 0], [0, 1, 0], [-1, 1, 1], [1, 0, 1]];
  const box = { middle: new THREE.Vector3(3, -1, 4), size: 2 };
  planes({ lines: [{ kind: 'plane', body: -1, points }] }, box, { quiet: 0 }, () => drawn);
  return drawn.children[0].position.toArray();
}"""
"""Middle of the plane x + 2 y + z = 2 as it is drawn where a motion has its middle at (3, -1, 4)."""


def planes(opened, view, told):
    """A plane that is fixed is drawn at its own place, below the middle of the motion: there its normal pierces it."""
    opened.go()
    page = opened.page
    for case in view.cases:
        opened.turn(f"#{case.anchor}", f"#page h2:has-text({case.name!r})")
        if page.locator("#page .replay").count():
            break
    page.locator("#page .replay").scroll_into_view_if_needed()
    page.wait_for_selector("#page .replay canvas")
    found = page.evaluate(PLANE)
    told(f"middle of the plane {found}")
    if max(abs(a - b) for a, b in zip(found, (2.5, -2.0, 3.5), strict=True)) > 1e-12:  # (3, -1, 4) - (1, 2, 1) 3 / 6
        yield f"the plane is drawn at {found}"


def slide(page, name, value):
    """Move a slider as a user does."""
    page.evaluate(
        "([id, v]) => { const e = document.getElementById(id); e.value = v; e.dispatchEvent(new Event('input')); }",
        [f"replay-{name}", str(value)],
    )


def copying(opened, view, told):
    """Every kind of copy button copies its command to the clipboard."""
    opened.go()
    page = opened.page
    anchors = [view.cells[0].anchor, view.cells[-1].anchor, view.cases[0].anchor, "about"]
    for anchor in anchors:
        opened.turn(f"#{anchor}")
        page.wait_for_timeout(100)
        for button in page.locator("#page button.copy").all():
            button.click()
            until(page, "[...document.querySelectorAll('.copy')].some(b => b.textContent === 'copied')")
            wanted, got = button.get_attribute("data-copy"), page.evaluate("navigator.clipboard.readText()")
            if wanted != got or not wanted.startswith("consilience "):
                yield f"#{anchor}: {got!r} is copied, not {wanted!r}"
    told(f"copy buttons of {len(anchors)} pages")


OUT = """() => [...document.querySelectorAll('.matrix :is(td, thead th), .engines :is(th, td)')].filter((place) => {
  const box = place.getBoundingClientRect();
  return [...place.querySelectorAll('*')].some((e) => {
    const own = e.getBoundingClientRect();
    return own.width && (own.left < box.left - 1 || own.right > box.right + 1 || own.bottom > box.bottom + 1);
  });
}).map((place) => place.textContent.trim().replace(/\\s+/g, ' '))"""
"""Places of the tables that something sticks out of."""


def first_screen(opened, view, told):
    """Before any scrolling: the headline, a row for each engine, what to look at, and the matrix begins."""
    page = opened.go()
    if page.inner_text(".lead h2") != view.headline:
        yield "another headline"
    places = {
        "engines": ".engines tbody tr:last-child td:last-child",
        "look first": ".first li:last-child",
        "matrix": ".matrix tbody tr",
    }
    if not view.look_first.lines:
        del places["look first"]
    for width, height, wanted in ((1280, 800, places), (375, 2 * 812, places.keys() - {"matrix"})):
        page.set_viewport_size({"width": width, "height": height})
        ends = {}
        for name in wanted:
            box = page.locator(places[name]).first.bounding_box()
            ends[name] = box["y"] + box["height"]
        yield from (f"{name} ends below {height} px at {width} px" for name, end in ends.items() if end > height)
        yield from (f"at {width} px something sticks out of '{text}'" for text in page.evaluate(OUT)[:5])
        told(f"{width} px: {', '.join(f'{name} to {end:.0f} px' for name, end in ends.items())}")


def sorting(opened, view, told):
    """A head sorts by its column, and again the other way round; the header stays in view."""
    page = opened.go()
    name = ".matrix thead th:first-child button"
    for order in (sorted, lambda names: sorted(names, reverse=True)):
        page.click(name)
        shown = opened.rows()
        if [n.lower() for n in shown] != order([n.lower() for n in shown]):
            yield "cases are not in the order of their names"
    head = page.locator(".matrix thead th button").nth(1)
    head.click()
    cells = "all => all.map(r => Number(r.querySelector('td.cell').dataset.digits))"
    digits = page.eval_on_selector_all(".matrix tbody tr", cells)
    if digits != sorted(digits):
        yield "cases are not in the order of the digits of the first engine"
    page.evaluate("window.scrollTo(0, document.body.scrollHeight)")
    if page.locator(".matrix thead th").first.bounding_box()["y"] < 0:
        yield "the header of the matrix leaves the window"
    told(f"{len(digits)} rows sorted")


def turning(opened, view, told):
    """A page leads to the previous and next case in the order of the matrix, and back."""
    opened.go()
    page = opened.page
    first, *_, last = [row.case for row in view.rows]
    if first is last:
        return
    engine = view.engine_names[0]
    cells = [next(c for c in row.case.cells if c.engine == engine).anchor for row in view.rows]
    for anchors in ([row.case.anchor for row in view.rows], cells):
        opened.turn(f"#{anchors[0]}")
        until(page, f"location.hash === {json.dumps(f'#{anchors[0]}')}")
        if page.locator(".turn [rel=prev]").count():
            yield "there is a page before the first"
        for wanted in anchors[1:FURTHER]:
            page.click(".turn [rel=next]")
            until(page, f"location.hash === {json.dumps(f'#{wanted}')}")
        opened.turn(f"#{anchors[-1]}", f"#page h2:has-text({last.name!r})")
        if page.locator(".turn [rel=next]").count():
            yield "there is a page behind the last"
    told(f"{len(view.rows[:FURTHER])} cases and cells in a row")


PAPER = 718
"""Width of a sheet of A4 between margins of 10 mm, px."""

CUT = """() => [...document.querySelectorAll('body *')].filter((e) => {
  const box = e.getBoundingClientRect(), style = getComputedStyle(e);
  if (!box.width || !box.height || e.closest('.hidden, .skip, svg, .modebar')) return false;
  const hides = style.overflowX !== 'visible' && e.scrollWidth > e.clientWidth + 1;
  return hides || box.right > window.innerWidth + 1;
}).map((e) => `${e.tagName.toLowerCase()}.${e.className}: ${e.textContent.trim().slice(0, 60)}`)"""
"""Elements that a sheet of paper cuts off, or that hide a part of themselves."""

HEADLESS = """[...document.querySelectorAll('thead th')]
  .filter((head) => head.offsetWidth && !head.innerText.trim()).length"""
"""Number of heads of columns that show no text."""


def printing(opened, view, told):
    """Printed, nothing is cut off, and all parts that a reader can unfold are open."""
    page, shown = opened.page, 0
    page.set_viewport_size({"width": PAPER, "height": 1000})
    moving = next((c for c in view.cells if c.figures), view.cells[0])
    joint = opened.joint(view)[1:]
    for anchor in (
        "",
        moving.anchor,
        view.cases[0].anchor,
        view.engines[0].anchor,
        "findings",
        "choice",
        "about",
        joint,
    ):
        opened.go(f"#{anchor}" if anchor else "")
        page.emulate_media(media="print")
        page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
        until(page, DRAWN)  # also those that nobody has come near
        page.wait_for_timeout(400)
        shown += 1
        yield from (f"#{anchor}: cut: {text}" for text in page.evaluate(CUT)[:5])
        if page.evaluate(HEADLESS):
            yield f"#{anchor}: a column has lost its head"
        if page.locator("#page details:not([open])").count():
            yield f"#{anchor}: a part stays folded"
        page.emulate_media(media="screen")
    told(f"{shown} pages at {PAPER} px")


def keyboard(opened, view, told):
    """Arrow keys move in the matrix, Enter opens a cell, Escape returns to the same cell; Tab reaches all filters."""
    page = opened.go()
    first = view.cases[0]
    page.focus(f'td.cell a[href="#{first.cells[0].anchor}"]')
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowDown")
    wanted = page.evaluate("document.activeElement.hash")
    several = len(view.cases) > 1 and len(view.engines) > 2  # the reference has no column
    if several and wanted != f"#{view.cases[1].cells[1].anchor}":
        yield "arrow keys lead elsewhere"
    page.keyboard.press("Enter")
    page.wait_for_selector("#page h2")
    if page.evaluate("document.activeElement.id") != "page-title":
        yield "the opened page does not take the focus"
    page.keyboard.press("Escape")
    until(page, "!document.getElementById('overview').hidden")
    if page.evaluate("document.activeElement.hash") != wanted:
        yield "Escape does not lead back"
    page = opened.go()
    page.evaluate("document.querySelector('#filters .all').open = true")
    reached = set()
    for _ in range(120):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.name || document.activeElement.hash || ''"))
    missing = {"find", "verdict", "engine", "question", "lone", "#findings"} - reached
    if missing:
        yield f"Tab does not reach {missing}"
    told(f"{len(reached)} places by Tab")
