"""Pages of the documentation in headless Chromium, all or some: ``python tests/browser/site.py SITE [PAGE.html ...]``.

At 1280 px light and dark and at 375 px: no violation of axe-core, no sideways scroll, every equation set.
"""

import sys
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from opened import SOFTWARE, chromium
from playwright.sync_api import sync_playwright

WINDOWS = ((1280, "light"), (1280, "dark"), (375, "light"))
SHOWN = """[document.querySelectorAll('.katex-error').length, document.querySelectorAll('span.math, div.math').length
- document.querySelectorAll('.katex').length, document.documentElement.scrollWidth - window.innerWidth]"""
WRONG = ("equations with an error", "equations not set", "px wider than the window")


def faults(page, path):
    """List what is wrong with a page."""
    page.goto(path.resolve().as_uri())
    page.wait_for_function("document.readyState === 'complete'")
    found = [f"{number} {what}" for number, what in zip(page.evaluate(SHOWN), WRONG, strict=True) if number > 0]
    for violation in Axe().run(page).response["violations"]:
        found.append(f"{violation['id']}: {violation['nodes'][0]['html'][:100]}")
    return found


def main(site, *names):
    """Check all pages, or those named; return how many are at fault."""
    paths = [Path(site) / name for name in names] or sorted(Path(site).rglob("*.html"))
    wrong = 0
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=list(SOFTWARE))
        for width, scheme in WINDOWS:
            page = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
            for path in paths:
                found = faults(page, path)
                wrong += bool(found)
                for fault in found:
                    print(f"{path.relative_to(site)} at {width} px, {scheme}: {fault}")
            page.close()
        browser.close()
    print(f"{len(paths)} pages, {len(WINDOWS)} windows: {wrong} at fault")
    return wrong


if __name__ == "__main__":
    sys.exit(bool(main(*sys.argv[1:])))
