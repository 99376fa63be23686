"""Writes `rules.md` from the rule files: `python docs/make_rules.py`. A test holds it to be current."""

from __future__ import annotations

from pathlib import Path

from inhalemon.rules import RuleSet, load_rules
from inhalemon.rules.explain import devices_in_words, levels_in_words, notes_in_words
from inhalemon.rules.model import Evidence, Rule

TARGET = Path(__file__).with_name("rules.md")

HEAD = """\
<!-- Written by docs/make_rules.py from inhalemon/data/rules; change those, not this. -->
# Rules

A rule says when a measure means a mistake, how grave that is, and where the number comes from. Rules are data: TOML
files in `inhalemon/data/rules`, read by one small engine that knows none of them. `inhalemon rules` lists them,
`inhalemon explain RULE` prints one, `inhalemon score --rules strict` or `--rules mine.toml` judges by others;
[extending.md](extending.md) says how to write one.

## The four verdicts

| verdict | meaning |
|---|---|
| `pass` | decided: not the mistake |
| `fail` | decided: the mistake was made; the severity is that of the gravest level that holds |
| `indeterminate` | the limit is nearer than the dead-band, or than 1.96 standard deviations of the measure |
| `not_assessable` | no measure, implied by another rule, or never seen by these sensors: `reason` says which |

Counts are compared at the half between two whole numbers: a count is undecided only by its own standard deviation.
Conditions joined by *and* and *or* follow Kleene's logic: a measure that is missing or too close to its limit matters
only where it could change the verdict. A rule may have several levels: it fails at
the gravest that surely holds, and passes only where surely none does.

A rule that another failed rule implies is `not_assessable` with `reason: implied_by:RULE`, so that one slip is counted
once. Nothing is passed in silence: what these sensors cannot see stands in every report.

## The score

Points are 100 less 40 for each critical, 15 for each major and 5 for each minor mistake, and never below 0. The grade
is the worst failed severity. When no critical rule failed and one could not be decided, the grade is `not_assessable`;
implied rules and those that can never be decided do not count. With several doses, the session's findings are the
worst verdict of each rule, from bad to good: `fail`, `indeterminate`, `not_assessable`, `pass`.

## Where the numbers come from

Each rule carries a grade of evidence. Severity is a profile, not a truth: a review of 114 papers found 299 descriptions
of "critical error" and no consensus (Usmani 2018, Respir Res 19:10).

"""


def rules_page() -> str:
    """The whole page as Markdown."""
    default, strict = load_rules("default"), load_rules("strict")
    grades = "".join(f"- **{evidence}**: {evidence.meaning}\n" for evidence in Evidence)
    decided = [rule for rule in default.rules if rule.never_decided is None]
    never = [rule for rule in default.rules if rule.never_decided is not None]
    parts = [HEAD, grades, "\n## The rules\n"]
    parts += [_section(rule, strict) for rule in decided]
    parts.append("\n## Never decided\n\n| rule | devices | why |\n|---|---|---|\n")
    parts += [f"| `{rule.id}` | {devices_in_words(rule)} | {rule.never_decided} |\n" for rule in never]
    return "".join(parts)


def _section(rule: Rule, strict: RuleSet) -> str:
    lines = [f"\n### `{rule.id}`: {rule.title}\n", f"\n{devices_in_words(rule)}. Fails when:\n\n"]
    lines += [f"- **{severity}**: {_code(words)}\n" for severity, words in levels_in_words(rule)]
    other = next(other for other in strict.rules if other.id == rule.id)
    if other.levels != rule.levels:
        lines.append("\nIn the strict profile:\n\n")
        lines += [f"- **{severity}**: {_code(words)}\n" for severity, words in levels_in_words(other)]
    lines += [f"\n{note}\n" for note in notes_in_words(rule)]
    lines.append(f"\nEvidence {rule.evidence}. {rule.source}\n")
    return "".join(lines)


def _code(words: str) -> str:
    return f"`{words}`"


if __name__ == "__main__":
    TARGET.write_text(rules_page(), encoding="utf-8")
