"""Spanning trees of mechanisms."""

from __future__ import annotations

from consilience.mechanism.model import GROUND, Mechanism


def spanning_tree(mechanism: Mechanism) -> tuple[list[tuple[int, bool]], list[int]]:
    """Choose the tree joints (index, passed from successor to predecessor) depth first, and the closing joints.

    Breadth first from the ground, so that loops are cut opposite to it; rods and free joints only where nothing
    else leads to a body.
    """
    strong, weak = (
        _joints_at(mechanism, {k for k, j in enumerate(mechanism.joints) if (j.kind in ("rod", "free")) == is_weak})
        for is_weak in (False, True)
    )
    front = [GROUND]
    reached = {GROUND}
    branches: dict[str, list[tuple[int, bool]]] = {}
    used: set[int] = set()

    def extend(body: str, candidates: dict[str, list[int]]) -> bool:
        """Take the first joint from `body` to a new body."""
        for k in candidates.get(body, []):
            joint = mechanism.joints[k]
            backward = joint.successor == body
            other = joint.predecessor if backward else joint.successor
            if other not in reached:
                reached.add(other)
                front.append(other)
                used.add(k)
                branches.setdefault(body, []).append((k, backward))
                return True
        return False

    position = 0
    while len(reached) <= len(mechanism.bodies):
        if position < len(front):
            position += not extend(front[position], strong)
        else:
            # the mechanism is connected, so some weak joint must lead on
            next(body for body in front if extend(body, weak))
    closing = [k for k in range(len(mechanism.joints)) if k not in used]
    return _depth_first(mechanism, branches), closing


def _joints_at(mechanism: Mechanism, chosen: set[int]) -> dict[str, list[int]]:
    """Those of the chosen joints that each body, or the ground, has."""
    found: dict[str, list[int]] = {}
    for k, joint in enumerate(mechanism.joints):
        if k in chosen:
            for body in (joint.predecessor, joint.successor):
                found.setdefault(body, []).append(k)
    return found


def _depth_first(mechanism: Mechanism, branches: dict[str, list[tuple[int, bool]]]) -> list[tuple[int, bool]]:
    """Joints of the branches from the ground on, without recursion, which a long chain would exhaust."""
    found: list[tuple[int, bool]] = []
    waiting = branches.get(GROUND, [])[::-1]
    while waiting:
        k, backward = waiting.pop()
        found.append((k, backward))
        joint = mechanism.joints[k]
        waiting += branches.get(joint.predecessor if backward else joint.successor, [])[::-1]
    return found
