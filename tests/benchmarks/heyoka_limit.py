"""Time of heyoka for minimal equations written by hand: a lower limit for motions of a pendulum and a linkage.

`trajectories.py` runs this file with a Python that has heyoka; constants come in, and times go out, as JSON. Vectors in
the plane are pairs (along, across) of expressions; the equations are those of `tests/oracles`.
"""

import json
import sys
import time

import heyoka as hy


def times(a, b):
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def scaled(s, a):
    return s * a[0], s * a[1]


def plus(a, b):
    return a[0] + b[0], a[1] + b[1]


def minus(a, b):
    return a[0] - b[0], a[1] - b[1]


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1]


def turned(a):
    return -a[1], a[0]


def turn(q):
    return hy.cos(q), hy.sin(q)


def pendulum(c):
    q, r = hy.make_vars("q", "r")
    return [(q, r), (r, dot(c["gravity"], turned(times(turn(q), c["moment"]))) / c["inertia"])]


def double_pendulum(c):
    q1, q2, r1, r2 = hy.make_vars("q1", "q2", "r1", "r2")
    t1, t2 = turn(q1), turn(q2)
    link, arm = times(t1, c["link"]), times(t2, c["arm_2"])
    m2 = c["mass_2"]
    along, across = m2 * dot(link, arm), m2 * (link[1] * arm[0] - link[0] * arm[1])
    drive = dot(c["gravity"], turned(times(t1, c["moment_1"]))), m2 * dot(c["gravity"], turned(arm))
    one, two = drive[0] - across * r2**2, drive[1] + across * r1**2
    det = c["A"] * c["B"] - along**2
    return [(q1, r1), (q2, r2), (r1, (c["B"] * one - along * two) / det), (r2, (c["A"] * two - along * one) / det)]


def components(one, two, of):
    """Return a, b in ``a one + b two = of``."""
    det = one[0] * two[1] - one[1] * two[0]
    return (of[0] * two[1] - of[1] * two[0]) / det, (one[0] * of[1] - one[1] * of[0]) / det


def four_bar(c):
    q, r = hy.make_vars("q", "r")
    crank = times(turn(q), c["crank"])
    gap = minus(c["D"], plus(c["A"], crank))
    f2 = dot(gap, gap)
    along = (c["coupler2"] - c["rocker2"] + f2) / (2.0 * f2)
    height = c["branch"] * hy.sqrt(c["coupler2"] / f2 - along**2)
    coupler, rocker = times((along, height), gap), times((along - 1.0, height), gap)
    first, second = turned(crank), scaled(-1.0, crank)
    b, d = components(turned(coupler), scaled(-1.0, turned(rocker)), scaled(-1.0, first))
    rest = minus(plus(scaled(b * b, coupler), scaled(-1.0 * d * d, rocker)), second)
    bb, dd = components(turned(coupler), scaled(-1.0, turned(rocker)), rest)
    nothing = (0.0, 0.0)
    parts = [(nothing, nothing, crank, 1.0, 0.0), (first, second, coupler, b, bb), (nothing, nothing, rocker, d, dd)]
    J = h = Q = 0.0
    for (v, a, arm, rate, bend), body in zip(parts, c["bodies"], strict=True):
        out = times(arm, body["arm"])
        c_q = plus(v, scaled(rate, turned(out)))
        c_qq = plus(a, minus(scaled(bend, turned(out)), scaled(rate * rate, out)))
        J = J + body["mass"] * dot(c_q, c_q) + body["inertia"] * rate * rate
        h = h + body["mass"] * dot(c_q, c_qq) + body["inertia"] * rate * bend
        Q = Q + body["mass"] * dot(c["gravity"], c_q)
    return [(q, r), (r, (Q - h * r * r) / J)]


SYSTEMS = {"physical_pendulum-large": pendulum, "double_pendulum": double_pendulum, "four_bar": four_bar}


def main():
    """Print, for every system, its final state and the least time in s of a run with all samples."""
    out = {}
    for name, given in json.load(sys.stdin).items():
        solver = hy.taylor_adaptive(SYSTEMS[name](given["constants"]), given["start"], tol=given["tolerance"])
        found = []
        for _ in range(given["repeats"]):
            solver.time, solver.state[:] = 0.0, given["start"]
            began = time.process_time()
            state = solver.propagate_grid(given["times"])[-1]
            found.append(time.process_time() - began)
        out[name] = {"state": state[-1].tolist(), "seconds": min(found)}
    json.dump(out, sys.stdout)


if __name__ == "__main__":
    main()
