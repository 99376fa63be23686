"""Rules by their titles, as the profile in use has them."""

from __future__ import annotations

import functools

from api.service import Service
from inhalemon.rules import load_rules


@functools.cache
def _titles(profile: str) -> dict[str, str]:
    return {rule.id: rule.title for rule in load_rules(profile).rules}


def rule_titles(service: Service) -> dict[str, str]:
    """The English title of each rule; other languages name them in their catalogue."""
    return _titles(service.settings.scoring_rules)


def rules_of(service: Service, device: str | None) -> list[str]:
    """The rules that could be broken with this device."""
    found = load_rules(service.settings.scoring_rules)
    return [rule.id for rule in found.rules if device in {str(each) for each in rule.devices}]
