"""The methods of the benchmark: their type, the table `methods.csv`, their variants, and modules.

A method of a module that is not installed is MODULE:NAME; it is loaded when it is named.
"""

from __future__ import annotations

import csv
import math
import os
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from bench.catalogue import loaders  # it imports no slow package, so that `bench list` is fast
from bench.catalogue.chosen import CHOSEN
from bench.catalogue.lookup import family_of, find, variant_of
from bench.catalogue.method_files import declared_files, known_by, with_files
from bench.entered.claims import IMAGES_PREFIX, entered_claims, read_claims
from data_prep.failures import BadInput, unknown
from data_prep.files.safe_read import is_regular_file
from data_prep.plugins import announced, entry_point_folder, load_entry_point

if TYPE_CHECKING:
    from bench.entered.tree import ImageTree
    from data_prep.scene import Renderer

Kind = Literal["", "reconstruction", "network", "splat", "reference"]
Color = Literal["", "none", "invented", "true"]

# The sides in pixels of the images that a method which draws surfaces or discs can draw.
ANY_SIZE = range(16, 2049)
# The environment variable with the names MODULE:NAME that a command line has allowed, with commas
# between them. Worker processes inherit it, as they inherit `sys.path`.
ALLOWED = "PC2PIX_BENCH_MODULES"
# A name MODULE:NAME, both parts with or without dots. What begins with "images:" is none.
NAME = re.compile(rf"(?!{IMAGES_PREFIX})[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*(\.[^\W\d]\w*)*")


@dataclass(frozen=True)
class Method:
    """A renderer with an id, and what is known about it.

    Attributes
    ----------
    id : str
        Kebab-case; a variant follows its method's id and "@".
    load : callable
        Returns the renderer for a device: "auto", "cpu" or "cuda".
    identity : callable
        Returns as text what else its images depend on: the versions of its libraries, the
        checksum of its weights.
    version : int
        Increase this number by hand with a change of the code that changes its images. Images
        that were drawn with another version are then drawn again.
    source : str
        One line about what it does and where it comes from.
    sees_mesh : bool
        Whether it draws the mesh behind the cloud, as only the ceiling does.
    sees_cloud : bool
        Whether its images depend on the cloud. If not, they are the same under every condition
        and drawn once.
    weights_file : callable or None
        Finds the file of weights of a network.
    trained_on : str or None
        The objects that a network has seen: "chairs", "13 classes" or "nothing"; free text for a
        method entered by images. None means unknown, as for weights in a file.
    kind : str
        "reconstruction", "network", "splat" or "reference" (blank, constant and true-mesh); ""
        means unknown.
    color : str
        The colours of its images: "none" (grey), "invented" (guessed by a network) or "true" (of
        the mesh); "" means unknown.
    sizes : sequence of int
        Sides in pixels of the images that it draws, in ascending order: 128, as a suite scores
        them, and others for which its renderer's `draw` takes the keyword `size`. For further sizes
        images are resampled.
    files : sequence of str or Path
        Files beside its code that the images of a method of another package or module depend on,
        such as weights; relative paths are from the folder of the module. Their contents are a part
        of its identity.
    images : ImageTree or None
        The images of a method that was run elsewhere; it draws only clouds of an export, and its
        times are claimed.
    """

    id: str
    load: Callable[[str], Renderer]
    identity: Callable[[], str]
    version: int
    source: str
    sees_mesh: bool = False
    sees_cloud: bool = True
    weights_file: Callable[[], Path] | None = None
    trained_on: str | None = None
    kind: Kind = ""
    color: Color = ""
    sizes: Sequence[int] = (128,)
    files: Sequence[str | Path] = ()
    images: ImageTree | None = None

    def __post_init__(self) -> None:
        sizes = self.sizes
        are_whole = isinstance(sizes, Sequence) and all(isinstance(side, int) for side in sizes)
        if not are_whole or 128 not in sizes or list(sizes) != sorted({*sizes}) or sizes[0] < 1:
            raise BadInput(
                f"method '{self.id}': sizes {sizes!r}; give whole numbers in ascending order, 128 "
                "among them, such as (128, 512)"
            )
        is_sequence = isinstance(self.files, (tuple, list))
        if not is_sequence or not all(isinstance(path, (str, Path)) for path in self.files):
            raise BadInput(
                f"method '{self.id}': files {self.files!r:.60}; give a tuple of paths, such as "
                "('weights.npz',)"
            )

    @property
    def address(self) -> str:
        """Return the text by which a run finds the method.

        It is the id; for a method that was run elsewhere it is "images:" and the folder of images.
        """
        return self.images.address if self.images else self.id

    @property
    def declared_files(self) -> tuple[str | Path, ...]:
        """Return the paths in `files`, followed by the file of weights if the method has one."""
        if self.weights_file is None:
            return tuple(self.files)
        return (*self.files, self.weights_file())

    @property
    def family(self) -> str:
        """Return the id without its variant; a family has one colour and marker in plots."""
        return family_of(self.id)

    def drawn_at(self, size: int) -> int:
        """Return the side in pixels of the images that the method draws for images of `size`.

        It is the smallest of `sizes` that is not less than `size`, or else the largest.
        """
        return next((side for side in self.sizes if side >= size), self.sizes[-1])

    @property
    def role(self) -> str:
        """Return the role of the method in comparisons.

        "ceiling" is a method that draws the true mesh, "floor" a reference method that does not see
        the cloud. A method that competes with others has the role "".
        """
        if self.sees_mesh:
            return "ceiling"
        return "floor" if self.kind == "reference" and not self.sees_cloud else ""


def is_module_name(name: str) -> bool:
    """Return whether a name has the form MODULE:NAME."""
    return NAME.fullmatch(name) is not None


def allow_modules(names: Iterable[str]) -> None:
    """Allow this process and its workers to load those of `names` that are MODULE:NAME."""
    modules = [name for name in names if is_module_name(name)]
    if modules:
        os.environ[ALLOWED] = ",".join(dict.fromkeys([*_allowed(), *modules]))
        search_folder()


def search_folder() -> None:
    """Allow this process and its workers to import modules of the current folder."""
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.append(folder)  # at the end, so that no file of it hides an installed module


def _allowed() -> list[str]:
    return list(filter(None, os.environ.get(ALLOWED, "").split(",")))


def check_module(name: str) -> None:
    """Raise BadInput where Python does not find the module of MODULE:NAME. It is not executed."""
    package = name.partition(":")[0].partition(".")[0]
    if not package.isidentifier() or find_spec(package) is None:
        raise BadInput(
            f"{name}: no module '{package}' in this folder or among the installed packages; "
            "give MODULE:NAME, or the name of a dataset and its folder"
        )


def load_object(module: str, path: str) -> Any:
    """Import a module and return the object at a dotted path in it.

    Raises BadInput where the module has no such object. Whatever importing the module raises is
    passed on.
    """
    import numpy as np

    with np.errstate():  # undoes a module's own `np.seterr`, as `load_entry_point` does
        target: Any = import_module(module)
    for part in path.split("."):
        if not hasattr(target, part):
            raise BadInput(
                f"{module} has no '{path}'; give the name of a method in it, as in {module}:NAME"
            )
        target = getattr(target, part)
    return target


def as_method(target: Any, name: str) -> Method | None:
    """Return an object of a module as a method; None where it is not usable as one.

    A class or an object with the functions `prepare` and `draw` becomes a method of this `name`.
    """
    if isinstance(target, Method):
        return target
    if not all(callable(getattr(target, function, None)) for function in ("prepare", "draw")):
        return None
    module = name.partition(":")[0]
    files = getattr(target, "files", ())
    load = partial(_instance, target)
    return Method(name, load, identity=str, version=1, source=module, files=files)


def _instance(target: Any, device: str) -> Any:
    """Return an object that draws: an instance of a class, or the object itself.

    Each worker process makes its own instance.
    """
    del device  # an author whose class needs the device wraps it in a Method
    return target() if isinstance(target, type) else target


@cache
def module_method(name: str) -> Method:
    """Return the method MODULE:NAME. Its identity has checksums of its source and its files.

    Raises BadInput for a name that no command line has allowed, for a module that cannot be loaded,
    and for an object that is not usable as a method.
    """
    if name not in _allowed():
        raise BadInput(
            f"{name}: is of a module, which only a command line that names it executes, as with "
            "--methods of 'bench run'; name it there, or install its package"
        )
    check_module(name)
    module, _, path = name.partition(":")
    try:
        target = load_object(module, path)
    except BadInput:
        raise
    except (Exception, SystemExit) as error:  # a module may raise anything
        raise BadInput(
            f"{name}: its module cannot be loaded ({type(error).__name__}: {error}); "
            f"'bench test {name}' shows where in its code"
        ) from error
    if (method := as_method(target, name)) is None:
        raise BadInput(
            f"{name}: is a {type(target).__name__}; expected a Method, or a class with the "
            "functions prepare and draw"
        )
    return replace(
        method,
        id=name,
        identity=lambda: known_by(name, method.identity(), method.declared_files),
    )


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
    sizes     the sides in pixels of its images, "any" for ANY_SIZE, or the least with a "+", as in
              "128+", for all from there on
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
        fields["sizes"] = _sizes(sizes)
        fields |= {"version": int(version)} | _BY_HAND.get(row["id"], {})
        yield Method(**row, **fields)


def _sizes(text: str) -> Sequence[int]:
    """Return the sides in pixels that the table's column `sizes` names."""
    if text == "any":
        return ANY_SIZE
    if text.endswith("+"):
        return range(int(text.removesuffix("+")), ANY_SIZE.stop)
    return tuple(map(int, text.split()))


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

    Raises BadInput where `find_method` or `entered_method` does.
    """
    if not address.startswith(IMAGES_PREFIX):
        return find_method(address)
    taken = OUR_FAMILIES | {family_of(id_) for id_ in announced("method")}
    return entered_method(Path(address.removeprefix(IMAGES_PREFIX)), taken)


def entered_method(folder: Path, taken: Collection[str]) -> Method:
    """Return the method whose images are in a folder; `taken` are ids that it must not have.

    Its images are in the keys of jobs, and its identity is the version that the author states.
    Raises BadInput as `bench.entered.claims.read_claims`.
    """
    from bench.entered.tree import ImageTree  # it imports NumPy, which `bench list` does not need

    root = folder.absolute()
    claims = read_claims(root, taken)
    tree = ImageTree(root, claims)
    return Method(
        claims.name,
        load=partial(_entered_images, tree),
        identity=partial(str, f"{claims.version or 'no version'}, entered by images"),
        version=1,
        source=claims.about,
        trained_on=claims.trained_on,
        images=tree,
    )


def _entered_images(tree: ImageTree, device: str) -> ImageTree:
    del device  # nothing is computed
    return tree


def find_method(method_id: str) -> Method:
    """Return the method with this id.

    The id is one of the table or of an installed package, or has one of these forms:
    `pc2pix@FILE.safetensors`, a network of `_WITH_WEIGHTS_FILE` with a user's own weights;
    `METHOD@PARAMETER=VALUE`, a method with a value for one of `PARAMETERS`; `MODULE:NAME`, a method
    of a module that the command line names (`bench.catalogue.methods.module_method`).

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
