"""Give an asset back with the parts that words can name: for the command line and for the API's child. Torch-free."""

from __future__ import annotations

import base64
import re
from functools import partial
from typing import TYPE_CHECKING

from meshdeform.errors import PartNotFoundError
from meshdeform.requests.choices import PartsAs
from meshdeform.requests.document import DeformParams, ResolvedParams, resolve

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from meshdeform.assets import Asset
    from meshdeform.assets.parted import PartLabels
    from meshdeform.plain.body import Body
    from meshdeform.plain.naming import NamedPart


_NAME, _MOST_GIVEN = re.compile(r"[\w -]{1,40}"), 64


def parts_glb(
    asset: Asset, form: PartsAs, body: Body | None = None, params: ResolvedParams | None = None
) -> tuple[bytes, list[str]]:
    """Return an asset with the parts of its body as a GLB, and the names of the parts.

    `body`: by default that of the asset; `params`: of the job whose prompts name the parts.

    Raises PartNotFoundError: no part was found.
    """
    from meshdeform.plain.body import loose_body
    from meshdeform.plain.naming import find_parts
    from meshdeform.runs.changes import asked_changes

    read = partial(asked_changes, params=params or resolve(DeformParams()))
    body = loose_body(asset) if body is None else body
    return named_glb(asset, form, body, find_parts(body, read))


def named_glb(asset: Asset, form: PartsAs, body: Body, parts: Sequence[NamedPart]) -> tuple[bytes, list[str]]:
    """Return an asset with these parts of its body as a GLB, and their names.

    Raises PartNotFoundError: there is none.
    """
    from meshdeform.assets.parted import with_parts

    if not parts:
        raise PartNotFoundError(
            "No part of the asset was found, so there is none to write.",
            advice="Say what it is by source_noun, or name its nodes or materials after its parts.",
            parts=[],
        )
    return with_parts(asset, _labels(asset, body, parts), form), [part.name for part in parts]


def given_parts(asset: Asset, body: Body) -> dict[str, NDArray[np.bool_]]:
    """Return the faces (F,) of its body of each part that the file of an asset names by its attribute `_PART`.

    Names are in lower case; those that no sentence can have are left out.
    """
    from meshdeform.assets.parted import parts_of

    own = {name.lower(): flags for name, flags in parts_of(asset).items() if _NAME.fullmatch(name)}
    if not own:
        return {}
    from meshdeform.plain.naming import faces_among  # which loads much: most files have no such attribute

    faces = faces_among(body.vertex_map[asset.surface.triangles])
    found = {name: flags[faces] for name, flags in own.items()}
    return {name: flags for name, flags in list(found.items())[:_MOST_GIVEN] if flags.any()}


def result_with_parts(
    asset: Asset, result: str | None, form: PartsAs, body: Body, parts: Sequence[NamedPart]
) -> str | None:
    """Return the result of a change of an asset, or without one the asset, with these parts of its body.

    `result`: a GLB in base64, as what is returned. Without parts, it stays what it is.
    """
    from meshdeform.assets import Limits, load_asset

    if not parts:
        return result
    if result is not None:
        asset = load_asset(base64.b64decode(result), limits=Limits.unlimited()).without(asset.excluded)
    return base64.b64encode(named_glb(asset, form, body, parts)[0]).decode()


def _labels(asset: Asset, body: Body, parts: Sequence[NamedPart]) -> PartLabels:
    """Return the part of each triangle; one without an area has that of a neighbour."""
    import numpy as np

    from meshdeform.assets.parted import PartLabels
    from meshdeform.plain.naming import faces_among

    corners = body.vertex_map[asset.surface.triangles]
    faces = np.flatnonzero(faces_among(corners))
    labels = np.zeros(len(corners), np.int64)
    for number, part in reversed(list(enumerate(parts, 1))):  # the first counts, of parts that overlap
        labels[faces[part.inside]] = number
    of_vertex = np.zeros(len(body.points), np.int64)
    np.maximum.at(of_vertex, corners[faces], labels[faces, None])
    flat = (corners >= 0).all(1) & ~faces_among(corners)
    labels[flat] = of_vertex[corners[flat]].max(1)
    return PartLabels(tuple(part.name for part in parts), labels)
