"""Networks of the suite `latent`: from clouds to codes, and from codes to clouds and images."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from bench.catalogue.lookup import variant_of
from bench.catalogue.methods import find_method
from bench.suites.latent.chairs import SpecifiedChair
from data_prep.clouds.sampling import sample_surface
from data_prep.failures import BadInput, StageFailure
from data_prep.randomness import generator
from data_prep.rendering.images import to_uint8
from data_prep.rendering.opengl import render
from data_prep.scene import Mesh, PointCloud, View
from pc2pix.latent import decode
from pc2pix.model import Decoder
from pc2pix.renderer import Pc2pixRenderer
from pc2pix.weights import load_decoder

BUNDLED = "chair"  # the weights of the method `pc2pix`


@dataclass(frozen=True, eq=False)
class LatentNetwork:
    """A network that turns clouds into codes, and codes into clouds and images."""

    method: str
    renderer: Pc2pixRenderer
    decoder: Decoder
    decoder_sha256: str
    view: View

    def encode(self, name: str, cloud: PointCloud) -> Tensor:
        """Return the whitened code [1, d] of a cloud; `name` is for errors.

        Raises BadInput where the code is not finite.
        """
        with self._usable(f"encode {name}"):
            return self.renderer.prepare(cloud)

    def decode(self, codes: Tensor) -> NDArray[np.float32]:
        """Return clouds float32 [K, 2048, 3] of whitened codes [K, d]."""
        return decode(self.decoder, codes)

    def draw(self, codes: Tensor) -> NDArray[np.uint8]:
        """Return images uint8 [K, 128, 128, 3] of whitened codes [K, d], all from the same view.

        Raises BadInput where an image is not finite.
        """
        with self._usable("draw"):
            # One by one, so that an image does not depend on its neighbours.
            drawn = [self.renderer.draw(code[None], [self.view]) for code in codes]
        return to_uint8(np.concatenate(drawn))

    @contextmanager
    def _usable(self, what: str) -> Iterator[None]:
        try:
            yield
        except StageFailure as error:
            raise BadInput(
                f"{self.method}: cannot {what} ({error}); these weights cannot be measured"
            ) from error


def weights_of(method: str) -> str:
    """Return the name or the path of a method's weights. Raises BadInput for one without codes."""
    chosen = find_method(method)
    if chosen.family != "pc2pix":
        raise BadInput(
            f"--methods {method}: has no code to do arithmetic with; use pc2pix or "
            "pc2pix@FILE.safetensors"
        )
    return variant_of(chosen.id) or BUNDLED


def load_network(method: str, device: str, view: View) -> LatentNetwork:
    """Return a method's network with the decoder of its weights.

    Raises BadInput where the weights cannot be used, or their decoder is missing.
    """
    weights = weights_of(method)
    renderer = find_method(method).load(device)
    assert isinstance(renderer, Pc2pixRenderer)
    decoder, sha256 = load_decoder(weights, renderer.weights)
    return LatentNetwork(method, renderer, decoder.to(renderer.device), sha256, view)


def sample_chair(
    chair: SpecifiedChair, view: View, seed: int
) -> tuple[PointCloud, NDArray[np.uint8]]:
    """Return the cloud [2048, 3] of a chair, and its true image uint8 [128, 128, 3]."""
    mesh = chair.load()
    return cloud_of(mesh, chair, seed), render(mesh, [view])[0]


def cloud_of(mesh: Mesh, chair: SpecifiedChair, seed: int) -> PointCloud:
    """Return the 2,048 points that other suites take for the same chair and seed."""
    sampled = sample_surface(mesh, generator(seed, "cloud", "chair", chair.id))
    return PointCloud(sampled.points)  # without its mesh, which no method may see
