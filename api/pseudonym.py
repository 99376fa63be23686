"""Whether a patient_ref is a pseudonym. A service that never learns names cannot lose them.

The check is a safety net for slips, not a proof: it holds up what reads as a name, a birth date or the number of a
person, and must let through what studies call their participants. An operator who means it sets
`INHALEMON_ALLOW_NAMES`.
"""

from __future__ import annotations

import re

from api.problems import InvalidError
from api.settings import ServiceSettings

_MAX_LENGTH = 64
_YEAR = r"(?:18|19|20)\d\d"
_MONTH, _DAY = r"(?:0?[1-9]|1[0-2])", r"(?:0?[1-9]|[12]\d|3[01])"
_YEAR_2, _MONTH_2, _DAY_2 = r"\d\d", r"(?:0[1-9]|1[0-2])", r"(?:0[1-9]|[12]\d|3[01])"
_BIRTH_DATE = re.compile(
    "|".join(
        (
            # A year of four digits, in any usual order.
            rf"(?<!\d){_YEAR}(?P<a>[-._/ ]){_MONTH}(?P=a){_DAY}(?!\d)",
            rf"(?<!\d)(?:{_DAY}(?P<b>[-._/ ]){_MONTH}|{_MONTH}(?P<c>[-._/ ]){_DAY})[-._/ ]{_YEAR}(?!\d)",
            rf"(?<!\d)(?:{_YEAR}{_MONTH_2}{_DAY_2}|{_DAY_2}{_MONTH_2}{_YEAR})(?!\d)",
            # Of two, between dots, or of a Japanese era: 12.03.85, S60.3.12. Hyphens part site, arm and number, too.
            rf"(?<!\d){_DAY}\.{_MONTH}\.{_YEAR_2}(?!\d)",
            rf"(?<![A-Za-z])[MTSHR]?(?<!\d){_YEAR_2}\.{_MONTH}\.{_DAY}(?!\d)",
        )
    )
)
_NATIONAL_ID = re.compile(
    "|".join(
        (
            # A birth date and a serial number: 850312-1234, 131052-308T, 110101198503121234.
            rf"(?<!\d)(?:{_YEAR_2}{_MONTH_2}{_DAY_2}|{_DAY_2}{_MONTH_2}{_YEAR_2})[-+]\d{{3,4}}[A-Z]?(?![\dA-Za-z])",
            rf"(?<!\d)\d{{6}}{_YEAR}{_MONTH_2}{_DAY_2}\d{{3}}[\dX](?!\d)",
            r"^\d{3}-\d\d-\d{4}$",
            r"^\d{3}\.\d{3}\.\d{3}-\d\d$",
        )
    )
)
_UUID = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", re.IGNORECASE)
_CODE_WORD = re.compile(
    "anon(ymous)?|arm|asthma|case|child|client|clinic|code|cohort|control|copd|demo|group|id|no|nr|part(icipant)?|"
    "pat(ient)?|person|pid|prob(and)?|pseudonym|pt|ref|sample|simulated|site|study|subj?(ect)?|test|trial|user|visit",
    re.IGNORECASE,
)


def checked(given: str, settings: ServiceSettings) -> str:
    """The reference, trimmed. Raises `InvalidError` when it is no code, or looks like a name, a birth date or the
    number of a person.
    """
    ref = given.strip()
    if not ref or len(ref) > _MAX_LENGTH or not ref.isprintable():
        raise InvalidError(
            f"patient_ref has {len(ref)} characters; 1 to {_MAX_LENGTH} printable ones are wanted.",
            column="patient_ref",
        )
    if ref in {".", ".."} or "/" in ref or "\\" in ref:  # it stands in addresses
        raise InvalidError(
            "patient_ref has a slash, or is dots alone; take letters, digits and -.", column="patient_ref"
        )
    if settings.allow_names or _UUID.fullmatch(ref):
        return ref
    what = _told_by(ref)
    if what is not None:
        raise InvalidError(
            f"patient_ref looks like {what}. Send a pseudonym, such as P-0042; the list of who is who stays with you.",
            column="patient_ref",
            code="patient_ref_not_pseudonymous",
        )
    return ref


def _told_by(ref: str) -> str | None:
    """What the reference seems to tell of a person, in words."""
    if _BIRTH_DATE.search(ref):
        return "a birth date"
    if _NATIONAL_ID.search(ref):
        return "the number of a person"
    return "a name" if _reads_as_name(ref) else None


def _reads_as_name(ref: str) -> bool:
    if any(character.isspace() or character == "," for character in ref):
        return True
    if not ref.isascii():
        return any(character.isalpha() for character in ref)
    parts = [part for part in re.findall("[A-Za-z0-9]+", ref) if not _CODE_WORD.fullmatch(part.rstrip("0123456789"))]
    words = [part for part in parts if part.isalpha() and len(part) > 1]
    if not any(character.isdigit() for character in ref):  # ABC and AB-CD are codes, SMITH is none
        return any(len(word) > 4 or _is_spelled(word) for word in words)
    # Letters and digits that alternate were made by a machine; digits stuck to a word that can be spoken were not.
    stuck = [found[1] for part in parts if (found := re.fullmatch(r"([A-Z]?[a-z]{4,})\d{1,4}", part))]
    return sum(_is_spelled(word) for word in words) > 1 or any(_can_be_spoken(word) for word in stuck)


def _is_spelled(word: str) -> bool:
    return re.fullmatch(r"[A-Z]?[a-z]{2,}", word) is not None


def _can_be_spoken(word: str) -> bool:
    return not re.search("^[a-f]*$|^[^aeiouy]*$|[^aeiouy]{4}|[aeiouy]{4}", word, re.IGNORECASE)
