"""One version and one date, wherever they stand, and the command that raises them."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[1]
FILES = ("pyproject.toml", "CITATION.cff", "CHANGELOG.md", "Makefile")
SECTION = re.compile(r"^## \[(\d+\.\d+\.\d+)\] - (\d{4}-\d\d-\d\d|unreleased)$", re.MULTILINE)


def citation(folder: Path) -> dict[str, Any]:
    return yaml.safe_load((folder / "CITATION.cff").read_text("utf-8"))


def project_version(folder: Path) -> str:
    return tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]["version"]


def sections(folder: Path) -> list[tuple[str, str]]:
    return SECTION.findall((folder / "CHANGELOG.md").read_text("utf-8"))


def check(folder: Path) -> None:
    """Assert that the version and the date are the same everywhere."""
    cited, version = citation(folder), project_version(folder)
    assert cited["version"] == cited["preferred-citation"]["version"] == version
    assert str(cited["date-released"])[:4] == str(cited["preferred-citation"]["year"])
    dates = dict(sections(folder))
    # Version 0.1.0 has no section of its own.
    if version in dates:
        assert dates[version] == str(cited["date-released"])
    assert {v for v, date in dates.items() if date == "unreleased"} <= {sections(folder)[0][0]}


def test_the_version_is_the_same_everywhere():
    check(ROOT)


@pytest.fixture
def folder(tmp_path):
    for name in FILES:
        shutil.copy(ROOT / name, tmp_path)
    return tmp_path


def test_one_command_raises_the_version(folder):
    """The section of that version gets its date; a raised version of one file alone is found."""
    version = "9.0.0"
    changelog = folder / "CHANGELOG.md"
    top = "## [Unreleased]\n"
    text = changelog.read_text("utf-8")
    changelog.write_text(text.replace(top, f"{top}\n## [{version}] - unreleased\n"), "utf-8")
    before = {name: (folder / name).read_text("utf-8").splitlines() for name in FILES}
    arguments = ("make", "version", f"VERSION={version}", "DATE=2027-01-31")
    subprocess.run(arguments, cwd=folder, check=True, capture_output=True)
    assert project_version(folder) == version
    assert sections(folder)[0] == (version, "2027-01-31")
    check(folder)
    changed = {
        name: sum(a != b for a, b in zip(lines, after, strict=True))
        for name, lines in before.items()
        if (after := (folder / name).read_text("utf-8").splitlines()) != lines
    }
    assert changed == {"pyproject.toml": 1, "CITATION.cff": 4, "CHANGELOG.md": 1}
    project = folder / "pyproject.toml"
    project.write_text(project.read_text().replace(f'version = "{version}"', 'version = "9.9.9"'))
    with pytest.raises(AssertionError):
        check(folder)


def test_a_version_has_to_be_given(folder):
    done = subprocess.run(
        ("make", "version", "VERSION="), cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stderr.startswith("give the version: make version VERSION=1.0.0\n")
