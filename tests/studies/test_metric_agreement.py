"""Kendall's rank correlation of metrics, from the tables of a run."""

from __future__ import annotations

import pandas as pd

from studies.metric_agreement import agreement, read_values

METHODS = ("pc2pix", "splat-net", "splat", "blank", "true-mesh", "best-classical")
SSIM = (0.9, 0.8, 0.7, 0.6, 1.0, 0.1)
VALUES = {  # a table each
    "table_ssim": ("ssim", SSIM),
    "table_detail": ("lpips", (0.1, 0.2, 0.4, 0.3, 0.0, 0.9)),  # one pair of six the other way
    "metric_flip": ("flip", (0.4, 0.3, 0.2, 0.1, 0.0, 0.9)),  # all of them
    "metric_equal": ("ms-ssim", (0.50001, 0.5, 0.5, 0.5, 1.0, 1.0)),  # equal as they are printed
    "headline": ("ssim", SSIM),
}


def tables(folder, values=VALUES):
    (folder / "tables").mkdir()
    for name, (metric, of_methods) in values.items():
        rows = [
            {"method": method, "condition": condition, "class": "chair", "metric": metric,
             "failures_as_blank": value, "value": 0.0}
            for condition in ("2048", "1024")
            for method, value in zip(METHODS, of_methods, strict=True)
        ]  # fmt: skip
        pd.DataFrame(rows).to_csv(folder / "tables" / f"{name}.csv", index=False)
    pd.DataFrame({"other": [1]}).to_csv(folder / "tables" / "frontier.csv", index=False)
    return folder


def test_correlations_are_those_of_the_orders(tmp_path):
    values = read_values(tables(tmp_path))
    assert list(values.index.get_level_values("method")) == 2 * list(METHODS[:4])
    assert values.loc[("2048", "chair", "splat"), "lpips"] == -0.4
    rows = agreement(values, ["ssim", "lpips", "flip", "ms-ssim", "fd-absent"])
    assert list(dict.fromkeys(row["condition"] for row in rows)) == ["2048", "1024"]
    taus = {(row["metric"], row["other"]): row["tau"] for row in rows}
    assert taus == {
        **dict.fromkeys((("ssim", "lpips"), ("lpips", "ssim")), 0.667),  # (5 - 1) / 6
        **dict.fromkeys((("ssim", "flip"), ("flip", "ssim")), -1.0),
        **dict.fromkeys((("lpips", "flip"), ("flip", "lpips")), -0.667),
    }
    assert {row["methods"] for row in rows} == {4}
