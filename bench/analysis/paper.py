"""The paper's methods and published values, as runs are set against them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from bench.analysis.comparison import NAN
from bench.catalogue.lookup import family_of

# Published values by (class, metric, condition, method).
Published = Mapping[tuple[str, str, str, str], float]

SURFACE = "surface-apss"  # stands for the paper's SR (surface reconstruction)
NETWORK = "pc2pix"  # the first variant of it in a run stands for the paper's PC2PIX
PAPER_NETWORK = "pc2pix@all"  # the published PC2PIX of Table 5: one network for all classes
PAPER_METRIC = "fid"  # the metric of the paper's Table 5
# The methods of the paper's Tables 3 and 4, by the heads that their columns have in our tables.
PAPER_METHODS = {SURFACE: "SR", NETWORK: "PC2PIX", "pc2pix@acgan": "PC2PIX@acgan"}
AVERAGE = "average"  # the mean over classes, each counting alike


def network_of(methods: Iterable[str]) -> str | None:
    """Return the method that stands for the paper's PC2PIX; None where no variant was measured."""
    return next((method for method in methods if family_of(method) == NETWORK), None)


def published_value(
    published: Published, class_name: str, metric: str, condition: str, method: str
) -> float:
    """Return the paper's value of a method; NaN where it has none.

    A variant of a network that the paper does not have takes the value of the network itself.
    """
    of_method = published.get((class_name, metric, condition, method))
    if of_method is not None:
        return of_method
    return published.get((class_name, metric, condition, family_of(method)), NAN)


def paper_difference(published: Published, class_name: str) -> float:
    """Return by how much the paper's PC2PIX is better than its SR by FID; NaN without the class."""
    criterion = (class_name, PAPER_METRIC, "2048")
    surface = published.get((*criterion, SURFACE), NAN)
    network = published.get((*criterion, PAPER_NETWORK), NAN)
    return surface - network
