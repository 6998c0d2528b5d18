"""The suite `latent`: how many paths and sums it measures."""

from __future__ import annotations

from dataclasses import dataclass

from bench.catalogue import suites
from bench.catalogue.suites import Procedure


@dataclass(frozen=True)
class LatentSuite(Procedure):
    """Paths between codes and differences of codes, which `bench.suites.latent.run` measures.

    methods        networks with a code: pc2pix with any weights
    pairs          of test chairs of different structural families, joined by a path
    positions      on a path, its two ends included
    triples        sums A - B + C, where A is B with one change
    pool           test chairs that the triples are chosen from
    neighbours     train chairs that the nearest to a sum is chosen from
    azimuth_deg, elevation_deg  of the one view that all images show
    shown          pairs and triples in the figures
    """

    pairs: int
    positions: int
    triples: int
    pool: int
    neighbours: int
    azimuth_deg: float
    elevation_deg: float
    shown: int


LATENT = LatentSuite(
    **vars(suites.LATENT),
    pairs=50,
    positions=8,
    triples=60,
    pool=800,
    neighbours=500,
    azimuth_deg=30.0,
    elevation_deg=20.0,
    shown=5,
)
