"""Preconditions of mutants: whether a mechanism has the elements on which an error acts."""

from __future__ import annotations

from consilience.audit.mutate.inputs import other_branch
from consilience.audit.mutate.mutants import Precondition
from consilience.audit.mutate.subjects import MutationSubject
from consilience.mechanism import AXIS_COORDINATES, spanning_tree


def loop(subject: MutationSubject) -> bool:
    """Require a loop."""
    return bool(spanning_tree(subject.mechanism)[1])


def tree(subject: MutationSubject) -> bool:
    """Require no loop."""
    return not loop(subject)


def springless_loop(subject: MutationSubject) -> bool:
    """Require a loop and no joint spring."""
    return loop(subject) and not subject.mechanism.joint_springs


def kind(*kinds: str) -> Precondition:
    """Require a joint of one of these kinds."""
    return lambda subject: any(joint.kind in kinds for joint in subject.mechanism.joints)


def axis(subject: MutationSubject) -> bool:
    """Require a joint with an axis."""
    return any(joint.kind in AXIS_COORDINATES for joint in subject.mechanism.joints)


def load(subject: MutationSubject) -> bool:
    """Require a load."""
    return bool(subject.mechanism.loads)


def force(subject: MutationSubject) -> bool:
    """Require a load that is a force."""
    return any(x.kind == "force" for x in subject.mechanism.loads)


def damper(subject: MutationSubject) -> bool:
    """Require a joint spring with damping."""
    return any(s.damping > 0.0 for s in subject.mechanism.joint_springs)


def branch(subject: MutationSubject) -> bool:
    """Require a shipped case whose first state has a second assembly, which random mechanisms rarely have."""
    return subject.case is not None and loop(subject) and other_branch(subject.mechanism, subject.states[0]) is not None


def redundant(subject: MutationSubject) -> bool:
    """Require dependent constraint rows."""
    rows = subject.mechanism.constraint_count()
    return subject.model_answer.freedom > 6 * len(subject.mechanism.bodies) - rows


def only_joints(subject: MutationSubject) -> bool:
    """Require joints as the only constraints: adapters write the rows of others into a dense Jacobian."""
    m = subject.mechanism
    return not (m.drives or m.couplings or m.rollings or m.skates)


def held(subject: MutationSubject) -> bool:
    """Require a joint with constraint rows."""
    return any(joint.rows for joint in subject.mechanism.joints)


def random(subject: MutationSubject) -> bool:
    """Require a random mechanism: shipped cases have the default gravity of engines."""
    return subject.case is None
