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
        *progress, line = err.splitlines()
        assert all(text.startswith("drawing: ") for text in progress)  # where the machine is busy
        assert line.startswith("bench: ")
        return line.removeprefix("bench: ")

    return run
