"""Describe a job to post. Each request has its own idempotency key, so that a retry does not create a second job."""

from __future__ import annotations

import json
import os
import re
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from meshdeform.client.sources import AssetLike
from meshdeform.requests.document import DeformParams, OutputOptions

__all__ = ["Files", "Order", "Output", "Params", "checked_key", "parts_of", "refer"]

Params = DeformParams | Mapping[str, Any]
Output = OutputOptions | Mapping[str, Any]


@dataclass(frozen=True)
class Order:
    """The description of a job; for members that are None the service chooses. See `Client.submit`."""

    prompt: str = ""
    params: Params | None = None
    output: Output | None = None
    metadata: Mapping[str, str] | None = None
    priority: int | None = None
    deadline_s: float | None = None
    retention_s: float | None = None
    kind: str | None = None

    def document(self) -> dict[str, Any]:
        """Return the JSON document.

        Raises
        ------
        TypeError, ValueError
            It cannot be written as JSON: a value of another type, or a number that is not finite.
        """
        members = {
            "kind": self.kind,
            "prompt": self.prompt,
            "params": self.params,
            "output": self.output,
            "metadata": self.metadata,
            "priority": self.priority,
            "deadline_s": self.deadline_s,
            "retention_s": self.retention_s,
        }
        given = {name: value for name, value in members.items() if value is not None}
        # Not validated here: the service validates and reports all errors.
        document: dict[str, Any] = json.loads(json.dumps(given, default=_plain, allow_nan=False))
        return document


@dataclass(frozen=True)
class Files:
    """The files of a job, and how to send them. See `Client.submit`."""

    parts: Mapping[str, AssetLike]
    filename: str | None = None
    upload: bool | None = None
    key: str = ""

    @classmethod
    def of(
        cls,
        asset: AssetLike | None,
        target: AssetLike | None,
        files: Mapping[str, AssetLike] | None,
        filename: str | None,
        upload: bool | None,
        key: str | None,
    ) -> Files:
        """Return the files by part with the given key, or a new one.

        Raises
        ------
        ValueError
            The key is not valid in a header, or a file is given twice.
        """
        return cls(parts_of(files, asset=asset, target=target), filename, upload, checked_key(key))


def parts_of(files: Mapping[str, AssetLike] | None, **named: AssetLike | None) -> dict[str, AssetLike]:
    """Return the files by part, those with arguments of their own first.

    Raises
    ------
    ValueError
        A file is given twice.
    """
    parts = {name: file for name, file in named.items() if file is not None}
    if twice := sorted(parts.keys() & (files or {}).keys()):
        raise ValueError(f"Give {', '.join(twice)} once, as an argument or in `files`.")
    return {**parts, **(files or {})}


def checked_key(key: str | None) -> str:
    """Return the given key for a request, or a new one.

    Raises
    ------
    ValueError
        The key is empty, longer than 255 characters, or has other than visible ASCII characters.
    """
    if key is None:
        return uuid.uuid4().hex
    if not re.fullmatch(r"[\x21-\x7e]{1,255}", key):
        raise ValueError("An idempotency key must have 1 to 255 visible ASCII characters.")
    return key


def refer(document: dict[str, Any], name: str, reference: Mapping[str, str]) -> None:
    """Name a stored file in a document; those of `text_deform` in the way that older services understand, too."""
    if name in ("asset", "target"):
        document[name] = reference
    else:
        document.setdefault("files", {})[name] = reference


def _plain(value: Any) -> Any:
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_unset=True)
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"{type(value).__name__} is not a JSON value")
