"""Pushing scenes: what is sent, what is sent again, and what never is."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import fogbank
import pytest
from fogbank import InvalidSceneError, UnavailableError, UploadProgress
from fogbank.hash_cache import SETTLING_NANOSECONDS, HashCache

from tests.clients.fake_server import CHUNK_LIMIT, LOAD_SECONDS, FakeServer


def test_a_scene_is_pushed_with_the_files_that_the_server_finds(
    service: fogbank.Service, fake: FakeServer, scene_path: Path
) -> None:
    scene = service.load(scene_path)
    contents = {scene_path.read_bytes(), (scene_path.parent / "mesh.ply").read_bytes()}
    assert set(fake.blobs.values()) == contents
    assert scene.main_path == "fog.xml"
    assert scene.load_seconds == LOAD_SECONDS
    assert scene.statistics.triangles == 12


def test_a_second_push_sends_nothing(service: fogbank.Service, fake: FakeServer, scene_path: Path) -> None:
    first = service.load(scene_path)
    sent = fake.chunks_received
    again = service.load(scene_path)
    assert fake.chunks_received == sent
    assert again.name == first.name
    assert again.load_seconds == 0.0


def test_progress_is_reported_per_chunk(service: fogbank.Service, scene_path: Path) -> None:
    reports: list[UploadProgress] = []
    service.load(scene_path, on_progress=reports.append)
    mesh = [report for report in reports if report.path == "mesh.ply"]
    assert [report.file_bytes_sent for report in mesh] == list(range(CHUNK_LIMIT, 1025, CHUNK_LIMIT))
    assert {report.file_bytes for report in mesh} == {1024}


def test_an_upload_survives_many_disconnects_and_repeats_little(
    service: fogbank.Service, fake: FakeServer, scene_path: Path
) -> None:
    mesh = scene_path.parent / "mesh.ply"
    mesh.write_bytes(os.urandom(CHUNK_LIMIT * 60))
    # The XML takes two chunks; then 50 streams in a row break after one chunk each.
    fake.faults.cut_uploads_after = [99] + [1] * 50
    service.load(scene_path)
    assert mesh.read_bytes() in fake.blobs.values()
    xml_chunks = -(-scene_path.stat().st_size // CHUNK_LIMIT)
    # At most one chunk again per disconnect; in fact none, as the server keeps what it has.
    assert fake.chunks_received == xml_chunks + 60
    assert fake.upload_offsets[1:] == [CHUNK_LIMIT * sent for sent in range(51)]


def test_a_server_that_never_gets_further_is_given_up(
    service: fogbank.Service, fake: FakeServer, scene_path: Path
) -> None:
    fake.faults.cut_uploads_after = [0] * 100
    with pytest.raises(UnavailableError, match="connection lost"):
        service.load(scene_path)
    assert len(fake.upload_offsets) == 5  # the attempts of the tests' retry policy


def test_an_upload_that_someone_else_began_is_continued(
    service: fogbank.Service, fake: FakeServer, scene_path: Path
) -> None:
    mesh = (scene_path.parent / "mesh.ply").read_bytes()
    fake.partial[hashlib.sha256(mesh).hexdigest()] = bytearray(mesh[: 5 * CHUNK_LIMIT])
    service.load(scene_path)
    assert 5 * CHUNK_LIMIT in fake.upload_offsets


def test_an_upload_under_way_elsewhere_is_waited_for(
    service: fogbank.Service, fake: FakeServer, scene_path: Path
) -> None:
    fake.faults.uploads_in_progress = 3
    assert service.load(scene_path).main_path == "fog.xml"


def test_a_file_that_changes_after_it_was_hashed_is_hashed_again(
    service: fogbank.Service, fake: FakeServer, scene_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = scene_path.parent / "mesh.ply"
    hash_really = HashCache.sha256
    stale = [True]

    def hash_with_one_stale_answer(cache: HashCache, path: Path) -> tuple[str, int]:
        if path == mesh and stale:
            stale.clear()
            return "0" * 64, path.stat().st_size
        return hash_really(cache, path)

    monkeypatch.setattr(HashCache, "sha256", hash_with_one_stale_answer)
    service.load(scene_path)
    assert mesh.read_bytes() in fake.blobs.values()


def test_a_file_that_never_stops_changing_is_reported(
    service: fogbank.Service, scene_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(HashCache, "sha256", lambda cache, path: ("0" * 64, path.stat().st_size))
    with pytest.raises(InvalidSceneError, match=r"fog\.xml changes while it is being sent"):
        service.load(scene_path)


def test_search_folders_bring_candidates_of_which_the_existing_one_is_sent(
    service: fogbank.Service, fake: FakeServer, scene_path: Path
) -> None:
    (scene_path.parent / "meshes").mkdir()
    (scene_path.parent / "mesh.ply").rename(scene_path.parent / "meshes" / "mesh.ply")
    scene_path.write_text('<scene>\n <path value="meshes"/> <shape filename="mesh.ply"/></scene>')
    service.load(scene_path)
    assert len(fake.blobs) == 2


def test_a_missing_file_is_the_servers_error_with_its_line(service: fogbank.Service, scene_path: Path) -> None:
    (scene_path.parent / "mesh.ply").unlink()
    with pytest.raises(InvalidSceneError, match=r"^fog\.xml:2: <shape>: no such file: mesh\.ply") as caught:
        service.load(scene_path)
    assert caught.value.reason == "FILE_NOT_FOUND"


def test_a_missing_scene_is_reported(service: fogbank.Service, tmp_path: Path) -> None:
    with pytest.raises(InvalidSceneError, match=r"nothing\.xml: no such file"):
        service.load(tmp_path / "nothing.xml")


def test_a_scene_that_refers_outside_says_how_to_name_the_root(
    service: fogbank.Service, fake: FakeServer, scene_path: Path
) -> None:
    scene_path.write_text('<scene>\n <shape filename="../shared/mesh.ply"/></scene>')
    outside = scene_path.parent.parent / "shared"
    outside.mkdir()
    (outside / "mesh.ply").write_bytes(b"elsewhere")
    with pytest.raises(InvalidSceneError, match=r"fog\.xml:2: .*\n.*--root"):
        service.load(scene_path)
    assert b"elsewhere" not in fake.blobs.values()
    scene = service.load(scene_path, root=scene_path.parent.parent)
    assert scene.main_path == "scene/fog.xml"
    assert b"elsewhere" in fake.blobs.values()


def test_a_scene_outside_its_root_is_refused(service: fogbank.Service, scene_path: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    with pytest.raises(InvalidSceneError, match="is not below the scene's root"):
        service.load(scene_path, root=elsewhere)


def test_a_link_out_of_the_root_is_never_followed(
    service: fogbank.Service, fake: FakeServer, scene_path: Path, tmp_path: Path
) -> None:
    secret = tmp_path / "secret"
    secret.write_bytes(b"not for servers")
    mesh = scene_path.parent / "mesh.ply"
    mesh.unlink()
    mesh.symlink_to(secret)
    with pytest.raises(InvalidSceneError, match=r"mesh\.ply lies outside the scene's root"):
        service.load(scene_path)
    assert b"not for servers" not in fake.blobs.values()


def test_a_root_that_is_reached_by_a_link_is_fine(service: fogbank.Service, scene_path: Path, tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(scene_path.parent)
    assert service.load(link / "fog.xml").main_path == "fog.xml"
    assert service.load(link / "fog.xml", root=link).main_path == "fog.xml"


def test_parameters_go_over_as_mitsuba_spells_them(service: fogbank.Service, scene_path: Path) -> None:
    names = {
        service.load(scene_path, parameters=parameters).name
        for parameters in ({}, {"g": 0.5}, {"g": "0.5"}, {"on": True}, {"on": "true"})
    }
    assert len(names) == 3


def test_sums_of_settled_files_are_kept_and_of_fresh_ones_not(tmp_path: Path) -> None:
    cache = HashCache(tmp_path / "cache" / "hashes.sqlite")
    path = tmp_path / "file"
    path.write_bytes(b"one")
    status = path.stat()
    assert cache.sha256(path) == (hashlib.sha256(b"one").hexdigest(), 3)
    # Same size, inode and mtime, as an editor within one tick of the clock would leave it.
    path.write_bytes(b"two")
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert cache.sha256(path)[0] == hashlib.sha256(b"two").hexdigest()
    cache.close()


def test_a_kept_sum_is_used_until_the_file_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"one")
    later = path.stat().st_mtime_ns + 2 * SETTLING_NANOSECONDS
    monkeypatch.setattr("fogbank.hash_cache.time.time_ns", lambda: later)
    cache = HashCache(tmp_path / "hashes.sqlite")
    expected = cache.sha256(path)
    cache.close()
    reopened = HashCache(tmp_path / "hashes.sqlite")
    with monkeypatch.context() as without_hashing:
        without_hashing.setattr("fogbank.hash_cache.hashlib.sha256", None)
        assert reopened.sha256(path) == expected
    path.write_bytes(b"three")
    assert reopened.sha256(path)[0] == hashlib.sha256(b"three").hexdigest()
    reopened.close()


def test_a_damaged_cache_file_costs_time_only(tmp_path: Path) -> None:
    (tmp_path / "hashes.sqlite").write_bytes(b"this is no database" * 100)
    cache = HashCache(tmp_path / "hashes.sqlite")
    path = tmp_path / "file"
    path.write_bytes(b"one")
    assert cache.sha256(path)[0] == hashlib.sha256(b"one").hexdigest()
    cache.close()
