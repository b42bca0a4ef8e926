//! M2L by direction: what a cell sends in one direction, and what another receives from there, has a
//! lower rank than the cell's whole far field.
//!
//! The 26 directions are those of a cell's neighbours, larger neighbours further away: an offset's
//! components of two and more cells count by their signs, the others as zero. For the offsets o of one
//! direction, C_o = P W_o Qᴴ with the same Q and P: a multipole expansion is taken to y = Qᴴ m once,
//! whatever the number of targets; small matrices W_o connect cells; l = P z closes.
//!
//! Directions that are reflections R of each other have the same W_o, and S_R Q and S_R P, where the
//! signs S_R depend on a function's parities only. So the sums over the functions of each parity class
//! are the same for all of them but for signs: they are taken once, and added up for every reflection.

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use crate::dense::{Matrix, Svd};
use crate::expansion::OffsetMap;
use crate::interpolation::basis::{Basis, adjoint, product};
use crate::interpolation::means::weight;
use crate::probe::{Formula, norm_squared, zero};
use crate::products::Batched;
use crate::real::{Point, Real, Scalar, Vector};

/// The bases of cells of one size.
#[derive(Debug)]
pub(crate) struct Bases<S: Scalar> {
    pub(crate) half_width: S::Real,
    pub(crate) source: Arc<Basis<S>>,
    pub(crate) target: Arc<Basis<S>>,
    /// Whether a reflected offset has the same matrix, with signs on rows and columns.
    pub(crate) reflected: bool,
    /// What an M2L matrix may leave out (Frobenius norm).
    pub(crate) cut: f64,
}

/// The matrices of the directions that are reflections of one.
#[derive(Debug)]
pub(crate) struct Group<R> {
    /// The axes along which that one and its reflections lie, as bits.
    pub(crate) axes: u8,
    /// Qᴴ, by its columns.
    pub(crate) collect: Vec<Part<R>>,
    /// P, by its rows.
    pub(crate) spread: Vec<Part<R>>,
    /// W_o
    pub(crate) cores: Vec<Batched<R>>,
    /// How many coordinates y and z there are, and how many with zeros that fill up registers.
    pub(crate) ranks: [usize; 2],
    pub(crate) heights: [usize; 2],
}

/// The part of a matrix that belongs to neighbouring functions of one parity class.
#[derive(Debug)]
pub(crate) struct Part<R> {
    /// The parities along the group's axes.
    pub(crate) class: usize,
    /// The first of the functions.
    pub(crate) first: usize,
    pub(crate) matrix: Batched<R>,
}

impl<R> Group<R> {
    /// How many directions there are, and as many parity classes.
    pub(crate) fn members(&self) -> usize {
        1 << self.axes.count_ones()
    }

    /// Multiply-adds of the sums over all functions, once for all directions.
    pub(crate) fn side_multiply_adds(&self) -> usize {
        let parts = self.collect.iter().chain(&self.spread);
        parts.map(|part| part.matrix.rows * part.matrix.columns).sum()
    }
}

/// A group in the digits that the tolerance needs.
#[derive(Debug)]
pub(crate) enum Digits<S: Scalar> {
    Full(Group<S>),
    Single(Group<S::Single>),
}

/// Where the matrix of an offset stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    pub(crate) group: u8,
    /// Which reflection of the group's first direction, as bits of its axes.
    pub(crate) member: u8,
    pub(crate) core: u32,
}

/// Directions are numbered by their signs in base three, with one for no direction at all.
const DIRECTIONS: usize = 27;

/// The number of an offset's direction.
fn direction_of(offset: [i32; 3]) -> usize {
    let sign = |o: i32| if o >= 2 { 2 } else { usize::from(o > -2) };
    (sign(offset[0]) * 3 + sign(offset[1])) * 3 + sign(offset[2])
}

/// The groups of the given offsets' directions, and where each offset stands.
pub(crate) fn directions<S: Scalar>(
    kernel: &Formula<'_, S>,
    bases: &Bases<S>,
    offsets: &[[i32; 3]],
) -> (Vec<Digits<S>>, OffsetMap<Place>) {
    let stored = |o: [i32; 3]| if bases.reflected { o.map(i32::abs) } else { o };
    let known: Vec<[i32; 3]> = offsets.iter().map(|&o| stored(o)).collect();
    let matrices = OffsetMap::build(&known, |o| {
        full_matrix(kernel, bases.half_width, o, &bases.source, &bases.target)
    });

    // The offsets of each direction; with reflections, of those without negative signs.
    let mut members: Vec<Vec<[i32; 3]>> = vec![Vec::new(); DIRECTIONS];
    for &offset in offsets {
        let (_, offset) = bases.canonical(offset);
        members[direction_of(offset)].push(offset);
    }
    members.retain(|members| !members.is_empty());
    for members in &mut members {
        members.sort_unstable();
        members.dedup();
    }
    let places = OffsetMap::build(offsets, |offset| {
        let (reflection, canonical) = bases.canonical(offset);
        let number = direction_of(canonical);
        let group = members.iter().position(|members| direction_of(members[0]) == number);
        let group = group.unwrap_or_default();
        let core = members[group].binary_search(&canonical).unwrap_or_default() as u32;
        let member = compressed(reflection as u8, bases.axes(canonical)) as u8;
        Place { group: group as u8, member, core }
    });
    (members.par_iter().map(|members| bases.group(members, &matrices)).collect(), places)
}

/// The bits of `set` at the places of `axes`, next to each other.
fn compressed(set: u8, axes: u8) -> usize {
    let bits = (0..3).filter(|axis| axes >> axis & 1 == 1).enumerate();
    bits.fold(0, |all, (place, axis)| all | usize::from(set >> axis & 1) << place)
}

impl<S: Scalar> Bases<S> {
    /// The reflection that takes an offset to a direction without negative signs, and its image.
    fn canonical(&self, offset: [i32; 3]) -> (usize, [i32; 3]) {
        if !self.reflected {
            return (0, offset);
        }
        let negative = |axis: usize| usize::from(offset[axis] <= -2) << axis;
        let image = offset.map(|o| if o <= -2 { -o } else { o });
        (negative(0) | negative(1) | negative(2), image)
    }

    /// The axes along which a direction and its reflections lie.
    fn axes(&self, offset: [i32; 3]) -> u8 {
        let along = |axis: usize| u8::from(self.reflected && offset[axis].abs() >= 2) << axis;
        along(0) | along(1) | along(2)
    }

    fn group(&self, members: &[[i32; 3]], matrices: &OffsetMap<Matrix<S>>) -> Digits<S> {
        let signed = |&offset: &[i32; 3]| {
            let negative = |axis: usize| usize::from(offset[axis] < 0) << axis;
            let (reflection, stored) = match self.reflected {
                true => (negative(0) | negative(1) | negative(2), offset.map(i32::abs)),
                false => (0, offset),
            };
            let [rows, columns] =
                [&self.target, &self.source].map(|basis| &basis.signs[reflection]);
            let c = matrices.get(stored).into_iter();
            c.map(move |c| {
                Matrix::from_fn(c.rows, c.columns, |i, j| {
                    c.at(i, j) * S::from_real(rows[i] * columns[j])
                })
            })
        };
        let matrices: Vec<Matrix<S>> = members.iter().flat_map(signed).collect();
        let adjoints: Vec<Matrix<S>> = matrices.iter().map(adjoint).collect();
        let weights: Vec<f64> = members.iter().map(|&offset| weight(offset).sqrt()).collect();
        let spread = common_range(&matrices, &weights, self.target.rank(), self.cut);
        let right = common_range(&adjoints, &weights, self.source.rank(), self.cut);
        let (collect, left) = (adjoint(&right), adjoint(&spread));
        let cores = matrices.iter().map(|c| product(&product(&left, c), &right)).collect();
        let size = matrices.iter().map(|c| norm_squared(&c.data)).fold(0.0, f64::max).sqrt();
        let single = size_of::<S>() > size_of::<S::Single>();
        let axes = self.axes(members[0]);
        match single && SINGLE_ROUNDING * size <= ROUNDING_SHARE * self.cut {
            true => Digits::Single(self.in_parts(axes, [&collect, &spread], cores, S::to_single)),
            false => Digits::Full(self.in_parts(axes, [&collect, &spread], cores, |x| x)),
        }
    }

    fn in_parts<R: Scalar>(
        &self,
        axes: u8,
        [collect, spread]: [&Matrix<S>; 2],
        cores: Vec<Matrix<S>>,
        digits: impl Fn(S) -> R,
    ) -> Group<R> {
        let batched = |a: Matrix<S>| Batched::new(&a.map(&digits));
        let columns = runs(&self.source, axes).into_iter().map(|(class, run)| {
            let part =
                Matrix::from_fn(collect.rows, run.len(), |i, j| collect.at(i, run.start + j));
            Part { class, first: run.start, matrix: batched(part) }
        });
        let rows = runs(&self.target, axes).into_iter().map(|(class, run)| {
            let part =
                Matrix::from_fn(run.len(), spread.columns, |i, j| spread.at(run.start + i, j));
            Part { class, first: run.start, matrix: batched(part) }
        });
        let ranks = [collect.rows, spread.columns];
        Group {
            axes,
            collect: columns.collect(),
            spread: rows.collect(),
            cores: cores.into_iter().map(batched).collect(),
            ranks,
            heights: ranks.map(Batched::<R>::height_of),
        }
    }
}

/// The runs of functions of one parity class, with the class; each class has one at least.
fn runs<S: Scalar>(basis: &Basis<S>, axes: u8) -> Vec<(usize, Range<usize>)> {
    let mut runs: Vec<(usize, Range<usize>)> = Vec::new();
    for block in &basis.blocks {
        let class = compressed(block.parity, axes);
        let end = block.first + block.functions.columns;
        match runs.last_mut() {
            Some((last, run)) if *last == class => run.end = end,
            _ => runs.push((class, block.first..end)),
        }
    }
    for class in 0..1 << axes.count_ones() {
        if runs.iter().all(|(other, _)| *other != class) {
            runs.push((class, 0..0));
        }
    }
    runs
}

/// The share of a cut-off that each of the two sides of a direction may use up.
const SIDE_SHARE: f64 = 2.0;

/// The relative error of products in single precision, root mean square.
const SINGLE_ROUNDING: f64 = 4e-8;

/// The share of a cut-off that rounding may add.
const ROUNDING_SHARE: f64 = 1.0;

/// Orthonormal columns that span A = [w_o C_o …] but for a share of `cut` per matrix.
///
/// Taken from as many products of A with random vectors as A has rows, of which each has the expected
/// squared norm of A (Halko, Martinsson and Tropp, "Finding structure with randomness", SIAM Review 53,
/// 2011).
fn common_range<S: Scalar>(
    matrices: &[Matrix<S>],
    weights: &[f64],
    rows: usize,
    cut: f64,
) -> Matrix<S> {
    let mut sketch = Matrix { rows, columns: rows, data: vec![zero::<S>(); rows * rows] };
    let mut numbers = Random::default();
    for (c, &weight) in matrices.iter().zip(weights) {
        let vectors = Matrix::from_fn(c.columns, rows, |_, _| {
            S::from_real(S::Real::from_f64(weight * numbers.next()))
        });
        S::product(c, &vectors.data, true, &mut sketch.data);
    }
    let squares: f64 = weights.iter().map(|weight| weight * weight).sum();
    let cut = SIDE_SHARE * cut * (squares * rows as f64).sqrt();
    match decompose(&sketch, cut) {
        Some(Svd { u, sigma }) => {
            let rank = len_without_tail(sigma.len(), cut, |i| sigma[i] * sigma[i]);
            u.corner(u.rows, rank)
        }
        // Without a decomposition, every direction is kept.
        None => Matrix::from_fn(rows, rows, |i, j| {
            S::from_real(S::Real::from_f64(if i == j { 1.0 } else { 0.0 }))
        }),
    }
}

/// Random numbers of mean zero and variance one, always the same (Steele, Lea and Flood, "Fast
/// splittable pseudorandom number generators", OOPSLA 2014).
#[derive(Default)]
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let unit = ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64;
        12f64.sqrt() * (unit - 0.5)
    }
}

/// The singular value decomposition of all of C that exceeds a tenth of `cut`; none if it fails.
fn decompose<S: Scalar>(c: &Matrix<S>, cut: f64) -> Option<Svd<S>> {
    if c.rows == 0 || c.columns == 0 {
        return Some(Svd { u: c.clone(), sigma: Vec::new() });
    }
    // Pivoted elimination first: the decomposition proper then has few rows. The order of columns is
    // nothing to left singular vectors.
    let (q, r, _) = S::pivoted_qr(c);
    let row = |i: usize| (0..r.columns).map(|j| r.at(i, j).norm_squared()).sum::<f64>();
    let kept = len_without_tail(r.rows, 0.1 * cut, row);
    if kept == 0 {
        return Some(Svd { u: q.corner(q.rows, 0), sigma: Vec::new() });
    }
    let Svd { u, sigma } = S::svd(&r.corner(kept, r.columns))?;
    Some(Svd { u: product(&q.corner(q.rows, kept), &u), sigma })
}

/// The smallest length such that the root of the sum of the squares beyond it is at most `cut`.
fn len_without_tail(len: usize, cut: f64, squared: impl Fn(usize) -> f64) -> usize {
    let mut tail = 0.0;
    (0..len)
        .rev()
        .find(|&i| {
            tail += squared(i);
            tail > cut * cut
        })
        .map_or(0, |i| i + 1)
}

/// C = X_t G X_sᵀ: from the values of the kernel between skeletons.
fn full_matrix<S: Scalar>(
    kernel: &Formula<'_, S>,
    half_width: S::Real,
    offset: [i32; 3],
    source: &Basis<S>,
    target: &Basis<S>,
) -> Matrix<S> {
    let step = offset.map(|o| S::Real::from_f64(2.0 * f64::from(o)));
    let step = Point::<S::Real>::from_array(step);
    let (xs, ys) = (&target.skeleton.points, &source.skeleton.points);
    let rows = xs.len() * kernel.fields;
    let mut values = Matrix::from_fn(rows, ys.len() * kernel.densities, |_, _| zero::<S>());
    let mut g = vec![zero::<S>(); kernel.fields * kernel.densities];
    for (b, &y) in ys.iter().enumerate() {
        for (a, &x) in xs.iter().enumerate() {
            kernel.write((x + step) * half_width, y * half_width, &mut g);
            for (k, &entry) in g.iter().enumerate() {
                let column = k % kernel.densities * ys.len() + b;
                values.data[column * rows + k / kernel.densities * xs.len() + a] = entry;
            }
        }
    }
    let left = product(&target.skeleton.from_values, &values);
    product(&left, &source.skeleton.from_values.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interpolation::means::interaction_offsets;

    #[test]
    fn directions_part_the_interaction_list() {
        let mut members = [0; DIRECTIONS];
        interaction_offsets().for_each(|o| members[direction_of(o)] += 1);
        assert_eq!(
            (members[4], members[22], members[1], members[0], members[13]),
            (18, 18, 12, 8, 0)
        );
        assert_eq!(members.iter().sum::<i32>(), 316);
        assert_eq!(direction_of([-7, 1, 2]), direction_of([-2, 0, 9]));
    }
}
