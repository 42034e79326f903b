// The panel of events and diagnostics.

import { shown } from "./panels.js";

const EVENTS_LISTED = 50;
export const element = (id) => document.getElementById(id);

export function build(tag, parent, attributes = {}, text = "") {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text) made.textContent = text;
  parent.append(made);
  return made;
}

/** Events, each a button to its time, and how the decision of a time came about. */
export function drawEvents(run, player, time) {
  listEvents(run, player);
  drawDecision(run, time);
}

let listed = "";

function listEvents(run, player) {
  const key = JSON.stringify(run.events);
  if (key === listed) return;
  listed = key;
  element("events").replaceChildren();
  for (const { from, to, level, text } of run.events.slice(-EVENTS_LISTED)) {
    const lasting = to > from ? ` to ${to.toFixed(0)}` : "";
    const button = build("button", build("li", element("events")), { type: "button", "data-level": level });
    button.textContent = `${from.toFixed(0)}${lasting} s: ${text}`;
    button.addEventListener("click", () => player.seek(from));
  }
}

function drawDecision(run, time) {
  const [status, rung] = [run.rows.at("status_code", time), run.rows.at("fallback_rung", time)];
  const since = run.silentSince(time);
  element("decision").dataset.level = since === null ? "" : "silent";
  if (since !== null) element("decision").textContent = `no decision since ${since.toFixed(0)} s`;
  if (status === null || since !== null) return;
  const limited = run.rows.at("limiter_active", time) ? "; the limiter changed the command" : "";
  const age = shown(run.rows.at("preview_age_s", time), 1);
  element("decision").textContent =
    `solver: ${run.facts.statuses[status]} after ${run.rows.at("iterations", time)} iterations; ` +
    `command from: ${run.facts.rungs[rung]}${limited}; preview ${age} s old`;
}

/** Age of a status that is older than twice the longest time between two of a node; null where not, or not known. */
export function silence(now, heard, every, step) {
  if (now === null || !Number.isFinite(heard) || !every) return null;
  const usual = Math.max(every, Number.isFinite(step) ? step : 0);
  return now - heard > 2 * usual ? now - heard : null;
}

const shownStatuses = new Map();

export function drawStatuses(run) {
  const { statuses } = run.statuses;
  // Nodes report by wall time, all as often: a fast trip may hear each of them once.
  const every = Math.max(0, ...statuses.map((status) => status.every_s ?? 0));
  for (const { name, level: stated, reason, values, heard_s: heard } of statuses) {
    const age = silence(run.rows.lastTime, heard, every, run.rows.shortestStep);
    const level = age === null ? stated : `silent for ${age.toFixed(0)} s`;
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
    nodes.badge.dataset.level = age === null ? level : "silent";
    nodes.text.dataset.level = nodes.badge.dataset.level;
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
