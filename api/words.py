"""What pages say, in the reader's language.

English texts stand in the templates themselves. `locale/LANGUAGE.json` has, for each language, `texts` (an English text
and its translation), `names` (of phases, rules, verdicts and the like, by kind) and `findings` (a sentence for a rule's
verdict, with `{value}` and `{limit}`). What a catalogue lacks is said in English.
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypedDict

import orjson

from inhalemon.values import Verdict
from inhalemon.words import brief, in_words, number

LANGUAGES: Final = {"en": "English", "ja": "日本語"}
_FOLDER: Final = Path(__file__).parent / "locale"
_NUMBER: Final = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?")
_SECONDS: Final = {"en": " s", "ja": " 秒"}


class Catalogue(TypedDict):
    texts: dict[str, str]
    names: dict[str, dict[str, str]]
    findings: dict[str, dict[str, str]]


@functools.cache
def catalogue(language: str) -> Catalogue:
    found: Catalogue = orjson.loads((_FOLDER / f"{language}.json").read_bytes())
    return found


@dataclass(frozen=True, slots=True)
class Words:
    """One language's words; called with an English text, it gives the translation."""

    language: str

    def __call__(self, text: str, **values: object) -> str:
        said = catalogue(self.language)["texts"].get(text, text)
        return said.format(**values) if values else said

    def name(self, kind: str, name: str, default: str | None = None) -> str:
        """What a thing with a fixed name is called: `name("phase", "to_mouth")`."""
        found = catalogue(self.language)["names"].get(kind, {}).get(name)
        return found if found is not None else (default or in_words(name))

    def names(self, kind: str) -> dict[str, str]:
        """Everything of one kind that has a name of its own."""
        return catalogue(self.language)["names"].get(kind, {})

    def quantity(self, value: float | None, unit: str | None) -> str:
        """A number with its unit, or a dash, as reports have it."""
        return self._localised(number(value, unit))

    def limit(self, value: float | None, unit: str | None) -> str:
        """A limit with its unit: a number that somebody wrote, so without the digits that a measurement has."""
        return self._localised(number(value, unit) if value is None else brief(value, unit))

    def _localised(self, text: str) -> str:
        seconds = _SECONDS[self.language]
        return (text.removesuffix(" s") + seconds if text.endswith(" s") else text).replace("-", "−")

    def flag(self, code: str, detail: str) -> str | None:
        """A flag's detail by its code, with the numbers of the report's own in their order; `None`: in English only."""
        said = self.names("flag_detail").get(code)
        numbers = _NUMBER.findall(detail)
        return None if said is None or said.count("{") != len(numbers) else said.format(*numbers).replace("-", "−")

    def reason(self, reason: str | None) -> str:
        """Why something could not be had; `implied_by:no_press` names the rule."""
        head, _, rest = (reason or "").partition(":")
        if head == "implied_by" and rest:
            return self("already told by “{rule}”", rule=self.name("rule", rest))
        said = self.name("reason", head, in_words(head))
        return f"{said}: {self.name('measure', rest)}" if rest else said

    def told(
        self,
        rule: str,
        verdict: str,
        *,
        value: float | None,
        limit: float | None,
        unit: str | None,
        reason: str | None,
        message: str,
    ) -> str:
        """The sentence of a finding; `message` is the report's own, in English."""
        if self.language == "en":
            return message
        sentences = catalogue(self.language)["findings"]
        said = sentences.get(rule, {}).get(verdict)
        if verdict == Verdict.INDETERMINATE and value is not None:
            said = said or sentences["*"].get("indeterminate")
        elif verdict in {Verdict.INDETERMINATE, Verdict.NOT_ASSESSABLE}:
            said = said or sentences["*"].get("not_assessable")
        if said is None:
            return message
        return said.format(value=self.quantity(value, unit), limit=self.limit(limit, unit), reason=self.reason(reason))


def preferred(cookie: str | None, accept_language: str) -> str:
    """The language chosen, or else the first one accepted that we have, or English."""
    if cookie in LANGUAGES:
        return cookie
    wanted: list[tuple[float, str]] = []
    for part in accept_language.split(",")[:20]:
        tag, _, quality = part.strip().partition(";q=")
        try:
            weight = float(quality) if quality else 1.0
        except ValueError:
            continue
        wanted.append((-weight, tag.split("-")[0].lower()))
    known = [tag for weight, tag in sorted(wanted, key=lambda each: each[0]) if tag in LANGUAGES and weight < 0]
    return known[0] if known else "en"
