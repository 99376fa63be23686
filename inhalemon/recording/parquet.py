"""Recordings in Parquet: the same columns, the sidecar under the key `inhalemon`; needs pyarrow, an extra."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
import orjson

from inhalemon.exceptions import RecordingError
from inhalemon.recording.csv_table import RowBlock, not_finite, unknown_sensor
from inhalemon.recording.layout import MAX_UNPACKED_BYTES, PARQUET_KEY, Columns, columns_from_names
from inhalemon.recording.unpack import too_large
from inhalemon.values import FloatArray, SensorName

if TYPE_CHECKING:
    from types import ModuleType

_ROWS_A_BATCH = 2**16


def read_parquet(source: BinaryIO, *, file: str) -> tuple[bytes | None, Iterator[tuple[Columns, RowBlock]]]:
    """The sidecar's JSON, if the file has it, and the rows in blocks (row `i` counts as line `i + 1`)."""
    pa, pq = _pyarrow(file)
    try:
        columns = columns_from_names(tuple(str(name) for name in pq.read_schema(source).names), file=file)
        source.seek(0)
        table = pq.ParquetFile(source, read_dictionary=["sensor"], memory_map=False)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise _broken(file, error) from error
    schema = table.schema_arrow
    for field in schema:
        is_right = _is_text(pa, field.type) if field.name == "sensor" else _is_number(pa, field.type)
        if not is_right:
            raise RecordingError(
                "wrong_header",
                file=file,
                column=field.name,
                found=f"of type {field.type}",
                wanted="text for sensor, floating point or whole numbers for the rest",
            )
    metadata = table.metadata
    unpacked = max(
        metadata.num_rows * 8 * len(columns.names),
        sum(metadata.row_group(i).total_byte_size for i in range(metadata.num_row_groups)),
    )
    if unpacked > MAX_UNPACKED_BYTES:
        raise too_large(file)
    sidecar = (schema.metadata or {}).get(PARQUET_KEY)
    return sidecar, _batches(pa, table, columns, file)


def embedded_sidecar(path: Path) -> bytes | None:
    """The sidecar's JSON in a Parquet file's footer, if it has one. Raises `RecordingError`."""
    pa, pq = _pyarrow(str(path))
    try:
        return (pq.read_schema(path).metadata or {}).get(PARQUET_KEY)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise _broken(str(path), error) from error


def write_parquet(
    target: BinaryIO, names: list[str], arrays: dict[str, FloatArray], sidecar: dict[str, object]
) -> None:
    """Writes one row a sample; `names` is the sensor of each row, `arrays` the other columns by name."""
    pa, pq = _pyarrow("parquet")
    schema = pa.schema(
        [pa.field("sensor", pa.string()), *(pa.field(name, pa.float64()) for name in arrays)],
        metadata={PARQUET_KEY: orjson.dumps(sidecar)},
    )
    table = pa.table([pa.array(names, pa.string()), *(pa.array(column) for column in arrays.values())], schema=schema)
    pq.write_table(table, target, compression="zstd")


def _batches(pa: ModuleType, table: object, columns: Columns, file: str) -> Iterator[tuple[Columns, RowBlock]]:
    line = 1
    total = 0
    batches = table.iter_batches(batch_size=_ROWS_A_BATCH, use_threads=False)  # type: ignore[attr-defined]  # pyarrow has no types
    while True:
        try:
            batch = next(batches, None)
        except (pa.ArrowException, OSError, ValueError) as error:
            raise _broken(file, error) from error
        if batch is None:
            return
        total += batch.nbytes
        if total > MAX_UNPACKED_BYTES:
            raise too_large(file)
        if batch.num_rows:
            yield columns, _block(pa, batch, columns, line, file)
        line += batch.num_rows


def _block(pa: ModuleType, batch: object, columns: Columns, line: int, file: str) -> RowBlock:
    values = np.zeros((batch.num_rows, len(columns.names)))  # type: ignore[attr-defined]  # pyarrow has no types
    for position, name in enumerate(columns.names):
        column = batch.column(position)  # type: ignore[attr-defined]  # pyarrow has no types
        if column.null_count:
            row = int(np.argmax(column.is_null().to_numpy(zero_copy_only=False)))
            raise not_finite(name, "empty", line + row, file)
        if name != "sensor":
            values[:, position] = column.to_numpy(zero_copy_only=False).astype(np.float64)
    sensor = batch.column(columns.sensor).cast(pa.dictionary(pa.int32(), pa.string()))  # type: ignore[attr-defined]  # pyarrow has no types
    words = sensor.dictionary.to_pylist()
    indices = sensor.indices.to_numpy(zero_copy_only=False)
    is_known = np.array([word in (SensorName.BODY, SensorName.LEVER) for word in words])[indices]
    if not is_known.all():
        row = int(np.argmin(is_known))
        raise unknown_sensor(words[indices[row]], line + row, file)
    is_lever = np.array([word == SensorName.LEVER for word in words])[indices]
    return RowBlock(is_lever, values, line)


def _is_text(pa: ModuleType, kind: object) -> bool:
    value = getattr(kind, "value_type", kind)
    return bool(pa.types.is_string(value) or pa.types.is_large_string(value))


def _is_number(pa: ModuleType, kind: object) -> bool:
    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind))


def _broken(file: str, error: Exception) -> RecordingError:
    return RecordingError(
        "bad_parquet",
        file=file,
        found=f"not readable ({str(error).splitlines()[0][:120] if str(error) else type(error).__name__})",
        wanted="a whole Parquet file",
        detail="The file was cut short or damaged: copy it again",
    )


def _pyarrow(file: str) -> tuple[ModuleType, ModuleType]:
    try:
        import pyarrow  # noqa: PLC0415 - an extra, and slow to import
        import pyarrow.parquet  # noqa: PLC0415
    except ImportError as error:
        raise RecordingError(
            "needs_pyarrow",
            file=file,
            found="Parquet, without pyarrow installed",
            wanted="the extra `parquet`",
            detail="Install it with: pip install 'inhalemon[parquet]'",
        ) from error
    return pyarrow, pyarrow.parquet
