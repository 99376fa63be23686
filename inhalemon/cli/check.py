"""`inhalemon check`: whether recordings can be used, without scoring them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from inhalemon.cli.failures import UNUSABLE_RECORDING, tell
from inhalemon.cli.options import DeviceOption, RecordingPaths, SettingsOption, device_of, read_source, settings_of
from inhalemon.cli.output import console, progress, table, write
from inhalemon.cli.sources import Source, sources
from inhalemon.exceptions import RecordingError

if TYPE_CHECKING:
    from inhalemon.devices import Device
    from inhalemon.settings import Settings

Checked = dict[str, object]


def add_to(app: typer.Typer) -> None:
    app.command("check")(check)


def check(
    paths: RecordingPaths,
    device: DeviceOption = None,
    settings: SettingsOption = None,
    form: Annotated[Literal["table", "json"], typer.Option("--format", help="How to print.")] = "table",
) -> None:
    """Check recordings without scoring them: device, length, rates, and what is doubtful.

    The exit code is 3 when some recording could not be used.
    """
    import orjson

    profile, chosen = device_of(device), settings_of(settings)
    found = sources(paths)
    checked = list(
        progress((_checked(source, profile, chosen) for source in found), n_done=0, n=len(found), doing="checking")
    )
    if form == "json":
        write(orjson.dumps(checked, option=orjson.OPT_INDENT_2) + b"\n", None)
    else:
        _print_table(checked)
    if any("error" in each for each in checked):
        raise typer.Exit(UNUSABLE_RECORDING)


def _checked(source: Source, profile: Device | None, settings: Settings) -> Checked:
    from inhalemon.pipeline import estimate_tracks
    from inhalemon.report.documents import error_to_dict, quality_to_dict

    try:
        recording = read_source(source, profile)
        tracks = estimate_tracks(recording, settings, device=profile)
    except RecordingError as error:
        tell(str(error))
        return error_to_dict(error, file=source.name)
    return {
        "file": source.name,
        "session_id": recording.session_id,
        "device": str(recording.device),
        "duration_s": round(float(recording.body.time_s[-1] - recording.body.time_s[0]), 6),
        "body_rate_hz": round(recording.body.rate_hz, 3),
        "lever_rate_hz": round(recording.lever.rate_hz, 3),
        **quality_to_dict(tracks.quality),
    }


def _print_table(checked: Iterable[Checked]) -> None:
    made = table("", "file", "device", "s", "body Hz", "lever Hz", "usable", "doubtful")
    made.columns[-1].justify, made.columns[-1].no_wrap = "left", False
    for each in checked:
        if "error" in each:
            made.add_row(str(each["file"]), "", "", "", "", "refused", str(_error_code(each)))
            continue
        flags = each["flags"]
        assert isinstance(flags, list)
        numbers = [f"{each[name]:.1f}" for name in ("duration_s", "body_rate_hz", "lever_rate_hz")]
        usable = "yes" if each["usable"] else "no"
        details = "\n".join(f"{flag['code']}: {flag['detail']}" for flag in flags)
        made.add_row(str(each["file"]), str(each["device"]), *numbers, usable, details)
    console().print(made)


def _error_code(checked: Checked) -> object:
    error = checked["error"]
    assert isinstance(error, dict)
    return error["code"]
