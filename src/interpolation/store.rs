//! Operators of kernels that were met before: they do not depend on the points.

use std::fmt;
use std::path::Path;
use std::sync::{Arc, LazyLock, Mutex, MutexGuard};

use crate::interpolation::known::{Identity, Key, Known};
use crate::interpolation::operators::Operators;
use crate::interpolation::store_error::StoreError;
use crate::interpolation::store_files;
use crate::interpolation::stored::length;
use crate::interpolation::tuning::STORE_BYTES;
use crate::numbers::traits::Scalar;

/// Operators of [`Interpolation`](crate::Interpolation) that were built before, for later plans.
///
/// Operators depend on the kernel, on the tolerance, on which sizes cells have, and on how strongly each level acts, but
/// not on the points. A plan looks for its operators in a store, and leaves them there if it had to build them. All plans
/// share [the store of the process](Self::of_process) unless [`Builder::operator_store`](crate::Builder::operator_store)
/// names another. A store can be saved to a folder, and loaded by another process.
///
/// Operators are recognised by what they were built from. Where the kernel states its
/// [identity](crate::Kernel::identity), or has no parameters and is met again in the same process, that is compared, and
/// values of the kernel at some thousand points. Of any other kernel, a quarter of the values that went into the
/// operators is evaluated again, spread over all of them, which takes a fraction of the time of building them. So sums have
/// the same bits with a store and without one, unless two kernels differ so narrowly that none of these values shows it.
///
/// Clones share what is stored. Nothing is locked while a kernel is evaluated.
///
/// ```
/// use farfield::{Fmm, OperatorStore, from_fn};
/// use glam::DVec3;
///
/// let store = OperatorStore::new(100 << 20);
/// let points: Vec<DVec3> =
///     (0..20_000).map(|i| DVec3::new(0.618, 0.755, 0.570) * f64::from(i)).map(|x| x.fract()).collect();
/// let log = || from_fn(|x: DVec3, y: DVec3| if x == y { 0.0 } else { x.distance(y).ln() });
/// let plan = || Fmm::builder(log()).tolerance(1e-3).operator_store(&store).build(&points, &points);
/// let sums = plan()?.apply(&vec![1.0; points.len()])?;
///
/// let folder = std::env::temp_dir().join(format!("operators-{}", std::process::id()));
/// assert_eq!(store.save(&folder)?, store.len());
/// store.clear();
/// assert_eq!(store.load(&folder)?, store.len());
/// assert_eq!(plan()?.apply(&vec![1.0; points.len()])?, sums);
/// # std::fs::remove_dir_all(&folder)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone)]
pub struct OperatorStore {
    sets: Arc<Mutex<Vec<Known>>>,
    capacity: usize,
    /// Whether operators can be recognised by another process.
    lasts: bool,
}

static OF_PROCESS: LazyLock<OperatorStore> =
    LazyLock::new(|| OperatorStore { lasts: false, ..OperatorStore::new(STORE_BYTES) });

impl OperatorStore {
    /// A store that keeps at most so many bytes of operators. Sets that were used the longest ago give way to new ones; one
    /// that is larger than the store is not kept.
    pub fn new(bytes: usize) -> Self {
        Self { sets: Arc::default(), capacity: bytes, lasts: true }
    }

    /// The store of all plans of the process for which no other is named. It keeps half a gigabyte at most. Operators of
    /// kernels without parameters or identity are not [saved](Self::save) from it: it doesn't spend the time to evaluate
    /// what another process would recognise them by.
    pub fn of_process() -> &'static Self {
        &OF_PROCESS
    }

    /// How many sets of operators it holds: one for each kernel, tolerance and series of cell sizes.
    pub fn len(&self) -> usize {
        self.locked().len()
    }

    /// Whether it holds nothing.
    pub fn is_empty(&self) -> bool {
        self.locked().is_empty()
    }

    /// How many bytes of operators it holds.
    pub fn bytes(&self) -> usize {
        self.locked().iter().map(|set| set.bytes).sum()
    }

    /// Forgets everything.
    pub fn clear(&self) {
        self.locked().clear();
    }

    /// Writes each set of operators to a file of the folder, which is made if need be. A file appears whole or not at
    /// all. Sets that the folder has already are left as they are. Returns how many of its sets the folder now has.
    ///
    /// Files are named after the version of this library, the processor's [dispatch level](crate::DispatchLevel), and
    /// what is in them. Machines of several kinds can share a folder.
    ///
    /// # Errors
    /// [`StoreError::Io`], with the file or the folder.
    pub fn save(&self, folder: &Path) -> Result<usize, StoreError> {
        let sets: Vec<Known> = self.locked().iter().filter(|set| set.lasts()).cloned().collect();
        store_files::write(folder, &sets)?;
        Ok(sets.len())
    }

    /// Reads all sets that this version saved at this dispatch level to a folder; returns how many. They are used when a
    /// plan needs the same, so a folder may hold those of any kernels.
    ///
    /// # Errors
    /// [`StoreError`], with the file: one that can't be read, is damaged, or is not what its name says. Nothing is
    /// loaded then.
    pub fn load(&self, folder: &Path) -> Result<usize, StoreError> {
        let sets = store_files::read(folder)?;
        let found = sets.len();
        sets.into_iter().for_each(|set| self.keep(set));
        Ok(found)
    }

    /// Operators that may be those of a kernel, with what has to be compared still: the digest of values that they
    /// were built from, if anything. The kernel is asked by the caller, when nothing is locked.
    pub(crate) fn candidates<S: Scalar>(&self, key: &Key) -> Vec<(Arc<Operators<S>>, Option<u64>)> {
        let mut sets = self.locked();
        // Those that are asked for become the last to be forgotten.
        sets.sort_by_key(|set| set.key.is_like(key));
        let found = sets.iter().filter(|set| set.key.is_like(key));
        let typed = |set: &Known| {
            let operators = Arc::clone(&set.operators).into_any().downcast().ok()?;
            let is_known = key.identity != Identity::Values && key.identity == set.key.identity;
            let check = if is_known { None } else { Some(set.digest?) };
            Some((operators, check))
        };
        found.filter_map(typed).collect()
    }

    /// Whether the digest of values is needed to recognise operators with this key.
    pub(crate) fn needs_digest(&self, key: &Key) -> bool {
        match key.identity {
            Identity::Stated(_) => false,
            Identity::Code(_) => self.lasts,
            Identity::Values => true,
        }
    }

    /// Remembers operators, and forgets the ones that were used the longest ago.
    pub(crate) fn remember<S: Scalar>(
        &self,
        key: Key,
        operators: Arc<Operators<S>>,
        digest: Option<u64>,
    ) {
        let bytes = length(&*operators);
        self.keep(Known { key, operators, digest, bytes });
    }

    fn keep(&self, set: Known) {
        if set.bytes > self.capacity {
            return;
        }
        let mut sets = self.locked();
        sets.retain(|known| known.key != set.key || known.digest != set.digest);
        sets.push(set);
        // From the last on, as many as there is room for.
        let mut bytes = 0;
        let first = sets.iter().rposition(|known| {
            bytes += known.bytes;
            bytes > self.capacity
        });
        sets.drain(..first.map_or(0, |first| first + 1));
    }

    fn locked(&self) -> MutexGuard<'_, Vec<Known>> {
        self.sets.lock().unwrap_or_else(|e| e.into_inner())
    }
}

impl fmt::Debug for OperatorStore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("OperatorStore")
            .field("sets", &self.len())
            .field("bytes", &self.bytes())
            .field("capacity", &self.capacity)
            .finish_non_exhaustive()
    }
}
