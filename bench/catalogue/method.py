"""The type of a method, and how a method of a module that is not installed is loaded.

A user names such a method MODULE:NAME; the module may be a file in the current folder. Loading the
method executes the module. So a module is loaded only where a command line names it
(`allow_modules`). The manifest of a run can name a module, too; but a manifest may come from
anywhere, and a module that only a manifest names is never executed.
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

# The sides in pixels of the images that a method which draws surfaces or discs can draw.
ANY_SIZE = range(16, 2049)
# The environment variable with the names MODULE:NAME that a command line has allowed, with commas
# between them. Worker processes inherit it, as they inherit `sys.path`.
ALLOWED = "PC2PIX_BENCH_MODULES"
IMAGES_PREFIX = "images:"  # begins the name of a folder of images on the command line: images:TREE
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
