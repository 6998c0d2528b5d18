from __future__ import annotations

import pytest

from bench.catalogue.methods import COST_VARIANTS, METHODS, PARAMETERS, find_method, find_setting
from data_prep.failures import BadInput


def test_an_id_says_parameter_and_value():
    setting = find_setting("surface-apss@resolution=64")
    assert setting is not None
    assert (setting.parameter.method, setting.parameter.name) == ("surface-apss", "resolution")
    assert setting.value == 64
    assert isinstance(setting.value, int)


@pytest.mark.parametrize(
    "method", ["splat", "pc2pix@paper", "pc2pix@a=b.safetensors", "surface-apss@64", "a=b", ""]
)
def test_other_ids_say_none(method):
    assert find_setting(method) is None


@pytest.mark.parametrize("parameter", PARAMETERS, ids=lambda parameter: parameter.method)
def test_the_renderer_has_its_parameter_set_within_the_bounds(parameter):
    method = find_method(parameter.method)
    step = 1 if parameter.whole else 0.01
    for value in (parameter.low, parameter.high):
        variant = find_method(f"{parameter.method}@{parameter.name}={value:g}")
        assert variant.id == f"{parameter.method}@{parameter.name}={value:g}"
        assert getattr(variant.load("cpu"), parameter.field or parameter.name) == value
        assert (variant.version, variant.weights_file) == (method.version, method.weights_file)
    for value in (parameter.low - step, parameter.high + step):
        with pytest.raises(BadInput, match=rf"{parameter.name} must be a .*not '{value:g}'"):
            find_method(f"{parameter.method}@{parameter.name}={value:g}")


@pytest.mark.parametrize(
    ("method", "message"),
    [
        *(
            (f"splat@spread={text}", rf"spread must be a number from 0.1 to 10, not '{text}'")
            for text in ("", "x", "nan", "inf", "1e9", "-1")
        ),
        (
            "surface-apss@resolution=64.5",
            r"resolution must be a whole number from 10 to 400, not '64.5'",
        ),
        ("splat@size=1", r"unknown variant 'splat@size=1': there are .*splat@spread="),
        ("nothing@spread=1", r"unknown variant .*splat@spread="),
        ("pc2pix@width=2", r"unknown variant .*splat@spread="),
    ],
)
def test_what_is_no_parameter_or_value_is_refused_by_name(method, message):
    with pytest.raises(BadInput, match=message):
        find_method(method)


def test_cost_variants_are_found_but_no_methods_of_the_list():
    for variant in COST_VARIANTS:
        assert find_method(variant.id) is variant
        assert variant not in METHODS
