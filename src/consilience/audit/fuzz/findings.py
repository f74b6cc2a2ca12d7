"""Disagreements of a campaign, each kind of it shrunk to the smallest case that shows it, and kept as a case file."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from consilience.audit.fuzz.campaign import Campaign, Judged, Panel
from consilience.audit.fuzz.judging import Entry, alarms, judge
from consilience.audit.fuzz.population import read_text, replay
from consilience.audit.fuzz.reductions import without_rest
from consilience.audit.fuzz.shrink import Shrinker
from consilience.audit.fuzz.workers import Sheet, Task
from consilience.case.file.writer import table_text
from consilience.compare import Verdict
from consilience.compare.judge import REFERENCE
from consilience.engine import InstantAnswer
from consilience.errors import ConsilienceError

NOTHING = 1e-6
"""Accelerations and loads below this in SI units are none: far above rounding in bodies of some kg and m."""

Progress = Callable[[str], None]
"""Called with what is about to be shrunk."""


@dataclass(frozen=True)
class Finding:
    """One kind of disagreement.

    Attributes
    ----------
    entry : Entry
        As met in the smallest mechanism that has it.
    seeds : tuple of int
        All mechanisms that have it.
    seed : int
        The one that was shrunk.
    file : str
        Case file of the smallest case, in the folder of the fuzz.
    bodies, met : int
        Number of bodies of the smallest case, and of the one it was shrunk from.
    shown : Entry
        What the smallest case shows.
    tried : int
        Cases asked about on the way.
    """

    entry: Entry
    seeds: tuple[int, ...]
    seed: int
    file: str
    bodies: int
    met: int
    shown: Entry
    tried: int


def find(
    campaign: Campaign, panel: Panel, folder: Path, limit: float, progress: Progress | None = None
) -> list[Finding]:
    """Shrink one disagreement of each kind, and write its case to `folder`.

    Parameters
    ----------
    limit : float, s
        Time for one of them.
    """
    kinds: dict[tuple[str, ...], list[tuple[Judged, Entry]]] = {}
    for judged in campaign.judged:
        for entry in alarms(judged.entries):
            kinds.setdefault(entry.signature, []).append((judged, entry))
    found = []
    for met in kinds.values():
        judged, entry = min(met, key=lambda pair: len(pair[0].specimen.case.mechanism.bodies))
        if progress is not None:
            progress(f"{entry.engine}, {entry.method or entry.quantity}, seed {judged.specimen.seed}")
        found.append(_shrunk(panel, judged, entry, tuple(j.specimen.seed for j, _ in met), folder, limit))
    return found


def _shrunk(panel: Panel, judged: Judged, entry: Entry, seeds: tuple[int, ...], folder: Path, limit: float) -> Finding:
    seen: dict[str, Entry] = {}

    def shows(text: str) -> bool:
        same = [e for e in asked_again(panel, text, entry.engine) if e.signature == entry.signature]
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
    heading = (
        f"{shown.engine}, {shown.method or 'any method'}, against {shown.against}: {shown.why}\n\n"
        f"    consilience run {name} -e {shown.engine} -q {shown.question}\n\n"
        f"Shrunk from a random mechanism of {met} bodies:\n\n    {replay(seed)} -e {shown.engine}\n"
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(table_text(table, heading), encoding="utf-8")
    return Finding(entry, seeds, seed, name, len(table["body"]), met, shown, shrinker.tried)


def _file_name(seed: int, entry: Entry) -> str:
    other = "" if entry.against == REFERENCE else entry.against
    text = f"{entry.engine} {entry.method} {other} {entry.question} {entry.quantity}"
    words = re.findall(r"[a-z0-9]+", text.lower())
    return f"fuzz_{seed}_{'_'.join(words)}.toml"


def asked_again(panel: Panel, text: str, engine: str) -> list[Entry]:
    """What one engine shows at the case of a text; nothing if it has no states, or nothing happens there."""
    try:
        case = read_text(text, "shrunk")
        tasks = [Task(case.mechanism, case.states)]
    except ConsilienceError:
        return []
    (sheets,) = panel.collect(tasks, panel.submit(tasks, list(dict.fromkeys((REFERENCE, engine)))))
    if not _something_happens(sheets[REFERENCE]):
        return []
    return [entry for entry in judge(case, sheets) if entry.engine == engine]


def _something_happens(reference: Sheet) -> bool:
    """Whether anything accelerates or bears a load: without, all that could be compared is rounding."""
    instants = [said.answer for said in reference.said if isinstance(said.answer, InstantAnswer)]
    return not instants or any(
        float(np.max(np.abs(values), initial=0.0)) > NOTHING
        for values in (instants[0].a_WB_W, instants[0].alpha_WB_W, instants[0].force_F, instants[0].torque_F)
        if values is not None
    )


def exit_code(campaign: Campaign) -> int:
    """0 if all agree, 1 if some differ in the model, 3 if something is missing, failed, unresolved or not drawn."""
    verdicts = {e.verdict for j in campaign.judged for e in j.entries if e.alarm or e.verdict is Verdict.UNRESOLVED}
    if Verdict.MODEL in verdicts:
        return 1
    return 3 if campaign.missing or campaign.undrawn or verdicts else 0
