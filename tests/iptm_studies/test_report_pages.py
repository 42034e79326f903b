"""The report from a store: a whole one, one with gaps, and none at all."""

import re
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from iptm_core.decision_record import DecisionSeries
from iptm_core.errors import ScenarioError, StoreError
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_studies.campaign import Campaign, plan_campaign
from iptm_studies.execution import survey
from iptm_studies.expected_time import ExpectedTimes
from iptm_studies.report import build_report
from iptm_studies.report.building import document_of
from iptm_studies.report.claims import load_claims
from iptm_studies.report.document import ClaimList, Document, Missing, Picture, Table
from iptm_studies.report.evaluation import NO_CAUSE
from iptm_studies.report.gathering import gather
from iptm_studies.report.plots.registry import PLOTS
from iptm_studies.report.plots.style import MOST_BYTES
from iptm_studies.report.rendering import render_html, render_markdown, spaced
from iptm_studies.report.verdict import Verdict
from iptm_studies.run_inputs import RunInputs
from iptm_studies.run_spec import RunKind
from iptm_studies.single_run import FinishedRun, WallTimes, WholeTripRecord, WholeTripSolve
from iptm_studies.store import ResultStore
from iptm_studies.stored_run import stored_run
from iptm_studies.study import ShortTrip
from iptm_studies.study_loading import available_studies

TRIP = ShortTrip(duration_s=200.0)


def made_trip(inputs: RunInputs, rng: np.random.Generator) -> Trajectory:
    """A trip behind the leader that no controller drove; the weights and the horizon shift its figures."""
    times = np.arange(inputs.ticks + 1.0)
    ease = 1.0 - 0.1 * rng.random()
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


def made_run(key: str, inputs: RunInputs) -> FinishedRun:
    rng = np.random.default_rng(int(key[:12], 16))
    ticks = inputs.ticks
    whole = inputs.spec.kind is RunKind.WHOLE_TRIP
    decisions = DecisionSeries(
        time_s=np.arange(float(ticks)),
        objective=np.zeros(ticks),
        preview_age_s=np.zeros(ticks),
        status=np.zeros(ticks, dtype=np.int64),
        rung=np.zeros(ticks, dtype=np.int64),
        iterations=np.full(ticks, 5),
        solve_time_s=1e-3 * (1.0 + rng.random(ticks)),
        gap_slack_m=np.zeros(ticks),
        speed_slack_m_s=np.zeros(ticks),
        temperature_slack_k=np.zeros(ticks),
        limiter_active=np.zeros(ticks, dtype=bool),
    )
    solves = (
        WholeTripSolve("solved", 100, 20.0, 1.5, 1e-6, 30.0),
        WholeTripSolve("solved", 20, 4.0, 1.4, 1e-7, None),
    )
    return FinishedRun(
        trajectory=made_trip(inputs, rng),
        decisions=None if whole else decisions,
        whole_trip=WholeTripRecord(True, solves, 0.0, 0.0, 0.0) if whole else None,
        wall=WallTimes(0.5, 2.0),
        compiled=True,
    )


def filled(store: ResultStore, names: list[str]) -> None:
    """Store a made run for everything that the studies need."""
    campaign = plan_campaign(names, TRIP)
    while new := campaign.take():
        for planned in new:
            run = stored_run(
                planned.key,
                planned.inputs,
                made_run(planned.key, planned.inputs),
                "2026-01-01T00:00:00+00:00",
            )
            store.save(run)
            campaign.finish(planned.key, run.metrics)


def surveyed(store: ResultStore) -> Campaign:
    campaign = plan_campaign(available_studies(), TRIP)
    survey(campaign, store, ExpectedTimes())
    return campaign


@pytest.fixture(scope="module")
def full_store(tmp_path_factory: pytest.TempPathFactory) -> ResultStore:
    store = ResultStore(tmp_path_factory.mktemp("report") / "results")
    filled(store, list(available_studies()))
    return store


@pytest.fixture(scope="module")
def full(full_store: ResultStore) -> Document:
    return document_of(gather(full_store, surveyed(full_store)))


@pytest.fixture(scope="module")
def partial(tmp_path_factory: pytest.TempPathFactory) -> Document:
    store = ResultStore(tmp_path_factory.mktemp("report") / "results")
    filled(store, ["strategies"])
    return document_of(gather(store, surveyed(store)))


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out what takes long and is not looked at."""
    monkeypatch.setattr("iptm_studies.report.sections.png_bytes", lambda _figure, _name: b"\x89PNG")


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


def test_a_full_store_leaves_no_gap(full: Document) -> None:
    assert [block.title for block in full.missing] == []
    assert {picture.key for picture in full.pictures} == set(PLOTS)
    untested = [
        entry.claim.id
        for block in full.blocks()
        if isinstance(block, ClaimList)
        for entry in block.entries
        if entry.verdict is Verdict.NOT_TESTED
    ]
    assert untested == []


def test_every_statement_is_shown_once(full: Document) -> None:
    shown = [
        entry.claim.id
        for block in full.blocks()
        if isinstance(block, ClaimList)
        for entry in block.entries
    ]
    assert sorted(shown) == sorted(claim.id for claim in load_claims().claims)


def test_every_table_and_figure_of_the_paper_is_there(full: Document) -> None:
    paper = load_claims()
    figures = {picture.paper.split(":")[0] for picture in full.pictures if picture.paper}
    assert figures == {figure.figure for figure in paper.figures}
    tables = {block.paper for block in full.blocks() if isinstance(block, Table)}
    assert {"Table I", "Table II", "Table III", "Table IV"} <= tables
    keys = [
        (type(block), block.key)
        for block in full.blocks()
        if isinstance(block, Table | Picture | Missing)
    ]
    assert len(keys) == len(set(keys))


def test_figures_are_small_pictures(full: Document) -> None:
    for picture in full.pictures:
        assert picture.png.startswith(b"\x89PNG"), picture.key
        assert len(picture.png) <= MOST_BYTES, picture.key


def test_strategy_table_gives_found_and_printed(full: Document) -> None:
    (table,) = (
        block for block in full.blocks() if isinstance(block, Table) and block.key == "strategies"
    )
    cooling = next(row for row in table.rows if row[0].text.startswith("Cooling energy"))
    printed = table.rows[table.rows.index(cooling) + 1]
    assert [cell.text for cell in printed[1:4]] == [
        "printed",
        "8 049.01",
        "6 925.07 (-13.96 %)",
    ]
    assert cooling[2].verdict is None
    assert all(cell.verdict is not None for cell in cooling[3:])
    assert all(re.fullmatch(r"[\d .]+ \([+-][\d.]+ %\)", cell.text) for cell in cooling[3:])
    assert any(row[0].text.startswith("Ticks on a fallback") for row in table.rows)


def test_html_page_is_whole_and_self_contained(full: Document) -> None:
    page = Page()
    page.feed(render_html(full))
    assert page.open == []
    assert len(page.sources) == len(PLOTS)
    assert all(source.startswith("data:image/png;base64,") for source in page.sources)
    assert len(page.ids) == len(set(page.ids))
    assert {anchor.removeprefix("#") for anchor in page.anchors} <= set(page.ids)
    assert {f"figure-{key}" for key in PLOTS} <= set(page.ids)


def test_markdown_has_sound_tables_and_every_figure(full: Document) -> None:
    text = render_markdown(full, "pictures")
    for key in PLOTS:
        assert f"(pictures/{key}.png)" in text
    found = list(tables_of(text))
    assert len(found) > 20
    for rows in found:
        assert set(rows[1]) <= set("|-"), rows[:2]
        assert len({len(re.findall(r"(?<!\\)\|", row)) for row in rows}) == 1, rows[0]


def test_no_statement_differs_without_a_place_for_the_reason(full: Document) -> None:
    differing = [
        entry
        for block in full.blocks()
        if isinstance(block, ClaimList)
        for entry in block.entries
        if entry.verdict in {Verdict.SIGN_ONLY, Verdict.NOT_REPRODUCED}
    ]
    assert differing
    assert all(entry.cause for entry in differing)
    page = render_html(full)
    assert page.count("<strong>Why ") == len(differing)


@pytest.mark.usefixtures("undrawn")
def test_causes_reach_the_page(full_store: ResultStore, tmp_path: Path) -> None:
    causes = tmp_path / "causes.yaml"
    lines = [
        f'  {claim.id}: \'Because {{{{ change("strategies/aging", "strategies/reference", '
        f'"cooling_energy") }}}} <& so on>\''
        for claim in load_claims().claims
    ]
    chapters = "chapters:\n  power: 'Braking: {{ braking_share(\"strategies/aging\") }}'"
    causes.write_text("\n".join(["claims:", *lines, chapters]), encoding="utf-8")
    gathered = gather(full_store, surveyed(full_store))
    document = document_of(gathered, causes_file=causes)
    assert re.search(r"Because [+-][\d.]+ % &lt;&amp; so on&gt;", render_html(document))
    assert NO_CAUSE not in render_html(document)
    assert re.search(r"<p>Braking: [\d.]+ %</p>", render_html(document))
    causes.write_text("claims: {}\nchapters: {nowhere: text}\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match="no chapter nowhere; there are summary, "):
        document_of(gathered, causes_file=causes)


@pytest.mark.usefixtures("undrawn")
def test_build_writes_pages_and_removes_old_figures(
    full_store: ResultStore, tmp_path: Path
) -> None:
    old = tmp_path / "docs" / "paper-reproduction" / "old.png"
    old.parent.mkdir(parents=True)
    old.write_bytes(b"")
    pages = build_report(full_store, surveyed(full_store), tmp_path / "docs")
    assert [page.name for page in pages] == ["paper-reproduction.html", "paper-reproduction.md"]
    assert all(page.is_file() for page in pages)
    written = {path.stem for path in old.parent.iterdir()}
    assert written == set(PLOTS)


def test_a_partial_store_says_what_is_missing(partial: Document) -> None:
    shown = {picture.key for picture in partial.pictures}
    assert {"aging_map", "driving_cycle", "power_distribution", "strategy_changes"} <= shown
    missing = {block.key: block for block in partial.missing}
    assert {"prediction_horizon", "sampling_time", "long_horizon", "headline"} <= set(missing)
    assert shown | set(missing) >= set(PLOTS)
    horizon = missing["prediction_horizon"]
    assert "not computed" in horizon.reason
    assert horizon.command == "scripts/reproduce run prediction_horizon"
    page = render_html(partial)
    assert "This report is incomplete" in page
    assert "do not all drive the whole comprehensive cycle" in page
    assert horizon.reason in page
    assert "> **" in render_markdown(partial, "pictures")
    verdicts = {
        entry.claim.id: entry.verdict
        for block in partial.blocks()
        if isinstance(block, ClaimList)
        for entry in block.entries
    }
    assert verdicts["headline-cooling"] is Verdict.NOT_TESTED
    assert verdicts["proposed-cooling"] is not Verdict.NOT_TESTED
    assert verdicts["aging-falls"] is Verdict.REPRODUCED


@pytest.mark.usefixtures("undrawn")
def test_a_failed_run_is_named_with_its_cause(tmp_path: Path) -> None:
    store = ResultStore(tmp_path / "results")
    filled(store, ["strategies"])
    campaign = plan_campaign(["prediction_horizon"], TRIP)
    for planned in campaign.take():
        if planned.key not in store:
            store.note_failure(planned.key, planned.inputs.spec, "the solver would not build")
    document = document_of(gather(store, surveyed(store)))
    missing = {block.key: block for block in document.missing}
    assert "the solver would not build" in missing["prediction_horizon"].reason


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
    survey(campaign, store, ExpectedTimes())
    with pytest.raises(ScenarioError, match="scripts/reproduce run --small prediction_horizon"):
        build_report(store, campaign, tmp_path / "docs")


def test_unwritable_folder_is_one_clear_error(partial: Document, tmp_path: Path) -> None:
    from iptm_studies.report.building import write_report  # noqa: PLC0415

    (tmp_path / "docs").write_text("a file", encoding="utf-8")
    with pytest.raises(StoreError, match="cannot be written"):
        write_report(partial, tmp_path / "docs")


def test_blocks_of_markdown_are_parted() -> None:
    text = "# head\ntext\n| a |\n|---|\n\n| b |\n- one\n- two\n> c\n> d"
    assert spaced(text) == "# head\n\ntext\n\n| a |\n|---|\n| b |\n\n- one\n- two\n\n> c\n\n> d\n"


def test_ragged_tables_are_refused(full: Document) -> None:
    (table,) = (
        block for block in full.blocks() if isinstance(block, Table) and block.key == "headline"
    )
    with pytest.raises(ValueError, match="cells under"):
        replace(table, head=table.head[:-1])
