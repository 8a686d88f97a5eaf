"""Describe a run of the benchmark by everything that affects its results, stored as the manifest of its folder.

A folder belongs to one plan. An existing manifest is compared member by member, so that a table never mixes results
of different parameters, models or code.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import meshdeform
from meshdeform.errors import ParameterError
from meshdeform.requests.document import ResolvedParams
from meshdeform.support.files import write_files
from training.evaluation.ablations import Ablation
from training.evaluation.sources import mesh_sha256, source_mesh
from training.evaluation.suite import Suite

FORMAT = 1
MANIFEST = "manifest.json"

_DECISIVE_FOLDERS = ("deformation", "geometry", "guidance", "priors", "rendering", "requests")
_TRAINING = "training/prior/"
"""Code that affects how a mesh is deformed; a prior's weights have their own hash."""


@dataclass(frozen=True)
class Plan:
    """A run of the benchmark; picklable for the worker processes.

    Attributes
    ----------
    suite : Suite
    params : ResolvedParams
        Parameters of every deformation, except the seed.
    steps : tuple of int
        Steps after which a shape is saved and judged, ascending; the last is `params.steps`.
    folder : Path
        Folder for all files.
    revision : str
        Revision of the model, for hub ids.
    device : str
    dtype : str
        Precision of the model, as for `load_prior`.
    judge : str
        As in `retrieval.load_judge`.
    clip : str
        Folder of a CLIP model, or empty.
    ablation : Ablation, optional
        Modification of the method; `params` already contains its parameters.
    """

    suite: Suite
    params: ResolvedParams
    steps: tuple[int, ...]
    folder: Path
    revision: str = ""
    device: str = "cpu"
    dtype: str = "auto"
    judge: str = "builtin"
    clip: str = ""
    ablation: Ablation | None = None


def code_sha256() -> str:
    """Hash the package's modules that affect how a mesh is deformed."""
    root = Path(meshdeform.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(path for folder in _DECISIVE_FOLDERS for path in (root / folder).rglob("*.py")):
        name = path.relative_to(root).as_posix()
        if not name.startswith(_TRAINING):
            digest.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def manifest(plan: Plan, prior: dict[str, str], judge: dict[str, Any], clip: dict[str, Any]) -> dict[str, Any]:
    """Return everything that affects the results of the deformation and of the judges."""
    suite = plan.suite
    params = plan.params.model_dump(mode="json", exclude={"seed", "checkpoint_every_steps"})
    sources = {
        name: {
            "faces": len(source_mesh(name).faces),
            "vertices": len(source_mesh(name).verts),
            "sha256": mesh_sha256(source_mesh(name)),
        }
        for name in suite.sources
    }
    return {
        "format": FORMAT,
        "suite": suite.name,
        "prompts": list(suite.prompts),
        "seeds": list(suite.seeds),
        "pairs": [list(pair) for pair in suite.pairs],
        "turned": suite.turned,
        "delivered": suite.delivered,
        "sources": sources,
        "steps": list(plan.steps),
        "ablation": plan.ablation,
        "params": params,
        "prior": prior,
        "device": plan.device,
        "dtype": plan.dtype,
        "code": {"version": meshdeform.__version__, "sha256": code_sha256()},
        "judge": judge,
        "clip": clip,
    }


def plan_of(folder: Path, manifest: dict[str, Any], *, judge: str, clip: str, device: str) -> Plan:
    """Return the plan of a manifest with other judges, for judging again."""
    suite = Suite(
        manifest["suite"],
        tuple(manifest["sources"]),
        tuple(manifest["prompts"]),
        tuple(manifest["seeds"]),
        manifest["params"]["preset"],
        tuple((source, prompt) for source, prompt in manifest.get("pairs", [])),
        turned=manifest.get("turned", False),
        delivered=manifest.get("delivered", False),
    )
    # Not validated: the parameters may be of an earlier version, and no deformation uses them.
    params = ResolvedParams.model_construct(**manifest["params"])
    precision = manifest.get("dtype", "auto")
    return Plan(suite, params, tuple(manifest["steps"]), folder, device=device, dtype=precision, judge=judge, clip=clip)


def read_manifest(folder: Path) -> dict[str, Any] | None:
    """Read the manifest of a folder; return None if there is none.

    Raises
    ------
    ParameterError
        The manifest is damaged or of another version.
    """
    path = folder / MANIFEST
    if not path.exists():
        return None
    try:
        manifest: dict[str, Any] = json.loads(path.read_text())
    except ValueError as error:
        raise ParameterError(f"{path} is damaged: {error}.", advice="Choose another folder with --out.") from error
    if manifest.get("format") != FORMAT:
        raise ParameterError(
            f"{path} is of format {manifest.get('format')}; this version writes {FORMAT}.",
            advice="Choose another folder with --out.",
        )
    return manifest


def write_manifest(folder: Path, members: dict[str, Any]) -> None:
    """Write the manifest of a folder, atomically."""
    write_files({folder / MANIFEST: (json.dumps(members, indent=2) + "\n").encode()})


def check_manifest(folder: Path, stored: dict[str, Any], expected: dict[str, Any]) -> None:
    """Refuse to continue in the folder of another run.

    Raises
    ------
    ParameterError
        The manifests differ; the message lists the differences.
    """
    old, new = _flat(stored), _flat(expected)
    names = [name for name in {**new, **old} if old.get(name) != new.get(name)]
    if not names:
        return
    judging = all(name.startswith(("judge.", "clip.")) for name in names)
    shown = "; ".join(f"{name} ({_short(old.get(name))} there, {_short(new.get(name))} now)" for name in names[:6])
    raise ParameterError(
        f"{folder} is of another run, which differs in {shown}{f'; and {len(names) - 6} more' if names[6:] else ''}.",
        advice="Judge its meshes again with --rejudge, or choose another folder with --out."
        if judging
        else "Choose another folder with --out, or give the options of that run (its manifest.json has them).",
    )


def _flat(members: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in members.items():
        if isinstance(value, dict):
            flat.update(_flat(value, f"{prefix}{name}."))
        else:
            flat[prefix + name] = value
    return flat


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
