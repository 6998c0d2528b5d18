"""Modules under their old names: the same modules, with a warning."""

import subprocess
import sys
from importlib import import_module

import pytest

from data_prep.moved_modules import NEW_NAMES


@pytest.mark.parametrize("old", sorted(NEW_NAMES))
def test_an_old_name_is_the_new_module_and_warns(old: str) -> None:
    with pytest.warns(DeprecationWarning, match=rf"data_prep\.{old} is now data_prep\.[a-z_.]+;"):
        module = import_module(f"data_prep.{old}")
    try:
        assert module is import_module(f"data_prep.{NEW_NAMES[old]}")
        assert module.__name__ == f"data_prep.{NEW_NAMES[old]}"
    finally:
        del sys.modules[f"data_prep.{old}"]


def test_names_of_the_old_datasets_module_are_those_of_the_registry() -> None:
    from data_prep.datasets import registry

    with pytest.warns(DeprecationWarning, match="data_prep.datasets.registry.open_dataset"):
        from data_prep.datasets import open_dataset
    assert open_dataset is registry.open_dataset
    with pytest.raises(ImportError, match="nothing"):
        from data_prep.datasets import nothing  # noqa: F401


def test_a_package_that_imports_an_old_name_works() -> None:
    code = (
        "from data_prep.render import render; "
        "from data_prep.images import to_uint8; "
        "print(render.__module__)"
    )
    done = subprocess.run(
        (sys.executable, "-P", "-W", "ignore", "-c", code),
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "data_prep.rendering.opengl\n"


def test_the_old_name_of_a_listing_is_the_new_class() -> None:
    from data_prep.datasets import dataset

    with pytest.warns(DeprecationWarning, match="dataset.Found is now DatasetListing"):
        from data_prep.datasets.dataset import Found
    assert Found is dataset.DatasetListing
    with pytest.raises(AttributeError, match="nothing"):
        _ = dataset.nothing
