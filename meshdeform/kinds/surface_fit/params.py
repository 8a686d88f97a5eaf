"""Define the parameters of jobs of kind `surface_fit`. Torch-free."""

from __future__ import annotations

from pydantic import Field

from meshdeform.requests.declaration import StrictModel
from meshdeform.requests.parameters import MAX_STEPS
from meshdeform.requests.selection import Point

MAX_BASE_FACES = 4000
MAX_ANCHORS = 256

MAX_LEVEL = 4
"""Highest level that a job writes as a mesh."""

RETIRED = {"surface_fit": frozenset({"batch_faces", "learning_rate", "normal_weight"})}


class AnchorParams(StrictModel):
    """A place of the base that comes to lie at a place of the surface."""

    base: Point = Field(description="A point near the base.", examples=[[1.0, 0.0, 0.0]])
    surface: Point = Field(description="The point near the surface where it goes.", examples=[[0.0, 0.0, 1.0]])


class SurfaceFitParams(StrictModel):
    """Parameters of a neural displacement field and its fit."""

    base_faces: int = Field(
        1000,
        ge=100,
        le=MAX_BASE_FACES,
        description="Faces of the base mesh, at most; up to four times as many where fewer would fold over.",
        examples=[500],
    )
    features: int = Field(
        8, ge=1, le=32, description="Features that are learned at each vertex of the base.", examples=[8]
    )
    octaves: int = Field(6, ge=0, le=8, description="Octaves of positions that the network sees.", examples=[6])
    width: int = Field(32, ge=4, le=128, description="Neurons of each hidden layer.", examples=[32])
    depth: int = Field(2, ge=1, le=6, description="Hidden layers.", examples=[2])
    steps: int = Field(600, ge=1, le=MAX_STEPS, description="Optimiser iterations.", examples=[600])
    seed: int = Field(
        0,
        ge=0,
        le=2**63 - 1,
        description="Seed of the first weights and of every random draw.",
        examples=[0],
    )
    level: int = Field(
        2,
        ge=0,
        le=MAX_LEVEL,
        description="Highest level to write: `level_0.glb` to `level_N.glb`. Each has four times the faces of the one "
        "before.",
        examples=[2],
    )
    anchors: list[AnchorParams] = Field(
        default_factory=list,
        max_length=MAX_ANCHORS,
        description="Pairs of points that the fit brings together, for a base of its own (the file `base`), which may "
        "have other holes than the surface.",
        examples=[[{"base": [1.0, 0.0, 0.0], "surface": [0.0, 0.0, 1.0]}]],
    )
    checkpoint_every_steps: int = Field(
        100,
        ge=1,
        le=MAX_STEPS,
        description="Steps between two checkpoints; at most this many are repeated after a crash.",
        examples=[100],
    )


PARAMS = {"surface_fit": SurfaceFitParams}
