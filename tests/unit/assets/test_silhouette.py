"""Silhouettes in pictures: what is found in masks and photographs, and what is refused."""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from meshdeform.assets.check import check_asset_subprocess
from meshdeform.assets.inspect import PictureSummary
from meshdeform.assets.silhouette import read_silhouette
from meshdeform.errors import AssetTooLargeError, SilhouetteError
from tests.cases import each_case

RNG = np.random.default_rng(0)


def encoded(pixels: NDArray[np.generic], kind: str = "PNG", **more: object) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(buffer, kind, **more)
    return buffer.getvalue()


def disk(height: int = 200, width: int = 300, radius: float = 60.0) -> NDArray[np.bool_]:
    rows, columns = np.mgrid[:height, :width] + 0.5
    return np.asarray(np.hypot(rows - height / 2, columns - width / 2) < radius)


@each_case("light_object", [True, False])
def test_a_mask_is_read_exactly_whichever_of_its_colours_is_the_object(light_object: bool) -> None:
    mask = disk()
    found = read_silhouette(encoded(np.where(mask == light_object, 255, 0)))
    # The filter against specks may change pixels at the outline only.
    assert (found.mask != mask).sum() < 8
    assert found.summary.format == "png"
    assert (found.summary.width, found.summary.height) == (300, 200)
    np.testing.assert_allclose(found.summary.box, (0.3, 0.2, 0.7, 0.8), atol=0.004)
    assert found.summary.share == pytest.approx(mask.mean(), rel=0.01)


def test_transparent_and_large_pictures_are_read() -> None:
    mask = disk()
    colours = RNG.integers(0, 255, (200, 300, 4))
    colours[..., 3] = np.where(mask, 255, 0)
    assert (read_silhouette(encoded(colours)).mask == mask).all()
    large = disk(900, 1200, 300)
    exif = Image.Exif()
    exif[0x0112] = 6  # turn by 90 degrees clockwise
    found = read_silhouette(encoded(np.where(large, 0, 255), "JPEG", exif=exif))
    assert found.mask.shape == (512, 384)
    assert (found.summary.width, found.summary.height) == (900, 1200)


def test_a_photograph_in_front_of_a_plain_background_survives_noise_and_compression() -> None:
    mask = disk()
    picture = np.where(mask[..., None], [150, 60, 40], [225, 222, 210]) + RNG.normal(0, 4, (200, 300, 1))
    found = read_silhouette(encoded(picture.clip(0, 255), "JPEG", quality=70)).mask
    assert (found & mask).sum() / (found | mask).sum() > 0.98


@each_case(
    ("data", "message"),
    [
        (encoded(np.full((64, 64, 3), 255)), "no object"),
        (encoded(RNG.integers(0, 255, (64, 64, 3))), "no plain background"),
        (encoded(np.dstack([np.full((64, 64, 3), 9), np.zeros((64, 64, 1))])), "no object"),
        (b"not a picture", "cannot be read"),
        (b"", "cannot be read"),
        (encoded(np.where(disk(), 255, 0))[:200], r"damaged|cannot be read"),
    ],
)
def test_what_has_no_silhouette_is_refused_with_its_reason(data: bytes, message: str) -> None:
    with pytest.raises(SilhouetteError, match=message):
        read_silhouette(data)


def test_a_picture_of_too_many_pixels_is_refused_before_it_is_decoded() -> None:
    def stating(width: int, height: int) -> bytes:
        head = b"IHDR" + struct.pack(">2I", width, height) + bytes([1, 0, 0, 0, 0])
        return (
            b"\x89PNG\r\n\x1a\n"
            + struct.pack(">I", 13)
            + head
            + struct.pack(">I", zlib.crc32(head))
            + bytes(4)
            + b"IDAT"
        )

    with pytest.raises(AssetTooLargeError, match="8192 x 8193"):
        read_silhouette(stating(8192, 8193))
    with pytest.raises(SilhouetteError, match="damaged"):
        read_silhouette(stating(8192, 8192))


def test_the_child_process_checks_a_picture(tmp_path) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "front.png"
    path.write_bytes(encoded(np.where(disk(), 255, 0)))
    summary = check_asset_subprocess(path, content="silhouette")
    assert isinstance(summary, PictureSummary)
    assert summary.box == pytest.approx((0.3, 0.2, 0.7, 0.8), abs=0.004)
    path.write_bytes(encoded(np.full((64, 64), 255)))
    with pytest.raises(SilhouetteError, match="no object"):
        check_asset_subprocess(path, content="silhouette")
