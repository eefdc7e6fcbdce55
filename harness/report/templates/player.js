"use strict";
// Pairs drawn from their traces: top views of both arms, and v, R and T_adv of the egos over time.
(() => {
  const source = document.getElementById("player-data");
  if (!source) return;
  const data = JSON.parse(source.textContent);
  const root = document.getElementById("player");
  const part = (name) => document.getElementById(`player-${name}`);
  const speeds = [...part("speed").options].map((option) => option.value);
  const ns = "http://www.w3.org/2000/svg";
  const state = { episode: 0, time: 0, end: 0, step: 0.1, playing: false, before: 0 };
  let views = [];
  let charts = [];

  function make(tag, attributes = {}, parent = null, text = "") {
    const element = document.createElementNS(ns, tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    if (text) element.textContent = text;
    if (parent) parent.append(element);
    return element;
  }
  function html(tag, className, parent, text = "") {
    const element = document.createElement(tag);
    if (className) element.className = className;
    element.textContent = text;
    parent.append(element);
    return element;
  }

  // Finds a time in a sorted list: index of the last time not after it, of the next one, and the share in between.
  // Null before the first and after the last.
  function at(times, time) {
    if (!times.length || time < times[0] - 1e-9 || time > times[times.length - 1] + 1e-9) return null;
    let low = 0, high = times.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (times[middle] <= time + 1e-9) low = middle; else high = middle - 1;
    }
    const next = Math.min(low + 1, times.length - 1);
    const share = next > low ? (time - times[low]) / (times[next] - times[low]) : 0;
    return [low, next, Math.min(1, Math.max(0, share))];
  }
  // A column that never changes is one number.
  function between(values, [low, next, share]) {
    if (!Array.isArray(values)) return values;
    return values[low] === null || values[next] === null ? values[low] : values[low] + share * (values[next] - values[low]);
  }
  function place(track, time) {
    const where = at(track.t, time);
    return where && [between(track.x, where), between(track.y, where)];
  }
  function put(element, where) {
    element.style.display = where ? "" : "none";
    if (where) element.setAttribute("transform", `translate(${where[0]} ${where[1]})`);
  }
  const text = (value, unit, digits = 1) =>
    value === null || value === undefined ? "undefined" : `${value.toFixed(digits)} ${unit}`;
  const last = (times) => times[times.length - 1];

  // --- top views: drawn in metres of the road frame, y upwards ------------------------------
  function view(arm, scene) {
    const box = html("div", "view", part("views"));
    box.dataset.arm = arm.arm;
    const head = html("h4", "", box);
    html("i", "", head);
    head.append(arm.title);
    if (arm.words) html("p", "", box, arm.words);
    const { left, right } = scene;
    const low = -3.5, high = scene.length + 3.5;
    const svg = make("svg", {
      viewBox: `${left} ${-high} ${right - left} ${high - low}`, role: "img",
      "aria-label": `Top view, ${arm.title}: vehicles on the road, pedestrians on the crosswalk`,
    }, box);
    const world = make("g", { transform: "scale(1,-1)" }, svg);
    const half = scene.width / 2;
    make("rect", { class: "path", x: -half, y: low, width: scene.width, height: high - low }, world);
    make("rect", { class: "road", x: left, y: 0, width: right - left, height: scene.length }, world);
    for (const y of scene.borders) {
      make("line", { class: "middle", x1: left, x2: right, y1: y, y2: y }, world);
    }
    for (let y = 0.25; y + 0.5 <= scene.length; y += 1) {
      make("rect", { class: "stripe", x: -half, y, width: scene.width, height: 0.5 }, world);
    }
    if (scene.stop) {
      const [x, y1, y2] = scene.stop;
      make("line", { class: "stop", x1: x, x2: x, y1, y2 }, world);
    }
    for (const [west, east, south, north] of scene.obstacles) {
      const obstacle = make("rect", { class: "obstacle", x: west, y: south, width: east - west, height: north - south }, world);
      make("title", {}, obstacle, "obstacle");
    }
    const side = scene.carWidth / 2;
    const vehicle = make("g", {}, world);
    make("rect", { class: "ego", x: -scene.carLength, y: -side, width: scene.carLength, height: 2 * side, rx: 0.35 }, vehicle);
    make("rect", { class: "ego-front", x: -1.5, y: -side * 0.75, width: 0.6, height: side * 1.5, rx: 0.15 }, vehicle);
    const walkers = arm.walkers.map((walker) => {
      const group = make("g", { "data-pedestrian": walker.index }, world);
      make("circle", { class: "halo", r: 0.7 }, group);
      make("circle", { class: "walker", r: scene.radius }, group);
      make("title", {}, group, `pedestrian ${walker.index}, ${walker.side} side`);
      return group;
    });
    // Where the strategy perceives the pedestrians: squares, held from one state to the next.
    const ghosts = arm.shown.map((shown) => {
      const square = make("rect", { class: "ghost", "data-shown": shown.index, x: -0.5, y: -0.5, width: 1, height: 1 }, world);
      make("title", {}, square, `pedestrian ${shown.index} as the strategy is shown them`);
      return square;
    });
    return { arm, scene, box, vehicle, walkers, ghosts, readout: html("p", "readout", box) };
  }

  function drawView({ arm, scene, box, vehicle, walkers, ghosts, readout }) {
    const ego = arm.ego;
    if (!ego.t.length) { readout.textContent = "no trace"; put(vehicle, null); return; }
    // An arm that has ended keeps its last state.
    const end = last(ego.t), time = Math.min(state.time, end);
    put(vehicle, place(ego, time));
    arm.walkers.forEach((walker, number) => {
      const group = walkers[number];
      put(group, position(walker, scene, time));
      group.classList.toggle("waiting", walker.start === null || time < walker.start);
      const hit = arm.contact && arm.contact.index === walker.index && state.time >= arm.contact.time;
      group.classList.toggle("hit", Boolean(hit));
    });
    arm.shown.forEach((shown, number) => {
      const now = ego.t[at(ego.t, time)[0]], where = at(shown.t, now);
      const held = where && now - shown.t[where[0]] < 1e-6;
      put(ghosts[number], held && [0, between(shown.y, [where[0], where[0], 0])]);
    });
    const where = at(ego.t, time);
    const x = between(ego.x, where), v = between(ego.v, where), gap = between(ego.gap, where);
    box.dataset.x = x;
    box.dataset.v = v;
    const over = state.time > end + 1e-9 ? ` (ended at ${end.toFixed(1)} s)` : "";
    readout.textContent =
      `v ${text(v, "m/s")} · R ${text(-x, "m")} · T_adv ${text(gap, "s")}${over}`;
  }

  // Pedestrians wait at the kerb from arrival to start, then follow the trace; null while they are absent.
  function position(walker, scene, time) {
    if (time < walker.arrival) return null;
    if (walker.start === null || time < walker.start) return waiting(walker, scene);
    if (!walker.t.length || time > last(walker.t) + 1e-9) return null;
    return place(walker, Math.max(time, walker.t[0]));
  }
  function waiting(walker, scene) {
    const first = !walker.t.length ? null : place(walker, walker.t[0])[1];
    // A pedestrian who steps off from the kerb is at most one step's walk into the road in their first state.
    if (first !== null && first > 0.5 && first < scene.length - 0.5) return [0, first];
    return [0, walker.side === "near" ? -0.6 : scene.length + 0.6];
  }

  // --- v, R and T_adv over time ------------------------------------------------------------------
  const measures = [
    ["v (m/s)", (ego) => ego.v, 0],
    ["R (m)", (ego) => ego.t.map((_, k) => -between(ego.x, [k, k, 0])), null],
    ["T_adv (s)", (ego) => ego.gap, 0],
  ];
  const margin = { left: 44, right: 10, top: 19, bottom: 16 };

  function ticks(low, high, most) {
    const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw * 0.999);
    const places = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9; k++) places.push(+(k * step).toPrecision(10));
    return places;
  }

  function chart([label, values, floor], arms) {
    const width = Math.max(260, part("charts").clientWidth), height = 108;
    const series = arms.map((arm) => [arm, arm.ego, values(arm.ego)]);
    const all = series.flatMap(([, , column]) => column).filter((value) => value !== null);
    let low = floor ?? Math.min(0, ...all), high = Math.max(...all, low + 1);
    if (label.startsWith("T")) high = Math.min(high, 15);
    const svg = make("svg", { viewBox: `0 0 ${width} ${height}`, height, role: "img", "aria-label": `${label} of both arms over the time` }, part("charts"));
    const px = (time) => margin.left + (time / state.end) * (width - margin.left - margin.right);
    const py = (value) => height - margin.bottom - ((value - low) / (high - low)) * (height - margin.top - margin.bottom);
    for (const tick of ticks(low, high, 3)) {
      make("line", { class: tick === 0 && low < 0 ? "zero" : "axis", x1: margin.left, x2: width - margin.right, y1: py(tick), y2: py(tick) }, svg);
      make("text", { x: margin.left - 6, y: py(tick) + 4, "text-anchor": "end" }, svg, String(tick));
    }
    for (const tick of ticks(0, state.end, Math.max(3, Math.floor(width / 110)))) {
      make("line", { class: "axis", x1: px(tick), x2: px(tick), y1: margin.top, y2: height - margin.bottom }, svg);
      make("text", { x: px(tick), y: height - 3, "text-anchor": "middle" }, svg, `${tick}`);
    }
    make("text", { x: 2, y: 10 }, svg, label);
    for (const [arm, ego, column] of series) {
      let path = "", pen = false;
      ego.t.forEach((time, number) => {
        const value = column[number];
        if (value === null || value > high) { pen = false; return; }
        path += `${pen ? "L" : "M"}${px(time).toFixed(1)} ${py(value).toFixed(1)}`;
        pen = true;
      });
      make("path", { class: arm.arm, d: path || "M0 0" }, svg);
    }
    const cursor = make("line", { class: "cursor", y1: margin.top, y2: height - margin.bottom }, svg);
    const dots = series.map(([arm, ego, column]) => [ego, column, make("circle", { class: `dot-${arm.arm}`, r: 3.5 }, svg)]);
    const seek = (event) => {
      const box = svg.getBoundingClientRect();
      const share = ((event.clientX - box.left) * (width / box.width) - margin.left) / (width - margin.left - margin.right);
      pause();
      go(share * state.end);
    };
    svg.addEventListener("pointerdown", (event) => { svg.setPointerCapture(event.pointerId); seek(event); });
    svg.addEventListener("pointermove", (event) => { if (event.buttons) seek(event); });
    return { cursor, dots, px, py, high };
  }

  function drawChart({ cursor, dots, px, py, high }) {
    cursor.setAttribute("x1", px(state.time));
    cursor.setAttribute("x2", px(state.time));
    for (const [ego, column, dot] of dots) {
      const where = at(ego.t, state.time);
      const value = where && between(column, where);
      dot.style.display = value === null || value > high ? "none" : "";
      if (dot.style.display === "") { dot.setAttribute("cx", px(state.time)); dot.setAttribute("cy", py(value)); }
    }
  }

  // --- time and episodes -------------------------------------------------------------------------
  function go(time) {
    state.time = Math.min(state.end, Math.max(0, time));
    root.dataset.time = state.time;
    part("time").value = state.time;
    part("time").setAttribute("aria-valuetext", `${state.time.toFixed(1)} seconds`);
    part("clock").textContent = `${state.time.toFixed(1)} s`;
    views.forEach(drawView);
    charts.forEach(drawChart);
  }
  function toStep(steps) { pause(); go((Math.round(state.time / state.step) + steps) * state.step); }
  function pause() { state.playing = false; part("play").textContent = "Play"; root.dataset.playing = "false"; }
  function play() {
    if (state.time >= state.end - 1e-9) go(0);
    state.playing = true;
    state.before = performance.now();
    part("play").textContent = "Pause";
    root.dataset.playing = "true";
    requestAnimationFrame(frame);
  }
  function frame(now) {
    if (!state.playing) return;
    const passed = Math.max(0, now - state.before) / 1000;
    state.before = now;
    go(state.time + passed * Number(part("speed").value));
    if (state.time >= state.end - 1e-9) pause(); else requestAnimationFrame(frame);
  }
  function drawCharts() {
    part("charts").replaceChildren();
    const arms = data.episodes[state.episode].arms.filter((arm) => arm.ego.t.length);
    charts = arms.length ? measures.map((measure) => chart(measure, arms)) : [];
  }
  function show(number) {
    pause();
    state.episode = (number + data.episodes.length) % data.episodes.length;
    const episode = data.episodes[state.episode];
    [state.end, state.step] = [Math.max(episode.step, episode.until), episode.step];
    part("time").max = state.end;
    part("time").step = Math.min(state.step, 0.1);
    part("title").textContent = `${episode.name}: ${episode.result}`;
    part("note").textContent = episode.note;
    const scene = data.scenes[episode.scene];
    part("views").replaceChildren();
    views = episode.arms.map((arm) => view(arm, scene));
    root.dataset.shown = state.episode;
    for (const button of root.querySelectorAll("[data-episode]")) {
      const current = Number(button.dataset.episode) === state.episode;
      if (current) button.setAttribute("aria-current", "true"); else button.removeAttribute("aria-current");
    }
    drawCharts();
    go(0);
  }

  root.hidden = false;
  root.addEventListener("click", (event) => {
    const button = event.target.closest("[data-episode]");
    if (button) show(Number(button.dataset.episode));
  });
  part("play").addEventListener("click", () => (state.playing ? pause() : play()));
  part("back").addEventListener("click", () => toStep(-1));
  part("forward").addEventListener("click", () => toStep(1));
  part("previous").addEventListener("click", () => show(state.episode - 1));
  part("next").addEventListener("click", () => show(state.episode + 1));
  part("time").addEventListener("input", (event) => { pause(); go(Number(event.target.value)); });
  root.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.matches("select")) return;
    if (event.key === " " && event.target.matches("button")) return;
    const second = Math.round(1 / state.step);
    const actions = {
      " ": () => (state.playing ? pause() : play()),
      ArrowLeft: () => toStep(event.shiftKey ? -second : -1),
      ArrowRight: () => toStep(event.shiftKey ? second : 1),
      Home: () => { pause(); go(0); },
      End: () => { pause(); go(state.end); },
      "+": () => faster(1), "-": () => faster(-1),
      n: () => show(state.episode + 1), p: () => show(state.episode - 1),
    };
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });
  function faster(by) {
    const place = speeds.indexOf(part("speed").value) + by;
    if (place >= 0 && place < speeds.length) part("speed").value = speeds[place];
  }
  let width = 0;
  new ResizeObserver(() => {
    if (part("charts").clientWidth === width) return;
    width = part("charts").clientWidth;
    drawCharts();
    go(state.time);
  }).observe(part("charts"));
  show(0);
})();
