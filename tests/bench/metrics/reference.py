"""The conformance vectors of tests/reference, or of the folder that PC2PIX_REFERENCE names."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

REFERENCE = Path(os.environ.get("PC2PIX_REFERENCE", Path(__file__).parents[2] / "reference"))


def reference_cases(file_name):
    """The parameters of a test: one a case, slow where it has more than 1,000 dimensions."""
    return [
        pytest.param(case, id=name, marks=pytest.mark.slow if case.get("dim", 0) > 1000 else [])
        for name, case in json.loads((REFERENCE / file_name).read_text())["cases"].items()
    ]
