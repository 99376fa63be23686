"""Phases, events, measures and mistakes, against the truth of simulated sessions from two different generators."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from inhalemon.devices import load_device
from inhalemon.evaluate import Evaluation, Session, evaluate, session_from_labels, session_from_report
from inhalemon.pipeline import estimate_tracks, score_recording
from inhalemon.settings import Settings
from inhalemon.simulate import MISTAKES, simulate_session
from inhalemon.simulate.truth import Truth
from inhalemon.stages.events import find_events
from inhalemon.stages.motion import describe_motion
from inhalemon.stages.phases.boundaries import phases_of
from inhalemon.stages.phases.evidence import Evidence, gather_evidence
from inhalemon.stages.phases.order import cheapest_path, transition_costs
from inhalemon.stages.shakes import find_shakes
from inhalemon.values import DeviceKind, IntArray, Recording, Verdict
from validation.second_actor import ATTACKS
from validation.second_generator import second_session
from validation.tables import Table, Target

N_SESSIONS = 1200
N_SECOND = 650
N_ABLATION = 120
RATES_HZ = (50.0, 100.0, 200.0)
DEVICES = (DeviceKind.PMDI, DeviceKind.ELLIPTA)
Out = TypeVar("Out")
_CORRECT_SHARE = 4  # of a device's list of mistakes, how many turns are without any


@dataclass(frozen=True)
class Job:
    """One session to make and score; `attack` names the second generator's, or the first one's profile."""

    generator: str
    device: DeviceKind
    mistakes: tuple[str, ...]
    seed: int
    rate_hz: float
    manner: str

    def make(self) -> tuple[Recording, Truth]:
        if self.generator == "second":
            return second_session(self.device, self.mistakes, seed=self.seed, rate_hz=self.rate_hz, attack=self.manner)
        return simulate_session(self.device, self.mistakes, seed=self.seed, rate_hz=self.rate_hz, profile=self.manner)


def jobs(generator: str, n: int, manners: Sequence[str], *, first_seed: int) -> list[Job]:
    """Every device, mistake, rate and manner in turn; about a fifth of the sessions are without mistakes."""
    made = []
    for i in range(n):
        device = DEVICES[i % 2]
        turn = (i // 2) % (len(MISTAKES[device]) + _CORRECT_SHARE)
        mistakes = (MISTAKES[device][turn],) if turn < len(MISTAKES[device]) else ()
        rate_hz = RATES_HZ[(i // 2) % len(RATES_HZ)]
        made.append(Job(generator, device, mistakes, first_seed + i, rate_hz, manners[(i // 7) % len(manners)]))
    return made


def scored(job: Job) -> tuple[Session, Session]:
    recording, truth = job.make()
    return session_from_report(score_recording(recording)), session_from_labels(truth.to_labels())


def compare(todo: Sequence[Job]) -> tuple[Evaluation, list[tuple[Session, Session]]]:
    pairs = _everywhere(scored, todo)
    return evaluate((report for report, _ in pairs), (label for _, label in pairs)), pairs


def tables() -> list[Table]:
    """The tables of phases, events, mistakes and measures, by generator, and the ablation."""
    first = jobs("first", N_SESSIONS, ("typical", "harsh"), first_seed=700_000)
    found, pairs = compare(first)
    what = (
        f"{N_SESSIONS} simulated sessions of the project's simulator, half typical and half harsh, 35 subjects, "
        "50/100/200 Hz, one mistake each or none"
    )
    made = [_events(found, what), _phases(found, what), _mistakes(found, pairs, what), _measures(found, what)]
    made.append(_by_attack())
    made.append(_ablation())
    return made


def _everywhere(work: Callable[[Job], Out], todo: Sequence[Job]) -> list[Out]:
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(work, todo, chunksize=8))


def _events(found: Evaluation, what: str) -> Table:
    rows, targets = [], []
    for kind, result in found.events.items():
        start = result.start_s
        rows.append(
            (
                kind,
                result.n_labelled,
                result.f1,
                None if start is None else 1e3 * start.median_abs,
                None if start is None else 1e3 * start.p95_abs,
            )
        )
        if kind != "partial_press" and start is not None:
            targets.append(Target(f"{kind}: F1", result.f1 or 0.0, 0.99, at_least=True))
            targets.append(Target(f"{kind}: onset, median", 1e3 * start.median_abs, 20.0, "ms"))
            targets.append(
                Target(f"{kind}: onset, 95th percentile", 1e3 * start.p95_abs, 40.0 if kind == "press" else 60.0, "ms")
            )
    return Table(
        "Events", what, ("event", "labelled", "F1", "onset, median ms", "onset, p95 ms"), tuple(rows), tuple(targets)
    )


def _phases(found: Evaluation, what: str) -> Table:
    rows = []
    for kind, result in found.phases.items():
        start, end = result.start_s, result.end_s
        rows.append(
            (
                kind,
                result.n_labelled,
                result.f1,
                None if start is None else 1e3 * start.p95_abs,
                None if end is None else 1e3 * end.p95_abs,
            )
        )
    inhale = found.phases["inhale"]
    targets = [
        Target("segmental F1@50", found.segmental_f1_50 or 0.0, 0.95, at_least=True),
        Target("frame accuracy", found.frame_accuracy or 0.0, 0.95, at_least=True),
    ]
    if inhale.start_s is not None and inhale.end_s is not None:
        targets.append(Target("inhalation start, 95th percentile", 1e3 * inhale.start_s.p95_abs, 100.0, "ms"))
        targets.append(Target("inhalation end, 95th percentile", 1e3 * inhale.end_s.p95_abs, 150.0, "ms"))
    columns = ("phase", "labelled", "F1 (any overlap by half)", "start, p95 ms", "end, p95 ms")
    return Table("Phases", what, columns, tuple(rows), tuple(targets))


def _mistakes(found: Evaluation, pairs: Iterable[tuple[Session, Session]], what: str) -> Table:
    alarms, asked = Counter[str](), Counter[str]()
    decided = wrong = indeterminate = 0
    for report, label in pairs:
        labelled = {rule for rule, verdict in label.verdicts.items() if verdict is Verdict.FAIL}
        for rule, verdict in report.verdicts.items():
            if not labelled:
                asked[rule] += 1
                alarms[rule] += verdict is Verdict.FAIL
            if verdict in (Verdict.PASS, Verdict.FAIL):
                decided += 1
                wrong += (verdict is Verdict.FAIL) != (rule in labelled)
            indeterminate += verdict is Verdict.INDETERMINATE
    rows, rates = [], []
    for rule, result in sorted(found.rules.items()):
        agreed = result.agreement
        share = 100.0 * alarms[rule] / asked[rule] if asked[rule] else 0.0
        rates.append(share)
        rows.append(
            (rule, agreed.tp, agreed.fp, agreed.fn, result.missed_as_indeterminate, agreed.f1, agreed.kappa, share)
        )
    worst = min((row[5] for row in rows if isinstance(row[5], float)), default=0.0)
    return Table(
        "Mistakes",
        what,
        ("rule", "TP", "FP", "FN", "of them indeterminate", "F1", "kappa", "false alarms on correct sessions, %"),
        tuple(rows),
        (
            Target("macro F1", found.macro_f1 or 0.0, 0.98, at_least=True),
            Target("worst rule's F1", worst, 0.95, at_least=True),
            Target("false alarms on correct sessions, worst rule", max(rates), 1.0, "%"),
        ),
        (f"Of {decided} decided verdicts {wrong} are wrong; {indeterminate} are indeterminate.",),
    )


def _measures(found: Evaluation, what: str) -> Table:
    rows = []
    for name, result in sorted(found.measures.items()):
        if result.error is not None:
            error = result.error
            rows.append((name, error.n, result.n_missing, error.bias, error.p95_abs, result.normalised_error))
    honest = [row for row in rows if isinstance(row[5], float) and math.isfinite(row[5])]
    n_honest = sum(0.7 <= float(row[5]) <= 1.3 for row in honest if row[5] is not None)
    return Table(
        "Measures",
        what,
        ("measure", "n", "missing", "bias", "p95 of the error", "normalised error"),
        tuple(rows),
        (Target("measures with a normalised error in 0.7-1.3", n_honest, len(honest), at_least=True),),
    )


def _by_attack() -> Table:
    todo = jobs("second", N_SECOND, ATTACKS, first_seed=810_000)
    _, pairs = compare(todo)
    rows = []
    for attack in ATTACKS:
        own = [pair for job, pair in zip(todo, pairs, strict=True) if job.manner == attack]
        found = evaluate((report for report, _ in own), (label for _, label in own))
        counts = [result.agreement for result in found.rules.values()]
        tp, fp, fn = (sum(getattr(each, name) for each in counts) for name in ("tp", "fp", "fn"))
        micro = 2 * tp / (2 * tp + fp + fn) if tp + fp + fn else None
        rows.append((attack, len(own), tp, fp, fn, micro, found.frame_accuracy))
    whole = evaluate((report for report, _ in pairs), (label for _, label in pairs))
    return Table(
        "Sessions of the second generator",
        f"{N_SECOND} simulated sessions of a generator of other motions, nothing tuned on these seeds",
        ("attack", "sessions", "TP", "FP", "FN", "F1 over all rules", "frame accuracy"),
        tuple(rows),
        (Target("macro F1", whole.macro_f1 or 0.0, 0.98, at_least=True),),
    )


def _ablated(job: Job) -> tuple[Session, Session, Session, Session]:
    recording, truth = job.make()
    tracks = estimate_tracks(recording)
    device, settings = load_device(job.device), Settings()
    motion = describe_motion(tracks.recording, tracks.body, tracks.angle, settings.motion)
    shakes = find_shakes(motion, settings.shakes)
    events = find_events(motion, shakes, device, settings.events)
    evidence = gather_evidence(motion, shakes, events, device, settings.phases)

    def session(labels: IntArray, refine_s: float) -> Session:
        return Session(session_id=truth.session_id, phases=phases_of(motion, evidence, labels, refine_s=refine_s))

    path = cheapest_path(evidence.costs, transition_costs(device.steps, settings.phases))
    return (
        session_from_labels(truth.to_labels()),
        session(_by_cluster(evidence), 0.0),
        session(path, 0.0),
        session(path, settings.phases.refine_s),
    )


def _by_cluster(evidence: Evidence) -> IntArray:
    """The label (m,) of each window by its cluster alone, the cheapest for all of the cluster."""
    labels = np.empty(evidence.windows.cluster.size, dtype=np.int64)
    for k in np.unique(evidence.windows.cluster):
        members = evidence.windows.cluster == k
        labels[members] = int(np.argmin(evidence.costs[members].mean(axis=0)))
    return labels


def _ablation() -> Table:
    found = _everywhere(_ablated, jobs("first", N_ABLATION, ("typical", "harsh"), first_seed=760_000))
    rows = []
    for k, name in enumerate(("k-means alone", "with the path search", "with refined boundaries"), start=1):
        result = evaluate((each[k] for each in found), (each[0] for each in found))
        starts = [phase.start_s.p95_abs for phase in result.phases.values() if phase.start_s is not None]
        rows.append((name, result.frame_accuracy, result.segmental_f1_50, 1e3 * float(np.median(starts))))
    return Table(
        "Ablation of the phases",
        f"{N_ABLATION} simulated sessions as above",
        ("phases by", "frame accuracy", "segmental F1@50", "start of a phase, median over kinds of p95, ms"),
        tuple(rows),
    )
