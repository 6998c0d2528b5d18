from __future__ import annotations

import pytest

from baselines.splat import Splat
from baselines.surface import SurfaceApss
from bench.catalogue.methods import COST_VARIANTS, METHODS, find_method
from bench.catalogue.parameters import PARAMETERS, find_setting
from data_prep.failures import BadInput


def test_an_id_says_parameter_and_value():
    setting = find_setting("surface-apss@resolution=64")
    assert setting is not None
    assert (setting.parameter.method, setting.parameter.name) == ("surface-apss", "resolution")
    assert setting.value == 64
    assert isinstance(setting.value, int)
    assert setting.fields == {"resolution": 64}


@pytest.mark.parametrize(
    "method", ["splat", "pc2pix@bf16", "pc2pix@a=b.safetensors", "surface-apss@64", "a=b", ""]
)
def test_other_ids_say_none(method):
    assert find_setting(method) is None


@pytest.mark.parametrize(
    ("method", "expected"),
    [
        ("surface-apss@resolution=64", SurfaceApss(resolution=64)),
        ("splat@spread=1.5", Splat(spread=1.5)),
    ],
)
def test_the_renderer_has_its_parameter_set(method, expected):
    assert find_method(method).load("cpu") == expected
    assert find_method(method).id == method


def test_the_bounds_belong_to_the_range():
    for value in (10, 400):
        assert find_setting(f"surface-apss@resolution={value}") is not None
    for value in (9, 401):
        with pytest.raises(BadInput, match="must be a whole number from 10 to 400"):
            find_setting(f"surface-apss@resolution={value}")


@pytest.mark.parametrize("text", ["", "x", "nan", "inf", "1e9", "-1", "0"])
def test_what_is_no_value_is_refused_by_name(text):
    with pytest.raises(BadInput, match=rf"spread must be a number from 0.1 to 10, not '{text}'"):
        find_method(f"splat@spread={text}")


def test_a_whole_number_is_asked_for():
    with pytest.raises(BadInput, match=r"whole number .* not '64.5'"):
        find_method("surface-apss@resolution=64.5")


@pytest.mark.parametrize("method", ["splat@size=1", "nothing@spread=1", "pc2pix@width=2"])
def test_an_unknown_parameter_is_refused_with_the_known_ones(method):
    with pytest.raises(BadInput, match=r"unknown variant .* splat@spread="):
        find_method(method)


def test_every_parameter_is_a_field_of_a_method():
    for parameter in PARAMETERS:
        method = find_method(parameter.method)
        for value in (parameter.low, parameter.high):
            turned = find_method(f"{parameter.method}@{parameter.name}={value:g}")
            assert getattr(turned.load("cpu"), parameter.field) == value
            assert (turned.version, turned.weights_file) == (method.version, method.weights_file)


def test_yardsticks_are_found_but_no_methods_of_the_list():
    for variant in COST_VARIANTS:
        assert find_method(variant.id) is variant
        assert variant not in METHODS
