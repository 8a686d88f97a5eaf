"""The TypeScript client in Chromium, as the page has it: it is the one that is built (tests/integration)."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from playwright.sync_api import Page

from tests.acceptance.service import Service

pytestmark = pytest.mark.without_3d

SCENARIO = """async (text) => {
  const { Client } = await import("/web/client/index.js");
  const client = new Client();
  const file = new File([text], "sphere.obj");
  const seen = [];
  const job = await client.deform(file, { params: { guidance: { kind: "target" }, steps: 4 } }, {
    files: { target: file }, onEvent: (event) => seen.push(event.type),
  });
  const glb = await client.download(job, "result.glb");
  const upload = await client.upload(file);
  const magic = await glb.slice(0, 4).text();
  return { job: job.id, base: client.baseUrl, last: seen.at(-1), magic, state: upload.state };
}"""


def test_the_client_works_in_a_page(page: Page, service: Service, repository: Path, small_sphere: Path) -> None:
    page.goto("/#/jobs")
    base = str(service.http.base_url).rstrip("/")
    found = page.evaluate(SCENARIO, small_sphere.read_text())
    assert found["base"] == base
    assert (found["last"], found["magic"], found["state"]) == ("succeeded", "glTF", "complete")
    assert service.job(found["job"])["state"] == "succeeded"

    # What its README shows first, in a few steps.
    shown = re.findall(r"^```ts\n(.*?)^```", (repository / "clients/typescript/README.md").read_text(), re.M | re.S)[0]
    for old, new in (
        ('import { Client } from "meshdeform";', 'const { Client } = await import("/web/client/index.js");'),
        ('{ baseUrl: "https://meshdeform.example", apiKey: "..." }', json.dumps({"baseUrl": base})),
        ("seed: 7", "seed: 7, steps: 4"),
    ):
        assert shown.count(old) == 1
        shown = shown.replace(old, new)
    program = f"""async (text) => {{
      const file = new File([text], "sphere.obj");
      {shown}
      return {{ job: job.id, files: [await glb.slice(0, 4).text(), await half.slice(0, 4).text()] }};
    }}"""
    found = page.evaluate(program, small_sphere.read_text())
    assert found["files"] == ["glTF", "glTF"]
    job = service.job(found["job"])
    assert (job["prompt"], job["params"]["steps"], job["params"]["seed"]) == ("a tall vase", 4, 7)
