"""Rules as data: which measure means which mistake, how grave it is, and where the number comes from."""

from inhalemon.rules.explain import explain
from inhalemon.rules.load import load_rules, profile_names
from inhalemon.rules.model import Rule, RuleSet

__all__ = ["Rule", "RuleSet", "explain", "load_rules", "profile_names"]
