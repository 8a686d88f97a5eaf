"""Lessons are posted to a service by the client and by the command line."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from meshdeform.cli.app import app
from meshdeform.client.orders import packed_meshes
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from tests.client_flavors import opened
from tests.in_process import children_in_process
from tests.integration.conftest import serving


@pytest.fixture
def pots(tmp_path: Path) -> Path:
    """Return a folder of two meshes, one of them labelled, with other files beside them."""
    import trimesh

    folder = tmp_path / "pots"
    (folder / "tall").mkdir(parents=True)
    (folder / ".hidden").mkdir()
    for place in ("round.glb", "tall/can.stl", ".hidden/no.glb"):
        trimesh.creation.icosphere(1).export(folder / place)
    (folder / "notes.txt").write_text("no mesh")
    return folder


@pytest.fixture
def url(tmp_path: Path, redis_url: str) -> Iterator[str]:
    settings = Settings(data_dir=tmp_path / "data", redis_url=redis_url, queue="test-lessons")
    with children_in_process(), serving(settings) as found:
        yield found


def names_in(packed: object) -> list[str]:
    assert isinstance(packed, bytes)
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        return archive.namelist()


def test_meshes_are_packed_with_the_names_of_their_folders(pots: Path) -> None:
    packed, filename = packed_meshes(pots)
    assert (names_in(packed), filename) == (["round.glb", "tall/can.stl"], "meshes.zip")
    assert packed_meshes(pots)[0] == packed
    assert names_in(packed_meshes([pots / "tall", pots / "round.glb"])[0]) == ["can.stl", "round.glb"]
    assert packed_meshes(pots / "round.glb") == (pots / "round.glb", None)
    assert packed_meshes(b"glTF") == (b"glTF", None)
    with pytest.raises(ValueError, match=r"Two meshes are called round\.glb"):
        packed_meshes([pots, pots / "round.glb"])
    with pytest.raises(ValueError, match="There is no mesh"):
        packed_meshes([])


@pytest.mark.parametrize("flavor", ["sync", "async"])
def test_a_client_posts_a_lesson(url: str, pots: Path, flavor: str) -> None:
    with opened(flavor, url) as client:
        job = client.teach("a gnome", pots, params={"synonyms": ["dwarf"]}, metadata={"from": "test"})
        assert (str(job.kind), list(job.files), job.metadata) == ("prior_teach", ["meshes"], {"from": "test"})
        params = job.as_json()["params"]
        assert (params["noun"], params["synonyms"]) == ("a gnome", ["dwarf"])


def test_the_command_line_posts_a_lesson(url: str, pots: Path, tmp_path: Path) -> None:
    lesson = ["teach", str(pots), "--noun", "a gnome", "--detach", "--url", url]
    done = CliRunner().invoke(app, [*lesson, "--synonym", "dwarf", "--steps", "7"])
    assert done.exit_code == 0, done.output
    record = JobRecord(Settings(data_dir=tmp_path / "data").resolved_database_url)
    job = record.get(done.stdout.strip().splitlines()[-1])
    record.close()
    params = job.request.params.model_dump()
    assert (params["noun"], params["synonyms"], params["steps"]) == ("a gnome", ["dwarf"], 7)
    refused = CliRunner().invoke(app, [*lesson, "--checkpoint", "x.state"])
    assert refused.exit_code == 2
    assert "on this machine, not for a service" in " ".join(refused.output.replace("│", " ").split())
    known = CliRunner().invoke(app, ["teach", str(pots), "--noun", "a chair", "--detach", "--url", url])
    assert known.exit_code == 3
    assert "knows 'chair' already" in known.output
