"""Jobs: tiles, re-attachment, results, ends."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import fogbank
import numpy as np
import numpy.typing as npt
import pytest
from fogbank import JobState, Tile, Window, place

from tests.clients.fake_job import ENDLESS, FAILING, PASSES, FakeJob, radiance
from tests.clients.fake_server import FakeServer

WHOLE = Window(0, 0, 40, 24)


def assemble(job: fogbank.Job, window: Window = WHOLE) -> npt.NDArray[np.float32]:
    """The image that the tiles of a job amount to."""
    film = np.full((window.height, window.width, 3), np.nan, np.float32)
    for tile in job.tiles():
        assert isinstance(tile, Tile)
        assert tile.dtype == np.float32
        assert tile.shape == (tile.window.height, tile.window.width, 3)
        place(film, window, tile)
    return film


def wait_until(condition: Callable[[], bool]) -> None:
    """Waits for something that happens in another thread; the test's own timeout is the limit."""
    while not condition():
        time.sleep(0.005)


def test_tiles_add_up_to_the_result(scene: fogbank.Scene) -> None:
    job = scene.render(integrator="volpath", spp=4)
    film = assemble(job)
    image = job.result()
    np.testing.assert_array_equal(film, np.asarray(image))
    np.testing.assert_array_equal(film, radiance(WHOLE, PASSES - 1))
    assert job.state is JobState.SUCCEEDED
    assert image.metadata["fogbank:scene"] == scene.name
    statistics = job.statistics
    assert statistics is not None
    assert statistics.samples == 4 * 40 * 24
    assert statistics.relative_noise == 0.02


def test_a_crop_window_and_variance_come_through(scene: fogbank.Scene) -> None:
    window = Window(5, 3, 21, 17)
    job = scene.render(crop=window, variance=True)
    np.testing.assert_array_equal(assemble(job, window), radiance(window, PASSES - 1))
    image = job.result()
    assert image.window == window
    assert image.film_size == (40, 24)
    assert image.variance is not None


def test_a_late_watcher_sees_the_same_image(scene: fogbank.Scene) -> None:
    job = scene.render().wait()
    np.testing.assert_array_equal(assemble(job), radiance(WHOLE, PASSES - 1))


def test_a_stream_that_breaks_again_and_again_gives_the_same_image(scene: fogbank.Scene, fake: FakeServer) -> None:
    fake.faults.cut_watches_after = [2] * 20
    np.testing.assert_array_equal(assemble(scene.render()), radiance(WHOLE, PASSES - 1))
    assert len(fake.faults.cut_watches_after) < 20


def test_re_attaching_gets_only_newer_tiles(scene: fogbank.Scene, fake: FakeServer) -> None:
    job = scene.render().wait()
    fake.faults.cut_watches_after = [4]
    # All tiles are final: the two that came before the cut are not sent again.
    windows = [tile.window for tile in job.tiles()]
    assert len(windows) == len(set(windows)) == 6


def test_a_stream_without_terminal_event_is_taken_up_again(scene: fogbank.Scene, fake: FakeServer) -> None:
    fake.faults.end_watches_early = 3
    np.testing.assert_array_equal(assemble(scene.render()), radiance(WHOLE, PASSES - 1))


def test_a_stream_that_the_server_cut_is_taken_up_again(scene: fogbank.Scene, fake: FakeServer) -> None:
    fake.faults.cancel_watches = 3
    np.testing.assert_array_equal(assemble(scene.render()), radiance(WHOLE, PASSES - 1))


def test_a_service_that_is_closed_ends_its_streams(service: fogbank.Service, scene: fogbank.Scene) -> None:
    tiles = scene.render(integrator=ENDLESS).tiles()
    next(tiles)
    service.close()
    with pytest.raises(fogbank.UnavailableError, match="is closed"):
        list(tiles)


def test_a_server_that_only_ever_breaks_off_is_given_up(scene: fogbank.Scene, fake: FakeServer) -> None:
    fake.faults.cut_watches_after = [1] * 1000
    with pytest.raises(fogbank.UnavailableError):
        list(scene.render().tiles())


def test_a_slow_reader_gets_newest_tiles_and_the_right_end(scene: fogbank.Scene, fake: FakeServer) -> None:
    fake.hold_jobs = True
    job = scene.render()
    tiles = job.tiles()
    first = next(tiles)
    fake.jobs[job.name].go_on.set()
    wait_until(lambda: fake.jobs[job.name].ended)
    film = np.zeros((24, 40, 3), np.float32)
    for tile in [first, *tiles]:
        place(film, WHOLE, tile)
    np.testing.assert_array_equal(film, radiance(WHOLE, PASSES - 1))


def test_dropping_the_generator_ends_the_stream_and_not_the_job(scene: fogbank.Scene, fake: FakeServer) -> None:
    fake.hold_jobs = True
    job = scene.render()
    fake_job: FakeJob = fake.jobs[job.name]
    tiles = job.tiles()
    next(tiles)
    assert fake_job.open_streams == 1
    tiles.close()  # type: ignore[attr-defined]
    wait_until(lambda: fake_job.open_streams == 0)
    assert job.refresh().state is JobState.RUNNING
    fake_job.go_on.set()
    np.testing.assert_array_equal(np.asarray(job.result()), radiance(WHOLE, PASSES - 1))


def test_events_tell_of_states_tiles_and_progress(scene: fogbank.Scene) -> None:
    job = scene.render()
    events = list(job.events())
    assert events[0] is job
    assert events[-1] is job
    progress = [event for event in events if isinstance(event, fogbank.Progress)]
    assert progress[-1].passes_done == PASSES
    assert progress[-1].eta_seconds == 0.1
    without_tiles = list(job.events(tiles=False))
    assert not any(isinstance(event, Tile) for event in without_tiles)


def test_a_failed_job_raises_with_the_servers_reason(scene: fogbank.Scene) -> None:
    job = scene.render(integrator=FAILING)
    for attempt in (lambda: list(job.tiles()), job.result):
        with pytest.raises(fogbank.JobFailedError, match="the fake integrator fails") as caught:
            attempt()
        assert caught.value.reason == "INTERNAL_ERROR"
    assert job.state is JobState.FAILED


def test_a_cancelled_job_raises(scene: fogbank.Scene) -> None:
    job = scene.render(integrator=ENDLESS)
    next(job.tiles())
    job.cancel()
    with pytest.raises(fogbank.JobCancelledError) as caught:
        job.result()
    assert caught.value.reason == "JOB_CANCELLED"
    job.cancel()  # a second time is no error
    assert job.state is JobState.CANCELLED


def test_waiting_can_be_limited(scene: fogbank.Scene) -> None:
    job = scene.render(integrator=ENDLESS)
    with pytest.raises(fogbank.DeadlineExceededError, match="has not ended"):
        job.result(timeout=0.05)
    assert job.refresh().state is JobState.RUNNING


def test_a_download_is_taken_up_where_it_broke(scene: fogbank.Scene, fake: FakeServer) -> None:
    job = scene.render().wait()
    fake.faults.cut_downloads_after = [1, 0, 2, 1]
    np.testing.assert_array_equal(np.asarray(job.result()), radiance(WHOLE, PASSES - 1))
    assert fake.faults.cut_downloads_after == []


def test_a_damaged_download_is_noticed(scene: fogbank.Scene, fake: FakeServer) -> None:
    job = scene.render().wait()
    fake.faults.damage_image = True
    with pytest.raises(fogbank.DataLossError, match="SHA-256"):
        job.result()


def test_effective_settings_are_shown(scene: fogbank.Scene) -> None:
    settings = scene.render(seed=3).settings
    assert settings["spp"] == 4
    assert settings["seed"] == 3
    assert settings["size"] == (40, 24)


def test_the_same_request_id_gives_the_same_job(scene: fogbank.Scene) -> None:
    assert scene.render(request_id="mine").name == scene.render(request_id="mine").name
    assert scene.render().name != scene.render().name


def test_unavailability_is_retried_with_the_same_request_id(scene: fogbank.Scene, fake: FakeServer) -> None:
    fake.faults.unavailable_calls = 3
    scene.render()
    assert len({request.request_id for request in fake.create_job_requests}) == 1
    assert len(fake.jobs) == 1


def test_listings_span_pages(service: fogbank.Service, scene: fogbank.Scene) -> None:
    names = [scene.render(seed=seed).wait().name for seed in range(5)]
    failed = scene.render(integrator=FAILING).wait().name
    assert [job.name for job in service.jobs()] == [failed, *reversed(names)]
    assert [job.name for job in service.jobs(states=[JobState.FAILED])] == [failed]
    assert service.job(names[0]).state is JobState.SUCCEEDED
    assert [item.name for item in service.scenes()] == [scene.name]


def test_a_deleted_scene_is_gone(service: fogbank.Service, scene: fogbank.Scene) -> None:
    assert service.scene(scene.name).main_path == "fog.xml"
    scene.delete()
    with pytest.raises(fogbank.NotFoundError) as caught:
        service.scene(scene.name)
    assert caught.value.reason == "SCENE_NOT_FOUND"
    with pytest.raises(fogbank.NotFoundError):
        scene.render()


def test_threads_may_share_a_client(scene: fogbank.Scene) -> None:
    with ThreadPoolExecutor(10) as pool:
        films = list(pool.map(lambda seed: assemble(scene.render(seed=seed)), range(20)))
    for film in films:
        np.testing.assert_array_equal(film, radiance(WHOLE, PASSES - 1))
