"""What an import costs and where it leads: the client needs no torch, the API not even numpy."""

from __future__ import annotations

import json
import os
import sqlite3
import subprocess
import sys
import tomllib
from pathlib import Path

from meshdeform.assets import build_glb
from meshdeform.geometry.shapes import icosphere
from tests.acceptance.service import smaller

HEAVY = ["torch", "diffusers", "transformers", "numba", "scipy", "trimesh", "PIL"]
NUMPY_FREE = [
    "meshdeform.errors",
    "meshdeform.requests.document",
    "meshdeform.settings",
    "meshdeform.record",
    "meshdeform.storage",
    "meshdeform.webhooks",
    "meshdeform.client",
    "service",
]
TORCH_FREE = [
    "meshdeform.cli.app",
    "meshdeform.serving.stack",
    "meshdeform.serving.redis_server",
    "meshdeform.assets",
    "meshdeform.exemplar",
    "meshdeform.judge",
    "meshdeform.kinds.sketch",
    "meshdeform.nouns",
    "meshdeform.plain",
    "meshdeform.priors.*",
    "meshdeform.reading",
    "meshdeform.rendering.studio",
    "meshdeform.runs.control",
    "meshdeform.runs.derive",
    "meshdeform.runs.exemplar",
    "meshdeform.runs.rehearsal",
    "meshdeform.runs.strength",
    "meshdeform.runs.text_deform",
    "meshdeform.kinds.words.making",
    "meshdeform.kinds.words.picture",
    "meshdeform.vocabulary.grammar",
    "worker.health",
    "worker.process",
    "worker.supervisor",
]

# Imports modules with everything below them (`name.*`: the package alone), then tells for each top-level name that came
# along which of them brought it.
_PROBE = """
import importlib, json, pkgutil, sys
brought = {}
for asked in sys.argv[1:]:
    name, alone, _ = asked.partition(".*")
    module = importlib.import_module(name)
    for info in [] if alone else pkgutil.walk_packages(getattr(module, "__path__", []), module.__name__ + "."):
        if not info.name.endswith("__main__"):
            importlib.import_module(info.name)
    for loaded in sys.modules:
        brought.setdefault(loaded.partition(".")[0], asked)
print(json.dumps(brought))
"""

# The same with every package refused that the base install does not bring.
_REFUSE = """
import importlib.abc, sys
class Refuse(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in %r:
            raise ModuleNotFoundError(f"No module named {name!r} in a base install", name=name)
sys.meta_path.insert(0, Refuse())
"""


# Draws an asset and judges a mesh.
_LOOK = """
from meshdeform.geometry.shapes import icosphere
from meshdeform.judge import Judge
from meshdeform.rendering.studio import comparison_png
assert comparison_png({"cube": open(sys.argv[1], "rb").read()}).startswith(b"\\x89PNG")
assert sum(Judge().noun_probabilities(icosphere(2)).values()) > 0.99
"""

# Starts the API as `python -m service` does, up to the moment at which it would answer, and tells what is loaded.
_START = """
import asyncio, json, sys
import service.__main__, uvicorn
from service.app import create_app
app = create_app()
async def start():
    async with app.router.lifespan_context(app):
        print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
asyncio.run(start())
"""
# What the command line needs, and what upgrades a record: neither stays in the memory of a server.
NOT_IN_A_SERVER = ["typer", "rich", "alembic", "mako", "pygments", "httpx", "obstore", "pg8000"]


def loaded_by(*modules: str, before: str = "") -> dict[str, str]:
    """Return the top-level names that a fresh interpreter has loaded, each with the first module that brought it."""
    probe = [sys.executable, "-c", before + _PROBE, *modules]
    result = subprocess.run(probe, check=False, capture_output=True, text=True)
    assert result.returncode == 0, f"{modules} cannot be imported: {result.stderr.splitlines()[-1]}"
    return dict(json.loads(result.stdout))


def among(loaded: dict[str, str], unwanted: list[str]) -> dict[str, str]:
    """Return what of the unwanted is loaded."""
    return {name: module for name, module in loaded.items() if name in unwanted}


def test_nothing_loads_what_it_does_not_need_and_a_new_server_keeps_nothing_of_its_start(tmp_path: Path) -> None:
    assert among(loaded_by("meshdeform.cli.app"), ["pydantic", "fastapi", "redis", "numpy", *HEAVY]) == {}  # for --help
    assert among(loaded_by(*NUMPY_FREE), ["numpy", *HEAVY]) == {}
    assert among(loaded_by(*TORCH_FREE), ["torch", "diffusers", "transformers", "numba"]) == {}
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("MESHDEFORM", "OTEL"))}
    environment |= {"MESHDEFORM_DATA_DIR": str(tmp_path), "MESHDEFORM_REDIS_URL": "redis://127.0.0.1:1/0"}
    started = subprocess.run(
        [sys.executable, "-c", _START], env=environment, check=True, capture_output=True, text=True
    )
    assert set(json.loads(started.stdout)) & {*NOT_IN_A_SERVER, "numpy", *HEAVY} == set()
    record = sqlite3.connect(tmp_path / "meshdeform.sqlite")
    assert record.execute("SELECT count(*) FROM alembic_version").fetchone() == (1,)
    record.close()


def test_pictures_and_the_judge_need_neither_torch_nor_numba(repository: Path) -> None:
    program = _REFUSE % ["torch", "numba"] + _LOOK
    done = subprocess.run(
        [sys.executable, "-c", program, str(repository / "examples/cube.glb")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_the_base_install_is_enough_for_the_client(repository: Path) -> None:
    refused = ["numpy", *HEAVY, "fastapi", "starlette", "uvicorn", "sqlalchemy", "alembic", "redis", "rq", "obstore"]
    modules = ["meshdeform.client", "meshdeform.requests.document", "meshdeform.settings", "meshdeform.cli.app"]
    assert loaded_by(*modules, before=_REFUSE % refused)
    base = tomllib.loads((repository / "pyproject.toml").read_text())["project"]["dependencies"]
    assert not [line for line in base if line.startswith(tuple(refused))]


# Makes packages look as if they were not installed, also to who only asks whether they are.
_MISSING = """
import importlib.machinery, sys
class Missing:
    @staticmethod
    def find_spec(name, path=None, target=None):
        missing = name.partition(".")[0] in %r
        return None if missing else importlib.machinery.PathFinder.find_spec(name, path, target)
sys.meta_path[sys.meta_path.index(importlib.machinery.PathFinder)] = Missing
"""
# Runs commands, one after the other, and says at its end what they have loaded.
_COMMANDS = """
import json
from meshdeform.cli.app import main
try:
    for line in json.loads(sys.argv[1]):
        sys.argv[:] = ['meshdeform', *line]
        try: main()
        except SystemExit as end:
            if end.code: raise
finally: print("LOADED", *{name.partition(".")[0] for name in sys.modules})
"""
_SDS = ["torch", "diffusers", "transformers"]


def commands(folder: Path, *lines: list[str], refused: list[str]) -> subprocess.CompletedProcess[str]:
    """Run commands of ours in a folder where packages are not installed, up to the first that fails."""
    program = [sys.executable, "-c", _MISSING % refused + _COMMANDS, json.dumps(lines)]
    environment = {**os.environ, **smaller()}
    return subprocess.run(program, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_the_extra_deform_is_enough_to_fit_and_to_change_without_torch(repository: Path, tmp_path: Path) -> None:
    packages = tomllib.loads((repository / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert [line for line in packages["deform"] if line.startswith("meshdeform")] == ["meshdeform[asset]"]
    refused = [*_SDS, *(line.partition(">")[0] for line in packages["stack"])]
    vase, ball, given = str(repository / "examples/vase.glb"), icosphere(2), ["--set", "orientation=keep"]
    (tmp_path / "ball.glb").write_bytes(build_glb(ball.verts, ball.faces))
    # A fit of parts with its morph, a mould, a target, a change, and what comes after a run.
    done = commands(
        tmp_path,
        ["run", vase, "a bottle", "-o", "bottle.glb", "--morph", *given, "--set", "source_noun=vase"],
        ["run", "ball.glb", "a mushroom", "-o", "mushroom.glb", *given],
        ["run", "ball.glb", "--target", vase, "--guidance", "exemplar", "-o", "t.glb"],
        ["run", "ball.glb", "twice as tall", "-o", "tall.glb"],
        ["inspect", vase],
        ["apply", "bottle.glb", "--source", vase, "--strength", "0.5", "-o", "half.glb"],
        ["convert", "tall.glb", "-o", "tall.stl"],
        refused=refused,
    )
    assert done.returncode == 0, done.stderr
    assert not set(done.stdout.rpartition("LOADED")[2].split()) & {*refused}
    made = {path.name for path in tmp_path.iterdir()}
    assert made >= {"bottle.glb", "bottle.morph.glb", "bottle.preview.png", "t.report.json", "half.glb", "tall.stl"}


def test_what_needs_torch_names_its_extra_before_anything_is_read(repository: Path, tmp_path: Path) -> None:
    cube = str(repository / "examples/cube.glb")
    for arguments in (
        ["run", cube, "a vase", "--guidance", "sds"],
        ["run", cube, "--target", cube, "--guidance", "target"],
        ["run", cube, "--kind", "surface_fit"],
    ):
        done = commands(tmp_path, [*arguments, "--json"], refused=_SDS)
        assert done.returncode == 4, done.stderr
        error = json.loads(done.stderr)
        assert (error["code"], error["extra"]) == ("dependency_missing", "sds")
        assert "[sds]" in error["advice"]


def test_the_extra_sds_is_enough_for_the_papers_method_and_loads_no_compiler(repository: Path, tmp_path: Path) -> None:
    packages = tomllib.loads((repository / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert packages["sds"] == ["meshdeform[deform]", "torch>=2.8"]
    refused = ["diffusers", "transformers", *(line.partition(">")[0] for line in packages["stack"])]
    line = ["run", str(repository / "examples/cube.glb"), "a vase", "--steps", "1", "-o", "vase.glb"]
    done = commands(tmp_path, [*line, "--guidance", "sds", "--set", "orientation=keep"], refused=refused)
    assert done.returncode == 0, done.stderr
    loaded = set(done.stdout.rpartition("LOADED")[2].split())
    assert "torch" in loaded
    # What torch's own optimiser loads, a compiler, takes longer than a short run.
    assert "sympy" not in loaded
    assert {path.name for path in tmp_path.iterdir()} >= {"vase.glb", "vase.preview.png", "vase.report.json"}
