"""`inhalemon track`: the time series behind a report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inhalemon.cli.options import DeviceOption, RecordingPath, SettingsOption, device_of, read_one, settings_of
from inhalemon.cli.output import write

if TYPE_CHECKING:
    from inhalemon.pipeline import Tracks
    from inhalemon.values import FloatArray


def add_to(app: typer.Typer) -> None:
    app.command("track")(track)


def track(
    path: RecordingPath,
    out: Annotated[Path | None, typer.Option(metavar="F", help="A .csv or .parquet file; without it, CSV.")] = None,
    device: DeviceOption = None,
    settings: SettingsOption = None,
) -> None:
    """Write attitude, tilt, lever angle, their deviations and R over time."""
    from inhalemon.pipeline import estimate_tracks

    if out is not None and out.suffix not in {".csv", ".parquet"}:
        raise typer.BadParameter(f"{out.name!r} ends in neither .csv nor .parquet", param_hint="--out")
    profile = device_of(device)
    chosen = settings_of(settings)
    columns = _columns(estimate_tracks(read_one(path, profile), chosen, device=profile))
    if out is not None and out.suffix == ".parquet":
        write(_as_parquet(columns), out)
    else:
        write(_as_csv(columns), out)


def _columns(tracks: Tracks) -> dict[str, FloatArray]:
    """Column name to values; q are `q_ref_body` and `q_ref_lever`, the lever's room turned into the body's."""
    import numpy as np

    from inhalemon.rotation import about_z, multiply, tilt_from_upright

    body, lever, angle = tracks.body, tracks.lever, tracks.angle
    q_lever = multiply(about_z(tracks.calibration.heading_rad), lever.q)
    columns = {"time_s": body.time_s}
    for name, q in (("body", body.q), ("lever", q_lever)):
        columns |= {f"q_ref_{name}_{axis}": q[:, number] for number, axis in enumerate("wxyz")}
    degrees = {
        "tilt_body_deg": tilt_from_upright(body.q),
        "tilt_body_sd_deg": body.sd_tilt_rad,
        "lever_angle_deg": angle.angle_rad,
        "lever_angle_sd_deg": angle.sd_rad,
        "lever_off_axis_deg": angle.off_axis_rad,
    }
    columns |= {name: np.rad2deg(values) for name, values in degrees.items()}
    return columns | {"r_body": body.r, "r_lever": lever.r}


def _as_csv(columns: dict[str, FloatArray]) -> bytes:
    import io

    import numpy as np

    text = io.StringIO()
    formats = ["%.6f" if name == "time_s" else "%.9g" for name in columns]  # microseconds, though it count from 1970
    table = np.column_stack(list(columns.values()))
    np.savetxt(text, table, fmt=formats, delimiter=",", header=",".join(columns), comments="")
    return text.getvalue().encode()


def _as_parquet(columns: dict[str, FloatArray]) -> bytes:
    import io

    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise typer.BadParameter("needs pyarrow: pip install 'inhalemon[parquet]'", param_hint="--out") from None
    target = io.BytesIO()
    pq.write_table(pa.table(columns), target)
    return target.getvalue()
