"""The jobs of the suite `stability`: every method on every case. Pure: nothing is run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from bench.catalogue.suites import StabilitySuite
from bench.records.artifacts import artifact_path
from bench.records.record import SCHEMA_VERSION
from bench.running.protocol import digest, method_identity
from bench.running.work import Job
from bench.suites.stability.cases import CASES
from data_prep.datasets import ProceduralObject

CASES_VERSION = 1  # raise when a perturbation of `data_prep.extremes` changes a cloud


def stability_jobs(
    suite: StabilitySuite,
    methods: Sequence[str],
    seed: int,
    device: str,
    environment: Mapping[str, str],
    directory: Path,
) -> list[Job]:
    """One job per method and case, without ground truth: nothing is scored.

    Raises BadInput for an unknown method.
    """
    obj = ProceduralObject(suite.class_name, "test", suite.index)
    jobs = []
    for method in methods:
        common = [
            *(suite.id, SCHEMA_VERSION, CASES_VERSION, obj.fingerprint(), seed, method),
            *(sorted(environment.items()), method_identity(method, device)),
        ]
        for case in CASES:
            views = [[view.azimuth_deg, view.elevation_deg] for view in case.views]
            # The case's name too: random numbers are drawn by it.
            key = digest([*common, case.id, repr(case.perturbation), views, case.batch])
            jobs.append(
                Job(
                    key=key,
                    suite=suite.id,
                    method=method,
                    condition=case.id,
                    perturbation=case.perturbation,
                    object=obj,
                    views=case.views,
                    seed=seed,
                    device=device,
                    features=(),
                    artifact=artifact_path(directory, key),
                    reference=None,
                    batch=case.batch,
                )
            )
    return jobs
