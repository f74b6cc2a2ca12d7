"""Frames and values of the wire protocol: a value arrives unchanged to the last bit, everything else is refused."""

import json
from dataclasses import fields, is_dataclass, replace
from enum import Enum

import numpy as np
import pytest

from consilience.engine import EngineInfo, Manifest, Method, ModelAnswer, Question, Route, TrajectoryAnswer, Unsupported
from consilience.engine.questions import ANSWERS
from consilience.engine.worker import codec, wire
from consilience.engine.worker.messages import RecentlySent, job
from consilience.engine.worker.requests import AnswerSet, MethodAnswer, Plan, Request
from consilience.engine.worker.server import Server, _Bytes, read_frames
from consilience.engine.worker.wire import PREFIX, Message, MessageHeader, ProtocolError, pack, read_prefix, unpack
from consilience.mechanism import ContactLaw, Drive, Mechanism, Regularisation, through
from consilience.reference.engine import ReferenceEngine
from mechanisms import ELEMENTS, LOOPS, TREES, chain, states_of

MECHANISMS = TREES | LOOPS | ELEMENTS
LAST = next(reversed(MECHANISMS))


def sent(value):
    """The value after packing and unpacking."""
    tree, arrays = codec.encode(value)
    data = pack({"value": tree}, arrays)
    header, body, *_ = read_prefix(data)
    assert len(data) == PREFIX.size + header + body
    text, rest = data[PREFIX.size : PREFIX.size + header], bytearray(data[PREFIX.size + header :])
    return codec.value_of(*unpack(text, rest))


def same(a, b):
    """Whether two values have the same type and are equal to the last bit."""
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[k], b[k]) for k in a)
    if is_dataclass(a):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return a == b or repr(a) == repr(b) == "nan"


@pytest.mark.parametrize("name", MECHANISMS)
def test_a_mechanism_and_its_states_arrive_to_the_last_bit(name):
    mechanism = MECHANISMS[name]
    arrived = sent(mechanism)
    assert isinstance(arrived, Mechanism)
    assert same(arrived, mechanism)
    states = states_of(mechanism, 2)
    assert same(sent(states), states)


def test_a_curve_arrives_with_its_spline():
    law = through(np.linspace(0.0, 2.0, 8), np.cos(np.linspace(0.0, 2.0, 8)))
    mechanism = replace(chain("revolute", seed=1), drives=(Drive("d", "j0", "angle", law),))
    arrived = sent(mechanism).drives[0].motion
    assert "pieces" in vars(arrived.table)
    assert arrived.jet(0.77) == law.jet(0.77)


METHOD = Method(
    "a",
    Route.TUNED,
    4,
    (1, 2),
    settings={"x": [1, 2.5, None, True], "y": {"z": (1, "ü")}, "w": float("inf")},
    softness=1.0,
    soft_law=ContactLaw(
        regularisation=(
            Regularisation(
                pull=2e3, decay=1e2, least=0.9, most=0.95, width=1e-3, midpoint=0.5, power=2.0, inverse_mass=0.5
            ),
        )
    ),
)
VALUES = [
    None,
    True,
    -0.0,
    float("nan"),
    10**30,
    "text ∂ \x00",
    (1, [2, (3,)]),
    {"a": 1, 2: "b", Question.MODEL: ()},
    METHOD,
    EngineInfo("e", "1", "2"),
    Plan(
        {Question.MODEL: (Unsupported("f", "r"),), Question.INSTANT: (), Question.TRAJECTORY: ()},
        {Question.INSTANT: (METHOD,), Question.TRAJECTORY: (METHOD,)},
        Manifest(("a",), ()),
    ),
    AnswerSet(
        (MethodAnswer(Question.MODEL, METHOD, 5.0), MethodAnswer(Question.INSTANT, None, None, "why")),
        {Question.MODEL: ()},
    ),
    ModelAnswer(1.0, np.zeros(3), np.eye(3), 2),
    TrajectoryAnswer(np.arange(3.0), *(np.ones((3, 2, n)) for n in (3, 4, 3, 3)), {"steps": 5, "error": 0.1}),
    np.zeros((0, 3)),
    np.array(5.0),
    np.arange(6, dtype="<i2"),
    np.array([["ab", "c"]]),
    np.array([1 + 2j]),
    np.array([True, False]),
]


@pytest.mark.parametrize("value", VALUES, ids=lambda v: type(v).__name__)
def test_a_value_arrives(value):
    assert same(sent(value), value)


@pytest.mark.parametrize(
    "asked",
    [
        Request(),
        Request(states=states_of(MECHANISMS[LAST], 3), question=Question.INSTANT, method=METHOD),
        Request(states=states_of(MECHANISMS[LAST], 1), times=np.linspace(0.0, 1.0, 5), step=0.1, method=METHOD),
        Request(MECHANISMS[LAST], survey=(Question.MODEL, Question.INSTANT)),
        Request(MECHANISMS[LAST], states=states_of(MECHANISMS[LAST], 2), parameters={"a": np.eye(3), "n": (1, 0.5)}),
        Request(MECHANISMS[LAST], parameters={"about": "the origin"}),
    ],
)
def test_a_job_arrives_to_the_last_bit(asked):
    mechanism, first = RecentlySent().need(asked.mechanism)
    method, second = RecentlySent().need(asked.method)
    server, found = Asked(), read_frames(_Bytes(first + second + job(asked, mechanism, method, 7)))
    replies = [server.handle(frame) for frame in found]
    assert all(reply is None for reply in replies[:-1])
    assert same(server.request, replace(asked, states=tuple(asked.states)))


class Asked(Server):
    """A worker that keeps its requests."""

    def _perform(self, request):
        self.request = request


def test_an_array_in_another_order_of_memory_arrives_in_order():
    a = np.arange(24.0).reshape(2, 3, 4)
    np.testing.assert_array_equal(sent(a.T), a.T)
    np.testing.assert_array_equal(sent(a[:, ::2, ::-1]), a[:, ::2, ::-1])


def test_a_real_answer_arrives_to_the_last_bit():
    mechanism = MECHANISMS[next(iter(TREES))]
    engine = ReferenceEngine()
    method = engine.methods(mechanism, Question.MODEL)[0]
    answer = engine.model(mechanism, states_of(mechanism, 1)[0], method)
    assert same(sent(replace(answer, mass=float(answer.mass))), replace(answer, mass=float(answer.mass)))


@pytest.mark.parametrize("value", [lambda: 0, object(), {1, 2}, np.array([object()]), b"bytes", open])
def test_what_no_message_can_hold_is_refused(value):
    with pytest.raises(ProtocolError, match="cannot be sent: it holds"):
        codec.encode({"answer": [value]})


# ---------------------------------------------------------------- frames of a broken worker


def told(tree, *arrays):
    return codec.value_of(MessageHeader({"value": json.loads(json.dumps(tree))}), arrays)


INFO = {"@": "EngineInfo", "name": "e", "version": "1", "adapter": "a", "remarks": ""}
A_METHOD = codec.encode(METHOD)[0]


@pytest.mark.parametrize(
    "tree",
    [
        {},
        {"@": 5},
        {"@": "Popen", "args": "x"},
        {"@": "__import__"},
        {"@": "EngineInfo"},
        INFO | {"more": 1},
        INFO | {"name": 5},
        INFO | {"version": None},
        INFO | {"remarks": "\ud800"},
        A_METHOD | {"substeps": {"@": "tuple", "items": [0]}},
        A_METHOD | {"substeps": {"@": "tuple", "items": [-1]}},
        A_METHOD | {"substeps": {"@": "tuple", "items": ["2"]}},
        A_METHOD | {"substeps": {"@": "tuple", "items": [True]}},
        A_METHOD | {"substeps": [2]},
        A_METHOD | {"tolerances": {"@": "tuple", "items": [float("nan")]}},
        A_METHOD | {"route": "native"},
        A_METHOD | {"route": {"@": "Route", "value": "invented"}},
        A_METHOD | {"settings": {"@": "dict", "items": [[[1], 2]]}},
        A_METHOD | {"settings": {"@": "dict", "items": [5]}},
        {"@": "Question", "value": []},
        {"@": "array", "n": 0},
        {"@": "array", "n": -1},
        {"@": "array", "n": True},
        {"@": "array"},
        {"@": "tuple", "items": 5},
        {"@": "tuple"},
        {"@": "dict", "items": [[{"@": "tuple", "items": [[]]}, 1]]},
    ],
    ids=lambda tree: json.dumps(tree)[:60],
)
def test_an_invalid_value_is_refused(tree):
    with pytest.raises(ProtocolError):
        told(tree)


@pytest.mark.parametrize("missing", ["unsupported", "methods"])
def test_a_plan_that_is_silent_about_a_question_is_refused(missing):
    """Such a plan must not end the runner."""
    says = {"unsupported": dict.fromkeys(Question, ()), "methods": dict.fromkeys(Question, ()), "manifest": Manifest()}
    assert isinstance(sent(Plan(**says)), Plan)
    del says[missing][Question.INSTANT]
    with pytest.raises(ProtocolError, match="a Plan says of a question neither"):
        sent(Plan(**says))


NONSENSE = {
    "no kind": {"engine": "mujoco"},
    "an unknown kind": {"kind": ["job"]},
    "no name": {"kind": "load"},
    "a number for a name": {"kind": "load", "engine": 7},
    "no mechanism": {"kind": "keep", "key": "k", "value": 7},
    "a key that is none": {"kind": "forget", "key": []},
}


@pytest.mark.parametrize("header", NONSENSE.values(), ids=NONSENSE)
def test_a_worker_refuses_frames_that_are_none_of_ours(header):
    with pytest.raises(ProtocolError):
        Server().handle(Message(MessageHeader(header), []))


def test_deep_nesting_is_refused():
    tree = []
    for _ in range(100_000):
        tree = [tree]
    with pytest.raises(ProtocolError, match="nested too deeply"):
        codec.value_of(MessageHeader({"value": tree}), [])
    with pytest.raises(ProtocolError, match="no JSON"):
        unpack(b"[" * 100_000, bytearray())


@pytest.mark.parametrize(
    ("listed", "body"),
    [
        (None, 0),
        ([["<f8", [2]]], 0),
        ([["<f8", [2]]], 32),
        ([["<f8", [-1]]], 16),
        ([["<f8", [2.0]]], 16),
        ([["<f8", [True]]], 16),
        ([["<f8", [2**40, 2**40, 2**40, 0]]], 0),
        ([["<f8", [1] * 40]], 16),
        ([["|O", [1]]], 16),
        ([["<M8[s]", [1]]], 16),
        ([["f9", [1]]], 16),
        ([["<f8,<f8", [1]]], 16),
        ([["<U999999", [10**6]]], 16),
        ([[1, 2]], 16),
        ([["<f8"]], 16),
        ([["|S0", [3]]], 16),
    ],
)
def test_arrays_that_do_not_fill_the_body_are_refused(listed, body):
    with pytest.raises(ProtocolError):
        unpack(json.dumps({"arrays": listed}).encode(), bytearray(body))


@pytest.mark.parametrize("text", [b"", b"\xff", b"[]", b"5", b"{", b"{}", b'{"arrays":[]} x', b"9" * 5000])
def test_an_invalid_header_is_refused(text):
    parsed, arrays = unpack(b'{"arrays":[]}', bytearray())
    assert parsed.entries == {}
    assert arrays == []
    with pytest.raises(ProtocolError):
        unpack(text, bytearray())


def test_every_single_byte_changed_is_refused_or_a_value():
    """Each byte of a frame replaced in turn: the frame is refused or read, without any other exception or size."""
    refused = {question: (Unsupported("f", "r"),) for question in Question}
    tree, arrays = codec.encode(Plan(refused, {Question.MODEL: (METHOD,)}, Manifest(("exact",))))
    data = pack({"kind": "reply", "value": tree}, [*arrays, np.arange(3.0)])
    rng = np.random.default_rng(1)
    outcomes = set()
    for at in range(len(data)):
        for byte in rng.integers(0, 256, 4):
            broken = bytearray(data)
            broken[at] = byte
            outcomes.add(_read(bytes(broken)))
    assert outcomes == {"refused", "read"}


def _read(data):
    try:
        header, body, *_ = read_prefix(data)
        if len(data) != PREFIX.size + header + body:
            return "refused"
        parsed, arrays = unpack(data[PREFIX.size : PREFIX.size + header], bytearray(data[PREFIX.size + header :]))
        if "value" in parsed.entries:
            codec.value_of(parsed, arrays)
    except ProtocolError:
        return "refused"
    return "read"


def test_every_class_of_the_table_has_its_own_name():
    everything = [*codec.CLASSES.values(), *ANSWERS.values(), *codec.WORDS.values()]
    assert len({cls.__name__ for cls in everything}) == len(everything)
    assert all(is_dataclass(cls) for cls in (*codec.CLASSES.values(), *ANSWERS.values()))
    assert all(issubclass(cls, Enum | Question) for cls in codec.WORDS.values())


def test_a_frame_too_large_is_not_packed():
    with pytest.raises(ProtocolError, match="at most"):
        pack({"reason": "x" * (wire.MOST_HEADER + 1)})
