"""The documentation names everything that exists, and what it shows is true."""

from __future__ import annotations

import functools
import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import typer.main
from pydantic import BaseModel

from meshdeform.requests.document import JobRequest
from meshdeform.requests.kind_folders import kind_modules
from meshdeform.settings import Settings
from service.jobs.documents import PreviewDocument
from tests.cases import each_case

# Read by the client and the command line, not by the service.
CLIENTS = {"MESHDEFORM_URL", "MESHDEFORM_API_KEY"}


def sections(path: Path) -> dict[str, str]:
    """Return the text under each heading of a page, whatever the heading's level."""
    found: dict[str, str] = {}
    heading, fenced = "", False
    for line in path.read_text().splitlines():
        fenced ^= line.startswith("```")
        if not fenced and (match := re.fullmatch(r"#+ (.*)", line)):
            heading = match[1].replace("`", "")
            found[heading] = ""
        elif heading:
            found[heading] += line + "\n"
    return found


def snippets(path: Path, language: str) -> list[str]:
    """Return the fenced blocks of a language, with continued lines joined and comments cut off."""
    blocks = re.findall(rf"^```{language}\n(.*?)^```", path.read_text(), re.DOTALL | re.MULTILINE)
    return [re.sub(r"\s*\\\n\s*", " ", block) for block in blocks]


def shell_lines(repository: Path) -> list[tuple[str, str]]:
    """Return every shell line that the README and the docs show, with the page's name."""
    pages = [repository / "README.md", *sorted((repository / "docs").glob("*.md"))]
    found = []
    for page in pages:
        for block in snippets(page, "(?:sh|bash)"):
            found += [(page.name, line) for line in block.splitlines() if line and not line.startswith("#")]
    return found


@functools.cache
def commands() -> dict[str, Any]:
    from meshdeform.cli.app import app

    return dict(typer.main.get_command(app).commands)  # type: ignore[attr-defined]


@each_case("name", Settings.model_fields)
def test_every_setting_has_a_section_with_its_default_and_bounds(name: str, repository: Path) -> None:
    text = sections(repository / "docs/configuration.md")[f"MESHDEFORM_{name.upper()}"]
    default = Settings.model_fields[name].get_default(call_default_factory=True)
    assert text.lstrip().startswith("Default: ")
    if default not in ("", []):
        assert f"Default: `{default}`" in text
    # That nothing is less than 0 needs no words.
    limits = Settings.model_json_schema()["properties"][name]
    least, most = limits.get("minimum", 0), limits.get("maximum")
    first = text.strip().partition("\n\n")[0]
    assert least == 0 or f"at least {least:,g}" in first
    assert most is None or f"at most {most:,g}" in first


def test_every_setting_that_any_page_names_exists(repository: Path) -> None:
    known = {f"MESHDEFORM_{name.upper()}" for name in Settings.model_fields} | {"MESHDEFORM_FAILPOINTS"} | CLIENTS
    for page in [repository / "README.md", *(repository / "docs").glob("*.md")]:
        named = set(re.findall(r"MESHDEFORM_[A-Z_]*[A-Z]", page.read_text()))
        assert named <= known, page.name


def test_what_is_generated_is_what_the_code_says() -> None:
    from docs.generate import pages

    for path, text in pages().items():
        assert path.read_text() == text, f"{path.name}: write it again: python docs/generate.py"


def test_headings_name_commands_and_routes_that_exist(repository: Path) -> None:
    """The lists of all commands and routes are generated; what is told of some is not."""
    headings = {name for name in sections(repository / "docs/cli.md") if name.startswith("meshdeform ")}
    assert headings
    assert headings <= {f"meshdeform {name}" for name, found in commands().items() if not found.hidden}
    document = json.loads((repository / "openapi/openapi.json").read_text())
    routes = {f"{method.upper()} {path}" for path, methods in document["paths"].items() for method in methods}
    told = {name for name in sections(repository / "docs/http.md") if re.match("(GET|POST|PUT|PATCH|DELETE) ", name)}
    assert told
    assert told <= routes


@each_case("reader", ["artist", "developer", "operator", "researcher", "contributor"])
def test_the_path_of_a_reader_is_short_and_ends_in_something_that_works(reader: str, repository: Path) -> None:
    (line,) = re.findall(
        rf"^- \*\*You are an? {reader}\*\*.*", (repository / "docs/index.md").read_text(), re.MULTILINE
    )
    path, _, end = line.partition(" At the end ")
    pages = re.findall(r"\]\((\w+\.md)\)", path)
    assert pages
    assert end
    assert sum(len((repository / "docs" / page).read_text().split()) for page in pages) <= 3000


_DOCUMENTS: dict[str, type[BaseModel]] = {
    "/v1/jobs:preview": PreviewDocument,
    **{each.ROUTERS[0].prefix: each.MODELS[0] for each in kind_modules("routes")},
}


def test_every_json_request_that_is_shown_is_valid(repository: Path) -> None:
    lines = [line for _, line in shell_lines(repository)]
    shown = [(line, text) for line in lines for text in re.findall(r"request='?(\{.*?\})'(?=[\s;])", line)]
    assert shown
    for line, text in shown:
        model = next((each for path, each in _DOCUMENTS.items() if path in line), JobRequest)
        model.model_validate_json(text)
    for page in ("parameters", "control"):
        for block in snippets(repository / f"docs/{page}.md", "json"):
            JobRequest.model_validate_json(block)


def test_every_shell_line_that_is_shown_can_be_run(repository: Path) -> None:
    """Commands and flags exist, routes exist, scripts and files exist, extras exist."""
    extras = set(tomllib.loads((repository / "pyproject.toml").read_text())["project"]["optional-dependencies"])
    routes = json.loads((repository / "openapi/openapi.json").read_text())["paths"]
    patterns = [re.compile(re.sub(r"\{\w+\}", "[^/?]+", path)) for path in routes]
    lines = shell_lines(repository)
    assert len(lines) > 10
    for page, line in lines:
        words = shlex.split(line, comments=True)
        if words[0] == "kubectl":  # of names in a cluster, only what follows `--` is a command of ours
            words = words[words.index("--") + 1 :] if "--" in words else []
        for extra in re.findall(r"meshdeform\[([\w,]+)\]|\"\.\[([\w,]+)\]", line):
            assert set("".join(extra).split(",")) <= extras, (page, line)
        for url in re.findall(r"https?://127\.0\.0\.1:8765(/[^\s\"'?]*)", line):
            path = re.sub(r"\$\{?\w+\}?", "X", url)
            assert any(pattern.fullmatch(path) for pattern in patterns), (page, line)
        for word in words:
            if word.startswith(("scripts/", "examples/", "docker/", "service/")) and not word.endswith("*"):
                assert (repository / word).exists(), (page, line)
        if "meshdeform" in words:
            first = words.index("meshdeform")
            found, flags = commands()[words[first + 1]], [word for word in words[first + 2 :] if word.startswith("-")]
            if hasattr(found, "commands"):
                found = found.commands[words[first + 2]]
            known = {
                option
                for parameter in found.get_params(typer.Context(found))
                for option in [*parameter.opts, *parameter.secondary_opts]
            }
            assert set(flags) <= known | {"--help"}, (page, line)


def test_commands_in_the_text_exist(repository: Path) -> None:
    modules, named = set(), set()
    for page in (repository / "README.md", *set((repository / "docs").glob("*.md")) - {repository / "docs/changes.md"}):
        text = page.read_text()
        modules |= set(re.findall(r"python -m ((?:bench|training|tests|service|worker)\.[\w.]*\w)", text))
        named |= set(re.findall(r"`meshdeform ([a-z][\w-]*)", text))
    assert len(modules) > 10
    for module in modules:
        path = repository / module.replace(".", "/")
        assert path.with_suffix(".py").is_file() or (path / "__main__.py").is_file(), module
    assert len(named) > 10
    assert named <= set(commands())


def test_commands_in_the_text_of_the_readme_name_files_of_a_clone(repository: Path) -> None:
    runs = re.findall(r"`meshdeform run (\S+) [^`]*`", (repository / "README.md").read_text())
    assert runs
    for asset in runs:
        assert (repository / asset).is_file(), asset


@each_case("page", ["README.md", "CHANGELOG.md", "docs"])
def test_links_inside_the_repository_lead_somewhere(page: str, repository: Path) -> None:
    path = repository / page
    for file in [path] if path.is_file() else sorted(path.glob("*.md")):
        for link in re.findall(r"\]\(([^)#\s]+)", file.read_text()):
            if "://" not in link:
                assert (file.parent / link).exists(), (file.name, link)


def test_nothing_advises_to_install_a_name_that_is_not_published(repository: Path) -> None:
    # There is no release: whoever takes the name would be installed. Advice in errors: `install_command`.
    python = r"pip3? install|pipx (?:install|run)|uvx|uv (?:add|pip install|tool (?:install|run))|conda install"
    node = r"npx|npm (?:i|install)|yarn add|pnpm add"
    advice = re.compile(rf"\b(?:{python}|{node})\b(?: +[^\s;|&]+)*? +[\\\"']*meshdeform(?![\w./-])")
    tops = [path for path in repository.iterdir() if path.name[0] != "." and path.name != "CHANGELOG.md"]
    for file in (file for top in tops for file in ([top] if top.is_file() else top.rglob("*.*"))):
        inside = file.relative_to(repository).parts
        made = any(part[0] == "." or part in ("node_modules", "__pycache__") for part in inside)
        if file.is_file() and not made:
            assert not (hit := advice.search(file.read_text(errors="replace"))), (file, hit)


def test_the_site_has_every_page_and_loads_nothing_from_other_hosts(repository: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=repository, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for page in (repository / "docs").glob("*.md"):
        assert len(re.findall(r"<h1", (tmp_path / f"{page.stem}.html").read_text())) == 1, page.name
    assert "Unreleased" in (tmp_path / "changes.html").read_text()
    loading = re.compile(r'<(?:script|img|link|iframe)\b[^>]*?\b(?:src|href)="?((?:https?:)?//[^\s">]+)')
    for built in tmp_path.glob("*.html"):
        assert loading.findall(built.read_text()) == [], built.name
    named = re.findall(r"\]\(([^)]+)\): \S", (tmp_path / "llms.txt").read_text())
    assert {"quickstart.html", "mcp.html", "http.html"} <= set(named)
    assert all((tmp_path / name).exists() for name in named)
