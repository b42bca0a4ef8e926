//! From the points of all ranks and choices to a plan.

use std::hash::{DefaultHasher, Hash, Hasher};

use farfield::{
    Cube, DispatchLevel, Expansion, Interpolation, Kernel, Located, Numbers, PartCell, PartMoments,
    Point, PointSet, Real, RealOf, Scalar, SourceOf, TargetOf, Vector,
};

use crate::collective::{agree, any};
use crate::error::Error;
use crate::fmm::DistributedFmm;
use crate::moments::{Served, SharedMoments};
use crate::needed::{KnownCells, shared_children};
use crate::places::ServedPlaces;
use crate::points::{Layout, root_cube, shown};
use crate::transport::Transport;
use crate::whole::Whole;

impl<'a, K: Kernel> DistributedFmm<'a, Interpolation<K>> {
    /// Starts a plan for a kernel expanded by [`Interpolation`].
    pub fn builder(kernel: K, ranks: &'a dyn Transport) -> Builder<'a, Interpolation<K>> {
        DistributedFmm::with_expansion(Interpolation::new(kernel), ranks)
    }
}

impl<'a, E: Expansion> DistributedFmm<'a, E> {
    /// Starts a plan for an expansion of its own.
    pub fn with_expansion(expansion: E, ranks: &'a dyn Transport) -> Builder<'a, E> {
        Builder { expansion, ranks, leaf_size: None }
    }
}

/// Collects the choices for a plan over many ranks. All ranks have to choose alike.
#[must_use = "call `build`"]
pub struct Builder<'a, E> {
    pub(crate) expansion: E,
    pub(crate) ranks: &'a dyn Transport,
    pub(crate) leaf_size: Option<usize>,
}

impl<K: Kernel> Builder<'_, Interpolation<K>> {
    /// The relative l2 error to stay below; default 1e-6.
    pub fn tolerance(mut self, tolerance: f64) -> Self {
        self.expansion = self.expansion.tolerance(tolerance);
        self
    }
}

impl<'a, E: Expansion> Builder<'a, E>
where
    SourceOf<E>: Numbers<Real = RealOf<E>>,
    TargetOf<E>: Numbers<Real = RealOf<E>>,
{
    /// The largest number of points in a leaf; by default what the expansion
    /// [chooses](farfield::Costs::leaf_size) by what a pair is said to take.
    pub fn leaf_size(mut self, leaf_size: usize) -> Self {
        self.leaf_size = Some(leaf_size);
        self
    }

    /// Builds the plan. All ranks call it; a rank may have no points.
    ///
    /// # Errors
    /// On all ranks alike, if a rank's input is refused as by [`farfield::Builder::build`], if the ranks' choices or
    /// [instructions](DispatchLevel) are not the same, or if there are too many points. Kernels are told apart by their
    /// values for a few pairs of points in the cube around all points.
    pub fn build(
        mut self,
        my_sources: &[SourceOf<E>],
        my_targets: &[TargetOf<E>],
    ) -> Result<DistributedFmm<'a, E>, Error> {
        let ranks = self.ranks;
        let leaf_size = agree(ranks, self.check(my_sources, my_targets))?;
        let root = root_cube(ranks, my_sources, my_targets)?;
        check_alike(ranks, &self.expansion, &root, leaf_size)?;
        let (sources, own_sources) = Layout::new(ranks, &root, my_sources, leaf_size)?;
        let same = my_sources.len() == my_targets.len()
            && my_sources.iter().zip(my_targets).all(|(y, x)| y.position() == x.position());
        let (targets, own_targets) = if any(ranks, !same)? {
            Layout::new(ranks, &root, my_targets, leaf_size)?
        } else {
            (sources.clone(), sources.route.to_owners(ranks, my_targets)?)
        };
        let shared_children = shared_children(ranks, &sources.cells, &sources.borders)?;
        let mut whole = Whole {
            ranks,
            root,
            known: KnownCells::new(ranks, &sources.cells, &sources.borders)?,
            sources: &sources,
            targets: &targets,
            shared_children,
            target_cells: targets.cells.iter().map(|cell| cell.part(false)).collect(),
        };
        let shown = (
            shown(ranks, &sources.borders, &own_sources)?,
            shown(ranks, &targets.borders, &own_targets)?,
        );
        let (lists, levels) = whole.prepare(&mut self.expansion, shown)?;
        let ids = whole.known.ids();
        let mut part = agree(ranks, lists.plan(self.expansion, own_targets))?;
        let needed: Vec<_> = part.multipoles().iter().map(|&s| ids[s as usize]).collect();
        let cells = Served::new(ranks, &needed, &sources.cells, &sources.borders)?;
        let places = ServedPlaces::new(ranks, part.places(), &sources.borders)?;
        let mut messages = vec![Vec::new(); ranks.size()];
        places.send(&own_sources, &mut messages);
        let messages = ranks.exchange(messages)?;
        let mut messages: Vec<_> = messages.iter().map(|words| words.iter()).collect();
        agree(ranks, part.set_sources(places.receive(&mut messages)))?;
        let moments: Vec<PartCell> =
            sources.cells.iter().map(|cell| cell.part(cell.is_shared)).collect();
        let moments = agree(ranks, PartMoments::new(root, &moments))?;
        let shared = SharedMoments::new(ranks, &root, &sources.cells, &sources.borders)?;
        Ok(DistributedFmm {
            ranks,
            own_sources,
            moments,
            shared,
            // Without expansions, no level is coarse enough.
            coarsest: levels.first().map_or(usize::MAX, |level| level.level),
            levels: levels.last().map_or(0, |level| level.level + 1),
            part,
            cells,
            places,
            sources,
            targets,
        })
    }

    /// Refuses what can be told without the others; the leaf size.
    fn check(
        &self,
        sources: &[SourceOf<E>],
        targets: &[TargetOf<E>],
    ) -> Result<usize, farfield::Error> {
        let kernel = self.expansion.kernel();
        kernel.check_sizes()?;
        check_positions(PointSet::Sources, sources)?;
        check_positions(PointSet::Targets, targets)?;
        let costs = self.expansion.costs(2);
        let best = || costs.leaf_size(kernel.pair_seconds(costs.pair_tolerance));
        match self.leaf_size.unwrap_or_else(best) {
            0 => Err(farfield::Error::InvalidLeafSize),
            leaf_size => Ok(leaf_size),
        }
    }
}

/// Refuses ranks that are not as rank 0 is, in what decides about the plan.
fn check_alike<E: Expansion>(
    ranks: &dyn Transport,
    expansion: &E,
    root: &Cube<RealOf<E>>,
    leaf_size: usize,
) -> Result<(), Error> {
    let level = agree(ranks, DispatchLevel::in_force())?;
    let costs = expansion.costs(2);
    let names = [
        "dispatch level",
        "leaf size",
        "tolerance of a pair",
        "number of terms",
        "digest of values of the kernel",
    ];
    let (tolerance, terms) = (costs.pair_tolerance, costs.terms);
    let digest = digest(expansion.kernel(), root);
    let own = format!("{level}\n{leaf_size}\n{tolerance:e}\n{terms}\n{digest:016x}").into_bytes();
    let all = ranks.gather(&own.into_iter().map(u64::from).collect::<Vec<u64>>())?;
    let text = |words: &Vec<u64>| words.iter().map(|&byte| byte as u8 as char).collect::<String>();
    let all: Vec<String> = all.iter().map(text).collect();
    for (rank, own) in all.iter().enumerate() {
        for ((what, found), expected) in names.into_iter().zip(own.lines()).zip(all[0].lines()) {
            if found != expected {
                let [found, expected] = [found, expected].map(String::from);
                return Err(Error::Unlike { rank, what, found, expected });
            }
        }
    }
    Ok(())
}

/// A number that another kernel has another of, as good as surely: from the bits of its values for all pairs of some points
/// in the cube.
fn digest<K: Kernel>(kernel: &K, root: &Cube<K::Real>) -> u64 {
    let place = |i: usize, axis: usize| {
        let share = ((i + 1) as f64 * STEPS[axis]).fract() * 2.0 - 1.0;
        root.centre().to_array()[axis] + K::Real::from_f64(share) * root.half_width()
    };
    let points: [Point<K::Real>; DIGESTED] =
        std::array::from_fn(|i| Point::<K::Real>::from_array([0, 1, 2].map(|axis| place(i, axis))));
    let (fields, densities) = (kernel.fields(), kernel.densities());
    let zero = <K::Entry as Numbers>::zero();
    let mut entries = vec![zero; DIGESTED * DIGESTED * fields * densities];
    kernel.entries_block(&points, &points, &mut entries);
    let mut hasher = DefaultHasher::new();
    (fields, densities, kernel.columns()).hash(&mut hasher);
    let parts = entries.iter().flat_map(|entry| entry.parts());
    parts.for_each(|part| part.as_f64().to_bits().hash(&mut hasher));
    hasher.finish()
}

/// Points for a digest; the pairs of a point with itself are among theirs.
const DIGESTED: usize = 4;
/// By which shares of the cube one point follows the other: spread evenly (Roberts, "The unreasonable effectiveness of
/// quasirandom sequences", 2018).
const STEPS: [f64; 3] = [0.819_172_5, 0.671_043_6, 0.549_700_5];

fn check_positions<P: Located>(set: PointSet, points: &[P]) -> Result<(), farfield::Error> {
    match points.iter().position(|p| !p.position().is_finite()) {
        Some(index) => {
            let position = points[index].position().to_array().map(Real::as_f64);
            Err(farfield::Error::NonFinitePosition { set, index, position })
        }
        None => Ok(()),
    }
}
