"""Make another strength of a result in a child process, so that a process without torch can ask for one.

`apply_strength` imports neither torch nor numpy. The child has no secrets in its environment, and bounded memory and
time.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from meshdeform.assets.isolation import bound_memory, run_child
from meshdeform.assets.limits import Limits
from meshdeform.errors import DependencyError, MeshdeformError, ParameterError, UnavailableError

__all__ = ["apply_strength", "main"]

_MEMORY_BYTES = 16 * 2**30
"""Address space; torch alone maps several gigabytes of it."""


def apply_strength(
    source: Path,
    result: Path,
    output: Path,
    strength: float,
    *,
    filename: str,
    exclude: Sequence[str | int],
    compact: bool,
    limits: Limits,
    timeout_s: float,
) -> None:
    """Write the GLB of a result at another strength.

    Parameters
    ----------
    source, result, output : Path
        The asset that was deformed, its result, and the file to write.
    strength : float
    filename : str
        The source's name; its extension decides the format where the content does not.
    exclude : sequence of str or int
        `params.exclude` of the run.
    compact : bool
    limits : Limits
    timeout_s : float

    Raises
    ------
    ParameterError
        The result was not made from the source.
    DependencyError
        Torch is not installed here.
    UnavailableError
        It took too long or too much memory, or no process can be started.
    """
    task = {
        "source": str(source.absolute()),
        "result": str(result.absolute()),
        "output": str(output.absolute()),
        "strength": strength,
        "suffix": Path(filename).suffix[:16],
        "exclude": list(exclude),
        "compact": compact,
        "limits": asdict(limits),
    }
    try:
        child = run_child(__name__, [json.dumps(task)], timeout_s=timeout_s, temporary=output.absolute().parent)
    except TimeoutError as error:
        raise _too_much(f"It takes longer than {timeout_s:g} s.") from error
    if child.verdict is None:
        raise _too_much(f"The process ended with status {child.returncode}.")
    if not child.verdict["ok"]:
        raise _error(child.verdict)


def main(arguments: list[str] | None = None) -> int:
    """Carry out one task, given as JSON, and print a JSON verdict: `{"ok": true}` or what went wrong."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("task", type=json.loads)
    task = parser.parse_args(arguments).task
    bound_memory(_MEMORY_BYTES)
    verdict: dict[str, Any] = {"ok": True}
    try:
        _apply(task)
    except MeshdeformError as error:
        verdict = {"ok": False, "code": error.code, "detail": error.detail, "advice": error.advice_text}
    except ModuleNotFoundError as error:
        verdict = {"ok": False, "code": DependencyError.code, "detail": f"{error.name} is not installed.", "advice": ""}
    print(json.dumps(verdict))
    return 0 if verdict["ok"] else 1


def _apply(task: dict[str, Any]) -> None:
    from meshdeform.assets import load_asset
    from meshdeform.runs.devices import use_threads
    from meshdeform.runs.strength import with_strength

    use_threads(1)
    limits = Limits(**task["limits"])
    source = load_asset(Path(task["source"]).read_bytes(), f"asset{task['suffix']}", limits)
    options = {"exclude": task["exclude"], "limits": limits, "compact": task["compact"]}
    made = with_strength(source, Path(task["result"]).read_bytes(), task["strength"], **options)
    Path(task["output"]).write_bytes(made)


def _error(verdict: dict[str, Any]) -> MeshdeformError:
    if verdict["code"] == DependencyError.code:
        return DependencyError(
            f"Other strengths need the extra `deform` where they are made: {verdict['detail']}",
            advice="Download the result and its source, and run `meshdeform apply`, or install the extra.",
        )
    kind = ParameterError if verdict["code"] == ParameterError.code else MeshdeformError
    return kind(verdict["detail"], advice=verdict["advice"])


def _too_much(reason: str) -> UnavailableError:
    return UnavailableError(
        f"The strength cannot be applied on this server. {reason}",
        advice="Download the result and its source, and run `meshdeform apply`.",
    )
