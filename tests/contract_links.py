"""Add OpenAPI `links`, of which Schemathesis makes chains of requests."""

from __future__ import annotations

from typing import Any

__all__ = ["add_links"]

_BODY_ID = {"id": "$response.body#/id"}
_SAME_ID = {"id": "$request.path.id"}
_FIRST_ARTIFACT = {**_SAME_ID, "name": "$response.body#/artifacts/0/name"}
_FIRST_CHECKPOINT = {**_SAME_ID, "step": "$response.body#/checkpoints/0/step"}
_DELIVERY = {**_SAME_ID, "delivery_id": "$response.body#/id"}
_OF_A_JOB = (
    "get_job",
    "get_asset",
    "get_events",
    "cancel_job",
    "retry_job",
    "list_artifacts",
    "list_checkpoints",
    "delete_job",
)
_OF_A_WEBHOOK = (
    "get_webhook",
    "update_webhook",
    "rotate_webhook",
    "test_webhook",
    "list_deliveries",
    "delete_webhook",
)
_OF_AN_UPLOAD = ("get_upload", "complete_upload", "delete_upload")

# By operation: the status of the response, and the operations that can follow with their parameters.
_LINKS: dict[str, tuple[str, dict[str, dict[str, str]]]] = {
    "create_job": ("202", dict.fromkeys(_OF_A_JOB, _BODY_ID)),
    "retry_job": ("202", dict.fromkeys(_OF_A_JOB, _BODY_ID)),
    "branch_job": ("202", dict.fromkeys(_OF_A_JOB, _BODY_ID)),
    "list_jobs": ("200", {"list_jobs": {"cursor": "$response.body#/next_cursor"}}),
    "get_job": (
        "200",
        {
            "get_file": {**_BODY_ID, "part": "asset"},
            **dict.fromkeys(("get_asset", "get_events", "cancel_job", "list_artifacts", "delete_job"), _BODY_ID),
        },
    ),
    "cancel_job": ("200", dict.fromkeys(("get_job", "get_events", "retry_job", "delete_job"), _BODY_ID)),
    "get_events": ("200", {"get_events": {**_SAME_ID, "after": "$response.body#/next_after"}}),
    "list_artifacts": (
        "200",
        dict.fromkeys(("get_artifact", "sign_artifact"), _FIRST_ARTIFACT),
    ),
    "list_checkpoints": (
        "200",
        dict.fromkeys(("get_checkpoint_mesh", "branch_job"), _FIRST_CHECKPOINT),
    ),
    "create_upload": ("201", dict.fromkeys(_OF_AN_UPLOAD, _BODY_ID)),
    "create_webhook": ("201", dict.fromkeys(_OF_A_WEBHOOK, _BODY_ID)),
    "test_webhook": (
        "202",
        dict.fromkeys(("get_delivery", "replay_delivery"), _DELIVERY),
    ),
}


def add_links(document: dict[str, Any]) -> None:
    """Add the links to an OpenAPI document, which must have every operation and status that one refers to."""
    operations = {
        operation["operationId"]: operation
        for methods in document["paths"].values()
        for operation in methods.values()
        if isinstance(operation, dict) and "operationId" in operation
    }
    for source, (status, targets) in _LINKS.items():
        links = operations[source]["responses"][status].setdefault("links", {})
        for target, parameters in targets.items():
            summary = operations[target]["summary"]
            links[target] = {"operationId": target, "parameters": parameters, "description": f"{summary}."}
