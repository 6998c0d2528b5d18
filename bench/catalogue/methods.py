"""The methods of the benchmark, a row of `methods.csv` each, and their variants.

Other packages add methods by entry points of the group `pc2pix_bench.methods`: the name is the
method's id, the object a `Method`.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

from bench.catalogue import loaders  # no package that is slow to import: `bench list` needs this
from bench.catalogue.chosen import CHOSEN
from bench.catalogue.lookup import family_of, find, variant_of
from bench.catalogue.method import ANY_SIZE, IMAGES, Method, is_module_name, module_method
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
_BY_HAND: dict[str, dict[str, Any]] = {  # what rows cannot say
    "open3d-poisson": {"identity": loaders.open3d_identity},
    "true-mesh@grey": {"load": partial(loaders.renderer, "reference:TrueMesh", coloured=False)},
    "constant": {"load": loaders.constant, "identity": loaders.constant_identity},
}


def _rows() -> list[dict[str, Any]]:
    with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


# The methods that a reader should choose from, with what for.
CHOOSE_FOR: dict[str, str] = {row["id"]: row["choose_for"] for row in _rows() if row["choose_for"]}


def _methods() -> Iterator[Method]:
    """Yield the methods of the table.

    sees      mesh, as only the ceiling does; cloud; or nothing, with the same images always
    version   raised by hand when a change alters its images; "" for that of its package
    sizes     of its images in pixels, or any
    renderer  of a network the package (`_WITH_WEIGHTS_FILE`), else a class below `baselines`
    needs     of a network the name of its weights, else the libraries that its images depend on
    """
    for row in _rows():
        renderer, needs, version = row.pop("renderer"), row.pop("needs"), row.pop("version")
        sees, sizes, _ = row.pop("sees"), row.pop("sizes"), row.pop("choose_for")
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
# Methods that nobody would draw with, but whose cost is measured beside the others.
COST_VARIANTS = (
    replace(
        METHODS[0],
        id="pc2pix@paper",
        load=loaders.paper_width,
        source="pc2pix with an untrained generator of the paper's width, for its cost alone",
    ),
)
RECOMMENDED = "fused-net@grey"  # for a cloud of an unknown object: docs/trade.md
RECOMMENDED_IN_COLOUR = "fused-net"  # the same where colours are asked for
BUNDLED = (*METHODS, *COST_VARIANTS)
# The first ones stand where the id of a method stands: they are no ids for methods of others.
OUR_FAMILIES = {"ground-truth", *CHOSEN, *_WITH_WEIGHTS_FILE} | {m.family for m in BUNDLED}
FLOOR = "blank"
PAPERS_CHAIN = {"surface-apss", "surface-fit", "surface-bpa"}  # or a part of it
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


class _Setting(NamedTuple):
    """A parameter and its value."""

    parameter: Parameter
    value: float


def find_setting(method_id: str) -> _Setting | None:
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
    return _Setting(parameter, value)


def find_run_method(address: str) -> Method:
    """Return a method of a run: by its id, or with the images in a folder, as "images:TREE".

    Raises BadInput as `find_method`, and as `bench.catalogue.images.entered_method`.
    """
    if not address.startswith(IMAGES):
        return find_method(address)
    from bench.catalogue.images import entered_method

    taken = OUR_FAMILIES | {family_of(id_) for id_ in announced("method")}
    return entered_method(Path(address.removeprefix(IMAGES)), taken)


def find_method(method_id: str) -> Method:
    """Return the method with this id, or a variant of one, that draws any cloud.

    `pc2pix@FILE.safetensors` and the like (_WITH_WEIGHTS_FILE) have weights of your own,
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
    """Return whether drawing with a method executes code of others than this project."""
    return method_id in announced("method") or is_module_name(method_id)


@cache
def _plugin(method_id: str) -> Method:
    named = "bench.methods.Method"
    method = load_entry_point("method", method_id, Method, named, OUR_FAMILIES)

    def identity() -> str:
        folder = entry_point_folder("method", method_id)
        files = declared_files(method_id, method.declared_files, folder)
        return with_files(method.identity(), files)

    return replace(method, identity=identity)


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


def known_method(method_id: str) -> Method | None:
    """Return the method with this id; None if its weights file or its package is gone."""
    try:
        return find_method(method_id)
    except BadInput:
        return None
