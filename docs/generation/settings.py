"""Generate the reference in docs/configuration.md: every setting with its default, its bounds and its meaning."""

from __future__ import annotations

from typing import Any

from docs.generation.between import renewed
from meshdeform.settings import Settings

__all__ = ["GROUPS", "page"]

GROUPS: dict[str, tuple[str, str]] = {
    "Where things lie": (
        "data_dir cache_dir words database_url redis_url storage_url storage_public_url",
        "",
    ),
    "Models": ("model model_revision dtype allowed_models", ""),
    "The worker": (
        "device threads queue lease_s turn_s max_running_jobs max_run_s max_attempts retry_delay_s step_timeout_s "
        "checkpoints_kept",
        "",
    ),
    "Requests to other hosts": ("fetch_assets fetch_networks webhook_networks", ""),
    "Who may ask": (
        "web auth allowed_hosts cors_origins trusted_proxies requests_per_minute max_active_jobs max_priority "
        "max_stored_bytes max_uploads max_uploads_bytes max_words max_words_bytes",
        "",
    ),
    "Logs": ("log_format", ""),
    "Limits": (
        "max_upload_bytes max_json_bytes max_accessor_elements max_triangles max_steps",
        "A file over a limit is `asset_too_large`, before anything is allocated.",
    ),
    "How long things are kept": ("retention_s upload_ttl_s signed_url_ttl_s", "In seconds."),
}
"""Title of each group, the names of its settings, and a sentence about all of them."""


def page(text: str) -> str:
    """Return docs/configuration.md with its reference regenerated."""
    schemas = Settings.model_json_schema()["properties"]
    named = [name for names, _ in GROUPS.values() for name in names.split()]
    if sorted(named) != sorted(schemas):
        raise ValueError(f"settings without a group, or twice in one: {sorted(set(schemas) ^ set(named))}")
    parts = []
    for title, (names, about) in GROUPS.items():
        parts += [f"## {title}", *([about] if about else [])]
        parts += [_section(name, schemas[name]) for name in names.split()]
    return renewed(text, "meshdeform/settings.py", "\n\n".join(parts) + "\n")


def _section(name: str, schema: dict[str, Any]) -> str:
    default = Settings.model_fields[name].get_default(call_default_factory=True)
    meaning, _, told = (Settings.model_fields[name].description or "").partition(" Default: ")
    value = told.rstrip(".") or ("none" if default in ("", []) else f"`{default}`{_readable(default)}")
    limits = [f"at {word} {schema[key]:,g}" for key, word in _BOUNDS.items() if schema.get(key)]
    return f"### MESHDEFORM_{name.upper()}\n\nDefault: {'; '.join([value, *limits])}.\n\n{meaning}"


_BOUNDS = {"minimum": "least", "maximum": "most"}


def _readable(default: Any) -> str:
    """Return a number of bytes in MiB or GiB, in brackets."""
    if not isinstance(default, int) or default < 2**20 or default % 2**20:
        return ""
    return f" ({default // 2**30} GiB)" if default % 2**30 == 0 else f" ({default // 2**20} MiB)"
