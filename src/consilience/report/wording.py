"""Words, symbols and numbers of the report, one table for each, shared by all pages."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any

from consilience.compare import CODES, Verdict
from consilience.compare.power import LARGEST
from consilience.compare.rules import CONVERGENCE
from consilience.engine import Profile, Route
from consilience.engine.failures import FailureClass
from consilience.mechanism.perturbation import AXIS, PLACE

DASH = "\N{EM DASH}"


@dataclass(frozen=True)
class Look:
    """Appearance of a verdict: a symbol and a name, never a colour alone.

    Attributes
    ----------
    key : str
        Key of the verdict in the address of the page.
    tint : str
        Colour class of an answer; `model_tint` that of a cell, where few digits are no colour.
    symbol : str
        One character.
    name : str
        The verdict in words.
    sentence : str
        Meaning of the verdict, for the legend.
    verdict : str
        The verdict itself, as in the record; empty where there is none.
    """

    key: str
    tint: str
    symbol: str
    name: str
    sentence: str
    verdict: str = ""

    @property
    def rank(self) -> int:
        """Rank among the verdicts, the best 0; below all where there is none."""
        return RANK.get(self.verdict, -1)

    @property
    def urgency(self) -> tuple[bool, int]:
        """Rank among what to look at: another model first, since it is what a run is for."""
        return self.verdict == Verdict.MODEL, self.rank

    @property
    def wants_look(self) -> bool:
        """Whether the verdict is among those of an exit code other than 0."""
        return bool(self.verdict) and CODES[Verdict(self.verdict)] != 0

    @property
    def model_tint(self) -> str:
        """Colour class of a cell."""
        return "same" if self.tint == "short" else self.tint


_WORDS = {
    Verdict.AGREES: (
        "same",
        "\N{CHECK MARK}",
        "agrees",
        "The difference to the reference is within the bar that was asked.",
    ),
    Verdict.DISCRETISATION: (
        "short",
        "\N{ALMOST EQUAL TO}",
        "same model, coarse steps",
        "The steps are too coarse for the digits asked, but smaller ones lead to the reference: no disagreement.",
    ),
    Verdict.REGULARISATION: (
        "short",
        "\N{PROPORTIONAL TO}",
        "same model, soft constraints",
        "The engine's constraints are soft, and the difference goes away with that softness: the model is the same.",
    ),
    Verdict.UNSUPPORTED: (
        "none",
        "\N{EMPTY SET}",
        "unsupported",
        "The engine cannot represent something in the case, and says what: not a failure, and not counted as one.",
    ),
    Verdict.UNRESOLVED: (
        "unsure",
        "?",
        "cannot tell",
        "The runs do not suffice to decide: not asymptotic at these steps, past the horizon, or no sure reference.",
    ),
    Verdict.MODEL: (
        "differs",
        "\N{NOT EQUAL TO}",
        "another model",
        "A difference that neither smaller steps nor harder constraints remove: another model, or another reading.",
    ),
    Verdict.FAILED: (
        "failed",
        "!",
        "failed",
        "No usable answer: an exception, a crash, a time limit or values that are not finite; the evidence is kept.",
    ),
}

LOOKS: dict[Verdict, Look] = {
    verdict: Look(verdict.name.lower(), *words, verdict=verdict) for verdict, words in _WORDS.items()
}
"""Verdicts, best first."""

AT_DEFAULTS = replace(
    LOOKS[Verdict.MODEL],
    name="another motion",
    sentence="At the engine's defaults smaller steps lead to another motion: by its model, or by what it sets so.",
)
"""A motion at an engine's own defaults that neither steps nor softness explain: a tolerance may be to blame."""


def look_of(verdict: Verdict, rule: str, matched: bool) -> Look:
    """Return the verdict for display; of a motion at defaults another model is not said."""
    return LOOKS[verdict] if matched or rule not in CONVERGENCE else AT_DEFAULTS


PHRASES: dict[Verdict, tuple[str, str]] = {
    Verdict.AGREES: ("agree", ""),
    Verdict.DISCRETISATION: ("need", "smaller steps, not another model"),
    Verdict.REGULARISATION: ("have", "soft constraints, not another model"),
    Verdict.UNSUPPORTED: ("hold", "something the engine cannot represent"),
    Verdict.UNRESOLVED: ("are", "unresolved"),
    Verdict.MODEL: ("differ", "in the model"),
    Verdict.FAILED: ("failed", ""),
}
"""Words after the number of cells of a verdict: verb in the plural, and the rest."""

_OF_ONE = {"are": "is", "have": "has", "failed": "failed"}


def phrase(verdict: Verdict, count: int) -> str:
    """Word the verdict of a number of cells: ``differ in the model``, ``is unresolved``."""
    verb, rest = PHRASES[verdict]
    return f"{_OF_ONE.get(verb, verb + 's') if count == 1 else verb} {rest}".rstrip()


NOT_ASKED = Look("empty", "empty", DASH, "not asked", "This question was not part of the run.")
YARDSTICK = Look(
    "empty", "empty", DASH, "the reference itself", "What the others are compared with is not compared with itself."
)

RANK = {str(verdict): n for n, verdict in enumerate(LOOKS)}
"""Rank of a verdict: the verdict of the highest rank is shown."""

ROUTES: dict[str, tuple[str, str]] = {
    Route.NATIVE: ("native", "the engine's own solver or integrator, at default or plain settings"),
    Route.TUNED: ("tuned", "the engine's own, with public knobs away from their defaults"),
    Route.EXTRAPOLATED: ("extrapolated", "Richardson extrapolation over runs of the engine's own"),
    Route.HARNESS_SOLVE: ("harness solve", "the engine's terms, the constraints solved by the harness"),
    Route.HARNESS_INTEGRATOR: ("harness integrator", "the engine's accelerations, integrated by the harness"),
    Route.HARNESS_STEPPING: ("harness stepping", "the engine's contact solver, in steps of the harness"),
    Route.REFERENCE: ("reference", "the reference solver itself"),
}
"""Short name and meaning of each route."""

EXIT_CODES: dict[int, str] = {
    0: "with matched settings no engine differs in the model, and none is missing, failed or unresolved",
    1: "with matched settings at least one engine differs in the model",
    3: "incomplete: an engine is missing, or with matched settings a run failed or a verdict is unresolved",
}
"""Meaning of the exit code; answers at the engines' own defaults do not change it."""

CAUSES: dict[str, str] = {
    "horizon": "The motion is too sensitive: rounding reaches the digits asked before the first sample.",
    "uncertain reference": "The reference is not certain enough to judge.",
    "disputed reference": "A published value contradicts the reference.",
    "singular pose": "At a singular pose the constraints do not determine the motion.",
    "velocities": "The poses agree and the velocities do not: they mean something else.",
    "no power": "A wrong model would have passed as well.",
    "agreement by chance": "The error of the steps cancels another one at this step, and will not at smaller ones.",
    "agreement": "As accurate as asked.",
    "steps": "The steps are too large for the digits asked; smaller ones lead to the reference.",
    "impacts within steps": "Impacts fall at any phase of a step; smaller steps lead closer to the reference.",
    "cone shape": "The engine slides by another friction cone than the case's, as the reference with that cone does.",
    "associated cone": "What slides also lifts: the engine's friction is convex, as the reference with that law shows.",
    "compliance": "The engine's contacts are springs; the reference with them moves alike, and as the case if harder.",
    "impact law": "Bodies that hit part by another law, as in the reference with the engine's law of impacts.",
    "restitution threshold": "Slow impacts do not rebound, as in the reference with the engine's threshold.",
    "modes within steps": "Contacts change their mode within steps; smaller ones lead closer to the reference.",
    "impacts elsewhere": "Smaller steps lead to another motion after impacts.",
    "scatter elsewhere": "The levels scatter, and smaller steps lead to another motion on average.",
    "impacts unclear": "Impacts fall at any phase of a step, and the levels scatter too much to tell a cause.",
    "earlier layer": "The accelerations are already others, before anything is integrated.",
    "softness": "The engine's constraints are soft; harder ones lead to the reference.",
    "softness unclear": "The engine's constraints are soft; harder ones move the answer, but not to the reference yet.",
    "inexact solver": "The engine's equations are right, and its solution of them is as inexact at instants.",
    "no ladder": "Not as accurate as asked, and there is only one step to judge by.",
    "unresolved rate": "The steps do not resolve how fast the forces change; smaller ones would, unless a force jumps.",
    "converged elsewhere": "Smaller steps no longer change the motion, and it is another one.",
    "not asymptotic": "The steps are too large to tell a cause.",
    "wide band": "The steps are too large to tell a cause: as much could come from them as from another model.",
    "elsewhere": "Smaller steps lead to another motion.",
    "contact solver": "What is missed is less than the engine's solver of contacts, stops and dry friction may lose.",
    "solver": "The engine's own equations are right, and their solution is less exact than their condition allows.",
    "tuning": "The equations are so ill-conditioned that the bar is wide, and the engine's own settings are nearer.",
}
"""Cause of a verdict in a sentence without numbers, by the rule that decided."""

CAUSES_BY_VERDICT: dict[str, str] = {
    Verdict.AGREES: "Within the bars.",
    Verdict.DISCRETISATION: CAUSES["steps"],
    Verdict.REGULARISATION: "The engine's constraints are soft.",
    Verdict.UNSUPPORTED: "The engine cannot represent something in the case.",
    Verdict.UNRESOLVED: "There is nothing to judge by.",
    Verdict.MODEL: "Other accelerations, reactions or energies than the case's.",
    Verdict.FAILED: "No usable answer.",
}
"""Cause of a verdict that no rule decided: answers with bars, and runs without an answer."""


FAILURES: dict[str, str] = {
    FailureClass.NOT_FINITE: "The answer has values that are not finite.",
    FailureClass.TIME: "No answer within the time limit.",
    FailureClass.MEMORY: "The engine outgrew the limit of its memory.",
    FailureClass.CRASH: "The engine's process died.",
    FailureClass.REFUSED: "The engine raised an exception.",
    FailureClass.STOPPED: "The run was ended from outside.",
    FailureClass.MALFORMED: "The answer is not of the form that was asked.",
    FailureClass.OTHER: "No usable answer.",
}
"""Cause of a failure, by its class."""


def cause_of(cause: str, verdict: str) -> str:
    """Return the cause in words: of the rule that decided, of the class of a failure, else of the verdict."""
    return CAUSES.get(cause) or FAILURES.get(cause) or CAUSES_BY_VERDICT[verdict]


def severity(verdict: str, digits: float | None) -> tuple[int, float]:
    """Rank a comparison for `max`: larger for a worse verdict, then for fewer digits."""
    return RANK[verdict], -(17.0 if digits is None else digits)


PROFILES: dict[str, str] = {Profile.MATCHED: "matched", Profile.DEFAULT: "engine's defaults"}
"""Words for the settings that a method runs with."""

CAPTIONS: dict[str, str] = {
    "choice": "The best motion of each case with matched settings: digits at its finest level over CPU time. Upper "
    "left is better. One colour an engine; hollow: by the harness's integrator. Classes by the tags of the cases.",
    "difference": "Difference to the reference over time: position over the size of the motion, or angle in rad, "
    "whichever is larger. One marker a method, hollow at the engine's defaults; one dash a level, the finest solid. "
    "Dotted, level: the band of the finest level, and in grey the uncertainty of the reference. Shaded: past the "
    "horizon, not judged.",
    "energy": "Change of the total energy since the start over the largest kinetic energy, recomputed from the motion "
    "by the same code for every engine.",
    "coordinates": "Joint coordinates over time by the reference, full turns counted. Samples are halved until the "
    "extremes of each curve settle within 1 %; a panel where they do not says by how much its peak may be off.",
    "rates": "Rates of the joint coordinates over time by the reference, sampled as the coordinates.",
    "positions": "Positions of the body origins over time by the reference, world axes, sampled as the coordinates.",
    "velocities": "Velocities of the body origins over time by the reference, world axes, sampled as the coordinates.",
    "energies": "Energies over time by the reference, sampled as the coordinates.",
    "reactions": "Reaction forces and torques over time, on the successor, the torque about the origin of M: the line "
    "by the reference, sampled as the coordinates; markers, a colour an engine, recomputed at samples of the motion of "
    "each engine by the same dense solution. Components that equilibrium does not determine are left out.",
    "joint": "Coordinates and rates of the joint over time by the reference, and its reactions on the successor, the "
    "torque about the origin of M: the line by the reference; markers, a colour an engine, at samples of its motion.",
    "drift": "Largest violation of a joint's constraints over time, from the motion of each engine by the same code.",
    "horizon": "How far the motion can be judged: one rounding error, committed at the start, grows along the "
    "reference as shown, the largest over a few directions. Where it reaches the digits asked lies the horizon; what "
    "lies shaded beyond is not judged. Dotted: the uncertainty of the reference.",
    "work": "Work and precision: largest difference to the reference, up to the horizon, against CPU time of the "
    "worker; one marker a level, one colour an engine, hollow at the engine's defaults. Lower left is better. Each "
    "time is that of a single run.",
    "steps": "The same runs against the step, of an adaptive method the mean step. A line falls one decade a decade "
    "for each order; where it is level, smaller steps no longer help.",
}
"""Captions of the figures of a case."""

UNITS: dict[str, str] = {"mass": "kg", "com": "m", "inertia": "kg m\N{SUPERSCRIPT TWO}", "freedom": ""}


def number(value: float | None, digits: int = 2) -> str:
    """Write a number to some significant digits; a dash for None."""
    return DASH if value is None else f"{value:.{digits}g}"


def difference_text(value: float | None) -> str:
    """Write a difference; None stands for a difference that is not finite."""
    return "not finite" if value is None else number(value)


_ERRORS = {PLACE: (100.0, " % of the size of a body"), AXIS: (1.0, " rad")}
"""Factor and unit of errors that are not relative."""


def error_text(kind: str, limit: float | None) -> str:
    """Write an error of a parameter in percent, of an axis in rad; an error above `LARGEST` is not measured."""
    factor, unit = _ERRORS.get(kind, (100.0, " %"))
    if limit is None or limit >= LARGEST:
        return f"more than {LARGEST * factor:g}{unit}"
    return f"{number(limit * factor)}{unit}"


def seconds(value: float | None) -> str:
    """Write a time in s; a dash for None."""
    return DASH if value is None else f"{value:.3g} s"


def digits_text(value: float | None) -> str:
    """Write correct digits to one decimal, at least 0; a dash for None."""
    return DASH if value is None else f"{max(value, 0.0):.1f}"


def method_title(name: str, matched: bool) -> str:
    """Name a method in plain text; a default method is labelled, unless its name contains the word."""
    return name if matched or "default" in name.lower() else f"{name} ({PROFILES[Profile.DEFAULT]})"


def plain(value: Any) -> str:
    """Write a setting or a value of the record in one line."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list | tuple):
        return ", ".join(plain(v) for v in value)
    return str(value)


def step_name(method: dict[str, Any]) -> str:
    """Name what distinguishes the levels: the step of a fixed-step method, the tolerance of an adaptive method."""
    return "step" if method.get("substeps") else "tolerance"


def step_text(step: float | None, method: dict[str, Any]) -> str:
    """Write the step or the tolerance of a level, with its unit."""
    unit = " s" if step_name(method) == "step" else ""
    return DASH if step is None else f"{step:.3g}{unit}"


def level_text(step: float | None, method: dict[str, Any]) -> str:
    """Name a level by its step or its tolerance."""
    return f"{step_name(method)} {step_text(step, method)}"


def order_text(value: float | None) -> str:
    """Write an observed order to two decimals; a dash for None."""
    return DASH if value is None else f"{value:z.2f}"


def nested(value: Any) -> str:
    """Write a number, a vector or the six entries of a symmetric matrix to four digits."""
    if not isinstance(value, list):
        return number(value, 4)
    if value and isinstance(value[0], list):
        entries = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
        return ", ".join(f"{'xyz'[i]}{'xyz'[j]} {number(value[i][j], 4)}" for i, j in entries)
    return "(" + ", ".join(number(v, 4) for v in value) + ")"


def counted(count: int, noun: str) -> str:
    """Write a number and its noun: ``1 case``, ``2 cases``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


_KINDS = (
    *("case", "horizon", "work", "steps", "coordinates", "rates", "positions", "velocities", "energies"),
    *("reactions", "joint", "drift", "cell"),
)
"""First names of identifiers that belong to a case: its page and figures."""


def cell_anchor(case: str, engine: str) -> str:
    """Make the identifier of a cell: ``CASE.ENGINE``; ``cell.CASE.ENGINE`` if the case is named like an element."""
    return anchor("cell", case, engine) if case in _KINDS else anchor(case, engine)


def anchor(*names: str) -> str:
    """Make the identifier of an element: valid in a URL, and different for different names."""
    return ".".join(re.sub(r"[^A-Za-z0-9_-]", lambda m: f"~{ord(m[0]):x}~", name) for name in names)
