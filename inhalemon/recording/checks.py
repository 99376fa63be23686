"""Rows gathered into two sensors' arrays, with every check that needs more than one cell of the file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from inhalemon.exceptions import RecordingError
from inhalemon.limits import MAX_SAMPLES, too_long
from inhalemon.recording.csv_table import RowBlock, not_finite
from inhalemon.recording.layout import Columns
from inhalemon.values import BoolArray, FloatArray, SensorName


@dataclass(frozen=True, slots=True)
class RawSensor:
    """One sensor's samples as the file has them, in SI units and on the chip's axes."""

    time_s: FloatArray  # (n,)
    acc_m_s2: FloatArray  # (n, 3)
    gyr_rad_s: FloatArray  # (n, 3)
    mag_ut: FloatArray | None  # (n, 3)


@dataclass(slots=True)
class _Gathered:
    """One sensor's rows so far."""

    time: list[FloatArray] = field(default_factory=list)
    acc: list[FloatArray] = field(default_factory=list)
    gyr: list[FloatArray] = field(default_factory=list)
    mag: list[FloatArray] = field(default_factory=list)
    last_time_s: float = -np.inf
    n_samples: int = 0


def gather(blocks: Iterable[tuple[Columns, RowBlock]], *, file: str) -> dict[SensorName, RawSensor]:
    """Both sensors' samples. Raises `RecordingError` for what no recording may be; times are checked as they come."""
    gathered = {name: _Gathered() for name in SensorName}
    for columns, block in blocks:
        _check_values(columns, block, file)
        faults = [
            fault
            for name, is_its in ((SensorName.BODY, ~block.is_lever), (SensorName.LEVER, block.is_lever))
            if (fault := _add(gathered[name], columns, block, is_its, file)) is not None
        ]
        if faults:
            raise min(faults, key=lambda fault: fault.line or 0)
    if not any(sensor.n_samples for sensor in gathered.values()):
        raise RecordingError("empty", file=file, found="no row after the header", wanted="rows of both sensors")
    return {name: _finished(name, sensor, file) for name, sensor in gathered.items()}


def _check_values(columns: Columns, block: RowBlock, file: str) -> None:
    is_right = np.abs(block.values) <= np.array(columns.largest)  # false for what is no number
    if is_right.all():
        return
    row, position = (int(i) for i in np.argwhere(~is_right)[0])
    value, name = float(block.values[row, position]), columns.names[position]
    line = block.first_line + row
    if not np.isfinite(value):
        raise not_finite(name, repr(value), line, file)
    raise RecordingError(
        "out_of_range",
        file=file,
        line=line,
        column=name,
        found=f"{value:g}",
        wanted=f"at most {columns.largest[position]:g} either way",
        detail="No such sensor can say this: check the export and its units",
    )


def _add(sensor: _Gathered, columns: Columns, block: RowBlock, is_its: BoolArray, file: str) -> RecordingError | None:
    """Adds the rows of one sensor; returns what is wrong with their times, if anything is."""
    rows = np.flatnonzero(is_its)
    if rows.size == 0:
        return None
    values = block.values if rows.size == len(block.values) else block.values.take(rows, axis=0)
    time = np.ascontiguousarray(values[:, columns.time])
    is_late = np.empty(time.size, dtype=np.bool_)
    is_late[0] = time[0] > sensor.last_time_s
    np.greater(time[1:], time[:-1], out=is_late[1:])
    if not is_late.all():
        at = int(np.argmin(is_late))
        before = time[at - 1] if at else sensor.last_time_s
        what = "equal to" if time[at] == before else "earlier than"
        return RecordingError(
            "time_not_increasing",
            file=file,
            line=block.first_line + int(rows[at]),
            column="time_s",
            found=f"{time[at]:.10g}, {what} the same sensor's {before:.10g} before",
            wanted="times that increase within a sensor",
            detail="Export the rows in the order they were taken, each once",
        )
    sensor.last_time_s = float(time[-1])
    sensor.n_samples += time.size
    if sensor.n_samples > MAX_SAMPLES:
        return too_long(f"more than {MAX_SAMPLES} samples of one sensor").in_file(file)
    sensor.time.append(time)
    sensor.acc.append(values[:, columns.acc] * columns.acc_factor)
    sensor.gyr.append(values[:, columns.gyr] * columns.gyr_factor)
    if columns.mag:
        sensor.mag.append(values[:, columns.mag])
    return None


def _finished(name: SensorName, sensor: _Gathered, file: str) -> RawSensor:
    if not sensor.n_samples:
        raise RecordingError(
            "sensor_missing",
            file=file,
            column="sensor",
            found=f"never '{name}'",
            wanted="rows of both body and lever",
            detail=f"Export the {name} sensor too",
        )
    return RawSensor(
        time_s=np.concatenate(sensor.time),
        acc_m_s2=np.concatenate(sensor.acc),
        gyr_rad_s=np.concatenate(sensor.gyr),
        mag_ut=np.concatenate(sensor.mag) if sensor.mag else None,
    )
