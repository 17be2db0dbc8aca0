"use strict";
// What the pages share: programs, textures of numbers, and a traced scene's numbers.

const programs = new Map();

function program(gl, sources) {
  const key = sources.join("");
  if (programs.has(key)) return programs.get(key);
  const linked = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, sources[0]],
                              [gl.FRAGMENT_SHADER, sources[1]]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) {
      throw new Error(gl.getShaderInfoLog(shader));
    }
    gl.attachShader(linked, shader);
  }
  gl.linkProgram(linked);
  if (!gl.getProgramParameter(linked, gl.LINK_STATUS)) {
    throw new Error(gl.getProgramInfoLog(linked));
  }
  programs.set(key, linked);
  return linked;
}

// Floats {size, each, base64}, one or four together, which a shader reads one by one.
function sampleTexture(gl, { size, each, base64 }) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  const [stored, given] = each === 4 ? [gl.RGBA32F, gl.RGBA] : [gl.R32F, gl.RED];
  const bytes = Uint8Array.from(atob(base64), (one) => one.charCodeAt(0));
  gl.texImage2D(gl.TEXTURE_2D, 0, stored, ...size, 0, given, gl.FLOAT,
                new Float32Array(bytes.buffer));
  for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
    gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
  }
  return texture;
}

function setFloats(gl, used, uniforms) {
  for (const [name, value] of Object.entries(uniforms)) {
    const place = gl.getUniformLocation(used, name);
    if (value.length === 9) gl.uniformMatrix3fv(place, false, value);
    else gl[`uniform${value.length}fv`](place, value);
  }
}

// Textures {name: {size, each, base64}}, each bound to the unit of its number.
function bindTextures(gl, used, textures) {
  return Object.entries(textures).map(([name, texels], unit) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.uniform1i(gl.getUniformLocation(used, name), unit);
    return sampleTexture(gl, texels);
  });
}

// Makes the program of a scene {sources, uniforms, places, textures} the one that draws, and
// returns it with the textures.
function useTraced(gl, scene) {
  gl.disable(gl.BLEND);
  gl.disable(gl.DEPTH_TEST);
  const used = program(gl, scene.sources);
  gl.useProgram(used);
  setFloats(gl, used, scene.uniforms);
  for (const [name, value] of Object.entries(scene.places)) {
    gl.uniform2iv(gl.getUniformLocation(used, name), value);
  }
  return { used, textures: bindTextures(gl, used, scene.textures) };
}
