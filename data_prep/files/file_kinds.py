"""The kinds of files, told by their first bytes, whatever their names say."""

from __future__ import annotations

import json
import re
from typing import NamedTuple

START_BYTES = 4096  # how much of a file `mismatch` looks at

_RENAME = "name it {suffix}"
_UNPACK = "unpack it"
_EXPORT = "export it as {wanted}"


class _Kind(NamedTuple):
    """A kind of file.

    pattern   what its start matches
    name      what it is, with an article
    suffixes  the names that it may have; () for kinds that nothing here reads
    remedy    what to do where its name is another one; {suffix} stands for the first of its
              suffixes, {wanted} for the one that it has
    """

    pattern: str
    name: str
    suffixes: tuple[str, ...] = ()
    remedy: str = _EXPORT


# Matched with the bytes of a file, each of which stands for one character.
_BY_BYTES = (
    _Kind(
        "version https?://(?:git-lfs|hawser)",
        "a Git LFS pointer, which stands for the file",
        remedy="fetch it with 'git lfs pull'",
    ),
    _Kind(
        "/annex/objects/",
        "a git-annex pointer, which stands for the file",
        remedy="fetch it with 'git annex get'",
    ),
    _Kind(r"\x1f\x8b", "packed by GZIP", remedy=_UNPACK),
    _Kind("BZh[1-9]1AY&SY", "packed by BZIP2", remedy=_UNPACK),
    _Kind(r"\xfd7zXZ\0", "packed by XZ", remedy=_UNPACK),
    _Kind(r"\x28\xb5\x2f\xfd", "packed by Zstandard", remedy=_UNPACK),
    _Kind(r"7z\xbc\xaf\x27\x1c", "packed by 7-Zip", remedy=_UNPACK),
    _Kind(r"Rar!\x1a\x07", "packed by RAR", remedy=_UNPACK),
    _Kind(
        r"PK(?:\x03\x04|\x05\x06)",
        "a ZIP, as XLSX, NPZ and 3MF are, too",
        remedy=f"{_UNPACK}, or {_EXPORT}",
    ),
    _Kind(r"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an old file of Excel or Word"),
    _Kind("%PDF-", "a PDF"),
    _Kind(r"\x89PNG\r\n", "a PNG picture"),
    _Kind(r"\xff\xd8\xff", "a JPEG picture"),
    _Kind(r"\x89HDF\r\n", "an HDF5 file"),
    _Kind("MATLAB 5.0 MAT-file", "a MAT-file of MATLAB"),
    _Kind("Kaydara FBX Binary", "an FBX"),
    _Kind("BLENDER", "a file of Blender"),
    _Kind(r"glTF\x01\0\0\0", "a glTF 1.0, which is not read", remedy="convert it to glTF 2.0"),
    _Kind("glTF", "a GLB", (".glb",), _RENAME),
    _Kind("LASF", "a LAS", (".las", ".laz"), _RENAME),
    _Kind("ASTM-E57", "an E57", (".e57",), _RENAME),
    _Kind(r"\x93NUMPY", "an NPY", (".npy",), _RENAME),
    _Kind(r"(?:\xef\xbb\xbf)?ply[ \t]*[\r\n]", "a PLY", (".ply",), _RENAME),
    _Kind(
        r"(?:ST)?C?N?4?n?OFF[ \t]+BINARY",
        "a binary OFF, which is not read",
        remedy="export it as an OFF of text, or as PLY",
    ),
)
# Matched with the text behind the comments at the beginning. More is asked for than a bracket or a
# word, as columns may have the names [x], <x> and OFF.
_TAG = r"[A-Za-z][\w:.-]*"
_BY_TEXT = (
    _Kind(
        r"(?i:<!doctype\s+html|<(?:html|head|body)\b)",
        "a web page, which stands for the file",
        remedy="download the file itself",
    ),
    _Kind(rf"<[!?]|<{_TAG}\s+[\w:.-]+\s*=|<{_TAG}>(?:\s*[\r\n]\s*)?<", "XML"),
    _Kind(r'\{(?=.*"(?:asset|accessors|bufferViews)"\s*:)', "a glTF", (".gltf",), _RENAME),
    _Kind(r'\{\s*["}]', "JSON", (".gltf",)),
    _Kind(r'\[\s*[-+.\d"\[{]', "JSON, or an array as NumPy prints it"),
    _Kind(r"(?:ST)?C?N?4?n?OFF[ \t]*[\r\n#\d]", "an OFF", (".off",), _RENAME),
    _Kind(r"(?i:solid\b.*?\bfacet\s)", "an STL", (".stl",), _RENAME),
    _Kind(
        r"v[ \t]+[-+.\d]|mtllib[ \t]|(?:o|g|s|usemtl)[ \t].*?[\r\n][ \t]*v[ \t]+[-+.\d]",
        "an OBJ",
        (".obj",),
        _RENAME,
    ),
    _Kind(
        r"(?i:VERSION[ \t]+v?0?\.\d|(?:FIELDS|COLUMNS)[ \t].*?[\r\n](?:SIZE|TYPE|DATA)[ \t])",
        "a PCD",
        (".pcd",),
        _RENAME,
    ),
)
_PACKED = tuple(kind for kind in _BY_BYTES if kind.remedy.startswith(_UNPACK))
_COMMENTS = re.compile(r"\s*(?:(?:#|//|%)[^\r\n]*\s*)*")


def mismatch(start: bytes, suffix: str) -> str | None:
    """Return what a file is, and the remedy, where its name says something else.

    It is the rest of a sentence behind "PATH: ", such as "packed by GZIP; unpack it"; None where
    nothing speaks against the name. What is not known is left to the readers.

    start   the first `START_BYTES` bytes of the file, or all of a shorter one
    suffix  the suffix of its name, such as ".ply", in any case
    """
    suffix = suffix.lower()
    if not start:
        return "an empty file; fetch or write it again"
    # A binary STL begins with any 80 bytes, which may be the words of another format.
    is_binary_stl = suffix == ".stl" and b"\0" in start[80:]
    kind = _first(_PACKED if is_binary_stl else _BY_BYTES, start.decode("latin-1"))
    if kind is None and not is_binary_stl:
        text = start.decode(json.detect_encoding(start[:4]), "replace")
        kind = _first(_BY_TEXT, _COMMENTS.sub("", text, count=1))
    if kind is None or suffix in kind.suffixes:
        return None
    contents = f"{kind.name} by its contents" if kind.suffixes else kind.name
    return f"{contents}; {kind.remedy}".format(suffix="".join(kind.suffixes[:1]), wanted=suffix)


def _first(kinds: tuple[_Kind, ...], text: str) -> _Kind | None:
    """Return the first of the kinds whose pattern the beginning of a text matches."""
    return next((kind for kind in kinds if re.match(kind.pattern, text, re.DOTALL)), None)
