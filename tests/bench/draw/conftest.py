from __future__ import annotations

import plugin_methods
import pytest


@pytest.fixture
def plugins(tmp_path_factory, monkeypatch):
    with plugin_methods.installed(tmp_path_factory.mktemp("plugins"), monkeypatch):
        yield
