"""The modules of pyiqa that need NumPy and PyTorch alone, without its package."""

from __future__ import annotations

import importlib
import sys
from importlib.metadata import PackageNotFoundError, distribution
from types import ModuleType

import pytest

PROVENANCE = "pyiqa 0.1.16 (pyiqa/archs/ssim_arch.py), float64, 2026-11-25"


def similarity_module() -> ModuleType:
    """Return `pyiqa.archs.ssim_arch`; skip the test where pyiqa is not installed."""
    try:
        package = distribution("pyiqa")
    except PackageNotFoundError:
        pytest.skip("pyiqa is not installed (pip install --no-deps pyiqa==0.1.16)")
    for name in ("pyiqa", "pyiqa.utils", "pyiqa.archs"):
        if name not in sys.modules:  # whose own code imports OpenCV and others
            module = sys.modules[name] = ModuleType(name)
            module.__path__ = [str(package.locate_file(name.replace(".", "/")))]
    return importlib.import_module("pyiqa.archs.ssim_arch")
