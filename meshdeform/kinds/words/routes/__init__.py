"""Add, list, show, export, draw and delete words of one's own."""

from __future__ import annotations

from functools import partial
from typing import Annotated

from anyio import to_thread
from fastapi import APIRouter, Header, Path, Request, Response
from fastapi.responses import JSONResponse

from meshdeform.api.documents import WordDetail, WordList, WordMesh, WordView
from meshdeform.errors import (
    ConflictError,
    DependencyError,
    NotFoundError,
    ParameterError,
    RequestError,
    RequestTimeoutError,
    StoredFileError,
)
from meshdeform.kinds.words.process import drawn_word
from meshdeform.kinds.words.routes.documents import WordDocument
from meshdeform.kinds.words.routes.making import MESHES, WORD, add_words, remove_contents, view_members
from meshdeform.words.file import NAME, SUFFIX
from meshdeform.words.limits import MAX_NAME
from service.documentation.responses import (
    ASSET_ERRORS,
    BYTES,
    CALLER_ERRORS,
    FILE,
    ONCE_ERRORS,
    REPLAY,
    form_body,
    header,
)
from service.downloads.responses import ConditionsDep, Download, download, download_responses, matches
from service.http.auth import PrincipalDep
from service.http.bodies import body_of, parse_document, receive_document
from service.http.errors import KNOWN_QUERY, answers, problem_responses
from service.http.forms import FormFiles, ReceivedFile, receive_form
from service.http.idempotency import Caller, IdempotencyKey
from service.state import AppStateDep

router = APIRouter(prefix="/v1/words", tags=["words"], dependencies=KNOWN_QUERY)

ROUTERS = (router,)

MODELS = (WordDocument,)

TAGS = ({"name": "words", "description": "Words of your own, which your prompts can name: docs/words.md."},)

_FORM = FormFiles(
    (MESHES, WORD),
    f"Send meshes as fields `{MESHES}` and the JSON document as the field `request`: "
    """curl -F meshes=@FILE -F 'request={"noun": "dragonfruit"}' URL.""",
    repeated=(MESHES,),
)
_Noun = Annotated[
    str,
    Path(description="The word's noun.", pattern=f"^{NAME.pattern}$", max_length=MAX_NAME, examples=["dragonfruit"]),
]
_TAG = {"ETag": header("Identifies the word as it is.", '"9f86d081884c7d65..."')}
_BODY = form_body(
    "WordDocument",
    {
        MESHES: {
            "type": "array",
            "items": FILE,
            "description": "Meshes of the word, or ZIPs of several; the part is repeated.",
        },
        WORD: {**FILE, "description": "Instead of meshes: a file that an export wrote."},
    },
    {
        "meshes": {
            "summary": "Meshes and a noun",
            "value": {MESHES: ["the bytes of fruit.glb"], "request": {"noun": "dragonfruit"}},
        },
        "word": {
            "summary": "An exported file",
            "value": {WORD: "the bytes of fruit.word", "request": {"replace": True}},
        },
    },
    {"example": {"noun": "dragonfruit", MESHES: [{"upload_id": "upl_01kg9zqk2xf3v8c5m7n9p1r4t6"}]}},
)


@router.post(
    "",
    operation_id="add_words",
    summary="Make a word of meshes, or import words",
    status_code=201,
    responses=answers(
        WordList,
        "The new words.",
        *ASSET_ERRORS,
        RequestError,
        ParameterError,
        ConflictError,
        StoredFileError,
        RequestTimeoutError,
        DependencyError,
        *ONCE_ERRORS,
        *CALLER_ERRORS,
        status=201,
        headers=REPLAY,
    ),
    openapi_extra=_BODY,
)
async def post_words(
    request: Request, app: AppStateDep, principal: PrincipalDep, idempotency_key: IdempotencyKey = None
) -> Response:
    """Your prompts know them at once. Nothing is kept if anything is wrong with any mesh.

    It takes one to three seconds a mesh, in a process of its own on the API's machine.
    """
    caller = Caller.of(request, principal, idempotency_key)
    async with app.bodies.slot(principal.owner_id):
        with app.workspace.temporary_folder() as folder:
            kind, length = (request.headers.get(name, "") for name in ("content-type", "content-length"))
            files = dict[str, ReceivedFile]()
            if kind.lower().startswith("application/json"):
                text = await receive_document(request)
            else:
                most = app.settings.max_upload_bytes
                text, files = await receive_form(kind, length, body_of(request), folder, most, _FORM)
            document = parse_document(WordDocument, text, "The field `request`" if files else "The body")
            async with app.wording.slot(principal.owner_id):
                answer = await to_thread.run_sync(add_words, app, caller, document, files, folder)
    return answer.response()


@router.get(
    "",
    summary="List your words",
    responses=answers(WordList, "All your words.", *CALLER_ERRORS),
)
def list_words(app: AppStateDep, principal: PrincipalDep) -> Response:
    """Not paginated: there are at most 200."""
    views = [WordView(**view_members(kept)) for kept in app.record.words.all(principal.owner_id)]
    return JSONResponse(WordList(words=views).as_json())


@router.get(
    "/{noun}",
    summary="Get a word",
    responses=answers(WordDetail, "The word, with its meshes.", NotFoundError, ParameterError, *CALLER_ERRORS),
)
def get_word(app: AppStateDep, principal: PrincipalDep, noun: _Noun) -> Response:
    """Each mesh with the file that it comes from."""
    kept = app.record.words.get(noun, principal.owner_id)
    pairs = zip(kept.told["shapes"], kept.faces, strict=True)
    sources = [WordMesh(**source, faces=faces) for source, faces in pairs]
    return JSONResponse(WordDetail(**view_members(kept), sources=sources).as_json())


@router.delete(
    "/{noun}",
    summary="Delete a word",
    status_code=204,
    response_class=Response,
    responses=answers(None, "The word is deleted.", NotFoundError, ParameterError, *CALLER_ERRORS, status=204),
)
def delete_word(app: AppStateDep, principal: PrincipalDep, noun: _Noun) -> Response:
    """Jobs that have it keep it."""
    remove_contents(app, [app.record.words.delete(noun, principal.owner_id)])
    return Response(status_code=204)


@router.get(
    "/{noun}/content",
    summary="Export a word",
    response_class=Response,
    responses={**download_responses("A file of words."), **problem_responses(ParameterError)},
)
def export_word(
    request: Request, app: AppStateDep, principal: PrincipalDep, noun: _Noun, conditions: ConditionsDep
) -> Response:
    """Its file, for other owners and machines. Several words are the files of each, one after the other."""
    kept = app.record.words.get(noun, principal.owner_id)
    file = Download(kept.key, f"{noun}{SUFFIX}", "application/octet-stream", kept.size, kept.sha256)
    return download(request, app, file, conditions)


@router.get(
    "/{noun}/picture.png",
    summary="Get a picture of a word",
    response_class=Response,
    responses={
        200: {
            "description": "A PNG of its meshes, coloured by their parts; of many, some.",
            "content": BYTES,
            "headers": _TAG,
        },
        304: {"description": "Unchanged: `If-None-Match` holds its `ETag`.", "headers": _TAG},
        **problem_responses(NotFoundError, ParameterError, StoredFileError, DependencyError, *CALLER_ERRORS),
    },
)
async def draw_word(
    app: AppStateDep,
    principal: PrincipalDep,
    noun: _Noun,
    if_none_match: Annotated[
        str | None,
        Header(description="The `ETag` of your copy. Default: none.", max_length=1000, examples=['"9f86d081884c7d65"']),
    ] = None,
) -> Response:
    """It is drawn anew in a few seconds, in a process of its own on the API's machine."""
    kept = await to_thread.run_sync(app.record.words.get, noun, principal.owner_id)
    headers = {"ETag": f'"{kept.sha256}"', "Cache-Control": "private, no-cache"}
    if matches(if_none_match, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    with app.workspace.temporary_folder() as folder:
        async with app.wording.slot(principal.owner_id):
            content = await to_thread.run_sync(partial(app.store.get, kept.key, sha256=kept.sha256))
            picture = await to_thread.run_sync(drawn_word, content, folder)
    return Response(picture, headers=headers, media_type="image/png")
