// The page: follows the server's events and what the reader does.

import { themeColors } from "./charts.js";
import { build, drawStatuses, element } from "./diagnostics.js";
import { player, redraw, run, shownWith, THUMB_PX } from "./draw.js";
import { PANELS } from "./panels.js";

const STEP_S = 1;
const LONG_STEP_S = 10;
let isClosed = false;
/** Everything about a run that the page itself holds; null where a server has it. */
const stored = element("stored");

function setStatus(text, level) {
  element("connection").textContent = text;
  element("connection").dataset.level = level;
}

function sayState() {
  if (stored) setStatus("stored run", "good");
  else if (isClosed) setStatus(run.end.ended ? "trip ended; view closed, replay works" : "view closed", "warn");
  else if (events.readyState !== EventSource.OPEN) setStatus("not connected, trying again", "warn");
  else if (run.rows.lastTime === null) setStatus(run.end.ended ? "trip ended, reading its bag" : "waiting for a run", "warn");
  else if (run.silentSince(run.rows.lastTime) !== null) {
    const since = run.silentSince(run.rows.lastTime).toFixed(0);
    setStatus(`${run.end.ended ? "trip ended" : "live"}; no decision since ${since} s`, "warn");
  } else if (run.end.ended) setStatus(player.mode === "playing" ? "replay" : "trip ended", "good");
  else setStatus(player.mode === "live" ? "live" : "live, shown later", "good");
}

// --- events of the server

const HANDLERS = {
  vehicles: ({ names, shown: vehicle }) => {
    element("vehicle").replaceChildren();
    for (const name of names) build("option", element("vehicle"), { value: name }, name);
    element("vehicle").value = vehicle;
    element("vehicle-choice").hidden = false;
  },
  trip: () => run.clear(),
  facts: (facts) => {
    run.set("facts", facts);
    element("title").textContent = facts.title;
    element("source").textContent = facts.source;
    element("waiting-text").textContent = facts.waiting;
    drawStatuses(run);
  },
  statuses: (statuses) => {
    run.statuses = statuses;
    drawStatuses(run);
  },
  rows: (rows) => {
    const isFirst = run.rows.lastTime === null;
    run.addRows(rows);
    drawStatuses(run);
    if (isFirst && run.play) {
      player.speed = run.play.rate;
      showSpeed();
      player.play();
      player.seek(player.first + run.play.start_s);
    }
  },
  plans: (plans) => run.plans.push(...plans),
  events: (changes) => run.addChanges(changes),
  savings: (entries) => run.savings.push(...entries),
  reference: (rows) => run.reference.add(rows),
  reference_state: (state) => run.set("referenceState", state),
  road: (road) => { run.road = road; },
  play: (play) => { run.play = play; },
  end: (end) => { run.end = end; },
  closing: () => {
    isClosed = true;
    events.close();
  },
};

function take(kind, content) {
  HANDLERS[kind](content);
  sayState();
  redraw();
}

const events = stored ? null : new EventSource(`events${window.location.search}`);
if (stored) JSON.parse(stored.textContent).forEach(([kind, content]) => take(kind, content));
for (const kind of stored ? [] : Object.keys(HANDLERS)) {
  events.addEventListener(kind, (event) => take(kind, JSON.parse(event.data)));
}
for (const kind of ["open", "error"]) events?.addEventListener(kind, sayState);
player.onMode = sayState;

// --- what the reader does

function showSpeed() {
  const choice = element("speed");
  const value = String(player.speed);
  if (![...choice.options].some((option) => option.value === value)) build("option", choice, { value }, `${value} ×`);
  choice.value = value;
}

element("play").addEventListener("click", () => player.toggle());
element("to-start").addEventListener("click", () => player.seek(player.first));
element("to-end").addEventListener("click", () => player.follow());
element("position").addEventListener("input", (event) => player.seek(Number(event.target.value)));
element("speed").addEventListener("change", (event) => { player.speed = Number(event.target.value); });
element("window").addEventListener("change", redraw);
element("vehicle").addEventListener("change", (event) => {
  window.location.search = new URLSearchParams({ vehicle: event.target.value });
});

for (const panel of PANELS) {
  const timeAt = (event) => {
    if (!panel.box) return null;
    const share = (event.offsetX - panel.box.left) / (panel.box.right - panel.box.left);
    return panel.range[0] + Math.min(1, Math.max(0, share)) * (panel.range[1] - panel.range[0]);
  };
  panel.canvas.addEventListener("pointermove", (event) => {
    shownWith.pointed = timeAt(event);
    redraw();
  });
  panel.canvas.addEventListener("pointerleave", () => {
    shownWith.pointed = null;
    redraw();
  });
  panel.canvas.addEventListener("click", (event) => player.seek(timeAt(event) ?? 0));
}

element("event-row").addEventListener("click", (event) => {
  const share = (event.offsetX - THUMB_PX) / (event.target.clientWidth - 2 * THUMB_PX);
  player.seek(player.first + share * (player.last - player.first));
});

const KEYS = {
  " ": () => player.toggle(),
  Home: () => player.seek(player.first),
  End: () => player.follow(),
  ArrowLeft: (event) => player.seek((player.now ?? 0) - (event.shiftKey ? LONG_STEP_S : STEP_S)),
  ArrowRight: (event) => player.seek((player.now ?? 0) + (event.shiftKey ? LONG_STEP_S : STEP_S)),
};
window.addEventListener("keydown", (event) => {
  const isControl = event.target.closest("input, select, button, summary");
  if (!KEYS[event.key] || isControl || event.ctrlKey || event.altKey || event.metaKey) return;
  event.preventDefault();
  KEYS[event.key](event);
});

// Panels also change their size where the window keeps it, as when legends need another line.
new ResizeObserver(redraw).observe(element("panels"));
window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  shownWith.colors = themeColors();
  redraw();
});

// State of the page, for tests and for the browser console.
window.iptmRun = run;
window.iptmPlayer = player;
redraw();
