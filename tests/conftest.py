"""Fixtures that more than one test file uses: real servers, a clean environment, and why something was skipped."""

from __future__ import annotations

import atexit
import functools
import gc
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.testing

from meshdeform.runs.kept_readings import Unkept
from tests.acceptance.service import Service, serving
from tests.s3_fixtures import s3_server, s3_store_url  # noqa: F401 - fixtures
from tests.servers import NotInstalledError, postgres_database, postgres_server, redis_server
from tests.smaller.sitecustomize import SMALLER

ROOT = Path(__file__).resolve().parent.parent

# A shell without job control starts background commands with Ctrl-C ignored, and so would the tests' own processes be.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Before anything imports torch or numba: threads of ours would fight with the processes that the tests start.
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["NUMBA_NUM_THREADS"] = "1"
# `CliRunner` builds the tree of 33 commands from the app again for each line that it runs.
typer.testing._get_command = functools.cache(typer.testing._get_command)
# What is imported is compiled once, and kept for the hundreds of processes that the tests start.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Nothing is fetched in a test; a hub that is asked by mistake must fail at once.
os.environ["HF_HUB_OFFLINE"] = "1"


SHARING = {
    "the service": (
        "tests/acceptance/test_serve.py",
        "tests/acceptance/test_cli_service.py",
        "tests/acceptance/test_cli_batch.py",
        "tests/acceptance/test_mcp.py",
        "tests/acceptance/test_quickstart.py",
        "tests/integration/test_client_examples.py",
        "tests/toolchain/test_blender_client.py",
        "tests/toolchain/test_recipes.py",
    ),
    "the page, from the file to the result": (
        "tests/browser/test_page_access.py",
        "tests/browser/test_page_assets.py",
        "tests/browser/test_page_compare.py",
        "tests/browser/test_page_drafts.py",
        "tests/browser/test_page_gallery.py",
        "tests/browser/test_page_jobs.py",
        "tests/browser/test_page_trouble.py",
    ),
    # Two halves that take about as long: one after the other they would outlast everything else.
    "the rest of the page": ("tests/browser/test_",),
    # One page with one WebGL context, whose shaders take seconds.
    "the viewer": ("tests/browser/viewer/",),
    # What imports diffusers or transformers, which takes seconds, and shares their small models.
    "Stable Diffusion": ("tests/unit/priors/test_stable_diffusion",),
    "the S3 server": (
        "tests/acceptance/test_storage_faults.py",
        "tests/acceptance/test_worker_outages.py",
        "tests/integration/test_api_uploads.py",
        "tests/integration/test_compose_commands.py",
        "tests/integration/test_doctor_servers.py",
        "tests/integration/test_downloads.py",
        "tests/integration/test_s3.py",
    ),
}
"""Files that one worker runs, because they share what takes seconds to start. They come first, as they take longest."""


AGAIN = ("tests/acceptance/", "tests/browser/", "tests/integration/", "tests/security/")
"""Folders whose tests start servers or a browser. In CI they get a second try, which the last lines name: a test that
needs it is wrong and gets mended, but the work of others does not wait for that. Anywhere else they get none."""


def group_of(nodeid: str) -> str:
    """Return the name of the test's group, or its file if it belongs to none."""
    file = nodeid.partition("::")[0]
    return next((name for name, beginnings in SHARING.items() if file.startswith(beginnings)), file)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, Any, Any]:
    """Leave what is imported and collected out of the search for garbage: it stays until the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        # Seldom, as in the processes of the API: nothing that a test leaves behind is large.
        gc.set_threshold(20_000)
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the groups first; in CI, run a test of several processes again if it fails."""
    if os.environ.get("CI"):
        for item in items:
            if item.nodeid.startswith(AGAIN):
                item.add_marker(pytest.mark.flaky(reruns=1))
    groups = list(SHARING)
    items.sort(key=lambda item: groups.index(group) if (group := group_of(item.nodeid)) in SHARING else len(groups))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Extend `--dist loadfile`: a group stays on one worker, as a file does."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return group_of(nodeid)

    return Scheduling(config, log) if config.getvalue("dist") == "loadfile" else None


def pytest_sessionstart(session: pytest.Session) -> None:
    """Drop the caller's settings: the tests run on the defaults, but each command and worker on one thread."""
    shared = os.environ.get("MESHDEFORM_CACHE_DIR") if hasattr(session.config, "workerinput") else None
    for name in [name for name in os.environ if name.startswith("MESHDEFORM_")]:
        del os.environ[name]
    # More threads than free cores spend their time waiting for each other.
    os.environ["MESHDEFORM_THREADS"] = "1"
    # Readings of other runs say nothing about this code.
    os.environ["MESHDEFORM_CACHE_DIR"] = cache = tempfile.mkdtemp(prefix="meshdeform-cache-")
    atexit.register(shutil.rmtree, cache, ignore_errors=True)
    # Members of nouns are drawn once for all workers: `shared` is the folder of the process that starts them.
    nouns = Path(shared or cache, "nouns")
    nouns.mkdir(exist_ok=True)
    if shared:
        Path(cache, "nouns").symlink_to(nouns)


@pytest.fixture(autouse=True)
def _one_torch_thread() -> None:
    """Keep torch on one thread where a test has imported it; never import it for a test that does not."""
    if torch := sys.modules.get("torch"):
        torch.set_num_threads(1)


_shipped: dict[str, dict[str, Any]] = {}


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Draw and measure less in this process, except in tests that are marked `as_shipped`; fixtures do so, too.

    Members of nouns, a second of a noun, are those of the folder that all share.
    """
    shipped = item.get_closest_marker("as_shipped") is not None
    made: Any = Unkept.__init__
    made.__defaults__ = (None if shipped else Path(os.environ["MESHDEFORM_CACHE_DIR"], "nouns"),)
    for name, smaller in SMALLER.items():
        if module := sys.modules.get(name):
            as_shipped = _shipped.setdefault(name, {constant: getattr(module, constant) for constant in smaller})
            vars(module).update(as_shipped if shipped else smaller)


@pytest.fixture(params=["cpu", "cuda"])
def device(request: pytest.FixtureRequest) -> str:
    """Each device that this machine has."""
    import torch

    if request.param == "cuda" and not torch.cuda.is_available():
        pytest.skip("no CUDA device")
    return str(request.param)


@pytest.fixture(scope="session")
def repository() -> Path:
    """The repository's root."""
    return ROOT


@pytest.fixture(scope="session")
def server_folder() -> Iterator[Path]:
    """A temporary folder that other users may enter (a Redis and a PostgreSQL keep their data there)."""
    # Not pytest's own: those are 0700 for the user who runs the tests, and PostgreSQL runs as another one.
    # Under /tmp where there is one: the path of a unix socket must be short.
    base = "/tmp" if Path("/tmp").is_dir() else None
    folder = Path(tempfile.mkdtemp(prefix="meshdeform-", dir=base))
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="session")
def redis_server_url(server_folder: Path) -> Iterator[str]:
    """A real Redis for the session. Tests take `redis_url`, which is empty."""
    folder = server_folder / "redis"
    folder.mkdir()
    try:
        with redis_server(folder) as url:
            yield url
    except NotInstalledError as missing:
        pytest.skip(str(missing))


@pytest.fixture
def redis_url(redis_server_url: str) -> str:
    """A real Redis with nothing in it."""
    import redis

    with redis.Redis.from_url(redis_server_url) as connection:
        connection.flushall()
    return redis_server_url


@pytest.fixture(scope="session")
def postgres_port(server_folder: Path) -> Iterator[int]:
    """A real PostgreSQL for the session. Tests take `postgres_url`, a database of their own."""
    folder = server_folder / "postgres"
    folder.mkdir()
    try:
        with postgres_server(folder) as port:
            yield port
    except NotInstalledError as missing:
        pytest.skip(str(missing))


@pytest.fixture
def postgres_url(postgres_port: int) -> Iterator[str]:
    """A new, empty PostgreSQL database, dropped afterwards."""
    with postgres_database(postgres_port) as url:
        yield url


@pytest.fixture(scope="session")
def service(server_folder: Path) -> Iterator[Service]:
    """A `meshdeform serve` with a real worker that many files share, because it takes seconds to start.

    A test looks only at jobs of its own. Webhooks on loopback are allowed. Leases are long: a busy machine may be slow
    to renew one.
    """
    settings = {"MESHDEFORM_WEBHOOK_NETWORKS": '["127.0.0.0/8"]', "MESHDEFORM_LEASE_S": "60"}
    with serving(server_folder / "service", **settings) as service:
        yield service


@pytest.fixture(scope="session")
def validate_glb(repository: Path) -> Iterator[Callable[[bytes], dict[str, Any]]]:
    """The Khronos glTF validator: GLB bytes to its report, `report["issues"]["messages"]` and the rest."""
    node, script = shutil.which("node"), repository / "tests/node/validate.cjs"
    if node is None:
        pytest.skip("Node.js is not installed (apt install nodejs npm, then scripts/test)")
    if not (script.parent / "node_modules/gltf-validator").is_dir():
        pytest.skip("the glTF validator is not installed (npm install --prefix tests/node)")
    # One process for all files: starting it takes more than a hundred times as long as a file.
    with subprocess.Popen([node, script], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        requests, reports = process.stdin, process.stdout
        assert requests is not None
        assert reports is not None

        def validate(glb: bytes) -> dict[str, Any]:
            requests.write(len(glb).to_bytes(4, "little") + glb)
            requests.flush()
            report = dict(json.loads(reports.readline()))
            assert "failed" not in report, report
            return report

        yield validate


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> Generator[None, None, None]:
    """Say last of all what did not run here, and why."""
    result = yield
    reasons = Counter(
        report.longrepr[2].removeprefix("Skipped: ")
        for report in terminalreporter.stats.get("skipped", [])
        if isinstance(report.longrepr, tuple)
    )
    for reason, count in sorted(reasons.items()):
        terminalreporter.write_line(f"NOT RUN HERE: {count} test{'s' * (count > 1)}: {reason}", yellow=True)
    return result
