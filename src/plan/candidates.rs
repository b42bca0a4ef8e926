//! Which schemes may be taken, and what each would cost.

use crate::error::Error;
use crate::expansion::admissibility::Admissibility;
use crate::expansion::costs::Costs;
use crate::expansion::{Expansion, RealOf, SourceOf, TargetOf};
use crate::interaction::cell_mask::{CellMask, PointMask, TreePoints};
use crate::interaction::traversal::{Far, Traversal};
use crate::kernel::mask::Mask;
use crate::kernel::traits::Kernel;
use crate::numbers::traits::Real;
use crate::octree::trees::Trees;
use crate::plan::Scheme;
use crate::plan::builder::Builder;
use crate::plan::choice::Candidate;
use crate::plan::choices::{Choices, Pace};
use crate::plan::estimate::Estimate;
use crate::plan::forecast::Forecast;
use crate::plan::pair_time::pair_seconds;
use crate::plan::tuning::{DOUBT, SET_UP_SECONDS};

impl<E: Expansion, M: Mask<E::Kernel>> Builder<'_, E, M> {
    /// The schemes that may be taken: the one that is given, or any.
    pub(super) fn candidates(
        &self,
        trees: &Trees<SourceOf<E>, TargetOf<E>>,
        tree_seconds: f64,
        admissibility: &Admissibility,
    ) -> Vec<Candidate> {
        let Choices { scheme, leaf_size, masked, .. } = self.choices;
        let given = scheme.or((masked || leaf_size.is_some()).then_some(Scheme::Fmm));
        if let Some(scheme) = given {
            return vec![Candidate { scheme, estimate: None }];
        }
        let candidate = |scheme| {
            let estimate = Some(self.estimate_of(scheme, trees, tree_seconds, admissibility));
            Candidate { scheme, estimate }
        };
        // Few pairs are summed before anything else is set up.
        let pairs = trees.sources.len() as f64 * trees.targets.len() as f64;
        let seconds = pairs * self.seconds_of_a_pair(&trees.sources, &trees.targets);
        if seconds * self.choices.applications as f64 <= SET_UP_SECONDS {
            return vec![candidate(Scheme::Direct)];
        }
        let mut candidates = [Scheme::Fmm, Scheme::Treecode { m2m: true }].map(candidate).to_vec();
        // Where direct sums are hopeless, they need no estimate of their own.
        let hopeless = |expanded: &Candidate| {
            expanded.estimate.is_some_and(|e| e.direct_seconds > DOUBT * e.apply_seconds())
        };
        if !candidates.iter().any(hopeless) {
            candidates.insert(0, candidate(Scheme::Direct));
        }
        candidates
    }

    /// Direct sums, with what they would cost where that decides.
    pub(super) fn direct(
        &self,
        trees: &Trees<SourceOf<E>, TargetOf<E>>,
        tree_seconds: f64,
        is_chosen: bool,
    ) -> Candidate {
        let (scheme, whole) = (Scheme::Direct, Admissibility::default());
        let estimate = || self.estimate_of(scheme, trees, tree_seconds, &whole);
        Candidate { scheme, estimate: is_chosen.then(estimate) }
    }

    pub(super) fn estimate_of(
        &self,
        scheme: Scheme,
        trees: &Trees<SourceOf<E>, TargetOf<E>>,
        tree_seconds: f64,
        admissibility: &Admissibility,
    ) -> Estimate {
        let pair_seconds = self.seconds_of_a_pair(&trees.sources, &trees.targets);
        let expansion = &self.expansion;
        let forecast = Forecast { expansion, scheme, trees, pair_seconds, tree_seconds };
        let mask = self.cell_mask(trees);
        forecast.estimate(&self.traversal(scheme, trees, &mask, admissibility))
    }

    pub(super) fn trees(
        &self,
        sources: &[SourceOf<E>],
        targets: &[TargetOf<E>],
    ) -> Result<Trees<SourceOf<E>, TargetOf<E>>, Error> {
        let best = || self.costs().leaf_size(self.seconds_of_a_pair(sources, targets));
        let leaf_size = || self.choices.leaf_size.unwrap_or_else(best);
        let unit = self.choices.unit.map(Real::from_f64);
        Trees::new(sources, targets, &leaf_size, unit, &self.choices.watch)
    }

    /// What is known of costs before the expansion is prepared.
    pub(super) fn costs(&self) -> Costs {
        self.expansion.costs(2)
    }

    /// Seconds of one core for a pair that is summed directly.
    pub(super) fn seconds_of_a_pair(
        &self,
        sources: &[SourceOf<E>],
        targets: &[TargetOf<E>],
    ) -> f64 {
        let (kernel, tolerance) = (self.expansion.kernel(), self.costs().pair_tolerance);
        match self.choices.pace {
            Pace::Declared => kernel.pair_seconds(tolerance),
            Pace::Stated(seconds) => seconds,
            Pace::Measured => pair_seconds(kernel, tolerance, sources, targets),
        }
    }

    pub(super) fn cell_mask<'b>(
        &'b self,
        trees: &'b Trees<SourceOf<E>, TargetOf<E>>,
    ) -> PointMask<'b, E::Kernel, M> {
        PointMask {
            mask: &self.mask,
            targets: TreePoints { tree: &trees.target_tree, points: &trees.targets },
            sources: TreePoints { tree: &trees.source_tree, points: &trees.sources },
        }
    }

    pub(super) fn traversal<'b>(
        &'b self,
        scheme: Scheme,
        trees: &'b Trees<SourceOf<E>, TargetOf<E>>,
        mask: &'b dyn CellMask,
        admissibility: &'b Admissibility,
    ) -> Traversal<'b, RealOf<E>> {
        Traversal {
            targets: &trees.target_tree,
            sources: &trees.source_tree,
            mask,
            admissibility,
            watch: &self.choices.watch,
            far: match scheme {
                Scheme::Direct => Far::Nothing,
                Scheme::Fmm if self.costs().weighs => Far::Weighed,
                Scheme::Fmm | Scheme::Treecode { .. } => Far::Whole,
            },
        }
    }
}
