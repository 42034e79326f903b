// Draws the page: builds its elements once, and brings them up to date with the run.

import { drawChart, drawEventRow, interpolate, themeColors } from "./charts.js";
import { build, drawEvents, element } from "./diagnostics.js";
import { FIGURES, PANELS, ROAD, shown, TILES } from "./panels.js";
import { Player } from "./player.js";
import { difference, Run } from "./run.js";

const PLAN_AHEAD_S = 30;
const AUTO_WINDOW_S = 120;
/** Half the width of the thumb of a slider: where its scale begins. */
export const THUMB_PX = 8;
const EVENTS_LISTED = 50;

export const run = new Run();
export const player = new Player(run, redraw);
/** Place of the pointer on the time axis, null where it is not on a panel; and the colours of the theme. */
export const shownWith = { pointed: null, colors: themeColors() };
let isDirty = false;

/** Draw before the next frame of the screen. */
export function redraw() {
  if (isDirty) return;
  isDirty = true;
  requestAnimationFrame(drawAll);
}

// --- build

function buildTile(tile, parent, prefix) {
  tile.box = build("div", parent);
  build("dt", tile.box, {}, tile.label);
  const value = build("dd", tile.box);
  tile.node = build("span", value, { id: `${prefix}-${tile.id}` }, "–");
  build("small", value, {}, tile.unit ? ` ${tile.unit}` : "");
  tile.note = build("dd", tile.box, { class: "note" });
}

function buildPanel(panel) {
  panel.section = build("section", element("panels"), { class: "panel", id: `panel-${panel.id}` });
  build("h2", panel.section, {}, `${panel.title} (${panel.unit})`);
  const legend = build("ul", panel.section, { class: "legend" });
  for (const line of panel.lines) {
    line.item = build("li", legend);
    const swatch = build("i", line.item, { "aria-hidden": "true" });
    swatch.style.borderTopColor = `var(--${line.color})`;
    swatch.style.borderTopStyle = line.dash ? "dashed" : "solid";
    line.item.append(`${line.label} `);
    line.node = build("b", line.item, { id: `value-${panel.id}-${line.label.replaceAll(" ", "-")}` }, "–");
  }
  panel.canvas = build("canvas", panel.section, { role: "img", "aria-label": panel.title });
}

FIGURES.forEach((figure) => buildTile(figure, element("figures"), "figure"));
TILES.forEach((tile) => buildTile(tile, element("tiles"), "tile"));
PANELS.forEach(buildPanel);
buildPanel(ROAD);

// --- draw

/** Time of the values on the page: that under the pointer, else that of the player. */
function readingTime() {
  return shownWith.pointed === null || run.rows.lastTime === null ? player.now : Math.min(Math.max(shownWith.pointed, player.first), player.last);
}

function timeRange() {
  const [first, last, now] = [player.first, player.last, player.now ?? 0];
  const choice = element("window").value;
  const isFollowing = player.mode === "live" && !run.end.ended;
  const ahead = isFollowing || now < last ? PLAN_AHEAD_S : 0;
  if (choice === "whole" || (choice === "auto" && !isFollowing)) {
    return [first, Math.max(last, now + (isFollowing ? ahead : 0), first + 1)];
  }
  const length = choice === "auto" ? AUTO_WINDOW_S : Number(choice);
  const begin = Math.max(first, now - length);
  return [begin, Math.max(now, begin + Math.min(length, 30)) + ahead];
}

/** An input holds from its node to the next one. */
function stepped(times, values) {
  const [xs, ys] = [[], []];
  times.forEach((time, k) => {
    if (k > 0) {
      xs.push(time);
      ys.push(values[k - 1]);
    }
    xs.push(time);
    ys.push(values[k]);
  });
  return { xs, ys };
}

function inUnit(values, factor) {
  return factor === 1 ? values : values.map((y) => (y === null ? null : factor * y));
}

function linesOf(panel, line, plan) {
  const table = run[line.table ?? "rows"];
  const curve = line.of ? line.of(run) : { xs: table.times, ys: table.column(line.column) };
  const ys = inUnit(curve.ys, line.factor);
  line.item.hidden = !ys.some((y) => y !== null);
  const lines = [{ xs: curve.xs, ys, color: line.color, width: line.width, dash: line.dash }];
  for (const limit of line.broken ?? []) {
    const rows = run.broken[limit] ?? [];
    if (rows.includes(true)) lines.push({ xs: curve.xs, ys: ys.map((y, k) => (rows[k] ? y : null)), color: "bad", width: 4 });
  }
  if (plan && line.plan && plan[line.plan]) {
    const ahead = inUnit(plan[line.plan], line.factor);
    const future = line.holds ? stepped(plan.time_s, ahead) : { xs: plan.time_s, ys: ahead };
    lines.push({ ...future, color: line.color, dash: [3, 3], width: 1.5, isAhead: true });
  }
  if (plan && line.worst && plan[line.worst]) {
    lines.push({ xs: plan.time_s, ys: inUnit(plan[line.worst], line.factor), color: line.color, dash: [1, 3], width: 1, isAhead: true });
  }
  const index = table.indexAt(readingTime());
  return { lines, value: index < 0 ? null : ys[index] };
}

function bandOf(panel) {
  const { limits } = run.facts;
  if (!panel.band || !limits) return null;
  const bound = (name) => (name === "s_min" ? { xs: run.rows.times, ys: run.rows.column("min_gap_m") } : limits[name]);
  const [low, high] = [bound(panel.band.low), bound(panel.band.high)];
  const text = (edge) => (typeof edge === "number" ? ` ${Number(edge.toPrecision(4))}` : "");
  const to = typeof low === "number" ? " to" : "";
  return { low, high, label: `${panel.band.label}${text(low)}${to}${text(high)} ${panel.unit}` };
}

function drawPanel(panel, range) {
  const hasData = panel.lines.some((line) => !line.table && run.rows.has(line.column));
  panel.section.hidden = !hasData;
  if (!hasData) return;
  const plan = run.planAt(player.now);
  const [lines, values, own] = [[], [], {}];
  const drawnOf = new Map(panel.lines.map((line) => [line, linesOf(panel, line, plan)]));
  for (const [line, { value }] of drawnOf) if (!line.table) own[line.column] = value;
  for (const [line, drawn] of drawnOf) {
    lines.push(...drawn.lines);
    const change = line.table ? difference(own[line.column], drawn.value) : null;
    const signed = change === null ? "" : ` (this car ${change < 0 ? "−" : "+"}${shown(Math.abs(change), panel.digits)})`;
    line.node.textContent = `${shown(drawn.value, panel.digits)}${signed}`;
    if (!line.item.hidden) values.push(`${line.label} ${line.node.textContent}`);
  }
  const limits = run.facts.limits
    ? (panel.limits ?? []).map(({ key, factor, color, label }) => {
      const value = factor * run.facts.limits[key];
      return { value, color, label: `${label} ${Number(value.toPrecision(4))} ${panel.unit}` };
    })
    : [];
  const content = { lines, band: bandOf(panel), limits, range, now: player.now, cursor: shownWith.pointed, xUnit: "s" };
  panel.box = drawChart(panel.canvas, panel.axis, content, shownWith.colors);
  panel.range = range;
  describe(panel, values);
}

function drawRoad() {
  const time = readingTime();
  const here = run.rows.at("position_m", time);
  const { position_m: xs = [], height_m: ys = [] } = run.road ?? {};
  const isFlat = Math.max(...ys) - Math.min(...ys) < ROAD.flatM;
  ROAD.section.hidden = here === null || !ys.length || isFlat;
  if (ROAD.section.hidden) return;
  const heightAt = (x) => interpolate(x, xs, ys) ?? (x < xs[0] ? ys[0] : ys[ys.length - 1]);
  const marks = [];
  for (const car of ROAD.lines) {
    const position = run.rows.at(car.column, time);
    car.node.textContent = position === null ? "–" : `at ${position.toFixed(0)} m`;
    if (position !== null) marks.push({ x: position, y: heightAt(position), ...car });
  }
  const line = { xs: [...xs, xs[xs.length - 1] + 1e5], ys: [...ys, ys[ys.length - 1]], color: "green", width: 2.2 };
  const range = [Math.max(xs[0], here - ROAD.behindM), here + ROAD.aheadM];
  drawChart(ROAD.canvas, ROAD.axis, { lines: [line], marks, range, xUnit: "m" }, shownWith.colors);
  describe(ROAD, ROAD.lines.map((car) => `${car.label} ${car.node.textContent}`));
}

function describe(panel, values) {
  const time = shown(readingTime(), 1);
  panel.canvas.setAttribute("aria-label", `${panel.title} (${panel.unit}); at ${time} s: ${values.join(", ")}`);
}

function drawHeadline() {
  const time = readingTime();
  const { state, strategy, run: other, duration_s: duration, reason } = run.referenceState;
  const car = other ? `the run ${other}` : `a car with strategy ${strategy}`;
  const saving = run.savingAt(time);
  const saved = saving?.energy.percent ?? null;
  element("saved").textContent = saved === null ? (saving?.energy.text ?? "–") : `${shown(saved, 1)} %`;
  element("saving").dataset.level = saved === null ? "none" : saved < 0 ? "bad" : "good";
  element("saving").title = run.facts.definitions?.energy_saved ?? "";
  const done = run.reference.lastTime ?? 0;
  const percent = duration ? Math.floor((100 * done) / duration) : 0;
  const isWhole = run.end.ended && saving?.time_s === player.last;
  const computing = state === "computing" ? `; reference car: ${percent} % computed` : "";
  element("saved-note").textContent = {
    none: "no reference car",
    failed: `no reference car: ${reason}`,
  }[state] ?? (saving === null
    ? `reference car (strategy ${strategy}): ${percent} % computed`
    : `after ${shown(saving.time_s, 0)} s${isWhole ? ", the whole trip" : ""}, against ${car}; ${saving.energy.as_driven}${computing}`);
  element("saved-others").textContent = saving?.others ?? "";
  const progress = element("reference-progress");
  progress.hidden = state !== "computing";
  progress.value = duration ? done / duration : 0;
  for (const figure of FIGURES) {
    const [value, note, isBad] = figure.of(run, time);
    const isRough = figure.isSum && run.rows.isSampled && value !== null;
    figure.node.textContent = `${isRough ? "≈ " : ""}${shown(value, figure.digits)}`;
    figure.note.textContent = note;
    figure.box.dataset.level = isBad ? "bad" : "";
    figure.box.title = run.facts.definitions?.[figure.key] ?? "";
  }
}

function drawTiles() {
  const time = readingTime();
  const row = run.rows.indexAt(time);
  for (const tile of TILES) {
    const value = tile.of(run.rows, time);
    tile.box.hidden = value === null && run.rows.times.length > 0;
    const broken = tile.broken.filter((limit) => run.broken?.[limit]?.[row]);
    tile.node.textContent = shown(value, tile.digits);
    tile.note.textContent = broken.join(", ");
    tile.box.dataset.level = broken.length ? "bad" : "";
  }
}

function drawTransport() {
  const [first, last, now] = [player.first, player.last, player.now ?? 0];
  const range = element("position");
  [range.min, range.max, range.value] = [first, Math.max(last, first + 1), now];
  range.setAttribute("aria-valuetext", `${now.toFixed(1)} s`);
  const total = run.end.ended ? last : (run.facts.duration_s ?? null);
  element("clock").textContent = `${readingTime()?.toFixed(1) ?? "–"}${total === null ? "" : ` / ${total.toFixed(0)}`} s`;
  const isRunning = player.mode === "playing" || (player.mode === "live" && !run.end.ended);
  element("play").textContent = isRunning ? "❚❚" : "▶";
  element("play").setAttribute("aria-label", isRunning ? "pause" : "play");
  const texts = run.events.slice(0, EVENTS_LISTED).map(({ from, text }) => `${from.toFixed(0)} s: ${text}`);
  const label = texts.length ? texts.join("; ") : "none";
  element("event-row").setAttribute("aria-label", `interventions and broken limits: ${label}`);
  const content = { events: run.events, range: [first, Math.max(last, first + 1)], now: player.now, inset: THUMB_PX };
  drawEventRow(element("event-row"), content, shownWith.colors);
}

function drawAll() {
  isDirty = false;
  document.body.dataset.empty = String(run.rows.lastTime === null);
  drawHeadline();
  drawTransport();
  drawTiles();
  const range = timeRange();
  PANELS.forEach((panel) => drawPanel(panel, range));
  drawRoad();
  drawEvents(run, player, readingTime());
  // State for programs that wait for the picture, such as tests.
  document.body.dataset.rows = String(run.rows.times.length);
  document.body.dataset.ended = String(Boolean(run.end.ended));
  document.body.dataset.reference = run.referenceState.state;
  document.body.dataset.player = player.mode;
}
