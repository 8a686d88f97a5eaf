"""The nodes: load an asset, set parameters, deform it by text or towards another mesh, set the strength."""

from __future__ import annotations

from typing import Any, ClassVar

from meshdeform import Client
from meshdeform.requests.choices import Preset
from meshdeform.requests.groups import without_unused

from . import host, parameters
from .jobs import NodeError, explained, run

__all__ = ["NODE_CLASS_MAPPINGS", "NODE_DISPLAY_NAME_MAPPINGS"]

# The names by which workflows refer to the types and the nodes must never change.
_PARAMETERS = "MESHDEFORM_PARAMETERS"
_CATEGORY = "Meshdeform"
_NO_PRESET = "default"
_LARGEST_SEED = 2**53 - 1  # the largest whole number that the browser keeps exactly

_PATH = ("STRING", {"forceInput": True, "tooltip": "A path, from Load 3D Asset, Load 3D, or glb_path of another job."})
_PREFIX = (
    "STRING",
    {"default": "meshdeform/result", "tooltip": "Folder and beginning of the names in ComfyUI's output folder."},
)
_SETTINGS: dict[str, tuple[Any, ...]] = {
    "preset": (
        [_NO_PRESET, *(preset.value for preset in Preset)],
        {
            "default": _NO_PRESET,
            "tooltip": "default: fitted to what the prompt's noun stands for. Others: pushed by a model, balanced, in "
            "few steps (preview), or with the published settings (paper).",
        },
    ),
    "seed": ("INT", {"default": 0, "min": 0, "max": _LARGEST_SEED, "control_after_generate": True}),
    "filename_prefix": _PREFIX,
}
_OPTIONAL = {"parameters": (_PARAMETERS, {"tooltip": "From Deformation Parameters. Without them: the preset's."})}


class LoadAsset:
    """Choose an asset in ComfyUI's input folder."""

    CATEGORY = _CATEGORY
    FUNCTION = "load"
    RETURN_TYPES = ("STRING",)
    RETURN_NAMES = ("asset",)
    DESCRIPTION = "Choose a GLB, OBJ, PLY, STL or ZIP in ComfyUI's input folder or below it."

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:
        """Return the node's inputs."""
        return {
            "required": {"asset": (host.assets(), {"tooltip": "A GLB comes back with its materials, UVs and rig."})}
        }

    @classmethod
    def IS_CHANGED(cls, asset: str) -> str:
        """Return the file's hash: with it ComfyUI runs what follows again once the file is another."""
        return host.digest(asset)

    def load(self, asset: str) -> tuple[str]:
        """Return the asset's path."""
        return (str(host.find(asset)),)


class Parameters:
    """Set parameters of the deformation."""

    CATEGORY = _CATEGORY
    FUNCTION = "collect"
    RETURN_TYPES = (_PARAMETERS,)
    RETURN_NAMES = ("parameters",)
    DESCRIPTION = "Overrides of the preset. `preset` and -1 mean: the preset's value."

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:
        """Return the node's inputs."""
        return {"required": parameters.inputs()}

    @classmethod
    def VALIDATE_INPUTS(cls, **values: Any) -> bool | str:
        """Check the values before anything runs."""
        return parameters.problem(values) or True

    def collect(self, **values: Any) -> tuple[dict[str, Any]]:
        """Return the parameters that are set."""
        try:
            return (parameters.wanted(values),)
        except ValueError as error:
            raise NodeError(str(error)) from error


class _Job:
    """The common part of the nodes that run a job."""

    CATEGORY = _CATEGORY
    OUTPUT_NODE = True
    RETURN_TYPES: ClassVar = ("STRING", "STRING", "IMAGE", "STRING")
    RETURN_NAMES: ClassVar = ("glb_path", "model_file", "preview", "job_id")
    OUTPUT_TOOLTIPS: ClassVar = (
        "The result's full path, for further nodes.",
        "Its path within the output folder, for Preview 3D.",
        "Source and result from several sides.",
        "The job on the service, for Deformation Strength.",
    )

    @staticmethod
    def _run(
        asset: str,
        prompt: str,
        sent_params: dict[str, Any] | None,
        target: str | None,
        *,
        preset: str,
        seed: int,
        filename_prefix: str,
    ) -> dict[str, Any]:
        params = {**(sent_params or {}), **({} if preset == _NO_PRESET else {"preset": preset}), "seed": seed}
        if target is not None:
            params = without_unused({**params, "guidance": {**params.get("guidance", {}), "kind": "target"}})
        with explained():
            job = run(
                host.find(asset),
                prompt,
                params,
                target=None if target is None else host.find(target),
                check=host.check_interrupted,
                progress=host.progress_bar(),
            )
            names = host.output(filename_prefix)
            with Client() as client:
                client.download(job, "preview.png", names.path(".png"))
                client.download(job, "result.glb", names.path(".glb"))
        shown = {"filename": names.path(".png").name, "subfolder": names.subfolder, "type": "output"}
        preview = host.image(names.path(".png").read_bytes())
        return {
            "ui": {"images": [shown]},
            "result": (str(names.path(".glb")), names.relative(".glb"), preview, job.id),
        }


class DeformByText(_Job):
    """Deform an asset towards a prompt."""

    FUNCTION = "deform"
    DESCRIPTION = (
        "Deform an asset towards a prompt, on the service that MESHDEFORM_URL names. Topology, UVs, materials and rig "
        "stay as they are. Cancel stops the job on the service, too."
    )

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:
        """Return the node's inputs."""
        prompt = ("STRING", {"default": "a mushroom", "multiline": True, "tooltip": "The new shape, in words."})
        return {"required": {"asset": _PATH, "prompt": prompt, **_SETTINGS}, "optional": _OPTIONAL}

    def deform(
        self, asset: str, prompt: str, parameters: dict[str, Any] | None = None, **settings: Any
    ) -> dict[str, Any]:
        """Run the job and fetch its result."""
        return self._run(asset, prompt, parameters, None, **settings)


class FitToMesh(_Job):
    """Give an asset the shape of another mesh."""

    FUNCTION = "fit"
    DESCRIPTION = "Give an asset the shape of another mesh, and keep its own topology, UVs, materials and rig."

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:
        """Return the node's inputs."""
        return {"required": {"asset": _PATH, "target": _PATH, **_SETTINGS}, "optional": _OPTIONAL}

    def fit(self, asset: str, target: str, parameters: dict[str, Any] | None = None, **settings: Any) -> dict[str, Any]:
        """Run the job and fetch its result."""
        return self._run(asset, "", parameters, target, **settings)


class Strength:
    """Take the result of a job at another strength."""

    CATEGORY = _CATEGORY
    FUNCTION = "apply"
    OUTPUT_NODE = True
    RETURN_TYPES = ("STRING", "STRING")
    RETURN_NAMES = ("glb_path", "model_file")
    DESCRIPTION = "Take the result of a job at another strength: 0 is the source, 1 the result, 1.5 goes beyond it."

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:
        """Return the node's inputs."""
        return {
            "required": {
                "job_id": ("STRING", {"forceInput": True}),
                "strength": ("FLOAT", {"default": 0.5, "min": 0.0, "max": 1.5, "step": 0.01}),
                "filename_prefix": _PREFIX,
            }
        }

    def apply(self, job_id: str, strength: float, filename_prefix: str) -> tuple[str, str]:
        """Fetch the result at a strength."""
        names = host.output(filename_prefix)
        with explained(), Client() as client:
            client.download(job_id, "result.glb", names.path(".glb"), strength=round(strength, 2))
        return str(names.path(".glb")), names.relative(".glb")


NODE_CLASS_MAPPINGS: dict[str, type[Any]] = {
    "MeshdeformLoadAsset": LoadAsset,
    "MeshdeformParameters": Parameters,
    "MeshdeformDeform": DeformByText,
    "MeshdeformFit": FitToMesh,
    "MeshdeformStrength": Strength,
}
NODE_DISPLAY_NAME_MAPPINGS = {
    "MeshdeformLoadAsset": "Load 3D Asset",
    "MeshdeformParameters": "Deformation Parameters",
    "MeshdeformDeform": "Deform 3D Asset by Text",
    "MeshdeformFit": "Fit 3D Asset to Mesh",
    "MeshdeformStrength": "Deformation Strength",
}
