//! The level of light in closed parts, taken from what is absorbed instead of from bounces.

use std::borrow::Cow;

use crate::error::{Error, check_length};
use crate::operator::RadiosityOperator;

/// The radiosity equation of an operator with the even glow of its closed parts solved beforehand.
///
/// Light in a closed part whose surfaces absorb next to nothing bounces about for ever: an iteration takes
/// 1/(1 − ρ) steps, and rounding grows by as much. But how bright such a part is on the whole follows from
/// its balance alone: with z = 1 on its reflecting elements and M = A/ρ − A H, ⟨M z, B⟩ = ⟨z, A E/ρ⟩. With
/// g = M z, g B is therefore known, and
///
/// E″ = E + ρ A⁻¹ τ g ⟨g, B⟩,   H″ = H − A⁻¹ τ g gᵀ
///
/// have the same solution, and no slow mode: H″ takes an even glow to next to nothing. They are reciprocal
/// as H is, and E″ is not negative (Nicolaides, "Deflation of conjugate gradients", SIAM J. Numer. Anal. 24,
/// 1987). With τ = 1/⟨g, A⁻¹ g⟩ what is taken from H is a projection. Parts that absorb more than a tenth of
/// what they reflect stay as they are.
#[derive(Debug)]
pub struct Balance<'a, 'b, const BANDS: usize> {
    operator: &'b RadiosityOperator<'a, BANDS>,
    /// E.
    own: &'b [[f64; BANDS]],
    /// E″.
    emission: Cow<'b, [[f64; BANDS]]>,
    /// √τ g; empty where nothing has changed.
    weights: Vec<[f64; BANDS]>,
}

/// Parts that absorb a larger share than this of what reaches their reflecting surfaces are left alone.
const ABSORBED: f64 = 0.1;

impl<'a, const BANDS: usize> RadiosityOperator<'a, BANDS> {
    /// The equation B = E + ρ H(B) balanced for the parts that [`close_parts`](Self::close_parts) has closed.
    /// One sum if some element of such a part reflects nothing, none otherwise.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`]; [`Error::NothingAbsorbs`] if a closed part is lit and none of it absorbs
    /// anything; those of the sum.
    pub fn balance<'b>(
        &'b self,
        emission: &'b [[f64; BANDS]],
        reflectance: &[[f64; BANDS]],
    ) -> Result<Balance<'a, 'b, BANDS>, Error> {
        check_length("emission", emission.len(), self.areas.len())?;
        check_length("reflectance", reflectance.len(), self.areas.len())?;
        let unchanged = Cow::Borrowed(emission);
        let mut balance =
            Balance { operator: self, own: emission, emission: unchanged, weights: Vec::new() };
        let reflects = |i: usize, k: usize| reflectance[i][k] > 0.0;
        // H z: 1 where all of the part reflects.
        let all_reflect = |i: usize| (0..BANDS).all(|k| reflects(i, k));
        let seen = if self.in_parts().all(|(i, _)| all_reflect(i)) {
            vec![[1.0; BANDS]; self.areas.len()]
        } else {
            let z: Vec<[f64; BANDS]> = (0..self.areas.len())
                .map(|i| std::array::from_fn(|k| f64::from(u8::from(reflects(i, k)))))
                .collect();
            self.apply(&z)?
        };
        // Σ A over the reflecting elements, Σ g, ⟨z, A E/ρ⟩ and ⟨g, A⁻¹ g⟩, part by part.
        let mut sums = vec![[[0.0; 4]; BANDS]; self.part_count()];
        let g = |i: usize, k: usize| {
            let rho = reflectance[i][k];
            // (1 − ρ)/ρ + (1 − w) keeps the digits that 1/ρ − w loses.
            let lost = (1.0 - rho) / rho + (1.0 - seen[i][k]).max(0.0);
            if rho > 0.0 { self.areas[i] * lost } else { 0.0 }
        };
        for (i, part) in self.in_parts() {
            for k in 0..BANDS {
                let (rho, area, e) = (reflectance[i][k], self.areas[i], emission[i][k]);
                let sums = &mut sums[part][k];
                sums[0] += if rho > 0.0 { area } else { 0.0 };
                sums[1] += g(i, k);
                sums[2] += if rho > 0.0 { area * e / rho } else { area * e * seen[i][k] };
                sums[3] += g(i, k).powi(2) / area;
            }
        }
        for (k, &[area, absorbed, emitted, _]) in
            sums.iter().flat_map(|part| part.iter().enumerate())
        {
            if area > 0.0 && absorbed <= 0.0 && emitted > 0.0 {
                return Err(Error::NothingAbsorbs { band: k });
            }
        }
        let slow = |[area, absorbed, ..]: [f64; 4]| absorbed > 0.0 && absorbed < ABSORBED * area;
        if !sums.iter().flatten().any(|&sums| slow(sums)) {
            return Ok(balance);
        }
        balance.weights = vec![[0.0; BANDS]; self.areas.len()];
        let emission = balance.emission.to_mut();
        for (i, part) in self.in_parts() {
            for k in 0..BANDS {
                let [.., emitted, squares] = sums[part][k];
                if slow(sums[part][k]) {
                    let root = squares.sqrt().recip();
                    let weight = root * g(i, k);
                    balance.weights[i][k] = weight;
                    emission[i][k] +=
                        reflectance[i][k] * (weight / self.areas[i]) * (root * emitted);
                }
            }
        }
        Ok(balance)
    }

    /// The elements of closed parts, and the part of each.
    fn in_parts(&self) -> impl Iterator<Item = (usize, usize)> + Clone {
        let parts = self.parts.iter().enumerate();
        parts.filter_map(|(i, part)| part.map(|part| (i, part as usize)))
    }
}

impl<const BANDS: usize> Balance<'_, '_, BANDS> {
    /// E.
    pub(crate) fn own(&self) -> &'_ [[f64; BANDS]] {
        self.own
    }

    /// E″.
    pub fn emission(&self) -> &[[f64; BANDS]] {
        &self.emission
    }

    /// H, from which H″ was made.
    pub(crate) fn operator(&self) -> &RadiosityOperator<'_, BANDS> {
        self.operator
    }

    /// Whether it differs from the equation that it was made from.
    pub fn is_changed(&self) -> bool {
        !self.weights.is_empty()
    }

    /// H″.
    ///
    /// # Errors
    /// Those of [`RadiosityOperator::apply`].
    pub fn apply(&self, radiosity: &[[f64; BANDS]]) -> Result<Vec<[f64; BANDS]>, Error> {
        let mut irradiance = self.operator.apply(radiosity)?;
        if self.is_changed() {
            let mut dots = vec![[0.0; BANDS]; self.operator.part_count()];
            for (i, part) in self.operator.in_parts() {
                for k in 0..BANDS {
                    dots[part][k] += self.weights[i][k] * radiosity[i][k];
                }
            }
            for (i, part) in self.operator.in_parts() {
                for k in 0..BANDS {
                    irradiance[i][k] -= self.weights[i][k] / self.operator.areas[i] * dots[part][k];
                }
            }
        }
        Ok(irradiance)
    }

    /// What H″ has more than H of the irradiance of element `to` per unit of radiosity of element `from`,
    /// in one band.
    pub fn change(&self, to: usize, from: usize, band: usize) -> f64 {
        let parts = &self.operator.parts;
        let same = parts.get(to).is_some_and(|part| part.is_some() && *part == parts[from]);
        if !(self.is_changed() && same) {
            return 0.0;
        }
        let [to_weight, from_weight] = [to, from].map(|i| self.weights[i][band]);
        -to_weight / self.operator.areas[to] * from_weight
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operator::radiosity_operator::tests::plain;
    use crate::{Solution, Stop, bicgstab, conjugate_gradients, furnace, jacobi};

    const STOP: Stop = Stop { tolerance: 1e-7, max_iterations: 60 };

    /// The solution by each of three solvers, and by one of them for what is reflected.
    fn solutions(
        emission: &[[f64; 1]],
        reflectance: &[[f64; 1]],
    ) -> Result<[Solution<f64, 1>; 4], Error> {
        let scene = furnace(4);
        let mut operator = plain(&scene);
        operator.close_parts(vec![Some(0); scene.surfels.len()], 0.5)?;
        let balance = operator.balance(emission, reflectance)?;
        let (e, apply) = (balance.emission(), |b: &[[f64; 1]]| balance.apply(b));
        Ok([
            conjugate_gradients(&scene.surfels, e, reflectance, STOP, apply, |_, _| ())?,
            jacobi(e, reflectance, STOP, apply, |_, _| ())?,
            bicgstab(e, reflectance, STOP, apply, |_, _| ())?,
            balance.solve(reflectance, |e| {
                conjugate_gradients(&scene.surfels, e, reflectance, STOP, apply, |_, _| ())
            })?,
        ])
    }

    #[test]
    fn a_furnace_glows_by_its_balance_however_little_it_absorbs() {
        for k in 2..=9 {
            let exact = 10f64.powi(k);
            let even = solutions(&[[1.0]; 96], &[[1.0 - 1.0 / exact]; 96]).unwrap();
            let mut lamp = [[0.0]; 96];
            lamp[..16].fill([6.0]);
            let lit = solutions(&lamp, &[[1.0 - 1.0 / exact]; 96]).unwrap();
            for solution in even.iter().chain(&lit) {
                let mean = solution.radiosity.iter().map(|b| b[0]).sum::<f64>() / 96.0;
                assert!((mean / exact - 1.0).abs() < 1e-5, "{k}: {mean:e}");
            }
            for b in even.iter().flat_map(|solution| &solution.radiosity) {
                assert!((b[0] / exact - 1.0).abs() < 1e-5, "{k}: {b:?}");
            }
        }
    }

    #[test]
    fn adiabatic_walls_keep_the_balance_of_the_one_element_that_absorbs() {
        let scene = furnace(4);
        let mut operator = plain(&scene);
        operator.close_parts(vec![Some(0); scene.surfels.len()], 0.5).unwrap();
        let mut emission = vec![[0.0]; 96];
        emission[40] = [1.0];
        for absorbing in [0.0, 1.0 - 1e-9, 0.3] {
            let mut reflectance = vec![[1.0]; 96];
            reflectance[0] = [absorbing];
            let balance = operator.balance(&emission, &reflectance).unwrap();
            assert!(balance.is_changed());
            let (e, apply) = (balance.emission(), |b: &[[f64; 1]]| balance.apply(b));
            let surfels = &scene.surfels;
            let b = conjugate_gradients(surfels, e, &reflectance, STOP, apply, |_, _| ()).unwrap();
            let h = operator.apply(&b.radiosity).unwrap();
            let reflected = balance.solve(&reflectance, |e| {
                conjugate_gradients(surfels, e, &reflectance, STOP, apply, |_, _| ())
            });
            // It takes all that is emitted.
            for h in [h, reflected.unwrap().irradiance] {
                assert!(((1.0 - absorbing) * h[0][0] - 1.0).abs() < 1e-4, "{absorbing} {:?}", h[0]);
            }
        }
    }

    #[test]
    fn a_room_that_absorbs_nothing_is_refused_if_lit() {
        let error = solutions(&[[1.0]; 96], &[[1.0]; 96]).unwrap_err();
        assert_eq!(error, Error::NothingAbsorbs { band: 0 });
        for dark in solutions(&[[0.0]; 96], &[[1.0]; 96]).unwrap() {
            assert!(dark.radiosity.iter().all(|b| *b == [0.0]));
        }
    }

    #[test]
    fn changes_of_single_pairs_are_those_of_the_whole() {
        let scene = furnace(2);
        let mut operator = plain(&scene);
        operator.close_parts(vec![Some(0); scene.surfels.len()], 0.5).unwrap();
        let reflectance: Vec<_> = (0..24).map(|i| [1.0 - 1e-3 * (1.0 + i as f64)]).collect();
        let emission = [[1.0]; 24];
        let balance = operator.balance(&emission, &reflectance).unwrap();
        assert!(balance.is_changed());
        let mut unit = [[0.0]; 24];
        unit[5] = [1.0];
        let (plain, changed) = (operator.apply(&unit).unwrap(), balance.apply(&unit).unwrap());
        for i in 0..24 {
            assert!((plain[i][0] + balance.change(i, 5, 0) - changed[i][0]).abs() < 1e-12);
        }
    }
}
