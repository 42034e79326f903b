// The data of a run: rows by column with what follows from them, the reference car, plans and events.

import { lowerIndex } from "./charts.js";

const SAME_INSTANT_S = 1e-6;
const SHORTEST_DISTANCE_M = 100;
// Numbers of CommandSource other than the answer.
const SOURCES = [
  [1, "warn", "no command in time: an earlier one is held"],
  [2, "bad", "no command in time: vehicle stops"],
];

/** Rows by column; sums and extremes are kept up to date as rows arrive. */
class Table {
  constructor(names = []) {
    this.names = names;
    this.columns = new Map([...names, "battery_energy_j", "compressor_energy_j", "least_margin_m"].map((name) => [name, []]));
    this.longestStep = 0;
    this.shortestStep = Infinity;
  }

  add(rows) {
    for (const row of rows) {
      const last = this.times.length - 1;
      this.names.forEach((name, index) => this.column(name).push(row[index]));
      const step = last < 0 ? 0 : this.times[last + 1] - this.times[last];
      if (step > 0) {
        this.longestStep = Math.max(this.longestStep, step);
        this.shortestStep = Math.min(this.shortestStep, step);
      }
      for (const kind of ["battery", "compressor"]) {
        // A power is the mean over the interval that ends at its row.
        const energies = this.column(`${kind}_energy_j`);
        energies.push((last < 0 ? 0 : energies[last]) + step * (this.column(`${kind}_power_w`)[last + 1] ?? 0));
      }
      const margins = this.column("least_margin_m");
      const margin = difference(this.column("gap_m")[last + 1], this.column("min_gap_m")[last + 1]) ?? Infinity;
      margins.push(Math.min(last < 0 ? Infinity : margins[last], margin));
    }
  }

  column(name) {
    return this.columns.get(name) ?? [];
  }

  get times() {
    return this.column("time_s");
  }

  get lastTime() {
    return this.times.length ? this.times[this.times.length - 1] : null;
  }

  /** Whether rows are missing between others, as of a run that is faster than the page. */
  get isSampled() {
    return this.longestStep > 1.5 * this.shortestStep;
  }

  /** Index of the newest row at a time, -1 before the first one. */
  indexAt(time) {
    return time === null ? -1 : lowerIndex(this.times, time + SAME_INSTANT_S) - 1;
  }

  /** Value at a time, held from the row before; null where there is none. */
  at(name, time) {
    const value = this.column(name)[this.indexAt(time)];
    return value === undefined || !Number.isFinite(value) ? null : value;
  }

  has(name) {
    return this.column(name).some((value) => value !== null);
  }
}

export class Run {
  constructor() {
    this.facts = { columns: [], limits: null, notes: [], statuses: {}, rungs: {}, waiting: "" };
    this.road = null;
    this.referenceState = { state: "none", columns: [] };
    this.statuses = { statuses: [], faults: [] };
    this.clear();
  }

  /** Forget all rows: another trip has begun, or everything is sent again. */
  clear() {
    this.rows = new Table(this.facts.columns);
    this.reference = new Table(this.referenceState.columns);
    this.plans = [];
    this.changes = [];
    this.savings = [];
    this.end = {};
    this.events = [];
  }

  set(kind, document) {
    if (kind === "facts" && document.columns.join() !== this.rows.names.join()) this.rows = new Table(document.columns);
    if (kind === "referenceState" && document.columns.join() !== this.reference.names.join()) this.reference = new Table(document.columns);
    this[kind] = document;
    this.findEvents();
  }

  addRows(rows) {
    this.rows.add(rows);
    this.findEvents();
  }

  addChanges(changes) {
    this.changes.push(...changes);
    this.findEvents();
  }

  /** Plan that was made at the row of a time, null without one. */
  planAt(time) {
    const row = this.rows.indexAt(time);
    if (row < 0) return null;
    const made = this.rows.times[row];
    const plan = this.plans[lowerIndex(this.plans.map((plan) => plan.time_s[0]), made - SAME_INSTANT_S)];
    return plan && plan.time_s[0] <= made + SAME_INSTANT_S ? plan : null;
  }

  /** Time of the last decision, where the controller has been silent for more than two rows at a time; else null. */
  silentSince(time) {
    const column = this.rows.column("status_code");
    const known = (value) => value !== null && value !== undefined;
    const end = this.rows.indexAt(time);
    let last = end;
    while (last >= 0 && !known(column[last])) last -= 1;
    return last >= 0 && end - last > 2 ? this.rows.times[last] : null;
  }

  /** Rows at which a limit is broken by more than its tolerance, by limit. */
  brokenRows() {
    const { limits } = this.facts;
    if (!limits) return {};
    const over = (name, bound) => this.rows.column(name).map((value) => value !== null && value > bound);
    const hot = limits.max_temperature_c + limits.temperature_tolerance_k;
    const gaps = this.rows.column("gap_m");
    const shortest = this.rows.column("min_gap_m");
    const [first, last] = [over("cell_1_temperature_c", hot), over("cell_n_temperature_c", hot)];
    return {
      "gap below s_min": gaps.map((gap, k) => gap !== null && shortest[k] !== null && gap < shortest[k] - limits.gap_tolerance_m),
      "gap above s_max": over("gap_m", limits.max_gap_m + limits.gap_tolerance_m),
      "speed above its limit": over("speed_m_s", limits.max_speed_m_s + limits.speed_tolerance_m_s),
      "cell above its limit": last.map((isHot, k) => isHot || first[k]),
    };
  }

  /**
   * Everything that the row of events shows: {from, to, level: bad|warn, text}, sorted by time. A kind of event
   * is added here: broken limits, commands that are not from the optimal plan, braking of the safety monitor, and
   * changes of the diagnostics, of which a warning is a notice and no intervention.
   */
  findEvents() {
    const { times } = this.rows;
    const found = [];
    this.broken = this.brokenRows();
    for (const [text, rows] of Object.entries(this.broken)) {
      found.push(...spans(rows, times).map((span) => ({ ...span, level: "bad", text })));
    }
    const rungs = this.rows.column("fallback_rung");
    for (const [number, name] of Object.entries(this.facts.rungs)) {
      if (Number(number) === 0) continue;
      const level = name.includes("emergency") ? "bad" : "warn";
      const held = rungs.map((rung) => rung === Number(number));
      found.push(...spans(held, times).map((span) => ({ ...span, level, text: `intervention: ${name}` })));
    }
    const sources = this.rows.column("command_source");
    for (const [number, level, text] of SOURCES) {
      found.push(...spans(sources.map((source) => source === number), times).map((span) => ({ ...span, level, text })));
    }
    const braked = this.rows.column("service_braking_s").map((lasted) => lasted > 0);
    found.push(...spans(braked, times).map((span) => ({ ...span, level: "bad", text: "intervention: safety monitor brakes" })));
    for (const { time_s: time, level, name, reason } of this.changes) {
      const isError = level === "ERROR";
      if (level !== "OK") found.push({ from: time, to: time, level: isError ? "bad" : "warn", text: `${name}: ${reason}`, isNotice: !isError });
    }
    this.events = found.sort((one, other) => one.from - other.from);
  }

  // --- figures

  /** Newest time up to which both cars are known, at most a given one; null without a reference car. */
  comparedUntil(time) {
    const last = this.reference.lastTime;
    return last === null || time === null ? null : Math.min(time, last);
  }

  /** Capacity lost since the start; where the first state of the cells is not known, since the first row. */
  ownLoss() {
    const values = this.rows.column("capacity_loss");
    const first = this.facts.initial_capacity_loss ?? values.find((value) => value !== null);
    return { xs: this.rows.times, ys: values.map((value) => (value === null ? null : value - first)) };
  }

  referenceLoss() {
    const values = this.reference.column("capacity_loss");
    return { xs: this.reference.times, ys: values.map((value) => value - values[0]) };
  }

  /** What this car has saved against the reference car, as judged last before a time; null where not known. */
  savingAt(time) {
    if (time === null) return null;
    return this.savings[lowerIndex(this.savings.map((entry) => entry.time_s), time + SAME_INSTANT_S) - 1] ?? null;
  }

  /** Energy per distance since the start of a table, in kWh per 100 km; null on the first metres. */
  consumption(table, kind, time) {
    if (!table.has(`${kind}_power_w`)) return null;
    const [energy, position] = [table.at(`${kind}_energy_j`, time), table.at("position_m", time)];
    const distance = position === null ? 0 : position - table.column("position_m")[0];
    return energy === null || distance < SHORTEST_DISTANCE_M ? null : energy / 36 / distance;
  }
}

/** Stretches of rows at which something holds, as times of their first and last row. */
function spans(holds, times) {
  const found = [];
  holds.forEach((isHeld, k) => {
    if (isHeld && holds[k - 1]) found[found.length - 1].to = times[k];
    else if (isHeld) found.push({ from: times[k], to: times[k] });
  });
  return found;
}

/** Difference of two values, null where one is missing. */
export function difference(first, second) {
  return first === null || second === null || first === undefined || second === undefined ? null : first - second;
}
