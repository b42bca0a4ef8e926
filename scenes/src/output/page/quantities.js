// What can be shown of a solution, as a number or a colour at every corner.

const SIGMA = 5.670374419e-8;

/** The temperature of a black surface of this radiosity, in kelvins. */
function temperature(radiosity) {
  return (Math.max(radiosity, 0) / SIGMA) ** 0.25;
}

/** The quantities that there are, in the order of the list: how they are called, and how numbers are made. */
function quantities(scene) {
  const list = [];
  if (scene.solved) {
    if (scene.heat) list.push({ id: "temperature", name: "Temperature", unit: "K" });
    else list.push({ id: "light", name: "Light", unit: "" });
    list.push({ id: "radiosity", name: "Radiosity B", unit: "W/m²", banded: true });
    list.push({ id: "irradiance", name: "Irradiance H", unit: "W/m²", banded: true });
  }
  list.push({ id: "rows", name: "Sum of form factors", unit: "" });
  list.push({ id: "area", name: "Area of elements", unit: "" });
  return list;
}

/** The mean of an element's bands, or one of them. */
function ofBand(scene, field, element, band) {
  const { bands } = scene;
  if (band >= 0) return field[element * bands + band];
  let sum = 0;
  for (let k = 0; k < bands; k++) sum += field[element * bands + k];
  return sum / bands;
}

/** The number of an element. */
function elementNumber(scene, id, element, band) {
  switch (id) {
    case "temperature":
      return temperature(ofBand(scene, scene.radiosity, element, 0));
    case "radiosity":
      return ofBand(scene, scene.radiosity, element, band);
    case "irradiance":
      return ofBand(scene, scene.irradiance, element, band);
    case "rows":
      return scene.rows[element];
    default:
      return scene.areas[element];
  }
}

/**
 * What is shown at every corner, three numbers each: the radiance of light, or a number thrice. Smooth fields are those
 * that the program's pictures show: B = E + ρH with the irradiance H of vertices.
 */
function valuesAt(scene, mesh, quantity, band, smooth) {
  const values = new Float32Array(3 * mesh.count);
  const { shades, vertexIrradiance, materials } = scene;
  // Vertices know the bands of pictures only.
  const known = scene.bands === 3 || band < 0 || scene.bands === 1;
  const fromVertices = smooth && known && !["rows", "area"].includes(quantity.id);
  const pick = (rgb) => (band >= 0 && scene.bands === 3 ? rgb[band] : (rgb[0] + rgb[1] + rgb[2]) / 3);
  const rgb = [0, 0, 0];
  for (let at = 0; at < mesh.count; at++) {
    const element = mesh.elements[at];
    const material = materials[shades[element]];
    const vertex = 3 * mesh.vertices[at];
    if (fromVertices || quantity.id === "light") {
      for (let k = 0; k < 3; k++) {
        const irradiance = smooth ? vertexIrradiance[vertex + k] : pictured(scene, element, k);
        const radiosity = material.emission[k] + material.reflectance[k] * irradiance;
        rgb[k] = quantity.id === "irradiance" ? irradiance : radiosity;
      }
    }
    if (quantity.id === "light") {
      for (let k = 0; k < 3; k++) values[3 * at + k] = rgb[k] / Math.PI;
    } else {
      let number;
      if (!fromVertices) number = elementNumber(scene, quantity.id, element, band);
      else if (quantity.id === "temperature") number = temperature(rgb[0]);
      else number = pick(rgb);
      values.fill(number, 3 * at, 3 * at + 3);
    }
  }
  return values;
}

/** An element's irradiance in a band of pictures. */
function pictured(scene, element, k) {
  return ofBand(scene, scene.irradiance, element, scene.bands === 3 ? k : -1);
}

/**
 * The range that a scale shows: all numbers of elements; where a few are far above all others, as lamps are, up to what
 * 98 % of them are below.
 */
function rangeOf(scene, quantity, band) {
  const count = scene.sizes.length;
  const numbers = new Float64Array(count);
  for (let k = 0; k < count; k++) numbers[k] = elementNumber(scene, quantity.id, k, band);
  numbers.sort();
  const [low, most, high] = [numbers[0], numbers[Math.floor(0.98 * (count - 1))], numbers[count - 1]];
  if (quantity.id === "temperature" && scene.range) return scene.range;
  return high - low > 3 * (most - low) && most > low ? [low, most] : [low, high];
}

/** Numbers from one end of a range to the other, as round as they can be: five or so. */
function ticks([low, high]) {
  const width = high - low;
  if (!(width > 0)) return [low];
  const rough = 10 ** Math.floor(Math.log10(width / 5));
  const step = rough * [1, 2, 5, 10].find((factor) => width / (rough * factor) <= 7);
  const marks = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) marks.push(k * step);
  return marks;
}

/** A number in as many digits as tell it from others. */
function shown(number, digits = 4) {
  if (!Number.isFinite(number)) return String(number);
  if (number === 0) return "0";
  const size = Math.abs(number);
  if (size < 1e-3 || size >= 1e6) return number.toExponential(digits - 1);
  return String(Number(number.toPrecision(digits)));
}
