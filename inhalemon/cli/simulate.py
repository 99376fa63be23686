"""`inhalemon simulate`: sessions with known truth, for trying out and for tests."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from inhalemon.exceptions import SimulationError


def add_to(app: typer.Typer) -> None:
    app.command("simulate")(simulate)


def simulate(
    device: Annotated[Literal["pmdi", "ellipta"], typer.Argument(metavar="pmdi|ellipta", help="Which inhaler.")],
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where the files go; made when it is not there.")],
    mistake: Annotated[
        list[str] | None, typer.Option(metavar="RULE", help="A mistake to act, by its rule's name; may be repeated.")
    ] = None,
    random_mistakes: Annotated[
        bool, typer.Option("--random-mistakes", help="Draw the mistakes of each session instead.")
    ] = False,
    count: Annotated[int, typer.Option(min=1, help="How many sessions, with seeds counting up.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first.")] = 0,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Samples a second of both sensors.")] = 100.0,
    doses: Annotated[int, typer.Option(min=1, help="Doses in a session.")] = 1,
    profile: Annotated[
        Literal["perfect", "typical", "harsh"], typer.Option(help="How good the sensors are and how steady the hand.")
    ] = "typical",
    form: Annotated[Literal["csv", "csv.gz", "csv.zst", "parquet"], typer.Option("--format")] = "csv",
) -> None:
    """Write simulated sessions: a recording, its sidecar and its labels (*.truth.json) each."""
    import numpy as np

    from inhalemon.recording import write_recording
    from inhalemon.simulate import draw_mistakes, simulate_session
    from inhalemon.values import DeviceKind

    if random_mistakes and mistake:
        raise SimulationError("--random-mistakes and --mistake are both given; expected one of them")
    out.mkdir(parents=True, exist_ok=True)
    for number in range(seed, seed + count):
        chosen = tuple(mistake or ())
        if random_mistakes:
            chosen = draw_mistakes(DeviceKind(device), np.random.default_rng(number))
        recording, truth = simulate_session(device, chosen, seed=number, rate_hz=rate, profile=profile, n_doses=doses)
        path = out / f"{recording.session_id}.{form}"
        write_recording(recording, path)
        truth.write_labels(path)
        typer.echo(f"{path}  {', '.join(chosen) or 'no mistake'}")
