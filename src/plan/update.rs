//! A plan for points that have moved.

use crate::error::Error;
use crate::expansion::{Expansion, SourceOf, TargetOf};
use crate::kernel::mask::{Mask, Unmasked};
use crate::plan::builder::Builder;
use crate::plan::choices::Choices;
use crate::plan::fmm::Fmm;

impl<E: Expansion + Clone> Fmm<E> {
    /// Makes the plan one for other points: those that have moved, or any others, more of them or fewer.
    ///
    /// Everything that was chosen for the plan holds on, and what was left open is decided for the new points as
    /// [`build`](crate::Builder::build) decides it: leaf size and scheme, orders, which pairs of cells are carried. Trees and
    /// lists are made anew, and how strongly each level acts is measured anew. So the tolerance promises what it
    /// promises for a plan that is built, whatever shape the points have taken. The sums differ from those of
    /// such a plan in rounding and within the tolerance, because two things are kept:
    ///
    /// * *The sizes of cells.* The root's edge is that of the first plan times a power of two: up to twice the
    ///   longest extent of the points, where `build` has at most an eighth more. A kernel that is no power of a length
    ///   is asked for distances as long as that.
    /// * *Operators that still serve.* The expansion is cloned, and prepared for the new points. A clone of an
    ///   [`Interpolation`](crate::Interpolation) has the operators at hand that were used before, and takes them for all
    ///   levels for which they are exact enough, and not much more exact than that; it builds others for the levels that
    ///   are new. Those of a homogeneous kernel serve cells of any size.
    ///
    /// Cost: O(N log N) for trees and lists, and for operators what is new of them; `build` looks for these in its
    /// [`OperatorStore`](crate::OperatorStore) only, and recognises them by values of the kernel.
    ///
    /// ```
    /// use farfield::{Fmm, direct, formula, relative_l2_error};
    ///
    /// let mut points: Vec<[f64; 3]> = (0..3000).map(|i| [0.755, 0.570, 0.362].map(|s| (s * f64::from(i)).fract())).collect();
    /// let masses = vec![1.0; points.len()];
    /// let kernel = formula!(|d| (-d.length()).exp());
    /// let mut fmm = Fmm::builder(kernel).tolerance(1e-4).build(&points, &points)?;
    /// for _step in 0..3 {
    ///     points.iter_mut().for_each(|[x, y, _]| (*x, *y) = (*x - 0.1 * *y, *y + 0.1 * *x));
    ///     fmm.update(&points, &points)?;
    ///     let exact = direct(&kernel, &points, &masses, &points)?;
    ///     assert!(relative_l2_error(&fmm.apply(&masses)?, &exact) < 1e-4);
    /// }
    /// # Ok::<(), farfield::Error>(())
    /// ```
    ///
    /// # Errors
    /// Those of [`build`](crate::Builder::build), and [`Error::MaskNeeded`] for a plan with a mask, which
    /// [`update_masked`](Self::update_masked) takes. The plan stays as it was then.
    pub fn update(
        &mut self,
        sources: &[SourceOf<E>],
        targets: &[TargetOf<E>],
    ) -> Result<(), Error> {
        if self.choices.masked {
            return Err(Error::MaskNeeded);
        }
        self.replace(Unmasked, self.choices.clone(), sources, targets)
    }

    /// As [`update`](Self::update), with a mask that is asked anew; pass a reference to keep it. The plan may have had
    /// another before, or none.
    ///
    /// # Errors
    /// Those of [`build`](crate::Builder::build). The plan stays as it was then.
    pub fn update_masked(
        &mut self,
        sources: &[SourceOf<E>],
        targets: &[TargetOf<E>],
        mask: impl Mask<E::Kernel>,
    ) -> Result<(), Error> {
        let choices = Choices { masked: true, ..self.choices.clone() };
        self.replace(mask, choices, sources, targets)
    }

    fn replace<M: Mask<E::Kernel>>(
        &mut self,
        mask: M,
        choices: Choices<'static>,
        sources: &[SourceOf<E>],
        targets: &[TargetOf<E>],
    ) -> Result<(), Error> {
        let expansion = self.expansion().clone();
        *self = Builder { expansion, mask, choices }.build(sources, targets)?;
        Ok(())
    }
}
