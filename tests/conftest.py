"""Which tests share a worker: those of a file, those that would disturb each other, and those
that share what takes long to make. And how many threads torch has in a test: one; and a clock."""

import sys
import time
from collections.abc import Iterator

import pytest

ALONE = ("opengl", "ray", "memory", "timing")  # see the markers in pyproject.toml
MADE_ONCE = ("finished",)  # fixtures of the session that take long: made by one worker


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
