"""Settings: every field has a range, held to from TOML and from Python alike, and no number in it breaks a stage."""

import dataclasses
import math
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

import inhalemon as im
from inhalemon.exceptions import SettingsError
from inhalemon.ranges import field_types
from inhalemon.settings import (
    AttitudeSettings,
    MotionSettings,
    PhaseSettings,
    QualitySettings,
    Settings,
)
from inhalemon.signals import moving_mean

SAMPLE = Path(__file__).parent.parent / "sample_data" / "pmdi_correct.csv"
FIELDS = [(stage, name) for stage, kind in field_types(Settings).items() for name in field_types(kind)]


def _as_toml(value):
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple):
        return f"[{', '.join(map(repr, value))}]"
    return repr(value)


def test_every_default_can_be_written_in_a_file():
    tables = dataclasses.asdict(Settings())
    text = "\n".join(
        "\n".join([f"[{stage}]", *(f"{name} = {_as_toml(value)}" for name, value in table.items())])
        for stage, table in tables.items()
    )
    assert Settings.from_toml(text) == Settings()
    assert Settings.from_toml(text).digest == Settings().digest


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[motion]\nblock_s = -5.0", r"\[motion\]: block_s is -5.0; expected a number from 0.005 to 10"),
        ("[motion]\nblock_s = nan", "block_s is nan; expected a number"),
        ("[motion]\nblock_s = inf", "block_s is inf; expected a number"),
        ("[motion]\nblock_s = true", "block_s is True; expected a number"),
        ('[motion]\nblock_s = "100"', "block_s is '100'; expected a number"),
        ("[lever]\nblock_s = 0", "block_s is 0; expected a number"),
        ("[quality]\nrate_block = 0", "rate_block is 0; expected a whole number"),
        ("[quality]\nrate_block = 50.0", "rate_block is 50.0; expected a whole number"),
        ("[quality]\nmax_gap_share = 1.5", "max_gap_share is 1.5; expected a number from 0 to 1"),
        ("[phases]\nsmooth_s = []", r"smooth_s is \[\]; expected a list"),
        ("[phases]\nsmooth_s = 0.1", "smooth_s is 0.1; expected a list"),
        ("[phases]\nsmooth_s = [0.1, -0.3]", "smooth_s is -0.3; expected a number"),
        ("[attitude]\nsmooth = 1", "smooth is 1; expected true or false"),
        ('[attitude]\nmethod = "madgwick"', "method is 'madgwick'; expected one of akf, akf_source, ekf, gyro"),
        ("[motion]\nblock = 1", "block is unknown; expected one of long_gap_s"),
        ("[motions]\nblock_s = 1", r"\[motions\] is unknown; expected one of clocks"),
        ("motion = 1", "motion is 1; expected a table"),
        ("[motion]\nblock_s = " + "1" * 5000, "Give a readable TOML file"),
        ("[motion]\nblock_s = " + "1" * 400, "block_s is 1111.*; expected a number"),
        ("a = " + "[" * 100_000, "Give a readable TOML file"),
    ],
)
def test_bad_settings_say_field_found_and_wanted(text, told):
    with pytest.raises(SettingsError, match=told):
        Settings.from_toml(text)


def test_settings_made_in_python_are_checked_too():
    for kind, name, value in (
        (MotionSettings, "block_s", 0.0),
        (QualitySettings, "rate_block", None),
        (AttitudeSettings, "method", "madgwick"),
        (Settings, "motion", {"block_s": 0.04}),
    ):
        with pytest.raises(SettingsError, match=f"{name} is "):
            kind(**{name: value})
    with pytest.raises(SettingsError, match="block_s is nan"):
        dataclasses.replace(MotionSettings(), block_s=math.nan)
    assert PhaseSettings(smooth_s=[1, 2]).smooth_s == (1.0, 2.0)


def test_a_mean_over_less_than_a_sample_is_the_sample_itself():
    """The compiled kernel does not look where it reads: a window of nothing would read beyond the array."""
    ramp = np.arange(40.0).reshape(20, 2)
    for width in (-25, 0, 1):
        assert np.array_equal(moving_mean(ramp, width), ramp)


def _scored(stage, name, value):
    """`scored`, or what the settings say of the value; runs in a process of its own, which a bad size may kill."""
    kind = field_types(Settings)[stage]
    try:
        settings = Settings(**{stage: kind(**{name: value})})
    except SettingsError:
        return "refused"
    im.score_recording(im.read_recording(SAMPLE), settings=settings)
    return "scored"


@pytest.fixture(scope="module")
def apart():
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield pool


JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.text(max_size=3),
    st.integers(),
    st.floats(),
    st.sampled_from([0, -1, 1, 10**6, 10**30, 0.0, -0.0, 1e-300, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e300, math.nan, math.inf]),
    st.lists(st.floats(), max_size=3),
    st.lists(st.floats(1e-6, 1e6), min_size=1, max_size=3),
    st.floats(-6.0, 6.0).map(lambda power: 10.0**power),
    st.integers(1, 10_000),
    st.sampled_from(["akf", "akf_source", "ekf", "gyro"]),
)


@hypothesis_settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(field=st.sampled_from(FIELDS), value=JUNK)
@example(field=("events", "smooth_s"), value=-5.0)
@example(field=("lever", "block_s"), value=0)
@example(field=("quality", "rate_block"), value=0)
@example(field=("attitude", "sd_start_scale"), value=1e4)  # an inhalation that outlasts its dose
def test_any_one_field_set_to_junk_is_refused_or_scored(apart, field, value):
    """Any other exception comes back as itself, and a crash breaks the pool."""
    assert apart.submit(_scored, *field, value).result(timeout=120) in {"refused", "scored"}
