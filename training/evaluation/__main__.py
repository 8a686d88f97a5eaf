"""Run a suite of the benchmark and judge its results: ``python -m training.evaluation --suite NAME --out FOLDER``.

The deformations are rows of `meshdeform batch`, which writes

::

    rows.jsonl      the rows
    sources/        the sources by formula
    NAME/           of each deformation `result.glb`, `report.json` and `preview.png`
    summary.csv, summary.json, sheet.png

and this adds `manifest.json`, to which the folder belongs, `results.json` and `table.md`. The same command resumes an
interrupted run and tries again what failed.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import meshdeform
from meshdeform.assets import build_glb
from meshdeform.cli.form import overlaid
from meshdeform.cli.request import make_settings
from meshdeform.errors import MeshdeformError, ParameterError
from meshdeform.requests.choices import is_builtin
from meshdeform.requests.document import BUILTIN_MODEL
from meshdeform.requests.groups import grouped
from meshdeform.support.files import write_files
from training.evaluation.clip_judge import ClipJudge, refuse_the_guides_own
from training.evaluation.report import compare, table, write_report
from training.evaluation.retrieval import BUILTIN_JUDGE, ShapeJudge, load_judge
from training.evaluation.sources import source_mesh
from training.evaluation.suite import SUITES, files_in

_SOME_FAILED = 8
"""Exit code of `meshdeform batch`, whose other rows are done."""


def main(words: list[str] | None = None) -> None:
    """Run what the command line says."""
    given = _parsed(words)
    try:
        if given.compare:
            print(compare(given.compare), end="")
            return
        judge = load_judge(given.judge)
        clip = ClipJudge(given.clip, device=given.device) if given.clip else None
        manifest = _stored(given.out) if given.rejudge else _manifest(given)
        _check(manifest, judge, given.clip)
        if not given.rejudge:
            _run(given, manifest)
        document = write_report(given.out, manifest, judge, clip)
    except MeshdeformError as error:
        sys.exit(f"{error.detail} {error.advice_text}")
    except KeyboardInterrupt:
        sys.exit("Interrupted. The same command goes on.")
    print(table("", {given.out.name: document["summary"]}), end="")
    print(*(given.out / name for name in ("results.json", "table.md", "sheet.png")))


def _parsed(words: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m training.evaluation", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--suite", choices=SUITES, default="small")
    parser.add_argument("--kind", choices=("exemplar", "sds"), default="exemplar", help="the guidance")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter; repeatable")
    parser.add_argument("--out", type=Path, default=Path("meshdeform-eval"), help="the folder of the run")
    parser.add_argument("--assets", type=Path, help="a folder with the files of the suite `assets`")
    parser.add_argument("--limit", type=int, help="only the first so many deformations")
    parser.add_argument("--device", default="cpu", help="cpu, cuda or cuda:N")
    parser.add_argument("--parallel", type=int, default=1, help="deformations at the same time")
    parser.add_argument("--judge", default=BUILTIN_JUDGE, help="builtin, none, or package.module:name")
    parser.add_argument("--clip", type=Path, help="the folder of a CLIP model, which judges as well")
    parser.add_argument("--rejudge", action="store_true", help="judge the results in --out again")
    parser.add_argument("--compare", nargs="+", type=Path, metavar="FOLDER", help="print one table of finished runs")
    return parser.parse_args(words)


def _manifest(given: argparse.Namespace) -> dict[str, Any]:
    """Return what decides the results, but for the versions of other packages."""
    preset = {"preset": "paper"} if given.suite == "paper" else {}
    return {
        "suite": given.suite,
        "kind": given.kind,
        "params": grouped({**preset, **overlaid({"guidance": {"kind": given.kind}}, make_settings(given.set))}),
        "prompts": list(SUITES[given.suite].prompts),
        "device": given.device,
        "code": _code_sha256(),
    }


def _check(manifest: dict[str, Any], judge: ShapeJudge | None, clip: Path | None) -> None:
    """Refuse judges that do not know the prompts, or that guide as well, before anything is deformed."""
    model = manifest["params"]["guidance"].get("model", BUILTIN_MODEL)
    if clip is not None and not is_builtin(model):
        refuse_the_guides_own(clip, model)
    if judge is not None:
        judge.log_likelihoods(source_mesh("sphere"), manifest["prompts"])


def _run(given: argparse.Namespace, manifest: dict[str, Any]) -> None:
    """Do the deformations that are left."""
    suite = SUITES[given.suite]
    items = suite.items[: given.limit]
    if suite.of_files and given.assets is None:
        raise ParameterError(f"The suite {given.suite} needs files.", advice="Name their folder with --assets.")
    own = {} if suite.of_files else {item.source: given.out / "sources" / f"{item.source}.glb" for item in items}
    paths = own or files_in(given.assets, items)
    _claim(given.out, manifest)
    for name, path in own.items():
        mesh = source_mesh(name)
        write_files({path: build_glb(mesh.verts, mesh.faces)})
    rows = given.out / "rows.jsonl"
    lines = [{"asset": str(paths[each.source].absolute()), "prompt": each.prompt, "name": each.name,
              "seed": each.seed, "params": manifest["params"]} for each in items]  # fmt: skip
    write_files({rows: "".join(json.dumps(line) + "\n" for line in lines).encode()})
    how = ["--device", given.device, "--parallel", str(given.parallel), "--retry-failed"]
    done = subprocess.run([sys.executable, "-m", "meshdeform", "batch", str(rows), "-o", str(given.out), *how])
    if done.returncode not in (0, _SOME_FAILED):
        sys.exit(done.returncode)


def _code_sha256() -> str:
    """Hash the modules of the package."""
    root, digest = Path(meshdeform.__file__).parent, hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _claim(folder: Path, manifest: dict[str, Any]) -> None:
    """Write the manifest of a folder; refuse one of another run, whose results must not be mixed with this one's."""
    path = folder / "manifest.json"
    if path.exists() and (others := [name for name, value in _stored(folder).items() if manifest.get(name) != value]):
        raise ParameterError(
            f"{folder} is of a run with other {', '.join(others)}.",
            advice="Choose another folder with --out, or judge its results again with --rejudge.",
        )
    (folder / "sources").mkdir(parents=True, exist_ok=True)
    write_files({path: (json.dumps(manifest, indent=1) + "\n").encode()})


def _stored(folder: Path) -> dict[str, Any]:
    try:
        manifest: dict[str, Any] = json.loads((folder / "manifest.json").read_text())
    except (OSError, ValueError) as error:
        raise ParameterError(f"There is no run in {folder}: {error}.", advice="Name one with --out.") from error
    return manifest


if __name__ == "__main__":
    main()
