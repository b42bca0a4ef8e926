//! One set of points, spread over the ranks along the curve.

use farfield::{Cube, Located, MAX_LEVEL, Numbers, Real, Vector};

use crate::borders::Borders;
use crate::cells::{OwnCell, own_cells};
use crate::collective::{agree, any};
use crate::error::Error;
use crate::key::{Key, WORD_LEVELS};
use crate::sort::{Route, cuts, order};
use crate::transport::{Transport, TransportError};
use crate::words::{read, write};

/// The precision of points.
type RealOf<P> = <P as Located>::Real;

/// Where the points of a set are, and the cells of their tree.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    pub(crate) route: Route,
    pub(crate) borders: Borders,
    pub(crate) cells: Vec<OwnCell>,
}

/// Points of either set that an expansion is shown, at most: as many as in a plan of one process.
const SHOWN_POINTS: u32 = 512;

impl Layout {
    /// Brings points to ranks along the curve, and divides the tree that all of them make; returns the points that are here
    /// as well. O(n log n) for the points of a rank; each sends its points and O(P) words.
    ///
    /// Places are found from rounded numbers, unless there is a leaf with too many points that exact ones tell apart.
    pub(crate) fn new<P: Located + Numbers<Real = RealOf<P>>>(
        ranks: &dyn Transport,
        root: &Cube<RealOf<P>>,
        points: &[P],
        leaf_size: usize,
    ) -> Result<(Self, Vec<P>), Error> {
        let mut levels = WORD_LEVELS;
        loop {
            let exact = levels > WORD_LEVELS;
            let key = |p: &P| root.curve_key(p.position(), exact);
            let keys: Vec<Key> = points.iter().map(key).collect();
            let order = order(&keys);
            let sorted: Vec<Key> = order.iter().map(|&i| keys[i as usize]).collect();
            let weighted: Vec<(Key, f64)> = sorted.iter().map(|&key| (key, 1.0)).collect();
            let cuts = cuts(ranks, &weighted)?;
            let borders = Borders::new(ranks, &sorted, &cuts, leaf_size, levels)?;
            let (route, keys) = Route::new(ranks, &keys, &order, &borders.firsts)?;
            let cells = own_cells(&keys, &borders, ranks.rank(), leaf_size);
            let here = route.to_owners(ranks, points)?;
            let exact_key = |p: &P| root.curve_key(p.position(), true);
            let differ = |cell: &OwnCell| {
                let own = &here[cell.here.start as usize..cell.here.end as usize];
                own.iter().any(|p| exact_key(p) != exact_key(&own[0]))
            };
            let large = |cell: &&OwnCell| cell.is_leaf && cell.here.len() > leaf_size;
            let is_divisible = !exact && cells.iter().filter(large).any(differ);
            if !any(ranks, is_divisible)? {
                return Ok((Self { route, borders, cells }, here));
            }
            levels = MAX_LEVEL;
        }
    }
}

/// The places of some points of a set, spread along the curve; the same on all ranks.
pub(crate) fn shown<P: Located>(
    ranks: &dyn Transport,
    borders: &Borders,
    here: &[P],
) -> Result<Vec<farfield::Point<P::Real>>, TransportError> {
    let step = borders.total().div_ceil(SHOWN_POINTS).max(1);
    let own = borders.of(ranks.rank());
    let places = (own.start.next_multiple_of(step)..own.end).step_by(step as usize);
    let positions: Vec<_> =
        places.map(|place| here[(place - own.start) as usize].position()).collect();
    let mut words = Vec::new();
    write(&positions, &mut words);
    let all = ranks.gather(&words)?.concat();
    Ok(read(all.len() / 3, &mut all.iter()))
}

/// The root cube of all points of all ranks.
pub(crate) fn root_cube<S: Located, X: Located<Real = S::Real>>(
    ranks: &dyn Transport,
    sources: &[S],
    targets: &[X],
) -> Result<Cube<S::Real>, Error> {
    let positions = || {
        let sources = sources.iter().map(Located::position);
        sources.chain(targets.iter().map(Located::position)).map(|p| p.to_array())
    };
    let extreme = |start: f64, pick: fn(f64, f64) -> f64| {
        let start = [start; 3];
        positions().fold(start, |bound, p| [0, 1, 2].map(|k| pick(bound[k], p[k].as_f64())))
    };
    let own = [extreme(f64::INFINITY, f64::min), extreme(f64::NEG_INFINITY, f64::max)];
    let words: Vec<u64> = own.iter().flatten().map(|x| x.to_bits()).collect();
    let mut bounds = own;
    for words in ranks.gather(&words)? {
        for (k, word) in words.iter().enumerate().take(6) {
            let (side, axis, x) = (k / 3, k % 3, f64::from_bits(*word));
            let bound = &mut bounds[side][axis];
            *bound = if side == 0 { bound.min(x) } else { bound.max(x) };
        }
    }
    let [low, high] = bounds.map(|corner| corner.map(Real::from_f64));
    agree(ranks, Cube::around_box(low, high))
}
