// A recording: play, pause, speed, and any place of it. The server plays it; all its pages see the same.

import { byId, element, knownAt, lostText, seconds, setText } from "./text.mjs";

const STEP_S = 5, SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16, 32, 64], END_S = 0.05;

export class PlaybackView {
  constructor(store, recording) {
    this._store = store;
    this._from = recording.from_s;
    this._to = recording.to_s;
    this._isHeld = false;
    this._slider = byId("place");
    // In whole steps of the slider, so that its end is the recording's.
    this._slider.min = Math.floor(recording.from_s * 100) / 100;
    this._slider.max = Math.ceil(recording.to_s * 100) / 100;
    byId("speed").append(...SPEEDS.map((speed) => element("option", { value: speed }, `${speed}×`)));
    const whose = recording.robot ? `what ${recording.robot} knew` : "as it was watched";
    this._about = `${recording.file}: ${whose}, run ${recording.run}`;
    byId("playback").hidden = false;
    this._listen();
  }

  update(keys) {
    if (keys.has("playback")) this._draw();
    if ([...keys].some((key) => key.startsWith("fault/") || key.startsWith("loss/"))) this._mark();
  }

  // Called every frame.
  tick() {
    const now = this._store.now();
    if (now === null || document.hidden) return;
    const text = `${seconds(now)} of ${seconds(this._to)}`;
    setText(byId("place-text"), text);
    if (this._isHeld) return;
    const value = now.toFixed(2);
    if (this._slider.value !== value) {
      this._slider.value = value;
      this._slider.setAttribute("aria-valuetext", text);
    }
  }

  go(time, isPaused) {
    const at = Math.max(this._from, Math.min(time, this._to));
    this._store.leap(at);
    this._wish({ at_s: at, ...(isPaused ? { paused: true } : {}) });
  }

  // Times at which something broke, in order.
  _faults() {
    const times = ["fault", "loss"].flatMap((kind) => [...this._store.all(kind).values()].map(knownAt));
    return [...new Set(times)].sort((a, b) => a - b);
  }

  _leap(direction) {
    const now = this._store.now() ?? 0;
    // A little before it counts as being there: it takes a moment to press again.
    const ahead = this._faults().filter((time) => (direction > 0 ? time > now + END_S : time < now - 0.5));
    if (ahead.length) this.go(direction > 0 ? ahead[0] : ahead.at(-1));
  }

  _draw() {
    const told = this._store.get("playback");
    if (!told) return;
    const read = told.read_s === null ? "" : `; timeline read up to ${seconds(told.read_s)} of ${seconds(this._to)}`;
    setText(byId("playback-hint"), this._about + read);
    const play = byId("play");
    setText(play, told.paused ? "▶" : "❚❚");
    play.setAttribute("aria-label", told.paused ? "Play" : "Pause");
    const choice = byId("speed");
    if (![...choice.options].some((each) => Number(each.value) === told.speed)) {
      choice.append(element("option", { value: told.speed }, `${told.speed}×`));
    }
    choice.value = told.speed;
  }

  // Marks above the slider; the list of faults and the buttons beside it say the same.
  _mark() {
    const marks = ["fault", "loss"].flatMap((kind) => [...this._store.all(kind).values()].map((each) => {
      const mark = element("i", { class: kind, title: `${each.robot} ${kind === "fault" ? "died" : lostText(each.local_tasks, each.reason)} at ${seconds(each.at_s)}`,
        onclick: () => this.go(knownAt(each)) });
      mark.style.left = `${(each.at_s - this._from) / Math.max(1e-6, this._to - this._from) * 100}%`;
      return mark;
    }));
    byId("place-marks").replaceChildren(...marks);
  }

  _toggle() { this._wish({ paused: !(this._store.get("playback")?.paused ?? true) }); }

  _faster(direction) {
    const speed = this._store.get("playback")?.speed ?? 1;
    const next = direction > 0 ? SPEEDS.find((each) => each > speed) : SPEEDS.findLast((each) => each < speed);
    if (next) this._wish({ speed: next });
  }

  _listen() {
    const byArrows = { ArrowLeft: () => this.go(this._store.now() - STEP_S), ArrowRight: () => this.go(this._store.now() + STEP_S) };
    const press = (id, act) => byId(id).addEventListener("click", act);
    press("play", () => this._toggle());
    press("back", byArrows.ArrowLeft);
    press("forth", byArrows.ArrowRight);
    press("previous-fault", () => this._leap(-1));
    press("next-fault", () => this._leap(1));
    byId("speed").addEventListener("change", (event) => this._wish({ speed: Number(event.target.value) }));
    this._slider.addEventListener("input", () => { this._isHeld = true; this.go(Number(this._slider.value)); });
    this._slider.addEventListener("change", () => { this._isHeld = false; });
    // Space and the arrows work wherever they mean nothing else.
    document.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey || event.target.closest("button, input, select, summary, .rows, .lanes")) return;
      this._key({ " ": () => this._toggle(), ...byArrows }, event);
    });
    this._slider.addEventListener("keydown", (event) => this._key({ ...byArrows, ArrowUp: byArrows.ArrowRight,
      ArrowDown: byArrows.ArrowLeft }, event));
    // Letters and signs mean something only within the bar.
    byId("playback").addEventListener("keydown", (event) => this._key({ n: () => this._leap(1), p: () => this._leap(-1),
      "<": () => this._faster(-1), ">": () => this._faster(1) }, event));
  }

  _key(acts, event) {
    const act = acts[event.key];
    if (act) { act(); event.preventDefault(); }
  }

  // Only the newest wish counts while one is under way, as when the slider is dragged.
  async _wish(wish) {
    this._wanted = { ...this._wanted, ...wish };
    if (this._isAsking) return;
    this._isAsking = true;
    while (this._wanted) {
      const body = JSON.stringify(this._wanted);
      this._wanted = null;
      try {
        await fetch("playback", { method: "POST", headers: { "content-type": "application/json" }, body });
      } catch { /* the headline says that the connection is lost */ }
    }
    this._isAsking = false;
  }
}
