"""A recording as a session of a Motion-BIDS dataset, for tools of movement science.

Each sensor is a tracking system of its own, because each has a clock of its own: its times are the LATENCY channel,
in seconds since the first sample of either.
Source: the Brain Imaging Data Structure, specification 1.9 and later, "Motion". Values are in the part's frame, not the
chip's; the dataset says so.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import orjson

from inhalemon.exceptions import RecordingError
from inhalemon.values import FloatArray, ImuTrack, Recording, SensorName

BIDS_VERSION = "1.9.0"
_TASK = "inhalation"
_KINDS = (("acc_m_s2", "acc", "ACCEL", "m/s^2"), ("gyr_rad_s", "gyr", "GYRO", "rad/s"), ("mag_ut", "mag", "MAGN", "uT"))
_AXES = "x: along the hinge, to the user's right; y: away from the user; z: up when the inhaler is held upright"
_CHANNEL_COLUMNS = ("name", "component", "type", "tracked_point", "units", "reference_frame")


def write_motion_bids(recording: Recording, folder: str | Path) -> Path:
    """The session's folder inside the dataset `folder`, which is made or added to.

    The subject is the patient's pseudonym (without one, `unknown`), the session is the session id; BIDS labels take
    letters and digits alone, so all else is left out of them. Raises `RecordingError` when that label is taken.
    """
    dataset = Path(folder)
    subject, session = _label(recording.patient_ref or "unknown"), _label(recording.session_id)
    place = dataset / f"sub-{subject}" / f"ses-{session}"
    if place.exists():
        raise RecordingError(
            "session_exists",
            file=recording.session_id,
            column="session",
            found=f"already there as {place}",
            wanted="a session that the dataset does not hold",
        )
    (place / "motion").mkdir(parents=True)
    stem = f"sub-{subject}_ses-{session}_task-{_TASK}"
    onset_s = min(float(track.time_s[0]) for track in (recording.body, recording.lever))
    files = [
        _write_sensor(recording, name, onset_s, place / "motion" / f"{stem}_tracksys-{name.value}")
        for name in SensorName
    ]
    rows = [[f"motion/{file}", _utc(recording.recorded_at)] for file in files]
    scans = place / f"sub-{subject}_ses-{session}_scans.tsv"
    scans.write_text(_tsv([["filename", "acq_time"], *rows]), encoding="utf-8")
    _describe_dataset(dataset, subject)
    return place


def _write_sensor(recording: Recording, name: SensorName, onset_s: float, stem: Path) -> str:
    track: ImuTrack = getattr(recording, name)
    columns = _columns(track, onset_s)
    values = np.column_stack([values for values, *_ in columns])
    text = io.StringIO()
    # A motion file has no header; a latency is written in full, never as a power of ten.
    np.savetxt(text, values, fmt=["%.6f", *["%.9g"] * (len(columns) - 1)], delimiter="\t")
    motion = stem.with_name(stem.name + "_motion.tsv")
    motion.write_text(text.getvalue(), encoding="utf-8")
    channels = [
        [f"{prefix}_{axis}", axis, kind, name.value, unit, name.value] for _, prefix, axis, kind, unit in columns
    ]
    channels[0] = ["latency", "n/a", "LATENCY", "n/a", "s", "n/a"]
    stem.with_name(stem.name + "_channels.tsv").write_text(_tsv([_CHANNEL_COLUMNS, *channels]), encoding="utf-8")
    frame = {"SpatialAxes": "RAS", "RotationRule": "right-hand", "RotationOrder": "n/a", "Description": _AXES}
    _write_json(stem.with_name(stem.name + "_channels.json"), {"reference_frame": {"Levels": {name.value: frame}}})
    info = recording.sensors.get(name)
    about = {
        "TaskName": _TASK,
        "TaskDescription": f"Use of an inhaler ({recording.device.value})",
        "SamplingFrequency": round(track.rate_hz, 6),
        "TrackingSystemName": name.value,
        "ManufacturersModelName": (info.model if info else None) or "n/a",
        "RecordingDuration": round(float(track.time_s[-1] - track.time_s[0]), 6),
        "MotionChannelCount": len(columns),
        "TrackedPointsCount": 1,
        "LATENCYChannelCount": 1,
        "ACCELChannelCount": 3,
        "GYROChannelCount": 3,
        "MAGNChannelCount": 0 if track.mag_ut is None else 3,
        "MissingValues": "n/a",
    }
    _write_json(stem.with_name(stem.name + "_motion.json"), about)
    return motion.name


def _columns(track: ImuTrack, onset_s: float) -> list[tuple[FloatArray, str, str, str, str]]:
    """Values, name's beginning, axis, BIDS type and unit of each channel; time first."""
    columns = [(track.time_s - onset_s, "latency", "n/a", "LATENCY", "s")]
    for attribute, prefix, kind, unit in _KINDS:
        values: FloatArray | None = getattr(track, attribute)
        if values is not None:
            columns += [(values[:, number], prefix, axis, kind, unit) for number, axis in enumerate("xyz")]
    return columns


def _describe_dataset(dataset: Path, subject: str) -> None:
    description = dataset / "dataset_description.json"
    if not description.exists():
        about = {"Name": "Inhaler sessions", "BIDSVersion": BIDS_VERSION, "DatasetType": "raw"}
        _write_json(description, about | {"GeneratedBy": [{"Name": "inhalemon"}]})
        (dataset / "README").write_text(
            "Inhaler sessions recorded by two inertial sensors, on the body and on the lever or cover.\n"
            f"Axes of both parts: {_AXES}.\n",
            encoding="utf-8",
        )
    participants = dataset / "participants.tsv"
    known = participants.read_text(encoding="utf-8") if participants.exists() else "participant_id\n"
    if f"sub-{subject}" not in known.splitlines():
        participants.write_text(f"{known}sub-{subject}\n", encoding="utf-8")


def _label(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]", "", text) or "unknown"


def _utc(recorded_at: str | None) -> str:
    return "n/a" if recorded_at is None else datetime.fromisoformat(recorded_at).astimezone(UTC).strftime("%FT%TZ")


def _tsv(rows: Iterable[Sequence[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, delimiter="\t", lineterminator="\n").writerows(rows)
    return text.getvalue()


def _write_json(path: Path, content: dict[str, object]) -> None:
    path.write_bytes(orjson.dumps(content, option=orjson.OPT_INDENT_2) + b"\n")
