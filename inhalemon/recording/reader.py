"""From a recording file to a `Recording`, or to a refusal that says where and why."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO

import numpy as np

from inhalemon.exceptions import RecordingError
from inhalemon.recording.checks import RawSensor, gather
from inhalemon.recording.csv_table import read_rows
from inhalemon.recording.layout import MAX_UNPACKED_BYTES, session_of, stem_of, suffix_of
from inhalemon.recording.parquet import read_parquet
from inhalemon.recording.saturation import MIN_FLAT_ACC_M_S2, MIN_FLAT_GYR_RAD_S, saturated
from inhalemon.recording.sidecar import (
    MAX_SIDECAR_BYTES,
    SensorEntry,
    Sidecar,
    sidecar_from_json,
    sidecar_from_mapping,
)
from inhalemon.recording.unpack import kind_of, too_large, unpacked_blocks
from inhalemon.rotation import rotate
from inhalemon.values import DeviceKind, ImuTrack, Recording, SensorName


def is_recording_file(path: str | Path) -> bool:
    """Whether a file's name ends as a recording's does: .csv, .csv.gz, .csv.zst or .parquet."""
    return suffix_of(str(path)) is not None


def read_recording(path: str | Path, *, device: DeviceKind | str | None = None) -> Recording:
    """The recording in a file, with its sidecar `<stem>.json` if there is one; `device` overrides the sidecar's.

    Raises `RecordingError` for anything that is not a recording, naming the file, line, column, what was found and
    what was wanted.
    """
    path = Path(path)
    try:
        with path.open("rb") as stream:
            return _read(stream, name=str(path), sidecar=sidecar_beside(path), device=device)
    except OSError as error:
        raise _unreadable(str(path), error) from error


def read_recording_bytes(
    data: bytes | BinaryIO,
    *,
    name: str = "session.csv",
    metadata: Mapping[str, object] | bytes | str | None = None,
    device: DeviceKind | str | None = None,
) -> Recording:
    """The recording in bytes or in an open binary stream, such as standard input or an upload.

    `name` is shown in errors, gives the session's default id and, by its suffix, says what is inside; without a
    recording suffix the first bytes say it. `metadata` is the sidecar, as JSON or already parsed.
    Raises `RecordingError` as `read_recording` does.
    """
    sidecar = None
    if isinstance(metadata, Mapping):
        sidecar = sidecar_from_mapping(metadata, file=f"{name} metadata")
    elif metadata is not None:
        sidecar = sidecar_from_json(metadata, file=f"{name} metadata")
    stream = io.BytesIO(data) if isinstance(data, bytes | bytearray | memoryview) else data
    try:
        return _read(stream, name=name, sidecar=sidecar, device=device)
    except OSError as error:
        raise _unreadable(name, error) from error


def _read(stream: BinaryIO, *, name: str, sidecar: Sidecar | None, device: DeviceKind | str | None) -> Recording:
    kind, head = kind_of(stream, name=name)
    if kind == "parquet":
        rest = stream.read(MAX_UNPACKED_BYTES)
        if len(rest) == MAX_UNPACKED_BYTES:
            raise too_large(name)
        embedded, blocks = read_parquet(io.BytesIO(head + rest), file=name)
        if embedded is not None:
            sidecar = sidecar_from_json(embedded, file=name)
    else:
        blocks = read_rows(unpacked_blocks(stream, kind, head, file=name), file=name)
    sidecar = sidecar or Sidecar()
    chosen = _device(device, sidecar, name)
    raw = gather(blocks, file=name)
    try:
        return Recording(
            device=chosen,
            body=_track(raw[SensorName.BODY], sidecar.sensors.get(SensorName.BODY, SensorEntry())),
            lever=_track(raw[SensorName.LEVER], sidecar.sensors.get(SensorName.LEVER, SensorEntry())),
            session_id=sidecar.session_id or session_of(name),
            recorded_at=sidecar.recorded_at,
            patient_ref=sidecar.patient_ref,
            sensors=MappingProxyType({sensor: entry.info for sensor, entry in sidecar.sensors.items()}),
        )
    except RecordingError as error:
        raise error.in_file(name) from error


def _device(given: DeviceKind | str | None, sidecar: Sidecar, file: str) -> DeviceKind:
    chosen = given if given is not None else sidecar.device
    wanted = ", ".join(DeviceKind)
    if chosen is None:
        raise RecordingError(
            "missing_device",
            file=file,
            column="device",
            found="not given",
            wanted=wanted,
            detail="Give --device, or a sidecar or metadata with the device",
        )
    if chosen not in tuple(DeviceKind):
        raise RecordingError("unknown_device", file=file, column="device", found=repr(chosen), wanted=wanted)
    return DeviceKind(chosen)


def _track(raw: RawSensor, entry: SensorEntry) -> ImuTrack:
    """The sensor's track in its part's frame; saturation was looked for on the chip's axes."""
    is_acc_saturated = saturated(raw.acc_m_s2, entry.acc_range_m_s2, min_flat=MIN_FLAT_ACC_M_S2)
    is_gyr_saturated = saturated(raw.gyr_rad_s, entry.gyr_range_rad_s, min_flat=MIN_FLAT_GYR_RAD_S)
    acc, gyr, mag = raw.acc_m_s2, raw.gyr_rad_s, raw.mag_ut
    if entry.info.q_chip is not None:
        q_part_chip = np.array(entry.info.q_chip)
        acc, gyr = rotate(q_part_chip, acc), rotate(q_part_chip, gyr)
        mag = rotate(q_part_chip, mag) if mag is not None else None
    return ImuTrack(
        time_s=raw.time_s,
        acc_m_s2=acc,
        gyr_rad_s=gyr,
        mag_ut=mag,
        acc_range_m_s2=entry.acc_range_m_s2,
        gyr_range_rad_s=entry.gyr_range_rad_s,
        is_acc_saturated=is_acc_saturated,
        is_gyr_saturated=is_gyr_saturated,
    )


def sidecar_beside(path: Path) -> Sidecar | None:
    """The sidecar `<stem>.json` of a recording file, if there is one. Raises `RecordingError`."""
    beside = path.with_name(stem_of(path.name) + ".json")
    if not beside.is_file():
        return None
    try:
        with beside.open("rb") as stream:
            text = stream.read(MAX_SIDECAR_BYTES + 1)
    except OSError as error:
        raise _unreadable(str(beside), error) from error
    if len(text) > MAX_SIDECAR_BYTES:
        raise RecordingError(
            "bad_sidecar",
            file=str(beside),
            column="sidecar",
            found="over 1 MiB",
            wanted="a small JSON object",
        )
    return sidecar_from_json(text, file=str(beside))


def _unreadable(file: str, error: OSError) -> RecordingError:
    return RecordingError(
        "unreadable", file=file, column="file", found=error.strerror or str(error), wanted="a file that can be read"
    )
