"""Provide clients of the HTTP API, for threads and for event loops. They need only the base install.

>>> client = Client("http://127.0.0.1:8765")                          # doctest: +SKIP
>>> result = client.deform("examples/sphere.glb", "a mushroom")       # doctest: +SKIP
>>> result.save("mushroom")                                           # doctest: +SKIP
"""

from __future__ import annotations

from meshdeform.api.documents import (
    AssetFound,
    FoundPart,
    FoundParts,
    FoundReading,
    JobEstimate,
    LikelyNoun,
    ModelList,
    ModelView,
    SketchGuess,
    SketchGuesses,
    SketchParameter,
    UploadView,
    UsageMonth,
    WordDetail,
    WordView,
)
from meshdeform.api.documents import KindView as KindInfo
from meshdeform.api.documents import LimitList as Limits
from meshdeform.api.documents import VocabularyView as Vocabulary
from meshdeform.api.jobs import ArtifactView, CheckpointView, EventView, SignedUrl
from meshdeform.client.asynchronous.client import AsyncClient, AsyncResult
from meshdeform.client.documents import JobView, Validation
from meshdeform.client.orders import AssetLike, JobOptions, UploadProgress
from meshdeform.client.problems import WaitTimeoutError
from meshdeform.client.sync.client import Client, Result
from meshdeform.requests.previews import PreviewShape, PreviewShapes, PrimitivePositions

__all__ = [
    "ArtifactView",
    "AssetFound",
    "AssetLike",
    "AsyncClient",
    "AsyncResult",
    "CheckpointView",
    "Client",
    "EventView",
    "FoundPart",
    "FoundParts",
    "FoundReading",
    "JobEstimate",
    "JobOptions",
    "JobView",
    "KindInfo",
    "LikelyNoun",
    "Limits",
    "ModelList",
    "ModelView",
    "PreviewShape",
    "PreviewShapes",
    "PrimitivePositions",
    "Result",
    "SignedUrl",
    "SketchGuess",
    "SketchGuesses",
    "SketchParameter",
    "UploadProgress",
    "UploadView",
    "UsageMonth",
    "Validation",
    "Vocabulary",
    "WaitTimeoutError",
    "WordDetail",
    "WordView",
]
