"""The methods of the benchmark, as a literal table.

Other packages add methods by entry points of the group `pc2pix_bench.methods`: the name is the
method's id, the object a `Method`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from bench.catalogue import loaders  # no package that is slow to import: `bench list` needs this
from bench.catalogue.chosen import CHOSEN
from bench.catalogue.lookup import family_of, find, instead_of, unknown, variant_of
from bench.catalogue.method import IMAGES, Color, Method, TrainedOn, is_module_name, module_method
from data_prep import plugins
from data_prep.failures import BadInput
from data_prep.files.safe_read import is_regular_file
from data_prep.plugins import entry_point_names, load_entry_point

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


def _reconstruction(
    method_id: str,
    renderer: str,
    source: str,
    identity: Callable[[], str],
    version: int = 1,
    chain: Literal["paper", "other"] = "other",
) -> Method:
    """Return a method that reconstructs a surface, in grey, by a class of our own."""
    return Method(
        method_id,
        load=partial(loaders.renderer, f"baselines.reconstruction.{renderer}"),
        identity=identity,
        version=version,
        source=source,
        trained_on="nothing",
        reconstruction=chain,
        color="none",
    )


_MESHLAB = partial(loaders.versions, "embreex", "pymeshlab")
_paper_chain = partial(_reconstruction, version=2, identity=_MESHLAB, chain="paper")
_untrained = partial(Method, version=1, trained_on="nothing")
_splat = partial(
    _untrained, kind="splat", color="none", identity=partial(loaders.versions, "scipy")
)
_reference = partial(_untrained, kind="reference", identity=loaders.versions)

METHODS = (
    *NETWORK_METHODS,
    _paper_chain(
        "surface-apss",
        "surface:SurfaceApss",
        source="paper's SR; filter script of roatienza/pc2pix@23b7b46d",
    ),
    _paper_chain(
        "surface-fit",
        "surface_fit:SurfaceFit",
        source="the paper's SR on a grid no finer than the image can show",
    ),
    _paper_chain(
        "surface-bpa",
        "surface:SurfaceBpa",
        source="the paper's SR without its last step: ball pivoting and holes closed",
    ),
    _reconstruction(
        "poisson",
        "poisson:Poisson",
        version=2,
        source="screened Poisson reconstruction (Kazhdan and Hoppe 2013)",
        identity=partial(loaders.versions, "embreex", "pymeshlab", "scipy"),
    ),
    _reconstruction(
        "alpha-wrap",
        "alpha_wrap:AlphaWrap",
        source="alpha wrapping of the points as they are (Portaneri et al. 2022)",
        identity=partial(loaders.versions, "embreex", "pymeshlab", "scipy"),
    ),
    _reconstruction(
        "denoised-wrap",
        "alpha_wrap:DenoisedWrap",
        source="alpha wrapping of points smoothed as their noise asks for",
        identity=partial(loaders.versions, "embreex", "pymeshlab", "scipy"),
    ),
    _reconstruction(
        "open3d-poisson",
        "open3d_poisson:Open3dPoisson",
        source="screened Poisson as a first script with Open3D does it; extra [open3d]",
        identity=loaders.open3d_identity,
    ),
    _splat(
        "splat",
        load=partial(loaders.renderer, "baselines.splat:Splat"),
        source="depth-buffered discs: what a viewer shows",
    ),
    _splat(
        "splat-fill",
        load=partial(loaders.renderer, "baselines.splat_fill:SplatFill"),
        source="projected points filled by pull-push (Marroquim et al. 2007)",
    ),
    _reference(
        "true-mesh",
        load=partial(loaders.renderer, "baselines.reference:TrueMesh"),
        source="the ceiling: the mesh behind the cloud",
        sees_mesh=True,
        sees_cloud=False,
        color="true",
    ),
    _reference(
        "true-mesh@grey",
        load=partial(loaders.renderer, "baselines.reference:TrueMesh", coloured=False),
        source="the mesh behind the cloud in neutral grey: a ceiling for what has no colour",
        sees_mesh=True,
        sees_cloud=False,
        color="none",
    ),
    _reference(
        "constant",
        load=loaders.constant,
        identity=loaders.constant_identity,
        source="a second floor: the one image that scores best by SSIM on the training set",
        sees_cloud=False,
        trained_on="chairs",
        color="invented",
    ),
    _reference(
        "blank",
        load=partial(loaders.renderer, "baselines.reference:Blank"),
        source="the floor: white images; failures are scored as these",
        sees_cloud=False,
        color="none",
    ),
)
RECOMMENDED = "fused-net@grey"  # for a cloud of an unknown object: docs/trade.md
RECOMMENDED_IN_COLOUR = "fused-net"  # the same where colours are asked for
BUNDLED = (*METHODS, *COST_VARIANTS)
WITH_WEIGHTS_FILE = {
    "pc2pix": loaders.PC2PIX,
    "splat-net": loaders.SPLAT_NET,
    "fused-net": loaders.FUSED_NET,
    "occupancy-net": loaders.OCCUPANCY_NET,
}
# The first ones stand where the id of a method stands: they are no ids for methods of others.
OUR_FAMILIES = {"ground-truth", *CHOSEN, *WITH_WEIGHTS_FILE} | {m.family for m in BUNDLED}
FLOOR = "blank"
FLOORS = tuple(method.id for method in METHODS if method.role == "floor")


@dataclass(frozen=True)
class Parameter:
    """A number that a method's class takes as a field.

    method         the id of the method that has it
    name           in ids of variants
    low, high      the values that are taken, both included
    about          what it is, with its unit
    field          of the method's class; "" where it has the parameter's name
    whole          whether only whole numbers are taken
    """

    method: str
    name: str
    low: float
    high: float
    about: str
    field: str = ""
    whole: bool = False


_whole = partial(Parameter, whole=True)

PARAMETERS = (
    _whole("surface-apss", "resolution", 10, 400, "grid cells along the longest side of the cloud"),
    Parameter(
        "surface-fit", "cell", 0.5, 4, "side of a grid cell, in pixels at the origin", "cell_px"
    ),
    Parameter(
        *("surface-bpa", "radius", 0.1, 20),
        *("of the ball, in percent of the diagonal of the cloud's box", "radius_percent"),
    ),
    _whole("poisson", "depth", 3, 10, "levels of the octree"),
    Parameter("alpha-wrap", "ball", 0.5, 8, "radius of the ball, in spacings of the points"),
    Parameter("denoised-wrap", "ball", 0.5, 8, "radius of the ball, in spacings of the points"),
    Parameter("denoised-wrap", "strength", 0, 4, "factor on the estimated noise"),
    _whole("open3d-poisson", "depth", 3, 10, "levels of the octree"),
    Parameter("splat", "spread", 0.1, 10, "factor on the radius of the discs"),
)


@dataclass(frozen=True)
class Setting:
    """A parameter and its value."""

    parameter: Parameter
    value: float

    @property
    def fields(self) -> dict[str, float]:
        """Return the arguments of the renderer's class."""
        return {self.parameter.field or self.parameter.name: self.value}


def find_setting(method_id: str) -> Setting | None:
    """Return the setting of an id METHOD@PARAMETER=VALUE; None for an id of another form.

    Raises BadInput for a parameter that the method does not have, and for a value out of its range.
    """
    method, setting = family_of(method_id), variant_of(method_id)
    name, equals, text = setting.partition("=")
    if not equals or method_id.endswith(".safetensors"):
        return None
    parameter = next((k for k in PARAMETERS if (k.method, k.name) == (method, name)), None)
    if parameter is None:
        variants = ", ".join(f"{k.method}@{k.name}=..." for k in PARAMETERS)
        raise BadInput(f"unknown variant '{method_id}': there are {variants}")
    try:
        value = int(text) if parameter.whole else float(text)
    except ValueError:
        value = math.nan
    if not parameter.low <= value <= parameter.high:
        kind = "whole number" if parameter.whole else "number"
        raise BadInput(
            f"'{method_id}': {name} must be a {kind} from {parameter.low:g} to {parameter.high:g}, "
            f"not '{text}'"
        )
    return Setting(parameter, value)


def find_run_method(address: str) -> Method:
    """Return a method of a run: by its id, or with the images in a folder, as "images:TREE".

    Raises BadInput as `find_method`, and as `bench.catalogue.images.entered_method`.
    """
    if not address.startswith(IMAGES):
        return find_method(address)
    from bench.catalogue.images import entered_method

    taken = OUR_FAMILIES | {family_of(id_) for id_ in plugin_ids()}
    return entered_method(Path(address.removeprefix(IMAGES)), taken)


def find_method(method_id: str) -> Method:
    """Return the method with this id, or a variant of one, that draws any cloud.

    `pc2pix@FILE.safetensors` and the like (WITH_WEIGHTS_FILE) have weights of your own,
    `METHOD@PARAMETER=VALUE` is a method with one parameter set
    (`PARAMETERS`), `MODULE:NAME` is of a module that the command line
    names (`bench.catalogue.method.module_method`).

    Raises BadInput for images in place of a method, an unknown id (naming the nearest), an unknown
    parameter or value, weights that are missing or in another format, where another package
    announces a method that it does not have, and as `module_method`.
    """
    if method_id.startswith(IMAGES):
        raise BadInput(
            f"{method_id}: images of an export, which cannot draw other clouds; give them to "
            "'bench run' of a suite that scores images"
        )
    if (line := instead_of("method", method_id)) and method_id not in plugin_ids():
        raise BadInput(line)
    if (setting := find_setting(method_id)) is not None:
        method = find(setting.parameter.method, METHODS, "method")
        source = f"{method.id} with {setting.parameter.name} {setting.value:g}"
        load = partial(method.load, **setting.fields)
        return replace(method, id=method_id, load=load, source=source)
    family, weights = family_of(method_id), variant_of(method_id)
    package, suffix = WITH_WEIGHTS_FILE.get(family), Path(weights).suffix
    if package and suffix == ".safetensors":
        if not is_regular_file(Path(weights)):
            raise BadInput(f"{weights}: no such weights file; train one with '{package.command}'")
        return Method(
            method_id,
            load=partial(package.load, weights),
            identity=partial(package.file_identity, weights),
            version=package.version,
            source=f"{family} with the weights in {weights}",
            weights_file=partial(Path, weights),
            kind="network",
        )
    for method in BUNDLED:
        if method.id == method_id:
            return method
    if method_id in plugin_ids():
        return _plugin(method_id)
    if is_module_name(method_id):
        return module_method(method_id)
    if package and suffix:
        raise BadInput(f"{weights}: weights are .safetensors files; '{package.command}' writes one")
    raise unknown(method_id, [*(method.id for method in BUNDLED), *plugin_ids()], "method")


@cache
def plugin_ids() -> tuple[str, ...]:
    """Return the ids of methods that other installed packages announce, sorted; load none."""
    return entry_point_names(plugins.METHODS)


def is_foreign(method_id: str) -> bool:
    """Return whether drawing with a method executes code of others than this project."""
    return method_id in plugin_ids() or is_module_name(method_id)


@cache
def _plugin(method_id: str) -> Method:
    named = "bench.methods.Method"
    return load_entry_point((plugins.METHODS,), method_id, "method", Method, named, OUR_FAMILIES)


def objectives(methods: Iterable[Method]) -> dict[str, str]:
    """Return what the weights of networks were trained with, by id; other methods are left out."""
    from learning.weights import objective_of

    networks = ((method.id, method.weights_file) for method in methods)
    return {id_: objective_of(find_file()) for id_, find_file in networks if find_file}


def role(method_id: str) -> str:
    """Return the role of a row of tables: that of its method, or "chosen".

    "chosen" is a row of `bench.catalogue.chosen`, another method at each condition; methods
    that compete, and methods that are gone, have the role "".
    """
    if method_id in CHOSEN:
        return "chosen"
    method = known_method(method_id)
    return method.role if method else ""


def training_objects(method_id: str, manifest: Mapping[str, Any]) -> str:
    """Return the objects that a method of a run was trained on; "" where nobody says."""
    from bench.catalogue.images import entered_claims

    if claims := entered_claims(manifest, method_id):
        return claims.trained_on
    method = known_method(method_id)
    return (method and method.trained_on) or ""


def has_papers_chain(method_id: str) -> bool:
    """Return whether a method is the paper's chain of reconstruction or a part of it."""
    known = known_method(method_id)
    return known is not None and known.reconstruction == "paper"


def known_method(method_id: str) -> Method | None:
    """Return the method with this id; None if its weights file or its package is gone."""
    try:
        return find_method(method_id)
    except BadInput:
        return None
