"use strict";
// What stands beside the scene, and what a person does with both.

const DIGITS = 2;            // of the legend
const shown = { hidden: new Set(), points: true, colored: true, wires: true,
                times: scene.deviations, opacity: 0.35, chosen: null };
let view = new Orbit(scene.up, SLANT);

const lookFromCamera = () => lookFrom(scene.views[0].taken_from);

const title = () => {
  const { shapes } = scene;
  if (!shapes.length) return "Nothing was found";
  return shapes.length === 1 ? `${shapes[0].kind}: ${shapes[0].status}`
                             : `${shapes.length} fits in this image`;
};

// A failure in a word; the words of a fit that is not sure.
const stateOf = ({ drawn, isGood, status }) =>
  !drawn ? `failed: ${status}` : isGood ? "" : status;

function briefOf(shape) {
  const [, value, std, unit] = shape.numbers.find(([name]) => name.includes("radius")) ?? [];
  return value === undefined ? "" : `r = ${value} ± ${std} ${unit}`;
}

function listShapes() {
  const list = element("shapes");
  scene.shapes.forEach((shape, number) => {
    const state = stateOf(shape), drawn = shape.drawn !== null;
    const swatch = made("span", { className: drawn ? "swatch" : "swatch none" });
    if (drawn) swatch.style.background = colorOf(number);
    const button = made("button", { type: "button", onclick: () => choose(number) }, [
      swatch, made("span", { textContent: shape.name }),
      made("span", { className: state ? "bad" : "brief", textContent: state || briefOf(shape) }),
    ]);
    const eye = made("input", { type: "checkbox", checked: true, disabled: !drawn,
                                title: `show ${shape.name}`, ariaLabel: `show ${shape.name}` });
    eye.onchange = () => {
      if (eye.checked) shown.hidden.delete(number); else shown.hidden.add(number);
      showOutlines();
      changed();
    };
    list.append(made("li", {}, scene.shapes.length > 1 || drawn ? [button, eye] : [button]));
  });
}

// Tells the numbers of a shape, and marks it; null of none.
function choose(number) {
  shown.chosen = number;
  document.querySelectorAll("#shapes button").forEach((button, k) => {
    button.ariaPressed = String(k === number);
  });
  const place = element("chosen");
  place.replaceChildren();
  if (number !== null) {
    const shape = scene.shapes[number], state = stateOf(shape);
    if (scene.shapes.length > 1) {
      place.append(made("h2", { textContent: `${shape.name}: ${shape.status}` }));
    }
    for (const [k, text] of shape.notes.entries()) {
      place.append(made("p", { textContent: text, className: !k && state ? "bad" : "" }));
    }
    place.append(made("table", {}, [made("tbody", {}, shape.numbers.map(rowOf))]));
  }
  showOutlines();
  changed();
}

function chooseNext() {
  const many = scene.shapes.length;
  if (many) choose(shown.chosen === null ? 0 : (shown.chosen + 1) % many);
}

function showPictures() {
  const place = element("pictures");
  for (const { size: [width, height], picture, outlines } of scene.views) {
    const box = svg("svg", { viewBox: `-0.5 -0.5 ${width} ${height}`, role: "img",
                             "aria-label": "Depth image with the fitted outlines" });
    box.append(svg("image", { href: picture, x: -0.5, y: -0.5, width, height }));
    outlines.forEach((d, number) => {
      if (!d) return;
      const group = svg("g", {});
      group.dataset.shape = number;
      group.append(svg("path", { d, class: "halo" }),
                   svg("path", { d, class: "outline", stroke: colorOf(number) }));
      group.addEventListener("click", () => choose(number));
      box.append(group);
    });
    place.append(box);
  }
}

function showOutlines() {
  for (const group of document.querySelectorAll("#pictures g")) {
    const number = Number(group.dataset.shape);
    group.style.display = shown.hidden.has(number) ? "none" : "";
    group.lastChild.classList.toggle("chosen", number === shown.chosen);
  }
}

function showLegend() {
  element("legend").hidden =
    !(shown.points && shown.colored && scene.shapes.some(({ drawn }) => drawn));
  element("bar").style.background = `linear-gradient(to right, ${RESIDUALS})`;
  const [low, , high] = element("ticks").children;
  const limit = (1e3 * scene.limit).toPrecision(DIGITS);
  [low.textContent, high.textContent] = [`−${limit}`, `+${limit}`];
}

// What failed is told where nobody overlooks it.
function warn() {
  const failed = scene.shapes.filter(({ drawn }) => !drawn);
  const alert = element("alert");
  alert.hidden = !failed.length;
  alert.textContent = failed.map(({ name, status, notes }) =>
    `${name}: the fit failed (${status}), there is no shape. ${notes[0]}`).join("\n");
}

function listenToPanel() {
  listenToControls(["points", "colored", "wires"], lookFromCamera, () => {
    showLegend();
    changed();
  });
  element("times").onchange = ({ target }) => {
    shown.times = Number(target.value) * scene.deviations;
    changed();
  };
}

function begin() {
  element("title").textContent = title();
  document.title = title();
  listShapes();
  showPictures();
  showLegend();
  warn();
  stage = new Stage(canvas, scene);
  listenToPanel();
  listenToHands(choose, { c: lookFromCamera, n: chooseNext });
  note.hidden = true;
  choose(scene.shapes.length === 1 ? 0 : null);
}

beginSoon(begin);
