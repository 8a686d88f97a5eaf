"""The form arrives in pieces of any size, and what is wrong with it is found whatever the pieces are."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from meshdeform.errors import AssetTooLargeError, MeshdeformError, RequestError
from service.http.forms import FormFiles, ReceivedFile, receive_form
from tests.cases import each_case

KIND = "multipart/form-data; boundary=edge"


def part(name: str, data: bytes, filename: str | None = None) -> bytes:
    file = f'; filename="{filename}"' if filename is not None else ""
    return f'--edge\r\nContent-Disposition: form-data; name="{name}"{file}\r\n\r\n'.encode() + data + b"\r\n"


def form(asset: bytes, document: bytes = b"{}") -> bytes:
    return part("asset", asset, "a.glb") + part("request", document) + b"--edge--\r\n"


def receive(
    body: bytes, folder: Path, *, size: int = 7, max_bytes: int = 10**6, length: str = ""
) -> tuple[bytes, dict[str, ReceivedFile]]:
    async def pieces() -> AsyncIterator[bytes]:
        for start in range(0, len(body), size):
            yield body[start : start + size]

    return asyncio.run(receive_form(KIND, length, pieces(), folder, max_bytes))


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@example(asset=b"\r\n--edg\r\n--edgf\r\n-\r\n--", size=1)
@given(asset=st.binary(max_size=200), size=st.integers(1, 300))
def test_any_bytes_arrive_whole_in_pieces_of_any_size(asset: bytes, size: int, tmp_path: Path) -> None:
    document, files = receive(form(asset, b'{"prompt": "x"}'), tmp_path, size=size)
    assert document == b'{"prompt": "x"}'
    assert list(files) == ["asset"]
    assert files["asset"].path.read_bytes() == asset
    assert (files["asset"].size, files["asset"].sha256) == (len(asset), hashlib.sha256(asset).hexdigest())


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(body=st.binary(max_size=300), at=st.integers(0, 200), size=st.integers(1, 50))
def test_a_broken_body_is_an_error_of_ours_and_nothing_else(body: bytes, at: int, size: int, tmp_path: Path) -> None:
    whole = form(b"data")
    for broken in (body, whole[:at] + body + whole[at + len(body) :]):
        try:
            document, files = receive(broken, tmp_path, size=size)
        except MeshdeformError as error:
            if error.status >= 500:
                raise
        else:
            # What is accepted is a form all the same, and nothing in it was made up.
            assert b"--edge--" in broken
            assert document in broken
            assert all(file.path.read_bytes() in broken for file in files.values())


@each_case("cut", range(1, len(form(b"data")) - 3, 9))
def test_a_body_that_ends_early_is_refused(cut: int, tmp_path: Path) -> None:
    with pytest.raises(RequestError):
        receive(form(b"data")[:cut], tmp_path)


def test_the_limit_holds_while_it_streams_and_before(tmp_path: Path) -> None:
    body = form(bytes(1000))
    assert receive(body, tmp_path, max_bytes=len(body))[1]["asset"].size == 1000
    with pytest.raises(AssetTooLargeError):
        receive(body, tmp_path, max_bytes=len(body) - 1)
    with pytest.raises(AssetTooLargeError):
        receive(b"", tmp_path, max_bytes=10, length="11")


@each_case(
    ("disposition", "kept"),
    [
        ('filename="../../etc/passwd"', "passwd"),
        ('filename="C:\\models\\a b.glb"', "a b.glb"),
        ('filename="größe.glb"', "größe.glb"),
        ('filename="a\x07b.glb"', "ab.glb"),
        (f'filename="{"x" * 500}.glb"', "x" * 196 + ".glb"),
        ('filename=""', ""),
        ("filename=\"x.glb\"; filename*=UTF-8''h%C3%A4t%20a.glb", "hät a.glb"),
        ("filename*=iso-8859-1'de'h%E4t.glb; filename=x.glb", "hät.glb"),
        ("FileName* = utf-8'en'a.glb", "a.glb"),
        ("filename*=UTF-8''..%2F..%2Fetc%2Fpasswd", "passwd"),
        ("filename*=x-none''a.glb; filename=\"x.glb\"", "x.glb"),
        ("filename=\"a; filename*=utf-8''b.glb\"", "a; filename*=utf-8''b.glb"),
        ("filename*=broken; filename=x.glb", "x.glb"),
    ],
)
def test_a_file_keeps_the_last_part_of_its_name_in_its_own_script(disposition: str, kept: str, tmp_path: Path) -> None:
    head = f'--edge\r\nContent-Disposition: form-data; name="asset"; {disposition}\r\n\r\nx\r\n'.encode()
    _, received = receive(head + part("request", b"{}") + b"--edge--\r\n", tmp_path)
    assert received["asset"].filename == kept
    assert received["asset"].path.parent == tmp_path


def test_a_part_that_may_be_repeated_is_numbered_and_no_form_has_ever_so_many(tmp_path: Path) -> None:
    known = FormFiles(("meshes",), "Send meshes.", repeated=("meshes",))

    def received(count: int) -> dict[str, ReceivedFile]:
        body = b"".join(part("meshes", b"%d" % number, "a.glb") for number in range(count))

        async def pieces() -> AsyncIterator[bytes]:
            yield body + part("request", b"{}") + b"--edge--\r\n"

        return asyncio.run(receive_form(KIND, "", pieces(), tmp_path, 10**6, known))[1]

    files = received(3)
    assert [(name, file.path.read_bytes()) for name, file in files.items()] == [
        ("meshes", b"0"), ("meshes_2", b"1"), ("meshes_3", b"2"),
    ]  # fmt: skip
    with pytest.raises(RequestError, match="more than 250 fields"):
        received(251)
    with pytest.raises(RequestError, match="Unknown field 'asset'"):
        asyncio.run(receive_form(KIND, "", _once(form(b"data")), tmp_path, 10**6, known))


async def _once(body: bytes) -> AsyncIterator[bytes]:
    yield body
