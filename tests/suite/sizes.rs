//! Sizes of kernels: known when they are compiled or at run time only, and what is refused; points of any type.

use farfield::num_complex::Complex;
use farfield::{Fmm, Kernel, direct, from_fn, from_formula, relative_l2_error, rows_as_points};
use farfield_testing::clouds;
use glam::DVec3;
use ndarray::{Array2, ShapeBuilder};

use crate::plain;
use crate::written_once::{Matrix, N, Softened, Wave, cloud};

/// A matrix kernel whose sizes are known only at run time, as those of a kernel read from a text are:
/// G_ab(d) = (c_ab + |d|²)^(−1/2), `side` × `side`, for `columns` right-hand sides.
struct Table {
    side: usize,
    columns: usize,
    offsets: Vec<f64>,
    /// How many blocks of entries were asked for.
    blocks: std::sync::atomic::AtomicUsize,
}

impl Kernel for Table {
    type Real = f64;
    type Source = DVec3;
    type Target = DVec3;
    type Charge = Vec<f64>;
    type Value = Vec<f64>;
    type Entry = f64;

    fn fields(&self) -> usize {
        self.side
    }

    fn densities(&self) -> usize {
        self.side
    }

    fn columns(&self) -> usize {
        self.columns
    }

    fn entries(&self, x: DVec3, y: DVec3, g: &mut [f64]) {
        self.entries_block(&[x], &[y], g);
    }

    fn entries_block(&self, xs: &[DVec3], ys: &[DVec3], g: &mut [f64]) {
        self.blocks.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let pairs = xs.iter().flat_map(|x| ys.iter().map(move |y| x.distance_squared(*y)));
        for (r2, g) in pairs.zip(g.chunks_exact_mut(self.offsets.len())) {
            for (entry, offset) in g.iter_mut().zip(&self.offsets) {
                *entry = 1.0 / (offset + r2).sqrt();
            }
        }
    }
}

#[test]
fn sizes_may_be_known_at_run_time_only() {
    let points = clouds::cube(800, 1);
    let (side, columns) = (3, 5);
    let offsets: Vec<f64> = (0..side * side).map(|k| 0.5 + 0.1 * k as f64).collect();
    let table = Table { side, columns, offsets, blocks: Default::default() };
    let numbers = clouds::charges(points.len() * side * columns, 3);
    let charges: Vec<Vec<f64>> = numbers.chunks(side * columns).map(<[f64]>::to_vec).collect();
    let sums = direct(&table, &points, &charges, &points[..60]).unwrap();
    for (x, sums) in points.iter().zip(&sums) {
        for field in 0..side {
            for column in 0..columns {
                let mut exact = 0.0;
                for (y, q) in points.iter().zip(&charges) {
                    for density in 0..side {
                        let offset = table.offsets[field * side + density];
                        let entry = 1.0 / (offset + x.distance_squared(*y)).sqrt();
                        exact += entry * q[density * columns + column];
                    }
                }
                let found = sums[field * columns + column];
                assert!((found - exact).abs() < 1e-11, "field {field}, column {column}");
            }
        }
    }
    let fmm = Fmm::builder(&table).tolerance(1e-4).leaf_size(20).build(&points, &points).unwrap();
    assert!(fmm.report().stats.expansion_pairs > 0);
    // A shorter list ends in zeros; a longer one would be cut.
    let mut uneven = charges.clone();
    uneven[3] = vec![0.0; side * columns];
    let zeros = fmm.apply(&uneven).unwrap();
    uneven[3] = Vec::new();
    assert_eq!(fmm.apply(&uneven).unwrap(), zeros);
    uneven[3] = vec![0.0; side * columns + 1];
    let refusals = [fmm.apply(&uneven), direct(&table, &points, &uneven, &points)];
    for refused in refusals {
        let refused = refused.unwrap_err();
        assert_eq!(refused, farfield::Error::ChargeTooLong { index: 3, expected: 15, found: 16 });
    }
    let before = table.blocks.load(std::sync::atomic::Ordering::Relaxed);
    let values = fmm.apply(&charges).unwrap();
    assert!(relative_l2_error(&values[..60], &sums) < 1e-4);
    let asked = table.blocks.load(std::sync::atomic::Ordering::Relaxed) - before;
    let pairs = fmm.report().stats.direct_pairs as usize;
    assert!(asked > 0 && 10 * asked < pairs, "blocks, not pairs: {asked} of {pairs}");
}

#[test]
fn points_may_be_arrays_vectors_or_rows() {
    let (points, charges) = cloud();
    let arrays: Vec<[f64; 3]> = points.iter().map(|p| p.to_array()).collect();
    let rows = Array2::from_shape_vec((N, 3), arrays.concat()).unwrap();
    let mut columns = Array2::zeros((N, 3).f());
    columns.assign(&rows);
    let sum = |points: &[[f64; 3]]| {
        let kernel = from_formula(Softened);
        let fmm = Fmm::builder(kernel).tolerance(1e-3).leaf_size(50).build(points, points).unwrap();
        fmm.apply(&charges).unwrap()
    };
    let kernel = from_formula(Softened);
    let fmm = Fmm::builder(kernel).tolerance(1e-3).leaf_size(50).build(&points, &points).unwrap();
    let expected = fmm.apply(&charges).unwrap();
    assert_eq!(sum(&arrays), expected);
    assert_eq!(sum(&rows_as_points(rows.view()).unwrap()), expected);
    assert_eq!(sum(&rows_as_points(columns.view()).unwrap()), expected);
}

#[test]
fn sizes_that_don_t_belong_together_are_refused() {
    use farfield::Error::{EmptyKernel, KernelSize};
    let at = [DVec3::X, DVec3::Y];
    // A complex formula and charges of one real number.
    let refused = direct(&from_formula(Wave), &at, &[1.0, 2.0], &at).unwrap_err();
    assert_eq!(refused, KernelSize { what: "charge", expected: 2, found: 1 });
    let refused = Fmm::builder(from_formula::<_, DVec3, f64>(Wave)).build(&at, &at).map(|_| ());
    assert_eq!(refused, Err(KernelSize { what: "charge", expected: 2, found: 1 }));
    // Three densities and two fields, charges and values of other sizes.
    let matrix = from_formula::<_, DVec3, [f64; 3]>(Matrix);
    let refused = direct(&matrix, &at, &[[1.0; 3]; 2], &at).unwrap_err();
    assert_eq!(refused, KernelSize { what: "value", expected: 2, found: 3 });
    let values = matrix.values::<[f64; 4]>();
    let refused = direct(&values, &at, &[[1.0; 3]; 2], &at).unwrap_err();
    assert_eq!(refused, KernelSize { what: "value", expected: 2, found: 4 });
    // A kernel that makes more densities than its charges have numbers has to say how many columns it has.
    let unsaid = Table { side: 3, columns: 0, offsets: vec![1.0; 9], blocks: Default::default() };
    let refused = direct(&unsaid, &at, &[vec![1.0; 3], vec![1.0; 3]], &at).unwrap_err();
    assert_eq!(refused, farfield::Error::UnknownColumns);
    let refused = direct(&plain(|x, _| x.x).charges::<Vec<f64>>(), &[], &[], &at).unwrap_err();
    assert_eq!(refused, farfield::Error::UnknownColumns);
    // Three numbers are no whole number of complex charges.
    let waves = from_fn(|x: DVec3, _: DVec3| Complex::new(x.x, 1.0)).charges::<[f64; 3]>();
    let refused = direct(&waves, &[], &[], &at).unwrap_err();
    assert_eq!(refused, KernelSize { what: "charge", expected: 2, found: 3 });
    let estimate = Fmm::builder(waves).tolerance(1e-3).estimate(&[], &at).unwrap_err();
    assert_eq!(estimate, refused);
    let empty = Table { side: 0, columns: 1, offsets: Vec::new(), blocks: Default::default() };
    let refused = direct(&empty, &at, &[vec![], vec![]], &at).unwrap_err();
    assert_eq!(refused, EmptyKernel { fields: 0, densities: 0 });
}

/// A kernel of one field whose value has three numbers.
struct Misfit;

impl Kernel for Misfit {
    type Real = f64;
    type Source = DVec3;
    type Target = DVec3;
    type Charge = f64;
    type Value = [f64; 3];
    type Entry = f64;

    fn entries(&self, x: DVec3, y: DVec3, g: &mut [f64]) {
        g[0] = x.distance(y);
    }
}

#[test]
fn a_value_of_another_length_is_no_number() {
    let at = [DVec3::X, DVec3::Y];
    let sums = direct(&Misfit, &at, &[1.0; 2], &at).unwrap();
    assert!(sums.as_flattened().iter().all(|number| number.is_nan()), "{sums:?}");
    let fmm = Fmm::builder(Misfit).order(3).build(&at, &at).unwrap();
    let refused = fmm.apply(&[1.0; 2]);
    assert!(
        matches!(refused, Err(farfield::Error::NonFiniteValue { index: 0, .. })),
        "{refused:?}"
    );
}

#[test]
fn no_columns_have_no_sums() {
    let (points, _) = cloud();
    let nothing = vec![[0.0f64; 0]; N];
    let closure = plain(|x, y| x.distance(y)).charges::<[f64; 0]>();
    let formula = from_formula::<_, DVec3, [f64; 0]>(Softened);
    assert_eq!(direct(&closure, &points, &nothing, &points).unwrap(), nothing);
    assert_eq!(direct(&formula, &points, &nothing, &points).unwrap(), nothing);
    let fmm = Fmm::builder(closure).tolerance(1e-3).leaf_size(50).build(&points, &points).unwrap();
    assert_eq!(fmm.apply(&nothing).unwrap(), nothing);
}
