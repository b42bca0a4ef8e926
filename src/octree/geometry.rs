//! The root cube and its cells.

use crate::numbers::traits::{Point, Real, Vector};

/// The deepest level of the octree: three 21-bit coordinates fill one 64-bit Morton key.
pub const MAX_LEVEL: usize = 21;

/// The smallest half-width of a root cube, in units of the smallest normal number.
const MIN_SCALE: f64 = (1u64 << (MAX_LEVEL + 8)) as f64;

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
    /// one eighth. A half-width of zero gives a cube of half-width one; one so small that its
    /// deepest cells would be denormal is raised.
    pub fn new(centre: Point<T>, half_width: T) -> Self {
        let half_width = if half_width > T::from_f64(0.0) {
            let half_width = half_width.max(T::min_positive_value() * T::from_f64(MIN_SCALE));
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

    /// Integer coordinates of the level-[`MAX_LEVEL`] cell that holds `p`; points outside the cube
    /// are put into the nearest cell.
    pub(crate) fn locate(&self, p: Point<T>) -> [u32; 3] {
        let n = f64::from(1u32 << MAX_LEVEL);
        let (p, centre) = (p.to_array(), self.centre.to_array());
        std::array::from_fn(|k| {
            let d = p[k].as_f64() - centre[k].as_f64();
            let fraction = 0.5 * (d / self.half_width.as_f64() + 1.0);
            (fraction * n).clamp(0.0, n - 1.0) as u32
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
    coordinates: [u32; 3],
}

impl<T: Real> Cell<T> {
    /// The cell at `level` with the given integer coordinates, each below 2^`level`.
    ///
    /// # Panics
    /// If the level exceeds [`MAX_LEVEL`] or a coordinate lies outside the root cube.
    pub fn new(root: &Cube<T>, level: usize, coordinates: [u64; 3]) -> Self {
        assert!(level <= MAX_LEVEL, "level {level}: expected at most {MAX_LEVEL}");
        let cells = 1i64 << level;
        let half_width = root.half_width / T::from_f64(cells as f64);
        let origin = root.centre.to_array();
        let exact_sums: [(T, T); 3] = std::array::from_fn(|k| {
            let c = coordinates[k] as i64;
            assert!((0..cells).contains(&c), "coordinate {c}: expected less than {cells}");
            let from_root = half_width * T::from_f64((2 * c + 1 - cells) as f64);
            two_sum(origin[k], from_root)
        });
        Self {
            centre: Point::<T>::from_array(exact_sums.map(|(sum, _)| sum)),
            centre_low: Point::<T>::from_array(exact_sums.map(|(_, low)| low)),
            half_width,
            level: level as u32,
            coordinates: coordinates.map(|c| c as u32),
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
        self.coordinates.map(u64::from)
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

    /// The integer vector from this cell to `other`, a cell of the same level.
    pub fn offset_to(&self, other: &Self) -> [i32; 3] {
        debug_assert_eq!(self.level, other.level);
        std::array::from_fn(|k| other.coordinates[k] as i32 - self.coordinates[k] as i32)
    }

    /// Whether at least one cell of the finer of the two levels lies between this cell and
    /// `other`. Symmetric.
    pub fn well_separated(&self, other: &Self) -> bool {
        let (coarse, fine) = if self.level <= other.level { (self, other) } else { (other, self) };
        let shift = fine.level - coarse.level;
        (0..3).any(|k| {
            let low = i64::from(coarse.coordinates[k]) << shift;
            let high = low + (1i64 << shift) - 1;
            let c = i64::from(fine.coordinates[k]);
            c < low - 1 || c > high + 1
        })
    }
}

/// a + b rounded, and what rounding took from it (Knuth's two-sum).
fn two_sum<T: Real>(a: T, b: T) -> (T, T) {
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
        let last = (1 << MAX_LEVEL) - 1;
        assert_eq!(cube.locate(DVec3::new(-2.0, 2.0, 1.0)), [0, last, last]);
    }
}
