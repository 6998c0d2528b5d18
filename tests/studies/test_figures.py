"""Figures of the result pages: what they show, and that they are up to date."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from studies.documents import REPOSITORY
from studies.figures import DPI, FIGURES

DIFFERENT = 32  # grey levels; smaller differences come from other versions of matplotlib
SHARE = 0.0005  # of the pixels: a marker that moved changes more


@pytest.fixture(scope="module")
def figures():
    return {name: draw() for name, draw in FIGURES.items()}


@pytest.mark.parametrize("name", FIGURES)
def test_figures_are_what_the_numbers_say(figures, name):
    """Run python -m studies.figures where this fails."""
    drawn = io.BytesIO()
    figures[name].savefig(drawn, format="png", dpi=DPI)
    now, stored = (
        np.asarray(Image.open(file).convert("L"), np.int16)
        for file in (drawn, REPOSITORY / "docs" / f"{name}.png")
    )
    assert now.shape == stored.shape
    assert (abs(now - stored) > DIFFERENT).mean() < SHARE
