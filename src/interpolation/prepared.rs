//! What a plan needs of a kernel, once the levels and offsets are known.

use std::sync::Arc;

use num_traits::Float;

use crate::error::Error;
use crate::expansion::admissibility::Admissibility;
use crate::expansion::geometry::{Geometry, Level};
use crate::expansion::weights::Weights;
use crate::interpolation::accuracy::Accuracy;
use crate::interpolation::carried::Carried;
use crate::interpolation::entries::Entries;
use crate::interpolation::everywhere::Everywhere;
use crate::interpolation::kept::{Former, kept_unit};
use crate::interpolation::known::Identity;
use crate::interpolation::left_out::leave_out;
use crate::interpolation::level::LevelOperators;
use crate::interpolation::means::INTERACTION_OFFSETS;
use crate::interpolation::operators::{Operators, Sizes, afford_any};
use crate::interpolation::order::{Refusal, Restriction, smooth_share};
use crate::interpolation::probe;
use crate::interpolation::reuse;
use crate::interpolation::scale::{Scale, Served, factor, level_weights, lighter};
use crate::interpolation::store::OperatorStore;
use crate::interpolation::transfer::Transfers;
use crate::interpolation::tuning::{EXTENDED_BYTES, SAMPLED_REACH, SLOPE_ROUNDING, SMOOTH_SHARE};
use crate::linalg::matrix::Matrix;
use crate::numbers::compiled::Compiled;
use crate::numbers::traits::{Numbers, Real, Scalar};
use crate::parallel;

/// Operators, as far as they can be prepared.
pub(crate) enum Prepared<S: Scalar> {
    /// For kernels that look different from place to place: all polynomials, and the kernel itself
    /// between their nodes.
    Everywhere(Box<Everywhere<S>>),
    /// For translation-invariant kernels.
    Invariant(Box<Invariant<S>>),
}

/// The operators of a translation-invariant kernel, and where they belong in a tree.
pub(crate) struct Invariant<S: Scalar> {
    pub(crate) operators: Arc<Operators<S>>,
    first_level: usize,
    /// K(s x, s y) = s^degree K(x, y)
    degree: Option<f64>,
    /// What the operators' kernel is to be multiplied by.
    unit: S::Real,
    /// Where masks ask for more offsets than an unmasked tree: the transfers of that entry of
    /// `operators.levels`.
    extended: Vec<Option<Arc<Transfers<S>>>>,
    /// What errors of a pair's values and derivatives are relative to, level by level.
    pair_sizes: Vec<[f64; 2]>,
    /// What the operators were made for.
    sizes: Sizes<S::Real>,
    /// For how many levels operators were built, rather than kept or found in a store.
    pub(crate) built: usize,
}

/// S_to A S_from: a matrix with signs on its columns and rows.
pub(crate) struct Shift<'a, S: Scalar> {
    pub(crate) matrix: &'a Matrix<S>,
    /// Tells matrices of one level apart.
    pub(crate) index: usize,
    /// The diagonals of S_from and S_to.
    pub(crate) signs: [&'a [S::Real]; 2],
}

/// [`Prepared::new`].
type New<S> = fn(
    (&OperatorStore, Identity),
    &Entries<'_, S>,
    Option<&Entries<'_, S>>,
    Accuracy,
    &Geometry<<S as Numbers>::Real>,
    Option<&Prepared<S>>,
) -> Result<(Prepared<S>, Admissibility), Error>;
static NEW: Compiled<New<f32>, New<f64>> = Compiled(Prepared::compiled, Prepared::compiled);

impl<S: Scalar> Prepared<S> {
    /// For the pairs of cells that are carried so far; or which of them can be, if those are fewer.
    pub(crate) fn new(
        stored: (&OperatorStore, Identity),
        kernel: &Entries<'_, S>,
        slopes: Option<&Entries<'_, S>>,
        accuracy: Accuracy,
        geometry: &Geometry<S::Real>,
        former: Option<&Self>,
    ) -> Result<(Self, Admissibility), Error> {
        let new = if const { S::COMPLEX } { Self::compiled } else { NEW.of::<New<S>>() };
        new(stored, kernel, slopes, accuracy, geometry, former)
    }

    fn compiled(
        (store, identity): (&OperatorStore, Identity),
        kernel: &Entries<'_, S>,
        slopes: Option<&Entries<'_, S>>,
        accuracy: Accuracy,
        geometry: &Geometry<S::Real>,
        former: Option<&Self>,
    ) -> Result<(Self, Admissibility), Error> {
        let before = &geometry.admissibility;
        let unprepared = || {
            let everywhere = Everywhere::with_order(1, kernel.fields, kernel.densities);
            Self::Everywhere(Box::new(everywhere))
        };
        if geometry.levels.is_empty() {
            return Ok((unprepared(), before.clone()));
        }
        if !probe::translation_invariant(kernel, &geometry.root) {
            let everywhere = Everywhere::new(kernel, slopes, accuracy, geometry)?;
            return Ok((Self::Everywhere(Box::new(everywhere)), before.clone()));
        }
        let former = match former {
            Some(Self::Invariant(former)) => Some(&**former),
            _ => None,
        };
        match Invariant::new((store, identity), kernel, slopes, accuracy, geometry, former) {
            Ok(invariant) => Ok((Self::Invariant(Box::new(invariant)), before.clone())),
            Err(Refusal::Error(error)) => Err(error),
            Err(Refusal::Restricted(restriction)) => {
                let reflected = |index: usize| {
                    // One set may serve all levels.
                    let is_own = restriction.offsets.len() == geometry.levels.len();
                    let of_all = || probe::reference(geometry.root.half_width());
                    let h = if is_own { geometry.levels[index].half_width } else { of_all() };
                    probe::parities(kernel, h).is_some()
                };
                Ok((unprepared(), restriction.of(before, &geometry.levels, reflected)))
            }
        }
    }
}

impl<S: Scalar> Invariant<S> {
    fn new(
        (store, identity): (&OperatorStore, Identity),
        kernel: &Entries<'_, S>,
        slopes: Option<&Entries<'_, S>>,
        accuracy: Accuracy,
        geometry: &Geometry<S::Real>,
        former: Option<&Self>,
    ) -> Result<Self, Refusal> {
        let levels = || geometry.levels.iter().map(|level| level.half_width);
        let degree = probe::homogeneity(kernel, geometry.root.half_width(), levels());
        let one = S::Real::from_f64(1.0);
        let (length, half_widths) = match degree {
            Some(_) => (probe::reference(geometry.root.half_width()), vec![one]),
            None => (one, levels().collect()),
        };
        // G(x, y) = length^−α G(length x, length y): a homogeneous kernel is asked within the root too, wherever
        // it says it is. Derivatives are those with respect to x in this unit.
        let of_length = |degree: Option<f64>| {
            S::Real::from_f64(degree.map_or(1.0, |degree| length.as_f64().powf(-degree)))
        };
        let kernel = &kernel.in_lengths_of(length).times(of_length(degree));
        let of_slopes = of_length(degree.map(|degree| degree - 1.0));
        let slopes = slopes.map(|slopes| slopes.in_lengths_of(length).times(of_slopes));
        let unit = probe::unit(kernel, half_widths.iter().copied());
        let unit = former.map_or(unit, |former| kept_unit(former.unit, unit));
        let former = former.filter(|former| former.unit == unit && former.degree == degree);
        // A kernel with a scale of its own is asked for distances within the root only: it may know no others.
        // It is asked for all of these: it may grow.
        let edge = 2.0 * geometry.root.half_width().as_f64();
        let reach = |h: &S::Real| match degree {
            Some(_) => SAMPLED_REACH,
            None => edge / h.as_f64() - 1.0,
        };
        let reaches: Vec<f64> = half_widths.iter().map(reach).collect();
        let kernel = &kernel.times(unit.recip());
        let slopes = slopes.as_ref().map(|slopes| slopes.times(unit.recip()));
        let slopes = slopes.as_ref();
        let mut sizes = Sizes {
            half_widths,
            homogeneous: degree.is_some(),
            reaches,
            scales: Vec::new(),
            slope_scales: Vec::new(),
            weights: Vec::new(),
            carried: Carried::of_levels(
                &geometry.admissibility,
                &geometry.levels,
                degree.is_some(),
            ),
        };
        let unit_size = unit.as_f64();
        let weights = kernel.weights();
        let own = geometry.levels.iter().map(|level| weights.and(&level_weights(level)));
        sizes.weights = if degree.is_some() { vec![weights.clone()] } else { own.collect() };
        if let (Accuracy::Tolerance(tolerance), None, true) =
            (accuracy, degree, geometry.admissibility.is_whole())
        {
            leave_out(kernel, slopes, unit_size, tolerance, &geometry.levels)?;
        }
        if former.is_none() {
            afford_any(kernel, accuracy, sizes.half_widths.len())?;
        }
        type Scales = (Scale, Option<Scale>);
        let of_level = |index: usize| -> Result<Scales, Refusal> {
            // One set of operators serves all levels, or one.
            let own = if sizes.homogeneous { 0..geometry.levels.len() } else { index..index + 1 };
            let far = sizes.offsets(index);
            let scale = |entries: &Entries<'_, S>, derivatives: bool| {
                let model = far.size(entries);
                if !model.least().is_finite() {
                    let mut offsets =
                        vec![vec![false; INTERACTION_OFFSETS]; sizes.half_widths.len()];
                    offsets[index] = far.not_finite(entries);
                    let share = smooth_share(std::slice::from_ref(&far), &offsets[index..]);
                    let some = share >= SMOOTH_SHARE;
                    let error = Error::NonFiniteKernel.into();
                    return Err(if some { Restriction::split(offsets) } else { error });
                }
                let levels = geometry.levels[own.clone()].iter();
                let served =
                    levels.filter_map(|level| Served::new(level, degree, unit_size, derivatives));
                Ok(Scale::new(model, served))
            };
            let weights = &sizes.weights[index];
            let own = scale(&kernel.weighted_by(weights), false)?;
            let of_slopes = |slopes: &Entries<'_, S>| {
                scale(&slopes.weighted_by(weights).times(far.half_width()), true)
            };
            Ok((own, slopes.map(of_slopes).transpose()?))
        };
        for scales in parallel::map(sizes.half_widths.len(), &of_level) {
            let (own, of_slopes) = scales?;
            sizes.scales.push(own);
            sizes.slope_scales.extend(of_slopes);
        }
        if let (Accuracy::Tolerance(requested), Some(_)) = (accuracy, slopes) {
            let reachable = slope_floor(&geometry.levels);
            if reachable > requested {
                return Err(Error::UnreachableTolerance { requested, reachable }.into());
            }
        }
        let stored = (store, identity);
        let kept = former.map(|own| Former { operators: &own.operators, sizes: &own.sizes });
        let (operators, built) =
            reuse::operators(stored, kernel, slopes, accuracy, &mut sizes, kept)?;
        let first_level = geometry.levels.first().map_or(0, |level| level.level);
        let extended = operators.levels.iter().map(|_| None).collect();
        // The tolerance is divided among levels of their own.
        let share = (operators.levels.len() as f64).sqrt().recip();
        let pair_sizes = |(index, level): (usize, &Level<S::Real>)| {
            let h = level.half_width.as_f64();
            let factor = share * unit_size * factor(degree, h);
            let index = index.min(operators.levels.len() - 1);
            let size =
                |scales: &[Scale]| scales.get(index).map_or(0.0, |scale| factor * scale.size);
            let lighter = if degree.is_some() { 1.0 } else { lighter(level) };
            [size(&sizes.scales) / lighter, size(&sizes.slope_scales) / h]
        };
        let pair_sizes = geometry.levels.iter().enumerate().map(pair_sizes).collect();
        let mut prepared =
            Self { operators, first_level, degree, unit, extended, pair_sizes, sizes, built };
        prepared.extend(kernel, geometry, former);
        Ok(prepared)
    }

    /// Builds M2L operators for the offsets that only masks ask for, unless there were such before.
    fn extend(
        &mut self,
        kernel: &Entries<'_, S>,
        geometry: &Geometry<S::Real>,
        former: Option<&Self>,
    ) {
        let mut bytes_left = EXTENDED_BYTES;
        for (index, level) in self.operators.levels.iter().enumerate() {
            let kernel = &kernel.weighted_by(&self.sizes.weights[index]);
            let mut offsets = match self.degree {
                Some(_) => geometry.all_offsets(),
                None => geometry.levels.get(index).map_or(vec![], |level| level.offsets.clone()),
            };
            offsets.retain(|offset| offset.iter().any(|o| o.abs() > 3));
            // Reflections of an offset share its core.
            let image = |offset: &[i32; 3]| {
                if level.bases.reflected { offset.map(i32::abs) } else { *offset }
            };
            let mut images: Vec<[i32; 3]> = offsets.iter().map(image).collect();
            images.sort_unstable_by_key(|&image| (distance_squared(image), image));
            images.dedup();
            let core = level.transfers.numbering.mean_rank().powi(2) * size_of::<S>() as f64;
            let bytes = (core as usize).max(1);
            let beyond = images.get(bytes_left / bytes).map(|&image| distance_squared(image));
            offsets.retain(|&o| beyond.is_none_or(|beyond| distance_squared(o) < beyond));
            if !offsets.is_empty() {
                bytes_left -= bytes_left.min(images.len() * bytes);
                offsets.extend(level.transfers.offsets());
                let known = former.and_then(|former| former.extended_for(level, &offsets));
                let new = || Arc::new(Transfers::new(kernel, &level.bases, &offsets));
                self.extended[index] = Some(known.unwrap_or_else(new));
            }
        }
    }

    /// Transfers between cells with these operators, if there are any for all of these offsets.
    fn extended_for(
        &self,
        level: &Arc<LevelOperators<S>>,
        offsets: &[[i32; 3]],
    ) -> Option<Arc<Transfers<S>>> {
        let index = self.operators.levels.iter().position(|own| Arc::ptr_eq(own, level))?;
        let known = self.extended[index].as_ref()?;
        let is_known = |offset: &[i32; 3]| known.offsets().binary_search(offset).is_ok();
        offsets.iter().all(is_known).then(|| Arc::clone(known))
    }

    /// What errors of a pair at `level` are relative to: those of values, and of derivatives.
    pub(crate) fn pair_sizes(&self, level: usize) -> [f64; 2] {
        let own = level.checked_sub(self.first_level).and_then(|index| self.pair_sizes.get(index));
        own.copied().unwrap_or_default()
    }

    pub(crate) fn level(&self, level: usize) -> &LevelOperators<S> {
        &self.operators.levels[self.index(level)]
    }

    /// The M2L operators at `level` and the factor to take them by.
    pub(crate) fn transfers(&self, level: usize, half_width: S::Real) -> (&Transfers<S>, S::Real) {
        let operators = self.level(level);
        let transfers = self.extended[self.index(level)].as_deref();
        let scale = match self.degree {
            Some(degree) => half_width.as_f64().powf(degree),
            None => 1.0,
        };
        let scale = S::Real::from_f64(scale * self.unit.as_f64());
        (transfers.unwrap_or(&operators.transfers), scale)
    }

    /// M2M, or L2L if `down`, between a cell of `level` and its child in an octant.
    pub(crate) fn shift(&self, level: usize, octant: usize, down: bool) -> Shift<'_, S> {
        let index = self.index(level).min(self.operators.shifts.len() - 1);
        let shifts = &self.operators.shifts[index];
        let matrices = if down { &shifts.l2l } else { &shifts.m2m };
        let (index, reflection) = if matrices.len() == 1 { (0, octant) } else { (octant, 0) };
        let (parent, child) = (self.level(level), self.level(level + 1));
        let (from, to) = if down {
            (&parent.bases.target, &child.bases.target)
        } else {
            (&child.bases.source, &parent.bases.source)
        };
        let signs = [&from.signs[reflection][..], &to.signs[reflection]];
        Shift { matrix: &matrices[index], index, signs }
    }

    /// What expansions of a level are of.
    pub(crate) fn weights(&self, level: usize) -> &Weights {
        &self.sizes.weights[self.index(level)]
    }

    fn index(&self, level: usize) -> usize {
        level.saturating_sub(self.first_level).min(self.operators.levels.len() - 1)
    }
}

/// What rounding leaves of derivatives: a value that comes from coarser levels is rounded, and differs by little
/// within a small cell. It is about ε n |G| / h for values G that pass through cells of half-width h.
fn slope_floor<T: Real>(levels: &[Level<T>]) -> f64 {
    let (mut largest, mut floor) = (0.0f64, 0.0f64);
    for level in levels {
        if let (Some(values), Some(slopes)) = (level.values, level.slopes) {
            let slope =
                SLOPE_ROUNDING * T::epsilon().as_f64() * largest / level.half_width.as_f64();
            floor = floor.max(slope / slopes.through);
            largest = largest.max(values.pair);
        }
    }
    floor
}

/// |o|²
fn distance_squared(offset: [i32; 3]) -> i64 {
    offset.iter().map(|&o| i64::from(o) * i64::from(o)).sum()
}
