"use strict";
// Draws readings, wireframes and shapes of a scene into one depth buffer.
//
// All places are in the frame of the page, whose origin is what the view turns about. An
// instance of a shape is moved into the frame of the turned camera here, so that the shaders
// that the desktop draws with do the rest.

const COLORS = ["#d81b7a", "#00a3c4", "#e07b00", "#7e57e0", "#3f9c35", "#c0392b"];
const RESIDUALS = ["#b3182d", "#ef8a4b", "#f4dd7a", "#74a9d4", "#2a4fa0"];  // nearer, farther
const FOCAL = 1.3;    // of the shorter side of the canvas,
const DISTANCE = 3.1; // and of the radius of what is looked at, which then fills the view
const MOST_LIFT = 0.1;// of that radius, which a reading may count as nearer: see marks.glsl
const MARGIN = 1e-3;  // of that radius, from the eye to what is drawn

const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
const colorOf = (number) => COLORS[number % COLORS.length];
const styleColor = (name) =>
  rgb(getComputedStyle(document.documentElement).getPropertyValue(name).trim());

function floats(base64) {
  const bytes = Uint8Array.from(atob(base64), (one) => one.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}

// Buffers {count, array} of attributes [[values, components]], in the order of their places.
function buffersOf(gl, attributes) {
  const array = gl.createVertexArray();
  gl.bindVertexArray(array);
  attributes.forEach(([values, components], place) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, components, gl.FLOAT, false, 0, 0);
  });
  gl.bindVertexArray(null);
  return { array, count: attributes[0][0].length / attributes[0][1] };
}

class Stage {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.scene = scene;
    this.colors = scene.colors ?? COLORS;
    this.gl = canvas.getContext("webgl2", { antialias: true, powerPreference: "high-performance" });
    const gl = this.gl;
    if (!gl) {
      throw new Error("this browser has no WebGL2, or it is switched off; " +
                      "nothing can be drawn without it");
    }
    this.readings = program(gl, scene.readings);
    this.wires = program(gl, scene.wires);
    this.clouds = scene.views.map((one) => ({
      ...buffersOf(gl, [[floats(one.places), 3], [floats(one.residuals), 1],
                        [floats(one.owners), 1]]),
      footprint: one.footprint, taken_from: one.taken_from,
    }));
    this.shapes = scene.shapes.map(({ drawn, wires }) => ({
      drawn: drawn && this.drawnShape(drawn),
      wires: wires && { ...buffersOf(gl, [[floats(wires.places), 3], [floats(wires.changes), 3]]),
                        most: wires.most },
    }));
  }

  drawnShape({ sources, attributes, fields, instance, textures }) {
    const { gl } = this, used = program(gl, sources), array = gl.createVertexArray();
    const buffer = gl.createBuffer();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    let offset = 0;
    attributes.forEach(([, count], place) => {
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, count, gl.FLOAT, false, 4 * instance.length, 4 * offset);
      gl.vertexAttribDivisor(place, 1);
      offset += count;
    });
    gl.bindVertexArray(null);
    gl.useProgram(used);
    const held = bindTextures(gl, used, textures);
    return { used, array, buffer, fields, instance, textures: held };
  }

  // By how much readings count as nearer: of half of them noise alone is behind the surface.
  lift() {
    return Math.min(this.scene.limit, MOST_LIFT * this.scene.radius);
  }

  // The same of lines: readings must not hide them, either.
  liftOfWires() {
    return 2 * this.lift();
  }

  // The turned camera: its axes as rows, its eye, and how pixels lie.
  cameraOf(view, width, height) {
    const { radius } = this.scene, axes = [[1, 0, 0], [0, 1, 0], FORWARD].map((v) => view.inScene(v));
    const eye = view.shift.map((x, k) => x - view.zoom * DISTANCE * radius * axes[2][k]);
    const middle = -dot(axes[2], eye), focal = FOCAL * Math.min(width, height);
    const near = Math.max(middle - this.reach(), MARGIN * radius);
    return {
      axes, eye,
      uniforms: {
        focal: [focal, focal], principal: [(width - 1) / 2, (height - 1) / 2],
        image_size: [width, height],
        depth_range: [near, Math.max(middle + this.reach(), 2 * near) - near, 0],
      },
    };
  }

  // How far the readings are from the origin.
  reach() {
    this.farthest ??= this.scene.views.reduce((most, { places }) => {
      const all = floats(places);
      for (let k = 0; k < all.length; k += 3) {
        most = Math.max(most, Math.hypot(all[k], all[k + 1], all[k + 2]));
      }
      return most;
    }, 2 * this.scene.radius);
    return this.farthest;
  }

  // Numbers of an instance in the frame of the turned camera.
  moved({ fields, instance }, { axes, eye }) {
    const turn = (v) => axes.map((axis) => dot(axis, v));
    const numbers = [...instance];
    let first = 0;
    for (const [count, kind] of fields) {
      const own = instance.slice(first, first + count);
      let now = own;
      if (kind === "point") now = turn(own.map((x, k) => x - eye[k]));
      if (kind === "direction") now = turn(own);
      if (kind === "matrix") {
        const columns = [0, 1, 2].map((k) => turn([own[k], own[3 + k], own[6 + k]]));
        now = [0, 1, 2].flatMap((k) => columns.map((column) => column[k]));
      }
      numbers.splice(first, count, ...now);
      first += count;
    }
    return new Float32Array(numbers);
  }

  // Draws what `shown` {hidden, points, colored, wires, times, opacity, chosen} says.
  draw(view, shown) {
    const { gl, canvas } = this;
    const camera = this.cameraOf(view, canvas.width, canvas.height);
    this.begin([...styleColor("--ground"), 1]);
    if (shown.points) this.drawReadings(camera, shown.colored, 0);
    const seen = this.shapes.map((one, number) => [one, number])
                            .filter(([, number]) => !shown.hidden.has(number));
    if (shown.wires) for (const [one] of seen) this.drawWires(one, camera, shown.times);
    if (!shown.opacity) return;
    // What is nearest alone is blended: first the depths, then the colors at these.
    gl.colorMask(false, false, false, false);
    for (const [one] of seen) this.drawShape(one, camera, [0, 0, 0, 1], 0);
    gl.colorMask(true, true, true, true);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthFunc(gl.EQUAL);
    for (const [one, number] of seen) {
      const more = number === shown.chosen && seen.length > 1 ? 0.25 : 0;
      const opacity = Math.min(shown.opacity + more, 1);
      this.drawShape(one, camera, [...rgb(this.colors[number % this.colors.length]), opacity], 0);
    }
    gl.depthFunc(gl.LESS);
    gl.disable(gl.BLEND);
  }

  // Number of the shape that a pixel of the canvas shows, or whose reading; null of none.
  pick(view, shown, x, y) {
    const { gl, canvas } = this, frame = gl.createFramebuffer();
    const targets = [[gl.COLOR_ATTACHMENT0, gl.RGBA8], [gl.DEPTH_ATTACHMENT, gl.DEPTH_COMPONENT24]];
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    const buffers = targets.map(([place, format]) => {
      const buffer = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.renderbufferStorage(gl.RENDERBUFFER, format, canvas.width, canvas.height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, buffer);
      return buffer;
    });
    const camera = this.cameraOf(view, canvas.width, canvas.height), row = canvas.height - 1 - y;
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(x, row, 1, 1);
    this.begin([0, 0, 0, 1]);
    if (shown.points) this.drawReadings(camera, shown.colored, 1);
    this.shapes.forEach((one, number) => {
      if (!shown.opacity || shown.hidden.has(number)) return;
      const digits = [(number + 1) % 256, Math.floor((number + 1) / 256)];
      this.drawShape(one, camera, [...digits.map((x) => x / 255), 0, 1], 1);
    });
    const pixel = new Uint8Array(4);
    gl.readPixels(x, row, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    gl.disable(gl.SCISSOR_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    buffers.forEach((buffer) => gl.deleteRenderbuffer(buffer));
    gl.deleteFramebuffer(frame);
    const found = pixel[0] + 256 * pixel[1];
    return found ? found - 1 : null;
  }

  begin(ground) {
    const { gl, canvas } = this;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.enable(gl.DEPTH_TEST);
    gl.clearColor(...ground);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  drawReadings(camera, isColored, isFlat) {
    const { gl, readings } = this;
    this.use(readings, camera, {
      limit: [this.scene.limit], smallest: [1.6 * devicePixelRatio],
      other: styleColor("--other"), used: styleColor("--used"),
      is_colored: [Number(isColored)], is_flat: [isFlat], lift: [this.lift()],
    });
    gl.uniform3fv(gl.getUniformLocation(readings, "scale"), RESIDUALS.flatMap(rgb));
    for (const { array, count, footprint, taken_from } of this.clouds) {
      setFloats(gl, readings, { footprint, taken_from });
      gl.bindVertexArray(array);
      gl.drawArrays(gl.POINTS, 0, count);
    }
  }

  // The largest shape and the smallest one.
  drawWires({ wires }, camera, deviations) {
    if (!wires) return;
    const { gl } = this;
    this.use(this.wires, camera, {
      color: [...styleColor("--wire"), 1], lift: [this.liftOfWires()],
    });
    gl.bindVertexArray(wires.array);
    for (const many of [deviations, -Math.min(deviations, wires.most)]) {
      setFloats(gl, this.wires, { deviations: [many] });
      gl.drawArrays(gl.LINES, 0, wires.count);
    }
  }

  drawShape({ drawn }, camera, color, isFlat) {
    if (!drawn) return;
    const { gl } = this;
    gl.useProgram(drawn.used);
    setFloats(gl, drawn.used, { ...camera.uniforms, color, is_flat: [isFlat] });
    drawn.textures.forEach((texture, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
    });
    gl.bindBuffer(gl.ARRAY_BUFFER, drawn.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, this.moved(drawn, camera), gl.DYNAMIC_DRAW);
    gl.bindVertexArray(drawn.array);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, 1);
  }

  use(used, { axes, eye, uniforms }, more) {
    this.gl.useProgram(used);
    // Column by column, of a matrix whose rows are the axes.
    const turn = [0, 1, 2].flatMap((k) => axes.map((axis) => axis[k]));
    setFloats(this.gl, used, { ...uniforms, view_from_page: turn, eye, ...more });
  }
}
