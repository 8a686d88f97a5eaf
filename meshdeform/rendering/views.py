"""Draw four cameras, and combine their views into one image.

Image models know single pictures, so four views a quarter turn apart share one.

Source: Xu et al. 2024, FusionDeformer, section 4.2 and eq. 8.
"""

from __future__ import annotations

import torch
from torch import Tensor

from meshdeform.errors import ShapeError
from meshdeform.rendering.cameras import NUM_VIEWS, UNIT_SPHERE, CameraRange, Cameras, orthogonal_cameras


def combine_views(images: Tensor) -> Tensor:
    """Combine the four views into one image: 0 and 1 above, 2 and 3 below.

    Parameters
    ----------
    images : (4, H, W, 3) floating

    Returns
    -------
    (1, 3, 2H, 2W), the layout that image models take.
    """
    if images.ndim != 4 or images.shape[0] != 4:
        raise ShapeError(f"expected four views (4, H, W, C), got {tuple(images.shape)}")
    rows = torch.cat([torch.cat([images[0], images[1]], 1), torch.cat([images[2], images[3]], 1)], 0)
    return rows.permute(2, 0, 1)[None]


def sample_orthogonal_cameras(
    bounds: CameraRange, generator: torch.Generator, fitting_radius: float = UNIT_SPHERE, turn_deg: float = 0.0
) -> Cameras:
    """Draw the four cameras of one step: azimuth a + {0, 90, 180, 270} with a ~ U(-180, 180).

    Each elevation and the shared field of view are uniform in `bounds`. `generator`: the job's only source of
    randomness; `fitting_radius` and `turn_deg`: as in `orthogonal_cameras`.
    """
    shares = torch.rand(2 + NUM_VIEWS, generator=generator, dtype=torch.float64).tolist()
    return orthogonal_cameras(bounds, shares, fitting_radius, turn_deg)
