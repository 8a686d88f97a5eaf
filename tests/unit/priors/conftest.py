"""Tiny Stable Diffusion checkpoints of the real classes, written once a session."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def tiny_stable_diffusion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a checkpoint that predicts epsilon."""
    from tests.fakes import build_tiny_stable_diffusion

    return build_tiny_stable_diffusion(tmp_path_factory.mktemp("stable-diffusion"))
