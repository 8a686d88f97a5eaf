"""The routes of the service that recognise drawings, and make the shapes of corrected sliders."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from anyio import to_thread
from fastapi import APIRouter, Query, Request, Response

from meshdeform.api.documents import SketchGuesses
from meshdeform.errors import (
    DependencyError,
    DrawingError,
    ModelError,
    ParameterError,
    RequestError,
    RequestTimeoutError,
    readable_size,
)
from meshdeform.kinds.sketch.process import guesses_of, shape_of
from meshdeform.kinds.sketch.sliders import Sketch
from service.documentation.responses import BYTES, CALLER_ERRORS, json_body
from service.http.auth import PrincipalDep
from service.http.bodies import parse_document, receive_document, receive_file
from service.http.callers import while_waited_for
from service.http.errors import KNOWN_QUERY, answers, problem_responses
from service.state import AppState, AppStateDep
from service.words.known import with_others

router = APIRouter(prefix="/v1/sketches", tags=["sketches"], dependencies=KNOWN_QUERY)

ROUTERS = (router,)

MODELS = (Sketch,)

TAGS = ({"name": "sketches", "description": "Reading a drawing, before it is the target of a job: docs/sketch.md."},)

_READING = "drawings are being read"
_MAX_BYTES = 20_000_000
_GUESS_TIMEOUT_S = 120.0
_SHAPE_TIMEOUT_S = 30.0
_Noun = Annotated[
    str | None,
    Query(
        max_length=64,
        description="What is drawn, a [noun](nouns.md) or a word of yours; no other is considered. Default: all are.",
        examples=["vase"],
    ),
]


@router.post(
    ":guess",
    summary="Guess what a drawing shows",
    responses=answers(
        SketchGuesses,
        "The likeliest shapes.",
        DrawingError,
        ParameterError,
        ModelError,
        RequestError,
        RequestTimeoutError,
        DependencyError,
        *CALLER_ERRORS,
    ),
    openapi_extra={
        "requestBody": {
            "required": True,
            "description": "A PNG, JPEG or WebP of at most 20 MB.",
            "content": {
                "application/octet-stream": {
                    "schema": {"type": "string", "contentMediaType": "application/octet-stream"}
                }
            },
        },
    },
)
async def guess_sketch(request: Request, app: AppStateDep, principal: PrincipalDep, noun: _Noun = None) -> Response:
    """Three nouns, each with the shape nearest to the drawing: its sliders, their ranges and a mesh.

    It takes some seconds, in a process of its own on the API's machine.
    """
    async with app.bodies.slot(principal.owner_id):
        with app.workspace.temporary_folder() as folder:
            drawing = folder / "drawing"
            too_large = DrawingError(f"The drawing's file is larger than {readable_size(_MAX_BYTES)}.")
            await receive_file(request, drawing, _MAX_BYTES, too_large)
            async with while_waited_for(request), app.slots_for(_READING).slot(principal.owner_id):
                guesses = await to_thread.run_sync(_guessed, app, principal.owner_id, drawing, noun or "")
    return Response(guesses.model_dump_json(), media_type="application/json")


@router.post(
    ":mesh",
    summary="Make a shape of a noun",
    response_class=Response,
    responses={
        200: {
            "description": "The shape as a GLB, one node for each of its parts.",
            "content": BYTES,
        },
        **problem_responses(ParameterError, RequestError, RequestTimeoutError, DependencyError, *CALLER_ERRORS),
    },
    openapi_extra=json_body("Sketch", {"noun": "vase", "values": {"neck": 0.5, "height": 1.2}}),
)
async def make_sketch_mesh(request: Request, app: AppStateDep, principal: PrincipalDep) -> Response:
    """A mesh of these sliders, which a job can take as its target."""
    sketch = parse_document(Sketch, await receive_document(request))
    with app.workspace.temporary_folder() as folder:
        async with while_waited_for(request), app.slots_for(_READING).slot(principal.owner_id):
            data = await to_thread.run_sync(_shaped, app, principal.owner_id, sketch, folder)
    # As described: code generators know no other media type for bytes.
    return Response(data, media_type="application/octet-stream")


def _guessed(app: AppState, owner_id: str, drawing: Path, noun: str) -> SketchGuesses:
    words = with_others(app, owner_id, [])
    return SketchGuesses.model_validate(guesses_of(drawing, noun=noun, words=words, timeout_s=_GUESS_TIMEOUT_S))


def _shaped(app: AppState, owner_id: str, sketch: Sketch, folder: Path) -> bytes:
    return shape_of(sketch, folder, words=with_others(app, owner_id, []), timeout_s=_SHAPE_TIMEOUT_S)
