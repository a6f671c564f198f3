//! Uncertain keys that depend on each other.
//!
//! ```text
//! "KEY" = { uniform = [low, high], correlation = { "OTHER KEY" = r } }        -1 < r < 1
//! ```
//!
//! A Gaussian copula (R. B. Nelsen, *An Introduction to Copulas*, 2006, section 2.3): each key's share of probability p is the one of a
//! standard normal number z = Phi^-1(p), the z of all keys have the correlation matrix R, and each key keeps its own distribution.
//! Independent z become z' = L z with R = L L^T. For two normal keys r is their own correlation, for others nearly so.

use nalgebra::{Cholesky, DMatrix, DVector};
use statrs::distribution::{ContinuousCDF as _, Normal};

use super::SceneError;
use super::check::Check;
use super::uncertainty::{CORRELATION, Recorded, Uncertain, inconsistent};

/// How the keys of a scene depend on each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Dependence {
    /// L; none where the keys are independent.
    factor: Option<DMatrix<f64>>,
}

impl Dependence {
    /// That of some keys, in their order.
    ///
    /// # Errors
    /// Place of a key among them and what is wrong: a correlation with itself or with a key that is not uncertain, two numbers for one pair, or
    /// correlations that no numbers can have together.
    pub fn of(keys: &[Uncertain]) -> Result<Self, (usize, String)> {
        if keys.iter().all(|one| one.correlation.is_empty()) {
            return Ok(Self { factor: None });
        }
        let mut r = DMatrix::identity(keys.len(), keys.len());
        for (i, one) in keys.iter().enumerate() {
            for (other, &number) in &one.correlation {
                let j = keys.iter().position(|known| known.key == *other).filter(|j| *j != i);
                let Some(j) = j else {
                    return Err((i, format!("{CORRELATION} with {other}, which is no other key of [uncertainty]")));
                };
                let back = keys.get(j).and_then(|other| other.correlation.get(&one.key)).copied();
                if back.is_some_and(|back| back != number) {
                    return Err((i, format!("{CORRELATION} with {other} is {number} here and another number there")));
                }
                r[(i, j)] = number;
                r[(j, i)] = number;
            }
        }
        let last = keys.iter().rposition(|one| !one.correlation.is_empty()).unwrap_or(0);
        let factor = Cholesky::new(r).ok_or_else(|| {
            (
                last,
                format!("no numbers have these values of {CORRELATION} together (the matrix is not positive definite)"),
            )
        })?;
        Ok(Self { factor: Some(factor.l()) })
    }

    /// Shares of probability of the keys from independent ones, all above 0 and below 1.
    #[must_use]
    pub fn shares(&self, independent: Vec<f64>) -> Vec<f64> {
        let (Some(l), Ok(normal)) = (&self.factor, Normal::new(0.0, 1.0)) else { return independent };
        let z = l * DVector::from_iterator(independent.len(), independent.iter().map(|&p| normal.inverse_cdf(p)));
        let inside = |p: f64| p.clamp(f64::MIN_POSITIVE, 1.0 - f64::EPSILON / 2.0);
        z.iter().map(|&z| inside(normal.cdf(z))).collect()
    }
}

impl Check<'_> {
    /// Every uncertain key is one that this scene has.
    pub(super) fn uncertainty(&self) -> Result<(), SceneError> {
        let absent = |one: &&Uncertain| Recorded::of(&one.key).is_none() && self.scene.get(&one.key).is_none();
        let refuse =
            |one: &Uncertain, reason| Err(inconsistent(&one.key, &one.to_string(), self.values.origin(), reason));
        if let Some(one) = self.scene.uncertainty.iter().find(absent) {
            return refuse(one, format!("scene {} has no such key", self.scene.name));
        }
        match Dependence::of(&self.scene.uncertainty) {
            Err((at, reason)) => self.scene.uncertainty.get(at).map_or(Ok(()), |one| refuse(one, reason)),
            Ok(_) => Ok(()),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn keys(correlations: &[(usize, &str, f64)]) -> Vec<Uncertain> {
        let paths = ["material.shear_modulus_pa", "material.density_kg_per_m3", "instrument.deformation_coefficient"];
        let mut keys: Vec<Uncertain> =
            paths.map(|path| Uncertain::new(path, "uniform", &[0.3, 0.4], "here")).into_iter().flatten().collect();
        for (i, other, r) in correlations {
            keys[*i].correlation.insert((*other).to_owned(), *r);
        }
        keys
    }

    #[test]
    fn shares_keep_their_distribution_and_have_the_correlation() {
        let keys = keys(&[(0, "material.density_kg_per_m3", 0.6), (2, "material.shear_modulus_pa", -0.5)]);
        assert_eq!(keys.len(), 3);
        let dependence = Dependence::of(&keys).unwrap();
        // points that fill the cube evenly: multiples of numbers whose ratios are irrational
        let (n, steps) = (4096, [2f64.sqrt(), 3f64.sqrt(), 5f64.sqrt()]);
        let drawn: Vec<Vec<f64>> = (0..n)
            .map(|k| dependence.shares(steps.map(|step: f64| ((k as f64 + 0.5) * step).fract()).to_vec()))
            .collect();
        let normal = Normal::new(0.0, 1.0).unwrap();
        let z = |k: usize, i: usize| normal.inverse_cdf(drawn[k][i]);
        let mean = |i: usize, j: usize| (0..n).map(|k| z(k, i) * z(k, j)).sum::<f64>() / n as f64;
        for (i, j, r) in [(0, 1, 0.6), (0, 2, -0.5), (1, 2, 0.0)] {
            assert!((mean(i, j) - r).abs() < 0.01, "{i} {j}: {}", mean(i, j));
        }
        for i in 0..3 {
            let mut shares: Vec<f64> = drawn.iter().map(|row| row[i]).collect();
            shares.sort_by(f64::total_cmp);
            // largest distance of the shares' own distribution from the uniform one
            let off = (0..n).map(|k| (shares[k] - (k as f64 + 0.5) / n as f64).abs()).fold(0.0, f64::max);
            assert!(off < 0.01, "key {i}: {off}");
        }
    }

    #[test]
    fn correlations_that_cannot_be_are_refused() {
        let refused = |correlations: &[(usize, &str, f64)]| Dependence::of(&keys(correlations)).unwrap_err().1;
        assert!(refused(&[(0, "sample.height_m", 0.1)]).contains("no other key"));
        assert!(refused(&[(0, "material.shear_modulus_pa", 0.1)]).contains("no other key"));
        let twice = [(0, "material.density_kg_per_m3", 0.1), (1, "material.shear_modulus_pa", 0.2)];
        assert!(refused(&twice).contains("another number"));
        let (first, second) = ("material.density_kg_per_m3", "instrument.deformation_coefficient");
        assert!(refused(&[(0, first, 0.9), (0, second, 0.9), (1, second, -0.9)]).contains("positive definite"));
    }
}
