//! From points and choices to a plan.

use std::fmt;

use crate::dispatch_level::DispatchLevel;
use crate::error::Error;
use crate::expansion::admissibility::Admissibility;
use crate::expansion::geometry::Geometry;
use crate::expansion::weights::Weights;
use crate::expansion::{Expansion, RealOf, SourceOf, TargetOf};
use crate::interaction::lists::Lists;
use crate::interpolation::black_box::Interpolation;
use crate::interpolation::store::OperatorStore;
use crate::kernel::mask::{Coverage, Mask, Unmasked};
use crate::kernel::ordinary::check_range;
use crate::kernel::traits::Kernel;
use crate::numbers::traits::{Located, Point, Real};
use crate::octree::trees::Trees;
use crate::parallel::watch::{Phase, Progress, Watch};
use crate::plan::choice::{Candidate, cheapest, correct, direct_unless_halved};
use crate::plan::choices::{Choices, Pace};
use crate::plan::estimate::Estimate;
use crate::plan::fmm::Fmm;
use crate::plan::guard::Guard;
use crate::plan::norms::Norms;
use crate::plan::times::{BuildTimes, Clock};
use crate::plan::trial::stands_trial;
use crate::plan::tuning::{RESTRICTIONS, SHOWN_POINTS};
use crate::plan::{Plan, Scheme, levels};

impl<K: Kernel> Fmm<Interpolation<K>> {
    /// Starts a plan for a kernel expanded by [`Interpolation`].
    pub fn builder(kernel: K) -> Builder<'static, Interpolation<K>, Unmasked> {
        Fmm::with_expansion(Interpolation::new(kernel))
    }
}

impl<E: Expansion> Fmm<E> {
    /// Starts a plan for an expansion of its own.
    pub fn with_expansion(expansion: E) -> Builder<'static, E, Unmasked> {
        Builder { expansion, mask: Unmasked, choices: Choices::default() }
    }
}

/// Collects the choices for a plan; every one has a default.
#[must_use = "call `build`"]
pub struct Builder<'a, E, M> {
    pub(crate) expansion: E,
    pub(super) mask: M,
    pub(super) choices: Choices<'a>,
}

impl<K: Kernel, M> Builder<'_, Interpolation<K>, M> {
    /// The relative l2 error to stay below; default 1e-6. The order follows from it.
    pub fn tolerance(mut self, tolerance: f64) -> Self {
        self.expansion = self.expansion.tolerance(tolerance);
        self
    }

    /// A fixed number of Chebyshev nodes per axis, in place of a tolerance.
    pub fn order(mut self, order: usize) -> Self {
        self.expansion = self.expansion.order(order);
        self
    }

    /// Where operators are looked for, and kept for later plans; default [`OperatorStore::of_process`].
    pub fn operator_store(mut self, store: &OperatorStore) -> Self {
        self.expansion = self.expansion.operator_store(store);
        self
    }
}

impl<'a, E: Expansion, M: Mask<E::Kernel>> Builder<'a, E, M> {
    /// Sums only the pairs that `mask` lets count; pass a reference to keep the mask.
    pub fn mask<N: Mask<E::Kernel>>(self, mask: N) -> Builder<'a, E, N> {
        let Self { expansion, choices, .. } = self;
        Builder { expansion, mask, choices: Choices { masked: true, ..choices } }
    }

    /// How to sum.
    ///
    /// By default, whichever scheme's [applications](Fmm::apply) take the shortest time: expansions or,
    /// for few points, direct sums, which need no operators either. What they take is forecast from the
    /// lists of a sample of the cells and the [time of a pair](Self::pair_seconds). With a
    /// [leaf size](Self::leaf_size) or a [mask](Self::mask), the default is [`Scheme::Fmm`].
    ///
    /// Whatever is chosen here, sums without a mask are direct where an expansion can't meet the tolerance
    /// or would take much longer to set up or to apply; [`Stats::fallback`](crate::Stats::fallback) then says why.
    pub fn scheme(mut self, scheme: Scheme) -> Self {
        self.choices.scheme = Some(scheme);
        self
    }

    /// The largest number of points in a leaf.
    ///
    /// By default the expansion [chooses](crate::Costs::leaf_seconds) by the
    /// [time of a pair](Self::pair_seconds).
    pub fn leaf_size(mut self, leaf_size: usize) -> Self {
        self.choices.leaf_size = Some(leaf_size);
        self
    }

    /// How often the plan will be applied, about; default 1. Operators that take longer than the direct sums
    /// that they save are not built, nor are those for [charges of unlike size](Fmm::apply).
    pub fn applications(mut self, applications: usize) -> Self {
        self.choices.applications = applications;
        self
    }

    /// Seconds of one core that a pair takes if it is summed directly, about. By default the kernel
    /// [says it](Kernel::pair_seconds). A closure is taken to need four nanoseconds: if yours needs much more, plans
    /// are faster if you say so.
    ///
    /// Nothing that is measured decides about a plan. Another run on a processor with the same
    /// [instructions](DispatchLevel) therefore comes to the same sums, bit by bit.
    pub fn pair_seconds(mut self, seconds: f64) -> Self {
        self.choices.pace = Pace::Stated(seconds);
        self
    }

    /// Measures what a pair takes, once in a process for each type of kernel and tolerance. Where forecasts leave a
    /// doubt about the scheme, the plan is made and applied, and the correction found holds for all plans of its
    /// kind until the process ends. Plans are the fastest for this machine; another run may come to another tree
    /// or scheme, and to sums that differ in rounding and within the tolerance.
    pub fn tuned(mut self) -> Self {
        self.choices.pace = Pace::Measured;
        self
    }

    /// A callback that is told how far building has come. It may be called from several threads at once.
    pub fn progress<'b>(self, report: &'b (dyn Fn(Progress) + Sync)) -> Builder<'b, E, M> {
        let Self { expansion, mask, choices } = self;
        Builder { expansion, mask, choices: Choices { progress: Some(report), ..choices } }
    }

    /// What looks on while the plan is built, and can stop that.
    pub fn watch(mut self, watch: &Watch) -> Self {
        self.choices.watch = watch.clone();
        self
    }

    /// The most bytes that the plan and one workspace may need; by default as many as it takes. With a
    /// budget, building makes an [`estimate`](Self::estimate) as soon as the trees stand, and stops there
    /// if that is more. Operators of expansions are not counted.
    pub fn memory_budget(mut self, bytes: usize) -> Self {
        self.choices.memory_budget = Some(bytes);
        self
    }

    /// What the plan would cost, without making its lists and operators: sorts the points into trees,
    /// and asks the mask for some cells. O(N).
    ///
    /// ```
    /// use farfield::{Error, Fmm, from_fn};
    /// use glam::DVec3;
    ///
    /// let points: Vec<DVec3> = (0..5000).map(|i| DVec3::splat(f64::from(i)).map(f64::sin)).collect();
    /// let builder = Fmm::builder(from_fn(|x: DVec3, y: DVec3| (-x.distance(y)).exp()));
    /// let estimate = builder.estimate(&points, &points)?;
    /// assert!(estimate.bytes() > 5000 * size_of::<DVec3>());
    /// let refused = builder.memory_budget(estimate.bytes() / 2).build(&points, &points);
    /// assert!(matches!(refused, Err(Error::OverMemoryBudget { .. })));
    /// # Ok::<(), Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`build`](Self::build), but for those of the expansion and of the mask's pairs.
    pub fn estimate(
        &self,
        sources: &[SourceOf<E>],
        targets: &[TargetOf<E>],
    ) -> Result<Estimate, Error> {
        DispatchLevel::in_force()?;
        self.expansion.kernel().check_sizes()?;
        self.choices.check()?;
        let (mut clock, mut tree_seconds) = (Clock::start(), 0.0);
        let trees = self.trees(sources, targets)?;
        clock.lap(&mut tree_seconds);
        let whole = Admissibility::default();
        let candidates = self.candidates(&trees, tree_seconds, &whole);
        let (Candidate { scheme, estimate }, _) =
            cheapest(&self.expansion, &candidates, self.choices.pace);
        Ok(estimate.unwrap_or_else(|| self.estimate_of(scheme, &trees, tree_seconds, &whole)))
    }

    /// Builds the plan. Empty sets are valid: sums over no sources are zero. If sources and targets
    /// are at the same points in the same order, they share one tree.
    ///
    /// # Errors
    /// If a coordinate is not finite, the points extend too far for their precision, or so far or so little that the
    /// precision has no digits for what the [kernel](Kernel::sizes) gives between them, the leaf size is
    /// zero, a pair is said to take no time, the kernel's sizes don't belong together, the mask gives no share
    /// from 0 to 1, the plan would need more memory than it may, or the expansion can't meet its tolerance or
    /// order, or if `FARFIELD_DISPATCH` does not name a [`DispatchLevel`]; or [`Error::Stopped`] by a
    /// [watch](Self::watch).
    pub fn build(
        mut self,
        sources: &[SourceOf<E>],
        targets: &[TargetOf<E>],
    ) -> Result<Fmm<E>, Error> {
        DispatchLevel::in_force()?;
        self.expansion.kernel().check_sizes()?;
        self.choices.check()?;
        let (mut clock, mut times) = (Clock::start(), BuildTimes::default());
        self.report(Phase::Tree, 0.0);
        let watch = self.choices.watch.clone();
        let mut trees = self.trees(sources, targets)?;
        check_range(self.expansion.kernel(), sources, targets)?;
        self.report(Phase::Tree, 1.0);
        clock.lap(&mut times.tree);

        self.report(Phase::Lists, 0.0);
        let mut admissibility = Admissibility::default();
        let mut candidates = self.candidates(&trees, times.tree, &admissibility);
        let (mut fallback, mut restrictions) = (None, 0);
        loop {
            let (Candidate { scheme, mut estimate }, doubted) =
                cheapest(&self.expansion, &candidates, self.choices.pace);
            if let Some(budget) = self.choices.memory_budget {
                let estimate = estimate.get_or_insert_with(|| {
                    self.estimate_of(scheme, &trees, times.tree, &admissibility)
                });
                if estimate.bytes() > budget {
                    return Err(Error::OverMemoryBudget { budget, needed: estimate.bytes() });
                }
            }
            clock.lap(&mut times.lists);
            let mask = self.cell_mask(&trees);
            let traversal = self.traversal(scheme, &trees, &mask, &admissibility);
            let found = traversal.lists(&|fraction| self.report(Phase::Lists, fraction));
            watch.check()?;
            let mut lists = found.map_err(|pair| Error::InvalidShare {
                target: trees.target_tree.shape.order[pair.target as usize] as usize,
                from: trees.source_tree.shape.order[pair.source as usize] as usize,
                found: pair.share,
            })?;
            lists.sum_few_directly(&trees.target_tree.shape, &trees.source_tree.shape);
            self.report(Phase::Lists, 1.0);
            clock.lap(&mut times.lists);

            self.report(Phase::Operators, 0.0);
            let levels = levels(&lists, &trees.source_tree, &trees.target_tree, scheme);
            let pairs = trees.sources.len() as f64 * trees.targets.len() as f64;
            let pair_seconds = self.seconds_of_a_pair(&trees.sources, &trees.targets);
            let direct_seconds = pairs * pair_seconds;
            let most_seconds =
                self.choices.worth(estimate.as_ref(), direct_seconds, admissibility.is_whole());
            let mut geometry = Geometry {
                most_seconds,
                most_apply_seconds: self
                    .choices
                    .most_far_seconds(estimate.as_ref(), direct_seconds),
                pair_seconds,
                sources: some(&trees.sources),
                targets: some(&trees.targets),
                admissibility: admissibility.clone(),
                watch: watch.clone(),
                ..Geometry::new(trees.root, levels)
            };
            // Direct sums ask the kernel for their own pairs and no others.
            let is_direct = geometry.levels.is_empty();
            let weights =
                if is_direct { Weights::default() } else { self.expansion.weigh(&trees.root) };
            let norms = self.measure(&weights, &trees, &lists, &mut geometry);
            let prepared = self.expansion.prepare(&geometry);
            clock.lap(&mut times.operators);
            match prepared {
                Err(error)
                    if scheme != Scheme::Direct
                        && self.choices.may_sum_directly::<RealOf<E>>(&error) =>
                {
                    candidates = vec![self.direct(&trees, times.tree, estimate.is_some())];
                    fallback = Some(error.to_string());
                    continue;
                }
                prepared => prepared?,
            }
            self.report(Phase::Operators, 1.0);
            let announced = geometry.levels.iter().map(|level| level.level);
            let admits = |level, offset| self.expansion.admits(level, offset);
            let mut carried = admissibility.with(announced.clone(), admits);
            // What can't be tried is not trusted, and in the end nothing is.
            if carried != admissibility && (self.choices.masked || restrictions == RESTRICTIONS) {
                carried = admissibility.with(announced, |_, _| Coverage::Partial);
            }
            if carried != admissibility {
                (admissibility, restrictions) = (carried, restrictions + 1);
                candidates = self.candidates(&trees, times.tree, &admissibility);
                if let Some(direct) = direct_unless_halved(&candidates) {
                    fallback = Some("the expansion carries too few pairs of cells".to_string());
                    candidates = vec![direct];
                }
                continue;
            }

            // Whether there are operators for other charges shows when direct sums have to wait for them.
            let most_seconds = self.choices.ventured(direct_seconds);
            let geometry = Geometry { most_seconds, watch: Watch::default(), ..geometry };
            let guard = norms.map(|norms| Guard::new(norms, geometry));
            let guard = guard.filter(|guard| guard.is_needed(&self.expansion));
            let plan = Plan::new(self.expansion, scheme, trees, lists);
            clock.lap(&mut times.lists);
            let is_tried = !admissibility.is_whole() && !self.choices.masked;
            let stands = !is_tried || scheme == Scheme::Direct || stands_trial(&plan, &watch);
            watch.check()?;
            if !stands {
                fallback = Some("the kernel is too uneven between cells".to_string());
                (self.expansion, trees) = plan.into_parts();
                candidates = vec![self.direct(&trees, times.tree, estimate.is_some())];
                continue;
            }
            let right = match &estimate {
                Some(estimate) if doubted => {
                    correct(&plan, estimate);
                    cheapest(&plan.expansion, &candidates, self.choices.pace).0.scheme == scheme
                }
                _ => true,
            };
            if right {
                let half_width = plan.root.half_width().as_f64();
                let choices = self.choices.kept(half_width);
                return Ok(Fmm::new(plan, choices, guard, times, estimate, fallback));
            }
            (self.expansion, trees) = plan.into_parts();
        }
    }

    /// Measures how strongly the pairs of each level act. Not with a mask, which decides what counts.
    fn measure(
        &self,
        weights: &Weights,
        trees: &Trees<SourceOf<E>, TargetOf<E>>,
        lists: &Lists,
        geometry: &mut Geometry<RealOf<E>>,
    ) -> Option<Norms> {
        let is_direct = geometry.levels.is_empty() && lists.left_out.items.is_empty();
        if self.choices.masked || is_direct {
            return None;
        }
        self.expansion.again()?;
        let norms = Norms::sample::<E>((self.expansion.kernel(), weights), trees, lists);
        for level in &mut geometry.levels {
            [level.values, level.slopes] = norms.usual[level.level];
            [level.fields, level.densities] = norms.sizes(level.level);
        }
        Some(norms)
    }

    fn report(&self, phase: Phase, fraction: f64) {
        self.choices.watch.enter(Progress { phase, fraction });
        if let Some(report) = self.choices.progress {
            report(Progress { phase, fraction });
        }
    }
}

/// The places of some points, spread over all of them in tree order.
fn some<P: Located>(points: &[P]) -> Vec<Point<P::Real>> {
    let step = points.len().div_ceil(SHOWN_POINTS).max(1);
    points.iter().step_by(step).map(Located::position).collect()
}

impl<E: fmt::Debug, M: fmt::Debug> fmt::Debug for Builder<'_, E, M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Builder")
            .field("expansion", &self.expansion)
            .field("mask", &self.mask)
            .field("scheme", &self.choices.scheme)
            .field("leaf_size", &self.choices.leaf_size)
            .finish_non_exhaustive()
    }
}
