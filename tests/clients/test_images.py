"""Tiles and images as numpy sees them, and as files."""

from __future__ import annotations

import hashlib
import pickle
from pathlib import Path

import numpy as np
import pytest
from fogbank import DataLossError, Image, Tile, Window, place, to_srgb
from fogbank.exr import decode
from PIL import Image as PillowImage

from tests.clients.fake_job import encode_exr, radiance

WINDOW = Window(3, 5, 8, 4)
FILM = (40, 24)


@pytest.fixture
def data() -> bytes:
    """An EXR file of a crop window, with variance and provenance."""
    return encode_exr(radiance(WINDOW, 0), WINDOW, FILM, variance=True, attributes={"fogbank:seed": "7"})


def test_an_exr_file_is_decoded_with_its_windows(data: bytes) -> None:
    decoded = decode(data)
    np.testing.assert_array_equal(decoded.pixels, radiance(WINDOW, 0))
    assert decoded.pixels.dtype == np.float32
    assert decoded.window == WINDOW
    assert decoded.film_size == FILM
    assert decoded.metadata == {"fogbank:seed": "7"}
    assert decoded.variance is not None
    np.testing.assert_array_equal(decoded.variance, radiance(WINDOW, 0) * np.float32(0.01))


@pytest.mark.parametrize("length", [0, 3, 200, 500])
def test_a_cut_exr_file_is_data_loss(data: bytes, length: int) -> None:
    with pytest.raises(DataLossError, match="EXR"):
        decode(data[:length])


def test_an_image_knows_what_it_is(data: bytes) -> None:
    image = Image.from_exr(data, sha256=hashlib.sha256(data).hexdigest())
    np.testing.assert_array_equal(np.asarray(image), radiance(WINDOW, 0))
    assert image.shape == (WINDOW.height, WINDOW.width, 3)
    assert image.window == WINDOW
    assert image.film_size == FILM
    assert image.metadata["fogbank:seed"] == "7"
    assert image.variance is not None
    assert image.variance.shape == image.shape
    with pytest.raises(DataLossError, match="SHA-256"):
        Image.from_exr(data, sha256="0" * 64)


def test_an_image_cannot_be_changed_in_place_but_computed_with(data: bytes) -> None:
    image = Image.from_exr(data)
    with pytest.raises(ValueError, match="read-only"):
        image[0, 0, 0] = 1.0
    # What is computed or cut is a plain array, since it is no longer what `window` and `exr` say.
    for derived in (image * 2.0, np.sqrt(image), image[1:, 2:], np.concatenate([image, image])):
        assert type(derived) is np.ndarray
    assert isinstance(image.mean(), np.floating)
    assert isinstance(image[0, 0, 0], np.float32)
    editable = np.array(image)
    editable[0, 0, 0] = 1.0


def test_images_and_tiles_survive_pickling(data: bytes) -> None:
    image = pickle.loads(pickle.dumps(Image.from_exr(data)))
    assert isinstance(image, Image)
    assert image.window == WINDOW
    assert image.exr == data
    assert not image.flags.writeable
    np.testing.assert_array_equal(image, radiance(WINDOW, 0))


def test_tiles_are_placed_on_a_film_or_on_a_crop_of_it() -> None:
    tile = Tile.create(radiance(WINDOW, 0), window=WINDOW, pass_=0, samples_per_pixel=1)
    film = np.zeros((24, 40, 3), np.float32)
    place(film, Window(0, 0, 40, 24), tile)
    np.testing.assert_array_equal(film[WINDOW.slices], tile)
    assert np.count_nonzero(film) == np.count_nonzero(tile)
    crop = np.zeros((6, 10, 3), np.float32)
    place(crop, Window(2, 4, 10, 6), tile)
    np.testing.assert_array_equal(crop[1:5, 1:9], tile)


def test_the_exr_is_saved_byte_for_byte(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "image.exr"
    path.write_bytes(b"older")
    Image.from_exr(data).save(path)
    assert path.read_bytes() == data
    assert [entry.name for entry in tmp_path.iterdir()] == ["image.exr"]


def test_the_tone_curve_is_srgb() -> None:
    # Values of IEC 61966-2-1: ends, the toe's end, 18 % grey (118), half (188), and clipping.
    linear = np.array([0.0, 0.0031308, 0.18, 0.5, 1.0, 7.0, -1.0], np.float32)
    assert to_srgb(linear).tolist() == [0, 10, 118, 188, 255, 255, 0]
    assert to_srgb(linear * np.float32(0.25), exposure=2.0).tolist() == to_srgb(linear).tolist()


def test_a_png_holds_the_tone_mapped_pixels(data: bytes, tmp_path: Path) -> None:
    image = Image.from_exr(data)
    image.save(tmp_path / "image.PNG", exposure=-5.0)
    with PillowImage.open(tmp_path / "image.PNG") as picture:
        assert picture.mode == "RGB"
        assert picture.info["srgb"] == 0
        np.testing.assert_array_equal(np.asarray(picture), to_srgb(image, exposure=-5.0))


def test_an_unknown_format_is_refused_and_nothing_left_behind(data: bytes, tmp_path: Path) -> None:
    image = Image.from_exr(data)
    with pytest.raises(ValueError, match=r"must end in \.exr or \.png"):
        image.save(tmp_path / "image.jpg")
    with pytest.raises(FileNotFoundError):
        image.save(tmp_path / "nowhere" / "image.exr")
    assert list(tmp_path.iterdir()) == []
