"use strict";
const $ = (id) => document.getElementById(id);
const POLL_MS = 500;
const MOST_LISTED = 200;
const state = { version: "", map: "", now: null, flown: null, flownOf: "", chosen: null, moment: null, playing: false };

// Everything that comes from a run is put in as text, never as HTML.
function el(tag, props = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(props)) {
    if (name === "onclick") node.addEventListener("click", value);
    else if (value !== null && value !== undefined && value !== false) node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children.map((c) => (c instanceof Node ? c : document.createTextNode(c))));
  return node;
}
async function get(path) {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error(`${answer.status}`);
  return answer.json();
}
const percent = (p) => `${Math.round(100 * p)} %`;
const clock = (ms) => new Date(ms).toISOString().slice(11, 19) + "Z";

// --- time

function span() {
  const flights = (state.flown || { flights: [] }).flights.filter((f) => f.times_s.length);
  if (!flights.length) return null;
  const from = Math.min(...flights.map((f) => f.start_ms + 1000 * f.times_s[0]));
  const to = Math.max(...flights.map((f) => f.start_ms + 1000 * f.times_s[f.times_s.length - 1]));
  return [from, reached() ?? to];
}
function reached() {
  if (!state.now || state.now.state !== "flying") return null;
  const newest = Object.values((state.now.run.reducer || {}).newest_ns || {});
  return newest.length ? Math.max(...newest) / 1e6 : null;
}
function moment() {
  const s = span();
  return s === null ? Infinity : state.moment === null ? s[1] : Math.min(state.moment, s[1]);
}
function seenBy(place, ms) {
  const from = Date.parse(place.said.seen_from.endsWith("Z") ? place.said.seen_from : place.said.seen_from + "Z");
  return !(from > ms);
}

// --- drawing

function places() { return state.now ? state.now.places.filter((p) => seenBy(p, moment())) : []; }
function order(list) { return [...list].sort((a, b) => b.decided - a.decided || a.id - b.id); }
function inOrder() {
  const all = places();
  return [...order(all.filter((p) => p.kind === "found")), ...order(all.filter((p) => p.kind === "possible"))];
}
function down() {
  const links = (state.now && state.now.run.status && state.now.run.status.links) || [];
  return new Set(links.filter((l) => Object.keys(l.down || {}).length).map((l) => l.stream));
}
function draw() {
  if (!state.now) return;
  const shown = places();
  SearchMap.layer($("layer").value, state.now.layer, state.map);
  if (state.flown) SearchMap.drones(state.flown.flights, moment(), down());
  SearchMap.drawPlaces(shown, state.chosen, choose);
  list("found", shown.filter((p) => p.kind === "found"));
  list("possible", shown.filter((p) => p.kind === "possible"));
  $("moment").textContent = Number.isFinite(moment()) ? `as of ${clock(moment())}` : "time";
  $("ramp").className = `ramp ${$("layer").value}`;
  one();
  going();
}
function list(kind, of) {
  const head = $(`${kind}-head`);
  head.textContent = `${kind === "found" ? "Found" : "Possible"}: ${of.length}`;
  const focused = document.activeElement && document.activeElement.dataset ? document.activeElement.dataset.place : null;
  const sorted = order(of), listed = sorted.filter((p, k) => k < MOST_LISTED || p.id === state.chosen);
  const more = sorted.length - listed.length;
  $(kind).replaceChildren(...listed.map((p) => {
    const mark = p.conflict ? "reviewers disagree" : p.net > 0 ? "✓ confirmed" : p.net < 0 ? "✕ rejected" : "";
    return el("li", {}, el("button", { type: "button", "data-place": p.id, "aria-current": p.id === state.chosen ? "true" : null,
      class: p.net < 0 ? "rejected" : null, onclick: () => choose(p.id) },
      el("strong", {}, `${p.id}`), el("span", {}, `${p.class} ${percent(p.decided)}`),
      el("span", { class: "dim" }, `±${p.ellipse[0].toFixed(1)} m`), el("span", {}, mark)));
  }), ...(more ? [el("li", { class: "dim" }, `${more} less probable ones are on the map; j goes on to them`)] : []));
  if (focused) { const again = document.querySelector(`[data-place="${Number(focused)}"]`); if (again) again.focus({ preventScroll: true }); }
}
let drawnPlace = "";
function one() {
  const p = state.now.places.find((q) => q.id === state.chosen);
  $("place").hidden = !p;
  const key = JSON.stringify(p || null);
  if (key === drawnPlace) return;
  drawnPlace = key;
  if (!p) { $("place").replaceChildren(); return; }
  const standing = p.decisions.map((d) => el("li", {}, `${d.at.slice(0, 19)}Z ${d.who}: ${d.kind}${d.text ? " – " + d.text : ""}`));
  $("place").replaceChildren(
    el("h2", {}, `Place ${p.id}: ${p.class}, ${percent(p.decided)}`),
    el("p", {}, p.net ? `${percent(p.probability)} by the pictures; reviewers: ${p.net > 0 ? "+" : ""}${p.net}` : `${percent(p.probability)} by the pictures`,
      p.conflict ? "; reviewers disagree" : ""),
    el("p", {}, `${p.latitude_deg.toFixed(6)}, ${p.longitude_deg.toFixed(6)}; 95 % within ${p.ellipse[0].toFixed(1)} x ${p.ellipse[1].toFixed(1)} m`),
    el("p", { class: "dim" }, `seen ${p.said.seen_from} to ${p.said.seen_to} by ${(p.said.streams || []).join(", ")}; ${p.said.sightings} sightings`),
    el("div", { class: "bar" },
      el("button", { type: "button", id: "confirm", onclick: () => decide("confirm") }, "confirm (c)"),
      el("button", { type: "button", id: "reject", onclick: () => decide("reject") }, "reject (r)"),
      el("button", { type: "button", id: "note", onclick: note }, "note (n)"),
      el("button", { type: "button", id: "undo", onclick: undo }, "undo (u)")),
    el("div", { class: "bar", id: "note-bar", hidden: true },
      el("label", {}, "Note", el("input", { id: "note-text", maxlength: "500" })),
      el("button", { type: "button", onclick: sendNote }, "keep")),
    el("ul", {}, ...standing),
    el("div", { class: "pictures" }, ...(p.seen.length ? p.seen : [null]).map((s, k) => figure(p, s, k))));
}
function figure(p, s, k) {
  const picture = el("img", { src: `/crop/${p.id}/${k}?t=${s ? s.time_s : 0}`, width: "180", height: "180", loading: "lazy",
    alt: s ? `place ${p.id} as ${s.stream} saw it at ${s.time_s.toFixed(1)} s` : `place ${p.id}` });
  picture.addEventListener("error", () => picture.replaceWith(el("p", { class: "dim" }, "no picture: its video is not there")));
  if (!s) return el("figure", {}, picture);
  return el("figure", {}, picture, el("figcaption", {}, `${s.stream}, ${s.time_s.toFixed(1)} s, score ${s.score.toFixed(2)}`),
    el("button", { type: "button", onclick: () => play(s.stream, s.time_s) }, "play"));
}
function table(head, rows) {
  return el("table", {}, el("thead", {}, el("tr", {}, ...head.map((h) => el("th", { scope: "col" }, h)))),
    el("tbody", {}, ...rows.map((r) => el("tr", {}, ...r.map((c) => el("td", {}, String(c)))))));
}
const reasons = (d) => Object.entries(d || {}).map(([r, n]) => `${r.replaceAll("_", " ")} ${n}`).join(", ") || "none";
function going() {
  const run = state.now.run, parts = [];
  if (state.now.state === "flying") {
    const s = run.status;
    parts.push(table(["stream", "captured", "looked at", "on the way", "dropped"], Object.entries(s.streams || {}).map(
      ([name, c]) => [name, c.captured, c.processed, c.in_flight ?? "", reasons(c.dropped)])));
    if (s.links && s.links.length) parts.push(table(["link", "Mbit/s", "waiting, s", "state"], s.links.map((l) => [
      `${l.stream} to ${l.site}`, l.rate_bps === null ? "no limit" : (l.rate_bps / 1e6).toFixed(1), l.backlog_s ?? "",
      Object.values(l.down || {}).join(", ") || (l.full ? "full" : "up")])));
    if (s.machines) parts.push(table(["machine", "packets waiting"], Object.entries(s.machines).map(([n, m]) => [
      n, (s.lost || []).includes(`machine:${n}`) ? "lost" : m.waiting])));
    parts.push(table(["plan: stream", "looked at by", "every", "Mbit/s"], (s.plan || []).map((a) => [
      a.stream, a.detector, a.period === 1 ? "picture" : `${a.period} pictures`, (a.bitrate_bps / 1e6).toFixed(2)])));
    if ((s.timeline || []).length) parts.push(table(["s", "what happened"], s.timeline.slice(-20).reverse().map((t) => [
      t.at_s, `${t.what} ${t.subject} ${t.detail}`])));
  } else {
    parts.push(table(["stream", "captured", "looked at", "dropped"], (run.streams || []).map((s) => [
      s.stream, s.captured, s.processed, reasons(s.dropped)])));
    parts.push(table(["looked at by", "machine", "frames", "boxes"], (run.substreams || []).map((s) => [
      s.detector, s.machine, s.processed, s.detections])));
    if (run.coverage) parts.push(el("p", {}, `${run.coverage.looked_at_m2} m² looked at; nobody looked at ${run.coverage.nobody_looked_m2} m².`));
    if ((run.timeline || []).length) parts.push(table(["s", "what happened"], run.timeline.map((t) => [t.at_s, `${t.what} ${t.subject} ${t.detail}`])));
  }
  const lost = state.now.lost_decisions;
  if (lost.length) parts.unshift(el("p", { class: "warning" }, `${lost.length} decisions are of places that are not on the map (any more): ${
    lost.map((d) => `${d.who} ${d.kind} ${d.latitude_deg.toFixed(6)}, ${d.longitude_deg.toFixed(6)}`).join("; ")}`));
  if (state.now.unreadable_decisions) parts.unshift(el("p", { class: "warning" }, `${state.now.unreadable_decisions} lines of decisions.jsonl cannot be read.`));
  $("going").replaceChildren(...parts);
}
function head() {
  const flying = state.now.state === "flying", run = state.now.run;
  const verdict = flying ? run.reducer.verdict : run.verdict;
  $("mission").textContent = (flying ? run.status.mission : run.mission) || "Searchlight";
  $("state").textContent = flying ? `flying, ${run.status.seconds ?? 0} s; map as of ${(run.reducer.at || "").slice(11, 19)}Z` : "finished";
  const warnings = [];
  if (verdict && verdict.kind === "cannot_be_trusted") warnings.push(verdict.sentence);
  if (flying && (run.status.lost || []).length) warnings.push(`lost: ${run.status.lost.join(", ")}`);
  if (flying && run.reducer.too_large) warnings.push("The map is too large to be shown while it grows.");
  if (!flying && run.partial) warnings.push("This run ended before its streams did.");
  $("warning").hidden = !warnings.length;
  if ($("warning").textContent !== warnings.join(" ")) $("warning").textContent = warnings.join(" ");
  $("verdict").textContent = verdict ? verdict.sentence : "";
}

// --- what is asked of the server

async function refresh() {
  try {
    const { version, map } = await get("/api/version");
    if (version !== state.version) {
      // thousands of places are asked for again only if the map has changed
      const now = map === state.map ? { ...state.now, ...await get("/api/said") } : await get("/api/now");
      state.now = now;
      state.version = version;
      state.map = map;
      if (state.flownOf !== now.state) { state.flown = await get("/api/flown"); state.flownOf = now.state; SearchMap.flown(state.flown); }
      head();
      draw();
      document.body.dataset.ready = "yes";
    }
    if (state.gone) { state.gone = false; head(); }
  } catch (error) {
    state.gone = true;
    $("state").textContent = "the server does not answer; what is shown may be old";
  }
}
async function loop() { await refresh(); setTimeout(loop, POLL_MS); }

function who() {
  const name = $("who").value.trim();
  if (!name) { say("Say who you are first."); $("who").focus(); }
  return name;
}
function say(text) { $("said").textContent = text; }
async function send(body) {
  const answer = await fetch("/api/decide", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
  const said = await answer.json().catch(() => ({ error: `refused (${answer.status})` }));
  say(answer.ok ? `${body.kind}: written as number ${said.number}` : said.error);
  await refresh();
}
async function decide(kind, text = "") {
  const name = who();
  if (!name || state.chosen === null) return;
  await send({ who: name, kind, place: state.chosen, text });
}
async function undo() {
  const name = who(), p = state.now.places.find((q) => q.id === state.chosen);
  if (!name || !p) return;
  const mine = p.decisions.filter((d) => d.who === name).pop();
  if (!mine) { say("You have decided nothing about this place."); return; }
  await send({ who: name, kind: "undo", place: p.id, undoes: mine.number });
}
function note() { $("note-bar").hidden = false; $("note-text").focus(); }
async function sendNote() {
  const text = $("note-text").value.trim();
  $("note-bar").hidden = true;
  if (text) await decide("note", text);
}
function choose(id) {
  state.chosen = id;
  const p = state.now.places.find((q) => q.id === id);
  if (p) SearchMap.show(p);
  draw();
  const button = document.querySelector(`[data-place="${id}"]`);
  if (button) button.scrollIntoView({ block: "nearest" });
}
function step(by) {
  const all = inOrder();
  if (!all.length) return;
  const k = all.findIndex((p) => p.id === state.chosen);
  choose(all[k < 0 ? 0 : Math.min(all.length - 1, Math.max(0, k + by))].id);
}
function play(stream, time_s, video = null, video_s = null) {
  const flight = state.flown.flights.find((f) => f.stream === stream);
  if (!flight || !flight.videos.length) { say("This stream has no video."); return; }
  let number = video;
  if (number === null) { number = 0; flight.videos.forEach((from, k) => { if (from <= time_s) number = k; }); }
  const at = video_s === null ? time_s - flight.videos[number] : video_s;
  const player = $("video"), source = `/video/${encodeURIComponent(stream)}/${number}`;
  player.hidden = false;
  if (player.getAttribute("src") !== source) player.setAttribute("src", source);
  const from = () => { player.currentTime = Math.max(0, at - 1); player.play().catch(() => {}); };
  if (player.readyState >= 1) from(); else player.addEventListener("loadedmetadata", from, { once: true });
  player.scrollIntoView({ block: "nearest" });
}
async function ask(east, north) {
  SearchMap.mark(east, north);
  const said = await get(`/api/saw?e=${east}&n=${north}`);
  const rows = said.seen.map((s) => el("li", {}, `${s.stream}: ${s.from_s.toFixed(1)} to ${s.to_s.toFixed(1)} s `,
    s.video === undefined ? "" : el("button", { type: "button", onclick: () => play(s.stream, s.best_s, s.video, s.video_s) }, `play at ${s.best_s.toFixed(1)} s`)));
  const none = said.known ? "No camera saw this point." : "This run did not keep where its cameras were.";
  $("point").replaceChildren(el("p", {}, `${said.latitude_deg.toFixed(6)}, ${said.longitude_deg.toFixed(6)}: `, rows.length ? "seen by" : none), el("ul", {}, ...rows));
}

// --- keys and controls

const keys = { j: () => step(1), k: () => step(-1), c: () => decide("confirm"), r: () => decide("reject"), n: note, u: undo,
  "?": () => { $("keys").hidden = !$("keys").hidden; },
  Enter: () => { const p = state.now.places.find((q) => q.id === state.chosen); if (p && p.seen.length) play(p.seen[0].stream, p.seen[0].time_s); } };
document.addEventListener("keydown", (event) => {
  const tag = event.target.tagName;
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target.id === "note-text" && event.key === "Enter") { sendNote(); return; }
  if (tag === "INPUT" && event.target.type !== "range" || tag === "SELECT" || event.key === "Enter" && tag === "BUTTON") return;
  if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
});
$("layer").addEventListener("change", draw);
$("whole").addEventListener("click", () => SearchMap.fit());
$("help").addEventListener("click", keys["?"]);
$("time").addEventListener("input", () => {
  const s = span(), share = Number($("time").value) / 1000;
  state.moment = s === null || share >= 1 ? null : s[0] + share * (s[1] - s[0]);
  draw();
});
$("play").addEventListener("click", () => { state.playing = !state.playing; $("play").textContent = state.playing ? "pause" : "replay"; tick(); });
function tick() {
  if (!state.playing) return;
  const slider = $("time");
  slider.value = Number(slider.value) >= 1000 ? 0 : Number(slider.value) + 10;
  slider.dispatchEvent(new Event("input"));
  if (Number(slider.value) < 1000) setTimeout(tick, 200); else { state.playing = false; $("play").textContent = "replay"; }
}
try { $("who").value = localStorage.getItem("who") || ""; } catch (_) { /* private window */ }
$("who").addEventListener("change", () => { try { localStorage.setItem("who", $("who").value.trim()); } catch (_) { /* private window */ } });
SearchMap.map.setView([0, 0], 0);
SearchMap.map.on("click", (event) => ask(event.latlng.lng, event.latlng.lat));
loop();
