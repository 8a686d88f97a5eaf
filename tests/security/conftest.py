"""Fixtures for attacks on a real server; they are those of the integration tests."""

from __future__ import annotations

from tests.integration.conftest import api, database_url, own_settings, pytest_generate_tests, record, sphere, start

__all__ = ["api", "database_url", "own_settings", "pytest_generate_tests", "record", "sphere", "start"]
