"""Scenes: preparing, creating, listing, and everything that can be wrong with them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import grpc
import pytest
from fogbank._generated.v1 import scene_pb2 as scene

from tests.service.harness import Server, error_info, fog_scene, new_request_id, sha256

TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
WITH_MESH = fog_scene(extra='<shape type="obj"><string name="filename" value="meshes/a.obj"/></shape>')


def prepare(server: Server, manifest: scene.SceneManifest) -> scene.PrepareSceneResponse:
    """PrepareScene."""
    return server.scenes.PrepareScene(scene.PrepareSceneRequest(manifest=manifest))


def create(server: Server, manifest: scene.SceneManifest, request_id: str = "") -> scene.CreateSceneResponse:
    """CreateScene."""
    request = scene.CreateSceneRequest(request_id=request_id or new_request_id(), manifest=manifest)
    return server.scenes.CreateScene(request)


def test_the_upload_loop(server: Server) -> None:
    main = WITH_MESH.replace(b"</scene>", b"<!-- " + new_request_id().encode() + b" --></scene>")
    mesh = TRIANGLE + b"# " + new_request_id().encode() + b"\n"
    manifest = server.manifest({"scene.xml": main})
    answer = prepare(server, manifest)
    assert (list(answer.missing_blobs), list(answer.unlisted_paths)) == ([sha256(main)], [])
    server.upload(main)
    answer = prepare(server, manifest)
    assert (list(answer.missing_blobs), list(answer.unlisted_paths)) == ([], ["meshes/a.obj"])
    manifest = server.manifest({"scene.xml": main, "meshes/a.obj": mesh})
    assert list(prepare(server, manifest).missing_blobs) == [sha256(mesh)]
    with pytest.raises(grpc.RpcError) as caught:
        create(server, manifest)
    assert caught.value.code() == grpc.StatusCode.FAILED_PRECONDITION
    assert error_info(caught.value).reason == "BLOBS_MISSING"
    server.upload(mesh)
    answer = prepare(server, manifest)
    assert (list(answer.missing_blobs), list(answer.unlisted_paths)) == ([], [])
    created = create(server, manifest)
    assert not created.already_loaded
    description = created.scene
    assert description.statistics.media == 1
    assert description.statistics.lights == 1
    assert description.statistics.triangles == 12 + 2 + 12 + 1
    assert (description.defaults.width, description.defaults.height) == (64, 48)
    assert description.defaults.integrator == "volpath"
    assert description.defaults.samples_per_pixel == 4
    assert description.load_times.total_seconds > 0
    assert description.resident
    again = create(server, manifest)
    assert again.already_loaded
    assert again.scene.name == description.name
    assert server.scenes.GetScene(scene.GetSceneRequest(name=description.name)).scene.name == description.name


def test_the_name_depends_on_contents_only(server: Server) -> None:
    first = server.create_scene(fog_scene(extra="<!-- one -->"))
    second = server.create_scene(fog_scene(extra="<!-- two -->"))
    other_view = server.create_scene(fog_scene(width=65))
    other_light = server.create_scene(fog_scene().replace(b"8, 7, 6", b"8, 7, 5"))
    assert first.name == second.name
    assert other_view.name != first.name
    assert other_view.radiance_fingerprint == first.radiance_fingerprint
    assert other_light.radiance_fingerprint != first.radiance_fingerprint


def test_parameters(server: Server) -> None:
    main = fog_scene().replace(b'"width" value="64"', b'"width" value="$w"')
    main = main.replace(b'<scene version="3.0.0">', b'<scene version="3.0.0"><default name="w" value="64"/>')
    server.upload(main)
    manifest = server.manifest({"scene.xml": main})
    assert create(server, manifest).scene.defaults.width == 64
    manifest.options.parameters["w"] = "32"
    assert create(server, manifest).scene.defaults.width == 32


def test_request_ids(server: Server) -> None:
    main = fog_scene()
    other = fog_scene(samples=9)
    for data in (main, other):
        server.upload(data)
    request_id = new_request_id()
    name = create(server, server.manifest({"scene.xml": main}), request_id).scene.name
    assert create(server, server.manifest({"scene.xml": main}), request_id).scene.name == name
    with pytest.raises(grpc.RpcError) as caught:
        create(server, server.manifest({"scene.xml": other}), request_id)
    assert caught.value.code() == grpc.StatusCode.ALREADY_EXISTS
    assert error_info(caught.value).reason == "REQUEST_ID_REUSED"
    for bad in ("", "a" * 65, "with space", "semi;colon"):
        with pytest.raises(grpc.RpcError) as caught:
            server.scenes.CreateScene(
                scene.CreateSceneRequest(request_id=bad, manifest=server.manifest({"scene.xml": main}))
            )
        assert error_info(caught.value).reason == "INVALID_REQUEST_ID"


BAD_PATHS = [
    "",
    "/etc/passwd",
    "../scene.xml",
    "a/../../b",
    "a//b",
    "a/",
    "./a",
    "a/./b",
    "..",
    "a\\..\\b",
    "a\nb",
    "a\0b",
    "x" * 1025,
]


@pytest.mark.parametrize("path", BAD_PATHS)
def test_bad_paths_in_a_manifest(server: Server, path: str) -> None:
    data = fog_scene()
    manifest = server.manifest({"scene.xml": data, path: data})
    for call in (prepare, create):
        with pytest.raises(grpc.RpcError) as caught:
            call(server, manifest)
        assert caught.value.code() == grpc.StatusCode.INVALID_ARGUMENT
        assert error_info(caught.value).reason == "INVALID_MANIFEST"
        assert error_info(caught.value).metadata["field"] == "entries[1]"


def test_bad_manifests(server: Server) -> None:
    entry = scene.ManifestEntry(path="scene.xml", sha256="0" * 64, size=1)
    cases = {
        "main not listed": scene.SceneManifest(main_path="other.xml", entries=[entry]),
        "nothing": scene.SceneManifest(),
        "twice": scene.SceneManifest(main_path="scene.xml", entries=[entry, entry]),
        "hash": scene.SceneManifest(
            main_path="scene.xml", entries=[scene.ManifestEntry(path="scene.xml", sha256="0", size=1)]
        ),
        "size": scene.SceneManifest(
            main_path="scene.xml", entries=[scene.ManifestEntry(path="scene.xml", sha256="0" * 64, size=-1)]
        ),
    }
    for case, manifest in cases.items():
        with pytest.raises(grpc.RpcError) as caught:
            prepare(server, manifest)
        assert error_info(caught.value).reason == "INVALID_MANIFEST", case
    with pytest.raises(grpc.RpcError) as caught:
        server.scenes.CreateScene(scene.CreateSceneRequest(request_id=new_request_id()))
    assert error_info(caught.value).reason == "INVALID_MANIFEST"
    many = [scene.ManifestEntry(path=str(i), sha256="0" * 64, size=1) for i in range(16385)]
    with pytest.raises(grpc.RpcError) as caught:
        prepare(server, scene.SceneManifest(main_path="0", entries=many))
    assert caught.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    assert error_info(caught.value).reason == "TOO_MANY_FILES"
    with pytest.raises(grpc.RpcError) as caught:
        prepare(server, scene.SceneManifest(main_path="0", entries=many * 4))
    assert caught.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED


# Line 1 is <scene>; the bad element stands where its message says.
BAD_SCENES = {
    "malformed XML": (b"<scene version='3.0.0'>\n<shape\n</scene>", "scene.xml:"),
    "no scene": (b"", "scene.xml"),
    "unknown BSDF": (
        b"<scene version='3.0.0'>\n<shape type='cube'>\n<bsdf type='velvet'/>\n</shape></scene>",
        "scene.xml:3",
    ),
    "negative coefficient": (
        fog_scene().replace(b"0.2, 0.25, 0.3", b"-0.2, 0.25, 0.3"),
        "scene.xml:",
    ),
    "NaN": (fog_scene().replace(b"0.2, 0.25, 0.3", b"nan, 0.25, 0.3"), "scene.xml:"),
    "singular transform": (fog_scene().replace(b'<scale value="0.5"/>', b'<scale value="0"/>'), "scene.xml:"),
    "zero-area light": (
        fog_scene().replace(b'<rotate x="1" angle="90"/>', b'<scale x="0"/><rotate x="1" angle="90"/>'),
        "scene.xml:",
    ),
    "missing mesh": (WITH_MESH, "scene.xml:"),
    "path out of the root": (WITH_MESH.replace(b"meshes/a.obj", b"../a.obj"), "scene.xml:"),
    "absolute path": (WITH_MESH.replace(b"meshes/a.obj", b"/etc/passwd"), "scene.xml:"),
    "external entity": (
        b"<!DOCTYPE scene [<!ENTITY x SYSTEM 'file:///etc/passwd'>]><scene version='3.0.0'>&x;</scene>",
        "scene.xml",
    ),
    "deep nesting": (b"<scene version='3.0.0'>" + b"<bsdf type='twosided'>" * 5000 + b"</scene>", "scene.xml"),
}


@pytest.mark.parametrize("case", BAD_SCENES)
def test_bad_scenes(server: Server, case: str) -> None:
    main, place = BAD_SCENES[case]
    server.upload(main)
    with pytest.raises(grpc.RpcError) as caught:
        create(server, server.manifest({"scene.xml": main}))
    assert caught.value.code() in (
        grpc.StatusCode.INVALID_ARGUMENT,
        grpc.StatusCode.NOT_FOUND,
        grpc.StatusCode.UNIMPLEMENTED,
        grpc.StatusCode.RESOURCE_EXHAUSTED,
    )
    assert str(caught.value.details()).startswith(place), caught.value.details()
    assert error_info(caught.value).reason != "INTERNAL_ERROR"
    # The request id of a failure is free again, and the server goes on serving.
    server.create_scene(fog_scene())


def test_server_files(tmp_path: Path) -> None:
    root = tmp_path / "root"
    root.mkdir()
    (root / "fog.xml").write_bytes(fog_scene())
    (tmp_path / "secret.xml").write_bytes(fog_scene())
    (root / "link.xml").symlink_to(tmp_path / "secret.xml")
    (root / "inside.xml").symlink_to(root / "fog.xml")
    server = Server(tmp_path / "data", "--scene-root", str(root))

    def load(path: str) -> scene.Scene:
        request = scene.CreateSceneRequest(request_id=new_request_id(), server_file=scene.ServerFile(path=path))
        return server.scenes.CreateScene(request).scene

    name = load("fog.xml").name
    assert load("inside.xml").name == name
    for path in ("../secret.xml", "/etc/passwd", str(tmp_path / "secret.xml"), "link.xml", ".", "a/../fog.xml"):
        with pytest.raises(grpc.RpcError) as caught:
            load(path)
        assert caught.value.code() == grpc.StatusCode.INVALID_ARGUMENT, path
        assert error_info(caught.value).reason in ("SCENE_PATH_REFUSED", "PATH_OUTSIDE_ROOT"), path
    with pytest.raises(grpc.RpcError) as caught:
        load("absent.xml")
    assert caught.value.code() == grpc.StatusCode.NOT_FOUND
    # A file that changes makes a new scene; the old name does not quietly mean something else.
    (root / "fog.xml").write_bytes(fog_scene(width=33))
    assert load("fog.xml").name != name
    assert server.stop() == 0


def test_no_scene_root(server: Server) -> None:
    with pytest.raises(grpc.RpcError) as caught:
        server.scenes.CreateScene(
            scene.CreateSceneRequest(request_id=new_request_id(), server_file=scene.ServerFile(path="fog.xml"))
        )
    assert caught.value.code() == grpc.StatusCode.FAILED_PRECONDITION
    assert error_info(caught.value).reason == "NO_SCENE_ROOT"


def test_names(server: Server) -> None:
    for name in ("", "scenes/", "scenes/xyz", "jobs/" + "0" * 64, "scenes/" + "0" * 63, "scenes/../" + "0" * 61):
        calls: tuple[Callable[[], object], ...] = (
            partial(server.scenes.GetScene, scene.GetSceneRequest(name=name)),
            partial(server.scenes.DeleteScene, scene.DeleteSceneRequest(name=name)),
        )
        for call in calls:
            with pytest.raises(grpc.RpcError) as caught:
                call()
            assert caught.value.code() == grpc.StatusCode.INVALID_ARGUMENT
            assert error_info(caught.value).reason == "INVALID_NAME"
    with pytest.raises(grpc.RpcError) as caught:
        server.scenes.GetScene(scene.GetSceneRequest(name="scenes/" + "0" * 64))
    assert caught.value.code() == grpc.StatusCode.NOT_FOUND
    assert error_info(caught.value).reason == "SCENE_NOT_FOUND"


def test_listing_deleting_and_restarting(own_server: Server) -> None:
    names = [own_server.create_scene(fog_scene(width=32 + i)).name for i in range(5)]
    listed: list[str] = []
    token = ""
    while True:
        page = own_server.scenes.ListScenes(scene.ListScenesRequest(page_size=2, page_token=token))
        assert len(page.scenes) <= 2
        listed += [entry.name for entry in page.scenes]
        token = page.next_page_token
        if not token:
            break
    assert listed == names[::-1]
    own_server.scenes.DeleteScene(scene.DeleteSceneRequest(name=names[0]))
    with pytest.raises(grpc.RpcError) as caught:
        own_server.scenes.DeleteScene(scene.DeleteSceneRequest(name=names[0]))
    assert error_info(caught.value).reason == "SCENE_NOT_FOUND"
    assert own_server.stop() == 0

    again = Server(own_server.data)
    page = again.scenes.ListScenes(scene.ListScenesRequest())
    assert [entry.name for entry in page.scenes] == names[:0:-1]
    assert not any(entry.resident for entry in page.scenes)
    job = again.create_job(names[1])
    assert again.finish(job.name).result.load_seconds > 0
    assert again.scenes.GetScene(scene.GetSceneRequest(name=names[1])).scene.resident
    for request, reason in (
        (scene.ListScenesRequest(page_size=-1), "INVALID_PAGE_SIZE"),
        (scene.ListScenesRequest(page_token="nonsense"), "INVALID_PAGE_TOKEN"),
    ):
        with pytest.raises(grpc.RpcError) as caught:
            again.scenes.ListScenes(request)
        assert error_info(caught.value).reason == reason
    assert again.stop() == 0
