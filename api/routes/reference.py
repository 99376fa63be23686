"""What the service knows: rules with their sources, devices."""

from __future__ import annotations

import math
from typing import Any

from fastapi import APIRouter

from api.access import Anybody, ServiceDep
from api.routes.common import problems
from inhalemon.devices import device_names, load_device
from inhalemon.rules import explain

router = APIRouter(prefix="/v1", tags=["reference"])


@router.get("/rules", summary="Every rule: limits, severity, evidence, source", responses=dict(problems()))
def rules(service: ServiceDep, _who: Anybody) -> dict[str, Any]:
    found = service.rules
    return {
        "profile": found.profile,
        "digest": found.digest,
        "items": [
            {
                "rule": rule.id,
                "title": rule.title,
                "devices": [str(device) for device in rule.devices],
                "severity": None if rule.gravest is None else str(rule.gravest),
                "unit": rule.unit,
                "never_decided": rule.never_decided,
                "evidence": None if rule.evidence is None else str(rule.evidence),
                "source": rule.source,
                "explanation": explain(rule.id, found),
            }
            for rule in found.rules
        ],
    }


@router.get("/devices", summary="The devices: hinge, travel, order of steps, rules", responses=dict(problems()))
def devices(_who: Anybody) -> dict[str, Any]:
    return {
        "items": [
            {
                "device": device.name,
                "title": device.title,
                "moving_part": device.moving_part,
                "is_calibrated": device.is_calibrated,
                "full_stroke_deg": round(math.degrees(device.full_stroke_rad), 3),
                "steps": [str(step) for step in device.steps],
            }
            for device in map(load_device, device_names())
        ]
    }
