"""`bench data inspect`, and runs on trees in the paper's layout."""

from __future__ import annotations

import csv
import json
import re
import shutil
from functools import partial
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from bench.check.inspection import inspect
from bench.running.options import Options
from data_prep.datasets.registry import ProceduralObject
from data_prep.files.clouds import save_ply

from ...data_prep.dataset_trees import write_obj, write_off, write_paper_tree
from ..builders import run_suite

CHAIR = "03001627"
REPOSITORY = Path(__file__).resolve().parents[3]
REAL_MESHES = REPOSITORY / "results" / "real-meshes.csv"


@pytest.fixture(scope="module")
def tree(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("paper") / "tree"
    write_paper_tree(out, [ProceduralObject("chair", "test", i) for i in range(2)])
    return out


@pytest.fixture
def copied(tree, tmp_path) -> Path:
    return Path(shutil.copytree(tree, tmp_path / "tree"))


@pytest.mark.slow
def test_a_run_on_the_tree_is_the_run_on_its_source(tree, tmp_path, no_machine, monkeypatch):
    """Fewer than 20 views would be random ones here, and the first of 20 on a tree."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # no weights for fid
    cells = {"methods": ("splat", "pc2pix", "blank"), "conditions": ("2048", "noise-0.10")}
    tables = []
    for name, dataset in (("there", "procedural"), ("here", f"paper:{tree}")):
        out = tmp_path / name
        run_suite(Options("chair-robustness", dataset, **cells, limit=2, workers=1, out=out))
        tables.append({path.name: path.read_bytes() for path in (out / "tables").glob("*.csv")})
    assert "table3_ssim.csv" in tables[0]
    assert tables[0] == tables[1]


def test_a_regular_tree(tree, command):
    status, out, _ = command("data", "inspect", tree, "--workers", "1")
    *lines, angles, use = out.splitlines()
    assert (status, use) == (0, f"use          --dataset paper:{tree}")
    assert angles.startswith("angles       9")
    assert lines == [
        "layout       the paper's clouds and images, split by chair_exp.json",
        "orientation  +Z up, front +X: (x, y, z) becomes (-y, z, -x), twice as large",
        "class        chair: train 0, test 2",
        "class        all: train 0, test 2",
        "read         2 objects",
    ]


def test_an_irregular_tree(copied):
    renders = copied / "shapenet_release" / "renders" / CHAIR
    (renders / "test-0000" / "render_3_128.png").unlink()
    (renders / "test-0000" / "render_4_128.png").unlink()
    (renders / "test-0001" / "view.txt").unlink()
    (copied / "shape_net_core_uniform_samples_2048" / CHAIR / "extra.ply").touch()
    found = inspect(f"paper:{copied}", 10, 1)
    assert (*found.irregular, *found.kinds) == (
        "chair, clouds: 1 are in no split and left out: extra",
        "1 objects lack images: chair/test-0000 (2)",
        "1 objects lack view.txt: chair/test-0001",
        "1 of 2 read: an image cannot be used (first chair/test-0000: render_3_128.png: no such "
        "file)",
        "1 of 2 read: the cameras cannot be read (first chair/test-0001: no such file)",
    )
    assert len(inspect(str(copied), 0, 1).irregular) == 3  # nothing is read


def test_angles_in_the_other_sense(copied):
    for path in (copied / "shapenet_release").rglob("view.txt"):
        pairs = [line.split() for line in path.read_text().splitlines()]
        path.write_text("".join(f"{-float(a)!r} {e}\n" for a, e in pairs))
    (line,) = inspect(str(copied), 2, 1).irregular
    assert line.startswith("angles do not fit: ")
    assert line.endswith("(the other sense, turned by 0 degrees)")


def mesh(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    write_obj(path)


def test_a_folder_of_meshes_with_what_is_none(tmp_path, command):
    folder = tmp_path / "my meshes"
    for name in "abc":
        mesh(folder / "chair" / f"{name}.obj")
    (folder / "chair" / "bad.ply").write_text("nonsense")
    save_ply(np.eye(3, dtype=np.float32), folder / "chair" / "bare.ply")
    status, out, _ = command("data", "inspect", folder, "--workers", "1")
    assert status == 1
    *lines, nonsense, no_faces, use = out.splitlines()
    assert lines == [
        "layout       a folder of meshes, sub-folders are classes",
        "orientation  +Y up, front -Z: taken as it is",
        "class        chair: objects 5",
        "class        all: objects 5",
        "splits       none: all objects are taken",
        lines[5],
        "read         5 objects",
    ]
    assert re.fullmatch("checksum     [0-9a-f]{64} of 5 files", lines[5])
    first = "IRREGULAR    1 of 5 read: it cannot be used (first "
    assert nonsense.startswith(f"{first}chair/bad.ply: {folder}/chair/bad.ply: no PLY header")
    assert no_faces.startswith(f"{first}chair/bare.ply: {folder}/chair/bare.ply: the mesh has no")
    assert use == f"use          --dataset 'folder:{folder}'"


@pytest.fixture
def unequal(tmp_path):
    """A folder of twelve chairs, of which four cannot be used, for three causes."""
    folder = tmp_path / "unequal"
    for i in range(8):
        mesh(folder / "chair" / f"{i}.obj")
    flat = "v 0 0 {z}\nv 1 0 {z}\nv 2 0 {z}\nf 1 2 3\n"
    for name, text in (
        ("8.obj", "v 0 0 0\nv 1 0 0\nv 0 1 nan\nf 1 2 3\n"),
        ("9.obj", flat.format(z=1)),
        ("10.obj", flat.format(z=2) + "f 3 2 1\n"),
        ("11.obj", "v 0 0 0\n"),
    ):
        (folder / "chair" / name).write_text(text)
    return folder


CAUSES = {  # what is said of the objects that cannot be used, by their numbers
    10: "all 2 faces have no area; a shape needs a surface",
    11: "the mesh has no faces; a bare point cloud cannot be scored",
    8: "the mesh has 1 non-finite vertices of 3 (the first is vertex 2); repair or remove them",
    9: "all 1 faces have no area; a shape needs a surface",
}


def test_each_cause_has_its_line_and_all_lists_every_problem(unequal, command):
    """The ten objects that are spread evenly over the twelve are all but 11.obj and 6.obj."""

    def inspected(*options):
        status, out, _ = command("data", "inspect", unequal, "--workers", "1", *options)
        assert status == 1
        lines = [(line[:12].rstrip(), line[13:]) for line in out.splitlines()]
        return [line for line in lines if line[0] in ("PROBLEM", "IRREGULAR", "more")]

    reasons = {i: f"{unequal}/chair/{i}.obj: {cause}" for i, cause in CAUSES.items()}

    def kinds(read, *firsts):
        return [
            (
                "IRREGULAR",
                f"{count} of {read} read: it cannot be used (first chair/{i}.obj: {reasons[i]})",
            )
            for i, count in firsts
        ]

    more = ("more", "--all reads every object and lists every problem")
    assert inspected() == [*kinds(10, (10, 2), (8, 1)), more]
    assert inspected("--all") == [
        *(
            ("PROBLEM", f"chair/{i}.obj: it cannot be used: {reason}")
            for i, reason in reasons.items()
        ),
        *kinds(12, (10, 2), (11, 1), (8, 1)),
    ]


def test_the_report_as_json(unequal, command):
    (unequal / "notes.txt").touch()
    asked = ("data", "inspect", unequal, "--workers", "1", "--all", "--format", "json")
    status, out, _ = command(*asked)
    told = json.loads(out)
    sha256_of_all = checksum(
        {
            f"chair/{i}.obj": sha256((unequal / "chair" / f"{i}.obj").read_bytes()).hexdigest()
            for i in sorted(range(12), key=lambda i: f"{i}.obj")
        }
    )
    assert status == 1
    assert told == {
        "dataset": f"folder:{unequal}",
        "regular": False,
        "layout": "a folder of meshes, sub-folders are classes",
        "orientation": "+Y up, front -Z: taken as it is",
        "classes": ["chair"],
        "counts": {"chair": {"objects": 12}, "all": {"objects": 12}},
        "left_out": "notes.txt",
        "checksum": {"sha256": sha256_of_all, "files": 12},
        "read": 12,
        "angles": None,
        "clouds": False,
        "irregular": [],
        "problems": [
            {
                "object": f"chair/{i}.obj",
                "kind": "it cannot be used",
                "reason": f"{unequal}/chair/{i}.obj: {cause}",
            }
            for i, cause in CAUSES.items()
        ],
    }


def test_a_regular_dataset_without_an_end_as_json(command):
    asked = ("data", "inspect", "procedural:novel-families", "--sample", "0", "--format", "json")
    status, out, _ = command(*asked)
    told = json.loads(out)
    assert (status, told["regular"], told["problems"]) == (0, True, [])
    assert (told["classes"], told["counts"]) == (["chair"], None)


def test_all_has_every_split_and_what_is_not_there(tmp_path):
    """Two objects of the same name are two; one that a list names, and the disk lacks, is one."""
    for name in ("train/chair_0001", "test/chair_0001", "test/chair_0002"):
        write_off(tmp_path / "folders" / "chair" / f"{name}.off")
    write_off(tmp_path / "lists" / "chair" / "chair_0001.off")
    (tmp_path / "lists" / "modelnet40_test.txt").write_text("chair_0001\nchair_0009\n")
    folders, lists = (inspect(str(tmp_path / name), None, 1) for name in ("folders", "lists"))
    assert folders.checksum is not None
    assert (folders.read, folders.checksum.files, folders.problems) == (3, 3, ())
    (problem,) = lists.problems
    assert (lists.read, problem.object) == (2, "chair/chair_0009")
    assert problem.reason == f"{tmp_path}/lists/chair/chair_0009.off: no such file"


@pytest.fixture
def colourless(tmp_path):
    """A folder of five chairs: three name files that are not there, one is partly unpainted."""
    folder = tmp_path / "colourless" / "chair"
    for name in "abcde":
        mesh(folder / f"{name}.obj")
    (folder / "a.mtl").unlink()
    (folder / "b.mtl").write_text("newmtl m0\nmap_Kd wood.png\nnewmtl m1\nnewmtl m2\n")
    (folder / "c.mtl").write_text("".join(f"newmtl m{i}\nmap_Kd {i}.png\n" for i in range(5)))
    (folder / "d.mtl").write_text("newmtl m0\nnewmtl m1\n")
    return folder.parent


def test_files_that_meshes_name_and_colours_that_are_lost(colourless):
    found = inspect(str(colourless), None, 1)
    assert found.kinds == (
        "3 of 5 read: it names files that are not there (first chair/a.obj: a.mtl)",
        "1 of 5 read: colours are lost (first chair/d.obj: the material 'm2' is in none of its "
        "libraries)",
    )
    named = {problem.object: problem.reason for problem in found.problems[:3]}
    assert named == {
        "chair/a.obj": "a.mtl",
        "chair/b.obj": "wood.png",
        "chair/c.obj": "0.png, 1.png, 2.png, 3.png, 4.png",
    }


@pytest.mark.slow
def test_a_run_says_at_its_start_which_files_lack_once(command, colourless, tmp_path, no_machine):
    out = tmp_path / "run"
    words = ("--methods", "blank", "--conditions", "2048", "--views", "1", "--workers", "1")
    run = ("run", "--suite", "chair-robustness", "--dataset", f"folder:{colourless}", *words)
    line = (
        "bench: 2 of {} objects name files that are not there, so that their faces may be grey: "
        "chair/a.obj (a.mtl), chair/b.obj (wood.png)\n"
    )
    (colourless / "chair" / "c.obj").unlink()
    for limit, expected in (("3", line.format(3)), ("3", ""), ("4", "")):
        status, _, err = command(*run, "--limit", limit, "--out", out)
        told = [text for text in err.splitlines(keepends=True) if "not there" in text]
        assert (status, "".join(told)) == (0, expected)
    status, _, err = command(*run, "--truth", "grey", "--out", tmp_path / "grey")
    assert (status, "not there" in err) == (0, False)


def test_a_folder_of_clouds_is_nothing_irregular_but_for_bench_render(tmp_path, command):
    points, equal = np.eye(3, dtype=np.float32), np.zeros((3, 3), np.float32)
    for write in (
        partial(save_ply, points, tmp_path / "a.ply"),
        partial(np.save, tmp_path / "b", points),
    ):
        write()
        status, out, _ = command("data", "inspect", tmp_path, "--workers", "1")
        assert status == 0
        assert "IRREGULAR" not in out
        assert out.splitlines()[-2:] == [
            "clouds       points without faces: they can be drawn, not scored",
            "use          bench render FILE",
        ]
    save_ply(equal, tmp_path / "c.ply")
    found = inspect(str(tmp_path), 10, 1)
    assert found.clouds
    assert [problem.object for problem in found.problems] == [f"{tmp_path.name}/c.ply"]
    assert found.problems[0].reason.startswith(f"{tmp_path}/c.ply: all 3 points are equal")


def test_the_embedded_set(command):
    status, out, _ = command("data", "inspect", "procedural", "--sample", "0")
    assert status == 0
    assert "as many objects as one asks for" in out
    assert out.endswith("use          --dataset procedural\n")


def test_a_folder_of_meshes_has_the_checksum_of_its_files(tmp_path, command):
    """Materials, clouds and other files are not in it."""
    texts = {"lamp/c.obj": "c", "car/b.ply": "other", "car/a.ply": "a", "car/more/a.off": "d"}
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "car" / "README.txt").write_text("no mesh")
    names = ("car/a.ply", "car/b.ply", "car/more/a.off", "lamp/c.obj")
    expected = checksum({name: sha256(texts[name].encode()).hexdigest() for name in names})
    _, out, _ = command("data", "inspect", tmp_path, "--sample", "0")
    assert f"checksum     {expected} of 4 files\n" in out


def checksum(sums):
    """The sha256 of what `sha256sum` prints of files."""
    return sha256("".join(f"{sums[name]}  {name}\n" for name in sums).encode()).hexdigest()


def test_the_list_of_real_meshes_and_its_checksum_on_the_page():
    with REAL_MESHES.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len({row["file"] for row in rows}) == 107
    for row in rows:
        assert re.fullmatch("[0-9a-f]{64}", row["sha256"])
        assert re.fullmatch("[0-9a-f]{40}", row["commit"])
        assert all(row[field] for field in ("repository", "path", "licence"))
    sums = {row["file"]: row["sha256"] for row in rows}
    page = (REPOSITORY / "docs" / "datasets.md").read_text(encoding="utf-8")
    assert f"`{checksum(dict(sorted(sums.items())))}`" in page


@pytest.mark.slow
def test_what_is_far_off_and_sets_the_scale_is_named_by_inspect_and_by_a_run(
    command, tmp_path, no_machine
):
    """The mesh has a face without area 40 times farther out; the cloud has one far point."""
    folder, clouds = tmp_path / "meshes", tmp_path / "clouds"
    mesh(folder / "chair" / "odd.obj")
    text = (folder / "chair" / "odd.obj").read_text()
    (folder / "chair" / "odd.obj").write_text(f"{text}v 40 0 0\nf -1 -1 -1\n")
    clouds.mkdir()
    points = np.random.default_rng(0).uniform(-1, 1, (300, 3))
    save_ply(np.vstack([points, [[40, 0, 0]]]).astype(np.float32), clouds / "odd.ply")
    for place, name, use in (
        (folder, "chair/odd.obj", f"--dataset folder:{folder}"),
        (clouds, "odd.ply", "bench render FILE"),
    ):
        status, out, _ = command("data", "inspect", place, "--workers", "1")
        assert status == 1
        assert re.search(rf"small in its images \(first \S*{name}: the object takes \S+ %", out)
        assert out.endswith(f"use          {use}\n")
    cells = ("--methods", "blank", "--conditions", "2048", "--views", "1", "--workers", "1")
    run = ("run", "--suite", "chair-robustness", "--dataset", f"folder:{folder}", *cells)
    status, _, err = command(*run, "--out", tmp_path / "run")
    assert status == 0
    assert (
        "bench: 1 objects are small in their images, points or faces far from the rest set its "
        "scale: chair/odd.obj\n"
    ) in err
