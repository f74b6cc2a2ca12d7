"""A report in headless Chromium: console messages and requests are kept, and fail the check that caused them."""

import shutil
import time
from contextlib import contextmanager
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import sync_playwright

NAMES = ("chromium", "chromium-browser", "google-chrome")
# WebGL without a graphics card
SOFTWARE = ("--no-sandbox", "--enable-unsafe-swiftshader", "--use-angle=swiftshader")

LEFT = "document.querySelector('#page [data-figure]:not(:has(.main-svg))')"
"""The first plot that is not drawn yet."""

DRAWN = f"!{LEFT}"


def chromium():
    """Path of the system's Chromium, so that Playwright's own need not be downloaded."""
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        raise SystemExit(
            f"none of {', '.join(NAMES)} is installed: `apt-get install chromium`, or give --chromium PATH"
        )
    return found


def until(page, expression, seconds=20.0):
    """Wait until an expression holds; Playwright's own waits evaluate strings, which the page's policy forbids."""
    end = time.monotonic() + seconds
    while not page.evaluate(expression):
        if time.monotonic() > end:
            raise TimeoutError(f"after {seconds:g} s there is not: {expression}")
        page.wait_for_timeout(20)


class Opened:
    """A report on a page of the browser."""

    def __init__(self, page, report):
        self.page, self.address = page, report.resolve().as_uri()
        self.trouble = []
        page.on("console", lambda m: self._note(m) if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda e: self.trouble.append(f"error: {e}"))
        page.on("request", self._request)

    def _note(self, message):
        # the software renderer warns that reading pixels back for a screenshot is slow
        if "GPU stall due to ReadPixels" not in message.text:
            self.trouble.append(f"console {message.type}: {message.text}")

    def _request(self, request):
        if request.url.partition("#")[0] != self.address and not request.url.startswith(("data:", "blob:")):
            self.trouble.append(f"request: {request.url[:200]}")

    def go(self, fragment=""):
        """Load the report from its file, at a fragment of the address."""
        self.page.goto("about:blank")
        self.page.goto(f"{self.address}{fragment}")
        until(self.page, "document.getElementById('shown').textContent !== ''")
        if fragment and not fragment.startswith(("#?", "#matrix")):
            self.page.wait_for_selector("#page h2")
        return self.page

    def turn(self, fragment, heading="#page h2"):
        """Go to another page of the report without reloading."""
        self.page.evaluate("(to) => { location.hash = to; }", fragment)
        self.page.wait_for_selector(heading)

    def joint(self, view):
        """Fragment of the page of a joint, from the page of the first case that moves; without one, that of the run."""
        moving = next((c.case for c in view.cells if c.figures), view.cases[0].name)
        self.go(f"#{next(c.anchor for c in view.cases if c.name == moving)}")
        return self.page.evaluate("document.querySelector('#page a[href^=\"#joint.\"]')?.hash") or "#about"

    def rows(self):
        """Cases that the matrix shows."""
        return self.page.eval_on_selector_all(
            "table.matrix tbody tr:not([hidden])", "all => all.map(r => r.dataset.name)"
        )

    def matched(self):
        """Number of cells that match the filters, as the page states."""
        return int(self.page.inner_text("#shown").split(" cases, ")[1].split(" ")[0])

    def violations(self):
        """Violations that axe-core finds, one line each."""
        found = Axe().run(self.page).response["violations"]
        return [f"{v['id']}: {v['help']}: {n['target']} {n['html'][:160]}" for v in found for n in v["nodes"][:3]]

    def plots_drawn(self):
        """Go to each plot of the page until it is drawn, and back to the top; return their number."""
        # scrolling may return a promise, which is no answer
        until(self.page, f"(() => {{ const left = {LEFT}; left?.scrollIntoView(); return !left; }})()")
        self.page.evaluate("window.scrollTo(0, 0)")
        return self.page.locator("#page [data-figure]").count()


@contextmanager
def browser(path=None):
    """Chromium, and a function that opens a report in a new window."""
    with sync_playwright() as playwright:
        program = playwright.chromium.launch(executable_path=str(path or chromium()), args=list(SOFTWARE))

        def window(report: Path, width=1280, height=900, scheme="light"):
            context = program.new_context(
                viewport={"width": width, "height": height},
                color_scheme=scheme,
                permissions=["clipboard-read", "clipboard-write"],
            )
            return Opened(context.new_page(), report)

        yield window
        program.close()
