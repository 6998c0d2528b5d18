"""The type of a method, and methods of modules that are not installed, by MODULE:NAME.

Such a module is a file in the current folder, say. To find its method is to execute it. So only the
names that a command line gives are found (`allow_modules`). A manifest, which may come from
anywhere, can name a module as well, and nothing of it is executed.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from bench.catalogue.lookup import family_of
from bench.catalogue.method_files import known_by
from data_prep.failures import BadInput

if TYPE_CHECKING:
    from bench.catalogue.images import ImageTree
    from data_prep.scene import Renderer

Kind = Literal["", "reconstruction", "network", "splat", "reference"]
Color = Literal["", "none", "invented", "true"]

ANY_SIZE = range(16, 2049)  # of an image, by the methods that draw surfaces or discs
# The names that a command has allowed. Worker processes inherit it, as they do `sys.path`.
ALLOWED = "PC2PIX_BENCH_MODULES"
IMAGES = "images:"  # of a folder of images on the command line, as in "images:TREE"
NAME = re.compile(rf"(?!{IMAGES})[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*(\.[^\W\d]\w*)*")


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
        Raised by hand when a change alters its images; finished work is then done again.
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
        whole = isinstance(sizes, Sequence) and all(isinstance(side, int) for side in sizes)
        if not whole or 128 not in sizes or list(sizes) != sorted({*sizes}) or sizes[0] < 1:
            raise BadInput(
                f"method '{self.id}': sizes {sizes!r}; give whole numbers in ascending order, 128 "
                "among them, such as (128, 512)"
            )
        listed = isinstance(self.files, (tuple, list))
        if not listed or not all(isinstance(path, (str, Path)) for path in self.files):
            raise BadInput(
                f"method '{self.id}': files {self.files!r:.60}; give a tuple of paths, such as "
                "('weights.npz',)"
            )

    @property
    def address(self) -> str:
        """Return the text by which a run finds the method: its id, or where its images are."""
        return self.images.address if self.images else self.id

    @property
    def declared_files(self) -> tuple[str | Path, ...]:
        """Return its `files`, and its file of weights."""
        if self.weights_file is None:
            return tuple(self.files)
        return (*self.files, self.weights_file())

    @property
    def family(self) -> str:
        """Return the id without its variant; it fixes colour and marker in every plot."""
        return family_of(self.id)

    def drawn_at(self, size: int) -> int:
        """Return the side of the images that it draws where ones of `size` are wanted."""
        return next((side for side in self.sizes if side >= size), self.sizes[-1])

    @property
    def role(self) -> str:
        """Return "ceiling", "floor" (a reference method that sees no cloud) or "" (competes)."""
        if self.sees_mesh:
            return "ceiling"
        return "floor" if self.kind == "reference" and not self.sees_cloud else ""


def is_module_name(name: str) -> bool:
    """Return whether a name has the form MODULE:NAME."""
    return NAME.fullmatch(name) is not None


def allow_modules(names: Iterable[str]) -> None:
    """Let this process and its workers load the names of the form MODULE:NAME among `names`."""
    if modules := [name for name in names if is_module_name(name)]:
        os.environ[ALLOWED] = ",".join(dict.fromkeys([*_allowed(), *modules]))
        search_folder()


def search_folder() -> None:
    """Let this process and its workers import modules of the current folder."""
    if (folder := str(Path.cwd())) not in sys.path:
        sys.path.append(folder)  # last: no file of this folder hides an installed module


def _allowed() -> list[str]:
    return list(filter(None, os.environ.get(ALLOWED, "").split(",")))


def check_module(name: str) -> None:
    """Raise BadInput where the module of a name MODULE:NAME is not there; load nothing."""
    package = name.partition(":")[0].partition(".")[0]
    if not package.isidentifier() or find_spec(package) is None:
        raise BadInput(
            f"{name}: no module '{package}' in this folder or among the installed packages; "
            "give MODULE:NAME, or the name of a dataset and its folder"
        )


def load_object(module: str, path: str) -> Any:
    """Return the object at a dotted path of a module; what its module raises goes on.

    Raises BadInput where the module has no such object.
    """
    import numpy as np

    with np.errstate():  # as in `data_prep.plugins.load_entry_point`
        target: Any = import_module(module)
    for part in path.split("."):
        if not hasattr(target, part):
            raise BadInput(f"{module} has no '{path}'; give a name in it")
        target = getattr(target, part)
    return target


def as_method(target: Any, name: str) -> Method | None:
    """Return a method, or a class or an object that draws as a method; None for another object."""
    if isinstance(target, Method):
        return target
    if not all(callable(getattr(target, function, None)) for function in ("prepare", "draw")):
        return None
    module = name.partition(":")[0]
    files = getattr(target, "files", ())
    load = partial(_instance, target)
    return Method(name, load, identity=str, version=1, source=module, files=files)


def _instance(target: Any, device: str) -> Any:
    """Return an object that draws: a class is instantiated, in each worker anew."""
    del device  # a class that needs it is wrapped in a Method
    return target() if isinstance(target, type) else target


@cache
def module_method(name: str) -> Method:
    """Return the method MODULE:NAME; checksums of its source and files are a part of its identity.

    Raises BadInput for a name that no command has allowed, a module that cannot be loaded, and an
    object that is no method.
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
            f"'bench test {name}' says more"
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
