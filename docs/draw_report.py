"""Draw the first screen of a report for the README and the front page: `python docs/draw_report.py REPORT`.

It needs the extra `browser` and a Chromium of the system; `just pictures` draws the tour.
"""

import shutil
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

PICTURES = Path(__file__).parent / "static" / "pictures"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


def draw(report: Path) -> None:
    """Write `report-light.png` and `report-dark.png`: 1280 by 800 px."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        for scheme in ("light", "dark"):
            page = browser.new_page(viewport={"width": 1280, "height": 800}, color_scheme=scheme)
            page.goto((report / "report.html").resolve().as_uri())
            page.screenshot(path=PICTURES / f"report-{scheme}.png")
        browser.close()


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
