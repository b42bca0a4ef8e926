//! Which scheme is cheapest to apply: by forecast, corrected by what was measured if that is wanted.

use std::any::type_name;
use std::collections::BTreeMap;
use std::hint::black_box;
use std::sync::Mutex;
use std::time::Instant;

use crate::expansion::Expansion;
use crate::numbers::traits::Numbers;
use crate::parallel::watch::Watch;
use crate::plan::choices::Pace;
use crate::plan::estimate::Estimate;
use crate::plan::tuning::{APPLY_BUDGET, APPLY_REPETITIONS, DOUBT};
use crate::plan::{Plan, Scheme, Workspace};

/// A scheme that may be taken.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Candidate {
    pub(crate) scheme: Scheme,
    /// What a plan would cost; none if no other scheme may be taken.
    pub(crate) estimate: Option<Estimate>,
}

impl Candidate {
    fn seconds(&self) -> f64 {
        self.estimate.map_or(0.0, |estimate| estimate.apply_seconds())
    }
}

/// The cheapest candidate, the first of several, and whether a wrong forecast may have made it so.
pub(crate) fn cheapest<E: Expansion>(
    expansion: &E,
    candidates: &[Candidate],
    pace: Pace,
) -> (Candidate, bool) {
    let correction = |i: usize| match pace {
        Pace::Measured => correction(expansion, candidates[i].scheme),
        Pace::Declared | Pace::Stated(_) => Some(1.0),
    };
    let seconds = |i: usize| candidates[i].seconds() * correction(i).unwrap_or(1.0);
    let shorter = |best: usize, i: usize| if seconds(i) < seconds(best) { i } else { best };
    let best = (1..candidates.len()).fold(0, shorter);
    let rival = |i: usize| i != best && seconds(i) < DOUBT * seconds(best);
    let doubted = correction(best).is_none() && (0..candidates.len()).any(rival);
    (candidates[best], doubted)
}

/// Direct sums, if they are among the candidates and no other promises to halve what they take. Where an expansion
/// carries only some pairs of cells, the near field is in many pieces, and takes longer than forecast.
pub(crate) fn direct_unless_halved(candidates: &[Candidate]) -> Option<Candidate> {
    let direct = candidates.iter().find(|candidate| candidate.scheme == Scheme::Direct)?;
    let is_halved = |other: &Candidate| other.seconds() < 0.5 * direct.seconds();
    (!candidates.iter().any(is_halved)).then_some(*direct)
}

/// Applies `plan` to see how many times as long as forecast it takes, and remembers that for all plans
/// of its kind.
pub(crate) fn correct<E: Expansion>(plan: &Plan<E>, estimate: &Estimate) {
    let charges = vec![Numbers::zero(); plan.sources.len()];
    let mut workspace = Workspace::new(plan);
    let (start, mut shortest) = (Instant::now(), f64::INFINITY);
    for _ in 0..APPLY_REPETITIONS {
        let before = Instant::now();
        black_box(plan.run(&charges, &mut workspace, &Watch::default()));
        shortest = shortest.min(before.elapsed().as_secs_f64());
        if start.elapsed().as_secs_f64() > APPLY_BUDGET {
            break;
        }
    }
    let factor = shortest / estimate.apply_seconds().max(f64::MIN_POSITIVE);
    remembered(|factors| factors.insert(kind(&plan.expansion, plan.scheme), factor));
}

/// How many times as long as forecast an application takes, if that is known. Forecasts of direct sums
/// rest on a measured pace as they are.
fn correction<E: Expansion>(expansion: &E, scheme: Scheme) -> Option<f64> {
    match scheme {
        Scheme::Direct => Some(1.0),
        _ => remembered(|factors| factors.get(&kind(expansion, scheme)).copied()),
    }
}

/// What plans of a kind have in common: the expansion's type, precision and size, and the scheme.
type Kind = (&'static str, u64, usize, Scheme);

fn kind<E: Expansion>(expansion: &E, scheme: Scheme) -> Kind {
    let costs = expansion.costs(2);
    (type_name::<E>(), costs.pair_tolerance.to_bits(), costs.terms, scheme)
}

fn remembered<R>(ask: impl FnOnce(&mut BTreeMap<Kind, f64>) -> R) -> R {
    static FACTORS: Mutex<BTreeMap<Kind, f64>> = Mutex::new(BTreeMap::new());
    ask(&mut FACTORS.lock().unwrap_or_else(|e| e.into_inner()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interpolation::black_box::Interpolation;
    use crate::{Fmm, from_fn};
    use glam::DVec3;

    fn candidate(scheme: Scheme, seconds: f64) -> Candidate {
        let points = [DVec3::ZERO, DVec3::X];
        let estimate = Fmm::builder(from_fn(|x: DVec3, y: DVec3| x.distance(y)))
            .estimate(&points, &points)
            .unwrap();
        let estimate = Estimate { near_seconds: seconds, far_seconds: 0.0, ..estimate };
        Candidate { scheme, estimate: Some(estimate) }
    }

    #[test]
    fn only_forecasts_of_expansions_are_doubted() {
        let expansion = Interpolation::new(from_fn(|x: DVec3, y: DVec3| x.distance(y)));
        let pick = |direct: f64, fmm: f64| {
            let candidates = [candidate(Scheme::Direct, direct), candidate(Scheme::Fmm, fmm)];
            let (best, doubted) = cheapest(&expansion, &candidates, Pace::Measured);
            (best.scheme, doubted)
        };
        assert_eq!(pick(1.0, 1.0), (Scheme::Direct, false));
        assert_eq!(pick(1.0, 0.9), (Scheme::Fmm, true));
        assert_eq!(pick(1.0, 0.9 / DOUBT), (Scheme::Fmm, false));
        // Once it is known how far forecasts are off, nothing is.
        remembered(|factors| factors.insert(kind(&expansion, Scheme::Fmm), 2.0));
        assert_eq!(pick(1.0, 0.6), (Scheme::Direct, false));
        assert_eq!(pick(1.0, 0.4), (Scheme::Fmm, false));
        // Plans that are not tuned know nothing of it.
        let candidates = [candidate(Scheme::Direct, 1.0), candidate(Scheme::Fmm, 0.9)];
        let (best, doubted) = cheapest(&expansion, &candidates, Pace::Declared);
        assert_eq!((best.scheme, doubted), (Scheme::Fmm, false));
    }

    #[test]
    fn a_plan_without_rivals_is_not_doubted() {
        let expansion = Interpolation::new(from_fn(|x: DVec3, y: DVec3| x.distance(y)));
        let alone = [Candidate { scheme: Scheme::Fmm, estimate: None }];
        let (best, doubted) = cheapest(&expansion, &alone, Pace::Measured);
        assert_eq!((best.scheme, doubted), (Scheme::Fmm, false));
    }
}
