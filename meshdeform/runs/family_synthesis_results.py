"""Write the results of `family_synthesize`: the shapes, their points, the report and the picture."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset, Limits, load_asset
from meshdeform.assets.family_file import FamilyFile
from meshdeform.assets.wall import WallShape
from meshdeform.requests.choices import SynthesisMode
from meshdeform.requests.family import FamilySynthesisParams
from meshdeform.runs.base import ArtifactData, versions
from meshdeform.runs.family_results import assets_png, packed_arrays, wall, wall_shape


@dataclass(frozen=True)
class SynthesisResults:
    """What a finished run has made. Attributes as in `FamilySynthesisRun`."""

    family: FamilyFile
    params: FamilySynthesisParams
    limits: Limits
    digests: dict[str, str]
    members: list[int]
    energies: list[float]
    defects: NDArray[np.float64]
    shapes: list[bytes]
    about: list[dict[str, Any]]
    drawn: list[tuple[NDArray[np.float64], NDArray[np.bool_]]]
    load: Callable[[int], Asset]

    def artifacts(self) -> dict[str, ArtifactData]:
        """Return all artifacts by name."""
        search = self.params.mode is SynthesisMode.SEARCH
        found = self._neighbours() if search else None
        made: dict[str, ArtifactData] = {}
        if found is None:
            glb = "model/gltf-binary"
            made["result.glb"] = ArtifactData(self.shapes[0], glb)
            made["shapes.zip"] = ArtifactData(self._packed(), "application/zip")
            points, exists = (np.stack([each[i] for each in self.drawn]) for i in (0, 1))
            arrays = {"points": points, "exists": exists, "part": self.family.labels}
            made["points.npz"] = ArtifactData(packed_arrays(arrays), "application/x-npz")
            pictures = [load_asset(shape, self._name(n), self.limits) for n, shape in enumerate(self.shapes)]
            titles = [str(number) for number in range(len(pictures))]
            shapes = [self._shape(number, asset) for number, asset in enumerate(pictures)]
        else:
            rows = [self.members[0], *(self.family.names.index(each["name"]) for each in found)]
            pictures = [self.load(row) for row in rows]
            titles = [self.family.names[row] for row in rows]
            shapes = [self._member(row, asset, len(rows)) for row, asset in zip(rows, pictures, strict=True)]
        made["wall.glb"] = wall(shapes, self.family.parts, self.family.labels)
        made["preview.png"] = ArtifactData(assets_png(pictures, titles), "image/png")
        made["report.json"] = ArtifactData(self._report(found), "application/json")
        return made

    def _shape(self, number: int, asset: Asset) -> WallShape:
        parts, frame = asset.parts(), self.about[number]["frame"]
        found = np.zeros(len(asset.surface.triangles), np.uint8)
        for node in parts.nodes:
            found[parts.in_node(node["index"])] = self.family.parts.index(node["name"])
        points, exists = self.drawn[number]
        return wall_shape(
            self._name(number),
            asset.surface.positions,
            asset.surface.triangles,
            found,
            points,
            exists.astype(np.float32),
            centre=np.array(frame["centre"]),
            diagonal=frame["diagonal"],
            turn=0.0,
            count=len(self.shapes),
        )

    def _member(self, row: int, asset: Asset, count: int) -> WallShape:
        family, surface = self.family, asset.surface
        return wall_shape(
            family.names[row],
            surface.positions,
            surface.triangles,
            family.segments[row],
            family.points[row],
            family.exists[row].astype(np.float32),
            centre=family.centres[row],
            diagonal=float(family.diagonals[row]),
            turn=float(family.turns[row]),
            count=count,
        )

    @staticmethod
    def _name(number: int) -> str:
        return f"shape_{number:02d}.glb"

    def _packed(self) -> bytes:
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
            for number, shape in enumerate(self.shapes):
                archive.writestr(zipfile.ZipInfo(self._name(number)), shape)
        return buffer.getvalue()

    def _neighbours(self) -> list[dict[str, Any]]:
        """Return the members nearest to the one that is searched for, without itself."""
        family, query = self.family, self.members[0]
        distance = np.abs(family.descriptors - family.descriptors[query]).sum(1)
        distance[query] = np.inf
        order = np.argsort(distance, kind="stable")[: min(self.params.count, len(family.names) - 1)]
        return [{"name": family.names[member], "distance": float(distance[member])} for member in order]

    def _report(self, found: list[dict[str, Any]] | None) -> bytes:
        clean = np.isfinite(self.defects) & (self.defects <= self.params.max_defect)
        read = np.isfinite(self.defects)
        warnings = []
        for number, about in enumerate(self.about):
            if about["loose"]:
                warnings.append(f"{self._name(number)}: no member says where {', '.join(about['loose'])} would touch.")
        for part, name in enumerate(self.family.parts):
            if read[:, part].any() and not clean[:, part].any():
                warnings.append(f"No member has a {name} with a clean boundary; the cleanest was used.")
        report = {
            "kind": "family_synthesize",
            "versions": versions(),
            "params": self.params.model_dump(mode="json"),
            "input": {"sha256": self.digests, "members": len(self.family.names)},
            "parts": self.family.parts,
            "members": [
                {"name": name, "free_energy": energy}
                for name, energy in zip(self.family.names, self.energies, strict=True)
            ],
            "boundaries": {
                name: {"members": int(read[:, part].sum()), "clean": int(clean[:, part].sum())}
                for part, name in enumerate(self.family.parts)
            },
            "shapes": [{"name": self._name(number), **about} for number, about in enumerate(self.about)],
            "nearest_members": found,
            "warnings": warnings,
        }
        return json.dumps(report, indent=1, allow_nan=False).encode()
