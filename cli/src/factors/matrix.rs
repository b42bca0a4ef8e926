//! Exchange areas of groups as a matrix, and the factors that they make.

use farfield_radiosity::Occluders;
use rayon::prelude::*;

use super::exchange::exchange;
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
    /// The form factors, each of which is off by about the tolerance at most.
    ///
    /// # Errors
    /// [`Failure::TooMany`].
    pub(crate) fn new(
        groups: Groups,
        occluders: &Occluders,
        tolerance: f64,
    ) -> Result<Self, Failure> {
        let Groups { groups, sides, shares, masks } = groups;
        let count = groups.len();
        if count > MOST_GROUPS {
            return Err(Failure::TooMany { found: count, limit: MOST_GROUPS });
        }
        let mut factors = vec![0.0; count * count];
        let known: Vec<usize> = (0..sides.len()).filter(|&i| !shares[i].is_empty()).collect();
        for (chunk, rows) in known.chunks(ROWS).enumerate() {
            let row = |(place, &i): (usize, &usize)| -> Vec<(usize, usize, f64)> {
                let others = &known[chunk * ROWS + place + 1..];
                let with =
                    |&j: &usize| (i, j, exchange([&sides[i], &sides[j]], occluders, tolerance));
                others.iter().map(with).filter(|&(.., area)| area > 0.0).collect()
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
