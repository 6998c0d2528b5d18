from __future__ import annotations

import dataclasses

import pytest
import torch

from baselines.splat_net.network import (
    COLOUR_HEADS,
    DEFAULT,
    POINTS2PIX,
    NetworkConfig,
    composite,
)
from baselines.splat_net.projection import ALL_INPUTS, Inputs, cameras, project
from baselines.splat_net.start import read_start
from baselines.splat_net.surfels import find_surfels, stack
from baselines.splat_net.train import KIND, SplatNetConfig, SplatNetTrainer, train_splat_net
from baselines.splat_net.weights import BUNDLED, export
from bench.training.networks import do_without
from data_prep.failures import BadInput
from data_prep.scene import View
from learning import checkpoint
from learning.weights import file_sha256
from tests.learning.trainings import SMALL, make_surfaces

from .conftest import make_cloud

VIEWS = [View(30.0, 10.0), View(-100.0, -20.0)]


@pytest.fixture
def files(trained, tmp_path):
    export(trained, tmp_path / "weights.safetensors", "colour")
    export(trained, tmp_path / "weights-grey.safetensors", "grey")
    return tmp_path / "weights.safetensors"


def test_both_heads_come_back_as_they_were_trained(trained, files) -> None:
    start = read_start(str(files), SMALL)
    trained_state = checkpoint.sub_state(checkpoint.load(trained, KIND)[0], "average")
    for key, value in start.network.state_dict().items():
        if not key.endswith("num_batches_tracked"):  # which files do not keep
            kept = trained_state[key].half() if value.dim() > 1 else trained_state[key]
            assert torch.equal(value, kept.float()), key
    grey = files.with_name("weights-grey.safetensors")
    assert start.sha256 == f"{file_sha256(files)} {file_sha256(grey)}"


@pytest.mark.parametrize("part", ["normals", "density", "flattened", "far", "discs"])
def test_a_network_without_an_input_draws_as_one_that_ignores_it(part) -> None:
    few = do_without(DEFAULT, (part,))
    cut = read_start("chair", few).network
    assert cut.config == few
    start = read_start("chair", DEFAULT)
    assert start.sha256 == f"{BUNDLED['chair']} {BUNDLED['chair-grey']}"
    whole = start.network
    gone = [i for i, name in enumerate(ALL_INPUTS.names) if name not in few.inputs.names]
    assert len(gone) == DEFAULT.inputs.channels - few.inputs.channels > 0
    with torch.no_grad():
        whole.first.conv.weight[:, gone] = 0
        channels = _seen(ALL_INPUTS)
        kept = channels[:, [i for i in range(channels.shape[1]) if i not in gone]]
        if part != "discs":  # without which other channels are of something else
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
    trainer = SplatNetTrainer(data, config, torch.device("cpu"), start=start.network)
    for part in (trainer.network, trainer.average):
        state = part.state_dict()
        assert all(torch.equal(state[k], v) for k, v in start.network.state_dict().items())
    assert all(parameter.requires_grad for parameter in trainer.network.parameters())

    path = train_splat_net(data, config, tmp_path / "on", start=start.network)
    before, after = start.network.state_dict(), checkpoint.load(path, KIND)
    assert after[2]["start"] == start.sha256
    moved = checkpoint.sub_state(after[0], "network")
    assert any(not torch.equal(before[k], moved[k]) for k in before)
    # Adam's first step is one of the learning rate, whatever the gradient
    for key, parameter in trainer.network.named_parameters():
        assert (moved[key] - parameter).abs().max() <= 1.01 * config.learning_rate
    # the statistics stay those of the start, for all its steps are the last
    assert torch.equal(moved["first.norm.running_var"], before["first.norm.running_var"])
    other = dataclasses.replace(config, start=None)
    with pytest.raises(BadInput, match=r"trained with start = .*, asked for None"):
        train_splat_net(data, other, tmp_path / "on")


def test_a_wider_network_draws_as_the_narrower_one_did() -> None:
    narrow = read_start("chair", DEFAULT).network
    wider = dataclasses.replace(DEFAULT, widths=(20, 32, 72, 130, 168))  # one level as it was
    wide = read_start("chair", wider).network
    assert wide.config == wider
    channels = _seen(ALL_INPUTS)
    with torch.no_grad():
        # the same sums with zeros among them, in another order: as above
        torch.testing.assert_close(wide(channels), narrow(channels), rtol=0, atol=1e-3)


def test_what_a_wider_network_has_more_of_can_be_trained() -> None:
    wider = dataclasses.replace(DEFAULT, widths=(18, 34, 66, 130, 162))
    network = read_start("chair", wider).network.requires_grad_(True)
    network(_seen(ALL_INPUTS)).square().sum().backward()
    narrow = read_start("chair", DEFAULT).network.state_dict()
    heard = {
        key: parameter
        for key, parameter in network.named_parameters()
        if parameter.dim() == 4 and parameter.shape[1] > narrow[key].shape[1]
    }
    assert len(heard) == 20  # all kernels but that of the first layer
    for key, parameter in heard.items():
        outputs, inputs = narrow[key].shape[:2]
        assert not parameter[:outputs, inputs:].any(), key
        assert parameter[outputs:].any() or key == "last.weight", key
        assert parameter.grad is not None
        assert parameter.grad[:outputs, inputs:].any(), key


def test_what_it_has_more_of_is_random_by_seed() -> None:
    wider = dataclasses.replace(DEFAULT, widths=(17, 32, 64, 128, 160))
    first, again, other = (
        read_start("chair", wider, seed).network.first.conv.weight for seed in (0, 0, 1)
    )
    assert torch.equal(first, again)
    assert torch.equal(first[:16], other[:16])
    assert not torch.equal(first[16:], other[16:])


def test_a_narrower_network_is_refused(files) -> None:
    narrower = NetworkConfig(widths=(4, 6, 8, 10, 10))
    with pytest.raises(
        BadInput, match=r"10, 12.*asked for.*10, 10.*wider, not narrower.*--network"
    ):
        read_start(str(files), narrower)


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


def test_only_splat_net_can_start_from_weights() -> None:
    with pytest.raises(BadInput, match="--start chair: is of splat-net, asked for points2pix"):
        read_start("chair", POINTS2PIX)


@pytest.mark.parametrize("key", ["last.weight", "last.bias", "first.norm.bias"])
def test_files_of_two_trainings_are_refused(files, key) -> None:
    """The coverage that both heads have tells, or any other layer."""
    grey = files.with_name("weights-grey.safetensors")
    tensors, header = checkpoint.read_safetensors(grey)
    tensors[key][0] += 1
    checkpoint.write_atomically(grey, tensors, header)
    with pytest.raises(
        BadInput, match=rf"weights.safetensors: is not of one training.*: {key} differs"
    ):
        read_start(str(files), SMALL)


def test_a_head_that_is_missing_or_the_wrong_one(files) -> None:
    grey = files.with_name("weights-grey.safetensors")
    with pytest.raises(BadInput, match=r"weights-grey-grey\.safetensors' is neither"):
        read_start(str(grey), SMALL)
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


def test_a_file_with_one_colour_comes_back_and_has_none_for_each_pixel(tmp_path) -> None:
    config = dataclasses.replace(SMALL, heads=COLOUR_HEADS["image"])
    trained = train_splat_net(
        make_surfaces(), SplatNetConfig(config, steps=2, cool_down=1, batch=4), tmp_path / "out"
    )
    path = tmp_path / "weights.safetensors"
    export(trained, path, "albedo")
    start = read_start(str(path), config)
    assert start.sha256 == file_sha256(path)
    state = checkpoint.sub_state(checkpoint.load(trained, KIND)[0], "average")
    for name in ("last.weight", "albedo.weight"):
        assert torch.equal(start.network.state_dict()[name], state[name].half().float())
    assert read_start(str(path), dataclasses.replace(SMALL, heads=("grey",))).network
    with pytest.raises(BadInput, match="one colour for the image; leave --colours out"):
        read_start(str(path), SMALL)
