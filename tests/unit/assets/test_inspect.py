"""The first gate: bad files are told from their JSON alone, at once, and without memory."""

from __future__ import annotations

import sys
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from meshdeform.assets.check import check_asset_subprocess
from meshdeform.assets.inspect import inspect_asset
from meshdeform.assets.limits import Limits
from meshdeform.children import asking
from meshdeform.errors import (
    AssetEmptyError,
    AssetError,
    AssetExternalError,
    AssetFormatError,
    AssetNotFiniteError,
    AssetTooLargeError,
    AssetTruncatedError,
    AssetUnsupportedError,
    UnavailableError,
)
from meshdeform.serving.access import is_foreign
from meshdeform.settings import Settings
from tests.cases import each_case
from tests.unit.assets.builders import QUAD_VERTS, Builder, pack, quad


def bomb(count: int = 200_000_000) -> bytes:
    """A file of a few hundred bytes whose accessor without a buffer view declares 200 million vertices."""
    return pack(
        {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [{"componentType": 5126, "count": count, "type": "VEC3", "min": [0] * 3, "max": [1] * 3}],
        }
    )


@each_case("count", [200_000_000, 20_000_000, 2**53, 10**30])
def test_a_tiny_file_that_declares_millions_costs_nothing(count: int) -> None:
    data = bomb(count)
    assert len(data) < 480
    tracemalloc.start()
    with pytest.raises(AssetError):
        inspect_asset(data)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2**20


def test_an_empty_morph_target_may_be_as_large_as_its_mesh() -> None:
    builder = Builder()
    primitive = builder.primitive()
    builder.root["accessors"].append({"componentType": 5126, "count": 1_000_000, "type": "VEC3"})
    builder.node(builder.mesh({**primitive, "targets": [{"POSITION": 2}]}))
    inspect_asset(builder.glb())  # nobody reads it
    primitive["attributes"]["TEXCOORD_0"] = 2
    with pytest.raises(AssetTooLargeError, match="without data"):
        inspect_asset(builder.glb())


def test_a_summary_counts_every_instance() -> None:
    builder = Builder()
    mesh = builder.mesh(builder.primitive(), {**builder.primitive(), "mode": 0})
    builder.node(mesh)
    builder.node(mesh)
    builder.root["extensionsUsed"] = ["X_other"]
    summary = inspect_asset(builder.glb())
    assert (summary.format, summary.vertices, summary.triangles, summary.meshes) == ("glb", 8, 4, 2)
    assert summary.extensions == ("X_other",)
    assert summary.skipped == ()  # points follow the surface
    assert inspect_asset(quad(), "model.obj").format == "glb"


def test_limits_come_from_the_settings_and_are_told() -> None:
    builder = Builder()
    mesh = builder.mesh(builder.primitive())
    for _ in range(6):
        builder.node(mesh)
    assert inspect_asset(builder.glb(), limits=Limits(max_triangles=12)).triangles == 12
    with pytest.raises(AssetTooLargeError, match="MESHDEFORM_MAX_TRIANGLES"):
        inspect_asset(builder.glb(), limits=Limits(max_triangles=11))
    low = Limits.from_settings(Settings(max_upload_bytes=5000, max_triangles=7, max_json_bytes=2048))
    assert (low.max_bytes, low.max_triangles, low.max_json_bytes) == (5000, 7, 2048)
    with pytest.raises(AssetTooLargeError, match="more than 5,000 bytes") as refused:
        inspect_asset(bytes(6000), limits=low)
    assert "MESHDEFORM_MAX_UPLOAD_BYTES" in refused.value.advice_text
    with pytest.raises(AssetTooLargeError, match="The ZIP unpacks to more than 100 MiB, which is the limit"):
        Limits().check_bytes(2**27, "The ZIP unpacks to")
    usual = Limits()
    assert usual.memory_bytes(usual.max_bytes) == usual.max_memory_bytes > usual.memory_bytes(0)
    assert Limits(max_memory_bytes=5).memory_bytes(10**9) == 5
    larger = Limits.from_settings(Settings(max_upload_bytes=2**30))
    assert larger.max_memory_bytes == larger.memory_bytes(2**30) > usual.max_memory_bytes


def broken(change: Any) -> bytes:
    builder = Builder()
    builder.node(builder.mesh(builder.primitive()))
    change(builder.root)
    return builder.glb()


def put(*path: Any) -> Any:
    """Return a change that sets what stands at a path."""

    def change(root: dict[str, Any]) -> None:
        *way, last, value = path
        place: Any = root
        for step in way:
            place = place[step]
        place[last] = value

    return change


@each_case(
    ("change", "error"),
    [
        (put("asset", "version", "1.0"), AssetFormatError),
        (put("asset", "version", 2.0), AssetError),
        (put("asset", "minVersion", "2.1"), AssetUnsupportedError),
        (put("accessors", 0, "count", 5), AssetTruncatedError),
        (put("accessors", 0, "count", 0), AssetError),
        (put("accessors", 0, "count", -1), AssetError),
        (put("accessors", 0, "count", True), AssetError),
        (put("accessors", 0, "byteOffset", 4), AssetTruncatedError),
        (put("accessors", 0, "byteOffset", -4), AssetError),
        (put("accessors", 0, "bufferView", 9), AssetError),
        (put("accessors", 0, "componentType", 5124), AssetError),
        (put("accessors", 0, "type", "VEC5"), AssetError),
        (put("accessors", 0, "type", "VEC2"), AssetError),
        (put("accessors", 0, "sparse", {"count": 1}), AssetError),
        (put("accessors", 0, "sparse", {"count": 10**9}), AssetError),
        (put("accessors", 1, "count", 3 * 2**40), AssetTooLargeError),
        (put("accessors", 1, "componentType", 5122), AssetError),
        (put("bufferViews", 0, "byteLength", 10**6), AssetTruncatedError),
        (put("bufferViews", 0, "byteStride", 24), AssetTruncatedError),
        (put("bufferViews", 0, "buffer", 1), AssetError),
        (put("bufferViews", 0, []), AssetError),
        (put("images", [{"bufferView": 9, "mimeType": "image/png"}]), AssetError),
        (put("buffers", [{"byteLength": 10}]), None),
        (put("buffers", [{"uri": "scene.bin", "byteLength": 10}]), AssetExternalError),
        (put("images", [{"uri": 1}]), AssetError),
        (put("buffers", [{"uri": "data:;base64,AAAA", "byteLength": 10}]), AssetTruncatedError),
        (put("extensionsRequired", ["X_changes_everything"]), AssetUnsupportedError),
        (put("extensionsRequired", [1]), AssetError),
        (put("scene", 4), AssetError),
        (put("nodes", 0, "mesh", 1), AssetError),
        (put("nodes", 0, "children", [0]), AssetError),
        (put("nodes", 0, "children", [7]), AssetError),
        (put("nodes", 0, "children", 7), AssetError),
        (put("nodes", 0, "matrix", [1, 0, 0]), AssetError),
        (put("nodes", 0, "scale", [1, 0, "x"]), AssetError),
        (put("nodes", 0, "scale", [1e999, 1, 1]), AssetError),
        (put("nodes", 0, "translation", [10**400, 1, 1]), AssetError),
        (put("nodes", [{"mesh": 0, "children": [1]}, {"children": [0]}]), AssetError),
        (put("nodes", [{"mesh": 0, "children": [2]}, {"children": [2]}, {}]), AssetError),
        (put("nodes", 0, "skin", 0), AssetError),
        (put("skins", [{"joints": [0], "inverseBindMatrices": 0}]), AssetError),
        (put("skins", [{"joints": []}]), AssetError),
        (put("meshes", 0, "primitives", 0, "attributes", "POSITION", 12), AssetError),
        (put("meshes", 0, "primitives", 0, "attributes", []), AssetError),
        (put("meshes", 0, "primitives", 0, "attributes", {}), AssetEmptyError),
        (put("meshes", 0, "primitives", 0, "mode", 7), AssetError),
        (put("meshes", 0, "primitives", 0, "indices", 0), AssetError),
        (put("meshes", 0, "primitives", 0, "targets", [{"POSITION": 99}]), AssetError),
        (put("meshes", 0, "primitives", "x"), AssetError),
        (put("scenes", [{"nodes": []}]), AssetEmptyError),
    ],
)
def test_each_fault_is_its_own_error(change: Any, error: type[AssetError] | None) -> None:
    data = broken(change)
    if error is None:
        inspect_asset(data)
        return
    with pytest.raises(error) as raised:
        inspect_asset(data)
    assert raised.value.status in {413, 415, 422}
    assert raised.value.advice_text


@each_case(
    ("link", "told"),
    [
        ("file:///etc/passwd", "may fetch"),
        ("http://127.0.0.1:9/x.bin", "may fetch"),
        ("\\\\host\\share", "may fetch"),
        ("//host/share", "may fetch"),
        ("C:/key.png", "may fetch"),
        ("%2fetc%2fpasswd", "may fetch"),
        ("textures/wood.png", "ZIP"),
        ("data:image/png;base64,", None),
    ],
)
def test_links_to_other_places_are_kept_and_named(link: str, told: str | None) -> None:
    warnings = inspect_asset(broken(put("images", [{"uri": link}]))).warnings
    assert len(warnings) == (told is not None)
    assert all(told in warning and link.strip("\\") in warning.replace("\\\\", "\\") for warning in warnings if told)


def test_a_buffer_without_its_data_is_told() -> None:
    root = {"asset": {"version": "2.0"}, "buffers": [{"byteLength": 9}]}
    with pytest.raises(AssetTruncatedError):
        inspect_asset(pack(root, b"12345678"))
    builder = Builder()
    builder.node(builder.mesh(builder.primitive()))
    builder.root["buffers"].append({"byteLength": 10**9})
    builder.root["bufferViews"][0] |= {"buffer": 1}
    with pytest.raises(AssetTruncatedError, match="no data"):
        inspect_asset(builder.glb())


@each_case(
    ("data", "name", "error"),
    [
        (b"", "", AssetFormatError),
        (b"%PDF-1.7", "a.pdf", AssetFormatError),
        (b"hello", "a.glb", AssetFormatError),
        (b"hello", "a.ply", AssetFormatError),
        (b"\x00\x01", "a.obj", AssetFormatError),
        (b"v 0 0 0\n", "a.obj", AssetEmptyError),
        (b"ply\nformat ascii 1.0\nelement vertex 3", "", AssetTruncatedError),
        (b"ply\nformat ascii 1.0\nelement vertex 99999999999\nend_header\n", "", AssetTruncatedError),
        (b"ply\nformat ascii 1.0\nelement vertex x\nend_header\n", "", AssetFormatError),
        (b"solid x\nendsolid", "a.stl", AssetEmptyError),
        (bytes(80) + b"\xff\xff\xff\xff", "a.stl", AssetTruncatedError),
        (bytes(80), "a.stl", AssetTruncatedError),
        (
            b'{"asset": {"version": "2.0"}, "buffers": [{"uri": "a.bin", "byteLength": 1}]}',
            "a.gltf",
            AssetExternalError,
        ),
    ],
)
def test_other_formats(data: bytes, name: str, error: type[AssetError]) -> None:
    with pytest.raises(error):
        inspect_asset(data, name)


@each_case(
    ("data", "name", "surface"),
    [
        (b"0 0 0 0 0 1\n" * 200, "scan.xyz", "points"),
        (b"PK\x03\x04" + bytes(60), "grid.npz", "grid"),
        (bytes(64), "net.safetensors", "network"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nend_header\n0 0 0\n", "scan.ply", "points"),
    ],
)
def test_a_surface_without_triangles_is_told_what_to_do(data: bytes, name: str, surface: str) -> None:
    with pytest.raises(AssetEmptyError) as caught:
        inspect_asset(data, name)
    assert caught.value.extra["surface"] == surface
    assert "meshdeform surface-fit FILE -o mesh.glb" in caught.value.advice_text


# Web pages of others cannot use a service on loopback through the browser of whoever runs it.


@each_case(
    ("host", "origin", "foreign"),
    [
        ("127.0.0.1:8765", None, False),
        ("[::1]:8765", None, False),
        (None, None, False),
        ("localhost:8765", "http://localhost:8765", False),
        ("127.0.0.1:8765", "http://localhost:3000", False),
        ("evil.example:8765", None, True),
        ("127.0.0.1:8765", "https://evil.example", True),
        ("127.0.0.1:8765", "null", True),
        ("127.0.0.1.evil.example", None, True),
        ("localhost.evil.example", None, True),
        ("[::1", None, True),
        ("", None, True),
        ("10.0.0.7:8765", None, True),
    ],
)
def test_only_programs_and_pages_of_this_machine_may_ask(host: str | None, origin: str | None, foreign: bool) -> None:
    assert is_foreign(host, origin) is foreign


# Parts of a grid that are thinner than its cells can tell: where they are told, and where nothing is.


# The second gate: a child process decodes, the parent gets a verdict whatever happens to the child.


PYTHON = sys.executable


def stand_in_for_child(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, child: str) -> None:
    """Write a good file, and let a program of ours check it."""
    (tmp_path / "quad.glb").write_bytes(quad())
    program = tmp_path / "child.py"
    program.write_text(child)
    stand_in = tmp_path / "python"
    stand_in.write_text(f'#!/bin/sh\nexec "{PYTHON}" "{program}"\n')
    stand_in.chmod(0o755)
    monkeypatch.setattr(asking.sys, "executable", str(stand_in))


def test_the_child_says_what_a_file_holds_whatever_its_name(tmp_path: Path) -> None:
    path = tmp_path / "stored"
    path.write_bytes(quad())
    summary = check_asset_subprocess(path, "quad.glb")
    assert (summary.format, summary.vertices, summary.triangles, summary.skipped) == ("glb", 4, 2, ())
    for name in ("--help", "a\0b.glb", "\ud800.glb", "a\nb.glb", "x" * 200_000 + ".glb"):
        assert check_asset_subprocess(path, name) == summary
    with pytest.raises(AssetTooLargeError):
        check_asset_subprocess(path, limits=Limits(max_triangles=1))
    with pytest.raises(AssetError) as raised:
        check_asset_subprocess(path, limits=Limits(max_memory_bytes=24 * 2**20))
    assert raised.value.status in (413, 422)


def stretched(path: Path, *scale: float) -> Path:
    """Write the quad with its positions multiplied."""
    builder = Builder()
    primitive = builder.primitive()
    primitive["attributes"]["POSITION"] = builder.accessor(QUAD_VERTS * np.float32(scale))
    builder.node(builder.mesh(primitive))
    path.write_bytes(builder.glb())
    return path


def test_the_childs_error_is_the_parents(tmp_path: Path) -> None:
    path = tmp_path / "quad.glb"
    with pytest.raises(AssetNotFiniteError, match="4 positions") as raised:
        check_asset_subprocess(stretched(path, np.nan))
    assert raised.value.advice_text == AssetNotFiniteError.advice
    for width in (0.0, 9e-6):  # the solve takes these for collapsed
        with pytest.raises(AssetEmptyError, match="zero area"):
            check_asset_subprocess(stretched(path, 1, width, width))
    assert check_asset_subprocess(stretched(path, 1, 1e-4, 1e-4)).triangles == 2


@each_case(
    ("child", "error", "message"),
    [
        ("import os; os.kill(os.getpid(), 11)", AssetError, "SIGSEGV"),
        ("import os; os.kill(os.getpid(), 9)", AssetTooLargeError, "memory"),
        ("print('decoding {'); print('[]'); raise SystemExit(7)", AssetError, "exit status 7"),
        ("import time; time.sleep(600)", AssetTooLargeError, "within 0.5 s"),
    ],
)
def test_a_child_that_dies_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, child: str, error: type[AssetError], message: str
) -> None:
    stand_in_for_child(tmp_path, monkeypatch, child)
    with pytest.raises(error, match=message):
        check_asset_subprocess(tmp_path / "quad.glb", limits=Limits(max_check_s=0.5 if "sleep" in child else 60.0))


def test_a_machine_that_starts_no_process_is_not_the_files_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(asking.sys, "executable", str(tmp_path / "nothing"))
    with pytest.raises(UnavailableError):
        check_asset_subprocess(stretched(tmp_path / "quad.glb", 1))
