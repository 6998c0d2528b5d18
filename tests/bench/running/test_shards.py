from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.running.shards import Shard, interleave, objects_to_search, read_shard
from data_prep.failures import BadInput


def test_every_nth_from_the_kth():
    assert Shard(1, 3).select("abcdefgh") == ("a", "d", "g")
    assert Shard(2, 3).select("abcdefgh") == ("b", "e", "h")
    assert Shard(3, 3).select("abcdefgh") == ("c", "f")
    assert Shard(1, 1).select("ab") == ("a", "b")
    assert Shard(3, 3).select("ab") == ()


@given(st.lists(st.integers(), max_size=40), st.integers(1, 12))
def test_what_was_interleaved_comes_back_in_its_order(things, count):
    assert interleave([Shard(k, count).select(things) for k in range(1, count + 1)]) == things


@pytest.mark.parametrize("shards", [["ab", "cde"], ["abc", "d"], ["ab", "c", "de"], ["", "a"]])
def test_what_cannot_have_been_interleaved(shards):
    with pytest.raises(ValueError, match="not interleaved"):
        interleave(shards)


@pytest.mark.parametrize(
    "text", ["", "1", "0/4", "5/4", "1/0", "-1/4", "1/4/4", "a/b", "1 /4", "१/४"]
)
def test_what_is_no_shard(text):
    assert read_shard("16/16") == Shard(16, 16)
    assert str(read_shard("2/16")) == "2/16"
    with pytest.raises(BadInput, match=r"--shard .*: give k/N, the kth of N parts"):
        read_shard(text)


def test_how_far_into_its_dataset_a_shard_reaches():
    """Of 11 objects shard 3 of 4 has numbers 3, 7 and 11."""
    assert objects_to_search({"objects": ["c/a"] * 3, "shard": "3/4"}) == 12
    assert objects_to_search({"objects": ["c/a"] * 3, "shard": None}) == 3
    assert objects_to_search({"objects": ["c/a"] * 3}) == 3
