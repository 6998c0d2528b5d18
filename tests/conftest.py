"""Which tests share a worker: those of a file, those that would disturb each other, and those
that share what takes long to make. Where tests stand: in a folder and a home of their own. And how
many threads torch has in a test: one; and a clock."""

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

ALONE = ("opengl", "ray", "memory", "timing")  # see the markers in pyproject.toml
MADE_ONCE = ("finished", "outputs_of")  # fixtures of the session that take long: made by one worker
# Folders of settings and caches, which are below HOME where these are not set.
ELSEWHERE = ("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME")
# Git reads a checkout of another user only where its settings, which the user's home has, say so.
GIT = {
    "GIT_CONFIG_COUNT": "1",
    "GIT_CONFIG_KEY_0": "safe.directory",
    "GIT_CONFIG_VALUE_0": str(Path(__file__).parents[1]),
}
HOME = pytest.StashKey[str]()


def pytest_configure(config: pytest.Config) -> None:
    """Give the process, and those that tests start, an empty home, without a user's settings and
    caches. Before tests are collected: libraries look there when they are imported."""
    config.stash[HOME] = os.environ["HOME"] = tempfile.mkdtemp(prefix="home-of-tests-")
    for name in ELSEWHERE:
        os.environ.pop(name, None)
    os.environ.update(GIT)


def pytest_unconfigure(config: pytest.Config) -> None:
    """Remove that home."""
    shutil.rmtree(config.stash[HOME], ignore_errors=True)


@pytest.fixture(scope="session", autouse=True)
def current_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Run all tests in an empty folder: the default folder of runs, plug-ins and settings are
    looked for in the current one, and a user's may lie where pytest was started."""
    folder = tmp_path_factory.mktemp("current")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield folder


@pytest.fixture(autouse=True)
def stays_empty(current_folder: Path) -> Iterator[None]:
    """Fail for a test that leaves something in the current folder of all tests."""
    yield
    left = sorted(path.name for path in current_folder.iterdir())
    if left:
        shutil.rmtree(current_folder)  # or the next tests would fail, too
        current_folder.mkdir()
        os.chdir(current_folder)
        pytest.fail(f"left {left} in the current folder: write into tmp_path")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Name the group of each test for `--dist loadgroup`: a group is done by one worker."""
    for item in items:
        alone = [name for name in ALONE if item.get_closest_marker(name)]
        alone += [name for name in MADE_ONCE if name in getattr(item, "fixturenames", ())]
        group = alone[0] if alone else item.nodeid.partition("::")[0]
        item.add_marker(pytest.mark.xdist_group(group))


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What `time.monotonic` gives, to be moved on."""
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    return now


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Torch sums with one thread, where the test's module has imported it: the number of threads
    changes the order of a sum, and with it the last bits."""
    torch = sys.modules.get("torch")
    if torch is None:
        yield
        return
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
