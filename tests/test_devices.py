"""Device profiles: what ships, and how a profile that cannot be used says so."""

from __future__ import annotations

import math
from importlib import resources

import pytest

from inhalemon.devices import device_names, load_device
from inhalemon.exceptions import DeviceError
from inhalemon.values import DeviceKind, PhaseKind

PMDI = resources.files("inhalemon").joinpath("data/devices/pmdi.toml").read_text(encoding="utf-8")


def test_every_device_kind_has_a_profile():
    assert set(device_names()) == set(DeviceKind)
    for name in device_names():
        assert load_device(name).kind == name


def test_pmdi_is_not_calibrated_and_counts_presses_from_five_degrees():
    device = load_device("pmdi")
    assert not device.is_calibrated
    assert math.degrees(device.full_stroke_rad) == pytest.approx(5.0)
    assert math.degrees(device.partial_stroke_rad) == pytest.approx(1.5)
    assert device.steps[0] is PhaseKind.SHAKE


def test_ellipta_cover_travels_95_degrees():
    device = load_device("ellipta")
    assert device.is_calibrated
    assert math.degrees(device.full_travel_rad) == pytest.approx(95.0)
    assert math.degrees(device.full_stroke_rad) == pytest.approx(0.85 * 95.0)
    assert device.steps[0] is PhaseKind.OPEN


def test_calibrated_travel_replaces_the_angles_of_the_uncalibrated_device(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(PMDI + "\nfull_travel_deg = 12.0\n", encoding="utf-8")
    device = load_device(path)
    assert device.name == "mine"
    assert device.is_calibrated
    assert math.degrees(device.full_stroke_rad) == pytest.approx(0.6 * 12.0)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('kind = "pmdi"', 'kind = "spacer"', ("kind", "'spacer'", "pmdi, ellipta, hinge")),
        ("hinge_sign = 1", "hinge_sign = 2", ("hinge_sign", "2", "1 or -1")),
        ("hinge_sign = 1", "hinge_sign = true", ("hinge_sign", "True", "1 or -1")),
        ("hinge_axis = [1.0, 0.0, 0.0]", "hinge_axis = [1.0, 1.0, 0.0]", ("hinge_axis", "unit vector")),
        ("hinge_axis = [1.0, 0.0, 0.0]", 'hinge_axis = "x"', ("hinge_axis", "unit vector")),
        ("full_fraction = 0.60", "full_fraction = 1.6", ("full_fraction", "1.6", "fraction")),
        ("full_fraction = 0.60", "full_fraction = 0.10", ("partial < full",)),
        ("uncalibrated_full_deg = 5.0", "uncalibrated_full_deg = nan", ("uncalibrated_full_deg", "degrees")),
        ("uncalibrated_full_deg = 5.0", "", ("uncalibrated_full_deg", "missing")),
        ('"shake", "exhale"', '"shook", "exhale"', ("steps", "shake")),
        ('"shake", "exhale"', '"shake", "shake"', ("steps", "each step once")),
        ('moving_part = "lever"', 'moving_part = "lever"\ncolour = 1', ("colour", "unknown", "moving_part")),
        ('moving_part = "lever"', "moving_part = ", ("readable TOML",)),
    ],
)
def test_odd_profile_is_refused_with_file_field_found_and_wanted(tmp_path, old, new, words):
    assert old in PMDI
    path = tmp_path / "odd.toml"
    path.write_text(PMDI.replace(old, new), encoding="utf-8")
    with pytest.raises(DeviceError) as caught:
        load_device(path)
    for word in ("odd.toml", *words):
        assert word in str(caught.value)


def test_unknown_device_names_those_that_exist():
    with pytest.raises(DeviceError, match="'pdmi'; expected one of ellipta, hinge, pmdi"):
        load_device("pdmi")


def test_missing_profile_file_says_so(tmp_path):
    with pytest.raises(DeviceError, match="nowhere"):
        load_device(tmp_path / "nowhere.toml")
