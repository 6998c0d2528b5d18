from __future__ import annotations

import io
import struct

import numpy as np
import pytest

from data_prep.files.file_kinds import mismatch

PLY = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
OBJ = b"# Blender\n\no Cube\nv 1 2 3\nv 4 5 6\n"
PCD = b"# .PCD v0.7 - Point Cloud Data\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\n"
OLD_PCD = b"COLUMNS x y z\nSIZE 4 4 4\nTYPE F F F\n"
STL = b"solid leg\n  facet normal 0 0 1\n"
GLTF = b'{"scenes": [{"nodes": [0]}], "asset": {"version": "2.0"}}'
GLB = b"glTF" + struct.pack("<2I", 2, 1000)
NPY = io.BytesIO()
np.save(NPY, np.zeros((2, 3)))
WEB_PAGE = "a web page, which stands for the file; download the file itself"
POINTER = "a Git LFS pointer, which stands for the file; fetch it with 'git lfs pull'"


@pytest.mark.parametrize(
    ("start", "suffix", "problem"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", ".ply", POINTER),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", ".glb", POINTER),
        (
            b"/annex/objects/MD5E-s3--0.ply\n",
            ".ply",
            "a git-annex pointer, which stands for the file; fetch it with 'git annex get'",
        ),
        (b"<!DOCTYPE html><html><head>", ".ply", WEB_PAGE),
        (b"\xef\xbb\xbf\r\n<HTML lang=en>\r\n", ".las", WEB_PAGE),
        ("<html>\n".encode("utf-16"), ".txt", WEB_PAGE),
        (b'<?xml version="1.0"?>\n<VTKFile>', ".xyz", "XML; export it as .xyz"),
        (b"<Error>\n<Code>AccessDenied</Code>", ".e57", "XML; export it as .e57"),
        (b'<svg width="2">', ".obj", "XML; export it as .obj"),
        (b"\x1f\x8b\x08\0\0", ".csv", "packed by GZIP; unpack it"),
        (b"\x1f\x8b\x08" + bytes(200), ".stl", "packed by GZIP; unpack it"),  # no binary STL
        (b"BZh91AY&SY\xaa", ".npy", "packed by BZIP2; unpack it"),
        (b"\xfd7zXZ\0\0", ".ply", "packed by XZ; unpack it"),
        (b"\x28\xb5\x2f\xfd\0", ".pcd", "packed by Zstandard; unpack it"),
        (b"7z\xbc\xaf\x27\x1c", ".stl", "packed by 7-Zip; unpack it"),
        (b"Rar!\x1a\x07\0", ".obj", "packed by RAR; unpack it"),
        (
            b"PK\x03\x04\0\0",
            ".csv",
            "a ZIP, as XLSX, NPZ and 3MF are, too; unpack it, or export it as .csv",
        ),
        (
            b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1",
            ".csv",
            "an old file of Excel or Word; export it as .csv",
        ),
        (b"%PDF-1.7\n", ".txt", "a PDF; export it as .txt"),
        (b"\x89PNG\r\n\x1a\n", ".npy", "a PNG picture; export it as .npy"),
        (b"\xff\xd8\xff\xe0\0\x10JFIF", ".ply", "a JPEG picture; export it as .ply"),
        (b"\x89HDF\r\n\x1a\n", ".las", "an HDF5 file; export it as .las"),
        (b"MATLAB 5.0 MAT-file, Pl", ".txt", "a MAT-file of MATLAB; export it as .txt"),
        (b"Kaydara FBX Binary  \0", ".obj", "an FBX; export it as .obj"),
        (b"BLENDER-v300", ".obj", "a file of Blender; export it as .obj"),
        (PLY, ".OBJ", "a PLY by its contents; name it .ply"),
        (PLY, ".xyz", "a PLY by its contents; name it .ply"),
        (OBJ, ".xyz", "an OBJ by its contents; name it .obj"),
        (b"mtllib a.mtl\nusemtl b\n", ".off", "an OBJ by its contents; name it .obj"),
        (b"v 1 2 3\n", ".stl", "an OBJ by its contents; name it .obj"),
        (b"OFF\n3 1 0\n", ".xyz", "an OFF by its contents; name it .off"),
        (b"COFF # of a scan\n3 1 0\n", ".obj", "an OFF by its contents; name it .off"),
        (b"OFF490 518 0\n", ".txt", "an OFF by its contents; name it .off"),
        (
            b"OFF BINARY\n\0\0\0\3",
            ".off",
            "a binary OFF, which is not read; export it as an OFF of text, or as PLY",
        ),
        (PCD, ".txt", "a PCD by its contents; name it .pcd"),
        (OLD_PCD, ".ply", "a PCD by its contents; name it .pcd"),
        (STL, ".obj", "an STL by its contents; name it .stl"),
        (b"LASF" + bytes(300), ".pcd", "a LAS by its contents; name it .las"),
        (b"ASTM-E57\1\0\0\0", ".ply", "an E57 by its contents; name it .e57"),
        (NPY.getvalue(), ".xyz", "an NPY by its contents; name it .npy"),
        (GLB, ".gltf", "a GLB by its contents; name it .glb"),
        (GLTF, ".glb", "a glTF by its contents; name it .gltf"),
        (
            b"glTF\1\0\0\0",
            ".glb",
            "a glTF 1.0, which is not read; convert it to glTF 2.0",
        ),
        (b'{"points": [[1, 2, 3]]}', ".txt", "JSON by its contents; export it as .txt"),
        (b"[[1, 2, 3]]", ".txt", "JSON, or an array as NumPy prints it; export it as .txt"),
        (b"[ 1.5  2. ]", ".csv", "JSON, or an array as NumPy prints it; export it as .csv"),
        (b"", ".ply", "an empty file; fetch or write it again"),
    ],
)
def test_what_a_file_really_is_and_the_remedy(start: bytes, suffix: str, problem: str) -> None:
    assert mismatch(start, suffix) == problem


@pytest.mark.parametrize(
    ("start", "suffix"),
    [
        (PLY, ".ply"),
        (PLY.replace(b"\n", b"\r"), ".PLY"),
        (OBJ, ".obj"),
        (b"f -1 -2 -3\n", ".obj"),
        (PCD, ".pcd"),
        (OLD_PCD, ".pcd"),
        (STL, ".stl"),
        (b"OFF2STL <html> solid facet".ljust(80) + struct.pack("<I", 1) + bytes(50), ".stl"),
        (b"OFF 3 facets".ljust(80) + struct.pack("<I", 1) + bytes(50), ".stl"),
        (b"# solid facet\nOFF\n3 1 0\n", ".off"),
        (b"LASF" + bytes(300), ".las"),
        (b"LASF" + bytes(300), ".laz"),
        (b"ASTM-E57\1\0\0\0", ".e57"),
        (NPY.getvalue(), ".npy"),
        (GLB, ".glb"),
        (GLTF, ".gltf"),
        (b'{"nodes": []}', ".gltf"),
        (b"# nothing\n", ".xyz"),
        (b"1 2 3\n", ".txt"),
        ("x\ty\tz\n1\t2\t3\n".encode("utf-16"), ".txt"),
        (b"[x],[y],[z]\n1,2,3\n", ".csv"),
        (b"<x> <y> <z>\n1 2 3\n", ".txt"),
        (b"OFF x y z\n1 2 3 4\n", ".txt"),
        (b"VERSION x y z\n1 2 3 4\n", ".txt"),
        (b"COLUMNS: x y z\n1 2 3\n", ".txt"),
        (b"v x y z\n0 1 2 3\n", ".txt"),
        (b"s x y z\n0 1 2 3\n", ".txt"),
        (b"solid x y z\n0 1 2 3\n", ".txt"),
    ],
)
def test_nothing_speaks_against_a_good_file(start: bytes, suffix: str) -> None:
    assert mismatch(start, suffix) is None
