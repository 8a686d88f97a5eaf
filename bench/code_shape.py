"""Count what makes code hard to read: long functions, many arguments, one name for two classes, constants far below.

A constant stands below a function or a class without need if its value could be known above all of them: then a second
subject usually begins there. Private classes, and those of the client that extend those of the API
(`meshdeform/client/documents.py`), may share names.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

__all__ = ["MOST_ARGUMENTS", "MOST_LINES", "counted"]

MOST_LINES, MOST_ARGUMENTS = 60, 8
_EXTENDS = "meshdeform/client/documents.py"
_Function = ast.FunctionDef | ast.AsyncFunctionDef
_Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
_Constant = ast.Assign | ast.AnnAssign


def counted(sources: Mapping[str, str]) -> dict[str, int]:
    """Return the counts of modules: mapping of paths to source texts."""
    trees = {path: ast.parse(text) for path, text in sources.items()}
    functions = [node for tree in trees.values() for node in ast.walk(tree) if isinstance(node, _Function)]
    return {
        f"functions_over_{MOST_LINES}_lines": sum(_lines(each) > MOST_LINES for each in functions),
        f"functions_over_{MOST_ARGUMENTS}_arguments": sum(_arguments(each) > MOST_ARGUMENTS for each in functions),
        "class_names_twice": sum(count > 1 for count in Counter(_public_classes(trees)).values()),
        "modules_with_constants_below": sum(any(_below(tree)) for tree in trees.values()),
    }


def _lines(function: _Function) -> int:
    return (function.end_lineno or 0) - function.lineno + 1


def _arguments(function: _Function) -> int:
    given = function.args
    names = [each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return len(names) - (names[:1] in (["self"], ["cls"]))


def _public_classes(trees: Mapping[str, ast.Module]) -> Iterator[str]:
    for path, tree in trees.items():
        if path != _EXTENDS:
            yield from (node.name for node in tree.body if isinstance(node, ast.ClassDef) and node.name[0] != "_")


def _below(tree: ast.Module) -> Iterator[str]:
    """Yield the names of the constants that could stand above all functions and classes."""
    defined = {node.name for node in tree.body if isinstance(node, _Definition)}
    late: set[str] = set()
    below = False
    for node in tree.body:
        if isinstance(node, _Definition):
            below = True
        elif isinstance(node, _Constant) and below and node.value is not None:
            names = set(_names(_targets(node)))
            if names & late or names & defined or set(_names([node.value])) & (defined | late):
                late |= names
            else:
                yield from names
        elif below and not isinstance(node, ast.Expr):
            late |= {alias.asname or alias.name for each in ast.walk(node) for alias in getattr(each, "names", ())
                     if isinstance(alias, ast.alias)}  # fmt: skip


def _targets(node: _Constant) -> list[ast.expr]:
    return node.targets if isinstance(node, ast.Assign) else [node.target]


def _names(nodes: Iterable[ast.expr]) -> Iterator[str]:
    return (each.id for node in nodes for each in ast.walk(node) if isinstance(each, ast.Name))
