"""The container files say true things: files that exist, settings that exist, pinned images, no root."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from meshdeform.settings import Settings

COMPOSE = ["docker-compose.yml", "docker/gpu.yml"]
DOCKERFILES = ["docker/service.Dockerfile", "docker/worker.Dockerfile"]


def services(repository: Path, name: str) -> dict[str, dict[str, Any]]:
    """Return the services of a compose file."""
    return dict(yaml.safe_load((repository / name).read_text())["services"])


@pytest.mark.parametrize("name", COMPOSE)
def test_every_setting_in_compose_exists(name: str, repository: Path) -> None:
    known = {f"MESHDEFORM_{field.upper()}" for field in Settings.model_fields}
    used = {key for service in services(repository, name).values() for key in service.get("environment", {})}
    assert {key for key in used if key.startswith("MESHDEFORM_")} <= known


def test_compose_builds_from_files_that_exist_and_pins_the_rest(repository: Path) -> None:
    for service in services(repository, "docker-compose.yml").values():
        if "build" in service:
            assert (repository / service["build"]["dockerfile"]).is_file()
        else:
            assert re.fullmatch(r"[\w/]+:\d[\w.-]*", service["image"])


def test_everything_that_is_waited_for_has_a_health_check(repository: Path) -> None:
    found = services(repository, "docker-compose.yml")
    for service in found.values():
        for name, how in service.get("depends_on", {}).items():
            assert how == {"condition": "service_healthy"}
            assert "healthcheck" in found[name]


@pytest.mark.parametrize("name", DOCKERFILES)
def test_images_are_pinned_and_run_without_root(name: str, repository: Path) -> None:
    lines = (repository / name).read_text().splitlines()
    bases = [line.split()[1] for line in lines if line.startswith("FROM ")]
    assert bases
    assert all(re.fullmatch(r"python:3\.11-slim-\w+", base) for base in bases)
    users = [line.split()[1] for line in lines if line.startswith("USER ")]
    assert users == ["meshdeform"]


@pytest.mark.parametrize("name", DOCKERFILES)
def test_what_an_image_copies_passes_the_ignore_file(name: str, repository: Path) -> None:
    allowed = {
        line.removeprefix("!") for line in (repository / ".dockerignore").read_text().splitlines() if line[:1] == "!"
    }
    for line in (repository / name).read_text().splitlines():
        if line.startswith("COPY ") and "--from" not in line:
            sources = set(line.split()[1:-1])
            assert sources <= allowed
            assert all((repository / source).exists() for source in sources)


def test_both_images_write_as_the_same_user(repository: Path) -> None:
    found = {re.search(r"--uid (\d+)", (repository / name).read_text()) for name in DOCKERFILES}
    assert {match and match.group(1) for match in found} == {"10001"}
