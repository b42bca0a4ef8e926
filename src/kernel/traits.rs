//! What a kernel says of itself.

use num_traits::Float;

use crate::error::Error;
use crate::numbers::bits::for_each_set_bit;
use crate::numbers::traits::{Located, Numbers, Point, Real, Scalar};

/// The kernel of a sum, u(x_i) = Σ_j K(x_i, y_j) q_j, as a formula between bare points with attributes
/// applied on either side:
///
/// K(x, y) q = R_x [ G(x, y) · S_y q ]
///
/// | part | method | default |
/// |---|---|---|
/// | G(x, y): the formula, a small matrix of numbers | [`entries`](Self::entries) | none: the one that is required |
/// | S_y: what a source sends, *densities* from a charge | [`density`](Self::density) | the charge's own numbers |
/// | R_x: what a target makes of it, a value from *fields* | [`value`](Self::value) | the fields' own numbers |
///
/// G has a row per field and a column per density. Independent right-hand sides (colours, several charge
/// vectors) are [`columns`](Self::columns): they share G and never enlarge it. How many there are of
/// each is asked at run time; kernels that know it when they are compiled return a constant.
///
/// The formula must be finite wherever it is asked for. In a sum that is also at x = y if a source and
/// a target can coincide: whether a point acts on itself is the kernel's decision, and one that is
/// singular there gives zero. [`Interpolation`](crate::Interpolation) asks for it between other points
/// too.
///
/// Every other method may be left out. Whoever can sum a block faster than by its entries overrides
/// [`add_block`](Self::add_block).
///
/// [`conformance::check_kernel`](crate::conformance::check_kernel) tells whether a kernel's methods
/// agree with each other.
pub trait Kernel: Send + Sync {
    /// Precision of the coordinates, charges and values.
    type Real: Real;
    /// What acts: any type with a position.
    type Source: Located<Real = Self::Real>;
    /// What is acted upon: any type with a position.
    type Target: Located<Real = Self::Real>;
    /// What a source carries: a number, a vector, several right-hand sides in an array.
    type Charge: Numbers<Real = Self::Real>;
    /// What a target receives.
    type Value: Numbers<Real = Self::Real>;
    /// The number type of the formula: real or complex.
    type Entry: Scalar<Real = Self::Real>;

    /// Writes G(x, y) into `g`, row after row: [`fields`](Self::fields) × [`densities`](Self::densities)
    /// entries.
    fn entries(&self, x: Point<Self::Real>, y: Point<Self::Real>, g: &mut [Self::Entry]);

    /// How many fields a target receives: the rows of G.
    #[inline(always)]
    fn fields(&self) -> usize {
        1
    }

    /// How many densities a source sends: the columns of G.
    #[inline(always)]
    fn densities(&self) -> usize {
        1
    }

    /// How many independent right-hand sides ride along: by default as many as make up a charge, if each
    /// density takes one of its numbers, and 0 if that leaves a remainder. A kernel whose
    /// [`density`](Self::density) makes other numbers of a charge says it here.
    #[inline(always)]
    fn columns(&self) -> usize {
        columns_of_a_charge(self)
    }

    /// Refuses sizes that don't belong together. Called before every sum; the default finds kernels
    /// without fields or densities, and charges that the densities can't be taken from.
    ///
    /// # Errors
    /// [`Error::EmptyKernel`], [`Error::KernelSize`] or [`Error::UnknownColumns`].
    fn check_sizes(&self) -> Result<(), Error> {
        check_densities(self)
    }

    /// How many numbers a charge may have at most that is a list: by default one for each density in every
    /// column. Charges of a fixed length are not held against it.
    fn charge_len(&self) -> usize {
        Self::Entry::PARTS * self.densities() * self.columns()
    }

    /// Writes S_y q into `d`: for each density, its number in every column.
    #[inline(always)]
    fn density(&self, _y: &Self::Source, q: &Self::Charge, d: &mut [Self::Entry]) {
        for (k, d) in d.iter_mut().enumerate() {
            *d = q.column(k);
        }
    }

    /// Adds R_x f to `u`. `fields` holds, for each field, its number in every column; `gradients`
    /// ∂f/∂x in the same order if [`needs_gradients`](Self::needs_gradients), and nothing otherwise.
    ///
    /// The default takes a value for the fields themselves. One of another length becomes NaN.
    #[inline(always)]
    fn value(
        &self,
        _x: &Self::Target,
        fields: &[Self::Entry],
        _gradients: &[[Self::Entry; 3]],
        u: &mut Self::Value,
    ) {
        add_fields(u, fields);
    }

    /// Whether [`value`](Self::value) needs the fields' derivatives with respect to x.
    #[inline(always)]
    fn needs_gradients(&self) -> bool {
        false
    }

    /// Whether kernels of this type can differ in their formula: by default, unless they have no size. A plan
    /// takes the operators of another plan for granted only where they can't; otherwise it evaluates the
    /// formula at a quarter of the places that they came from.
    fn has_parameters(&self) -> bool {
        size_of_val(self) > 0
    }

    /// What tells this kernel from all others with entries of its type, its parameters included, in any program: such as
    /// `"yukawa 2.5"`. Operators that an [`OperatorStore`](crate::OperatorStore) holds are recognised by it, rather than
    /// by values that they were built from. By default there is none. A kernel that states an identity and changes
    /// its formula changes that too.
    fn identity(&self) -> Option<String> {
        None
    }

    /// About how many seconds one core takes for a pair in [`add_block`](Self::add_block), each off by the
    /// relative error `tolerance` at most.
    ///
    /// Schemes and sizes of leaves follow from it, so that they are the same in every run: nothing is measured
    /// unless a plan is [tuned](crate::Builder::tuned). Sums are right whatever is said here. The default is two
    /// nanoseconds, and two more for each product of an entry and a density. A kernel that is much slower says so, for
    /// the sake of speed; for a closure, [`Builder::pair_seconds`](crate::Builder::pair_seconds) does.
    fn pair_seconds(&self, _tolerance: f64) -> f64 {
        let products = self.fields() * self.densities() * self.columns();
        let parts = if self.needs_gradients() { 4 } else { 1 };
        2e-9 * (1 + parts * products) as f64
    }

    /// Writes ∂G(x, y)/∂x into `g`, in the order of the entries. A kernel that
    /// [needs gradients](Self::needs_gradients) must give them.
    fn entry_gradients(
        &self,
        _x: Point<Self::Real>,
        _y: Point<Self::Real>,
        _g: &mut [[Self::Entry; 3]],
    ) -> Outcome {
        Outcome::Declined
    }

    /// The largest |G(x, y)| and, if the kernel [needs gradients](Self::needs_gradients), the largest |∂G(x, y)/∂x|
    /// (0 otherwise), as far as double precision reaches; 0 only where they are zero. Before sums over points that
    /// extend very far, or very little, some pairs are asked: if the precision of the kernel is lost on most of
    /// what it gives there, the sum is [refused](Error::KernelOutOfRange). `None` if the kernel doesn't know.
    fn sizes(&self, _x: Point<Self::Real>, _y: Point<Self::Real>) -> Option<[f64; 2]> {
        None
    }

    /// Writes G(x_i, y_j) for all pairs of a block into `g`: the entries of the pair (i, j) start at
    /// (i · `ys.len()` + j) · fields · densities.
    ///
    /// The near field and the set-up of expansions both go through it. The default asks for one pair after
    /// the other; a [`Formula`](crate::Formula) is evaluated for several pairs side by side.
    fn entries_block(
        &self,
        xs: &[Point<Self::Real>],
        ys: &[Point<Self::Real>],
        g: &mut [Self::Entry],
    ) {
        let len = self.fields() * self.densities();
        let pairs = xs.iter().flat_map(|x| ys.iter().map(move |y| (*x, *y)));
        for ((x, y), g) in pairs.zip(g.chunks_exact_mut(len.max(1))) {
            self.entries(x, y, g);
        }
    }

    /// Adds Σ_j K(x_i, y_j) q_j to `us[i]` for every target of a block: as many `us` as `xs`, as many
    /// `qs` as `ys`. Each K(x_i, y_j) may be off by the relative error `tolerance`; 0 asks for all
    /// digits.
    ///
    /// The default takes the entries of the whole block. Override it to do better, or where what a pair
    /// contributes is more than a formula of its positions; each target's sum must keep one fixed order of
    /// its own.
    fn add_block(
        &self,
        xs: &[Self::Target],
        ys: &[Self::Source],
        qs: &[Self::Charge],
        _tolerance: f64,
        us: &mut [Self::Value],
    ) {
        add_by_entries(self, xs, ys, qs, us);
    }

    /// Adds K(x_i, y_j) q_j to `us[i]` for the pairs of a block whose bit is set: bit i·n + j, counted
    /// through the words of `bits`, is that of the i-th target and the j-th of n sources. As
    /// [`add_block`](Self::add_block) otherwise.
    ///
    /// The default sums blocks of one pair after the other.
    fn add_pairs(
        &self,
        xs: &[Self::Target],
        ys: &[Self::Source],
        qs: &[Self::Charge],
        bits: &[u64],
        tolerance: f64,
        us: &mut [Self::Value],
    ) {
        for (i, (x, u)) in xs.chunks(1).zip(us.chunks_mut(1)).enumerate() {
            for_each_set_bit(bits, i, ys.len(), |j| {
                self.add_block(x, &ys[j..=j], &qs[j..=j], tolerance, u);
            });
        }
    }
}

/// Whether an optional operator did its work. One that declines must leave its output untouched;
/// the engine then sums directly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub enum Outcome {
    /// The result has been added.
    Done,
    /// Nothing has been added.
    Declined,
}

/// Adds the fields' own numbers to a value. One of another length becomes NaN.
#[inline(always)]
pub(crate) fn add_fields<U: Numbers, S: Scalar<Real = U::Real>>(u: &mut U, fields: &[S]) {
    if U::LEN > 0 && U::LEN != S::PARTS * fields.len() {
        (0..U::LEN).for_each(|i| u.set_number(i, <U::Real as Float>::nan()));
        return;
    }
    for (k, &field) in fields.iter().enumerate() {
        u.set_column(k, u.column::<S>(k) + field);
    }
}

/// How many columns a charge of fixed length holds; 0 if there is a remainder, or no fixed length.
#[inline(always)]
pub(crate) fn columns_of_a_charge<K: Kernel + ?Sized>(kernel: &K) -> usize {
    let each = (K::Entry::PARTS * kernel.densities()).max(1);
    if K::Charge::LEN.is_multiple_of(each) { K::Charge::LEN / each } else { 0 }
}

/// Refuses kernels without fields or densities, and charges that the densities can't be taken from.
pub(crate) fn check_densities<K: Kernel + ?Sized>(kernel: &K) -> Result<(), Error> {
    let (fields, densities) = (kernel.fields(), kernel.densities());
    if fields == 0 || densities == 0 {
        return Err(Error::EmptyKernel { fields, densities });
    }
    if kernel.columns() == 0 && K::Charge::LEN > 0 {
        let (expected, found) = (K::Entry::PARTS * densities, K::Charge::LEN);
        return Err(Error::KernelSize { what: "charge", expected, found });
    }
    // Charges that are lists don't say how many columns they hold.
    if kernel.columns() == 0 && size_of::<K::Charge>() > 0 {
        return Err(Error::UnknownColumns);
    }
    Ok(())
}

/// Adds the sums of a block, R_x Σ_j G(x, y_j) S_y q_j, target by target.
pub(crate) fn add_by_entries<K: Kernel + ?Sized>(
    kernel: &K,
    xs: &[K::Target],
    ys: &[K::Source],
    qs: &[K::Charge],
    us: &mut [K::Value],
) {
    let (fields, densities, columns) = (kernel.fields(), kernel.densities(), kernel.columns());
    if ys.is_empty() || fields * densities * columns == 0 {
        return;
    }
    let zero = <K::Entry as Numbers>::zero();
    let positions: Vec<_> = ys.iter().map(Located::position).collect();
    let mut sent = vec![zero; ys.len() * densities * columns];
    for ((y, q), d) in ys.iter().zip(qs).zip(sent.chunks_exact_mut(densities * columns)) {
        kernel.density(y, q, d);
    }
    let slopes = kernel.needs_gradients();
    let mut g = vec![zero; ys.len() * fields * densities];
    let mut dg = vec![[zero; 3]; if slopes { fields * densities } else { 0 }];
    let mut received = vec![zero; fields * columns];
    let mut gradients = vec![[zero; 3]; if slopes { fields * columns } else { 0 }];
    for (x, u) in xs.iter().zip(us) {
        received.fill(zero);
        gradients.fill([zero; 3]);
        let position = x.position();
        kernel.entries_block(&[position], &positions, &mut g);
        let pairs = g.chunks_exact(fields * densities).zip(sent.chunks_exact(densities * columns));
        for ((g, d), &y) in pairs.zip(&positions) {
            // For each column, the field that entry k adds to and the density that it takes.
            let columns_of = |k: usize| {
                let (field, density) = (k / densities * columns, k % densities * columns);
                (0..columns).map(move |column| (field + column, d[density + column]))
            };
            for (k, &entry) in g.iter().enumerate() {
                columns_of(k).for_each(|(field, d)| received[field] += entry * d);
            }
            if slopes {
                if kernel.entry_gradients(position, y, &mut dg) == Outcome::Declined {
                    // No gradient is not a gradient of zero: NaN is seen by the engine and named.
                    dg.fill([K::Entry::from_real(<K::Real as Float>::nan()); 3]);
                }
                for (k, slope) in dg.iter().enumerate() {
                    for (field, d) in columns_of(k) {
                        gradients[field].iter_mut().zip(slope).for_each(|(g, &s)| *g += s * d);
                    }
                }
            }
        }
        kernel.value(x, &received, &gradients, u);
    }
}
