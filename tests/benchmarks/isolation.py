"""Cost of a worker process: small jobs in the worker and in this process, in alternating blocks.

    python tests/benchmarks/isolation.py [ENGINE]...

The cost is the time of a job minus the CPU time of the engine in the worker. The last column is the CPU time of both
processes minus that of the engine, which is least affected by other load on the machine.
"""

import statistics
import sys
import time

import psutil

from consilience.case import load_case
from consilience.engine import Question, load_engine
from consilience.engine.worker.client import Request, Worker
from consilience.engine.worker.requests import perform

ROUNDS, BLOCK, WARM = 15, 20, 20
CASES = ("double_pendulum", "four_bar")


def requests_of(engine, case):
    """Yield small jobs: the engine's name, a mass, accelerations at one state."""
    mechanism, states = case.mechanism, case.states[:1]
    yield "info", Request()
    for question in (Question.MODEL, Question.INSTANT):
        if not engine.unsupported(mechanism, question):
            yield str(question), Request(mechanism, question, engine.methods(mechanism, question)[0], states)


def spent(action, request):
    start = time.perf_counter()
    found = action(request)
    return 1e3 * (time.perf_counter() - start), found


def cpu_of(process):
    times = process.cpu_times()
    return 1e3 * (times.user + times.system)


def measured(here, worker, request):
    """Return medians in ms of time here, time in the worker and cost; the least cost; the cost in CPU time."""
    near, far, own = [], [], []
    for _ in range(WARM):
        worker.ask(request)
    (there,) = psutil.Process().children()
    before, spent_here = cpu_of(there), 0.0
    for _ in range(ROUNDS):
        # in blocks: a runner with workers does not load the engine's code into its caches between two jobs
        near += [spent(lambda r: perform(here, r), request)[0] for _ in range(BLOCK)]
        start = time.process_time()
        for _ in range(BLOCK):
            time_there, reply = spent(worker.ask, request)
            far.append(time_there)
            own.append(1e3 * reply.cpu)
        spent_here += 1e3 * (time.process_time() - start)
    cost = [f - o for f, o in zip(far, own, strict=True)]
    cpu = (spent_here + cpu_of(there) - before - sum(own)) / len(own)
    return statistics.median(near), statistics.median(far), statistics.median(cost), min(cost), cpu


def main(engines):
    print("| engine | case | job | here, ms | in a worker, ms | cost, ms | least cost, ms | cost, CPU time, ms |")
    print("|---|---|---|---:|---:|---:|---:|---:|")
    for name in engines:
        here = load_engine(name)
        with Worker(name, 600.0) as worker:
            for case in map(load_case, CASES):
                for job, request in requests_of(here, case):
                    cells = " | ".join(f"{cell:.3f}" for cell in measured(here, worker, request))
                    print(f"| {name} | {case.name} | {job} | {cells} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or ["mujoco", "pinocchio", "dart"])
