"""Parquet files with one changed byte end no process and are never read as something else."""

from __future__ import annotations

import pytest

from bench.records.seal import SEAL

from .flip_bytes import FILES, count_outcomes, flips, make_files


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "run").mkdir()
    return tmp_path / "run"


@pytest.mark.slow
def test_no_changed_byte_is_read_as_something_else(folder):
    make_files(folder)
    tasks = [flip for file in FILES for flip in flips(folder, file, values=1, stride=7)]
    for outcomes in count_outcomes(tasks).values():
        assert outcomes.keys() <= {"read", "refused"}
        # only a changed SEAL leaves the rest as it was
        assert outcomes["read"] <= len(SEAL)
        assert outcomes["refused"] > 50
