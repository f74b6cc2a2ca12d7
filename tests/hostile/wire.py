"""Hostile frames: messages of a broken worker to the runner, and messages to a worker.

An input is the bytes of the socket after a first byte that names the receiver. The runner processes a received value as
`run` and `fuzz` do: it checks for defects, plans, keeps and judges.
"""

import json
import struct
import warnings
from contextlib import closing, nullcontext, suppress
from functools import cache

import numpy as np
from hypothesis import strategies as st

from consilience.audit.fuzz.judging import judge
from consilience.audit.fuzz.workers import batch_of
from consilience.case import load_case
from consilience.engine import (
    EngineInfo,
    InstantAnswer,
    Manifest,
    Method,
    ModelAnswer,
    Question,
    Route,
    TrajectoryAnswer,
    Unsupported,
)
from consilience.engine.questions import ANSWERS
from consilience.engine.worker import codec, wire
from consilience.engine.worker.client import Reply, Request, _sound
from consilience.engine.worker.messages import RecentlySent, job, loading
from consilience.engine.worker.requests import AnswerSet, MethodAnswer, Plan, perform
from consilience.engine.worker.server import Server, _Bytes, read_frames
from consilience.engine.worker.wire import MAGIC, PREFIX, VERSION, Incoming, ProtocolError
from consilience.errors import visible
from consilience.suite import QUICK, Store, ask_case
from hostile.mutations import TABLE_KINDS, TEXT_KINDS, _json, changed_bytes, changed_tables
from hostile.pages import check_terminal
from hostile.watch import Breach, import_everything, watched

METHOD = Method("RK4", Route.NATIVE, 4, (2, 4), settings={"step": 0.01}, softness=1.0)
RUNNER, WORKER = b"r", b"w"


@cache
def _case():
    return QUICK.case(load_case("double_pendulum"))


class Still:
    """An engine that answers every question; nothing moves."""

    def info(self):
        return EngineInfo("still", "1.0", "1.0", "remarks")

    def unsupported(self, mechanism, question):
        return ()

    def methods(self, mechanism, question):
        return (METHOD,)

    def manifest(self, mechanism):
        return Manifest(("bodies",), ("joints",))

    def model(self, mechanism, state, method):
        return ModelAnswer(1.0, np.zeros(3), np.eye(3), 2)

    def instant(self, mechanism, states, method):
        b, j = (np.zeros((len(states), len(items), 3)) for items in (mechanism.bodies, mechanism.joints))
        return InstantAnswer(b, b, j, j, np.zeros(len(states)), np.zeros(len(states)))

    def trajectory(self, mechanism, state, times, method, step):
        zeros = np.zeros((len(times), len(mechanism.bodies), 3))
        quat = np.tile([1.0, 0.0, 0.0, 0.0], (*zeros.shape[:2], 1))
        return TrajectoryAnswer(times, zeros, quat, zeros, zeros, {"steps": 4})


def _requests():
    case = _case()
    yield Request()
    yield Request(case.mechanism)
    yield Request(case.mechanism, states=case.states, survey=(Question.MODEL, Question.INSTANT))
    for question in Question:
        yield Request(case.mechanism, question, METHOD, case.states, case.times, 0.01)


def _server():
    server = Server()
    server.engine = Still()
    return server


def _obeyed(raw):
    """Replies of a worker to frames."""
    server, replies = _server(), b""
    for frame in read_frames(_Bytes(raw)):
        replies += server.handle(frame) or b""
    return replies


def _taken_apart(raw):
    """Frames as tables: number of the job, CPU time, header, and body in hexadecimal digits."""
    found = []
    while raw:
        *_, n, m, job, cpu = PREFIX.unpack(raw[: PREFIX.size])
        text, body, raw = (
            raw[PREFIX.size : PREFIX.size + n],
            raw[PREFIX.size + n : PREFIX.size + n + m],
            raw[PREFIX.size + n + m :],
        )
        found.append({"job": job, "cpu": cpu, "header": json.loads(text), "body": body.hex()})
    return found


def _put_together(tables):
    raw = b""
    for frame in tables if isinstance(tables, list) else []:
        job, cpu, header, body = (
            map(frame.get, ("job", "cpu", "header", "body")) if isinstance(frame, dict) else (0, 0.0, frame, "")
        )
        text = _json(header).encode("utf-8", "surrogatepass")
        try:
            data = bytes.fromhex(body)
        except (TypeError, ValueError):
            data = _json(body).encode("utf-8", "surrogatepass")
        try:
            prefix = PREFIX.pack(MAGIC, VERSION, len(text), len(data), job, cpu)
        except (struct.error, OverflowError):  # numbers outside the range of the format cannot be sent
            prefix = PREFIX.pack(MAGIC, VERSION, len(text), len(data), 0, float("nan"))
        raw += prefix + text + data
    return raw


def wire_seeds():
    """Frames to a worker, and its replies."""
    found = []
    for request in _requests():
        mechanism, first = RecentlySent().need(request.mechanism)
        method, second = RecentlySent().need(request.method)
        sent = first + second + job(request, mechanism, method, 7)
        found += [(WORKER, sent), (RUNNER, _obeyed(sent))]
    answered = AnswerSet(
        (MethodAnswer(Question.MODEL, METHOD, None, "singular"),), {Question.INSTANT: (Unsupported("b", "c"),)}
    )
    tree, arrays = codec.encode(answered)
    told = {"kind": "reply", "reason": "", "strays": False, "value": tree}
    found.append((RUNNER, wire.pack(told, arrays, 7, 0.1)))
    found.append((WORKER, loading("nothing", 7)))
    return [(to, raw, _taken_apart(raw)) for to, raw in found]


def wire_mutants(steps):
    """Strategy of inputs.

    Parameters
    ----------
    steps : callable
        Strategy of steps of mutation, from their kinds and greatest number.
    """
    seeds = wire_seeds()
    whole = st.sampled_from(range(len(seeds)))
    tables, text = steps(TABLE_KINDS), steps(TEXT_KINDS, 2)
    return st.one_of(
        st.tuples(whole, tables).map(lambda t: seeds[t[0]][0] + _put_together(changed_tables(seeds[t[0]][2], t[1]))),
        st.tuples(whole, text).map(lambda t: seeds[t[0]][0] + changed_bytes(seeds[t[0]][1], t[1])),
        st.tuples(whole, steps(TABLE_KINDS, 2), text).map(
            lambda t: seeds[t[0]][0] + changed_bytes(_put_together(changed_tables(seeds[t[0]][2], t[1])), t[2])
        ),
    )


class _Answers:
    """A worker that answers every job with one value; for a plan, a valid plan if the value is not a plan."""

    engine = "still"

    def __init__(self, value):
        self.value = value

    def ask(self, request):
        if request.question is None and not isinstance(self.value, Plan):
            return Reply(perform(Still(), request), True)
        return Reply(self.value, True)


def _received(raw, folder):
    """Process a reply as the runner does; return whether it held a value."""
    coming = Incoming()
    if not coming.add(raw):
        raise ConnectionResetError
    frame = coming.take()
    if not _sound(frame) or frame.job != 7:
        return False
    value, case = codec.value_of(frame.header, frame.arrays), _case()
    info = value if isinstance(value, EngineInfo) else Still().info()
    with (
        closing(Store(folder / "store", fresh=True))
        if isinstance(value, (EngineInfo, *ANSWERS.values()))
        else nullcontext() as store
    ):
        list(ask_case(_Answers(value), case, list(Question), QUICK, store, info))
    if not isinstance(value, AnswerSet):
        return True
    reference = perform(Still(), Request(case.mechanism, states=case.states, survey=tuple(Question)[:2]))
    judge(case, {"reference": batch_of(Reply(reference, True)), "still": batch_of(Reply(value, True))})
    return True


def swallow_wire(raw, folder):
    """Process frames as runner and workers do; return whether they were accepted."""
    to, frames_ = raw[:1], raw[1:]
    try:
        with watched(folder), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return bool(_obeyed(frames_) if to == WORKER else _received(frames_, folder))
    except (ProtocolError, ConnectionError) as error:
        check_terminal(visible(str(error)))
        return False


def warm_wire(folder):
    """Import all modules, and check that unmutated frames are accepted."""
    import_everything()
    for to, raw, tables in wire_seeds():
        with suppress(Breach):  # the first lookup of types imports modules
            swallow_wire(to + raw, folder)
        assert swallow_wire(to + raw, folder)
        assert _taken_apart(_put_together(tables)) == tables
