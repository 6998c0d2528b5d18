"""Training of the up-sampler: it learns to move places onto the surface and to tell its normals.

The loss of a place has two terms: the distance of the moved place from the nearest point of the
surface, in spacings of the points, and the sine of the angle between the predicted normal and the
true one. Neither is squared: the large errors at creases, where the points do not tell what is
right, would outweigh the small errors of flat sides. No term asks whether moved places reach all
parts of the surface, because places lie evenly around all points. The weight of a place falls with
the noise of its cloud: errors of noisy clouds are as large as the noise, and would outweigh those
of clean ones.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, NamedTuple

import torch
from torch import Tensor

from baselines.upsampler.config import UpsamplerTrainingConfig
from baselines.upsampler.data import UpsamplerSet, joined
from baselines.upsampler.network import Surroundings, Upsampler
from learning import training_loop
from learning.trainer import CooledTrainer

PLACES = 2048  # places of each object that a step learns from
# Clouds for validation, which are not trained on: one in _LEFT, at least one and at most _HELD_OUT,
# spread evenly over the data.
_HELD_OUT = 24
_LEFT = 4
_VALIDATED_EVERY = 250  # steps between two validations
_NORMALS = 0.5  # weight of the normals' sines in the loss
# The size of an error (a distance in spacings, or a sine) below which the loss is smooth: its
# gradient falls to 0 with the error, while that of an absolute value jumps.
_ROUND = 0.02
_NOISE_COUNTS = 2.0  # the loss of a place is divided by 1 + this times the noise in spacings


class UpsamplerTrainer(CooledTrainer):
    """The trainer of the up-sampler, on an `UpsamplerSet`.

    validation  mean distance of the averaged network on the held-out clouds, in spacings, when it
                was last measured; NaN before
    """

    kind = "upsampler"
    parts = ("network", "average", "adam", "random")
    kept = ("steps_done", "validation")
    config: UpsamplerTrainingConfig

    def __init__(self, data: UpsamplerSet, config: UpsamplerTrainingConfig, *place: Any) -> None:
        super().__init__(data, config, *place)
        self.data = data
        count = len(data.places)
        validated = max(1, min(_HELD_OUT, count // _LEFT))
        held_out = torch.arange(validated) * count // validated
        kept = torch.ones(count, dtype=torch.bool)
        kept[held_out] = False
        self.held_out, self.trained_on = held_out.tolist(), kept.nonzero()[:, 0]
        self.build(training_loop.seeded(config.seed, lambda: Upsampler(config.network)))
        self.validation = torch.full((), torch.nan)

    def take_step(self) -> dict[str, Tensor]:
        """Take a step; return mean distance, mean sine, and the distance on held-out clouds."""
        if int(self.steps_done) % _VALIDATED_EVERY == 0:
            self.validation = self._validate()
        chosen = torch.randint(len(self.trained_on), (self.config.batch,), generator=self.random)
        objects = self.trained_on[chosen].tolist()
        first = int(torch.randint(self._last_start() + 1, (), generator=self.random))
        batch = self._batch(objects, first)
        with self.autocast():
            distance, sine = self._errors(self.network, batch)
        weight = 1 / (1 + _NOISE_COUNTS * batch.seen.noise[batch.nearest])
        loss = (weight * (distance + _NORMALS * sine)).mean()
        self.learn(loss)
        return {
            "distance": distance.detach().mean(),
            "normals": sine.detach().mean(),
            "validation": self.validation,
        }

    @torch.no_grad()
    def _validate(self) -> Tensor:
        """Return the mean distance of the averaged network on the held-out clouds, a scalar."""
        means = []
        for held_out in self.held_out:
            distance, _ = self._errors(self.average, self._batch([held_out], 0))
            means.append(distance.mean())
        return torch.stack(means).mean()

    def _last_start(self) -> int:
        """Return the last place of an object at which PLACES in a row can begin."""
        return max(0, self.data.places.shape[1] - PLACES)

    def _errors(self, network: torch.nn.Module, batch: _Batch) -> tuple[Tensor, Tensor]:
        """Return distances [Q] from the targets, in spacings, and sines [Q] between normals."""
        moved, told = network(batch.seen, batch.places, batch.nearest)
        apart = (moved - batch.targets) / batch.seen.radius[batch.nearest][:, None]
        sine = torch.linalg.cross(told, batch.normals)
        return _length(apart), _length(sine)

    def _batch(self, objects: list[int], first: int) -> _Batch:
        """Return the clouds of objects as one, and PLACES places of each, from `first` on."""
        data, some = self.data, slice(first, first + PLACES)
        starts, ends = data.first[:-1].tolist(), data.first[1:].tolist()
        seen = joined([_rows(data.clouds, slice(starts[i], ends[i])) for i in objects])
        sizes = torch.tensor([ends[i] - starts[i] for i in objects])
        # Row numbers within a cloud become row numbers in all clouds of the batch.
        before = sizes.cumsum(0) - sizes  # the points of the clouds before each
        neighbours = seen.neighbours + before.repeat_interleave(sizes)[:, None]
        nearest = data.nearest[objects, some] + before[:, None]
        return _Batch(
            seen=replace(seen, neighbours=neighbours).to(self.device),
            places=data.places[objects, some].flatten(0, 1).to(self.device),
            nearest=nearest.flatten().to(self.device),
            targets=data.targets[objects, some].flatten(0, 1).to(self.device),
            normals=data.normals[objects, some].flatten(0, 1).to(self.device),
        )


class _Batch(NamedTuple):
    """Some clouds as one, and Q places near them.

    seen     the surroundings of the points of all clouds
    places   [Q, 3]
    nearest  [Q]: the row in `seen` of the point nearest to each place
    targets  [Q, 3]: the point of the surface nearest to each place
    normals  [Q, 3]: unit normals of the surface there
    """

    seen: Surroundings
    places: Tensor
    nearest: Tensor
    targets: Tensor
    normals: Tensor


def _length(vectors: Tensor) -> Tensor:
    """Return the lengths [Q] of vectors [Q, 3], by a function that is smooth at 0."""
    return (vectors.square().sum(dim=1) + _ROUND**2).sqrt() - _ROUND


def _rows(seen: Surroundings, rows: slice) -> Surroundings:
    return Surroundings(**{field.name: getattr(seen, field.name)[rows] for field in fields(seen)})
