"""Run jobs of kind `family_synthesize`: draw points near the members, and make assets of members' parts on them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.assets import Asset, Limits, build_glb, load_asset
from meshdeform.assets.assemble import assemble
from meshdeform.assets.collection import open_collection
from meshdeform.deformation.checkpoint import Checkpoint, dump_checkpoint, fingerprint, load_checkpoint
from meshdeform.errors import AssetError, ParameterError
from meshdeform.kinds.families.assembly import Assembler, Assembly
from meshdeform.kinds.families.family_file import FamilyFile, has_digest, read_family
from meshdeform.kinds.families.machine import BetaMachine
from meshdeform.kinds.families.params import FamilySynthesisParams, SynthesisMode
from meshdeform.kinds.families.results import FamilyResults, SynthesisResults, Unfinished, nearest_members
from meshdeform.kinds.families.rows import StandingShape, in_rows, standing_shape
from meshdeform.kinds.families.sampling import Drawn, FreeEnergy, between, completed, sampled, to_machine
from meshdeform.kinds.families.synthesis_description import total_steps
from meshdeform.runs.base import ArtifactData, JobRun, RunInput, params_of

_ITS_COLLECTION = "Send the collection of that job, or its labelled.zip."
_AGAIN = "Run family_fit again, and use the family.safetensors that it writes."
_SAME = 1e-6
_GLB = "model/gltf-binary"


def machine_of(family: FamilyFile) -> BetaMachine:
    """Return the Beta shape machine of a family."""
    weights = {name: torch.from_numpy(np.array(value)) for name, value in family.machine.items() if name != "sees"}
    return BetaMachine(weights, torch.from_numpy(np.array(family.machine["sees"])))


def start(job_input: RunInput) -> FamilySynthesisRun:
    """Read the family, find its assets, and prepare the run.

    Raises AssetError, RequestError, CheckpointError: the input cannot be run; the error says what to do.
    """
    params = params_of(job_input.request, FamilySynthesisParams)
    limits = job_input.limits or Limits()
    files = {name: job_input.files[name] for name in ("family", "collection")}
    digests = {name: file.digest for name, file in files.items()}
    family = read_family(files["family"].data, limits)
    assets = open_collection(files["collection"].data, limits).assets
    run = fingerprint(kind="family_synthesize", params=params.model_dump(mode="json"), **digests)
    state = load_checkpoint(job_input.checkpoint, run) if job_input.checkpoint is not None else None
    return FamilySynthesisRun(family, assets, params, limits, run, digests, state)


class FamilySynthesisRun(JobRun):
    """A run in progress, created by `start`."""

    def __init__(
        self,
        family: FamilyFile,
        assets: dict[str, bytes],
        params: FamilySynthesisParams,
        limits: Limits,
        run: str,
        digests: dict[str, str],
        state: Checkpoint | None,
    ) -> None:
        self.family, self._params, self._limits, self._run, self._digests = family, params, limits, run, digests
        self._data = [_asset_of(assets, name) for name in family.names]
        self._members = [_member(family, name, number) for number, name in enumerate(params.members)]
        if len(set(self._members)) < len(self._members):
            raise ParameterError.at(
                ["params", "members"], "The two members are the same.", "Name two different members."
            )
        self._keep = [_part(family, name, self._members[0], n) for n, name in enumerate(params.keep)]
        self._machine = machine_of(family)
        self._energy = FreeEnergy(self._machine, *self._known(family.points, family.exists))
        super().__init__(total_steps(params), 0 if state is None else state.step)
        self._shapes: list[bytes] = []
        self._about: list[dict[str, Any]] = []
        self._drawn: list[tuple[NDArray[np.float64], NDArray[np.bool_]]] = []
        self._standing: list[StandingShape] = []
        if state is not None:
            self._resume(state)
        self._assembler: Assembler | None = None

    @property
    def shapes(self) -> tuple[bytes, ...]:
        """The shapes that were made so far, each a GLB."""
        return tuple(self._shapes)

    def _steps(self) -> Iterator[dict[str, float]]:
        """Run the remaining steps, one for each shape."""
        while self.step < self.total_steps:
            if self._params.mode is not SynthesisMode.SEARCH:
                self._make(self.step)
            yield {"total": float(self.total_steps - self.step - 1)}

    def checkpoint(self) -> bytes:
        """Return the complete state of the run; call only between two steps."""
        tensors: dict[str, NDArray[Any]] = {}
        for number, (shape, about) in enumerate(zip(self._shapes, self._about, strict=True)):
            tensors[f"glb.{number}"] = _bytes(shape)
            tensors[f"about.{number}"] = _bytes(json.dumps(about).encode())
            tensors[f"points.{number}"] = self._drawn[number][0]
            tensors[f"exists.{number}"] = self._drawn[number][1]
        return dump_checkpoint(Checkpoint(self.step, tensors), self._run, self._digests["family"])

    def snapshot(self) -> ArtifactData:
        """Return the shapes so far in the colours of their parts; before the first, the points of a member."""
        if not self._shapes:
            there = self.family.exists[0]
            markers = FamilyResults.markers(self.family.points[0][there], self.family.labels[there])
            return ArtifactData(build_glb(markers), _GLB)
        for number in range(len(self._standing), len(self._shapes)):
            name = f"shape {number}"
            asset = load_asset(self._shapes[number], f"{name}.glb", self._limits)
            self._standing.append(standing_shape(name, asset, self.family.parts))
        return ArtifactData(in_rows(self._standing, self.family.parts), _GLB)

    def finish(self) -> dict[str, ArtifactData]:
        """Return the results, by artifact name."""
        return self._results().artifacts()

    def so_far(self) -> dict[str, ArtifactData]:
        """Return the shapes that were made."""
        if not self._shapes:
            return {}
        return dataclasses.replace(self._results(), unfinished=Unfinished.of(self)).artifacts()

    def _results(self) -> SynthesisResults:
        return SynthesisResults(
            self.family,
            self._params,
            self._limits,
            self._digests,
            members=self._members,
            energies=self._energy.members.tolist(),
            shapes=self._shapes,
            about=self._about,
            drawn=self._drawn,
            load=self.asset,
        )

    def _known(self, points: NDArray[np.float64], exists: NDArray[np.bool_]) -> tuple[Tensor, Tensor]:
        """Return points (S, K, 3) and which exist (S, K) as the machine sees them."""
        scaling = torch.from_numpy(self.family.scaling.copy())
        return to_machine(torch.from_numpy(points).float(), scaling), torch.from_numpy(exists).float()

    def asset(self, member: int) -> Asset:
        """Read a member's asset, and check that it is the one that the family was fitted to."""
        name = self.family.names[member]
        try:
            asset = load_asset(self._data[member], name, self._limits)
        except AssetError as error:
            raise type(error)(f"{name}: {error.detail}", advice=error.advice_text, **error.extra) from error
        if not has_digest(asset.surface, self.family.digests[member]):
            raise AssetError(f"{name} has another shape than when the family was fitted.", advice=_ITS_COLLECTION)
        if len(asset.surface.triangles) != len(self.family.segments[member]):
            raise AssetError(f"{name} has another number of triangles than in the family.", advice=_AGAIN)
        used = asset.surface.positions[np.unique(asset.surface.triangles)]
        low, high = used.min(0), used.max(0)
        diagonal = float(np.linalg.norm(high - low))
        apart = np.abs(
            np.append((low + high) / 2 - self.family.centres[member], diagonal - self.family.diagonals[member])
        )
        if apart.max() > _SAME * diagonal:
            raise AssetError(f"{name} has another size or place than in the family.", advice=_AGAIN)
        return asset

    def _make(self, number: int) -> None:
        if self._assembler is None:
            self._assembler = Assembler(self.family, self.asset)
        diagonal, centre, draw = self._drawn_shape(number)
        choice = self._assembler.chosen(draw) | dict.fromkeys(self._keep, self._members[:1])
        if not choice:
            raise AssetError(
                f"Shape {number} has no point that any member has.",
                advice="Take another seed, or run family_fit again with more points.",
            )
        assembly = self._assembler.assemble(
            draw.points, draw.exists, choice, kept=self._keep, diagonal=diagonal, centre=centre
        )
        self._shapes.append(assemble(assembly.pieces, {"kind": "family_synthesize", "shape": number}))
        self._drawn.append((draw.points, draw.exists))
        frame = {"centre": [float(value) for value in centre], "diagonal": float(diagonal)}
        self._about.append({"frame": frame, **self._described(assembly, draw)})

    def _drawn_shape(self, number: int) -> tuple[float, NDArray[np.float64], Drawn]:
        """Return the diagonal, the centre and the draw of a shape."""
        family, members, mode, seed = self.family, self._members, self._params.mode, self._params.seed
        if mode is SynthesisMode.INTERPOLATE:
            share = number / (self._params.count - 1)
            one, other = (np.append(family.centres[each], family.diagonals[each]) for each in members)
            frame = (1 - share) * one + share * other
            return float(frame[3]), frame[:3], between(family, members, share)
        if mode is SynthesisMode.COMPLETE:
            draw = completed(family, members[0], self._keep, np.random.default_rng([seed, number]))
            return float(family.diagonals[members[0]]), family.centres[members[0]], draw
        return float(np.median(family.diagonals)), np.median(family.centres, axis=0), sampled(family, number, seed)

    def _described(self, assembly: Assembly, draw: Drawn) -> dict[str, Any]:
        family = self.family
        points, exists = self._known(draw.points[None], draw.exists[None])
        energy = float(self._energy(points, exists)[0])
        parts = [
            {
                "part": family.parts[each.number],
                "member": family.names[each.member],
                "kept": each.still,
                "distance": each.distance,
                "gap": each.gap,
                "penetration": each.penetration,
            }
            for each in assembly.parts
        ]
        return {
            "parts": parts,
            "loose": [family.parts[part] for part in assembly.loose],
            "free_energy": energy,
            "plausibility": self._energy.plausibility(energy),
            "nearest_members": nearest_members(family, draw.points, draw.exists, 3),
        }

    def _resume(self, state: Checkpoint) -> None:
        tensors = state.tensors
        for number in range(state.step):
            if f"glb.{number}" not in tensors:
                return
            self._shapes.append(tensors[f"glb.{number}"].tobytes())
            self._about.append(json.loads(tensors[f"about.{number}"].tobytes()))
            self._drawn.append((tensors[f"points.{number}"], tensors[f"exists.{number}"]))


def _bytes(data: bytes) -> NDArray[np.uint8]:
    return np.frombuffer(data, np.uint8)


def _asset_of(assets: dict[str, bytes], name: str) -> bytes:
    for candidate in (name, f"{name}.glb", str(PurePosixPath(name).with_suffix(".glb"))):
        if candidate in assets:
            return assets[candidate]
    raise AssetError(f"The collection has no {name[:100]!r}, which the family was fitted to.", advice=_ITS_COLLECTION)


def _member(family: FamilyFile, name: str, place: int) -> int:
    number = family.member(name)
    if number is None:
        detail = f"The family has no member {name[:100]!r}."
        advice = f"It has: {', '.join(family.names[:8])}{' ...' if len(family.names) > 8 else ''}."
        raise ParameterError.at(["params", "members", place], detail, advice)
    return number


def _part(family: FamilyFile, name: str, member: int, place: int) -> int:
    there = [family.parts[part] for part in np.unique(family.segments[member])]
    if name not in there:
        detail = f"{family.names[member]} has no part {name!r}."
        raise ParameterError.at(["params", "keep", place], detail, f"It has: {', '.join(there)}.")
    return family.parts.index(name)
