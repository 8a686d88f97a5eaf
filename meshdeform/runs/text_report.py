"""The report of a `text_deform` run; what it says was kept is compared with the written file, read back."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from torch import Tensor

from meshdeform.assets import Asset, load_asset
from meshdeform.assets.limits import Limits
from meshdeform.assets.usd import Usdz
from meshdeform.geometry.quality import measure
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.requests.document import JobRequest, ResolvedParams
from meshdeform.runs.report import LossHistory, PhaseClock, sha256_hex, versions

__all__ = ["RunFacts", "build_report", "read_result"]

_UNBOUNDED = Limits(
    max_bytes=2**40,
    max_json_bytes=2**40,
    max_accessor_elements=2**40,
    max_triangles=2**40,
    max_bare_elements=2**40,
    max_json_values=2**40,
    max_primitives=2**40,
)
"""For our own output: the input has passed the limits, and the output is a little larger."""


@dataclass(frozen=True)
class RunFacts:
    """What is known of a run before its first step."""

    request: JobRequest
    params: ResolvedParams
    asset_sha256: str
    asset_bytes: int
    filename: str
    guidance: dict[str, str]
    fingerprint: str
    device: str


def build_report(
    facts: RunFacts,
    *,
    asset: Asset,
    welded: WeldedMesh,
    verts: Tensor,
    result: bytes,
    written: Asset,
    usdz: Usdz | None = None,
    history: LossHistory,
    first_step: int,
    clock: PhaseClock,
    not_drawn: dict[str, int],
    likeness: dict[str, Any] | None = None,
) -> bytes:
    """Make `report.json`.

    Parameters
    ----------
    facts : RunFacts
    asset : Asset
        The source.
    welded : WeldedMesh
    verts : (V, 3) float64
        Deformed welded positions in the world.
    result : bytes
        `result.glb`.
    written : Asset
        The same, read back: a mistake of the writer shows only there.
    usdz : Usdz, optional
        `result.usdz`, where it was asked for.
    history : LossHistory
    first_step : int
        Steps that an earlier attempt had done.
    clock : PhaseClock
    not_drawn : dict of str to int
        Parts of the asset's look that `preview.png` does not show, with counts.
    likeness : dict, optional
        How much the result looks like its prompt.
    """
    with clock.phase("measure"):
        quality = measure(welded.mesh.verts.numpy(), welded.mesh.faces.numpy(), verts.numpy())
        invariants = _invariants(asset, written)
    losses = history.to_list()
    report: dict[str, Any] = {
        "kind": facts.request.kind.value,
        "prompt": facts.request.prompt,
        "params": facts.params.model_dump(mode="json"),
        "seed": facts.params.seed,
        "metadata": facts.request.metadata,
        "input": {"filename": facts.filename, "bytes": facts.asset_bytes, "sha256": facts.asset_sha256},
        "guidance": facts.guidance,
        "fingerprint": facts.fingerprint,
        "device": facts.device,
        "versions": versions(),
        "result": {"bytes": len(result), "sha256": sha256_hex(result)},
        "mesh": {
            "source_vertices": len(asset.surface.positions),
            "source_triangles": len(asset.surface.triangles),
            "welded_vertices": welded.mesh.verts.shape[0],
            "welded_faces": welded.mesh.faces.shape[0],
            **invariants,
        },
        "quality": quality.to_dict(),
        "skipped": {**welded.skipped, "primitives": asset.surface.skipped},
        "losses": losses,
        "resumed_from_step": first_step,
        "seconds": {k: round(v, 4) for k, v in clock.seconds.items()},
    }
    if likeness is not None:
        report["likeness"] = likeness
    if not_drawn:
        report["preview"] = {"left_out": not_drawn}
    if usdz is not None:
        report["usd"] = {
            "bytes": len(usdz.data),
            "sha256": sha256_hex(usdz.data),
            "meshes": usdz.meshes,
            "left_out": usdz.left_out,
        }
    return json.dumps(report, indent=2, allow_nan=False, default=str).encode()


def read_result(result: bytes) -> Asset:
    """Read our own `result.glb` back, whatever the limits were for its source."""
    return load_asset(result, "result.glb", _UNBOUNDED)


def _invariants(source: Asset, result: Asset) -> dict[str, bool]:
    old, new = source.surface, result.surface
    return {
        "same_vertex_count": len(old.positions) == len(new.positions),
        "same_faces": bool(np.array_equal(old.triangles, new.triangles)),
        "same_uvs": source.texture_coordinates() == result.texture_coordinates(),
    }
