"""Read a ZIP of many assets of one family and the labels beside them, in memory and within limits. No numpy.

Each asset is one file that needs no others: a GLB, or an OBJ, PLY or STL. `labels.json`, if there is one, names the
parts of some of them (docs/families.md).
"""

from __future__ import annotations

import dataclasses
import posixpath
import zipfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field, StringConstraints, ValidationError

from meshdeform.assets.archive import ZIP_MAGIC, content_of, entries_of, opened_zip
from meshdeform.assets.container import GLB_MAGIC, Data, Json, glb_layout, parse_json
from meshdeform.assets.inspect import AssetSummary, inspect_asset
from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetEmptyError, AssetError, AssetFormatError, AssetTooLargeError
from meshdeform.requests.declaration import StrictModel
from meshdeform.requests.problems import reason

MIN_COLLECTION, MAX_COLLECTION = 10, 3000
LABELS_FILE = "labels.json"
_ENDINGS = ("glb", "obj", "ply", "stl")
_MAX_LABELS_BYTES = 64 * 2**20
_ATTRIBUTE = b'"_PART"'
_MOST_PARTS = 15
"""Parts that assets name themselves: one of the 16 that a family may have is what has no part."""
_MOST_LETTERS = 64
_Name = Annotated[str, StringConstraints(min_length=1, max_length=_MOST_LETTERS)]


class AssetLabels(StrictModel):
    """Metadata of one asset."""

    nodes: dict[str, str] = Field(default_factory=dict, description="Part of each node, by its name.")
    materials: dict[str, str] = Field(default_factory=dict, description="Part of each material, by its name.")
    triangles: list[str] | None = Field(None, description="Part of each triangle of the surface, in the file's order.")
    held_out: bool = Field(False, description="Use the labels only to measure the accuracy.")
    class_: _Name | None = Field(None, alias="class", description="Its sub-class, to measure the descriptors.")

    @property
    def names_parts(self) -> bool:
        """Whether it gives any part."""
        return bool(self.nodes or self.materials or self.triangles is not None)


class FamilyLabels(StrictModel):
    """The contents of `labels.json`."""

    parts: list[_Name] = Field(min_length=2, max_length=16, description="Names of the parts.")
    assets: dict[str, AssetLabels] = Field(default_factory=dict, description="By file name.")


@dataclass(frozen=True)
class CollectionFiles:
    """The files of a collection."""

    assets: dict[str, bytes]  # by name in the ZIP, sorted
    labels: FamilyLabels | None


def open_collection(data: Data, limits: Limits) -> CollectionFiles:
    """Unpack a collection."""
    with opened_zip(data) as archive:
        entries = entries_of(archive, _bounds(limits))
        names = _assets_of(list(entries))
        labels = None
        if LABELS_FILE in entries:
            if entries[LABELS_FILE].file_size > _MAX_LABELS_BYTES:
                raise AssetTooLargeError(f"{LABELS_FILE} has more than {_MAX_LABELS_BYTES} bytes.")
            labels = _labels(content_of(archive, entries[LABELS_FILE]), names)
        return CollectionFiles({name: _asset(archive, entries[name], name) for name in names}, labels)


def own_labels(assets: Mapping[str, bytes], limits: Limits) -> FamilyLabels | None:
    """Return labels with the parts that assets name by their attribute `_PART` (`assets/parted.py`); None without two.

    Of more than 15 names, those of the most assets count.
    """
    named: Counter[str] = Counter()
    for data in assets.values():
        root = _with_attribute(data, limits)
        meshes = [] if root is None else root.get("meshes")
        holders = [] if root is None else [root.get("asset"), *(meshes if isinstance(meshes, list) else [])]
        extras = [holder.get("extras") for holder in holders if isinstance(holder, dict)]
        lists = [each.get("parts") for each in extras if isinstance(each, dict)]
        names = [name for each in lists if isinstance(each, list) for name in each if isinstance(name, str)]
        named.update(dict.fromkeys(name for name in names if 0 < len(name) <= _MOST_LETTERS).keys())
    parts = [name for name, _ in named.most_common(_MOST_PARTS)]
    return FamilyLabels(parts=parts) if len(parts) > 1 else None


def _with_attribute(data: bytes, limits: Limits) -> Json | None:
    """Return the JSON of a GLB that has the attribute; None for other files."""
    if not data.startswith(GLB_MAGIC):
        return None
    try:
        text = data[glb_layout(data, limits).json]
        return parse_json(text, limits) if _ATTRIBUTE in text else None
    except AssetError:  # found when it is read
        return None


def _asset(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, name: str) -> bytes:
    """Unpack an asset, but no archive: what that unpacks to is not in the sum that was checked."""
    data = content_of(archive, entry)
    if data.startswith(ZIP_MAGIC):
        raise AssetFormatError(f"{name} is a ZIP within a ZIP.", advice="Unpack it, and pack the files once.")
    return data


def unpacked(data: Data, limits: Limits) -> dict[str, bytes]:
    """Return all files of a ZIP by name, those that a collection does not use too."""
    with opened_zip(data) as archive:
        return {name: content_of(archive, entry) for name, entry in entries_of(archive, _bounds(limits)).items()}


def meshes_in(files: Mapping[str, bytes], limits: Limits) -> dict[str, bytes]:
    """Return files with the assets of every ZIP in its place that holds several; one of a single asset stays a ZIP.

    Assets have their names in the ZIP, and where these are taken, that of the ZIP before.
    """
    meshes = dict[str, bytes]()
    for name, data in files.items():
        inner = unpacked(data, limits) if data.startswith(ZIP_MAGIC) else {}
        assets = [each for each in sorted(inner) if each.lower().rpartition(".")[2] in _ENDINGS]
        if len(assets) < 2:
            meshes[name] = data
            continue
        meshes |= {(f"{name}/{each}" if each in meshes else each): inner[each] for each in assets}
    return meshes


def inspect_collection(data: Data, limits: Limits) -> AssetSummary:
    """Check a collection and the structure of its assets; `meshes` of the summary counts those that can be used.

    Raises AssetError: as `open_collection`; or too many assets cannot be used, and the error names the last one.
    """
    files = open_collection(data, limits)
    usable, wrong = [], None
    for name, content in files.assets.items():
        try:
            usable.append(inspect_asset(content, name, limits))
        except AssetError as error:
            wrong = type(error)(f"{name}: {error.detail}", advice=error.advice_text, **error.extra)
    if wrong is not None and len(usable) < MIN_COLLECTION:
        raise wrong
    vertices, triangles = sum(each.vertices for each in usable), sum(each.triangles for each in usable)
    return AssetSummary("zip", vertices, triangles, meshes=len(usable))


def _bounds(limits: Limits) -> Limits:
    return dataclasses.replace(limits, max_archive_files=max(limits.max_archive_files, 2 * MAX_COLLECTION))


def _assets_of(names: list[str]) -> list[str]:
    assets = sorted(name for name in names if name.lower().rpartition(".")[2] in _ENDINGS)
    advice = (
        f"Pack {MIN_COLLECTION} to {MAX_COLLECTION:,} files of the types {', '.join(_ENDINGS)}, each whole by itself."
    )
    if not assets:
        raise AssetEmptyError("The ZIP holds no asset.", advice=advice)
    if len(assets) < MIN_COLLECTION:
        count = "one asset" if len(assets) == 1 else f"{len(assets)} assets"
        raise AssetError(f"The ZIP holds {count}; a family has at least {MIN_COLLECTION}.", advice=advice)
    if len(assets) > MAX_COLLECTION:
        raise AssetTooLargeError(f"The ZIP holds {len(assets)} assets; the limit is {MAX_COLLECTION:,}.", advice=advice)
    return assets


def _labels(data: bytes, names: list[str]) -> FamilyLabels:
    """Read the labels, and refuse those that name no part or no asset."""
    try:
        labels = FamilyLabels.model_validate_json(data)
    except ValidationError as error:
        first = error.errors()[0]
        pointer = ".".join(map(str, first["loc"]))
        raise AssetError(
            f"{LABELS_FILE} is not valid: {pointer or 'the document'}: {reason(first)}.",
            advice="docs/families.md describes it.",
        ) from error
    if len(set(labels.parts)) < len(labels.parts):
        raise AssetError(f"{LABELS_FILE} names a part twice.", advice="Give each part one name.")
    whole, files = set(names), Counter(posixpath.basename(name) for name in names)
    for asset, of_asset in labels.assets.items():
        if asset not in whole and files[asset] > 1:
            raise AssetError(
                f"{LABELS_FILE} has labels for {asset[:100]!r}, which is the name of {files[asset]} assets.",
                advice="Name the asset with its folder, as the ZIP does.",
            )
        if asset not in whole and not files[asset]:
            raise AssetError(
                f"{LABELS_FILE} has labels for {asset[:100]!r}, which is not in the ZIP.",
                advice="Name the assets as the ZIP does, such as 'chair_01.glb'.",
            )
        used = {*of_asset.nodes.values(), *of_asset.materials.values(), *(of_asset.triangles or ())}
        if wrong := sorted(used - set(labels.parts)):
            raise AssetError(
                f"{LABELS_FILE}: the label {wrong[0][:64]!r} of {asset[:100]} names no part.",
                advice=f"Use one of: {', '.join(labels.parts)}; or add it to `parts`.",
            )
    return labels
