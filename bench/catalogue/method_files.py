"""The files that a method MODULE:NAME is known by, so that a change of one has its work done again.

They are the sources of the module, the other files of its package, the files and folders that the
texts in its sources name, and those that the method declares (`Method.files`). A file that it
finds in another way is not seen, which `told_files` says.
"""

from __future__ import annotations

import ast
import os
import stat
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from data_prep.failures import BadInput
from data_prep.files.checksums import MOST_BYTES, file_sha256
from data_prep.files.safe_read import is_hidden

# Packages of this project; versions in the keys of jobs stand for their code.
PROJECT = {"bench", "data_prep", "learning", "baselines", "pc2pix", "results"}
_SUFFIXES = (".py", ".pyc")  # of what is code, or made of it
_OF_A_RUN = {"manifest.json", "lock"}  # are in the folder of each run, which grows by being used
MOST_FILES = 1_000  # in a folder: more are a data set and no part of a method
_MOST_NAMED = 5  # files in a line for people
_MOST_TEXT = 255  # characters of a text that may be a path
_REMEDY = "name them in `files` of the method (docs/extending.md)"


@cache  # as of the module that this process has loaded
def source_sha256(module: str) -> str:
    """Return the checksum of the source of a module and of what it imports from its folder."""
    digest = sha256()
    for file in source_files(module):
        digest.update(f"{file.name} {sha256(file.read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()


def source_files(module: str) -> list[Path]:
    """Return the files behind a module, sorted.

    These are the module or all files of its package, and, where these are in the current folder,
    the modules and packages of that folder that they import, at the top or within functions.
    """
    return sorted({file for place in _places(module) for file in _code_in(place)})


def _places(module: str) -> list[Path]:
    """Return the files of modules and the folders of packages that are behind a module."""
    top = module.partition(".")[0]
    spec = find_spec(top)
    assert spec is not None, "the module was loaded"
    queue = [Path(place) for place in spec.submodule_search_locations or [str(spec.origin)]]
    if not queue[0].exists():
        raise BadInput(f"{module}: has no source, by which a run knows its images; wrap it")
    folder, seen, places = Path.cwd(), {top, *PROJECT}, list[Path]()
    is_here = _is_here(queue[0])
    while queue:
        place = queue.pop()
        places.append(place)
        if not is_here:
            continue
        names = {name for file in _code_in(place) for name in _read_source(file).imported} - seen
        beside = (path for name in names for path in (folder / name, folder / f"{name}.py"))
        queue += (path for path in beside if path.exists())
        seen |= names
    return places


def _is_here(place: Path) -> bool:
    """Return whether a module or package lies in the current folder."""
    return place.resolve().parent == Path.cwd().resolve()


def _code_in(place: Path) -> list[Path]:
    return sorted(place.rglob("*.py")) if place.is_dir() else [place]


class _Source(NamedTuple):
    """The modules and paths that a file of Python names."""

    imported: frozenset[str]  # the first part of the name of each module
    texts: frozenset[str]  # that may be paths


@cache  # as of the module that this process has loaded
def _read_source(file: Path) -> _Source:
    """Return what a file of Python says; nothing of another file, or of one with an error."""
    imported, texts = set[str](), set[str]()
    with suppress(SyntaxError, ValueError):  # it fails when it is imported, if it ever is
        for node in ast.walk(ast.parse(file.read_bytes() if file.suffix == ".py" else b"")):
            if isinstance(node, ast.Import):
                imported.update(alias.name.partition(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                imported.add(node.module.partition(".")[0])
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                texts.add(node.value)
    return _Source(frozenset(imported), frozenset(texts))


class DataFiles(NamedTuple):
    """The files beside its source that a method is known by, and what is left out as too much."""

    files: tuple[Path, ...]
    left_out: tuple[Path, ...]


def data_files(name: str, declared: Sequence[str | Path] = ()) -> DataFiles:
    """Return the files that MODULE:NAME is known by beside its source, sorted.

    These are the other files of its package, those that a text in its source names by a path from
    the current folder, all below a folder that is so named, and those that are declared. Hidden
    files, caches and folders of runs are no part of it, and a folder with more than MOST_FILES
    files or MOST_BYTES bytes is left out. Raises BadInput for a declared file that is missing.
    """
    places, folder = _places(name.partition(":")[0]), Path.cwd()
    wanted = {place.resolve() for place in places if place.is_dir()}
    if _is_here(places[0]):
        sources = [file for place in places for file in _code_in(place)]
        wanted |= {path for file in sources for path in _named_paths(file, folder)}
    files, left_out = set[Path](), list[Path]()
    for path in sorted(wanted):
        if (below := _files_below(path)) is None:
            left_out.append(path)
        else:
            files.update(below)
    of_module = places[0] if places[0].is_dir() else places[0].parent
    files.update(declared_files(name, declared, of_module))
    return DataFiles(tuple(sorted(files)), tuple(left_out))


def declared_files(name: str, declared: Sequence[str | Path], folder: Path) -> list[Path]:
    """Return the paths that a method declares, relative ones from the folder of its module.

    Raises BadInput for one that is no file.
    """
    for path in declared:
        if not (folder / path).is_file():
            raise BadInput(
                f"{name}: declares the file {folder / path}, which is not there; bring it back"
            )
    return sorted((folder / path).resolve() for path in declared)


def _named_paths(file: Path, folder: Path) -> Iterator[Path]:
    """Yield the files, and the folders below `folder`, that a text in a source is the path of."""
    for text in _read_source(file).texts:
        if not text.isprintable() or not 0 < len(text) < _MOST_TEXT:
            continue
        path = folder / text
        with suppress(OSError):  # a name that is too long, a folder that may not be searched
            if path.is_file() or (path.is_dir() and folder.resolve() in path.resolve().parents):
                yield path.resolve()


def _files_below(path: Path) -> list[Path] | None:
    """Return a file, or all of a folder, that are data; None where they are too many or too large.

    Empty files have nothing to be known by, and those of /proc are always empty.
    """
    files, size = list[Path](), 0
    for file in _walk(path):
        with suppress(OSError):  # it was there just now
            status = file.stat()
            if file.suffix in _SUFFIXES or not stat.S_ISREG(status.st_mode) or not status.st_size:
                continue
            files.append(file)
            size += status.st_size
        if len(files) > MOST_FILES or size > MOST_BYTES:
            return None
    return files


def _walk(path: Path) -> Iterator[Path]:
    if not path.is_dir():
        yield path
        return
    for folder, folders, names in os.walk(path):
        if _OF_A_RUN.issubset(names):
            folders.clear()
            continue
        folders[:] = [name for name in folders if not is_hidden(name)]
        yield from (Path(folder) / name for name in names if not is_hidden(name))


def with_files(identity: str, files: Sequence[Path]) -> str:
    """Return an identity with a checksum of the names and contents of files, where there are any.

    Raises BadInput as `file_sha256`.
    """
    if not files:
        return identity
    lines = "".join(f"{file.name} {file_sha256(file)}\n" for file in files)
    checksum = sha256(lines.encode("utf-8", "surrogateescape")).hexdigest()
    return f"{identity} files {checksum}".strip()


def known_by(name: str, stated: str, declared: Sequence[str | Path]) -> str:
    """Return the identity of MODULE:NAME: what it states, its source, and its files if any."""
    module = name.partition(":")[0]
    text = f"{stated} source {source_sha256(module)}".strip()
    return with_files(text, data_files(name, declared).files)


def told_files(name: str, declared: Sequence[str | Path]) -> str:
    """Return in a line which files MODULE:NAME is known by, and that others are not seen."""
    files, left_out = data_files(name, declared)
    line = f"{name}: known by its source {_in_words(files)}; "
    if left_out:
        paths = ", ".join(map(str, left_out))
        line += f"{paths} left out, of more than {MOST_FILES} files or {MOST_BYTES >> 30} GiB; "
    return f"{line}other files that it reads are not seen: {_REMEDY}"


def _in_words(files: Sequence[Path]) -> str:
    if not files:
        return "alone"
    folder = Path.cwd().resolve()
    shown = [
        str(file.relative_to(folder)) if file.is_relative_to(folder) else str(file)
        for file in files[:_MOST_NAMED]
    ]
    more = len(files) - len(shown)
    return f"and {', '.join(shown)}" + (f" and {more} more" if more else "")
