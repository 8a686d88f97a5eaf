"""Generate the page equations.md: the method module by module, as the docstrings of the code have it.

docs/method.md, written by hand, says how the modules work together.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

__all__ = ["MODULES", "page"]

_ROOT = Path(__file__).resolve().parents[2]
_FOLDERS = {
    "geometry": "weld junctions shapes intersections quality texture_stretch structure_changes target_distance",
    "deformation": "poisson factor jacobians degrees_of_freedom lattice lattice_field details_on_faces rigid_bodies "
    "constraints stand_in binding variables regularizers loop surface_guard path rotation_vectors bridges edit_map",
    "rendering": "cameras views shading scenes normal_colours rasterizer interpolation antialiasing",
    "guidance": "sds alignment target points silhouettes",
    "runs": "prompts",
    "assets": "placement rig attached",
    "reading": "read choice articulated groups votes smoothing evidence deciding trust",
    "exemplar": "choosing posture pieces affine_maps axis_maps side_maps blending splines smooth_fit surface_fit "
    "sprouts mending invertible relaxing clay spherical borrowing outlook",
    "kinds/surface_fit": "surface_sources oriented_points collapse network fitting scalar_fields intrinsic",
    "kinds/families": "collection template inference machine learning sampling boundary cut assembly placing",
}
MODULES = [f"meshdeform/{folder}/{name}" for folder, names in _FOLDERS.items() for name in names.split()]
"""Files whose docstrings hold the method, without their ending."""

_HEAD = """\
# Equations

Every equation with its source, module by module, as the docstrings of the code have them. This page is generated when
the site is built. [Method](method.md), [Method of shapes](shapes.md), [Surface fits](surface_fit.md) and
[Families](families.md) say how the modules work together.
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
