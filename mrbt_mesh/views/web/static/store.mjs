// What is known of the team, and the connection that keeps it so.
//
// News change a map; the page is drawn once per frame from what the map holds then. So a page
// that is slow, or hidden, skips what is old and never queues it.

const RETRY_MS = 1000;
// The server says something every second.
const SILENCE_MS = 4000;

const epochOf = (event) => event.lastEventId.split(".")[0];

export class Store {
  constructor(run) {
    this._run = run;
    this.items = new Map();
    this._kinds = new Map();
    this.state = "connecting";
    // Where a recording ends.
    this.end = Infinity;
    this._views = [];
    this._dirty = new Set();
    this._now = { s: null, at: 0 };
    this._frame = 0;
    this._heardAt = 0;
    // The epoch of the server that has said that it is over: it may answer once more before it ends.
    this._over = "";
  }

  // `view(keys)` is called with the keys that have changed, at most once per frame.
  onChange(view) { this._views.push(view); }

  get(key) { return this.items.get(key); }

  // Name -> value of all items `kind/name`.
  all(kind) {
    if (!this._kinds.has(kind)) this._kinds.set(kind, new Map());
    return this._kinds.get(kind);
  }

  // The team's time now, in seconds from the start of the run; null before.
  now() {
    if (this._now.s === null) return null;
    const playback = this.items.get("playback");
    if (playback) return this._played(playback);
    const ended = this.items.get("team")?.ended_s;
    if (ended !== null && ended !== undefined) return ended;
    if (this.state !== "connected") return this._now.s;
    return this._now.s + Math.min(SILENCE_MS, performance.now() - this._now.at) / 1000;
  }

  // Where a recording is: between two news it goes on as fast as it is played.
  _played({ paused, speed }) {
    const isPlaying = this.state === "connected" && !paused;
    const passed = isPlaying ? Math.min(SILENCE_MS, performance.now() - this._now.at) / 1000 * speed : 0;
    return Math.min(this._now.s + passed, this.end);
  }

  // Somebody has gone elsewhere in a recording: it is shown before the server says so.
  leap(at) { this._now = { s: at, at: performance.now() }; }

  connect() {
    const source = new EventSource("events");
    const take = (event, isFresh) => {
      const news = JSON.parse(event.data);
      // Another run on this port: what is shown stays, and the page offers the other one.
      if (news.run !== this._run) { source.close(); clearInterval(watch); return this._become("replaced"); }
      this._heardAt = performance.now();
      this._now = { s: news.now_s, at: this._heardAt };
      this._take(news.items, isFresh);
      this._become("connected");
      if (this._over !== epochOf(event)) this._over = "";
    };
    source.addEventListener("begin", (event) => take(event, true));
    source.addEventListener("news", (event) => take(event, false));
    source.addEventListener("over", (event) => { this._over = epochOf(event); this._become("over"); });
    // After the end too: the next run may be served here.
    const again = () => {
      source.close();
      clearInterval(watch);
      this._become(this._over ? "over" : "lost");
      setTimeout(() => this.connect(), RETRY_MS);
    };
    source.onerror = () => { if (source.readyState === EventSource.CLOSED || this._over) again(); else this._become("lost"); };
    this._heardAt = performance.now();
    const watch = setInterval(() => {
      if (performance.now() - this._heardAt > SILENCE_MS) again();
    }, RETRY_MS);
  }

  _take(items, isFresh) {
    if (isFresh) {
      for (const key of this.items.keys()) this._dirty.add(key);
      this.items.clear();
      this._kinds.clear();
    }
    for (const [key, value] of Object.entries(items)) {
      const at = key.indexOf("/"), known = this.all(key.slice(0, at)), name = key.slice(at + 1);
      if (value === null) { this.items.delete(key); known.delete(name); }
      else { this.items.set(key, value); known.set(name, value); }
      this._dirty.add(key);
    }
    if (items.older) this._dropOlder(items.older);
    this._draw();
  }

  // What the server does not keep any more.
  _dropOlder(older) {
    for (const [kind, [first, kept]] of Object.entries(older)) {
      for (const name of this.all(kind).keys()) {
        if (Number(name) >= first || kept.includes(Number(name))) continue;
        this.all(kind).delete(name);
        this.items.delete(`${kind}/${name}`);
        this._dirty.add(`${kind}/${name}`);
      }
    }
  }

  _become(state) {
    if (state === this.state) return;
    this.state = state;
    this._dirty.add("connection");
    this._draw();
  }

  _draw() {
    if (this._frame || this._dirty.size === 0) return;
    this._frame = requestAnimationFrame(() => {
      this._frame = 0;
      const keys = this._dirty;
      this._dirty = new Set();
      for (const view of this._views) view(keys);
    });
  }
}
