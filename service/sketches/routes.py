"""Recognise drawings, and make the shapes of corrected parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from anyio import to_thread
from fastapi import APIRouter, Query, Request, Response

from meshdeform.api.documents import SketchGuess, SketchGuesses, SketchParameter
from meshdeform.errors import (
    DependencyError,
    DrawingError,
    ModelError,
    ParameterError,
    RequestError,
    RequestTimeoutError,
    readable_size,
)
from meshdeform.requests.sketches import SKETCH_FAMILIES, Sketch, sketch_family
from meshdeform.runs.sketch_process import guesses_of, shape_of
from service.documentation.responses import CALLER_ERRORS, json_body
from service.http.auth import PrincipalDep
from service.http.bodies import parse_document, receive_document, receive_file
from service.http.callers import while_waited_for
from service.http.errors import KNOWN_QUERY, problem_responses
from service.state import AppStateDep

router = APIRouter(prefix="/v1/sketches", tags=["sketches"], dependencies=KNOWN_QUERY)

_MAX_BYTES = 20_000_000
_GUESS_TIMEOUT_S = 120.0
_SHAPE_TIMEOUT_S = 30.0
_Family = Annotated[
    str | None,
    Query(
        description="Family of the drawing; no other is considered. Default: all are.",
        examples=["vase"],
        json_schema_extra={"enum": list(SKETCH_FAMILIES)},
    ),
]


@router.post(
    ":guess",
    operation_id="guess_sketch",
    summary="Guess what a drawing shows",
    responses={
        200: {"model": SketchGuesses, "description": "The likeliest shapes."},
        **problem_responses(
            DrawingError,
            ParameterError,
            ModelError,
            RequestError,
            RequestTimeoutError,
            DependencyError,
            *CALLER_ERRORS,
        ),
    },
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
async def guess_sketch(request: Request, app: AppStateDep, principal: PrincipalDep, family: _Family = None) -> Response:
    """Three families with all parameters, their ranges and a mesh each.

    It takes a second or two, in a process of its own on the API's machine.
    """
    async with app.bodies.slot(principal.owner_id):
        with app.workspace.temporary_folder() as folder:
            drawing = folder / "drawing"
            too_large = DrawingError(f"The drawing's file is larger than {readable_size(_MAX_BYTES)}.")
            await receive_file(request, drawing, _MAX_BYTES, too_large)
            async with while_waited_for(request), app.sketching.slot(principal.owner_id):
                guesses = await to_thread.run_sync(_guessed, drawing, family or "")
    return Response(guesses.model_dump_json(), media_type="application/json")


@router.post(
    ":mesh",
    operation_id="make_sketch_mesh",
    summary="Make a shape of a family",
    response_class=Response,
    responses={
        200: {
            "description": "The shape as a GLB, one node for each of its closed solids.",
            "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
        },
        **problem_responses(ParameterError, RequestError, RequestTimeoutError, DependencyError, *CALLER_ERRORS),
    },
    openapi_extra=json_body("Sketch", {"family": "vase", "values": {"lip": 0.2, "handles": "two"}}),
)
async def make_sketch_mesh(request: Request, app: AppStateDep, principal: PrincipalDep) -> Response:
    """A mesh of these parameters, which a job can take as its target."""
    sketch = parse_document(Sketch, await receive_document(request))
    with app.workspace.temporary_folder() as folder:
        async with while_waited_for(request), app.sketching.slot(principal.owner_id):
            data = await to_thread.run_sync(_shaped, sketch, folder)
    # As described: code generators know no other media type for bytes.
    return Response(data, media_type="application/octet-stream")


def _guessed(drawing: Path, family: str) -> SketchGuesses:
    guesses = guesses_of(drawing, family=family, timeout_s=_GUESS_TIMEOUT_S)
    return SketchGuesses(guesses=[_guess(each) for each in guesses["guesses"]], unsure=guesses["unsure"])


def _guess(document: dict[str, Any]) -> SketchGuess:
    """Return the document about a guess of `meshdeform.runs.sketch_process.guesses_of`."""
    family, values = sketch_family(document["family"]), document["values"]
    numbers = [
        SketchParameter(
            name=each.name, value=values[each.name], default=each.default, minimum=each.low, maximum=each.high
        )
        for each in family.numbers
    ]
    choices = [
        SketchParameter(name=each.name, value=values[each.name], default=each.default, options=list(each.options))
        for each in family.choices
    ]
    return SketchGuess(
        family=family.name, probability=document["probability"], parameters=numbers + choices, mesh=document["mesh"]
    )


def _shaped(sketch: Sketch, folder: Path) -> bytes:
    return shape_of(sketch, folder, timeout_s=_SHAPE_TIMEOUT_S)
