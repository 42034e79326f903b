"""The report from a store: a whole one, one with gaps, and none at all."""

import re
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from tests.iptm_reproduction.made_store import TRIP, filled, surveyed

from iptm_core.errors import ScenarioError, StoreError
from iptm_reproduction.chapters import compose
from iptm_reproduction.check import CheckedClaim, Verdict
from iptm_reproduction.claims import CLAIMS
from iptm_reproduction.document import ClaimList, Document, Missing, Table
from iptm_reproduction.gathering import gather
from iptm_reproduction.plots.style import MOST_BYTES
from iptm_reproduction.printed import FIGURE_CAPTIONS
from iptm_reproduction.report import (
    build_report,
    render_html,
    render_markdown,
    spaced,
    write_report,
)
from iptm_reproduction.tables import SAVING
from iptm_studies.campaign import plan_campaign
from iptm_studies.execution import survey
from iptm_studies.store import ResultStore
from iptm_studies.study import ShortTrip
from iptm_studies.study_loading import available_studies

PICTURES = 23


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Document:
    store = ResultStore(tmp_path_factory.mktemp("report") / "results")
    filled(store, list(available_studies()))
    return compose(gather(store, surveyed(store)))


@pytest.fixture(scope="module")
def partial_store(tmp_path_factory: pytest.TempPathFactory) -> ResultStore:
    """All strategies, but no other study; and one run that failed."""
    store = ResultStore(tmp_path_factory.mktemp("report") / "results")
    filled(store, ["strategies"])
    for inputs in plan_campaign(["prediction_horizon"], TRIP).take():
        if not store.path_of(inputs.key).is_file():
            store.note_failure(inputs.key, "the solver would not build")
    return store


@pytest.fixture(scope="module")
def partial(partial_store: ResultStore) -> Iterator[Document]:
    with pytest.MonkeyPatch.context() as patch:
        # What takes long and is looked at in the full report.
        patch.setattr("iptm_reproduction.parts.png_bytes", lambda _figure, _name: b"\x89PNG")
        yield compose(gather(partial_store, surveyed(partial_store)))


def statements(document: Document) -> list[CheckedClaim]:
    return [
        entry
        for block in document.blocks()
        if isinstance(block, ClaimList)
        for entry in block.entries
    ]


def tables(document: Document) -> dict[str, Table]:
    return {block.key: block for block in document.blocks() if isinstance(block, Table)}


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


def test_a_full_store_leaves_nothing_out(full: Document) -> None:
    assert not any(isinstance(block, Missing) for block in full.blocks())
    assert len(full.pictures) == PICTURES
    assert [entry for entry in statements(full) if entry.verdict is Verdict.NOT_TESTED] == []


def test_every_statement_is_shown_once_and_differences_have_a_cause(full: Document) -> None:
    shown = statements(full)
    assert sorted(entry.claim.id for entry in shown) == sorted(claim.id for claim in CLAIMS)
    differing = [
        entry for entry in shown if entry.verdict in {Verdict.SIGN_ONLY, Verdict.NOT_REPRODUCED}
    ]
    assert differing
    assert all(entry.cause for entry in differing)
    assert render_html(full).count("<strong>Why ") == len(differing)


def test_every_table_and_figure_of_the_paper_is_there(full: Document) -> None:
    figures = {picture.paper.split(":")[0] for picture in full.pictures if picture.paper}
    assert figures == {figure for figure, _ in FIGURE_CAPTIONS.values()}
    assert {"Table I", "Table II", "Table III", "Table IV"} <= {
        table.paper for table in tables(full).values()
    }


def test_figures_are_small_pictures(full: Document) -> None:
    for picture in full.pictures:
        assert picture.png.startswith(b"\x89PNG"), picture.key
        assert len(picture.png) <= MOST_BYTES, picture.key


def test_strategy_table_gives_found_and_printed(full: Document) -> None:
    rows = tables(full)["strategies"].rows
    cooling = next(row for row in rows if row[0].text.startswith("Cooling energy"))
    printed = rows[rows.index(cooling) + 1]
    assert [cell.text for cell in printed[1:4]] == ["printed", "8 049.01", "6 925.07 (-13.96 %)"]
    assert cooling[2].verdict is None
    assert all(cell.verdict is not None for cell in cooling[3:])
    assert all(re.fullmatch(r"[\d .]+ \([+-][\d.]+ %\)", cell.text) for cell in cooling[3:])


def test_the_channel_table_says_where_the_hottest_cell_is(full: Document) -> None:
    table = tables(full)["channel"]
    rows = {row[0].text: [cell.text for cell in row[1:]] for row in table.rows}
    assert table.head[1:] == ("Reference", "Aging, MH 3+5", "Aging and cost to go, MH 3+5")
    assert rows["hottest cell of the trip [°C]"] == ["39.35 (cell 9, 50 s)"] * 3
    assert rows["line against every cell, RMS / largest [K]"] == ["0.250 / 1.500"] * 3
    saving = tables(full)["channel-saving"]
    assert [row[0].text for row in saving.rows] == ["two cells"] * 3 + ["full channel"] * 3
    assert saving.rows[0][-1].text == "–"
    assert re.fullmatch(r"[+-][\d.]+ %", saving.rows[-1][-1].text)


def test_the_cost_to_go_stands_beside_the_reference_and_the_whole_trip(full: Document) -> None:
    found = tables(full)
    share = found["cost-to-go"].head.index(SAVING)
    rows = {(row[0].text, row[1].text): row for row in found["cost-to-go"].rows}
    with_it = "Aging and cost to go, MH 3+5"
    assert {preview for name, preview in rows if name == with_it} == {
        "perfect",
        "15 s",
        "8 s",
        "noise",
        "none",
    }
    assert rows["Reference", "perfect"][share].text == "0.0 %"
    assert rows["whole-trip optimum", "perfect"][share].text == "100.0 %"
    assert re.fullmatch(r"-?[\d.]+ %", rows[with_it, "none"][share].text)
    others = found["cost-to-go-trips"].rows
    assert {row[0].text for row in others} == {"us06, slope small"}, "the trip that was driven"
    assert [row[1].strong for row in others] == 4 * [True, False, False]


def test_cold_days_stand_beside_the_warm_one_of_their_trip(full: Document) -> None:
    rows = tables(full)["cold-days"].rows
    days = [row[1].text for row in rows]
    assert days == 6 * ["without limits", "-20 °C", "-10 °C", "0 °C", "10 °C", "20 °C"]
    assert [row[1].strong for row in rows] == 6 * [True, False, False, False, False, False]
    for warm, *cold in (rows[first : first + 6] for first in range(0, 36, 6)):
        assert re.fullmatch(r"-?[\d ]+\.\d+", warm[2].text)
        assert all(re.fullmatch(r"[+-][\d.]+ %", row[2].text) for row in cold)
        assert {row[3].text for row in (warm, *cold)} == {"0.0"}, "the made trips are warm"


def test_verdict_table_counts_every_statement(full: Document) -> None:
    *topics, every = [[cell.text for cell in row] for row in tables(full)["verdicts"].rows]
    assert every[:2] == ["all statements", str(len(CLAIMS))]
    for column in range(1, 6):
        assert sum(int(row[column]) for row in topics) == int(every[column])


def test_html_page_is_whole_and_self_contained(full: Document) -> None:
    page = Page()
    page.feed(render_html(full))
    assert page.open == []
    assert len(page.sources) == PICTURES
    assert all(source.startswith("data:image/png;base64,") for source in page.sources)
    assert len(page.ids) == len(set(page.ids))
    assert {anchor.removeprefix("#") for anchor in page.anchors} <= set(page.ids)


def test_markdown_has_sound_tables_and_every_figure(full: Document) -> None:
    markdown = render_markdown(full, "pictures")
    assert all(f"(pictures/{picture.key}.png)" in markdown for picture in full.pictures)
    found = list(tables_of(markdown))
    assert len(found) > 20
    for rows in found:
        assert set(rows[1]) <= set("|-"), rows[:2]
        assert len({len(re.findall(r"(?<!\\)\|", row)) for row in rows}) == 1, rows[0]


def test_causes_and_remarks_are_filled_in(full: Document) -> None:
    page, markdown = render_html(full), render_markdown(full, "pictures")
    assert re.search(r"Cooling with drawn power pays only after \d+ to \d+ s on this trip", page)
    assert re.search(r"multi-horizon controller is [\d.]+ m without any prediction", markdown)


def test_pages_are_written_and_old_figures_removed(full: Document, tmp_path: Path) -> None:
    old = tmp_path / "docs" / "paper-reproduction" / "old.png"
    old.parent.mkdir(parents=True)
    old.write_bytes(b"")
    pages = write_report(full, tmp_path / "docs")
    assert [page.name for page in pages] == ["paper-reproduction.html", "paper-reproduction.md"]
    assert all(page.is_file() for page in pages)
    assert {path.stem for path in old.parent.iterdir()} == {figure.key for figure in full.pictures}


def test_a_partial_store_says_what_is_missing(partial: Document) -> None:
    shown = {picture.key for picture in partial.pictures}
    assert {"aging_map", "driving_cycle", "power_distribution", "strategy_changes"} <= shown
    missing = {block.key: block for block in partial.blocks() if isinstance(block, Missing)}
    assert {"sampling_time", "long_horizon", "headline", "sampling-time-table"} <= set(missing)
    assert "not computed" in missing["sampling_time"].reason
    assert missing["sampling_time"].command == "scripts/reproduce run sampling_time"
    assert "the solver would not build" in missing["prediction_horizon"].reason
    page = render_html(partial)
    assert "This report is incomplete" in page
    assert "do not all drive the whole comprehensive cycle" in page
    assert missing["sampling_time"].reason in page
    assert "> **" in render_markdown(partial, "pictures")
    verdicts = {entry.claim.id: entry.verdict for entry in statements(partial)}
    assert verdicts["headline-cooling"] is Verdict.NOT_TESTED
    assert verdicts["proposed-cooling"] is not Verdict.NOT_TESTED
    assert verdicts["aging-falls"] is Verdict.REPRODUCED


def test_nothing_stored_is_one_clear_error(tmp_path: Path) -> None:
    store = ResultStore(tmp_path / "results")
    with pytest.raises(
        ScenarioError, match=r"none of the results.*runs of strategies.*scripts/reproduce run "
    ):
        build_report(store, surveyed(store), tmp_path / "docs")
    assert not (tmp_path / "docs").exists()


def test_small_studies_are_computed_with_their_own_option(tmp_path: Path) -> None:
    store = ResultStore(tmp_path / "results")
    campaign = plan_campaign(["prediction_horizon"], ShortTrip())
    survey(campaign, store)
    with pytest.raises(ScenarioError, match="scripts/reproduce run --small prediction_horizon"):
        build_report(store, campaign, tmp_path / "docs")


def test_unwritable_folder_is_one_clear_error(partial: Document, tmp_path: Path) -> None:
    (tmp_path / "docs").write_text("a file", encoding="utf-8")
    with pytest.raises(StoreError, match="cannot be written"):
        write_report(partial, tmp_path / "docs")


def test_blocks_of_markdown_are_parted() -> None:
    text = "# head\ntext\n| a |\n|---|\n\n| b |\n- one\n- two\n> c\n> d"
    assert spaced(text) == "# head\n\ntext\n\n| a |\n|---|\n| b |\n\n- one\n- two\n\n> c\n\n> d\n"


def test_ragged_tables_are_refused(full: Document) -> None:
    table = tables(full)["headline"]
    with pytest.raises(ValueError, match="cells under"):
        replace(table, head=table.head[:-1])
