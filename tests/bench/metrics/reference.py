"""Conformance vectors, which are no part of the repository: where they are, and their cases."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

REFERENCE = Path(
    os.environ.get("PC2PIX_REFERENCE", Path(__file__).parents[4] / "shared" / "reference")
)
MISSING = f"no conformance vectors in {REFERENCE}; set PC2PIX_REFERENCE"


def reference_cases(file_name):
    """The parameters of a test: one a case, slow where it has more than 1,000 dimensions."""
    path = REFERENCE / file_name
    if not path.is_file():
        return [pytest.param(None, marks=pytest.mark.skip(reason=MISSING))]
    return [
        pytest.param(case, id=name, marks=pytest.mark.slow if case.get("dim", 0) > 1000 else [])
        for name, case in json.loads(path.read_text())["cases"].items()
    ]
