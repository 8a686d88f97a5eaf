"""Generate the page equations.md: the method module by module, as the docstrings of the code have it.

docs/method.md, written by hand, says how the modules work together.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

__all__ = ["MODULES", "page"]

_ROOT = Path(__file__).resolve().parents[2]
MODULES = (
    *(f"meshdeform/geometry/{name}" for name in ("weld", "junctions", "shapes", "intersections", "quality")),
    *(
        f"meshdeform/deformation/{name}"
        for name in (
            "poisson controls lattice_field rigid_bodies constraints stand_in binding variables regularizers loop "
            "surface_guard path edit_map"
        ).split()
    ),
    *(f"meshdeform/rendering/{name}" for name in ("cameras", "shading", "rasterizer")),
    *(f"meshdeform/guidance/{name}" for name in ("sds", "alignment", "target", "points", "silhouettes")),
    "meshdeform/runs/prompts",
    *(f"meshdeform/assets/{name}" for name in ("placement", "rig", "attached")),
    *(
        f"meshdeform/reading/{name}"
        for name in "read choice articulated groups votes smoothing evidence deciding trust".split()
    ),
    *(
        f"meshdeform/exemplar/{name}"
        for name in (
            "choosing posture pieces affine_maps axis_maps side_maps blending splines smooth_fit surface_fit sprouts "
            "mending invertible relaxing clay spherical borrowing outlook"
        ).split()
    ),
    *(
        f"meshdeform/kinds/surface_fit/{name}"
        for name in "surface_sources oriented_points collapse network fitting scalar_fields intrinsic".split()
    ),
    *(
        f"meshdeform/kinds/families/{name}"
        for name in "collection inference machine learning sampling boundary cut assembly embedded".split()
    ),
)
"""Files whose docstrings hold the method, without their ending."""

_HEAD = """\
# Equations

Every equation with its source, module by module, as the docstrings of the code have them. This page is generated when
the site is built. [Method](method.md), [Method of shapes](shapes.md), [Surface fits](surface_fit.md) and [Families](families.md) say how the
modules work together.
"""


def page() -> str:
    """Return the whole page."""
    return "\n".join([_HEAD, *(f"## {name}.py\n\n{_told(_ROOT / f'{name}.py')}\n" for name in MODULES)])


def _told(path: Path) -> str:
    """Return a module's docstring in Markdown: underlined titles in bold, and no colon twice before a block."""
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    if text is None:
        raise ValueError(f"{path} has no docstring")
    text = re.sub(r"^(\S.*)\n-{3,}$", r"**\1**\n", text, flags=re.MULTILINE)
    text = re.sub(r"^ *::$\n", "", text, flags=re.MULTILINE)
    return re.sub(r" ?::$", ":", text, flags=re.MULTILINE)
