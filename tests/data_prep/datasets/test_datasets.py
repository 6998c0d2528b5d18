"""Datasets by their names: what is in them, folders as archives and systems leave them, and all
that is refused, with its cause."""

from __future__ import annotations

import os
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import data_prep
from data_prep.clouds.orientations import PAPER
from data_prep.datasets import procedural, registry
from data_prep.datasets.folder import BareCloud
from data_prep.datasets.protocol_version import CHANGES, PROTOCOL_VERSION
from data_prep.datasets.registry import (
    Dataset,
    DatasetReader,
    ProceduralObject,
    open_dataset,
    recognised,
)
from data_prep.datasets.stored_meshes import MeshFile
from data_prep.datasets.synsets import CLASS_OF, SYNSETS, class_names
from data_prep.datasets.training_set import training_clouds
from data_prep.failures import BadInput
from data_prep.files.clouds import clouds_below
from data_prep.files.safe_read import files_below
from data_prep.randomness import generator
from data_prep.scene import Mesh
from data_prep.shapes.catalogue import CLASSES, FAMILIES, NOVEL_CLASSES, NOVEL_FAMILIES

ROOT = Path(data_prep.__file__).parents[1]


def ids(dataset: Dataset, class_name: str, limit: int | None = None, split=None) -> list[str]:
    return [obj.object_id for obj in dataset.objects(class_name, limit, 5, split)]


def bytes_of(mesh: Mesh) -> bytes:
    return b"|".join(a.tobytes() for a in (mesh.vertices, mesh.faces, mesh.face_colors))


# --- procedural -----------------------------------------------------------------------------------


def test_the_procedural_set_has_no_end_and_its_splits_share_no_object() -> None:
    dataset = open_dataset("procedural")
    assert dataset.finite is None
    assert dataset.classes == tuple(CLASSES)
    assert ids(dataset, "chair", 3) == ["test-0000", "test-0001", "test-0002"]
    assert len(ids(dataset, "chair")) == 5
    assert ids(dataset, "chair", 0) == []
    assert ids(dataset, "chair", 12346, "train")[-1] == "train-12345"
    assert ids(open_dataset("procedural:validation"), "chair", 1) == ["validation-0000"]
    splits = ("train", "validation", "test")
    objects = [obj for split in splits for obj in dataset.objects("vessel", 3, 0, split=split)]
    assert "procedural-1/vessel/test-0000" in {obj.fingerprint() for obj in objects}
    for what in (lambda o: o.fingerprint(), lambda o: o.object_id, lambda o: bytes_of(o.load())):
        assert len(set(map(what, objects))) == 9
    novel = open_dataset("procedural:novel-families")
    assert novel.classes == tuple(NOVEL_CLASSES) == ("chair",)
    assert not set(NOVEL_FAMILIES["chair"]) & set(FAMILIES["chair"])
    mesh = NOVEL_CLASSES["chair"].draw(generator("procedural", "chair", "novel-families", 0)).mesh()
    assert bytes_of(novel.objects("chair", 1, 9)[0].load()) == bytes_of(mesh)


@pytest.mark.parametrize("kind", ["widened", "relief"])
def test_shapes_for_training_are_in_the_train_split_alone(kind: str) -> None:
    dataset = open_dataset(f"procedural:{kind}")
    first, second = dataset.objects("chair", 2, 9, "train")
    assert first.object_id == f"{kind}-00000"
    assert second.fingerprint() == f"procedural-1/chair/{kind}-00001"
    assert bytes_of(first.load()) != bytes_of(second.load())
    other = (ProceduralObject("chair", "validation", 0),)
    assert dataset.objects("chair", 1, 9, "validation") == other


def test_the_sealed_split_is_another_in_each_version_of_the_protocol(monkeypatch) -> None:
    prefix = f"sealed-{PROTOCOL_VERSION}-"
    assert ids(open_dataset("procedural:sealed"), "chair", 2) == [f"{prefix}0000", f"{prefix}0001"]
    sealed = ProceduralObject("chair", "sealed", 3)
    before = bytes_of(sealed.load())
    # Without the salt it would be drawn by whoever writes down its name.
    named = CLASSES["chair"].draw(generator("procedural", "chair", "sealed", 3)).mesh()
    assert before != bytes_of(named)
    assert sealed.fingerprint() == f"procedural-1/chair/{prefix}0003"
    monkeypatch.setattr(procedural, "PROTOCOL_VERSION", PROTOCOL_VERSION + 1)
    assert bytes_of(sealed.load()) != before
    assert sealed.fingerprint() == f"procedural-1/chair/sealed-{PROTOCOL_VERSION + 1}-0003"


OPENS_THE_SEALED = {  # its definition, and the list of datasets
    *(f"data_prep/datasets/{name}.py" for name in ("procedural", "registry", "objects")),
    *("data_prep/datasets/protocol_version.py", "bench/commands/listing.py"),
    "studies/figures.py",  # draws the stored results, and opens no dataset
    "studies/measurements.py",  # the final measurement of a version of the protocol
}


def test_no_training_study_or_default_takes_the_sealed_split() -> None:
    packages = ("bench", "pc2pix", "baselines", "learning", "data_prep", "studies", "examples")
    files = [file for package in packages for file in (ROOT / package).rglob("*.py")]
    files += [ROOT / name for name in ("Makefile", "tox.ini", "pyproject.toml", ".ci/run")]
    named = {str(f.relative_to(ROOT)) for f in files if "sealed" in f.read_text("utf-8").lower()}
    assert named == OPENS_THE_SEALED
    for spec in ("procedural:sealed", "procedural:novel-families"):  # what a training gets of it
        assert ids(open_dataset(spec), "chair", 1, "train") == ["train-0000"]


def test_the_page_names_the_last_version_of_the_protocol_and_what_it_changed() -> None:
    assert [*CHANGES] == [*range(1, PROTOCOL_VERSION + 1)]
    text = (ROOT / "docs" / "protocol.md").read_text(encoding="utf-8")
    assert f"This is version {PROTOCOL_VERSION} of the protocol" in text
    assert re.findall(r"^### Protocol (\d+)$", text, re.MULTILINE) == [str(PROTOCOL_VERSION)]


def test_names_of_classes() -> None:
    assert len(SYNSETS) == len(CLASS_OF) == 13
    assert all(len(synset) == 8 and synset.isdecimal() for synset in CLASS_OF)
    assert set(CLASSES) == set(SYNSETS)
    expected = {
        "03001627": ("whatever", "chair"),
        "02747177": ("ashcan,trash can", "ashcan"),
        "02773838": ("", "02773838"),
        "00000001": ("chair,electric chair", "00000001"),  # not the chair of the 13
        "00000002": ("twin", "twin"),
        "00000003": ("twin,other", "00000003"),
    }
    names = class_names({synset: given for synset, (given, _) in expected.items()})
    assert names == {synset: name for synset, (_, name) in expected.items()}


# --- folders --------------------------------------------------------------------------------------

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n"
CONTENTS = {
    ".off": "OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n",
    ".obj": OBJ,
    ".json": '[{"synsetId": "02747177", "name": "ashcan,trash can"}]',
    ".xyz": "0 0 0\n1 0 0\n0 1 0\n0 0 1\n",
}


def plant(root: Path, *files: str | tuple[str, str]) -> Path:
    """Write files of these names, or names and contents; those of meshes can be read."""
    for file in files:
        name, text = (file, None) if isinstance(file, str) else file
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        usual = "Mac OS X" if path.name.startswith("._") else CONTENTS.get(path.suffix.lower(), "x")
        path.write_text(usual if text is None else text)
    return root


def test_subfolders_are_classes_and_flat_folders_have_none(tmp_path: Path, monkeypatch) -> None:
    plant(tmp_path, "lamp/b.obj", "lamp/a.obj", "chair/x/y.obj", "chair/z.OBJ", "chair/notes.txt")
    (tmp_path / "empty").mkdir()
    (tmp_path / "lamp" / "folder.obj").mkdir()
    dataset = open_dataset(f"folder:{tmp_path}")
    assert (dataset.id, dataset.classes) == (f"folder:{tmp_path}", ("chair", "lamp"))
    assert ids(dataset, "lamp") == ["a.obj", "b.obj"]
    assert ids(dataset, "chair") == ["x/y.obj", "z.OBJ"]
    assert {obj.class_name for obj in dataset.objects("chair", None, 5)} == {"chair"}
    monkeypatch.setenv("HOME", str(tmp_path))
    flat = open_dataset("folder:~/lamp")
    assert flat.classes == ()
    # The endless source's limit does not count here, and all splits are one.
    for limit, split, count in ((None, None, 2), (1, None, 1), (0, None, 0), (99, "train", 2)):
        assert ids(flat, "whatever", limit, split) == ["a.obj", "b.obj"][:count]
    assert {obj.class_name for obj in flat.finite} == {"lamp"}


def test_meshes_are_found_by_their_formats_and_read_when_they_are_needed(tmp_path: Path) -> None:
    (tmp_path / "sub.ply").mkdir()
    names = ("a.ply", "b.obj", "c.off", "d.stl", "e.glb", "f.gltf")
    plant(tmp_path, *names, "g.xyz", "g.xyz.old", "h.mtl", "i.png", "readme.txt")
    objects = open_dataset(f"folder:{tmp_path}").finite
    assert [obj.object_id for obj in objects] == [*names]
    mesh = objects[1].load()
    # The corners of a tetrahedron on the axes lie at sqrt(3) / 2 of the middle of their box.
    np.testing.assert_allclose(np.abs(mesh.vertices), 1 / np.sqrt(3), rtol=2.0**-23)
    with pytest.raises(BadInput, match=r"a\.ply: no PLY header"):
        objects[0].load()


def test_clouds_are_taken_where_there_is_no_mesh(tmp_path: Path) -> None:
    points = np.random.default_rng(0).uniform(-7, 9, (3000, 3))
    (tmp_path / "chair").mkdir()
    np.save(tmp_path / "chair" / "a.npy", points)
    np.savetxt(tmp_path / "chair" / "b.xyz", points[:10])
    (tmp_path / "readme.txt").touch()
    dataset = open_dataset(f"folder:{tmp_path}")
    assert dataset.classes == ("chair",)
    many, few = dataset.objects("chair", None, 5)
    assert (many.object_id, many.has_truth) == ("a.npy", False)
    cloud = many.cloud(generator(1)).points
    assert len(np.unique(cloud, axis=0)) == len(cloud) == 2048
    # The whole was brought to the unit sphere, not the part: rows of the one are of the other.
    whole = many.cloud(generator(1), 3000).points
    assert {row.tobytes() for row in cloud} <= {row.tobytes() for row in whole}
    assert np.linalg.norm(whole, axis=1).max() == pytest.approx(1, abs=1e-6)
    assert many.cloud(generator(2)).points.tolist() != cloud.tolist()
    assert len(few.cloud(generator(1))) == 10
    views = many.views(2, generator(3))
    with_views = (lambda: many.truth(views), lambda: many.cloud_and_truth(generator(1), views))
    for refuse in (many.load, *with_views):
        with pytest.raises(BadInput, match=r"a\.npy: a bare cloud has no"):
            refuse()
    before = many.fingerprint()
    np.save(tmp_path / "chair" / "a.npy", np.full((2, 3), 7))
    assert many.fingerprint() != before
    with pytest.raises(BadInput, match=r"a\.npy: all 2 points are equal"):
        many.cloud(generator(1))
    plant(tmp_path, "chair/mesh.obj")  # the clouds beside a mesh are left alone
    assert ids(open_dataset(f"folder:{tmp_path}"), "chair") == ["mesh.obj"]


def test_texts_of_numbers_are_clouds_where_there_is_no_mesh(tmp_path: Path) -> None:
    """The layout of ShapeNet's part annotations, with the list of its classes."""
    row = "0.1 -0.2 0.3 0 1 0 12.000000\n0.2 0.1 0.3 0 1 0 12.000000\n"
    classes = ("synsetoffset2category.txt", "Airplane\t02691156\nChair\t03001627\n")
    plant(tmp_path, classes, ("03001627/1a.txt", row), ("02691156/1b.TXT", row))
    plant(tmp_path, ("03001627/licence.txt", "for 3 uses\n"))
    dataset = open_dataset(recognised(str(tmp_path)))
    assert dataset.layout == "a folder of bare clouds, sub-folders are classes"
    assert ids(dataset, "03001627") == ["1a.txt"]
    assert ids(dataset, "02691156") == ["1b.TXT"]
    assert dataset.left_out == "03001627/licence.txt, synsetoffset2category.txt"
    assert dataset.irregular == ()
    plant(tmp_path, "03001627/mesh.obj")
    assert [obj.object_id for obj in open_dataset(f"folder:{tmp_path}").finite] == ["mesh.obj"]


def test_training_clouds_are_of_one_size(tmp_path: Path) -> None:
    for name, count in (("a", 5000), ("b", 9000), ("c", 3000)):
        np.save(tmp_path / f"{name}.npy", np.random.default_rng(1).random((count, 3)))
    clouds = [BareCloud("chair", f"{n}.npy", tmp_path / f"{n}.npy") for n in "abc"]
    assert training_clouds(clouds[:2], quiet=True).shape == (2, 4096, 3)
    message = r"chair/c\.npy: 3000 points, and a\.npy has 4096.*give clouds of one size, or of at"
    with pytest.raises(BadInput, match=message):
        training_clouds(clouds, quiet=True)


def test_objects_survive_pickling(tmp_path: Path) -> None:
    plant(tmp_path, "a.obj")
    for obj in (
        ProceduralObject("chair", "validation", 3),
        *open_dataset(f"folder:{tmp_path}").finite,
        MeshFile("chair", "a", tmp_path / "a.obj", tmp_path, PAPER),
    ):
        twin = pickle.loads(pickle.dumps(obj))
        assert (twin, hash(twin)) == (obj, hash(obj))
        assert twin.fingerprint() == obj.fingerprint()
        assert bytes_of(twin.load()) == bytes_of(obj.load())
        assert len(pickle.dumps(obj)) < 1000  # small: the mesh does not travel


MODELNET = ("chair/train/chair_0001.off", "chair/test/chair_0890.off", "table/test/table_0393.off")
V1 = ("03001627/1a/model.obj", "03001627/1a/model.mtl", "02747177/1b/model.obj")
V2 = ("03001627/2a/models/model_normalized.obj", "03001627/2a/images/texture0.jpg")


def under(folder: str, *files: str) -> tuple[str, ...]:
    return tuple(f"{folder}/{file}" for file in files)


RECOGNISED = {  # files, the dataset, its objects by class, and the folder that is asked for
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
    "unpacked where capitals are usual": (
        ("chair/Train/chair_0001.OFF", "chair/TEST/chair_0890.off"), "modelnet:", {"chair": 2}),
    "without splits, with capitals": (("Chair/chair_0001.off",), "modelnet:", {"Chair": 1}),
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
    "meshes in a folder named as a synset": (("03001627/a.obj",), "folder:", {"03001627": 1}),
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
        under("up", *MODELNET[:2]), "modelnet:/up", {"chair": 2}, "up/chair"),
    "a split of a class of ModelNet": (
        under("up", *MODELNET[:2]), "modelnet:/up", {"chair": 2}, "up/chair/train"),
    "a split in capitals": (
        ("up/chair/Train/chair_0001.off",), "modelnet:/up", {"chair": 1}, "up/chair/Train"),
    "a synset": (under("up", *V2), "shapenet:/up", {"chair": 1}, "up/03001627"),
}  # fmt: skip


@pytest.mark.parametrize("case", RECOGNISED)
def test_a_tree_is_recognised_with_its_option(tmp_path: Path, case: str) -> None:
    files, option, counts, *part = RECOGNISED[case]
    plant(tmp_path, *files)
    kind, _, place = option.partition(":")
    expected = f"{kind}:{tmp_path}{place}"
    asked = tmp_path.joinpath(*part)
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


def test_walks_end_and_pass_by_links_pipes_devices_and_odd_names(tmp_path: Path) -> None:
    names = ["new\nline.obj", "\x1b[31mred.obj", "a|b`c<d>.obj", "\u202eylp.obj", " .obj", "=1.obj"]
    box = plant(tmp_path, *under("box", "a.obj", "b/b.obj", *names)) / "box"
    for name, target in (
        *(("up", ".."), ("disk", "/"), ("self", "self"), ("zero.obj", "/dev/zero")),
        *(("gone.obj", "no.obj"), ("f.obj", "a.obj"), ("../again", "box")),
    ):
        (box / name).symlink_to(target)
    os.mkfifo(box / "pipe.obj")
    expected = sorted(["a.obj", "b/b.obj", "f.obj", *names])
    assert sorted(ids(open_dataset(f"folder:{tmp_path}"), "box")) == expected
    assert {path.name for path in files_below(box, (".obj",))[0]} >= {"a.obj", "b.obj", "f.obj"}


def test_deep_folders(tmp_path: Path) -> None:
    depth, limit = 320, sys.getrecursionlimit()
    where = tmp_path / ("d/" * depth)
    where.mkdir(parents=True)
    plant(where, "a.obj")
    sys.setrecursionlimit(300)
    try:
        assert ids(open_dataset(f"folder:{tmp_path}"), "d") == ["d/" * (depth - 1) + "a.obj"]
    finally:  # pytest's own way to clear up is recursive
        sys.setrecursionlimit(limit)
        subprocess.run(["rm", "-rf", tmp_path / "d"], check=True)


# --- refusals -------------------------------------------------------------------------------------

CHAIR = "03001627"
CSV = "id,synsetId,subSynsetId,modelId,split\n"
LISTS = "modelnet40_test.txt"
KINDS = "there are procedural, folder:PATH, shapenet:PATH, modelnet:PATH, exported:PATH and 6 more"
REFUSED = [  # the dataset of a folder {}, its files, a pattern of what is said, class and split
    *(
        (spec, (), rf"^unknown dataset '{re.escape(spec)}': (did you mean '.*'\? )?{KINDS}")
        for spec in ("", "Procedural", "procedural:x", "folder:", "shapes:/tmp")
    ),
    *(
        (spec, ("a/a.obj", "nets/03001627/a/model.obj"), rf"did you mean '{guess}'\? {KINDS}")
        for spec, guess in (
            ("{}/a", "folder:{}/a"),
            ("{}/nets", "shapenet:{}/nets"),
            ("/gone", "folder:/gone"),
            ("procedual", "procedural"),
            ("ShapeNet", "shapenet:PATH"),
        )
    ),
    ("procedural", (), "procedural: no class 'unicorn'.*chair", "unicorn"),
    ("procedural:novel-families", (), "no class 'car' .*found chair$", "car"),
    ("folder:{}", ("chair/a.obj", "lamp/b.obj"),
     "no class 'sofa'.*found chair, lamp; --suite own-meshes .* class folder:.*/chair$", "sofa"),
    *(
        (f"folder:{place}", ("file.ply",), "not the name of a folder|no such folder")
        for place in ("{}/gone", "{}/file.ply", "~no-such-user-anywhere/x", "{}/" + "n" * 5000)
    ),
    *(
        (spec, (), "a whole disk; give the folder")
        for spec in ("folder:/", "modelnet:/", "shapenet:/../")
    ),
    ("folder:{}", ("g.xyz.old", "i.png"), r"no mesh in this folder; expected \.ply, \.obj"),
    ("shapenet:{}", ("i.png",), r"no ShapeNetCore here; expected <synset>/<id>/model\.obj"),
    ("modelnet:{}", ("chair/train/i.png",), "no ModelNet here; expected"),
    ("folder:{}", ("ModelNet10\\chair\\train\\chair_0001.off", "ModelNet10\\a.txt"),
     "backslashes.*unzip"),
    ("folder:{}", ("a/chair\\test\\b.off",), "backslashes.*unzip"),
    ("folder:{}", ("chair/a.obj", "chair/.b.obj.icloud"), r"\.b\.obj\.icloud.*iCloud; download it"),
    ("folder:{}", ("train/chair/a.obj", "test/chair/b.obj"),
     r"splits \(test, train\).*folder:.*/test"),
    ("folder:{}", ("Train/chair/a.obj", "Test/chair/b.obj"),
     r"splits \(Test, Train\).*folder:.*/Test"),
    ("folder:{}", ("ModelNet10.zip", "README.txt"), r"no mesh.*it has ModelNet10\.zip, README"),
    ("folder:{}", ("._a.obj", "__MACOSX/._a.obj", ".DS_Store"), "no mesh"),
    ("folder:{}", (*under("one", *V1), *under("two", *V2)), "give --dataset .* or "),
    *(
        ("shapenet:{}", (*under(CHAIR, "a/model.obj"), file), says)
        for file, says in (
            (("all.csv", "a,b\n1,2\n"), "not the split list of ShapeNet"),
            (("all.csv", f"{CSV}1,{CHAIR},x,..,test\n"), "is a path"),
            (("all.csv", f"{CSV}1,{CHAIR},x,a\u202e,test\n"), "cannot be seen"),
            (("all.csv", f"{CSV}1,{CHAIR},x,a,tset\n"), "'tset' is no split"),
            (("all.csv", f"{CSV}1,{CHAIR}\n"), "not the split list"),
            (("taxonomy.json", "{"), "not the taxonomy of ShapeNet"),
            (("taxonomy.json", "[1]"), "not the taxonomy of ShapeNet"),
            (("taxonomy.json", '[{"synsetId": "03001627"}]'), "not the taxonomy of ShapeNet"),
        )
    ),
    *(
        ("modelnet:{}", ("chair/chair_0001.off", (LISTS, line)), "expected an id in each line")
        for line in ("../../etc/passwd\n", "chair\x00_1\n")
    ),
    ("modelnet:{}", MODELNET, "no chair in the split 'validation'", "chair", "validation"),
    ("modelnet:{}", MODELNET, "no table in the split 'train'", "table", "train"),
    ("paper:{}", ("shape_net_core_uniform_samples_2048/03001627/a.ply",),
     r"no split file here; expected chair_exp\.json or all_exp"),
    ("paper:{}", (*under("shape_net_core_uniform_samples_2048", f"{CHAIR}/a.ply"),
                  ("chair_exp.json", "{")), r"chair_exp\.json: not JSON that can be read"),
]  # fmt: skip


@pytest.mark.parametrize("case", REFUSED, ids=[case[2] for case in REFUSED])
def test_a_dataset_is_refused_with_the_cause(tmp_path: Path, case: tuple) -> None:
    spec, files, says, *asked = case
    plant(tmp_path, *files)

    def ask():
        dataset = open_dataset(spec.replace("{}", str(tmp_path)))
        class_name, *split = asked
        dataset.objects(class_name, None, 1, *split)

    with pytest.raises(BadInput, match=says.replace("{}", str(tmp_path))) as refusal:
        ask()
    assert "\n" not in str(refusal.value)


def test_folders_of_several_datasets_of_too_much_and_that_cannot_be_read(
    tmp_path: Path, monkeypatch
) -> None:
    plant(tmp_path, *under("one", *MODELNET), *under("two", *MODELNET), "meshes/box/a.obj")
    with pytest.raises(BadInput, match=r"several datasets.*modelnet:.*one, modelnet:.*two"):
        recognised(str(tmp_path))
    with pytest.raises(BadInput, match="no such folder"):
        recognised(str(tmp_path / "gone"))
    with monkeypatch.context() as patch:
        patch.setattr("data_prep.files.safe_read.MOST_ENTRIES", 1)
        with pytest.raises(BadInput, match=r"more than 1 files and folders.*give a folder"):
            open_dataset(f"folder:{tmp_path}/meshes")
    real = os.scandir

    def refuse(path: Path) -> object:
        if path.name == "box":
            raise PermissionError(13, "Permission denied", str(path))
        return real(path)

    monkeypatch.setattr(os, "scandir", refuse)  # who runs tests as root may read everything
    with pytest.raises(BadInput, match=r"box: cannot be read \(Permission denied\); fix this"):
        open_dataset(f"folder:{tmp_path / 'meshes'}")


@pytest.mark.parametrize("name", [b"\xff.obj", b"\xff/a.obj"])
def test_names_that_are_no_text(tmp_path: Path, name: bytes) -> None:
    path = os.fsdecode(os.fsencode(tmp_path / "box") + b"/" + name)
    plant(Path(path).parent, Path(path).name)
    with pytest.raises(BadInput, match=r"the name '(box/)?\\xff.* is not UTF-8; rename it"):
        open_dataset(f"folder:{tmp_path}")
    with pytest.raises(BadInput, match="not the name of a folder"):
        open_dataset(f"folder:{path}")


FAILS = "dataset 'made:.*': {}; fix or remove the package that adds"


@pytest.mark.parametrize(
    ("result", "message"),
    [
        (ValueError("no"), FAILS.format("ValueError: no")),
        (SystemExit(0), FAILS.format("SystemExit: 0")),
        (BadInput("x.csv:3: expected a name"), "^x.csv:3: expected a name$"),
        ("a text", "dataset 'made:.*': its package gives no Dataset"),
    ],
)
def test_a_reader_of_another_package_that_fails_is_named(monkeypatch, tmp_path, result, message):
    def read(spec, root):
        if isinstance(result, BaseException):
            raise result
        return result

    reader = DatasetReader("made", read, "made up")
    monkeypatch.setattr(registry, "reader_ids", lambda: ("made",))
    monkeypatch.setattr(registry, "load_entry_point", lambda *_: reader)
    for spec, says in (
        (f"made:{tmp_path}", message),
        (f"made:{tmp_path}/gone", "no such folder"),
        ("other:x", r"unknown dataset 'other:x'.* and 7 more; see 'bench list'$"),
    ):
        with pytest.raises(BadInput, match=says):
            open_dataset(spec)
    assert registry.is_dataset("made:x")
    assert not registry.is_dataset("other:x")
