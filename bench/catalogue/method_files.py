"""The files that the images of a method MODULE:NAME depend on, as far as this project can tell.

Checksums of these files are a part of the method's identity. So when one of them changes, its
images are drawn again. They are the sources of the module, the other files of its package, the
files and folders whose paths stand as texts in these sources, and the files that the method
declares (`Method.files`). A file that the method finds in another way is missed; a run tells its
user so (`told_files`).
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

# The packages of this project. Their sources are left out: a version that is increased by hand
# stands for them in the keys of jobs.
PROJECT = {"bench", "data_prep", "learning", "baselines", "pc2pix", "results"}
_CODE_SUFFIXES = (".py", ".pyc")  # the suffixes of files that are code, and so no data files
# The files by which the folder of a run is recognised. It is left out, for it changes in each run.
_RUN_FILES = {"manifest.json", "lock"}
MOST_FILES = 1_000  # files of a folder; one with more is a data set and no part of a method
_MOST_NAMED = 5  # files that a line for people names
_MOST_TEXT = 255  # characters of a text that may be a path; longer ones are not looked up
_REMEDY = "name them in `files` of the method (docs/extending.md)"


@cache  # once a process, so that it stays that of the code which this process has loaded
def source_sha256(module: str) -> str:
    """Return the checksum of the names and contents of `source_files`."""
    digest = sha256()
    for file in source_files(module):
        digest.update(f"{file.name} {sha256(file.read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()


def source_files(module: str) -> list[Path]:
    """Return the files of source code that make up a module, sorted.

    They are the file of the module, or all files of its package. Where it lies in the current
    folder, they are also the files of the modules and packages of that folder which it imports,
    directly or through others, at the top of a file or within functions.
    """
    return sorted({file for root in _code_roots(module) for file in _code_in(root)})


def _code_roots(module: str) -> list[Path]:
    """Return the files of modules and the folders of packages that `source_files` lie in.

    The first is the module itself, or the package that it belongs to.
    """
    top = module.partition(".")[0]
    spec = find_spec(top)
    assert spec is not None, "the module was loaded"
    queue = [Path(path) for path in spec.submodule_search_locations or [str(spec.origin)]]
    if not queue[0].exists():
        raise BadInput(
            f"{module}: has no file of source code, and without one a run cannot tell whether its "
            "images are still the same; import it in a module of your own and name that one"
        )
    folder = Path.cwd()
    follows_imports = _is_here(queue[0])
    seen, roots = {top, *PROJECT}, list[Path]()
    while queue:
        root = queue.pop()
        roots.append(root)
        if not follows_imports:
            continue
        imported = {name for file in _code_in(root) for name in _read_source(file).imported}
        for name in imported - seen:
            candidates = (folder / name, folder / f"{name}.py")
            queue += [path for path in candidates if path.exists()]
        seen |= imported
    return roots


def _is_here(path: Path) -> bool:
    """Return whether a module or package lies in the current folder itself."""
    return path.resolve().parent == Path.cwd().resolve()


def _code_in(path: Path) -> list[Path]:
    """Return the Python files below a folder, or the file itself."""
    return sorted(path.rglob("*.py")) if path.is_dir() else [path]


class _Source(NamedTuple):
    """The modules that a file of Python imports, and the texts in it."""

    imported: frozenset[str]  # the first part of the dotted name of each imported module
    texts: frozenset[str]  # the string literals, any of which may be a path


@cache  # once a process, so that it stays that of the code which this process has loaded
def _read_source(file: Path) -> _Source:
    """Return the imports and texts of a file of Python.

    There are none for a file with another suffix, and for one with a syntax error.
    """
    imported, texts = set[str](), set[str]()
    with suppress(SyntaxError, ValueError):  # such a file fails when the method imports it
        for node in ast.walk(ast.parse(file.read_bytes() if file.suffix == ".py" else b"")):
            if isinstance(node, ast.Import):
                imported.update(alias.name.partition(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                imported.add(node.module.partition(".")[0])
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                texts.add(node.value)
    return _Source(frozenset(imported), frozenset(texts))


class DataFiles(NamedTuple):
    """The files, other than its source code, that the images of a method depend on."""

    files: tuple[Path, ...]
    left_out: tuple[Path, ...]  # folders with too many files or bytes, which are not in `files`


def data_files(name: str, declared: Sequence[str | Path] = ()) -> DataFiles:
    """Return the files beside its source code that the images of MODULE:NAME depend on, sorted.

    They are the other files of its package; the files whose paths, from the current folder, stand
    as texts in its source, and all files below a folder whose path does; and the files in
    `declared`. Hidden files, caches and folders of runs are left out, and so is a folder with more
    than MOST_FILES files or MOST_BYTES bytes. Raises BadInput for a declared file that is missing.
    """
    roots, folder = _code_roots(name.partition(":")[0]), Path.cwd()
    wanted = {root.resolve() for root in roots if root.is_dir()}
    if _is_here(roots[0]):
        for root in roots:
            for source in _code_in(root):
                wanted.update(_named_paths(source, folder))
    files, left_out = set[Path](), list[Path]()
    for path in sorted(wanted):
        below = _files_below(path)
        if below is None:
            left_out.append(path)
        else:
            files.update(below)
    module_folder = roots[0] if roots[0].is_dir() else roots[0].parent
    files.update(declared_files(name, declared, module_folder))
    return DataFiles(tuple(sorted(files)), tuple(left_out))


def declared_files(name: str, declared: Sequence[str | Path], folder: Path) -> list[Path]:
    """Return the files that a method declares, with absolute paths, sorted.

    Relative paths are from `folder`, that of the method's module. Raises BadInput for a path that
    is not a file.
    """
    for path in declared:
        if not (folder / path).is_file():
            raise BadInput(
                f"{name}: declares the file {folder / path}, which is not there; put it there, or "
                "take it out of `files` of the method"
            )
    return sorted((folder / path).resolve() for path in declared)


def _named_paths(file: Path, folder: Path) -> Iterator[Path]:
    """Yield the files, and the folders below `folder`, whose paths are texts in a source file.

    Relative paths are from `folder`.
    """
    for text in _read_source(file).texts:
        if not text.isprintable() or not 0 < len(text) < _MOST_TEXT:
            continue
        path = folder / text
        with suppress(OSError):  # a path that is too long, or a folder without permission
            if path.is_file() or (path.is_dir() and folder.resolve() in path.resolve().parents):
                yield path.resolve()


def _files_below(path: Path) -> list[Path] | None:
    """Return the data files at a path: the file itself, or all files below the folder.

    Code, empty files and what is no regular file are left out; files of /proc always seem empty.
    None where the files are too many or too large.
    """
    files, size = list[Path](), 0
    for file in _walk(path):
        with suppress(OSError):  # the file may have been removed since its folder was read
            status = file.stat()
            is_data = file.suffix not in _CODE_SUFFIXES and stat.S_ISREG(status.st_mode)
            if not is_data or status.st_size == 0:
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
        if _RUN_FILES.issubset(names):
            folders.clear()
            continue
        folders[:] = [name for name in folders if not is_hidden(name)]
        yield from (Path(folder) / name for name in names if not is_hidden(name))


def with_files(identity: str, files: Sequence[Path]) -> str:
    """Return an identity, extended by a checksum of the names and contents of files if any.

    Raises BadInput where `file_sha256` does.
    """
    if not files:
        return identity
    lines = "".join(f"{file.name} {file_sha256(file)}\n" for file in files)
    checksum = sha256(lines.encode("utf-8", "surrogateescape")).hexdigest()
    return f"{identity} files {checksum}".strip()


def known_by(name: str, stated: str, declared: Sequence[str | Path]) -> str:
    """Return the identity of the method MODULE:NAME.

    It is the identity that the method itself has `stated`, the checksum of its source, and that of
    its data files if it has any.
    """
    module = name.partition(":")[0]
    text = f"{stated} source {source_sha256(module)}".strip()
    return with_files(text, data_files(name, declared).files)


def told_files(name: str, declared: Sequence[str | Path]) -> str:
    """Return a line that tells the user which files the identity of MODULE:NAME takes into account.

    It also says that other files are not seen, and what the author can do about it.
    """
    files, left_out = data_files(name, declared)
    line = f"{name}: known by its source {_in_words(files)}; "
    if left_out:
        paths = ", ".join(map(str, left_out))
        line += f"{paths} left out, of more than {MOST_FILES} files or {MOST_BYTES >> 30} GiB; "
    return f"{line}other files that it reads are not seen: {_REMEDY}"


def _in_words(files: Sequence[Path]) -> str:
    """Return the end of the phrase "known by its source ...", which names the first files."""
    if not files:
        return "alone"
    folder = Path.cwd().resolve()
    shown = []
    for file in files[:_MOST_NAMED]:
        is_below = file.is_relative_to(folder)
        shown.append(str(file.relative_to(folder)) if is_below else str(file))
    text = f"and {', '.join(shown)}"
    if len(files) > len(shown):
        text += f" and {len(files) - len(shown)} more"
    return text
