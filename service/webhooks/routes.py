"""Webhooks: enter, look, change, delete; what was sent to them, and sending it again."""

from __future__ import annotations

from typing import Annotated

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
from meshdeform.record.ids import id_pattern
from meshdeform.webhooks.addresses import find_destination, parse_networks
from service.http.auth import PrincipalDep
from service.http.errors import problem_responses
from service.http.queries import KNOWN_QUERY
from service.state import AppState, AppStateDep

__all__ = ["messages", "router"]

router = APIRouter(prefix="/v1/webhooks", tags=["webhooks"], dependencies=KNOWN_QUERY)
messages = APIRouter()
"""What receivers get: OpenAPI's `webhooks`. Nothing here is called."""

_WebhookId = Annotated[
    str,
    Path(
        description="The webhook's id, as `POST /v1/webhooks` gave it.",
        pattern=id_pattern("wh"),
        examples=["wh_01kg9zqk2xf3v8c5m7n9p1r4t6"],
    ),
]
_DeliveryId = Annotated[
    str,
    Path(
        description="The delivery's id, as the list of deliveries gives it.",
        pattern=id_pattern("msg"),
        examples=["msg_01kg9zqk2xf3v8c5m7n9p1r4t7"],
    ),
]
_LOCATION = {
    "Location": {
        "description": "The webhook's URL.",
        "schema": {"type": "string"},
        "example": "/v1/webhooks/wh_01kg9zqk2xf3v8c5m7n9p1r4t6",
    }
}


@router.post(
    "",
    operation_id="create_webhook",
    summary="Ask to be told of events",
    status_code=201,
    responses={
        201: {"model": WebhookWithSecret, "description": "Entered, with its secret.", "headers": _LOCATION},
        **problem_responses(RequestError, ParameterError, WebhookAddressError, UnavailableError),
    },
)
def create_webhook(app: AppStateDep, principal: PrincipalDep, body: NewWebhook) -> Response:
    """The host is resolved and must be public; this is checked again whenever a message is sent."""
    url = _checked(app, body.url)
    webhook, secret = app.record.webhooks.create(principal.owner_id, url, body.events)
    document = WebhookWithSecret.of(webhook, secret=secret)
    return JSONResponse(
        document.model_dump(mode="json"),
        201,
        {"Location": f"/v1/webhooks/{webhook.id}", "Cache-Control": "no-store"},
    )


@router.get(
    "",
    operation_id="list_webhooks",
    summary="List your webhooks",
    responses={
        200: {"model": WebhookList, "description": "All of them."},
        **problem_responses(UnavailableError),
    },
)
def list_webhooks(app: AppStateDep, principal: PrincipalDep) -> Response:
    """There are at most 20, so there are no pages."""
    found = [WebhookView.of(webhook) for webhook in app.record.webhooks.list_webhooks(principal.owner_id)]
    return JSONResponse(WebhookList(webhooks=found).model_dump(mode="json"))


@router.get(
    "/{id}",
    operation_id="get_webhook",
    summary="Look at a webhook",
    responses={
        200: {"model": WebhookView, "description": "The webhook, without its secret."},
        **problem_responses(NotFoundError, UnavailableError),
    },
)
def get_webhook(app: AppStateDep, principal: PrincipalDep, id: _WebhookId) -> Response:  # noqa: A002 - the path's own word
    """Whether it is enabled, and if not, why."""
    return JSONResponse(WebhookView.of(app.record.webhooks.get(id, principal.owner_id)).model_dump(mode="json"))


@router.patch(
    "/{id}",
    operation_id="update_webhook",
    summary="Change a webhook",
    responses={
        200: {"model": WebhookView, "description": "The webhook as it is now."},
        **problem_responses(NotFoundError, ParameterError, WebhookAddressError, UnavailableError),
    },
)
def update_webhook(app: AppStateDep, principal: PrincipalDep, id: _WebhookId, body: WebhookChange) -> Response:  # noqa: A002
    """A new URL holds for what is still pending too. `enabled: true` enables one that `410 Gone` has disabled."""
    # First whether there is one: nobody else's webhook makes this server look a host up.
    app.record.webhooks.get(id, principal.owner_id)
    url = None if body.url is None else _checked(app, body.url)
    webhook = app.record.webhooks.update(id, principal.owner_id, url=url, events=body.events, enabled=body.enabled)
    return JSONResponse(WebhookView.of(webhook).model_dump(mode="json"))


@router.delete(
    "/{id}",
    operation_id="delete_webhook",
    summary="Delete a webhook with its log",
    status_code=204,
    response_class=Response,
    responses={
        204: {"description": "It is gone."},
        **problem_responses(NotFoundError, UnavailableError),
    },
)
def delete_webhook(app: AppStateDep, principal: PrincipalDep, id: _WebhookId) -> Response:  # noqa: A002
    """What is pending is not sent any more; what is on its way may still arrive."""
    app.record.webhooks.delete(id, principal.owner_id)
    return Response(status_code=204)


@router.post(
    "/{id}/rotate",
    operation_id="rotate_webhook",
    summary="Make a new secret",
    responses={
        200: {"model": WebhookWithSecret, "description": "The webhook with its new secret."},
        **problem_responses(NotFoundError, UnavailableError),
    },
)
def rotate_webhook(app: AppStateDep, principal: PrincipalDep, id: _WebhookId) -> Response:  # noqa: A002
    """For 24 hours messages carry two signatures, by the new secret and by the one before."""
    webhook, secret = app.record.webhooks.rotate(id, principal.owner_id)
    document = WebhookWithSecret.of(webhook, secret=secret)
    return JSONResponse(document.model_dump(mode="json"), headers={"Cache-Control": "no-store"})


@router.post(
    "/{id}/test",
    operation_id="test_webhook",
    summary="Send a test message",
    status_code=202,
    responses={
        202: {"model": DeliveryView, "description": "Its delivery."},
        **problem_responses(NotFoundError, ConflictError, UnavailableError),
    },
)
def test_webhook(app: AppStateDep, principal: PrincipalDep, id: _WebhookId) -> Response:  # noqa: A002
    """A message of the type `meshdeform.test`, on the same way as every other one. Look at its delivery to see it."""
    delivery = app.record.webhooks.send_test(id, principal.owner_id)
    return JSONResponse(DeliveryView.of(delivery).model_dump(mode="json"), 202)


@router.get(
    "/{id}/deliveries",
    operation_id="list_deliveries",
    summary="List what was sent to a webhook, newest first",
    responses={
        200: {"model": DeliveryList, "description": "A page of deliveries."},
        **problem_responses(NotFoundError, ParameterError, UnavailableError),
    },
)
def list_deliveries(
    app: AppStateDep,
    principal: PrincipalDep,
    id: _WebhookId,  # noqa: A002
    state: Annotated[
        DeliveryState | None, Query(description="Only deliveries in this state. Default: all.", examples=["failed"])
    ] = None,
    limit: Annotated[int, Query(description="Length of a page.", ge=1, le=200, examples=[50])] = 50,
    cursor: Annotated[
        str | None,
        Query(
            description="`next_cursor` of the page before. Default: the first page.",
            max_length=200,
            examples=["bXNnXzAxa2c5enFrMnhmM3Y4YzVtN245cDFyNHQ3"],
        ),
    ] = None,
) -> Response:
    """Kept for 30 days."""
    page = app.record.webhooks.deliveries(id, principal.owner_id, state=state, cursor=cursor, limit=limit)
    found = [DeliveryView.of(delivery) for delivery in page.deliveries]
    return JSONResponse(DeliveryList(deliveries=found, next_cursor=page.next_cursor).model_dump(mode="json"))


@router.get(
    "/{id}/deliveries/{delivery_id}",
    operation_id="get_delivery",
    summary="Look at a delivery",
    responses={
        200: {"model": DeliveryDetail, "description": "What is sent, and every attempt."},
        **problem_responses(NotFoundError, UnavailableError),
    },
)
def get_delivery(app: AppStateDep, principal: PrincipalDep, id: _WebhookId, delivery_id: _DeliveryId) -> Response:  # noqa: A002
    """Of an answer only its status is kept."""
    delivery = app.record.webhooks.delivery(id, delivery_id, principal.owner_id)
    return JSONResponse(DeliveryDetail.of_log(delivery).model_dump(mode="json"))


@router.post(
    "/{id}/deliveries/{delivery_id}/replay",
    operation_id="replay_delivery",
    summary="Send a message again",
    status_code=202,
    responses={
        202: {"model": DeliveryView, "description": "The new delivery."},
        **problem_responses(NotFoundError, ConflictError, UnavailableError),
    },
)
def replay_delivery(app: AppStateDep, principal: PrincipalDep, id: _WebhookId, delivery_id: _DeliveryId) -> Response:  # noqa: A002
    """The same message with the same `webhook-id`: a receiver that has dealt with it drops it."""
    delivery = app.record.webhooks.replay(id, delivery_id, principal.owner_id)
    return JSONResponse(DeliveryView.of(delivery).model_dump(mode="json"), 202)


def _checked(app: AppState, url: str) -> str:
    return str(find_destination(url, parse_networks(app.settings.webhook_networks)).url)


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
            410: {"description": "Not wanted any more: the webhook is disabled."},
            "default": {"description": "Any other answer, or none within 15 seconds: it is sent again later."},
        },
    )
    def message(
        body: JobMessage,
        webhook_id: Annotated[
            str,
            Header(
                description="The message's id: the same for every attempt and every replay.",
                pattern=id_pattern("msg"),
                examples=["msg_01kg9zqk2xf3v8c5m7n9p1r4t7"],
            ),
        ],
        webhook_timestamp: Annotated[
            int, Header(description="When this attempt was sent, seconds since 1970.", ge=0, examples=[1769860800])
        ],
        webhook_signature: Annotated[
            str,
            Header(
                description="One signature, or two while the secret is being changed, apart by a space.",
                max_length=200,
                examples=["v1,K5oZfzN95Z9UVu1EsfQmfVNQhnkZ2pj9o9NDN/H/pI4="],
            ),
        ],
    ) -> None:
        """Sent to the webhook's URL. How to verify it: docs/webhooks.md."""


_HAPPENED = {
    WebhookEvent.QUEUED: "a job was accepted",
    WebhookEvent.STARTED: "a worker began an attempt",
    WebhookEvent.RECOVERED: "a worker gave a job back or fell silent, and it is queued again",
    WebhookEvent.CANCELING: "a running job is to stop",
    WebhookEvent.SUCCEEDED: "a job has its results",
    WebhookEvent.FAILED: "a job ended with an error",
    WebhookEvent.CANCELED: "a job was canceled",
    WebhookEvent.EXPIRED: "a job's deadline was over before it was",
}
for _event in WebhookEvent:
    _describe(_event)
