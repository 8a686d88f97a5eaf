"""Settings overridden by flags, installed packages, and the service that a command speaks to: address and API key."""

from __future__ import annotations

import contextlib
import os
import shlex
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from meshdeform.errors import DependencyError, MeshdeformError, ParameterError, install_command
from meshdeform.serving import DEFAULT_URL

if TYPE_CHECKING:
    from meshdeform.client import Client
    from meshdeform.settings import Settings


def load_settings(**flags: Any) -> Settings:
    """Return the settings from the environment, overridden by the flags that are not None."""
    from pydantic import ValidationError

    from meshdeform.requests.problems import reason
    from meshdeform.settings import Settings

    try:
        return Settings(**{name: value for name, value in flags.items() if value is not None})
    except ValidationError as error:
        first = error.errors()[0]
        name = str(first["loc"][0])
        variable = f"MESHDEFORM_{name.upper()}"
        source = variable if flags.get(name) is None else f"--{name.replace('_', '-')}"
        problem = reason(first).rstrip(".")
        end = "" if problem.endswith("?") else "."
        raise ParameterError(
            f"{source} is not valid: {problem[:1].lower()}{problem[1:]}{end}",
            advice=f"Correct {source}; docs/configuration.md describes {variable}.",
        ) from error


def require(module: str, extra: str) -> None:
    """Raise DependencyError unless `module` can be imported; `extra` is the extra that installs it."""
    if find_spec(module) is None:
        raise DependencyError(
            f"This command needs {module}, which is not installed.",
            advice=f"Install it: {install_command(extra)}.",
        )


def service_url(url: str | None) -> str:
    """Return the service's address: the option or MESHDEFORM_URL (typer merges them), else the default on this machine.

    Another than an http or https URL is a `typer.BadParameter`.
    """
    from urllib.parse import urlsplit

    address = (url or DEFAULT_URL).rstrip("/")
    try:
        parts = urlsplit(address)
        valid = parts.scheme in ("http", "https") and bool(parts.hostname) and (parts.port or 1) > 0
    except ValueError:
        valid = False
    if not valid:
        raise typer.BadParameter(f"{address!r} is not an address such as {DEFAULT_URL}", param_hint="--url")
    return address


def connect(url: str | None, api_key: str | None, api_key_file: Path | None, **more: Any) -> Client:
    """Return a client of the service, which the caller closes; nothing is sent yet. `more`: as of `Client`."""
    from meshdeform.client import Client

    return Client(service_url(url), api_key=read_key(api_key, api_key_file), **more)


def command_line(command: str, url: str | None) -> str:
    """Return a `meshdeform` command line to copy, with `--url` where the address is not the default."""
    option = f" --url {shlex.quote(url)}" if url and url not in (os.environ.get("MESHDEFORM_URL"), DEFAULT_URL) else ""
    return f"meshdeform {command}{option}"


def read_key(api_key: str | None, path: Path | None) -> str | None:
    """Return the API key: the option, else the word in the file, else the environment variable.

    A file that cannot be read, or does not hold exactly one key, is a `typer.BadParameter`.
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


def complete_models(incomplete: str) -> Iterator[tuple[str, str]]:
    """Complete the models in the settings."""
    models = {"builtin": "the demonstration model that ships with Meshdeform"}
    with contextlib.suppress(MeshdeformError):
        settings = load_settings()
        for name in (settings.model, *settings.allowed_models):
            models.setdefault(name, "from the settings")
    yield from ((name, text) for name, text in models.items() if name.startswith(incomplete))
