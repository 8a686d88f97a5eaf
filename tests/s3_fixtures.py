"""Fixtures on a real S3 server; tests/conftest.py makes them known everywhere."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import s3_server as swift
from tests.servers import NotInstalledError


@pytest.fixture(scope="session")
def s3_server(server_folder: Path) -> Iterator[swift.S3Server]:
    """A real S3 server for the session. Tests take `s3_store_url`, a bucket of their own."""
    folder = server_folder / "s3"
    folder.mkdir()
    try:
        with swift.s3_server(folder) as server:
            yield server
    except NotInstalledError as missing:
        pytest.skip(str(missing))


@pytest.fixture
def s3_store_url(s3_server: swift.S3Server, monkeypatch: pytest.MonkeyPatch) -> str:
    """`MESHDEFORM_STORAGE_URL` for a prefix in an empty bucket; the AWS_* variables that go with it are set.

    Child processes inherit them. For a proxy in front of the server, set `AWS_ENDPOINT_URL` to it afterwards.
    """
    bucket = f"test-{uuid.uuid4().hex}"
    s3_server.make_bucket(bucket)
    for name, value in s3_server.settings().items():
        monkeypatch.setenv(name, value)
    return f"s3://{bucket}/some/prefix"
