from __future__ import annotations

import pytest

from pc2pix.training_data import GanData
from pc2pix.weights import export
from tests.learning.trainings import TRAININGS, make_set


def many_objects():
    """More objects than a code has numbers: the codes of fewer lie on a plane."""
    return gan_set(12)


def gan_set(objects=3):
    seen = make_set(objects)
    return GanData(seen.images, seen.azimuth_deg, seen.elevation_deg, seen.clouds)


@pytest.fixture(scope="session")
def gan_data():
    return gan_set()


@pytest.fixture(scope="session")
def weights_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gan")
    export(TRAININGS["gan"](folder / "run", 1, augment=False), folder / "tiny.safetensors")
    return folder / "tiny.safetensors"
