"use strict";
// Files are sent one request each, two at a time, so that each has its own progress, its own error and its own retry.
(() => {
  const box = document.getElementById("upload");
  const words = JSON.parse(box.dataset.words), problems = JSON.parse(box.dataset.problems);
  const input = document.getElementById("files"), drop = document.getElementById("drop");
  const list = document.getElementById("list"), summary = document.getElementById("summary");
  const AT_ONCE = 2;
  const jobs = [];
  let running = 0;

  const stem = (name) => name.replace(/\.(csv(\.gz|\.zst)?|parquet|json)$/i, "");
  const isSidecar = (file) => /\.json$/i.test(file.name);

  async function add(files) {
    const chosen = [...files];
    const sidecars = new Map(chosen.filter(isSidecar).map((file) => [stem(file.name), file]));
    for (const file of chosen.filter((each) => !isSidecar(each))) {
      const sidecar = sidecars.get(stem(file.name));
      sidecars.delete(stem(file.name));
      jobs.push(row({ file, sidecar, state: "waiting" }));
    }
    for (const file of sidecars.values()) {
      const job = row({ file, state: "failed" });
      show(job, "failed", words.lone);
      jobs.push(job);
    }
    pump();
  }

  function row(job) {
    const item = document.createElement("li");
    const name = document.createElement("b"), state = document.createElement("span"), bar = document.createElement("progress");
    const told = document.createElement("p"), acts = document.createElement("span");
    name.textContent = job.file.name;
    state.className = "state";
    bar.max = 1;
    bar.value = 0;
    bar.setAttribute("aria-label", job.file.name);
    acts.className = "acts";
    item.append(name, state, bar, told, acts);
    list.append(item);
    Object.assign(job, { item, stateBox: state, bar, told, acts });
    show(job, job.state);
    return job;
  }

  function show(job, state, text = "") {
    job.state = state;
    job.item.dataset.state = state;
    job.stateBox.textContent = words[state];
    job.told.textContent = text;
    job.bar.hidden = state !== "waiting" && state !== "sending" && state !== "scoring";
    if (state === "scoring") job.bar.removeAttribute("value");
    const all = jobs.length, failed = jobs.filter((each) => each.state === "failed").length;
    const done = jobs.filter((each) => ["done", "known", "kept"].includes(each.state)).length;
    summary.textContent = all ? words.progress.replace("{done}", done).replace("{all}", all).replace("{failed}", failed) : "";
  }

  function pump() {
    while (running < AT_ONCE) {
      const job = jobs.find((each) => each.state === "waiting");
      if (!job) return;
      running += 1;
      send(job).finally(() => { running -= 1; pump(); });
    }
  }

  async function send(job) {
    job.acts.replaceChildren();
    job.bar.value = 0;
    show(job, "sending");
    const metadata = {};
    const device = document.getElementById("device").value, patient = document.getElementById("patient").value.trim();
    if (device) metadata.device = device;
    if (patient) metadata.patient_ref = patient;
    if (job.sidecar) {
      try {
        Object.assign(metadata, JSON.parse(await job.sidecar.text()));
      } catch (error) {
        show(job, "failed", `${job.sidecar.name}: ${error.message}`);
        retryButton(job);
        return;
      }
    }
    const body = new FormData();
    body.append("recording", job.file, job.file.name);
    body.append("metadata", new Blob([JSON.stringify(metadata)], { type: "application/json" }));
    const clinic = document.getElementById("clinic");
    const query = clinic ? `?clinic=${encodeURIComponent(clinic.value)}` : "";
    await new Promise((finished) => {
      const request = new XMLHttpRequest();
      request.open("POST", `/v1/sessions${query}`);
      request.setRequestHeader("X-CSRF-Token", box.dataset.csrf);
      request.setRequestHeader("Accept", "application/json");
      request.upload.addEventListener("progress", (event) => { if (event.lengthComputable) job.bar.value = event.loaded / event.total; });
      request.upload.addEventListener("load", () => show(job, "scoring"));
      request.addEventListener("load", () => { answered(job, request); finished(); });
      request.addEventListener("error", () => { show(job, "failed", words.offline); retryButton(job); finished(); });
      request.send(body);
    });
  }

  function answered(job, request) {
    let told = {};
    try { told = JSON.parse(request.responseText); } catch { /* not from the service */ }
    if (request.status === 200 || request.status === 201) {
      const differing = request.getResponseHeader("Inhalemon-Differing");
      const text = [words.grades[told.grade], differing && `${words.differing}: ${differing}`].filter(Boolean).join(" – ");
      show(job, request.status === 200 ? "known" : "done", text);
      openLink(job, told.id);
      return;
    }
    const kind = String(told.type || "").split(":").pop();
    const where = [told.line && `${words.line} ${told.line}`, told.column && `${words.column} ${told.column}`].filter(Boolean).join(", ");
    const text = [problems[kind] || told.title || String(request.status), where, told.detail].filter(Boolean).join(" – ");
    const isKept = (request.status === 503 || request.status === 500) && told.session;
    show(job, isKept ? "kept" : "failed", text);
    retryButton(job);
    if (told.session) openLink(job, told.session);
  }

  function openLink(job, id) {
    if (!id || !words.may_open) return;
    const link = document.createElement("a");
    link.href = `/sessions/${id}`;
    link.textContent = words.open;
    link.setAttribute("aria-label", `${words.open}: ${job.file.name}`);
    if (job.state === "failed") job.acts.prepend(link); else job.acts.replaceChildren(link);
  }
  function retryButton(job) {
    const retry = document.createElement("button"), remove = document.createElement("button");
    for (const [button, text] of [[retry, words.retry], [remove, words.remove]]) {
      button.type = "button";
      button.textContent = text;
      button.setAttribute("aria-label", `${text}: ${job.file.name}`);
    }
    retry.addEventListener("click", () => { show(job, "waiting"); pump(); });
    remove.addEventListener("click", () => {
      jobs.splice(jobs.indexOf(job), 1);
      job.item.remove();
      if (jobs.length) show(jobs[0], jobs[0].state, jobs[0].told.textContent); else summary.textContent = "";
      input.focus();
    });
    if (isSidecar(job.file)) job.acts.replaceChildren(remove); else job.acts.replaceChildren(retry, remove);
  }

  input.addEventListener("change", () => { add(input.files); input.value = ""; });
  for (const kind of ["dragenter", "dragover"]) {
    document.addEventListener(kind, (event) => { event.preventDefault(); drop.classList.add("over"); });
  }
  document.addEventListener("dragleave", (event) => { if (!event.relatedTarget) drop.classList.remove("over"); });
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    drop.classList.remove("over");
    add(event.dataTransfer.files);
  });
  addEventListener("beforeunload", (event) => { if (running) event.preventDefault(); });
})();
