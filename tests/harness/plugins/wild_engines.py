"""Engines that attack their worker, each at the question `instant` of the mechanism ``first`` only.

Every regular answer is zero: without a solver the engines start at once.
"""

import ctypes
import os
import socket
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

from consilience.engine import (
    EngineInfo,
    InstantAnswer,
    Manifest,
    Method,
    ModelAnswer,
    Question,
    Route,
    TrajectoryAnswer,
)
from consilience.engine.worker import wire


class ZeroEngine:
    """Answers zeros in the right form, and keeps every mechanism that was asked about."""

    def __init__(self):
        self.seen = []

    def info(self):
        return EngineInfo("zero", "1.0", "1.0")

    def unsupported(self, mechanism, question):
        return ()

    def methods(self, mechanism, question):
        return (Method("zero", Route.NATIVE, substeps=(1,) if question is Question.TRAJECTORY else ()),)

    def manifest(self, mechanism):
        return Manifest()

    def model(self, mechanism, state, method):
        self.seen.append(mechanism)
        same = len({id(m) for m in self.seen if m.name == mechanism.name})
        return ModelAnswer(0.0, np.zeros(3), np.zeros((3, 3)), same)

    def instant(self, mechanism, states, method):
        n_s, n_b, n_j = len(states), len(mechanism.bodies), len(mechanism.joints)
        b, j = np.zeros((n_s, n_b, 3)), np.zeros((n_s, n_j, 3))
        return InstantAnswer(b, b, j, j, np.zeros(n_s), np.zeros(n_s))

    def trajectory(self, mechanism, state, times, method, step):
        zeros = np.zeros((len(times), len(mechanism.bodies), 3))
        quat = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*zeros.shape[:2], 4))
        return TrajectoryAnswer(times, zeros, quat, zeros, zeros)


class WildEngine(ZeroEngine):
    def __init__(self, attack):
        super().__init__()
        self._attack = attack

    def instant(self, mechanism, states, method):
        if mechanism.name == "first":
            self._attack()
        return super().instant(mechanism, states, method)


def _wire():
    """The socket of the protocol, found although the worker hides it from engines."""
    for number in sorted(int(name) for name in os.listdir("/proc/self/fd")):
        try:
            return socket.socket(fileno=os.dup(number))
        except OSError:
            continue
    raise AssertionError("no socket is open")


def _half_a_frame():
    _wire().sendall(wire.pack({"kind": "reply"}, [np.zeros(1000)])[:4000])


def _crash(*_):
    os.abort()


def _reply(number):
    return wire.pack({"kind": "reply", "reason": "", "strays": False, "value": None}, job=number)


def _eat():
    held = []
    while True:
        held.append(np.ones(2**20))


def _print_without_end():
    while True:
        os.write(1, b"iteration diverged, trying again\n" * 1000)


def _leave_a_child(away):
    if os.fork() == 0:
        if away:
            os.setsid()
        time.sleep(10_000)


def _leave_a_grandchild():
    """Start a daemon: a process with a session of its own whose parent has ended."""
    child = os.fork()
    if child == 0:
        os.setsid()
        if os.fork() == 0:
            time.sleep(10_000)
        os._exit(0)
    os.waitpid(child, 0)


def _close_everything():
    os.closerange(3, 4096)
    time.sleep(10_000)


def _child_and_crash():
    _leave_a_child(away=True)
    os.abort()


def _both(first, second):
    first()
    second()


def _loop():
    while True:  # memory does not grow: only the time limit ends this loop
        pass


ATTACKS = {
    "starts_a_crash": None,
    "loops": _loop,
    "loops_in_c": lambda: ctypes.PyDLL(None).pause(),
    "eats_memory": _eat,
    "asks_for_too_much": lambda: np.ones(2**46),
    "floods": _print_without_end,
    "writes_garbage": lambda: _wire().sendall(b"Segmentation fault (core dumped)\n" * 100),
    "writes_text_frame": lambda: _wire().sendall(wire.pack({"kind": "job", "value": [1, 2]})),
    "half_a_frame_and_dies": lambda: _both(_half_a_frame, _crash),
    "half_a_frame_and_hangs": lambda: _both(_half_a_frame, lambda: time.sleep(10_000)),
    "announces_too_much": lambda: _wire().sendall(wire.PREFIX.pack(wire.MAGIC, wire.VERSION, 2**32 - 1, 2**60, 4, 0.0)),
    "other_version": lambda: _wire().sendall(wire.PREFIX.pack(wire.MAGIC, 99, 10, 0, 4, 0.0)),
    "wrong_job": lambda: _wire().sendall(_reply(123_456)),
    "answers_twice": lambda: _both(lambda: _wire().sendall(_reply(4)), lambda: _wire().sendall(_reply(4))),
    "closes_its_pipe": _close_everything,
    "leaves_a_child": partial(_leave_a_child, away=False),
    "leaves_a_child_elsewhere": partial(_leave_a_child, away=True),
    "leaves_a_daemon": _leave_a_grandchild,
    "leaves_a_child_and_dies": _child_and_crash,
    "closes_standard_output": lambda: _both(sys.stdout.close, lambda: os.close(2)),
    "nests": None,
}
for _name, _attack in ATTACKS.items():
    globals()[_name] = partial(WildEngine, _attack)

starts_a_crash = _crash


class Nester(ZeroEngine):
    """Returns an answer that contains itself."""

    def instant(self, mechanism, states, method):
        if mechanism.name != "first":
            return super().instant(mechanism, states, method)
        knot = []
        knot.append(knot)
        return knot


nests = Nester


class Scribbler(ZeroEngine):
    """Writes into the mechanism that the worker lends to it."""

    def instant(self, mechanism, states, method):
        mechanism.bodies[0].com[0] = 7.0
        return super().instant(mechanism, states, method)


class Stuck(ZeroEngine):
    """Writes a file as a sign that it was called, then blocks for ever."""

    def unsupported(self, mechanism, question):
        Path(os.environ["CONSILIENCE_TEST_STUCK"]).write_text("stuck")
        ctypes.PyDLL(None).pause()
