// The map: what the mission says of the place, and the robots where they are, or say that they are.

import { select } from "d3-selection";
import { zoom, zoomIdentity } from "d3-zoom";
import { fan, fitted, grouped, neighbourDistance, placed, route, sizes } from "./map_layout.mjs";
import { STATES, byId, byName, groupOf, setText } from "./text.mjs";

const MARGIN = 26, ZOOM_STEP = 1.6, STACK_STEP = 3, MOST_ZOOM = 30;
// Where there are no neighbours, sizes are as if they were so far apart, in pixels.
const USUAL = 40;
const SVG = "http://www.w3.org/2000/svg";
// Labels are placed in this order.
const FIRST = { trouble: 0, bad: 1, robot: 2, busy: 3, place: 4 };

export class MapView {
  constructor(store, map, choose) {
    this._store = store;
    this._map = map ?? { lines: [], places: {}, ways: [] };
    this._choose = choose;
    this._picture = byId("map-picture");
    this._layers = Object.fromEntries(["lines", "ways", "routes", "places", "robots", "labels", "over"].map((name) => [name, this._picture.appendChild(make("g", { class: `map-${name}` }))]));
    this._nodes = new Map();
    this._widths = new Map();
    this._transform = zoomIdentity;
    this._isSeen = true;
    const points = [...this._map.lines.flatMap((line) => line.points), ...Object.values(this._map.places).map((place) => place.at)];
    this._box = boxAround(points);
    this._distance = neighbourDistance(Object.values(this._map.places).map((place) => place.at));
    if (map) this._show();
    this._listen();
    new ResizeObserver(() => this._draw()).observe(this._picture);
    new IntersectionObserver(([entry]) => {
      this._isSeen = entry.isIntersecting;
      if (this._isSeen) this._draw();
    }).observe(byId("map"));
  }

  update(keys) {
    if ([...keys].some((key) => /^(place|position|robot)\/|^team$/.test(key))) this._draw();
  }

  _show() {
    byId("map").hidden = false;
    document.querySelector("main").classList.add("has-map");
  }

  // -- what is where ----------------------------------------------------------------------

  // The robots that are known to be somewhere: as they report it, else at their places.
  _robots() {
    const found = [], isOver = !!this._store.get("team")?.ended;
    for (const [name, robot] of [...this._store.all("robot")].sort(([a], [b]) => byName(a, b))) {
      const told = this._store.get(`position/${name}`), place = this._map.places[robot?.place]?.at;
      if (!robot || robot.state === "absent" || !(told || place)) continue;
      const [x, y] = told ? [told.x, told.y] : place;
      found.push({ name, at: [x, y], heading: told?.heading ?? null, state: robot.state, place: robot.place, goalName: robot.under_way, goal: isOver || robot.state === "dead" ? null : this._map.places[robot.under_way]?.at ?? null, group: groupOf(robot, this._store.now(), isOver) });
    }
    return found;
  }

  _draw() {
    const robots = this._robots();
    if (robots.length && byId("map").hidden) this._show();
    // What colours mean, where some place has one.
    byId("map-key").hidden = !this._store.all("place").size;
    setText(byId("map-hint"), robots.length ? `${robots.length} robots` : "");
    const { clientWidth: width, clientHeight: height } = this._picture;
    if (!this._isSeen || !width || !height) return;
    // It grows with what robots report, and is never smaller than what the mission says.
    this._box = boxAround(robots.map((robot) => robot.at), this._box);
    if (!this._box) return;
    const [left, top, right, bottom] = this._box, ratio = String(Math.round(Math.max(0.7, Math.min(3, (right - left) / Math.max(1e-6, bottom - top))) * 100) / 100);
    if (this._picture.style.getPropertyValue("--ratio") !== ratio) this._picture.style.setProperty("--ratio", ratio);
    const { scale, shiftX, shiftY } = fitted(this._box, width, height, MARGIN), { k, x, y } = this._transform;
    this._at = ([mapX, mapY]) => ({ x: k * (mapX * scale + shiftX) + x, y: k * (-mapY * scale + shiftY) + y });
    const isCrowded = Number.isFinite(this._distance), distance = isCrowded ? this._distance * scale * k : Math.min(width, height);
    const size = sizes(isCrowded ? distance : USUAL);
    const spots = [], labels = [], drawn = new Set();
    const node = (...told) => { drawn.add(told[0]); return this._node(...told); };
    this._drawLines(node);
    this._drawPlaces(node, robots, size.place, spots, labels);
    this._drawRobots(node, robots, size, distance, spots, labels);
    this._drawLabels(node, spots, labels, width, height);
    for (const [key, made] of this._nodes) if (!drawn.has(key)) { made.remove(); this._nodes.delete(key); }
  }

  _drawLines(node) {
    this._map.lines.forEach((line, index) => {
      const made = node(`line/${index}`, "lines", line.closed ? "polygon" : "polyline", { class: `map-${line.kind}${line.closed ? "" : " map-open"}` });
      change(made, "points", line.points.map((point) => this._at(point)).map(({ x, y }) => `${round(x)},${round(y)}`).join(" "));
    });
    this._map.ways.forEach(([from, to]) => {
      const a = this._at(this._map.places[from].at), b = this._at(this._map.places[to].at);
      drawLine(node(`way/${from}/${to}`, "ways", "line", { class: "map-way" }), [a.x, a.y, b.x, b.y]);
    });
  }

  _drawPlaces(node, robots, radius, spots, labels) {
    const busy = new Set(robots.flatMap(({ place, goalName }) => [place, goalName]));
    for (const [name, place] of Object.entries(this._map.places)) {
      const { x, y } = this._at(place.at), state = this._store.get(`place/${name}`) ?? "", owner = `place/${name}`;
      const made = node(owner, "places", "circle", { "data-label": place.label });
      change(made, "cx", round(x)); change(made, "cy", round(y)); change(made, "r", round(radius));
      change(made, "class", `map-place ${state}`);
      spots.push({ x, y, radius, owner });
      labels.push({ x, y, radius, owner, text: place.label, isInside: true, first: state === "bad" ? FIRST.bad : busy.has(name) ? FIRST.busy : FIRST.place, look: "map-label" });
    }
  }

  _drawRobots(node, robots, { place, robot: radius }, distance, spots, labels) {
    const standing = robots.filter((robot) => !robot.goal).map((robot) => ({ ...robot, ...this._at(robot.at) }));
    const moving = robots.filter((robot) => robot.goal).map((robot) => ({ ...robot, ...this._at(robot.at) }));
    const groups = [...grouped(standing, radius), ...moving.map((robot) => ({ x: robot.x, y: robot.y, members: [robot] }))];
    for (const { x, y, members } of groups) {
      const places = fan(members.length, radius, distance);
      if (!places) { this._drawStack(node, x, y, members, radius, spots, labels); continue; }
      members.forEach((robot, i) => {
        const at = { x: x + places[i].x, y: y + places[i].y }, owner = `robot/${robot.name}`;
        const made = node(owner, "robots", "path", { "data-label": robot.name, "data-robot": robot.name });
        change(made, "d", robotShape(radius, robot.heading));
        change(made, "transform", `translate(${round(at.x)},${round(at.y)}) rotate(${robot.heading === null ? 0 : round(-robot.heading * 180 / Math.PI)})`);
        change(made, "class", `map-robot ${robot.state}`);
        spots.push({ ...at, radius, owner });
        labels.push({ ...at, radius, owner, text: robot.state === "dead" ? `✕ ${robot.name}` : robot.name,
          isNeeded: robot.group === "trouble", first: robot.group === "trouble" ? FIRST.trouble : FIRST.robot, look: `map-name ${robot.state}` });
        if (!robot.goal) return;
        const line = route(at, this._at(robot.goal), place);
        if (line) drawLine(node(`route/${robot.name}`, "routes", "line", { class: "map-route", "marker-end": "url(#map-arrow)" }), line);
      });
    }
  }

  // Robots at one place that have no room around it: how many they are, and on hover who.
  _drawStack(node, x, y, members, radius, spots, labels) {
    const names = members.map((robot) => robot.name), owner = `stack/${names[0]}`, size = Math.max(radius, 9);
    const worst = members.some((robot) => robot.group === "trouble") ? "trouble" : "";
    const made = node(owner, "robots", "g", {});
    if (!made.firstChild) made.append(make("circle", {}), make("text", {}));
    change(made, "class", `map-stack ${worst}`);
    change(made, "transform", `translate(${round(x)},${round(y)})`);
    change(made, "data-label", names.join(" "));
    change(made.firstChild, "r", round(size));
    setText(made.lastChild, String(names.length));
    spots.push({ x, y, radius: size, owner });
    for (const robot of members.filter((each) => each.group === "trouble")) {
      labels.push({ x, y, radius: size, owner, key: robot.name, text: `${STATES[robot.state]?.[0] ?? "⚠"} ${robot.name}`, isNeeded: true, first: FIRST.trouble, look: `map-name ${robot.state}` });
    }
  }

  _drawLabels(node, spots, labels, width, height) {
    const wanted = labels.map((label) => ({ ...label, width: this._widthOf(label.text) })).sort((a, b) => a.first - b.first);
    placed(wanted, spots, width, height).forEach((at, i) => {
      if (!at) return;
      const { owner, key = "", text, look } = wanted[i], made = node(`label/${owner}/${key}`, "labels", "text", {});
      change(made, "class", look); change(made, "x", round(at.x)); change(made, "y", round(at.y));
      setText(made, text);
    });
  }

  _widthOf(text) {
    if (!this._widths.has(text)) {
      this._pen ??= document.createElement("canvas").getContext("2d");
      this._pen.font = `600 12px ${getComputedStyle(document.documentElement).getPropertyValue("--sans")}`;
      this._widths.set(text, this._pen.measureText(text).width + 4);
    }
    return this._widths.get(text);
  }

  // What is drawn keeps its element, as long as it is drawn.
  _node(key, layer, name, attributes) {
    if (!this._nodes.has(key)) this._nodes.set(key, this._layers[layer].appendChild(make(name, attributes)));
    return this._nodes.get(key);
  }

  // -- what people do ---------------------------------------------------------------------

  _listen() {
    const picture = select(this._picture);
    // One finger scrolls the page, two move and zoom the map.
    this._zoom = zoom().scaleExtent([0.8, MOST_ZOOM]).filter((event) => (event.type.startsWith("touch") ? event.touches.length > 1 : !event.button))
      .on("zoom", (event) => { this._transform = event.transform; this._unhover(); this._draw(); });
    picture.call(this._zoom);
    const press = (id, act) => byId(id).addEventListener("click", act);
    press("map-fit", () => picture.call(this._zoom.transform, zoomIdentity));
    press("map-in", () => picture.call(this._zoom.scaleBy, ZOOM_STEP));
    press("map-out", () => picture.call(this._zoom.scaleBy, 1 / ZOOM_STEP));
    this._picture.addEventListener("click", (event) => {
      const robot = event.target.closest("[data-robot]"), stack = event.target.closest(".map-stack");
      if (robot) this._choose({ kind: "robot", name: robot.dataset.robot });
      else if (stack) picture.call(this._zoom.transform, this._closer(offset(event, this._picture)));
    });
    this._picture.addEventListener("pointerover", (event) => this._hover(event.target.closest("[data-label]"), event));
    this._picture.addEventListener("pointerout", () => this._unhover());
  }

  // Zoomed in, with this point in the middle.
  _closer([x, y]) {
    const [mapX, mapY] = this._transform.invert([x, y]), k = Math.min(MOST_ZOOM, this._transform.k * STACK_STEP);
    const { clientWidth, clientHeight } = this._picture;
    return zoomIdentity.translate(clientWidth / 2 - k * mapX, clientHeight / 2 - k * mapY).scale(k);
  }

  // The name of what is pointed at, above everything.
  _hover(spot, event) {
    this._unhover();
    if (!spot) return;
    const text = spot.dataset.label, width = this._widthOf(text), [x, y] = offset(event, this._picture), half = width / 2 + 6;
    const group = make("g", { transform: `translate(${round(Math.max(half, Math.min(this._picture.clientWidth - half, x)))},${round(Math.max(14, y - 22))})` });
    const label = make("text", { class: "map-name" });
    setText(label, text);
    group.append(make("rect", { x: -half, y: -11, width: 2 * half, height: 22, rx: 5, class: "map-hover" }), label);
    this._layers.over.append(group);
  }

  _unhover() { this._layers.over.replaceChildren(); }
}

function boxAround(points, known = null) {
  let box = known;
  for (const [x, y] of points) box = box ? [Math.min(box[0], x), Math.min(box[1], -y), Math.max(box[2], x), Math.max(box[3], -y)] : [x, -y, x, -y];
  return box;
}

const robotShape = (size, heading) => (heading !== null ? `M${round(size * 1.1)},0 L${round(-size * 0.8)},${round(size * 0.8)} L${round(-size * 0.4)},0 L${round(-size * 0.8)},${round(-size * 0.8)} Z`
  : `M${round(-size * 0.85)},0 a${round(size * 0.85)},${round(size * 0.85)} 0 1,0 ${round(size * 1.7)},0 a${round(size * 0.85)},${round(size * 0.85)} 0 1,0 ${round(-size * 1.7)},0`);

function offset(event, picture) {
  const box = picture.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

const round = (number) => String(Math.round(number * 10) / 10);

function drawLine(line, numbers) { ["x1", "y1", "x2", "y2"].forEach((name, i) => change(line, name, round(numbers[i]))); }

function make(name, attributes) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

function change(node, name, value) {
  if (node.getAttribute(name) !== value) node.setAttribute(name, value);
}
