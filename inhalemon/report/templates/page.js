"use strict";
// Zooms, pans and reads values. Everything is on the page already; without this script it is shown whole.
(() => {
  const plots = document.getElementById("plots");
  if (!plots) return;
  const first = Number(plots.dataset.start), last = Number(plots.dataset.end), height = Number(plots.dataset.height);
  const shortest = Math.min(0.2, last - first);
  const all = document.getElementById("all"), cursor = document.getElementById("cursor"), hint = cursor.textContent;
  const panels = [...plots.querySelectorAll(".panel")].map((panel) => {
    const svg = panel.querySelector("svg");
    return {
      svg,
      line: svg.querySelector(".cursor"),
      low: Number(svg.dataset.low), high: Number(svg.dataset.high), isLog: "log" in svg.dataset,
      outputs: [...panel.querySelectorAll("output")],
      curves: [...svg.querySelectorAll(".curve")].map(points),
    };
  });
  const strip = plots.querySelector(".strip"), axis = plots.querySelector(".axis");
  plots.classList.add("scripted");
  let start = first, end = last;

  function points(path) {
    return path.getAttribute("d").split(/[M ]/).filter(Boolean).map((pair) => pair.split(",").map(Number));
  }
  function show(from, to) {
    const span = Math.min(Math.max(to - from, shortest), last - first);
    start = Math.min(Math.max(from, first), last - span);
    end = start + span;
    for (const { svg } of panels) svg.setAttribute("viewBox", `${start} 0 ${span} ${height}`);
    for (const mark of plots.querySelectorAll(".strip span[data-start]")) {
      // A band that began before the view keeps its name in sight.
      const from_s = mark.dataset.end ? Math.max(Number(mark.dataset.start), start) : Number(mark.dataset.start);
      mark.style.left = `${100 * (from_s - start) / span}%`;
      if (mark.dataset.end) {
        const width = Math.min(Number(mark.dataset.end), end) - from_s;
        mark.style.width = `${100 * Math.max(width, 0) / span}%`;
        mark.hidden = width <= 0;
        mark.classList.remove("unnamed");
      }
    }
    // Half a name tells less than none; the legend and the title have it. Read first, then written: one layout.
    const bands = [...plots.querySelectorAll(".phases span")];
    const cut = bands.filter((band) => band.scrollWidth > band.clientWidth);
    for (const band of cut) band.classList.add("unnamed");
    ticks(span);
    all.hidden = span >= last - first;
  }
  function ticks(span) {
    const wanted = span / Math.max(3, Math.min(9, strip.clientWidth / 70));
    const power = 10 ** Math.floor(Math.log10(wanted));
    const step = power * [1, 2, 5, 10].find((factor) => factor * power >= wanted);
    axis.replaceChildren();
    for (let i = Math.ceil(start / step); i * step <= end; i += 1) {
      const tick = document.createElement("span");
      tick.textContent = `${Number((i * step).toPrecision(8))} s`;
      tick.style.left = `${100 * (i * step - start) / span}%`;
      axis.append(tick);
    }
  }
  function zoom(factor, around) {
    show(around - (around - start) * factor, around + (end - around) * factor);
  }
  function timeAt(event) {
    const box = strip.getBoundingClientRect();
    return start + (end - start) * Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1);
  }
  function valueAt(curve, time, panel) {
    let low = 0, high = curve.length - 1;
    if (high < 0) return "";
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (curve[middle][0] <= time) low = middle; else high = middle;
    }
    const y = curve[time - curve[low][0] < curve[high][0] - time ? low : high][1];
    const value = panel.low + (height - 4 - y) * (panel.high - panel.low) / (height - 8);
    return panel.isLog ? (10 ** value).toExponential(1) : value.toFixed(panel.high - panel.low > 20 ? 1 : 2);
  }
  function read(time) {
    cursor.textContent = `${time.toFixed(2)} s`;
    for (const panel of panels) {
      panel.line.setAttribute("d", `M${time},0V${height}`);
      panel.outputs.forEach((output, i) => { output.textContent = valueAt(panel.curves[i], time, panel); });
    }
  }

  let held = null;
  plots.addEventListener("pointerdown", (event) => { if (event.button === 0) held = timeAt(event); });
  plots.addEventListener("pointermove", (event) => {
    const time = timeAt(event);
    read(time);
    if (held !== null) cursor.textContent = `${Math.min(held, time).toFixed(2)} to ${Math.max(held, time).toFixed(2)} s`;
  });
  addEventListener("pointerup", (event) => {
    if (held === null) return;
    const time = timeAt(event);
    if (Math.abs(time - held) > 0.01 * (end - start)) show(Math.min(held, time), Math.max(held, time));
    held = null;
  });
  addEventListener("pointercancel", () => { held = null; });
  plots.addEventListener("dblclick", () => show(first, last));
  plots.addEventListener("pointerleave", () => { if (held === null) cursor.textContent = hint; });
  plots.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return; // a plain wheel scrolls the page
    event.preventDefault();
    zoom(event.deltaY > 0 ? 1.25 : 0.8, timeAt(event));
  }, { passive: false });
  plots.addEventListener("keydown", (event) => {
    const span = end - start, middle = (start + end) / 2;
    const acts = {
      ArrowLeft: () => show(start - 0.2 * span, end - 0.2 * span),
      ArrowRight: () => show(start + 0.2 * span, end + 0.2 * span),
      "+": () => zoom(0.5, middle), "=": () => zoom(0.5, middle), "-": () => zoom(2, middle),
      0: () => show(first, last), Home: () => show(first, last), Escape: () => show(first, last),
    };
    if (event.ctrlKey || event.metaKey || event.altKey || !(event.key in acts)) return;
    event.preventDefault();
    acts[event.key]();
    read((start + end) / 2);
  });
  all.addEventListener("click", () => { show(first, last); plots.focus(); });
  for (const button of document.querySelectorAll("button[data-start]")) {
    button.addEventListener("click", () => {
      const from = Number(button.dataset.start), to = Number(button.dataset.end), around = Math.max(1, 0.3 * (to - from));
      show(from - around, to + around);
      read(from);
      plots.scrollIntoView({ block: "nearest" });
    });
  }
  new ResizeObserver(() => show(start, end)).observe(strip);
})();
