"""Select the parts of an asset that keep their shape. Torch-free."""

from __future__ import annotations

from pydantic import Field

from meshdeform.requests.choices import Rigidity
from meshdeform.requests.selection import Selection

__all__ = ["RigidSelector"]


class RigidSelector(Selection):
    """A selection of what keeps its shape; exactly one of the members that say where is set."""

    mode: Rigidity = Field(
        Rigidity.RIGID,
        description="`rigid`: it moves and turns; `similarity`: it is scaled as well.",
        examples=["similarity"],
    )
    together: bool = Field(
        False,
        description="Hold everything that is selected as one body, for example a tyre and its rim. Otherwise each of "
        "its connected parts is a body of its own.",
        examples=[False],
    )
