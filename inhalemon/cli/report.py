"""`inhalemon report`: one session as one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from inhalemon.cli.options import (
    DeviceOption,
    RecordingPath,
    RulesOption,
    SettingsOption,
    device_of,
    read_one,
    rules_of,
    settings_of,
)
from inhalemon.cli.output import write


def add_to(app: typer.Typer) -> None:
    app.command("report")(report)


def report(
    path: RecordingPath,
    out: Annotated[
        Path | None, typer.Option(metavar="F", help="The page (.html); without it, standard output.")
    ] = None,
    device: DeviceOption = None,
    rules: RulesOption = "default",
    settings: SettingsOption = None,
) -> None:
    """Write one self-contained HTML page with curves, phases, findings, and what could not be assessed."""
    profile, chosen, rule_set = device_of(device), settings_of(settings), rules_of(rules)

    from inhalemon.devices import load_device
    from inhalemon.pipeline import estimate_tracks, report_of
    from inhalemon.report.curves import session_panels
    from inhalemon.report.page import session_page

    recording = read_one(path, profile)
    profile = profile or load_device(recording.device)
    tracks = estimate_tracks(recording, chosen, device=profile)
    panels = session_panels(tracks, moving_part=profile.moving_part)
    titles = {rule.id: rule.title for rule in rule_set.rules}
    write(session_page(report_of(tracks, chosen, rules=rule_set, device=profile), panels, titles=titles), out)
