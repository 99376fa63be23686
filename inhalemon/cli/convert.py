"""`inhalemon convert`: recordings in another form."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from inhalemon.cli.failures import UNUSABLE_RECORDING, tell
from inhalemon.cli.options import DeviceOption, RecordingPaths, device_of, read_source
from inhalemon.cli.sources import sources
from inhalemon.exceptions import RecordingError


def add_to(app: typer.Typer) -> None:
    app.command("convert")(convert)


def convert(
    paths: RecordingPaths,
    to: Annotated[Literal["csv", "csv.gz", "csv.zst", "parquet", "motion-bids"], typer.Option(help="The form.")],
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where the files go; made when it is not there.")],
    device: DeviceOption = None,
) -> None:
    """Write recordings as CSV or Parquet, each under its own name, or into a Motion-BIDS dataset.

    What is there already is never written over.
    """
    from inhalemon.recording import write_motion_bids, write_recording
    from inhalemon.recording.layout import stem_of

    profile = device_of(device)
    found = sources(paths)
    out.mkdir(parents=True, exist_ok=True)
    is_any_unusable = False
    for source in found:
        try:
            recording = read_source(source, profile)
            if to == "motion-bids":
                path = write_motion_bids(recording, out)
            else:
                path = out / f"{stem_of(source.name)}.{to}"
                if path.exists():
                    raise RecordingError(
                        "session_exists",
                        file=source.name,
                        column="file",
                        found=f"already there as {path}",
                        wanted="a name that the folder does not hold",
                    )
                write_recording(recording, path)
        except RecordingError as error:
            is_any_unusable = True
            tell(str(error))
        else:
            typer.echo(path)
    if is_any_unusable:
        raise typer.Exit(UNUSABLE_RECORDING)
