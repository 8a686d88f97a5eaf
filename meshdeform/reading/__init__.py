"""Read an asset: find its noun, its front and its parts by fitting members of its noun to it. numpy and scipy alone.

`read.read_asset` does it. The members come from `meshdeform.nouns`; nothing was trained. `banks` draws them, `choice`
grades them, `articulated` fits the best, `votes` carries their parts over, `evidence` weighs in what the file says, and
`smoothing` makes areas of it. A `Reading` can be kept in bytes (`result`), as long as `VERSION` stays.
"""

from meshdeform.reading.evidence import Evidence
from meshdeform.reading.read import FITTED, read_asset
from meshdeform.reading.result import GROUND, NO_PART, Reading
from meshdeform.reading.version import VERSION

__all__ = ["FITTED", "GROUND", "NO_PART", "VERSION", "Evidence", "Reading", "read_asset"]
