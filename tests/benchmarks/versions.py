"""Versions of MuJoCo side by side: only the sparse Newton solver of 4.0.0 gives other results.

    python tests/benchmarks/versions.py

A branched tree of six bodies, locked by two loops. With MuJoCo's own softness the problem has one solution, whatever
solver computes it; the sparse Newton solver of 4.0.0 gives another (`reports/findings/mujoco_sparse_newton`). Missing
environments are built.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from consilience.engine import Profile, Question
from consilience.engine.worker.client import Request, Worker
from consilience.mechanism import Mechanism
from mechanisms import drawn_joint, lumpy_body, rotation, states_of

VERSIONS = ("3.3.7", "3.17.0", "4.0.0")
SEED = 264


def locked_tree():
    """Return six bodies on hinges, with two ball joints that close loops."""
    rng = np.random.default_rng(SEED)
    count = int(rng.integers(6, 13))
    before = [int(rng.integers(-1, i)) for i in range(count)]
    bodies = {f"b{i}": lumpy_body(f"b{i}", rng) for i in range(count)}
    joints = []
    for i, k in enumerate(before):
        place, axes = rng.uniform(-1, 1, 3), rotation(rng)
        joints.append(drawn_joint(f"j{i}", "revolute", bodies, "ground" if k < 0 else f"b{k}", f"b{i}", place, axes))
    for k in range(2):
        a, b = rng.choice(count, 2, replace=False)
        place, axes = rng.uniform(-1, 1, 3), rotation(rng)
        joints.append(drawn_joint(f"loop{k}", "spherical", bodies, f"b{a}", f"b{b}", place, axes))
    return Mechanism("locked_tree", np.array([0.0, 0.0, -9.81]), tuple(bodies.values()), tuple(joints))


def main():
    mechanism = locked_tree()
    states = states_of(mechanism, 1)
    found = {}
    for version in VERSIONS:
        with Worker(f"mujoco@{version}", 600.0) as worker:
            info = worker.ask(Request())
            print(info.value or info.reason, flush=True)
            plan = worker.ask(Request(mechanism)).value
            for method in plan.methods[Question.INSTANT]:
                if method.profile is Profile.DEFAULT:
                    reply = worker.ask(Request(mechanism, Question.INSTANT, method, states))
                    found[method.name, version] = reply.value.a_WB_W
    print("| method | version | relative difference to " + VERSIONS[0] + " |\n|---|---|---:|")
    for (name, version), a in found.items():
        first = found[name, VERSIONS[0]]
        print(f"| {name} | {version} | {np.max(np.abs(a - first)) / np.max(np.abs(first)):.1e} |")


if __name__ == "__main__":
    main()
