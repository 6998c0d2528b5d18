"""Evidence of finished runs for or against the claims of the paper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import pandas as pd

from bench.analysis.comparison import Comparison, Quality
from bench.analysis.paper import NETWORK
from bench.catalogue.lookup import family_of
from data_prep.arrays import Floats

FULL = "2048"
DISTANCES = ("fid", "fd-views")  # the first that a run has; the second stands in for the first


class MissingEvidence(Exception):
    """A run of the right suite that lacks a value which the claim needs."""


class Training(NamedTuple):
    """The facts about a network's weights that claims depend on.

    width     in widths of the paper's network
    degraded  whether the training showed clouds with fewer points and noise
    """

    width: float
    degraded: bool


@dataclass(frozen=True, eq=False)
class QualityEvidence:
    """A run with scored images.

    comparisons  by condition and class
    spreads      by class, how much true objects differ: the value, and the values without each
                 object
    retrieval    by method and condition, the share of each chair's images that is found, [G]
    trainings    of the networks with known weights
    subjects     methods in place of the variants of pc2pix
    seeds        by method, metric and condition, the spread between trainings on chairs
    """

    comparisons: Mapping[tuple[str, str], Comparison]
    spreads: Mapping[str, tuple[float, Floats]] = field(default_factory=dict)
    retrieval: Mapping[tuple[str, str], Floats] = field(default_factory=dict)
    trainings: Mapping[str, Training] = field(default_factory=dict)
    subjects: tuple[str, ...] = ()
    seeds: Mapping[tuple[str, str, str], float] = field(default_factory=dict)

    @property
    def networks(self) -> list[str]:
        """Return the methods that claims are about: `subjects`, or the variants of pc2pix."""
        methods = next(iter(self.comparisons.values())).images
        networks = [
            method
            for method in methods
            if (method in self.subjects if self.subjects else family_of(method) == NETWORK)
        ]
        if not networks:
            raise MissingEvidence(f"the run has no {' or '.join(self.subjects or (NETWORK,))}")
        return networks

    def quality(self, metric: str, method: str, condition: str, class_name: str) -> Quality:
        """Return a metric of a method in one cell. Raises MissingEvidence without a value."""
        cell = self.comparisons.get((condition, class_name))
        if cell is None:
            raise MissingEvidence(f"the run has no {class_name} at {condition}")
        of_metric = cell.qualities.get(metric, {})
        if method not in of_metric:
            raise MissingEvidence(f"the run has no {metric} of {method}")
        return of_metric[method]

    @property
    def distance(self) -> str:
        """Return the Fréchet distance that the run has."""
        measured = next(iter(self.comparisons.values())).qualities
        return next((metric for metric in DISTANCES if metric in measured), DISTANCES[0])

    def classes(self) -> list[str]:
        """Return the classes that have full clouds."""
        return [name for condition, name in self.comparisons if condition == FULL]


@dataclass(frozen=True, eq=False)
class TimingEvidence:
    """A run of the suite `speed`.

    samples    as in `tables/speed_samples.csv`
    machine    its processor
    trainings  of the networks with known weights
    """

    samples: pd.DataFrame
    machine: str = "an unknown machine"
    trainings: Mapping[str, Training] = field(default_factory=dict)


# A run of `latent` is given by the means of both its tables.
Evidence: TypeAlias = QualityEvidence | TimingEvidence | pd.DataFrame
