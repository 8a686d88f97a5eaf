"""The web page over real sockets: its files, and what their headers say."""

from __future__ import annotations

import gzip
import json
import re
import zlib
from collections.abc import Callable, Iterator
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import httpx
import pytest

from meshdeform.requests.declaration import FORM
from meshdeform.requests.document import DeformParams, OutputParams, Safeguard
from meshdeform.requests.parameters import OF_OPTIMISER
from meshdeform.settings import Settings
from service.page.routes import PAGE_HEADERS
from tests.cases import each_case
from tests.integration.conftest import DEADLINE_S, serving, serving_api
from tests.integration.http_calls import check_problem

# What browsers insist on: module scripts, styles and WebAssembly of any other type are refused.
TYPES = {
    "": "text/plain",
    ".css": "text/css",
    ".glb": "model/gltf-binary",
    ".html": "text/html",
    ".js": "text/javascript",
    ".json": "application/json",
    ".md": "text/markdown",
    ".ndf": "application/octet-stream",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
    ".wasm": "application/wasm",
    ".webmanifest": "application/manifest+json",
    ".webp": "image/webp",
    ".woff2": "font/woff2",
    ".zip": "application/zip",
}


@pytest.fixture(scope="module")
def http(own_settings: Callable[..., Settings]) -> Iterator[httpx.Client]:
    """A client without a key, of a service that wants keys."""
    with serving_api(own_settings(auth="on")) as api:
        yield api.http


def test_the_page_needs_no_key_and_may_load_and_run_only_what_is_its_own(http: httpx.Client) -> None:
    page = http.get("/")
    assert (page.status_code, page.headers["content-type"]) == (200, "text/html; charset=utf-8")
    for path in ("/v1/jobs", "/v1/models"):
        check_problem(http.get(path), 401, "unauthorized")
    for name, value in PAGE_HEADERS.items():
        assert page.headers[name] == value
    policy = dict(rule.split(" ", 1) for rule in page.headers["content-security-policy"].split("; "))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == "'self' 'wasm-unsafe-eval'"
    assert policy["style-src"] == "'self'"
    assert "unsafe-inline" not in str(policy)
    assert "http" not in str(policy)
    for answer in (http.get("/web/nothing.js"), http.get("/v1/jobs")):
        assert answer.headers["content-security-policy"] == "default-src 'none'; frame-ancestors 'none'"


def test_every_file_of_the_page_comes_as_it_lies_there(http: httpx.Client, repository: Path) -> None:
    root = repository / "service" / "web"
    paths = sorted(path for path in root.rglob("*") if path.is_file() and not path.name.startswith("."))
    assert root / "index.html" in paths
    for path in paths:
        name = path.relative_to(root).as_posix()
        answer = http.get(f"/web/{name}", headers={"Accept-Encoding": "identity"})
        assert (answer.status_code, answer.content) == (200, path.read_bytes()), name
        assert "content-encoding" not in answer.headers
        assert answer.headers["content-type"].partition(";")[0] == TYPES[path.suffix], name


def test_the_page_learns_the_parameters_from_their_declaration(http: httpx.Client) -> None:
    answer = http.get("/web/parameters.json")
    assert answer.headers["content-type"] == "application/json"
    assert answer.headers["content-security-policy"] == PAGE_HEADERS["Content-Security-Policy"]
    assert answer.headers["content-encoding"] == "gzip"
    schema = answer.json()
    assert schema.pop("x-output") == OutputParams().model_dump(mode="json")
    assert set(schema.pop("x-unused")["exemplar"]) == {*OF_OPTIMISER, "preset"}
    assert schema == DeformParams.model_json_schema()
    groups = [schema, schema["$defs"]["PromptGuidanceParams"], schema["$defs"]["ExemplarGuidanceParams"]]
    forms = {name: it[FORM] for group in groups for name, it in group["properties"].items() if FORM in it}
    assert {"steps", "learning_rate", "safeguard", "negative_prompt", "strength"} <= set(forms)
    assert all({"label", "help"} <= set(form) for form in forms.values())
    assert {value for value, _ in forms["safeguard"]["choices"]} == set(Safeguard)


def test_llms_txt_names_operations_that_exist(http: httpx.Client, openapi: dict[str, Any]) -> None:
    answer = http.get("/llms.txt")
    assert (answer.status_code, answer.headers["content-type"]) == (200, "text/plain; charset=utf-8")
    known = set(openapi["paths"])
    for path in re.findall(r"(?:POST|GET) (v1/[\w:/{}]+)", answer.text):
        assert f"/{path}" in known, path
    for link in re.findall(r"\]\(([^)]+)\)", answer.text):
        assert http.get(f"/{link}").status_code == 200, link


def test_the_page_is_asked_for_again_and_costs_nothing_then(http: httpx.Client) -> None:
    for accepted in ("gzip", "identity"):
        headers = {"Accept-Encoding": accepted}
        first = http.get("/", headers=headers)
        assert first.headers["cache-control"] == "no-cache"
        assert first.headers["vary"] == "Accept-Encoding"
        again = http.get("/", headers={**headers, "If-None-Match": first.headers["etag"]})
        assert (again.status_code, again.content) == (304, b"")
        assert again.headers["etag"] == first.headers["etag"]
        assert again.headers["content-security-policy"] == PAGE_HEADERS["Content-Security-Policy"]
        head = http.head("/", headers=headers)
        assert (head.status_code, head.content) == (200, b"")
        assert head.headers["etag"] == first.headers["etag"]
    refused = http.post("/")
    assert (refused.status_code, refused.headers["allow"]) == (405, "GET, HEAD")


def test_files_of_the_page_are_kept_until_one_changes(http: httpx.Client, repository: Path) -> None:
    files = re.findall(r'="(web/[^"]+)"', http.get("/").text)
    edition = files[0].split("/")[1]
    assert re.fullmatch("~[0-9a-f]{16}", edition)
    for name in files:
        assert name.startswith(f"web/{edition}/")
        answer = http.get(f"/{name}")
        assert answer.content == (repository / "service" / name.replace(f"{edition}/", "")).read_bytes()
        assert answer.headers["cache-control"] == "public, max-age=31536000, immutable"
        assert answer.headers["content-security-policy"] == PAGE_HEADERS["Content-Security-Policy"]
    for other in ("web", "web/~0123456789abcdef"):
        assert http.get(f"/{other}/app/main.js").headers["cache-control"] == "no-cache"


def test_text_comes_compressed_where_that_is_understood(http: httpx.Client, repository: Path) -> None:
    content = (repository / "service" / "web" / "index.html").read_bytes()
    with http.stream("GET", "/web/index.html", headers={"Accept-Encoding": "br;q=1, gzip;q=0.5"}) as answer:
        assert answer.headers["content-encoding"] == "gzip"
        raw = b"".join(answer.iter_raw())
    assert len(raw) < len(content)
    assert zlib.decompress(raw, 31) == gzip.decompress(raw) == content
    for other in ("identity", "br", ""):
        plain = http.get("/web/index.html", headers={"Accept-Encoding": other})
        assert "content-encoding" not in plain.headers
    # One tag for both forms: so it names the file and not the bytes.
    assert plain.headers["etag"] == answer.headers["etag"]
    assert plain.headers["etag"].startswith("W/")


@each_case(
    "path",
    [
        "/web",
        "/web/",
        "/web/..",
        "/web/../app.py",
        "/web/../../pyproject.toml",
        "/web/%2e%2e/app.py",
        "/web/..%2fapp.py",
        "/web//etc/passwd",
        "/web/%2fetc%2fpasswd",
        "/web/index.html%00.js",
        "/web/none.js",
        "/index.html",
    ],
)
def test_nothing_beside_the_page_is_served(http: httpx.Client, path: str) -> None:
    # Not by httpx, which would tidy the path up.
    connection = HTTPConnection(http.base_url.host, http.base_url.port, timeout=DEADLINE_S)
    try:
        connection.request("GET", path)
        answer = connection.getresponse()
        assert (answer.status, json.loads(answer.read())["code"]) == (404, "not_found")
    finally:
        connection.close()


def test_a_service_can_do_without_the_page(own_settings: Callable[..., Settings]) -> None:
    with serving(own_settings(web="off")) as url:
        for path in ("/", "/web/index.html"):
            check_problem(httpx.get(f"{url}{path}"), 404, "not_found")
        assert httpx.get(f"{url}/openapi.json").status_code == 200
