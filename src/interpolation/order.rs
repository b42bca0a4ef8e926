//! How many nodes per axis a tolerance needs, and what is not smooth enough for any number of them.

use crate::error::Error;
use crate::expansion::admissibility::Admissibility;
use crate::expansion::geometry::Level;
use crate::interpolation::budget::{INTERPOLATION_SHARE, LIMITING_SHARE};
use crate::interpolation::carried::number;
use crate::interpolation::chebyshev::Chebyshev;
use crate::interpolation::far_field::FarField;
use crate::interpolation::means::{interaction_offsets, largest, weight};
use crate::interpolation::offset_errors::OffsetErrors;
use crate::interpolation::tuning::{
    CONVERGING, MAX_ORDER, SMOOTH_SHARE, UNEVEN_SHARE, WORTH_A_NODE,
};
use crate::kernel::mask::Coverage;
use crate::numbers::traits::Real;

/// Why there are no operators.
#[derive(Debug)]
pub(crate) enum Refusal {
    /// There can be none.
    Error(Error),
    /// Not for all offsets.
    Restricted(Restriction),
}

/// Offsets that are not to be carried.
#[derive(Debug)]
pub(crate) struct Restriction {
    /// What is done for them.
    pub(crate) coverage: Coverage,
    /// Whether an offset is one of them, for each of the [`interaction_offsets`], level by level.
    pub(crate) offsets: Vec<Vec<bool>>,
}

impl Restriction {
    /// Splits the cells where there is no smooth kernel.
    pub(crate) fn split(offsets: Vec<Vec<bool>>) -> Refusal {
        Refusal::Restricted(Self { coverage: Coverage::Partial, offsets })
    }

    /// What `before` becomes for some levels. Offsets that are images of each other are treated alike, since they
    /// share operators.
    pub(crate) fn of<T: Real>(
        &self,
        before: &Admissibility,
        levels: &[Level<T>],
        reflected: impl Fn(usize) -> bool,
    ) -> Admissibility {
        let mut all = before.clone();
        for (index, level) in levels.iter().enumerate() {
            // One set may serve all levels.
            let index = index.min(self.offsets.len() - 1);
            let own = &self.offsets[index];
            let reflected = reflected(index);
            let own = || interaction_offsets().zip(own).filter(|(_, own)| **own).map(|(o, _)| o);
            let mut is_one = [false; 343];
            own().for_each(|offset| is_one[number(offset)] = true);
            for offset in own() {
                let images = images(offset, reflected);
                if self.coverage == Coverage::Partial || images.iter().all(|&o| is_one[number(o)]) {
                    images.into_iter().for_each(|image| all.set(level.level, image, self.coverage));
                }
            }
        }
        all
    }
}

/// An offset and those that share its operators: the opposite one, or all reflections.
fn images(offset: [i32; 3], reflected: bool) -> Vec<[i32; 3]> {
    let signs = |k: usize| [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { 1 } else { -1 });
    let image = |k: usize| {
        let signs = signs(k);
        [0, 1, 2].map(|axis| signs[axis] * offset[axis])
    };
    if reflected { (0..8).map(image).collect() } else { vec![image(0), image(7)] }
}

impl From<Error> for Refusal {
    fn from(error: Error) -> Self {
        Self::Error(error)
    }
}

/// The rule with the fewest nodes whose error is the share of the tolerance that interpolation may use.
pub(crate) fn fewest_nodes<T: Real>(
    requested: f64,
    afford: impl Fn(usize) -> Result<(), Error>,
    error: impl Fn(&Chebyshev<T>) -> f64,
) -> Result<Chebyshev<T>, Error> {
    let mut reachable = f64::INFINITY;
    for n in 1..=MAX_ORDER {
        afford(n)?;
        let rule = Chebyshev::new(n);
        let needed = error(&rule) / INTERPOLATION_SHARE;
        reachable = reachable.min(needed);
        if needed <= requested {
            return Ok(rule);
        }
    }
    Err(Error::UnreachableTolerance { requested, reachable })
}

/// The same for the far fields of some levels, of which some offsets may be in the way: `closer` then looks at each of
/// them more closely, level by level.
pub(crate) fn order_of<T: Real>(
    requested: f64,
    fields: &[FarField<T>],
    afford: impl Fn(usize) -> Result<(), Error>,
    errors: impl Fn(&Chebyshev<T>) -> Vec<OffsetErrors>,
    closer: impl Fn(&Chebyshev<T>) -> Result<Vec<Vec<f64>>, Error>,
) -> Result<usize, Refusal> {
    let tried = std::cell::RefCell::new(Vec::new());
    let rule = fewest_nodes(requested, afford, |rule| {
        let errors = errors(rule);
        let mean = largest(errors.iter().map(|level| level.mean));
        tried.borrow_mut().push(errors);
        mean
    });
    let most = INTERPOLATION_SHARE * requested;
    let tried = tried.into_inner();
    let (n, mut failing) = match rule {
        Ok(rule) => {
            let slow = slow_offsets(&tried, most);
            if !slow.iter().flatten().any(|&is_slow| is_slow) {
                return Ok(rule.len());
            }
            (rule.len(), slow)
        }
        Err(refusal) => smooth_offsets(fields, &tried, most).ok_or(refusal)?,
    };
    // What is in the way somewhere may be so at other offsets and have been missed.
    for (failing, closer) in failing.iter_mut().zip(closer(&Chebyshev::new(n))?) {
        failing.iter_mut().zip(closer).for_each(|(fails, error)| *fails |= is_off(error, most));
    }
    Err(Restriction::split(failing))
}

/// Which offsets are in the way though their errors are small enough by now: if the last node more took the whole error
/// down by less than it does where a kernel is smooth, those where it did so. Bases that are found from samples don't
/// hold what other sources send there.
fn slow_offsets(tried: &[Vec<OffsetErrors>], most: f64) -> Vec<Vec<bool>> {
    let [.., before, last] = tried else { return Vec::new() };
    let mean = |errors: &[OffsetErrors]| largest(errors.iter().map(|level| level.mean));
    if mean(last) <= CONVERGING * mean(before) {
        return Vec::new();
    }
    let is_slow = |(before, last): (&f64, &f64)| {
        is_off(*last, (CONVERGING * before).max(LIMITING_SHARE * most))
    };
    let of_level = |(before, last): (&OffsetErrors, &OffsetErrors)| {
        before.each.iter().zip(&last.each).map(is_slow).collect()
    };
    before.iter().zip(last).map(of_level).collect()
}

/// With how many nodes most offsets are smooth that ever are, and which then are not, if those are few enough to be
/// known and enough to be worth it.
fn smooth_offsets<T: Real>(
    fields: &[FarField<T>],
    tried: &[Vec<OffsetErrors>],
    most: f64,
) -> Option<(usize, Vec<Vec<bool>>)> {
    let failing =
        |errors: &Vec<OffsetErrors>| failing(errors.iter().map(|level| &level.each[..]), most);
    let smooth = |errors: &Vec<OffsetErrors>| smooth_share(fields, &failing(errors));
    let last = tried.last().map(smooth).filter(|&share| share >= SMOOTH_SHARE)?;
    // More nodes are not worth it for a few offsets more.
    let n = tried.iter().position(|errors| smooth(errors) >= WORTH_A_NODE * last)?;
    let failing = failing(&tried[n]);
    (smooth_share(fields, &failing) <= 1.0 - UNEVEN_SHARE).then_some((n + 1, failing))
}

/// Which offsets of each level have larger errors than `most`, or none that is a number.
fn failing<'a>(errors: impl Iterator<Item = &'a [f64]>, most: f64) -> Vec<Vec<bool>> {
    errors.map(|level| level.iter().map(|&error| is_off(error, most)).collect()).collect()
}

/// Whether an error is larger than `most`, or no number.
fn is_off(error: f64, most: f64) -> bool {
    error > most || error.is_nan()
}

/// The share of what is carried that does not fail.
pub(crate) fn smooth_share<T: Real>(fields: &[FarField<T>], failing: &[Vec<bool>]) -> f64 {
    let (mut smooth, mut all) = (0.0, 0.0);
    for (far, failing) in fields.iter().zip(failing) {
        for (offset, &fails) in interaction_offsets().zip(failing) {
            if far.carried().has(offset) {
                all += weight(offset);
                smooth += if fails { 0.0 } else { weight(offset) };
            }
        }
    }
    if all > 0.0 { smooth / all } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interpolation::carried::Carried;

    /// What there is for a tolerance of 1e-3 if the offsets in the way never converge, others after four nodes.
    fn order(in_the_way: fn([i32; 3]) -> bool, seen_closer: [i32; 3]) -> Result<usize, Refusal> {
        order_with(in_the_way, |_| 1.0, seen_closer)
    }

    /// The same with what the errors are with so many nodes at the offsets in the way.
    fn order_with(
        in_the_way: fn([i32; 3]) -> bool,
        there: fn(f64) -> f64,
        seen_closer: [i32; 3],
    ) -> Result<usize, Refusal> {
        let fields = [FarField::new(0.5, 8.0, 1, Carried::default())];
        let errors = |rule: &Chebyshev<f64>| {
            let n = rule.len() as f64;
            let [smooth, there] = [0.1f64.powf(n), there(n)];
            let each = interaction_offsets().map(|o| if in_the_way(o) { there } else { smooth });
            let each: Vec<f64> = each.collect();
            vec![OffsetErrors { mean: largest(each.iter().copied()), each }]
        };
        let closer = |_: &Chebyshev<f64>| {
            let error = |o| if o == seen_closer { 1.0 } else { 0.0 };
            Ok(vec![interaction_offsets().map(error).collect()])
        };
        order_of(1e-3, &fields, |_| Ok(()), errors, closer)
    }

    #[test]
    fn only_what_is_in_the_way_is_split() {
        assert_eq!(order(|_| false, [0; 3]).unwrap(), 4);
        let Err(Refusal::Restricted(plane)) = order(|o| o[0] == 0, [3, 1, 2]) else { panic!() };
        let expected: Vec<bool> =
            interaction_offsets().map(|o| o[0] == 0 || o == [3, 1, 2]).collect();
        assert_eq!((plane.coverage, &plane.offsets), (Coverage::Partial, &vec![expected]));
        let levels = [Level::new(2, 0.25f64, Vec::new())];
        let split = plane.of(&Admissibility::default(), &levels, |_| false);
        assert_eq!(split.of(2, [-3, -1, -2]), Coverage::Partial, "it shares operators");
        assert_eq!(split.of(2, [-3, 1, 2]), Coverage::Full);
    }

    #[test]
    fn what_converges_slowly_is_in_the_way() {
        let plane = |o: [i32; 3]| o[0] == 0;
        // Nine nodes are within a quarter of the tolerance, and take errors down to four fifths of what eight do.
        let kink = order_with(plane, |n| 2e-2 / (n * n), [3, 1, 2]);
        let Err(Refusal::Restricted(kink)) = kink else { panic!("{kink:?}") };
        let expected = interaction_offsets().map(|o| plane(o) || o == [3, 1, 2]);
        assert_eq!(kink.offsets, vec![expected.collect::<Vec<bool>>()]);
        // What falls by a factor, or is small from the first, is not.
        assert_eq!(order_with(plane, |n| 0.5f64.powf(n), [0; 3]).unwrap(), 12);
        assert_eq!(order_with(plane, |_| 2e-4, [0; 3]).unwrap(), 4);
    }

    #[test]
    fn what_samples_hardly_see_is_not_trusted() {
        let refused = |in_the_way| {
            let found = order(in_the_way, [0; 3]);
            matches!(found, Err(Refusal::Error(Error::UnreachableTolerance { .. })))
        };
        assert!(refused(|o| o == [2, 1, 0]), "a peak somewhere, perhaps elsewhere too");
        assert!(refused(|_| true) && refused(|o| o != [3, 3, 3]));
    }
}
