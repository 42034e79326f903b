"""The report from a store: a whole one, one with gaps, and none at all."""

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pandas as pd
import pytest
from tests.iptm_reproduction.made_store import TRIP_S, filled, surveyed

from iptm.studies.campaign import plan_campaign, survey
from iptm.studies.store import ResultStore
from iptm.studies.study_loading import available_studies
from iptm_core.errors import ScenarioError, StoreError
from iptm_reproduction.claims import Claim
from iptm_reproduction.plots.style import MOST_BYTES
from iptm_reproduction.printed import Finding, Verdict
from iptm_reproduction.report import (
    Chapters,
    blocks_of,
    build_report,
    compose,
    render_html,
    render_markdown,
    spaced,
    write_report,
)
from iptm_reproduction.results import gather
from iptm_reproduction.tables import SAVING, table_of

PICTURES = 23


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Chapters:
    store = ResultStore(tmp_path_factory.mktemp("report") / "results")
    filled(store, list(available_studies()))
    return compose(gather(store, surveyed(store)))


@pytest.fixture(scope="module")
def partial(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chapters]:
    """All strategies, but no other study; and one run that failed."""
    store = ResultStore(tmp_path_factory.mktemp("report") / "results")
    filled(store, ["strategies"])
    for inputs in plan_campaign(["prediction_horizon"], TRIP_S).take():
        if not store.path_of(inputs.key).is_file():
            store.note_failure(inputs.key, "the solver would not build")
    with pytest.MonkeyPatch.context() as patch:
        # What takes long and is looked at in the full report.
        patch.setattr("iptm_reproduction.plots.png_bytes", lambda _figure, _name: b"\x89PNG")
        yield compose(gather(store, surveyed(store)))


def statements(document: Chapters) -> list[tuple[Claim, Finding]]:
    return [entry for block in blocks_of(document, "claims") for entry in block.content]


def tables(document: Chapters) -> dict[str, pd.DataFrame]:
    return {block.key: block.content for block in blocks_of(document, "table")}


class Page(HTMLParser):
    """Collects what a page refers to, and sees to it that elements are closed."""

    def __init__(self) -> None:
        super().__init__()
        self.sources: list[str] = []
        self.anchors: list[str] = []
        self.ids: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        if "id" in given:
            self.ids.append(given["id"])
        if tag in {"img", "script", "link", "iframe"}:
            self.sources.append(given.get("src", given.get("href", "")))
        if tag == "a":
            self.anchors.append(given["href"])
        if tag not in {"meta", "img", "br"}:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def tables_of(text: str) -> Iterator[list[str]]:
    rows: list[str] = []
    for line in [*text.splitlines(), ""]:
        if line.startswith("|"):
            rows.append(line)
        elif rows:
            yield rows
            rows = []


def test_a_full_store_leaves_nothing_out(full: Chapters) -> None:
    assert not list(blocks_of(full, "missing"))
    pictures = list(blocks_of(full, "picture"))
    assert len(pictures) == PICTURES
    for picture in pictures:
        assert picture.content.startswith(b"\x89PNG"), picture.key
        assert len(picture.content) <= MOST_BYTES, picture.key
    figures = {picture.paper.split(":")[0] for picture in pictures if picture.paper}
    numbers = {int(number) for name in figures for number in re.findall(r"\d+", name)}
    assert numbers == set(range(4, 14)), "Figs. 1 to 3 draw the system"
    papers = {block.paper for block in blocks_of(full, "table")}
    assert {"Table I", "Table II", "Table III", "Table IV"} <= papers


def test_every_statement_is_shown_once_and_differences_have_a_cause(full: Chapters) -> None:
    shown = statements(full)
    assert len({claim.id for claim, _ in shown}) == len(shown) == 78
    assert not [claim.id for claim, finding in shown if finding.verdict is Verdict.NOT_TESTED]
    differing = [finding for _, finding in shown if finding.verdict.differs]
    assert differing
    assert all(finding.cause for finding in differing)
    page = render_html(full)
    assert page.count("<strong>Why ") == len(differing)
    assert re.search(r"Cooling with drawn power pays only after \d+ to \d+ s on this trip", page)
    assert re.search(r"multi-horizon controller is [\d.]+ m without any prediction", page)
    topics = tables(full)["verdicts"].set_index("statements about")
    every = topics.loc["**all statements**"].astype(int)
    assert (topics.drop("**all statements**").astype(int).sum() == every).all()
    assert every["number"] == len(shown)


def test_strategy_table_gives_found_and_printed(full: Chapters) -> None:
    rows = tables(full)["strategies"].to_numpy().tolist()
    place = next(place for place, row in enumerate(rows) if row[0].startswith("**Cooling energy"))
    assert rows[place + 1][1:4] == ["printed", "8 049.01", "6 925.07 (-13.96 %)"]
    assert re.fullmatch(r"[\d .]+", rows[place][2])
    assert all(re.fullmatch(r"[\d .]+ \([+-][\d.]+ %\) [✓≈✗]", cell) for cell in rows[place][3:])


def test_the_channel_table_gives_the_hottest_cell(full: Chapters) -> None:
    table = tables(full)["channel"].set_index("")
    assert list(table) == ["Reference", "Aging, MH 3+5", "Aging and cost to go, MH 3+5"]
    assert (table.loc["hottest cell of the trip [°C]"] == "39.35 (cell 9, 50 s)").all()
    assert (table.loc["line against every cell, RMS / largest [K]"] == "0.250 / 1.500").all()
    saving = tables(full)["channel-saving"].to_numpy().tolist()
    assert [row[0] for row in saving] == ["two cells"] * 3 + ["full channel"] * 3
    assert saving[0][-1] == "–"
    assert re.fullmatch(r"[+-][\d.]+ %", saving[-1][-1])


def test_the_cost_to_go_stands_next_to_the_reference_and_the_whole_trip(full: Chapters) -> None:
    shares = tables(full)["cost-to-go"].set_index(["controller", "preview"])[SAVING]
    with_it = "Aging and cost to go, MH 3+5"
    assert set(shares[with_it].index) == {"perfect", "15 s", "8 s", "noise", "none"}
    assert shares["**Reference**", "perfect"] == "0.0 %"
    assert shares["whole-trip optimum", "perfect"] == "100.0 %"
    assert re.fullmatch(r"-?[\d.]+ %", shares[with_it, "none"])
    others = tables(full)["cost-to-go-trips"]
    assert set(others["trip"]) == {"us06, slope small"}, "the trip that was driven"
    assert others["controller"].str.startswith("**").tolist() == 4 * [True, False, False]


def test_cold_days_stand_next_to_the_warm_one_of_their_trip(full: Chapters) -> None:
    rows = tables(full)["cold-days"].to_numpy().tolist()
    days = ["**without limits**", "-20 °C", "-10 °C", "0 °C", "10 °C", "20 °C"]
    assert [row[1] for row in rows] == 6 * days
    for warm, *cold in (rows[first : first + 6] for first in range(0, 36, 6)):
        assert re.fullmatch(r"-?[\d ]+\.\d+", warm[2])
        assert all(re.fullmatch(r"[+-][\d.]+ %", row[2]) for row in cold)
        assert {row[3] for row in (warm, *cold)} == {"0.0"}, "the made trips are warm"


def test_html_page_is_whole_and_self_contained(full: Chapters) -> None:
    page = Page()
    text = render_html(full)
    page.feed(text)
    assert page.open == []
    assert len(page.sources) == PICTURES
    assert all(source.startswith("data:image/png;base64,") for source in page.sources)
    assert len(page.ids) == len(set(page.ids))
    assert {anchor.removeprefix("#") for anchor in page.anchors} <= set(page.ids)
    assert '<td>-2 m/s^2 <span class="reproduced" title="reproduced">✓</span></td>' in text
    assert '<td class="number">8 049.01</td>' in text
    assert "<td><strong>all statements</strong></td>" in text


def test_markdown_has_sound_tables_and_every_figure(full: Chapters) -> None:
    markdown = render_markdown(full, "pictures")
    assert all(
        f"(pictures/{picture.key}.png)" in markdown for picture in blocks_of(full, "picture")
    )
    found = list(tables_of(markdown))
    assert len(found) > 20
    for rows in found:
        assert set(rows[1]) <= set("|-"), rows[:2]
        assert len({len(re.findall(r"(?<!\\)\|", row)) for row in rows}) == 1, rows[0]


def test_pages_are_written_and_old_figures_removed(full: Chapters, tmp_path: Path) -> None:
    old = tmp_path / "docs" / "paper-reproduction" / "old.png"
    old.parent.mkdir(parents=True)
    old.write_bytes(b"")
    pages = write_report(full, tmp_path / "docs")
    assert [page.name for page in pages] == ["paper-reproduction.html", "paper-reproduction.md"]
    assert all(page.is_file() for page in pages)
    keys = {picture.key for picture in blocks_of(full, "picture")}
    assert {path.stem for path in old.parent.iterdir()} == keys


def test_a_partial_store_gives_what_is_missing(partial: Chapters, tmp_path: Path) -> None:
    shown = {picture.key for picture in blocks_of(partial, "picture")}
    assert {"aging_map", "driving_cycle", "power_distribution", "strategy_changes"} <= shown
    missing = {block.key: block for block in blocks_of(partial, "missing")}
    assert {"sampling_time", "long_horizon", "headline", "sampling-time-table"} <= set(missing)
    assert "not computed" in missing["sampling_time"].text
    assert missing["sampling_time"].command == "scripts/reproduce run sampling_time"
    assert "the solver would not build" in missing["prediction_horizon"].text
    page = render_html(partial)
    assert "This report is incomplete" in page
    assert "do not all drive the whole comprehensive cycle" in page
    assert missing["sampling_time"].text in page
    assert "> **" in render_markdown(partial, "pictures")
    verdicts = {claim.id: finding.verdict for claim, finding in statements(partial)}
    assert verdicts["headline-cooling"] is Verdict.NOT_TESTED
    assert verdicts["proposed-cooling"] is not Verdict.NOT_TESTED
    assert verdicts["aging-falls"] is Verdict.REPRODUCED
    (tmp_path / "docs").write_text("a file", encoding="utf-8")
    with pytest.raises(StoreError, match="cannot be written"):
        write_report(partial, tmp_path / "docs")


def test_nothing_stored_is_one_clear_error(tmp_path: Path) -> None:
    store = ResultStore(tmp_path / "results")
    refusal = r"none of the results.*runs of strategies.*scripts/reproduce run "
    with pytest.raises(ScenarioError, match=refusal):
        build_report(store, surveyed(store), tmp_path / "docs")
    assert not (tmp_path / "docs").exists()
    small = plan_campaign(["prediction_horizon"], 600.0)
    survey(small, store)
    with pytest.raises(ScenarioError, match="scripts/reproduce run --small prediction_horizon"):
        build_report(store, small, tmp_path / "docs")


def test_blocks_of_markdown_are_parted() -> None:
    text = "# head\ntext\n| a |\n|---|\n\n| b |\n- one\n- two\n> c\n> d"
    assert spaced(text) == "# head\n\ntext\n\n| a |\n|---|\n| b |\n\n- one\n- two\n\n> c\n\n> d\n"


def test_ragged_tables_are_refused() -> None:
    with pytest.raises(ValueError, match="columns"):
        table_of(("one", "two"), [("1", "2", "3")])
