"""The files that an asset names are found however systems spell their names, in a ZIP and in a folder alike."""

from __future__ import annotations

import io
import unicodedata
import zipfile
from collections.abc import Mapping
from pathlib import Path

import pytest

from meshdeform.assets import Asset, Limits, load_asset
from meshdeform.assets.archive import FileNames
from meshdeform.assets.bundle import read_with_files
from tests.cases import each_case
from tests.unit.assets.archives import packed
from tests.unit.assets.builders import notable, unpack
from tests.unit.assets.test_replace import DOT

COMPOSED = "Fächer/Holz grün.png"
DECOMPOSED = unicodedata.normalize("NFD", COMPOSED)
OBJ = b"mtllib lib.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl wood\nf 1/1 2/2 3/3\n"


def files(link: str, name: str) -> dict[str, bytes]:
    """Return an OBJ whose texture is linked, and a file of another name."""
    return {"a.obj": OBJ, "lib.mtl": f"newmtl wood\nmap_Kd {link}\n".encode(), name: DOT}


def read(way: str, contents: Mapping[str, bytes], folder: Path) -> Asset:
    """Read the files from a ZIP, or from a folder."""
    if way == "zip":
        return load_asset(packed(dict(contents)), "a.zip")
    for name, data in contents.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return load_asset(read_with_files(folder / "a.obj", Limits()), "a.obj")


def has_picture(asset: Asset) -> bool:
    return bool(unpack(asset.to_bytes())[0].get("images"))


@pytest.mark.parametrize("way", ["zip", "folder"])
@pytest.mark.parametrize(
    ("link", "name"),
    [
        (COMPOSED, COMPOSED),
        (COMPOSED, DECOMPOSED),
        (DECOMPOSED, COMPOSED),
        (COMPOSED.upper(), DECOMPOSED),
        ("Textures\\wood.PNG", "textures/Wood.png"),
        ("wood%20red.png", "wood red.png"),
        ("./maps/../wood.png", "wood.png"),
    ],
)
def test_spellings_make_no_difference(way: str, link: str, name: str, tmp_path: Path) -> None:
    asset = read(way, files(link, name), tmp_path)
    assert (has_picture(asset), notable(asset)) == (True, ())


@pytest.mark.parametrize("way", ["zip", "folder"])
@pytest.mark.parametrize(
    ("link", "name"),
    [
        ("C:\\Users\\me\\wood.png", "textures/wood.png"),
        ("/home/me/wood.png", "textures/wood.png"),
        ("../../wood.png", "deep/down/WOOD.png"),
        ("https://example.org/maps/wood.png", "maps/wood.png"),
    ],
)
def test_a_file_elsewhere_is_taken_if_no_other_has_its_name(way: str, link: str, name: str, tmp_path: Path) -> None:
    asset = read(way, files(link, name), tmp_path)
    assert has_picture(asset)
    assert any(name in warning and "elsewhere" in warning for warning in notable(asset))
    two = {**files(link, name), "other/wood.png": DOT}
    asset = read(way, two, tmp_path)
    assert not has_picture(asset)
    assert any("Textures not found" in warning for warning in notable(asset))


def test_names_that_differ_in_case_only_are_told_apart() -> None:
    names = FileNames(["a.png", "A.png", "b/c.png"])
    assert names.find("A.png") == ("A.png", False)
    assert names.find("a.png") == ("a.png", False)
    assert names.find("C.PNG", "b") == ("b/c.png", False)
    assert names.find("c.png") == ("b/c.png", True)
    assert names.find("d.png") is None


def test_utf8_without_the_flag_is_read(tmp_path: Path) -> None:
    """Info-ZIP and macOS write such names (APPNOTE 4.4.4, bit 11)."""
    data = packed(files(COMPOSED, COMPOSED))
    flags = (b"PK\x03\x04", 6), (b"PK\x01\x02", 8)
    raw = bytearray(data)
    for magic, offset in flags:
        at = raw.find(magic)
        while at >= 0:
            raw[at + offset + 1] &= 0xF7
            at = raw.find(magic, at + 4)
    path = tmp_path / "a.zip"
    path.write_bytes(bytes(raw))
    assert COMPOSED not in zipfile.ZipFile(path).namelist()
    assert has_picture(load_asset(bytes(raw), "a.zip"))


@each_case("kind", ["TGA", "BMP", "TIFF"])
def test_pictures_of_other_formats_become_png(kind: str) -> None:
    image = pytest.importorskip("PIL.Image")
    written = io.BytesIO()
    image.new("RGB", (2, 2), (10, 20, 30)).save(written, kind)
    contents = files("wood.tga", "wood.tga") | {"wood.tga": written.getvalue()}
    root, binary, _ = unpack(load_asset(packed(contents), "a.zip").to_bytes())
    assert root["images"][0]["mimeType"] == "image/png"
    view = root["bufferViews"][root["images"][0]["bufferView"]]
    with image.open(io.BytesIO(binary[view["byteOffset"] :][: view["byteLength"]])) as picture:
        assert picture.convert("RGB").getpixel((1, 1)) == (10, 20, 30)


def test_colors_of_a_material_are_srgb_and_tint_a_texture_unless_grey() -> None:
    def factor(mtl: str) -> list[float] | None:
        data = packed({"a.obj": OBJ, "lib.mtl": f"newmtl wood\n{mtl}".encode(), "wood.png": DOT})
        material = unpack(load_asset(data, "a.zip").to_bytes())[0]["materials"][0]
        color: list[float] | None = material["pbrMetallicRoughness"].get("baseColorFactor")
        return color

    half = 0.735356983052449  # sRGB of the linear 0.5
    assert factor(f"Kd {half} 0 1\n") == pytest.approx([0.5, 0, 1, 1])
    assert factor(f"Kd {half} 0 1\nmap_Kd wood.png\n") == pytest.approx([0.5, 0, 1, 1])
    assert factor("Kd 0.8 0.8 0.8\nmap_Kd wood.png\n") == [1, 1, 1, 1]
