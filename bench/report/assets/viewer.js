"use strict";
// Turns clouds, beside images of the same object at the nearest of its views. What is shown is JSON in the page
// (bench.report.look); the camera is that of data_prep.rendering.camera, its angles are in degrees.
(() => {
  const VERTEX = `
    attribute vec3 point, colour;
    uniform mat3 camera; // its columns are the camera's axes: right, up, backwards
    uniform float scale, dot_px, grey;
    varying vec3 shade;
    void main() {
      vec3 seen = point * scale * camera;
      float depth = 4.0 - seen.z; // the camera's distance from the centre, in radii of the unit sphere
      gl_Position = vec4(58.0 / 16.0 * seen.xy, (depth - 4.0) / 2.0 * depth, depth); // 58 mm, a sensor of 32 mm
      gl_PointSize = max(dot_px * 4.0 / depth, 1.5);
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

  // Returns the camera's axes, one after the other; the last of them is the direction to the camera.
  const axes = (direction) => {
    const [a, e] = direction.map((degrees) => (degrees * Math.PI) / 180); // azimuth, elevation
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
        const points = bytes(cloud.points);
        count = points.length / 6; // three numbers of 16 bits
        upload("point", points, gl.SHORT);
        upload("colour", cloud.colours ? bytes(cloud.colours) : new Uint8Array(3 * count), gl.UNSIGNED_BYTE);
        loaded = cloud;
      }
      canvas.width = canvas.height = canvas.clientWidth * devicePixelRatio;
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.uniformMatrix3fv(uniform("camera"), false, axes(direction));
      gl.uniform1f(uniform("scale"), cloud.scale);
      // About a pixel of an image of 128 for 2,048 points, less for more: dots hide each other less.
      gl.uniform1f(uniform("dot_px"), (canvas.width / 100) * Math.min(1, Math.sqrt(2048 / count)));
      gl.uniform1f(uniform("grey"), cloud.colours ? 0 : 1);
      gl.drawArrays(gl.POINTS, 0, count);
    };
  };

  const look = (section) => {
    const { objects, conditions, methods } = JSON.parse(section.querySelector("script").textContent);
    const part = (name) => section.querySelector(`.look-${name}`);
    const [canvas, view, truth, drawn] = [part("cloud"), part("view"), new Image(), new Image()];
    drawn.className = "over";
    part("frame").append(truth, drawn);
    const choices = { object: objects.map((one) => one.name), condition: conditions, method: methods };
    for (const [name, entries] of Object.entries(choices)) {
      part(name).append(...entries.map((entry) => new Option(entry)));
      part(name).closest("label").hidden = entries.length < 2;
      part(name).addEventListener("change", () => show());
    }
    section.hidden = false;
    const paint = painter(canvas);
    let direction = objects[0].views[0] || [30, 20];

    const nearest = (views) => {
      const to = axes(direction).slice(6);
      const near = views.map((one) => axes(one).slice(6).reduce((sum, value, i) => sum + value * to[i], 0));
      return near.indexOf(Math.max(...near));
    };
    const show = () => {
      const object = objects[part("object").selectedIndex];
      const [condition, method] = [part("condition").value, part("method").value];
      const cloud = object.clouds[condition];
      canvas.hidden = !paint || !cloud;
      if (!canvas.hidden) paint(cloud, direction);
      const without = paint ? "The page has no cloud at this condition." : "This browser has no WebGL to show the cloud.";
      part("note").textContent = canvas.hidden ? without : "";
      const views = object.views;
      part("images").hidden = !views.length;
      if (!views.length) return;
      const number = nearest(views);
      [view.max, view.value] = [views.length - 1, number];
      const [azimuth, elevation] = views[number].map(Math.round);
      part("words").textContent = `View ${number}: azimuth ${azimuth}°, elevation ${elevation}°`;
      view.setAttribute("aria-valuetext", part("words").textContent);
      const strips = [[truth, "the truth", object.truth], [drawn, method, object.images[condition]?.[method]]];
      for (const [image, name, strip] of strips) {
        image.hidden = !strip;
        if (strip && image.getAttribute("src") !== strip) image.src = strip; // all views, one below the other
        image.alt = `${name}, ${object.name}, view ${number}`;
        image.style.objectPosition = `0 ${(100 * number) / Math.max(1, views.length - 1)}%`;
      }
    };
    const turn = (azimuth, elevation) => {
      direction = [direction[0] + azimuth, Math.max(-90, Math.min(90, direction[1] + elevation))];
      show();
    };

    const turns = { ArrowLeft: [-5, 0], ArrowRight: [5, 0], ArrowUp: [0, -5], ArrowDown: [0, 5] };
    canvas.addEventListener("keydown", (event) => {
      if (!turns[event.key]) return;
      event.preventDefault();
      turn(...turns[event.key]);
    });
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const by = 180 / canvas.clientWidth; // the width of the cloud is half a turn
      if (canvas.hasPointerCapture(event.pointerId)) turn(event.movementX * by, event.movementY * by);
    });
    view.addEventListener("input", () => {
      direction = objects[part("object").selectedIndex].views[view.value];
      show();
    });
    new ResizeObserver(show).observe(section);
  };

  // A slider over two images in one frame: left of it the one beneath is seen, right of it the other.
  document.addEventListener("input", ({ target }) => {
    if (!target.matches(".share")) return;
    const over = target.closest(".before-after").querySelector(".over");
    over.style.clipPath = `inset(0 0 0 ${target.value}%)`;
  });
  document.querySelectorAll(".look").forEach(look);
})();
