"""Damaged files: scenes through the sandboxed loader, segments of caches on the disk. Faults F1, F2, F4."""

from __future__ import annotations

import contextlib
import random
import struct
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import grpc
import pytest
from fogbank._generated.v1 import cache_pb2 as cache
from fogbank._generated.v1 import render_pb2 as render
from fogbank._generated.v1 import scene_pb2 as scene

from tests.faults.conftest import FULL, Record
from tests.service.harness import Server, error_info, fog_scene, new_request_id

# Over the wire, into the sandbox and onto the disk; 20,000 of each go straight into the readers (test_inputs.py).
MUTATIONS = 1000 if FULL else 150
# Slower than this, and a client would rather hear of a limit.
LONGEST_SECONDS = 10.0

FRAGMENTS = [
    b"<", b">", b'"', b"&", b"&#0;", b"<!--", b"<![CDATA[", b"]]>", b"$", b"nan", b"inf", b"-1", b"0", b"1e308",
    b"1e-320", b"../", b"/etc/passwd", b"\0", b"\xff", b"</scene>", b'<ref id="fog"/>',
    b'<include filename="scene.xml"/>', b'<shape type="cube">', b"</shape>", b"99999999999999999999",
]  # fmt: skip


def mutated(data: bytes, dice: random.Random) -> bytes:
    """Bytes overwritten in a window of a tenth, or bits in the first 200; cut off; or something put in between."""
    damaged = bytearray(data)
    kind = dice.randrange(4)
    if kind == 0:
        start = dice.randrange(len(data))
        window = range(start, min(len(data), start + 1 + len(data) // 10))
        for at in dice.choices(window, k=dice.randrange(1, 9)):
            damaged[at] = dice.randrange(256)
    elif kind == 1:
        for at in dice.choices(range(min(200, len(data))), k=dice.randrange(1, 5)):
            damaged[at] ^= 1 << dice.randrange(8)
    elif kind == 2:
        del damaged[dice.randrange(len(data)) :]
    else:
        for _ in range(dice.randrange(1, 4)):
            at = dice.randrange(len(damaged) + 1)
            damaged[at : at + dice.choice((0, 0, 1, 4, 30))] = dice.choice(FRAGMENTS)
    return bytes(damaged)


def png(width: int, height: int) -> bytes:
    """A grey picture."""
    import zlib

    def chunk(name: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    rows = b"".join(b"\0" + bytes(range(row, row + width)) for row in range(height))
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


PLY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    + struct.pack("<9fB3i", 0, 0, 0, 1, 0, 0, 0, 1, 0, 3, 0, 1, 2)
)  # fmt: skip
OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\n"
FILES = {
    "mesh.ply": PLY,
    "mesh.obj": OBJ,
    "picture.png": png(16, 16),
    "scene.xml": fog_scene(
        extra='<shape type="ply"><string name="filename" value="mesh.ply"/><bsdf type="diffuse">'
        '<texture type="bitmap" name="reflectance"><string name="filename" value="picture.png"/></texture>'
        "</bsdf></shape>"
        '<shape type="obj"><string name="filename" value="mesh.obj"/></shape>'
    ),
}


@pytest.fixture
def rooted(tmp_path: Path) -> Iterator[tuple[Server, Path]]:
    """A server that loads scenes from a folder, and the folder."""
    root = tmp_path / "scenes"
    root.mkdir()
    server = Server(tmp_path / "data", "--scene-root", str(root), "--threads", "1")
    yield server, root
    assert server.stop() == 0


@pytest.mark.timeout(1800)
def test_mutated_scenes(rooted: tuple[Server, Path], record: Record) -> None:
    server, root = rooted
    for name, data in FILES.items():
        (root / name).write_bytes(data)
    request = scene.CreateSceneRequest(server_file=scene.ServerFile(path="scene.xml"))
    dice = random.Random(20261122)
    outcomes: Counter[str] = Counter()
    slowest = 0.0
    for number in range(MUTATIONS):
        # Half of them the scene file, half of them what it refers to.
        name = "scene.xml" if number % 2 else dice.choice(sorted(FILES)[:3])
        (root / name).write_bytes(mutated(FILES[name], dice))
        request.request_id = new_request_id()
        start = time.monotonic()
        try:
            created = server.scenes.CreateScene(request).scene
            server.scenes.DeleteScene(scene.DeleteSceneRequest(name=created.name))
            outcomes["loaded"] += 1
        except grpc.RpcError as error:
            info = error_info(error)
            assert error.code() not in (grpc.StatusCode.INTERNAL, grpc.StatusCode.UNKNOWN), error
            outcomes[info.reason] += 1
        slowest = max(slowest, time.monotonic() - start)
        (root / name).write_bytes(FILES[name])
    request.request_id = new_request_id()
    server.scenes.CreateScene(request)
    assert server.process.poll() is None
    record("mutated scenes, meshes and pictures", -MUTATIONS, -MUTATIONS)
    record("deaths of the server", 0, 0)
    record("crashes of a reading process", outcomes["SCENE_READER_CRASHED"], 0)
    record("slowest answer, seconds", slowest, LONGEST_SECONDS)
    assert 0 < outcomes["loaded"] < MUTATIONS


@pytest.mark.timeout(1800)
def test_mutated_segments(tmp_path: Path, record: Record) -> None:
    server = Server(tmp_path / "data", "--threads", "1")
    name = server.create_scene(fog_scene()).cache
    settings = render.RenderSettings(integrator="radiance-cache", width=8, height=8, samples_per_pixel=1)
    created = server.scenes.ListScenes(scene.ListScenesRequest()).scenes[0]
    server.fill(created.name, settings)
    whole = server.caches.VerifyCache(cache.VerifyCacheRequest(name=name))
    # One of those that the fill's rounds have left.
    segments = [path for path in (server.data / "caches").rglob("segments/*") if path.is_file()]
    segment = max(segments, key=lambda path: (path.stat().st_size, path.name))
    manifest = segment.parent.parent / "manifest"
    originals = {path: path.read_bytes() for path in (segment, manifest)}
    dice = random.Random(20261122)
    silent = 0
    for _ in range(MUTATIONS):
        data = mutated(originals[segment], dice)
        segment.write_bytes(data)
        manifest.write_bytes(originals[manifest])
        report = server.caches.VerifyCache(cache.VerifyCacheRequest(name=name))
        silent += (data != originals[segment]) != (report.damaged_segments == 1)
        for aside in (segment.parent.parent / "quarantine").glob("*"):
            with contextlib.suppress(FileNotFoundError):
                aside.unlink()
    for path, data in originals.items():
        path.write_bytes(data)
    assert server.caches.VerifyCache(cache.VerifyCacheRequest(name=name)) == whole
    assert server.stop() == 0
    record("mutated segments", -MUTATIONS, -MUTATIONS)
    record("deaths of the server", 0, 0)
    record("damages that went unnoticed", silent, 0)
    assert silent == 0
