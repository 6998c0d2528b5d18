from __future__ import annotations

import pytest

from pc2pix.training_data import GanData
from pc2pix.weights import export
from tests.learning.trainings import TRAININGS, make_set


@pytest.fixture(scope="session")
def gan_data():
    seen = make_set()
    return GanData(seen.images, seen.azimuth_deg, seen.elevation_deg, seen.clouds)


@pytest.fixture(scope="session")
def gan_checkpoint(tmp_path_factory):
    return TRAININGS["gan"](tmp_path_factory.mktemp("gan"), 2, augment=False)


@pytest.fixture(scope="session")
def weights_file(gan_checkpoint, tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "tiny.safetensors"
    export(gan_checkpoint, path)
    return path
