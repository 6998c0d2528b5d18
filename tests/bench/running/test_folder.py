"""A folder holds one request: what goes on, the two ways in which it grows, what is refused."""

from __future__ import annotations

import sqlite3
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.catalogue.method_files import source_sha256
from bench.catalogue.methods import ALLOWED, allow_modules, module_method
from bench.commands.add import options_of
from bench.commands.terminal import Terminal
from bench.finish import write_tables_and_figures
from bench.records.folder import open_folder, read_manifest, write_manifest
from bench.records.frames import read_records
from bench.records.store import STORE
from bench.running.folder import protocol_in_folder, read_held
from bench.running.options import Options
from bench.running.protocol import Protocol
from bench.running.run import executors_for, open_run, run
from data_prep.failures import BadInput

from ..builders import file_bytes, finished_options, make_manifest, run_suite, stored_keys, watched

TABLE = "tables/table3_ssim.csv"


def every_file(directory: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in directory.rglob("*") if path.is_file()}


def outputs(directory: Path) -> list[dict[str, bytes]]:
    return [file_bytes(directory / name) for name in ("tables", "figures")]


def asked(out: Path, **changes):
    """The protocol of a command of no machine, in its folder."""
    options = Options("chair-robustness", out=out, **{"limit": 1, "views": 2} | changes)
    protocol = Protocol.from_options(options, dict)
    return protocol_in_folder(protocol, read_held(out, protocol), options)


OF_RUN = {"methods": ("splat", "true-mesh", "blank"), "conditions": ("2048", "512"), "limit": 2}
APART = "give --out for a run of its own, or --fresh to start over"


@pytest.mark.parametrize("finished", [None, "2026-01-01T00:00:00+00:00"])
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"methods": ("splat",)},
            f"holds a run of other methods, with true-mesh; name all with --methods, {APART}",
        ),
        (
            {"methods": ("splat", "constant", "alpha-wrap")},
            "holds a run of other methods, without constant, alpha-wrap and with true-mesh; name "
            f"all with --methods, {APART}",
        ),
        (
            {"methods": ("splat", "true-mesh", "constant")},
            "holds a run of other methods, without constant; 'bench add constant {folder}' adds "
            f"one, or {APART}",
        ),
        (
            {"conditions": ("2048",)},
            f"holds a run of other conditions, with 512; name all with --conditions, {APART}",
        ),
        (
            {"conditions": ("2048", "512", "1024")},
            f"holds a run of other conditions, without 1024; name all with --conditions, {APART}",
        ),
        (
            {"limit": 1},
            f"holds a run of 2 objects, not 1; give its --limit again or a larger one, {APART}",
        ),
        (
            {"views": 3},
            "holds a run of views 2, not 3; give another --out, or --fresh to start over",
        ),
    ],
)
def test_another_request_is_refused_with_what_differs_and_nothing_changes(
    tmp_path, no_machine, finished, changes, message
):
    objects = ["chair/test-0000", "chair/test-0001"]
    there = {"objects": objects, "planned": 2, "finished": finished}
    write_manifest(tmp_path, make_manifest(device="auto", conditions=["2048", "512"], **there))
    before = every_file(tmp_path)
    with pytest.raises(BadInput) as refused:
        run_suite(Options("chair-robustness", out=tmp_path, **{"views": 2} | OF_RUN | changes))
    assert str(refused.value) == f"{tmp_path}: {message.format(folder=tmp_path)}"
    assert every_file(tmp_path) == before


class Stopped(Terminal):
    """Ctrl-C after so many jobs; notes the manifests that the folder has until then."""

    def __init__(self, after: int, directory: Path, seen: list, *terminal) -> None:
        super().__init__(*terminal)
        self._after, self._directory, self._seen = after, directory, seen

    def on_jobs_done(self, ended, failed):
        super().on_jobs_done(ended, failed)
        self._seen.append(read_manifest(self._directory))
        if len(self._seen) == self._after:
            raise KeyboardInterrupt


def test_an_extension_that_is_stopped_leaves_the_outputs_and_goes_on(
    finished, copied, same_machine, tiny_weights
):
    """With a further method: one of three objects is complete when Ctrl-C comes."""
    manifest, seen = read_manifest(copied), []
    options = options_of(copied, ["constant"], workers=1)
    stopped = run(options, write_tables_and_figures, **watched(Stopped, 1, copied, seen))
    assert (stopped.interrupted, stopped.outputs) == (True, None)
    assert (stopped.objects, stopped.planned, stopped.done) == (1, 3, 1)
    assert seen == [manifest]  # a kill finds the run as it was, too
    assert read_manifest(copied) == manifest
    assert outputs(copied) == outputs(finished[0])

    again = run_suite(options)
    assert (again.objects, again.done, again.reused) == (3, 2, 22)
    wide = read_manifest(copied)
    assert wide["methods"] == [*manifest["methods"], "constant"]
    assert wide["request"]["methods"] == wide["methods"]
    assert (wide["objects"], wide["conditions"]) == (manifest["objects"], manifest["conditions"])
    old, new = (set((d / TABLE).read_text().splitlines()) for d in (finished[0], copied))
    assert old < new


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"methods": ["splat", "my-plug-in"]},
            "this machine: unknown method 'my-plug-in'; install",
        ),
        ({"methods": ["pc2pix@gone.safetensors"]}, "gone.safetensors"),
        (
            {"conditions": ["2048", "my-noise"]},
            "this machine: unknown condition 'my-noise'; install",
        ),
        ({"objects": ["chair/gone"]}, r"has chair/gone \(1 in all\), which procedural no longer"),
    ],
)
def test_what_cannot_be_kept_is_refused_where_a_method_is_added(
    tmp_path, no_machine, changes, message
):
    here = make_manifest(device="auto", objects=["chair/test-0000"]) | changes
    write_manifest(tmp_path, here)
    before = every_file(tmp_path)
    with pytest.raises(BadInput, match=message) as refused:
        asked(tmp_path, methods=("blank",), adds=True)
    assert str(refused.value).endswith(APART)
    assert "\n" not in str(refused.value)
    assert every_file(tmp_path) == before


def test_more_objects_are_those_of_the_dataset_and_the_objects_there_are_among_them(
    tmp_path, no_machine
):
    """Of a run that was stopped the complete objects need not be the first ones."""
    some = ["chair/test-0000", "chair/test-0003"]
    conditions = list(OF_RUN["conditions"])
    there = make_manifest(device="auto", objects=some, planned=5, conditions=conditions)
    write_manifest(tmp_path, there)
    wide = asked(tmp_path, **OF_RUN | {"limit": 6})
    assert wide.names == [f"chair/test-000{i}" for i in range(6)]
    write_manifest(tmp_path, there | {"objects": ["chair/gone"]})
    with pytest.raises(BadInput, match=r"has chair/gone \(1 in all\), which procedural no longer"):
        asked(tmp_path, **OF_RUN | {"limit": 6})


def test_equal_protocols_are_equal_whatever_their_folder_holds(tmp_path, no_machine):
    conditions = list(OF_RUN["conditions"])
    there = make_manifest(device="auto", objects=["chair/test-0000"], conditions=conditions)
    write_manifest(tmp_path, there)
    assert asked(tmp_path, **OF_RUN) == asked(tmp_path / "new", **OF_RUN)


def test_a_run_that_was_killed_while_its_tables_were_made_keeps_them(
    copied, same_machine, tiny_weights
):
    write_manifest(copied, read_manifest(copied) | {"finished": None})
    protocol = Protocol.from_options(finished_options(tiny_weights, copied))
    assert read_held(copied, protocol).tabled == {f"chair/test-000{i}" for i in range(3)}


def test_a_suite_with_a_procedure_of_its_own_does_not_narrow_a_run(tmp_path):
    manifest = make_manifest(suite="speed", conditions=["2048", "512"])
    with open_run(tmp_path, manifest):
        pass
    before = every_file(tmp_path)
    narrower = manifest | {"conditions": ["2048"]}
    with (
        pytest.raises(BadInput, match="holds a run with 1 more condition, 512 among them; give"),
        open_run(tmp_path, narrower),
    ):
        pytest.fail("the run was opened")
    assert every_file(tmp_path) == before
    with open_run(tmp_path, narrower, fresh=True):  # the old run is renamed
        pass


def measure(options):
    """Carry out a run without its tables, figures and report, which take most of the time."""
    return run(options, lambda directory, seconds: directory, **watched())


GREY = """import numpy as np

class Grey:
    def prepare(self, cloud, rng):
        return cloud

    def draw(self, state, views, rng):
        images = np.ones((len(views), 128, 128, 3), np.float32)
        images[:, 40:80, 40:80] = 0.5
        return images
"""


@pytest.fixture
def grey_module(tmp_path, monkeypatch):
    """Return the file of a module in the current folder that has a method, `Grey`."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setenv(ALLOWED, "")
    folder = tmp_path / "folder"
    folder.mkdir()
    monkeypatch.chdir(folder)
    (folder / "grey_module.py").write_text(GREY)
    yield folder / "grey_module.py"
    sys.modules.pop("grey_module", None)  # the next test has another of this name
    for cached in (module_method, source_sha256):
        cached.cache_clear()


@pytest.mark.slow
def test_a_method_of_a_module_stays_where_no_command_names_it(
    copied, same_machine, tiny_weights, grey_module, monkeypatch
):
    """Its jobs are known by the identity in the manifest: its file may even be gone."""
    name = "grey_module:Grey"
    allow_modules([name])
    added = measure(options_of(copied, [name], workers=1))
    assert (added.done, added.reused, added.failed) == (6, 21, 0)
    records = read_records(copied)
    drawn = records[records["method"] == name]
    assert (drawn["outcome"] == "ok").all()
    assert len(drawn) == 3 * 2 * 2
    manifest = read_manifest(copied)
    assert f"source {source_sha256('grey_module')}" in manifest["identities"][name][1]

    monkeypatch.setenv(ALLOWED, "")
    text = grey_module.read_text()
    grey_module.unlink()
    again = measure(options_of(copied, ["splat"], workers=1))
    assert (again.done, again.reused) == (0, 27)
    assert read_records(copied).equals(records)
    assert read_manifest(copied)["identities"] == manifest["identities"]
    with open_folder(copied) as store:
        lost = next(job.key for job in store.listed() if job.name.method == name)
    with closing(sqlite3.connect(copied / STORE)) as database, database:
        database.execute("DELETE FROM job WHERE key = ?", [lost])
    before = every_file(copied)
    with pytest.raises(BadInput, match=f"{name} has jobs left, and its module is executed only"):
        measure(options_of(copied, ["splat"], workers=1))
    assert every_file(copied) == before

    # After an edit its work is another.
    grey_module.write_text(text.replace("0.5", "0.25"))
    for cached in (module_method, source_sha256):
        cached.cache_clear()
    allow_modules([name])
    edited = measure(options_of(copied, [name], workers=1))
    assert (edited.done, edited.reused) == (6, 21)
    assert read_manifest(copied)["identities"] != manifest["identities"]
    other = read_records(copied)
    assert (other[other["method"] == name]["ssim"].to_numpy() != drawn["ssim"].to_numpy()).all()


@pytest.mark.slow
def test_a_method_whose_weights_were_trained_again_is_measured_anew(
    copied, same_machine, tiny_weights, grey_module, capsys
):
    name = "grey_module:Grey"
    grey_module.write_text(GREY.replace("0.5", "np.load('level.npy')"))
    allow_modules([name])

    def scores(level):
        np.save("level.npy", np.float32(level))
        measured = measure(options_of(copied, [name], workers=1))
        records = read_records(copied, method=name)
        return (measured.done, measured.reused), records["ssim"].to_numpy()

    counts, first = scores(0.5)
    assert counts == (6, 21)
    assert f"{name}: known by its source and level.npy; other files" in capsys.readouterr().err
    counts, second = scores(0.25)
    assert counts == (6, 21)
    assert (second != first).all()
    counts, third = scores(0.5)  # the first ones are still there
    assert counts == (0, 27)
    assert (third == first).all()


def test_a_run_that_goes_on_elsewhere_says_what_differs_and_what_jobs_were_made_with(
    copied, same_machine, tiny_weights, capsys
):
    (here,) = read_manifest(copied)["environments"]
    facts = {name: value for name, value in here.items() if name != "jobs"}
    with open_folder(copied) as store:
        store.environment = facts | {"scipy": "0.1"}
        for key in stored_keys(copied):
            store.append(replace(store.result(key), arrays=store.arrays(key)))
    capsys.readouterr()
    grown = finished_options(tiny_weights, copied, limit=4)
    assert (measure(grown).done, measure(grown).done) == (7, 0)
    errors = capsys.readouterr().err
    told = (
        f"{copied}: goes on in another environment: scipy 0.1 -> {facts['scipy']}; 21 jobs are "
        "from before, and 'bench check' takes the wider tolerances; --fresh starts over"
    )
    assert errors.count(told) == 2
    assert read_manifest(copied)["environments"] == [
        {"jobs": 21, **facts, "scipy": "0.1"},
        {"jobs": 7, **facts},
    ]


@pytest.mark.slow
def test_a_method_is_added_on_the_objects_that_a_stopped_run_has(copied, same_machine, capsys):
    """A run that its budget has ended after two of three objects goes on with the third later."""
    manifest = read_manifest(copied)
    some = [manifest["objects"][i] for i in (0, 2)]
    write_manifest(copied, manifest | {"objects": some, "environment": {"numpy": "0.1"}})
    capsys.readouterr()
    options = options_of(copied, ["constant"], workers=1)
    assert (options.limit, options.views, options.conditions) == (2, 2, ("2048", "noise-0.10"))
    added = measure(options)
    # One job an object: the images of this method are the same under every condition.
    assert (added.objects, added.planned, added.done) == (2, 2, 2)
    after = read_manifest(copied)
    assert (after["objects"], after["planned"], after["request"]["limit"]) == (some, 3, 3)
    assert set(after["methods"]) == {*manifest["methods"], "constant"}
    errors = capsys.readouterr().err
    changed = ", ".join(["numpy", *(k for k in manifest["environment"] if k != "numpy")])
    assert f"{copied}: was made with another {changed}; all its jobs are done again" in errors


def test_methods_of_modules_do_not_go_to_other_nodes(no_machine):
    protocol = replace(asked(Path("new")), methods={"mine:METHOD": None})
    with (
        pytest.raises(BadInput, match="--ray: mine:METHOD is of a module of this machine; install"),
        executors_for(protocol, Options("chair-robustness", ray="local")),
    ):
        pytest.fail("a cluster was asked")
