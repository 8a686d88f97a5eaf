"""Connect a command to its service: address and API key."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from meshdeform.serving.defaults import DEFAULT_URL

if TYPE_CHECKING:
    from meshdeform.client import Client

__all__ = ["command_line", "connect", "read_key", "service_url"]


def service_url(url: str | None) -> str:
    """Return the service's address: the option or MESHDEFORM_URL (typer merges them), else the default on this machine.

    Raises
    ------
    typer.BadParameter
        It is not an http or https URL.
    """
    from urllib.parse import urlsplit

    found = (url or DEFAULT_URL).rstrip("/")
    try:
        parts = urlsplit(found)
        valid = parts.scheme in ("http", "https") and bool(parts.hostname) and (parts.port or 1) > 0
    except ValueError:
        valid = False
    if not valid:
        raise typer.BadParameter(f"{found!r} is not an address such as {DEFAULT_URL}", param_hint="--url")
    return found


def connect(
    url: str | None, api_key: str | None, api_key_file: Path | None, *, timeout_s: float = 60.0, max_retries: int = 4
) -> Client:
    """Return a client of the service, which the caller closes; nothing is sent yet.

    Parameters
    ----------
    url : str, optional
    api_key, api_key_file : str, Path, optional
        As in `read_key`.
    timeout_s : float
        The longest wait for one response, in seconds.
    max_retries : int
        How often a request without a response is repeated.
    """
    from meshdeform.client import Client

    key = read_key(api_key, api_key_file)
    return Client(service_url(url), api_key=key, timeout_s=timeout_s, max_retries=max_retries)


def command_line(command: str, url: str | None) -> str:
    """Return a `meshdeform` command line to copy, with `--url` where the address is not the default."""
    place = f" --url {shlex.quote(url)}" if url and url not in (os.environ.get("MESHDEFORM_URL"), DEFAULT_URL) else ""
    return f"meshdeform {command}{place}"


def read_key(api_key: str | None, path: Path | None) -> str | None:
    """Return the API key: the option, else the word in the file, else the environment variable.

    Raises
    ------
    typer.BadParameter
        The file cannot be read or does not hold exactly one key.
    """
    # typer also passes the environment variable as the option; a file named on the command line goes before it.
    if path is None or (api_key and api_key != os.environ.get("MESHDEFORM_API_KEY")):
        return api_key or None
    try:
        words = path.read_text(encoding="utf-8").split()
    except (OSError, UnicodeDecodeError) as error:
        raise typer.BadParameter(f"{path} cannot be read: {error}", param_hint="--api-key-file") from error
    if len(words) != 1:
        raise typer.BadParameter(f"{path} holds {len(words)} words, not one key", param_hint="--api-key-file")
    return words[0]
