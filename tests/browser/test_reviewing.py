"""What a reviewer sees and may lose at the pages, in a real browser against the real service."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.sync_api import expect

from api.principal import Role

_NUMBERS = itertools.count(1)
SHORT_OF_LIPS = "The lips were not closed."


@pytest.fixture
def clinic(site: Any) -> str:
    """A clinic of one test, with two clinicians named after it."""
    slug = f"review-{next(_NUMBERS)}"
    for name in ("doc", "other"):
        site.add_user(f"{name}-{slug}", Role.CLINICIAN, slug)
    return slug


def test_what_was_typed_stays_while_another_finding_is_confirmed(
    visit: Any, site: Any, clinic: str, recordings: Callable[..., Path]
) -> None:
    session = site.upload(clinic, recordings("S-201", ("press_late",), seed=201))
    visitor = visit()
    page = visitor.page
    visitor.log_in(f"doc-{clinic}")
    visitor.go(f"/sessions/{session}")
    lips = page.locator('.finding[data-rule="lip_seal"]')
    lips.locator(".head button").click()
    lips.locator("summary").click()
    lips.get_by_label("Reason").fill(SHORT_OF_LIPS)
    page.get_by_text("Comment", exact=True).first.click()
    page.locator("#add-comment textarea").fill("Half a thought")
    page.locator('.finding[data-rule="press_late"] [data-act=c]').click()
    expect(page.get_by_text(f"Confirmed by doc-{clinic}")).to_be_visible()
    expect(lips.locator("textarea")).to_have_value(SHORT_OF_LIPS)
    expect(page.locator("#add-comment textarea")).to_have_value("Half a thought")
    lips.locator("details.override button").click()
    expect(lips.get_by_text(SHORT_OF_LIPS)).to_be_visible()
    expect(page.locator("#add-comment textarea")).to_have_value("Half a thought")
    page.locator("#add-comment button").click()
    expect(page.locator(".history").get_by_text("Half a thought")).to_be_visible()
    expect(page.locator("#add-comment textarea")).to_have_value("", timeout=2000)


def test_result_at_the_top_follows_the_review(
    visit: Any, site: Any, clinic: str, recordings: Callable[..., Path]
) -> None:
    session = site.upload(clinic, recordings("S-202", ("press_late",), seed=202))
    visitor = visit()
    page = visitor.page
    visitor.log_in(f"doc-{clinic}")
    visitor.go(f"/sessions/{session}")
    result = page.locator("#result")
    said = result.locator(".grade").inner_text()
    for rule in [each.get_attribute("data-rule") for each in page.locator(".finding.fail").all()]:
        finding = page.locator(f'.finding[data-rule="{rule}"]')
        finding.locator("summary").click()
        finding.get_by_label("Verdict").select_option("pass")
        finding.get_by_label("Reason").fill("A spacer was used.")
        finding.get_by_role("button", name="Override").click()
        expect(finding.get_by_text("A spacer was used.")).to_be_visible()
    expect(result.locator(".grade")).to_have_text("correct")
    expect(result).to_contain_text(f"the machine: {said}")
    visitor.go("/sessions")
    expect(page.locator("td .grade")).to_have_text("correct")


def test_second_reviewer_can_sign_too_and_a_later_entry_opens_the_session_again(
    visit: Any, site: Any, clinic: str, recordings: Callable[..., Path]
) -> None:
    session = site.upload(clinic, recordings("S-203", ("press_late",), seed=203))
    one, other = visit(), visit()
    for visitor, name in ((one, "doc"), (other, "other")):
        visitor.log_in(f"{name}-{clinic}")
        visitor.go(f"/sessions/{session}")
        visitor.page.get_by_role("button", name="Sign off").click()
        expect(visitor.page.get_by_text(f"Signed off by {name}-{clinic}")).to_be_visible()
    expect(other.page.get_by_text(f"Signed off by doc-{clinic}")).to_be_visible()
    other.page.locator('.finding[data-rule="press_late"] [data-act=c]').click()
    expect(other.page.get_by_text("It was signed off before")).to_be_visible()
    expect(other.page.get_by_role("button", name="Sign off")).to_be_visible()


def test_who_is_logged_out_is_told_so_and_led_back(
    visit: Any, site: Any, clinic: str, recordings: Callable[..., Path]
) -> None:
    session = site.upload(clinic, recordings("S-204", ("press_late",), seed=204))
    visitor = visit()
    page = visitor.page
    visitor.log_in(f"doc-{clinic}")
    visitor.go(f"/sessions/{session}?dose=1")
    visitor.go(f"/sessions/{session}")
    visitor.context.clear_cookies()
    page.keyboard.press("s")
    expect(page.locator("#notice")).to_contain_text("Your login has run out; nothing was saved.")
    expect(page.locator("#notice")).not_to_contain_text("Bearer")
    visitor.wrong.clear()  # htmx tells the console of the refusal too
    page.get_by_role("link", name="Log in again").click()
    page.fill("input[name=name]", f"doc-{clinic}")
    page.fill("input[name=password]", "correct-horse-7")
    page.click("form.fields button")
    page.wait_for_url(re.compile(f"/sessions/{session}"))


def test_two_doses_are_shown_together_and_one_by_one(
    visit: Any, site: Any, clinic: str, recordings: Callable[..., Path]
) -> None:
    session = site.upload(clinic, recordings("S-205", ("press_late",), seed=205, n_doses=2))
    key = {"authorization": f"Bearer {site.key(Role.CLINICIAN, clinic)}"}
    report = httpx.get(f"{site.url}/v1/sessions/{session}/report", headers=key).json()
    assert len(report["doses"]) == 2
    visitor = visit()
    page = visitor.page
    visitor.log_in(f"doc-{clinic}")
    visitor.go(f"/sessions/{session}")
    for number, dose in enumerate(report["doses"], start=1):
        page.get_by_role("navigation", name="Doses").get_by_role("link", name=f"Dose {number}").click()
        page.wait_for_url(re.compile(f"dose={number}"))
        visitor.see_curves()
        start, end = map(float, (page.get_attribute("#curves", "data-view") or "").split())
        assert start == pytest.approx(dose["start_s"], abs=0.1)
        assert end == pytest.approx(dose["end_s"], abs=0.1)
        shown = page.locator('table.measures tr:has(code:text-is("inhalation_s"))').locator("td").first.inner_text()
        assert shown == f"{dose['measures']['inhalation_s']['value']:.2f} s"
        expect(page.locator("[data-act=c]")).to_have_count(0)


def test_a_finding_without_a_place_says_so(visit: Any, site: Any, clinic: str, recordings: Callable[..., Path]) -> None:
    session = site.upload(clinic, recordings("S-206", ("press_late",), seed=206))
    visitor = visit()
    page = visitor.page
    visitor.log_in(f"doc-{clinic}")
    visitor.go(f"/sessions/{session}")
    visitor.see_curves()
    page.locator('.finding[data-rule="lip_seal"] .head button').click()
    expect(page.locator("#moment")).to_have_text("This finding belongs to no one place in the curves.")


@pytest.mark.parametrize("width", [390, 1366])
def test_axes_have_numbers_and_names_of_phases_are_whole_or_left_out(
    visit: Any, site: Any, clinic: str, recordings: Callable[..., Path], width: int
) -> None:
    session = site.upload(clinic, recordings(f"S-{width}", ("press_late",), seed=207 + width))
    visitor = visit(viewport={"width": width, "height": 800})
    page = visitor.page
    visitor.log_in(f"doc-{clinic}")
    visitor.go(f"/sessions/{session}")
    visitor.see_curves()
    cut = page.evaluate("""() => [...document.querySelectorAll(".strip .phase:not(.unnamed)")]
        .filter((each) => !each.hidden && each.scrollWidth > each.clientWidth + 1).map((each) => each.textContent)""")
    assert cut == []
    named = page.locator(".phases-legend li").all_inner_texts()
    assert "inhale" in named


def test_lists_are_narrowed_by_days_of_the_reader_and_parts_of_a_name(
    visit: Any, site: Any, clinic: str, recordings: Callable[..., Path]
) -> None:
    """In Tokyo the evening of the 20th in UTC is the morning of the 21st."""
    late = recordings("S-208", ("press_late",), seed=208)
    site.upload(clinic, late, session_id="S-208", patient_ref="P-0042", recorded_at="2026-11-20T22:00:00Z")
    fine = recordings("S-209", seed=209)
    site.upload(clinic, fine, session_id="S-209", patient_ref="P-0137", recorded_at="2026-11-20T08:00:00Z")
    visitor = visit(timezone_id="Asia/Tokyo", locale="en-GB")
    page = visitor.page
    visitor.log_in(f"doc-{clinic}")
    names = page.locator("tbody th a")
    for fields, left in (
        ({"since": "2026-11-21"}, ["S-208"]),
        ({"until": "2026-11-20"}, ["S-209"]),
        ({"since": "2026-11-20", "until": "2026-11-21"}, ["S-208", "S-209"]),
        ({"patient_part": "p-00"}, ["S-208"]),
        ({"patient_part": "137"}, ["S-209"]),
    ):
        visitor.go("/sessions")
        for name, value in fields.items():
            page.fill(f"[name={name}]", value)
        page.get_by_role("button", name="Show", exact=True).click()
        page.wait_for_load_state()
        expect(names).to_have_text(left)
        for name, value in fields.items():
            expect(page.locator(f"[name={name}]")).to_have_value(value)
    visitor.go("/sessions?rule=press_late")
    expect(names).to_have_text(["S-208"])
    expect(page.locator("[name=verdict]")).to_have_value("fail")
    expect(page.locator("td time").first).to_have_text("21 Nov 2026, 07:00")
    page.set_viewport_size({"width": 390, "height": 800})
    visitor.go("/sessions")
    expect(page.locator("[name=device]")).not_to_be_visible()
    page.get_by_text("Filters", exact=True).click()
    expect(page.locator("[name=device]")).to_be_visible()
