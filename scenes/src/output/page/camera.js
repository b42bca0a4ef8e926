// A camera that goes around a place, or walks.

const vector = {
  add: (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]],
  sub: (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]],
  dot: (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
  cross: (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
  length: (a) => Math.hypot(...a),
  unit: (a) => a.map((x) => x / (Math.hypot(...a) || 1)),
  /** A vector turned around a unit axis (Rodrigues). */
  turn(a, axis, angle) {
    const [sin, cos] = [Math.sin(angle), Math.cos(angle)];
    const along = vector.dot(a, axis) * (1 - cos);
    const across = vector.cross(axis, a);
    return a.map((x, k) => x * cos + across[k] * sin + axis[k] * along);
  },
};

/** How close to straight up or down a camera looks, as an angle. */
const LEAST_TILT = 0.02;

class Camera {
  /** The camera of a scene, whose positions are around the origin. */
  constructor(scene) {
    this.scene = scene;
    this.home();
  }

  /** Goes back to where the scene is seen from at first. */
  home() {
    const { eye, target, up } = this.scene.camera;
    this.eye = [...eye];
    this.ahead = vector.unit(vector.sub(target, eye));
    this.up = vector.unit(up);
    // Orbits go around what is straight ahead in the middle of the scene.
    const toMiddle = -vector.dot(eye, this.ahead);
    const { radius } = this.scene;
    this.distance = toMiddle > 0.1 * radius ? toMiddle : 0.5 * radius;
    const inside = eye.every((x, axis) => Math.abs(x) < this.scene.extent[axis]);
    this.walks = inside && !this.scene.camera.outside;
  }

  get right() {
    return vector.unit(vector.cross(this.ahead, this.up));
  }

  get target() {
    return vector.add(this.eye, this.ahead, this.distance);
  }

  /** Turns by angles: to the right, and upwards. */
  turn(right, upwards) {
    const { target } = this;
    const tilt = Math.acos(Math.min(1, Math.max(-1, vector.dot(this.ahead, this.up))));
    const free = Math.min(Math.PI - LEAST_TILT, Math.max(LEAST_TILT, tilt - upwards));
    this.ahead = vector.turn(this.ahead, this.right, tilt - free);
    this.ahead = vector.unit(vector.turn(this.ahead, this.up, -right));
    if (!this.walks) this.eye = vector.add(target, this.ahead, -this.distance);
  }

  /** Moves by lengths: to the right, upwards, ahead. */
  move(right, upwards, ahead) {
    this.eye = vector.add(this.eye, this.right, right);
    this.eye = vector.add(this.eye, this.up, upwards);
    this.eye = vector.add(this.eye, this.ahead, ahead);
  }

  /** Shifts the picture, as right drags do. */
  shift(right, upwards) {
    const over = vector.cross(this.right, this.ahead);
    this.eye = vector.add(this.eye, this.right, right);
    this.eye = vector.add(this.eye, over, upwards);
  }

  /** Comes nearer by a factor, or goes ahead where it walks. */
  zoom(factor) {
    if (this.walks) {
      this.move(0, 0, 0.35 * this.scene.radius * Math.log(factor));
    } else {
      const { target } = this;
      const next = this.distance / factor;
      this.distance = Math.min(50 * this.scene.radius, Math.max(1e-3 * this.scene.radius, next));
      this.eye = vector.add(target, this.ahead, -this.distance);
    }
  }

  /** Turns towards a place, and goes around it from now on. */
  lookAt(place) {
    const line = vector.sub(place, this.eye);
    this.distance = vector.length(line);
    this.ahead = vector.unit(line);
    this.walks = false;
  }

  /** The size of half a picture of so many columns and rows, at distance 1: to the right, and upwards. */
  film(width, height) {
    const half = 0.5 * this.scene.camera.film;
    const short = Math.min(width, height);
    return [(half * width) / short, (half * height) / short];
  }

  /**
   * The matrix, column by column, from places to a picture of so many columns and rows; given a pixel (x, y), counted
   * from the upper left corner, to a picture of this pixel alone.
   */
  matrix(width, height, pixel = null) {
    const { eye, ahead, right } = this;
    const over = vector.cross(right, ahead);
    const { radius } = this.scene;
    const far = vector.length(eye) + 2 * radius;
    const near = Math.max(1e-5 * far, 2e-3 * radius);
    const [halfWidth, halfHeight] = this.film(width, height);
    // Rows that give the clip coordinates of a vector from the eye.
    let x = right.map((c) => c / halfWidth);
    let y = over.map((c) => c / halfHeight);
    if (pixel) {
      const centre = [(2 * pixel[0]) / width - 1, 1 - (2 * pixel[1]) / height];
      x = x.map((c, k) => (c - centre[0] * ahead[k]) * width);
      y = y.map((c, k) => (c - centre[1] * ahead[k]) * height);
    }
    const depth = (far + near) / (far - near);
    const rows = [x, y, ahead.map((c) => c * depth), ahead];
    const last = rows.map((row) => -vector.dot(row, eye));
    last[2] -= (2 * far * near) / (far - near);
    return new Float32Array([0, 1, 2].flatMap((k) => rows.map((row) => row[k])).concat(last));
  }
}
