"""Parquet files with one changed byte end no process and are never read as something else."""

from __future__ import annotations

import pytest

from bench.records.seal import SEAL

from .flip_bytes import FILES, REST, Flip, count_outcomes, flips, make_files, part_start

FEATURES_FILE = FILES[1]


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "run").mkdir()
    return tmp_path / "run"


@pytest.mark.slow
def test_no_changed_byte_is_read_as_something_else(folder):
    make_files(folder, sealed=True)
    tasks = [flip for file in FILES for flip in flips(folder, file, values=1, stride=7)]
    for outcomes in count_outcomes(tasks).values():
        assert outcomes.keys() <= {"read", "refused"}
        # only a changed SEAL leaves the rest as it was
        assert outcomes["read"] <= len(SEAL)
        assert outcomes["refused"] > 50


def test_what_ends_arrow_is_refused_in_files_without_a_seal_too(folder):
    """Arrow 26 ends its process at these bytes of a footer: terminate() in a destructor."""
    make_files(folder, sealed=False)
    footer = part_start((folder / FEATURES_FILE).read_bytes())
    deadly = [(39, 106), (162, 55), (798, 32)]
    tasks = [Flip(folder, FEATURES_FILE, footer + at, value) for at, value in deadly]
    ((part, outcomes),) = count_outcomes(tasks).items()
    assert part == (FEATURES_FILE, REST)
    assert outcomes == {"refused": 3}
