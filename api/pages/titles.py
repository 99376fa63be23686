"""Rules by their titles, as the profile in use has them."""

from __future__ import annotations

from api.service import Service


def rule_titles(service: Service) -> dict[str, str]:
    """The English title of each rule; other languages name them in their catalogue."""
    return {rule.id: rule.title for rule in service.rules.rules}


def rules_of(service: Service, device: str | None) -> list[str]:
    """The rules that could be broken with this device."""
    return [rule.id for rule in service.rules.rules if device in rule.devices]
