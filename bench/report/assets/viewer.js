"use strict";
// Turns clouds, beside images of the same object at the nearest of its views. What is shown is JSON in the page
// (bench.report.look), the camera that of data_prep.rendering.camera: angles in degrees, distances in unit-sphere radii.
(() => {
  const DISTANCE = 4; // from the camera to the centre
  const FOCAL = 58 / 16; // a 58 mm lens before a sensor of twice 16 mm
  const STEP = 5; // degrees that an arrow key turns
  const VERTEX = `
    attribute vec3 point;
    attribute vec3 colour;
    uniform mat3 camera; // its columns are the camera's axes: right, up, backwards
    uniform float scale, dot_px, grey;
    varying vec3 shade;
    void main() {
      vec3 seen = point * scale * camera;
      float depth = ${DISTANCE.toFixed(1)} - seen.z;
      gl_Position = vec4(${FOCAL} * seen.xy, (depth - ${DISTANCE.toFixed(1)}) / 2.0 * depth, depth);
      gl_PointSize = max(dot_px * ${DISTANCE.toFixed(1)} / depth, 1.5);
      float near = clamp((seen.z + 1.0) / 2.0, 0.0, 1.0);
      shade = mix(colour, vec3(mix(0.745, 0.078, near)), grey); // the greys of data_prep.rendering.dots
    }`;
  const FRAGMENT = `
    precision mediump float;
    varying vec3 shade;
    void main() {
      if (length(gl_PointCoord - 0.5) > 0.5) discard;
      gl_FragColor = vec4(shade, 1.0);
    }`;

  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

  // Returns the camera's axes, one after the other, and the direction to the camera, which is the last of them.
  const axes = ([azimuth, elevation]) => {
    const [a, e] = [(azimuth * Math.PI) / 180, (elevation * Math.PI) / 180];
    const [sin, cos, up, level] = [Math.sin(a), Math.cos(a), Math.sin(e), Math.cos(e)];
    return [-cos, 0, -sin, -sin * up, level, cos * up, sin * level, up, -cos * level];
  };

  // Returns a function that draws a cloud from a direction; null in a browser without WebGL.
  const painter = (canvas) => {
    const gl = canvas.getContext("webgl", { preserveDrawingBuffer: true }); // so that it can be printed
    if (!gl) return null;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    gl.useProgram(program);
    gl.enable(gl.DEPTH_TEST);
    gl.clearColor(1, 1, 1, 1); // as the images are, on dark pages, too
    const uniform = (name) => gl.getUniformLocation(program, name);
    const upload = (name, data, type) => {
      const place = gl.getAttribLocation(program, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, 3, type, true, 0, 0);
    };
    let loaded = null;
    let count = 0;
    return (cloud, direction) => {
      if (cloud !== loaded) {
        const points = cloud ? bytes(cloud.points) : new Uint8Array(0);
        count = points.length / 6; // three numbers of 16 bits
        upload("point", points, gl.SHORT);
        upload("colour", cloud?.colours ? bytes(cloud.colours) : new Uint8Array(3 * count), gl.UNSIGNED_BYTE);
        loaded = cloud;
      }
      const side = canvas.clientWidth * devicePixelRatio;
      if (canvas.width !== Math.round(side)) canvas.width = canvas.height = Math.round(side);
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.uniformMatrix3fv(uniform("camera"), false, axes(direction));
      gl.uniform1f(uniform("scale"), cloud ? cloud.scale : 1);
      // A pixel of an image of 128 for 2,048 points, and less for more: dots hide each other less.
      gl.uniform1f(uniform("dot_px"), (1.3 * canvas.width * Math.min(1, Math.sqrt(2048 / count))) / 128);
      gl.uniform1f(uniform("grey"), cloud?.colours ? 0 : 1);
      if (count) gl.drawArrays(gl.POINTS, 0, count);
    };
  };

  const look = (section) => {
    const { objects, conditions, methods } = JSON.parse(section.querySelector("script").textContent);
    const part = (name) => section.querySelector(`.look-${name}`);
    const [canvas, view, share] = [part("cloud"), part("view"), part("share")];
    const choices = { object: objects.map((one) => one.name), condition: conditions, method: methods };
    for (const [name, entries] of Object.entries(choices)) {
      part(name).append(...entries.map((entry) => new Option(entry)));
      part(name).closest("label").hidden = entries.length < 2;
      part(name).addEventListener("change", () => show());
    }
    section.hidden = false;
    const paint = painter(canvas);
    part("without").hidden = paint !== null;
    canvas.hidden = paint === null;
    let direction = objects[0].views[0] || [30, 20];

    const chosen = () => objects[part("object").selectedIndex];
    const nearest = (views) => {
      const to = axes(direction).slice(6);
      const near = views.map((one) => axes(one).slice(6).reduce((sum, value, i) => sum + value * to[i], 0));
      return near.indexOf(Math.max(...near));
    };
    const show = () => {
      const [object, condition, method] = [chosen(), part("condition").value, part("method").value];
      const cloud = object.clouds[condition];
      if (paint) paint(cloud, direction);
      part("lacking").hidden = !paint || Boolean(cloud);
      part("images").hidden = !object.views.length;
      if (!object.views.length) return;
      const number = nearest(object.views);
      [view.max, view.value] = [object.views.length - 1, number];
      const [azimuth, elevation] = object.views[number].map((angle) => `${Math.round(angle)}°`);
      const words = `View ${number}: azimuth ${azimuth}, elevation ${elevation}`;
      part("words").textContent = words;
      view.setAttribute("aria-valuetext", words);
      const strips = { truth: object.truth, drawn: (object.images[condition] || {})[method] };
      for (const [name, strip] of Object.entries(strips)) {
        const image = part(name);
        image.hidden = !strip;
        if (!strip) continue;
        if (image.getAttribute("src") !== strip) image.src = strip;
        image.alt = `${name === "truth" ? "the truth" : method}, ${object.name}, view ${number}`;
        image.style.objectPosition = `0 ${(100 * number) / Math.max(1, object.views.length - 1)}%`;
      }
      part("missing").hidden = Boolean(strips.drawn);
    };
    const turn = (azimuth, elevation) => {
      direction = [direction[0] + azimuth, Math.max(-90, Math.min(90, direction[1] + elevation))];
      show();
    };

    const turns = { ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, -STEP], ArrowDown: [0, STEP] };
    canvas.addEventListener("keydown", (event) => {
      if (!turns[event.key] || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      turn(...turns[event.key]);
    });
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (!canvas.hasPointerCapture(event.pointerId)) return;
      const half_turn = 180 / canvas.clientWidth; // a width is half a turn
      turn(event.movementX * half_turn, event.movementY * half_turn);
    });
    view.addEventListener("input", () => {
      direction = chosen().views[view.value];
      show();
    });
    new ResizeObserver(show).observe(canvas);
    if (!paint) show();
  };

  // A slider over two images in one frame: left of it the one beneath is seen, right of it the other.
  document.addEventListener("input", ({ target }) => {
    if (!target.matches(".share")) return;
    const over = target.closest(".before-after").querySelector(".over");
    over.style.clipPath = `inset(0 0 0 ${target.value}%)`;
  });
  for (const section of document.querySelectorAll(".look")) look(section);
})();
