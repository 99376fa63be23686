"""Whether a patient_ref is a pseudonym. A service that never learns names cannot lose them.

The check is a safety net for slips, not a proof: it lets through what could be a code and holds up what reads as a name
or a birth date. An operator who means it sets `INHALEMON_ALLOW_NAMES`.
"""

from __future__ import annotations

import re

from api.problems import InvalidError

MAX_LENGTH = 64
_PERSONAL_YEARS = r"(?:18|19|20)\d\d"
_DATE = re.compile(
    rf"(?<!\d)(?:{_PERSONAL_YEARS}(?P<a>[-./ ]?)(?:0?[1-9]|1[0-2])(?P=a)(?:0?[1-9]|[12]\d|3[01])"
    rf"|(?:0?[1-9]|[12]\d|3[01])(?P<b>[-./ ]?)(?:0?[1-9]|1[0-2])(?P=b){_PERSONAL_YEARS}"
    rf"|(?:0?[1-9]|1[0-2])(?P<c>[-./ ])(?:0?[1-9]|[12]\d|3[01])(?P=c){_PERSONAL_YEARS})(?!\d)"
)
_UUID = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", re.IGNORECASE)
_CODE_WORD = re.compile(
    "anon(ymous)?|arm|case|child|client|clinic|code|cohort|control|demo|group|id|no|nr|part(icipant)?|pat(ient)?|person|"
    "pid|prob(and)?|pseudonym|pt|ref|sample|site|study|subj?(ect)?|test|trial|user|visit",
    re.IGNORECASE,
)


def checked(patient_ref: str, *, allow_names: bool) -> str:
    """The reference, trimmed. Raises `InvalidError` when it is no code or looks like a name or a birth date."""
    ref = patient_ref.strip()
    if not ref or len(ref) > MAX_LENGTH or not ref.isprintable():
        raise InvalidError(
            f"patient_ref has {len(ref)} characters; 1 to {MAX_LENGTH} printable ones are wanted.", column="patient_ref"
        )
    if allow_names or _UUID.fullmatch(ref):
        return ref
    what = "a birth date" if _DATE.search(ref) else "a name" if _reads_as_name(ref) else None
    if what is not None:
        raise InvalidError(
            f"patient_ref looks like {what}. Send a pseudonym, such as P-0042; the list of who is who stays with you.",
            column="patient_ref",
            code="patient_ref_not_pseudonymous",
        )
    return ref


def _reads_as_name(ref: str) -> bool:
    if any(character.isspace() or character == "," for character in ref):
        return True
    if not ref.isascii():
        return any(character.isalpha() for character in ref)
    words = [word for word in re.split(r"[^A-Za-z]+", ref) if len(word) > 1 and not _CODE_WORD.fullmatch(word)]
    is_with_digits = any(character.isdigit() for character in ref)
    has_name_case = any(re.fullmatch(r"[A-Z]?[a-z]{2,}", word) for word in words)
    if not is_with_digits:
        return has_name_case or any(len(word) > 4 for word in words)  # ABC and AB-CD are codes, SMITH is none
    spelled = [word for word in words if len(word) > 2 and re.fullmatch(r"[A-Z]?[a-z]+", word)]
    return len(spelled) > 1
