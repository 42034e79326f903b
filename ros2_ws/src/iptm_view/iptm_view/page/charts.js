// Curves on a canvas: axes, lines that may have holes, limits, and marks. Knows nothing of cars.

const FONT = "11px system-ui, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif";
const MARGIN = { left: 44, right: 8, top: 6, bottom: 18 };

/** Colours of the page by name, as the style sheet has them at present. */
export function themeColors() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ink", "faint", "grid", "edge", "card", "blue", "orange", "green", "red", "purple",
    "sky", "grey", "bad"];
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
 * Draw a panel.
 *
 * spec: {low?, high?, span}: what the y axis must show; lines: [{xs, ys, color, dash?, width?}];
 * limits: [{value, label}]; marks: [{x, y, color, label, side}]; range: [from, to] of the x axis.
 */
export function drawChart(canvas, spec, { lines, limits = [], marks = [], range, now, xUnit }, colors) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (!width || !height) return;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = FONT;
  const [from, to] = range;
  const [low, high] = rangeOf(spec, lines, from, to);
  const box = {
    left: MARGIN.left, right: width - MARGIN.right, top: MARGIN.top, bottom: height - MARGIN.bottom,
  };
  const toX = (x) => box.left + ((x - from) / (to - from)) * (box.right - box.left);
  const toY = (y) => box.bottom - ((y - low) / (high - low)) * (box.bottom - box.top);

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
  const ticks = ticksOf(from, to, width / 80);
  ticks.forEach(([value, text], index) => {
    const unit = index === ticks.length - 1 ? ` ${xUnit}` : "";
    const x = Math.min(toX(value), width - 4 - context.measureText(text + unit).width / 2);
    context.fillText(text + unit, x, box.bottom + 5);
  });

  context.save();
  context.beginPath();
  context.rect(box.left, box.top - 2, box.right - box.left, box.bottom - box.top + 4);
  context.clip();
  if (now !== undefined && now > from && now < to) {
    context.strokeStyle = colors.edge;
    context.beginPath();
    context.moveTo(toX(now), box.top);
    context.lineTo(toX(now), box.bottom);
    context.stroke();
  }
  for (const line of lines) {
    context.strokeStyle = colors[line.color];
    context.lineWidth = line.width ?? 1.7;
    context.setLineDash(line.dash ?? []);
    drawLine(context, line, from, to, toX, toY, box.right - box.left);
  }
  context.setLineDash([]);
  drawLimits(context, limits, { low, high, toY, box }, colors);
  for (const mark of marks) drawMark(context, mark, toX(mark.x), mark.y === undefined ? box.top + 5 : toY(mark.y), colors);
  context.restore();
}

/** Limits inside the range are lines; one outside is named at the edge where it lies. */
function drawLimits(context, limits, { low, high, toY, box }, colors) {
  context.textAlign = "left";
  for (const { value, label } of limits) {
    const isBelow = value < low;
    const isInside = !isBelow && value <= high;
    context.fillStyle = colors.bad;
    context.strokeStyle = colors.bad;
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

function drawMark(context, { label, color, side }, x, y, colors) {
  context.fillStyle = colors[color];
  context.beginPath();
  context.arc(x, y, label ? 6 : 3, 0, 2 * Math.PI);
  context.fill();
  if (!label) return;
  context.strokeStyle = colors.card;
  context.lineWidth = 1.5;
  context.stroke();
  // On the side away from the other mark, so that the names stay apart when the marks are close.
  context.textAlign = side === "left" ? "right" : "left";
  context.textBaseline = "bottom";
  context.fillStyle = colors.ink;
  fillReadable(context, label, x + (side === "left" ? -5 : 5), y - 6, colors);
}

/** Text with an edge in the colour of the card, so that no curve runs through it. */
function fillReadable(context, text, x, y, colors) {
  context.strokeStyle = colors.card;
  context.lineWidth = 4;
  context.lineJoin = "round";
  context.strokeText(text, x, y);
  context.fillText(text, x, y);
}
