"""`inhalemon evaluate`: reports against labels."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from inhalemon.cli.output import console, table, write
from inhalemon.exceptions import LabelsError
from inhalemon.formats import ERROR_FORMAT, LABELS_FORMAT, REPORT_FORMAT

if TYPE_CHECKING:
    from rich.table import Table

    from inhalemon.evaluate import Evaluation
    from inhalemon.evaluate.segments import Boundaries, Spread


def add_to(app: typer.Typer) -> None:
    app.command("evaluate")(evaluate)


def evaluate(
    reports: Annotated[str, typer.Argument(help="Reports: JSONL, JSON, a folder of such files, or - .")],
    labels: Annotated[
        Path, typer.Argument(exists=True, help="Labels: *.truth.json in a folder, one such file, or JSONL.")
    ],
    form: Annotated[Literal["table", "json"], typer.Option("--format", help="How to print.")] = "table",
    out: Annotated[Path | None, typer.Option(help="Write to this file instead of standard output.")] = None,
) -> None:
    """Compare reports with labels: mistakes by rule, boundaries of phases and events, measures."""
    import orjson

    from inhalemon import evaluate as library

    result = library.evaluate(
        [library.session_from_report(each) for each in _documents(reports, (REPORT_FORMAT, ERROR_FORMAT))],
        [library.session_from_labels(each) for each in _documents(str(labels), (LABELS_FORMAT,))],
    )
    if form == "json":
        write(orjson.dumps(result.to_dict(), option=orjson.OPT_INDENT_2) + b"\n", out)
        return
    terminal = console()
    with terminal.capture() as captured:
        for part in _tables(result):
            if part.row_count:
                terminal.print(part)
        terminal.print(_summary(result))
    write(captured.get(), out)


def _documents(source: str, formats: tuple[str, ...]) -> Iterator[dict[str, object]]:
    """Every document of the wanted formats; in a folder others are passed over, in a named file they are an error."""
    if source == "-":
        yield from _parsed("standard input", sys.stdin.buffer.read())
    elif not Path(source).is_dir():
        yield from _parsed(source, Path(source).read_bytes())
    else:
        for path in sorted(Path(source).rglob("*.json*")):
            if path.suffix in {".json", ".jsonl"}:
                found = _parsed(str(path), path.read_bytes())
                yield from (each for each in found if each.get("format") in formats)


def _parsed(name: str, data: bytes) -> Iterator[dict[str, object]]:
    """The JSON objects of a document, of a list of them, or of lines of them."""
    import orjson

    try:
        whole = orjson.loads(data)
        found = whole if isinstance(whole, list) else [whole]
    except orjson.JSONDecodeError:
        found = []
        for number, line in enumerate(data.splitlines(), start=1):
            try:
                found += [orjson.loads(line)] if line.strip() else []
            except orjson.JSONDecodeError as error:
                raise LabelsError(f"{name} line {number}: {error}; expected JSON") from error
    for each in found:
        if not isinstance(each, dict):
            raise LabelsError(f"{name}: found {type(each).__name__}; expected JSON objects")
        yield each


def _tables(result: Evaluation) -> Iterator[Table]:
    verdicts = ("TP", "FP", "FN", "F1", "95 %", "kappa", "missed: indet.", "missed: n/a", "doubted")
    rules = table("Mistakes", "rule", *verdicts)
    for name, rule in result.rules.items():
        found = rule.agreement
        interval = "" if found.f1_interval is None else "{:.2f}-{:.2f}".format(*found.f1_interval)
        counts = (str(found.tp), str(found.fp), str(found.fn))
        doubts = [str(n or "") for n in (rule.missed_as_indeterminate, rule.missed_as_not_assessable, rule.doubted)]
        rules.add_row(name, *counts, _text(found.f1), interval, _text(found.kappa), *doubts)
    yield rules
    yield _boundary_table("Phases", result.phases)
    yield _boundary_table("Events", result.events)
    columns = ("n", "missing", "bias", "median", "95th", "error/sd")
    measures = table("Measures: report less label, in the measure's unit", "measure", *columns)
    for name, measure in result.measures.items():
        error = measure.error
        numbers = (None, None, None) if error is None else (error.bias, error.median_abs, error.p95_abs)
        counts_of = (str(error.n if error else 0), str(measure.n_missing or ""))
        measures.add_row(name, *counts_of, *(_text(each, 3) for each in numbers), _text(measure.normalised_error))
    yield measures


def _boundary_table(title: str, found: dict[str, Boundaries]) -> Table:
    columns = ("labelled", "reported", "F1", "start", "median", "95th", "end", "median", "95th")
    made = table(f"{title}: start and end, report less label, in ms", "kind", *columns)
    for kind, each in found.items():
        counts = (str(each.n_labelled), str(each.n_reported), _text(each.f1))
        made.add_row(kind, *counts, *_milliseconds(each.start_s), *_milliseconds(each.end_s))
    return made


def _summary(result: Evaluation) -> str:
    lines = [f"{result.n_sessions} sessions, macro F1 {_text(result.macro_f1, 3) or 'undefined'}"]
    if result.frame_accuracy is not None:
        lines.append(f"frame accuracy {result.frame_accuracy:.3f}, segmental F1@50 {_text(result.segmental_f1_50, 3)}")
    if result.n_unusable:
        lines.append(f"{result.n_unusable} recordings could not be used; their mistakes count as missed")
    if result.not_observable:
        lines.append("labelled, and not observable by these sensors: " + ", ".join(sorted(result.not_observable)))
    for names, side in ((result.without_report, "labels without a report"), (result.without_labels, "without labels")):
        if names:
            lines.append(f"{side}: {len(names)} ({', '.join(names[:5])}{', ...' if len(names) > 5 else ''})")
    return "\n".join(lines)


def _milliseconds(found: Spread | None) -> tuple[str, str, str]:
    if found is None:
        return "", "", ""
    return f"{1e3 * found.bias:.0f}", f"{1e3 * found.median_abs:.0f}", f"{1e3 * found.p95_abs:.0f}"


def _text(number: float | None, digits: int = 2) -> str:
    return "" if number is None else f"{number:.{digits}f}"
