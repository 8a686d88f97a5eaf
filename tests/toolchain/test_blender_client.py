"""The Blender add-on without Blender: meshes to GLB and back, its HTTP client and its thread, against a real server."""

from __future__ import annotations

import subprocess
import threading
import zipfile
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.assets import load_asset
from meshdeform.geometry.shapes import icosphere
from tests.acceptance.service import Service, until
from tests.cases import each_case

glb = pytest.importorskip("meshdeform_blender.glb")
client_module = pytest.importorskip("meshdeform_blender.client")
job_module = pytest.importorskip("meshdeform_blender.job")
control = pytest.importorskip("meshdeform_blender.control")
errors = pytest.importorskip("meshdeform_blender.errors")

TARGET = {"params": {"steps": 5, "checkpoint_every_steps": 5, "guidance": {"kind": "target"}}}


def part(name: str = "ball", matrix: NDArray[np.float64] | None = None, height: float = 1.0) -> Any:
    mesh = icosphere(2)
    positions = (mesh.verts * [1.0, 1.0, height]).astype(np.float32)
    triangles = mesh.faces.astype(np.uint32)
    return glb.Part(name, positions, triangles, np.eye(4) if matrix is None else matrix)


def turned(shear: float = 0.0) -> NDArray[np.float64]:
    """A turn about all axes, an uneven mirrored scale, an offset far away, and, if asked, a shear."""
    axes, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    matrix = np.eye(4)
    matrix[:3, :3] = axes @ np.diag([2.0, -0.5, 3.0])
    matrix[:3, :3] += shear * np.array([[0, 1, 0], [0, 0, 0], [0, 0, 0]])
    matrix[:3, 3] = [100.0, -50.0, 7.0]
    return matrix


@each_case("shear", [0.0, 0.7])
def test_the_service_sees_the_mesh_where_it_stands_and_upright(
    shear: float, validate_glb: Callable[[bytes], dict[str, Any]]
) -> None:
    ball = part(matrix=turned(shear))
    assert validate_glb(glb.write_glb([ball, part("b")]))["issues"]["messages"] == []
    surface = load_asset(glb.write_glb([ball])).surface
    world = ball.positions @ ball.matrix[:3, :3].T + ball.matrix[:3, 3]
    np.testing.assert_allclose(surface.positions, world[:, [0, 2, 1]] * [1, 1, -1], rtol=1e-6)
    volume = np.linalg.det(surface.positions[surface.triangles] - surface.positions.mean(axis=0)).sum()
    assert volume > 0  # mirrored, yet outside is outside


@each_case("shear", [0.0, 0.7])
def test_what_comes_back_is_vertex_by_vertex_what_was_sent(shear: float) -> None:
    parts = [part("a", turned(shear)), part("b", height=2.0)]
    asset = load_asset(glb.write_glb(parts))
    same = glb.read_positions(asset.replace(asset.surface.positions), parts)
    if shear:
        np.testing.assert_allclose(same[0], parts[0].positions, atol=1e-5)
    else:
        np.testing.assert_array_equal(same[0], parts[0].positions)
    np.testing.assert_array_equal(same[1], parts[1].positions)
    moved = asset.surface.positions + [0.0, 1.0, 0.0]  # up by one, in the world
    first, second = glb.read_positions(asset.replace(moved), parts)
    up = np.linalg.inv(parts[0].matrix[:3, :3]) @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(first, parts[0].positions + up, atol=1e-4)
    np.testing.assert_allclose(second, parts[1].positions + [0.0, 0.0, 1.0], atol=1e-6)


def test_vertex_groups_and_empties_mean_the_faces_and_places_of_the_file() -> None:
    parts = [part("a", turned()), part("b", turned(0.7)), part("c")]
    weights = [None, (parts[1].positions[:, 2] > 0.3).astype(np.float32), np.full(len(parts[2].positions), 0.5)]
    [region] = control.region_documents(parts, weights, "Head", "keep")
    items = [item if isinstance(item, list) else [item, item] for item in region["faces"]]
    numbers = np.concatenate([np.arange(first, last + 1) for first, last in items])
    surface = load_asset(glb.write_glb(parts)).surface
    vertices = np.unique(surface.triangles[numbers]) - len(parts[0].positions)
    # Of the second part alone; in the third, no corner weighs more than a half.
    assert (parts[1].positions[vertices, 2] > 0.3).all()
    expected = (parts[1].positions[parts[1].triangles][..., 2] > 0.3).all(1)
    assert len(numbers) == expected.sum() > 10
    # A vertex in Blender's world is where the service has it.
    place = parts[0].matrix[:3, :3] @ parts[0].positions[7] + parts[0].matrix[:3, 3]
    handle = control.handle_document(place, place + [0, 0, 1], 0.5)
    np.testing.assert_allclose(handle["position"], surface.positions[7], rtol=1e-5)
    np.testing.assert_allclose(np.subtract(handle["to"], handle["position"]), [0, 1, 0], atol=1e-9)
    assert handle["weight"] == 0.5
    assert "weight" not in control.handle_document(place, place)
    with pytest.raises(errors.AddonError, match="“Tail”"):
        control.region_documents(parts, [None, None, None], "Tail", "only")


def test_what_cannot_be_sent_is_told_at_once() -> None:
    flat = np.diag([1.0, 1.0, 0.0, 1.0])
    cases = {
        "no faces": lambda: glb.write_glb([glb.Part("x", np.zeros((3, 3), np.float32), np.zeros((0, 3)), np.eye(4))]),
        "zero along": lambda: glb.write_glb([part(matrix=flat)]),
        "No mesh is selected": lambda: glb.write_glb([]),
        "not the address": lambda: client_module.Client("ftp://x"),
        "cannot be read": lambda: glb.read_positions(b"no GLB", [part()]),
        "does not fit": lambda: glb.read_positions(
            glb.write_glb([part()]), [glb.Part("x", np.zeros((3, 3), np.float32), np.zeros((1, 3)), np.eye(4))]
        ),
    }
    for words, call in cases.items():
        with pytest.raises(errors.AddonError, match=words):
            call()


def started(*arguments: Any) -> Any:
    thread = job_module.JobThread(*arguments)
    thread.start()
    return thread


def finished(thread: Any) -> Any:
    thread.join(timeout=240)
    assert not thread.is_alive()
    return thread.status


def test_from_posting_to_the_result_or_the_refusal(service: Service) -> None:
    ball, egg = part(matrix=turned()), part(height=1.6)
    target, asset = glb.write_glb([egg]), glb.write_glb([ball])
    thread = started(str(service.http.base_url), "", asset, 'odd "näme".glb', TARGET, target)
    status = finished(thread)
    assert (status.phase, status.fraction, status.error) == ("succeeded", 1.0, None)
    assert (status.step, status.total_steps) == (5, 5)
    (moved,) = glb.read_positions(thread.result, [ball])
    assert np.abs(moved - ball.positions).max() > 1e-3
    assert thread.result == service.artifact(status.job_id, "result.glb")
    assert client_module.Client(str(service.http.base_url)).version()
    status = finished(started(str(service.http.base_url), "", asset, "a.glb", {"prompt": "a quixotic zeitgeist"}))
    assert (status.phase, status.error.code) == ("failed", "prompt_unknown_words")
    assert "zeitgeist" in status.error.detail
    assert status.error.advice


def test_a_canceled_job_is_canceled_on_the_server(service: Service) -> None:
    request = {"params": {"steps": 50_000, "guidance": {"kind": "target"}}}
    asset = glb.write_glb([part()])
    thread = started(str(service.http.base_url), "", asset, "a.glb", request, asset)
    until("a step", lambda: thread.status.step >= 1)
    thread.cancel()
    assert finished(thread).phase == "canceled"
    assert thread.result is None
    assert service.finished(thread.status.job_id)["state"] == "canceled"


def test_an_answer_that_gets_lost_makes_no_second_job() -> None:
    """The server says that it is busy, then loses its answer; all three requests have the same key."""
    seen: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            self.rfile.read(int(self.headers["content-length"]))
            seen.append(self.headers["idempotency-key"])
            if len(seen) == 2:
                self.close_connection = True
                return
            self.send_response(503 if len(seen) == 1 else 202)
            self.send_header("retry-after", "0.05")
            self.end_headers()
            self.wfile.write(b'{"id": "job_x"}')

        def log_message(self, *arguments: object) -> None:
            pass

    asset = glb.write_glb([part()])
    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        job = client_module.Client(f"http://127.0.0.1:{server.server_port}").submit(
            asset, "a.glb", TARGET, target=asset
        )
        server.shutdown()
    assert job["id"] == "job_x"
    assert (len(seen), len(set(seen))) == (3, 1)
    assert len(seen[0]) >= 32


def test_a_server_that_is_away_is_told_and_waiting_for_it_can_be_ended() -> None:
    from tests.servers import free_port

    url = f"http://127.0.0.1:{free_port()}"
    status = finished(started(url, "", glb.write_glb([part()]), "a.glb", {"prompt": "a mushroom"}))
    assert status.phase == "failed"
    assert "does not answer" in status.error.detail
    stop = threading.Event()
    stop.set()
    with pytest.raises(errors.Canceled):
        client_module.Client(url, stop=stop).submit(b"", "a.glb", {})


def test_the_archive_has_what_blender_needs(repository: Path) -> None:
    built = subprocess.run(
        [repository / "integrations/blender/build"], check=True, capture_output=True, text=True
    ).stdout.strip()
    names = set(zipfile.ZipFile(built).namelist())
    modules = {path.name for path in (repository / "integrations/blender/meshdeform_blender").glob("*.py")}
    assert names == modules | {"blender_manifest.toml", "LICENSE"}
