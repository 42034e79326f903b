// The page: follows the server's events and draws what has changed, at most once per frame of the screen.

import { drawChart, interpolate, themeColors } from "./charts.js";
import { PANELS, ROAD, Run, shown, TILES } from "./panels.js";

const PLAN_AHEAD_S = 30;
const AUTO_WINDOW_S = 120;

const run = new Run();
const element = (id) => document.getElementById(id);
let colors = themeColors();
let isDirty = false;

// --- build

function build(tag, parent, attributes = {}, text = "") {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text) made.textContent = text;
  parent.append(made);
  return made;
}

for (const tile of TILES) {
  const box = build("div", element("tiles"));
  build("dt", box, {}, tile.label);
  const value = build("dd", box);
  tile.node = build("span", value, { id: `tile-${tile.id}` }, "–");
  build("small", value, {}, ` ${tile.unit}`);
}

function buildPanel(panel, lines) {
  const section = build("section", element("panels"), { class: "panel", id: `panel-${panel.id}` });
  build("h2", section, {}, `${panel.title} (${panel.unit})`);
  const legend = build("ul", section, { class: "legend" });
  for (const line of lines) {
    const item = build("li", legend);
    const swatch = build("i", item, { "aria-hidden": "true" });
    swatch.style.borderTopColor = `var(--${line.color})`;
    swatch.style.borderTopStyle = line.dash ? "dashed" : "solid";
    item.append(`${line.label} `);
    line.node = build("b", item, { id: `value-${panel.id}-${line.label.replaceAll(" ", "-")}` }, "–");
  }
  panel.canvas = build("canvas", section, { role: "img", "aria-label": panel.title });
}

const CARS = [
  { label: "host", color: "blue", column: "position_m", side: "left" },
  { label: "leader", color: "grey", column: "leader_position_m", side: "right" },
];
PANELS.forEach((panel) => buildPanel(panel, panel.lines));
buildPanel(ROAD, CARS);
element("panels").append(element("status-panel"));

// --- draw

function timeRange() {
  const { times } = run;
  if (!times.length) return [0, 60];
  const [first, last] = [times[0], times[times.length - 1]];
  const choice = element("window").value;
  const isWhole = choice === "whole" || (choice === "auto" && run.end.ended);
  if (isWhole) return [first, Math.max(last, first + 1)];
  const length = choice === "auto" ? AUTO_WINDOW_S : Number(choice);
  const begin = Math.max(first, last - length);
  return [begin, Math.max(last, begin + Math.min(length, 30)) + PLAN_AHEAD_S];
}

/** Where a curve stands at the newest row; one of another car is read at the same time. */
function newestValue({ xs, ys }) {
  const now = run.newest("time_s");
  if (now === null) return null;
  return xs === run.times ? ys[ys.length - 1] : interpolate(now, xs, ys);
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

function drawPanel(panel, range) {
  const lines = [];
  const said = [];
  for (const line of panel.lines) {
    const curve = line.of ? line.of(run) : { xs: run.times, ys: run.column(line.column) };
    const values = line.factor === 1 ? curve.ys : curve.ys.map((y) => (y === null ? null : line.factor * y));
    lines.push({ xs: curve.xs, ys: values, color: line.color, width: line.width, dash: line.dash });
    if (line.plan && run.plan[line.plan]) {
      const ahead = run.plan[line.plan].map((y) => (y === null ? null : line.factor * y));
      const curve = line.holds ? stepped(run.plan.time_s, ahead) : { xs: run.plan.time_s, ys: ahead };
      lines.push({ ...curve, color: line.color, dash: [3, 3], width: 1.5 });
    }
    const newest = newestValue(curve);
    const text = shown(newest === null || newest === undefined ? null : line.factor * newest, panel.digits);
    line.node.textContent = text;
    said.push(`${line.label} ${text}`);
  }
  const limits = (panel.limits ?? [])
    .filter(({ key }) => run.facts.limits)
    .map(({ key, factor, label }) => {
      const value = factor * run.facts.limits[key];
      return { value, label: `${label} ${Number(value.toPrecision(4))} ${panel.unit}` };
    });
  const marks = panel.marks ? panel.marks(run) : [];
  drawChart(panel.canvas, panel.axis, { lines, limits, marks, range, now: run.newest("time_s"), xUnit: "s" }, colors);
  describe(panel, said);
}

function drawRoad() {
  const host = run.newest("position_m") ?? 0;
  const { position_m: xs = [0, 1], height_m: ys = [0, 0] } = run.road ?? {};
  const heightAt = (x) => interpolate(x, xs, ys) ?? (x < xs[0] ? ys[0] : ys[ys.length - 1]);
  const range = [Math.max(xs[0], host - ROAD.behindM), host + ROAD.aheadM];
  const marks = [];
  for (const car of CARS) {
    const position = run.newest(car.column);
    car.node.textContent = position === null ? "–" : `at ${position.toFixed(0)} m`;
    if (position !== null && position !== undefined) {
      marks.push({ x: position, y: heightAt(position), color: car.color, label: car.label, side: car.side });
    }
  }
  const line = { xs: [...xs, xs[xs.length - 1] + 1e5], ys: [...ys, ys[ys.length - 1]], color: "green", width: 2.2 };
  drawChart(ROAD.canvas, ROAD.axis, { lines: [line], marks, range, xUnit: "m" }, colors);
  describe(ROAD, CARS.map((car) => `${car.label} ${car.node.textContent}`));
}

function describe(panel, said) {
  panel.canvas.setAttribute("aria-label", `${panel.title} (${panel.unit}); now: ${said.join(", ")}`);
}

function drawTiles() {
  for (const tile of TILES) tile.node.textContent = shown(tile.value(run), tile.digits);
}

function drawDecision() {
  const [status, rung] = [run.newest("status_code"), run.newest("fallback_rung")];
  if (status === null || status === undefined) return;
  const limited = run.newest("limiter_active") ? "; the limiter changed the command" : "";
  const age = shown(run.newest("preview_age_s"), 1);
  element("decision").textContent =
    `solver: ${run.facts.statuses[status]} after ${run.newest("iterations")} iterations; ` +
    `command from: ${run.facts.rungs[rung]}${limited}; preview ${age} s old`;
}

const shownStatuses = new Map();

function drawStatuses() {
  for (const { name, level, reason, values } of run.statuses.statuses) {
    if (!shownStatuses.has(name)) {
      const details = build("details", build("li", element("statuses")));
      const summary = build("summary", details);
      const badge = build("span", summary, { class: "level" });
      shownStatuses.set(name, {
        badge, text: build("span", summary), table: build("tbody", build("table", details)),
      });
    }
    const nodes = shownStatuses.get(name);
    nodes.badge.textContent = level;
    nodes.badge.dataset.level = level;
    nodes.text.textContent = ` ${name}: ${reason}`;
    nodes.table.replaceChildren();
    for (const [key, value] of Object.entries(values)) {
      const row = build("tr", nodes.table);
      build("td", row, {}, key);
      build("td", row, {}, value);
    }
  }
  element("notes").replaceChildren();
  const foxglove = run.facts.foxglove ? [`Foxglove or Lichtblick: open a connection to ${run.facts.foxglove}`] : [];
  for (const text of [...run.facts.notes, ...run.statuses.faults, ...foxglove]) build("li", element("notes"), {}, text);
}

function drawAll() {
  isDirty = false;
  drawTiles();
  const range = timeRange();
  PANELS.forEach((panel) => drawPanel(panel, range));
  drawRoad();
  drawDecision();
  // For whoever waits for the picture, such as a test: what is drawn, and whether more will come.
  document.body.dataset.rows = String(run.times.length);
  document.body.dataset.ended = String(Boolean(run.end.ended || run.end.paused));
  document.body.dataset.reference = String(run.reference !== null);
}

function redraw() {
  if (isDirty) return;
  isDirty = true;
  requestAnimationFrame(drawAll);
}

// --- events

function say(text, level) {
  element("connection").textContent = text;
  element("connection").dataset.level = level;
}

function sayState() {
  if (run.end.ended) say("trip ended", "good");
  else if (run.times.length) say("live", "good");
  else say("waiting for a run", "warn");
}

const HANDLERS = {
  vehicles: ({ names, shown: vehicle }) => {
    element("vehicle").replaceChildren();
    for (const name of names) build("option", element("vehicle"), { value: name }, name);
    element("vehicle").value = vehicle;
    element("vehicle-choice").hidden = false;
  },
  trip: () => run.clear(),
  facts: (facts) => {
    run.facts = facts;
    element("title").textContent = facts.title;
    element("source").textContent = facts.source;
    drawStatuses();
  },
  statuses: (statuses) => {
    run.statuses = statuses;
    drawStatuses();
  },
  rows: (rows) => run.addRows(rows),
  plan: (plan) => { run.plan = plan; },
  road: (road) => { run.road = road; },
  reference: (reference) => { run.reference = reference; },
  end: (end) => { run.end = end; },
};

const events = new EventSource(`events${window.location.search}`);
for (const [kind, handle] of Object.entries(HANDLERS)) {
  events.addEventListener(kind, (event) => {
    handle(JSON.parse(event.data));
    sayState();
    redraw();
  });
}
events.addEventListener("open", sayState);
events.addEventListener("error", () => say("not connected, trying again", "warn"));

element("window").addEventListener("change", redraw);
element("vehicle").addEventListener("change", (event) => {
  window.location.search = new URLSearchParams({ vehicle: event.target.value });
});
window.addEventListener("resize", redraw);
window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  colors = themeColors();
  redraw();
});

// What the page knows, for its tests and for the curious in the console.
window.iptmRun = run;
redraw();
