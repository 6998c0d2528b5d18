"""The paper's methods and published values."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.analysis.paper import network_of, paper_difference, published_value
from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from bench.tables.paper import published

SUITE = find("thirteen-classes", SUITES, "suite")


def test_a_variant_has_its_own_published_value_or_its_architectures():
    fid = ("chair", "fid", "2048")
    values = {(*fid, "pc2pix"): 31.5, (*fid, "pc2pix@all"): 28.8}
    for method, value in (("pc2pix@all", 28.8), ("pc2pix@acgan", 31.5), ("pc2pix", 31.5)):
        assert published_value(values, *fid, method) == value
    assert math.isnan(published_value(values, *fid, "splat"))


def test_which_network_stands_for_the_papers():
    assert network_of(["surface-apss", "pc2pix@all", "pc2pix"]) == "pc2pix@all"
    assert network_of(["pc2pix", "pc2pix@all"]) == "pc2pix"
    assert network_of(["splat", "pc2pixel"]) is None


def test_the_paper_has_11_classes_and_the_average_for_pc2pix():
    """Rifle and lamp are for SR."""
    paper = published(SUITE.id)
    differences = {name: paper_difference(paper, name) for name in (*SUITE.classes, "average")}
    assert [name for name, value in differences.items() if value < 0] == ["lamp", "rifle"]
    # the paper's AVERAGE is the mean of its classes, printed with one decimal
    classes = [differences[name] for name in SUITE.classes]
    assert np.mean(classes) == pytest.approx(differences["average"], abs=0.1)
    assert math.isnan(paper_difference(paper, "spoon"))
