// What is shown of a run: tiles with the newest values, and panels of curves. Columns are those of the feed.

import { interpolate } from "./charts.js";

const KM_H = 3.6;
const KW = 1e-3;

/** Tiles at the head of the page: label, unit, digits, and the value in the newest row. */
export const TILES = [
  { id: "time", label: "trip time", unit: "s", digits: 1, value: (run) => run.newest("time_s") },
  { id: "speed", label: "speed", unit: "km/h", digits: 1, value: (run) => scaled(run.newest("speed_m_s"), KM_H) },
  { id: "gap", label: "gap to the leader", unit: "m", digits: 2, value: (run) => run.newest("gap_m") },
  { id: "margin", label: "above s_min", unit: "m", digits: 2, value: (run) => difference(run.newest("gap_m"), run.newest("min_gap_m")) },
  { id: "battery", label: "battery power", unit: "kW", digits: 2, value: (run) => scaled(run.newest("battery_power_w"), KW) },
  { id: "compressor", label: "compressor", unit: "kW", digits: 3, value: (run) => scaled(run.newest("compressor_power_w"), KW) },
  { id: "cell_n", label: "warmest cell", unit: "°C", digits: 2, value: (run) => run.newest("cell_n_temperature_c") },
  { id: "solve", label: "solve", unit: "ms", digits: 2, value: (run) => scaled(run.newest("solve_time_s"), 1e3) },
  { id: "saved", label: "aging saved", unit: "%", digits: 1, value: (run) => run.lifeSaved() },
];

/**
 * Panels of curves. A line has a column of the rows (or `of`, which computes one), a factor into the unit of the
 * panel, and where the plan has it, the column of the plan; one that `holds` keeps its value between nodes.
 */
export const PANELS = [
  {
    id: "speed", title: "Speed", unit: "km/h", digits: 1, axis: { low: 0, span: 20 },
    lines: [
      { label: "leader", color: "grey", column: "leader_speed_m_s", factor: KM_H },
      { label: "host", color: "blue", column: "speed_m_s", factor: KM_H, plan: "speed_m_s" },
    ],
    limits: [{ key: "max_speed_m_s", factor: KM_H, label: "limit" }],
  },
  {
    id: "gap", title: "Gap to the leader", unit: "m", digits: 2, axis: { low: 0, span: 30 },
    lines: [
      { label: "s_min", color: "red", column: "min_gap_m", factor: 1, width: 1.1 },
      { label: "gap", color: "blue", column: "gap_m", factor: 1, plan: "gap_m" },
    ],
    limits: [{ key: "max_gap_m", factor: 1, label: "s_max" }],
  },
  {
    id: "driving", title: "Driving power, positive: drawn from the pack", unit: "kW", digits: 2, axis: { span: 5 },
    lines: [
      { label: "battery", color: "sky", column: "battery_power_w", factor: KW, width: 2.6 },
      { label: "traction", color: "red", column: "traction_power_w", factor: KW, width: 1.1 },
    ],
  },
  {
    id: "cooling", title: "Cooling power", unit: "kW", digits: 3, axis: { low: 0, span: 0.5 },
    lines: [
      { label: "heat to the chiller", color: "green", column: "chiller_heat_w", factor: KW },
      { label: "compressor", color: "orange", column: "compressor_power_w", factor: KW, plan: "compressor_power_w", holds: true },
    ],
    limits: [{ key: "max_compressor_power_w", factor: KW, label: "compressor limit" }],
  },
  {
    id: "temperature", title: "Temperatures", unit: "°C", digits: 2, axis: { span: 2 },
    lines: [
      { label: "coolant in", color: "grey", column: "coolant_inlet_temperature_c", factor: 1, width: 1.1 },
      { label: "coolant out", color: "purple", column: "coolant_outlet_temperature_c", factor: 1, width: 1.1 },
      { label: "cell 1", color: "blue", column: "cell_1_temperature_c", factor: 1, plan: "cell_1_temperature_c" },
      { label: "cell N", color: "red", column: "cell_n_temperature_c", factor: 1, width: 2.3, plan: "cell_n_temperature_c" },
    ],
    limits: [
      { key: "min_temperature_c", factor: 1, label: "limit" },
      { key: "max_temperature_c", factor: 1, label: "limit" },
    ],
  },
  {
    id: "aging", title: "Battery life lost on this trip, both cells", unit: "10⁻⁵", digits: 4,
    axis: { low: 0, span: 1e-3 },
    lines: [
      { label: "reference car", color: "grey", of: (run) => run.referenceLoss(), factor: 1e5, dash: [6, 4] },
      { label: "this car", color: "red", of: (run) => run.ownLoss(), factor: 1e5 },
    ],
  },
  {
    id: "solver", title: "Time of a solve; dots: fallback", unit: "ms", digits: 2, axis: { low: 0, span: 1 },
    lines: [{ label: "solve", color: "blue", column: "solve_time_s", factor: 1e3, width: 1.1 }],
    marks: (run) => run.times
      .filter((_, k) => run.column("fallback_rung")[k] > 0)
      .map((x) => ({ x, color: "bad" })),
  },
];

/** The road is drawn over position, around the cars. */
export const ROAD = {
  id: "road", title: "Height of the road, both cars on it", unit: "m", digits: 2, axis: { span: 4 },
  behindM: 300, aheadM: 900,
};

function scaled(value, factor) {
  return value === null || value === undefined ? null : factor * value;
}

function difference(first, second) {
  return first === null || second === null || first === undefined || second === undefined ? null : first - second;
}

/** A number with fixed digits, or a dash where there is none. */
export function shown(value, digits) {
  return value === null || value === undefined ? "–" : value.toFixed(digits);
}

/** The run as the page knows it: rows by column, and the newest document of each kind. */
export class Run {
  constructor() {
    this.facts = { columns: [], limits: null, notes: [], statuses: {}, rungs: {} };
    this.plan = {};
    this.road = null;
    this.reference = null;
    this.statuses = { statuses: [], faults: [] };
    this.end = {};
    this.clear();
  }

  /** Forget the rows: another trip has begun, or the same one is told anew. */
  clear() {
    this.columns = new Map();
    this.plan = {};
    this.end = {};
  }

  column(name) {
    return this.columns.get(name) ?? [];
  }

  get times() {
    return this.column("time_s");
  }

  newest(name) {
    const values = this.column(name);
    return values.length ? values[values.length - 1] : null;
  }

  addRows(rows) {
    this.facts.columns.forEach((name, index) => {
      if (!this.columns.has(name)) this.columns.set(name, []);
      const values = this.columns.get(name);
      for (const row of rows) values.push(row[index]);
    });
  }

  /** Capacity lost since the start; where the cells' first state is not known, since the first row. */
  ownLoss() {
    const values = this.column("capacity_loss");
    const first = this.facts.initial_capacity_loss ?? values.find((value) => value !== null);
    return { xs: this.times, ys: values.map((value) => (value === null ? null : value - first)) };
  }

  referenceLoss() {
    const { time_s: xs = [], capacity_loss: values = [] } = this.reference ?? {};
    return { xs, ys: values.map((value) => value - values[0]) };
  }

  /** Battery life that this car has saved so far against the reference car, in percent. */
  lifeSaved() {
    const values = this.column("capacity_loss");
    const { xs, ys } = this.referenceLoss();
    const reference = this.times.length ? interpolate(this.newest("time_s"), xs, ys) : null;
    const first = this.facts.initial_capacity_loss ?? values.find((value) => value !== null);
    const newest = this.newest("capacity_loss");
    return reference && newest !== null ? 100 * (1 - (newest - first) / reference) : null;
  }
}
