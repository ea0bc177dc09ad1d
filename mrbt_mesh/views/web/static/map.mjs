// The map: what the mission says of the place, and the robots where they say they are.

import { select } from "d3-selection";
import { zoom, zoomIdentity } from "d3-zoom";
import { byId, setText } from "./text.mjs";

// Labels can be read where the map has at least this size.
const UNIT_PX = 18;
const SVG = "http://www.w3.org/2000/svg";

export class MapView {
  constructor(store, map, choose) {
    this._store = store;
    this._map = map;
    this._choose = choose;
    this._places = new Map();
    this._robots = new Map();
    this._box = null;
    this._picture = byId("map-picture");
    this._root = this._picture.appendChild(make("g", {}));
    this._zoom = zoom().scaleExtent([0.5, 20]).on("zoom", (event) => this._root.setAttribute("transform", event.transform));
    select(this._picture).call(this._zoom);
    byId("map-fit").addEventListener("click", () => select(this._picture).call(this._zoom.transform, zoomIdentity));
    if (map) this._drawMap();
    new ResizeObserver(() => this._resize()).observe(this._picture);
    this._isSeen = true;
    this._moved = new Set();
    new IntersectionObserver(([entry]) => {
      this._isSeen = entry.isIntersecting;
      if (!this._isSeen) return;
      const moved = this._moved;
      this._moved = new Set();
      this.update(moved);
    }).observe(byId("map"));
  }

  update(keys) {
    // While nobody sees it, it is only noted what has moved.
    if (!this._isSeen && this._robots.size) {
      for (const key of keys) this._moved.add(key);
      return;
    }
    for (const key of keys) {
      if (key.startsWith("place/")) {
        this._places.get(key.slice(6))?.setAttribute("class", `map-place ${this._store.get(key) ?? ""}`);
      } else if (key.startsWith("position/") || key.startsWith("robot/")) {
        this._drawRobot(key.slice(key.indexOf("/") + 1));
      }
    }
  }

  _show() {
    byId("map").hidden = false;
    document.querySelector("main").classList.add("has-map");
  }

  _drawMap() {
    this._show();
    const points = [...this._map.lines.flatMap((line) => line.points), ...Object.values(this._map.places).map((place) => place.at)];
    this._fit(points);
    for (const line of this._map.lines) {
      const text = line.points.map(([x, y]) => `${x},${-y}`).join(" ");
      this._root.append(make(line.closed ? "polygon" : "polyline", { points: text, class: `map-${line.kind}${line.closed ? "" : " map-open"}` }));
    }
    byId("map-key").hidden = !Object.keys(this._map.places).length;
    for (const [name, place] of Object.entries(this._map.places)) {
      const [x, y] = place.at;
      const shape = make("circle", { cx: x, cy: -y, class: `map-place ${this._store.get(`place/${name}`) ?? ""}` });
      shape.append(titled(place.label));
      const label = make("text", { x, class: "map-label" });
      label.textContent = place.label;
      this._places.set(name, shape);
      this._root.append(shape, label);
    }
    this._sizePlaces();
  }

  // A short label is in its place, a long one below it.
  _sizePlaces() {
    const radius = this._unit * 0.75;
    for (const [name, shape] of this._places) {
      const { label: text, at: [, y] } = this._map.places[name], label = shape.nextSibling, isLong = text.length > 3;
      change(shape, "r", String(radius));
      change(label, "y", String(-y + (isLong ? radius * 1.7 : 0)));
      change(label, "font-size", String(radius * (isLong ? 0.75 : 0.85)));
    }
  }

  _resize() {
    if (!this._box) return;
    this._fit([]);
    this._sizePlaces();
    for (const name of this._robots.keys()) this._drawRobot(name);
  }

  // The box grows with what robots report, and is never smaller than what the mission says.
  _fit(points) {
    const box = this._box ?? [Infinity, Infinity, -Infinity, -Infinity];
    for (const [x, y] of points) {
      box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], -y);
      box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], -y);
    }
    this._box = box;
    const wide = Math.max(1e-6, box[2] - box[0]), high = Math.max(1e-6, box[3] - box[1]), rim = Math.max(wide, high) * 0.1 + 1e-3;
    const { clientWidth, clientHeight } = this._picture;
    const pixels = Math.min(clientWidth / (wide + 2 * rim), clientHeight / (high + 2 * rim));
    this._unit = Math.max(Math.max(wide, high) / 18, pixels > 0 ? UNIT_PX / pixels : 0) || 1;
    this._picture.setAttribute("viewBox", `${box[0] - rim} ${box[1] - rim} ${wide + 2 * rim} ${high + 2 * rim}`);
  }

  _drawRobot(name) {
    const position = this._store.get(`position/${name}`);
    if (!position) return;
    const { x, y, heading } = position;
    const state = this._store.get(`robot/${name}`)?.state ?? "alive";
    let robot = this._robots.get(name);
    const [left, top, right, bottom] = this._box ?? [1, 1, 0, 0];
    if (x < left || x > right || -y < top || -y > bottom) {
      this._fit([[x, y]]);
      // Their sizes go by the box.
      this._resize();
    }
    if (!robot) {
      this._show();
      robot = make("g", { class: "map-robot" });
      robot.append(make("path", {}), make("text", {}), titled(name));
      robot.children[1].textContent = name;
      robot.addEventListener("click", () => this._choose({ kind: "robot", name }));
      this._robots.set(name, robot);
      this._root.append(robot);
    }
    const size = this._unit * 0.55;
    const hasHeading = heading !== null && heading !== undefined;
    const path = hasHeading ? `M${size},0 L${-size * 0.8},${size * 0.75} L${-size * 0.4},0 L${-size * 0.8},${-size * 0.75} Z`
      : `M${-size * 0.7},0 a${size * 0.7},${size * 0.7} 0 1,0 ${size * 1.4},0 a${size * 0.7},${size * 0.7} 0 1,0 ${-size * 1.4},0`;
    change(robot.children[0], "d", path);
    // The dead are below those that took over where they died, and their names are below them.
    const isDead = state === "dead";
    if (isDead && !robot.classList.contains("dead")) this._root.insertBefore(robot, this._root.querySelector(".map-robot"));
    change(robot.children[1], "y", String(size * (isDead ? 1.9 : -1.2)));
    change(robot.children[1], "font-size", String(size * 1.1));
    change(robot.children[0], "transform", `rotate(${hasHeading ? -heading * 180 / Math.PI : 0})`);
    change(robot, "transform", `translate(${x},${-y})`);
    change(robot, "class", `map-robot ${state}`);
    setText(byId("map-hint"), `${this._robots.size} robots`);
  }
}

function make(name, attributes) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

function change(node, name, value) {
  if (node.getAttribute(name) !== value) node.setAttribute(name, value);
}

function titled(text) {
  const title = make("title", {});
  title.textContent = text;
  return title;
}
