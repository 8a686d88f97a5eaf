"""The application: parts, routes, errors, and the reconciler beside them."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI
from fastapi.responses import HTMLResponse

from meshdeform import __version__
from meshdeform.jobs.reconciler import Reconciler
from meshdeform.settings import Settings
from service.deps import Parts
from service.errors import add_error_handlers
from service.openapi import describe
from service.reference import reference_page
from service.routes import artifacts, health, jobs

__all__ = ["create_app"]


def create_app(settings: Settings | None = None) -> FastAPI:
    """Return the API.

    Parameters
    ----------
    settings : Settings, optional
        From the environment unless given. The parts that it names are opened when the application starts.
    """
    app = FastAPI(
        title="Meshdeform",
        version=__version__,
        summary="A GLB and a prompt go in, the same asset with a new shape comes out.",
        lifespan=_lifespan,
        # FastAPI's own pages load scripts from another host; `/docs` is ours.
        docs_url=None,
        redoc_url=None,
        separate_input_output_schemas=False,
        redirect_slashes=False,
    )
    app.state.settings = settings
    app.include_router(jobs.router)
    app.include_router(artifacts.router)
    app.include_router(health.router)
    app.add_api_route("/docs", lambda: HTMLResponse(reference_page(app.openapi())), include_in_schema=False)
    add_error_handlers(app)
    describe(app)
    return app


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    settings = app.state.settings or Settings()
    parts = Parts.open(settings)
    app.state.parts = parts
    try:
        with Reconciler(parts.record, parts.queue, settings.max_attempts, store=parts.store):
            yield
    finally:
        parts.close()
