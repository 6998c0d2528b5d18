from __future__ import annotations

import plugin_methods
import pytest


@pytest.fixture
def plugins(tmp_path_factory, monkeypatch):
    with plugin_methods.installed(tmp_path_factory.mktemp("plugins"), monkeypatch):
        yield


@pytest.fixture
def refused(command):
    """Runs a command that cannot do what it is asked; gives its one line of error."""

    def run(*arguments):
        status, out, err = command(*arguments)
        assert (status, out) == (2, "")
        assert err.startswith("bench: ")
        assert err.count("\n") == 1
        return err.removeprefix("bench: ").rstrip("\n")

    return run
