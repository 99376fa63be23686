"""For all recordings: what is written is read back; for all bytes: a recording or our own error, and soon."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from fuzz.recording import check_bytes
from hypothesis import given, settings
from hypothesis import strategies as st
from odd_recordings import GOOD, NAMES, ODD_FILES, cell, rows, text

import inhalemon as im
from inhalemon.exceptions import RecordingError
from inhalemon.recording import csv_table
from inhalemon.recording.layout import columns_from_names
from inhalemon.values import DeviceKind, FloatArray, ImuTrack, Recording, SensorInfo, SensorName

FORMS = ("csv", "csv.gz", "csv.zst", "parquet")
ranges = st.one_of(st.none(), st.floats(0.1, 500.0))


@st.composite
def _times(draw: st.DrawFn) -> FloatArray:
    rate_hz = draw(st.floats(27.0, 900.0))
    n = int(2.1 * rate_hz) + draw(st.integers(0, 40))
    jitter = np.random.default_rng(draw(st.integers(0, 2**32 - 1))).uniform(-0.2, 0.2, n)
    start_s = draw(st.floats(-1.0, 1e5))
    return np.asarray(start_s + (np.arange(n) + jitter) / rate_hz)


@st.composite
def _track(draw: st.DrawFn, with_mag: bool) -> ImuTrack:
    time_s = draw(_times())
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    scale = draw(st.sampled_from([1e-6, 1.0, 100.0]))
    values = [rng.normal(0.0, scale, (time_s.size, 3)) for _ in range(3)]
    odd = draw(st.lists(st.floats(-9000, 9000), min_size=1, max_size=5))
    values[0][: len(odd), 0] = odd
    mag_ut = values[2] if with_mag else None
    return ImuTrack(
        time_s, values[0], values[1], mag_ut=mag_ut, acc_range_m_s2=draw(ranges), gyr_range_rad_s=draw(ranges)
    )


@st.composite
def _info(draw: st.DrawFn) -> SensorInfo:
    turn = draw(st.one_of(st.none(), st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)))
    q_chip = None
    if turn is not None:
        w, x, y, z = (float(part) for part in np.array(turn) / np.linalg.norm(turn))
        q_chip = (w, x, y, z)
    model = draw(st.one_of(st.none(), st.text(min_size=1, max_size=20).filter(lambda t: t.isprintable() and t.strip())))
    return SensorInfo(model=model, q_chip=q_chip)


@st.composite
def _recordings(draw: st.DrawFn) -> Recording:
    with_mag = draw(st.booleans())
    names = draw(st.lists(st.sampled_from(list(SensorName)), unique=True))
    return Recording(
        device=draw(st.sampled_from(list(DeviceKind))),
        body=draw(_track(with_mag)),
        lever=draw(_track(with_mag)),
        session_id=draw(st.text(min_size=1, max_size=30).filter(lambda t: t.isprintable() and bool(t.strip()))),
        patient_ref=draw(st.one_of(st.none(), st.just("p-3"))),
        sensors={name: draw(_info()) for name in names},
    )


@settings(max_examples=40, deadline=None)
@given(recording=_recordings(), form=st.sampled_from(FORMS))
def test_every_recording_survives_being_written_and_read(recording: Recording, form: str) -> None:
    """To the bit where no mounting is turned back and forth; else to the rounding of two rotations."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"x.{form}"
        im.write_recording(recording, path, decimals=None)
        again = im.read_recording(path)
    assert (again.device, again.session_id, again.patient_ref) == (
        recording.device,
        recording.session_id,
        recording.patient_ref,
    )
    models = [{name: info.model for name, info in each.sensors.items() if info.model} for each in (again, recording)]
    assert models[0] == models[1]
    for name in SensorName:
        before, after = getattr(recording, name), getattr(again, name)
        np.testing.assert_array_equal(after.time_s, before.time_s)
        for name_of_range in ("acc_range_m_s2", "gyr_range_rad_s"):
            full = getattr(before, name_of_range)
            assert getattr(after, name_of_range) == (None if full is None else pytest.approx(full, rel=1e-8))
        info = recording.sensors.get(name)
        tolerance = 0.0 if info is None or info.q_chip is None else 1e-10
        for values in ("acc_m_s2", "gyr_rad_s", "mag_ut"):
            if getattr(before, values) is None:
                assert getattr(after, values) is None
            else:
                np.testing.assert_allclose(getattr(after, values), getattr(before, values), rtol=0, atol=tolerance)


@settings(max_examples=200, deadline=None)
@given(st.floats(-9000, 9000), st.sampled_from(["{!r}", "{:.3f}", "{:+e}", "{:g}", '"{}"']))
def test_every_way_to_write_a_number_is_read_as_python_reads_it(value: float, form: str) -> None:
    written = form.format(value)
    recording = im.read_recording_bytes(cell(9, "acc_x_m_s2", written), device="pmdi")
    assert recording.body.acc_m_s2[7, 0] == float(written.strip('"'))


@settings(max_examples=200, deadline=None)
@given(st.integers(2, 2 * 250 + 1), st.sampled_from(NAMES), st.text(max_size=12))
def test_any_text_in_any_cell_is_read_or_refused_on_its_line(line: int, column: str, value: str) -> None:
    """A quotation mark, comma, line end, time or the other sensor's name may move the fault; nothing else may."""
    refused = None
    try:
        im.read_recording_bytes(cell(line, column, value), device="pmdi")
    except RecordingError as error:
        refused = error
    is_plain = not set(value) & set(',"\n\r\0') and column != "time_s" and value not in tuple(SensorName)
    if refused is not None and is_plain:
        assert (refused.line, refused.column) == (line, column)


def _outcome(data: bytes, name: str) -> tuple[object, ...]:
    try:
        recording = im.read_recording_bytes(data, name=name, device="pmdi")
    except RecordingError as error:
        return (str(error),)
    tracks = (recording.body, recording.lever)
    return tuple(part.tobytes() for track in tracks for part in (track.time_s, track.acc_m_s2, track.gyr_rad_s))


@pytest.mark.skipif(not csv_table.IS_COMPILED, reason="installed without a C compiler: there is one form alone")
def test_with_and_without_the_compiled_kernel_every_odd_file_comes_to_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """To the bit and to the letter."""
    small = [odd for odd in ODD_FILES if len(odd.data) < 100_000]
    compiled = [_outcome(odd.data, odd.name) for odd in small]
    monkeypatch.setattr(csv_table, "IS_COMPILED", False)
    assert [_outcome(odd.data, odd.name) for odd in small] == compiled


@pytest.mark.skipif(not csv_table.IS_COMPILED, reason="installed without a C compiler: there is one form alone")
@settings(max_examples=300, deadline=None)
@given(st.data())
def test_what_the_compiled_kernel_takes_the_other_form_takes_alike(data: st.DataObject) -> None:
    order = data.draw(st.permutations(range(8)))
    columns = columns_from_names(tuple(NAMES[i] for i in order), file="a.csv")
    number = st.one_of(
        st.floats(-1e20, 1e20).map(repr),
        st.floats(-9000, 9000).map("{:.6f}".format),
        st.integers(-(2**70), 2**70).map(str),
        st.from_regex(r"-?[0-9]{1,20}(\.[0-9]{1,25})?([eE][+-]?[0-9]{1,4})?", fullmatch=True),
        st.text("0123456789.-+eE", max_size=8),
    )
    lines = []
    for _ in range(data.draw(st.integers(1, 4))):
        row = [data.draw(st.sampled_from(["body", "lever", "lever", "bod"])), *(data.draw(number) for _ in range(7))]
        lines.append(",".join(row[i] for i in order))
    block = bytearray("\n".join(lines).encode())
    if data.draw(st.booleans()):
        at = data.draw(st.integers(0, len(block) - 1))
        block[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=3))
    compiled = csv_table._compiled_rows(bytes(block), columns)
    if compiled is not None:
        plain = csv_table._plain_rows(bytes(block), columns)
        assert plain is not None
        np.testing.assert_array_equal(compiled[0], plain[0])
        np.testing.assert_array_equal(compiled[1], plain[1])


@settings(max_examples=60, deadline=None)
@given(st.permutations(range(8)), st.sampled_from(["\n", "\r\n"]), st.randoms(use_true_random=False))
def test_order_of_columns_and_mixing_of_sensors_change_nothing(order: list[int], end: str, random: object) -> None:
    table = rows()
    body, lever = table[1:251], table[251:]
    mixed: list[list[str]] = []
    while body or lever:
        take_body = bool(body) and (not lever or random.random() < 0.5)  # type: ignore[attr-defined]  # random.Random
        mixed.append((body if take_body else lever).pop(0))
    data = text(([row[i] for i in order] for row in [table[0], *mixed]), end=end)
    plain, shuffled = im.read_recording_bytes(GOOD, device="pmdi"), im.read_recording_bytes(data, device="pmdi")
    for name in SensorName:
        for values in ("time_s", "acc_m_s2", "gyr_rad_s"):
            np.testing.assert_array_equal(
                getattr(getattr(shuffled, name), values), getattr(getattr(plain, name), values)
            )


@settings(max_examples=150, deadline=2000, derandomize=True)
@given(st.data())
def test_no_bytes_bring_anything_but_a_recording_or_our_error(data: st.DataObject) -> None:
    """Odd files, cut, spliced and overwritten at random: what the fuzz target tries for longer."""
    odd = data.draw(st.sampled_from([odd for odd in ODD_FILES if len(odd.data) < 100_000]))
    raw = bytearray(odd.data)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, max(len(raw) - 1, 0)))
        raw[at : at + data.draw(st.integers(0, 30))] = data.draw(st.binary(max_size=12))
    check_bytes(bytes(raw), name=odd.name)


@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz", "a.csv.zst", "a.parquet", "-"])
def test_random_bytes_are_refused(name: str) -> None:
    rng = np.random.default_rng(3)
    for size in (1, 10, 1000, 100_000):
        check_bytes(rng.bytes(size), name=name)
        check_bytes(rng.bytes(size).translate(bytes(b"0123456789.,-\nebodylvr"[i % 22] for i in range(256))), name=name)
