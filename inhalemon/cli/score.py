"""`inhalemon score`: reports of recordings, one or thousands."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from inhalemon.cli.failures import UNUSABLE_RECORDING, tell
from inhalemon.cli.options import (
    DeviceOption,
    Form,
    RecordingPaths,
    RulesOption,
    SettingsOption,
    device_of,
    rules_of,
    settings_of,
)
from inhalemon.cli.output import progress
from inhalemon.cli.sources import STANDARD_INPUT, Source, sources

# A smaller batch is done before other processes have started and imported the pipeline.
_ALONE_BELOW = 48


def add_to(app: typer.Typer) -> None:
    app.command("score")(score)


def score(
    paths: RecordingPaths,
    device: DeviceOption = None,
    rules: RulesOption = "default",
    settings: SettingsOption = None,
    form: Annotated[
        Form | None, typer.Option("--format", help="By default what the name of --out says, or a table.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option("--jobs", "-j", metavar="N", min=1, help="Processes; by default one a core.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="F", help="Write to this file, which skips the sessions that it holds.")
    ] = None,
) -> None:
    """Score recordings: phases, measures, mistakes with their severity, and what could not be assessed.

    Folders are walked. A recording that cannot be used does not stop the others: it is told on stderr, in JSON and
    JSONL an inhalemon-error/1 document takes its place, and the exit code is 3.
    """
    profile, chosen, rule_set = device_of(device), settings_of(settings), rules_of(rules)
    # The results of an earlier run may lie in the folder that is walked.
    found = [source for source in sources(paths) if out is None or Path(source.name).absolute() != out.absolute()]
    is_single = len(paths) == 1 and (paths[0] == STANDARD_INPUT or not Path(paths[0]).is_dir())

    from inhalemon.cli.batch import run_batch, usable_cores
    from inhalemon.cli.scoring import Scoring, crashed
    from inhalemon.cli.sinks import form_of, sink_of
    from inhalemon.pipeline import PIPELINE_VERSION

    versions = (PIPELINE_VERSION, chosen.digest, rule_set.digest)
    asked = {source.name for source in found}
    sink, kept = sink_of(form or form_of(out), out, versions, asked, is_single=is_single)
    waiting = _not_kept(found, kept)
    n_workers = min(jobs or (1 if len(waiting) < _ALONE_BELOW else usable_cores()), len(waiting))
    outcomes = run_batch(
        Scoring(profile, chosen, rule_set),
        waiting,
        n_workers=n_workers,
        on_crash=crashed,
        preload=["inhalemon.cli.scoring"],
    )
    is_any_unusable = False
    with closing(outcomes):
        for outcome in progress(outcomes, n_done=len(found) - len(waiting), n=len(found), doing="scoring"):
            sink.add(outcome.document)
            if outcome.failure is not None:
                is_any_unusable = True
                tell(outcome.failure)
    sink.close()
    if is_any_unusable:
        raise typer.Exit(UNUSABLE_RECORDING)


def _not_kept(found: Iterable[Source], kept: Iterable[str]) -> list[Source]:
    """The sources whose report is not there yet. Sessions of one name count as often as they are there."""
    from inhalemon.recording import session_id_of

    left = Counter(kept)
    waiting = []
    for source in found:
        session_id = session_id_of(source.name) if left else ""
        if left[session_id]:
            left[session_id] -= 1
        else:
            waiting.append(source)
    return waiting
