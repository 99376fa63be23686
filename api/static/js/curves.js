"use strict";
// The curves of a session on one time axis: phases lie behind them as bands, presses and openings across them.
(() => {
  const box = document.getElementById("curves");
  if (!box) return;
  const told = JSON.parse(box.dataset.drawn), words = told.words;
  const plotsBox = document.getElementById("plots"), moment = document.getElementById("moment");
  const TWO_SIDED_95 = 1.96, GAP_S = 0.25, SHORTEST_S = 0.2;
  const PANELS = told.panels;
  const CHANNELS = PANELS.flatMap((panel) => panel.curves.flatMap(({ channel, sd }) => (sd ? [channel, sd] : [channel])));
  // Two points a column of the screen: the least and the greatest of what falls into it.
  const MAX_POINTS = Math.min(Math.max(2 * plotsBox.clientWidth, 1000), 4000);
  // The panels fill the window and no more.
  const HEIGHT = Math.round(Math.min(Math.max((innerHeight - 425) / PANELS.length, 84), 260));
  const heightOf = (isLast) => HEIGHT + (isLast ? 24 : 0);
  const DASHES = [[], [6, 2], [2, 2]];

  let first = told.start_s, last = Math.max(told.end_s, told.start_s + SHORTEST_S);
  let start = first, end = last, marked = null;
  let whole = null, held = null; // curves of all time, and of the part that is looked at
  let plots = [], isReduced = false, waiting = 0, asked = 0;

  // ------------------------------------------------------------------------------------------------ data
  async function load(from, to) {
    const query = new URLSearchParams({ channels: CHANNELS.join(","), max_points: MAX_POINTS, format: "binary" });
    if (from !== undefined) { query.set("from_s", from); query.set("to_s", to); }
    const answer = await fetch(`${told.url}?${query}`, { headers: { Accept: "application/vnd.inhalemon.series" } });
    if (!answer.ok) throw new Error(window.inhalemon.problemIn(await answer.text()));
    return parse(await answer.arrayBuffer());
  }
  function parse(buffer) {
    const length = new DataView(buffer).getUint32(0, true);
    const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    const rows = new Float32Array(buffer.slice(4 + length));
    const n = head.points, time = rows.subarray(0, n), values = new Map();
    head.channels.forEach((name, i) => values.set(name, rows.subarray((i + 1) * n, (i + 2) * n)));
    return { n, from: time[0], to: time[n - 1], time, values, breaks: breaksIn(time) };
  }
  function breaksIn(time) { // a line is broken where samples are missing
    const steps = [];
    for (let i = 1; i < time.length; i += 1) steps.push(time[i] - time[i - 1]);
    const usual = [...steps].sort((a, b) => a - b)[steps.length >> 1] || 0;
    const most = Math.max(GAP_S, 4 * usual);
    return steps.flatMap((step, i) => (step > most ? [i + 1] : []));
  }
  function rowsOf(panel, data) {
    const rows = [Array.from(data.time)];
    const { scale } = panel;
    for (const { channel, sd } of panel.curves) {
      const value = data.values.get(channel);
      rows.push(known(value, (x) => x * scale));
      if (sd) {
        const half = data.values.get(sd);
        for (const side of [TWO_SIDED_95, -TWO_SIDED_95]) rows.push(known(value, (x, i) => (x + side * half[i]) * scale));
      }
    }
    for (let k = data.breaks.length - 1; k >= 0; k -= 1) {
      const i = data.breaks[k];
      rows[0].splice(i, 0, (rows[0][i - 1] + rows[0][i]) / 2);
      for (const row of rows.slice(1)) row.splice(i, 0, null);
    }
    return rows;
  }
  function known(values, f) {
    const out = new Array(values.length);
    for (let i = 0; i < values.length; i += 1) {
      const y = f(values[i], i);
      out[i] = Number.isFinite(y) ? y : null;
    }
    return out;
  }

  // ------------------------------------------------------------------------------------------------ drawing
  const probe = document.createElement("i");
  probe.hidden = true;
  box.append(probe);
  function colour(name) { return getComputedStyle(document.documentElement).getPropertyValue(name).trim(); }
  function tones() {
    const found = {};
    for (const phase of told.phases) {
      probe.className = phase.kind;
      found[phase.kind] = getComputedStyle(probe).getPropertyValue("--tone").trim();
    }
    return found;
  }
  let palette = null;
  function renewPalette() {
    palette = { ink: colour("--ink"), dim: colour("--dim"), line: colour("--line"), ground: colour("--ground"), curves: [0, 1, 2].map((i) => colour(`--c${i}`)), tones: tones() };
  }

  function behind(u) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    for (const phase of told.phases) {
      const x = u.valToPos(phase.start_s, "x", true), to = u.valToPos(phase.end_s, "x", true);
      ctx.globalAlpha = 0.24;
      ctx.fillStyle = palette.tones[phase.kind];
      ctx.fillRect(x, bbox.top, to - x, bbox.height);
    }
    if (marked) {
      const x = u.valToPos(marked.start_s, "x", true), to = u.valToPos(marked.end_s, "x", true);
      ctx.globalAlpha = 1;
      ctx.setLineDash([]);
      ctx.lineWidth = 2 * devicePixelRatio;
      ctx.strokeStyle = palette.ink;
      ctx.strokeRect(x - 2, bbox.top + 1, Math.max(to - x, 2) + 4, bbox.height - 2);
    }
    ctx.restore();
  }
  function across(u) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.strokeStyle = ctx.fillStyle = palette.ink;
    ctx.lineWidth = devicePixelRatio;
    for (const event of told.events) {
      const x = Math.round(u.valToPos(event.start_s, "x", true)), peak = u.valToPos(event.peak_s, "x", true);
      ctx.setLineDash([3 * devicePixelRatio, 3 * devicePixelRatio]);
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      ctx.setLineDash([]);
      const size = 5 * devicePixelRatio; // where the end stop was reached
      ctx.beginPath();
      ctx.moveTo(peak - size, bbox.top);
      ctx.lineTo(peak + size, bbox.top);
      ctx.lineTo(peak, bbox.top + 1.6 * size);
      ctx.fill();
    }
    ctx.restore();
  }

  function seriesOf(panel) {
    const series = [{}], bands = [];
    panel.curves.forEach((curve, i) => {
      const stroke = palette.curves[i % 3];
      series.push({ label: curve.name, stroke, width: 1.5, dash: DASHES[i % 3], points: { show: false }, spanGaps: false });
      if (curve.sd) {
        const at = series.length;
        for (const _ of [0, 1]) series.push({ stroke: "transparent", width: 0, points: { show: false } });
        bands.push({ series: [at, at + 1], fill: `color-mix(in srgb, ${stroke} 28%, transparent)` });
      }
    });
    return { series, bands };
  }
  function optionsOf(panel, width, isLast) {
    const axis = { stroke: palette.dim, grid: { stroke: palette.line, width: 1 }, ticks: { stroke: palette.line, width: 1 }, font: "12px system-ui, sans-serif" };
    return {
      width, height: heightOf(isLast),
      padding: [8, 18, isLast ? null : 8, 0], // room for half a number at either end of the axis
      scales: { x: { time: false, range: () => [start, end] }, y: { range: yRange } },
      axes: [
        { ...axis, show: isLast, size: 28, values: (u, ticks) => ticks.map((t) => `${Number(t.toFixed(3))} s`) },
        { ...axis, size: innerWidth < 600 ? 40 : 54, space: 20 },
      ],
      ...seriesOf(panel),
      legend: { show: false },
      cursor: {
        sync: { key: "session", setSeries: false }, points: { size: 6 },
        drag: { x: true, y: false, setScale: false, dist: 6 },
        bind: { dblclick: () => () => { show(first, last); return null; }, mousedown: panWithShift },
      },
      hooks: {
        drawClear: [behind], draw: [across],
        setSelect: [(u) => {
          if (u.select.width < 6) return;
          const from = u.posToVal(u.select.left, "x"), to = u.posToVal(u.select.left + u.select.width, "x");
          u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
          show(from, to);
        }],
        setCursor: [(u) => read(u, panel)],
      },
    };
  }
  function yRange(u, low, high) {
    if (low === null || high === null) return [0, 1];
    const from = Math.min(low, 0), to = Math.max(high, 0), room = 0.06 * Math.max(to - from, 1e-3);
    return [from < 0 ? from - room : 0, to + room];
  }
  function panWithShift(u, target, handler) {
    return (event) => {
      if (!event.shiftKey || event.button !== 0) return handler(event);
      const from = event.clientX, at = start, span = end - start;
      const move = (to) => show(at - (to.clientX - from) * span / u.over.clientWidth, at + span - (to.clientX - from) * span / u.over.clientWidth);
      const up = () => { removeEventListener("pointermove", move); removeEventListener("pointerup", up); };
      addEventListener("pointermove", move);
      addEventListener("pointerup", up);
      return null;
    };
  }
  function read(u, panel) {
    const { idx, left } = u.cursor;
    const isOn = idx !== null && idx !== undefined && left >= 0;
    if (isOn) moment.textContent = `${u.data[0][idx].toFixed(2)} s`;
    let row = 1;
    for (const curve of panel.curves) {
      const y = isOn ? u.data[row][idx] : null;
      curve.output.textContent = y === null || y === undefined ? "" : `${y.toFixed(Math.abs(y) < 10 ? 2 : 1)}${panel.unit === "°" ? "" : " "}${panel.unit}`;
      row += curve.sd ? 3 : 1;
    }
  }

  // ------------------------------------------------------------------------------------------------ the strips above
  const strips = document.createElement("div");
  strips.className = "strips";
  strips.setAttribute("aria-hidden", "true"); // the table below says the same
  const phaseMarks = told.phases.map((phase) => mark("phase", phase, `${phase.name}, ${phase.start_s.toFixed(2)} ${words.to} ${phase.end_s.toFixed(2)} s, ${phase.confidence.toFixed(2)}`));
  const eventMarks = told.events.map((event) => mark("event", event, `${event.name}, ${event.start_s.toFixed(2)} s, ${event.angle_deg.toFixed(1)}°`));
  function mark(kind, what, title) {
    const span = document.createElement("span");
    span.className = `${kind} ${kind === "phase" ? what.kind : ""}`;
    span.textContent = kind === "event" ? `${what.name} ${what.angle_deg.toFixed(0)}°` : what.name;
    span.title = title;
    span.addEventListener("click", () => zoomTo(what));
    return { span, what };
  }
  for (const [name, marks] of [["phases", phaseMarks], ["events", eventMarks]]) {
    const strip = document.createElement("div");
    strip.className = `strip ${name}`;
    strip.append(...marks.map(({ span }) => span));
    strips.append(strip);
  }
  const widths = new Map();
  function widthOf(span) { // of the whole name, measured once
    if (!widths.has(span)) {
      const [was, style] = [span.style.width, span.style];
      span.classList.remove("unnamed");
      style.width = "auto";
      widths.set(span, span.offsetWidth);
      style.width = was;
    }
    return widths.get(span);
  }
  const legend = document.createElement("ul");
  legend.className = "phases-legend";
  legend.setAttribute("aria-hidden", "true");
  for (const [kind, name] of new Map(told.phases.map((phase) => [phase.kind, phase.name]))) {
    const item = document.createElement("li"), swatch = document.createElement("i");
    swatch.className = `swatch ${kind}`;
    item.append(swatch, name);
    legend.append(item);
  }
  function placeMarks() {
    const over = plots[0].over, left = over.offsetLeft, width = over.clientWidth;
    strips.style.marginLeft = `${left}px`;
    strips.style.width = `${width}px`;
    for (const { span, what } of phaseMarks) {
      const from = Math.max(what.start_s, start), to = Math.min(what.end_s, end);
      span.hidden = to <= from;
      span.style.left = `${100 * (from - start) / (end - start)}%`;
      const share = Math.max(to - from, 0) / (end - start);
      span.style.width = `${100 * share}%`;
      span.classList.toggle("unnamed", share * width < widthOf(span)); // half a name tells less than none
    }
    let free = [-Infinity, -Infinity]; // two lines, so that marks close together can be read
    for (const { span, what } of eventMarks) {
      const at = width * (what.start_s - start) / (end - start);
      span.hidden = at < 0 || at > width;
      if (span.hidden) continue;
      const line = at >= free[0] ? 0 : 1;
      span.style.left = `${at}px`;
      span.style.top = `${line * 1.3}em`;
      span.classList.toggle("flipped", at + span.offsetWidth > width);
      free[line] = at + span.offsetWidth + 4;
    }
  }

  // ------------------------------------------------------------------------------------------------ the view
  function build() {
    const began = performance.now();
    renewPalette();
    for (const plot of plots) plot.destroy();
    plots = [];
    plotsBox.replaceChildren(strips);
    const data = held || whole;
    PANELS.forEach((panel, i) => {
      const section = document.createElement("div"), head = document.createElement("p"), title = document.createElement("b");
      section.className = "panel";
      title.textContent = `${panel.title} (${panel.unit})`;
      head.append(title);
      panel.curves.forEach((curve, k) => {
        const name = document.createElement("span");
        name.className = `curve c${k % 3}`;
        curve.output = document.createElement("output");
        name.append(document.createElement("i"), ` ${curve.name} `, curve.output);
        head.append(name);
      });
      section.append(head);
      plotsBox.append(section);
      plots.push(new uPlot(optionsOf(panel, plotsBox.clientWidth, i === PANELS.length - 1), rowsOf(panel, data), section));
    });
    plotsBox.append(legend);
    placeMarks();
    // uPlot draws in a microtask: this one comes after all of theirs.
    queueMicrotask(() => { box.dataset.drawnMs = (performance.now() - began).toFixed(1); });
  }
  function give(data) {
    plots.forEach((plot, i) => plot.setData(rowsOf(PANELS[i], data), false));
  }
  function show(from, to) {
    const span = Math.min(Math.max(to - from, SHORTEST_S), last - first);
    start = Math.min(Math.max(from, first), last - span);
    end = start + span;
    if (!plots.length) return;
    if (held && (start < held.from || end > held.to)) { held = null; give(whole); }
    for (const plot of plots) plot.setScale("x", { min: start, max: end });
    placeMarks();
    box.dataset.view = `${start.toFixed(3)} ${end.toFixed(3)}`;
    clearTimeout(waiting);
    if (isReduced && span < 0.9 * (last - first)) waiting = setTimeout(refine, 150);
  }
  async function refine() { // as fine as the screen can show it
    const number = asked += 1, margin = 0.5 * (end - start);
    try {
      const found = await load(Math.max(first, start - margin), Math.min(last, end + margin));
      if (number !== asked || !found.n || start < found.from - GAP_S || end > found.to + GAP_S) return;
      held = found;
      give(held);
      for (const plot of plots) plot.setScale("x", { min: start, max: end });
    } catch { /* what is on the screen stays */ }
  }
  function zoom(factor, around) { show(around - (around - start) * factor, around + (end - around) * factor); }
  function pan(share) { show(start + share * (end - start), end + share * (end - start)); }
  function zoomTo(what) {
    const around = Math.max(1, 0.5 * (what.end_s - what.start_s));
    marked = what;
    show(what.start_s - around, what.end_s + around);
  }

  const views = {
    left: () => pan(-0.2), right: () => pan(0.2), in: () => zoom(0.5, (start + end) / 2),
    out: () => zoom(2, (start + end) / 2), all: () => show(first, last),
  };
  const KEYS = { "+": "in", "=": "in", "-": "out", 0: "all", ArrowLeft: "left", ArrowRight: "right", Home: "all" };
  box.addEventListener("click", (event) => {
    const button = event.target.closest("[data-view]");
    if (button && button !== box) views[button.dataset.view]();
  });
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.isComposing || !(event.key in KEYS)) return;
    if (event.target.closest("input, select, textarea, summary")) return;
    const on = document.getElementById("keys-on");
    const isOnCurves = plotsBox.contains(event.target);
    if (!isOnCurves && (event.key === "Home" || event.key.startsWith("Arrow") || !on || !on.checked)) return;
    if (document.querySelector("dialog[open]")) return;
    event.preventDefault();
    views[KEYS[event.key]]();
  });
  plotsBox.addEventListener("wheel", (event) => {
    const over = plots[0]?.over;
    if (!over) return;
    if (event.ctrlKey) {
      event.preventDefault();
      const left = over.getBoundingClientRect().left;
      zoom(event.deltaY > 0 ? 1.25 : 0.8, start + (end - start) * Math.min(Math.max((event.clientX - left) / over.clientWidth, 0), 1));
    } else if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      event.preventDefault();
      pan(event.deltaX / over.clientWidth);
    }
  }, { passive: false });
  document.addEventListener("nowhere", () => { show(first, last); moment.textContent = words.nowhere; });
  document.addEventListener("zoom", (event) => { zoomTo(event.detail); plotsBox.scrollIntoView({ block: "nearest" }); });
  document.addEventListener("finding", (event) => {
    marked = event.detail;
    for (const plot of plots) plot.redraw(false);
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (whole) build(); });
  let width = 0;
  new ResizeObserver(() => {
    if (!plots.length || plotsBox.clientWidth === width) return;
    width = plotsBox.clientWidth;
    plots.forEach((plot, i) => plot.setSize({ width, height: heightOf(i === PANELS.length - 1) }));
    placeMarks();
  }).observe(plotsBox);

  load().then((found) => {
    if (!found.n) throw new Error(words.failed);
    whole = found;
    isReduced = found.n >= MAX_POINTS - 2;
    first = Math.min(first, found.from);
    last = Math.max(last, found.to);
    [start, end] = [first, last];
    build();
    box.dataset.view = `${start.toFixed(3)} ${end.toFixed(3)}`;
    if (told.dose) show(told.dose.start_s, told.dose.end_s);
  }).catch((error) => {
    const line = document.createElement("p");
    line.className = "problem";
    line.setAttribute("role", "alert");
    line.textContent = `${words.failed} ${error.message}`;
    plotsBox.replaceChildren(line);
  });
})();
