"""Other laws of contact: which answer of the reference was computed with the law that a method of an engine solves.

An engine whose law of contact is not that of the case declares its law (`engine.Method.law`), and the reference is
asked again with the law of the engine. A difference that this answer does not have is the law's.

A compliance excuses a difference only if it leads to the case: a wrong damper would make a wrong rebound, and the
reference with the same damper would follow. The reference is therefore asked with the compliance far harder, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from consilience.engine import Run
from consilience.mechanism import Compliance, ContactLaw, Mechanism

COMPLIANCE = "compliance"
"""Name of the rule by which springs in place of rigid shapes make a difference."""

HARDER = 100.0
"""Factor by which a compliance is harder, in the time of its contacts: what is left of its effect is a hundredth."""


def cause_of(law: ContactLaw, mechanism: Mechanism) -> str:
    """Return what a law changes for a mechanism, by the name of a rule (`rules.OTHER_LAWS`); empty for nothing."""
    rough = [contact for contact in mechanism.contacts if contact.friction > 0.0]
    changes = {
        "associated cone": law.associated and any(not contact.associated for contact in rough),
        "cone shape": law.cone is not None and any(contact.cone != law.cone for contact in rough),
        COMPLIANCE: law.compliance is not None,
        "impact law": law.impact_law is not None and any(contact.impact_law != law.impact_law for contact in rough),
        "restitution threshold": law.rebound_threshold is not None
        and any(c.restitution > 0.0 and c.rebound_threshold != law.rebound_threshold for c in mechanism.contacts),
    }
    return next((cause for cause, changed in changes.items() if changed), "")


def answer_under(law: ContactLaw | None, references: Sequence[Run]) -> Run | None:
    """Return the answered run of the reference with the law that a method solves; None if there is none."""
    if law is None:
        return None
    return next((run for run in references if run.method is not None and run.method.law == law), None)


def hardened(law: ContactLaw | None) -> ContactLaw | None:
    """Return a law with its compliance far harder and with the same rebound; None for a law without compliance."""
    if law is None or law.compliance is None:
        return None
    soft = law.compliance
    return replace(law, compliance=Compliance(HARDER**2 * soft.stiffness, HARDER * soft.damping))
