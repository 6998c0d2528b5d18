"""`method.toml`: what the author of a method entered by images states."""

from __future__ import annotations

import json

import pytest

from bench.catalogue.images import (
    Claims,
    address_of,
    entered_claims,
    manifest_entry,
    read_claims,
)
from data_prep.failures import BadInput

from ..builders import refusal

STATED = {
    "name": "neural-points",
    "source": "a network over points, arXiv:0000.00000",
    "trained_on": "ShapeNet cars",
    "hardware": "one H100",
    "prepare_s": 0.5,
    "draw_s": 2,
    "licence": "CC-BY-4.0",
    "export": "0123456789abcdef" * 4,
}
KEYS = "name, source, trained_on, hardware, prepare_s, draw_s, licence, export, version"


def toml_of(**changes) -> str:
    values = {key: value for key, value in (STATED | changes).items() if value is not None}
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in values.items())


def problem(tmp_path, text: str) -> str:
    path = tmp_path / "method.toml"
    path.write_text(text)
    said = refusal(read_claims, tmp_path, {"splat"})
    assert said.startswith(f"{path}: ")
    return said.removeprefix(f"{path}: ")


def test_the_facts_are_read(tmp_path):
    (tmp_path / "method.toml").write_text(toml_of())
    claims = read_claims(tmp_path, {"splat"})
    assert claims == Claims(**STATED)
    assert claims.version == ""
    (tmp_path / "method.toml").write_text(toml_of(version="1.2"))
    assert read_claims(tmp_path, ()).version == "1.2"


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"name": None}, "no key name; add it, as docs/entering.md shows"),
        ({"export": None}, "no key export; add it, as docs/entering.md shows"),
        ({"speed": 1}, f"unknown key 'speed'; the keys are {KEYS}"),
        ({"name": "Neural_Points"}, "name 'Neural_Points' is not kebab-case (a-z, 0-9 and single"),
        ({"name": "../up"}, "name '../up' is not kebab-case (a-z, 0-9 and single hyphens), and"),
        ({"name": "splat"}, "name 'splat' is an id of this installation; give another name"),
        ({"source": ""}, "source '' has 0 characters, not 1..200; give a short text in one line"),
        ({"source": "a\nb"}, "source \"'a\\\\nb'\" has characters that cannot be seen; give a"),
        ({"hardware": ["H100"]}, "hardware \"['H100']\" is not a text; give a short text in one"),
        ({"draw_s": -1}, "draw_s '-1' is no number of seconds from 0 to 1e+06; give one"),
        ({"draw_s": "2"}, "draw_s \"'2'\" is no number of seconds from 0 to 1e+06; give one"),
        ({"export": "abc"}, "export 'abc' is no sha256; copy the identifier in the croissant.json"),
    ],
    ids=lambda value: str(value)[:30],
)
def test_a_wrong_fact_is_named(tmp_path, changes, expected):
    assert problem(tmp_path, toml_of(**changes)).startswith(expected)


@pytest.mark.parametrize("number", ["nan", "inf", "true", "9" * 400])
def test_a_time_is_a_finite_number(tmp_path, number):
    text = toml_of(draw_s=None) + f"draw_s = {number}\n"
    named = number.capitalize() if number == "true" else number
    assert problem(tmp_path, text).startswith(f"draw_s '{named[:40]}")
    assert " is no number of seconds" in problem(tmp_path, text)


def test_a_file_that_is_none_is_named(tmp_path):
    assert problem(tmp_path, "name = ").startswith("not TOML (Invalid value")
    assert problem(tmp_path, "x = " + "[" * 50_000).startswith("not TOML (")
    assert problem(tmp_path, "draw_s = " + "9" * 5_000).startswith("not TOML (")
    assert problem(tmp_path, "#" * 70_000).endswith("give a smaller file")
    (tmp_path / "method.toml").unlink()
    with pytest.raises(BadInput, match=r"method\.toml: no such file$"):
        read_claims(tmp_path, ())
    with pytest.raises(BadInput, match=r"absent: no such folder; give a tree of images with its"):
        read_claims(tmp_path / "absent", ())


def test_a_manifest_has_the_facts_and_the_place(tmp_path):
    claims = Claims(**STATED)
    manifest = manifest_entry({"neural-points": (tmp_path, claims)})
    assert entered_claims(manifest, "neural-points") == claims
    assert address_of(manifest, "neural-points") == f"images:{tmp_path}"
    assert entered_claims(manifest, "splat") is None
    assert address_of(manifest, "splat") == "splat"
    assert manifest_entry({}) == {}


@pytest.mark.parametrize("entered", [None, [], {"neural-points": 1}, {"neural-points": {"x": 1}}])
def test_a_damaged_entry_of_a_manifest_is_as_none(entered):
    manifest = {"entered": entered}
    assert entered_claims(manifest, "neural-points") is None
    assert address_of(manifest, "neural-points") == "neural-points"
