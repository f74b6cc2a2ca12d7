"""Engines with one fault each, shown only at the question `instant` or `trajectory` of the mechanism ``first``."""

import ctypes
import os
import resource
import signal
import sys
import time
from dataclasses import replace
from functools import partial

import numpy as np
from honest_engine import HonestEngine
from wild_engines import ATTACKS

from consilience.engine import CannotRepresent, Question, Unsupported

resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # intentional crashes here leave no core files


class FaultyEngine(HonestEngine):
    """An engine whose function `fault` replaces the right answer."""

    def __init__(self, question, fault):
        super().__init__()
        self.question, self.fault = question, fault

    def _spoil(self, question, mechanism, answer):
        return self.fault(answer) if question is self.question and mechanism.name == "first" else answer

    def instant(self, mechanism, states, method):
        return self._spoil(Question.INSTANT, mechanism, super().instant(mechanism, states, method))

    def trajectory(self, mechanism, state, times, method, step):
        return self._spoil(Question.TRAJECTORY, mechanism, super().trajectory(mechanism, state, times, method, step))


class TwoPartError(Exception):
    """An exception that pickle cannot rebuild: pickle passes the message alone to the constructor."""

    def __init__(self, code, detail):
        super().__init__(f"{code}: {detail}")


def _raise(error):
    raise error


def _exit(_):
    os._exit(3)


def _abort(_):
    sys.stderr.write("*** corrupted double-linked list ***\n")
    sys.stderr.flush()
    os.abort()


def _sleep(_):
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # stands for native code that ignores SIGTERM
    time.sleep(10_000)


def _chatter(answer):
    os.write(1, b"\xff\xfe\x00\x80garbage" * 100_000)
    ctypes.CDLL(None).puts(b"from C")
    sys.stdout.write("from Python\n")
    sys.stdout.flush()
    os.write(2, b"on the error channel, last\n")
    return answer


def _nan(answer):
    a = answer.a_WB_W.copy()
    a[1, 0, 2] = np.nan
    return replace(answer, a_WB_W=a)


def _cut(answer):
    return replace(answer, **{n: getattr(answer, n)[:-1] for n in ("time", "p_WB", "quat_WB", "v_WB_W", "w_WB_W")})


def _emptied(answer):
    return replace(answer, **{name: np.array([]) for name in ("a_WB_W", "alpha_WB_W", "kinetic", "potential")})


DEADLY = {
    "aborts": _abort,
    "is_killed": lambda _: os.kill(os.getpid(), signal.SIGKILL),
    "segfaults": lambda _: ctypes.string_at(0),
    "exits": _exit,
    "chatters": _chatter,
    "raises_two_parts": lambda _: _raise(TwoPartError(7, "no licence")),
    "gives_lambda": lambda _: lambda: 0,
    "gives_ragged": lambda answer: replace(answer, force_F=[[1.0], [1.0, 2.0]]),
}
for name in (
    *("writes_garbage", "closes_its_pipe", "leaves_a_child", "leaves_a_child_and_dies", "floods", "wrong_job"),
    *("half_a_frame_and_dies", "eats_memory"),
):
    DEADLY[f"honestly_{name}"] = lambda answer, attack=ATTACKS[name]: attack() or answer
for name, fault in DEADLY.items():
    globals()[name] = partial(FaultyEngine, Question.INSTANT, fault)
gives_zero_quaternions = partial(
    FaultyEngine, Question.TRAJECTORY, lambda answer: replace(answer, quat_WB=0.0 * answer.quat_WB)
)

LIES = {
    Question.MODEL: {},
    Question.INSTANT: {
        "raises": lambda _: _raise(RuntimeError("the Jacobian is singular at body 2")),
        "gives_nan": _nan,
        "cannot_represent": lambda _: _raise(CannotRepresent("state 1", "this engine knows no such state")),
        "gives_none": lambda _: None,
        "gives_text": lambda _: "42",
        "gives_strings": lambda answer: replace(answer, kinetic=np.array(["1.0"] * len(answer.kinetic))),
        "gives_wrong_shape": lambda answer: replace(answer, alpha_WB_W=answer.alpha_WB_W[..., :2]),
        "gives_nothing": _emptied,
    },
    Question.TRAJECTORY: {
        "stops_early": _cut,
        "gives_long_quaternions": lambda answer: replace(answer, quat_WB=2.0 * answer.quat_WB),
    },
}


class Liar(HonestEngine):
    """An engine with one method for each kind of malformed answer, and an honest method before and after them."""

    def methods(self, mechanism, question):
        (honest,) = super().methods(mechanism, question)
        faulty = [replace(honest, name=name) for name in LIES[question]] if mechanism.name == "first" else []
        return (honest, *faulty, replace(honest, name="honest after all"))

    def model(self, mechanism, state, method):
        return super().model(mechanism, state, replace(method, name="descriptor"))

    def instant(self, mechanism, states, method):
        answer = super().instant(mechanism, states, replace(method, name="descriptor"))
        return LIES[Question.INSTANT].get(method.name, lambda a: a)(answer)

    def trajectory(self, mechanism, state, times, method, step):
        answer = super().trajectory(mechanism, state, times, replace(method, name="descriptor"), step)
        return LIES[Question.TRAJECTORY].get(method.name, lambda a: a)(answer)


hangs = partial(FaultyEngine, Question.INSTANT, _sleep)


class Selective(HonestEngine):
    """Declares one mechanism unsupported."""

    def unsupported(self, mechanism, question):
        if question is Question.INSTANT and mechanism.name == "first":
            return (Unsupported("joint 'j1'", "this engine knows no spherical joints"),)
        return ()


class Silent(HonestEngine):
    """Declares a mechanism supported, but offers no method for it."""

    def methods(self, mechanism, question):
        if question is Question.INSTANT and mechanism.name == "first":
            return ()
        return super().methods(mechanism, question)


class Stepless(HonestEngine):
    """Offers a trajectory method without levels."""

    def methods(self, mechanism, question):
        found = super().methods(mechanism, question)
        if question is Question.TRAJECTORY and mechanism.name == "first":
            return tuple(replace(m, tolerances=()) for m in found)
        return found


class CannotPlan(HonestEngine):
    """Raises while it plans a mechanism, before a question is asked."""

    def methods(self, mechanism, question):
        if mechanism.name == "first":
            raise KeyError("spherical")
        return super().methods(mechanism, question)


class CannotStart(HonestEngine):
    """Can be imported, but raises when it is constructed."""

    def __init__(self):
        raise OSError("no licence server")


class Anonymous(HonestEngine):
    """Returns a string in place of `EngineInfo`."""

    def info(self):
        return "version 3"
