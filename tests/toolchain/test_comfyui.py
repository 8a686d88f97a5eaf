"""The ComfyUI nodes: loaded as ComfyUI loads them, without torch, and run against a real service."""

from __future__ import annotations

import contextlib
import json
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from meshdeform.assets import load_asset
from tests.acceptance.service import Service, until
from tests.cases import each_case
from tests.toolchain.comfyui_host import Host, InterruptProcessingException, load_nodes, ready_prompt

NODES = Path(__file__).parents[2] / "integrations/comfyui"
WORKFLOW = NODES / "example_workflows/deform_by_text.json"
kinds: dict[str, type[Any]] = load_nodes(NODES).NODE_CLASS_MAPPINGS


@pytest.fixture
def host(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, repository: Path) -> Host:
    """ComfyUI's folders and modules, with the sphere as input."""
    host = Host(tmp_path)
    for name, module in host.modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    shutil.copy(repository / "examples/sphere.glb", host.input)
    return host


@pytest.fixture
def address(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    """The nodes find the service as users tell them: by the environment."""
    monkeypatch.setenv("MESHDEFORM_URL", str(service.http.base_url))


def deform(**values: Any) -> dict[str, Any]:
    """Run the deform node with few steps."""
    kind = kinds["MeshdeformDeform"]
    params = {"steps": 2, "guidance": {"orientation": "keep"}}
    given = {"asset": "sphere.glb", "prompt": "a mushroom", "preset": "preview", "seed": 7, "filename_prefix": "out"}
    return dict(getattr(kind(), kind.FUNCTION)(**{"parameters": params, **given, **values}))


def test_loading_the_nodes_loads_neither_torch_nor_comfyui() -> None:
    probe = (
        "import sys; sys.path.insert(0, sys.argv[1]); from comfyui import NODE_CLASS_MAPPINGS as kinds; "
        "kinds['MeshdeformParameters'].INPUT_TYPES(); kinds['MeshdeformDeform'].INPUT_TYPES(); "
        "print({'torch', 'numpy', 'PIL', 'comfy', 'folder_paths'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", probe, NODES.parent], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_a_new_node_of_parameters_has_those_of_the_page_and_asks_for_nothing(repository: Path) -> None:
    api = json.loads((repository / "openapi/openapi.json").read_text())
    schemas = (api["components"]["schemas"][name] for name in ("DeformParams", "PromptGuidanceParams", "ControlParams"))
    declared = {name: member for schema in schemas for name, member in schema["properties"].items()}
    widgets = kinds["MeshdeformParameters"].INPUT_TYPES()["required"]
    assert list(widgets) == [*(name for name, member in declared.items() if "x-form" in member), "more"]
    defaults = {name: about["default"] for name, (_, about) in widgets.items()}
    assert kinds["MeshdeformParameters"]().collect(**defaults) == ({},)


@each_case(
    ("values", "said"),
    [
        ({"steps": 0}, "steps: Input should be greater than or equal to 1"),
        ({"more": "{"}, "more: this is not JSON"),
        ({"more": "[1]"}, "more: write a JSON object"),
        ({"more": '{"seed": 1}'}, "more: seed is set in the node that starts the job"),
        ({"steps": 3, "more": '{"steps": 4}'}, "more: steps is already set above"),
        ({"steps": 3, "more": '{"guidance": {"kind": "target"}}'}, "more: kind is set in the node"),
        ({"orientation": "90", "more": '{"guidance": {"orientation": 0}}'}, "more: orientation is already set above"),
        ({"more": '{"control": {"symmetry": "q"}}'}, "control.symmetry"),
    ],
)
def test_a_wrong_parameter_is_refused_before_anything_runs(values: dict[str, Any], said: str) -> None:
    assert said in kinds["MeshdeformParameters"].VALIDATE_INPUTS(**values)
    with pytest.raises(RuntimeError, match=said.split(":")[0]):
        kinds["MeshdeformParameters"]().collect(**values)


@each_case(
    "more",
    [
        '{"symmetry": "auto", "negative_prompt": "a"}',
        '{"control": {"symmetry": "auto"}, "guidance": {"negative_prompt": "a"}}',
    ],
)
def test_what_the_widgets_say_is_what_is_sent(more: str) -> None:
    values = {"steps": 5, "learning_rate": -1.0, "orientation": "90", "more": more, "carrier": None}
    assert kinds["MeshdeformParameters"].VALIDATE_INPUTS(**values) is True
    guidance = {"orientation": 90.0, "negative_prompt": "a"}
    sent = {"steps": 5, "guidance": guidance, "control": {"symmetry": "auto"}}
    assert kinds["MeshdeformParameters"]().collect(**values) == (sent,)


def test_assets_are_found_below_the_folders_of_comfyui_and_nowhere_else(host: Host, tmp_path: Path) -> None:
    (host.input / "3d").mkdir()
    (host.input / "3d/cow.OBJ").write_text("v 0 0 0")
    (host.input / "picture.png").touch()
    (host.output / "old.glb").touch()
    load = kinds["MeshdeformLoadAsset"]
    assert load.INPUT_TYPES()["required"]["asset"][0] == ["3d/cow.OBJ", "sphere.glb"]
    assert load().load("3d/cow.OBJ") == (str(host.input / "3d/cow.OBJ"),)
    assert load().load("old.glb [output]") == (str(host.output / "old.glb"),)
    assert load().load(str(host.output / "old.glb")) == (str(host.output / "old.glb"),)
    before = load.IS_CHANGED("3d/cow.OBJ")
    (host.input / "3d/cow.OBJ").write_text("v 0 0 1")
    assert load.IS_CHANGED("3d/cow.OBJ") != before
    (tmp_path / "secret.glb").touch()
    for outside in ("../secret.glb", str(tmp_path / "secret.glb"), "/etc/passwd"):
        with pytest.raises(RuntimeError, match="outside"):
            load().load(outside)
    for missing in ("none.glb", "", str(host.input)):
        with pytest.raises(RuntimeError, match=r"no file|no asset"):
            load().load(missing)


@pytest.mark.usefixtures("address")
def test_the_example_workflow_runs(host: Host, service: Service, repository: Path) -> None:
    document = json.loads(WORKFLOW.read_text())
    types = {node["id"]: node["type"] for node in document["nodes"]}
    results: dict[int, tuple[Any, ...]] = {}
    for number, name, inputs in ready_prompt(WORKFLOW, kinds):
        kind = kinds[name]
        for slot, value in inputs.items():
            if isinstance(value, tuple):
                source = kinds[types[value[0]]]
                declared = {**kind.INPUT_TYPES()["required"], **kind.INPUT_TYPES().get("optional", {})}
                assert source.RETURN_TYPES[value[1]] == declared[slot][0]
                inputs[slot] = results[value[0]][value[1]]
        if name == "MeshdeformParameters":
            inputs |= {"steps": 2, "orientation": "keep"}
            assert kind.VALIDATE_INPUTS(**inputs) is True
        found = getattr(kind(), kind.FUNCTION)(**inputs)
        results[number] = found["result"] if isinstance(found, dict) else found
        if isinstance(found, dict):
            (shown,) = found["ui"]["images"]
            assert (host.output / shown["subfolder"] / shown["filename"]).is_file()
    glb_path, model_file, preview, job_id = next(result for result in results.values() if len(result) == 4)
    assert model_file == "meshdeform/mushroom_00001_.glb"
    assert Path(glb_path) == host.output / model_file
    assert Path(glb_path).read_bytes() == service.artifact(job_id, "result.glb")
    assert preview.shape[0] == 1
    assert preview.shape[3] == 3
    assert preview.dtype == torch.float32
    assert 0.0 <= float(preview.min()) < float(preview.max()) <= 1.0
    assert host.shown == sorted(host.shown)
    guidance = {"kind": "sds", "orientation": "keep"}  # steps are the optimiser's
    assert service.job(job_id)["params"] == {"seed": 7, "steps": 2, "guidance": guidance}
    # Half of the way, by the node after it.
    half = load_asset((host.output / "meshdeform/half_00001_.glb").read_bytes()).surface.positions
    source = load_asset((repository / "examples/sphere.glb").read_bytes()).surface.positions
    whole = load_asset(Path(glb_path).read_bytes()).surface.positions
    assert 0.0 < abs(half - source).max() < abs(whole - source).max()


@pytest.mark.usefixtures("address")
def test_an_asset_is_fitted_to_a_mesh_and_names_are_never_reused(
    host: Host, service: Service, repository: Path
) -> None:
    shutil.copy(repository / "examples/cube.glb", host.input)
    kind = kinds["MeshdeformFit"]
    (host.output / "fit_00001_.glb").write_bytes(b"the one before")
    found = kind().fit("cube.glb", "cube.glb", {"steps": 1}, preset="preview", seed=0, filename_prefix="fit")
    path, model_file, _, job_id = found["result"]
    assert model_file == "fit_00002_.glb"
    assert Path(path).read_bytes() == service.artifact(job_id, "result.glb")
    assert (host.output / "fit_00001_.glb").read_bytes() == b"the one before"
    assert service.job(job_id)["params"]["guidance"] == {"kind": "target"}


@pytest.mark.usefixtures("address")
def test_cancel_stops_the_job_on_the_service(host: Host, service: Service) -> None:
    def newest() -> dict[str, Any] | None:
        (job,) = service.http.get("/v1/jobs", params={"limit": 1}).json()["jobs"]
        return dict(job) if job["prompt"] == "a tall thin vase" and job["progress"]["step"] >= 1 else None

    def press() -> None:
        until("the job runs", newest)
        host.interrupted = True

    with service.held_jobs():
        button = threading.Thread(target=press)
        button.start()
        with pytest.raises(InterruptProcessingException):
            deform(prompt="a tall thin vase", parameters={"steps": 50, "guidance": {"orientation": "keep"}})
        button.join()
    (job,) = service.http.get("/v1/jobs", params={"limit": 1}).json()["jobs"]
    assert service.finished(job["id"])["state"] == "canceled"
    assert list(host.output.iterdir()) == []


@pytest.mark.usefixtures("address")
def test_errors_say_what_to_do(host: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(RuntimeError, match=r"zeitgeist.*Try .*\(prompt_unknown_words, request req_"):
        deform(prompt="a quixotic zeitgeist")
    (host.input / "bad.glb").write_bytes(b"no glTF")
    with pytest.raises(RuntimeError, match=r"\(asset_format"):
        deform(asset="bad.glb")
    monkeypatch.setenv("MESHDEFORM_URL", "meshes.example")
    with pytest.raises(ValueError, match=r"meshes\.example"):
        deform()


def test_a_short_outage_is_waited_out_and_a_long_one_is_not(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    jobs = sys.modules[kinds["MeshdeformDeform"].__module__.replace(".nodes", ".jobs")]
    clock = [0.0]

    class Clock:
        monotonic = staticmethod(lambda: clock[0])

        @staticmethod
        def sleep(seconds: float) -> None:
            clock[0] += seconds

    def job() -> Any:
        return SimpleNamespace(state=SimpleNamespace(terminal=clock[0] >= 700), progress=SimpleNamespace(fraction=0.5))

    def service(answers: Callable[[float], bool]) -> Callable[..., Any]:
        def get(_: object) -> Any:
            if not answers(clock[0]):
                raise jobs.UnavailableError("away")
            return job()

        client = SimpleNamespace(submit=lambda *_, **__: job(), get=get, wait=lambda _: job())
        return lambda **_: contextlib.nullcontext(client)

    monkeypatch.setattr(jobs, "time", Clock)
    run = {"check": lambda: None, "progress": lambda fraction: None}
    monkeypatch.setattr(jobs, "Client", service(lambda now: not 100 < now < 380))
    assert jobs.run(tmp_path, "a mushroom", {}, **run).state.terminal
    clock[0] = 0.0
    monkeypatch.setattr(jobs, "Client", service(lambda now: now < 100))
    with pytest.raises(jobs.UnavailableError):
        jobs.run(tmp_path, "a mushroom", {}, **run)
    assert 400 <= clock[0] < 420
