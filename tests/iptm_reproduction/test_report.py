"""The report from a store: a whole one, one with gaps, and none at all."""

import re
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from iptm_core.decision_record import DECISION_COLUMNS, DecisionSeries
from iptm_core.errors import ScenarioError, StoreError
from iptm_core.settings import ThermalModel
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
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
from iptm_studies.campaign import Campaign, plan_campaign
from iptm_studies.channel_record import CellError, ChannelRecord, HottestCell
from iptm_studies.execution import survey
from iptm_studies.run import Run, RunRecord
from iptm_studies.run_inputs import RunInputs
from iptm_studies.run_spec import RunKind
from iptm_studies.store import ResultStore
from iptm_studies.study import ShortTrip
from iptm_studies.study_loading import available_studies
from iptm_studies.whole_trip import TemperatureCostates, WholeTripRecord, WholeTripSolve

PICTURES = 23
TRIP = ShortTrip(duration_s=200.0)


def made_trip(inputs: RunInputs, rng: np.random.Generator) -> Trajectory:
    """A trip behind the leader that no controller drove; the weights and the horizon shift its figures.

    Those of a whole trip as one problem are the best.
    """
    times = np.arange(inputs.ticks + 1.0)
    ease = 0.85 if inputs.spec.kind is RunKind.WHOLE_TRIP else 1.0 - 0.1 * rng.random()
    speed = ease * inputs.route.leader.speeds_at(times)
    traction = 300.0 * speed + 4000.0 * np.gradient(speed)
    compressor = 400.0 * ease * (traction < np.median(traction))
    cooled = 5.0 * ease * (1.0 - np.exp(-times / 40.0))
    columns = dict.fromkeys(TRAJECTORY_COLUMNS, 300.0) | {
        "time_s": times,
        "position_m": ease * inputs.route.leader.positions_at(times) - 30.0,
        "speed_m_s": speed,
        "acceleration_m_s2": np.zeros(times.size),
        "compressor_power_w": compressor,
        "cell_1_temperature_k": 308.15 - cooled,
        "cell_n_temperature_k": 308.15 - 0.6 * cooled,
        "cell_1_capacity_loss": 1e-3 + 1e-9 * ease * times,
        "cell_n_capacity_loss": 1e-3 + 1.1e-9 * ease * times,
        "traction_power_w": traction,
        "auxiliary_power_w": np.full(times.size, 200.0),
        "battery_power_w": traction + compressor + 200.0,
        "leader_position_m": inputs.route.leader.positions_at(times),
        "leader_speed_m_s": inputs.route.leader.speeds_at(times),
    }
    return Trajectory.from_arrays(
        {name: np.broadcast_to(values, times.shape) for name, values in columns.items()}
    )


def made_run(inputs: RunInputs) -> Run:
    rng = np.random.default_rng(int(inputs.key[:12], 16))
    whole = inputs.spec.kind is RunKind.WHOLE_TRIP
    times = np.arange(float(inputs.ticks))
    columns = dict.fromkeys(DECISION_COLUMNS, np.zeros(times.size)) | {
        "time_s": times,
        "solve_time_s": 1e-3 * (1.0 + rng.random(times.size)),
        "iterations": np.full(times.size, 5),
        "cell_1_price_1_k": np.full(times.size, 1.5),
        "cell_n_price_1_k": np.full(times.size, 4.5),
    }
    costates = TemperatureCostates((100.0, 200.0), (2.0, 0.0), (6.0, 0.0))
    solves = (
        WholeTripSolve("solved", 100, 20.0, 1.5, 1e-6, 30.0),
        WholeTripSolve("solved", 20, 4.0, 1.4, 1e-7, None),
    )
    return Run(
        key=inputs.key,
        spec=inputs.spec,
        parameters=inputs.parameters,
        trajectory=made_trip(inputs, rng),
        decisions=None if whole else DecisionSeries.from_arrays(columns),
        whole_trip=WholeTripRecord(True, solves, 0.0, 0.0, 0.0, costates) if whole else None,
        record=RunRecord(
            wall_time_s=2.5,
            compiled=True,
            finished_at_utc="2026-01-01T00:00:00+00:00",
            git_revision="0123456789abcdef",
            versions={"python": "3.11.0", "casadi": "3.7.0"},
            fingerprint=inputs.fingerprint,
        ),
        channel=made_channel(rng)
        if inputs.spec.thermal_model is ThermalModel.FULL_CHANNEL
        else None,
    )


def made_channel(rng: np.random.Generator) -> ChannelRecord:
    """Ten cells of which the ninth is the hottest."""
    rising = tuple(float(value) for value in np.sort(rng.random(10)))
    profile = tuple(300.0 + value for value in rising)
    return ChannelRecord(
        mean_temperatures_k=profile,
        max_temperatures_k=profile,
        capacity_losses=tuple(1e-6 * (1.0 + value) for value in rising),
        hottest_shares=(0.0,) * 8 + (0.75, 0.25),
        peak=HottestCell(9, 50.0, 312.5, 0.5),
        largest_excess=HottestCell(9, 60.0, 310.0, 0.625),
        line_rms_k=rising,
        line_max_k=rising,
        line=CellError(0.25, 1.5),
        two_cell_1=CellError(0.125, 0.5),
        two_cell_n=CellError(0.375, 0.875),
        two_cell_losses=(1e-6, 2e-6),
        profile_times_s=(10.0, 20.0),
        profiles_k=(profile, profile),
    )


def filled(store: ResultStore, names: list[str]) -> None:
    """Store a made run for everything that the studies need."""
    campaign = plan_campaign(names, TRIP)
    while new := campaign.take():
        for inputs in new:
            run = made_run(inputs)
            store.save(run)
            campaign.finish(run)


def surveyed(store: ResultStore) -> Campaign:
    campaign = plan_campaign(available_studies(), TRIP)
    survey(campaign, store)
    return campaign


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
