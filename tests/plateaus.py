"""Where a sliding cube stops, by every engine at several headings, against the reference with the law of each method.

python tests/plateaus.py                  a table in Markdown
python tests/plateaus.py -e mujoco 0 20   of one engine, at some headings in degrees

A *plateau* is the way from the place where Coulomb's law stops the cube to that of the law that a method solves: no
step of the engine takes it away. A rigid law is solved by the reference from event to event; the engine's place is then
the one to which its two finest levels lead, by the order that its method declares. A soft convex law makes the cube
hop, so that its place has no limit that steps come near; it is solved step by step (`soft_cones`), as by the engine,
from a start `SUNK` into the plane: at a gap of zero rounding chooses the corners that act in the first step.
"""

import argparse
from dataclasses import dataclass, replace

import numpy as np

from consilience.case import load_cases
from consilience.engine import Question, load_engine
from consilience.mechanism import rotation_from_quaternion
from consilience.reference.contact import simulate_with_contacts
from consilience.suite.engine_runs import levels_of
from consilience.suite.other_laws import with_law
from soft_cones import SoftContact

HEADINGS = (0.0, 15.0, 20.0, 30.0, 45.0)
ENGINES = ("mujoco", "dart", "pinocchio", "exudyn")
SUNK = 1e-9
"""Overlap at the start under a soft law, m."""


@dataclass(frozen=True)
class Plateau:
    """Plateau of a method at a heading, and the way from it to the engine's place, m; the step of a soft law, s."""

    heading: float
    method: str
    plateau: float
    off: float
    step: float | None


def plateaus(engine, heading, methods=lambda method: True):
    """Yield the plateaus of the methods of an engine at a heading."""
    (case,) = load_cases(f"sliding_cube:heading={heading:g}")
    mechanism, start, times = case.mechanism, case.initial_state, case.times
    com = np.asarray(mechanism.bodies[0].com)

    def place(answer):
        return answer.p_WB[-1, 0] + rotation_from_quaternion(answer.quat_WB[-1, 0]) @ com

    def rigid(law):
        return place(simulate_with_contacts(with_law(mechanism, law) if law else mechanism, start, times, 1e-11)[0])

    coulomb = rigid(None)
    for method in filter(methods, engine.methods(mechanism, Question.TRAJECTORY)):
        levels = levels_of(case, Question.TRAJECTORY, method)
        soft = levels[0] if "soft" in method.contact_law else None
        at = replace(start, p_WB=start.p_WB - SUNK * mechanism.contacts[0].normal) if soft else start
        places = [place(engine.trajectory(mechanism, at, times, method, h)) for h in ([soft] if soft else levels[-2:])]
        if soft:
            (found,) = places
            law = SoftContact(mechanism, method.law and np.array(method.law.cone.tangent)).stop(at, times[-1], soft)
        else:
            ratio = (levels[-2] / levels[-1]) ** (method.order or 1)
            found, law = places[1] + (places[1] - places[0]) / (ratio - 1.0), rigid(method.law)
        sizes = (float(np.linalg.norm(way)) for way in (law - coulomb, found - law))
        yield Plateau(heading, method.name, *sizes, soft)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("headings", nargs="*", type=float, default=HEADINGS, help="degrees from the first tangent")
    parser.add_argument("-e", "--engine", action="append", dest="engines", help="of several, one option each")
    given = parser.parse_args()
    print("| engine | method | heading, deg | law | plateau, m | off, m | off over plateau |")
    print("|---|---|---|---|---|---|---|")
    for name in given.engines or ENGINES:
        engine = load_engine(name)
        for heading in given.headings:
            for one in plateaus(engine, heading):
                law = f"soft, steps of {one.step:g} s" if one.step else "rigid"
                part = f"{one.off / one.plateau:.1e}" if one.plateau > 1e-9 else "Coulomb's"
                row = (name, one.method, f"{heading:g}", law, f"{one.plateau:.4f}", f"{one.off:.1e}", part)
                print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
