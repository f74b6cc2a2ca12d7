"""Disagreements of a campaign: each kind is shrunk to the smallest case that shows it, and kept as a case file."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from consilience.audit.fuzz.campaign import EnginePanel, FuzzCampaign, JudgedMechanism
from consilience.audit.fuzz.judging import JudgedComparison, alarms, judge
from consilience.audit.fuzz.motions import judge_motions
from consilience.audit.fuzz.population import CONTACTS, read_text, replay
from consilience.audit.fuzz.reductions import without_rest
from consilience.audit.fuzz.shrink import Shrinker
from consilience.audit.fuzz.workers import AnswerBatch
from consilience.case.file.writer import table_text
from consilience.compare import Verdict, grouped
from consilience.compare import exit_code as exit_code_of
from consilience.compare.judge import REFERENCE
from consilience.engine import InstantAnswer, Question
from consilience.errors import ConsilienceError
from consilience.reference.engine import TIME_STEPPING

NEGLIGIBLE = 1e-6
"""Accelerations and loads in SI units that count as zero: far above rounding in bodies of some kg and m."""


@dataclass(frozen=True)
class ShrunkDisagreement:
    """One kind of disagreement.

    Attributes
    ----------
    entry : JudgedComparison
        Comparison in the smallest mechanism that was drawn with the disagreement.
    seeds : tuple of int
        Seeds of all mechanisms with the disagreement.
    seed : int
        Seed of the mechanism that was shrunk.
    file : str
        Name of the case file of the smallest case.
    bodies, met : int
        Number of bodies of the smallest case, and of the mechanism before shrinking.
    shown : JudgedComparison
        Comparison in the smallest case.
    tried : int
        Number of cases asked about while shrinking.
    """

    entry: JudgedComparison
    seeds: tuple[int, ...]
    seed: int
    file: str
    bodies: int
    met: int
    shown: JudgedComparison
    tried: int

    @property
    def command(self) -> str:
        """Command that asks about the smallest case again; a fuzz where two formulations of a motion differ."""
        if self.entry.method == TIME_STEPPING.name:
            return f"{replay(self.seed, CONTACTS)} -e {REFERENCE}"
        return f"consilience run {self.file} -e {self.entry.engine} -q {self.entry.question}"


def shrink_disagreements(
    campaign: FuzzCampaign,
    panel: EnginePanel,
    folder: Path,
    limit: float,
    progress: Callable[[str], None] | None = None,
) -> list[ShrunkDisagreement]:
    """Shrink one disagreement of each kind, and write its case file.

    Parameters
    ----------
    campaign : FuzzCampaign
    panel : EnginePanel
        Engines that are asked about smaller cases.
    folder : Path
        Folder of the case files.
    limit : float, s
        Time to shrink one disagreement.
    progress : callable, optional
        Called with the name of each disagreement before it is shrunk.
    """
    found = []
    pairs = [(judged, entry) for judged in campaign.judged for entry in alarms(judged.entries)]
    for met in grouped(pairs, lambda pair: pair[1].signature).values():
        judged, entry = min(met, key=lambda pair: len(pair[0].specimen.case.mechanism.bodies))
        if progress is not None:
            progress(f"{entry.engine}, {entry.method or entry.quantity}, seed {judged.specimen.seed}")
        found.append(_shrunk(panel, judged, entry, tuple(j.specimen.seed for j, _ in met), folder, limit))
    return found


def _shrunk(
    panel: EnginePanel,
    judged: JudgedMechanism,
    entry: JudgedComparison,
    seeds: tuple[int, ...],
    folder: Path,
    limit: float,
) -> ShrunkDisagreement:
    """Shrink one disagreement, and write its case file.

    Parameters
    ----------
    panel : EnginePanel
        Engines that are asked about smaller cases.
    judged : JudgedMechanism
        Mechanism to shrink.
    entry : JudgedComparison
        Comparison that shows the disagreement.
    seeds : tuple of int
        Seeds of all mechanisms with the disagreement.
    folder : Path
        Folder of the case file.
    limit : float, s
        Time to shrink.
    """
    seen: dict[str, JudgedComparison] = {}

    def shows(text: str) -> bool:
        same = [e for e in asked_again(panel, text, entry) if e.signature == entry.signature]
        if same:
            seen[text] = same[0]
        return bool(same)

    shrinker = Shrinker(judged.specimen.text, shows, limit)
    text = shrinker.shrink()
    shown = seen.get(text, entry)
    seed, met = judged.specimen.seed, len(judged.specimen.case.mechanism.bodies)
    name = _file_name(seed, entry)
    table = without_rest(tomllib.loads(text))
    table |= {"title": f"Smallest case found of: {shown.engine}, {shown.question}, {shown.verdict}"}
    again = replay(seed, judged.specimen.sort)
    found = ShrunkDisagreement(entry, seeds, seed, name, len(table["body"]), met, shown, shrinker.tried)
    heading = (
        f"{shown.engine}, {shown.method or 'any method'}, against {shown.against}: {shown.why}\n\n"
        f"    {found.command}\n\n"
        f"Shrunk from a random mechanism of {met} bodies:\n\n    {again} -e {shown.engine}\n"
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(table_text(table, heading), encoding="utf-8")
    return found


def _file_name(seed: int, entry: JudgedComparison) -> str:
    other = "" if entry.against == REFERENCE else entry.against
    text = f"{entry.engine} {entry.method} {other} {entry.question} {entry.quantity}"
    words = re.findall(r"[a-z0-9]+", text.lower())
    return f"fuzz_{seed}_{'_'.join(words)}.toml"


def asked_again(panel: EnginePanel, text: str, met: JudgedComparison) -> list[JudgedComparison]:
    """Compare an engine again, on the case of a text; nothing if the case is not sound or is at rest."""
    try:
        case = read_text(text, "shrunk")
        _ = case.states
    except ConsilienceError:
        return []
    engines = list(dict.fromkeys((REFERENCE, met.engine)))
    if met.question is Question.TRAJECTORY:
        (found,) = judge_motions([case], {name: panel.members[name] for name in engines})
    else:
        (batches,) = panel.collect(1, panel.submit([case], engines))
        found = judge(case, batches) if _is_loaded(batches[REFERENCE]) else []
    return [entry for entry in found if entry.engine == met.engine]


def _is_loaded(reference: AnswerBatch) -> bool:
    """Whether any acceleration or reaction is larger than rounding: else only rounding would be compared."""
    instants = [one.answer for one in reference.answers if isinstance(one.answer, InstantAnswer)]
    return not instants or any(
        float(np.max(np.abs(values), initial=0.0)) > NEGLIGIBLE
        for name in ("a_WB_W", "alpha_WB_W", "force_F", "torque_F", "contact_force")
        for values in [getattr(instants[0], name)]
        if values is not None
    )


def exit_code(campaign: FuzzCampaign) -> int:
    """Return 0 if all agree, 1 if a model differs, 3 if something is missing, failed, unresolved or not drawn."""
    verdicts = {e.verdict for j in campaign.judged for e in j.entries if e.alarm or e.verdict is Verdict.UNRESOLVED}
    return exit_code_of(verdicts, bool(campaign.missing or campaign.undrawn))
