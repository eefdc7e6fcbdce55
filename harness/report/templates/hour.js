"use strict";
// A stretch of an hour of traffic: top views of both arms, all vehicles and pedestrians.
(() => {
  const source = document.getElementById("hour-data");
  if (!source) return;
  const data = JSON.parse(source.textContent);
  const root = document.getElementById("hour");
  const part = (name) => document.getElementById(`hour-${name}`);
  const ns = "http://www.w3.org/2000/svg";
  const scene = data.scene;
  const state = { time: data.from, playing: false, before: 0 };

  function make(tag, attributes, parent) {
    const element = document.createElementNS(ns, tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    parent.append(element);
    return element;
  }

  // The value at a time between two of the times; null before the first and after the last.
  function at(times, values, time) {
    if (!times.length || time < times[0] || time > times[times.length - 1]) return null;
    let low = 0, high = times.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (times[middle] <= time) low = middle; else high = middle - 1;
    }
    if (low === times.length - 1) return values[low];
    const share = (time - times[low]) / (times[low + 1] - times[low]);
    return values[low] + share * (values[low + 1] - values[low]);
  }

  function view(arm) {
    const box = document.createElement("div");
    box.className = "view";
    box.dataset.arm = arm.arm;
    const head = document.createElement("h4");
    head.append(document.createElement("i"), `${arm.name}: ${arm.strategy}`);
    const count = document.createElement("p");
    box.append(head, count);
    part("views").append(box);
    const low = -3.5, high = scene.length + 3.5, width = scene.right - scene.left;
    const svg = make("svg", { viewBox: `${scene.left} ${-high} ${width} ${high - low}`, role: "img", "aria-label": `Top view of the road, ${arm.name}` }, box);
    const world = make("g", { transform: "scale(1,-1)" }, svg);
    const half = scene.width / 2;
    make("rect", { class: "path", x: -half, y: low, width: scene.width, height: high - low }, world);
    make("rect", { class: "road", x: scene.left, y: 0, width, height: scene.length }, world);
    for (const y of scene.borders) make("line", { class: "middle", x1: scene.left, x2: scene.right, y1: y, y2: y }, world);
    for (let y = 0.25; y + 0.5 <= scene.length; y += 1) {
      make("rect", { class: "stripe", x: -half, y, width: scene.width, height: 0.5 }, world);
    }
    const vehicles = arm.vehicles.map((vehicle) => {
      const group = make("g", { "data-vehicle": vehicle.number }, world);
      const back = vehicle.oncoming ? 0 : -scene.carLength;
      make("rect", { class: vehicle.automated || arm.arm === "human" ? "ego" : "other", x: back, y: -scene.carWidth / 2, width: scene.carLength, height: scene.carWidth, rx: 0.35 }, group);
      make("title", {}, group).textContent = `vehicle ${vehicle.number}${vehicle.strategy ? `, ${vehicle.strategy}` : ""}`;
      return group;
    });
    const walkers = arm.walkers.map((walker) => {
      const group = make("g", { "data-pedestrian": walker.index }, world);
      make("circle", { class: "halo", r: 0.7 }, group);
      make("circle", { class: "walker", r: scene.radius }, group);
      make("title", {}, group).textContent = `pedestrian ${walker.index}, ${walker.side} side`;
      return group;
    });
    return { arm, box, count, vehicles, walkers };
  }

  function placed(walker, time) {
    if (time < walker.arrival) return null;
    if (walker.start === null || time < walker.start) return walker.side === "near" ? -0.6 : scene.length + 0.6;
    const y = at(walker.t, walker.y, time);
    if (y !== null) return y;
    return walker.t.length && time < walker.t[0] ? walker.y[0] : null;
  }

  function draw({ arm, box, count, vehicles, walkers }) {
    let there = 0;
    arm.vehicles.forEach((vehicle, number) => {
      const x = at(vehicle.t, vehicle.x, state.time);
      vehicles[number].style.display = x === null ? "none" : "";
      if (x === null) return;
      there += 1;
      vehicles[number].setAttribute("transform", `translate(${x} ${vehicle.y})`);
    });
    arm.walkers.forEach((walker, number) => {
      const y = placed(walker, state.time);
      walkers[number].style.display = y === null ? "none" : "";
      if (y === null) return;
      walkers[number].setAttribute("transform", `translate(0 ${y})`);
      walkers[number].classList.toggle("waiting", walker.start === null || state.time < walker.start);
    });
    count.textContent = `${there} vehicles on the road`;
    box.dataset.vehicles = there;
  }

  const views = data.arms.map(view);
  function go(time) {
    state.time = Math.min(data.until, Math.max(data.from, time));
    root.dataset.time = state.time;
    part("time").value = state.time;
    part("clock").textContent = `${state.time.toFixed(1)} s`;
    views.forEach(draw);
  }
  function pause() { state.playing = false; part("play").textContent = "Play"; }
  function play() {
    if (state.time >= data.until - 1e-9) go(data.from);
    state.playing = true;
    state.before = performance.now();
    part("play").textContent = "Pause";
    requestAnimationFrame(frame);
  }
  function frame(now) {
    if (!state.playing) return;
    const passed = Math.max(0, now - state.before) / 1000;
    state.before = now;
    go(state.time + passed * Number(part("speed").value));
    if (state.time >= data.until - 1e-9) pause(); else requestAnimationFrame(frame);
  }
  part("time").min = data.from;
  part("time").max = data.until;
  part("play").addEventListener("click", () => (state.playing ? pause() : play()));
  part("time").addEventListener("input", (event) => { pause(); go(Number(event.target.value)); });
  root.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.matches("select, button")) return;
    if (event.key === " ") { if (state.playing) pause(); else play(); }
    else if (event.key === "ArrowLeft") { pause(); go(state.time - 1); }
    else if (event.key === "ArrowRight") { pause(); go(state.time + 1); }
    else return;
    event.preventDefault();
  });
  root.hidden = false;
  go(data.from);
})();
