"""A report in a browser, used as readers use it: ``python tests/browser REPORT.html [-o FOLDER]``, headless Chromium.

Every filter, cell, plot, replay and copy button is used, axe-core checks every kind of page in light and dark, and
screenshots are left for inspection. Needs the extra `browser`, and Chromium from the system. Exit code 1 if anything
fails.
"""

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import checks
from filters import filters
from opened import browser

from consilience.report.record import read_record
from consilience.report.view import page as view_of

NARROW = 375
WINDOWS = (("light", 1280, "light"), ("dark", 1280, "dark"), ("narrow", NARROW, "light"), ("print", 1000, "light"))
LONG = ("matrix", "filtered")
"""Pages too long for a screenshot of all of it."""

CHECKS = (
    checks.opens,
    checks.first_screen,
    filters,
    checks.sorting,
    checks.turning,
    checks.drill_down,
    checks.plots,
    checks.replay,
    checks.planes,
    checks.copying,
    checks.printing,
    checks.keyboard,
)

CUT = """[...document.querySelectorAll('.wide')].filter((e) => e.scrollWidth > e.clientWidth + 1)
  .map((e) => e.getAttribute('aria-label'))"""
"""Tables that a window shows a part of."""

SQUEEZED = """[...document.querySelectorAll('.matrix .cell a')].filter((e) => e.offsetWidth).filter((e) =>
  [...e.children].some((part) => part.offsetWidth && (part.offsetHeight > e.offsetHeight
  || part.getBoundingClientRect().left < e.getBoundingClientRect().left
  || part.getBoundingClientRect().right > e.getBoundingClientRect().right + 1))).map((e) => e.hash)"""
"""Cells of the matrix of which a mark or number does not fit into its line."""


def pages(view, joint):
    """One page of each kind, by the name of its screenshot."""
    worst = view.remarkable[0][0] if view.remarkable else view.cells[0]
    moving = next((c for c in view.cells if c.figures), view.cells[0])
    found = {"matrix": "", "filtered": "#?verdict=agrees", "cell": f"#{moving.anchor}", "worst": f"#{worst.anchor}"}
    found |= {"case": f"#{view.cases[0].anchor}", "engine": f"#{view.engines[0].anchor}"}
    found["joint"] = joint
    return found | {name: f"#{name}" for name in ("findings", "choice", "defaults", "orders", "softness", "about")}


def accessible(window, report, view):
    """Check accessibility of every kind of page in light, dark and narrow windows."""
    for scheme, width in (("light", 1280), ("dark", 1280), ("light", NARROW)):
        opened = window(report, width, 900, scheme)
        joint = opened.joint(view)
        for name, fragment in pages(view, joint).items():
            opened.go(fragment)
            opened.plots_drawn()
            opened.page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
            opened.page.wait_for_timeout(300)
            yield from (f"{name}, {scheme}, {width} px: {line}" for line in opened.violations())
            if opened.page.evaluate("document.documentElement.scrollWidth") > width:
                yield f"{name}: wider than a window of {width} px"
            yield from (f"{name}: {cell} is squeezed at {width} px" for cell in opened.page.evaluate(SQUEEZED)[:5])
            if width > NARROW:
                yield from (f"{name}: cut at {width} px: {label}" for label in opened.page.evaluate(CUT))
        yield from opened.trouble
        opened.page.context.close()


def screenshots(window, report, view, folder):
    """Take screenshots: light, dark, narrow and as printed."""
    folder.mkdir(parents=True, exist_ok=True)
    for kind, width, scheme in WINDOWS:
        opened = window(report, width, 900, scheme)
        joint = opened.joint(view)
        if kind == "print":
            opened.page.emulate_media(media="print")
        for name, fragment in pages(view, joint).items():
            opened.go(fragment)
            opened.plots_drawn()
            opened.page.wait_for_timeout(700)
            opened.page.screenshot(path=str(folder / f"{name}_{kind}.png"), full_page=name not in LONG)
        opened.page.context.close()


def main(arguments=None):
    """Run the checks that the command line asks for; exit code 1 if anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("report", type=Path, help="report.html, with its report.jsonl beside it")
    parser.add_argument("-o", "--output", type=Path, default=Path("screenshots"), help="folder of the screenshots")
    parser.add_argument("--chromium", help="path of the browser; default: the system's")
    parser.add_argument("--only", action="append", help="name of a check; repeat it")
    given = parser.parse_args(arguments)
    view = view_of(read_record(given.report.parent))
    bad, size = [], given.report.stat().st_size
    print(f"{given.report}: {size / 1e6:.2f} MB, {len(view.cases)} cases, {len(view.cells)} cells")
    if size > checks.SIZE:
        bad.append(f"larger than {checks.SIZE / 1e6:g} MB")
    with browser(given.chromium) as window:
        for check in CHECKS:
            if given.only and check.__name__ not in given.only:
                continue
            opened, start = window(given.report), time.perf_counter()
            found = list(check(opened, view, lambda text: print(f"    {text}")))
            bad += [f"{check.__name__}: {text}" for text in (*found, *opened.trouble)]
            wrong = len(found) + len(opened.trouble)
            print(f"{check.__name__}: {wrong} wrong ({time.perf_counter() - start:.1f} s)", flush=True)
            opened.page.context.close()
        if not given.only or "accessible" in given.only:
            found = list(accessible(window, given.report, view))
            bad += [f"accessible: {text}" for text in found]
            print(f"accessible: {len(found)} wrong")
        if not given.only or "screenshots" in given.only:
            screenshots(window, given.report, view, given.output)
            print(f"screenshots in {given.output}: look at them")
    print("\n".join(bad) or "all well")
    sys.exit(bool(bad))


if __name__ == "__main__":
    main()
