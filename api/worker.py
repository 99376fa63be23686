"""One worker: reads orders, a line of JSON each, from its input, and answers on its output. Ends when its input does.

The only module of the service that runs the pipeline. An answer is a line of JSON with `n_bytes`, then that many bytes.
"""

from __future__ import annotations

import functools
import io
import os
import resource
import signal
import sys
import traceback
from collections.abc import Callable, Mapping
from typing import BinaryIO

import numpy as np
import orjson
import zstandard

from api import tracks
from inhalemon.devices import load_device
from inhalemon.exceptions import InhalemonError, RecordingError
from inhalemon.pipeline import PIPELINE_VERSION, estimate_tracks, score_recording
from inhalemon.recording import read_recording_bytes
from inhalemon.report import from_dict, to_json
from inhalemon.rules import RuleSet, load_rules
from inhalemon.settings import Settings
from inhalemon.values import DeviceKind, ImuTrack, Recording

Order = Mapping[str, object]
Told = tuple[dict[str, object], bytes]


def main(memory_bytes: int) -> None:
    """Serve until the input ends, within this much memory of its own: what does not fit is refused and harms nobody."""
    resource.setrlimit(resource.RLIMIT_DATA, (memory_bytes, memory_bytes))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the server's to handle
    # What a library prints must not land among the answers.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    _warm_up()
    answers.write(b"ready\n")
    answers.flush()
    for line in sys.stdin.buffer:
        head, body = answer(orjson.loads(line))
        answers.write(orjson.dumps(head | {"n_bytes": len(body)}) + b"\n" + body)
        answers.flush()


def _warm_up() -> None:
    """Score a device at rest: what the pipeline loads late is loaded before somebody waits for it."""
    time_s = np.arange(500) / 50.0
    still = ImuTrack(time_s, np.tile([0.0, 0.0, 9.81], (500, 1)), np.zeros((500, 3)))
    score_recording(Recording(DeviceKind.PMDI, still, still))


def answer(order: Order) -> Told:
    """What one order gives; a recording that cannot be used, and a failure of ours, are answers as well."""
    try:
        return _TASKS[str(order["task"])](order)
    except RecordingError as error:
        names = ("code", "line", "column", "found", "wanted")
        return {"refusal": {"sentence": str(error)} | {name: getattr(error, name) for name in names}}, b""
    except MemoryError:
        told = "The recording needs more memory than one worker may take; record at a lower rate, or in shorter pieces."
        return {"refusal": {"sentence": told, "code": "too_much_memory"}}, b""
    except (InhalemonError, ArithmeticError, ValueError, LookupError, TypeError, OSError) as error:
        # The place and the kind, not the message: a message may quote what is known of a patient.
        where = [f"{each.filename}:{each.lineno}" for each in traceback.extract_tb(error.__traceback__)[-3:]]
        return {"failure": f"{type(error).__name__} at {' < '.join(reversed(where))}"}, b""


def _versions(order: Order) -> Told:
    found = {
        "pipeline": PIPELINE_VERSION,
        "settings_digest": _settings(order["settings"]).digest,
        "rules_digest": _rules(str(order["rules"])).digest,
    }
    return dict(found), b""


def _score(order: Order) -> Told:
    recording = _recording(order)
    settings, rules = _settings(order["settings"]), _rules(str(order["rules"]))
    report = score_recording(recording, settings=settings, rules=rules)
    has_own_name = not str(order["name"]).startswith(recording.session_id)
    head: dict[str, object] = {
        "device": str(recording.device),
        "session_ref": recording.session_id if has_own_name else None,
        "patient_ref": recording.patient_ref,
        "recorded_at": recording.recorded_at,
    }
    return head, to_json(report)


def _series(order: Order) -> Told:
    packed = io.BytesIO()
    np.save(packed, tracks.table(_recording(order), _settings(order["settings"])), allow_pickle=False)
    return {}, packed.getvalue()


def _page(order: Order) -> Told:
    """The page of a stored report, with the curves of its recording as they are estimated today."""
    from api import report_page  # noqa: PLC0415  # with the page's templates, seldom needed
    from inhalemon.report.curves import session_panels  # noqa: PLC0415
    from inhalemon.report.page import session_page  # noqa: PLC0415

    recording = _recording(order)
    device = load_device(recording.device)
    panels = session_panels(
        estimate_tracks(recording, _settings(order["settings"]), device=device), moving_part=device.moving_part
    )
    titles = {rule.id: rule.title for rule in _rules(str(order["rules"])).rules}
    report = from_dict(orjson.loads(str(order["report"])))
    review = report_page.read(orjson.loads(str(order["review"])))
    return {}, session_page(report, panels, titles=titles, review=review).encode()


_TASKS: Mapping[str, Callable[[Order], Told]] = {
    "versions": _versions,
    "score": _score,
    "series": _series,
    "page": _page,
}


def _recording(order: Order) -> Recording:
    metadata = order["metadata"]
    with open(str(order["path"]), "rb") as file, zstandard.ZstdDecompressor().stream_reader(file) as stream:
        source: BinaryIO = io.BufferedReader(stream)
        return read_recording_bytes(
            source, name=str(order["name"]), metadata=orjson.loads(metadata) if isinstance(metadata, str) else None
        )


@functools.lru_cache(maxsize=4)
def _settings(path: object) -> Settings:
    return Settings() if path is None else Settings.from_toml(str(path))


@functools.lru_cache(maxsize=4)
def _rules(profile_or_path: str) -> RuleSet:
    return load_rules(profile_or_path)


if __name__ == "__main__":
    main(int(sys.argv[1]))
