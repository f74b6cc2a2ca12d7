"""Spanning tree of a mechanism: which joints form a tree from the ground, and which close loops."""

from __future__ import annotations

from consilience.mechanism.model import GROUND, Mechanism


def spanning_tree(mechanism: Mechanism) -> tuple[list[tuple[int, bool]], list[int]]:
    """Choose a spanning tree breadth first from the ground, so that loops are cut opposite to the ground.

    Rods and free joints belong to the tree only where no other joint leads to a body.

    Returns
    -------
    tree : list of (int, bool)
        Index of each joint of the tree, in depth-first order, and whether the tree passes the joint backwards, from
        successor to predecessor.
    closing : list of int
        Indices of the joints that close loops.
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
        """Add the first joint from `body` to a body that the tree does not have yet."""
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
            # the mechanism is connected: some rod or free joint leads on
            next(body for body in front if extend(body, weak))
    closing = [k for k in range(len(mechanism.joints)) if k not in used]
    return _depth_first(mechanism, branches), closing


def _joints_at(mechanism: Mechanism, chosen: set[int]) -> dict[str, list[int]]:
    """Indices of the chosen joints at each body and at the ground."""
    found: dict[str, list[int]] = {}
    for k, joint in enumerate(mechanism.joints):
        if k in chosen:
            for body in (joint.predecessor, joint.successor):
                found.setdefault(body, []).append(k)
    return found


def _depth_first(mechanism: Mechanism, branches: dict[str, list[tuple[int, bool]]]) -> list[tuple[int, bool]]:
    """Joints of the branches from the ground on; no recursion, which a long chain would exhaust."""
    found: list[tuple[int, bool]] = []
    waiting = branches.get(GROUND, [])[::-1]
    while waiting:
        k, backward = waiting.pop()
        found.append((k, backward))
        joint = mechanism.joints[k]
        waiting += branches.get(joint.predecessor if backward else joint.successor, [])[::-1]
    return found
