"""`inhalemon rules` and `inhalemon explain`: what is held against a recording, and why."""

from __future__ import annotations

from typing import Annotated

import typer

from inhalemon.cli.options import RulesOption, rules_of
from inhalemon.cli.output import console, table


def add_to(app: typer.Typer) -> None:
    app.command("rules")(rules)
    app.command("explain")(explain)


def rules(
    rules: RulesOption = "default",
    device: Annotated[str | None, typer.Option(metavar="D", help="Only the rules of pmdi or ellipta.")] = None,
) -> None:
    """List the rules: for which device, when they fail, and how well the number is founded."""
    from inhalemon.rules.explain import devices_in_words, levels_in_words
    from inhalemon.values import DeviceKind

    rule_set = rules_of(rules)
    if device is not None and device not in tuple(DeviceKind):
        raise typer.BadParameter(f"{device!r} is none of {', '.join(DeviceKind)}", param_hint="--device")
    chosen = rule_set.rules if device is None else rule_set.of(DeviceKind(device))
    made = table(f"Profile {rule_set.profile}", "rule", "devices", "severity", "fails when", "evidence")
    for column in made.columns:
        column.justify = "left"
    made.columns[3].no_wrap = False
    for rule in chosen:
        evidence = "" if rule.evidence is None else str(rule.evidence)
        if rule.never_decided is not None:
            made.add_row(rule.id, devices_in_words(rule), "", f"never decided: {rule.never_decided}", evidence)
        for number, (severity, words) in enumerate(levels_in_words(rule)):
            head = (rule.id, devices_in_words(rule)) if number == 0 else ("", "")
            made.add_row(*head, severity, words, evidence if number == 0 else "")
    console().print(made)


def _rule_ids(incomplete: str) -> list[str]:
    return [rule.id for rule in rules_of("default").rules if rule.id.startswith(incomplete)]


def explain(
    rule: Annotated[str, typer.Argument(metavar="RULE", help="A rule's name.", autocompletion=_rule_ids)],
    rules: RulesOption = "default",
) -> None:
    """Say what a rule means, when it fails, how grave that is, and where its numbers come from."""
    from inhalemon.rules import explain as in_words

    rule_set = rules_of(rules)
    known = [each.id for each in rule_set.rules]
    if rule not in known:
        raise typer.BadParameter(f"{rule!r} is none of {', '.join(known)}", param_hint="RULE")
    typer.echo(in_words(rule, rule_set))
