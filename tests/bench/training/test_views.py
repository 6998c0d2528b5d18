from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from bench.analysis.recognition import read_class_head
from bench.judges.views import ViewsNetwork, load_views_network, view_features
from bench.training import views as training
from bench.training.views import NO_LABEL, labels, train_views
from data_prep.datasets import procedural as dataset_procedural
from data_prep.datasets.registry import ProceduralObject
from data_prep.randomness import generator
from data_prep.shapes.catalogue import CLASSES
from data_prep.shapes.chair.spec import draw_chair_spec
from data_prep.shapes.shape_class import Drawn, ShapeClass
from data_prep.shapes.solids import box


def block(rng):
    """A red block or a blue board: what a few steps suffice to tell from chairs."""
    flat = bool(rng.random() < 0.5)
    size, color = ((1.0, 0.2, 1.0), (30, 40, 200)) if flat else ((1.0, 1.0, 1.0), (200, 30, 40))
    return Drawn("flat" if flat else "cubic", (box((0.0, 0.0, 0.0), size, color),))


@pytest.fixture
def two_classes(monkeypatch):
    """Chairs, and blocks of two families."""
    blocks = ShapeClass("block", ("flat", "cubic"), block)
    classes = {"block": blocks, "chair": CLASSES["chair"]}
    for module in (training, dataset_procedural):
        monkeypatch.setattr(module, "CLASSES", classes)
    return classes


def test_answers_belong_to_the_objects_that_are_shown(two_classes):
    known = labels()
    assert known.classes == ("block", "chair")
    assert known.families[:3] == ("block/flat", "block/cubic", "chair/four-leg")
    for index in range(3):
        spec = draw_chair_spec(generator("procedural", "chair", "train", index))
        family, back = known.families.index(f"chair/{spec.family}"), known.backs.index(spec.back)
        found = training._answers(known, ProceduralObject("chair", "train", index))
        assert found == (1, family, back)
        drawn = block(generator("procedural", "block", "validation", index))
        found = training._answers(known, ProceduralObject("block", "validation", index))
        assert found == (0, 0 if drawn.family == "flat" else 1, NO_LABEL)


def test_variation(two_classes):
    """White stays white; what is grey has one value in all channels, by its luma."""
    images = torch.full((400, 2, 2, 3), 255, dtype=torch.uint8)
    images[:, 0, 0] = torch.tensor([105, 155, 205], dtype=torch.uint8)  # ink 150, 100, 50
    varied = training._varied(images, torch.Generator().manual_seed(0))
    assert varied.shape == (400, 3, 2, 2)
    assert torch.equal(varied[:, :, 1, 1], torch.full((400, 3), 255.0))
    ink = 255.0 - varied[:, :, 0, 0]
    grey = (ink[:, 0] == ink[:, 2]).numpy()
    # binomial: 4 standard deviations of 400 draws at 1/4
    assert abs(grey.mean() - 0.25) < 4 * math.sqrt(0.25 * 0.75 / 400)
    levels = ink[:, 0].numpy() / np.where(grey, 0.299 * 150 + 0.587 * 100 + 0.114 * 50, 150)
    assert 0.9 - 1e-6 <= levels.min() < 0.92
    assert 1.08 < levels.max() <= 1.1 + 1e-6
    coloured = ink.numpy()[~grey] / levels[~grey, None]
    np.testing.assert_allclose(coloured, [[150, 100, 50]] * len(coloured), rtol=1e-5)


def test_cross_entropy_leaves_out_what_has_no_label():
    answers = torch.tensor([[0.0, math.log(3)], [5.0, 0.0], [math.log(7), 0.0]])
    loss = training._cross_entropy(answers, torch.tensor([1, NO_LABEL, 1]))
    assert float(loss) == pytest.approx((math.log(4 / 3) + math.log(8)) / 2, rel=1e-6)
    assert float(training._cross_entropy(answers, torch.full((3,), NO_LABEL))) == 0


@pytest.mark.slow
def test_a_short_training(two_classes, tmp_path, capsys, monkeypatch):
    """With blocks and chairs as unlike as can be, some steps are enough to tell them apart."""
    monkeypatch.setattr(training, "BATCH", 8)
    out, folder = tmp_path / "views.safetensors", tmp_path / "training"
    scores = train_views(16, 2, 10, 0, out, validation=(5, 3), folder=folder)
    assert "views: step 80/80, loss " in capsys.readouterr().err
    assert scores.confusion.sum(axis=1).tolist() == [15, 15]
    assert scores.confusion.diagonal().sum() >= 27  # by chance 15, with a deviation of 2.7
    network = load_views_network(out)
    assert network.labels == labels()
    # and the head alone tells what the network tells
    images = np.random.default_rng(0).integers(0, 256, (3, 128, 128, 3), dtype=np.uint8)
    features = view_features(network, images)
    with torch.inference_mode():
        expected = network.heads["class"](torch.from_numpy(features)).double().softmax(1).numpy()
    head = read_class_head(out)
    for i, name in enumerate(head.classes):
        # float32 sums of 64 products against float64
        np.testing.assert_allclose(head.confidence(features, name), expected[:, i], rtol=1e-4)


def test_the_rates_fall_along_half_a_cosine():
    learned = np.zeros((1, 1, 1, 1, 3), np.uint8), {}
    trainer = training.ViewsTrainer(learned, training.JudgeConfig(50, seed=0), labels())
    found = [trainer.rate(done) for done in range(50)]
    expected = training.LEARNING_RATE * (1 + np.cos(np.pi * np.arange(50) / 50)) / 2
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_scores_of_a_network_that_always_answers_the_same(two_classes):
    """Class chair, the family of the first object, the back of the first chair, azimuth 0,
    elevation 0."""
    message = labels()
    data, true = training._labelled(message, "validation", 6, 4)
    chairs = true["class"] == 1
    family, back = true["family"][0], true["back"][chairs][0]
    network = ViewsNetwork(message).eval()
    with torch.no_grad():
        for parameter in network.heads.parameters():
            parameter.zero_()
        # of the view the cosine
        for head, answer in (("class", 1), ("family", family), ("back", back), ("view", 1)):
            network.heads[head].bias[answer] = 1.0
    scores = training._score(network, 6, 4)
    assert scores.confusion.tolist() == [[0, 24], [0, 24]]
    assert scores.family == (true["family"] == family).double().mean() > 0
    assert scores.back == (true["back"][chairs] == back).double().mean() > 0
    for name in ("azimuth_deg", "elevation_deg"):
        expected = np.median(np.abs(getattr(data, name)).reshape(2, 24), axis=1)
        np.testing.assert_allclose(getattr(scores, name), expected, rtol=1e-12)
