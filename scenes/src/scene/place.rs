//! Where surfaces come from and where they are, in words, for messages.

use glam::DVec3;

/// Surfaces that come from one file, one after the other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Part {
    /// The name of the file; empty for a mesh that was in memory.
    pub file: String,
    /// What its entries are: faces, say.
    pub kind: &'static str,
    /// Index of the first of the surfaces.
    pub first: usize,
    /// For each surface the number of its entry in the file, from 1; of a mesh in memory, from 0.
    pub numbers: Vec<u32>,
}

impl Part {
    /// Keeps the names of surfaces that were cut or left out. `origins` has for each surface that there is now the one
    /// that it was, or was a part of, in their order.
    pub(crate) fn follow(&mut self, origins: &[usize]) {
        let start = origins.partition_point(|&origin| origin < self.first);
        let own = origins[start..].iter().map_while(|origin| self.numbers.get(origin - self.first));
        self.numbers = own.copied().collect();
        self.first = start;
    }

    /// A surface as the file has it; none if it isn't from this file.
    pub(crate) fn entry(&self, surface: usize) -> Option<String> {
        let number = self.numbers.get(surface.checked_sub(self.first)?)?;
        let whose = if self.file.is_empty() { String::new() } else { format!(" of {}", self.file) };
        Some(format!("{} {number}{whose}", self.kind))
    }
}

/// A place with as many digits as tell it from others.
pub(crate) fn rounded(place: DVec3) -> String {
    let [x, y, z] = place.to_array().map(|x| {
        let digits = format!("{x:.3e}").parse().unwrap_or(x);
        // Adding zero turns −0 into 0.
        if (digits + 0.0f64).abs() < 1e-12 { 0.0 } else { digits }
    });
    format!("({x}, {y}, {z})")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_have_the_digits_that_matter() {
        let place = DVec3::new(1e6, -2.5e-7, 1e-15);
        assert_eq!(rounded(place), "(1000000, -0.00000025, 0)");
        assert_eq!(rounded(DVec3::new(1.0 / 3.0, -0.0, -70.0 / 30.0)), "(0.3333, 0, -2.333)");
        assert_eq!(rounded(DVec3::NAN), "(NaN, NaN, NaN)");
    }
}
