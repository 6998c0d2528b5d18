"""Training of the network: places near clouds are moved onto the surface, and told its normals.

The loss is the distance to the nearest point of the surface, in spacings of the points, and the
sine of the angle between normals. Neither is squared. Squares would let the large errors at
creases, where the points do not say what is right, outweigh the small ones of flat sides. There is
no loss for parts of the surface that no moved place reaches, because places are spread evenly
around all points. A cloud under noise counts less by its noise: errors there are as large as the
noise, and would drown those of clean clouds.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import torch
from torch import Tensor

from baselines.upsampler.config import UpsamplerTrainingConfig
from baselines.upsampler.data import UpsamplerSet, joined
from baselines.upsampler.network import Surroundings, Upsampler
from learning import training_loop
from learning.trainer import CooledTrainer

PLACES = 2048  # of an object in a step
_HELD_OUT = 24  # clouds at most, spread over the data, that are not trained on
_LEFT = 4  # one cloud in four is held out, at least one and at most _HELD_OUT
_VALIDATED_EVERY = 250  # steps
_NORMALS = 0.5  # weight of their loss
_ROUND = 0.02  # spacings, and sines: errors below have a gradient that falls to 0
_NOISE_COUNTS = 2.0  # a loss is divided by 1 + so many times the noise in spacings


class UpsamplerTrainer(CooledTrainer):
    """The trainer of the up-sampler, on an `UpsamplerSet`.

    `validation` is the distance of the averaged network on clouds that it has not seen, of the last
    time that it was measured.
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
        """Take a step and return distance, loss of normals, and distance on held-out clouds."""
        if int(self.steps_done) % _VALIDATED_EVERY == 0:
            self.validation = self._validate()
        chosen = torch.randint(len(self.trained_on), (self.config.batch,), generator=self.random)
        objects = self.trained_on[chosen].tolist()
        first = int(torch.randint(self._last_start() + 1, (), generator=self.random))
        seen, *labelled = self._batch(objects, first)
        with self.autocast():
            distance, sine = self._errors(self.network, seen, *labelled)
        weight = 1 / (1 + _NOISE_COUNTS * seen.noise[labelled[1]])
        loss = (weight * (distance + _NORMALS * sine)).mean()
        self.learn(loss)
        return {
            "distance": distance.detach().mean(),
            "normals": sine.detach().mean(),
            "validation": self.validation,
        }

    @torch.no_grad()
    def _validate(self) -> Tensor:
        errors = [self._errors(self.average, *self._batch([i], 0))[0].mean() for i in self.held_out]
        return torch.stack(errors).mean()

    def _last_start(self) -> int:
        return max(0, self.data.places.shape[1] - PLACES)

    def _errors(
        self,
        network: torch.nn.Module,
        seen: Surroundings,
        places: Tensor,
        nearest: Tensor,
        targets: Tensor,
        normals: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Return distances [Q] from the targets, in spacings, and sines [Q] between normals."""
        moved, told = network(seen, places, nearest)
        apart = (moved - targets) / seen.radius[nearest][:, None]
        sine = torch.linalg.cross(told, normals)
        return _length(apart), _length(sine)

    def _batch(
        self, objects: list[int], first: int
    ) -> tuple[Surroundings, Tensor, Tensor, Tensor, Tensor]:
        """Return clouds of objects in one, and a run of the places of each, from `first` on."""
        data, some = self.data, slice(first, first + PLACES)
        starts, ends = data.first[:-1].tolist(), data.first[1:].tolist()
        seen = joined([_rows(data.clouds, slice(starts[i], ends[i])) for i in objects])
        sizes = torch.tensor([ends[i] - starts[i] for i in objects])
        before = sizes.cumsum(0) - sizes  # points of the clouds before each
        neighbours = seen.neighbours + before.repeat_interleave(sizes)[:, None]
        nearest = data.nearest[objects, some] + before[:, None]
        rest = (values[objects, some] for values in (data.places, data.targets, data.normals))
        places, targets, normals = (values.flatten(0, 1).to(self.device) for values in rest)
        seen = replace(seen, neighbours=neighbours).to(self.device)
        return seen, places, nearest.flatten().to(self.device), targets, normals


def _length(vectors: Tensor) -> Tensor:
    """Return lengths [Q] of vectors [Q, 3], rounded off at 0."""
    return (vectors.square().sum(dim=1) + _ROUND**2).sqrt() - _ROUND


def _rows(seen: Surroundings, rows: slice) -> Surroundings:
    return Surroundings(*(getattr(seen, field.name)[rows] for field in fields(seen)))
