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

    A dose ends when the next shake (pMDI) or opening (Ellipta) begins after an inhalation. Who never tilts inhales
    unseen: a press at the mouth, once prepared, stands for it.
    """
    if not phases or device.kind is DeviceKind.HINGE:
        return ()
    if device.kind is DeviceKind.ELLIPTA:
        begins = [event.start_s for event in events if event.kind is EventKind.OPEN]
    else:
        begins = [shake.start_s for shake in shakes]
    begins.sort()
    inhaled = [phase.start_s for phase in phases if phase.kind is PhaseKind.INHALE]
    pressed = [event.start_s for event in events if event.kind is EventKind.PRESS]
    at_mouth = [phase for phase in phases if phase.kind is PhaseKind.TO_MOUTH]
    unseen = [press_s for press_s in pressed if any(stay.start_s <= press_s < stay.end_s for stay in at_mouth)]
    edges = [phases[0].start_s]
    for begin in begins:
        prepared = next(other for other in begins if other >= edges[-1])
        is_inhaled = any(edges[-1] <= at_s < begin for at_s in inhaled)
        if is_inhaled or any(prepared < at_s < begin for at_s in unseen):
            edges.append(begin)
    edges.append(phases[-1].end_s)
    return tuple(itertools.pairwise(edges))
