from __future__ import annotations

import dataclasses

import pytest
import torch

from baselines.splat_net.config import SplatNetConfig
from baselines.splat_net.network import (
    COLOUR_HEADS,
    DEFAULT,
    POINTS2PIX,
    composite,
)
from baselines.splat_net.projection import ALL_INPUTS, Inputs, cameras, project
from baselines.splat_net.start import read_start
from baselines.splat_net.surfels import find_surfels, stack
from baselines.splat_net.train import SplatNetTrainer
from baselines.splat_net.weights import export, read_file
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from data_prep.scene import View
from learning import checkpoint, weights
from learning.training_loop import train
from tests.learning.trainings import SMALL, TRAININGS

from .conftest import make_cloud

FILES = weights.FILES["baselines.splat_net"]
VIEWS = [View(30.0, 10.0), View(-100.0, -20.0)]


@pytest.fixture
def files(trained, tmp_path):
    export(trained, tmp_path / "weights.safetensors", "colour")
    export(trained, tmp_path / "weights-grey.safetensors", "grey")
    return tmp_path / "weights.safetensors"


def test_both_heads_come_back_as_they_were_trained(trained, files) -> None:
    start = read_start(str(files), SMALL)
    trained_state = checkpoint.sub_state(checkpoint.load(trained, "splat-net")[0], "average")
    for key, value in start.network.state_dict().items():
        if not key.endswith("num_batches_tracked"):  # which files do not keep
            kept = trained_state[key].half() if value.dim() > 1 else trained_state[key]
            assert torch.equal(value, kept.float()), key
    grey = files.with_name("weights-grey.safetensors")
    assert start.sha256 == f"{file_sha256(files)} {file_sha256(grey)}"


@pytest.mark.parametrize("part", ["normals", "far"])
def test_a_network_without_an_input_draws_as_one_that_ignores_it(part) -> None:
    config = dataclasses.replace(DEFAULT, heads=COLOUR_HEADS["image"])
    few = dataclasses.replace(config, inputs=dataclasses.replace(config.inputs, **{part: False}))
    cut = read_start("all", few).network
    assert cut.config == few
    start = read_start("all", config)
    assert start.sha256 == FILES.bundled["all"]
    whole = start.network
    gone = [i for i, name in enumerate(ALL_INPUTS.names) if name not in few.inputs.names]
    assert len(gone) == DEFAULT.inputs.channels - few.inputs.channels > 0
    with torch.no_grad():
        whole.first.conv.weight[:, gone] = 0
        channels = _seen(ALL_INPUTS)
        kept = channels[:, [i for i in range(channels.shape[1]) if i not in gone]]
        assert torch.equal(_seen(few.inputs), kept)
        expected, drawn = whole(channels), cut(kept)
    # a sum of fewer terms, in another order: 22 channels x 9 taps of some 10 in float32, 18 layers
    torch.testing.assert_close(drawn, expected, rtol=0, atol=1e-3)


def _seen(inputs: Inputs) -> torch.Tensor:
    surfels = stack([find_surfels(make_cloud())])
    return project(surfels, cameras(VIEWS), inputs)


def test_training_goes_on_from_it(data, files, tmp_path) -> None:
    start = read_start(str(files), SMALL)
    config = SplatNetConfig(network=SMALL, steps=1, cool_down=1, batch=4, start=start.sha256)
    path = train(SplatNetTrainer, data, config, tmp_path / "on", start=start.network)
    before, (after, _, trained) = start.network.state_dict(), checkpoint.load(path, "splat-net")
    assert trained["start"] == start.sha256
    moved = checkpoint.sub_state(after, "network")
    # Adam's first step is one of the learning rate, whatever the gradient
    for key, parameter in start.network.named_parameters():
        assert (moved[key] - parameter).abs().max() <= 1.01 * config.learning_rate
    assert not torch.equal(moved["last.weight"], before["last.weight"])
    # the statistics stay those of the start, for all its steps are the last
    assert torch.equal(moved["first.norm.running_var"], before["first.norm.running_var"])
    other = dataclasses.replace(config, start=None)
    with pytest.raises(BadInput, match=r"trained with start = .*, asked for None"):
        train(SplatNetTrainer, data, other, tmp_path / "on")


@pytest.mark.parametrize(("heads", "known"), [("pixel", 4), ("image", 1)])
def test_what_the_colours_of_chair_lack_is_random_by_seed(heads, known) -> None:
    config = dataclasses.replace(DEFAULT, heads=COLOUR_HEADS[heads])
    start, again, other = (read_start("chair", config, seed) for seed in (0, 0, 1))
    assert start.sha256 == FILES.bundled["chair"]
    last, same, another = (s.network.last.weight for s in (start, again, other))
    assert torch.equal(last, same)
    assert torch.equal(last[:known], read_file(FILES.find("chair")).network.last.weight[:known])
    assert torch.equal(last[:known], another[:known])
    assert not torch.equal(last[known:], another[known:])


def test_inputs_that_it_never_saw_are_not_used_yet(files) -> None:
    wider = dataclasses.replace(SMALL.inputs, windows=(3, 5, 7), noise=True)
    before = read_start(str(files), SMALL).network
    after = read_start(str(files), dataclasses.replace(SMALL, inputs=wider)).network
    with torch.no_grad():
        expected, drawn = before(_seen(SMALL.inputs)), after(_seen(wider))
    # the same sums with zeros among them, in another order: as above
    torch.testing.assert_close(drawn, expected, rtol=0, atol=1e-3)
    new = [i for i, name in enumerate(wider.names) if name not in SMALL.inputs.names]
    assert len(new) >= 1
    assert not after.first.conv.weight[:, new].any()


@pytest.mark.parametrize("key", ["last.weight", "last.bias", "first.norm.bias"])
def test_files_of_two_trainings_are_refused(files, key) -> None:
    """The coverage that both heads have tells, or any other layer."""
    grey = files.with_name("weights-grey.safetensors")
    tensors, header = checkpoint.read_safetensors(grey)
    tensors[key][0] += 1
    checkpoint.write_atomically(grey, tensors, header)
    message = rf"weights.safetensors: is not of one training.*: {key} differs"
    with pytest.raises(BadInput, match=message):
        read_start(str(files), SMALL)


def test_what_training_cannot_start_from(files) -> None:
    grey = files.with_name("weights-grey.safetensors")
    for name, network, message in (
        ("chair", POINTS2PIX, "--start chair: these are weights of splat-net, to train points2pix"),
        (files, DEFAULT, r"widths \(4, 6.*to train \(16, 32.*give weights of these widths"),
        (grey, SMALL, r"weights-grey-grey\.safetensors' is neither"),
        ("all", SMALL, "have one colour for the whole image; leave --colours out"),
    ):
        with pytest.raises(BadInput, match=message):
            read_start(str(name), network)
    grey.write_bytes(files.read_bytes())
    with pytest.raises(BadInput, match="the heads are not colour and grey"):
        read_start(str(files), SMALL)


def test_one_colour_for_the_image_starts_from_any_file(files, tmp_path) -> None:
    config = dataclasses.replace(SMALL, heads=COLOUR_HEADS["image"])
    both, one = read_start(str(files), SMALL).network, read_start(str(files), config).network
    channels = _seen(SMALL.inputs)
    with torch.no_grad():
        expected = composite(both(channels), SMALL.heads)[1][1]
        grey, colour = composite(one(channels), config.heads)[1]
    assert torch.equal(grey, expected)
    assert torch.isfinite(colour).all()


def test_a_file_with_one_colour_comes_back(tmp_path) -> None:
    config = dataclasses.replace(SMALL, heads=COLOUR_HEADS["image"])
    path = tmp_path / "weights.safetensors"
    trained = TRAININGS["splat-net"](tmp_path / "out", 1, network=config)
    export(trained, path, "albedo")
    start = read_start(str(path), config)
    assert start.sha256 == file_sha256(path)
    state = checkpoint.sub_state(checkpoint.load(trained, "splat-net")[0], "average")
    for name in ("last.weight", "albedo.weight"):
        assert torch.equal(start.network.state_dict()[name], state[name].half().float())
    assert read_start(str(path), dataclasses.replace(SMALL, heads=("grey",))).network
