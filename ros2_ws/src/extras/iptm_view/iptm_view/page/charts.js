// Curves on a canvas: axes, lines that may have holes, limits, and marks. Independent of cars.

const FONT = "11px system-ui, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif";
const MARGIN = { left: 44, right: 8, top: 6, bottom: 18 };
const FUTURE_ALPHA = 0.3;

/** Colours of the page by name, as the style sheet has them at present. */
export function themeColors() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ink", "faint", "grid", "edge", "card", "blue", "orange", "green", "red", "purple",
    "sky", "grey", "bad", "warn", "good", "band"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

/** First index at which sorted values reach a bound. */
export function lowerIndex(values, bound) {
  let low = 0;
  let high = values.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] < bound) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** Value at a place between nodes, null outside. */
export function interpolate(x, xs, ys) {
  if (!xs.length || x < xs[0] || x > xs[xs.length - 1]) return null;
  const upper = lowerIndex(xs, x);
  if (upper === 0) return ys[0];
  const share = (x - xs[upper - 1]) / (xs[upper] - xs[upper - 1]);
  return ys[upper - 1] + share * (ys[upper] - ys[upper - 1]);
}

/** Round numbers to label an axis with, about `count` of them. */
function ticksOf(low, high, count) {
  const rough = (high - low) / Math.max(1, count);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
  const ticks = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k += 1) ticks.push(k * step);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return ticks.map((value) => [value, value.toFixed(digits)]);
}

/** Size the drawing surface of a canvas as the screen has it; null where it is not visible. */
export function surface(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (!width || !height) return null;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = FONT;
  return { context, width, height };
}

/** Range of the y axis: what is to be seen, at least `span` high, with a little air. */
function rangeOf(spec, lines, from, to) {
  let low = spec.low ?? Infinity;
  let high = spec.high ?? -Infinity;
  for (const line of lines) {
    const last = lowerIndex(line.xs, to);
    for (let k = lowerIndex(line.xs, from); k < last; k += 1) {
      const value = line.ys[k];
      if (value === null || value === undefined) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (!(low <= high)) [low, high] = [0, 1];
  const lacking = Math.max(0, spec.span - (high - low));
  if (lacking > 0) {
    high += spec.low === undefined ? 0.5 * lacking : lacking;
    low -= spec.low === undefined ? 0.5 * lacking : 0;
  }
  const air = 0.06 * (high - low);
  return [spec.low !== undefined && low >= spec.low ? spec.low : low - air, high + air];
}

/** Draw one line; where there are more nodes than pixels, the lowest and highest of each group. */
function drawLine(context, line, from, to, toX, toY, width) {
  const begin = Math.max(0, lowerIndex(line.xs, from) - 1);
  const end = Math.min(line.xs.length, lowerIndex(line.xs, to) + 1);
  const group = Math.max(1, Math.ceil((end - begin) / (2 * width)));
  context.beginPath();
  let isDrawing = false;
  const node = (k) => {
    const [x, y] = [toX(line.xs[k]), toY(line.ys[k])];
    if (isDrawing) context.lineTo(x, y);
    else context.moveTo(x, y);
    isDrawing = true;
  };
  for (let k = begin; k < end; k += group) {
    let lowest = -1;
    let highest = -1;
    for (let i = k; i < Math.min(end, k + group); i += 1) {
      if (line.ys[i] === null || line.ys[i] === undefined) continue;
      if (lowest < 0 || line.ys[i] < line.ys[lowest]) lowest = i;
      if (highest < 0 || line.ys[i] > line.ys[highest]) highest = i;
    }
    if (lowest < 0) isDrawing = false;
    else if (lowest === highest) node(lowest);
    else [Math.min(lowest, highest), Math.max(lowest, highest)].forEach(node);
  }
  context.stroke();
}

/**
 * Draw a panel; returns its plot box for the pointer: {left, right}.
 *
 * spec: {low?, high?, span}: what the y axis must show. lines: [{xs, ys, color, dash?, width?, isAhead?}], drawn
 * faintly behind `now` unless they are ahead of it by nature. band: {low, high, label}, each a number or {xs, ys}.
 * limits: [{value, label, color}]; marks: [{x, y, color, label, side}]; range: [from, to] of the x axis;
 * now, cursor: places of the two vertical lines.
 */
export function drawChart(canvas, spec, { lines, band, limits = [], marks = [], range, now, cursor, xUnit }, colors) {
  const sized = surface(canvas);
  if (!sized) return null;
  const { context, width, height } = sized;
  const [from, to] = range;
  const [low, high] = rangeOf(spec, lines, from, to);
  const box = {
    left: MARGIN.left, right: width - MARGIN.right, top: MARGIN.top, bottom: height - MARGIN.bottom,
  };
  const toX = (x) => box.left + ((x - from) / (to - from)) * (box.right - box.left);
  const toY = (y) => box.bottom - ((y - low) / (high - low)) * (box.bottom - box.top);
  const scale = { from, to, low, high, toX, toY, box };

  const clip = (left, right) => {
    context.save();
    context.beginPath();
    context.rect(left, box.top - 2, Math.max(0, right - left), box.bottom - box.top + 4);
    context.clip();
  };
  if (band) {
    clip(box.left, box.right);
    fillBand(context, band, scale, colors);
    context.restore();
  }
  drawAxes(context, scale, { width, height, xUnit }, colors);

  const present = now === undefined || now === null ? box.right : Math.min(Math.max(toX(now), box.left), box.right);
  for (const [left, right, isFuture] of [[box.left, present, false], [present, box.right, true]]) {
    clip(left, right);
    for (const line of lines) {
      if (line.isAhead && !isFuture) continue;
      context.globalAlpha = isFuture && !line.isAhead ? FUTURE_ALPHA : 1;
      context.strokeStyle = colors[line.color];
      context.lineWidth = line.width ?? 1.7;
      context.setLineDash(line.dash ?? []);
      drawLine(context, line, from, to, toX, toY, box.right - box.left);
    }
    context.restore();
  }
  clip(box.left, box.right);
  context.setLineDash([]);
  for (const [at, color] of [[now, "edge"], [cursor, "ink"]]) {
    if (at === undefined || at === null || at < from || at > to) continue;
    context.strokeStyle = colors[color];
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(toX(at), box.top);
    context.lineTo(toX(at), box.bottom);
    context.stroke();
  }
  context.restore();
  if (band) drawEdges(context, band, scale, colors);
  drawLimits(context, limits, scale, colors);
  for (const mark of marks) drawMark(context, mark, scale, colors);
  return box;
}

function drawAxes(context, { from, to, low, high, toX, toY, box }, { width, height, xUnit }, colors) {
  context.lineWidth = 1;
  context.textBaseline = "middle";
  context.textAlign = "right";
  for (const [value, text] of ticksOf(low, high, height / 34)) {
    context.strokeStyle = colors.grid;
    context.beginPath();
    context.moveTo(box.left, toY(value));
    context.lineTo(box.right, toY(value));
    context.stroke();
    context.fillStyle = colors.faint;
    context.fillText(text, box.left - 5, toY(value));
  }
  context.textAlign = "center";
  context.textBaseline = "top";
  const ticks = ticksOf(from, to, width / 56);
  ticks.forEach(([value, text], index) => {
    const unit = index === ticks.length - 1 ? ` ${xUnit}` : "";
    const x = Math.min(toX(value), width - 4 - context.measureText(text + unit).width / 2);
    context.fillText(text + unit, x, box.bottom + 5);
  });
}

/** Fill what is allowed: between two levels, or between a curve and a level. */
function fillBand(context, { low, high }, { from, to, toX, toY, box }, colors) {
  context.fillStyle = colors.band;
  context.beginPath();
  context.moveTo(box.left, toY(high));
  context.lineTo(box.right, toY(high));
  if (typeof low === "number") {
    context.lineTo(box.right, toY(low));
    context.lineTo(box.left, toY(low));
  } else {
    const begin = Math.max(0, lowerIndex(low.xs, from) - 1);
    const end = Math.min(low.xs.length, lowerIndex(low.xs, to) + 1);
    const known = [];
    for (let k = begin; k < end; k += 1) if (low.ys[k] !== null) known.push([toX(low.xs[k]), toY(low.ys[k])]);
    if (!known.length) return;
    context.lineTo(box.right, known[known.length - 1][1]);
    known.reverse().forEach(([x, y]) => context.lineTo(x, y));
    context.lineTo(box.left, known[known.length - 1][1]);
  }
  context.fill();
}

/** The edges of a band that are levels, and its label. */
function drawEdges(context, { low: bottom, high: top, label }, { low, high, toY, box }, colors) {
  context.strokeStyle = colors.good;
  context.lineWidth = 1;
  context.setLineDash([3, 3]);
  for (const edge of [bottom, top]) {
    if (typeof edge !== "number" || edge < low || edge > high) continue;
    context.beginPath();
    context.moveTo(box.left, toY(edge));
    context.lineTo(box.right, toY(edge));
    context.stroke();
  }
  context.setLineDash([]);
  context.textAlign = "right";
  context.textBaseline = "top";
  context.fillStyle = colors.good;
  fillReadable(context, label, box.right - 4, Math.max(box.top, Math.min(toY(top), box.bottom - 16)) + 3, colors);
}

/** Limits inside the range are lines; one outside is named at the edge where it lies. */
function drawLimits(context, limits, { low, high, toY, box }, colors) {
  context.textAlign = "left";
  for (const { value, label, color } of limits) {
    const isBelow = value < low;
    const isInside = !isBelow && value <= high;
    context.fillStyle = colors[color];
    context.strokeStyle = colors[color];
    if (isInside) {
      context.lineWidth = 1.2;
      context.setLineDash([7, 4]);
      context.beginPath();
      context.moveTo(box.left, toY(value));
      context.lineTo(box.right, toY(value));
      context.stroke();
      context.setLineDash([]);
    }
    const isHigh = isInside ? toY(value) < box.top + 14 : !isBelow;
    context.textBaseline = isHigh ? "top" : "bottom";
    const y = isInside ? toY(value) + (isHigh ? 2 : -2) : isBelow ? box.bottom : box.top;
    fillReadable(context, isInside ? label : `${label} ${isBelow ? "↓" : "↑"}`, box.left + 4, y, colors);
  }
}

function drawMark(context, { x: place, y: level, label, color, side }, { from, to, toX, toY, box }, colors) {
  if (place < from || place > to) return;
  const [x, y] = [toX(place), toY(level)];
  context.fillStyle = colors[color];
  context.beginPath();
  context.arc(x, y, label ? 6 : 3, 0, 2 * Math.PI);
  context.fill();
  if (!label) return;
  context.strokeStyle = colors.card;
  context.lineWidth = 1.5;
  context.stroke();
  // On the side away from the other mark where there is room, so that the names stay apart.
  const room = context.measureText(label).width + 6;
  const isLeft = side === "left" ? x - room > box.left : x + room > box.right;
  context.textAlign = isLeft ? "right" : "left";
  context.textBaseline = "bottom";
  context.fillStyle = colors.ink;
  fillReadable(context, label, x + (isLeft ? -5 : 5), Math.max(y - 6, box.top + 12), colors);
}

/** Text with an edge in the colour of the card, so that no curve runs through it. */
function fillReadable(context, text, x, y, colors) {
  context.strokeStyle = colors.card;
  context.lineWidth = 4;
  context.lineJoin = "round";
  context.strokeText(text, x, y);
  context.fillText(text, x, y);
}

/** Draw events as bars over time; returns the plot box. */
export function drawEventRow(canvas, { events, range: [from, to], now, inset }, colors) {
  const sized = surface(canvas);
  if (!sized) return null;
  const { context, width, height } = sized;
  const box = { left: inset, right: width - inset };
  const toX = (time) => box.left + ((time - from) / (to - from)) * (box.right - box.left);
  context.fillStyle = colors.grid;
  context.fillRect(box.left, 0, box.right - box.left, height);
  // The bad ones last, so that nothing hides them.
  for (const level of ["warn", "bad"]) {
    context.fillStyle = colors[level];
    for (const event of events) {
      if (event.level !== level) continue;
      const x = toX(event.from);
      context.fillRect(x - 1, 0, Math.max(3, toX(event.to) - x + 2), height);
    }
  }
  if (now !== null) {
    context.fillStyle = colors.ink;
    context.fillRect(toX(now) - 0.5, 0, 1, height);
  }
  return box;
}
