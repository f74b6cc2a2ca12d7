"""Workers under attack: each fault is one failed reply with its evidence, the next job is answered, nothing is left."""

import os
import subprocess
import sys
import threading
import time
import uuid
from dataclasses import replace

import numpy as np
import psutil
import pytest

from consilience.run import EngineInfo, InstantAnswer, Method, Question, Route
from consilience.worker import Reply, Request, Worker
from consilience.workers.jobs import Plan
from mechanisms import chain, states_of

LIMIT = 4.0
MEMORY = 400 * 2**20
METHOD = Method("zero", Route.NATIVE)

# engine: evidence (a pattern) in the reason
ATTACKS = {
    "loops": "^no answer within 4 s; the worker was stopped$",
    "loops_in_c": "^no answer within 4 s; the worker was stopped$",
    "eats_memory": r"^out of memory: \d+ MiB, the limit is 400 MiB$",
    "asks_for_too_much": "^_?ArrayMemoryError: Unable to allocate 512. TiB",
    "floods": "^it printed more than 64 MiB$",
    "writes_garbage": "^garbage on the wire: b'Segmentation fault",
    "writes_text_frame": "^garbage on the wire: .* is no reply$",
    "half_a_frame_and_dies": r"^the worker died: signal SIGABRT, after 4000 of \d{4} bytes of an answer$",
    "half_a_frame_and_hangs": r"the worker was stopped, after 4000 of \d{4} bytes of an answer$",
    "announces_too_much": r"^a frame of 4294967295 \+ 1152921504606846976 bytes; at most",
    "other_version": "^it speaks version 99 of the protocol, not 1$",
    "wrong_job": "^it answered job 123456, not job 3$",
    "answers_twice": "^it answered job 4, not job 3$",
    "closes_its_pipe": "^the worker closed its connection and lived on$",
    "leaves_a_child": "^it left a process behind that goes on$",
    "leaves_a_child_elsewhere": "^it left a process behind that goes on$",
    "leaves_a_daemon": "^it left a process behind that goes on$",
    "leaves_a_child_and_dies": "^the worker died: signal SIGABRT$",
    "nests": "^RecursionError",
}
SURVIVES = {"asks_for_too_much", "nests"}
"""What is an exception in the worker and no reason to replace it."""


@pytest.fixture
def marked(monkeypatch):
    """Pids of the living processes that descend from this test."""
    mark = uuid.uuid4().hex
    monkeypatch.setenv("CONSILIENCE_TEST_MARK", mark)

    def find():
        found = []
        for process in psutil.process_iter():
            try:
                if process.environ().get("CONSILIENCE_TEST_MARK") == mark and process.status() != "zombie":
                    found.append(process.pid)
            except psutil.Error:
                continue
        return found

    return find


def mechanism_of(name, seed=3):
    return replace(chain("revolute", "spherical", seed=seed), name=name)


def instant_of(mechanism, method=METHOD):
    return Request(mechanism, Question.INSTANT, method, states_of(mechanism, 2))


FIRST, OTHER = mechanism_of("first"), mechanism_of("other", 4)


def gone(find, within=2.0):
    """Whether nothing is left, at once or soon: the dead are buried by others."""
    until = time.monotonic() + within
    while find():
        if time.monotonic() > until:
            return False
        time.sleep(0.02)
    return True


@pytest.mark.parametrize("engine", ATTACKS)
def test_an_attack_is_a_failed_reply_and_the_next_job_is_answered(engine, marked):
    with Worker(engine, LIMIT, MEMORY) as worker:
        before = worker.ask(instant_of(OTHER))
        first = marked()
        start = time.monotonic()
        bad = worker.ask(instant_of(FIRST))
        spent = time.monotonic() - start
        assert gone(lambda: [pid for pid in marked() if pid in first]) is (engine not in SURVIVES)
        after = worker.ask(instant_of(OTHER))
        assert len(marked()) == 1
    assert before.returned, before.reason
    assert len(first) == 1
    assert not bad.returned
    assert bad.value is None
    pattern = ATTACKS[engine]
    assert __import__("re").search(pattern, bad.reason), bad.reason
    assert spent < LIMIT + 3.0
    assert isinstance(after.value, InstantAnswer), after.reason
    assert gone(marked)
