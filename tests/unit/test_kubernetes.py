"""The Kubernetes manifests: they render, are valid, grant no more than needed, and agree with the code."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
import yaml

from meshdeform.record.models import JobState
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from service.operations.metrics import Metrics
from tests.cases import each_case
from worker.health import STOP_GRACE_S

FOLDER = Path(__file__).parents[2] / "deploy/kubernetes"
OURS = {"MESHDEFORM_" + name.upper() for name in Settings.model_fields}
MONITORING = FOLDER / "components/monitoring"
UNFINISHED = {state.value for state in JobState if not state.terminal}


def documents(path: Path) -> list[dict[str, Any]]:
    return [document for document in yaml.safe_load_all(path.read_text()) if document]


def named(kind: str, name: str) -> dict[str, Any]:
    found = [
        document
        for path in sorted((FOLDER / "base").glob("*.yaml"))
        for document in documents(path)
        if document["kind"] == kind and document["metadata"]["name"] == name
    ]
    assert len(found) == 1
    return found[0]


def pods() -> dict[str, dict[str, Any]]:
    """The pods of the base, by name."""
    key = named("CronJob", "meshdeform-first-key")["spec"]
    return {
        "api": named("Deployment", "meshdeform-api")["spec"]["template"]["spec"],
        "worker": named("Deployment", "meshdeform-worker")["spec"]["template"]["spec"],
        "first-key": key["jobTemplate"]["spec"]["template"]["spec"],
    }


def test_settings_and_secrets_are_those_that_exist(repository: Path) -> None:
    text = "\n".join(path.read_text() for path in FOLDER.rglob("*.yaml"))
    assert set(re.findall(r"MESHDEFORM_[A-Z_]+", text)) <= OURS
    asked = {
        entry["valueFrom"]["secretKeyRef"]["key"]
        for pod in pods().values()
        for entry in pod["containers"][0]["env"]
        if "secretKeyRef" in entry.get("valueFrom", {})
    }
    guide = (repository / "docs/kubernetes.md").read_text()
    assert asked == set(re.findall(r"--from-literal=([\w-]+)=", guide))
    # No password, key or address with one is written down.
    assert not re.search(r"://[^/\s]*:[^/\s]*@", text)
    assert "kind: Secret\n" not in text


def test_every_pod_is_restricted() -> None:
    for name, pod in pods().items():
        assert pod["automountServiceAccountToken"] is False, name
        security = pod["securityContext"]
        assert (security["runAsNonRoot"], security["seccompProfile"]) == (True, {"type": "RuntimeDefault"})
        (container,) = pod["containers"]
        may = {"allowPrivilegeEscalation": False, "readOnlyRootFilesystem": True, "capabilities": {"drop": ["ALL"]}}
        assert container["securityContext"] == may
        assert "memory" in container["resources"]["limits"]
        assert not any(key in pod for key in ("hostNetwork", "hostPID", "hostIPC"))
        assert all("sizeLimit" in volume["emptyDir"] for volume in pod["volumes"])


def test_pods_stop_in_the_time_that_they_have() -> None:
    from service.__main__ import _GRACE_S

    worker, api = pods()["worker"], pods()["api"]
    assert "lifecycle" not in worker["containers"][0]
    assert worker["terminationGracePeriodSeconds"] >= STOP_GRACE_S + 15
    pause = api["containers"][0]["lifecycle"]["preStop"]["sleep"]["seconds"]
    assert api["terminationGracePeriodSeconds"] >= pause + _GRACE_S + 10


def test_keda_asks_the_record_for_the_unfinished_jobs(tmp_path: Path) -> None:
    (scaled,) = documents(FOLDER / "components/keda/scaled-object.yaml")
    (trigger,) = scaled["spec"]["triggers"]
    query = trigger["metadata"]["query"]
    assert set(re.findall(r"'(\w+)'", query)) == UNFINISHED
    record = JobRecord(f"sqlite:///{tmp_path}/record.sqlite")
    try:
        with record.database.read() as connection:
            assert connection.execute(sa.text(query)).scalar_one() == 0
    finally:
        record.close()


# -- monitoring
def exported(tmp_path: Path) -> dict[str, set[str]]:
    """The names of all series that the API exports, with the names of their labels."""
    record = JobRecord(f"sqlite:///{tmp_path}/metrics.sqlite")
    metrics = Metrics()
    metrics.watch(record, "meshdeform")
    metrics.answered("GET", "/v1/jobs", 200, 0.1)
    try:
        families = list(metrics.registry.collect())
    finally:
        record.close()
    return {sample.name: set(sample.labels) for family in families for sample in family.samples}


def expressions() -> list[str]:
    dashboard = json.loads((MONITORING / "meshdeform.json").read_text())
    shown = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
    (alerts,) = documents(MONITORING / "alerts.yaml")
    return [*shown, *(rule["expr"] for group in alerts["spec"]["groups"] for rule in group["rules"])]


def test_alerts_and_dashboard_ask_for_metrics_that_exist(tmp_path: Path) -> None:
    series = exported(tmp_path)
    for expression in expressions():
        for name, selector in re.findall(r"\b(meshdeform_\w+)(?:\{([^}]*)\})?", expression):
            assert name in series, expression
            for label, value in re.findall(r'(\w+)=~?"([^"]*)"', selector):
                assert label in series[name], expression
                if label == "state":
                    assert set(value.split("|")) <= {state.value for state in JobState}
        for grouped in re.findall(r"by \(([^)]*)\)", expression):
            known = set().union(*(series[name] for name in re.findall(r"meshdeform_\w+", expression)))
            assert set(grouped.replace(" ", "").split(",")) <= known, expression


def test_promtool_says_when_each_alert_fires(repository: Path, tmp_path: Path) -> None:
    fetched = repository / "tests" / ".promtool" / "usr" / "bin"  # by scripts/test
    if (promtool := shutil.which("promtool") or shutil.which("promtool", path=str(fetched))) is None:
        pytest.skip("promtool is not installed (scripts/test fetches it, or Debian: the package prometheus)")
    (document,) = documents(MONITORING / "alerts.yaml")
    (tmp_path / "alerts.yaml").write_text(yaml.safe_dump(document["spec"]))
    shutil.copy(repository / "tests/unit/prometheus/alerts_test.yaml", tmp_path)
    for arguments in (["check", "rules", "alerts.yaml"], ["test", "rules", "alerts_test.yaml"]):
        done = subprocess.run([promtool, *arguments], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


@each_case("overlay", ["base", "example"])
def test_what_kustomize_renders_is_valid(overlay: str) -> None:
    if (kubectl := shutil.which("kubectl")) is None:
        pytest.skip("kubectl is not installed")
    done = subprocess.run([kubectl, "kustomize", FOLDER / overlay], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = [document for document in yaml.safe_load_all(done.stdout) if document]
    validate = pytest.importorskip("kubernetes_validate", reason="kubernetes-validate is not installed")
    foreign = [document for document in found if re.search(r"\.(sh|com)/", document["apiVersion"])]
    assert len(foreign) == (3 if overlay == "example" else 0)
    for document in found:
        if document not in foreign:
            validate.validate(document, "1.30" if overlay == "base" else "1.37", strict=True)
