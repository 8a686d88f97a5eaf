"""Draw nouns by code that shares nothing with the families.

Results are fitted to members of the families. A judge that knew these rabbits would tell how much a result resembles
its goal, not whether it is a rabbit. These shapes have other poses and kinds, other proportions, one blended or creased
surface instead of joined parts, and the styles of kits of assets, low-poly and voxels. Most were written without
reading the families; those of `yard`, and of the other nouns that came with it, are by the hand that drew their
families. Those of tables (`*.txt`, see `table`) were all written without. `drawn(noun, attributes, rng)` is the
interface; the same generator state gives the same mesh.

Attributes of the whole are those of the families (`traits.deformed`), because they are operations, not ideas. Parts
have no attributes here: their sizes vary as the kinds do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from importlib import import_module
from pathlib import Path

import fast_simplification
import numpy as np

from meshdeform.nouns.deformed import deformed
from meshdeform.nouns.families.parts import Part
from meshdeform.vocabulary.lookup import Attribute
from training.judge.shapes.solids import Solid, surfaced
from training.judge.shapes.table import Table

__all__ = ["SHAPES", "drawn"]

_SUBJECTS = "beasts birds buildings clothing craft creatures figures food furniture plants tools vehicles vessels yard"
_MODULES = [import_module(f"{__name__}.{subject}") for subject in _SUBJECTS.split()]
_TABLE = Table("\n".join(path.read_text() for path in sorted(Path(__file__).parent.glob("*.txt"))))
SHAPES: dict[str, Callable[[np.random.Generator], list[Solid]]] = {
    name: getattr(module, name) for module in _MODULES for name in module.__all__
} | {noun: partial(_TABLE.shape, noun) for noun in _TABLE.nouns}
"""The shapes of each noun."""


def drawn(noun: str, attributes: Iterable[Attribute], rng: np.random.Generator) -> Part:
    """Draw a noun in one of four styles: blended, creased, low-poly and voxels.

    Parameters
    ----------
    noun : str
    attributes : iterable of Attribute
        Of the whole.
    rng : numpy.random.Generator

    Returns
    -------
    Part
        Closed, oriented outward (low-poly shapes nearly so), +Y up, facing +Z, centred, farthest vertex at distance 1.
    """
    solids = SHAPES[noun](rng)
    style, cells = rng.random(), int(rng.integers(32, 47))
    if style < 0.4:
        part = surfaced(solids, cells, float(rng.uniform(0.01, 0.05)))
    elif style < 0.65:
        part = surfaced(solids, cells, 0.0)
    elif style < 0.87:
        part = _low_poly(surfaced(solids, cells, 0.0), int(np.exp(rng.uniform(np.log(250), np.log(1200)))))
    else:
        part = surfaced(solids, int(rng.integers(24, 40)), 0.0, voxels=True)
    return deformed(part, attributes, rng)


def _low_poly(part: Part, faces: int) -> Part:
    """Reduce a mesh to a number of faces by quadric error (Garland and Heckbert 1997)."""
    if len(part.faces) <= faces:
        return part
    verts, faces_kept = fast_simplification.simplify(
        part.verts.astype(np.float32), part.faces.astype(np.int32), target_count=faces
    )
    used, corners = np.unique(faces_kept, return_inverse=True)
    return Part(np.asarray(verts, np.float64)[used], corners.reshape(-1, 3).astype(np.int64))
