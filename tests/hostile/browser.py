"""Hostile text in a real browser must stay inert: ``python tests/hostile/browser.py [--browser chromium]``

Renders a report with each payload in every text of a case, an engine and a message, opens the report in headless
Chromium, unfolds and clicks every control, and checks whether the payload ran. A control page that embeds the payload
unescaped shows that the check can detect a payload. Exit code 1 if a payload ran in a report or did not run in the
control page.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from consilience.report.html import render_html
from consilience.report.record import read_record
from hostile.mutations import TEXTS
from hostile.properties import hostile_everywhere, report_seed

PAYLOADS = [text for text in TEXTS if "window.hit" in text]

PROBE = """<script>
addEventListener("load", () => setTimeout(() => {
  for (const e of document.querySelectorAll("details")) e.open = true;
  for (const e of document.querySelectorAll("body *")) {
    for (const kind of ["mouseover", "focus", "input", "change"]) e.dispatchEvent(new Event(kind, {bubbles: true}));
    if (!e.closest("script, form") && (!e.href || String(e.href.baseVal ?? e.href).startsWith("javascript:"))) {
      e.dispatchEvent(new MouseEvent("click", {bubbles: true, cancelable: true}));
    }
  }
  setTimeout(() => { document.documentElement.dataset.hit = window.hit ? "yes" : "no"; }, 300);
}, 300));
</script>"""


def ran(browser, page, folder):
    """Whether the payload of a page ran."""
    file = folder / "page.html"
    file.write_text(page.replace("</body>", f"{PROBE}</body>"), encoding="utf-8")
    flags = ("--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=20000", "--dump-dom")
    offline = "--host-resolver-rules=MAP * ~NOTFOUND"
    command = [browser, *flags, offline, f"--user-data-dir={folder / 'profile'}", file.as_uri()]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True).stdout
    told = {word for word in ("yes", "no") if f'data-hit="{word}"' in shown[:2000]}
    if len(told) != 1:
        raise RuntimeError(f"the page does not say whether it was hit: {shown[:300]}")
    return told == {"yes"}


def main(arguments=None):
    """Check every page; return whether anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--browser", default="chromium")
    browser = parser.parse_args(arguments).browser
    wrong = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _, lines = report_seed(folder / "seed")
        for payload in PAYLOADS:
            own = folder / "report"
            own.mkdir(exist_ok=True)
            text = "".join(json.dumps(line) + "\n" for line in hostile_everywhere(lines, payload))
            (own / "report.jsonl").write_text(text, encoding="utf-8")
            page = render_html(read_record(own))
            hit = ran(browser, page, folder)
            wrong += hit
            print(f"{payload!r}: {'RAN' if hit else 'inert'}, {page.count('window.hit')} times in the page", flush=True)
        bare = {
            "script": "<script>window.hit=1</script>",
            "handler": '<img src="x" onerror="window.hit=1">',
            "link": '<a href="javascript:window.hit=1">x</a>',
        }
        for what, text in bare.items():
            if not ran(browser, f"<!doctype html><html><body>{text}</body></html>", folder):
                wrong += 1
                print(f"a bare {what} was not seen to run")
    print(f"{len(PAYLOADS)} payloads, {wrong} wrong")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
