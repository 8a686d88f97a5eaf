"""The TypeScript client in Node.js, on a real service."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from urllib.parse import urlsplit

from meshdeform.requests.document import JobKind
from tests.fake_kind import FakeKind
from tests.fault_proxy import FaultProxy
from tests.integration.conftest import Api
from tests.typescript_package import built_package
from tests.worker_world import working


def test_the_client_goes_from_a_file_to_a_result(api: Api, repository: Path, tmp_path: Path) -> None:
    dist = built_package(repository, tmp_path)
    sphere, port = repository / "examples/sphere.glb", urlsplit(api.url).port
    assert port is not None
    kind = FakeKind()
    kind.on_step = lambda step: time.sleep(0.02 if step > 12 else 0)  # what is canceled lasts: it has 5,000 steps
    with working(api.settings, kind.start), FaultProxy(port) as proxy:
        proxy.cut_after(901)
        command = [shutil.which("node") or "node", repository / "tests/node/client_scenario.mjs"]
        addresses = [(dist / "index.js").as_uri(), api.url, f"http://127.0.0.1:{proxy.port}"]
        done = subprocess.run([*command, *addresses, sphere], capture_output=True, text=True, check=False, timeout=300)
        connections = proxy.connections
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["vertices"] > 0
    # Every answer was lost once, and yet each request was carried out once.
    assert found["posts"].count("/v1/jobs") >= 6
    assert len(api.http.get("/v1/jobs", params={"q": "mushroom"}).json()["jobs"]) == 2
    assert found["sameJob"]
    assert found["seqs"] == list(range(1, len(found["seqs"]) + 1))
    assert found["ended"]
    assert found["broken"] == found["seqs"]
    assert connections >= 2, "the line broke"
    assert found["later"] == ["succeeded"]
    assert (found["progress"][-1], found["uploadState"], found["fromUpload"]) == (
        sphere.stat().st_size,
        "complete",
        "succeeded",
    )
    assert found["listed"] == [True, False, True]
    assert int(found["result"]) > 12
    assert found["artifacts"] == ["result.glb"]
    assert found["sent"] == sphere.stat().st_size
    assert found["signed"]
    assert found["longer"] == [True, 7200]
    assert (found["retired"]["code"], found["retired"]["status"]) == ("kind_retired", 422)
    assert found["missing"]["code"] == found["deleted"]["code"] == "not_found"
    assert found["refused"]["code"] == "prompt_unknown_words"
    assert found["refused"]["advice"]
    assert found["nobody"] == {"ours": True, "code": "unavailable", "status": 0, "name": "MeshdeformError"} | {
        "advice": found["nobody"]["advice"]
    }
    assert found["abandoned"]["name"] == "AbortError"
    assert JobKind.TEXT_DEFORM in found["limits"]


def test_the_page_has_the_client_as_it_is_built(repository: Path, tmp_path: Path) -> None:
    dist = built_package(repository, tmp_path)

    def check(folder: Path) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, repository / "scripts/vendor-client", "--check", "--dist", dist, "--folder", folder]
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=240)

    done = check(repository / "service/web/client")
    assert done.returncode == 0, done.stdout
    other = shutil.copytree(repository / "service/web/client", tmp_path / "client")
    (other / "errors.js").write_text("export {};\n")
    (other / "types.js").unlink()
    (other / "more.js").touch()
    done = check(other)
    assert done.returncode == 1
    assert [line.partition(":")[0] for line in done.stdout.splitlines()] == ["more.js", "types.js", "errors.js"]


def test_what_the_readme_shows_fits_the_types(repository: Path, tmp_path: Path) -> None:
    package = built_package(repository, tmp_path).parent
    given = (
        'import type { Job, JobEvent, MeshdeformError } from "meshdeform";\ndeclare const file: File, job: Job;\n'
        "declare function askForKey(refused: string): Promise<boolean>;\n"
        "declare function showWait(error: MeshdeformError, pauseMs: number): boolean;\n"
        "declare function showState(connected: boolean): void;\ndeclare function show(event: JobEvent): void;\n"
    )
    (tmp_path / "node_modules").mkdir()
    (tmp_path / "node_modules/meshdeform").symlink_to(package)
    readme = (repository / "clients/typescript/README.md").read_text()
    blocks = re.findall(r"^```ts\n(.*?)^```", readme, re.M | re.S)
    assert len(blocks) == 2
    for number, block in enumerate(blocks):
        imported = "" if "import {" in block else 'import { Client } from "meshdeform";\n'
        needed = given.replace(", job: Job", "") if "const job" in block else given
        (tmp_path / f"shown{number}.mts").write_text(imported + needed + block)
    compiler = repository / "tests/node/node_modules/typescript/bin/tsc"
    options = ["--noEmit", "--strict", "--skipLibCheck", "--target", "es2022", "--module", "nodenext"]
    options += ["--lib", "es2023,dom,dom.iterable,dom.asynciterable"]
    command = [shutil.which("node") or "node", compiler, *options, *sorted(tmp_path.glob("*.mts"))]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=240)
    assert done.returncode == 0, done.stdout
