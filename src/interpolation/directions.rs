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

use num_traits::Float;

use crate::expansion::offset_map::OffsetMap;
use crate::interpolation::bases::Bases;
use crate::interpolation::basis::{Basis, adjoint};
use crate::interpolation::budget::{ROUNDING_SHARE, SINGLE_ROUNDING};
use crate::interpolation::entries::{Entries, norm_squared, zero};
use crate::interpolation::probe::power_of_two;
use crate::interpolation::ranges::{Factors, Side};
use crate::linalg::batched::Batched;
use crate::linalg::matrix::Matrix;
use crate::numbers::traits::{Real, Scalar};
use crate::parallel;

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
    /// How many functions a source and a target have, in whatever part.
    pub(crate) functions: [usize; 2],
    /// How many coordinates y and z there are, and how many with zeros that fill up registers.
    pub(crate) ranks: [usize; 2],
    pub(crate) heights: [usize; 2],
}

/// The part of a matrix that belongs to the functions of one parity.
#[derive(Debug)]
pub(crate) struct Part<R> {
    /// The parities along the group's axes.
    pub(crate) class: usize,
    /// The first of the functions.
    pub(crate) first: usize,
    /// The first of the coordinates: those of one class across the group's directions.
    pub(crate) coordinate: usize,
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

impl<R: Scalar> Group<R> {
    /// l += P W Qᴴ m for one pair of cells and all right-hand sides.
    pub(crate) fn add_one<S: Scalar>(
        &self,
        place: Place,
        m: &[S],
        l: &mut [S],
        enter: impl Fn(S) -> R,
        leave: impl Fn(R) -> S,
    ) {
        if self.ranks.contains(&0) {
            return;
        }
        let [from_len, to_len] = self.functions;
        let count = m.len() / from_len;
        let places = |x: usize, y: usize| (0..count).map(|c| [c * x, c * y]).collect::<Vec<_>>();
        let [y_len, z_len] = self.heights;

        let mut from: Vec<R> = m.iter().map(|&m| enter(m)).collect();
        reflect(&self.collect, |part| part.matrix.columns, place, from_len, &mut from);
        let mut y = vec![zero::<R>(); count * y_len];
        for part in &self.collect {
            let y = &mut y[part.coordinate..];
            part.matrix.products(&places(from_len, y_len), true, &from[part.first..], y);
        }
        let mut z = vec![zero::<R>(); count * z_len];
        self.cores[place.core as usize].products(&places(y_len, z_len), true, &y, &mut z);
        // Zeros are added beyond the rows of a matrix, after the last right-hand side as well.
        let most = self.spread.iter().map(|part| part.matrix.height).max().unwrap_or(0);
        let mut to = vec![zero::<R>(); count * to_len + most];
        for part in &self.spread {
            let to = &mut to[part.first..];
            part.matrix.products(&places(z_len, to_len), true, &z[part.coordinate..], to);
        }
        reflect(&self.spread, |part| part.matrix.rows, place, to_len, &mut to);
        l.iter_mut().zip(to).for_each(|(l, to)| *l += leave(to));
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
    kernel: &Entries<'_, S>,
    bases: &Bases<S>,
    offsets: &[[i32; 3]],
) -> (Vec<Digits<S>>, OffsetMap<Place>) {
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
    (parallel::map(members.len(), &|g| bases.group(kernel, &members[g])), places)
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

    fn group(&self, kernel: &Entries<'_, S>, members: &[[i32; 3]]) -> Digits<S> {
        let axes = self.axes(members[0]);
        let (spread, collect, cores) = Factors::new(kernel, self, axes, members).compress();
        let size = cores.iter().map(|core| norm_squared(&core.data)).fold(0.0, f64::max).sqrt();
        let single = size_of::<S>() > size_of::<S::Single>();
        let sides = [&collect, &spread];
        if single && SINGLE_ROUNDING * size <= ROUNDING_SHARE * self.cut {
            let shrink = S::from_real(self.unit().recip());
            let cores: Vec<Matrix<S>> = cores.iter().map(|w| w.map(|w| w * shrink)).collect();
            return Digits::Single(self.in_digits(axes, sides, &cores, S::to_single));
        }
        Digits::Full(self.in_digits(axes, sides, &cores, |x| x))
    }

    /// What the W_o are divided by in single precision: then their range is that of the tolerance,
    /// however large or small the kernel is.
    pub(crate) fn unit(&self) -> S::Real {
        power_of_two(S::Real::from_f64(self.cut))
    }

    fn in_digits<R: Scalar>(
        &self,
        axes: u8,
        [q, p]: [&Side<S>; 2],
        cores: &[Matrix<S>],
        digits: impl Fn(S) -> R,
    ) -> Group<R> {
        let batched = |matrix: &Matrix<S>| Batched::new(&matrix.map(&digits));
        // What fills a part up to whole registers reaches beyond the last coordinate.
        let end = |side: &Side<S>| {
            let starts = side.classes.iter().map(|(_, coordinates)| {
                coordinates.start + Batched::<R>::height_of(coordinates.len())
            });
            Batched::<R>::height_of(starts.max().unwrap_or(0))
        };
        Group {
            axes,
            collect: self.parts(axes, q, &self.source, |q| batched(&adjoint(&q))),
            spread: self.parts(axes, p, &self.target, |p| batched(&p)),
            cores: cores.iter().map(batched).collect(),
            functions: [q.functions.rows, p.functions.rows],
            ranks: [q.functions.columns, p.functions.columns],
            heights: [end(q), end(p)],
        }
    }

    /// The parts of one side: for every class across the directions, one for each class along them, from
    /// the first coordinate to the last.
    fn parts<R>(
        &self,
        axes: u8,
        side: &Side<S>,
        basis: &Basis<S>,
        batched: impl Fn(Matrix<S>) -> Batched<R>,
    ) -> Vec<Part<R>> {
        let across = self.across(axes);
        let part = |parities: u8, coordinates: &Range<usize>, class: usize| {
            let block = basis.blocks.iter().find(|block| {
                block.parity & across == parities && compressed(block.parity, axes) == class
            });
            // There are sums for every class along the directions, if only of nothing.
            let functions = block.map_or(0..0, |block| block.range());
            let matrix = Matrix::from_fn(functions.len(), coordinates.len(), |i, j| {
                side.functions.at(functions.start + i, coordinates.start + j)
            });
            let (first, coordinate) = (functions.start, coordinates.start);
            Part { class, first, coordinate, matrix: batched(matrix) }
        };
        let mut parts = Vec::new();
        for (parities, coordinates) in &side.classes {
            if !coordinates.is_empty() {
                let classes = 0..1 << axes.count_ones();
                parts.extend(classes.map(|class| part(*parities, coordinates, class)));
            }
        }
        parts
    }
}

/// Gives the functions of each part the sign that a member's reflection gives them.
fn reflect<R: Scalar>(
    parts: &[Part<R>],
    functions: fn(&Part<R>) -> usize,
    place: Place,
    len: usize,
    expansions: &mut [R],
) {
    for part in parts {
        if (part.class & usize::from(place.member)).count_ones() % 2 == 1 {
            for expansion in expansions.chunks_exact_mut(len) {
                let own = &mut expansion[part.first..][..functions(part)];
                own.iter_mut().for_each(|term| *term = -*term);
            }
        }
    }
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
