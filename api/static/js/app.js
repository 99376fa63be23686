"use strict";
// What every page shares: local times, shortcuts, the list of keys, and telling what went wrong.
(() => {
  // The page's language as the browser has it: 22 Nov for en-GB, Nov 22 for en-US.
  const locale = navigator.languages.find((each) => each.split("-")[0] === document.documentElement.lang) ?? document.documentElement.lang;
  const notice = document.getElementById("notice");
  const problems = JSON.parse(document.body.dataset.problems || "{}");

  function localTimes(root) {
    const format = new Intl.DateTimeFormat(locale, { dateStyle: "medium", timeStyle: "short" });
    const short = new Intl.DateTimeFormat(locale, { month: "numeric", day: "numeric" });
    for (const time of root.querySelectorAll("time[datetime]")) {
      const at = new Date(time.dateTime);
      if (!Number.isNaN(at.getTime())) time.textContent = ("short" in time.dataset ? short : format).format(at);
    }
  }
  function say(text) {
    notice.replaceChildren();
    if (!text) return;
    const line = document.createElement("p");
    line.className = "problem";
    line.textContent = text;
    notice.append(line);
    notice.scrollIntoView({ block: "nearest" });
  }
  function sayLoggedOut() {
    const link = document.createElement("a");
    link.href = `/login?next=${encodeURIComponent(location.pathname + location.search)}`;
    link.textContent = document.body.dataset.login;
    say(document.body.dataset.loggedOut);
    notice.firstElementChild.append(" ", link);
  }
  function problemIn(text) {
    try {
      const problem = JSON.parse(text);
      const title = problems[String(problem.type).split(":").pop()] || problem.title;
      return `${title}: ${problem.detail}`;
    } catch {
      return document.body.dataset.offline;
    }
  }

  // ---------------------------------------------------------------------------------------------- requests
  document.addEventListener("htmx:beforeRequest", () => say(""));
  document.addEventListener("htmx:responseError", (event) => {
    if (event.detail.xhr.status === 401) sayLoggedOut(); else say(problemIn(event.detail.xhr.responseText));
  });
  document.addEventListener("htmx:sendError", () => say(document.body.dataset.offline));
  document.addEventListener("htmx:afterSwap", (event) => localTimes(event.detail.target.parentNode || document));

  // ---------------------------------------------------------------------------------------------- shortcuts
  const dialog = document.getElementById("keys");
  const keysOn = document.getElementById("keys-on");
  if (keysOn) {
    keysOn.checked = localStorage.getItem("keys") !== "off";
    keysOn.addEventListener("change", () => localStorage.setItem("keys", keysOn.checked ? "on" : "off"));
  }
  function isTyping(element) {
    return element.closest("input:not([type=checkbox]), select, textarea, [contenteditable]") !== null;
  }
  let isGoing = false;
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.isComposing || isTyping(event.target)) return;
    if (event.key === "?" && dialog) {
      event.preventDefault();
      if (dialog.open) dialog.close(); else dialog.showModal();
      return;
    }
    if (!keysOn || !keysOn.checked || dialog.open || document.querySelector("dialog[open]")) return;
    if (isGoing && event.key >= "1" && event.key <= "9") {
      const link = document.querySelectorAll(".top nav a")[Number(event.key) - 1];
      if (link) link.click();
    }
    isGoing = event.key === "g";
    if (event.key === "/") {
      const search = document.querySelector("[data-search]");
      if (search) { event.preventDefault(); search.focus(); }
      return;
    }
    const target = document.querySelector(`[data-key="${CSS.escape(event.key)}"]`);
    if (target && !event.repeat) { event.preventDefault(); target.click(); }
  });

  // ---------------------------------------------------------------------------------------------- small things
  document.addEventListener("click", async (event) => {
    const opener = event.target.closest("[data-opens]");
    if (opener) document.getElementById(opener.dataset.opens).showModal();
    const copier = event.target.closest("[data-copies]");
    if (copier) {
      const source = document.getElementById(copier.dataset.copies);
      try {
        await navigator.clipboard.writeText(source.textContent);
        copier.textContent = copier.dataset.done;
      } catch { // without leave to write to the clipboard: select it
        getSelection().selectAllChildren(source);
      }
    }
  });
  for (const form of document.querySelectorAll("form[data-tidy]")) {
    form.addEventListener("formdata", (event) => { // what was left open is no filter
      for (const [name, value] of [...event.formData]) if (value === "") event.formData.delete(name);
      for (const input of form.querySelectorAll("input[data-day]")) {
        if (input.value) event.formData.set(input.name, beginning(input.value, input.dataset.day).toISOString());
      }
    });
  }
  // Days are the reader's own: sent as moments, the last one up to its end.
  function beginning(day, which) {
    const at = new Date(`${day}T00:00`);
    if (which === "last") at.setDate(at.getDate() + 1);
    return at;
  }
  for (const input of document.querySelectorAll("input[data-at]")) {
    const at = new Date(input.dataset.at);
    if (Number.isNaN(at.getTime())) continue;
    if (input.dataset.day === "last") at.setMilliseconds(-1);
    const two = (number) => String(number).padStart(2, "0");
    input.value = `${at.getFullYear()}-${two(at.getMonth() + 1)}-${two(at.getDate())}`;
  }
  // On a phone what can be folded is, unless something in it was chosen.
  for (const fold of document.querySelectorAll("details[data-fold]")) {
    if (fold.dataset.fold === "" && matchMedia("(max-width: 760px)").matches) fold.open = false;
  }
  localTimes(document);
  window.inhalemon = { say, problemIn, locale };
})();
