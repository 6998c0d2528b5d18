"""Methods MODULE:NAME: executed only where a command names them, known by their source."""

from __future__ import annotations

import sys

import pytest

from bench.catalogue.method_files import data_files, source_files, source_sha256, told_files
from bench.catalogue.methods import (
    ALLOWED,
    allow_modules,
    find_method,
    is_module_name,
    known_method,
)
from data_prep.failures import BadInput

CLASS = """class Mine:
    def prepare(self, cloud, rng):
        return cloud

    def draw(self, state, views, rng):
        return views
"""
METHOD = """from pathlib import Path
from bench.catalogue.methods import Method
Path("executed").touch()
METHOD = Method("its-own-id", lambda device: device, lambda: "scipy 1", 7, "what it says")
NUMBER = 3
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return the current folder; names that are allowed in it are forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(ALLOWED, "")
    monkeypatch.setattr(sys, "path", [*sys.path])
    return tmp_path


def test_the_form_of_a_name():
    assert all(map(is_module_name, ("mine:METHOD", "package.mine:Outer.METHOD")))
    others = ("splat", "splat-net@a:b", "images:folder", "mine:METHOD:PATH", "mine:")
    assert not any(map(is_module_name, (*others, "my-module:METHOD", "mine:METHOD,other:METHOD")))


def test_nothing_is_executed_that_no_command_has_named(folder):
    (folder / "unnamed.py").write_text(METHOD)
    with pytest.raises(BadInput, match="unnamed:METHOD: is of a module, which only a command line"):
        find_method("unnamed:METHOD")
    assert known_method("unnamed:METHOD") is None
    allow_modules(["splat", "other:METHOD"])
    assert known_method("unnamed:METHOD") is None
    assert not (folder / "executed").exists()
    allow_modules(["unnamed:METHOD"])
    assert sys.path[-1] == str(folder)  # no file of it hides an installed module
    method = find_method("unnamed:METHOD")
    assert (folder / "executed").exists()
    assert (method.id, method.version, method.source) == ("unnamed:METHOD", 7, "what it says")
    checksum = source_sha256("unnamed")
    assert method.identity() == f"scipy 1 source {checksum}"


def test_a_class_is_instantiated_in_each_worker(folder):
    (folder / "with_a_class.py").write_text(CLASS + "\nOBJECT = Mine()\n")
    allow_modules(["with_a_class:Mine", "with_a_class:OBJECT"])
    of_class, of_object = (find_method(f"with_a_class:{name}") for name in ("Mine", "OBJECT"))
    first, second = of_class.load("cpu"), of_class.load("cpu")
    assert type(first).__name__ == "Mine"
    assert first is not second
    assert of_object.load("cpu") is of_object.load("cpu")
    assert of_class.identity() == f"source {source_sha256('with_a_class')}"


@pytest.mark.parametrize(
    ("text", "name", "message"),
    [
        (METHOD, "NUMBER", "is a int; expected a Method, or a class with the functions prepare"),
        (METHOD, "GONE", "has no 'GONE'"),
        ("1 / 0", "A", r"cannot be loaded \(ZeroDivisionError: division by zero\); 'bench test"),
        ("exit(3)", "B", r"cannot be loaded \(SystemExit: 3\)"),
        (None, "METHOD", "no module 'refused_method' in this folder or among the"),
    ],
)
def test_a_module_that_has_no_method_is_refused(folder, text, name, message):
    module = f"refused_{name.lower()}"
    if text is not None:
        (folder / f"{module}.py").write_text(text)
    allow_modules([f"{module}:{name}"])
    with pytest.raises(BadInput, match=message):
        find_method(f"{module}:{name}")


def test_the_source_is_the_module_and_what_it_imports_from_its_folder(folder, monkeypatch):
    """Installed packages and this project have versions of their own in the keys of jobs."""
    monkeypatch.syspath_prepend(folder)
    (folder / "src_main.py").write_text(
        "import numpy, src_helper\nfrom bench.cli import main\n\n"
        "def f():\n    from src_package.inner import g\n"
    )
    (folder / "src_helper.py").write_text("from src_deep import x\nimport src_main\n")
    (folder / "src_deep.py").write_text("x = 1\n")
    (folder / "src_package").mkdir()
    for name in ("__init__.py", "inner.py"):
        (folder / "src_package" / name).write_text("from . import inner\nimport numpy\n")
    (folder / "bench").mkdir()
    (folder / "bench" / "cli.py").write_text("")
    (folder / "unused.py").write_text("")
    (folder / "notes.txt").write_text("")
    expected = {
        *("src_main.py", "src_helper.py", "src_deep.py"),
        *("src_package/__init__.py", "src_package/inner.py"),
    }
    assert {str(file.relative_to(folder)) for file in source_files("src_main")} == expected
    of_package = {str(file.relative_to(folder)) for file in source_files("src_package.inner")}
    assert of_package == {"src_package/__init__.py", "src_package/inner.py"}

    def checksum():
        return source_sha256.__wrapped__("src_main")

    before = checksum()
    (folder / "unused.py").write_text("changed")
    assert checksum() == before
    for name in expected:
        text = (folder / name).read_text()
        (folder / name).write_text(text + "# changed\n")
        assert checksum() != before, name
        (folder / name).write_text(text)
        assert checksum() == before


def test_an_installed_module_is_known_by_its_own_files_alone():
    assert {file.parts[-2] for file in source_files("threadpoolctl")} == {"site-packages"}


NAMING = """from pathlib import Path
import data_helper
HERE = Path(__file__).parent

class Mine:
    {declared}
    def prepare(self, cloud, rng):
        return open("plain.txt"), HERE.joinpath("weights", "last.bin"), "weights", "meshes"

    def draw(self, state, views, rng):
        return HERE / f"deep/inner/{{len(views)}}.bin", "run", "absent.bin", "a\\0", ".", ".."
"""


@pytest.fixture
def naming(folder, monkeypatch):
    """Return the current folder, with a module whose texts name files in several ways."""
    data = ("plain.txt", "unnamed.txt", "weights/last.bin", "weights/more/a.npz", "of_helper.json")
    others = ("weights/.hidden", "weights/__pycache__/x.pyc")
    of_a_run = ("run/manifest.json", "run/lock", "run/tables/a.csv")
    contents = {
        **dict.fromkeys((*data, *others, *of_a_run), "1"),
        **{f"meshes/{i}.off": "1" for i in range(1_001)},
        **{"data_pack/__init__.py": "", "data_pack/inner/table.csv": "1"},
        "data_helper.py": "import data_pack\nNAME = 'of_helper.json'\n",
        "data_main.py": NAMING.format(declared=""),
        "data_declaring.py": NAMING.format(declared="files = ('unnamed.txt',)"),
    }
    for name, text in contents.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    monkeypatch.syspath_prepend(folder)
    return folder


def relative(files, folder):
    return [str(file.relative_to(folder)) for file in files]


def test_files_that_a_source_names_and_those_of_packages_are_known(naming):
    expected = ["data_pack/inner/table.csv", "of_helper.json", "plain.txt"]
    expected += ["weights/last.bin", "weights/more/a.npz"]
    files, left_out = data_files("data_main:Mine")
    assert relative(files, naming) == expected
    assert relative(left_out, naming) == ["meshes"]
    files, _ = data_files("data_main:Mine", ["unnamed.txt", naming / "weights/last.bin"])
    assert relative(files, naming) == [*expected[:3], "unnamed.txt", *expected[3:]]
    assert told_files("data_main:Mine", ()) == (
        "data_main:Mine: known by its source and data_pack/inner/table.csv, of_helper.json, "
        f"plain.txt, weights/last.bin, weights/more/a.npz; {naming}/meshes left out, of more than "
        "1000 files or 4 GiB; other files that it reads are not seen: name them in `files` of the "
        "method (docs/extending.md)"
    )


def test_the_identity_changes_with_each_file_that_is_known(naming):
    allow_modules(["data_declaring:Mine"])
    method = find_method("data_declaring:Mine")
    before = method.identity()
    for name, is_known in (
        ("plain.txt", True),
        ("weights/more/a.npz", True),
        ("unnamed.txt", True),
        ("weights/.hidden", False),
        ("run/tables/a.csv", False),
    ):
        (naming / name).write_text("2")
        assert (method.identity() != before) == is_known, name
        (naming / name).write_text("1")
        assert method.identity() == before
    (naming / "unnamed.txt").unlink()
    with pytest.raises(BadInput, match=r"data_declaring:Mine: declares the file .*unnamed\.txt"):
        method.identity()


@pytest.mark.parametrize("declared", ["'weights.npz'", "(1,)", "7"])
def test_what_declares_no_paths_is_refused(folder, declared):
    module = f"declares_{len(declared)}"
    (folder / f"{module}.py").write_text(f"{CLASS}\nMine.files = {declared}\n")
    allow_modules([f"{module}:Mine"])
    with pytest.raises(BadInput, match=f"'{module}:Mine': files .*; give a tuple of paths"):
        find_method(f"{module}:Mine")
