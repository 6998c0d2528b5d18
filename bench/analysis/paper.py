"""The paper's methods and published values, as runs are set against them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from bench.analysis.comparison import NAN
from bench.catalogue.lookup import family_of

# Published values by (class, metric, condition, method).
Published = Mapping[tuple[str, str, str, str], float]

SURFACE = "surface-apss"  # the paper's SR
NETWORK = "pc2pix"  # the first variant of it in a run is the paper's PC2PIX
PAPER_NETWORK = "pc2pix@all"  # of the paper's Table 5
PAPER_METRIC = "fid"
# Methods of the paper's Tables 3 and 4, with their heads; variants of the network follow it.
PAPER_METHODS = {SURFACE: "SR", NETWORK: "PC2PIX", "pc2pix@acgan": "PC2PIX@acgan"}
AVERAGE = "average"  # the mean over classes, each counting alike


def network_of(methods: Iterable[str]) -> str | None:
    """Return the method that stands for the paper's PC2PIX; None where no variant was measured."""
    return next((method for method in methods if family_of(method) == NETWORK), None)


def published_value(
    published: Published, class_name: str, metric: str, condition: str, method: str
) -> float:
    """Return the paper's value for a cell; NaN where it has none.

    A network of ours that the paper does not have takes the value of its architecture.
    """
    names = (method, family_of(method))
    values = (published.get((class_name, metric, condition, name)) for name in names)
    return next((value for value in values if value is not None), NAN)


def paper_difference(published: Published, class_name: str) -> float:
    """Return by how much the paper's PC2PIX is better than its SR by FID; NaN without the class."""
    cell = (class_name, PAPER_METRIC, "2048")
    surface, network = (published.get((*cell, m), NAN) for m in (SURFACE, PAPER_NETWORK))
    return surface - network
