"""Summary of a campaign of mutants: standing of each mutant in each host, exit code, verdict in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from consilience.audit.mutate.campaign import MutationCampaign, TaskOutcome
from consilience.audit.mutate.mutants import TRAPS, UNPLANTED, Mutant
from consilience.audit.mutate.table import MUTANTS
from consilience.compare import grouped


class Standing(StrEnum):
    """Outcome of a mutant in a host, over all magnitudes."""

    CAUGHT = "caught"
    MISSED = "missed"
    UNSEEN = "missed, as explained"
    SILENT = "rightly not noticed"
    FALSE_ALARM = "false alarm"
    NOT_JUDGED = "not judged"


@dataclass(frozen=True)
class MutantRow:
    """One mutant in one host; outcomes by magnitude, largest first."""

    mutant: Mutant
    host: str
    outcomes: tuple[TaskOutcome, ...]

    @property
    def standing(self) -> Standing:
        """Whether the mutant, or the harmless change, was noticed at any magnitude."""
        noticed = any(o.noticed for o in self.outcomes)
        if any(o.unusable for o in self.outcomes) or not any(o.judged or o.broken for o in self.outcomes):
            return Standing.NOT_JUDGED
        if self.mutant.harmless:
            return Standing.FALSE_ALARM if noticed else Standing.SILENT
        if noticed:
            return Standing.CAUGHT
        return Standing.UNSEEN if self.mutant.unseen else Standing.MISSED

    @property
    def smallest(self) -> TaskOutcome | None:
        """Outcome of the smallest magnitude caught on any mechanism."""
        return next((o for o in reversed(self.outcomes) if o.noticed), None)

    @property
    def smallest_everywhere(self) -> TaskOutcome | None:
        """Outcome of the smallest magnitude caught on as many mechanisms as any magnitude."""
        most = max((o.caught for o in self.outcomes), default=0)
        return next((o for o in reversed(self.outcomes) if o.noticed and o.caught >= most), None)

    @property
    def by(self) -> str:
        """Questions and quantities that caught the largest magnitude, most frequent first, or how it ended a worker."""
        first = next((o for o in self.outcomes if o.noticed), None)
        return first.broken or ", ".join(name for name, _ in first.by.most_common(3)) if first else ""

    @property
    def why_missed(self) -> str:
        """Why the largest magnitude without a catch was missed; empty if every magnitude was caught."""
        unusable = next((o.unusable for o in self.outcomes if o.unusable), "")
        if unusable:
            return unusable
        missed = next((o for o in self.outcomes if not o.noticed and o.judged), None)
        if missed is None:
            return ""
        if missed.unchanged == missed.judged:
            return f"{missed.magnitude:g}: changes no number of any answer"
        return f"{missed.magnitude:g}: {missed.largest_missed:.2g} of the bar at most"


def rows_of(campaign: MutationCampaign) -> list[MutantRow]:
    """Return the rows in the order of traps and of the table of mutants."""

    def key(outcome: TaskOutcome) -> tuple[int, int, str]:
        return MUTANTS[outcome.mutant].trap, list(MUTANTS).index(outcome.mutant), outcome.host

    found = sorted(campaign.outcomes, key=lambda o: (*key(o), -o.magnitude))
    return [MutantRow(MUTANTS[same[0].mutant], same[0].host, tuple(same)) for same in grouped(found, key).values()]


def count(rows: Sequence[MutantRow], standing: Standing) -> int:
    """Return the number of rows of a standing."""
    return sum(row.standing is standing for row in rows)


def traps_caught(rows: Sequence[MutantRow]) -> tuple[int, int]:
    """Return the number of traps of which every judged mutant was caught, and the number of traps judged."""
    judged = {r.mutant.trap for r in rows if r.standing in (Standing.CAUGHT, Standing.MISSED)}
    missed = {r.mutant.trap for r in rows if r.standing is Standing.MISSED}
    return len(judged - missed), len(judged)


def exit_code(campaign: MutationCampaign) -> int:
    """Return 0 if all mutants are caught without a false alarm, 1 if not, 3 if a mutant or engine was not judged."""
    rows = rows_of(campaign)
    if campaign.alarms or count(rows, Standing.MISSED) or count(rows, Standing.FALSE_ALARM):
        return 1
    return 3 if campaign.missing or count(rows, Standing.NOT_JUDGED) else 0


def verdict_of(campaign: MutationCampaign) -> str:
    """Return the counts of traps, mutants and false alarms as a sentence."""
    rows = rows_of(campaign)
    caught, judged = traps_caught(rows)
    harmful = [r for r in rows if not r.mutant.harmless]
    traps = f"{caught} of {judged} traps caught ({len(TRAPS)} known, {len(UNPLANTED)} not planted)"
    words = [f"{traps}: {count(harmful, Standing.CAUGHT)} mutants caught, {count(harmful, Standing.MISSED)} missed"]
    if count(harmful, Standing.UNSEEN):
        words.append(f"{count(harmful, Standing.UNSEEN)} that no question can see")
    unjudged = count(rows, Standing.NOT_JUDGED)
    if unjudged:
        words.append(f"{unjudged} not judged")
    alarms = len({(a.host, a.subject) for a in campaign.alarms})
    judgings = sum(campaign.judged.values())
    words.append(
        f"{alarms} false alarms on {judgings} judgings of correct adapters over {campaign.mechanisms} random mechanisms"
    )
    harmless = len(rows) - len(harmful)
    words.append(f"{count(rows, Standing.FALSE_ALARM)} of {harmless} changes that are no errors noticed")
    return "; ".join(words) + "."
