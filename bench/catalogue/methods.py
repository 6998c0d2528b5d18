"""The methods of the benchmark, as a literal table.

Importing this module needs no package at all, so that `bench list` answers at once.

Other packages add methods by entry points of the group `pc2pix_bench.methods`: the name is the
method's id, the object a `Method`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from bench.catalogue import loaders
from bench.catalogue.lookup import find
from bench.catalogue.parameters import find_setting
from bench.catalogue.reconstruction import BEST_RECONSTRUCTION
from data_prep import plugins
from data_prep.failures import BadInput, unknown
from data_prep.files.safe_read import is_regular_file
from data_prep.plugins import entry_point_names, load_entry_point

if TYPE_CHECKING:
    from data_prep.scene import Renderer
    from pc2pix.engine import Precision


TrainedOn = Literal["chairs", "13 classes", "nothing"]


@dataclass(frozen=True)
class Method:
    """A renderer with a name.

    `load` gets the device ("auto", "cpu" or "cuda") and returns the renderer; `version` is raised
    by hand when a change alters its images (finished work is then done again); `identity` gives
    whatever else its images depend on: the versions of its libraries, the checksum of its
    weights. Only ceilings have `sees_mesh`; what has not `sees_cloud` draws the same under every
    condition, and is drawn once. `trained_on` names the objects that a network has seen; it is
    None where nobody knows, as of weights in a file. `reconstruction` says whether it makes a
    surface of the points: "paper" by the chain of the paper or a part of it, "other" in another
    way.
    """

    id: str
    load: Callable[[str], Renderer]
    identity: Callable[[], str]
    version: int
    source: str
    sees_mesh: bool = False
    sees_cloud: bool = True
    weights_file: Callable[[], Path] | None = None  # of a network
    trained_on: TrainedOn | None = None
    reconstruction: Literal["", "paper", "other"] = ""


def _network(
    method_id: str,
    source: str,
    weights: str = loaders.BUNDLED,
    network: loaders.Network = loaders.PC2PIX,
    precision: Precision = "float32",
    load: Callable[[str], Renderer] | None = None,
    trained_on: TrainedOn = "chairs",
) -> Method:
    """Return a network with bundled weights; `load` where it is not loaded as usual."""
    return Method(
        method_id,
        load=load or partial(network.load, weights, precision=precision),
        identity=partial(network.identity, weights),
        version=network.version,
        source=source,
        weights_file=partial(network.file, weights),
        trained_on=trained_on,
    )


_splat_net = partial(_network, network=loaders.SPLAT_NET)

METHODS = (
    _network(
        "pc2pix",
        source="paper, section 3; bundled weights, objective paired (pc2pix/weights/chair.md)",
    ),
    _network(
        "pc2pix@acgan",
        source="paper, section 3; the paper's objective (pc2pix/weights/chair-acgan.md)",
        weights="chair-acgan",
    ),
    _network(
        "pc2pix@all",
        trained_on="13 classes",
        source="one network for all 13 classes, objective paired (pc2pix/weights/all.md)",
        weights="all",
    ),
    _network(
        "pc2pix@widened",
        source="pc2pix trained on chairs that vary more (pc2pix/weights/chair-widened.md)",
        weights="chair-widened",
    ),
    _network(
        "pc2pix@bf16",
        source="pc2pix in bfloat16: twice as fast where the processor has it",
        precision="bfloat16",
    ),
    _splat_net(
        "splat-net",
        weights="chair",
        source="a U-Net over the projected points; bundled weights "
        "(baselines/splat_net/weights/chair.md)",
    ),
    _splat_net(
        "splat-net@grey",
        weights="chair-grey",
        source="splat-net in neutral grey: no colour is made up",
    ),
    _splat_net(
        "splat-net@all",
        weights="all",
        trained_on="13 classes",
        source="splat-net trained on shapes of all 13 classes that vary more "
        "(baselines/splat_net/weights/all.md)",
    ),
    _splat_net(
        "splat-net@all-grey",
        weights="all-grey",
        trained_on="13 classes",
        source="splat-net@all in neutral grey",
    ),
    _splat_net(
        "splat-net@bf16",
        weights="chair",
        source="splat-net in bfloat16",
        precision="bfloat16",
    ),
    _splat_net(
        "splat-net@tiny",
        weights="chair-tiny",
        source="splat-net without normals, of half the width "
        "(baselines/splat_net/weights/chair-tiny.md)",
    ),
    _splat_net(
        "points2pix",
        weights="points2pix",
        trained_on="13 classes",
        source="the U-Net of pix2pix with a code of the cloud (Milz et al. 2019); its own loss, a "
        "short training (baselines/splat_net/weights/points2pix.md)",
    ),
    _splat_net(
        "points2pix@l1-patch",
        weights="points2pix-l1-patch",
        trained_on="13 classes",
        source="points2pix trained with the loss of splat-net",
    ),
    _splat_net(
        "depth-net",
        weights="depth",
        trained_on="13 classes",
        source="splat-net fed with the nearest depth alone, as Z2P is; a short training "
        "(baselines/splat_net/weights/depth.md)",
    ),
    Method(
        "surface-apss",
        load=partial(loaders.renderer, "baselines.reconstruction.surface:SurfaceApss"),
        identity=partial(loaders.versions, "embreex", "pymeshlab"),
        version=2,
        source="paper's SR; filter script of roatienza/pc2pix@23b7b46d",
        trained_on="nothing",
        reconstruction="paper",
    ),
    Method(
        "surface-fit",
        load=partial(loaders.renderer, "baselines.reconstruction.surface_fit:SurfaceFit"),
        identity=partial(loaders.versions, "embreex", "pymeshlab"),
        version=2,
        source="the paper's SR on a grid no finer than the picture can show",
        trained_on="nothing",
        reconstruction="paper",
    ),
    Method(
        "surface-bpa",
        load=partial(loaders.renderer, "baselines.reconstruction.surface:SurfaceBpa"),
        identity=partial(loaders.versions, "embreex", "pymeshlab"),
        version=2,
        source="the paper's SR without its last step: ball pivoting and holes closed",
        trained_on="nothing",
        reconstruction="paper",
    ),
    Method(
        "poisson",
        load=partial(loaders.renderer, "baselines.reconstruction.poisson:Poisson"),
        identity=partial(loaders.versions, "embreex", "pymeshlab", "scipy"),
        version=2,
        source="screened Poisson reconstruction (Kazhdan and Hoppe 2013)",
        trained_on="nothing",
        reconstruction="other",
    ),
    Method(
        "alpha-shape",
        load=partial(loaders.renderer, "baselines.reconstruction.alpha_shape:AlphaShape"),
        identity=partial(loaders.versions, "embreex", "scipy"),
        version=2,
        source="alpha shape (Edelsbrunner and Muecke 1994)",
        trained_on="nothing",
        reconstruction="other",
    ),
    Method(
        "denoised-bpa",
        load=partial(loaders.renderer, "baselines.reconstruction.denoised:DenoisedBpa"),
        identity=partial(loaders.versions, "embreex", "pymeshlab", "scipy"),
        version=1,
        source="ball pivoting on points smoothed as their noise asks for",
        trained_on="nothing",
        reconstruction="other",
    ),
    Method(
        "denoised-alpha",
        load=partial(loaders.renderer, "baselines.reconstruction.denoised:DenoisedAlpha"),
        identity=partial(loaders.versions, "embreex", "scipy"),
        version=1,
        source="the alpha shape of points smoothed as their noise asks for",
        trained_on="nothing",
        reconstruction="other",
    ),
    Method(
        "denoised-poisson",
        load=partial(loaders.renderer, "baselines.reconstruction.denoised:DenoisedPoisson"),
        identity=partial(loaders.versions, "embreex", "pymeshlab", "scipy"),
        version=1,
        source="screened Poisson on points smoothed as their noise asks for",
        trained_on="nothing",
        reconstruction="other",
    ),
    Method(
        "pgr",
        load=partial(loaders.renderer, "baselines.reconstruction.gauss:ParametricGauss"),
        identity=partial(loaders.versions, "embreex", "scikit-image", "scipy"),
        version=1,
        source="parametric Gauss reconstruction (Lin et al. 2022)",
        trained_on="nothing",
        reconstruction="other",
    ),
    Method(
        "open3d-poisson",
        load=partial(loaders.renderer, "baselines.reconstruction.open3d_poisson:Open3dPoisson"),
        identity=loaders.open3d_identity,
        version=1,
        source="screened Poisson as a first script with Open3D does it; extra [open3d]",
        trained_on="nothing",
        reconstruction="other",
    ),
    Method(
        "splat",
        load=partial(loaders.renderer, "baselines.splat:Splat"),
        identity=partial(loaders.versions, "scipy"),
        version=1,
        source="depth-buffered discs: what a viewer shows",
        trained_on="nothing",
    ),
    Method(
        "true-mesh",
        load=partial(loaders.renderer, "baselines.reference:TrueMesh"),
        identity=loaders.versions,
        version=1,
        source="the ceiling: the mesh behind the cloud",
        sees_mesh=True,
        sees_cloud=False,
        trained_on="nothing",
    ),
    Method(
        "true-mesh@grey",
        load=partial(loaders.renderer, "baselines.reference:TrueMesh", coloured=False),
        identity=loaders.versions,
        version=1,
        source="the mesh behind the cloud in neutral grey: a ceiling for what has no colour",
        sees_mesh=True,
        sees_cloud=False,
        trained_on="nothing",
    ),
    Method(
        "constant",
        load=loaders.constant,
        identity=loaders.constant_identity,
        version=1,
        source="a second floor: the one picture that SSIM likes best on the training set",
        sees_cloud=False,
        trained_on="chairs",
    ),
    Method(
        "blank",
        load=partial(loaders.renderer, "baselines.reference:Blank"),
        identity=loaders.versions,
        version=1,
        source="the floor: white pictures; failures are scored as these",
        sees_cloud=False,
        trained_on="nothing",
    ),
)
RECOMMENDED = "splat-net@all-grey"  # for a cloud of an unknown object: docs/trade.md
# What nobody would draw with, but a measurement of cost needs beside the others.
COST_VARIANTS = (
    _network(
        "pc2pix@unfolded",
        load=loaders.unfolded,
        source="pc2pix as it was trained, without the inference engine",
    ),
    _network(
        "pc2pix@one-by-one",
        load=loaders.one_by_one,
        source="pc2pix, a call for each view",
    ),
    _network(
        "pc2pix@paper",
        load=loaders.widened,
        source="the bundled pc2pix at the paper's width: same pictures, the paper's cost",
    ),
    _network(
        "pc2pix@paper-bf16",
        load=partial(loaders.widened, precision="bfloat16"),
        source="the same in bfloat16",
    ),
    _splat_net(
        "splat-net@no-normals",
        weights="chair-no-normals",
        source="splat-net without normals and flattened points: no neighbours are sought "
        "(baselines/splat_net/weights/chair-no-normals.md)",
    ),
    _splat_net(
        "splat-net@large",
        weights="chair-large",
        source="splat-net one and a half times as wide "
        "(baselines/splat_net/weights/chair-large.md)",
    ),
)
OWN_WEIGHTS = {"pc2pix": loaders.PC2PIX, "splat-net": loaders.SPLAT_NET}  # that take files of yours
# A method's variants follow its id and "@". The first two stand where a method's id stands.
OUR_FAMILIES = {"ground-truth", BEST_RECONSTRUCTION} | {
    method.id.partition("@")[0] for method in (*METHODS, *COST_VARIANTS)
}
FLOOR = "blank"
FLOORS = ("constant", FLOOR)  # what looks at no cloud


def find_method(method_id: str) -> Method:
    """The method with this id, or a variant of one.

    `pc2pix@FILE.safetensors` and `splat-net@FILE.safetensors` have weights of your own,
    `METHOD@PARAMETER=VALUE` is a method with one parameter set
    (`bench.catalogue.parameters.PARAMETERS`).

    Raises BadInput for an unknown id (naming the nearest), an unknown parameter or value, weights
    that are missing or in another format, and where another package announces a method that it does
    not have.
    """
    if (setting := find_setting(method_id)) is not None:
        method = find(setting.parameter.method, METHODS, "method")
        source = f"{method.id} with {setting.parameter.name} {setting.value:g}"
        load = partial(loaders.renderer, setting.parameter.renderer, **setting.fields)
        return replace(method, id=method_id, load=load, source=source)
    name, _, weights = method_id.partition("@")
    network, suffix = OWN_WEIGHTS.get(name), Path(weights).suffix
    if network and suffix == ".safetensors":
        if not is_regular_file(Path(weights)):
            raise BadInput(f"{weights}: no such weights file; train one with '{network.command}'")
        return Method(
            method_id,
            load=partial(network.load, weights),
            identity=partial(network.file_identity, weights),
            version=network.version,
            source=f"{name} with the weights in {weights}",
            weights_file=partial(Path, weights),
        )
    own = (*METHODS, *COST_VARIANTS)
    for method in own:
        if method.id == method_id:
            return method
    if method_id in plugin_ids():
        return _plugin(method_id)
    if network and suffix:
        raise BadInput(f"{weights}: weights are .safetensors files; '{network.command}' writes one")
    raise unknown(method_id, [*(method.id for method in own), *plugin_ids()], "method")


@cache
def plugin_ids() -> tuple[str, ...]:
    """Ids of the methods that other installed packages announce, sorted; none is loaded."""
    return entry_point_names(plugins.METHODS)


@cache
def _plugin(method_id: str) -> Method:
    named = "bench.methods.Method"
    return load_entry_point((plugins.METHODS,), method_id, "method", Method, named, OUR_FAMILIES)


def objectives(method_ids: Iterable[str]) -> dict[str, str]:
    """By method, what the weights of networks were trained with; other methods are left out."""
    from learning.weights import objective_of

    networks = ((id_, find_method(id_).weights_file) for id_ in method_ids)
    return {id_: objective_of(find()) for id_, find in networks if find}


def role(method: str) -> str:
    """ "ceiling" for what sees the mesh, "floor" for what sees no cloud, "chosen" for the row that
    is one of the other methods at each condition; empty for methods that compete."""
    if method in FLOORS:
        return "floor"
    if method == BEST_RECONSTRUCTION:
        return "chosen"
    known = known_method(method)
    return "ceiling" if known and known.sees_mesh else ""


def known_method(method_id: str) -> Method | None:
    """As `find_method`; None for a weights file or another package's method that is gone."""
    try:
        return find_method(method_id)
    except BadInput:
        return None
