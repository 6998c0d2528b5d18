from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from baselines.splat_net.network import DEFAULT
from bench.commands.train import do_without
from benchmarks.splat_net_ablation import METRICS, PARTS, TESTED, WHOLE, differences, to_markdown
from data_prep.failures import BadInput


def table(offset: float) -> pd.DataFrame:
    base = np.linspace(0.5, 0.7, 6)
    return pd.DataFrame(
        {"condition": c, "chair": i, **dict.fromkeys(METRICS, base[i] + offset)}
        for c in TESTED
        for i in range(len(base))
    )


def test_differences_are_against_the_whole_network() -> None:
    found = differences({WHOLE: table(0.0), "normals": table(-0.02), "far": table(0.01)})
    assert len(found) == 3 * len(TESTED) * len(METRICS)
    for part, change in ((WHOLE, 0.0), ("normals", -0.02), ("far", 0.01)):
        rows = found[found["without"] == part]
        # chairs differ, changes do not: every resample has the same mean
        for column in ("change", "ci_low", "ci_high"):
            assert rows[column].to_numpy() == pytest.approx(np.full(len(rows), change), abs=1e-12)
        assert rows["value"].to_numpy() == pytest.approx(0.6 + change, abs=1e-12)


def test_a_chair_without_thin_parts_is_left_out_of_both() -> None:
    whole, other = table(0.0), table(-0.02)
    whole.loc[0, "thin_recall"] = np.nan
    found = differences({WHOLE: whole, "far": other})
    rows = found[(found["without"] == "far") & (found["metric"] == "thin_recall")]
    assert rows["change"].to_numpy() == pytest.approx(-0.02, abs=1e-12)


def test_the_table_has_a_row_for_each_part() -> None:
    found = differences({WHOLE: table(0.0), "discs": table(-0.02)})
    lines = to_markdown(found, {WHOLE: (6.0, 4.0), "discs": (5.5, 3.25)}).splitlines()
    assert lines[2].startswith("| nothing | 0.600 | 0.600 |")
    assert lines[3] == ("| discs | " + "-0.020 [-0.020, -0.020] | " * 5 + "5.5 | 3.25 |")


@pytest.mark.parametrize(
    ("part", "channels"),
    # of 22: normals and variation at three scales, three densities, depth and density twice, ...
    [("normals", 10), ("density", 19), ("flattened", 18), ("far", 21), ("discs", 21)],
)
def test_what_is_left_out(part: str, channels: int) -> None:
    network = do_without(DEFAULT, (part,))
    assert DEFAULT.inputs.channels == 22
    assert network.inputs.channels == channels
    assert part in PARTS
    with pytest.raises(BadInput, match="--without shadows"):
        do_without(DEFAULT, ("shadows",))
