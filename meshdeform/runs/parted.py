"""Give an asset back with the parts that words can name: for the command line and for the API's child. Torch-free."""

from __future__ import annotations

import base64
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
    from meshdeform.plain.body import Body
    from meshdeform.plain.naming import NamedPart


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

    corners = body.vertex_map[asset.surface.triangles]
    flags = {part.name: _flags(part.faces(corners), len(corners)) for part in parts}
    if not flags:
        raise PartNotFoundError(
            "No part of the asset was found, so there is none to write.",
            advice="Say what it is by source_noun, or name its nodes or materials after its parts.",
            parts=[],
        )
    return with_parts(asset, flags, form), list(flags)


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


def _flags(faces: Sequence[int | list[int]], count: int) -> NDArray[np.bool_]:
    """Return flags of `count` triangles by numbers and ranges with both ends."""
    import numpy as np

    flags = np.zeros(count, bool)
    for each in faces:
        first, last = each if isinstance(each, list) else (each, each)
        flags[first : last + 1] = True
    return flags
