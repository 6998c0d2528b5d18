"""The table of `auto` from scored clouds, and what it gains where an object is left out."""

from __future__ import annotations

import pytest

from bench.catalogue.auto import AutoTable, Candidate, CloudEstimate
from data_prep.failures import BadInput
from studies.auto_table import (
    ScoredCloud,
    check_costs,
    fit,
    gain,
    read_costs,
    source_text,
    threshold,
    worth_their_cost,
)

COSTS = {
    **{(condition, "quick"): 10.0 for condition in ("2048", "512", "noise-0.05")},
    **{("2048", "slow"): 100.0, ("512", "slow"): 40.0, ("noise-0.05", "slow"): 150.0},
}


def cloud(obj: str, condition: str, noise: float, quick: float, slow: float) -> ScoredCloud:
    points = 512 if condition == "512" else 2048
    estimate = CloudEstimate(points, noise * 0.1, 0.1)
    return ScoredCloud(obj, condition, estimate, {"quick": quick, "slow": slow})


CLOUDS = [
    scored
    for obj, noise in (("a", 0.1), ("b", 0.2), ("c", 0.3))
    for scored in (
        cloud(obj, "2048", noise, quick=0.6, slow=0.9),
        cloud(obj, "512", noise, quick=0.5, slow=0.4),
        cloud(obj, "noise-0.05", noise + 0.5, quick=0.3, slow=0.5),
    )
]
FITTED = AutoTable(
    0.45,
    clean={
        2048: (Candidate("slow", 0.9, 100.0), Candidate("quick", 0.6, 10.0)),
        512: (Candidate("quick", 0.5, 10.0),),
    },
    noisy={2048: (Candidate("slow", 0.5, 150.0), Candidate("quick", 0.3, 10.0))},
)


def test_the_table_of_scores():
    assert fit(CLOUDS, COSTS) == FITTED


def test_the_threshold_has_the_fewest_errors():
    odd = cloud("d", "2048", 0.9, 0.0, 0.0)  # a clean cloud that looks noisy
    assert threshold([*CLOUDS, odd]) == 0.45


def test_what_costs_no_less_than_a_better_one_is_left_out():
    candidates = [
        Candidate(*c) for c in (("a", 0.5, 3), ("b", 0.6, 3), ("c", 0.4, 1), ("d", 0.7, 9))
    ]
    assert [c.method for c in worth_their_cost(candidates)] == ["d", "b", "c"]


@pytest.mark.parametrize(
    ("budget", "single", "single_score", "auto_score", "oracle_score", "closed", "refused"),
    [
        (None, "slow", "0.6000", "0.6333", "0.6333", "1.00", "0.000"),
        (120, "quick", "0.4667", "0.5667", "0.5667", "1.00", "0.000"),
        (10, "quick", "0.4667", "0.4667", "0.4667", "", "0.000"),
        (9, "", "", "", "", "", "1.000"),
    ],
)
def test_what_it_gains(budget, single, single_score, auto_score, oracle_score, closed, refused):
    row = gain(CLOUDS, COSTS, budget)
    expected = {"single": single, "single_score": single_score, "auto_score": auto_score}
    expected |= {"oracle_score": oracle_score, "closed": closed, "refused": refused}
    assert {name: row[name] for name in expected} == expected


def test_an_object_has_no_part_in_its_own_choice():
    """Without the odd one the table says slow, which draws nothing of it; with it, quick."""
    odd = [c if c.obj != "a" else cloud("a", c.condition, 0.1, 0.9, 0.0) for c in CLOUDS[::3]]
    row = gain([*odd, *CLOUDS[2::3]], COSTS, None)
    assert (row["single"], row["auto_score"]) == ("slow", "0.4500")
    assert row["oracle_score"] == "0.7000"


def test_a_cloud_that_is_taken_for_another_may_cost_more():
    wrong = cloud("d", "noise-0.05", 0.1, 0.3, 0.5)  # looks clean: slow for 100 ms, and takes 150
    row = gain([*CLOUDS, wrong], COSTS, 120)
    assert row["over"] == "0.100"


def test_costs_are_those_of_one_view(tmp_path):
    path, other = tmp_path / "a.csv", tmp_path / "b.csv"
    path.write_text("condition,views,method,cost_ms\n512,1,splat,8\n512,20,splat,90\n512,1,x,\n")
    other.write_text("condition,views,method,cost_ms\n512,1,splat,7\n2048,1,splat,9\n")
    assert read_costs([path, other]) == {("512", "splat"): 8.0, ("2048", "splat"): 9.0}
    with pytest.raises(
        BadInput, match=r"no cost of slow at 2048,512,noise-0\.05; measure them, 'ben"
    ):
        check_costs(CLOUDS, {key: cost for key, cost in COSTS.items() if key[1] == "quick"})


def test_the_module_has_the_table():
    names: dict[str, object] = {}
    text = source_text(FITTED, ["About it."])
    exec(text, names)
    assert names["TABLE"] == FITTED
    assert text.startswith('"""The measured table of `auto`. `python -m studies.auto_table` writes')
