"""A `Recording` written as a recording file with its sidecar."""

from __future__ import annotations

import gzip
import io
from pathlib import Path

import numpy as np
import orjson

from inhalemon.exceptions import RecordingError
from inhalemon.recording.layout import COMPRESSION_OF, stem_of, suffix_of
from inhalemon.recording.parquet import write_parquet
from inhalemon.recording.sidecar import sidecar_to_mapping
from inhalemon.rotation import conjugate, rotate
from inhalemon.values import FloatArray, ImuTrack, Recording, SensorName

_VECTORS = (("acc_m_s2", "acc_{}_m_s2"), ("gyr_rad_s", "gyr_{}_rad_s"), ("mag_ut", "mag_{}_ut"))


def write_recording(recording: Recording, path: str | Path, *, decimals: int | None = 6) -> None:
    """Writes the recording; the suffix chooses the form (.csv, .csv.gz, .csv.zst, .parquet).

    Text carries `decimals` places (a millionth of a second or of a unit, far below any such chip's least bit; `None`
    writes every bit); Parquet is always exact. The sidecar goes to `<stem>.json`, or into the Parquet file.
    Samples are turned back to the chip's axes when the sidecar has a mounting, so that reading gives the same tracks.
    The same recording gives the same bytes. Raises `RecordingError` for any other suffix.
    """
    path = Path(path)
    suffix = suffix_of(path.name)
    if suffix is None:
        raise RecordingError(
            "wrong_file_type",
            file=str(path),
            column="suffix",
            found=repr(path.suffix),
            wanted=", ".join(COMPRESSION_OF),
        )
    sidecar = sidecar_to_mapping(recording)
    columns = {name: _chip_columns(recording, name) for name in SensorName}
    if suffix == ".parquet":
        target = io.BytesIO()
        names = [str(name) for name in SensorName for _ in range(columns[name]["time_s"].size)]
        both = {key: np.concatenate([columns[name][key] for name in SensorName]) for key in columns[SensorName.BODY]}
        write_parquet(target, names, both, sidecar)
        path.write_bytes(target.getvalue())
        return
    path.write_bytes(_packed(_as_csv(columns, decimals), suffix))
    beside = path.with_name(stem_of(path.name) + ".json")
    beside.write_bytes(orjson.dumps(sidecar, option=orjson.OPT_INDENT_2) + b"\n")


def _chip_columns(recording: Recording, name: SensorName) -> dict[str, FloatArray]:
    """The columns of one sensor by name, on the chip's axes; magnetometers are written when both sensors have one."""
    track: ImuTrack = getattr(recording, name)
    info = recording.sensors.get(name)
    with_mag = recording.body.mag_ut is not None and recording.lever.mag_ut is not None
    columns = {"time_s": track.time_s}
    for attribute, pattern in _VECTORS:
        if attribute == "mag_ut" and not with_mag:
            continue
        values: FloatArray = getattr(track, attribute)
        if info is not None and info.q_chip is not None:
            values = rotate(conjugate(np.array(info.q_chip)), values)
        columns.update({pattern.format(axis): values[:, i] for i, axis in enumerate("xyz")})
    return columns


def _as_csv(columns: dict[SensorName, dict[str, FloatArray]], decimals: int | None) -> bytes:
    """One row a sample, the body's first."""
    text = [",".join(["sensor", *columns[SensorName.BODY]]).encode()]
    for name, sensor in columns.items():
        table = np.column_stack(list(sensor.values()))
        if decimals is not None:
            table = np.round(table, decimals) + 0.0  # no minus zeros
        # orjson writes the shortest form that reads back to the same number, some 50 times faster than formatting rows.
        rows = orjson.dumps(table, option=orjson.OPT_SERIALIZE_NUMPY)[2:-2]
        text.append(f"{name},".encode() + rows.replace(b"],[", f"\n{name},".encode()))
    return b"\n".join(text) + b"\n"


def _packed(text: bytes, suffix: str) -> bytes:
    kind = COMPRESSION_OF[suffix]
    if kind == "gzip":
        return gzip.compress(text, mtime=0)
    if kind == "zstd":
        import zstandard  # noqa: PLC0415 - needed for this form alone

        return zstandard.ZstdCompressor(level=10).compress(text)
    return text
