"""From motion to phases."""

from __future__ import annotations

from collections.abc import Sequence

from inhalemon.devices import Device
from inhalemon.settings import PhaseSettings
from inhalemon.stages.phases.boundaries import phases_of
from inhalemon.stages.phases.evidence import gather_evidence
from inhalemon.stages.phases.order import cheapest_path, transition_costs
from inhalemon.values import DeviceKind, Event, Motion, Phase, Shake


def find_phases(
    motion: Motion,
    shakes: Sequence[Shake],
    events: Sequence[Event],
    device: Device,
    settings: PhaseSettings | None = None,
) -> tuple[Phase, ...]:
    """The phases of the session in order of time, without overlap, covering it.

    Windows are clustered by k-means; what a cluster looks like, and which candidate steps (holds, stays at the mouth,
    strokes) a window lies in, makes each label more or less likely there; the cheapest path over the labels puts them
    in order, leaving the device's own order at a cost. Boundaries are then those of the candidates at full rate. The
    confidence of a phase is how much dearer its windows would be under the next best label.

    Source of the idea: Fujii et al. (2025), k-means on the waveforms of an Ellipta. The path and the refinement are
    departures from it: clusters alone do not know the order of the steps.
    """
    if device.kind is DeviceKind.HINGE:
        return ()
    settings = settings or PhaseSettings()
    evidence = gather_evidence(motion, shakes, events, device, settings)
    labels = cheapest_path(evidence.costs, transition_costs(device.steps, settings))
    return phases_of(motion, evidence, labels, refine_s=settings.refine_s)
