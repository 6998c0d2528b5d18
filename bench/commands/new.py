"""`bench new`: a package to start from, which is one of `examples` under another name."""

from __future__ import annotations

import keyword
import shutil
import tempfile
from enum import StrEnum
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from bench.catalogue.plugins import OUR_IDS
from bench.commands.options import path_option
from bench.records.folder import not_writable
from data_prep.failures import BadInput, CannotWrite
from data_prep.plugins import announced, is_id


class PluginKind(StrEnum):
    """The kinds of plug-ins that `bench new` writes."""

    method = "method"
    metric = "metric"
    dataset = "dataset"


class _Template(NamedTuple):
    """A package in `examples`.

    id       the id of its plug-in in kebab-case, in whose place the new id is written; the module
             has the same name with underscores
    tested   what follows "MODULE:" in the name that `bench test` takes for the plug-in
    further  the files beside README.md, pyproject.toml, the module and its test
    """

    id: str
    tested: str
    further: tuple[str, ...] = ()


TEMPLATES = {
    PluginKind.method: _Template("convex-hull", "METHOD"),
    PluginKind.metric: _Template("pixel-error", "METRIC"),
    PluginKind.dataset: _Template(
        "mesh-list",
        "DATASET:sample",
        ("sample/objects.csv", "sample/cube.ply", "sample/tall.ply"),
    ),
}


def new(
    kind: Annotated[PluginKind, typer.Argument(help="The kind of plug-in.")],
    name: Annotated[
        str,
        typer.Argument(metavar="NAME", help="Id of the plug-in in kebab-case, as in my-method."),
    ],
    out: Annotated[Path | None, path_option("The new folder. Default: NAME.")] = None,
) -> None:
    """Write a package to start from, which passes 'bench test' and can be installed with pip."""
    _check_id(kind, name)
    folder = out or Path(name)
    written = write_package(kind, name, folder)
    print(f"{folder}: {', '.join(written)}")
    print(f"next: cd {folder}; bench test {_module_of(name)}:{TEMPLATES[kind].tested}")


def _module_of(id_: str) -> str:
    """Return the name of a plug-in's module: its id with underscores for hyphens."""
    return id_.replace("-", "_")


def _check_id(kind: PluginKind, id_: str) -> None:
    """Raise BadInput for an id that no plug-in can have, or whose module would not be found."""
    module = _module_of(id_)
    if not is_id(id_):
        problem = f"an id is kebab-case (a-z, 0-9 and single hyphens), as in my-{kind}"
    elif id_ in OUR_IDS[kind]:
        problem = "pc2pix-bench uses that id itself"
    elif id_ in announced(kind):
        problem = "an installed package has that id"
    elif not module.isidentifier() or keyword.iskeyword(module):
        problem = f"Python cannot import a module '{module}'"
    elif module == "images" or find_spec(module) is not None:  # "images:TREE" names a folder
        problem = f"'{module}' is the name of another module or form already"
    else:
        return
    raise BadInput(f"{id_}: {problem}; give another NAME")


def write_package(kind: PluginKind, id_: str, folder: Path) -> list[str]:
    """Write the example package of a kind under another id into a new folder; return its files.

    Raises BadInput where the folder exists already, and CannotWrite where it cannot be written. In
    both cases no part of it is left behind.
    """
    if folder.exists() or folder.is_symlink():
        raise BadInput(f"{folder}: exists already; give another folder with --out")
    template = TEMPLATES[kind]
    module = _module_of(template.id)
    names = ("pyproject.toml", f"{module}.py", f"test_{module}.py", "README.md", *template.further)
    source, written = files("bench") / "examples" / str(kind), []
    try:
        temporary = Path(tempfile.mkdtemp(dir=folder.parent, prefix=".bench-new-"))
    except OSError as error:
        raise CannotWrite(
            f"{folder}: cannot be made ({error.strerror}); give another folder with --out"
        ) from error
    try:
        for name in names:
            text = source.joinpath(*name.split("/")).read_text(encoding="utf-8")
            renamed = _renamed(name, template.id, id_)
            (temporary / renamed).parent.mkdir(exist_ok=True)
            (temporary / renamed).write_text(_renamed(text, template.id, id_), encoding="utf-8")
            written.append(renamed)
        temporary.chmod(0o755)  # a temporary folder is made with 0o700, closed to others
        temporary.rename(folder)
    except OSError as error:
        raise not_writable(folder, error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return written


def _renamed(text: str, before: str, id_: str) -> str:
    return text.replace(before, id_).replace(_module_of(before), _module_of(id_))
