"""What every training has in common, whichever network it trains."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from baselines.splat_net.network import NetworkConfig
from baselines.splat_net.train import SplatNetConfig, train_splat_net
from bench.judges import train_judge, train_views
from bench.judges.views import Labels
from data_prep.failures import BadInput
from data_prep.training_set import SurfaceSet, TrainingSet
from learning import checkpoint, training_loop
from learning.training_loop import Cadence, seeded
from pc2pix.model import ModelConfig, build_encoder
from pc2pix.train_autoencoder import AutoencoderConfig, AutoencoderData, train_autoencoder
from pc2pix.train_decoder import DecoderConfig, train_decoder
from pc2pix.train_gan import GanConfig, GanData, train_gan
from pc2pix.weights import export, load_weights

CADENCE = Cadence(log=1, sheet=4, checkpoint=2)
TINY = ModelConfig(width=0.0625, latent_dim=4)
PAIRED = ModelConfig(width=0.0625, latent_dim=4, encoder="pointnet", azimuth="sine-cosine")
SMALL = NetworkConfig(widths=(4, 6, 8, 10, 12))


@pytest.fixture(autouse=True)
def one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def make_clouds(count=3, points=2048):
    rng = np.random.default_rng(0)
    return rng.uniform(-0.5, 0.5, (count, points, 3)).astype(np.float32)


def make_set(objects=3, views=2):
    rng = np.random.default_rng(1)
    return TrainingSet(
        images=rng.integers(0, 256, (objects, views, 128, 128, 3), dtype=np.uint8),
        azimuth_deg=rng.uniform(-180, 180, (objects, views)),
        elevation_deg=rng.uniform(-40, 40, (objects, views)),
        clouds=make_clouds(objects),
    )


def start_autoencoder(out_dir, on_progress, **changes):
    config = AutoencoderConfig(**{"model": TINY, "batch": 2, "cadence": CADENCE} | changes)
    data = AutoencoderData(make_clouds(points=2100))
    return train_autoencoder(data, config, out_dir, on_progress=on_progress)


def start_gan(out_dir, on_progress, **changes):
    config = GanConfig(**{"model": TINY, "batch": 2, "cadence": CADENCE} | changes)
    seen = make_set()
    data = GanData(seen.images, seen.azimuth_deg, seen.elevation_deg, seen.clouds)
    encoder = seeded(0, lambda: build_encoder(config.model))
    return train_gan(data, encoder, config, out_dir, on_progress=on_progress)


def start_decoder(out_dir, on_progress, **changes):
    path = out_dir.parent / "weights.safetensors"
    if not path.exists():
        export(start_gan(out_dir.parent / "gan", on_progress=ignore, steps=1), path)
    weights = load_weights(path)
    defaults = {"weights": weights.sha256, "model": TINY, "batch": 2, "cadence": CADENCE}
    data = AutoencoderData(make_clouds(points=2100))
    config = DecoderConfig(**defaults | changes)
    return train_decoder(data, weights, config, out_dir, on_progress=on_progress)


def start_splat_net(out_dir, on_progress, **changes):
    defaults = {"network": SMALL, "batch": 4, "cool_down": 2, "cadence": CADENCE}
    rng = np.random.default_rng(2)
    coverage, grey = rng.integers(0, 256, (2, 3, 2, 128, 128), dtype=np.uint8)
    data = SurfaceSet(make_set(), coverage, grey)
    config = SplatNetConfig(**defaults | changes)
    return train_splat_net(data, config, out_dir, on_progress=on_progress)


def start_judge(out_dir, on_progress, **changes):
    config = train_judge.JudgeConfig(**{"seed": 0, "cadence": CADENCE} | changes)
    rng = np.random.default_rng(3)
    painted, neutral = rng.integers(0, 256, (2, 4, 2, 128, 128), dtype=np.uint8)
    angles = rng.uniform(-40, 40, (2, 4, 2))
    data = train_judge.Pictures(painted, neutral, *angles, make_clouds(4))
    with pytest.MonkeyPatch.context() as patch, training_loop.denormals_flushed():
        patch.setattr(train_judge, "OBJECTS", 3)
        trainer = train_judge._Trainer(data, data, config)
        return training_loop.run(trainer, config, "data", out_dir, on_progress)


def start_views(out_dir, on_progress, **changes):
    config = train_views.JudgeConfig(**{"seed": 0, "cadence": CADENCE} | changes)
    message = Labels(("lamp", "car"), ("lamp/desk", "car/van"), ("ladder",))
    images = torch.from_numpy(make_set(objects=5).images).flatten(0, 1)
    answers = {name: torch.arange(10) % 2 for name in ("class", "family")}
    answers |= {"back": torch.full((10,), train_views.NO_LABEL), "view": torch.zeros(10, 3)}
    with pytest.MonkeyPatch.context() as patch, training_loop.denormals_flushed():
        patch.setattr(train_views, "BATCH", 4)  # an epoch is of two batches and a half
        trainer = train_views._Trainer(message, images, answers, config)
        return training_loop.run(trainer, config, "data", out_dir, on_progress)


def ignore(report):
    pass


@dataclass(frozen=True)
class Training:
    """A small training: `start` goes on where one has been in the folder.

    sheet    size of its picture in pixels; None where it has none
    lengthens  whether one of more steps begins in the same way
    """

    start: Any
    kind: str
    changes: dict[str, Any]
    sheet: tuple[int, int] | None = (3 * 128, 2 * 128)
    lengthens: bool = True

    def __call__(self, out_dir, steps, on_progress=ignore, **changes):
        return self.start(out_dir, on_progress, steps=steps, **self.changes | changes)


TRAININGS = {
    "autoencoder": Training(start_autoencoder, "autoencoder", {}),
    "gan": Training(start_gan, "gan", {}),
    "gan-augmented": Training(start_gan, "gan", {"augment": True}),
    "gan-paired": Training(
        start_gan, "gan", {"model": PAIRED, "objective": "paired", "warm_up": 1}
    ),
    "decoder": Training(start_decoder, "decoder", {}),
    "splat-net": Training(start_splat_net, "splat-net", {}, (3 * 128, 3 * 128)),
    "splat-net-patch": Training(
        start_splat_net, "splat-net", {"objective": "l1-patch", "warm_up": 1}, (3 * 128, 3 * 128)
    ),
    "judge": Training(start_judge, "judge", {}, sheet=None, lengthens=False),
    "views": Training(start_views, "views", {}, sheet=None, lengthens=False),
}


@pytest.fixture(params=TRAININGS)
def train(request):
    return TRAININGS[request.param]


def test_losses_are_not_read_by_a_step(train, tmp_path, monkeypatch):
    """To read a number means to wait for the device; the loop does, and only for what it logs."""
    steps = []

    def run(trainer, *rest):
        steps.extend(trainer.take_step() for _ in range(2))

    train(tmp_path / "x", 1)  # a decoder needs a whole training before it
    monkeypatch.setattr(training_loop, "run", run)
    train(tmp_path / "y", 2)
    for losses in steps:
        assert list(losses) == list(steps[0])
        for loss in losses.values():
            assert isinstance(loss, torch.Tensor)
            assert loss.shape == ()
            assert not loss.requires_grad


class Killed(Exception):
    pass


def kill_at(step):
    def on_progress(report):
        if report.step == step:
            raise Killed

    return on_progress


def require_equal(one, other, kind, steps):
    """Checkpoints and logs of two runs, bit for bit."""
    (state, step, _), (found, found_step, _) = (checkpoint.load(p, kind) for p in (one, other))
    assert step == found_step == steps
    assert state.keys() == found.keys()
    assert all(torch.equal(state[key], found[key]) for key in state)
    logs = [(path.parent / "losses.csv").read_text() for path in (one, other)]
    assert logs[0] == logs[1]
    rows = [row.split(",")[0] for row in logs[0].splitlines()]
    assert rows == ["step", *map(str, range(1, steps + 1))]


def test_a_killed_run_resumes_bit_for_bit(train, tmp_path):
    reports = []
    whole = train(tmp_path / "whole", 5, reports.append)
    # killed after step 3 is logged: the checkpoint is that of step 2, the row of step 3 must go
    with pytest.raises(Killed):
        train(tmp_path / "cut", 5, kill_at(3))
    path = tmp_path / "cut" / checkpoint.FILE_NAME
    # splat-net writes one more before its rate falls, after step 3; it is killed before that
    assert checkpoint.load(path, train.kind)[1] == 2
    cut = train(tmp_path / "cut", 5)
    require_equal(whole, cut, train.kind, 5)

    assert [report.step for report in reports] == [1, 2, 3, 4, 5]
    assert reports[0].images_per_s is None
    assert reports[-1].images_per_s > 0
    assert reports[-1].seconds_left == 0
    sheets = sorted((tmp_path / "whole" / "sheets").glob("*"))
    assert [sheet.name for sheet in sheets] == (
        ["step-000004.png", "step-000005.png"] if train.sheet else []
    )
    for sheet in sheets:
        with Image.open(sheet) as picture:
            assert picture.size == train.sheet


def test_a_lengthened_run_is_one_of_that_length_from_the_beginning(train, tmp_path):
    """Bit for bit, though it had ended, and its learning rate with it. Nothing else may change."""
    short = train(tmp_path / "cut", 4)
    before = short.read_bytes()
    assert train(tmp_path / "cut", 4, kill_at(1)) == short
    assert short.read_bytes() == before, "a finished run is not trained again"
    with pytest.raises(BadInput, match=r"seed = 0, asked for 1; use"):
        train(tmp_path / "cut", 6, seed=1)
    if not train.lengthens:
        with pytest.raises(BadInput, match="4 steps; one of 6 has another learning rate from step"):
            train(tmp_path / "cut", 6)
        assert short.read_bytes() == before
        return
    whole, cut = train(tmp_path / "whole", 6), train(tmp_path / "cut", 6)
    require_equal(whole, cut, train.kind, 6)


def test_bfloat16_trains(train, tmp_path):
    if not train.sheet:
        pytest.skip("the networks that judge have no other precision")
    train(tmp_path / "x", 2, precision="bfloat16")
    last = (tmp_path / "x" / "losses.csv").read_text().splitlines()[-1]
    assert all(math.isfinite(float(value)) for value in last.split(","))


@pytest.mark.parametrize("flushed", [False, True])
def test_denormal_numbers_are_flushed_inside_only(train, tmp_path, flushed):
    seen = []
    torch.set_flush_denormal(flushed)
    try:
        train(tmp_path / "x", 1, lambda report: seen.append(sys.float_info.min / 2))
        assert seen == [0.0]
        assert (sys.float_info.min / 2 == 0.0) == flushed
    finally:
        torch.set_flush_denormal(False)
