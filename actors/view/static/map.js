"use strict";
// The map: metres east and north, drawn on one canvas; 5,000 places stay quick.
const SearchMap = (() => {
  const at = (p) => [p[1], p[0]];
  const bounds = (b) => [[b[1], b[0]], [b[3], b[2]]];
  const map = L.map("map", { crs: L.CRS.Simple, preferCanvas: true, minZoom: -6, maxZoom: 8, zoomSnap: 0.5,
    attributionControl: false, keyboard: true, zoomAnimation: false, zoomControl: false, fadeAnimation: false });
  map.createPane("ground").style.zIndex = 150;
  map.createPane("layer").style.zIndex = 250;
  L.control.zoom({ position: "topright" }).addTo(map);
  L.control.scale({ imperial: false, maxWidth: 160 }).addTo(map);
  const fixed = L.layerGroup().addTo(map), moving = L.layerGroup().addTo(map), places = L.layerGroup().addTo(map);
  const labels = L.layerGroup().addTo(map);
  let grid = [];
  let image = null, shown = "", whole = null, fitted = false;

  function line(points, style, group) { return L.polyline(points.map(at), { interactive: false, ...style }).addTo(group); }
  function label(point, text, group) {
    L.tooltip({ permanent: true, direction: "top", offset: [0, -8], className: "label", interactive: false })
      .setLatLng(at(point)).setContent(document.createTextNode(text)).addTo(group);
  }
  function text(value) { const span = document.createElement("span"); span.textContent = value; return span; }

  function flown(data) {
    fixed.clearLayers();
    if (data.ground) L.imageOverlay("/hillshade.png", bounds(data.ground), { pane: "ground", alt: "" }).addTo(fixed);
    for (const c of data.contours) for (const l of c.lines) {
      line(l, { color: "#c9a66b", weight: c.index ? 1.6 : .8, opacity: c.index ? .6 : .35 }, fixed);
    }
    for (const c of data.contours.filter((one) => one.index)) {
      const longest = c.lines.reduce((a, b) => (b.length > a.length ? b : a)), middle = longest[longest.length >> 1];
      L.tooltip({ permanent: true, direction: "center", className: "label", interactive: false })
        .setLatLng(at(middle)).setContent(text(`${c.height_m} m`)).addTo(fixed);
    }
    for (const g of data.grid) {
      line(g.points, { color: "#8fa3bf", weight: 1, opacity: .45 }, fixed);
    }
    grid = data.grid;
    gridLabels();
    for (const ring of data.area) L.polygon(ring.map(at), { color: "#fff", weight: 2, dashArray: "10 6", fill: false,
      interactive: false }).addTo(fixed);
    for (const ring of data.second_look) L.polygon(ring.map(at), { color: "#e0a0ff", weight: 2, dashArray: "2 5",
      fillOpacity: .08, interactive: false }).addTo(fixed);
    whole = data.ground;
    const points = data.flights.flatMap((f) => f.points.concat(...f.footprints.filter(Boolean)));
    if (points.length) {
      const es = points.map((p) => p[0]), ns = points.map((p) => p[1]);
      whole = [Math.min(...es), Math.min(...ns), Math.max(...es), Math.max(...ns)];
    }
    if (!fitted) fit();
  }
  // Labels stand at the edge of what is shown, wherever that is.
  function gridLabels() {
    labels.clearLayers();
    const view = map.getBounds(), west = view.getWest(), north = view.getNorth();
    for (const g of grid) {
      const level = g.axis === "latitude", [along, across] = level ? [0, 1] : [1, 0], edge = level ? west : north;
      const p = g.points, a = p[0], b = p[p.length - 1], share = (edge - a[along]) / (b[along] - a[along]);
      const value = a[across] + share * (b[across] - a[across]);
      L.tooltip({ permanent: true, direction: level ? "right" : "bottom", className: "label", offset: [0, 0] })
        .setLatLng(level ? [value, west] : [north, value]).setContent(text(g.label)).addTo(labels);
    }
  }
  map.on("moveend", gridLabels);
  function fit() { if (whole) { map.fitBounds(bounds(whole)); fitted = true; } else if (!fitted) map.setView([0, 0], 0); }

  function layer(name, box, version) {
    const key = name + version + box;
    if (key === shown) return;
    shown = key;
    if (name === "none" || !box) { if (image) image.remove(); image = null; return; }
    const next = L.imageOverlay(`/${name}.png?v=${encodeURIComponent(version)}`, bounds(box), { pane: "layer", alt: "" });
    const before = image;
    image = next;
    next.on("load error", () => { if (before) before.remove(); });
    next.addTo(map);
  }

  function ellipse(p) {
    const [a, b, turn] = p.ellipse, t = turn * Math.PI / 180, points = [];
    for (let k = 0; k < 24; k++) {
      const u = a * Math.cos(k * Math.PI / 12), v = b * Math.sin(k * Math.PI / 12);
      points.push(at([p.east_m + u * Math.sin(t) + v * Math.cos(t), p.north_m + u * Math.cos(t) - v * Math.sin(t)]));
    }
    return points;
  }
  function drawPlaces(list, chosen, choose) {
    places.clearLayers();
    const named = list.length <= 60, outlined = list.length <= 500;
    for (const p of list) {
      const possible = p.kind === "possible", mine = p.id === chosen;
      const colour = p.net < 0 ? "#9a9a9a" : possible ? "#56b4e9" : "#ffb000";
      if (outlined || mine) L.polygon(ellipse(p), { color: colour, weight: 1.5, fillOpacity: .1, interactive: false }).addTo(places);
      const dot = L.circleMarker(at([p.east_m, p.north_m]), { radius: mine ? 13 : 9, color: mine ? "#fff" : colour,
        weight: mine ? 4 : 3, dashArray: possible ? "4 4" : null, fillColor: colour,
        fillOpacity: p.net > 0 ? .9 : possible ? .05 : .35, bubblingMouseEvents: false });
      dot.on("click", () => choose(p.id));
      dot.addTo(places);
      if (named || mine) dot.bindTooltip(text(`${p.id}${p.net > 0 ? " ✓" : p.net < 0 ? " ✕" : ""}`),
        { permanent: true, direction: "right", offset: [8, 0], className: "label" });
    }
  }
  const colours = ["#009e73", "#cc79a7", "#f0e442", "#d55e00", "#0072b2", "#ffffff"];
  function drones(flights, now_ms, down) {
    moving.clearLayers();
    flights.forEach((f, k) => {
      const colour = colours[k % colours.length];
      let last = -1;
      while (last + 1 < f.times_s.length && f.start_ms + 1000 * f.times_s[last + 1] <= now_ms) last++;
      if (last < 0) return;
      line(f.points.slice(0, last + 1), { color: colour, weight: 2, opacity: .9 }, moving);
      const print = f.footprints[last];
      if (print) L.polygon(print.map(at), { color: colour, weight: 2, fillOpacity: .08, interactive: false }).addTo(moving);
      const dead = down.has(f.stream);
      L.circleMarker(at(f.points[last]), { radius: 7, color: "#000", weight: 2, fillColor: dead ? "#ff5050" : colour,
        fillOpacity: 1, interactive: false }).addTo(moving);
      label(f.points[last], f.stream + (dead ? ": link down" : ""), moving);
    });
  }
  const mark = L.circleMarker([0, 0], { radius: 5, color: "#fff", weight: 2, interactive: false });
  return { map, flown, fit, layer, drawPlaces, drones,
    mark: (e, n) => mark.setLatLng([n, e]).addTo(map),
    show: (p) => { if (!map.getBounds().contains(at([p.east_m, p.north_m]))) map.panTo(at([p.east_m, p.north_m]), { animate: false }); } };
})();
