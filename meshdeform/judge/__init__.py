"""Judge which noun a mesh shows, independently of the guidance that made the mesh.

`Judge` renders a mesh with its own cameras and shading; a separately trained classifier of single views tells the noun.
`training` contains the code that made and measured the weights; see ``docs/judge.md``.
"""

from __future__ import annotations

from meshdeform.judge.network import WEIGHTS
from meshdeform.judge.scoring import Judge

__all__ = ["WEIGHTS", "Judge"]
