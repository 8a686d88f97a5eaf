"""The assets that are kept for previews: whose they are, and which go."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from meshdeform.errors import AssetNotKeptError
from service.http.forms import ReceivedFile
from service.jobs.kept_assets import KeptAssets


def received(folder: Path, content: bytes) -> ReceivedFile:
    digest = hashlib.sha256(content).hexdigest()
    path = folder / f"sent-{digest[:8]}"
    path.write_bytes(content)
    return ReceivedFile(path, "a.glb", len(content), digest)


@pytest.fixture
def kept(tmp_path: Path) -> KeptAssets:
    return KeptAssets(tmp_path / "kept", most_bytes=40, most_bytes_per_owner=20)


def held(kept: KeptAssets, owner: str, file: ReceivedFile, folder: Path) -> bool:
    target = folder / "fetched"
    target.unlink(missing_ok=True)
    try:
        return kept.fetch(owner, file.sha256, target).path.read_bytes() != b""
    except AssetNotKeptError:
        return False


def test_an_owner_gets_what_it_sent_and_nobody_else(kept: KeptAssets, tmp_path: Path) -> None:
    file = received(tmp_path, b"an asset")
    assert kept.keep("ann", file)
    file.path.unlink()
    fetched = kept.fetch("ann", file.sha256, tmp_path / "here")
    assert (fetched.path.read_bytes(), fetched.filename, fetched.size) == (b"an asset", "a.glb", 8)
    assert not held(kept, "bob", file, tmp_path)


def test_what_an_owner_used_least_recently_goes_and_of_nobody_else(kept: KeptAssets, tmp_path: Path) -> None:
    first, second, third, other = (received(tmp_path, 9 * letter) for letter in (b"a", b"b", b"c", b"d"))
    kept.keep("bob", other)
    kept.keep("ann", first)
    kept.keep("ann", second)
    assert held(kept, "ann", first, tmp_path)
    kept.keep("ann", third)
    assert [held(kept, "ann", each, tmp_path) for each in (first, second, third)] == [True, False, True]
    assert held(kept, "bob", other, tmp_path)


def test_all_together_take_no_more_than_they_may(kept: KeptAssets, tmp_path: Path) -> None:
    file = received(tmp_path, 15 * b"a")
    for owner in ("ann", "bob", "cat"):
        assert kept.keep(owner, file)
    assert [held(kept, owner, file, tmp_path) for owner in ("ann", "bob", "cat")] == [False, True, True]
    assert len(list((tmp_path / "kept").iterdir())) == 2


def test_a_file_that_takes_more_than_its_owner_may_have_is_not_kept(kept: KeptAssets, tmp_path: Path) -> None:
    small, large = received(tmp_path, b"small"), received(tmp_path, 21 * b"a")
    kept.keep("ann", small)
    assert not kept.keep("ann", large)
    assert held(kept, "ann", small, tmp_path)
