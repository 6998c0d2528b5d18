"""Folders as archives and systems leave them: recognised, or refused with the cause."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from data_prep.datasets.folder import BareCloud
from data_prep.datasets.registry import open_dataset, recognised
from data_prep.datasets.training_set import training_clouds
from data_prep.failures import BadInput
from data_prep.files.clouds import clouds_below
from data_prep.files.safe_read import files_below

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n"
CONTENTS = {
    ".off": "OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n",
    ".obj": OBJ,
    ".json": '[{"synsetId": "02747177", "name": "ashcan,trash can"}]',
    ".xyz": "0 0 0\n1 0 0\n0 1 0\n0 0 1\n",
}
MAC = ("._{}", "__MACOSX/x/._{}", ".DS_Store")


def plant(root: Path, *files: str) -> Path:
    for file in files:
        path = root / file
        path.parent.mkdir(parents=True, exist_ok=True)
        hidden = path.name.startswith("._")
        path.write_text("Mac OS X" if hidden else CONTENTS.get(path.suffix, "x"))
    return root


MODELNET = ("chair/train/chair_0001.off", "chair/test/chair_0890.off", "table/test/table_0393.off")
V1 = ("03001627/1a/model.obj", "03001627/1a/model.mtl", "02747177/1b/model.obj")
V2 = ("03001627/2a/models/model_normalized.obj", "03001627/2a/images/texture0.jpg")


def under(folder: str, *files: str) -> tuple[str, ...]:
    return tuple(f"{folder}/{file}" for file in files)


RECOGNISED = {
    "ModelNet10 and its README": (
        (*MODELNET, "README.txt"), "modelnet:", {"chair": 2, "table": 1}),
    "the parent of ModelNet10, packed on a Mac": (
        (*under("ModelNet10", *MODELNET), "ModelNet10/README.txt", "ModelNet10/.DS_Store",
         *under("__MACOSX/ModelNet10", *MODELNET), "ModelNet10/chair/test/._chair_0890.off"),
        "modelnet:/ModelNet10", {"chair": 2, "table": 1}),
    "ModelNet40 nested twice": (
        (*under("archive/ModelNet40", *MODELNET), "archive/metadata_modelnet40.csv"),
        "modelnet:/archive/ModelNet40", {"chair": 2, "table": 1}),
    "manually aligned, without splits": (
        under("modelnet40_manually_aligned", "chair/chair_0001.off", "chair/chair_0002.off"),
        "modelnet:/modelnet40_manually_aligned", {"chair": 2}),
    "with split lists": (
        ("modelnet10_train.txt", "modelnet10_test.txt", "chair/chair_0001.off"), "modelnet:",
        {"chair": 1}),
    "monitor is display": (
        ("monitor/test/monitor_0466.off", "chair/test/chair_0890.off"), "modelnet:",
        {"display": 1, "chair": 1}),
    "ShapeNetCore.v1": ((*V1, "taxonomy.json"), "shapenet:", {"ashcan": 1, "chair": 1}),
    "ShapeNetCore.v2 nested twice": (
        under("ShapeNetCore.v2/ShapeNetCore.v2", *V2),
        "shapenet:/ShapeNetCore.v2/ShapeNetCore.v2", {"chair": 1}),
    "v1 beside v2 in one synset": ((*V1, *V2), "shapenet:", {"chair": 2, "02747177": 1}),
    "synsets that are empty or unknown": (
        (*V2, "02691156/.keep", "00000001/z/model.obj", "02828884/1/images/a.png"), "shapenet:",
        {"00000001": 1, "chair": 1}),
    "a folder of images and of lists beside": (
        (*V2, "images/a.png", "screenshots/03001627/2a.png", "all.txt"), "shapenet:", {"chair": 1}),
    "Objaverse": (
        ("000-000/aaaa.obj", "000-001/bbbb.obj", "object-paths.json.gz", "000-000/.cache/c.obj"),
        "folder:", {"000-000": 1, "000-001": 1}),
    "Synology, Windows, Jupyter, git, ext4": (
        ("chair/a.obj", "chair/@eaDir/a.obj", "chair/Thumbs.db", "chair/desktop.ini",
         "chair/.ipynb_checkpoints/a.obj", ".git/a.obj", "lost+found/a.obj", "@eaDir/b.obj",
         "System Volume Information/a.obj", "$RECYCLE.BIN/a.obj", "#recycle/a.obj",
         "@Recycle/a.obj", "chair/#snapshot/a.obj", "chair/~$a.obj"),
        "folder:", {"chair": 1}),
    "a Mac's chairs": (
        ("chair/a.obj", "chair/b.obj", "chair/._a.obj", "__MACOSX/chair/._a.obj", "._chair"),
        "folder:", {"chair": 2}),
    "a class of ModelNet": (
        under("up", *MODELNET[:2]), "modelnet:/up", {"chair": 2}),
    "a split of a class of ModelNet": (
        under("up", *MODELNET[:2]), "modelnet:/up", {"chair": 2}),
    "a synset": (under("up", *V2), "shapenet:/up", {"chair": 1}),
}  # fmt: skip
ASKED = {
    "a class of ModelNet": "up/chair",
    "a split of a class of ModelNet": "up/chair/train",
    "a synset": "up/03001627",
}


@pytest.mark.parametrize("case", RECOGNISED)
def test_a_tree_is_recognised_with_its_option(tmp_path: Path, case: str) -> None:
    files, option, counts = RECOGNISED[case]
    plant(tmp_path, *files)
    kind, _, place = option.partition(":")
    expected = f"{kind}:{tmp_path}{place}"
    asked = tmp_path / ASKED.get(case, "")
    assert recognised(str(asked)) == expected
    dataset = open_dataset(expected)
    objects = [obj.class_name for obj in dataset.finite or ()]
    assert {name: objects.count(name) for name in dict.fromkeys(objects)} == counts
    for obj in dataset.finite or ():
        assert np.isfinite(obj.load().vertices).all()
    for other in ("folder", "modelnet", "shapenet", "paper", "exported"):
        if (other, asked) == (kind, tmp_path / place.strip("/")):
            continue
        with pytest.raises(BadInput) as refusal:
            open_dataset(f"{other}:{asked}")
        if kind != "folder":
            assert f"give --dataset {expected}" in str(refusal.value)


REFUSED = {
    "a zip of Windows": (
        ("ModelNet10\\chair\\train\\chair_0001.off", "ModelNet10\\a.txt"), "backslashes.*unzip"),
    "a zip of Windows within": (("a/chair\\test\\b.off",), "backslashes.*unzip"),
    "iCloud": (("chair/a.obj", "chair/.b.obj.icloud"), r"\.b\.obj\.icloud.*iCloud; download it"),
    "v1 and v2": (
        (*under("ShapeNetCore.v1", *V1), *under("ShapeNetCore.v2", *V2)),
        "several datasets.*shapenet:.*v1, shapenet:.*v2"),
    "two ModelNets": (
        (*under("ModelNet10", *MODELNET), *under("ModelNet40", *MODELNET)), "several datasets"),
    "splits of meshes": (
        ("train/chair/a.obj", "test/chair/b.obj"), r"splits \(test, train\).*folder:.*/test"),
    "packed": (("ModelNet10.zip", "README.txt"), r"no mesh.*it has ModelNet10\.zip, README"),
    "nothing but what a Mac leaves": (("._a.obj", "__MACOSX/._a.obj", ".DS_Store"), "no mesh"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_a_tree_is_refused_with_the_cause(tmp_path: Path, case: str) -> None:
    files, cause = REFUSED[case]
    plant(tmp_path, *files)
    with pytest.raises(BadInput, match=cause):
        open_dataset(recognised(str(tmp_path)))
    if cause.startswith("several"):
        with pytest.raises(BadInput, match=r"give --dataset .* or "):
            open_dataset(f"folder:{tmp_path}")


def test_what_is_left_out_is_named_once(tmp_path: Path) -> None:
    plant(tmp_path / "meshes", "chair/a.obj", "chair/a.mtl", "chair/a.npz", "labels.csv")
    (tmp_path / "meshes" / "table").symlink_to("chair")
    left_out = "chair/a.npz, labels.csv, table"
    assert open_dataset(f"folder:{tmp_path / 'meshes'}").left_out == left_out
    clouds = plant(tmp_path / "clouds", "a.xyz", "b/._b.xyz", "a.obj", "b/c.stl", ".DS_Store")
    (clouds / "README.txt").write_text("Clouds of 2024: 3 chairs\n\n1. scanned by hand\n")
    (clouds / "labels.csv").write_text("id,class,points,colour\n1,chair,2048,red\n")
    (clouds / "b" / "names.csv").write_text('"x (m)";"y (m)";"z (m)"\n"1.5";"2";"-3e-1"\n')
    (clouds / "wide.txt").write_text("0 0 0\n1 0 0\n", encoding="utf-16")
    files, others = clouds_below(clouds)
    assert [file.name for file in files] == ["a.xyz", "names.csv", "wide.txt"]
    assert others == ("README.txt", "a.obj", "b/c.stl", "labels.csv")


def test_walks_end(tmp_path: Path, monkeypatch) -> None:
    folder = plant(tmp_path, "a/a.obj", "a/b/b.obj")
    (folder / "a" / "up").symlink_to("..")
    (folder / "a" / "disk").symlink_to("/")
    (folder / "a" / "self").symlink_to("self")
    os.mkfifo(folder / "a" / "pipe.obj")
    (folder / "a" / "zero.obj").symlink_to("/dev/zero")
    assert [path.name for path in files_below(folder, (".obj",))[0]] == ["a.obj", "b.obj"]
    for spec in ("folder:/", f"folder:{folder}/a/disk", "modelnet:/", "shapenet:/../"):
        with pytest.raises(BadInput, match="a whole disk; give the folder"):
            open_dataset(spec)
    monkeypatch.setattr("data_prep.files.safe_read.MOST_ENTRIES", 5)
    with pytest.raises(BadInput, match=r"more than 5 files and folders.*give a folder"):
        open_dataset(f"folder:{folder}")


def test_clouds_of_several_sizes_are_refused(tmp_path: Path) -> None:
    for name, count in (("a", 5000), ("b", 9000), ("c", 3000)):
        points = np.random.default_rng(1).random((count, 3))
        np.save(tmp_path / f"{name}.npy", points)
    clouds = [BareCloud("chair", f"{n}.npy", tmp_path / f"{n}.npy") for n in "abc"]
    assert training_clouds(clouds[:2], quiet=True).shape == (2, 4096, 3)
    message = r"chair/c\.npy: 3000 points, and a\.npy has 4096.*give clouds of one size, or of at"
    with pytest.raises(BadInput, match=message):
        training_clouds(clouds, quiet=True)
