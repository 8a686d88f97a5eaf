"""The container files say true things: files that exist, settings that exist, pinned images, no root."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import jsonschema_rs
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from meshdeform.settings import Settings
from tests.cases import each_case

COMPOSE = ["docker-compose.yml", "docker/gpu.yml"]
DOCKERFILES = ["docker/service.Dockerfile", "docker/worker.Dockerfile"]


@each_case("name", COMPOSE)
def test_compose_files_are_of_the_specification_and_name_settings_and_images_that_exist(
    name: str, repository: Path
) -> None:
    # The Compose Specification's own schema (Apache-2.0), beside this file.
    schema = json.loads((Path(__file__).parent / "compose_spec.json").read_text())
    document = yaml.safe_load((repository / name).read_text())
    jsonschema_rs.Draft7Validator(schema).validate({key: value for key, value in document.items() if key[:2] != "x-"})
    known = {f"MESHDEFORM_{field.upper()}" for field in Settings.model_fields}
    for service in document["services"].values():
        used = {key for key in service.get("environment", {}) if key.startswith("MESHDEFORM_")}
        assert used <= known
        if dockerfile := service.get("build", {}).get("dockerfile"):
            assert (repository / dockerfile).is_file()
        if "image" in service and "build" not in service:
            # Down to the last number: 16.10, not 16.
            assert re.fullmatch(r"[\w/]+:v?\d+\.\d+[\w.-]*", service["image"])


def test_every_container_has_no_more_than_it_needs(repository: Path) -> None:
    for name, service in yaml.safe_load((repository / "docker-compose.yml").read_text())["services"].items():
        assert service["read_only"] is True, name
        assert "/tmp" in service["tmpfs"], name
        assert service["cap_drop"] == ["ALL"], name
        assert service["security_opt"] == ["no-new-privileges:true"], name
        assert "cap_add" not in service, name
        assert "privileged" not in service, name
        # The images of the project and of curl have users of their own; s3 is root, without any capability.
        assert (str(service.get("user", "")).split(":")[0] in {"0", "root"}) == (name == "s3"), name
        ports = service.get("ports", [])
        assert all(port.startswith("127.0.0.1:") for port in ports), name
        assert name in ("service", "s3") or ports == []


def test_no_secret_has_a_default_and_the_example_names_them_all(repository: Path) -> None:
    text = (repository / "docker-compose.yml").read_text()
    required = set(re.findall(r"(?<!\$)\$\{(\w+):\?", text))
    optional = set(re.findall(r"(?<!\$)\$\{(\w+):-", text))
    assert required == {"POSTGRES_PASSWORD", "REDIS_PASSWORD", "S3_ACCESS_KEY", "S3_SECRET_KEY"}
    assert optional == {"MESHDEFORM_MODEL", "MESHDEFORM_AUTH", "S3_PUBLIC_URL"}
    example = (repository / ".env.example").read_text()
    assert set(re.findall(r"^(?:# )?(\w+)=", example, re.MULTILINE)) == required | optional
    assert re.findall(r"^\w*(?:PASSWORD|SECRET)\w*=(.+)$", example, re.MULTILINE) == []
    assert ".env" in (repository / ".gitignore").read_text().splitlines()


def test_what_the_images_install_is_pinned(repository: Path) -> None:
    lines = (repository / "docker/constraints.txt").read_text().splitlines()
    pinned = dict(line.split("==") for line in lines if not line.startswith("#"))
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    asked = [*project["dependencies"]]
    for extra in ("stack", "asset", "service", "worker", "sd", "otel"):
        asked += project["optional-dependencies"][extra]
    for requirement in map(Requirement, asked):
        if requirement.name not in {"meshdeform", "torch"}:
            assert requirement.specifier.contains(pinned[canonicalize_name(requirement.name)]), requirement
    assert "torch" not in pinned


@each_case("name", DOCKERFILES)
def test_images_are_pinned_run_without_root_and_copy_what_the_ignore_file_lets_through(
    name: str, repository: Path
) -> None:
    lines = (repository / name).read_text().splitlines()
    bases = [line.split()[1] for line in lines if line.startswith("FROM ")]
    assert bases
    assert all(re.fullmatch(r"python:3\.11\.\d+-slim-\w+", base) for base in bases)
    users = [line.split()[1] for line in lines if line.startswith("USER ")]
    assert users == ["10001:10001"]  # a number: what starts containers can tell that it is not root
    allowed = {
        line.removeprefix("!") for line in (repository / ".dockerignore").read_text().splitlines() if line[:1] == "!"
    }
    for line in lines:
        if line.startswith("COPY ") and "--from" not in line:
            sources = set(line.split()[1:-1])
            assert sources <= allowed
            assert all((repository / source).exists() for source in sources)
