// What is shown of a run: headline, tiles with the values at the cursor, and panels of curves.

import { difference } from "./run.js";

const KM_H = 3.6;
const KW = 1e-3;
const PPM = 1e6;

function scaled(value, factor) {
  return value === null || value === undefined ? null : factor * value;
}

/** A number with fixed digits, or a dash where there is none. */
export function shown(value, digits) {
  return value === null || value === undefined || !Number.isFinite(value) ? "–" : value.toFixed(digits);
}

function consumption(kind, digits) {
  return (run, time) => {
    const own = run.consumption(run.rows, kind, time);
    const other = run.consumption(run.reference, kind, run.comparedUntil(time));
    return [own, other === null ? "" : `other car ${other.toFixed(digits)}`];
  };
}

/** Figures of the trip up to the cursor, in addition to the saving: [value, note, whether it is bad]. */
export const FIGURES = [
  { id: "energy", key: "consumption", label: "energy from the battery", unit: "kWh/100 km", digits: 1, isSum: true, of: consumption("battery", 1) },
  { id: "cooling", key: "cooling_energy", label: "of which the compressor", unit: "kWh/100 km", digits: 2, isSum: true, of: consumption("compressor", 2) },
  {
    id: "margin", key: "smallest_margin", label: "smallest distance above s_min", unit: "m", digits: 2,
    of: (run, time) => {
      const least = run.rows.at("least_margin_m", time);
      const isBroken = least !== null && run.facts.limits && least < -run.facts.limits.gap_tolerance_m;
      const since = run.rows.column("least_margin_m").indexOf(least);
      const first = run.rows.times[0] ?? 0;
      const known = first > 0 ? `, since ${first.toFixed(0)} s` : "";
      const when = least === null ? "" : `at ${run.rows.times[since].toFixed(0)} s${known}`;
      return [least, isBroken ? `limit broken, ${when}` : when, isBroken];
    },
  },
  {
    id: "events", label: "interventions and broken limits", unit: "", digits: 0,
    of: (run, time) => {
      const past = run.events.filter(({ from, isNotice }) => from <= time && !isNotice);
      return [past.length, past.length ? past[past.length - 1].text : "", past.some(({ level }) => level === "bad")];
    },
  },
];

/** Values at the cursor: [value, word where a limit is broken]. */
export const TILES = [
  { id: "speed", label: "speed", unit: "km/h", digits: 1, of: (rows, time) => scaled(rows.at("speed_m_s", time), KM_H), broken: ["speed above its limit"] },
  { id: "gap", label: "gap to the leader", unit: "m", digits: 2, of: (rows, time) => rows.at("gap_m", time), broken: ["gap above s_max"] },
  { id: "margin", label: "above s_min", unit: "m", digits: 2, of: (rows, time) => difference(rows.at("gap_m", time), rows.at("min_gap_m", time)), broken: ["gap below s_min"] },
  { id: "battery", label: "battery power", unit: "kW", digits: 2, of: (rows, time) => scaled(rows.at("battery_power_w", time), KW), broken: [] },
  { id: "compressor", label: "compressor", unit: "kW", digits: 3, of: (rows, time) => scaled(rows.at("compressor_power_w", time), KW), broken: [] },
  { id: "cell_n", label: "warmest cell", unit: "°C", digits: 2, of: (rows, time) => rows.at("cell_n_temperature_c", time), broken: ["cell above its limit"] },
];

function reference(column, factor) {
  return { label: "other car", color: "purple", dash: [6, 4], width: 1.4, table: "reference", column, factor };
}

/**
 * Panels of curves. A line has a column (or `of`, which computes a curve), a factor into the unit of the panel, and
 * where the plan has it, its column there, and that of its worst case; one that `holds` keeps its value between nodes. `broken` names the limits
 * of `Run.brokenRows` that hold for it. A limit has the colour of the curve that it holds for.
 */
export const PANELS = [
  {
    id: "aging", title: "Cyclic ageing, both cells", unit: "ppm of nominal capacity", digits: 3,
    axis: { low: 0, span: 1e-2 },
    lines: [
      { ...reference("capacity_loss", PPM), of: (run) => run.referenceLoss() },
      { label: "this car", color: "red", width: 2.2, column: "capacity_loss", of: (run) => run.ownLoss(), factor: PPM },
    ],
  },
  {
    id: "speed", title: "Speed", unit: "km/h", digits: 1, axis: { low: 0, span: 20 },
    lines: [
      { label: "leader", color: "grey", column: "leader_speed_m_s", factor: KM_H },
      reference("speed_m_s", KM_H),
      { label: "this car", color: "blue", column: "speed_m_s", factor: KM_H, plan: "speed_m_s", broken: ["speed above its limit"] },
    ],
    limits: [{ key: "max_speed_m_s", factor: KM_H, color: "blue", label: "limit of this car" }],
  },
  {
    id: "gap", title: "Gap to the leader", unit: "m", digits: 2, axis: { low: 0, span: 30 },
    band: { low: "s_min", high: "max_gap_m", label: "allowed: s_min to" },
    lines: [
      { label: "s_min", color: "red", column: "min_gap_m", factor: 1, width: 1.1 },
      reference("gap_m", 1),
      { label: "this car", color: "blue", column: "gap_m", factor: 1, plan: "gap_m", worst: "smallest_gap_m", broken: ["gap below s_min", "gap above s_max"] },
    ],
  },
  {
    id: "temperature", title: "Cell temperatures", unit: "°C", digits: 2, axis: { span: 2 },
    band: { low: "min_temperature_c", high: "max_temperature_c", label: "allowed for cells:" },
    lines: [
      { ...reference("cell_n_temperature_c", 1), label: "other car, cell N" },
      { label: "cell 1", color: "blue", column: "cell_1_temperature_c", factor: 1, plan: "cell_1_temperature_c", broken: ["cell above its limit"] },
      { label: "cell N", color: "red", column: "cell_n_temperature_c", factor: 1, width: 2.2, plan: "cell_n_temperature_c", broken: ["cell above its limit"] },
    ],
  },
  {
    id: "cooling", title: "Cooling", unit: "kW", digits: 3, axis: { low: 0, span: 0.5 },
    lines: [
      { label: "heat to the chiller", color: "green", column: "chiller_heat_w", factor: KW },
      { ...reference("compressor_power_w", KW), label: "compressor of the other car" },
      { label: "compressor", color: "orange", column: "compressor_power_w", factor: KW, plan: "compressor_power_w", holds: true },
    ],
    limits: [{ key: "max_compressor_power_w", factor: KW, color: "orange", label: "compressor limit" }],
  },
  {
    id: "coolant", title: "Coolant", unit: "°C", digits: 2, axis: { span: 2 },
    lines: [
      { label: "into the pack", color: "sky", column: "coolant_inlet_temperature_c", factor: 1 },
      { label: "out of it", color: "green", column: "coolant_outlet_temperature_c", factor: 1 },
    ],
  },
  {
    id: "driving", title: "Power, drawn from the battery: positive", unit: "kW", digits: 2, axis: { span: 5 },
    lines: [
      { label: "battery", color: "sky", column: "battery_power_w", factor: KW, width: 2.8 },
      { label: "traction", color: "red", column: "traction_power_w", factor: KW, width: 1.1 },
    ],
  },
  {
    id: "solver", title: "Time of a solve", unit: "ms", digits: 2, axis: { low: 0, span: 1 },
    lines: [{ label: "solve", color: "blue", column: "solve_time_s", factor: 1e3, width: 1.1 }],
  },
];

/** The road is drawn over position, around the cars, where it is not flat. */
export const ROAD = {
  id: "road", title: "Height of the road, both cars on it", unit: "m", digits: 2, axis: { span: 4 },
  behindM: 300, aheadM: 900, flatM: 0.5,
  lines: [
    { label: "this car", color: "blue", column: "position_m", side: "left" },
    { label: "leader", color: "grey", column: "leader_position_m", side: "right" },
  ],
};
