from __future__ import annotations

import hashlib
import os
import pickle
import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh

import data_prep
from data_prep.clouds.orientations import PAPER
from data_prep.datasets import procedural as dataset_procedural
from data_prep.datasets import registry as datasets
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from data_prep.datasets.registry import (
    Dataset,
    DatasetReader,
    MeshFile,
    PlacedMesh,
    ProceduralObject,
    open_dataset,
    recognised,
)
from data_prep.failures import BadInput
from data_prep.files.meshes import LOADER_VERSION
from data_prep.randomness import generator
from data_prep.scene import Mesh
from data_prep.shapes.catalogue import CLASSES, FAMILIES, NOVEL_CLASSES, NOVEL_FAMILIES

SPLITS = ("train", "validation", "test")


def write_box(path: Path, size: float = 1.0) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(trimesh.creation.box((1, 1, size)).export(file_type="ply"))


def digest(mesh: Mesh) -> str:
    arrays = (mesh.vertices, mesh.faces, mesh.face_colors)
    return hashlib.sha256(b"|".join(array.tobytes() for array in arrays)).hexdigest()


def ids(dataset: Dataset, class_name: str, limit: int | None = None) -> list[str]:
    return [obj.object_id for obj in dataset.objects(class_name, limit, 5)]


def test_procedural_set_has_no_end_and_its_splits_share_no_object() -> None:
    dataset = open_dataset("procedural")
    assert dataset.finite is None
    assert dataset.classes == tuple(CLASSES)
    assert ids(dataset, "chair", 3) == ["test-0000", "test-0001", "test-0002"]
    assert len(ids(dataset, "chair")) == 5
    assert ids(dataset, "chair", 0) == []
    (last,) = dataset.objects("chair", 12346, 5, split="train")[-1:]
    assert (last.class_name, last.object_id) == ("chair", "train-12345")
    with pytest.raises(BadInput, match=r"procedural: no class 'unicorn'.*chair"):
        dataset.objects("unicorn", 1, 1)
    validation = open_dataset("procedural:validation")
    assert ids(validation, "chair", 2) == ["validation-0000", "validation-0001"]
    assert validation.objects("chair", 1, 9, "train")[0].object_id == "train-0000"
    objects = [obj for split in SPLITS for obj in dataset.objects("vessel", 3, 0, split=split)]
    assert "procedural-1/vessel/test-0000" in {obj.fingerprint() for obj in objects}
    assert len({obj.fingerprint() for obj in objects}) == 9
    assert len({obj.object_id for obj in objects}) == 9
    assert len({digest(obj.load()) for obj in objects}) == 9


def test_the_sealed_split_is_another_in_each_version_of_the_protocol(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    dataset = open_dataset("procedural:sealed")
    prefix = f"sealed-{PROTOCOL_VERSION}-"
    assert ids(dataset, "chair", 2) == [f"{prefix}0000", f"{prefix}0001"]
    sealed = ProceduralObject("chair", "sealed", 3)
    before = digest(sealed.load())
    # Without the salt it would be drawn by whoever writes down its name.
    assert before != digest(CLASSES["chair"].draw(generator(*NAME)).mesh())
    assert sealed.fingerprint() == f"procedural-1/chair/{prefix}0003"
    monkeypatch.setattr(dataset_procedural, "PROTOCOL_VERSION", PROTOCOL_VERSION + 1)
    assert digest(sealed.load()) != before
    assert sealed.fingerprint() == f"procedural-1/chair/sealed-{PROTOCOL_VERSION + 1}-0003"


NAME = ("procedural", "chair", "sealed", 3)
OPENS_IT = {  # its definition, and the list of datasets
    *(
        "data_prep/datasets/procedural.py",
        "data_prep/datasets/registry.py",
        "data_prep/datasets/objects.py",
    ),
    *("data_prep/datasets/protocol_version.py", "bench/commands/listing.py"),
    "studies/figures.py",  # draws the stored results, and opens no dataset
    "studies/measurements.py",  # the final measurement of a version of the protocol
}


def test_no_training_study_or_default_takes_the_sealed_split() -> None:
    root = Path(data_prep.__file__).parents[1]
    packages = ("bench", "pc2pix", "baselines", "learning", "data_prep", "studies", "examples")
    files = [file for package in packages for file in (root / package).rglob("*.py")]
    files += [root / name for name in ("Makefile", "tox.ini", "pyproject.toml", ".ci/run")]
    named = {str(f.relative_to(root)) for f in files if "sealed" in f.read_text("utf-8").lower()}
    assert named == OPENS_IT
    for spec in ("procedural:sealed", "procedural:novel-families"):  # what a training gets of it
        (obj,) = open_dataset(spec).objects("chair", 1, 9, "train")
        assert obj.object_id == "train-0000"


def test_novel_families_are_those_of_no_other_split() -> None:
    dataset = open_dataset("procedural:novel-families")
    assert dataset.classes == tuple(NOVEL_CLASSES) == ("chair",)
    assert not set(NOVEL_FAMILIES["chair"]) & set(FAMILIES["chair"])
    (obj,) = dataset.objects("chair", 1, 9)
    rng = generator("procedural", "chair", "novel-families", 0)
    assert digest(obj.load()) == digest(NOVEL_CLASSES["chair"].draw(rng).mesh())
    with pytest.raises(BadInput, match="procedural:novel-families: no class 'car'"):
        dataset.objects("car", 1, 9)


def test_subfolders_are_classes(tmp_path: Path) -> None:
    for name in ("lamp/b.ply", "lamp/a.ply", "chair/x/y.ply", "chair/z.PLY"):
        write_box(tmp_path / name)
    (tmp_path / "chair" / "notes.txt").write_text("not a mesh")
    (tmp_path / "empty").mkdir()
    (tmp_path / "lamp" / "folder.ply").mkdir()
    dataset = open_dataset(f"folder:{tmp_path}")
    assert dataset.id == f"folder:{tmp_path}"
    assert dataset.classes == ("chair", "lamp")
    assert ids(dataset, "lamp") == ["a.ply", "b.ply"]
    assert ids(dataset, "chair") == ["x/y.ply", "z.PLY"]
    assert {obj.class_name for obj in dataset.objects("chair", None, 5)} == {"chair"}
    assert len(dataset.finite) == 4
    with pytest.raises(BadInput, match=r"no class 'sofa'.*found chair, lamp"):
        dataset.objects("sofa", None, 5)


def test_flat_folder_has_no_classes_and_a_limit_takes_the_first(tmp_path, monkeypatch) -> None:
    for name in ("c.ply", "a.ply", "b.ply"):
        write_box(tmp_path / "boxes" / name)
    monkeypatch.setenv("HOME", str(tmp_path))
    dataset = open_dataset("folder:~/boxes")
    assert dataset.classes == ()
    assert ids(dataset, "chair") == ids(dataset, "whatever") == ["a.ply", "b.ply", "c.ply"]
    assert ids(dataset, "chair", 2) == ["a.ply", "b.ply"]
    assert ids(dataset, "chair", 0) == []
    assert len(ids(dataset, "chair", 99)) == 3
    # The endless source's limit does not count here, and all splits are one.
    for split in SPLITS:
        assert len(dataset.objects("chair", None, 1, split)) == 3
    assert {obj.class_name for obj in dataset.finite} == {"boxes"}


def test_all_formats_are_found_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "sub.ply").mkdir()
    (tmp_path / "chair" / "train").mkdir(parents=True)
    for name in ("g.xyz.old", "h.mtl", "i.png", "readme.txt"):
        (tmp_path / name).touch()
    for kind, problem in (
        ("folder", r"no mesh in this folder; expected \.ply, \.obj"),
        ("shapenet", r"no ShapeNetCore here; expected <synset>/<id>/model\.obj"),
        ("modelnet", "no ModelNet here; expected"),
    ):
        with pytest.raises(BadInput, match=problem):
            open_dataset(f"{kind}:{tmp_path}")
    for name in ("a.ply", "b.obj", "c.off", "d.stl", "e.glb", "f.gltf", "g.xyz"):
        (tmp_path / name).touch()
    found = [obj.object_id for obj in open_dataset(f"folder:{tmp_path}").finite]
    assert found == ["a.ply", "b.obj", "c.off", "d.stl", "e.glb", "f.gltf"]


def test_meshes_are_read_when_they_are_needed(tmp_path: Path) -> None:
    write_box(tmp_path / "good.ply", size=2.0)
    (tmp_path / "bad.ply").write_text("nonsense")
    bad, good = open_dataset(f"folder:{tmp_path}").finite
    mesh = good.load()
    # Box 1 x 1 x 2: the corner (0.5, 0.5, 1) lies at sqrt(1.5); half an ulp of rounding each.
    expected = np.array([0.5, 0.5, 1.0]) / np.sqrt(1.5)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), expected, rtol=2.0**-24)
    with pytest.raises(BadInput, match=r"bad\.ply: not a readable mesh"):
        bad.load()


def test_clouds_are_taken_where_there_is_no_mesh(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-7, 9, (3000, 3))
    (tmp_path / "chair").mkdir()
    np.save(tmp_path / "chair" / "a.npy", points)
    np.savetxt(tmp_path / "chair" / "b.xyz", points[:10])
    (tmp_path / "readme.txt").touch()
    dataset = open_dataset(f"folder:{tmp_path}")
    assert dataset.classes == ("chair",)
    many, few = dataset.objects("chair", None, 5)
    assert (many.object_id, many.has_truth) == ("a.npy", False)
    cloud = many.cloud(np.random.default_rng(1)).points
    assert len(np.unique(cloud, axis=0)) == len(cloud) == 2048
    # The whole was brought to the unit sphere, not the part: rows of the one are of the other.
    whole = many.cloud(rng, 3000).points
    assert np.abs(whole).max() <= 1
    assert np.linalg.norm(whole, axis=1).max() == pytest.approx(1.0, abs=2.0**-23)
    rows = [int(np.flatnonzero((whole == p).all(axis=1))[0]) for p in cloud]
    assert rows == sorted(rows)
    assert many.cloud(np.random.default_rng(2)).points.tolist() != cloud.tolist()
    assert len(few.cloud(rng)) == 10
    views = many.views(2, rng)
    with_views = (lambda: many.truth(views), lambda: many.cloud_and_truth(rng, views))
    for refuse in (many.load, *with_views):
        with pytest.raises(BadInput, match=r"a\.npy: a bare cloud has no"):
            refuse()
    before = many.fingerprint()
    np.save(tmp_path / "chair" / "a.npy", points[:100])
    assert many.fingerprint() != before
    np.save(tmp_path / "chair" / "a.npy", np.full((2, 3), 7))
    with pytest.raises(BadInput, match=r"a\.npy: all 2 points are equal"):
        many.cloud(rng)
    write_box(tmp_path / "chair" / "mesh.ply")  # the clouds beside a mesh are left alone
    assert ids(open_dataset(f"folder:{tmp_path}"), "chair") == ["mesh.ply"]


def test_which_layout_a_folder_has(tmp_path: Path) -> None:
    for number, (path, layout) in enumerate(
        (
            ("chair/a.ply", "folder"),
            ("03001627/a/model.obj", "shapenet"),
            ("03001627/a/models/model_normalized.obj", "shapenet"),
            ("chair/test/chair_0001.off", "modelnet"),
            ("modelnet40_test.txt", "modelnet"),
            ("shape_net_core_uniform_samples_2048/03001627/a.ply", "paper"),
            ("03001627/a.ply", "folder"),
        )
    ):
        root = tmp_path / str(number)
        (root / path).parent.mkdir(parents=True)
        (root / path).touch()
        assert recognised(str(root)) == f"{layout}:{root}", path
    with pytest.raises(BadInput, match="no such folder"):
        recognised(str(tmp_path / "gone"))


def test_fingerprint_is_the_contents(tmp_path: Path) -> None:
    path, twin = tmp_path / "a.ply", tmp_path / "b.ply"
    obj = MeshFile("c", "a.ply", path)
    assert obj.fingerprint() == "unreadable: no such file"
    path.write_bytes(b"mesh")
    twin.write_bytes(b"mesh")
    expected = hashlib.sha256(f"loader {LOADER_VERSION}".encode() + b"mesh").hexdigest()
    assert obj.fingerprint() == expected
    assert MeshFile("d", "b.ply", twin).fingerprint() == expected
    # Companions that are no files do not count.
    (tmp_path / "a.textures").mkdir()
    os.mkfifo(tmp_path / "a.pipe")  # whose reader would wait for ever
    (tmp_path / "a.zero").symlink_to("/dev/zero")
    (tmp_path / "a.loop").symlink_to("a.loop")
    assert obj.fingerprint() == expected
    path.write_bytes(b"mesI")
    assert obj.fingerprint() != expected


def test_fingerprint_is_that_of_the_companions_too(tmp_path: Path) -> None:
    for name in ("a.obj", "ab.mtl", "b.obj"):
        (tmp_path / name).write_bytes(b"v")
    obj = MeshFile("c", "a.obj", tmp_path / "a.obj")
    alone = obj.fingerprint()
    (tmp_path / "ab.mtl").write_bytes(b"other")  # another object's
    assert obj.fingerprint() == alone
    (tmp_path / "a.mtl").write_bytes(b"Kd 1 0 0")
    red = obj.fingerprint()
    (tmp_path / "a.mtl").write_bytes(b"Kd 0 1 0")
    assert len({alone, red, obj.fingerprint()}) == 3
    (tmp_path / "a.mtl").unlink()
    Path(os.fsdecode(os.fsencode(tmp_path) + b"/a.\xff")).write_bytes(b"x")
    expected = hashlib.sha256(f"loader {LOADER_VERSION}".encode() + b"v" + b"a.\xff" + b"x")
    assert obj.fingerprint() == expected.hexdigest()


@pytest.mark.parametrize("name", ["a.obj", "a.mtl"])
def test_fingerprint_of_what_is_too_large_takes_no_time(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.obj").write_bytes(b"v")
    with (tmp_path / name).open("wb") as file:
        file.truncate(2**40)  # sparse
    found = MeshFile("c", "a.obj", tmp_path / "a.obj").fingerprint()
    assert found.startswith("unreadable: 1099511627776 bytes, and at most")


def test_objects_survive_pickling(tmp_path: Path) -> None:
    write_box(tmp_path / "a.ply")
    for obj in (
        ProceduralObject("chair", "validation", 3),
        *open_dataset(f"folder:{tmp_path}").finite,
        PlacedMesh("chair", "a", tmp_path / "a.ply", tmp_path, PAPER),
    ):
        twin = pickle.loads(pickle.dumps(obj))
        assert twin == obj
        assert hash(twin) == hash(obj)
        assert twin.fingerprint() == obj.fingerprint()
        assert digest(twin.load()) == digest(obj.load())
        assert len(pickle.dumps(obj)) < 1000  # small: the mesh does not travel


def _reads(result):
    def read(spec, root):
        if isinstance(result, BaseException):
            raise result
        return result

    return read


@pytest.mark.parametrize(
    ("result", "message"),
    [
        (
            ValueError("no"),
            "dataset 'made:.*': ValueError: no; fix or remove the package that adds",
        ),
        (SystemExit(0), "dataset 'made:.*': SystemExit: 0; fix or remove the package that adds"),
        (BadInput("x.csv:3: expected a name"), "^x.csv:3: expected a name$"),
        ("a text", "dataset 'made:.*': its package gives no Dataset"),
    ],
)
def test_a_reader_of_another_package_that_fails_is_named(monkeypatch, tmp_path, result, message):
    reader = DatasetReader("made", _reads(result), "made up")
    monkeypatch.setattr(datasets, "reader_ids", lambda: ("made",))
    monkeypatch.setattr(datasets, "load_entry_point", lambda *_: reader)
    with pytest.raises(BadInput, match=message):
        open_dataset(f"made:{tmp_path}")
    with pytest.raises(BadInput, match="no such folder"):
        open_dataset(f"made:{tmp_path}/gone")
    with pytest.raises(
        BadInput, match=r"unknown dataset 'other:x'.* and 7 more; see 'bench list'$"
    ):
        open_dataset("other:x")
    assert datasets.is_dataset("made:x")
    assert not datasets.is_dataset("other:x")


@pytest.mark.parametrize("spec", ["", "Procedural", "procedural:x", "folder:", "shapes:/tmp"])
def test_unknown_datasets(spec: str) -> None:
    with pytest.raises(
        BadInput,
        match=r"^unknown dataset '.*': (did you mean '.*'\? )?there are procedural, folder:PATH, "
        r"shapenet:PATH, modelnet:PATH, exported:PATH and 6 more; see 'bench list'$",
    ):
        open_dataset(spec)


def test_a_folder_alone_is_guessed_by_its_layout(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_box(tmp_path / "mine" / "a.ply")
    write_box(tmp_path / "nets" / "03001627" / "a" / "model.obj")
    for spec, guess in (
        ("mine", "folder:mine"),
        (str(tmp_path / "mine"), f"folder:{tmp_path / 'mine'}"),
        ("nets", "shapenet:nets"),
        ("/gone", "folder:/gone"),
        ("procedual", "procedural"),
        ("ShapeNet", "shapenet:PATH"),
    ):
        with pytest.raises(BadInput) as refusal:
            open_dataset(spec)
        assert str(refusal.value).startswith(
            f"unknown dataset '{spec}': did you mean '{guess}'? there are procedural, "
        )


def test_pipes_devices_and_links_in_a_folder(tmp_path: Path) -> None:
    write_box(tmp_path / "box" / "a.ply")
    os.mkfifo(tmp_path / "box" / "b.ply")
    (tmp_path / "box" / "c.ply").symlink_to("/dev/zero")
    (tmp_path / "box" / "d.ply").symlink_to("d.ply")
    (tmp_path / "box" / "e.ply").symlink_to("gone.ply")
    (tmp_path / "box" / "f.ply").symlink_to("a.ply")
    (tmp_path / "box" / "up").symlink_to("..")  # a circle
    (tmp_path / "again").symlink_to("box")
    assert ids(open_dataset(f"folder:{tmp_path}"), "box") == ["a.ply", "f.ply"]


def test_deep_folders(tmp_path: Path) -> None:
    depth = 1100  # beyond Python's limit of recursion
    where = tmp_path
    try:
        for _ in range(depth):
            where = where / "d"
            where.mkdir()
        write_box(where / "a.ply")
        assert ids(open_dataset(f"folder:{tmp_path}"), "d") == ["d/" * (depth - 1) + "a.ply"]
    finally:  # pytest's own way to clear up is recursive
        subprocess.run(["rm", "-rf", tmp_path / "d"], check=True)


def test_odd_names(tmp_path: Path) -> None:
    names = ["new\nline.ply", "\x1b[31mred.ply", "a|b`c<d>.ply", "\u202eylp.ply", " .ply", "=1.ply"]
    for name in names:
        write_box(tmp_path / "box" / name)
    assert ids(open_dataset(f"folder:{tmp_path}"), "box") == sorted(names)


@pytest.mark.parametrize("name", [b"\xff.ply", b"\xff/a.ply"])
def test_names_that_are_no_text(tmp_path: Path, name: bytes) -> None:
    write_box(Path(os.fsdecode(os.fsencode(tmp_path / "box") + b"/" + name)))
    with pytest.raises(BadInput, match=r"the name '(box/)?\\xff.* is not UTF-8; rename it"):
        open_dataset(f"folder:{tmp_path}")
    with pytest.raises(BadInput, match="not the name of a folder"):
        open_dataset("folder:" + os.fsdecode(os.fsencode(tmp_path / "box") + b"/" + name))


def test_a_folder_that_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_box(tmp_path / "box" / "a.ply")
    real = os.scandir

    def refuse(path: Path) -> object:
        if path.name == "box":
            raise PermissionError(13, "Permission denied", str(path))
        return real(path)

    monkeypatch.setattr(os, "scandir", refuse)  # who runs tests as root may read everything
    with pytest.raises(BadInput, match=r"box: cannot be read \(Permission denied\); fix this"):
        open_dataset(f"folder:{tmp_path}")


@pytest.mark.parametrize("location", ["gone", "file.ply", "~no-such-user-anywhere/x", "n" * 5000])
def test_names_of_no_folder(tmp_path: Path, location: str) -> None:
    (tmp_path / "file.ply").touch()
    place = location if location.startswith("~") else str(tmp_path / location)
    with pytest.raises(BadInput, match=r"not the name of a folder|no such folder"):
        open_dataset(f"folder:{place}")
