from __future__ import annotations

import sys

import pytest


@pytest.fixture(autouse=True)
def denormal_numbers():
    """Trainings switch them off for their whole process, in the middle of which other tests run."""
    if "torch" in sys.modules:
        sys.modules["torch"].set_flush_denormal(False)
