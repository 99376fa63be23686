"""What is taken for a pseudonym, and what is held up: the table of docs/security.md."""

from __future__ import annotations

import pytest

from api.moments import DAY_US, now_us, to_iso
from api.problems import InvalidError
from api.pseudonym import checked, checked_session_id
from api.settings import load


def each(text):
    return text.split()


NAMES = each("smith-john Tanaka smith42 TANAKA1 JohnSmith1 hanako1970 42smith P-smith-7 SATO1 joe-lee-42")
DATES = each("1980-05-12 1980_5_12 P-19800512 12.05.1980 850312 S600312 12.03.85 85.3.12 85-03-12 S60.3.12 H5.3.1")
NUMBERS = each(
    "850312-1234 131052-308T 8503121234 19850312-1234 110101198503121234 123-45-6789 1234-5678-9012 123.456.789-09 "
    "AB123456C RSSMRA85M01H501Z"
)
PSEUDONYMS = each(
    "P-0042 KX7-113 patient-7 demo AB12 0815 p-0042 P_0042 C-2026-017 NHS-0001 LEE-4 ABCD-17 COPD-12 site12-sub007 "
    "101-002-0042 1-2-34 S1-2-34 12345678 P-000123 A-100245 K7Q2M9 abc1def2 deadbeef42 3f9a1c77b2e84d10 "
    "01ARZ3NDEKTSV4RRFFQ69G5FAV V1StGXR8_Z5jdHi6B-myT 8f14e45f-ceea-467f-a8ad-0242ac120002 simulated-01"
)
SESSIONS = each("pmdi_press_late ellipta_short_breath_not_closed pmdi-00001 visit-12-a session_12 morning Visit:2")


@pytest.mark.parametrize("ref", [*NAMES, "John Smith", "Smith, J", "山田太郎", "田中-1", *DATES, *NUMBERS])
def test_what_tells_who_somebody_is_is_held_up(ref):
    with pytest.raises(InvalidError) as caught:
        checked(ref, load())
    assert caught.value.extra["code"] == "patient_ref_not_pseudonymous"
    assert checked(ref, load(allow_names=True)) == ref


@pytest.mark.parametrize("ref", PSEUDONYMS)
def test_a_pseudonym_is_accepted(ref):
    assert checked(f" {ref} ", load()) == ref


def test_no_counter_with_its_zeros_is_held_up():
    for n in range(10_000):
        for ref in (f"P-{n:04d}", f"P{n:05d}", f"{n:06d}", f"KX7-{n:03d}", f"P-{n + 100_000}"):
            assert checked(ref, load()) == ref


@pytest.mark.parametrize("ref", SESSIONS)
def test_a_recordings_own_name_is_accepted(ref):
    assert checked_session_id(ref, load(), None) == ref


def test_a_recordings_own_name_may_hold_its_day_and_no_other():
    recorded_at_us = now_us() - 400 * DAY_US
    day = to_iso(recorded_at_us)[:10]
    assert checked_session_id(f"{day}-am", load(), recorded_at_us) == f"{day}-am"
    with pytest.raises(InvalidError):
        checked_session_id(f"{day}-am", load(), None)


def test_a_studys_own_words_can_be_allowed(monkeypatch):
    with pytest.raises(InvalidError):
        checked("TOKYO-12", load())
    monkeypatch.setenv("INHALEMON_CODE_WORDS", "tokyo, osaka")
    assert checked("TOKYO-12", load()) == "TOKYO-12"
