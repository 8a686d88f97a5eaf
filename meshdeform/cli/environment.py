"""Load settings overridden by flags, and require installed packages."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from meshdeform.errors import DependencyError, ParameterError, install_command

if TYPE_CHECKING:
    from meshdeform.settings import Settings

__all__ = ["load_settings", "require"]


def load_settings(**flags: Any) -> Settings:
    """Return the settings from the environment, overridden by the flags that are not None.

    Raises
    ------
    ParameterError
        A flag or a variable is not valid.
    """
    from pydantic import ValidationError

    from meshdeform.settings import Settings

    try:
        return Settings(**{name: value for name, value in flags.items() if value is not None})
    except ValidationError as error:
        first = error.errors()[0]
        name = str(first["loc"][0])
        variable = f"MESHDEFORM_{name.upper()}"
        source = variable if flags.get(name) is None else f"--{name.replace('_', '-')}"
        reason = first["msg"].removeprefix("Value error, ").rstrip(".")
        raise ParameterError(
            f"{source} is not valid: {reason[:1].lower()}{reason[1:]}.",
            advice=f"Correct {source}; docs/configuration.md describes {variable}.",
        ) from error


def require(module: str, extra: str) -> None:
    """Raise DependencyError unless `module` can be imported; `extra` is the extra that installs it."""
    if find_spec(module) is None:
        raise DependencyError(
            f"This command needs {module}, which is not installed.",
            advice=f"Install it: {install_command(extra)}.",
        )
