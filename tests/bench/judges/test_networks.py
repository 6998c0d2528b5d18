"""The two bundled networks: of the judge, and of the features `fd-views`."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from bench.analysis.sets import read_class_head
from bench.catalogue.metrics import find_extractor
from bench.judges import JUDGE_WEIGHTS, VIEWS_WEIGHTS
from bench.judges.judge import CODE, greyscale, judge, load_judge_network
from bench.judges.views import (
    FEATURES,
    Labels,
    load_views_network,
    view_features,
)
from data_prep.clouds.sampling import random_views
from data_prep.datasets.registry import ProceduralObject
from data_prep.randomness import generator
from data_prep.rendering.images import blank
from data_prep.rendering.opengl import render
from data_prep.shapes.catalogue import CLASSES
from data_prep.shapes.chair.spec import BACKS
from tests.learning.trainings import write_views

OBJECTS, VIEWS = 10, 4
OF = {
    "judge": (load_judge_network, JUDGE_WEIGHTS, judge, 3 + CODE, 4e6),
    "views": (load_views_network, VIEWS_WEIGHTS, view_features, FEATURES, 2e6),
}


@pytest.fixture(scope="module", params=OF)
def bundled(request):
    """A network, and the function that asks it."""
    load, path, ask, width, most_bytes = OF[request.param]
    assert path.stat().st_size < most_bytes
    network = load(path)
    return SimpleNamespace(network=network, ask=lambda images: ask(network, images), width=width)


@pytest.fixture(scope="module")
def chairs():
    """Of 10 chairs that the networks have not seen, 4 views each, with the angles [40, 2]."""
    images, angles = [], []
    for index in range(OBJECTS):
        views = random_views(VIEWS, generator("test judge views", index))
        images.append(render(ProceduralObject("chair", "validation", index).load(), views))
        angles += [(view.azimuth_deg, view.elevation_deg) for view in views]
    return np.concatenate(images), np.array(angles)


def test_answers_do_not_depend_on_neighbours(bundled, chairs):
    together = bundled.ask(chairs[0])
    assert together.shape == (OBJECTS * VIEWS, bundled.width)
    assert together.dtype == np.float32
    assert np.array_equal(together, bundled.ask(chairs[0]))
    alone = np.concatenate([bundled.ask(image[None]) for image in chairs[0][:5]])
    # sums of up to 1,536 float32 products a layer in another order, of features up to some 10
    np.testing.assert_allclose(alone, together[:5], rtol=1e-4, atol=1e-4)
    # views of arrays with negative strides, which torch refuses
    mirrored = chairs[0][:3, :, ::-1]
    assert np.array_equal(bundled.ask(mirrored), bundled.ask(mirrored.copy()))
    assert bundled.ask(blank(0)).shape == (0, bundled.width)
    assert np.isfinite(bundled.ask(blank(1))).all()


def off(answers, angles):
    """Median errors of azimuth and elevation, in degrees; by chance 90 and 20."""
    turn = np.degrees(np.arctan2(answers[:, 0], answers[:, 1])) - angles[:, 0]
    tilt = 40 * answers[:, 2] - angles[:, 1]
    return np.median(np.abs((turn + 180) % 360 - 180)), np.median(np.abs(tilt))


@pytest.fixture(scope="module")
def judge_network():
    return load_judge_network(JUDGE_WEIGHTS)


def test_the_judge_sees_from_where_and_tells_objects_apart(judge_network, chairs):
    answers = judge(judge_network, chairs[0])
    # Over 100 validation chairs the medians are 3.1 and 1.8 degrees. A median of 40 errors, of
    # which those of one chair go together, is within a factor of 2 of that.
    turn, tilt = off(answers, chairs[1])
    assert turn < 6
    assert tilt < 4
    codes = answers[:, 3:].astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(codes, axis=1), 1, atol=1e-6)
    distance = np.linalg.norm(codes[:, None] - codes, axis=-1)
    chair = np.repeat(np.arange(OBJECTS), VIEWS)
    np.fill_diagonal(distance, np.inf)
    # 40 images against 3 of the same chair and 36 of others; by chance 3 in 39 are right
    assert (chair[distance.argmin(1)] == chair).mean() > 0.8


def test_the_judge_sees_luma_by_rec_601_and_no_colour(judge_network, chairs):
    primaries = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]], np.uint8)
    # 0.299, 0.587 and 0.114 of 255: 76.245, 149.685, 29.07
    assert greyscale(primaries).tolist() == [76, 150, 29, 255]
    greys = np.arange(256, dtype=np.uint8)
    assert np.array_equal(greyscale(np.stack([greys] * 3, axis=-1)), greys)
    for wrong in (blank(1) / 255, np.zeros((2, 4), np.uint8)):
        said = f"uint8 [..., 3], got {wrong.dtype} {list(wrong.shape)}"
        with pytest.raises(ValueError, match=re.escape(said)):
            greyscale(wrong)
    images = chairs[0][:8]
    assert (images.max(-1) != images.min(-1)).any(), "the images are coloured"
    grey = np.repeat(greyscale(images)[..., None], 3, axis=-1)
    assert np.array_equal(judge(judge_network, grey), judge(judge_network, images))


def test_features_tell_the_direction_of_view(chairs):
    network = load_views_network(VIEWS_WEIGHTS)
    assert network.labels.classes == tuple(CLASSES)
    families = [f"{name}/{family}" for name, entry in CLASSES.items() for family in entry.families]
    assert network.labels.families == tuple(families)
    assert network.labels.backs == BACKS
    features = view_features(network, chairs[0])
    assert features.min() >= 0
    with torch.inference_mode():
        answers = network.heads["view"](torch.from_numpy(features)).numpy()
    # 29 and 8.6 degrees on 520 validation images. The median of 32 has a standard error of 8 and
    # 1.7 (bootstrap of 160, scaled): two and three of these are left.
    turn, tilt = off(answers, chairs[1])
    assert turn < 45
    assert tilt < 14
    metric = find_extractor("fd-views")
    of_metric = metric.load(str(metric.weights(None)), "cpu")(chairs[0])
    np.testing.assert_allclose(of_metric, features, rtol=1e-4, atol=1e-4)  # as of neighbours


def test_a_file_is_read_as_it_was_written(tmp_path):
    """The head of classes alone tells what the network tells."""
    labels = Labels(("lamp", "car"), ("lamp/desk", "car/van", "car/truck"), ("ladder",))
    torch.manual_seed(0)
    write_views(None, tmp_path / "x.safetensors", labels)
    network = load_views_network(tmp_path / "x.safetensors")
    assert network.labels == labels
    images = np.random.default_rng(0).integers(0, 256, (2, 128, 128, 3), dtype=np.uint8)
    features = view_features(network, images)
    with torch.inference_mode():
        answers = {name: head(torch.from_numpy(features)) for name, head in network.heads.items()}
    outputs = {name: tuple(answer.shape) for name, answer in answers.items()}
    assert outputs == {"class": (2, 2), "family": (2, 3), "back": (2, 1), "view": (2, 3)}
    expected = answers["class"].double().softmax(1).numpy()
    head = read_class_head(tmp_path / "x.safetensors")
    for i, name in enumerate(labels.classes):
        # float32 sums of 64 products against float64
        np.testing.assert_allclose(head.confidence(features, name), expected[:, i], rtol=1e-4)
