"""Count the seeded mutations of the source that the tests find: which protection a smaller suite has kept.

Record for each set of tests which lines each test runs, then run the mutations against it; both in a checkout whose
source is the same (``git checkout REVISION -- tests``), because the seed chooses lines of that source::

    python -m bench.seeded_mutations record --database old.sqlite
    python -m bench.seeded_mutations run --database old.sqlite --output old.json

``record`` runs the suite under coverage.py (``pip install coverage``), in a checkout with its own environment. ``run``
changes one line at a time, runs the tests that enter this line, those that run the fewest lines first, and stops at the
first that fails.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Generator, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("meshdeform/deformation", "meshdeform/record", "meshdeform/assets", "service")
"""Where lines are changed: as many in each."""
MOST_TESTS = 60
"""Tests run for one mutation."""
_COMPARISONS = {
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==",
    ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
_OPERATORS = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.BitAnd: "|", ast.BitOr: "&"}


@dataclass(frozen=True, slots=True)
class Mutation:
    """A change of one expression: ``source[start:end]`` of the file becomes `text`."""

    path: str
    line: int
    start: int
    end: int
    old: str
    text: str


def mutations_of(path: str, source: str) -> list[Mutation]:
    """Return every mutation of the functions in a file."""
    tree = ast.parse(source)
    starts = [0]
    for line in source.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    encoded = source.encode()
    mutations: list[Mutation] = []
    for node, text in _changes(tree):
        start = starts[node.lineno - 1] + node.col_offset
        end = starts[node.end_lineno - 1] + node.end_col_offset
        old = encoded[start:end].decode()
        if text != old:
            mutations.append(Mutation(path, node.lineno, start, end, old, text))
    return mutations


def _changes(tree: ast.Module) -> Iterator[tuple[Any, str]]:
    """Yield nodes within functions with the text that takes their place; annotations and docstrings stay."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    seen: set[int] = set()
    for function in functions:
        statements = list(function.body)
        while statements:
            node: ast.AST = statements.pop()
            if id(node) in seen:
                continue
            seen.add(id(node))
            if isinstance(node, ast.AnnAssign):
                statements.extend([node.value] if node.value else [])  # type: ignore[list-item]
                continue
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                statements.extend(node.body)
                continue
            statements.extend(ast.iter_child_nodes(node))  # type: ignore[arg-type]
            if (text := _changed(node)) is not None:
                yield node, text


def _changed(node: ast.AST) -> str | None:
    """Return the text of a mutation of a node, or `None` if it has none."""
    match node:
        case ast.Compare(left, [operator], [right]) if type(operator) in _COMPARISONS:
            return f"({ast.unparse(left)} {_COMPARISONS[type(operator)]} {ast.unparse(right)})"
        case ast.BinOp(left, operator, right) if type(operator) in _OPERATORS and not _is_text(left, right):
            return f"(({ast.unparse(left)}) {_OPERATORS[type(operator)]} ({ast.unparse(right)}))"
        case ast.BoolOp(operator, values):
            word = " or " if isinstance(operator, ast.And) else " and "
            return "(" + word.join(f"({ast.unparse(value)})" for value in values) + ")"
        case ast.UnaryOp(ast.Not() | ast.USub(), operand):
            return f"({ast.unparse(operand)})"
        case ast.Constant(bool() as value):
            return str(not value)
        case ast.Constant(int() | float() as value):
            return str(value + 1)
        case ast.If(test=_) | ast.While(test=_) | ast.Constant() | ast.Name():
            return None
        case ast.Expr(ast.Call() | ast.Await()):
            return "pass"
        case ast.Return(ast.expr() as value) if not isinstance(value, ast.Constant):
            return "return None"
    return None


def _is_text(*nodes: ast.expr) -> bool:
    """Whether an operand is a literal text."""
    return any(isinstance(node, ast.JoinedStr) or isinstance(getattr(node, "value", None), str) for node in nodes)


def chosen(count: int, seed: int) -> list[Mutation]:
    """Return `count` mutations, as many of each folder: first a line at random, then one of its mutations."""
    generator = random.Random(seed)
    choices: list[Mutation] = []
    for folder in FOLDERS:
        by_line: dict[tuple[str, int], list[Mutation]] = {}
        for file in sorted((ROOT / folder).rglob("*.py")):
            path = file.relative_to(ROOT).as_posix()
            for mutation in mutations_of(path, file.read_text()):
                by_line.setdefault((path, mutation.line), []).append(mutation)
        lines = generator.sample(sorted(by_line), count // len(FOLDERS))
        choices += [generator.choice(by_line[line]) for line in lines]
    return choices


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, Any, Any]:
    """Name the test in what coverage.py records, here and in the processes that the test starts."""
    from coverage import Coverage

    os.environ["RUNNING_TEST"] = item.nodeid
    if coverage := Coverage.current():
        coverage.switch_context(item.nodeid)
    return (yield)


def record(database: Path, tests: list[str]) -> None:
    """Run the tests under coverage.py, and keep which of them enters each line."""
    with tempfile.TemporaryDirectory() as folder:
        rc = Path(folder) / "coveragerc"
        rc.write_text(
            f"[run]\ninclude =\n    {ROOT}/meshdeform/*\n    {ROOT}/service/*\n    {ROOT}/worker/*\n"
            f"data_file = {folder}/data\nparallel = true\npatch = subprocess, _exit\nsigterm = true\n"
            "context = ${RUNNING_TEST-start}\nconcurrency = thread\n"
            "disable_warnings = no-data-collected, module-not-imported, module-not-measured, context-name-changed\n"
        )
        coverage = [sys.executable, "-m", "coverage"]
        suite = ["pytest", "-p", "bench.seeded_mutations", "-n", "3", "--dist", "loadfile", "--no-loadscope-reorder"]
        subprocess.run([*coverage, "run", f"--rcfile={rc}", "-m", *suite, *tests], cwd=ROOT, check=False)
        subprocess.run([*coverage, "combine", f"--rcfile={rc}", "-q", folder], cwd=ROOT, check=True)
        Path(f"{folder}/data").rename(database)


def tests_of(mutation: Mutation, database: Path) -> list[str]:
    """Return the tests that enter the line; for a line of compiled code, which has no trace, those of its file."""
    from coverage import CoverageData

    data = CoverageData(str(database))
    data.read()
    by_line = data.contexts_by_lineno(str(ROOT / mutation.path))
    contexts = set(by_line.get(mutation.line, []))
    tests = {part for context in contexts for part in context.split("|") if "::" in part}
    if not tests:
        nearby = set().union(*by_line.values()) if by_line else set()
        tests = {part for context in nearby for part in context.split("|") if "::" in part}
    sizes = _sizes(database)
    return sorted(tests, key=lambda test: (sizes.get(test, 0), test))[:MOST_TESTS]


def _sizes(database: Path) -> dict[str, int]:
    """Return for each test how much of the source it enters: the bytes of its bitmaps of lines."""
    with sqlite3.connect(database) as connection:
        rows = connection.execute(
            "select context.context, sum(length(numbits)) from line_bits join context on context.id = context_id"
            " group by context.context"
        )
        sizes: dict[str, int] = {}
        for context, size in rows:
            for part in context.split("|"):
                sizes[part] = sizes.get(part, 0) + size
    return sizes


def run(mutation: Mutation, tests: list[str], limit_s: float) -> dict[str, Any]:
    """Run the tests on the changed file, and return which of them failed first."""
    file = ROOT / mutation.path
    source = file.read_bytes()
    file.write_bytes(source[: mutation.start] + mutation.text.encode() + source[mutation.end :])
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-p", "no:randomly", *tests]
    try:
        ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=limit_s, check=False)
        failed = [line for line in ended.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
        code = ended.returncode
    except subprocess.TimeoutExpired:
        failed, code = ["out of time"], -1
    finally:
        file.write_bytes(source)
    return {"found": code not in (0, 5), "code": code, "by": failed[:1], "tests": len(tests)}


def main() -> None:
    """Record, or run."""
    parser = argparse.ArgumentParser(description="Count the seeded mutations that the tests find.")
    parser.add_argument("action", choices=["choose", "record", "run"])
    parser.add_argument("--database", type=Path, help="what each test enters")
    parser.add_argument("--output", type=Path, help="the outcome of each mutation, as JSON")
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=46)
    parser.add_argument("--limit-s", type=float, default=900.0, help="time for the tests of one mutation")
    parser.add_argument("tests", nargs="*", help="for record: tests, instead of the suite")
    options = parser.parse_intermixed_args()
    if options.action == "record":
        record(options.database, options.tests)
        return
    outcomes: list[dict[str, Any]] = []
    for mutation in chosen(options.count, options.seed):
        outcome: dict[str, Any] = asdict(mutation)
        if options.action == "run":
            outcome |= run(mutation, tests_of(mutation, options.database), options.limit_s)
            outcomes.append(outcome)
            options.output.write_text(json.dumps(outcomes, indent=1) + "\n")
        print(json.dumps(outcome), flush=True)
    if outcomes:
        print(f"{sum(outcome['found'] for outcome in outcomes)} of {len(outcomes)} found")


if __name__ == "__main__":
    main()
