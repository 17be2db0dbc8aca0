"use strict";
// What the pages of fits and of tracks share beside the stage: `stage`, `view` and `shown` are
// the page's own.

const element = (id) => document.getElementById(id);
const scene = JSON.parse(element("scene").textContent);
const [canvas, note] = [element("view"), element("note")];
const SLANT = { yaw: -0.45, pitch: -0.25 };  // of the first view: beside the camera's
let stage = null, asked = 0;

function made(tag, properties = {}, children = []) {
  const one = Object.assign(document.createElement(tag), properties);
  one.append(...children);
  return one;
}

function svg(tag, attributes) {
  const one = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) one.setAttribute(name, value);
  return one;
}

const rowOf = ([name, value, std, unit]) => made("tr", {}, [
  made("th", { scope: "row", textContent: name }),
  made("td", { textContent: value }),
  made("td", { className: "std", textContent: std && /\d/.test(std) ? `± ${std}` : std }),
  made("td", { className: "unit", textContent: unit }),
]);

function changed() {
  cancelAnimationFrame(asked);
  canvas.dataset.drawn = "before";
  asked = requestAnimationFrame(() => {
    const size = [canvas.clientWidth, canvas.clientHeight];
    const [width, height] = size.map((x) => Math.max(Math.round(x * devicePixelRatio), 1));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    stage.draw(view, shown);
    canvas.dataset.drawn = "whole";
  });
}

// The eye at a place of the page, that of a camera, with the axes of the first one.
function lookFrom(place) {
  const away = DISTANCE * scene.radius, zoom = Math.max(-place[2] / away, 1 / FARTHEST);
  Object.assign(view, { yaw: 0, pitch: 0, zoom,
                        shift: place.map((x, k) => x + zoom * away * FORWARD[k]) });
}

// The controls that the pages share; after a switch, `switched` is called.
function listenToControls(switches, lookFromCamera, switched) {
  for (const name of switches) {
    element(name).onchange = ({ target }) => { shown[name] = target.checked; switched(); };
  }
  element("opacity").oninput = ({ target }) => {
    shown.opacity = Number(target.value) / 100;
    changed();
  };
  const looks = { back: () => view.goBack(), "as-camera": lookFromCamera };
  for (const [id, look] of Object.entries(looks)) {
    element(id).onclick = () => { look(); changed(); };
  }
}

function listenToHands(choose, keys) {
  new Hands(canvas, view, {
    metersEach: () => {
      const away = view.zoom * DISTANCE * scene.radius;
      const each = away / (FOCAL * Math.min(canvas.clientWidth, canvas.clientHeight));
      return [each, each];
    },
    changed,
    tapped: (x, y) => {
      const box = canvas.getBoundingClientRect();
      const at = [x - box.left, y - box.top].map((z) => Math.floor(z * devicePixelRatio));
      choose(stage.pick(view, shown, ...at));
    },
    keys,
  });
  new ResizeObserver(changed).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
  canvas.addEventListener("webglcontextlost", () => {
    tell("The graphics driver has given up; reload the page.");
  });
}

function tell(text) {
  note.textContent = text;
  note.hidden = false;
}

// First the note is painted: to compile may take seconds.
function beginSoon(begin) {
  requestAnimationFrame(() => setTimeout(() => {
    try {
      begin();
    } catch (error) {
      tell(`This cannot be shown: ${error.message}`);
    }
  }));
}
