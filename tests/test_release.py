"""One version and one date, wherever they stand, and the command that raises them."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import yaml

from bench.commands.cite import bibtex, cite

ROOT = Path(__file__).parents[1]
FILES = ("pyproject.toml", "CITATION.cff", "CHANGELOG.md", "Makefile", "README.md")
SECTION = re.compile(r"^## \[(\d+\.\d+\.\d+)\] - (\d{4}-\d\d-\d\d|unreleased)$", re.MULTILINE)


def checked_version(folder: Path) -> str:
    """Return the version; assert that it and the date are the same everywhere."""
    cited = yaml.safe_load((folder / "CITATION.cff").read_text("utf-8"))
    version = tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    assert cited["version"] == cited["preferred-citation"]["version"] == version
    assert str(cited["date-released"])[:4] == str(cited["preferred-citation"]["year"])
    assert (
        bibtex((folder / "CITATION.cff").read_text("utf-8")) in (folder / "README.md").read_text()
    )
    (latest, _), *_ = sections = SECTION.findall((folder / "CHANGELOG.md").read_text("utf-8"))
    # Version 0.1.0 has no section of its own.
    assert dict(sections).get(version, str(cited["date-released"])) == str(cited["date-released"])
    assert {number for number, date in sections if date == "unreleased"} <= {latest}
    return version


def test_one_command_raises_the_version_everywhere(tmp_path):
    checked_version(ROOT)
    for name in FILES:
        shutil.copy(ROOT / name, tmp_path)
    changelog, top = tmp_path / "CHANGELOG.md", "## [Unreleased]\n"
    text = changelog.read_text("utf-8").replace(top, f"{top}\n## [9.0.0] - unreleased\n")
    changelog.write_text(text, "utf-8")
    arguments = ("make", "version", "VERSION=9.0.0", "DATE=2027-01-31")
    subprocess.run(arguments, cwd=tmp_path, check=True, capture_output=True)
    assert checked_version(tmp_path) == "9.0.0"
    assert "  year = {2027},\n  note = {Version 9.0.0},\n" in (tmp_path / "README.md").read_text()
    assert "\n## [9.0.0] - 2027-01-31\n" in changelog.read_text("utf-8")


def test_the_command_prints_what_yaml_reads_in_the_file(capsys):
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    program, (paper,) = cited["preferred-citation"], cited["references"]
    (author,) = paper["authors"]
    cite()
    printed = re.findall(r"^  (\w+) = \{(.*)\},$", capsys.readouterr().out, re.MULTILINE)
    assert printed == [
        ("author", f"{{{program['authors'][0]['name']}}}"),
        ("title", f"{{{program['title']}}}"),
        ("year", str(program["year"])),
        ("note", f"Version {program['version']}"),
        ("author", f"{author['family-names']}, {author['given-names']}"),
        ("title", f"{{{paper['title']}}}"),
        ("booktitle", paper["collection-title"]),
        ("year", str(paper["year"])),
    ]
