"""Cached forms of frames: header parts that repeat are written and read once, without any effect on values and keys."""

import numpy as np
import pytest

from consilience.engine import InstantAnswer, ModelAnswer
from consilience.engine.worker import codec
from consilience.engine.worker.messages import job
from consilience.engine.worker.requests import Request
from consilience.engine.worker.server import _REMEMBERED, Server, _Bytes, read_frames
from consilience.engine.worker.wire import pack
from harness.test_protocol import MECHANISMS, Asked, same

ONE, OTHER = list(MECHANISMS.values())[:2]


def received(data):
    """The frame that some bytes hold."""
    (frame,) = read_frames(_Bytes(data))
    return frame


class Repeats(Server):
    """A worker that returns prepared answers in turn."""

    def __init__(self, *answers):
        super().__init__()
        self.answers = iter(answers)

    def _perform(self, request):
        return next(self.answers)


ALIKE = [
    ModelAnswer(0.0, np.zeros(3), np.eye(3), 2),
    ModelAnswer(0.0, np.ones(3), 2.0 * np.eye(3), 2),
    ModelAnswer(-0.0, np.zeros(3), np.eye(3), 2),
    ModelAnswer(1.0, np.zeros(3), np.eye(3), 1),
    ModelAnswer(1.0, np.zeros(3), np.eye(3), True),
    ModelAnswer(1, np.zeros(3), np.eye(3), 1),
    ModelAnswer(float("nan"), np.zeros(3), np.eye(3), 1.0),
    ModelAnswer(1.0, np.zeros(4), np.eye(3), 1),
    ModelAnswer(1.0, np.zeros(3, dtype="<f4"), np.eye(3).T, 1),
    ModelAnswer("1.0", (0.0, [1.0]), None, -1),
    InstantAnswer(*np.ones((4, 1, 2, 3)), np.zeros(1), np.zeros(1)),
    InstantAnswer(*np.ones((2, 1, 2, 3)), None, None, np.zeros(1), np.zeros(1)),
]


def test_similar_answers_are_not_confused():
    answers = [*ALIKE, *reversed(ALIKE)]
    server = Repeats(*answers)
    for number, answer in enumerate(answers):
        frame = received(server.handle(received(job(Request(), None, None, number))))
        assert frame.job == number
        value = codec.value_of(frame.header, frame.arrays)
        assert same(value, answer)
        assert repr(vars(value)) == repr(vars(answer))  # unlike ==, repr tells -0.0 from 0.0


def test_the_header_of_an_answer_like_an_earlier_one_is_not_written_again(monkeypatch):
    monkeypatch.setattr(
        "consilience.engine.worker.server._left_behind", lambda: False
    )  # the test process may have children of its own
    server = Repeats(*ALIKE[:3])
    replies = [server.handle(received(job(Request(), None, None, 1)))]
    monkeypatch.setattr(codec, "encode", lambda answer: pytest.fail("it is written again"))
    replies.append(server.handle(received(job(Request(), None, None, 2))))
    first, second = map(received, replies)
    assert first.header is second.header
    assert same(codec.value_of(second.header, second.arrays), ALIKE[1])


def test_values_of_a_cached_form_are_not_shared():
    data = pack({"value": codec.encode({"a": [1, {"b": (2, [3])}]})[0]})
    first, second = received(data), received(data)
    assert first.header is second.header
    value = codec.value_of(first.header, first.arrays)
    value["a"][1]["b"][1].append(4)
    value["a"].clear()
    assert codec.value_of(second.header, second.arrays) == {"a": [1, {"b": (2, [3])}]}


def kept(key, mechanism):
    tree, arrays = codec.encode(mechanism)
    return received(pack({"kind": "keep", "key": key, "value": tree}, arrays))


def test_a_repeated_job_uses_the_mechanism_kept_last():
    server, asked = Asked(), received(job(Request(ONE), "key", None, 1))
    server.handle(kept("key", ONE))
    for _ in range(2):
        server.handle(asked)
        assert same(server.request.mechanism, ONE)
    server.handle(kept("key", OTHER))
    server.handle(asked)
    assert same(server.request.mechanism, OTHER)
    server.handle(received(pack({"kind": "forget", "key": "key"})))
    refused = received(server.handle(asked))
    assert refused.header.entries["reason"] == "the job refers to a Mechanism that was not sent"


def test_a_worker_remembers_a_limited_number_of_forms():
    server = Asked()
    for n in range(3 * _REMEMBERED):
        server.handle(received(job(Request(step=float(n)), None, None, n)))
    assert len(server._requests) <= _REMEMBERED
