//! The root cube and its cells.

use crate::numbers::traits::{Point, Real, Vector};
use crate::octree::morton::{KEY_LEVELS, morton_key};

/// The deepest level of the octree: as many as three Morton keys tell apart.
pub const MAX_LEVEL: usize = 3 * KEY_LEVELS;

/// Offsets between cells are told up to this many cells. Expansions do not carry anything farther.
pub(crate) const MAX_OFFSET: i32 = 1 << 30;

/// The smallest half-width of a cell, in units of the smallest normal number.
const MIN_SCALE: f64 = (1u64 << 8) as f64;

/// Cells of an edge that one key tells apart.
const CELLS_OF_KEY: f64 = (1u64 << KEY_LEVELS) as f64;

/// The root cube of a tree.
///
/// Its edge carries so few significant bits that the centres of all cells, measured from the root's
/// centre, are exact numbers, and so are shifts between cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cube<T: Real> {
    centre: Point<T>,
    half_width: T,
}

impl<T: Real> Cube<T> {
    /// The cube around `centre` whose half-width is at least `half_width`, rounded up by at most
    /// one eighth. A half-width of zero gives a cube of half-width one; one so small that cells
    /// of few levels would be denormal is raised.
    pub fn new(centre: Point<T>, half_width: T) -> Self {
        let half_width = if half_width > T::from_f64(0.0) {
            let half_width =
                half_width.max(T::min_positive_value() * T::from_f64(MIN_SCALE * CELLS_OF_KEY));
            let exponent = half_width.log2().floor();
            let unit = exponent.exp2() / T::from_f64(8.0);
            (half_width / unit).ceil() * unit
        } else {
            T::from_f64(1.0)
        };
        Self { centre, half_width }
    }

    /// Its centre.
    pub fn centre(&self) -> Point<T> {
        self.centre
    }

    /// Half its edge.
    pub fn half_width(&self) -> T {
        self.half_width
    }

    /// Where `p` is along the Morton curve through the cells of [`MAX_LEVEL`]: three words of 21 levels each, three bits
    /// a level, that compare like the places. Only the first of them is found, from rounded numbers, unless the place
    /// is to be exact: that is what trees need whose cells the first word can't tell apart.
    pub fn curve_key(&self, p: Point<T>, exact: bool) -> [u64; 3] {
        if !exact {
            return [morton_key(self.locate(p)), 0, 0];
        }
        let place = self.locate_exactly(p);
        [2, 1, 0].map(|word| morton_key(place.map(|c| c >> (word * KEY_LEVELS))))
    }

    /// The deepest level on which all arithmetic is that of normal numbers: [`MAX_LEVEL`], but for tiny
    /// cubes.
    pub(crate) fn deepest_level(&self) -> usize {
        let smallest = T::min_positive_value().as_f64() * MIN_SCALE;
        let levels = (self.half_width.as_f64() / smallest).log2().floor();
        MAX_LEVEL.min(levels as usize)
    }

    /// Integer coordinates of the cell that holds `p` among those that one key tells apart, from rounded
    /// numbers; points outside the cube are put into the nearest cell.
    pub(crate) fn locate(&self, p: Point<T>) -> [u64; 3] {
        let (p, centre) = (p.to_array(), self.centre.to_array());
        std::array::from_fn(|k| {
            let d = p[k].as_f64() - centre[k].as_f64();
            let fraction = 0.5 * (d / self.half_width.as_f64() + 1.0);
            let place = (fraction * CELLS_OF_KEY).clamp(0.0, CELLS_OF_KEY - 1.0);
            u64::from(place as u32)
        })
    }

    /// Integer coordinates of the level-[`MAX_LEVEL`] cell that holds `p`, with no digits of levels below the
    /// [deepest](Self::deepest_level) and none of the others rounded: however small a cell is beside the root,
    /// the points that it is said to hold lie in it.
    pub(crate) fn locate_exactly(&self, p: Point<T>) -> [u64; 3] {
        let (p, centre) = (p.to_array(), self.centre.to_array());
        let unknown = MAX_LEVEL - self.deepest_level();
        std::array::from_fn(|k| {
            let mut edge = 2.0 * self.half_width.as_f64();
            let from_centre = two_sum(p[k].as_f64(), -centre[k].as_f64());
            let mut rest = plus(from_centre, 0.5 * edge);
            let mut place = 0;
            for _ in 0..MAX_LEVEL / KEY_LEVELS {
                edge /= CELLS_OF_KEY;
                let digits;
                (digits, rest) = divided(rest, edge);
                place = place << KEY_LEVELS | digits;
            }
            place >> unknown << unknown
        })
    }
}

/// One cell of the octree over a root cube: what expansions are centred on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell<T: Real> {
    centre: Point<T>,
    /// What rounding took from `centre`.
    centre_low: Point<T>,
    half_width: T,
    level: u32,
    coordinates: [u64; 3],
}

impl<T: Real> Cell<T> {
    /// The cell at `level` with the given integer coordinates, each below 2^`level`.
    ///
    /// # Panics
    /// If the level exceeds [`MAX_LEVEL`] or a coordinate lies outside the root cube.
    pub fn new(root: &Cube<T>, level: usize, coordinates: [u64; 3]) -> Self {
        assert!(level <= MAX_LEVEL, "level {level}: expected at most {MAX_LEVEL}");
        let cells = 1u64 << level;
        let half_width = root.half_width / T::from_f64(cells as f64);
        let origin = root.centre.to_array();
        let exact_sums: [(T, T); 3] = std::array::from_fn(|k| {
            let c = coordinates[k];
            assert!(c < cells, "coordinate {c}: expected less than {cells}");
            let from_root = half_widths((2 * c + 1).wrapping_sub(cells) as i64, half_width);
            rounded_sum(origin[k], from_root)
        });
        Self {
            centre: Point::<T>::from_array(exact_sums.map(|(sum, _)| sum)),
            centre_low: Point::<T>::from_array(exact_sums.map(|(_, low)| low)),
            half_width,
            level: level as u32,
            coordinates,
        }
    }

    /// Its centre in scene coordinates.
    pub fn centre(&self) -> Point<T> {
        self.centre
    }

    /// Half its edge.
    pub fn half_width(&self) -> T {
        self.half_width
    }

    /// Its level; the root's is 0.
    pub fn level(&self) -> usize {
        self.level as usize
    }

    /// Its integer coordinates among the 2^level cells per axis.
    pub fn coordinates(&self) -> [u64; 3] {
        self.coordinates
    }

    /// `p` measured from the centre in scene units, free of the rounding that a far-away origin
    /// would bring: for points of the cell the first difference is exact or small.
    #[inline]
    pub fn relative(&self, p: Point<T>) -> Point<T> {
        (p - self.centre) - self.centre_low
    }

    /// `p` measured from the centre in half-widths: in [−1, 1]³ for points of the cell.
    #[inline]
    pub fn normalised(&self, p: Point<T>) -> Point<T> {
        let [x, y, z] = self.relative(p).to_array();
        let h = self.half_width;
        Point::<T>::from_array([x / h, y / h, z / h])
    }

    /// Which of its parent's octants it is: bit 0 for x, bit 1 for y, bit 2 for z.
    pub fn octant(&self) -> usize {
        let [x, y, z] = self.coordinates.map(|c| (c & 1) as usize);
        x | y << 1 | z << 2
    }

    /// The integer vector from this cell to `other`, a cell of the same level. Saturated at 2³⁰ cells:
    /// no pair of cells that is farther apart is ever given to an expansion.
    #[inline]
    pub fn offset_to(&self, other: &Self) -> [i32; 3] {
        debug_assert_eq!(self.level, other.level);
        let axis = |k: usize| other.coordinates[k] as i64 - self.coordinates[k] as i64;
        let most = i64::from(MAX_OFFSET);
        // No two cells of a coarser level are that far apart.
        if self.level <= MAX_OFFSET.ilog2() {
            [axis(0) as i32, axis(1) as i32, axis(2) as i32]
        } else {
            [0, 1, 2].map(|k| axis(k).clamp(-most, most) as i32)
        }
    }

    /// Whether at least one cell of the finer of the two levels lies between this cell and
    /// `other`. Symmetric.
    pub fn well_separated(&self, other: &Self) -> bool {
        let (coarse, fine) = if self.level <= other.level { (self, other) } else { (other, self) };
        let shift = fine.level - coarse.level;
        (0..3).any(|k| {
            let (low, c) = (coarse.coordinates[k] << shift, fine.coordinates[k]);
            c + 1 < low || c > low + (1 << shift)
        })
    }
}

/// An integer number of half-widths of a cell, and what rounding took from it. The half-width of a
/// cell has so few digits that both products are exact.
fn half_widths<T: Real>(count: i64, half_width: T) -> (f64, f64) {
    let few = count & i64::from(u32::MAX);
    let h = half_width.as_f64();
    two_sum(h * (count - few) as f64, h * few as f64)
}

/// A number plus one in two parts, rounded, and what rounding took from it.
fn rounded_sum<T: Real>(a: T, (high, low): (f64, f64)) -> (T, T) {
    let (sum, rest) = two_sum(a.as_f64(), high);
    let (rest, least) = two_sum(low, rest);
    let (sum, rest) = two_sum(sum, rest);
    let rounded = T::from_f64(sum);
    (rounded, T::from_f64((sum - rounded.as_f64()) + (rest + least)))
}

/// How often `edge` goes into a number in two parts, as far as one key tells, and the remainder.
fn divided(number: (f64, f64), edge: f64) -> (u64, (f64, f64)) {
    let last = CELLS_OF_KEY - 1.0;
    let mut count = (number.0 / edge).floor().clamp(0.0, last);
    let mut rest = plus(number, -count * edge);
    // The quotient is rounded, the remainder is not.
    if rest.0 < 0.0 && count > 0.0 {
        (count, rest) = (count - 1.0, plus(rest, edge));
    } else if plus(rest, -edge).0 >= 0.0 && count < last {
        (count, rest) = (count + 1.0, plus(rest, -edge));
    }
    (count as u64, rest)
}

/// A number in two parts plus another.
fn plus((high, low): (f64, f64), other: f64) -> (f64, f64) {
    let (sum, rest) = two_sum(high, other);
    two_sum(sum, rest + low)
}

/// a + b rounded, and what rounding took from it (Knuth's two-sum).
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let b_part = sum - a;
    (sum, (a - (sum - b_part)) + (b - b_part))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, Vec3};

    #[test]
    fn points_are_seen_from_cells_without_rounding() {
        let cube = Cube::<f32>::new(Vec3::new(0.1, -3.7, 1e3), 0.731);
        let n = 1u32 << 19;
        for c in [0, 1, 77_777, n - 1] {
            let cell = Cell::new(&cube, 19, [u64::from(c); 3]);
            let from_root =
                f64::from(cube.half_width()) * (f64::from(2 * c + 1) / f64::from(n) - 1.0);
            for (axis, centre) in [0.1f32, -3.7, 1e3].into_iter().enumerate() {
                let p = (f64::from(centre) + from_root * (1.0 + 1e-4)) as f32;
                let exact = f64::from(p) - (f64::from(centre) + from_root);
                let seen = f64::from(cell.relative(Vec3::splat(p))[axis]);
                assert!((seen - exact).abs() <= 1e-7 * exact.abs(), "{seen} {exact}");
            }
        }
    }

    /// Points of which everything is known: at a multiple of so small a length from the root's centre.
    fn located_and_seen<T: Real>(half_width: f64, centre: f64) {
        let splat = |x: f64| Point::<T>::from_array([T::from_f64(x); 3]);
        let cube = Cube::<T>::new(splat(centre), T::from_f64(half_width));
        let h = cube.half_width().as_f64();
        assert_eq!(cube.centre().to_array()[0].as_f64(), centre);
        for level in 3..=cube.deepest_level() {
            let edge = 2.0 * h / (1u64 << level) as f64;
            // The cells next to the origin of the scene, where coordinates have the most digits.
            let last = ((1.0 - centre / h) / 2.0 * (1u64 << level) as f64) as u64;
            for (c, fraction) in [(last, 0.625), (last - 1, 0.25)] {
                let corner = if c == last { 0.0 } else { -edge };
                let p = splat(corner + fraction * edge);
                let place = cube.locate_exactly(p).map(|place| place >> (MAX_LEVEL - level));
                assert_eq!(place, [c; 3], "level {level}");
                let cell = Cell::new(&cube, level, place);
                let seen = cell.normalised(p).to_array().map(Real::as_f64);
                assert_eq!(seen, [2.0 * fraction - 1.0; 3], "level {level}");
            }
        }
    }

    #[test]
    fn points_are_located_and_seen_on_every_level() {
        for half_width in [1.0, 1.125, 1e-30] {
            for share in [0.0, 0.5, 0.25] {
                let h = Cube::<f32>::new(Vec3::ZERO, half_width as f32).half_width();
                located_and_seen::<f32>(half_width, share * f64::from(h));
                let h = Cube::<f64>::new(DVec3::ZERO, half_width).half_width();
                located_and_seen::<f64>(half_width, share * h);
            }
        }
        let tiny = Cube::new(DVec3::ZERO, 1e-295);
        assert!((KEY_LEVELS + 1..MAX_LEVEL).contains(&tiny.deepest_level()));
        assert_eq!(Cube::<f32>::new(Vec3::ZERO, 0.0).deepest_level(), MAX_LEVEL);
        let smallest = Cube::<f32>::new(Vec3::ZERO, f32::MIN_POSITIVE);
        assert_eq!(smallest.deepest_level(), KEY_LEVELS);
    }

    #[test]
    fn offsets_and_separation_hold_between_the_ends_of_the_root() {
        let cube = Cube::new(DVec3::ZERO, 1.0);
        let last = (1u64 << MAX_LEVEL) - 1;
        let [low, high] = [0, last].map(|c| Cell::new(&cube, MAX_LEVEL, [c, 5, last - c]));
        assert_eq!(low.offset_to(&high), [MAX_OFFSET, 0, -MAX_OFFSET]);
        assert!(low.well_separated(&high) && high.well_separated(&low));
        let root = Cell::new(&cube, 0, [0; 3]);
        assert!(!root.well_separated(&high) && !low.well_separated(&root));
        let next = Cell::new(&cube, MAX_LEVEL, [last - 1, 5, 1]);
        assert_eq!(high.offset_to(&next), [-1, 0, 1]);
        assert!(!high.well_separated(&next));
    }

    #[test]
    fn separation_counts_cells_of_the_finer_level() {
        let cube = Cube::new(DVec3::ZERO, 1.0);
        let coarse = Cell::new(&cube, 2, [1, 1, 1]);
        assert!(!coarse.well_separated(&Cell::new(&cube, 2, [2, 0, 1])));
        assert!(coarse.well_separated(&Cell::new(&cube, 2, [3, 1, 1])));
        assert!(!coarse.well_separated(&Cell::new(&cube, 3, [4, 2, 2])));
        assert!(coarse.well_separated(&Cell::new(&cube, 3, [5, 2, 2])));
        assert!(Cell::new(&cube, 3, [5, 2, 2]).well_separated(&coarse));
        assert!(!coarse.well_separated(&Cell::new(&cube, 3, [3, 3, 3])));
    }

    #[test]
    fn points_outside_the_cube_fall_into_border_cells() {
        let cube = Cube::new(DVec3::ZERO, 1.0);
        let outside = DVec3::new(-2.0, 2.0, 1.0);
        let last = (1 << MAX_LEVEL) - 1;
        assert_eq!(cube.locate_exactly(outside), [0, last, last]);
        let last = (1 << KEY_LEVELS) - 1;
        assert_eq!(cube.locate(outside), [0, last, last]);
    }
}
