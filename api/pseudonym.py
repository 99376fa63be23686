"""Whether a reference is a pseudonym. A service that never learns names cannot lose them.

The check is a safety net for slips, not a proof. What it holds up, and lets through, is told in docs/security.md; an
operator adds a study's own words with `INHALEMON_CODE_WORDS`, or turns the check off with `INHALEMON_ALLOW_NAMES`.
"""

from __future__ import annotations

import itertools
import re
from datetime import timedelta

from api.moments import now_us, to_datetime
from api.problems import InvalidError
from api.settings import ServiceSettings

_MAX_LENGTH = {"patient_ref": 64, "session_id": 200}
_YEAR = r"(?:18|19|20)\d\d"
_YEAR_2 = r"\d\d"
_MONTH, _DAY = r"(?:0?[1-9]|1[0-2])", r"(?:0?[1-9]|[12]\d|3[01])"
_MONTH_2, _DAY_2 = r"(?:0[1-9]|1[0-2])", r"(?:0[1-9]|[12]\d|3[01])"
_BIRTH_DATE = re.compile(
    "|".join(
        (
            # A year of four digits, in any usual order.
            rf"(?<!\d){_YEAR}(?P<a>[-._/ ]){_MONTH}(?P=a){_DAY}(?!\d)",
            rf"(?<!\d){_DAY}(?P<b>[-._/ ]){_MONTH}(?P=b){_YEAR}(?!\d)",
            rf"(?<!\d){_MONTH}(?P<c>[-._/ ]){_DAY}(?P=c){_YEAR}(?!\d)",
            rf"(?<!\d)(?:{_YEAR}{_MONTH_2}{_DAY_2}|{_DAY_2}{_MONTH_2}{_YEAR})(?!\d)",
            # Of two: with dots or slashes, or with hyphens between pairs (1-2-34 may be site, arm and number).
            rf"(?<!\d){_DAY}(?P<d>[./]){_MONTH}(?P=d){_YEAR_2}(?!\d)",
            rf"(?<!\d){_MONTH}(?P<e>[./]){_DAY}(?P=e){_YEAR_2}(?!\d)",
            rf"(?<!\d){_YEAR_2}(?P<f>[./]){_MONTH}(?P=f){_DAY}(?!\d)",
            rf"(?<!\d)(?:{_DAY_2}-{_MONTH_2}|{_MONTH_2}-{_DAY_2})-{_YEAR_2}(?!\d)",
            rf"(?<!\d){_YEAR_2}-{_MONTH_2}-{_DAY_2}(?!\d)",
            # Six digits alone, or after an era's letter; A-100245 may be a counter, and so may 000123.
            rf"^[MTSHR]?(?!00)(?:{_YEAR_2}{_MONTH_2}{_DAY_2}|{_DAY_2}{_MONTH_2}{_YEAR_2})$",
            # Years of a Japanese era: S60.3.12.
            rf"(?<![A-Za-z])[MTSHR]\d{{1,2}}(?P<g>[./]){_MONTH}(?P=g){_DAY}(?!\d)",
        )
    )
)
_NATIONAL_ID = re.compile(
    "|".join(
        (
            # A birth date and a serial number: 850312-1234, 131052-308T, 19850312-1234; without a sign nothing else.
            rf"(?<!\d)(?:{_YEAR_2}{_MONTH_2}{_DAY_2}|{_DAY_2}{_MONTH_2}{_YEAR_2})[-+/A]\d{{3,7}}[A-Z]?(?![\dA-Z])",
            rf"(?<!\d){_YEAR}{_MONTH_2}{_DAY_2}[-+/]?\d{{3,5}}(?!\d)",
            rf"^(?:{_YEAR_2}{_MONTH_2}{_DAY_2}|{_DAY_2}{_MONTH_2}{_YEAR_2})(?:\d{{4,5}}|\d{{7}})$",
            rf"(?<!\d)\d{{6}}{_YEAR}{_MONTH_2}{_DAY_2}\d{{3}}[\dX](?!\d)",
            r"(?<!\d)\d{3}-\d\d-\d{4}(?!\d)",
            r"(?<!\d)\d{4}([- ])\d{4}\1\d{4}(?!\d)",
            r"(?<!\d)\d{3}\.\d{3}\.\d{3}-\d\d(?!\d)",
            r"^[A-Z]{2} ?\d\d ?\d\d ?\d\d ?[A-D]$",
            r"^[A-Z]{6}\d\d[A-Z]\d\d[A-Z]\d{3}[A-Z]$",
        )
    ),
    re.IGNORECASE,
)
_UUID = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", re.IGNORECASE)
_CODE_WORD = re.compile(
    "anon(ymous)?|arm|case|child|client|clinic|code|cohort|control|demo|group|id|no|nr|part(icipant)?|pat(ient)?|person|"
    "pid|prob(and)?|pseudonym|pt|ref|sample|simulated|site|sub|subj(ect)?|study|test|trial|user|"
    "asthma|copd|device|ellipta|hinge|inhaler?|mdi|pmdi|sensor|"
    "after|am|baseline|before|day|evening|final|first|followup|home|last|month|morning|night|noon|pilot|pm|post|pre|"
    "rec(ording)?|repeat|run|second|session|take|third|training|try|two|visit|week|"
    "breath|closed|correct|cover|doses?|early|exhale|half|hold|inverted|late|long|not|open(ed)?|press(ed)?|shaken?|"
    "short|tilted|trembling|twice",
    re.IGNORECASE,
)
_WORD = re.compile("[A-Z]+(?![a-z])|[A-Z]?[a-z]+")  # JohnSmith is two
_DAY_FORMS = ("%Y-%m-%d", "%Y_%m_%d", "%Y%m%d", "%y%m%d")


def checked(given: str, settings: ServiceSettings, *, field: str = "patient_ref", day_us: int | None = None) -> str:
    """The reference, trimmed. Raises `InvalidError` when it is no code, or looks like a name, a birth date or the
    number of a person. The day of `day_us`, by which a session may be called, is taken for no birth date.
    """
    ref = given.strip()
    if not ref or len(ref) > _MAX_LENGTH[field] or not ref.isprintable():
        raise InvalidError(
            f"{field} has {len(ref)} characters; 1 to {_MAX_LENGTH[field]} printable ones are wanted.", column=field
        )
    if ref in {".", ".."} or "/" in ref or "\\" in ref:  # it stands in addresses
        raise InvalidError(f"{field} has a slash, or is dots alone; take letters, digits and -.", column=field)
    if settings.allow_names or _UUID.fullmatch(ref):
        return ref
    what = _told_by(ref if day_us is None else _without_day(ref, day_us), frozenset(settings.code_words))
    if what is not None:
        raise InvalidError(
            f"{field} looks like {what}. Send a pseudonym, such as P-0042; the list of who is who stays with you.",
            column=field,
            code=f"{field}_not_pseudonymous",
        )
    return ref


def checked_session_id(given: str, settings: ServiceSettings, recorded_at_us: int | None) -> str:
    """The same of a recording's own name, which may hold the day of the recording (by default today)."""
    return checked(given, settings, field="session_id", day_us=now_us() if recorded_at_us is None else recorded_at_us)


def _without_day(ref: str, day_us: int) -> str:
    for days, form in itertools.product((-1, 0, 1), _DAY_FORMS):  # it is another day elsewhere
        ref = ref.replace((to_datetime(day_us) + timedelta(days)).strftime(form), "-")
    return ref


def _told_by(ref: str, code_words: frozenset[str]) -> str | None:
    """What the reference seems to tell of a person, in words."""
    if _BIRTH_DATE.search(ref):
        return "a birth date"
    if _NATIONAL_ID.search(ref):
        return "the number of a person"
    if _reads_as_name(ref, code_words):
        return "a name (a study's own words can be allowed with INHALEMON_CODE_WORDS)"
    return None


def _reads_as_name(given: str, code_words: frozenset[str]) -> bool:
    if not given.isascii():
        return any(character.isalpha() for character in given)
    ref = _WORD.sub(
        lambda found: "" if _CODE_WORD.fullmatch(found[0]) or found[0].lower() in code_words else found[0], given
    )
    words = re.findall("[A-Za-z]{2,}", ref)
    if re.search(r"[\s,]", ref):
        return bool(words)
    if not any(character.isdigit() for character in ref):  # ABC and AB-CD are codes, SMITH is none
        return any(len(word) > 4 or re.fullmatch("[A-Z]?[a-z]+", word) for word in words)
    spelled = re.findall(r"(?<!\w)[A-Z]?[a-z]{2,}(?!\w)", ref)
    return len(spelled) > 1 or any(_is_like_smith42(part) for part in re.findall("[A-Za-z0-9]+", ref))


def _is_like_smith42(part: str) -> bool:
    """Whether it is a word that can be spoken, alone or with digits at one end.

    Letters and digits that alternate more often were made by a machine.
    """
    run = part.strip("0123456789")
    is_between = part[0].isdigit() and part[-1].isdigit()
    return run.isalpha() and not is_between and any(_can_be_spoken(word) for word in _WORD.findall(run))


def _can_be_spoken(word: str) -> bool:
    n_syllables = len(re.findall("[aeiouy]+", word.lower()))
    is_short_code = len(word) < 4 or (len(word) == 4 and word.isupper() and n_syllables < 2)  # ABCD, not SATO
    is_noise = n_syllables == 0 or re.search("[^aeiouy]{5}", word.lower()) or re.fullmatch("[a-f]+", word.lower())
    return not is_short_code and not is_noise
