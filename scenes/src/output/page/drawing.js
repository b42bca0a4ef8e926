// The triangles on the graphics processor, their colours, and which element a pixel shows.

/** By how many pixels elements grow, so that no gaps show where neighbours are cut otherwise. */
const GROWTH = 0.5;

class Drawing {
  /** What is needed to draw the triangles of a scene on a canvas. */
  constructor(canvas, scene, mesh) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: false });
    if (!gl) throw new Error("This browser has no WebGL 2, which the scene takes to be shown.");
    this.gl = gl;
    this.canvas = canvas;
    this.mesh = mesh;
    this.burn = scene.burn;
    this.none = scene.sizes.length;
    this.colours = this.program("colour-shader");
    this.numbers = this.program("number-shader");
    this.values = gl.createBuffer();
    this.arrays = gl.createVertexArray();
    gl.bindVertexArray(this.arrays);
    this.attribute(0, mesh.positions, 3, gl.FLOAT);
    this.attribute(2, mesh.edges, 4, gl.UNSIGNED_BYTE);
    this.attribute(3, mesh.elements, 1, gl.UNSIGNED_INT);
    this.attribute(4, mesh.middles, 3, gl.FLOAT);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.values);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 3, gl.FLOAT, false, 0, 0);
    this.palette(scene.palette);
    this.target = this.onePixel();
    gl.enable(gl.DEPTH_TEST);
    // Walls are seen from within only: one looks through their backs.
    gl.enable(gl.CULL_FACE);
  }

  /** The program of the vertex shader and another one, with its uniforms by name. */
  program(fragment) {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, id] of [[gl.VERTEX_SHADER, "vertex-shader"], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, document.getElementById(id).textContent.trim());
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) {
        throw new Error(`${id}: ${gl.getShaderInfoLog(shader)}`);
      }
      gl.attachShader(program, shader);
    }
    ["a_position", "a_value", "a_edges", "a_element", "a_middle"].forEach((name, place) => {
      gl.bindAttribLocation(program, place, name);
    });
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
      throw new Error(`${fragment}: ${gl.getProgramInfoLog(program)}`);
    }
    const uniforms = {};
    for (let k = 0; k < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); k++) {
      const { name } = gl.getActiveUniform(program, k);
      uniforms[name] = gl.getUniformLocation(program, name);
    }
    return { program, uniforms };
  }

  /** Numbers of every corner that never change. */
  attribute(place, array, size, kind) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, array, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(place);
    if (kind === gl.UNSIGNED_INT) gl.vertexAttribIPointer(place, size, kind, 0, 0);
    else gl.vertexAttribPointer(place, size, kind, kind === gl.UNSIGNED_BYTE, 0, 0);
  }

  /** The colours of a scale, from its lower end to its upper one, as a picture of one row. */
  palette(codes) {
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    const size = codes.length / 3;
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, size, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, codes);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  }

  /** A picture of one pixel, in which the number of an element is drawn. */
  onePixel() {
    const { gl } = this;
    const target = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    for (const [place, format] of [
      [gl.COLOR_ATTACHMENT0, gl.RGBA8],
      [gl.DEPTH_ATTACHMENT, gl.DEPTH_COMPONENT24],
    ]) {
      const buffer = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.renderbufferStorage(gl.RENDERBUFFER, format, 1, 1);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, buffer);
    }
    return target;
  }

  /** Takes three numbers for every corner, as `valuesAt` makes them. */
  show(values) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.values);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
  }

  /** Draws what a camera sees. */
  draw(camera, { isLight, exposure, range, lines, picked, ground }) {
    const { gl, canvas } = this;
    const scale = window.devicePixelRatio || 1;
    const size = [canvas.clientWidth, canvas.clientHeight].map((x) => Math.max(1, Math.round(scale * x)));
    if (canvas.width !== size[0]) canvas.width = size[0];
    if (canvas.height !== size[1]) canvas.height = size[1];
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, ...size);
    gl.clearColor(...ground, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const { program, uniforms } = this.colours;
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.u_view, false, camera.matrix(...size));
    gl.uniform1i(uniforms.u_is_light, isLight ? 1 : 0);
    gl.uniform1f(uniforms.u_exposure, exposure);
    gl.uniform1f(uniforms.u_burn, this.burn);
    gl.uniform2f(uniforms.u_range, ...range);
    gl.uniform1i(uniforms.u_lines, lines ? 1 : 0);
    gl.uniform1ui(uniforms.u_picked, picked ?? this.none);
    gl.uniform2f(uniforms.u_growth, 0, 0);
    gl.drawArrays(gl.TRIANGLES, 0, this.mesh.count);
    // Once more, a little larger, where nothing else is as near: in the gaps between elements.
    gl.uniform2f(uniforms.u_growth, ...size.map((pixels) => (2 * GROWTH) / pixels));
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(0, 4);
    gl.drawArrays(gl.TRIANGLES, 0, this.mesh.count);
    gl.disable(gl.POLYGON_OFFSET_FILL);
  }

  /** The element at a place of the canvas, in its pixels; null where there is none. */
  elementAt(camera, x, y) {
    const { gl, canvas } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.viewport(0, 0, 1, 1);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const { program, uniforms } = this.numbers;
    gl.useProgram(program);
    const matrix = camera.matrix(canvas.clientWidth, canvas.clientHeight, [
      Math.floor(x) + 0.5,
      Math.floor(y) + 0.5,
    ]);
    gl.uniformMatrix4fv(uniforms.u_view, false, matrix);
    gl.uniform2f(uniforms.u_growth, 0, 0);
    gl.drawArrays(gl.TRIANGLES, 0, this.mesh.count);
    const bytes = new Uint8Array(4);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    const number = new DataView(bytes.buffer).getUint32(0, true);
    return number > 0 ? number - 1 : null;
  }
}
