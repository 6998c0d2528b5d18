"""The renderer of `auto`: it chooses a method for each cloud and draws with that one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from baselines.reconstruction.noise import quick_noise
from bench.catalogue.auto import AUTO, AutoTable, CloudEstimate
from data_prep.scene import Images, PointCloud, Renderer, View


@dataclass(frozen=True, eq=False)
class AutoState:
    """The renderer that was chosen for a cloud, its state, and notes for the record."""

    renderer: Renderer
    state: Any
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class AutoRenderer:
    """A `data_prep.scene.Renderer` that draws each cloud as the method does that it chooses.

    Attributes
    ----------
    table : AutoTable
        Scores and costs to choose by.
    budget_ms : float or None
        Most milliseconds for one view of a new cloud; None: no limit.
    load : callable
        Returns the renderer of a method; called once for each method that is chosen.
    """

    table: AutoTable
    budget_ms: float | None
    load: Callable[[str], Renderer]
    _loaded: dict[str, Renderer] = field(default_factory=dict, init=False, repr=False)

    def prepare(self, cloud: PointCloud, rng: np.random.Generator) -> AutoState:
        """Choose a method and prepare the cloud with it.

        Raises BadInput for a budget below the cheapest method on this cloud, and whatever the
        method raises.
        """
        estimate = estimate_of(cloud)
        method = self.table.choose(estimate, self.budget_ms).method
        if method not in self._loaded:
            self._loaded[method] = self.load(method)
        renderer = self._loaded[method]
        state = renderer.prepare(cloud, rng)
        note = f"{AUTO}: {method} for {estimate.note()}"
        return AutoState(renderer, state, (note, *getattr(state, "notes", ())))

    def draw(self, state: AutoState, views: Sequence[View], rng: np.random.Generator) -> Images:
        """Return the images of the chosen method."""
        return state.renderer.draw(state.state, views, rng)


def estimate_of(cloud: PointCloud) -> CloudEstimate:
    """Return what the choice depends on; the order of the points does not matter."""
    quick = quick_noise(cloud.points)
    return CloudEstimate(len(cloud), quick.noise, quick.spacing)
