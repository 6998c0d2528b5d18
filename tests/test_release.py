"""One version and one date, wherever they stand, and the command that raises them."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from bench.commands.cite import bibtex, cite
from studies.release import differences, version_of

ROOT = Path(__file__).parents[1]
FILES = ("pyproject.toml", "CITATION.cff", "CHANGELOG.md", "Makefile", "README.md")


@pytest.fixture
def checkout(tmp_path):
    """The files of a version 9.0.0 of 31 January 2027, as `make version` leaves them."""
    for name in FILES:
        shutil.copy(ROOT / name, tmp_path)
    changelog, top = tmp_path / "CHANGELOG.md", "## [Unreleased]\n"
    text = changelog.read_text("utf-8").replace(top, f"{top}\n## [9.0.0] - unreleased\n")
    changelog.write_text(text, "utf-8")
    arguments = ("make", "version", "VERSION=9.0.0", "DATE=2027-01-31")
    subprocess.run(arguments, cwd=tmp_path, check=True, capture_output=True)
    return tmp_path


def test_the_version_is_the_same_everywhere():
    assert differences(ROOT) == []


def test_one_command_raises_the_version_everywhere(checkout):
    assert version_of(checkout) == "9.0.0"
    assert differences(checkout) == []
    assert "  year = {2027},\n  note = {Version 9.0.0},\n" in (checkout / "README.md").read_text()
    assert "\n## [9.0.0] - 2027-01-31\n" in (checkout / "CHANGELOG.md").read_text("utf-8")


def test_the_address_of_a_release_is_cited_and_replaced(checkout):
    for url in ("https://example.org/old", "https://example.org/new"):
        arguments = ("make", "version", "VERSION=9.0.0", "DATE=2027-01-31", f"URL={url}")
        subprocess.run(arguments, cwd=checkout, check=True, capture_output=True)
    assert differences(checkout) == []
    citation = (checkout / "CITATION.cff").read_text("utf-8")
    assert yaml.safe_load(citation)["preferred-citation"]["repository-code"] == url
    assert bibtex(citation).count("  url = ") == 1
    assert f"  note = {{Version 9.0.0}},\n  url = {{{url}}},\n" in bibtex(citation)


@pytest.mark.parametrize(
    ("name", "text", "other", "lines"),
    [
        ("pyproject.toml", '"9.0.0"', '"9.0.1"', 3),  # two in CITATION.cff, and no section
        ("CITATION.cff", "\nversion: 9.0.0", "\nversion: 8.0.0", 1),
        ("CITATION.cff", "  year: 2027", "  year: 2026", 2),  # of the file, and of the BibTeX
        ("README.md", "Version 9.0.0", "Version 8.0.0", 1),
        ("CHANGELOG.md", "## [9.0.0] - 2027-01-31", "## [9.0.0] - unreleased", 1),
        ("CHANGELOG.md", "## [1.0.0] - 2026-11-26", "## [1.0.0] - unreleased", 1),
    ],
)
def test_each_other_version_or_date_is_named(checkout, name, text, other, lines):
    path = checkout / name
    before = path.read_text("utf-8")
    assert text in before
    path.write_text(before.replace(text, other), "utf-8")
    assert len(differences(checkout)) == lines


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
