"""What a mechanism must have for an error to act on: predicates for the table of mutants."""

from __future__ import annotations

from consilience.audit.mutate.inputs import other_branch
from consilience.audit.mutate.subjects import Subject
from consilience.audit.mutate.traps import Need
from consilience.mechanism import AXIS_COORDINATES, spanning_tree

_WITH_MASSLESS_LINKS = (
    "cylindrical",
    "universal",
    "planar",
    "rod",
    "point_on_line",
    "point_in_plane",
    "parallel_axes",
)


def loop(subject: Subject) -> bool:
    """A loop."""
    return bool(spanning_tree(subject.mechanism)[1])


def tree(subject: Subject) -> bool:
    """No loop."""
    return not loop(subject)


def springless_loop(subject: Subject) -> bool:
    """A loop and no element that a joint holds or pushes."""
    return loop(subject) and not subject.mechanism.joint_springs


def kind(*kinds: str) -> Need:
    """A joint of one of these kinds."""
    return lambda subject: any(joint.kind in kinds for joint in subject.mechanism.joints)


massless_link = kind(*_WITH_MASSLESS_LINKS)


def axis(subject: Subject) -> bool:
    """A joint with an axis."""
    return any(joint.kind in AXIS_COORDINATES for joint in subject.mechanism.joints)


def load(subject: Subject) -> bool:
    """A load."""
    return bool(subject.mechanism.loads)


def force(subject: Subject) -> bool:
    """A load that is a force."""
    return any(x.kind == "force" for x in subject.mechanism.loads)


def damper(subject: Subject) -> bool:
    """A joint spring with damping."""
    return any(s.damping > 0.0 for s in subject.mechanism.joint_springs)


def hinges_without_springs(subject: Subject) -> bool:
    """A hinge; no joint spring, for their adapter reads one angle where two coordinates stand."""
    return kind("revolute", "cylindrical", "planar", "universal")(subject) and not subject.mechanism.joint_springs


def branch(subject: Subject) -> bool:
    """A shipped case with a second assembly of its first state: in random mechanisms it takes long to find one."""
    return subject.case is not None and loop(subject) and other_branch(subject.mechanism, subject.states[0]) is not None


def redundant(subject: Subject) -> bool:
    """Dependent constraint rows."""
    rows = subject.mechanism.constraint_count()
    return subject.model_answer.freedom > 6 * len(subject.mechanism.bodies) - rows


def only_joints(subject: Subject) -> bool:
    """No constraint but joints: others are rows that an adapter writes into a dense Jacobian itself."""
    m = subject.mechanism
    return not (m.drives or m.couplings or m.rollings or m.skates)


def held(subject: Subject) -> bool:
    """A joint that holds something, with a component that equilibrium determines."""
    return any(joint.rows for joint in subject.mechanism.joints)


def random(subject: Subject) -> bool:
    """Gravity of its own: the shipped cases have that of every engine's default."""
    return subject.case is None
