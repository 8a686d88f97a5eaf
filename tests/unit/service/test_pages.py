"""The files of the web page, as they are found."""

from __future__ import annotations

import gzip
import hashlib
import zipfile
from pathlib import Path

import pytest

from service.page.files import PageFiles


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    web = tmp_path / "web"
    (web / "vendor" / "three").mkdir(parents=True)
    (web / ".hidden").mkdir()
    (web / "index.html").write_text("<!doctype html>" + "<p>mesh</p>" * 200)
    (web / "small.js").write_text("export {}")
    (web / "page.py").write_text("secret = 1")
    (web / ".hidden" / "a.js").write_text("secret")
    (web / "vendor" / "three" / "three.js").write_text("export const three = 3;" * 100)
    (web / "vendor" / "three" / "LICENSE").write_text("MIT")
    (tmp_path / "outside.js").write_text("secret")
    (web / "link.js").symlink_to(tmp_path / "outside.js")
    return web


def test_a_file_is_found_whole_and_compressed(folder: Path) -> None:
    content = (folder / "index.html").read_bytes()
    found = PageFiles(folder).find("index.html")
    assert found is not None
    assert found.compressed is not None
    assert (found.content, gzip.decompress(found.compressed)) == (content, content)
    assert len(found.compressed) < len(content) / 5
    assert found.digest == hashlib.sha256(content).hexdigest()
    assert found.content_type == "text/html; charset=utf-8"


def test_what_gains_nothing_is_not_compressed(folder: Path) -> None:
    found = PageFiles(folder).find("small.js")
    assert found is not None
    assert found.compressed is None


@pytest.mark.parametrize(
    "path",
    [
        "",
        "/",
        "nothing.js",
        "vendor",
        "../outside.js",
        "vendor/../small.js",
        "..%2foutside.js",
        "/etc/passwd",
        "//index.html",
        "vendor//three/three.js",
        "./small.js",
        "vendor\\three\\three.js",
        "small.js\0",
        "small.js/",
        ".hidden/a.js",
        "page.py",
        "link.js",
        "C:small.js",
        "a" * 5000 + ".js",
    ],
)
def test_nothing_else_is_opened(folder: Path, path: str) -> None:
    assert PageFiles(folder).find(path) is None


def test_a_licence_can_be_read(folder: Path) -> None:
    found = PageFiles(folder).find("vendor/three/LICENSE")
    assert found is not None
    assert (found.content, found.content_type) == (b"MIT", "text/plain; charset=utf-8")


def test_a_file_that_is_written_anew_is_read_anew(folder: Path) -> None:
    pages = PageFiles(folder)
    first = pages.find("small.js")
    assert pages.find("small.js") is first
    (folder / "small.js").write_text("export const more = 1")
    second = pages.find("small.js")
    assert second is not None
    assert second.content == b"export const more = 1"


def test_a_package_in_an_archive_has_its_page(folder: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "package.zip", "w") as archive:
        archive.write(folder / "index.html", "web/index.html")
    with zipfile.ZipFile(tmp_path / "package.zip") as archive:
        pages = PageFiles(zipfile.Path(archive, "web/"))
        found = pages.find("index.html")
        assert found is not None
        assert found.content == (folder / "index.html").read_bytes()
        assert pages.find("../index.html") is None


def test_without_the_folder_there_is_nothing(tmp_path: Path) -> None:
    assert PageFiles(tmp_path / "web").find("index.html") is None
