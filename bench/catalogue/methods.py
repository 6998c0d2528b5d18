"""The methods of the benchmark, as a literal table.

Other packages add methods by entry points of the group `pc2pix_bench.methods`: the name is the
method's id, the object a `Method`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

from bench.catalogue import loaders  # no package that is slow to import: `bench list` needs this
from bench.catalogue.chosen import CHOSEN
from bench.catalogue.claims import PREFIX, entered_claims
from bench.catalogue.gone import instead_of, unknown
from bench.catalogue.lookup import family_of, find, variant_of
from bench.catalogue.method import Method
from bench.catalogue.modules import is_module_name, module_method
from bench.catalogue.networks import COST_VARIANTS, NETWORK_METHODS
from bench.catalogue.parameters import find_setting
from data_prep import plugins
from data_prep.failures import BadInput
from data_prep.files.safe_read import is_regular_file
from data_prep.plugins import entry_point_names, load_entry_point


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


def find_run_method(address: str) -> Method:
    """Return a method of a run: by its id, or with the images in a folder, as "images:TREE".

    Raises BadInput as `find_method`, and as `bench.catalogue.image_tree.entered_method`.
    """
    if not address.startswith(PREFIX):
        return find_method(address)
    from bench.catalogue.image_tree import entered_method

    taken = OUR_FAMILIES | {family_of(id_) for id_ in plugin_ids()}
    return entered_method(Path(address.removeprefix(PREFIX)), taken)


def find_method(method_id: str) -> Method:
    """Return the method with this id, or a variant of one, that draws any cloud.

    `pc2pix@FILE.safetensors` and the like (WITH_WEIGHTS_FILE) have weights of your own,
    `METHOD@PARAMETER=VALUE` is a method with one parameter set
    (`bench.catalogue.parameters.PARAMETERS`), `MODULE:NAME` is of a module that the command line
    names (`bench.catalogue.modules`).

    Raises BadInput for images in place of a method, an unknown id (naming the nearest), an unknown
    parameter or value, weights that are missing or in another format, where another package
    announces a method that it does not have, and as `module_method`.
    """
    if method_id.startswith(PREFIX):
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
