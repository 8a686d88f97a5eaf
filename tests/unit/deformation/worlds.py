"""Parameters and meshes of the tests that deform something."""

from __future__ import annotations

from typing import Any

import numpy as np

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.requests.document import DeformParams, ResolvedParams, resolve
from meshdeform.requests.groups import grouped


def params(**given: Any) -> ResolvedParams:
    """Return all values of a preview that fits a target, unless something else is given."""
    return resolve(DeformParams.model_validate(grouped({"preset": "preview", "guidance": "target", **given})))


def moved(mesh: TriangleMesh, *by: float, scale: float = 1.0) -> TriangleMesh:
    """Return a copy that is scaled first."""
    return TriangleMesh(mesh.verts * scale + np.array(by, np.float64), mesh.faces)
