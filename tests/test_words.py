"""One number is told by the same digits wherever it stands."""

from __future__ import annotations

import orjson
import pytest
from hypothesis import given
from hypothesis import strategies as st

from inhalemon.words import brief, in_words, number


@given(st.floats(-1e4, 1e4), st.sampled_from(["s", "deg", "count", None]))
def test_a_value_and_its_document_and_its_sentence_agree(value, unit):
    """2.085000000000001 was 2.09 s in a message and, read back as 2.085, 2.08 s in the table."""
    read_back = orjson.loads(orjson.dumps(round(value, 6)))
    assert number(value, unit) == number(read_back, unit)
    told, sentence = (each.strip("° s") for each in (number(value, unit), brief(value, unit)))
    assert float(told) == float(sentence)


@pytest.mark.parametrize(
    ("value", "unit", "told", "sentence"),
    [
        (2.085000000000001, "s", "2.08 s", "2.08 s"),
        (2.0, "s", "2.00 s", "2 s"),
        (12.5, "s", "12.50 s", "12.5 s"),
        (-0.0000001, "s", "0.00 s", "0 s"),
        (30.0, "deg", "30.0°", "30°"),
        (3.0, "count", "3", "3"),
        (20.0, "count", "20", "20"),
    ],
)
def test_a_sentence_leaves_out_the_zeros_at_the_end(value, unit, told, sentence):
    assert (number(value, unit), brief(value, unit)) == (told, sentence)


def test_names_lose_their_underscores():
    assert in_words("implied_by:no_press") == "implied by: no press"
    assert number(None, "s") == "–"
