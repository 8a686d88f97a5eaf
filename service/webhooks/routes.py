"""Create, read, update and delete webhooks; list their deliveries and send them again."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import Annotated, Any

import anyio
from anyio import to_thread
from fastapi import APIRouter, Header, Path, Query, Response
from fastapi.responses import JSONResponse

from meshdeform.api.webhooks import (
    DeliveryDetail,
    DeliveryList,
    DeliveryState,
    DeliveryView,
    JobMessage,
    NewWebhook,
    WebhookChange,
    WebhookEvent,
    WebhookList,
    WebhookSecret,
    WebhookView,
    WebhookWithSecret,
)
from meshdeform.errors import (
    ConflictError,
    NotFoundError,
    ParameterError,
    RequestError,
    UnavailableError,
    WebhookAddressError,
)
from meshdeform.outgoing.addresses import find_destination, parse_networks
from meshdeform.outgoing.lookups import LOOKUP_S
from meshdeform.record.ids import id_pattern
from meshdeform.record.webhooks import Webhook
from service.documentation.responses import header
from service.http.auth import PrincipalDep
from service.http.errors import KNOWN_QUERY, answers
from service.state import AppState, AppStateDep

router = APIRouter(prefix="/v1/webhooks", tags=["webhooks"], dependencies=KNOWN_QUERY)
messages = APIRouter()
"""The messages that receivers get, for OpenAPI's `webhooks`. These routes are never called."""

_WebhookId = Annotated[
    str,
    Path(
        description="The webhook's id, from `POST /v1/webhooks`.",
        pattern=id_pattern("wh"),
        examples=["wh_01kg9zqk2xf3v8c5m7n9p1r4t6"],
    ),
]
_DeliveryId = Annotated[
    str,
    Path(
        description="The delivery's id, from the list of deliveries.",
        pattern=id_pattern("msg"),
        examples=["msg_01kg9zqk2xf3v8c5m7n9p1r4t7"],
    ),
]
_LOCATION = {"Location": header("The webhook's URL.", "/v1/webhooks/wh_01kg9zqk2xf3v8c5m7n9p1r4t6")}
_HAPPENED = {
    WebhookEvent.QUEUED: "a job was accepted",
    WebhookEvent.STARTED: "a worker started an attempt",
    WebhookEvent.RECOVERED: "a job was requeued because its worker shut down or was lost",
    WebhookEvent.CANCELING: "cancellation of a running job was requested",
    WebhookEvent.SUCCEEDED: "a job succeeded",
    WebhookEvent.FAILED: "a job failed",
    WebhookEvent.CANCELED: "a job was canceled",
    WebhookEvent.EXPIRED: "a job did not finish before its deadline",
}


@router.post(
    "",
    summary="Create a webhook",
    status_code=201,
    responses=answers(
        WebhookWithSecret,
        "The new webhook with its secret.",
        RequestError,
        ParameterError,
        WebhookAddressError,
        UnavailableError,
        status=201,
        headers=_LOCATION,
    ),
)
async def create_webhook(app: AppStateDep, principal: PrincipalDep, body: NewWebhook) -> Response:
    """The host is resolved and must be public. This is checked again for every message."""
    url = await checked_address(app, principal.owner_id, body.url)
    webhook, secret = await to_thread.run_sync(app.record.webhooks.create, principal.owner_id, url, body.events)
    return JSONResponse(
        _with_secret(webhook, secret),
        201,
        {"Location": f"/v1/webhooks/{webhook.id}", "Cache-Control": "no-store"},
    )


@router.get(
    "",
    summary="List your webhooks",
    responses=answers(WebhookList, "All your webhooks.", UnavailableError),
)
def list_webhooks(app: AppStateDep, principal: PrincipalDep) -> Response:
    """Not paginated: there are at most 20."""
    views = [WebhookView.model_validate(each) for each in app.record.webhooks.list_webhooks(principal.owner_id)]
    return JSONResponse(WebhookList(webhooks=views).model_dump(mode="json"))


@router.get(
    "/secret",
    summary="Get your account's secret",
    responses=answers(WebhookSecret, "The secret.", UnavailableError),
)
def get_webhook_secret(app: AppStateDep, principal: PrincipalDep) -> Response:
    """It signs the messages to the `webhook` that a job's request names, and never changes. Others have their own."""
    document = WebhookSecret(secret=app.record.webhooks.account_secret(principal.owner_id))
    return JSONResponse(document.model_dump(mode="json"), headers={"Cache-Control": "no-store"})


@router.get(
    "/{id}",
    summary="Get a webhook",
    responses=answers(WebhookView, "The webhook, without its secret.", NotFoundError, UnavailableError),
)
def get_webhook(app: AppStateDep, principal: PrincipalDep, id: _WebhookId) -> Response:
    """Shows whether it is enabled, and if not, why."""
    webhook = app.record.webhooks.get(id, principal.owner_id)
    return JSONResponse(WebhookView.model_validate(webhook).model_dump(mode="json"))


@router.patch(
    "/{id}",
    summary="Update a webhook",
    responses=answers(
        WebhookView, "The updated webhook.", NotFoundError, ParameterError, WebhookAddressError, UnavailableError
    ),
)
async def update_webhook(
    app: AppStateDep,
    principal: PrincipalDep,
    id: _WebhookId,
    body: WebhookChange,
) -> Response:
    """A new URL also applies to pending messages. `enabled: true` re-enables a webhook disabled by `410 Gone`."""
    # Check the owner first: a request for somebody else's webhook must not cause a DNS lookup.
    webhooks, owner = app.record.webhooks, principal.owner_id
    await to_thread.run_sync(webhooks.get, id, owner)
    url = None if body.url is None else await checked_address(app, owner, body.url)
    update = partial(webhooks.update, id, owner, url=url, events=body.events, enabled=body.enabled)
    webhook = await to_thread.run_sync(update)
    return JSONResponse(WebhookView.model_validate(webhook).model_dump(mode="json"))


@router.delete(
    "/{id}",
    summary="Delete a webhook and its log",
    status_code=204,
    response_class=Response,
    responses=answers(None, "Deleted.", NotFoundError, UnavailableError, status=204),
)
def delete_webhook(app: AppStateDep, principal: PrincipalDep, id: _WebhookId) -> Response:
    """Cancels pending messages; one that is being sent may still arrive."""
    app.record.webhooks.delete(id, principal.owner_id)
    return Response(status_code=204)


@router.post(
    "/{id}/rotate",
    summary="Rotate the secret",
    responses=answers(WebhookWithSecret, "The webhook with its new secret.", NotFoundError, UnavailableError),
)
def rotate_webhook(app: AppStateDep, principal: PrincipalDep, id: _WebhookId) -> Response:
    """For 24 hours, messages have two signatures: one by the new secret and one by the previous secret."""
    webhook, secret = app.record.webhooks.rotate(id, principal.owner_id)
    return JSONResponse(_with_secret(webhook, secret), headers={"Cache-Control": "no-store"})


@router.post(
    "/{id}/test",
    summary="Send a test message",
    status_code=202,
    responses=answers(
        DeliveryView, "The delivery of the test message.", NotFoundError, ConflictError, UnavailableError, status=202
    ),
)
def test_webhook(app: AppStateDep, principal: PrincipalDep, id: _WebhookId) -> Response:
    """Sends a message of type `meshdeform.test` like any other. Its delivery shows the outcome."""
    delivery = app.record.webhooks.send_test(id, principal.owner_id)
    return JSONResponse(DeliveryView.model_validate(delivery).model_dump(mode="json"), 202)


@router.get(
    "/{id}/deliveries",
    summary="List the deliveries of a webhook, newest first",
    responses=answers(DeliveryList, "A page of deliveries.", NotFoundError, ParameterError, UnavailableError),
)
def list_deliveries(
    app: AppStateDep,
    principal: PrincipalDep,
    id: _WebhookId,
    state: Annotated[
        DeliveryState | None, Query(description="Only deliveries in this state. Default: all.", examples=["failed"])
    ] = None,
    limit: Annotated[int, Query(description="Maximum length of a page.", ge=1, le=200, examples=[50])] = 50,
    cursor: Annotated[
        str | None,
        Query(
            description="`next_cursor` of the previous page. Default: the first page.",
            max_length=200,
            examples=["bXNnXzAxa2c5enFrMnhmM3Y4YzVtN245cDFyNHQ3"],
        ),
    ] = None,
) -> Response:
    """Deliveries are kept for 30 days."""
    page = app.record.webhooks.deliveries(id, principal.owner_id, state=state, cursor=cursor, limit=limit)
    return JSONResponse(DeliveryList.model_validate(page).model_dump(mode="json"))


@router.get(
    "/{id}/deliveries/{delivery_id}",
    summary="Get a delivery",
    responses=answers(DeliveryDetail, "The message and all its attempts.", NotFoundError, UnavailableError),
)
def get_delivery(app: AppStateDep, principal: PrincipalDep, id: _WebhookId, delivery_id: _DeliveryId) -> Response:
    """Of the receiver's responses only the status is kept."""
    delivery = app.record.webhooks.delivery(id, delivery_id, principal.owner_id)
    return JSONResponse(DeliveryDetail.model_validate(delivery).model_dump(mode="json"))


@router.post(
    "/{id}/deliveries/{delivery_id}/replay",
    summary="Send a message again",
    status_code=202,
    responses=answers(DeliveryView, "The new delivery.", NotFoundError, ConflictError, UnavailableError, status=202),
)
def replay_delivery(app: AppStateDep, principal: PrincipalDep, id: _WebhookId, delivery_id: _DeliveryId) -> Response:
    """Sends the same message with the same `webhook-id`: receivers ignore one that they have processed."""
    delivery = app.record.webhooks.replay(id, delivery_id, principal.owner_id)
    return JSONResponse(DeliveryView.model_validate(delivery).model_dump(mode="json"), 202)


def _with_secret(webhook: Webhook, secret: str) -> dict[str, Any]:
    view = WebhookView.model_validate(webhook)
    return WebhookWithSecret(**view.model_dump(), secret=secret).model_dump(mode="json")


async def checked_address(app: AppState, owner: str, url: str) -> str:
    """Return the URL of a webhook of this owner after looking its host up; `WebhookAddressError`: it is not allowed."""
    networks = parse_networks(app.settings.webhook_networks, "MESHDEFORM_WEBHOOK_NETWORKS")
    future = app.webhook_lookups.submit(owner, lambda: find_destination(url, networks, WebhookAddressError))
    try:
        with anyio.fail_after(LOOKUP_S):
            return str((await asyncio.wrap_future(future)).url)
    except TimeoutError as error:
        raise UnavailableError(
            f"The URL's host could not be resolved within {LOOKUP_S:g} s.", advice="Try again in a moment."
        ) from error


def _describe(event: WebhookEvent) -> None:
    name = event.value.replace(".", "_")

    @messages.post(
        event.value,
        operation_id=f"on_{name}",
        summary=f"`{event.value}`: {_HAPPENED[event]}",
        tags=["webhooks"],
        status_code=204,
        response_class=Response,
        responses={
            204: {"description": "Any status from 200 to 299: received."},
            410: {"description": "No longer wanted: disables the webhook."},
            "default": {"description": "Any other response, or none within 15 seconds: the message is retried later."},
        },
    )
    def message(
        body: JobMessage,
        webhook_id: Annotated[
            str,
            Header(
                description="The message's id, the same for all attempts and replays.",
                pattern=id_pattern("msg"),
                examples=["msg_01kg9zqk2xf3v8c5m7n9p1r4t7"],
            ),
        ],
        webhook_timestamp: Annotated[
            int, Header(description="Time of this attempt, in seconds since 1970.", ge=0, examples=[1769860800])
        ],
        webhook_signature: Annotated[
            str,
            Header(
                description="One signature, or two separated by a space after a rotation of the secret.",
                max_length=200,
                examples=["v1,K5oZfzN95Z9UVu1EsfQmfVNQhnkZ2pj9o9NDN/H/pI4="],
            ),
        ],
    ) -> None:
        """Sent to the webhook's URL. How to verify it: docs/webhooks.md."""


for _event in WebhookEvent:
    _describe(_event)
