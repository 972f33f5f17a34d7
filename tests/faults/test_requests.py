"""Requests that no client of ours makes: every rpc with every field at its worst, and the corpus of the fuzz target
`request`. Fault F3.

Whatever a field says, an answer is a canonical code with a reason, never INTERNAL, and the server goes on.
"""

from __future__ import annotations

import io
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import grpc
import pytest
from fogbank._generated.v1 import cache_pb2, farm_pb2, flatland_pb2, probe_pb2, render_pb2, scene_pb2, server_pb2
from google.protobuf import proto
from google.protobuf.descriptor import FieldDescriptor, MethodDescriptor
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass

from tests.faults.conftest import FULL, Record
from tests.fuzz.run import CORPUS
from tests.service.harness import Server, error_info, fog_scene, new_request_id

REQUESTS = 300 if FULL else 12  # of each rpc
# An answer that takes longer is given up, as a client would; the next one finds out whether the server lives.
PATIENCE_SECONDS = 5.0
MOST_ANSWERS = 3  # of a stream

METHODS = [
    method
    for module in (cache_pb2, farm_pb2, flatland_pb2, probe_pb2, render_pb2, scene_pb2, server_pb2)
    for service in module.DESCRIPTOR.services_by_name.values()
    for method in service.methods
]
INTEGERS = [0, 1, -1, 2, 7, 255, 4096, 2**31 - 1, -(2**31)]
LONG_INTEGERS = [*INTEGERS, 2**63 - 1, -(2**63)]
NUMBERS = [0.0, -0.0, 1.0, -1.0, 0.5, 1e-320, 1e-30, 1e30, 1e308, float("inf"), float("-inf"), float("nan")]
TEXTS = [
    "",
    "x",
    "a" * 5000,
    "../../etc/passwd",
    "volpath",
    "radiance-cache",
    "\u202e\n\x1b[2J",
    "0" * 64,
    "%s%n",
    "{}",
]


class Mutator:
    """Messages of a type with random fields, some of which are what a good request says."""

    def __init__(self, dice: random.Random, names: list[str]) -> None:
        """`names` are of things that exist."""
        self._dice = dice
        self._texts = [*TEXTS, *names, *names]

    def message(self, message: Message, depth: int = 0) -> None:
        """Sets fields of a message."""
        for field in message.DESCRIPTOR.fields:
            if self._dice.random() < (0.35 if depth else 0.6):
                self._set(message, cast(FieldDescriptor, field), depth)

    def _set(self, message: Message, field: FieldDescriptor, depth: int) -> None:
        if field.message_type is not None and field.message_type.GetOptions().map_entry:
            entries: Any = getattr(message, field.name)
            entries[self._dice.choice(self._texts)] = self._dice.choice(self._texts)
        elif field.message_type is not None:
            if depth > 4:
                return
            if field.is_repeated:
                for _ in range(self._dice.choice((1, 2, 5))):
                    self.message(getattr(message, field.name).add(), depth + 1)
            else:
                getattr(message, field.name).SetInParent()
                self.message(getattr(message, field.name), depth + 1)
        elif field.is_repeated:
            count = self._dice.choice((0, 1, 2, 3, 4, 16, 1000))
            getattr(message, field.name).extend(self._value(field) for _ in range(count))
        else:
            setattr(message, field.name, self._value(field))

    def _value(self, field: FieldDescriptor) -> object:
        kind = field.type
        if kind == FieldDescriptor.TYPE_STRING:
            return self._dice.choice(self._texts)
        if kind == FieldDescriptor.TYPE_BYTES:
            return self._dice.randbytes(self._dice.choice((0, 1, 100, 70000)))
        if kind == FieldDescriptor.TYPE_BOOL:
            return self._dice.random() < 0.5
        if kind == FieldDescriptor.TYPE_ENUM:
            assert field.enum_type is not None
            return self._dice.choice((*field.enum_type.values_by_number, 99))
        if kind in (FieldDescriptor.TYPE_DOUBLE, FieldDescriptor.TYPE_FLOAT):
            return self._dice.choice(NUMBERS)
        if kind in (FieldDescriptor.TYPE_UINT32, FieldDescriptor.TYPE_UINT64):
            return abs(self._dice.choice(INTEGERS))
        return self._dice.choice(INTEGERS if kind == FieldDescriptor.TYPE_INT32 else LONG_INTEGERS)


def call(channel: grpc.Channel, method: MethodDescriptor, requests: list[Message]) -> None:
    """One call, read for a few answers."""
    path = f"/{method.containing_service.full_name}/{method.name}"
    kind = ("stream" if method.client_streaming else "unary") + ("_stream" if method.server_streaming else "_unary")
    stub = getattr(channel, kind)(
        path,
        request_serializer=type(requests[0]).SerializeToString,
        response_deserializer=GetMessageClass(method.output_type).FromString,
    )
    answer = stub(iter(requests) if method.client_streaming else requests[0], timeout=PATIENCE_SECONDS)
    if method.server_streaming:
        for _, _ in zip(range(MOST_ANSWERS), answer, strict=False):
            pass
        answer.cancel()


def wrong_answer(server: Server, method: MethodDescriptor, requests: list[Message]) -> list[str]:
    """What is wrong with the answer, if anything."""
    try:
        call(server.channel, method, requests)
    except grpc.RpcError as error:
        assert isinstance(error, grpc.Call)
        code = error.code()
        if code in (grpc.StatusCode.INTERNAL, grpc.StatusCode.UNKNOWN, grpc.StatusCode.UNAVAILABLE):
            return [f"{method.full_name}: {error} for {requests}"[:2000]]
        if code not in (grpc.StatusCode.DEADLINE_EXCEEDED, grpc.StatusCode.CANCELLED):
            assert error_info(error).reason
    assert server.process.poll() is None, f"{method.full_name} for {requests}"[:4000]
    return []


@pytest.fixture
def own(tmp_path: Path) -> Iterator[Server]:
    """A server with little memory, so that nothing that is asked of it takes much."""
    server = Server(tmp_path / "data", "--threads", "1", "--memory", "0.5")
    yield server
    assert server.stop() == 0


@pytest.mark.timeout(3600)
def test_mutated_requests(own: Server, record: Record) -> None:
    created = own.create_scene(fog_scene())
    job = own.create_job(created.name, render_pb2.RenderSettings(width=8, height=8))
    own.finish(job.name)
    names = [created.name, job.name, created.cache, own.upload(b"x" * 100), created.name.split("/")[1]]
    dice = random.Random(20261122)
    calls = 0
    wrong: list[str] = []
    for method in METHODS:
        for _ in range(REQUESTS):
            mutator = Mutator(dice, [*names, new_request_id()])
            requests = []
            for _ in range(dice.choice((1, 2, 4)) if method.client_streaming else 1):
                request = GetMessageClass(method.input_type)()
                mutator.message(request)
                requests.append(request)
            calls += 1
            wrong += wrong_answer(own, method, requests)
        for running in own.render.ListJobs(render_pb2.ListJobsRequest(page_size=200)).jobs:
            own.render.CancelJob(render_pb2.CancelJobRequest(name=running.name))
        if created.name not in {s.name for s in own.scenes.ListScenes(scene_pb2.ListScenesRequest()).scenes}:
            own.create_scene(fog_scene())
    record("requests with fields at their worst", -calls, -REQUESTS * len(METHODS))
    record("rpcs", -len(METHODS), -25)
    record("answers INTERNAL or UNKNOWN", len(wrong), 0)
    assert not wrong, wrong[:5]


@pytest.mark.timeout(600)
def test_corpus_of_requests(own: Server, record: Record) -> None:
    created = own.create_scene(fog_scene(width=8, height=8))
    small = render_pb2.RenderSettings(width=8, height=8, samples_per_pixel=1)
    ended = own.create_job(created.name, small).name
    own.finish(ended)
    methods = {f"{method.containing_service.full_name}/{method.name}": method for method in METHODS}
    build = own.server.GetCapabilities(server_pb2.GetCapabilitiesRequest()).build_id
    wrong: list[str] = []
    seen: set[MethodDescriptor] = set()
    inputs = sorted((CORPUS / "request").iterdir())
    for path in inputs:
        leased = own.create_job(created.name, small, leased=True).name
        # Of the same lengths: tests/fuzz/request_call.h.
        data = path.read_bytes()
        for digit, name in (
            ("2" * 64, created.name),
            ("3" * 64, created.cache),
            ("4" * 64, own.upload(b"x" * 100)),
            ("5" * 24, ended),
            ("1" * 24, leased),
            ("7" * 16, build),
            ("8" * 16, new_request_id()[:16]),
        ):
            data = data.replace(digit.encode(), name.rpartition("/")[2].encode())
        line, _, rest = data.partition(b"\n")
        method = methods[line.decode()]
        seen.add(method)
        stream = io.BytesIO(rest)
        requests: list[Message] = []
        while (request := proto.parse_length_prefixed(GetMessageClass(method.input_type), stream)) is not None:
            requests.append(request)
        wrong += wrong_answer(own, method, requests)
        for running in own.render.ListJobs(render_pb2.ListJobsRequest(page_size=200)).jobs:
            if running.name != ended:
                own.render.CancelJob(render_pb2.CancelJobRequest(name=running.name))
        if created.name not in {s.name for s in own.scenes.ListScenes(scene_pb2.ListScenesRequest()).scenes}:
            own.create_scene(fog_scene(width=8, height=8))
    record("inputs of the corpus of requests", -len(inputs), -len(METHODS))
    record("answers INTERNAL or UNKNOWN to them", len(wrong), 0)
    assert not wrong, wrong[:5]
    assert not {method.full_name for method in METHODS} - {method.full_name for method in seen}
