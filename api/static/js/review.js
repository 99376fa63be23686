"use strict";
// The list of findings: one of them is current; keys act on it, and the curves show it.
(() => {
  let current = null; // the rule of the current finding

  const items = () => [...document.querySelectorAll("#review .finding")];
  const itemOf = (rule) => items().find((item) => item.dataset.rule === rule) || null;

  function choose(item, { focus = false } = {}) {
    for (const other of items()) other.toggleAttribute("data-current", other === item);
    current = item ? item.dataset.rule : null;
    if (item && focus) {
      const name = item.querySelector(".head button");
      name.focus({ preventScroll: true });
      item.scrollIntoView({ block: "nearest" });
    }
    document.dispatchEvent(new CustomEvent("finding", { detail: span(item) }));
  }
  function span(item) {
    if (!item || item.dataset.start === undefined) return null;
    return { start_s: Number(item.dataset.start), end_s: Number(item.dataset.end) };
  }
  function show(item) {
    const detail = span(item);
    document.dispatchEvent(detail ? new CustomEvent("zoom", { detail }) : new CustomEvent("nowhere"));
  }
  function step(by) {
    const all = items();
    const at = all.findIndex((item) => item.dataset.rule === current);
    const next = all[Math.min(Math.max(at + by, 0), all.length - 1)];
    if (next) choose(next, { focus: true });
  }

  function begin(override) { // at once, so that the next key is a letter of the reason
    if (!override) return;
    override.open = true;
    override.querySelector("textarea").focus();
  }

  let isBusy = false; // an entry is on its way: a second key would act on what is no longer there
  const acts = {
    j: () => step(1),
    k: () => step(-1),
    z: (item) => item && show(item),
    c: (item) => item && item.querySelector('[data-act="c"]')?.click(),
    u: (item) => item && item.querySelector('[data-act="u"]')?.click(),
    o: (item) => item && begin(item.querySelector("details.override")),
  };
  document.addEventListener("keydown", (event) => {
    const on = document.getElementById("keys-on");
    if (event.ctrlKey || event.metaKey || event.altKey || !(event.key in acts) || !on || !on.checked) return;
    if (event.isComposing || isBusy || document.querySelector("dialog[open]")) return;
    if (event.target.closest("input:not([type=checkbox]), select, textarea")) return;
    event.preventDefault();
    if (!event.repeat || event.key === "j" || event.key === "k") acts[event.key](itemOf(current));
  });
  document.addEventListener("keydown", (event) => { // Escape leaves an override that was begun
    const details = event.key === "Escape" && event.target.closest("details.override[open]");
    if (!details) return;
    details.open = false;
    details.querySelector("summary").focus();
  });
  document.addEventListener("focusin", (event) => {
    const item = event.target.closest("#review .finding");
    if (item && item.dataset.rule !== current) choose(item);
  });
  document.addEventListener("click", (event) => {
    const name = event.target.closest("#review .finding .head button");
    if (name) { choose(name.closest(".finding")); show(name.closest(".finding")); return; }
    const other = event.target.closest("button[data-start]");
    if (other) {
      const detail = { start_s: Number(other.dataset.start), end_s: Number(other.dataset.end) };
      document.dispatchEvent(new CustomEvent("zoom", { detail }));
    }
  });
  document.addEventListener("toggle", (event) => {
    if (event.target.matches?.("details.override") && event.target.open) begin(event.target);
  }, true);

  // After an entry was written the list is drawn anew: go on to the next finding that waits.
  let next = null;
  document.addEventListener("htmx:afterRequest", (event) => {
    if (!event.detail.successful) isBusy = false;
    else if (event.target.matches("details[hx-preserve] form")) { // what was sent; all else that was typed stays
      event.target.reset();
      event.target.closest("details").open = false;
    }
  });
  document.addEventListener("htmx:beforeRequest", (event) => {
    isBusy = true;
    const item = event.target.closest?.("#review .finding");
    const kind = item && event.target.querySelector('input[name="kind"]')?.value;
    if (!item) { next = null; return; }
    const all = items();
    const waiting = all.slice(all.indexOf(item) + 1).find((other) => other.querySelector('[data-act="c"]'));
    next = kind === "undo" || !waiting ? item.dataset.rule : waiting.dataset.rule;
  });
  document.addEventListener("htmx:afterSettle", (event) => {
    if (event.detail.target.id !== "review" && event.target.id !== "review") return;
    isBusy = false;
    const conflict = document.getElementById("conflict");
    if (event.detail.xhr.status < 400 && conflict) conflict.replaceChildren();
    const item = itemOf(next ?? current);
    if (item) choose(item, { focus: next !== null });
    next = null;
  });
  document.addEventListener("htmx:afterSwap", (event) => {
    if (event.detail.target.id !== "conflict") return;
    isBusy = false;
    document.getElementById("reload")?.focus();
  });

  choose(items().find((item) => item.querySelector('[data-act="c"]')) || items()[0] || null);
})();
