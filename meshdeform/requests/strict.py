"""Define the base of the request's documents. Torch-free."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

__all__ = ["StrictModel"]


class StrictModel(BaseModel):
    """An immutable document that refuses unknown members."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
