"""The page of one session: whole, offline, safe against what a file may be called, small enough to mail."""

from __future__ import annotations

import dataclasses
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from reports import made_dose, made_report

from inhalemon import rotation
from inhalemon.devices import load_device
from inhalemon.pipeline import estimate_tracks, report_of
from inhalemon.report.curves import N_BUCKETS, Curve, Panel, reduced, session_panels
from inhalemon.report.page import Review, ReviewEntry, session_page
from inhalemon.report.plot import nice_step
from inhalemon.settings import Settings
from inhalemon.simulate import simulate_session
from inhalemon.values import DeviceKind, Finding, Grade, Measure, Quality, Score, Verdict

VOID = {"meta", "path", "rect", "link", "br", "img", "input"}


class Page(HTMLParser):
    """Every tag, attribute and text of the page; fails when tags do not close in order."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1:] not in (["script"], ["style"]):
            self.text += data


def panels(duration_s=24.0, rate_hz=100.0):
    """Five panels of noise, nine curves, two with bands: what a session has."""
    time_s = np.arange(0.0, duration_s, 1.0 / rate_hz)
    rng = np.random.default_rng(0)

    def curves(*names, half_width=None):
        return tuple(Curve(name, time_s, rng.normal(0, 5, time_s.size), half_width) for name in names)

    width = np.full(time_s.size, 0.5)
    return (
        Panel("Tilt from upright", "°", curves("tilt", half_width=width)),
        Panel("Lever angle", "°", (*curves("angle", half_width=width), *curves("off the axis"))),
        Panel("Rate of the body", "°/s", curves("x (hinge)", "y", "z")),
        Panel("Specific force", "g", curves("body", "lever")),
        Panel("R of the adaptive filter", "m²/s²", curves("body", "lever"), is_log=True),
    )


@pytest.fixture(scope="module")
def page():
    return session_page(made_report(), panels())


def test_page_is_well_formed_and_tells_what_it_must(page):
    text = " ".join(Page(page).text.split())
    for words in (
        "Decision support for trained staff; not a medical device. It never tells a patient to change treatment.",
        "inferred from stillness",
        "major mistakes",
        "85 of 100 points",
        "The press came late: 1.4 s, where 0.9 s is the latest wanted.",
        "1.40 s limit 0.9 s",
        "Not assessed: inhalation end not seen.",
        "attitude and motion do not show how fast the air flows",
        "press 13°",
        "breath hold",
        "0.12 s without samples at 8.31 s",
        "Tilt from upright",
        "Lever angle",
        "Rate of the body",
        "Specific force",
        "R of the adaptive filter",
        "shake_duration_s",
    ):
        assert words in text


def test_page_asks_nothing_of_any_network(page):
    parsed = Page(page)
    assert not re.search(r"https?:|//[a-z0-9.-]+\.[a-z]{2,}|@import|url\(", page)
    assert not {"src", "href", "srcset", "action"} & {name for _, attributes in parsed.tags for name in attributes}
    policy = next(a["content"] for tag, a in parsed.tags if a.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'")


HOSTILE = [
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "</style></title><b>",
    "{{script}}",
    "&amp;",
    "'\"\x00é\u202e",
]


@pytest.mark.parametrize("name", HOSTILE)
def test_session_name_flag_and_message_cannot_become_markup(page, name):
    report = made_report(name)
    finding = Finding(name, Verdict.INDETERMINATE, None, 1.0, 2.0, "s", 0.0, 1.0, name, name)
    flags = tuple(dataclasses.replace(flag, code=name, detail=name) for flag in report.quality.flags)
    report = dataclasses.replace(
        report, findings=(finding,), quality=Quality(False, flags), measures={name: Measure(None, None, name)}
    )
    hostile = Page(session_page(report, [Panel(name, name, (Curve(name, np.arange(3.0), np.arange(3.0)),))]))
    assert {tag for tag, _ in hostile.tags} <= {tag for tag, _ in Page(page).tags}
    assert not any(attribute.startswith("on") for _, attributes in hostile.tags for attribute in attributes)
    assert sum(tag == "script" for tag, _ in hostile.tags) == 1


def test_page_of_a_minute_at_200_hz_stays_under_500_kb():
    assert len(session_page(made_report(), panels(60.0, 200.0)).encode()) < 500_000


def test_several_doses_are_shown_each_with_its_score():
    text = Page(
        session_page(made_report(doses=(made_dose(), made_dose(24.0, coordination_s=Measure(0.2))))),
    ).text
    assert "Dose 1" in text
    assert "Dose 2" in text
    assert text.count("of 100 points") == 3


def test_hinge_and_a_session_without_curves_have_a_page():
    report = dataclasses.replace(
        made_report(),
        device=DeviceKind.HINGE,
        phases=(),
        events=(),
        measures={},
        findings=(),
        doses=(),
        score=Score(100, made_report().score.grade),
    )
    text = Page(session_page(report)).text
    assert "This device has no rules." in text
    assert "No curves." in text


def test_finding_with_a_place_can_be_followed_into_the_curves(page):
    buttons = [attributes for tag, attributes in Page(page).tags if tag == "button" and "data-start" in attributes]
    assert ("11.400", "12.800") in {(button["data-start"], button["data-end"]) for button in buttons}


# ---------------------------------------------------------------------------------------------------------- curves


def test_reduction_keeps_every_peak_at_its_time():
    time_s = np.arange(0.0, 600.0, 0.01)
    value = np.zeros(time_s.size)
    value[[12_345, 40_000]] = 5.0, -7.0
    ((kept_s, kept),) = reduced(time_s, value)
    assert kept.size <= 2 * N_BUCKETS + 2
    assert kept_s[kept.argmax()] == time_s[12_345]
    assert kept_s[kept.argmin()] == time_s[40_000]
    assert (np.diff(kept_s) > 0).all()


def test_reduction_breaks_the_line_at_gaps_and_leaves_out_what_is_not_finite():
    time_s = np.concatenate([np.arange(0.0, 1.0, 0.01), np.arange(2.0, 3.0, 0.01)])
    value = np.sin(time_s)
    value[5] = np.nan
    first, second = reduced(time_s, value)
    assert first[0][-1] < 1.0
    assert second[0][0] == 2.0
    assert np.isfinite(first[1]).all()
    assert reduced(time_s, np.full(time_s.size, np.nan)) == []


def test_short_curve_is_kept_whole():
    time_s = np.arange(0.0, 3.0, 0.01)
    ((kept_s, kept),) = reduced(time_s, np.cos(time_s))
    np.testing.assert_array_equal(kept_s, time_s)
    np.testing.assert_array_equal(kept, np.cos(time_s))


def test_panels_of_a_session_hold_its_tracks_in_units_for_people():
    """A simulated session: the tilt is that of the true attitude, the angle that of the track, the force is 1 g."""
    recording, _ = simulate_session("ellipta", seed=3)
    tracks = estimate_tracks(recording)
    tilt, angle, rate, force, variance = session_panels(tracks, moving_part="cover")
    assert angle.title == "Cover angle"
    np.testing.assert_allclose(np.radians(angle.curves[0].value), tracks.angle.angle_rad)
    up_z = rotation.rotate(tracks.body.q, np.array([0.0, 0.0, 1.0]))[:, 2]
    np.testing.assert_allclose(np.cos(np.radians(tilt.curves[0].value)), up_z, atol=1e-9)
    assert np.median(force.curves[0].value) == pytest.approx(1.0, abs=0.05)
    assert [curve.name for curve in rate.curves] == ["x (hinge)", "y", "z"]
    assert variance.is_log
    assert len(session_page(made_report(), (tilt, angle, rate, force, variance)).encode()) < 500_000


@pytest.mark.parametrize(("step", "nice"), [(0.9, 1.0), (1.0, 1.0), (1.2, 2.0), (3.0, 5.0), (7.0, 10.0), (0.02, 0.02)])
def test_axis_steps_are_one_two_or_five(step, nice):
    assert nice_step(step) == pytest.approx(nice)


# --------------------------------------------------------------------------------------------------------- browser


@pytest.mark.browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_page_zooms_reads_and_fits_in_a_real_browser(page, tmp_path, chromium, scheme):
    """Debian's Chromium: a finding zooms to its place, keys and the button bring all back, nothing is logged."""
    file = tmp_path / "session.html"
    file.write_text(page, encoding="utf-8")
    told: list[str] = []
    with chromium.new_context(viewport={"width": 360, "height": 800}, color_scheme=scheme) as context:
        tab = context.new_page()
        tab.on("console", lambda message: told.append(message.text))
        tab.on("pageerror", lambda error: told.append(str(error)))
        tab.on("request", lambda request: told.append(request.url) if not request.url.startswith("file:") else None)
        tab.goto(file.as_uri())
        assert tab.evaluate("document.documentElement.scrollWidth") <= 360
        view = "document.querySelector('svg').viewBox.baseVal"
        whole = tab.evaluate(f"[{view}.x, {view}.width]")
        tab.click("button[data-start='11.400'][data-end='12.800']")
        zoomed = tab.evaluate(f"[{view}.x, {view}.width]")
        assert zoomed == pytest.approx([10.4, 3.4], abs=1e-3)
        assert tab.inner_text(".names output") != ""
        tab.click("#all")
        assert tab.evaluate(f"[{view}.x, {view}.width]") == pytest.approx(whole)
        tab.focus("#plots")
        tab.keyboard.press("+")
        assert tab.evaluate(f"{view}.width") == pytest.approx(whole[1] / 2)
        tab.keyboard.press("ArrowRight")
        tab.keyboard.press("0")
        assert tab.evaluate(f"{view}.width") == pytest.approx(whole[1])
    assert told == []


# ---------------------------------------------------------------------------------------------------------- review

TITLES = {"press_late": "Pressed too late", "not_shaken": "Not shaken"}


def test_mistakes_have_titles_and_what_is_in_order_is_told_by_what_was_seen():
    """`PASS not shaken` can be read as its opposite."""
    page = Page(session_page(made_report(), titles=TITLES))
    text = " ".join(page.text.split())
    assert "major Pressed too late" in text
    assert "in order Shaken" in text
    assert "not shaken" not in text
    assert "pass not" not in text.lower()


def test_page_tells_the_review_and_the_result_that_holds():
    report = made_report()
    entries = [
        ReviewEntry("kimura, clinician", "2026-11-22 06:30 UTC", "press_late", Verdict.PASS, "A <spacer> was used."),
        ReviewEntry("kimura, clinician", "2026-11-22 06:31 UTC", "not_shaken", Verdict.PASS),
        ReviewEntry("ito, pharmacist", "2026-11-22 06:32 UTC", reason="See again in March."),
    ]
    review = Review(Score(100, Grade.CORRECT), ["kimura, clinician, 2026-11-22 06:33 UTC"], entries)
    text = " ".join(Page(session_page(report, titles=TITLES, review=review)).text.split())
    for words in (
        "correct 100 of 100 points",
        "the machine: major mistakes, 85",
        "Signed off by kimura, clinician, 2026-11-22 06:33 UTC",
        "Pressed too late: in order (the machine: mistake): “A <spacer> was used.” kimura, clinician, 2026-11-22",
        "Not shaken: in order, confirmed kimura, clinician",
        "Comment: “See again in March.” ito, pharmacist",
    ):
        assert words in text, words


def test_page_of_a_report_that_nobody_signed_says_so():
    text = Page(session_page(made_report(), review=Review(made_report().score))).text
    assert "Not signed off." in text
    assert "the machine" not in text


def test_a_clock_that_counts_from_1970_is_drawn_and_read_from_the_start():
    """Browsers draw in single precision, in which such times are two minutes apart; nobody reads ten digits a tick."""
    recording, _ = simulate_session("pmdi", seed=1)
    late = {
        name: dataclasses.replace(track, time_s=track.time_s + 1.76e9)
        for name, track in (("body", recording.body), ("lever", recording.lever))
    }
    pages = []
    for each in (recording, dataclasses.replace(recording, **late)):
        tracks, settings, device = estimate_tracks(each), Settings(), load_device("pmdi")
        pages.append(Page(session_page(report_of(tracks, settings, device=device), session_panels(tracks))))
    usual, since_1970 = pages
    boxes = [attributes["viewbox"] for page in pages for tag, attributes in page.tags if tag == "svg"]
    span_s = float(boxes[0].split()[2])
    for tag, attributes in since_1970.tags:
        times = re.findall(r"(?:^|[M ])(-?[\d.]+),", attributes.get("d") or "") if tag == "path" else ()
        assert all(-1.0 <= float(time) <= span_s + 2.0 for time in times)
    assert "1760000000 s of the body" in since_1970.text
    assert "176000" not in usual.text
    assert len(re.findall(r"\d{10,}", since_1970.text)) == 1  # the note alone
