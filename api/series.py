"""Time series of a session: computed once by a worker, cached, and reduced to what a screen can show."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import orjson
from numpy.typing import NDArray
from starlette.concurrency import run_in_threadpool

from api.channels import CHANNELS, DEFAULT, LAYOUT
from api.problems import InvalidError
from api.scoring import ask_worker, pipeline_versions
from api.service import Service
from api.store.sessions import Session

BINARY_TYPE = "application/vnd.inhalemon.series"

FloatTable = NDArray[np.float32]  # (channel, sample); the first channel is the time


async def table_of(service: Service, session: Session) -> FloatTable:
    """All channels of a session at full rate, from the cache or from a worker."""
    versions = await pipeline_versions(service)
    key = f"{LAYOUT}-{session.device}-{versions['pipeline']}-{versions['settings_digest'][:16]}"
    path = await run_in_threadpool(service.cache.find, session.id, key)
    if path is None:
        answer = await ask_worker(service, "series", session)
        path = await run_in_threadpool(service.cache.keep, session.id, key, answer.body)
    return await run_in_threadpool(_load, path)


def _load(path: Path) -> FloatTable:
    table: FloatTable = np.load(path, mmap_mode="r", allow_pickle=False)
    return table


def chosen(channels: str | None) -> tuple[str, ...]:
    """The channels in a comma-separated list. Raises `InvalidError` naming the unknown one."""
    names = DEFAULT if channels is None else tuple(name.strip() for name in channels.split(",") if name.strip())
    for name in names:
        if name not in CHANNELS:
            raise InvalidError(f"There is no channel {name!r}; choose among {', '.join(CHANNELS)}.", column="channels")
    return tuple(dict.fromkeys(name for name in names if name != "time_s"))


def reduced(
    table: FloatTable, names: Sequence[str], *, from_s: float | None, to_s: float | None, max_points: int
) -> FloatTable:
    """The time and the named channels between two moments, at most `max_points` long, (1 + channel, point).

    Where there are more samples than points, each stretch of time gives its smallest and its largest value in the order
    in which they came: no spike is lost and none is invented.
    """
    time_s = np.asarray(table[0])
    first = 0 if from_s is None else int(np.searchsorted(time_s, from_s, side="left"))
    last = time_s.size if to_s is None else int(np.searchsorted(time_s, to_s, side="right"))
    rows = [0, *(CHANNELS.index(name) for name in names)]
    part = np.asarray(table[:, first:last])[rows]
    n = part.shape[1]
    if n <= max_points:
        return np.ascontiguousarray(part)
    n_buckets = max(1, max_points // 2)
    edges = np.linspace(0, n, n_buckets + 1).astype(np.intp)
    size = int(np.diff(edges).max())
    # Every bucket as a row of equal length: a shorter one repeats its last sample.
    index = np.minimum(edges[:-1, None] + np.arange(size), edges[1:, None] - 1)
    values = part[1:, index]  # (channel, bucket, sample)
    is_missing = np.isnan(values)
    low = np.where(is_missing, np.inf, values).argmin(axis=-1)
    high = np.where(is_missing, -np.inf, values).argmax(axis=-1)
    order = np.sort(np.stack([low, high], axis=-1), axis=-1)
    picked = np.take_along_axis(values, order, axis=-1)
    pair_time_s = part[0][np.stack([edges[:-1], edges[1:] - 1], axis=-1)]
    return np.concatenate([pair_time_s.reshape(1, -1), picked.reshape(len(names), -1)])


def as_json(names: Sequence[str], points: FloatTable) -> bytes:
    """`{"channels": [...], "time_s": [...], "values": {name: [...]}}`; what is not known is null."""
    content = {
        "channels": list(names),
        "time_s": np.ascontiguousarray(points[0]),
        "values": {name: np.ascontiguousarray(row) for name, row in zip(names, points[1:], strict=True)},
    }
    return orjson.dumps(content, option=orjson.OPT_SERIALIZE_NUMPY)


def as_binary(names: Sequence[str], points: FloatTable) -> bytes:
    """Length of the head (uint32), the head (JSON, padded with blanks to a multiple of 4), then float32 rows, the time
    first; all little-endian.
    """
    head = orjson.dumps({"channels": list(names), "points": points.shape[1]})
    head += b" " * (-len(head) % 4)
    return struct.pack("<I", len(head)) + head + np.ascontiguousarray(points, dtype="<f4").tobytes()
