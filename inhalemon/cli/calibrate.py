"""`inhalemon calibrate`: a device's own profile, learned from a recording."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inhalemon.cli.options import DeviceOption, RecordingPath, SettingsOption, device_of, read_one, settings_of
from inhalemon.cli.output import write

if TYPE_CHECKING:
    from inhalemon.calibration import LearnedDevice


def add_to(app: typer.Typer) -> None:
    app.command("calibrate")(calibrate)


def calibrate(
    path: RecordingPath,
    out: Annotated[
        Path | None, typer.Option(metavar="F", help="The profile's file (.toml); without it, standard output.")
    ] = None,
    device: DeviceOption = None,
    settings: SettingsOption = None,
) -> None:
    """Learn a device's hinge axis and full travel from a recording in which it is worked to the stop a few times.

    The result is a device profile for --device.
    """
    from inhalemon.calibration import learn_device
    from inhalemon.devices import load_device
    from inhalemon.pipeline import estimate_tracks

    profile, chosen = device_of(device), settings_of(settings)
    recording = read_one(path, profile)
    profile = profile or load_device(recording.device)
    learned = learn_device(estimate_tracks(recording, chosen, device=profile), profile)
    write(_as_toml(learned, recording.session_id), out)
    if learned.n_strokes:
        travel_rad = learned.device.full_travel_rad or math.nan
        typer.echo(
            f"full travel {math.degrees(travel_rad):.1f} deg "
            f"(sd {math.degrees(learned.travel_sd_rad):.1f}) from {learned.n_strokes} strokes",
            err=True,
        )


def _as_toml(learned: LearnedDevice, session_id: str) -> str:
    import json

    device = learned.device
    lines = [f"# Learned from the recording {json.dumps(session_id)} ({learned.n_strokes} strokes)."]
    lines += [f"title = {json.dumps(device.title)}", f'kind = "{device.kind}"']
    lines += [f"moving_part = {json.dumps(device.moving_part)}", ""]
    lines += [f"hinge_axis = [{', '.join(f'{part:.6f}' for part in device.hinge_axis)}]"]
    lines += [f"hinge_sign = {device.hinge_sign}", ""]
    if device.full_travel_rad is not None:
        sd_deg = math.degrees(learned.travel_sd_rad)
        comment = f"  # sd {sd_deg:.2f}" if learned.n_strokes else ""
        lines += [f"full_travel_deg = {math.degrees(device.full_travel_rad):.2f}{comment}"]
    lines += [f"full_fraction = {device.full_fraction:g}", f"partial_fraction = {device.partial_fraction:g}"]
    lines += [f"uncalibrated_full_deg = {math.degrees(device.uncalibrated_full_rad):g}"]
    lines += [f"uncalibrated_partial_deg = {math.degrees(device.uncalibrated_partial_rad):g}", ""]
    lines += [f"steps = {json.dumps([str(step) for step in device.steps])}", ""]
    return "\n".join(lines)
