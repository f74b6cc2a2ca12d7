"""Draw the moving picture of the README: `python docs/draw_motion.py` writes it anew."""

from pathlib import Path

import consilience as cs
from consilience.mechanism import State
from consilience.report.sketch import sketch

PICTURE = Path(__file__).parent / "static" / "pictures" / "peaucellier.svg"
CASE, DURATION, FRAMES = "peaucellier_linkage", 2.0, 61
LIGHT, DARK = ("svg{{color:{}}}.paper{{fill:{}}}".format(*ink) for ink in (("#333a45", "#fff"), ("#d5dae2", "#0d1117")))
INK = f"<style>{LIGHT}@media(prefers-color-scheme:dark){{{DARK}}}</style>"


def drawn() -> str:
    """Return the picture: the motion of the case there and back, in ink for light and dark pages."""
    case = cs.load_case(CASE)
    times = [DURATION * n / (FRAMES - 1) for n in range(FRAMES)]
    motion = cs.simulate(case.mechanism, case.initial_state, times)
    states: list[State] = [motion.state(n) for n in range(FRAMES)]
    svg = sketch(case.mechanism, [*states, *states[-2::-1]], case.title, 2 * DURATION)
    head, _, body = svg.lstrip().partition("\n")
    return f"{head}\n{INK}\n{body}\n"


if __name__ == "__main__":
    PICTURE.write_text(drawn(), encoding="utf-8")
