"""Settings from the environment: lists in both forms, and one clear line about a value that is not valid."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from meshdeform.cli.app import app
from meshdeform.cli.environment import load_settings
from meshdeform.errors import ParameterError
from meshdeform.settings import Settings
from tests.cases import each_case


@each_case("text", ["builtin, owner/model", '["builtin", "owner/model"]', " builtin,owner/model,"])
def test_a_list_is_separated_by_commas_or_json(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setenv("MESHDEFORM_ALLOWED_MODELS", text)
    assert Settings().allowed_models == ["builtin", "owner/model"]
    monkeypatch.setenv("MESHDEFORM_WEBHOOK_NETWORKS", "127.0.0.0/8,fd00::/8")
    assert Settings().webhook_networks == ["127.0.0.0/8", "fd00::/8"]


@each_case(
    ("name", "value", "form"),
    [
        ("ALLOWED_MODELS", '["builtin"', "comma-separated list"),
        ("ALLOWED_MODELS", "[1]", "valid string"),
        ("WEBHOOK_NETWORKS", "10.0.0.1/8", "10.1.0.0/16,fd00::/8"),
        ("TRUSTED_PROXIES", "nginx", "10.1.0.0/16,fd00::/8"),
        ("LEASE_S", "abc", "valid number"),
    ],
)
def test_a_wrong_variable_is_named_with_the_expected_form(name: str, value: str, form: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(f"MESHDEFORM_{name}", value)
        with pytest.raises(ParameterError, match=f"MESHDEFORM_{name}") as refused:
            load_settings(data_dir="x")
    assert form in refused.value.detail
    assert "--" not in refused.value.detail + refused.value.advice_text
    with pytest.raises(ParameterError, match=r"^--threads is not valid"):
        load_settings(threads=-1)


@each_case("command", [["doctor"], ["serve"], ["models"]])
def test_every_command_says_it_in_one_line(monkeypatch: pytest.MonkeyPatch, command: list[str]) -> None:
    monkeypatch.setenv("MESHDEFORM_WEBHOOK_NETWORKS", "everywhere")
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 3
    assert "Error: MESHDEFORM_WEBHOOK_NETWORKS is not valid" in result.output
    assert "Traceback" not in result.output
