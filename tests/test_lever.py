"""The lever's angle, on attitudes whose relative rotation is known in closed form."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inhalemon import _heading_kernel as kernel
from inhalemon.rotation import about_z, from_rotation_vector, multiply, normalise
from inhalemon.settings import LeverSettings
from inhalemon.signals import resample_attitude
from inhalemon.stages.calibrate import calibrate
from inhalemon.stages.lever import lever_angle
from inhalemon.values import AttitudeTrack, FloatArray, LeverTrack
from validation import hinge

X = np.array([1.0, 0.0, 0.0])
FINISHED = LeverSettings(smooth=True)
UNDER_WAY = LeverSettings(smooth=False)

unit_quaternions = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda v: np.linalg.norm(v) > 0.1).map(np.array)


def attitude_track(time_s: FloatArray, q: FloatArray) -> AttitudeTrack:
    n = time_s.size
    return AttitudeTrack(time_s, q, np.full(n, np.radians(0.3)), np.zeros((n, 3)), np.zeros(n))


def hand(time_s: FloatArray) -> FloatArray:
    """An attitude that turns about all three axes, as in a hand."""
    roll = 0.5 * np.sin(0.9 * time_s)
    pitch = 0.7 * np.sin(0.5 * time_s + 1.0)
    yaw = 0.8 * np.sin(0.3 * time_s)
    return multiply(
        about_z(yaw),
        multiply(
            from_rotation_vector(np.outer(pitch, [0.0, 1.0, 0.0])),
            from_rotation_vector(np.outer(roll, [1.0, 0.0, 0.0])),
        ),
    )


def cover(time_s: FloatArray, angle_deg: float) -> FloatArray:
    """Shut for 4 s, opened within 0.5 s, shut again from 14 s."""
    share = np.clip((time_s - 4.0) / 0.5, 0.0, 1.0) - np.clip((time_s - 14.0) / 0.5, 0.0, 1.0)
    return np.radians(angle_deg) * share


def press(time_s: FloatArray, start_s: float, angle_deg: float) -> FloatArray:
    """Down within 0.15 s, held for 0.3 s, up within 0.15 s."""
    down = np.clip((time_s - start_s) / 0.15, 0.0, 1.0)
    up = np.clip((time_s - start_s - 0.45) / 0.15, 0.0, 1.0)
    return np.radians(angle_deg) * (down - up)


def pair(
    time_s: FloatArray,
    angle_rad: FloatArray,
    *,
    heading_rad: float = 1.0,
    drift_rad_s: float = 0.003,
    room: FloatArray | None = None,
    mounting: FloatArray | None = None,
) -> tuple[AttitudeTrack, AttitudeTrack]:
    """Body and lever as two filters would give them: exact, but for a heading of their own that drifts."""
    q_ref_body = hand(time_s)
    if room is not None:
        q_ref_body = multiply(normalise(room), q_ref_body)
    q_ref_lever = multiply(q_ref_body, from_rotation_vector(np.outer(angle_rad, X)))
    if mounting is not None:
        q_ref_lever = multiply(q_ref_lever, mounting)
    own = about_z(heading_rad + drift_rad_s * time_s)
    return attitude_track(time_s, q_ref_body), attitude_track(time_s, multiply(own, q_ref_lever))


def tracked(
    body: AttitudeTrack, lever: AttitudeTrack, lever_settings: LeverSettings, *, has_shut_state: bool = True
) -> LeverTrack:
    calibration = calibrate(body, lever, X, lever_settings, has_shut_state=has_shut_state)
    return lever_angle(body, lever, calibration)


TIME_S = np.arange(0.0, 20.0, 0.01)


@pytest.mark.parametrize("lever_settings", [FINISHED, UNDER_WAY], ids=["finished", "under way"])
@pytest.mark.parametrize("angle_deg", [95.0, -95.0, 12.0])
def test_angle_and_sign_of_a_cover_are_found(angle_deg: float, lever_settings: LeverSettings) -> None:
    angle_rad = cover(TIME_S, angle_deg)
    track = tracked(*pair(TIME_S, angle_rad), lever_settings)
    assert np.degrees(np.abs(track.angle_rad - angle_rad)).max() < 0.5


@settings(max_examples=25, deadline=None)
@given(room=unit_quaternions)
def test_angle_survives_turning_the_whole_inhaler(room: FloatArray) -> None:
    angle_rad = cover(TIME_S, 95.0)
    track = tracked(*pair(TIME_S, angle_rad, room=room), FINISHED)
    # Wherever the heading shows; a hinge that is vertical all the time says so by its own deviation.
    error = np.abs(track.angle_rad - angle_rad)
    assert (error < np.radians(0.5) + 3.0 * track.sd_rad).all()
    assert np.median(np.degrees(error)) < 0.5


def swaying(time_s: FloatArray, sway_deg: float, seed: int) -> tuple[AttitudeTrack, AttitudeTrack, FloatArray]:
    """A free hinge that stands upright but for some sway, tilts 0.3 deg wrong for a second each, at rest for 2 s."""
    rng = np.random.default_rng(seed)

    def wander(sd_deg: float, every_s: float) -> FloatArray:
        knots_s = np.arange(-every_s, time_s[-1] + 2 * every_s, every_s)
        return np.interp(time_s, knots_s, np.radians(sd_deg) * rng.normal(size=knots_s.size))

    moves = np.clip(time_s - 2.0, 0.0, 1.0)
    upright = from_rotation_vector(np.array([0.0, -np.pi / 2, 0.0]))
    lean = np.stack([moves * wander(sway_deg, 0.7), moves * wander(sway_deg, 0.7), moves * wander(40.0, 1.0)], axis=1)
    angle_rad = moves * wander(30.0, 0.6)
    q_body = multiply(from_rotation_vector(lean), upright)
    q_lever = multiply(q_body, from_rotation_vector(np.outer(angle_rad, X)))
    off = [from_rotation_vector(np.stack([wander(0.3, 1.0) for _ in range(3)], axis=1)) for _ in range(2)]
    body = attitude_track(time_s, multiply(q_body, off[0]))
    return body, attitude_track(time_s, multiply(about_z(2.0), multiply(q_lever, off[1]))), angle_rad


@pytest.mark.parametrize("lever_settings", [FINISHED, UNDER_WAY], ids=["finished", "under way"])
@pytest.mark.parametrize("sway_deg", [6.0, 20.0])
def test_sd_of_an_upright_hinge_agrees_with_the_error(sway_deg: float, lever_settings: LeverSettings) -> None:
    """An upright hinge hardly shows the heading, and must say so: 1, give or take a half, from the first lean on."""
    ratios = []
    for seed in range(8):
        body, lever, angle_rad = swaying(TIME_S, sway_deg, seed)
        track = tracked(body, lever, lever_settings, has_shut_state=False)
        error = np.angle(np.exp(1j * (track.angle_rad - angle_rad)))
        ratios.append(np.mean((error / track.sd_rad)[400:] ** 2))
    assert 0.5 < np.sqrt(np.mean(ratios)) < 1.5


def test_shut_lever_reads_zero_within_one_degree_when_mounted_askew() -> None:
    mounting = from_rotation_vector(np.radians([6.0, -5.0, 4.0]))
    angle_rad = cover(TIME_S, 95.0)
    track = tracked(*pair(TIME_S, angle_rad, mounting=mounting), FINISHED)
    is_shut = angle_rad == 0.0
    assert np.degrees(np.abs(track.angle_rad[is_shut])).max() < 1.0


def test_plain_hinge_keeps_the_zero_of_its_frames() -> None:
    angle_rad = np.radians(10.0) + cover(TIME_S, 40.0)
    track = tracked(*pair(TIME_S, angle_rad), FINISHED, has_shut_state=False)
    assert np.degrees(np.abs(track.angle_rad - angle_rad)).max() < 0.5


def test_angle_runs_on_through_half_a_turn() -> None:
    angle_rad = np.linspace(0.0, np.radians(300.0), TIME_S.size)
    track = tracked(*pair(TIME_S, angle_rad), FINISHED, has_shut_state=False)
    assert np.abs(np.diff(track.angle_rad)).max() < np.radians(1.0)
    assert np.degrees(np.abs(np.angle(np.exp(1j * (track.angle_rad - angle_rad))))).max() < 0.5


def test_fast_press_comes_through_unsmoothed() -> None:
    angle_rad = press(TIME_S, 10.0, 12.0)
    track = tracked(*pair(TIME_S, angle_rad), FINISHED)
    assert np.degrees(np.abs(track.angle_rad - angle_rad)).max() < 0.3


def test_recording_under_way_uses_the_past_alone() -> None:
    body, lever = pair(TIME_S, cover(TIME_S, 95.0))
    whole = tracked(body, lever, UNDER_WAY)
    n = 1234
    half = tracked(attitude_track(TIME_S[:n], body.q[:n]), attitude_track(TIME_S[:n], lever.q[:n]), UNDER_WAY)
    np.testing.assert_allclose(half.angle_rad, whole.angle_rad[:n], atol=1e-9)


def test_off_axis_is_what_a_hinge_cannot_make() -> None:
    wobble = np.radians(2.0) * np.sin(7.0 * TIME_S)
    body, lever = pair(TIME_S, cover(TIME_S, 95.0))
    loose = attitude_track(TIME_S, multiply(lever.q, from_rotation_vector(np.outer(wobble, [0.0, 1.0, 0.0]))))
    stiff_deg = np.degrees(tracked(body, lever, FINISHED).off_axis_rad)
    loose_deg = np.degrees(tracked(body, loose, FINISHED).off_axis_rad)
    assert stiff_deg.max() < 0.3
    assert np.sqrt(np.mean(loose_deg**2)) == pytest.approx(2.0 / np.sqrt(2.0), abs=0.3)


def test_resampled_attitude_lies_between_its_samples() -> None:
    exact = attitude_track(TIME_S, from_rotation_vector(np.outer(0.8 * TIME_S, [0.0, 0.6, 0.8])))
    at = TIME_S[:-1] + 0.004
    between = resample_attitude(exact, at)
    want = from_rotation_vector(np.outer(0.8 * at, [0.0, 0.6, 0.8]))
    assert np.abs(np.sum(between.q * want, axis=-1)).min() > 1.0 - 1e-12


def test_attitudes_at_different_times_are_refused() -> None:
    body, lever = pair(TIME_S, cover(TIME_S, 95.0))
    with pytest.raises(ValueError, match="same times"):
        calibrate(body, resample_attitude(lever, TIME_S + 0.001), X, FINISHED)


HINGE_DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "hinge"


@pytest.mark.skipif(not HINGE_DATA.is_dir(), reason="the real hinge recordings (../shared/data/hinge) are not here")
@pytest.mark.parametrize("is_finished", [True, False], ids=["finished", "under way"])
def test_real_hinges_are_tracked_better_than_by_qmt_on_the_same_attitudes(is_finished: bool) -> None:
    """DIODEM's optical truth, VQF's attitudes for both, qmt's headings from tests/authorities; the mean of 3 joints."""
    kept = json.loads((Path(__file__).parent / "authorities" / "qmt_heading.json").read_text(encoding="utf-8"))
    mode = "finished" if is_finished else "under way"
    ours: list[float] = []
    peer: dict[str, list[float]] = {"default": [], "tuned": []}
    for joint in hinge.load_joints(HINGE_DATA):
        if not joint.is_diodem:
            continue
        q = hinge.vqf_attitudes(joint, smooth=is_finished)
        time_s = joint.recording.body.time_s
        body, lever = attitude_track(time_s, q["body"]), attitude_track(time_s, q["lever"])
        track = tracked(body, lever, LeverSettings(smooth=is_finished), has_shut_state=False)
        ours.append(hinge.rmse_deg(joint, track.angle_rad))
        for label, errors in peer.items():
            heading = np.array(kept[f"{joint.name}/{mode}/{label}"])
            heading_rad = np.interp(time_s, np.arange(heading.size) * kept["every_s"], heading)
            angle = hinge.angle_about_x(q["body"], multiply(about_z(heading_rad), q["lever"]))
            errors.append(hinge.rmse_deg(joint, angle))
    assert np.mean(ours) < min(np.mean(errors) for errors in peer.values())
    if is_finished:
        assert np.mean(ours) < 0.35


def test_compiled_heading_filter_equals_its_python_form() -> None:
    """The same source, run by Python: to the bit, so that a machine without a compiler gives the same report."""
    path = Path(kernel.__file__).with_name("_heading_kernel.py")
    spec = importlib.util.spec_from_file_location("heading_kernel_as_python", path)
    assert spec is not None
    assert spec.loader is not None
    as_python = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(as_python)
    rng = np.random.default_rng(0)
    m = 200
    given = [np.full(m, 0.2), rng.normal(0.0, 2.0, m), rng.uniform(0.0, 1.0, m), rng.uniform(1e-4, 1e-2, m)]
    known = []
    for form in (kernel, as_python):
        told, out = np.empty((m, 5)), np.empty((m, 5))
        form.filter_heading(*(v.data for v in given), 0.3, 9.0, 1e-4, 1e-7, 0.03, 3.0, told.data, out.data)
        form.smooth_heading(given[0].data, told.data, out.data)
        known.append(out)
    np.testing.assert_array_equal(known[0], known[1])
