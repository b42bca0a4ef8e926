//! Operators as bytes, every number to its last bit.

use std::sync::Arc;

use crate::expansion::offset_map::OffsetMap;
use crate::interpolation::bases::Bases;
use crate::interpolation::basis::{Basis, Block, Skeleton};
use crate::interpolation::chebyshev::Chebyshev;
use crate::interpolation::directions::{Digits, Group, Part, Place};
use crate::interpolation::lanes::Padded;
use crate::interpolation::level::LevelOperators;
use crate::interpolation::numbering::Numbering;
use crate::interpolation::operators::{Operators, Shifts};
use crate::interpolation::transfer::Transfers;
use crate::interpolation::tuning::MAX_ORDER;
use crate::linalg::batched::Batched;
use crate::linalg::matrix::Matrix;
use crate::numbers::traits::{Point, Real, Scalar, Vector};

/// Whoever receives the bytes.
pub(crate) type Sink<'a> = dyn FnMut(&[u8]) + 'a;

/// What can be written as bytes and read again.
pub(crate) trait Stored: Sized {
    fn store(&self, to: &mut Sink<'_>);

    /// What the first of the bytes stand for, which are taken off; none if they stand for nothing.
    fn restore(from: &mut &[u8]) -> Option<Self>;
}

/// How many bytes something takes.
pub(crate) fn length(what: &impl Stored) -> usize {
    let mut length = 0;
    what.store(&mut |bytes| length += bytes.len());
    length
}

/// The first `N` of the bytes, which are taken off.
fn taken<const N: usize>(from: &mut &[u8]) -> Option<[u8; N]> {
    let (first, rest) = from.split_first_chunk()?;
    *from = rest;
    Some(*first)
}

impl Stored for u8 {
    fn store(&self, to: &mut Sink<'_>) {
        to(&[*self]);
    }

    fn restore(from: &mut &[u8]) -> Option<Self> {
        taken::<1>(from).map(|[byte]| byte)
    }
}

impl Stored for bool {
    fn store(&self, to: &mut Sink<'_>) {
        u8::from(*self).store(to);
    }

    fn restore(from: &mut &[u8]) -> Option<Self> {
        match u8::restore(from)? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }
}

macro_rules! integers {
    ($($t:ty),*) => {$(
        impl Stored for $t {
            fn store(&self, to: &mut Sink<'_>) {
                to(&(*self as u64).to_le_bytes());
            }

            fn restore(from: &mut &[u8]) -> Option<Self> {
                let number = u64::from_le_bytes(taken(from)?);
                let found = number as $t;
                (found as u64 == number).then_some(found)
            }
        }
    )*};
}

integers!(u32, i32, u64, usize);

impl<S: Scalar> Stored for S {
    fn store(&self, to: &mut Sink<'_>) {
        for part in &self.parts()[..S::PARTS] {
            match size_of::<S::Real>() {
                4 => to(&(part.as_f64() as f32).to_le_bytes()),
                _ => to(&part.as_f64().to_le_bytes()),
            }
        }
    }

    fn restore(from: &mut &[u8]) -> Option<Self> {
        let mut part = || {
            let number = match size_of::<S::Real>() {
                4 => f32::from_le_bytes(taken(from)?).into(),
                _ => f64::from_le_bytes(taken(from)?),
            };
            Some(S::Real::from_f64(number))
        };
        let re = part()?;
        let im = if S::COMPLEX { part()? } else { S::Real::from_f64(0.0) };
        Some(S::from_parts(re, im))
    }
}

impl<A: Stored> Stored for Vec<A> {
    fn store(&self, to: &mut Sink<'_>) {
        self.len().store(to);
        self.iter().for_each(|one| one.store(to));
    }

    fn restore(from: &mut &[u8]) -> Option<Self> {
        let len = usize::restore(from)?;
        // Each takes a byte at least: a length that is wrong takes no memory.
        if len > from.len() {
            return None;
        }
        (0..len).map(|_| A::restore(from)).collect()
    }
}

impl<A: Stored> Stored for Arc<A> {
    fn store(&self, to: &mut Sink<'_>) {
        (**self).store(to);
    }

    fn restore(from: &mut &[u8]) -> Option<Self> {
        A::restore(from).map(Self::new)
    }
}

impl<A: Stored, const N: usize> Stored for [A; N] {
    fn store(&self, to: &mut Sink<'_>) {
        self.iter().for_each(|one| one.store(to));
    }

    fn restore(from: &mut &[u8]) -> Option<Self> {
        let all: Option<Vec<A>> = (0..N).map(|_| A::restore(from)).collect();
        all?.try_into().ok()
    }
}

/// Structures of scalars, field after field.
macro_rules! fields {
    ($($structure:ident { $($field:ident),* })*) => {$(
        impl<S: Scalar> Stored for $structure<S> {
            fn store(&self, to: &mut Sink<'_>) {
                $(self.$field.store(to);)*
            }

            fn restore(from: &mut &[u8]) -> Option<Self> {
                Some(Self { $($field: Stored::restore(from)?),* })
            }
        }
    )*};
}

fields! {
    Matrix { rows, columns, data }
    Batched { rows, columns, height, entries }
    Padded { rows, columns, registers }
    Block { parity, places, first, functions, transposed }
    Basis { functions, signs, blocks, skeleton }
    Part { class, first, coordinate, matrix }
    Group { axes, collect, spread, cores, functions, ranks, heights }
    Shifts { m2m, l2l }
    LevelOperators { bases, transfers, error }
}

impl<S: Scalar> Stored for Skeleton<S> {
    fn store(&self, to: &mut Sink<'_>) {
        let points: Vec<[S::Real; 3]> = self.points.iter().map(|x| x.to_array()).collect();
        points.store(to);
        self.from_values.store(to);
    }

    fn restore(from: &mut &[u8]) -> Option<Self> {
        let points = Vec::restore(from)?.into_iter().map(Point::<S::Real>::from_array).collect();
        Some(Self { points, from_values: Stored::restore(from)? })
    }
}

impl<S: Scalar> Stored for Bases<S> {
    fn store(&self, to: &mut Sink<'_>) {
        self.half_width.store(to);
        self.target.store(to);
        let is_own = !Arc::ptr_eq(&self.source, &self.target);
        is_own.store(to);
        if is_own {
            self.source.store(to);
        }
        self.reflected.store(to);
        self.cut.store(to);
    }

    fn restore(from: &mut &[u8]) -> Option<Self> {
        let half_width = Stored::restore(from)?;
        let target = Arc::new(Basis::restore(from)?);
        let is_own = bool::restore(from)?;
        let source = if is_own { Arc::new(Basis::restore(from)?) } else { Arc::clone(&target) };
        let (reflected, cut) = (bool::restore(from)?, f64::restore(from)?);
        Some(Self { half_width, source, target, reflected, cut })
    }
}

impl<S: Scalar> Stored for Digits<S> {
    fn store(&self, to: &mut Sink<'_>) {
        matches!(self, Self::Full(_)).store(to);
        match self {
            Self::Full(group) => group.store(to),
            Self::Single(group) => group.store(to),
        }
    }

    fn restore(from: &mut &[u8]) -> Option<Self> {
        let is_full = bool::restore(from)?;
        let group = if is_full {
            Self::Full(Stored::restore(from)?)
        } else {
            Self::Single(Stored::restore(from)?)
        };
        Some(group)
    }
}

impl Stored for Place {
    fn store(&self, to: &mut Sink<'_>) {
        let Self { group, member, core } = self;
        [*group, *member].store(to);
        core.store(to);
    }

    fn restore(from: &mut &[u8]) -> Option<Self> {
        let [group, member] = Stored::restore(from)?;
        Some(Self { group, member, core: Stored::restore(from)? })
    }
}

impl<S: Scalar> Stored for Transfers<S> {
    fn store(&self, to: &mut Sink<'_>) {
        let Numbering { groups, places, .. } = &self.numbering;
        groups.store(to);
        places.offsets().to_vec().store(to);
        places.values().to_vec().store(to);
        self.unit.store(to);
    }

    fn restore(from: &mut &[u8]) -> Option<Self> {
        let groups = Vec::<Digits<S>>::restore(from)?;
        let offsets = Vec::<[i32; 3]>::restore(from)?;
        let places = Vec::<Place>::restore(from)?;
        let is_ascending = offsets.windows(2).all(|pair| pair[0] < pair[1]);
        if !is_ascending || places.len() != offsets.len() {
            return None;
        }
        let place = |offset| places[offsets.binary_search(&offset).unwrap_or_default()];
        let places = OffsetMap::build(&offsets, place);
        Some(Self::of(groups, places, Stored::restore(from)?))
    }
}

impl<S: Scalar> Stored for Operators<S> {
    fn store(&self, to: &mut Sink<'_>) {
        self.rule.len().store(to);
        self.error.store(to);
        self.levels.store(to);
        self.shifts.store(to);
    }

    fn restore(from: &mut &[u8]) -> Option<Self> {
        let order = usize::restore(from)?;
        if !(1..=MAX_ORDER).contains(&order) {
            return None;
        }
        let (rule, error) = (Chebyshev::new(order), f64::restore(from)?);
        Some(Self { rule, error, levels: Stored::restore(from)?, shifts: Stored::restore(from)? })
    }
}
