// The timeline: a lane per robot on a canvas, since a long run has thousands of spans.

import { ticks } from "d3-array";
import { select } from "d3-selection";
import { zoom, zoomIdentity } from "d3-zoom";
import { ENDS, STATES, byId, byName, contains, element, knownAt, lostText, rankOf, seconds, setText, timelineLegend } from "./text.mjs";

const HATCH = 9;
// Few robots have high lanes.
const LANE = 24, LOW_LANE = 16, FEW = 9;
// The names are before the lanes.
const LEAST_GUTTER = 74, MOST_GUTTER = 150, RIGHT = 18, FOLLOWED_S = 40, MOST_ZOOM_S = 0.2, FRAME_S = 0.1;
// As in the style sheet.
const SEEN_SHARE = 0.3;
// As `rankOf` has it: that of the first robots that are in no trouble.
const CALM = 2;

export class TimelineView {
  // `recording`: from when to when it goes, of one that is replayed; `seek` goes to a time of it.
  constructor(store, choose, recording, seek) {
    this._store = store;
    this._choose = choose;
    this._recording = recording;
    this._seek = seek;
    this._robots = [];
    // Robots in trouble, and their places among the others.
    this._ranks = new Map();
    this._all = [];
    this._wanted = "";
    this._isFollowing = !recording;
    this._span = recording ? [this._begin(), this._end() * 1.03] : [0, FOLLOWED_S];
    this._gutter = LEAST_GUTTER;
    this._canvas = byId("spans");
    this._axis = byId("axis");
    this._isDue = false;
    this._readColours();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { this._readColours(); this.draw(); });
    this._listen();
    this._width = 0;
    this._top = 0;
    this._follow(this._isFollowing);
    byId("lanes").addEventListener("scroll", () => { this._top = byId("lanes").scrollTop; this.draw(); }, { passive: true });
    new ResizeObserver(() => { this._width = this._canvas.clientWidth; this.draw(); }).observe(byId("lanes"));
  }

  update(keys) {
    let isNew = false, isTaken = false;
    for (const key of keys) {
      const [kind, name] = split(key);
      if (["work", "fault", "loss", "unwatched"].includes(kind)) {
        isNew = true;
        isTaken ||= kind === "fault";
        this._addLane(this._store.get(key)?.robot);
      } else if (kind === "robot" && this._store.get(key)) isNew = this._takeLane(name) || isNew;
      else if (kind === "event") this._isEventful = true;
      else if (key === "forecast" || key === "connection") isNew = true;
      else if (key === "older") { byId("events").replaceChildren(); this._isEventful = isNew = true; }
    }
    if (this._isFollowing && keys.has("team") && this._store.get("team")?.ended) this._whole();
    if (isTaken) this._listTakeovers();
    if (this._isEventful) this._listEvents();
    if (isNew) this.draw();
  }

  _addLane(robot) {
    if (!robot || this._all.includes(robot)) return false;
    this._all.push(robot);
    this._chooseLanes();
    return true;
  }

  // Those in trouble come first, as in the list of robots; the others keep their lanes, whatever they begin.
  // A recording's lanes keep their places.
  _takeLane(robot) {
    const isNew = this._addLane(robot);
    const rank = rankOf(this._store.get(`robot/${robot}`), this._store.now(), !!this._store.get("team")?.ended);
    const own = this._recording || rank >= CALM ? CALM : rank;
    if (this._rank(robot) === own) return isNew;
    this._ranks.set(robot, own);
    this._chooseLanes();
    return true;
  }

  _rank(robot) { return this._ranks.get(robot) ?? CALM; }

  // The robots whose names or tasks fit what is searched; if none does, all.
  _chooseLanes() {
    const works = this._items("work").map(([, work]) => work);
    const fits = (robot) => contains(robot, this._wanted) || works.some((work) => work.robot === robot && contains(workName(work), this._wanted));
    this._all.sort((a, b) => this._rank(a) - this._rank(b) || byName(a, b));
    const found = this._all.filter(fits);
    this._robots = found.length ? found : [...this._all];
  }

  search(wanted) {
    this._wanted = wanted;
    this._chooseLanes();
    this.draw();
    const found = [...this._store.all("event").values()].filter((event) => contains(event.text, wanted)).length;
    byId("events").replaceChildren();
    this._listEvents();
    return `${found} events`;
  }

  // As wide as the longest name.
  _measureNames(context) {
    context.font = this._nameFont;
    const widest = Math.max(0, ...this._robots.map((robot) => context.measureText(`✕ ${robot}`).width));
    this._gutter = Math.max(LEAST_GUTTER, Math.min(MOST_GUTTER, this._width / 3, Math.ceil(widest) + 24));
  }

  get _nameFont() { return `600 ${this._lane === LANE ? 12 : 11}px ${this._font}`; }

  get _lane() { return this._robots.length > FEW ? LOW_LANE : LANE; }

  // Those of the team, by name.
  _items(kind) { return [...this._store.all(kind)]; }

  // What is expected of a running team, if it travels.
  get _forecast() { return this._store.state === "over" || this._store.get("team")?.ended ? null : this._store.get("forecast"); }

  // Until when there is something to see, and something expected.
  _last() {
    const forecast = this._forecast, end = this._end() ?? 0;
    return forecast?.ends_s ? Math.max(end, forecast.at_s + forecast.ends_s) : end;
  }

  // Until when there is something to see; what has not ended goes on until then.
  _end() { return this._recording ? this._recording.to_s : this._store.now(); }

  _begin() { return Math.min(this._recording?.from_s ?? 0, 0); }

  // Called every frame; it draws only when time has moved by a pixel.
  tick() {
    const now = this._store.now();
    if (now === null || document.hidden) return;
    const pixel = (this._span[1] - this._span[0]) / Math.max(1, this._width);
    if (this._drawnAt === undefined || Math.abs(now - this._drawnAt) > Math.max(pixel, this._recording ? 0 : FRAME_S)) this.draw();
  }

  draw() {
    if (this._isDue) return;
    this._isDue = true;
    requestAnimationFrame(() => { this._isDue = false; this._paint(); });
  }

  // -- drawing ----------------------------------------------------------------------------

  _readColours() {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name).trim();
    this._colours = Object.fromEntries(["text", "muted", "line", "panel", "raised", "running", "success", "failure", "warn", "idle"]
      .map((name) => [name, colour(`--${name}`)]));
    this._font = colour("--sans");
  }

  _fit(canvas, height) {
    const ratio = window.devicePixelRatio || 1, width = this._width;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
      canvas.style.height = `${height}px`;
    }
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    return context;
  }

  _x(time) { return this._gutter + (time - this._span[0]) / (this._span[1] - this._span[0]) * (this._width - this._gutter - RIGHT); }

  _paint() {
    const now = this._store.now() ?? 0, end = this._end() ?? 0;
    this._drawnAt = now;
    if (this._isFollowing) {
      const long = Math.min(this._span[1] - this._span[0], Math.max(FOLLOWED_S, 5));
      const last = Math.max(long * 0.92, Math.min(this._last(), now + long / 2));
      this._span = [last - long * 0.92, last + long * 0.08];
    }
    // The canvas is as high as what is seen of the lanes, and stays in place while they scroll.
    const whole = Math.max(1, this._robots.length) * this._lane + 4;
    // No lane is cut off at the lower edge.
    const seen = Math.min(whole, Math.floor(window.innerHeight * SEEN_SHARE / this._lane) * this._lane + 4), height = this._top + seen;
    if (byId("lanes").style.maxHeight !== `${seen}px`) byId("lanes").style.maxHeight = `${seen}px`;
    const inner = byId("lanes-inner");
    if (inner.style.height !== `${whole}px`) inner.style.height = `${whole}px`;
    const context = this._fit(this._canvas, seen);
    context.translate(0, -this._top);
    this._hits = [];
    this._measureNames(context);
    this._paintAxis(now);
    this._paintLanes(context, now, height);
    for (const [, time] of this._items("unwatched")) this._paintUnwatched(context, time, height);
    for (const [, work] of this._items("work")) this._paintWork(context, work, end);
    for (const [, loss] of this._items("loss")) this._paintLoss(context, loss);
    for (const [name, fault] of this._items("fault")) this._paintFault(context, name, fault, end);
    if (this._recording) this._paintAhead(context, now, height);
    this._paintForecast(context, now, height);
    context.fillStyle = this._colours.panel;
    context.fillRect(0, this._top, this._gutter - 4, seen);
    context.textBaseline = "middle";
    context.font = this._nameFont;
    this._robots.forEach((robot, lane) => {
      const state = this._store.get(`robot/${robot}`)?.state;
      const isGone = ["dead", "suspect"].includes(state);
      context.fillStyle = isGone ? this._colours.failure : this._colours.text;
      context.fillText(isGone ? `${STATES[state][0]} ${robot}` : robot, 14, lane * this._lane + this._lane / 2 + 2, this._gutter - 20);
    });
  }

  _paintAxis(now) {
    const context = this._fit(this._axis, 24);
    context.font = `11px ${this._font}`;
    context.textBaseline = "middle";
    context.textAlign = "center";
    for (const time of this._ticks()) {
      const x = this._x(time);
      if (x < this._gutter - 1) continue;
      context.fillStyle = this._colours.muted;
      context.fillText(this._tickText(time), x, 12);
    }
    const x = this._x(now);
    if (x >= this._gutter && x <= this._width) {
      context.fillStyle = this._colours.running;
      context.beginPath();
      context.moveTo(x - 4, 19); context.lineTo(x + 4, 19); context.lineTo(x, 24);
      context.fill();
    }
  }

  _ticks() { return ticks(this._span[0], this._span[1], Math.max(2, Math.floor(this._width / 110))).filter((t) => t >= this._begin()); }

  _tickText(time) {
    const digits = this._span[1] - this._span[0] < 4 ? 2 : this._span[1] - this._span[0] < 12 ? 1 : 0;
    return time < 600 ? `${time.toFixed(digits)} s` : `${Math.floor(time / 60)}:${(time % 60).toFixed(digits).padStart(2, "0")}`;
  }

  _paintLanes(context, now, height) {
    this._robots.forEach((_, lane) => {
      if (lane % 2 === 0) { context.fillStyle = this._colours.raised; context.fillRect(this._gutter, lane * this._lane + 2, this._width, this._lane); }
    });
    context.strokeStyle = this._colours.line;
    context.lineWidth = 1;
    context.beginPath();
    for (const time of this._ticks()) {
      const x = Math.round(this._x(time)) + 0.5;
      if (x >= this._gutter) { context.moveTo(x, 0); context.lineTo(x, height); }
    }
    context.stroke();
    const x = this._x(now);
    if (x >= this._gutter) {
      context.strokeStyle = this._colours.running;
      context.beginPath(); context.moveTo(x, 0); context.lineTo(x, height); context.stroke();
    }
  }

  // A time of which nothing is known: hatched, so that nobody takes it for idle.
  _paintUnwatched(context, { from_s, to_s }, height) {
    const from = Math.max(this._gutter, from_s === null ? this._gutter : this._x(from_s)), to = Math.min(this._width, this._x(to_s));
    if (to - from < 1) return;
    context.save();
    context.beginPath(); context.rect(from, 0, to - from, height); context.clip();
    context.strokeStyle = this._colours.idle;
    context.globalAlpha = 0.4;
    context.lineWidth = 1;
    context.beginPath();
    // The hatching keeps to the time, so that it moves with what it covers.
    const first = this._x(to_s) - Math.ceil((this._x(to_s) - from + height) / HATCH) * HATCH;
    for (let x = first; x < to; x += HATCH) { context.moveTo(x, height); context.lineTo(x + height, 0); }
    context.stroke();
    context.restore();
    this._hits.push({ x: from, y: 0, wide: to - from, height, unwatched: true });
  }

  // What is yet to come in a recording is pale.
  _paintAhead(context, now, height) {
    const x = Math.max(this._gutter, this._x(now));
    context.globalAlpha = 0.45;
    context.fillStyle = this._colours.panel;
    context.fillRect(x, 0, this._width, height);
    context.globalAlpha = 1;
    if (this._x(now) < this._gutter) return;
    context.strokeStyle = this._colours.running;
    context.lineWidth = 2;
    context.beginPath(); context.moveTo(x, 0); context.lineTo(x, height); context.stroke();
  }

  _paintWork(context, work, now) {
    const lane = this._robots.indexOf(work.robot);
    if (lane * this._lane > this._top + window.innerHeight || (lane + 1) * this._lane < this._top) return;
    const end = work.ended_s ?? now;
    if (lane < 0 || end < this._span[0] || work.claimed_s > this._span[1]) return;
    const y = lane * this._lane + 4, height = this._lane - 4;
    const from = Math.max(this._gutter, this._x(work.claimed_s)), begun = this._x(work.running_s ?? end), to = this._x(end);
    context.fillStyle = this._colours.idle;
    context.globalAlpha = 0.35;
    if (begun > from) context.fillRect(from, y + height / 2 - 1.5, Math.max(0, Math.min(begun, to) - from), 3);
    context.globalAlpha = work.end === "dropped" ? 0.55 : 1;
    if (work.older && from > this._gutter) this._paintOlder(context, from, y, height);
    if (work.running_s !== null) {
      const colour = { done: "success", failed: "failure", dropped: "idle", died: "idle" }[work.end] ?? "running";
      context.fillStyle = this._colours[colour];
      const x = Math.max(this._gutter, begun), wide = Math.max(1.5, to - x);
      context.beginPath(); context.roundRect(x, y, wide, height, 3); context.fill();
      context.globalAlpha = 1;
      if (wide > 34) {
        context.fillStyle = this._colours.panel;
        context.font = `600 11px ${this._font}`;
        context.textBaseline = "middle";
        context.fillText(this._shortened(context, work.local_task, wide - 10), x + 6, y + height / 2 + 0.5);
      }
    }
    context.globalAlpha = 1;
    this._hits.push({ x: from, y, wide: Math.max(4, to - from), height, work });
  }

  // What is expected, dashed, after the line of the present.
  _paintForecast(context, now, height) {
    const forecast = this._forecast, at = forecast?.at_s ?? 0;
    byId("forecast").hidden = !forecast;
    if (!forecast) return;
    const end = forecast.ends_s === null ? "" : `, ends at ${seconds(at + forecast.ends_s)}`;
    const leftOut = forecast.ends_s === null ? "" : forecast.left_out.map((each) => `; not in it: ${each.global_task}, ${each.reason}`).join("");
    setText(byId("forecast"), forecast.reason + end + leftOut);
    context.save();
    context.beginPath(); context.rect(Math.max(this._gutter, this._x(now)), 0, this._width, height); context.clip();
    context.strokeStyle = context.fillStyle = this._colours.running;
    context.lineWidth = 1;
    context.setLineDash([4, 3]);
    for (const [robot, { work, work_s, steps }] of Object.entries(forecast.robots)) {
      if (work) this._paintExpected(context, robot, { local_task: work, begins_s: 0, ends_s: work_s }, at, now, true);
      for (const step of steps) this._paintExpected(context, robot, step, at, now);
    }
    if (forecast.ends_s !== null) {
      const x = Math.round(this._x(Math.max(now, at + forecast.ends_s))) + 0.5;
      context.beginPath(); context.moveTo(x, 0); context.lineTo(x, height); context.stroke();
      this._hits.push({ x: x - 3, y: 0, wide: 6, height, text: forecast.reason + end });
    }
    context.restore();
  }

  _paintExpected(context, robot, step, at, now, isAtWork = false) {
    const lane = this._robots.indexOf(robot), from = at + step.begins_s, to = at + step.ends_s;
    if (lane < 0 || to < Math.max(now, this._span[0]) || from > this._span[1]) return;
    const x = Math.max(this._gutter, this._x(Math.max(now, from))), y = lane * this._lane + 4, wide = this._x(to) - x, height = this._lane - 4;
    context.beginPath(); context.roundRect(x, y + 0.5, wide, height - 1, 3); context.stroke();
    const what = step.partners?.length ? `${step.local_task} with ${step.partners.join(", ")}` : step.local_task;
    if (wide > 34 && !isAtWork) {
      context.font = `11px ${this._font}`;
      context.textBaseline = "middle";
      context.fillText(this._shortened(context, step.local_task, wide - 10), x + 6, y + height / 2 + 0.5);
    }
    const when = isAtWork ? `expected to end at ${seconds(to)}` : `expected from ${seconds(from)} to ${seconds(to)}`;
    this._hits.push({ x, y, wide: Math.max(4, wide), height, text: `${robot}: ${what}${step.place ? ` at ${step.place}` : ""}, ${when}` });
  }

  // As much of a text as fits; its end tells most names apart, so the middle is left out.
  _shortened(context, text, room) {
    const fits = (shown) => context.measureText(shown).width <= room;
    if (fits(text)) return text;
    const [name, parameters] = [text.replace(/\(.*/, ""), text.replace(/^[^(]*/, "")];
    for (let kept = name.length - 1; kept > 1 && parameters; kept--) {
      const shown = `${name.slice(0, kept)}…${parameters}`;
      if (fits(shown)) return shown;
    }
    for (let kept = text.length - 1; kept > 1; kept--) if (fits(`${text.slice(0, kept)}…`)) return `${text.slice(0, kept)}…`;
    return "";
  }

  // It began before it was watched: an arrow to where that may be.
  _paintOlder(context, x, y, height) {
    context.fillStyle = this._colours.muted;
    context.beginPath(); context.moveTo(x - 8, y + height / 2); context.lineTo(x - 1, y + 2); context.lineTo(x - 1, y + height - 2); context.fill();
  }

  _paintLoss(context, loss) {
    const lane = this._robots.indexOf(loss.robot);
    if (lane < 0 || loss.at_s < this._span[0] || loss.at_s > this._span[1]) return;
    const x = this._x(loss.at_s), y = lane * this._lane + this._lane / 2 + 2;
    context.fillStyle = this._colours.warn;
    context.beginPath(); context.moveTo(x, y - 7); context.lineTo(x + 7, y + 6); context.lineTo(x - 7, y + 6); context.fill();
    this._hits.push({ x: x - 8, y: y - 8, wide: 16, height: 16, loss });
  }

  _paintFault(context, name, fault, now) {
    const lane = this._robots.indexOf(fault.robot);
    if (lane < 0 || fault.at_s > this._span[1]) return;
    const y = lane * this._lane + this._lane / 2 + 2, x = this._x(fault.at_s);
    const after = (value) => (value === null ? null : this._x(fault.at_s + value / 1000));
    const known = after(fault.detected_ms), taken = after(fault.taken_over_ms);
    context.strokeStyle = this._colours.failure;
    context.lineWidth = 2;
    const until = this._x(Math.min(fault.until_s ?? now, now));
    context.setLineDash([2, 4]);
    context.beginPath(); context.moveTo(Math.max(this._gutter, x), y); context.lineTo(Math.max(this._gutter, until), y); context.stroke();
    context.setLineDash([]);
    if (known !== null) { context.beginPath(); context.moveTo(x, y); context.lineTo(Math.max(known, x), y); context.stroke(); }
    const other = this._robots.indexOf(fault.replacement);
    if (taken !== null && other >= 0 && taken >= this._gutter) {
      const to = other * this._lane + this._lane / 2 + 2, down = Math.sign(to - y);
      context.beginPath(); context.moveTo(known ?? x, y); context.lineTo(taken, y); context.lineTo(taken, to - down * 9); context.stroke();
      context.fillStyle = this._colours.failure;
      context.beginPath(); context.moveTo(taken, to - down * 4); context.lineTo(taken - 5, to - down * 12); context.lineTo(taken + 5, to - down * 12); context.fill();
    }
    if (x < this._gutter - 8) return;
    context.lineWidth = 2.5;
    context.beginPath();
    context.moveTo(x - 5, y - 5); context.lineTo(x + 5, y + 5); context.moveTo(x + 5, y - 5); context.lineTo(x - 5, y + 5); context.stroke();
    context.font = `600 11px ${this._font}`;
    context.textBaseline = "middle";
    // What does not fit is in the list below.
    const left = Math.max(taken ?? known ?? x, x) + 10, room = this._width - left - 6;
    const text = [faultNumbers(fault), fault.taken_over_after ?? fault.detected_after ?? ""].find((each) => context.measureText(each).width <= room) ?? "";
    const wide = context.measureText(text).width;
    context.fillStyle = this._colours.panel;
    context.fillRect(left - 2, y - 8, wide + 6, 16);
    context.fillStyle = this._colours.failure;
    context.fillText(text, left, y);
    this._hits.push({ x: x - 8, y: y - 10, wide: left + wide - x + 10, height: 20, fault, name });
  }

  // -- lists ------------------------------------------------------------------------------

  _listTakeovers() {
    const rows = [...this._store.all("fault")].sort((a, b) => b[1].at_s - a[1].at_s).map(([name, fault]) => element("li", {},
      element("button", { type: "button", "data-fault": name, title: faultNumbers(fault), onclick: () => this._chooseFault(name, fault) },
        element("b", {}, `${fault.robot} died ${fault.older ? "before" : "at"} ${seconds(fault.at_s)}`), ` · ${faultNumbers(fault)}`,
        fault.replacement ? ` by ${fault.replacement} (${fault.held})` : fault.held ? ` (${fault.held})` : "")));
    byId("takeovers").replaceChildren(...rows);
    byId("no-faults").hidden = rows.length > 0;
  }

  // In a recording this is also the way to its moment.
  _chooseFault(name, fault) {
    if (this._recording) this._seek(knownAt(fault));
    this._choose({ kind: "fault", name });
  }

  // Only while it is open: a long run has thousands of lines.
  _listEvents() {
    this._isEventful = false;
    const list = byId("events");
    const all = this._store.all("event");
    const older = this._store.get("older")?.event[0];
    setText(byId("happened-count"), older ? `(${all.size}; ${older} older entries: see the recording)` : `(${all.size})`);
    if (!byId("happened").open) { this._isEventful = true; return; }
    const shown = [...all].filter(([, event]) => contains(event.text, this._wanted)).map(([index, event]) => [Number(index), event]).sort((a, b) => a[0] - b[0]);
    if (list.children.length > shown.length) list.replaceChildren();
    for (const [, event] of shown.slice(list.children.length)) {
      list.append(element("li", {}, element("time", {}, seconds(event.at_s ?? 0)), element("span", {}, event.text)));
    }
    if (this._isFollowing) list.scrollTop = list.scrollHeight;
  }

  // -- what people do ---------------------------------------------------------------------

  _listen() {
    const press = (id, act) => byId(id).addEventListener("click", act);
    byId("timeline-legend").append(...timelineLegend());
    press("follow", () => this._follow(!this._isFollowing));
    press("whole", () => this._whole());
    press("zoom-in", () => this._zoomBy(0.5));
    press("zoom-out", () => this._zoomBy(2));
    press("earlier", () => this._move(-0.4));
    press("later", () => this._move(0.4));
    byId("happened").addEventListener("toggle", () => this._listEvents());
    byId("lanes").addEventListener("keydown", (event) => {
      const act = { ArrowLeft: () => this._move(-0.1), ArrowRight: () => this._move(0.1), "+": () => this._zoomBy(0.7),
        "-": () => this._zoomBy(1.4), Home: () => this._whole(), End: () => this._follow(true) }[event.key];
      if (act) { act(); event.preventDefault(); }
    });
    // d3-zoom turns wheel, drag and pinch into transforms; each is applied to the span and undone.
    const picture = select(this._canvas);
    const behaviour = zoom().filter((event) => (event.type === "wheel" ? event.ctrlKey || event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY) : !event.button))
      .on("zoom", (event) => this._zoomed(picture, behaviour, event));
    picture.call(behaviour).on("dblclick.zoom", null);
    this._canvas.addEventListener("wheel", (event) => {
      if (event.ctrlKey || event.shiftKey) return;
      if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) { event.preventDefault(); this._move(event.deltaX / this._width); }
    }, { passive: false });
    this._canvas.addEventListener("pointermove", (event) => this._point(event));
    this._canvas.addEventListener("pointerleave", () => { byId("tip").hidden = true; });
    this._canvas.addEventListener("click", (event) => {
      const hit = this._hitAt(event);
      if (hit?.fault) this._chooseFault(hit.name, hit.fault);
      else if (hit?.work) this._choose({ kind: "task", name: hit.work.global_task });
      else if (hit?.loss) {
        if (this._recording) this._seek(hit.loss.at_s);
        this._choose({ kind: "robot", name: hit.loss.robot });
      }
    });
    if (!this._recording) return;
    this._axis.classList.add("seeks");
    this._axis.addEventListener("click", (event) => this._seek(this._time(event.clientX - this._axis.getBoundingClientRect().left)));
  }

  _time(x) { return this._span[0] + (x - this._gutter) / (this._width - this._gutter - RIGHT) * (this._span[1] - this._span[0]); }

  _zoomed(picture, behaviour, event) {
    const { k, x } = event.transform;
    if (!event.sourceEvent || (k === 1 && x === 0)) return;
    const wide = this._width - this._gutter - RIGHT, [from, to] = this._span;
    const time = (pixel) => from + ((pixel - x) / k - this._gutter) / wide * (to - from);
    this._set(time(this._gutter), time(this._gutter + wide));
    // Without an event of its own: the next one counts from here.
    this._canvas.__zoom = zoomIdentity;
  }

  _set(from, to, isFollowing = false) {
    const now = this._last() || FOLLOWED_S;
    let long = Math.max(MOST_ZOOM_S, Math.min(to - from, Math.max(FOLLOWED_S, now * 1.2)));
    const start = Math.max(Math.min(-long * 0.05, this._begin()), Math.min(from, now));
    this._span = [start, start + long];
    this._follow(isFollowing);
  }

  _follow(isFollowing) {
    this._isFollowing = isFollowing;
    byId("follow").setAttribute("aria-pressed", String(isFollowing));
    this.draw();
  }

  _whole() { this._set(this._begin(), Math.max(5, this._last() * 1.05)); }

  // Where a recording is; of a team, the time that is followed, or the middle of what is shown.
  moment() { return this._recording || this._isFollowing ? this._store.now() ?? 0 : (this._span[0] + this._span[1]) / 2; }

  // The end of a running team is not known yet, so this is not limited to it.
  showMoment(time) {
    const half = (this._span[1] - this._span[0]) / 2;
    this._span = [time - half, time + half];
    this._follow(false);
  }

  _zoomBy(factor) {
    const [from, to] = this._span, now = this._store.now() ?? to;
    const middle = this._isFollowing ? now : (from + to) / 2;
    this._set(middle - (middle - from) * factor, middle + (to - middle) * factor);
  }

  _move(share) {
    const [from, to] = this._span;
    this._set(from + share * (to - from), to + share * (to - from));
  }

  _hitAt(event) {
    const box = this._canvas.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top + this._top;
    return (this._hits ?? []).findLast((hit) => x >= hit.x && x <= hit.x + hit.wide && y >= hit.y && y <= hit.y + hit.height);
  }

  _point(event) {
    const tip = byId("tip"), hit = this._hitAt(event);
    tip.hidden = !hit;
    if (!hit) return;
    setText(tip, hit.text ? hit.text : hit.work ? workText(hit.work, this._end()) : hit.fault ? `${hit.fault.robot} died ${hit.fault.older ? "before" : "at"} ${seconds(hit.fault.at_s)}: ${faultNumbers(hit.fault)}`
      : hit.unwatched ? "Not watched: nothing is known of this time." : `${hit.loss.robot} ${lostText(hit.loss.local_tasks, hit.loss.reason)}`);
    const box = byId("timeline").getBoundingClientRect();
    tip.style.left = `${Math.max(8, Math.min(event.clientX - box.left + 12, box.width - tip.offsetWidth - 8))}px`;
    tip.style.top = `${event.clientY - box.top - tip.offsetHeight - 10}px`;
  }
}

const split = (key) => { const at = key.indexOf("/"); return [key.slice(0, at), key.slice(at + 1)]; };

function faultNumbers(fault) {
  if (fault.older) return fault.held ? "not watched" : "not watched, held no task";
  const known = fault.detected_after === null ? "not detected yet" : `detected after ${fault.detected_after}`;
  if (!fault.held) return `${known}, held no task`;
  if (fault.taken_over_after !== null) return `${known}, taken over after ${fault.taken_over_after}`;
  return `${known}, ${fault.wanted ? "not taken over yet" : "no longer needed"}`;
}

const workName = (work) => `${work.local_task} for ${work.global_task}`;

function workText(work, now) {
  const end = ENDS[work.end] ?? (work.running_s === null ? "waits" : ENDS.running);
  const long = (work.ended_s ?? now) - (work.running_s ?? work.claimed_s);
  const why = work.reason ? `: ${work.reason}` : "";
  return `${work.robot}: ${workName(work)}, ${end}, ${work.older ? "longer than " : ""}${seconds(long)}${why}`;
}
