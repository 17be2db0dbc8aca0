"use strict";
// The slider over the images of a video, and what each of them says of the tracks.

const { images, identities, grid: [COLS, ROWS] } = scene;
const LEVELS = 254;   // of inverse depth in a picture
const BY_KEY = 0.1;   // radians by which a key turns the view
const shown = { hidden: new Set(), points: true, colored: false, wires: true,
                times: 0, opacity: 0.7, chosen: null };
const switchedOff = new Set();   // cylinders that a person does not want to see
let view = new Orbit(scene.up, SLANT);
let now = 0, asOf = -1, begun = null;  // image; that of the picture; start of playing, in s
const bytes = (base64) => Uint8Array.from(atob(base64), (one) => one.charCodeAt(0));

// A stage whose shapes and readings change from image to image.
class Film extends Stage {
  constructor(canvas, scene) {
    const cylinders = identities.map(() => ({ drawn: scene.cylinder, wires: null }));
    super(canvas, { ...scene, shapes: cylinders, views: [] });
    const { gl } = this;
    this.farthest = scene.reach;
    this.own = scene.colors;
    this.coarseness = 0;
    this.array = gl.createVertexArray();
    this.buffer = gl.createBuffer();
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    gl.bindVertexArray(null);
    this.paths = identities.map((_, number) => this.pathOf(number));
  }

  // Readings are as coarse as the levels of their picture: they count as farther by one of
  // those, so that they do not hide the surface that they are of; and paths show through it.
  lift() {
    return -this.coarseness;
  }

  liftOfWires() {
    return this.scene.radius;
  }

  // Lines between the places of a cylinder where it was seen, and how many there are at each image.
  pathOf(number) {
    const places = [], counts = [];
    let before = null;
    for (const { tracks, shapes } of images) {
      const at = tracks.findIndex((one) => one.number === number && one.status !== "lost");
      if (at >= 0) {
        const place = shapes[at].slice(0, 3);
        if (before) places.push(...before, ...place);
        before = place;
      }
      counts.push(places.length / 3);
    }
    return { ...buffersOf(this.gl, [[new Float32Array(places), 3]]), counts, most: 0 };
  }

  // Takes the cylinders of an image.
  take({ tracks, shapes }) {
    this.colors = [...this.own];
    tracks.forEach(({ number, status }, k) => {
      this.shapes[number].drawn.instance = shapes[k];
      if (status === "lost") this.colors[number] = scene.lost;
    });
    this.paths.forEach((path, number) => {
      path.count = path.counts[now];
      this.shapes[number].wires = path.count ? path : null;
    });
  }

  takeReadings(places, taken_from, [near, far]) {
    const { gl } = this;
    this.coarseness = far * far * (1 / near - 1 / far) / (LEVELS - 1);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, places, gl.DYNAMIC_DRAW);
    this.clouds = [{ array: this.array, count: places.length / 3,
                     footprint: scene.footprint, taken_from }];
  }
}

// The picture that is shown with an image: its own, or the last one before it.
function pictureOf(number) {
  while (images[number].picture === null) number -= 1;
  return number;
}

const decoded = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
const rays = floats(scene.rays), depthColors = bytes(scene.depthColors);

async function showPicture() {
  const number = pictureOf(now);
  if (number === asOf) return;
  asOf = number;
  const { picture, ends: [near, far], pose } = images[number], image = new Image();
  image.src = picture;
  await image.decode();
  if (asOf !== number) return;  // another one is asked for by now
  decoded.drawImage(image, 0, 0);
  const levels = decoded.getImageData(0, 0, COLS, ROWS), places = [];
  const axes = [0, 3, 6].map((k) => pose.slice(k, k + 3)), from = pose.slice(9);
  const [first, last] = images[0].ends.map((x) => 1 / x), pixels = levels.data;
  for (let k = 0; k < ROWS * COLS; k++) {
    const level = pixels[4 * k];
    let color = 0;
    if (level) {
      const inverse = 1 / far + (level - 1) / (LEVELS - 1) * (1 / near - 1 / far);
      color = 1 + Math.round((LEVELS - 1) * clamped((inverse - last) / (first - last), 0, 1));
      for (let x = 0; x < 3; x++) {
        const along = [0, 1, 2].reduce((sum, a) => sum + rays[3 * k + a] * axes[a][x], 0);
        places.push(from[x] + along / inverse);
      }
    }
    for (let x = 0; x < 3; x++) pixels[4 * k + x] = depthColors[3 * color + x];
  }
  element("depth").getContext("2d").putImageData(levels, 0, 0);
  element("caption").textContent = captionOf(number);
  stage.takeReadings(new Float32Array(places), from, [near, far]);
  canvas.dataset.image = number;
  changed();
}

function captionOf(number) {
  const { every, everyPicture } = scene, left = [];
  if (every > 1) left.push(`Of ${scene.count} images one in ${every} is in this page.`);
  if (everyPicture > 1) {
    left.push(`One depth image in ${everyPicture} of these is; this is of image ` +
              `${images[number].number + 1}.`);
  }
  return ["Depth, near is dark, with the outlines of the tracks.", ...left].join(" ");
}

function listTracks() {
  identities.forEach((identity, number) => {
    const swatch = made("span", { className: "swatch" });
    swatch.style.background = scene.colors[number];
    const name = `cylinder ${identity}`;
    const button = made("button", { type: "button", onclick: () => choose(number) },
                        [swatch, made("span", { textContent: name }), made("span")]);
    const eye = made("input", { type: "checkbox", checked: true, title: `show ${name}`,
                                ariaLabel: `show ${name}` });
    eye.onchange = () => {
      if (eye.checked) switchedOff.delete(number); else switchedOff.add(number);
      show(now);
    };
    element("shapes").append(made("li", { hidden: true }, [button, eye]));
  });
}

// The numbers of a track in an image, as rows of a table.
const numbersOf = ({ values }) =>
  scene.rows.map(([name, unit], k) => [name, values[2 * k], values[2 * k + 1], unit]);

const briefOf = ({ status, values }) => {
  const radius = `r = ${values[0]} ± ${values[1]} mm`;
  return { new: `new, ${radius}`, tracked: radius, lost: "lost" }[status];
};

function showTracks({ tracks }) {
  const of = new Map(tracks.map((one) => [one.number, one]));
  [...element("shapes").children].forEach((item, number) => {
    const one = of.get(number), brief = item.firstChild.lastChild;
    item.hidden = !one;
    if (!one) return;
    brief.textContent = briefOf(one);
    brief.className = `brief ${one.status}`;
    item.firstChild.ariaPressed = String(number === shown.chosen);
  });
  const place = element("chosen"), { chosen } = shown;
  place.replaceChildren();
  if (chosen === null) return;
  const one = of.get(chosen), name = `cylinder ${identities[chosen]}`;
  const state = one ? one.status + (one.reason && `: ${one.reason}`) : "not in this image";
  place.append(made("h2", { textContent: `${name}: ${state}` }));
  if (one) place.append(made("table", {}, [made("tbody", {}, numbersOf(one).map(rowOf))]));
}

function showOutlines({ tracks }) {
  const box = element("picture").querySelector("svg");
  box.replaceChildren();
  for (const { number, status, outline: d } of tracks) {
    if (!d || switchedOff.has(number)) continue;
    const isLost = status === "lost", group = svg("g", {});
    group.dataset.track = identities[number];
    const words = ["outline", isLost && "lost", number === shown.chosen && "chosen"];
    group.append(svg("path", { d, class: "halo" }),
                 svg("path", { d, class: words.filter(Boolean).join(" "),
                               stroke: isLost ? scene.lost : scene.colors[number] }));
    group.addEventListener("click", () => choose(number));
    box.append(group);
  }
}

// Since the first image.
const secondsOf = (number) => images[number].seconds - images[0].seconds;

function show(number) {
  now = clamped(number, 0, images.length - 1);
  const image = images[now], present = new Set(image.tracks.map((one) => one.number));
  element("image").value = now;
  element("stamp").textContent =
    `${image.number + 1} of ${scene.count}, ${secondsOf(now).toFixed(2)} s`;
  shown.hidden = new Set(identities.keys());
  for (const one of present) if (!switchedOff.has(one)) shown.hidden.delete(one);
  stage.take(image);
  showTracks(image);
  showOutlines(image);
  showPicture();
  changed();
}

function choose(number) {
  shown.chosen = number;
  show(now);
}

function chooseNext() {
  const present = images[now].tracks.map((one) => one.number).sort((a, b) => a - b);
  if (present.length) choose(present.find((one) => one > (shown.chosen ?? -1)) ?? present[0]);
}

function play(isWanted) {
  if (isWanted && now === images.length - 1) show(0);
  begun = isWanted ? performance.now() / 1e3 - secondsOf(now) : null;
  const button = element("play");
  [button.textContent, button.ariaPressed] = isWanted ? ["❚❚", "true"] : ["▶", "false"];
  button.ariaLabel = isWanted ? "Pause" : "Play";
  if (isWanted) requestAnimationFrame(goOn);
}

function goOn() {
  if (begun === null) return;
  const seconds = performance.now() / 1e3 - begun;
  let next = now;
  while (next + 1 < images.length && secondsOf(next + 1) <= seconds) next += 1;
  if (next !== now) show(next);
  if (now === images.length - 1) play(false); else requestAnimationFrame(goOn);
}

const step = (many) => { play(false); show(now + many); };
const TIMES = {
  ArrowLeft: () => step(-1), ArrowRight: () => step(1),
  Home: () => step(-images.length), End: () => step(images.length),
  " ": () => play(begun === null),
};

// What has keys of its own keeps them: of the slider all but the space, of a button that.
function listenToKeys() {
  document.addEventListener("keydown", (event) => {
    const { target, key } = event, act = TIMES[key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
    if (target.matches(key === " " ? "button, [type=checkbox]" : "[type=range]")) return;
    event.preventDefault();
    act();
  });
}

function lookFromCamera() {
  lookFrom(images[now].pose.slice(9));
}

function listenToPanel() {
  listenToControls(["points", "wires"], lookFromCamera, changed);
  element("image").oninput = ({ target }) => { play(false); show(Number(target.value)); };
  element("play").onclick = () => play(begun === null);
}

const title = () => {
  const many = identities.length;
  const found = !many ? "No cylinder" : many === 1 ? "One cylinder" : `${many} cylinders`;
  return `${found} in ${scene.count} images`;
};

function begin() {
  element("title").textContent = document.title = title();
  element("image").max = images.length - 1;
  const [width, height] = scene.size;
  element("picture").append(svg("svg", { viewBox: `-0.5 -0.5 ${width} ${height}` }));
  for (const one of [element("depth"), decoded.canvas]) Object.assign(one, { width: COLS, height: ROWS });
  listTracks();
  stage = new Film(canvas, scene);
  listenToPanel();
  listenToKeys();
  listenToHands(choose, {
    // Left and right are for time.
    ArrowLeft: () => false, ArrowRight: () => false,
    a: () => view.turnBy(-BY_KEY, 0), d: () => view.turnBy(BY_KEY, 0),
    c: lookFromCamera, n: chooseNext,
  });
  note.hidden = true;
  choose(identities.length === 1 ? 0 : null);
}

beginSoon(begin);
