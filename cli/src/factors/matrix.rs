//! Exchange areas of groups as a matrix, and the factors that they make.

use std::sync::atomic::{AtomicUsize, Ordering};

use farfield_radiosity::{Occluders, visible_exchange_area};
use rayon::prelude::*;

use super::failure::Failure;
use super::groups::{Group, Groups};

/// Form factors between groups.
#[derive(Clone, Debug)]
pub(crate) struct Matrix {
    /// The groups.
    pub(crate) groups: Vec<Group>,
    /// F_ij, row by row.
    pub(crate) factors: Vec<f64>,
}

/// Groups at most: the matrix takes 3.2 GB then.
const MOST_GROUPS: usize = 20_000;
/// Rows of sides whose exchange is kept before it is added up.
const ROWS: usize = 64;
/// Reflections that are followed at most, and what they may leave.
const MOST_REFLECTIONS: usize = 10_000;
const LEFT: f64 = 1e-9;

impl Matrix {
    /// The form factors, each of which is off by about the tolerance at most. `report` is told the share of the
    /// pairs that is done.
    ///
    /// # Errors
    /// [`Failure::TooMany`].
    pub(crate) fn new(
        groups: Groups,
        occluders: &Occluders,
        tolerance: f64,
        report: impl Fn(f64) + Sync,
    ) -> Result<Self, Failure> {
        let Groups { groups, sides, shares, masks } = groups;
        let count = groups.len();
        if count > MOST_GROUPS {
            return Err(Failure::TooMany { found: count, limit: MOST_GROUPS });
        }
        let mut factors = vec![0.0; count * count];
        let known: Vec<usize> = (0..sides.len()).filter(|&i| !shares[i].is_empty()).collect();
        let (pairs, done) = (known.len() * known.len().saturating_sub(1) / 2, AtomicUsize::new(0));
        for (chunk, rows) in known.chunks(ROWS).enumerate() {
            let row = |(place, &i): (usize, &usize)| -> Vec<(usize, usize, f64)> {
                let others = &known[chunk * ROWS + place + 1..];
                let with = |&j: &usize| {
                    (i, j, visible_exchange_area(&sides[i], &sides[j], occluders, tolerance))
                };
                let found = others.iter().map(with).filter(|&(.., area)| area > 0.0).collect();
                let before = done.fetch_add(others.len(), Ordering::Relaxed);
                report((before + others.len()) as f64 / pairs.max(1) as f64);
                found
            };
            let found: Vec<Vec<_>> = rows.par_iter().enumerate().map(row).collect();
            for (i, j, area) in found.into_iter().flatten() {
                for &(g, s) in &shares[i] {
                    for &(h, t) in &shares[j] {
                        factors[g * count + h] += s * t * area;
                        factors[h * count + g] += s * t * area;
                    }
                }
            }
        }
        for (mask, base, area) in masks {
            factors[mask * count + base] += area;
            factors[base * count + mask] += area;
        }
        for (row, group) in factors.chunks_mut(count.max(1)).zip(&groups) {
            // What is left of rounding where a group has no area.
            let scale = if group.area > 0.0 { group.area.recip() } else { 0.0 };
            row.iter_mut().for_each(|factor| *factor = (scale * *factor).max(0.0));
        }
        Ok(Self { groups, factors })
    }

    /// The factors between some groups, each summed over all of one name. The error is the first name that no
    /// group has.
    pub(crate) fn between(&self, names: &[String]) -> Result<Self, String> {
        let groups = &self.groups;
        let mut sums: Vec<Group> = Vec::new();
        for name in names {
            if sums.iter().any(|sum| sum.name == *name) {
                continue;
            }
            let mut own = groups.iter().filter(|group| group.name == *name).peekable();
            own.peek().ok_or_else(|| name.clone())?;
            let zero = Group { name: name.clone(), ..Group::default() };
            sums.push(own.fold(zero, |sum, group| Group {
                area: sum.area + group.area,
                emitting: sum.emitting + group.emitting,
                ..sum
            }));
        }
        let place = |group: &Group| sums.iter().position(|sum| sum.name == group.name);
        let places: Vec<Option<usize>> = groups.iter().map(place).collect();
        let mut factors = vec![0.0; sums.len() * sums.len()];
        for (row, (group, from)) in groups.iter().zip(&places).enumerate() {
            let Some(from) = *from else { continue };
            let share = if group.area > 0.0 { group.area / sums[from].area } else { 0.0 };
            for (column, to) in places.iter().enumerate() {
                if let Some(to) = *to {
                    factors[from * sums.len() + to] +=
                        share * self.factors[row * groups.len() + column];
                }
            }
        }
        Ok(Self { groups: sums, factors })
    }

    /// The emissivity of a group: the mean over its area.
    pub(crate) fn emissivity(&self, group: usize) -> f64 {
        let Group { area, emitting, .. } = self.groups[group];
        if area > 0.0 { (emitting / area).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// Hottel's factors, which include all reflections: ε_i ((1 − F ρ)⁻¹ F)_ij ε_j (Hottel and Sarofim, "Radiative
    /// Transfer", 1967).
    ///
    /// # Errors
    /// [`Failure::White`] if light is reflected without end.
    pub(crate) fn reflecting(&self) -> Result<Self, Failure> {
        let count = self.groups.len();
        let emissivity: Vec<f64> = (0..count).map(|k| self.emissivity(k)).collect();
        let mut all = self.factors.clone();
        for _ in 0..MOST_REFLECTIONS {
            let next: Vec<f64> = (0..count)
                .into_par_iter()
                .flat_map_iter(|i| {
                    let mut row = self.factors[i * count..][..count].to_vec();
                    for k in 0..count {
                        let factor = self.factors[i * count + k] * (1.0 - emissivity[k]);
                        let others = &all[k * count..][..count];
                        row.iter_mut().zip(others).for_each(|(sum, x)| *sum += factor * x);
                    }
                    row
                })
                .collect();
            let change = next.iter().zip(&all).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            all = next;
            if change <= LEFT {
                for (k, factor) in all.iter_mut().enumerate() {
                    *factor *= emissivity[k / count] * emissivity[k % count];
                }
                return Ok(Self { groups: self.groups.clone(), factors: all });
            }
        }
        Err(Failure::White)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_summed_over_all_of_one_name_by_their_areas() {
        let group = |name: &str, area| Group { name: name.to_owned(), area, emitting: 0.5 * area };
        let groups = vec![group("a", 1.0), group("b", 4.0), group("a", 3.0)];
        let factors = vec![0.0, 0.4, 0.6, 0.1, 0.0, 0.3, 0.2, 0.4, 0.1];
        let matrix = Matrix { groups, factors };
        let sum = matrix.between(&["b", "a", "b"].map(str::to_owned)).expect("known");
        assert_eq!(sum.groups, [group("b", 4.0), group("a", 4.0)]);
        let expected = [0.0, 0.4, 0.4, 0.25 * 0.6 + 0.75 * 0.3];
        assert!(sum.factors.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-15), "{sum:?}");
        assert_eq!(matrix.between(&["c".to_owned()]).expect_err("unknown"), "c");
    }
}
