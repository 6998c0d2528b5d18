"""The measurements of the suite `speed`: each method under each condition, with each number of
threads. Nothing is run; our own sources are read, to see whether old times are of the same code.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.catalogue.lookup import find
from bench.catalogue.suites import SpeedSuite
from bench.running.protocol import digest, method_identity
from bench.running.sources import ROOT, code_sha256
from bench.suites.speed.measure import Unit
from bench.suites.speed.samples import FORM
from data_prep.conditions import CONDITIONS
from data_prep.datasets import SceneObject

TIMED = (  # what decides how long something takes
    *("data_prep", "baselines", "pc2pix"),
    *(f"bench/catalogue/{name}.py" for name in ("methods", "loaders", "parameters")),
    "bench/suites/speed/measure.py",
)


def speed_units(
    suite: SpeedSuite,
    methods: Sequence[str],
    conditions: Sequence[str],
    objects: Sequence[SceneObject],
    threads: Sequence[int],
    views: int,
    seed: int,
    device: str,
    circumstances: Mapping[str, Any],
) -> list[Unit]:
    """One unit per method, condition and number of threads, in the order in which they are taken.

    `circumstances` is whatever else times depend on: versions, machine, drivers. Raises BadInput
    for an unknown method or condition.
    """
    common = [
        *(FORM, suite.id, sources_sha256(), circumstances, views, seed),
        *(suite.singles, suite.warm_ups, suite.least_rounds, suite.most_rounds, suite.seconds),
        [[obj.class_name, obj.object_id, obj.fingerprint()] for obj in objects],
    ]
    units = []
    for method in methods:
        identity = [method, method_identity(method, device)]
        for name in conditions:
            condition = find(name, CONDITIONS, "condition")
            of_cloud = [condition.id, repr(condition.perturbation)]
            units += [
                Unit(
                    key=digest([common, identity, of_cloud, count]),
                    suite=suite,
                    method=method,
                    condition=condition.id,
                    perturbation=condition.perturbation,
                    objects=tuple(objects),
                    threads=count,
                    views=views,
                    seed=seed,
                    device=device,
                )
                for count in threads
            ]
    return units


def sources_sha256(root: Path = ROOT) -> str:
    """Checksum of all code under `root` that is timed.

    `Method.version` is raised when pictures change; times also change where they do not.
    """
    return code_sha256(TIMED, root)
