"""A user's script with types, which mypy checks strictly with the package; `tests/unit/test_library.py` runs it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import consilience as cs


def pendulum(length: float) -> cs.Case:
    """A rod of 2 kg that is released at 0.3 rad."""
    draw = cs.Drawing("pendulum", gravity=(0, 0, -9.81))
    draw.body("rod", cs.bar((0, 0, 0), (0, 0, -length), radius=0.01), mass=2.0)
    draw.joint("pin", "revolute", "ground", "rod", at=(0, 0, 0), axis=(0, 1, 0))
    return draw.case(start={"pin": 0.3}, duration=1.0, sample=0.1)


def swing(case: cs.Case) -> NDArray[np.float64]:
    """The angle over time."""
    motion: cs.Simulation = cs.simulate(case)
    angle: NDArray[np.float64] = motion.coordinates("pin")
    return angle


def answers(case: cs.Case, folder: Path) -> dict[str, float]:
    """A number of each part of the library."""
    state: cs.State = cs.initial_state(case.mechanism, case.initial)
    instant = cs.accelerations(case.mechanism, [state])
    study: cs.Study = cs.study(case, {"rod.mass": [1.0, 2.0]}, duration=0.5)
    many: cs.Study = cs.simulate_many(case, [state])
    again: cs.Case = cs.load_case(case.mechanism.save(folder / "pendulum.toml"))
    reading: dict[int, str] = dict(study.failures)
    return {
        "angle": float(swing(case)[-1]),
        "acceleration": float(instant.alpha_WB_W[0, 0, 1]),
        "of a study": float(study.coordinates("pin")[1, -1]),
        "of a state": float(many.motion(0).coordinates("pin")[-1]),
        "bodies of a file": float(len(again.mechanism.bodies)),
        "failures": float(len(reading)),
    }


def shown(case: cs.Case, folder: Path) -> list[Path]:
    """Files of a motion: its plot and its replay."""
    motion = cs.simulate(case)
    motion.plot("pin", what="reactions").savefig(folder / "plot.svg")
    total: NDArray[np.float64] = motion.energy()["total"] + 0.0 * motion.reactions("pin")[:, 0]
    return [folder / "plot.svg", motion.animate().save(folder / f"{len(total)}.html")]


def driven(folder: Path) -> cs.Mechanism:
    """A rod on a driven joint with frames of its own, saved and read again."""
    draw = cs.Drawing("driven", gravity=(0, 0, -9.81))
    draw.body("rod", mass=1.0, inertia=(0.1, 0.1, 0.01), at=cs.frame((0, 0, 0), (1, 0, 0, 0)))
    draw.joint("pin", "revolute", "ground", "rod", F=cs.frame((0, 0, 0)), M=cs.frame((0.1, 0, 0), np.eye(3)))
    draw.add("drive", "motor", joint="pin", coordinate="angle", motion=cs.sine(0.5, 4.0))
    return cs.load_case(draw.mechanism().save(folder / "driven.toml")).mechanism


def compared(case: cs.Case | cs.Mechanism | cs.Drawing, folder: Path) -> str:
    """The table of a comparison."""
    agreement: cs.Agreement = cs.compare(case, ["reference"], [cs.Question.MODEL])
    agreement.save(folder / "report")
    return str(agreement)
