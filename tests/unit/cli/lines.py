"""Command lines, run in the tests' process."""

from __future__ import annotations

from typer.testing import CliRunner, Result

from meshdeform.cli.app import app

__all__ = ["done", "refused"]


def done(line: str, *more: str) -> Result:
    """Run a command that must succeed; `more` has what spaces do not separate."""
    result = CliRunner().invoke(app, [*line.split(), *more])
    assert result.exit_code == 0, result.output
    return result


def refused(line: str, *more: str) -> str:
    """Run a command that must be refused as wrong, and return what it says in one line."""
    result = CliRunner().invoke(app, [*line.split(), *more])
    assert result.exit_code in {2, 3, 4}, result.output
    assert "Traceback" not in result.output
    return " ".join(result.output.replace("│", " ").split())
