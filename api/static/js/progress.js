"use strict";
// A patient's points and the share of steps kept, session by session; the tables below say the same in words.
(() => {
  const box = document.getElementById("progress");
  if (!box) return; // one session makes no curve
  const { sessions, words } = JSON.parse(box.dataset.drawn);
  const day = new Intl.DateTimeFormat(window.inhalemon.locale, { month: "short", day: "numeric" });
  const DAY_S = 86400;
  const STEPS_S = [1, 2, 7, 14, 30, 60, 90, 180, 365, 730].map((days) => days * DAY_S);
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const HEIGHT = 220;
  let plot = null;

  function build() {
    plot?.destroy();
    box.replaceChildren();
    const axis = { stroke: colour("--dim"), grid: { stroke: colour("--line"), width: 1 }, ticks: { show: false }, font: "12px system-ui, sans-serif" };
    const marks = { show: true, size: 7, fill: colour("--ground") };
    plot = new uPlot({
      width: box.clientWidth, height: HEIGHT, padding: [8, 16, 0, 0],
      scales: { x: { time: true, range: roomAround }, y: { range: [0, 104] } },
      axes: [{ ...axis, values: (u, ticks) => ticks.map((t) => day.format(new Date(1000 * t))), space: 70, incrs: STEPS_S }, { ...axis, size: 44 }],
      series: [
        {},
        { label: words.points, stroke: colour("--c0"), width: 2, points: marks },
        { label: words.kept, stroke: colour("--c1"), width: 2, dash: [6, 3], points: marks },
      ],
      legend: { live: false },
      cursor: { drag: { x: false, y: false } },
    }, [sessions.map((each) => each.at_s), sessions.map((each) => each.points), sessions.map((each) => each.kept)], box);
  }
  function roomAround(u, low, high) {
    const room = Math.max(0.04 * (high - low), 43200);
    return [low - room, high + room];
  }
  box.addEventListener("click", () => {
    const at = plot.cursor.idx;
    if (at !== null && at !== undefined) location.href = sessions[at].url;
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", build);
  addEventListener("resize", () => plot.setSize({ width: box.clientWidth, height: HEIGHT }));
  build();
})();
