"""Load settings overridden by flags, and require installed packages."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from meshdeform.errors import DependencyError, ParameterError

if TYPE_CHECKING:
    from meshdeform.settings import Settings

__all__ = ["load_settings", "require"]


def load_settings(**flags: Any) -> Settings:
    """Return the settings from the environment, overridden by the flags that are not None."""
    from pydantic import ValidationError

    from meshdeform.settings import Settings

    try:
        return Settings(**{name: value for name, value in flags.items() if value is not None})
    except ValidationError as error:
        first = error.errors()[0]
        name = "_".join(str(part) for part in first["loc"])
        raise ParameterError(
            f"The setting {name} is not valid: {first['msg']}.",
            advice=f"Fix --{name.replace('_', '-')} or MESHDEFORM_{name.upper()}.",
        ) from error


def require(module: str, extra: str) -> None:
    """Raise DependencyError unless `module` can be imported; `extra` is the extra that installs it."""
    if find_spec(module) is None:
        raise DependencyError(
            f"This command needs {module}, which is not installed.",
            advice=f'Install it: pip install "meshdeform[{extra}]".',
        )
