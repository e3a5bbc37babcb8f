"use strict";
// Moving bodies in WebGL 2. Facts come as JSON, arrays as one gzipped block of bytes; see scene.py for both.
(async () => {
  const $ = id => document.getElementById(id);
  const facts = JSON.parse($("facts").textContent);
  const letters = atob($("data").textContent.trim()), bytes = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);  // a callback each takes ten times as long
  const unpacked = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const block = await new Response(unpacked).arrayBuffer();
  $("data").textContent = "";
  const KINDS = { f4: Float32Array, i2: Int16Array, u4: Uint32Array, u1: Uint8Array };
  const array = ([kind, start, length]) => new KINDS[kind](block, start, length);
  const canvas = document.querySelector("canvas");
  const gl = canvas.getContext("webgl2", { antialias: true });
  if (!gl) {
    $("note").textContent = "This browser has no WebGL 2, which moving bodies need.";
    return;
  }

  // ---- What is shown --------------------------------------------------------------------------------------------
  const times = facts.t, last = times.length - 1, first = times[0], span = times[last] - first;
  const state = { time: facts.start, playing: false, speed: facts.speed, scale: facts.scale, colour: 0,
    end: facts.colours[0].end, cut: null, spot: null, turn: 0,
    stale: true };
  const [azimuth, elevation] = facts.view, home = () => ({ centre: [0, 0, 0], distance: 1.9 * facts.size, azimuth,
    elevation });
  let camera = home();

  // ---- Drawing on the graphics card -----------------------------------------------------------------------------
  const VERTEX = `#version 300 es
    in vec3 place, normal; in float level;
    uniform mat4 view, lens;
    out vec3 n, x, p; out float value;
    void main() {
      vec4 seen = view * vec4(place, 1.0);
      p = place; x = seen.xyz; n = mat3(view) * normal; value = level; gl_Position = lens * seen;
    }`;
  const PIXEL = `#version 300 es
    precision highp float;
    in vec3 n, x, p; in float value;
    uniform float end, faded; uniform vec4 plain, cut; uniform sampler2D colours;
    out vec4 colour;
    void main() {
      if (dot(cut.xyz, p) > cut.w) discard;
      if (cut.w < 1e30 && !gl_FrontFacing && plain.a < 1.0 && faded == 0.0) {  // the inside, as if it were full
        float line = step(0.5, fract((gl_FragCoord.x + gl_FragCoord.y) / 12.0));
        colour = vec4(vec3(0.62, 0.64, 0.67) - 0.07 * line, 1.0);
        return;
      }
      vec3 m = normalize(n); if (m.z < 0.0) m = -m;
      vec3 own = plain.a > 0.0 ? plain.rgb : texture(colours, vec2(clamp(value / end, 0.002, 0.998), 0.5)).rgb;
      vec3 light = normalize(vec3(0.35, 0.5, 0.8));
      float lit = 0.68 + 0.38 * max(dot(m, light), 0.0);
      float shine = pow(max(dot(reflect(normalize(x), m), light), 0.0), 24.0), rim = pow(1.0 - abs(m.z), 3.0);
      float seen = faded > 1.0 ? 0.3 : faded > 0.0 ? 0.10 + 0.45 * rim : 1.0;
      colour = vec4(own * lit * (1.0 - 0.25 * rim) + 0.06 * shine, 1.0) * seen;
    }`;
  const compiled = (type, text) => {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    return shader;
  };
  const program = gl.createProgram();
  gl.attachShader(program, compiled(gl.VERTEX_SHADER, VERTEX));
  gl.attachShader(program, compiled(gl.FRAGMENT_SHADER, PIXEL));
  ["place", "normal", "level"].forEach((name, i) => gl.bindAttribLocation(program, i, name));
  gl.linkProgram(program);
  gl.useProgram(program);
  gl.enable(gl.DEPTH_TEST);
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  const uniform = Object.fromEntries(
    ["view", "lens", "end", "plain", "cut", "faded"].map(n => [n, gl.getUniformLocation(program, n)]));
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  const pixels = new Uint8Array(facts.map.flatMap(([r, g, b]) => [r, g, b, 255]));
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, facts.map.length, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.LINEAR);
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
  const stops = facts.map.filter((_, i) => i % 8 == 0).map(c => `rgb(${c})`);
  $("bar").style.background = `linear-gradient(90deg, ${stops})`;

  /** Buffers of a surface: vertices v = {places, normals, levels}, triangles. */
  function buffers(surface) {
    surface.list = gl.createVertexArray();
    gl.bindVertexArray(surface.list);
    surface.buffers = [[surface.places, 3], [surface.normals, 3], [surface.levels, 1]].map(([values, width], i) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(i);
      gl.vertexAttribPointer(i, width, gl.FLOAT, false, 0, 0);
      return [buffer, values];
    });
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, surface.triangles, gl.STATIC_DRAW);
    return surface;
  }
  function upload(surface) {
    for (const [buffer, values] of surface.buffers) {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
    }
  }
  function setNormals({ places: x, normals: n, triangles }) {
    n.fill(0);
    for (let f = 0; f < triangles.length; f += 3) {
      const a = 3 * triangles[f], b = 3 * triangles[f + 1], c = 3 * triangles[f + 2];
      const ux = x[b] - x[a], uy = x[b + 1] - x[a + 1], uz = x[b + 2] - x[a + 2];
      const vx = x[c] - x[a], vy = x[c + 1] - x[a + 1], vz = x[c + 2] - x[a + 2];
      const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
      for (const at of [a, b, c]) { n[at] += nx; n[at + 1] += ny; n[at + 2] += nz; }
    }
  }

  // ---- Bodies: place + turn (points + sum of amplitudes and shapes) ------------------------------------------------
  const bodies = facts.bodies.map(given => {
    const body = { name: given.name, turns: given.turns, look: given.faded ? "faded" : "solid" };
    for (const key of ["points", "triangles", "nodes", "shapes", "amplitudes", "place", "turn"])
      body[key] = array(given[key]);
    body.colours = given.colours.map(array);
    body.count = body.points.length / 3;
    body.rank = body.amplitudes.length / times.length;
    body.local = new Float32Array(body.points.length);
    body.value = new Float32Array(body.count);
    body.places = new Float32Array(3 * body.nodes.length);
    body.normals = new Float32Array(3 * body.nodes.length);
    body.levels = new Float32Array(body.nodes.length);
    return buffers(body);
  });
  // Rigid surfaces, and Exudyn's own bodies: place + turn points; those that stay where they are have one frame.
  function rigid(given, more) {
    const surface = { name: given.name, look: given.faded ? "faded" : "solid", ...more };
    for (const key of ["points", "triangles", "place", "turn"]) surface[key] = array(given[key]);
    surface.nodes = Uint32Array.from({ length: surface.points.length / 3 }, (_, v) => v);
    surface.places = new Float32Array(surface.points.length);
    surface.normals = new Float32Array(surface.points.length);
    surface.levels = new Float32Array(surface.nodes.length);
    return buffers(surface);
  }
  const surfaces = facts.rigid.map(given =>
    rigid(given, { turns: true, plain: [0.6, 0.6, 0.63, given.name ? 0.5 : 1] }));
  // Signs may stretch, as springs do, so that their axes are no rotations.
  const signs = facts.signs.map(given => rigid(given, { turns: false, plain: [...given.colour, 1] }));

  const curves = facts.forces.map(({ name, curve }) => {
    const both = array(curve), every = k => both.filter((_, i) => i % 2 == k);
    return { name, t: every(0), f: every(1) };
  });

  const everything = [...surfaces, ...bodies];
  const looks = new Map(everything.map(surface => [surface, surface.look]));  // those of the first view

  /** Frames before and after a time, and the share of the later one. */
  function framesAt(time) {
    let before = 0, after = last;
    while (after - before > 1) {
      const middle = (before + after) >> 1;
      if (times[middle] <= time) before = middle; else after = middle;
    }
    const share = (time - times[before]) / (times[after] - times[before] || 1);
    return [before, after, Math.min(1, Math.max(0, share))];
  }
  /** A rotation between two, from the entries of both matrices; columns are made perpendicular again. */
  function turnBetween(body, i, j, share) {
    const m = [...Array(9).keys()].map(k => (1 - share) * body.turn[9 * i + k] + share * body.turn[9 * j + k]);
    if (!body.turns) return m;
    const column = k => [m[k], m[3 + k], m[6 + k]];
    const x = unit(column(0)), y0 = column(1), y = unit(y0.map((v, k) => v - dot(x, y0) * x[k])), z = cross(x, y);
    return [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]];
  }
  function move(body, [i, j, share]) {
    const { local, points, shapes, rank, count, nodes, levels, value } = body, own = body.colours[state.colour];
    local.set(points);
    for (let k = 0; k < rank; k++) {
      const a = body.amplitudes[i * rank + k], b = body.amplitudes[j * rank + k];
      const amplitude = ((1 - share) * a + share * b) * state.scale, at = 3 * count * k;
      if (amplitude) for (let e = 0; e < local.length; e++) local[e] += amplitude * shapes[at + e];
    }
    for (let v = 0; v < count; v++) {
      const root = ((1 - share) * own[i * count + v] + share * own[j * count + v]) / facts.levels;
      value[v] = root * root;
    }
    for (let v = 0; v < nodes.length; v++) levels[v] = value[nodes[v]];
    carry(body, local, [i, j, share]);
  }
  /** Places of vertices from those in the body's axes, and their normals. */
  function carry(body, local, [i, j, share]) {
    const { nodes, places } = body, R = turnBetween(body, i, j, share);
    const p = [0, 1, 2].map(k => (1 - share) * body.place[3 * i + k] + share * body.place[3 * j + k]);
    for (let v = 0; v < nodes.length; v++) {
      const e = 3 * nodes[v], a = local[e], b = local[e + 1], c = local[e + 2];
      places[3 * v] = R[0] * a + R[1] * b + R[2] * c + p[0];
      places[3 * v + 1] = R[3] * a + R[4] * b + R[5] * c + p[1];
      places[3 * v + 2] = R[6] * a + R[7] * b + R[8] * c + p[2];
    }
    setNormals(body);
    upload(body);
  }

  // ---- Camera -----------------------------------------------------------------------------------------------------
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = a => { const size = Math.hypot(...a) || 1; return a.map(v => v / size); };
  /** Directions to the right, upwards, and towards the viewer. */
  function axes() {
    const { azimuth, elevation } = camera, flat = Math.cos(elevation);
    const back = [flat * Math.cos(azimuth), flat * Math.sin(azimuth), Math.sin(elevation)];
    const right = [-Math.sin(azimuth), Math.cos(azimuth), 0];
    return [right, cross(back, right), back];
  }
  function lensAndView(width, height) {
    const [r, u, b] = axes(), near = 0.02 * camera.distance, far = camera.distance + 6 * facts.size;
    const aspect = width / height, zoom = Math.min(1, aspect / 0.7) / Math.tan(0.26);
    const eye = camera.centre.map((v, k) => v + camera.distance * b[k]);
    const lens = [zoom / aspect, 0, 0, 0, 0, zoom, 0, 0, 0, 0, -(far + near) / (far - near), -1, 0, 0,
      -2 * far * near / (far - near), 0];
    const view = [r[0], u[0], b[0], 0, r[1], u[1], b[1], 0, r[2], u[2], b[2], 0, -dot(r, eye), -dot(u, eye),
      -dot(b, eye), 1];
    return [lens, view];
  }
  /** Pixel of a place, and its distance from the viewer. */
  function project(x, y, z, [lens, view], width, height) {
    const a = view[0] * x + view[4] * y + view[8] * z + view[12];
    const b = view[1] * x + view[5] * y + view[9] * z + view[13];
    const c = view[2] * x + view[6] * y + view[10] * z + view[14];
    return [width * (1 + lens[0] * a / -c) / 2, height * (1 - lens[5] * b / -c) / 2, -c];
  }

  // ---- A frame ------------------------------------------------------------------------------------------------------
  const number = v => v === 0 ? "0" : Math.abs(v) >= 1e4 || Math.abs(v) < 1e-2 ? v.toExponential(1).replace("e+", "e")
    : String(+v.toPrecision(3));
  const force = v => Math.abs(v) >= 1e5 || (v && Math.abs(v) < 1e-2) ? v.toExponential(3).replace("e+", "e")
    : String(+v.toPrecision(4));
  /** Sum of the contacts' forces: each curve has the samples at which it is largest and least. */
  function forceAt(time) {
    return curves.reduce((sum, { t, f }) => {
      let before = 0, after = t.length - 1;
      while (after - before > 1) {
        const middle = (before + after) >> 1;
        if (t[middle] <= time) before = middle; else after = middle;
      }
      const share = Math.min(1, Math.max(0, (time - t[before]) / (t[after] - t[before] || 1)));
      return sum + (1 - share) * f[before] + share * f[after];
    }, 0);
  }
  const told = speed => `1 s = ${number(speed * facts.factor)} ${facts.unit}`;
  /** The impact that is going on and short, if any: it is played slowly. */
  const slowAt = time => $("slow").checked && facts.slow.find(([start, end]) => time >= start && time < end);
  function speedAt(time) {
    const slow = slowAt(time);
    return slow ? Math.min(state.speed, (slow[1] - slow[0]) / facts.slowSeconds) : state.speed;
  }
  function draw() {
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width != width || canvas.height != height) { canvas.width = width; canvas.height = height; }
    const frames = framesAt(state.time);
    bodies.forEach(body => move(body, frames));
    [...surfaces, ...signs].filter(surface => surface.place.length > 3 || !surface.stands).forEach(surface => {
      carry(surface, surface.points, surface.place.length > 3 ? frames : [0, 0, 0]);
      surface.stands = true;
    });
    gl.viewport(0, 0, width, height);
    gl.clearColor(...(matchMedia("(prefers-color-scheme: dark)").matches ? [0.13, 0.15, 0.18, 1] : [1, 1, 1, 1]));
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const [lens, view] = lensAndView(width, height);
    gl.uniformMatrix4fv(uniform.lens, false, lens);
    gl.uniformMatrix4fv(uniform.view, false, view);
    gl.uniform1f(uniform.end, state.end);
    gl.uniform4fv(uniform.cut, state.cut ? [0, 1, 2].map(k => k == state.cut.axis ? state.cut.side : 0)
      .concat(state.cut.side * state.cut.at) : [0, 0, 0, 1e31]);
    const show = (some, faded) => {
      gl.uniform1f(uniform.faded, faded);
      some.forEach(surface => {
        gl.uniform4fv(uniform.plain, surface.plain || [0, 0, 0, 0]);
        gl.bindVertexArray(surface.list);
        gl.drawElements(gl.TRIANGLES, surface.triangles.length, gl.UNSIGNED_INT, 0);
      });
    };
    show(everything.filter(surface => surface.look == "solid"), 0);
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    show(everything.filter(surface => surface.look == "faded"), 1);
    const drawn = $("signs").checked ? signs : [];
    gl.uniform4fv(uniform.cut, [0, 0, 0, 1e31]);
    gl.depthFunc(gl.GREATER);
    show(drawn, 2);  // what is within bodies shines through
    gl.depthFunc(gl.LESS);
    gl.disable(gl.BLEND);
    gl.depthMask(true);
    show(drawn, 0);
    const colour = facts.colours[state.colour], share = span ? (state.time - first) / span : 0;
    const now = curves.length ? `   force ${force(forceAt(state.time))} N` : "";
    $("time").textContent = `t = ${(state.time * facts.factor).toFixed(facts.digits)} ${facts.unit}${now}`;
    const slow = state.playing && slowAt(state.time);
    $("slowed").textContent = slow ? `slow motion, ${told(speedAt(state.time))}` : "";
    $("ends").children[0].textContent = "0";
    $("ends").children[1].textContent = (state.end < 0.999 ? "\u2265 " : "") + number(state.end * colour.largest);
    $("quantity").textContent = `${colour.name} [${colour.unit}]`;
    const scaled = `deformed \u00d7 ${number(state.scale)}: bodies may seem to overlap`;
    $("note").textContent = state.scale == 1 ? "" : scaled;
    $("slider").value = 1000 * share;
    $("slider").setAttribute("aria-valuetext", $("time").textContent);
    for (const end of ["x1", "x2"]) mark.setAttribute(end, 1000 * share);
    window.drawn = (window.drawn || 0) + 1;
  }

  // ---- Curve of the forces --------------------------------------------------------------------------------------------
  const svg = document.querySelector("#track svg");
  const line = (name, given) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(given)) element.setAttribute(key, value);
    element.setAttribute("vector-effect", "non-scaling-stroke");
    svg.append(element);
    return element;
  };
  const HEIGHT = 58, across = time => 1000 * (span ? (time - first) / span : 0);
  const largest = values => values.reduce((most, value) => Math.max(most, value), 0);
  const largestForce = largest(curves.map(({ f }) => largest(f)));
  const up = f => HEIGHT - 4 - (HEIGHT - 12) * f / (largestForce || 1);
  facts.slow.forEach(([start, end]) => line("rect", { x: across(start), width: Math.max(2, across(end) - across(start)),
    y: 0, height: HEIGHT, fill: "var(--accent)", opacity: 0.18, stroke: "none" }));
  curves.forEach(({ name, t, f }, k) => {
    const stroke = ["var(--accent)", "#d0691f", "#3f9a4a", "#a050a8"][k % 4];
    line("polyline", { points: [...t].map((time, i) => `${across(time).toFixed(2)},${up(f[i]).toFixed(1)}`).join(" "),
      fill: "none", stroke, "stroke-width": 1.6, "stroke-dasharray": ["", "6 3", "2 3"][Math.floor(k / 4) % 3] });
    const entry = document.createElement("span"), swatch = document.createElement("i");
    swatch.style.background = stroke;
    entry.append(swatch, `${name}: largest ${force(largest(f))} N`);
    $("curves").append(entry);
  });
  if (largestForce) {  // where the curve is highest, on the side that has room
    const { t, f } = curves.find(({ f }) => largest(f) == largestForce), at = across(t[f.indexOf(largestForce)]);
    $("peak").textContent = `${force(largestForce)} N`;
    const [end, share] = at < 800 ? ["left", at / 10] : ["right", 100 - at / 10];
    $("peak").style[end] = `calc(${share}% + 5px)`;
  }
  const shortTime = time => `${+(time * facts.factor).toPrecision(4)} ${facts.unit}`;
  [$("from").textContent, $("until").textContent] = [shortTime(first), shortTime(times[last])];
  $("slowly").hidden = !facts.slow.length;
  $("signed").hidden = !signs.length;
  $("signs").onchange = () => { state.stale = true; };
  const mark = line("line", { y1: 0, y2: HEIGHT, stroke: "var(--fore)", "stroke-width": 1 });

  // ---- Controls -------------------------------------------------------------------------------------------------------
  document.querySelector("#said b").textContent = facts.title;
  facts.speeds.forEach(speed => {
    const option = new Option(told(speed), speed);
    option.selected = speed == state.speed;
    $("speed").append(option);
  });
  facts.colours.forEach((colour, i) => $("colour").append(new Option(colour.name, i)));
  $("scale").max = Math.log10(facts.largestScale);
  function showSettings() {
    $("end").value = Math.log10(state.end);
    $("end").nextElementSibling.textContent = number(state.end * facts.colours[state.colour].largest);
    $("scale").value = Math.log10(state.scale);
    $("scale").nextElementSibling.textContent = number(state.scale);
    state.stale = true;
  }
  function setTime(time) {
    state.time = Math.min(times[last], Math.max(first, time));
    state.stale = true;
  }
  function play(on) {
    state.playing = on;
    $("play").textContent = on ? "Pause" : "Play";
    $("play").setAttribute("aria-pressed", on);
    if (on && state.time >= times[last]) setTime(first);
    before = 0;
  }
  $("speed").onchange = event => { state.speed = +event.target.value; };
  $("colour").onchange = event => {
    state.colour = +event.target.value;
    state.end = state.spot === null ? facts.colours[state.colour].end : 1;
    showSettings();
  };
  $("end").oninput = event => { state.end = 10 ** event.target.value; showSettings(); };
  $("scale").oninput = event => {
    state.scale = 10 ** event.target.value;
    if (Math.abs(state.scale - 1) < 0.03) state.scale = 1;
    showSettings();
  };
  $("play").onclick = () => play(!state.playing);
  $("slider").oninput = event => setTime(first + span * event.target.value / 1000);
  // Boxes have three states: a body is solid, faded, so that one looks through it, or hidden.
  const NEXT = { solid: "faded", faded: "hidden", hidden: "solid" };
  const named = [...bodies, ...surfaces.filter(surface => surface.name)];
  named.forEach(body => {
    const label = document.createElement("label");
    body.box = document.createElement("input");
    body.box.type = "checkbox";
    body.box.onchange = () => setLook(body, NEXT[body.look]);
    label.append(body.box, body.name);
    label.title = "solid, see-through or hidden";
    $("bodies").append(label);
  });
  function setLook(body, look) {
    body.look = look;
    if (body.box) {
      body.box.checked = look != "hidden";
      body.box.indeterminate = look == "faded";
      body.box.setAttribute("aria-label", `${body.name}: ${look}`);
    }
    state.stale = true;
  }
  const asAtFirst = () => looks.forEach((look, surface) => setLook(surface, look));
  asAtFirst();
  const quarter = Math.PI / 2;
  function whole(azimuth, elevation) {
    asAtFirst();
    camera = { ...home(), azimuth, elevation };
    state.spot = null;
    [state.scale, state.end] = [facts.scale, facts.colours[state.colour].end];
    showSettings();
  }
  /** Sides of a contact, 0 slave and 1 master, whose bodies are shown. */
  const sidesOf = spot => spot.bodies.map((body, side) => body < 0 ? -1 : side).filter(side => side >= 0);
  /** Looks at the side of a body that a contact presses, at its peak, with all else faded; then at the other's. */
  function lookAt(spot, i) {
    const sides = sidesOf(spot), turn = state.spot == i ? (state.turn + 1) % (sides.length || 1) : 0;
    const side = sides[turn] ?? 0, body = bodies[spot.bodies[side]];
    [state.spot, state.turn] = [i, turn];
    everything.forEach(surface => setLook(surface, surface == body || !body ? "solid" : "faded"));
    const out = spot.push.map(v => side ? v : -v);  // from the body, where the other one is
    const [, , back] = axes(), along = dot(back, out), flat = back.map((v, k) => v - along * out[k]);
    const aside = Math.hypot(...flat) > 0.05 ? unit(flat) : unit(cross(out, [0.3, 0.9, 0.3]));
    const eye = out.map((v, k) => 0.8 * v + 0.6 * aside[k]);
    camera = { centre: [...spot.place], azimuth: Math.atan2(eye[1], eye[0]),
      elevation: Math.asin(Math.max(-1, Math.min(1, eye[2]))),
      distance: Math.max(0.02 * facts.size, Math.min(0.6 * facts.size, 22 * spot.reach)) };
    [state.scale, state.end] = [1, 1];  // colours to the largest value, which is here
    showSettings();
    if (!state.playing) setTime(spot.time);
  }
  const button = (name, title, pressed) => {
    const element = document.createElement("button");
    Object.assign(element, { textContent: name, title, onclick: pressed });
    $("views").append(element);
  };
  button("all", "everything, from the first view", () => whole(...facts.view));
  if (facts.spots.length > 4) {
    const choice = document.createElement("select");
    choice.setAttribute("aria-label", "contact to look at");
    choice.append(new Option("contact ...", ""), ...facts.spots.map((spot, i) => new Option(spot.name, i)));
    choice.onchange = () => { lookAt(facts.spots[choice.value], +choice.value); choice.value = ""; };
    $("views").append(choice);
  } else facts.spots.forEach((spot, i) => button(spot.name,
    "where it presses, at its peak" + (sidesOf(spot).length > 1 ? "; once more: the other body" : ""),
    () => lookAt(spot, i)));
  for (const [name, azimuth, elevation] of [["front", -quarter, 0], ["side", 0, 0], ["top", -quarter, quarter]])
    button(name, `everything, from ${name == "front" ? "the front" : `the ${name}`}`, () => whole(azimuth, elevation));
  /** A plane that cuts off what is before it; it faces the viewer when it is chosen, and is dragged by the slider. */
  $("cut").onchange = event => {
    const axis = ["x", "y", "z"].indexOf(event.target.value);
    state.cut = axis < 0 ? null : { axis, side: axes()[2][axis] < 0 ? -1 : 1, at: 0 };
    $("place").style.visibility = state.cut ? "visible" : "hidden";
    if (state.cut) Object.assign($("place"), { min: -facts.half[axis], max: facts.half[axis], value: 0 });
    state.stale = true;
  };
  $("place").oninput = event => { state.cut.at = +event.target.value; state.stale = true; };

  // ---- Pointer and keys -------------------------------------------------------------------------------------------------
  const fingers = new Map();
  function shift(dx, dy) {
    const [right, up] = axes(), size = camera.distance * 0.53 / canvas.clientHeight;
    camera.centre = camera.centre.map((v, k) => v - size * (dx * right[k] - dy * up[k]));
  }
  canvas.onpointerdown = event => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY, button: event.button });
  };
  canvas.onpointerup = canvas.onpointercancel = event => fingers.delete(event.pointerId);
  canvas.oncontextmenu = event => event.preventDefault();
  canvas.onpointerleave = () => { $("value").style.display = "none"; };
  canvas.onpointermove = event => {
    const finger = fingers.get(event.pointerId);
    if (!finger) { showValue(event); return; }
    const dx = event.clientX - finger.x, dy = event.clientY - finger.y;
    if (fingers.size == 2) {
      const other = [...fingers].find(([id]) => id != event.pointerId)[1];
      const apart = Math.hypot(event.clientX - other.x, event.clientY - other.y);
      if (apart > 5) camera.distance *= Math.hypot(finger.x - other.x, finger.y - other.y) / apart;
      shift(dx / 2, dy / 2);
    } else if (finger.button == 2 || event.shiftKey) {
      shift(dx, dy);
    } else {
      camera.azimuth -= 0.008 * dx;
      camera.elevation = Math.max(-quarter, Math.min(quarter, camera.elevation + 0.008 * dy));
    }
    Object.assign(finger, { x: event.clientX, y: event.clientY });
    state.stale = true;
  };
  canvas.addEventListener("wheel", event => {
    event.preventDefault();
    camera.distance *= Math.exp(0.0012 * event.deltaY);
    state.stale = true;
  }, { passive: false });
  function pixel(surface, vertex) {
    const width = canvas.clientWidth, height = canvas.clientHeight, p = surface.places.slice(3 * vertex);
    return project(p[0], p[1], p[2], lensAndView(width, height), width, height);
  }
  /** The vertex nearest to the pointer, of those the one in front. */
  function nearest(px, py) {
    const width = canvas.clientWidth, height = canvas.clientHeight, matrices = lensAndView(width, height);
    let best = null;
    for (const body of [...bodies.filter(body => body.look == "solid"), ...($("signs").checked ? signs : [])]) {
      for (let v = 0; v < body.nodes.length; v++) {
        const [x, y, depth] = project(body.places[3 * v], body.places[3 * v + 1], body.places[3 * v + 2], matrices,
          width, height);
        const away = Math.hypot(x - px, y - py);
        if (away > 14 || depth < 0) continue;
        const shines = signs.includes(body) && away < 6;  // through bodies
        const cost = depth / camera.distance + 0.004 * away - (shines ? 10 : 0);
        if (!best || cost < best.cost) best = { cost, body, vertex: v, x, y };
      }
    }
    return best;
  }
  function showValue(event) {
    const frame = canvas.getBoundingClientRect(), tip = $("value");
    const found = nearest(event.clientX - frame.left, event.clientY - frame.top);
    tip.style.display = found ? "block" : "none";
    if (!found) return;
    const colour = facts.colours[state.colour];
    const value = `: ${number(found.body.levels[found.vertex] * colour.largest)} ${colour.unit}`;
    tip.textContent = found.body.name + (bodies.includes(found.body) ? value : "");
    tip.style.left = `${Math.min(found.x + 12, frame.width - tip.offsetWidth - 4)}px`;
    tip.style.top = `${Math.max(4, found.y - 30)}px`;
  }
  addEventListener("keydown", event => {
    if (["INPUT", "SELECT"].includes(event.target.tagName) && event.key != " ") return;
    if (event.key == " " && event.target.tagName != "BUTTON") { event.preventDefault(); play(!state.playing); }
    else if (event.key == "ArrowRight") setTime(times.find(time => time > state.time) ?? times[last]);
    else if (event.key == "ArrowLeft") setTime(times.findLast(time => time < state.time) ?? first);
    else if (event.key == "+" || event.key == "-") { camera.distance *= event.key == "+" ? 0.85 : 1.18; state.stale = true; }
  });
  matchMedia("(prefers-color-scheme: dark)").onchange = () => { state.stale = true; };
  new ResizeObserver(() => { state.stale = true; }).observe(canvas);

  // ---- Time goes on -------------------------------------------------------------------------------------------------------
  let before = 0;
  function loop(now) {
    if (state.playing) {
      let next = state.time + (before ? speedAt(state.time) * (now - before) / 1000 : 0);
      const begun = facts.slow.find(([start]) => start > state.time && start < next);
      if (begun && $("slow").checked) next = begun[0];  // not beyond an impact that is to be played slowly
      setTime(next > times[last] ? first : next);
      before = now;
    }
    if (state.stale) { state.stale = false; draw(); }
    requestAnimationFrame(loop);
  }
  showSettings();
  draw();
  requestAnimationFrame(loop);
  window.scene = { bodies, surfaces, signs, times, state, set(time) { setTime(time); draw(); },
    eye: () => axes()[2].map((v, k) => camera.centre[k] + camera.distance * v), pixel,
    project: (body, vertex) => pixel(bodies[body], vertex) };
  window.ready = true;
})().catch(error => {
  document.getElementById("note").textContent = `The moving bodies failed: ${error}`;
  throw error;
});
