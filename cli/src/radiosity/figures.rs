//! What a run on one mesh measured, as its report says it.

use farfield_radiosity::{Closure, PairCounts, Seen, Zones};

use super::args::{Args, VisibilityName};
use super::balance::RowSums;
use super::check::Check;
use super::daylight::Origin;
use super::negative::Negative;
use super::report::{Pairs, Report};
use super::warning::Warning;
use crate::memory::peak_memory_bytes;
use crate::progress::Progress;

/// What a run on one mesh measured.
pub(crate) struct Figures {
    pub(crate) pairs: Pairs,
    pub(crate) counts: PairCounts,
    pub(crate) zones: Zones,
    pub(crate) row_sums: RowSums,
    pub(crate) row_error: f64,
    pub(crate) seen: Seen,
    pub(crate) daylight: Option<f64>,
    pub(crate) outdoors: Option<Origin>,
    pub(crate) negative: Negative,
    pub(crate) reciprocity_error: f64,
    pub(crate) closure: Closure,
    pub(crate) uncertainty: f64,
    pub(crate) iterations: usize,
    pub(crate) residual: Option<f64>,
    pub(crate) residuals: Vec<Vec<(usize, f64)>>,
    pub(crate) interrupted: bool,
    pub(crate) energy: Option<f64>,
    pub(crate) error: Option<f64>,
    pub(crate) factor_error: Option<f64>,
    pub(crate) check: Check,
    /// Sums over all pairs that the solution took.
    pub(crate) sums: usize,
    pub(crate) element_error: Option<f64>,
}

impl Figures {
    /// The report of a run with these arguments, in so many bands on so many elements.
    pub(crate) fn report(
        &self,
        args: &Args,
        repairs: &[String],
        warnings: Vec<Warning>,
        [bands, elements]: [usize; 2],
        progress: &Progress,
    ) -> Report {
        let seconds = progress.seconds();
        let of = |phases: &[&str]| phases.iter().filter_map(|phase| seconds.get(phase)).sum();
        let check = &self.check;
        Report {
            scene: args.scene.clone(),
            scheme: args.scheme,
            expansion: args.expansion,
            solver: args.solver,
            quantity: args.quantity,
            bands,
            visibility: args.visibility,
            occlusion: args.visibility != VisibilityName::None,
            threads: rayon::current_num_threads(),
            tolerance: args.sum_tolerance(),
            elements,
            surfels: elements,
            element_error: self.element_error,
            adaptive: args.is_adaptive(),
            pairs: self.pairs,
            rays: self.counts.rays,
            near_pairs: self.zones.into(),
            visibility_uncertainty: self.uncertainty,
            row_sum: self.row_sums,
            form_factor_error: self.row_error,
            to_backs: self.seen.backs,
            to_sky: self.seen.sky,
            daylight: self.daylight,
            outdoors: self.outdoors,
            negative: self.negative,
            reciprocity_error: self.reciprocity_error,
            closure_correction: self.closure.largest,
            closure_rms: self.closure.rms,
            plan_s: of(&["planning", "near pairs"]),
            solve_s: of(&["solving"]),
            direct_s: check.visibility_s + self.sums as f64 * check.sum_s,
            iterations: self.iterations,
            residual: self.residual,
            residuals: self.residuals.clone(),
            interrupted: self.interrupted,
            energy_residual: self.energy,
            relative_l2_error: self.error,
            factor_l2_error: self.factor_error,
            sampled_surfels: check.sampled,
            peak_memory_bytes: peak_memory_bytes(),
            phases: seconds,
            warnings,
            repairs: repairs.to_vec(),
            files: Vec::new(),
        }
    }
}
