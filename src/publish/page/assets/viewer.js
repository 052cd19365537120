// The mesh that turns. Drag, pinch or use the keys; the colours are those of the pictures, the nodal line is where the function is 0.
(() => {
  "use strict";
  const canvas = document.getElementById("mesh");
  if (!canvas) return;
  const note = document.getElementById("note");
  const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) {
    note.textContent = "This browser has no WebGL 2; the pictures below show the same.";
    canvas.remove();
    return;
  }
  const bytes = (id) => {
    const text = atob(document.getElementById(id).textContent.trim());
    const array = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) array[i] = text.charCodeAt(i);
    return array.buffer;
  };
  const about = JSON.parse(document.getElementById("about").textContent);
  const positions = new Float32Array(bytes("positions"));
  const faces = new Uint32Array(bytes("faces"));
  const functions = new Int16Array(bytes("functions"));
  const colours = new Uint8Array(bytes("colours"));
  const n = positions.length / 3;

  const normals = new Float32Array(positions.length);
  for (let f = 0; f < faces.length; f += 3) {
    const [a, b, c] = [faces[f] * 3, faces[f + 1] * 3, faces[f + 2] * 3];
    const u = [0, 1, 2].map((i) => positions[b + i] - positions[a + i]);
    const v = [0, 1, 2].map((i) => positions[c + i] - positions[a + i]);
    const w = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    for (const corner of [a, b, c]) for (let i = 0; i < 3; i++) normals[corner + i] += w[i];
  }

  const vertex = `#version 300 es
    in vec3 position; in vec3 normal; in float value;
    uniform mat3 turn; uniform vec2 scale;
    out vec3 n; out float v;
    void main() {
      vec3 p = turn * position;
      n = turn * normal; v = value;
      gl_Position = vec4(p.xy * scale, -p.z * 0.4, 1.0);
    }`;
  const fragment = `#version 300 es
    precision highp float;
    in vec3 n; in float v;
    uniform sampler2D colours; uniform float lit;
    out vec4 colour;
    void main() {
      vec3 c = texture(colours, vec2(0.5 + 0.5 * clamp(v, -1.0, 1.0), 0.5)).rgb;
      float light = mix(1.0, 0.55 + 0.45 * abs(normalize(n).z), lit);
      float width = max(fwidth(v), 1e-6);
      float line = 1.0 - smoothstep(0.6 * width, 1.6 * width, abs(v));
      colour = vec4(mix(c * light, vec3(0.07), line), 1.0);
    }`;
  const program = twgl.createProgramInfo(gl, [vertex, fragment]);
  const buffers = twgl.createBufferInfoFromArrays(gl, {
    position: { numComponents: 3, data: positions },
    normal: { numComponents: 3, data: normals },
    value: { numComponents: 1, data: new Float32Array(n), drawType: gl.DYNAMIC_DRAW },
    indices: { numComponents: 3, data: faces },
  });
  const texture = twgl.createTexture(gl, {
    src: colours, width: 256, height: 1, format: gl.RGBA, min: gl.LINEAR, mag: gl.LINEAR, wrap: gl.CLAMP_TO_EDGE,
  });

  const identity = about.view.slice();
  let turn = identity.slice();
  let zoom = 1;
  let shown = 0;
  let asked = false;

  // Row i of `about.view` is the i-th axis of the picture in space.
  const times = (a, b) => {
    const c = new Array(9);
    for (let i = 0; i < 3; i++)
      for (let j = 0; j < 3; j++)
        c[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
    return c;
  };
  const rotate = (dx, dy) => {
    const [cx, sx, cy, sy] = [Math.cos(dx), Math.sin(dx), Math.cos(dy), Math.sin(dy)];
    turn = times([1, 0, 0, 0, cy, -sy, 0, sy, cy], times([cx, 0, sx, 0, 1, 0, -sx, 0, cx], turn));
    draw();
  };
  const drawNow = () => {
    asked = false;
    twgl.resizeCanvasToDisplaySize(canvas, Math.min(window.devicePixelRatio || 1, 2));
    const { width, height } = canvas;
    const size = 0.94 * zoom * Math.min(width, height);
    gl.viewport(0, 0, width, height);
    gl.enable(gl.DEPTH_TEST);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(program.program);
    twgl.setBuffersAndAttributes(gl, program, buffers);
    twgl.setUniforms(program, {
      // Columns first.
      turn: [turn[0], turn[3], turn[6], turn[1], turn[4], turn[7], turn[2], turn[5], turn[8]],
      scale: [size / width, size / height],
      colours: texture,
      lit: about.lit ? 1 : 0,
    });
    twgl.drawBufferInfo(gl, buffers);
  };
  // However often it is asked for, once a frame.
  const draw = () => {
    if (!asked) requestAnimationFrame(drawNow);
    asked = true;
  };
  const buttons = [...document.querySelectorAll("[data-function]")];
  const show = (index) => {
    shown = (index + about.places.length) % about.places.length;
    const values = new Float32Array(n);
    for (let i = 0; i < n; i++) values[i] = functions[shown * n + i] / 32767;
    twgl.setAttribInfoBufferFromArray(gl, buffers.attribs.value, values);
    buttons.forEach((button, i) => button.setAttribute("aria-pressed", String(i === shown)));
    const label = `φ${about.places[shown]}, λ = ${about.lambdas[shown]}`;
    canvas.setAttribute("aria-label", `${label}: a mesh that turns with the arrow keys`);
    document.getElementById("shown").textContent = label;
    draw();
  };
  buttons.forEach((button, i) => button.addEventListener("click", () => show(i)));

  const pointers = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
      const far = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
      zoom = Math.min(20, Math.max(0.2, (zoom * far(now)) / far(before)));
      draw();
    } else {
      const reach = canvas.clientHeight || 1;
      rotate((3 * (now[0] - before[0])) / reach, (3 * (now[1] - before[1])) / reach);
    }
    pointers.set(event.pointerId, now);
  });
  for (const end of ["pointerup", "pointercancel"])
    canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    if (document.activeElement !== canvas) return;
    event.preventDefault();
    zoom = Math.min(20, Math.max(0.2, zoom * Math.exp(-event.deltaY / 600)));
    draw();
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const step = 0.15;
    const keys = {
      ArrowLeft: () => rotate(-step, 0), ArrowRight: () => rotate(step, 0),
      ArrowUp: () => rotate(0, -step), ArrowDown: () => rotate(0, step),
      "+": () => { zoom = Math.min(20, zoom * 1.2); draw(); },
      "-": () => { zoom = Math.max(0.2, zoom / 1.2); draw(); },
      n: () => show(shown + 1), p: () => show(shown - 1),
      0: () => { turn = identity.slice(); zoom = 1; draw(); },
    };
    const act = keys[event.key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    act();
  });
  // Before the new size is painted: in the old one the mesh would be stretched.
  new ResizeObserver(drawNow).observe(canvas);
  show(0);
})();
