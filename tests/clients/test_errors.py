"""Errors: one exception class per canonical code, with the server's reason and message."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent import futures
from pathlib import Path

import fogbank
import grpc
import pytest
from fogbank.errors import ERROR_CLASSES
from grpc_status import rpc_status

from tests.clients.conftest import PATIENT
from tests.clients.fake_job import status
from tests.clients.fake_server import FakeServer

CODES = [code for code in grpc.StatusCode if code is not grpc.StatusCode.OK]


class Failing(grpc.GenericRpcHandler):
    """Answers every call with a status of the test's choice."""

    code = grpc.StatusCode.UNKNOWN
    with_details = True

    def service(self, details: grpc.HandlerCallDetails) -> grpc.RpcMethodHandler[bytes, bytes]:
        """The same for all methods."""
        return grpc.unary_unary_rpc_method_handler(self._fail)

    def _fail(self, request: bytes, context: grpc.ServicerContext) -> bytes:
        if self.with_details:
            number = self.code.value[0]
            context.abort_with_status(rpc_status.to_status(status(number, "SOME_REASON", "told so", field="spp")))
        context.abort(self.code, "told so")


@pytest.fixture
def failing() -> Iterator[tuple[Failing, str]]:
    """A server that fails, and its address."""
    handler = Failing()
    server = grpc.server(futures.ThreadPoolExecutor(2))
    server.add_generic_rpc_handlers([handler])
    port = server.add_insecure_port("127.0.0.1:0")
    server.start()
    yield handler, f"127.0.0.1:{port}"
    server.stop(0)


def test_every_code_has_a_class() -> None:
    assert set(ERROR_CLASSES) == set(CODES)


@pytest.mark.parametrize("code", CODES, ids=lambda code: code.name)
def test_a_status_becomes_its_exception(failing: tuple[Failing, str], code: grpc.StatusCode) -> None:
    handler, address = failing
    handler.code = code
    with pytest.raises(fogbank.FogbankError, match="told so") as caught:
        fogbank.connect(address, retry_policy=PATIENT)
    error = caught.value
    assert type(error) is ERROR_CLASSES[code]
    assert error.code is code
    assert error.reason == "SOME_REASON"
    assert error.metadata == {"field": "spp"}
    assert error.message == str(error) == "told so"


def test_a_status_without_details_has_no_reason(failing: tuple[Failing, str]) -> None:
    handler, address = failing
    handler.code = grpc.StatusCode.NOT_FOUND
    handler.with_details = False
    with pytest.raises(fogbank.NotFoundError) as caught:
        fogbank.connect(address, retry_policy=PATIENT)
    assert caught.value.reason == ""


def test_an_absent_server_is_named() -> None:
    with pytest.raises(fogbank.UnavailableError, match=r"cannot reach the server at 127\.0\.0\.1:1"):
        fogbank.connect("127.0.0.1:1", retry_policy=PATIENT)


def test_options_of_the_embedded_server_do_not_go_with_an_address() -> None:
    with pytest.raises(TypeError, match="embedded"):
        fogbank.connect("127.0.0.1:1", threads=2)


@pytest.mark.parametrize(("element", "reason"), [("<broken/>", "SCENE_INVALID"), ("<grid/>", "NOT_SUPPORTED")])
def test_scene_errors_are_one_class(service: fogbank.Service, tmp_path: Path, element: str, reason: str) -> None:
    path = tmp_path / "bad.xml"
    path.write_text(f"<scene>\n{element}\n</scene>")
    with pytest.raises(fogbank.InvalidSceneError, match=r"^bad\.xml:2: <") as caught:
        service.load(path)
    assert caught.value.reason == reason


def test_refused_settings_name_the_field(scene: fogbank.Scene) -> None:
    with pytest.raises(fogbank.InvalidArgumentError, match="integrator") as caught:
        scene.render(integrator="magic")
    assert caught.value.reason == "INVALID_SETTINGS"
    assert caught.value.metadata == {"field": "settings.integrator"}
    assert not isinstance(caught.value, fogbank.InvalidSceneError)


def test_a_closed_service_says_so(service: fogbank.Service) -> None:
    service.close()
    service.close()
    with pytest.raises(fogbank.UnavailableError, match="is closed"):
        service.status()


def test_transient_unavailability_goes_unnoticed(service: fogbank.Service, fake: FakeServer, scene_path: Path) -> None:
    fake.faults.unavailable_calls = 4
    assert service.load(scene_path).main_path == "fog.xml"
