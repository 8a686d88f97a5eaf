"""Draw what imports what, as docs/pictures/architecture.svg, and list the folders, each by its docstring.

A folder stands below all that import it, those inside functions included; an import that others imply has no line. What
nearly all import is a bar below them.
"""

from __future__ import annotations

import ast
import tomllib
from functools import cache
from html import escape
from pathlib import Path

from docs.generation.between import renewed

__all__ = ["page", "picture"]

_ROOT = Path(__file__).resolve().parents[2]
_CONTRACT = "Every folder stands above those that it imports"
_COMMON = ("support", "settings", "requests", "vocabulary", "errors", "verdicts")
"""What nearly all import: without lines."""
_WIDTH, _ROW, _BOX, _HEIGHT = 760, 62, 100, 24
"""Of the picture, in pixels: its width, from row to row, and of a box."""


def page(text: str) -> str:
    """Return docs/architecture.md with its list of folders regenerated."""
    return renewed(text, "the docstrings of folders", table())


def picture() -> str:
    """Return the picture as SVG."""
    names = [name for row in _layers() for name in row if name not in _COMMON]
    graph = _reduced({name: _imports(name) & set(names) for name in names})
    rows = _ordered(_rows(graph), graph)
    at = {
        name: (_WIDTH * (index + 0.5) / len(row), 20 + depth * _ROW)
        for depth, row in enumerate(rows)
        for index, name in enumerate(row)
    }
    lines = "".join(_line(at[above], at[below]) for above in graph for below in sorted(graph[above]))
    boxes = "".join(_box(name, place, _BOX) for name, place in at.items())
    foot = len(rows) * _ROW
    boxes += _box(", ".join(_COMMON), (_WIDTH / 2, foot + 10), _WIDTH - 20)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {foot + 30}" font-family="sans-serif"'
        f' font-size="13" text-anchor="middle"><rect width="{_WIDTH}" height="{foot + 30}" fill="#fff"/>\n'
        f'<g stroke="#8896a6" fill="none">\n{lines}</g>\n<g>\n{boxes}</g></svg>\n'
    )


def table() -> str:
    """Return what each folder holds, by the first sentence of its docstring."""
    lines = ["| folder | |", "|---|---|"]
    lines += [
        f"| `{_folder(name).relative_to(_ROOT)}` | {_purpose(name)} |"
        for row in _layers()
        for name in row
        if _folder(name).is_dir()
    ]
    return "\n".join(lines) + "\n"


def _layers() -> list[list[str]]:
    contracts = tomllib.loads((_ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = next(each["layers"] for each in contracts if each["name"] == _CONTRACT)
    return [[name.strip().removeprefix("meshdeform.") for name in layer.split("|")] for layer in layers]


def _rows(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the folders by the longest way down to them."""
    depth = dict.fromkeys(graph, 0)
    for name in graph:
        for below in graph[name]:
            depth[below] = max(depth[below], depth[name] + 1)
    return [[name for name in graph if depth[name] == row] for row in range(max(depth.values()) + 1)]


def _ordered(rows: list[list[str]], graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the rows, each in the order of the mean places of what imports a folder."""
    at: dict[str, float] = {}
    ordered = []
    for row in rows:
        above = {name: [at[other] for other in at if name in graph[other]] for name in row}
        row = sorted(row, key=lambda name: sum(above[name]) / len(above[name]) if above[name] else 0.5)
        at |= {name: (index + 0.5) / len(row) for index, name in enumerate(row)}
        ordered.append(row)
    return ordered


def _line(above: tuple[float, float], below: tuple[float, float]) -> str:
    (x, y), (u, v) = above, below
    y, v = y + _HEIGHT / 2, v - _HEIGHT / 2
    bend = (v - y) / 2
    return f'<path d="M{x:.0f} {y:.0f}C{x:.0f} {y + bend:.0f} {u:.0f} {v - bend:.0f} {u:.0f} {v:.0f}"/>\n'


def _box(name: str, place: tuple[float, float], width: float) -> str:
    x, y = place
    corner = f'x="{x - width / 2:.0f}" y="{y - _HEIGHT / 2:.0f}" width="{width}" height="{_HEIGHT}" rx="4"'
    return f'<rect {corner} fill="#eef2f7" stroke="#64748b"/><text x="{x:.0f}" y="{y + 4:.0f}">{escape(name)}</text>\n'


def _folder(name: str) -> Path:
    return _ROOT / name if name in ("service", "worker") else _ROOT / "meshdeform" / name


def _purpose(name: str) -> str:
    text = ast.get_docstring(ast.parse((_folder(name) / "__init__.py").read_text())) or ""
    return " ".join(text.partition("\n\n")[0].split())


@cache
def _imports(name: str) -> frozenset[str]:
    """Return the folders and modules of the package that modules of one import."""
    folder = _folder(name)
    files = sorted(folder.rglob("*.py")) if folder.is_dir() else [folder.with_suffix(".py")]
    names = {each for file in files for each in _imported(ast.parse(file.read_text()))}
    return frozenset(each.split(".")[1] for each in names if each.startswith("meshdeform.")) - {name}


def _imported(tree: ast.Module) -> list[str]:
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            found += [
                f"{node.module}.{alias.name}" if node.module == "meshdeform" else node.module for alias in node.names
            ]
        elif isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
    return found


def _reduced(graph: dict[str, frozenset[str]]) -> dict[str, set[str]]:
    """Return a graph whose nodes are in order without the edges that others imply, and without those that go up."""
    order = {name: rank for rank, name in enumerate(graph)}
    down = {name: {each for each in names if order[each] > order[name]} for name, names in graph.items()}
    reach: dict[str, set[str]] = {}
    for name in reversed(list(graph)):
        reach[name] = down[name].union(*(reach[each] for each in down[name]))
    return {
        name: {each for each in names if not any(each in reach[other] for other in names)}
        for name, names in down.items()
    }
