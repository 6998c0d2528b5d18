"""Folders of runs that others have made or altered: one line and status 2, or the usual result."""

from __future__ import annotations

import copy
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.records.folder import load_manifest, read_finished
from bench.records.frames import read_jobs
from data_prep.failures import BadInput

from .builders import EXTRACTORS, make_manifest, rewrite, write_run

STORED = Path(__file__).parent / "data" / "stored-run" / "manifest.json"
OTHERS = (None, True, 7, 1.5, "x", [], {}, ["\ud800"], 10**30)


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A run whose manifest has every entry that a run of jobs can have."""
    stored = json.loads(STORED.read_text())
    names = {name: make_manifest()[name] for name in ("methods", "conditions", "objects")}
    entries = {
        "identities": {method: [1, "", "auto"] for method in names["methods"]},
        "request": stored["request"] | {"methods": names["methods"], "limit": 3},
        "planned": 3,
        "entered": {"splat": {"tree": "/x", "name": "splat"}},
        "cluster": {"address": "local", "version": "2"},
        "truth": "coloured",
    }
    return write_run(tmp_path_factory.mktemp("foreign") / "run", **stored | names | entries)


@pytest.fixture
def copied(made, tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copytree(made, tmp_path / "run"))


def places(value: Any, above: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the place of each entry of a manifest, three levels down."""
    entries = value.items() if isinstance(value, dict) else enumerate(value[:1])
    for name, element in entries:
        yield (*above, name)
        if isinstance(element, (dict, list)) and len(above) < 2:
            yield from places(element, (*above, name))


def altered(manifest: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield a manifest without each entry, and with values of other types in its place."""
    for place in places(manifest):
        for other in ("removed", *OTHERS):
            changed: Any = copy.deepcopy(manifest)
            inner = changed
            for name in place[:-1]:
                inner = inner[name]
            if other == "removed":
                del inner[place[-1]]
            elif type(other) is type(inner[place[-1]]) and other not in (OTHERS[-1], OTHERS[-2]):
                continue
            else:
                inner[place[-1]] = other
            yield f"{'.'.join(map(str, place))} {other}", changed


def one_line(error: str) -> bool:
    return error.startswith("bench: ") and error.count("\n") == 1


COMMANDS = (
    ("table", "run"),
    ("check", "run"),
    ("check", "run", "--claims"),
    ("check", "run", "--again", "0.1"),
    ("compare", "run", "--methods", "splat,blank"),
    ("compare", "run", "other"),
    ("report", "run"),
    ("score", "run", "--metrics", "flip"),
    ("add", "splat", "run"),
    ("run", "--config", "run/manifest.json", "--dry-run"),
    ("run", "--suite", "chair-robustness", "--limit", "3", "--views", "2", "--out", "run"),
)


def problem(read: Any, *arguments: Any) -> str:
    try:
        read(*arguments)
    except BadInput as error:
        return str(error)
    return ""


MAY_LACK = {"condition_identities", "workers", "code", "git", "stage_seconds", "worker_shares"}
MAY_LACK |= {"cluster", "entered", "truth", "environments"}


def test_every_entry_of_a_manifest_has_a_type_and_few_may_lack(copied):
    path = copied / "manifest.json"
    accepted, lacking = [], set()
    for what, changed in altered(json.loads(path.read_text())):
        path.write_text(json.dumps(changed))
        reasons = problem(load_manifest, path), problem(read_finished, copied)
        assert "\n" not in "".join(reasons), what
        if not all(reasons):
            entry, _, other = what.partition(" ")
            if other != "removed":
                accepted.append(what)
            elif "." not in entry:
                lacking.add(entry)
    assert lacking == MAY_LACK
    either = {"cluster None", "machine.memory_gib 7", "finished None"}
    either |= {w for w in accepted if w.endswith(" 7") and "_s" in w}
    assert {*accepted} == either


@pytest.mark.slow
@pytest.mark.parametrize("arguments", COMMANDS, ids=" ".join)
def test_no_command_stumbles_over_a_manifest(copied, command, no_machine, arguments):
    """The schema lets some values pass, and refuses others."""
    shutil.copytree(copied, "other")
    path = copied / "manifest.json"
    manifest = json.loads(path.read_text())
    usual, _, _ = command(*arguments)
    for number, (what, changed) in enumerate(altered(manifest)):
        is_top = what.endswith(" removed") and "." not in what
        if is_top or number % 40 == 0:
            path.write_text(json.dumps(changed))
            status, _, error = command(*arguments)
            assert status == usual or (status == 2 and one_line(error)), (what, error)
            path.write_text(json.dumps(manifest))


@pytest.mark.parametrize("value", [None, np.nan], ids=range(2))
def test_features_that_lack_images_are_named(copied, command, value):
    """Some jobs have features of no image, or no numbers."""

    def change(result, arrays):
        lacking = {name: np.full_like(arrays[name], value) for name in EXTRACTORS if value}
        return result, {"images": arrays["images"]} | lacking

    for job in read_jobs(copied):
        if job.name[:2] == ("splat", "512"):
            rewrite(copied, job.key, change)
    for arguments in (("table", "run"), ("report", "run")):
        status, _, error = command(*arguments)
        assert (status, one_line(error)) == (2, True)
        assert ": no features (" in error


def test_a_terminal_gets_no_orders_from_names(tmp_path, command, monkeypatch):
    """A pipe gets them as they are."""
    name = "splat\x1b[31m\x9b"
    run = write_run(tmp_path / "run", methods=[name, "true-mesh", "blank"])
    for terminal, shown in ((False, name), (True, r"splat\x1b[31m\x9b")):
        for format_ in ("csv", "json"):
            monkeypatch.setattr("sys.stdout.isatty", lambda: terminal)  # noqa: B023
            status, out, _ = command("table", run, "--format", format_)
            assert status == 0
            assert (shown in out) or (format_ == "json" and r"\u001b" in out)
            assert terminal == out.replace("\n", "").isprintable()
