"""Create the application: its routes, middleware, error handlers and background tasks."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from anyio import to_thread
from fastapi import FastAPI

from meshdeform import __version__
from meshdeform.errors import LimitError, UnauthorizedError
from meshdeform.record.reconciler import Reconciler
from meshdeform.requests.kind_folders import kind_modules
from meshdeform.serving.access import check_origins
from meshdeform.settings import Settings
from meshdeform.support.memory import return_freed_memory
from meshdeform.support.telemetry import start_tracing, stop_tracing
from meshdeform.webhooks.delivery import WebhookDelivery
from service.documentation.responses import describe
from service.downloads import routes as download_routes
from service.events import routes as event_routes
from service.events.waiting import on_termination
from service.http.auth import Gate
from service.http.errors import add_error_handlers, problem_responses
from service.http.middleware import RequestFrame, TracingMiddleware
from service.http.origins import CrossOrigin, HeadAsGet
from service.jobs import creation_routes, preview_routes
from service.jobs import routes as job_routes
from service.jobs.arrivals import give_up_fetching
from service.operations import routes as operation_routes
from service.operations.metrics import Metrics, MetricsMiddleware
from service.page import routes as page_routes
from service.state import AppState
from service.uploads import routes as upload_routes
from service.webhooks import routes as webhook_routes

_RETURN_MEMORY_S = 30.0  # seldom: the pages that are needed again have to be fetched again

_log = logging.getLogger(__name__)
_NO_KEY = (
    "Every request is refused, because no API key exists. Create one: meshdeform keys create --owner me. "
    "With Docker: docker compose exec service meshdeform keys create --owner me"
)


def create_app(settings: Settings | None = None) -> FastAPI:
    """Create the API; its settings are by default those of the environment. Connections are opened when it starts."""
    app = FastAPI(
        title="Meshdeform",
        version=__version__,
        summary="Send a GLB and a prompt, get the same asset with a new shape.",
        lifespan=_lifespan,
        # FastAPI's own pages load scripts from another host.
        docs_url=None,
        redoc_url=None,
        separate_input_output_schemas=False,
        generate_unique_id_function=lambda route: route.name,
        redirect_slashes=False,
    )
    app.webhooks.include_router(webhook_routes.messages)
    app.state.settings = settings
    app.state.metrics = Metrics()
    app.add_middleware(HeadAsGet, router=app.router)
    app.add_middleware(TracingMiddleware)
    app.add_middleware(MetricsMiddleware, metrics=app.state.metrics)
    refusals = problem_responses(UnauthorizedError, LimitError)
    app.include_router(job_routes.router, responses=refusals)
    app.include_router(creation_routes.router, responses=refusals)
    app.include_router(preview_routes.router, responses=refusals)
    app.include_router(event_routes.router, responses=refusals)
    app.include_router(download_routes.checkpoints, responses=refusals)
    app.include_router(download_routes.artifacts, responses=refusals)
    app.include_router(download_routes.sources, responses=refusals)
    app.include_router(webhook_routes.router, responses=refusals)
    app.include_router(upload_routes.router, responses=refusals)
    app.include_router(upload_routes.content)
    for brings in kind_modules("routes"):
        for router in brings.ROUTERS:
            app.include_router(router, responses=refusals)
    app.include_router(operation_routes.router, responses=refusals)
    app.include_router(operation_routes.health)
    app.router.routes += page_routes.routes
    add_error_handlers(app)
    describe(app)
    _wrap_outermost(app)
    # A malformed form is the client's mistake and reported in the response, not in the log.
    logging.getLogger("python_multipart").setLevel(logging.ERROR)
    return app


def _wrap_outermost(app: FastAPI) -> None:
    """Put what every answer needs outside the handler of unexpected errors, where `add_middleware` cannot put it."""
    build = app.build_middleware_stack
    app.build_middleware_stack = lambda: RequestFrame(CrossOrigin(build(), app))  # type: ignore[method-assign]


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    settings = app.state.settings or Settings()
    check_origins(settings)
    start_tracing("api")
    # A program that brings its own settings is more than a server.
    state = AppState.open(settings, alone=app.state.settings is None)
    app.state.app_state = state
    app.state.gate = Gate(settings, state.record.keys)
    if settings.auth == "on" and not state.record.keys.any_active():
        _log.warning(_NO_KEY)
    app.state.metrics.watch(state.record, settings.queue)
    try:
        with (
            Reconciler(
                state.background,
                state.queue,
                settings.max_attempts,
                settings.lease_s,
                store=state.store,
                max_running=settings.max_running_jobs,
            ),
            WebhookDelivery(state.background, settings),
            on_termination(state.waiters.close),
        ):
            returning = asyncio.create_task(_return_memory(state))
            try:
                async with state.waiters.running():
                    yield
            finally:
                returning.cancel()
                await give_up_fetching(state)
    finally:
        app.state.gate.close()
        state.close()
        stop_tracing()


async def _return_memory(state: AppState) -> None:
    while True:
        await asyncio.sleep(_RETURN_MEMORY_S)
        await to_thread.run_sync(state.previews.tidy)
        return_freed_memory()
