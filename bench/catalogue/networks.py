"""The networks among the methods, as a literal table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from bench.catalogue import loaders  # no package that is slow to import: `bench list` needs this
from bench.catalogue.method import Color, Method, TrainedOn

if TYPE_CHECKING:
    from data_prep.scene import Renderer


def _network(
    method_id: str,
    source: str,
    weights: str = loaders.BUNDLED,
    package: loaders.NetworkPackage = loaders.PC2PIX,
    load: Callable[[str], Renderer] | None = None,
    trained_on: TrainedOn = "chairs",
    color: Color = "invented",
) -> Method:
    """Return a network with bundled weights; `load` where it is not loaded as usual."""
    return Method(
        method_id,
        load=load or partial(package.load, weights),
        identity=partial(package.identity, weights),
        version=package.version,
        source=source,
        weights_file=partial(package.file, weights),
        trained_on=trained_on,
        kind="network",
        color=color,
    )


_splat_net = partial(_network, package=loaders.SPLAT_NET)

NETWORK_METHODS = (
    _network(
        "pc2pix",
        source="paper, section 3; bundled weights, objective paired (pc2pix/weights/chair.md)",
    ),
    _network(
        "pc2pix@acgan",
        source="paper, section 3; the paper's objective alone (pc2pix/weights/chair-acgan.md)",
        weights="chair-acgan",
    ),
    _network(
        "pc2pix@all",
        trained_on="13 classes",
        source="one network for all 13 classes, objective paired (pc2pix/weights/all.md)",
        weights="all",
    ),
    _splat_net(
        "splat-net",
        weights="all",
        trained_on="13 classes",
        source="a U-Net over the projected points: one network for objects of any kind, trained on "
        "shapes of all 13 classes that vary more (baselines/splat_net/weights/all.md)",
    ),
    _splat_net(
        "splat-net@grey",
        weights="all-grey",
        color="none",
        trained_on="13 classes",
        source="splat-net in neutral grey: no colour is made up",
    ),
    _splat_net(
        "splat-net@chair",
        weights="chair",
        source="splat-net trained on chairs (baselines/splat_net/weights/chair.md)",
    ),
    # Its images changed with the windows of its finest level: version 3.
    replace(
        _splat_net(
            "splat-net@tiny",
            weights="all-tiny",
            trained_on="13 classes",
            source="splat-net without normals, of half the width "
            "(baselines/splat_net/weights/all-tiny.md)",
        ),
        version=3,
    ),
    replace(
        _splat_net(
            "splat-net@tiny-grey",
            weights="all-tiny-grey",
            color="none",
            trained_on="13 classes",
            source="splat-net@tiny in neutral grey",
        ),
        version=3,
    ),
    _splat_net(
        "points2pix",
        weights="points2pix",
        trained_on="13 classes",
        source="the U-Net of pix2pix with a code of the cloud (Milz et al. 2019); its own loss, a "
        "short training (baselines/splat_net/weights/points2pix.md)",
    ),
    _network(
        "occupancy-net",
        package=loaders.OCCUPANCY_NET,
        weights="all",
        trained_on="13 classes",
        color="none",
        source="an occupancy network on three planes (Peng et al. 2020), trained on the clouds "
        "of splat-net (baselines/occupancy_net/weights/all.md)",
    ),
    _network(
        "fused-net",
        package=loaders.FUSED_NET,
        weights="all",
        trained_on="13 classes",
        source="splat-net that also sees the meshes of denoised-wrap and occupancy-net "
        "(baselines/fused_net/weights/all.md)",
    ),
    _network(
        "fused-net@grey",
        package=loaders.FUSED_NET,
        weights="all-grey",
        trained_on="13 classes",
        color="none",
        source="fused-net in neutral grey: no colour is made up",
    ),
)
# Methods that nobody would draw with, but whose cost is measured beside the others.
COST_VARIANTS = (
    _network(
        "pc2pix@paper",
        load=loaders.widened,
        source="the bundled pc2pix at the paper's width: same images, the paper's cost",
    ),
)
