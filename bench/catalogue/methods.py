"""The methods of the benchmark, each a row of `methods.csv`, and their variants.

Other packages add methods by entry points of the group `pc2pix_bench.methods`. The name of such an
entry point is the method's id, and its object is a `Method`.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

from bench.catalogue import loaders  # it imports no slow package, so that `bench list` is fast
from bench.catalogue.chosen import CHOSEN
from bench.catalogue.lookup import family_of, find, variant_of
from bench.catalogue.method import ANY_SIZE, IMAGES_PREFIX, Method, is_module_name, module_method
from bench.catalogue.method_files import declared_files, with_files
from data_prep.failures import BadInput, unknown
from data_prep.files.safe_read import is_regular_file
from data_prep.plugins import announced, entry_point_folder, load_entry_point

_WITH_WEIGHTS_FILE = {
    "pc2pix": loaders.PC2PIX,
    "splat-net": loaders.SPLAT_NET,
    "fused-net": loaders.FUSED_NET,
    "occupancy-net": loaders.OCCUPANCY_NET,
    "upsampled-wrap": loaders.UPSAMPLER,
}
# Fields of `Method` that a row of the table cannot express, by the id of the method.
_BY_HAND: dict[str, dict[str, Any]] = {
    "open3d-poisson": {"identity": loaders.open3d_identity},
    "true-mesh@grey": {"load": partial(loaders.renderer, "reference:TrueMesh", coloured=False)},
    "constant": {"load": loaders.constant, "identity": loaders.constant_identity},
}


def _rows() -> list[dict[str, Any]]:
    with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


# The methods that a user should choose from: by id, the use that each is the best choice for.
CHOOSE_FOR: dict[str, str] = {row["id"]: row["choose_for"] for row in _rows() if row["choose_for"]}


def _methods() -> Iterator[Method]:
    """Yield the methods of the table, whose columns are fields of `Method` and these.

    sees      what the method draws from: "mesh" is the true mesh, "cloud" the cloud, and "nothing"
              means that it always draws the same images
    version   increase this number by hand with a change of the code that changes the images. It is
              empty for a network, which has the version of its package
    sizes     the sides in pixels of its images, or "any" for ANY_SIZE
    renderer  for a network its package, as named in `_WITH_WEIGHTS_FILE`; else a class below
              `baselines`, as MODULE:NAME
    needs     for a network the name of its bundled weights; else the libraries whose versions its
              images depend on
    """
    for row in _rows():
        renderer, needs, version = row.pop("renderer"), row.pop("needs"), row.pop("version")
        sees, sizes = row.pop("sees"), row.pop("sizes")
        del row["choose_for"]
        fields: dict[str, Any] = {"sees_mesh": sees == "mesh", "sees_cloud": sees == "cloud"}
        if row["kind"] == "network":
            package = _WITH_WEIGHTS_FILE[renderer]
            fields["weights_file"] = partial(package.file, needs)
            fields["identity"] = partial(package.identity, needs)
            fields["load"] = partial(package.load, needs)
            version = version or package.version
        else:
            fields["identity"] = partial(loaders.versions, *needs.split())
            fields["load"] = partial(loaders.renderer, renderer)
        fields["sizes"] = ANY_SIZE if sizes == "any" else tuple(map(int, sizes.split()))
        fields |= {"version": int(version)} | _BY_HAND.get(row["id"], {})
        yield Method(**row, **fields)


METHODS = tuple(_methods())
# Methods that exist only for the suite `speed`: their costs are compared with those of the others.
COST_VARIANTS = (
    replace(
        METHODS[0],
        id="pc2pix@paper",
        load=loaders.paper_width,
        source="pc2pix with an untrained generator of the paper's width, for its cost alone",
    ),
)
# The method that `bench render` draws a cloud with by default: docs/trade.md says why.
RECOMMENDED = "fused-net@grey"
RECOMMENDED_IN_COLOUR = "fused-net"  # the default method where the user asks for colours
BUNDLED = (*METHODS, *COST_VARIANTS)
# The names that methods of other packages may not have: the families of our own methods, and the
# names that stand in place of a method in tables, which are "ground-truth" and the chosen rows.
OUR_FAMILIES = {"ground-truth", *CHOSEN, *_WITH_WEIGHTS_FILE} | {m.family for m in BUNDLED}
FLOOR = "blank"  # the method with white images, against which others are compared
# The methods that reconstruct a surface by the MeshLab steps of the paper, or by some of them.
PAPERS_CHAIN = {"surface-apss", "surface-fit", "surface-bpa"}
FLOORS = tuple(method.id for method in METHODS if method.role == "floor")


@dataclass(frozen=True)
class Parameter:
    """A number that a user can set for a method, as in `poisson@depth=6`.

    method         the id of the method that has the parameter
    name           its name, as it stands after the "@"
    low, high      the lowest and the highest value that are allowed
    about          what it is, with its unit
    field          the name of the argument of the method's class; "" where that is `name`
    whole          whether only whole numbers are allowed
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
        method="surface-fit",
        name="cell",
        low=0.5,
        high=4,
        about="side of a grid cell, in pixels at the origin",
        field="cell_px",
    ),
    Parameter(
        method="surface-bpa",
        name="radius",
        low=0.1,
        high=20,
        about="of the ball, in percent of the diagonal of the cloud's box",
        field="radius_percent",
    ),
    _whole("poisson", "depth", 3, 10, "levels of the octree"),
    Parameter("alpha-wrap", "ball", 0.5, 8, "radius of the ball, in spacings of the points"),
    Parameter("denoised-wrap", "ball", 0.5, 8, "radius of the ball, in spacings of the points"),
    Parameter("denoised-wrap", "strength", 0, 4, "factor on the estimated noise"),
    _whole("open3d-poisson", "depth", 3, 10, "levels of the octree"),
    Parameter("splat", "spread", 0.1, 10, "factor on the radius of the discs"),
)


class _Setting(NamedTuple):
    """A parameter and the value that a method's id gives it."""

    parameter: Parameter
    value: float


def find_setting(method_id: str) -> _Setting | None:
    """Return the parameter and value of an id METHOD@PARAMETER=VALUE; None for other ids.

    Raises BadInput for a parameter that the method does not have, and for a value out of its range.
    """
    method, setting = family_of(method_id), variant_of(method_id)
    name, equals, text = setting.partition("=")
    if not equals or method_id.endswith(".safetensors"):
        return None
    known = {(parameter.method, parameter.name): parameter for parameter in PARAMETERS}
    parameter = known.get((method, name))
    if parameter is None:
        variants = ", ".join(f"{method}@{name}=..." for method, name in known)
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
    return _Setting(parameter, value)


def find_run_method(address: str) -> Method:
    """Return a method of a run by its `Method.address`: its id, or a folder of images images:TREE.

    Raises BadInput where `find_method` or `bench.catalogue.images.entered_method` does.
    """
    if not address.startswith(IMAGES_PREFIX):
        return find_method(address)
    from bench.catalogue.images import entered_method

    taken = OUR_FAMILIES | {family_of(id_) for id_ in announced("method")}
    return entered_method(Path(address.removeprefix(IMAGES_PREFIX)), taken)


def find_method(method_id: str) -> Method:
    """Return the method with this id.

    The id is one of the table or of an installed package, or has one of these forms:
    `pc2pix@FILE.safetensors`, a network of `_WITH_WEIGHTS_FILE` with a user's own weights;
    `METHOD@PARAMETER=VALUE`, a method with a value for one of `PARAMETERS`; `MODULE:NAME`, a method
    of a module that the command line names (`bench.catalogue.method.module_method`).

    Raises BadInput for images:TREE, which draws no cloud but those of its export; for an unknown
    id, with the nearest known one in the message; for an unknown parameter or value; for weights
    that are missing or in another format; for a package that announces a method which it does not
    contain; and where `module_method` does.
    """
    if method_id.startswith(IMAGES_PREFIX):
        raise BadInput(
            f"{method_id}: images of an export, which cannot draw other clouds; give them to "
            "'bench run' of a suite that scores images"
        )
    if (setting := find_setting(method_id)) is not None:
        parameter, value = setting
        method = find(parameter.method, METHODS, "method")
        source = f"{method.id} with {parameter.name} {value:g}"
        load = partial(method.load, **{parameter.field or parameter.name: value})
        return replace(method, id=method_id, load=load, source=source)
    family, weights = family_of(method_id), variant_of(method_id)
    package, suffix = _WITH_WEIGHTS_FILE.get(family), Path(weights).suffix
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
            sizes=next(m.sizes for m in METHODS if m.family == family),
        )
    for method in BUNDLED:
        if method.id == method_id:
            return method
    if method_id in announced("method"):
        return _plugin(method_id)
    if is_module_name(method_id):
        return module_method(method_id)
    if package and suffix:
        raise BadInput(f"{weights}: weights are .safetensors files; '{package.command}' writes one")
    raise unknown(method_id, [*(method.id for method in BUNDLED), *announced("method")], "method")


def is_foreign(method_id: str) -> bool:
    """Return whether drawing with a method executes code that is not this project's."""
    return method_id in announced("method") or is_module_name(method_id)


@cache
def _plugin(method_id: str) -> Method:
    """Return the method of another package, with checksums of its files in its identity."""
    type_name = "bench.methods.Method"
    method = load_entry_point("method", method_id, Method, type_name, OUR_FAMILIES)

    def identity() -> str:
        folder = entry_point_folder("method", method_id)
        files = declared_files(method_id, method.declared_files, folder)
        return with_files(method.identity(), files)

    return replace(method, identity=identity)


def objectives(methods: Iterable[Method]) -> dict[str, str]:
    """Return the training losses of networks by method id, leaving out methods without weights."""
    from learning.weights import objective_of

    losses = {}
    for method in methods:
        if method.weights_file is not None:
            losses[method.id] = objective_of(method.weights_file())
    return losses


def role(method_id: str) -> str:
    """Return the role of a row of tables: `Method.role` of its method, or "chosen".

    The role "chosen" is that of the chosen rows (`bench.catalogue.chosen`). A row has the role ""
    where its method competes with others, and where its method is not known here.
    """
    if method_id in CHOSEN:
        return "chosen"
    method = known_method(method_id)
    return method.role if method else ""


def training_objects(method_id: str, manifest: Mapping[str, Any]) -> str:
    """Return what a method of a run was trained on, such as "chairs"; "" where it is not known.

    For a method that was run elsewhere it is what its author claims in the manifest.
    """
    from bench.catalogue.images import entered_claims

    if claims := entered_claims(manifest, method_id):
        return claims.trained_on
    method = known_method(method_id)
    if method is None or method.trained_on is None:
        return ""
    return method.trained_on


def known_method(method_id: str) -> Method | None:
    """Return the method with this id; None where its weights or its package are not here."""
    try:
        return find_method(method_id)
    except BadInput:
        return None
