from __future__ import annotations

from functools import cache

import pytest

from bench.analysis.run import read_run
from bench.tables.build import make_outputs

from .test_all_tables import tiny_run


@pytest.fixture(scope="session")
def outputs_of(tmp_path_factory):
    """Return a function that gives the outputs of the tiny run of a suite, which is made once."""

    @cache
    def outputs(run_id):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("bench.analysis.intervals.FEWEST", 2)  # as `few_objects`
            return make_outputs(read_run(tiny_run(tmp_path_factory.mktemp("tiny") / "run", run_id)))

    return outputs
