"""The reference against Pinocchio's `aba` compiled in C++ for this processor: evaluations and whole motions.

Both sides run in compiled code, in one process on one thread: `compiled_cpp.cpp` is built into a temporary folder,
which takes some minutes, and a call of it does as much work as a call of the reference.
"""

from __future__ import annotations

import ctypes
import importlib.util
import shutil
import subprocess
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from tables import Table
from timing import Sample, less, race, ratio, seconds

from consilience.case import load_case
from consilience.engine import TrajectoryAnswer
from consilience.mechanism import Array, Mechanism
from consilience.reference import ForwardDynamics, simulate
from consilience.reference.integrators.coefficients import DORMAND_PRINCE
from mechanisms import chain

SOURCE = Path(__file__).with_suffix(".cpp")

EIGEN = tuple(Path(prefix) / "eigen3" for prefix in ("/usr/include", "/usr/local/include"))
"""Folders of Eigen's headers: one of them holds Eigen/Core."""

BOOST = ("-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS")
FLAGS = ("-std=c++17", "-O3", "-march=native", "-DNDEBUG", "-shared", "-fPIC", "-fvisibility=hidden", *BOOST)
"""Boost's definitions are those of Pinocchio's CMake target, which has more kinds of joints than lists by default."""

BODIES, BATCH = (2, 10, 50, 200), 40_000
"""Lengths of the chains, and bodies in all states of one call together."""

CONVENTIONS = ("local", "world")
"""In what axes `aba` computes."""

AGREEMENT = 1e-10
"""Largest relative difference of the accelerations."""

SAME = 1e-10
"""Tolerance of the motions that are compared by tolerance."""

GOAL = 1e-9
"""Largest error of the position of any body at the end in m, of the motions that are compared by accuracy."""

TOLERANCES = tuple(10.0 ** (-k / 2.0) for k in range(6, 27))
TURNS = 21

_EVALUATION = (
    "Bar: 1.0 from 10 bodies on. Spatial chains of revolutes about skew axes, full inertias; many states in one "
    "compiled call on each side; the time is that of one evaluation. {compiler}, -O3 -march=native; `aba` in the axes "
    "of the links (local) and of the world. The ratio is that to the faster of the two."
)
_MOTION = (
    "The end of a motion by gravity alone. C++: DOP853 around `aba` in the faster axes, with error estimate, norm and "
    "control of the step of the reference; the model is made before the clock starts. The reference: the whole call of "
    "`simulate` in relative coordinates with its own choice of integrator; in the last column less the translation of "
    f"the state. First both at a tolerance of {SAME:g}, then at the coarsest that reaches {GOAL:g} m: errors are those "
    "of the positions of all bodies, against `dop853` of the reference at a tolerance of 1e-14."
)


def missing() -> str:
    """Return what the benchmark needs and does not find, or an empty string."""
    found = {
        "C++ compiler (`c++`)": shutil.which("c++"),
        "folder of the headers of Pinocchio's wheel": _pinocchio(),
        "folder of Eigen's headers (`apt-get install libeigen3-dev`)": _eigen(),
    }
    return ", no ".join(what for what, there in found.items() if there is None)


def _eigen() -> Path | None:
    return next((folder for folder in EIGEN if (folder / "Eigen" / "Core").exists()), None)


def _pinocchio() -> Path | None:
    """Return the folder of headers beside the Python package `pinocchio`."""
    spec = importlib.util.find_spec("pinocchio")
    folders = [] if spec is None or spec.origin is None else Path(spec.origin).parents
    headers = (folder / "include" for folder in folders)
    return next((folder for folder in headers if (folder / "pinocchio" / "algorithm" / "aba.hpp").exists()), None)


def _compiler() -> str:
    return subprocess.run(["c++", "--version"], stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()[0]


def built(folder: Path) -> Any:
    """Return the compiled library."""
    library = folder / "compiled_cpp.so"
    headers = [f"-isystem{path}" for path in (_pinocchio(), _eigen())]
    subprocess.run(["c++", *FLAGS, *headers, str(SOURCE), "-o", str(library)], check=True)
    loaded = ctypes.CDLL(str(library))
    loaded.new_chain.restype = ctypes.c_void_p
    return loaded


def _pointer(x: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(x.ctypes.data)


class Chain:
    """A chain of revolute joints moved by gravity alone, in C++, in the coordinates of `ForwardDynamics`."""

    def __init__(self, library: Any, mechanism: Mechanism, convention: str) -> None:
        self._library = library
        links = [
            np.concatenate([joint.F.p, joint.F.R.ravel(), joint.M.p, joint.M.R.ravel(), [body.mass], body.com])
            for joint, body in zip(mechanism.joints, mechanism.bodies, strict=True)
        ]
        rows = np.hstack([links, [body.inertia.ravel() for body in mechanism.bodies]])
        gravity = np.array(mechanism.gravity, dtype=float)
        made = library.new_chain(len(rows), _pointer(rows), _pointer(gravity), CONVENTIONS.index(convention))
        self._chain = ctypes.c_void_p(made)
        self._pair = np.vstack([DORMAND_PRINCE.A, DORMAND_PRINCE.b, DORMAND_PRINCE.E])

    def accelerations(self, q: Array, v: Array, out: Array) -> None:
        """Overwrite `out` with the accelerations at each row of q and v, shapes (n_states, n)."""
        self._library.accelerations(self._chain, len(q), _pointer(q), _pointer(v), _pointer(out))

    def motion(self, q: Array, v: Array, span: float, tolerance: float) -> tuple[Array, Array, int]:
        """Return q and v after a span in s, and the number of evaluations."""
        z, counters = np.concatenate([q, v]), np.zeros(3, dtype=np.int32)
        given = self._chain, _pointer(self._pair), ctypes.c_double(span), ctypes.c_double(tolerance)
        if not self._library.motion(*given, _pointer(z), _pointer(counters)):
            raise RuntimeError(f"the step became too short at a tolerance of {tolerance:g}")
        return z[: len(q)], z[len(q) :], int(counters[2])


def evaluations(library: Any, rounds: int) -> Table:
    """Return the table of single evaluations."""
    columns = ("bodies", "reference", *(f"C++, {name}" for name in CONVENTIONS), "reference / C++", "difference")
    table = Table("One evaluation against `aba` in C++", _EVALUATION.format(compiler=_compiler()), columns)
    for count in BODIES:
        dynamics = ForwardDynamics(chain(*["revolute"] * count))
        states = BATCH // count
        q, v = np.random.default_rng(count).normal(size=(2, states, count))
        ours, theirs = dynamics.accelerations_of(q, v, threads=1), np.empty((states, count))
        contenders: dict[str, Callable[[], object]] = {"reference": partial(dynamics.accelerations_of, q, v, threads=1)}
        difference = 0.0
        for name in CONVENTIONS:
            made = Chain(library, dynamics.mechanism, name)
            made.accelerations(q, v, theirs)
            sizes = np.max(np.abs(theirs), axis=1)
            difference = max(difference, float(np.max(np.max(np.abs(ours - theirs), axis=1) / sizes)))
            contenders[name] = partial(made.accelerations, q, v, theirs)
        if difference > AGREEMENT:
            raise RuntimeError(f"{count} bodies: the accelerations differ by {difference:.1e}")
        samples = race(contenders, rounds)
        times = [seconds(sample.median / states) for sample in samples.values()]
        table.rows.append([str(count), *times, str(ratio(samples["reference"], _faster(samples))), f"{difference:.1e}"])
    return table


class Motion:
    """A motion by both sides, and the errors of the positions of all bodies at its end, in m.

    Parameters
    ----------
    library
    mechanism : Mechanism
    q, v : ndarray
        Coordinates and speeds at the start.
    span : float, s
    """

    def __init__(self, library: Any, mechanism: Mechanism, q: Array, v: Array, span: float) -> None:
        self._start, self._span = (q, v), span
        self._dynamics = ForwardDynamics(mechanism)
        self._simulate = partial(simulate, mechanism, self._dynamics.state(q, v))
        self._chains = {name: Chain(library, mechanism, name) for name in CONVENTIONS}
        self._end = self.reference(1e-14, "dop853").p_WB[-1]

    def reference(self, tolerance: float, integrator: str | None = None) -> TrajectoryAnswer:
        return self._simulate(np.array([0.0, self._span]), tolerance, "relative", integrator)

    def translation(self) -> TrajectoryAnswer:
        """Return the start alone: all work of the reference but the integration."""
        return self._simulate(np.zeros(1), SAME, "relative")

    def compiled(self, tolerance: float, convention: str) -> tuple[Array, Array, int]:
        return self._chains[convention].motion(*self._start, self._span, tolerance)

    def of_reference(self, tolerance: float) -> tuple[float, int]:
        """Return error and number of evaluations."""
        answer = self.reference(tolerance)
        return float(np.max(np.abs(answer.p_WB[-1] - self._end))), int(answer.counters["evaluations"])

    def of_compiled(self, tolerance: float) -> tuple[float, int]:
        """Return error and number of evaluations."""
        q, v, count = self.compiled(tolerance, CONVENTIONS[0])
        return float(np.max(np.abs(self._dynamics.state(q, v).p_WB - self._end))), count

    def row(self, ours: float, theirs: float, rounds: int) -> list[str]:
        """Return the columns of one pair of tolerances from the tolerance of the reference on."""
        compiled = {name: partial(self.compiled, theirs, name) for name in CONVENTIONS}
        whole = partial(self.reference, ours)
        samples = race({"reference": whole, "translation": self.translation, **compiled}, rounds)
        faster = _faster(samples)
        propagation = less(samples["reference"], samples["translation"])
        cells = []
        for tolerance, (error, count), sample in (
            (ours, self.of_reference(ours), samples["reference"]),
            (theirs, self.of_compiled(theirs), faster),
        ):
            cells += [f"{tolerance:.2g}", f"{error:.1e}", str(count), seconds(sample.median)]
        cells.insert(4, seconds(samples["translation"].median))
        return [*cells, *(str(ratio(sample, faster)) for sample in (samples["reference"], propagation))]


def _faster(samples: Mapping[str, Sample]) -> Sample:
    """Return the sample of the faster convention."""
    return min((samples[name] for name in CONVENTIONS), key=lambda sample: sample.median)


def _coarsest(outcome: Callable[[float], tuple[float, int]]) -> float:
    """Return the coarsest tolerance at which the error is at most `GOAL`."""
    return next(tolerance for tolerance in TOLERANCES if outcome(tolerance)[0] <= GOAL)


def motions(library: Any, rounds: int) -> Table:
    """Return the table of motions: at the same tolerance, and to the same accuracy."""
    ours = ("reference: tolerance", "error, m", "evaluations", "time", "of it translation")
    theirs = ("C++: tolerance", "error, m", "evaluations", "time")
    columns = ("motion", "over", *ours, *theirs, "reference / C++", "without translation")
    table = Table("A whole motion against `aba` in C++", _MOTION, columns)
    for name, problem in problems().items():
        motion = Motion(library, *problem)
        same, accurate = (SAME, SAME), (_coarsest(motion.of_reference), _coarsest(motion.of_compiled))
        table.rows += [[name, f"{problem[-1]:g} s", *motion.row(*pair, rounds)] for pair in (same, accurate)]
    return table


def problems() -> dict[str, tuple[Mechanism, Array, Array, float]]:
    """Return mechanism, coordinates and speeds at the start, and span in s."""
    case = load_case("seven_axis_arm")
    arm, long = replace(case.mechanism, joint_springs=()), chain(*["revolute"] * 50)
    return {
        "seven_axis_arm, motors off": (arm, *ForwardDynamics(arm).coordinates(case.initial_state), case.duration),
        "chain of 50": (long, *np.random.default_rng(50).normal(size=(2, 50)), 0.5),
    }


def run(short: bool) -> Iterator[Table]:
    """Yield two tables; where something is missing an empty one that says so."""
    if missing():
        yield Table("Against `aba` in C++", f"**No {missing()}: nothing was measured.**", ())
        return
    with TemporaryDirectory() as folder:
        library = built(Path(folder))
        rounds = 5 if short else TURNS
        yield evaluations(library, rounds)
        yield motions(library, rounds)
