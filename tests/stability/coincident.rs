//! Points at one place, and whether a point acts on itself.

use farfield::{Cell, Error, Expansion, Fmm, Kernel, Located, from_fn};
use farfield_testing::clouds;
use glam::DVec3;

use crate::table::row;
use crate::{Formula, inverse};

/// A point with a number of its own.
#[derive(Clone, Copy, Debug)]
struct Numbered {
    position: DVec3,
    number: usize,
}

impl Located for Numbered {
    type Real = f64;
    fn position(&self) -> DVec3 {
        self.position
    }
}

/// Counts all charges but a point's own.
struct Others {
    by_number: bool,
}

impl Kernel for Others {
    type Real = f64;
    type Source = Numbered;
    type Target = Numbered;
    type Charge = f64;
    type Value = f64;
    type Entry = f64;

    fn entries(&self, _: DVec3, _: DVec3, g: &mut [f64]) {
        g[0] = 1.0;
    }

    /// A pair is more than a formula of its positions.
    fn add_block(
        &self,
        xs: &[Numbered],
        ys: &[Numbered],
        qs: &[f64],
        _tolerance: f64,
        us: &mut [f64],
    ) {
        for (x, u) in xs.iter().zip(us) {
            for (y, q) in ys.iter().zip(qs) {
                let own =
                    if self.by_number { x.number == y.number } else { x.position == y.position };
                *u += if own { 0.0 } else { *q };
            }
        }
    }
}

impl Expansion for Others {
    type Kernel = Self;
    type MultipoleTerm = f64;
    type LocalTerm = f64;

    fn kernel(&self) -> &Self {
        self
    }
    fn multipole_len(&self, _: usize) -> usize {
        1
    }
    fn local_len(&self, _: usize) -> usize {
        1
    }
    fn p2m(&self, _: &Cell<f64>, _: &[Numbered], charges: &[f64], m: &mut [f64]) {
        m[0] += charges.iter().sum::<f64>();
    }
    fn m2m(&self, _: &Cell<f64>, _: &Cell<f64>, from: &[f64], to: &mut [f64]) {
        to[0] += from[0];
    }
    fn m2l(&self, _: &Cell<f64>, _: &Cell<f64>, from: &[f64], to: &mut [f64]) {
        to[0] += from[0];
    }
    fn l2l(&self, _: &Cell<f64>, _: &Cell<f64>, from: &[f64], to: &mut [f64]) {
        to[0] += from[0];
    }
    fn l2p(&self, _: &Cell<f64>, l: &[f64], _: &[Numbered], us: &mut [f64]) {
        us.iter_mut().for_each(|u| *u += l[0]);
    }
}

#[test]
fn whether_a_point_acts_on_itself_is_said_by_position_or_by_number() {
    // Two points at every place.
    let places = clouds::cube(600, 3);
    let points: Vec<Numbered> =
        (0..1200).map(|number| Numbered { position: places[number / 2], number }).collect();
    let charges: Vec<f64> = (0..1200).map(|i| f64::from(i % 7) - 2.0).collect();
    let total: f64 = charges.iter().sum();
    let sums = |by_number| {
        let fmm = Fmm::with_expansion(Others { by_number }).leaf_size(10);
        let fmm = fmm.build(&points, &points).unwrap();
        assert!(fmm.report().stats.cell_pairs[0] > 0);
        fmm.apply(&charges).unwrap()
    };
    let at_place = |i: usize| charges[i / 2 * 2] + charges[i / 2 * 2 + 1];
    for (i, (by_position, by_number)) in sums(false).into_iter().zip(sums(true)).enumerate() {
        assert_eq!((by_position, by_number), (total - at_place(i), total - charges[i]));
    }
    // With neither, the formula is taken at its word.
    let at = [places[0], DVec3::X, places[0]];
    let singular = Fmm::builder(from_fn(inverse as Formula)).order(3).build(&at, &at).unwrap();
    let refused = singular.apply(&[1.0; 3]);
    assert!(matches!(refused, Err(Error::NonFiniteValue { index: 0, .. })), "{refused:?}");
    let naive: f64 = at.iter().map(|y| inverse(at[0], *y)).sum();
    row(
        "Coincident points under a singular kernel",
        "1/0; whether twins see each other is nobody's decision",
        format!("sum {naive}"),
        "twins apart by number, skipped by position, both exact; undecided: `NonFiniteValue`",
    );
}
