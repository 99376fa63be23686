"""Nanoseconds a sample of the attitude filter, beside VQF and imufusion in the same run.

`make bench` runs it; the CPU's time is what counts, and the fastest round, because other work on the machine only adds.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import imufusion
import numpy as np
import pytest
from vqf import VQF, offlineVQF

import inhalemon as im
from inhalemon.settings import AttitudeSettings

N_SAMPLES = 20_000
RATE_HZ = 100.0
RESULTS: dict[str, float] = {}


@pytest.fixture(scope="module")
def track():
    """Shaking about upright: every branch of the filters is taken."""
    rng = np.random.default_rng(0)
    time_s = np.arange(N_SAMPLES) / RATE_HZ
    acc = np.array([0.0, 0.0, 9.81]) + rng.normal(0.0, 3.0, (N_SAMPLES, 3))
    return im.ImuTrack(time_s, acc, rng.normal(0.0, 1.0, (N_SAMPLES, 3)))


@pytest.fixture(scope="module", autouse=True)
def table(pytestconfig: pytest.Config) -> Iterator[None]:
    yield
    lines = ["", "", "attitude at 100 Hz, ns of CPU a sample"]
    lines += [f"  {name:<34}{ns:9.1f}" for name, ns in sorted(RESULTS.items(), key=lambda item: item[1])]
    if "VQF.updateBatch" in RESULTS and "akf while recording" in RESULTS:
        lines.append(f"  akf is {RESULTS['VQF.updateBatch'] / RESULTS['akf while recording']:.1f} times as fast as VQF")
    capture = pytestconfig.pluginmanager.getplugin("capturemanager")
    with capture.global_and_fixture_disabled():
        print("\n".join(lines), flush=True)


def measure(benchmark, name, work, n=N_SAMPLES):
    pedantic = benchmark.pedantic
    benchmark._timer = time.process_time  # CPU time: the machine is shared
    pedantic(work, rounds=15, iterations=1, warmup_rounds=1)
    RESULTS[name] = 1e9 * benchmark.stats.stats.min / n


def test_akf_while_recording(benchmark, track):
    settings = AttitudeSettings(smooth=False)
    measure(benchmark, "akf while recording", lambda: im.estimate_attitude(track, settings))


def test_akf_smoothed(benchmark, track):
    settings = AttitudeSettings(smooth=True)
    measure(benchmark, "akf smoothed", lambda: im.estimate_attitude(track, settings))


@pytest.mark.parametrize("method", ["ekf", "akf_source", "gyro"])
def test_other_methods(benchmark, track, method):
    settings = replace(AttitudeSettings(smooth=False), method=method)
    measure(benchmark, method, lambda: im.estimate_attitude(track, settings))


def test_vqf(benchmark, track):
    measure(benchmark, "VQF.updateBatch", lambda: VQF(1 / RATE_HZ).updateBatch(track.gyr_rad_s, track.acc_m_s2))


def test_offline_vqf(benchmark, track):
    measure(benchmark, "offlineVQF", lambda: offlineVQF(track.gyr_rad_s, track.acc_m_s2, None, 1 / RATE_HZ))


def test_imufusion(benchmark, track):
    """It takes one sample a call: most of its time is Python's."""
    gyr, acc = np.degrees(track.gyr_rad_s[:2000]), track.acc_m_s2[:2000] / 9.80665

    def work():
        ahrs = imufusion.Ahrs()
        ahrs.set_sample_period(1 / RATE_HZ)
        for k in range(len(gyr)):
            ahrs.update_no_magnetometer(gyr[k], acc[k])

    measure(benchmark, "imufusion, called from Python", work, n=2000)
