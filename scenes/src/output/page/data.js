// What the file holds: a description in JSON, and typed arrays in base 64.

/** The bytes that a text in base 64 stands for. */
function decode(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let k = 0; k < binary.length; k++) bytes[k] = binary.charCodeAt(k);
  return bytes;
}

/** The description with its arrays, each under its name. All numbers have their lowest byte first. */
function readScene() {
  const text = (id) => document.getElementById(id).textContent;
  const scene = JSON.parse(text("meta"));
  const { buffer } = decode(text("data"));
  const kinds = { f32: Float32Array, u32: Uint32Array, u8: Uint8Array };
  for (const { name, kind, offset, count } of scene.arrays) {
    scene[name] = new kinds[kind](buffer, offset, count);
  }
  return scene;
}

/**
 * The elements in triangles, three corners each: where they are and where the middle of their element is, which vertex
 * of the file and which element they are of, and how far they are from the edges, 0 or 255.
 */
function triangles(scene) {
  const { sizes, corners, positions } = scene;
  let count = 0;
  for (const size of sizes) count += 3 * (size - 2);
  const all = {
    count,
    positions: new Float32Array(3 * count),
    middles: new Float32Array(3 * count),
    vertices: new Uint32Array(count),
    elements: new Uint32Array(count),
    edges: new Uint8Array(4 * count),
  };
  let at = 0;
  let first = 0;
  sizes.forEach((size, element) => {
    const centre = middle(scene, first, size);
    for (let k = 2; k < size; k++) {
      // Edges from the first corner are within the element, but for the first and the last one.
      const within = [0, k < size - 1 ? 255 : 0, k > 2 ? 255 : 0];
      [0, k - 1, k].forEach((corner, number) => {
        const vertex = corners[first + corner];
        all.vertices[at] = vertex;
        all.elements[at] = element;
        for (let axis = 0; axis < 3; axis++) {
          all.positions[3 * at + axis] = positions[3 * vertex + axis];
          all.middles[3 * at + axis] = centre[axis];
          all.edges[4 * at + axis] = axis === number ? 255 : within[axis];
        }
        at++;
      });
    }
    first += size;
  });
  return all;
}

/** Where the middle of an element's corners is, from the origin of the file's positions; these are `size` from `first` on. */
function middle(scene, first, size) {
  const sum = [0, 0, 0];
  for (let k = first; k < first + size; k++) {
    for (let axis = 0; axis < 3; axis++) {
      sum[axis] += scene.positions[3 * scene.corners[k] + axis] / size;
    }
  }
  return sum;
}

/** The same by the number of an element. */
function middleOf(scene, element) {
  let first = 0;
  for (let k = 0; k < element; k++) first += scene.sizes[k];
  return middle(scene, first, scene.sizes[element]);
}
