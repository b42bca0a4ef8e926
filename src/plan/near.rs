//! The near field of a target leaf, run by run: short runs are brought together first, so that a kernel
//! meets its targets once with many sources instead of many times with a few.

use crate::interaction::lists::{ALL, PairShare, Run};
use crate::kernel::mask::share_of;
use crate::kernel::traits::Kernel;
use crate::parallel::watch::Watch;
use crate::plan::tuning::{GATHERED_BYTES, RUN_SOURCES};

/// What the near field is summed from.
pub(crate) struct Near<'a, K: Kernel> {
    pub(crate) kernel: &'a K,
    /// The relative error that a pair may be off by.
    pub(crate) tolerance: f64,
    /// All sources in tree order, and their charges.
    pub(crate) sources: &'a [K::Source],
    pub(crate) charges: &'a [K::Charge],
    /// Which pairs of a run count, where not all do.
    pub(crate) bits: &'a [u64],
    /// Once it is stopped, what is summed is not used.
    pub(crate) watch: &'a Watch,
}

/// Sources of several runs next to each other, and their charges.
#[derive(Debug)]
pub(crate) struct Gathered<K: Kernel> {
    sources: Vec<K::Source>,
    charges: Vec<K::Charge>,
}

impl<K: Kernel> Default for Gathered<K> {
    fn default() -> Self {
        Self { sources: Vec::new(), charges: Vec::new() }
    }
}

impl<K: Kernel> Near<'_, K> {
    /// Adds the fields of pairs that count in part to the values at the targets of their leaf, which start
    /// at `first` in tree order.
    pub(crate) fn add_shares(
        &self,
        shares: &[PairShare],
        first: usize,
        xs: &[K::Target],
        us: &mut [K::Value],
    ) {
        for pair in shares {
            let (i, j) = (pair.target as usize - first, pair.source as usize);
            let q = share_of(&self.charges[j], pair.share);
            let (y, u) = (&self.sources[j..=j], &mut us[i..=i]);
            self.kernel.add_block(&xs[i..=i], y, &[q], self.tolerance, u);
        }
    }

    /// Adds the fields of all runs to the values at the targets of their leaf.
    pub(crate) fn add(
        &self,
        runs: &[Run],
        gathered: &mut Gathered<K>,
        xs: &[K::Target],
        us: &mut [K::Value],
    ) {
        let most = GATHERED_BYTES / (size_of::<K::Source>() + size_of::<K::Charge>()).max(1);
        // Sources that own memory are not copied.
        let most = if std::mem::needs_drop::<K::Source>() { 0 } else { most };
        for run in runs {
            let points = run.first as usize..run.last as usize;
            let (ys, qs) = (&self.sources[points.clone()], &self.charges[points]);
            if run.bits != ALL {
                let bits = &self.bits[run.bits as usize..];
                self.kernel.add_pairs(xs, ys, qs, bits, self.tolerance, us);
            } else if runs.len() == 1 || 2 * ys.len() > most {
                self.add_run(xs, ys, qs, us);
            } else {
                if gathered.sources.len() + ys.len() > most {
                    self.add_gathered(gathered, xs, us);
                }
                gathered.sources.extend_from_slice(ys);
                gathered.charges.extend_from_slice(qs);
            }
        }
        self.add_gathered(gathered, xs, us);
    }

    /// Adds the fields of many sources, some after the others.
    fn add_run(&self, xs: &[K::Target], ys: &[K::Source], qs: &[K::Charge], us: &mut [K::Value]) {
        for (ys, qs) in ys.chunks(RUN_SOURCES).zip(qs.chunks(RUN_SOURCES)) {
            if self.watch.is_stopped() {
                return;
            }
            self.kernel.add_block(xs, ys, qs, self.tolerance, us);
        }
    }

    fn add_gathered(&self, gathered: &mut Gathered<K>, xs: &[K::Target], us: &mut [K::Value]) {
        let Gathered { sources, charges } = gathered;
        if !sources.is_empty() {
            self.kernel.add_block(xs, sources, charges, self.tolerance, us);
        }
        sources.clear();
        charges.clear();
    }
}
