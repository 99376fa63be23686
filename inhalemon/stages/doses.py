"""One session, one or several doses."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from inhalemon.devices import Device
from inhalemon.values import DeviceKind, Event, EventKind, Phase, PhaseKind, Shake


def split_doses(
    phases: Sequence[Phase], shakes: Sequence[Shake], events: Sequence[Event], device: Device
) -> tuple[tuple[float, float], ...]:
    """The stretch `(start_s, end_s)` of each dose, in order; together they cover the session.

    A dose ends when the next shake (pMDI) or opening (Ellipta) begins after an inhalation.
    """
    if not phases or device.kind is DeviceKind.HINGE:
        return ()
    if device.kind is DeviceKind.ELLIPTA:
        begins = [event.start_s for event in events if event.kind is EventKind.OPEN]
    else:
        begins = [shake.start_s for shake in shakes]
    edges = [phases[0].start_s]
    for begin in sorted(begins):
        if any(phase.kind is PhaseKind.INHALE and edges[-1] <= phase.start_s < begin for phase in phases):
            edges.append(begin)
    edges.append(phases[-1].end_s)
    return tuple(itertools.pairwise(edges))
