"""Spanning trees of mechanisms."""

from __future__ import annotations

from collections.abc import Iterator

from consilience.mechanism import GROUND, Mechanism


def spanning_tree(mechanism: Mechanism) -> tuple[list[tuple[int, bool]], list[int]]:
    """Choose the tree joints (index, passed from successor to predecessor) depth first, and the closing joints.

    Breadth first from the ground, so that loops are cut opposite to it; rods and free joints only where nothing
    else leads to a body.
    """
    strong = [k for k, joint in enumerate(mechanism.joints) if joint.kind not in ("rod", "free")]
    weak = [k for k, joint in enumerate(mechanism.joints) if joint.kind in ("rod", "free")]
    front = [GROUND]
    reached = {GROUND}
    branches: dict[str, list[tuple[int, bool]]] = {}
    used: set[int] = set()

    def extend(body: str, candidates: list[int]) -> bool:
        """Take the first joint from `body` to a new body."""
        for k in candidates:
            joint = mechanism.joints[k]
            if body not in (joint.predecessor, joint.successor):
                continue
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
    return list(_depth_first(mechanism, branches)), closing


def _depth_first(mechanism: Mechanism, branches: dict[str, list[tuple[int, bool]]]) -> Iterator[tuple[int, bool]]:
    ahead = branches.get(GROUND, [])[::-1]
    while ahead:
        k, backward = ahead.pop()
        yield k, backward
        joint = mechanism.joints[k]
        ahead += branches.get(joint.predecessor if backward else joint.successor, [])[::-1]
