"""Which tests share a worker: those of a file, and those that would disturb each other."""

import pytest

ALONE = ("opengl", "ray", "memory", "timing")  # see the markers in pyproject.toml


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Name the group of each test for `--dist loadgroup`: a group is done by one worker."""
    for item in items:
        marked = next((name for name in ALONE if item.get_closest_marker(name)), None)
        item.add_marker(pytest.mark.xdist_group(marked or item.nodeid.partition("::")[0]))
