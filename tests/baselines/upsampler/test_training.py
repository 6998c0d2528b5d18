from __future__ import annotations

import torch

from baselines.upsampler.config import UpsamplerTrainingConfig
from baselines.upsampler.network import Upsampler
from baselines.upsampler.train import UpsamplerTrainer
from tests.baselines.upsampler.test_network import SMALL
from tests.learning.trainings import CADENCE, make_upsampler


def build(data, **changes):
    defaults = {"network": SMALL, "batch": 3, "cool_down": 2, "cadence": CADENCE}
    return UpsamplerTrainer(data, UpsamplerTrainingConfig(**{**defaults, **changes}))


def test_the_loss_is_the_distance_in_spacings_and_the_sine_of_normals_of_the_network_before():
    """The values that are told are means over places, without the weights of noisy clouds."""
    trainer = build(make_upsampler())
    state = trainer.random.get_state()
    losses = trainer.take_step()
    trainer.random.set_state(state)
    fresh = build(make_upsampler())
    chosen = fresh.trained_on[torch.randint(len(fresh.trained_on), (3,), generator=fresh.random)]
    distances, sines = [], []
    untrained = Upsampler(SMALL).requires_grad_(False)
    for i in chosen.tolist():
        seen, places, nearest, targets, normals = fresh._batch([i], 0)
        points, told = untrained(seen, places, nearest)
        distances.append((points - targets).norm(dim=1) / seen.radius[nearest])
        sines.append((1 - (told * normals).sum(dim=1) ** 2).sqrt())
    distance = torch.cat(distances)
    # Both are rounded off at 0, by .02 at most.
    assert abs(float(losses["distance"]) - float(distance.mean())) < 0.02
    assert abs(float(losses["normals"]) - float(torch.cat(sines).mean())) < 0.02
    assert losses["validation"].isfinite()


def test_held_out_clouds_are_not_trained_on():
    """Most clouds of a small set are trained on."""
    for objects, held_out in ((2, 1), (9, 2)):
        trainer = build(make_upsampler(objects=objects))
        assert not set(trainer.held_out) & set(trainer.trained_on.tolist())
        assert len(trainer.held_out) == held_out
        assert len(trainer.trained_on) == objects - held_out


def test_a_batch_of_clouds_is_what_each_is_alone():
    trainer = build(make_upsampler())
    network = trainer.network
    torch.nn.init.normal_(network.answer.weight)
    with torch.no_grad():
        points, _ = network(*trainer._batch([0, 2], 0)[:3])
        alone = [network(*trainer._batch([i], 0)[:3])[0] for i in (0, 2)]
    torch.testing.assert_close(points, torch.cat(alone), rtol=0, atol=1e-5)
