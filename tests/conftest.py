"""Which tests share a worker: those of a file, those that would disturb each other, and those
that share what takes long to make."""

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
