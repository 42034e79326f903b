// The position in a run: it follows the newest row, stands still, or moves at a chosen speed.

export class Player {
  constructor(run, onChange) {
    this.run = run;
    this.onChange = onChange;
    this.state = "live";
    this.time = 0;
    this.speed = 10;
    this.lastFrame = null;
    this.onMode = () => {};
  }

  /** live, paused or playing. */
  get mode() {
    return this.state;
  }

  set mode(mode) {
    const isNew = mode !== this.state;
    this.state = mode;
    if (isNew) this.onMode();
  }

  get first() {
    return this.run.rows.times[0] ?? 0;
  }

  get last() {
    return this.run.rows.lastTime ?? 0;
  }

  /** Trip time that the page shows; null without rows. */
  get now() {
    if (this.run.rows.lastTime === null) return null;
    return this.mode === "live" ? this.last : Math.min(Math.max(this.time, this.first), this.last);
  }

  seek(time) {
    this.time = Math.min(Math.max(time, this.first), this.last);
    if (this.mode === "live") this.mode = "paused";
    this.onChange();
  }

  pause() {
    this.time = this.now ?? 0;
    this.mode = "paused";
    this.onChange();
  }

  /** Play from here; at the end of a trip, from its start. */
  play() {
    const isAtEnd = this.now === null || this.now >= this.last;
    this.time = isAtEnd && this.run.end.ended ? this.first : (this.now ?? 0);
    this.mode = "playing";
    this.lastFrame = null;
    this.onChange();
    requestAnimationFrame((at) => this.advance(at));
  }

  toggle() {
    if (this.mode === "playing" || (this.mode === "live" && !this.run.end.ended)) this.pause();
    else this.play();
  }

  /** Follow the newest row. */
  follow() {
    this.mode = "live";
    this.onChange();
  }

  advance(at) {
    if (this.mode !== "playing") return;
    if (this.lastFrame !== null) this.time += (this.speed * (at - this.lastFrame)) / 1000;
    this.lastFrame = at;
    if (this.time >= this.last) this.follow();
    else {
      this.onChange();
      requestAnimationFrame((next) => this.advance(next));
    }
  }
}
