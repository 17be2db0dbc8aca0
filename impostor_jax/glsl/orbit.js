"use strict";
// What the pages that are turned by hand share: where the eye is, and what hands do to it.
//
// All is in the frame of the camera with which a page begins: x right, y down, z forward.

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                         a[0] * b[1] - a[1] * b[0]];
const clamped = (x, low, high) => Math.min(Math.max(x, low), high);

// A vector, turned about a unit axis.
function turned(v, axis, angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  const along = (1 - c) * dot(axis, v), side = cross(axis, v);
  return v.map((x, k) => c * x + s * side[k] + along * axis[k]);
}

const FORWARD = [0, 0, 1];
const STEEPEST = Math.PI / 2 - 0.02;
const FARTHEST = 1e3;  // times the distance at the start; and as much nearer

// A camera that turns about a pivot, while one direction stays upright.
class Orbit {
  constructor(up, start = {}) {
    const level = cross(FORWARD, up);
    this.up = up;
    this.right = level.map((x) => x / Math.hypot(...level));
    this.rise = Math.asin(dot(FORWARD, up));  // of the direction of view, at the start
    this.start = { yaw: 0, pitch: 0, zoom: 1, shift: [0, 0, 0], ...start };
    this.goBack();
  }

  goBack() {
    Object.assign(this, this.start);
  }

  // A direction of the turned camera.
  inScene(v) {
    return turned(turned(v, this.right, this.pitch), this.up, this.yaw);
  }

  turnBy(right, down) {
    this.yaw -= right;
    this.pitch = clamped(this.rise + this.pitch - down, -STEEPEST, STEEPEST) - this.rise;
  }

  comeNearer(factor) {
    this.zoom = clamped(this.zoom / factor, 1 / FARTHEST, FARTHEST);
  }

  // Moves what is as far away as the pivot, in meters.
  moveBy(right, down) {
    const way = this.inScene([right, down, 0]);
    this.shift = this.shift.map((x, k) => x - way[k]);
  }
}

const TURN_BY_KEY = 0.1;
const TAP = 6;  // pixels that a finger may move while it taps

// Lets the hands on a canvas, and the keys, move a view.
//
// `metersEach()` is how far what is as far away as the pivot moves by a pixel of the page,
// right and down; `changed()` is called after each movement. A tap calls `tapped(x, y)`, in
// pixels of the page; `keys` has what other keys do, by their names.
class Hands {
  constructor(canvas, view, { metersEach, changed, tapped = () => {}, keys = {} }) {
    Object.assign(this, { canvas, view, metersEach, changed, tapped });
    this.held = new Map();  // fingers and the mouse, by their numbers: where they are
    this.travelled = 0;     // since the first of them came
    this.keys = {
      ArrowLeft: () => view.turnBy(-TURN_BY_KEY, 0),
      ArrowRight: () => view.turnBy(TURN_BY_KEY, 0),
      ArrowUp: () => view.turnBy(0, -TURN_BY_KEY),
      ArrowDown: () => view.turnBy(0, TURN_BY_KEY),
      "+": () => view.comeNearer(1.1),
      "-": () => view.comeNearer(1 / 1.1),
      r: () => view.goBack(),
      ...keys,
    };
    canvas.addEventListener("pointerdown", (event) => this.taken(event));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerup", (event) => this.released(event));
    canvas.addEventListener("pointercancel", (event) => this.held.delete(event.pointerId));
    this.listen("pointermove", (event) => this.moved(event));
    this.listen("wheel", (event) => {
      // Lines and pages of a wheel, in pixels.
      const each = [1, 16, innerHeight][event.deltaMode];
      view.comeNearer(Math.exp(-0.001 * each * event.deltaY));
    });
    this.listen("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return false;
      return (this.keys[event.key] ?? this.keys[event.key.toLowerCase()] ?? (() => false))();
    });
  }

  listen(name, act) {
    this.canvas.addEventListener(name, (event) => {
      if (act(event) === false) return;
      event.preventDefault();
      this.changed();
    }, { passive: false });
  }

  taken(event) {
    this.canvas.setPointerCapture(event.pointerId);
    if (!this.held.size) this.travelled = 0;
    this.held.set(event.pointerId, [event.clientX, event.clientY]);
  }

  released(event) {
    const wasHeld = this.held.delete(event.pointerId);
    if (wasHeld && !this.held.size && this.travelled < TAP) {
      this.tapped(event.clientX, event.clientY);
    }
  }

  moved(event) {
    const before = this.held.get(event.pointerId);
    if (!before) return false;
    const now = [event.clientX, event.clientY];
    this.held.set(event.pointerId, now);
    const [right, down] = [now[0] - before[0], now[1] - before[1]];
    this.travelled += Math.hypot(right, down);
    const other = [...this.held].find(([id]) => id !== event.pointerId)?.[1];
    const [across, along] = this.metersEach();
    if (other) {
      const reach = ([x, y]) => Math.max(Math.hypot(x - other[0], y - other[1]), 1);
      this.view.comeNearer(reach(now) / reach(before));
      this.view.moveBy(across * right / 2, along * down / 2);
    } else if (event.shiftKey || event.buttons & ~1) {
      this.view.moveBy(across * right, along * down);
    } else {
      const each = Math.PI / innerHeight;
      this.view.turnBy(each * right, each * down);
    }
  }
}
