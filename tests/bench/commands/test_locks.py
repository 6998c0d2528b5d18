"""Commands beside a run that is writing: what writes waits for it, what only reads goes on."""

from __future__ import annotations

import os

import pytest

from bench.records.folder import locked_run, open_folder

from ..builders import make_manifest, write_run_with_tables

GIVEN = {
    "objects": [f"chair/{i}" for i in range(3)],
    "methods": ["splat", "surface-apss", "pc2pix", "true-mesh", "blank"],
}


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """Return the folder of two finished runs, and a file of golden values."""
    folder = tmp_path_factory.mktemp("stored")
    for name, seed in (("run", 0), ("other", 1)):
        write_run_with_tables(folder / name, **GIVEN, seed=seed)
    return folder


@pytest.fixture
def golden(stored, command):
    """Return a file of golden values of the run."""
    path = stored / "golden.json"
    if not path.exists():
        assert command("check", stored / "run", "--bless", path)[0] == 0
    return path


def tree(folder):
    return {p: p.stat().st_mtime_ns for p in folder.rglob("*") if p.is_file() and p.name != "lock"}


ELSEWHERE = ", or give --out"  # where the command can write elsewhere
WRITING = (
    (("table", "{run}"), ""),
    (("report", "{run}"), ELSEWHERE),
    (("report", "{other}", "{run}", "--out", "{out}"), ""),
    (("compare", "{run}", "--methods", "splat,blank"), ELSEWHERE),
    (("compare", "{other}", "{run}"), ELSEWHERE),
    (("score", "{run}", "--metrics", "flip"), ""),
    (("check", "{run}", "--golden", "{golden}"), ""),
    (("check", "{run}", "--claims"), ""),
)
READING = (
    ("report", "{run}", "--out", "{out}/page.html"),
    ("compare", "{run}", "--methods", "splat,blank", "--out", "{out}"),
    ("check", "{run}", "--golden", "{golden}"),
)


def arguments_of(line, stored, golden, out):
    places = {"run": stored / "run", "other": stored / "other", "golden": golden, "out": out}
    return [word.format(**places) for word in line]


@pytest.mark.parametrize(("line", "instead"), WRITING)
def test_what_writes_into_the_folder_of_a_run_waits(
    line, instead, stored, golden, refused, tmp_path
):
    run = stored / "run"
    (run / "figures").mkdir(exist_ok=True)
    (run / "figures" / "moved.png").touch()  # of a check before, which a check removes
    arguments = arguments_of(line, stored, golden, tmp_path)
    with locked_run(run):
        before = tree(run)
        assert refused(*arguments) == f"{run}: another run is writing here; wait{instead}"
        assert tree(run) == before


@pytest.mark.parametrize("line", READING, ids=" ".join)
def test_what_only_reads_goes_on(line, stored, golden, command, tmp_path):
    run = stored / "run"
    (run / "figures" / "moved.png").unlink(missing_ok=True)
    arguments = arguments_of(line, stored, golden, tmp_path)
    with locked_run(run):
        before = tree(run)
        status, _, err = command(*arguments)
        assert (status, "another run is writing" in err) == (0, False)
        assert tree(run) == before


@pytest.mark.parametrize("name", ["lock", "run.sqlite", "manifest.json", "tables"])
@pytest.mark.parametrize("kind", ["link", "dangling link", "pipe"])
def test_a_link_or_a_pipe_in_the_folder_is_refused_before_any_work(
    name, kind, tmp_path, refused, no_machine
):
    run, target = tmp_path / "run", tmp_path / "target"
    run.mkdir()
    if kind == "pipe":
        os.mkfifo(run / name)
    else:
        (run / name).symlink_to(target)
    if kind == "link":
        target.write_text("of the user")
    message = refused("run", "--suite", "chair-robustness", "--limit", "1", "--out", run)
    told = "no regular file but a pipe or device" if kind == "pipe" else "a link that leads out of"
    assert message.startswith(f"{run / name}: {told}")
    assert [path.name for path in run.iterdir()] == [name]
    assert target.exists() == (kind == "link")
    assert kind != "link" or target.read_text() == "of the user"


@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_a_lock_that_is_no_file_is_not_opened(kind, tmp_path):
    """The lock is refused even if it is put there after the folder was looked at."""
    manifest = tmp_path / "manifest.json"
    manifest.write_text(str(make_manifest()))
    if kind == "link":
        (tmp_path / "lock").symlink_to(manifest)
    else:
        os.mkfifo(tmp_path / "lock")
    message = f"{tmp_path / 'lock'}: no file of this folder, but a link, pipe or device; remove it"
    with pytest.raises(Exception, match=message), open_folder(tmp_path):
        pytest.fail("the folder was opened")
    assert manifest.read_text() == str(make_manifest())
