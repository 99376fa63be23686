"""What is taken for a pseudonym, and what is held up: the table of docs/security.md."""

from __future__ import annotations

import random
import string

import pytest

from api.problems import InvalidError
from api.pseudonym import checked
from api.settings import load


def each(text):
    return text.split()


NAMES = each("smith-john Tanaka smith42 hanako1970 SMITH joe-lee-42")
DATES = each("1980-05-12 1980_5_12 P-19800512 12.05.1980 12.03.85 S60.3.12 H05.3.1")
NUMBERS = each("850312-1234 131052-308T 110101198503121234 123-45-6789 123.456.789-09")
PSEUDONYMS = each(
    "P-0042 KX7-113 patient-7 demo AB12 0815 p-0042 P_0042 C-2026-017 NHS-0001 LEE-4 ABCD-17 COPD-12 site12-sub007 "
    "101-002-0042 1-2-34 S1-2-34 12345678 P-000123 A-100245 850312 K7Q2M9 abc1def2 deadbeef42 3f9a1c77b2e84d10 "
    "TOKYO-12 01ARZ3NDEKTSV4RRFFQ69G5FAV V1StGXR8_Z5jdHi6B-myT 8f14e45f-ceea-467f-a8ad-0242ac120002 simulated-01"
)


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


@pytest.mark.parametrize("alphabet", [string.ascii_uppercase + string.digits, string.ascii_letters + string.digits])
def test_hardly_a_random_code_is_held_up(alphabet):
    """Of codes of eight characters with a digit: a word with digits stuck to it comes about by chance, once in 100."""
    rng = random.Random(1)
    codes = ["".join(rng.choices(alphabet, k=8)) for _ in range(5000)]
    held_up = sum(_is_held_up(code) for code in codes if any(character.isdigit() for character in code))
    assert held_up < 50


def _is_held_up(ref):
    try:
        checked(ref, load())
    except InvalidError:
        return True
    return False
