"""What several verbs take: a recording, a device, settings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from inhalemon.cli.sources import Source, sources
from inhalemon.exceptions import RecordingError

if TYPE_CHECKING:
    from inhalemon.devices import Device
    from inhalemon.rules import RuleSet
    from inhalemon.settings import Settings
    from inhalemon.values import Recording


Form = Literal["table", "json", "jsonl", "csv"]


def _device_names(incomplete: str) -> list[str]:
    from inhalemon.devices import device_names

    return [name for name in device_names() if name.startswith(incomplete)]


RecordingPath = Annotated[str, typer.Argument(metavar="PATH", help="A recording, or - for standard input.")]
RecordingPaths = Annotated[
    list[str], typer.Argument(metavar="PATH", help="Recordings, folders to walk, or - for standard input.")
]
DeviceOption = Annotated[
    str | None,
    typer.Option(
        "--device",
        metavar="D",
        help="pmdi, ellipta, hinge or a device profile (.toml); overrides the sidecar.",
        autocompletion=_device_names,
    ),
]
RulesOption = Annotated[
    str, typer.Option("--rules", metavar="F", help="default, strict, or a file (.toml) that changes or adds rules.")
]
SettingsOption = Annotated[
    Path | None, typer.Option("--settings", metavar="F", help="Settings (.toml); what it leaves out keeps its default.")
]


def device_of(name: str | None) -> Device | None:
    """The device profile that `--device` names. Raises `DeviceError` for a profile that cannot be used."""
    if name is None:
        return None
    from inhalemon.devices import device_names, load_device

    if name not in device_names() and not name.endswith(".toml"):
        wanted = ", ".join(device_names())
        raise typer.BadParameter(f"{name!r} is none of {wanted}, and no .toml profile", param_hint="--device")
    return load_device(name)


def rules_of(name: str) -> RuleSet:
    """The rules that `--rules` names. Raises `RulesError`."""
    from inhalemon.rules import load_rules

    return load_rules(name)


def settings_of(path: Path | None) -> Settings:
    """The settings in the file, or the defaults. Raises `SettingsError`."""
    from inhalemon.settings import Settings

    return Settings() if path is None else Settings.from_toml(path)


def read_source(source: Source, device: Device | None) -> Recording:
    """The recording behind a source. Raises `RecordingError`."""
    from inhalemon.recording import read_recording, read_recording_bytes

    kind = None if device is None else device.kind
    if source.data is not None:
        return read_recording_bytes(source.data, name=source.name, device=kind)
    return read_recording(source.name, device=kind)


def read_one(path: str, device: Device | None) -> Recording:
    """The one recording that a verb works on; a folder is refused. Raises `RecordingError`."""
    if Path(path).is_dir():
        raise RecordingError("unreadable", file=path, column="file", found="a folder", wanted="one recording")
    return read_source(sources([path])[0], device)
