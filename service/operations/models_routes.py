"""List the models that jobs may use."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import APIRouter
from fastapi.responses import JSONResponse

from meshdeform.priors.catalogue import list_models
from service.documentation.responses import CALLER_ERRORS
from service.http.auth import PrincipalDep
from service.http.errors import problem_responses
from service.http.queries import KNOWN_QUERY
from service.operations.model_documents import ModelList, ModelView
from service.state import AppStateDep

__all__ = ["router"]

router = APIRouter(prefix="/v1/models", tags=["models"], dependencies=KNOWN_QUERY)


@router.get(
    "",
    operation_id="list_models",
    summary="List the models that jobs may use",
    responses={
        200: {"model": ModelList, "description": "The models of this server, the default one first."},
        **problem_responses(*CALLER_ERRORS),
    },
)
def get_models(app: AppStateDep, principal: PrincipalDep) -> JSONResponse:
    """Each model with its availability and vocabulary. Prompts made of its words are accepted.

    The models of this server come first, then those that the caller's jobs of kind `prior_teach` have made, newest
    first.
    """
    settings = app.settings
    found = list_models(settings.model, settings.further_models, settings.model_revision, public=True)
    found += app.taught.of(principal.owner_id)
    views = [ModelView.model_validate(asdict(model)) for model in found]
    return JSONResponse(ModelList(default=views[0].id, models=views).model_dump(mode="json"))
