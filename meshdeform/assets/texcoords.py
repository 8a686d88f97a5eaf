"""Apply a texture's own transform to texture coordinates.

Source: KHR_texture_transform.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.materials import TextureUse


def moved_texcoords(values: NDArray[np.floating], use: TextureUse) -> NDArray[np.float64]:
    """Return texture coordinates (V, 2), v downwards, as a use of a texture reads them.

    A scale, a rotation that is counter-clockwise in the picture, and an offset.
    """
    if (use.offset, use.rotation, use.scale) == ((0.0, 0.0), 0.0, (1.0, 1.0)):
        return np.asarray(values, np.float64)
    u, v = (values.astype(np.float64) * use.scale).T
    cosine, sine = np.cos(use.rotation), np.sin(use.rotation)
    return np.stack([cosine * u + sine * v + use.offset[0], cosine * v - sine * u + use.offset[1]], 1)
