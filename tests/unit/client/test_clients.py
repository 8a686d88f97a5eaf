"""The two clients offer the same, and what they are told from outside is checked early."""

from __future__ import annotations

import importlib.util
import inspect
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import httpx
import pytest

import meshdeform
from meshdeform.client import AsyncClient, Client
from meshdeform.client import __all__ as exported
from service import schemas
from tests.cases import each_case

KEY = "md_secret"


def test_the_client_for_threads_is_made_of_the_other(repository: Path) -> None:
    script = importlib.util.spec_from_file_location("sync_client", repository / "scripts" / "sync_client.py")
    assert script is not None
    assert script.loader is not None
    module = importlib.util.module_from_spec(script)
    script.loader.exec_module(module)
    assert module.MADE.read_text() == module.made(), "run: python scripts/sync_client.py"
    # What the words of the generator must not miss.
    assert "await" not in module.made().replace("awaits", "")
    assert "Async" not in module.made()
    assert inspect.iscoroutinefunction(AsyncClient.submit)
    assert not inspect.iscoroutinefunction(Client.submit)


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
