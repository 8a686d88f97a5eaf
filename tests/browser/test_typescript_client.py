"""The TypeScript client in Chromium."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")

from playwright.sync_api import Page, Route

from tests.acceptance.service import Service
from tests.typescript_package import built_package

pytestmark = pytest.mark.without_3d

SCENARIO = """async (text) => {
  const { Client } = await import("/client/index.js");
  const client = new Client();
  const file = new File([text], "sphere.obj");
  const seen = [];
  const job = await client.deform(file, { params: { guidance: "target", steps: 4 } }, {
    files: { target: file }, onEvent: (event) => seen.push(event.type),
  });
  const glb = await client.download(job, "result.glb");
  const upload = await client.upload(file);
  const magic = await glb.slice(0, 4).text();
  return { job: job.id, base: client.baseUrl, last: seen.at(-1), magic, state: upload.state };
}"""


def test_the_client_works_in_a_page(
    page: Page, service: Service, repository: Path, small_sphere: Path, tmp_path: Path
) -> None:
    dist = built_package(repository, tmp_path)

    def serve(route: Route) -> None:
        name = route.request.url.rpartition("/")[2]
        route.fulfill(body=(dist / name).read_text(), content_type="text/javascript")

    page.route("**/client/*.js", serve)
    page.goto("/#/jobs")
    found = page.evaluate(SCENARIO, small_sphere.read_text())
    assert found["base"] == str(service.http.base_url).rstrip("/")
    assert (found["last"], found["magic"], found["state"]) == ("succeeded", "glTF", "complete")
    assert service.job(found["job"])["state"] == "succeeded"
