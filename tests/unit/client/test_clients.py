"""The two clients offer the same, and what they are told from outside is checked early."""

from __future__ import annotations

import ast
import inspect
import json
import subprocess
import sys
from typing import Any

import httpx
import pytest

import meshdeform
from meshdeform.client import AsyncClient, AsyncResult, Client, Result
from meshdeform.client import __all__ as exported
from service import schemas
from tests.cases import each_case

KEY = "md_secret"


def methods(kind: type) -> dict[str, Any]:
    return {name: value for name, value in inspect.getmembers(kind, callable) if not name.startswith("_")}


@each_case(("one", "other"), [(Client, AsyncClient), (Result, AsyncResult)])
def test_both_have_the_same_methods_with_the_same_parameters(one: type, other: type) -> None:
    ours, theirs = methods(one), methods(other)
    if one is Client:
        assert theirs.pop("aclose")
        assert ours.pop("close")
    assert ours.keys() == theirs.keys()
    for name, method in ours.items():
        mine, its = inspect.signature(method), inspect.signature(theirs[name])
        assert mine.parameters == its.parameters, name
        returned = str(mine.return_annotation).replace("Iterator[", "AsyncIterator[")
        assert str(its.return_annotation) in (returned, f"Async{returned}"), name
        is_iterator = str(its.return_annotation).startswith("AsyncIterator")
        assert inspect.iscoroutinefunction(theirs[name]) is not is_iterator, name
        assert method.__doc__, name
        assert theirs[name].__doc__, name


def test_the_package_gives_them_and_loads_nothing_before() -> None:
    probe = """
import json, sys
import meshdeform
before = sorted(sys.modules)
names = [meshdeform.Client, meshdeform.AsyncClient, meshdeform.Result, meshdeform.WaitTimeoutError]
print(json.dumps([before, sorted(sys.modules), [name.__name__ for name in names]]))
"""
    done = subprocess.run([sys.executable, "-c", probe], check=True, capture_output=True, text=True)
    before, after, names = json.loads(done.stdout)
    assert not {"httpx", "pydantic", "anyio", "meshdeform.errors", "meshdeform.client"} & set(before)
    assert {"httpx", "meshdeform.client"} <= set(after)
    assert names == ["Client", "AsyncClient", "Result", "WaitTimeoutError"]


def test_every_name_of_the_package_is_there() -> None:
    for name in meshdeform.__all__:
        assert getattr(meshdeform, name) is not None
        assert name in dir(meshdeform)
    for name in exported:
        assert getattr(meshdeform.client, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'Clinet'"):
        _ = meshdeform.Clinet


def answering(seen: list[httpx.Request], **options: Any) -> Client:
    def handle(request: httpx.Request) -> httpx.Response:
        seen.append(request)
        return httpx.Response(200, json={"default": "builtin", "models": []})

    return Client(http=httpx.Client(transport=httpx.MockTransport(handle)), **options)


def test_address_and_key_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[httpx.Request] = []
    assert Client().base_url == "http://127.0.0.1:8765"
    monkeypatch.setenv("MESHDEFORM_URL", "https://example.com/mesh/")
    monkeypatch.setenv("MESHDEFORM_API_KEY", KEY)
    client = answering(seen)
    assert client.models().models == []
    assert str(seen[0].url) == "https://example.com/mesh/v1/models"
    assert seen[0].headers["Authorization"] == f"Bearer {KEY}"
    assert seen[0].headers["User-Agent"] == f"meshdeform/{meshdeform.__version__}"
    assert KEY not in repr(client)
    assert KEY not in repr(vars(client))
    answering(seen, base_url="http://other", api_key="").models()
    assert seen[1].url.host == "other"
    assert "Authorization" not in seen[1].headers


@each_case(
    ("answered", "link"),
    [
        ("/v1/jobs/j/artifacts/result.glb?signature=s", "https://x/mesh/v1/jobs/j/artifacts/result.glb?signature=s"),
        ("/#/shared/j/token", "https://x/mesh/#/shared/j/token"),
        ("https://bucket/result.glb?X-Amz-Signature=s", "https://bucket/result.glb?X-Amz-Signature=s"),
    ],
)
def test_links_are_absolute_and_tell_no_password(answered: str, link: str) -> None:
    document = {"url": answered, "expires_at": "2026-01-31T13:00:00Z"}
    transport = httpx.MockTransport(lambda _: httpx.Response(200, json=document))
    client = Client("https://user:secret@x/mesh/", http=httpx.Client(transport=transport))
    assert client.signed_url("j", "result.glb").url == client.job_link("j").url == link


@each_case(
    ("options", "words"),
    [
        ({"base_url": "127.0.0.1:8765"}, "not a URL"),
        ({"base_url": "ftp://x"}, "not a URL"),
        ({"base_url": "http://"}, "not a URL"),
        ({"api_key": "md_a\n"}, "invalid characters"),
        ({"timeout_s": 0}, "timeout_s"),
        ({"max_retries": -1}, "max_retries"),
    ],
)
@each_case("kind", [Client, AsyncClient])
def test_what_cannot_be_right_is_refused_at_once(kind: type, options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        kind(**options)


def test_an_id_is_one_segment_of_a_path() -> None:
    seen: list[httpx.Request] = []
    client = answering(seen)
    for name in ("../../healthz", "a/b", "?x=1", "..", "a b#c"):
        client.delete(name)
        assert seen[-1].url.raw_path.startswith(b"/v1/jobs/")
        assert seen[-1].url.raw_path.count(b"/") == 3
        assert seen[-1].url.query == b""
    with pytest.raises(ValueError, match="empty"):
        client.get("")


def test_keys_of_requests_are_checked() -> None:
    client = answering([])
    for key in ("", "with space", "ä", "x" * 256):
        with pytest.raises(ValueError, match="255 visible"):
            client.retry("job_1", idempotency_key=key)


def test_the_documents_have_the_services_members() -> None:
    from meshdeform.client import documents

    for name in ("AssetFound", "JobEstimate", "Validation", "UploadView"):
        ours, theirs = getattr(documents, name).model_fields, getattr(schemas, name).model_fields
        assert ours.keys() == theirs.keys(), name
    for name in ("FileLimits", "JobLimits", "RequestLimits", "UploadLimits"):
        ours, theirs = getattr(documents, name).model_fields, getattr(schemas, name).model_fields
        assert ours.keys() <= theirs.keys(), name


def test_no_logic_is_written_twice() -> None:
    """A method of a client hands its arguments to an operation, and nothing else."""
    for kind in (Client, AsyncClient):
        for name, method in methods(kind).items():
            tree = ast.parse("class _:\n" + inspect.getsource(method))
            found = [node for node in ast.walk(tree) if isinstance(node, ast.For | ast.While | ast.Try | ast.With)]
            assert not found, name
