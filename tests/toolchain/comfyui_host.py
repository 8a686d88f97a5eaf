"""A stand-in for what the nodes use of ComfyUI, whose package cannot be installed: its folders and its workflows.

Names, arguments and rules are those of ComfyUI's `folder_paths`, `comfy.utils` and `comfy.model_management`.
"""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

__all__ = ["Host", "InterruptProcessingException", "ready_prompt"]


class InterruptProcessingException(Exception):
    """What ComfyUI raises in a node when somebody presses Cancel."""


class Host:
    """Its three modules, in `modules`; `shown` has what the progress bar has shown, from 0 to 1."""

    def __init__(self, folder: Path) -> None:
        self.input, self.output, self.temp = folder / "input", folder / "output", folder / "temp"
        for path in (self.input, self.output, self.temp):
            path.mkdir(parents=True)
        self.interrupted = False
        self.shown: list[float] = []

    @property
    def modules(self) -> dict[str, Any]:
        """The modules by name."""
        folders = {"input": self.input, "output": self.output, "temp": self.temp}
        paths = {f"get_{name}_directory": lambda at=path: str(at) for name, path in folders.items()}
        found = SimpleNamespace(**paths, get_annotated_filepath=self._annotated, get_save_image_path=_save_path)
        utils = SimpleNamespace(ProgressBar=self._bar)
        management = SimpleNamespace(throw_exception_if_processing_interrupted=self._throw_if_interrupted)
        comfy = SimpleNamespace(utils=utils, model_management=management)
        return {"folder_paths": found, "comfy": comfy, "comfy.utils": utils, "comfy.model_management": management}

    def _bar(self, total: int) -> Any:
        def update_absolute(value: int, total: int = total, preview: object = None) -> None:
            self.shown.append(value / total)

        return SimpleNamespace(update_absolute=update_absolute)

    def _throw_if_interrupted(self) -> None:
        if self.interrupted:
            self.interrupted = False
            raise InterruptProcessingException

    def _annotated(self, name: str) -> str:
        for kind, folder in (("output", self.output), ("input", self.input), ("temp", self.temp)):
            if name.endswith(f"[{kind}]"):
                return str(folder / name.removesuffix(f"[{kind}]").rstrip())
        return str(self.input / name)  # a full path stays what it is


def _save_path(prefix: str, output_dir: str) -> tuple[str, str, int, str, str]:
    subfolder, _, name = prefix.rpartition("/")
    folder = Path(output_dir) / subfolder
    assert folder.resolve().is_relative_to(output_dir)
    folder.mkdir(parents=True, exist_ok=True)
    numbers = [int(path.name[len(name) + 1 :].split("_")[0]) for path in folder.glob(f"{name}_*_.*")]
    return str(folder), name, max(numbers, default=0) + 1, subfolder, prefix


def load_nodes(folder: Path) -> ModuleType:
    """Import a folder of nodes as ComfyUI does: by its `__init__.py`, under a name with its path."""
    name = str(folder).replace(".", "_x_")
    spec = importlib.util.spec_from_file_location(name, folder / "__init__.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def widgets(kind: type[Any]) -> list[str]:
    """The inputs of a node that are widgets, in the order of a workflow's `widgets_values`."""
    names = []
    declared = kind.INPUT_TYPES()
    for name, (type_, *options) in {**declared["required"], **declared.get("optional", {})}.items():
        about = options[0] if options else {}
        if isinstance(type_, list) or (type_ in {"INT", "FLOAT", "STRING"} and not about.get("forceInput")):
            names.append(name)
            if about.get("control_after_generate"):
                names.append("")  # a widget of the page alone
    return names


def ready_prompt(workflow: Path, kinds: dict[str, type[Any]]) -> list[tuple[int, str, dict[str, Any]]]:
    """Return a workflow's own nodes in the order of their run: id, type and inputs; a link is `(node, output)`."""
    document = json.loads(workflow.read_text())
    links = {link[0]: (link[1], link[2]) for link in document["links"]}
    nodes = []
    for node in sorted(document["nodes"], key=lambda node: node["order"]):
        if node["type"] not in kinds:
            continue
        names = widgets(kinds[node["type"]])
        assert len(names) == len(node["widgets_values"]), node["type"]
        values = {name: value for name, value in zip(names, node["widgets_values"], strict=True) if name}
        linked = {slot["name"]: links[slot["link"]] for slot in node["inputs"] if slot.get("link") is not None}
        nodes.append((node["id"], node["type"], {**values, **linked}))
    return nodes
