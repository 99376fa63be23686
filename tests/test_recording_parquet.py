"""Recordings in Parquet are read as strictly as text, and stop at the same limit."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from odd_recordings import NAMES, N, rows

import inhalemon as im
from inhalemon.exceptions import RecordingError

pa = pytest.importorskip("pyarrow", reason="pyarrow, an extra, is not installed")
pq = pytest.importorskip("pyarrow.parquet")


def _columns() -> dict[str, list[object]]:
    table = rows()[1:]
    columns: dict[str, list[object]] = {"sensor": [row[0] for row in table]}
    columns.update({name: [float(row[i + 1]) for row in table] for i, name in enumerate(NAMES[1:])})
    return columns


def _parquet(columns: dict[str, object], *, metadata: object = None, **options: object) -> bytes:
    table = pa.table(columns)
    if metadata is not None:
        written = metadata if isinstance(metadata, bytes) else json.dumps(metadata).encode()
        table = table.replace_schema_metadata({"inhalemon": written})
    target = io.BytesIO()
    pq.write_table(table, target, **options)
    return target.getvalue()


def _refusal(data: bytes, **kwargs: object) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        im.read_recording_bytes(data, name="a.parquet", **{"device": "pmdi", **kwargs})  # type: ignore[arg-type]  # test helper
    return caught.value


def test_the_embedded_sidecar_is_used_and_a_given_device_overrides_it() -> None:
    metadata = {"format": "inhalemon-recording/1", "device": "ellipta", "session_id": "from inside"}
    data = _parquet(_columns(), metadata=metadata)
    recording = im.read_recording_bytes(data, name="a.parquet")
    assert (recording.device, recording.session_id) == ("ellipta", "from inside")
    assert im.read_recording_bytes(data, name="a.parquet", device="pmdi").device == "pmdi"


def test_a_wrong_embedded_sidecar_is_refused() -> None:
    error = _refusal(_parquet(_columns(), metadata={"format": "other"}))
    assert (error.code, error.column, error.file) == ("bad_sidecar", "format", "a.parquet")
    assert _refusal(_parquet(_columns(), metadata=b"{")).code == "bad_sidecar"


def test_without_a_sidecar_the_device_is_needed() -> None:
    assert _refusal(_parquet(_columns()), device=None).code == "missing_device"


@pytest.mark.parametrize("kind", ["float32", "float64"])
def test_numbers_of_either_width_and_words_of_either_kind_are_read(kind: str) -> None:
    columns: dict[str, object] = {
        name: pa.array(values, pa.string()).dictionary_encode() if name == "sensor" else pa.array(values, kind)
        for name, values in _columns().items()
    }
    columns["acc_x_m_s2"] = pa.array(range(2 * N), pa.int32())
    recording = im.read_recording_bytes(_parquet(columns), name="a.parquet", device="pmdi")
    assert recording.lever.n_samples == N
    np.testing.assert_array_equal(recording.body.acc_m_s2[:, 0], np.arange(N))


@pytest.mark.parametrize(
    ("column", "row", "value", "code"),
    [
        ("gyr_y_rad_s", 136, float("nan"), "not_finite"),
        ("gyr_y_rad_s", 136, None, "not_finite"),
        ("gyr_y_rad_s", 136, float("inf"), "not_finite"),
        ("acc_x_m_s2", 136, 1e308, "out_of_range"),
        ("sensor", 11, "wrist", "unknown_sensor"),
        ("sensor", 11, None, "not_finite"),
        ("time_s", 39, 0.0, "time_not_increasing"),
    ],
)
def test_a_wrong_cell_is_refused_with_its_row(column: str, row: int, value: object, code: str) -> None:
    columns = _columns()
    columns[column][row] = value
    error = _refusal(_parquet(dict(columns)))
    assert (error.code, error.line, error.column) == (code, row + 1, column)


@pytest.mark.parametrize(
    ("name", "array"),
    [("acc_x_m_s2", ["1.0"] * 2 * N), ("sensor", [1.0] * 2 * N), ("time_s", [[1.0]] * 2 * N), ("more", [1.0] * 2 * N)],
)
def test_a_column_of_another_kind_or_name_is_refused(name: str, array: list[object]) -> None:
    error = _refusal(_parquet({**_columns(), name: array}))
    assert (error.code, error.column) == ("wrong_header", name)


def test_a_small_file_that_unpacks_to_gigabytes_is_refused_at_once() -> None:
    n = 10_000_000  # 640 MB of doubles, run-length encoded to some hundred kilobytes
    columns: dict[str, object] = {name: pa.array(np.zeros(n, dtype=np.float32)) for name in NAMES[1:]}
    columns["sensor"] = pa.DictionaryArray.from_arrays(pa.array(np.zeros(n, dtype=np.int8)), ["body"])
    data = _parquet(columns, compression="zstd")
    assert len(data) < 1e6
    assert _refusal(data).code == "too_large"


def test_every_cut_of_a_file_is_refused() -> None:
    data = _parquet(_columns())
    for end in range(5, len(data) - 1, 997):
        assert _refusal(data[:end]).code in {"bad_parquet", "wrong_file_type"}
