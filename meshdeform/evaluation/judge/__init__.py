"""The judge: says which prompt a mesh shows, and shares nothing with the guidance that made the mesh.

`Judge` draws a mesh with cameras and shading of its own, and a separately trained classifier of single views scores
prompts. How its weights came to be: `members`, `train`; what they know: `measure` and ``docs/judge.md``.
"""

from __future__ import annotations

from meshdeform.evaluation.judge.scoring import Judge
from meshdeform.evaluation.judge.weights_file import WEIGHTS

__all__ = ["WEIGHTS", "Judge"]
