"""Start the one deformation that this Blender may run at a time, poll it, and apply its result to the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import bpy

from . import control, meshes
from .client import Client, is_loopback
from .errors import AddonError
from .glb import read_positions, write_glb
from .job import OVER, JobThread, Status


@dataclass
class Session:
    """The state that the panel shows."""

    job: JobThread | None = None  # the running job
    # How the last job ended
    message: str = ""
    is_error: bool = False
    _sources: list[meshes.Source] = field(default_factory=list)
    _how: meshes.Apply = "SHAPE_KEY"
    _name: str = ""

    @property
    def status(self) -> Status | None:
        """The status of the running job, if any."""
        return self.job.status if self.job else None

    def start(self, objects: Sequence[Any], settings: Any, preferences: Any) -> None:
        """Read the meshes and start sending them; returns at once."""
        if self.job:
            raise AddonError("A deformation is running.", "Wait for it, or cancel it.")
        Client(preferences.url)  # raises if it is not an address
        if not is_loopback(preferences.url) and not bpy.app.online_access:
            raise AddonError(
                "Blender may not use the network.", "Allow it: Preferences > System > Allow Online Access."
            )
        target_object = settings.target if settings.guidance == "target" else None
        if settings.guidance == "target" and target_object is None:
            raise AddonError("There is no target.", "Choose the object to use as the target shape.")
        sources = meshes.gather([obj for obj in objects if obj != target_object])
        target = write_glb([source.part for source in meshes.gather([target_object])]) if target_object else None
        asset = write_glb([source.part for source in sources])
        name = sources[0].part.name
        request = settings.request()
        request["params"]["control"] = _control(sources, settings)
        job = JobThread(preferences.url, preferences.api_key, asset, f"{name}.glb", request, target)
        self._sources, self._how = sources, settings.apply
        self._name = settings.prompt.strip() or (target_object.name if target_object else "Meshdeform")
        self.job, self.message, self.is_error = job, "", False
        job.start()

    def poll(self) -> str:
        """Check the job and apply its result once it is there; never waits.

        Returns
        -------
        "running", "applied", "failed" or "canceled".
        """
        if self.job is None:
            return "canceled"
        status = self.job.status
        if status.phase not in OVER:
            return "running"
        if status.phase == "succeeded" and not meshes.is_ready(self._sources):
            self.message = "Change to Object Mode to get the result."
            return "running"
        result, self.job = self.job.result, None
        if status.phase == "canceled":
            return self._end("canceled", "Canceled.")
        if status.error is not None:
            return self._end("failed", status.error.text)
        try:
            positions = read_positions(result or b"", [source.part for source in self._sources])
            remarks = meshes.apply(self._sources, positions, self._how, self._name[:60])
        except AddonError as error:
            return self._end("failed", f"{error.text} (The result is kept on the server as {status.job_id}.)")
        return self._end("applied", " ".join(remarks) or "Done.")

    def cancel(self) -> None:
        """Cancel the running job and forget it; returns at once."""
        if self.job:
            self.job.cancel()
            self.job = None
            self._end("canceled", "Canceled.")

    def _end(self, how: str, message: str) -> str:
        self.message, self.is_error, self._sources = message, how == "failed", []
        return how


def _control(sources: Sequence[meshes.Source], settings: Any) -> dict[str, Any]:
    """Return the parameters that say where the meshes may deform."""
    params: dict[str, Any] = {}
    if settings.region != "none" and settings.group:
        parts = [source.part for source in sources]
        weights = meshes.group_weights(sources, settings.group)
        params["regions"] = control.region_documents(parts, weights, settings.group, settings.region)
    elif settings.region != "none":
        raise AddonError("There is no vertex group.", "Choose one, or set Region to None.")
    if settings.handles:
        bpy.context.view_layer.update()  # places that a script has set count, too
        empties = [obj for obj in settings.handles.objects if obj.type == "EMPTY" and HANDLE_START in obj]
        params["handles"] = [
            control.handle_document(obj[HANDLE_START], obj.matrix_world.translation, settings.handle_weight)
            for obj in empties
        ]
        if not empties:
            raise AddonError(f"The collection “{settings.handles.name}” has no handles.", "Add some with Add Handle.")
    if settings.symmetry != "none":
        params["symmetry"] = settings.symmetry
    return params


HANDLE_START = "meshdeform_start"
"""The custom property of an empty with the place at which it was added, that is, the point that it takes along."""

current = Session()
