"""The two kinds of job of families. Torch-free."""

from __future__ import annotations

from meshdeform.kinds.families.fit_description import FAMILY_FIT
from meshdeform.kinds.families.synthesis_description import FAMILY_SYNTHESIZE

KINDS = (FAMILY_FIT, FAMILY_SYNTHESIZE)
