"""Growing images: which layers a step uses, and how new ones are blended in."""

from __future__ import annotations

import pytest
import torch
from torch.nn import functional

from learning.training_loop import seeded
from pc2pix.growth import Stage, draw, judge, shrink, small_inputs, small_outputs, stage_after
from pc2pix.model import Discriminator, Generator
from tests.learning.trainings import PAIRED

INPUTS = (torch.zeros(2, 128), torch.ones(2, 4), torch.full((2, 1), 0.4), torch.full((2, 1), 0.3))


@pytest.fixture(scope="module")
def networks():
    return seeded(
        0,
        lambda: (
            Generator(PAIRED).eval(),
            small_outputs(PAIRED).eval(),
            Discriminator(PAIRED).eval(),
            small_inputs(PAIRED).eval(),
        ),
    )


@pytest.mark.parametrize(
    ("steps_done", "stage"),
    [
        (0, Stage(2, 1.0, 0)),
        (9, Stage(2, 1.0, 9)),
        (10, Stage(1, 0.5, 0)),
        (11, Stage(1, 1.0, 1)),
        (19, Stage(1, 1.0, 9)),
        (20, Stage(0, 0.5, 0)),
        (21, Stage(0, 1.0, 1)),
        (99, Stage(0, 1.0, 79)),
    ],
)
def test_each_lower_resolution_has_its_steps_and_the_next_fades_in(steps_done, stage):
    assert stage_after(steps_done, 10) == stage


def test_without_growth_all_steps_are_at_128_px():
    assert stage_after(0, 0) == Stage(0, 1.0, 0)
    assert stage_after(7, 0) == Stage(0, 1.0, 7)


@pytest.mark.parametrize("fade", [0.25, 1.0])
@pytest.mark.parametrize(("halvings", "side"), [(0, 128), (1, 64), (2, 32)])
def test_images_of_a_stage_are_drawn_and_judged(networks, halvings, side, fade):
    if halvings == 2 and fade < 1:
        return  # nothing is blended into the first resolution
    generator, outputs, discriminator, inputs = networks
    stage = Stage(halvings, fade, 0)
    images = draw(generator, outputs, stage, INPUTS)
    assert images.shape == (2, 3, side, side)
    assert [t.shape[1] for t in judge(discriminator, inputs, stage, images)] == [1, 4, 1, 2]
    assert shrink(torch.zeros(2, 3, 128, 128), stage).shape == images.shape


def test_the_last_stage_is_the_networks_themselves(networks):
    generator, outputs, discriminator, inputs = networks
    stage = Stage(0, 1.0, 0)
    images = draw(generator, outputs, stage, INPUTS)
    assert torch.equal(images, generator(*INPUTS))
    judged = judge(discriminator, inputs, stage, images)
    assert all(map(torch.equal, judged, discriminator(images)))


def test_a_new_resolution_begins_as_the_one_before(networks):
    generator, outputs, discriminator, inputs = networks
    for halvings in (0, 1):
        begun, before = Stage(halvings, 0.0, 0), Stage(halvings + 1, 1.0, 9)
        small = draw(generator, outputs, before, INPUTS)
        images = draw(generator, outputs, begun, INPUTS)
        assert torch.equal(images, functional.interpolate(small, scale_factor=2.0))
        judged = judge(discriminator, inputs, begun, images)
        for now, then in zip(judged, judge(discriminator, inputs, before, small), strict=True):
            torch.testing.assert_close(now, then)


def test_layers_of_other_resolutions_do_not_take_part(networks):
    generator, outputs, discriminator, inputs = networks
    stage = Stage(1, 1.0, 0)
    judged = judge(discriminator, inputs, stage, draw(generator, outputs, stage, INPUTS))
    sum(t.sum() for t in judged).backward()
    parts = {"generator": generator, "outputs": outputs, "judge": discriminator, "inputs": inputs}
    idle = {
        f"{name}.{key.rsplit('.', 1)[0]}"
        for name, part in parts.items()
        for key, parameter in part.named_parameters()
        if parameter.grad is None and key.endswith("weight")
    }
    layers = ("conv1", "conv2", "shortcut")
    assert idle == {
        *(f"generator.blocks.4.{layer}" for layer in ("bn1", "bn2", *layers)),
        *("generator.bn", "generator.conv", "outputs.1.bn", "outputs.1.conv", "inputs.1"),
        *(f"judge.blocks.0.{layer}" for layer in layers),
    }
