"""`bench new` writes all of a package or nothing."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from bench.commands.new import TEMPLATES, PluginKind, write_package
from data_prep.failures import CannotWrite

REPOSITORY = Path(__file__).parents[3]


def test_nothing_is_left_of_a_package_that_cannot_be_written(tmp_path, monkeypatch):
    def full(*arguments):
        raise OSError(28, "No space left")

    monkeypatch.setattr(Path, "rename", full)
    with pytest.raises(CannotWrite, match=r"mine: cannot be written \(No space left\); give --out"):
        write_package(PluginKind.method, "mine", tmp_path / "mine")
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize("kind", PluginKind)
def test_a_package_is_the_example_under_another_name(command, tmp_path, kind):
    """Back under its name it is the example, to the letter."""
    folder, template = tmp_path / "there", TEMPLATES[kind]
    status, out, _ = command("new", kind, "zebra-crossing", "--out", folder)
    assert status == 0
    assert out.splitlines()[-1] == (
        f"next: cd {folder}; bench test zebra_crossing:{template.tested}"
    )
    written = sorted(path for path in folder.rglob("*") if path.is_file())
    module = template.id.replace("-", "_")
    for path in written:
        name = str(path.relative_to(folder)).replace("zebra_crossing", module)
        text = path.read_text().replace("zebra-crossing", template.id)
        example = REPOSITORY / "examples" / str(kind) / name
        assert text.replace("zebra_crossing", module) == example.read_text(), name
    assert len(written) >= 4
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    attribute = template.tested.partition(":")[0]
    assert project["entry-points"] == {
        f"pc2pix_bench.{kind}s": {"zebra-crossing": f"zebra_crossing:{attribute}"}
    }
    assert len((folder / "README.md").read_text().splitlines()) == 5
