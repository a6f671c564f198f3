//! Chooses one of several candidate models for a kind of samples, from the data alone. Readings that are held out
//! (beyond `fit_to_depth_m`) are never used.
//!
//! With `choose_from_depth_m` each candidate is fitted to the shallower readings and predicts the rest up to
//! `fit_to_depth_m`. Then e_i is the root mean square of the prediction error divided by the peak force, for
//! recording i. This detects a candidate that is more flexible than the tissue requires; its fit residual alone would
//! look better. Without `choose_from_depth_m`, e_i is the fit residual.
//!
//! ```text
//! m_c = mean_i e_ci^2,   best = argmin_c m_c,   s = standard deviation of e_best,i^2 / sqrt(n)
//! chosen: of the candidates with m_c <= m_best + s those with the fewest keys, and of these the least m_c
//! ```
//!
//! This is the one-standard-error rule of Breiman, Friedman, Olshen and Stone (Classification and Regression Trees,
//! 1984, 3.4.3). Without forward errors s is 0.

use super::{Fit, Row};

/// The errors of one candidate over the recordings of a kind.
#[derive(Clone, Debug, PartialEq)]
struct Tried {
    name: String,
    keys: usize,
    /// e_i^2 of every recording. `None` if the candidate failed for a recording that another candidate explains.
    squares: Option<Vec<f64>>,
}

impl Tried {
    fn mean(&self) -> Option<f64> {
        let squares = self.squares.as_ref().filter(|s| !s.is_empty())?;
        Some(squares.iter().sum::<f64>() / squares.len() as f64)
    }
}

/// Standard error of the mean.
fn standard_error(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let squares: f64 = x.iter().map(|x| (x - mean) * (x - mean)).sum();
    if n > 1.0 { (squares / (n - 1.0) / n).sqrt() } else { 0.0 }
}

/// Returns each candidate's e (root mean square over the recordings, in the manifest's order) and the name of the
/// chosen one.
pub(super) fn choose(rows: &[&Row]) -> (Vec<(String, Option<f64>)>, String) {
    let usable: Vec<&&Row> = rows.iter().filter(|row| row.failed.is_none()).collect();
    let fits = || usable.iter().flat_map(|row| &row.fits);
    let forward = fits().any(|fit| fit.forward_error.is_some());
    let error = |fit: &Fit| if forward { fit.forward_error } else { fit.nrmse() };
    let names = rows.iter().find(|row| !row.fits.is_empty()).map(|row| row.fits.iter().map(|f| f.candidate.as_str()));
    let tried: Vec<Tried> = names
        .into_iter()
        .flatten()
        .map(|name| Tried {
            name: name.to_owned(),
            keys: usable.iter().find_map(|row| row.fit(name)).map_or(0, |fit| fit.keys.len()),
            squares: usable.iter().map(|row| error(row.fit(name)?).map(|e| e * e)).collect(),
        })
        .collect();
    let chosen = taken(&tried, forward).or(tried.first()).map(|t| t.name.clone()).unwrap_or_default();
    (tried.iter().map(|t| (t.name.clone(), t.mean().map(f64::sqrt))).collect(), chosen)
}

fn taken(tried: &[Tried], forward: bool) -> Option<&Tried> {
    let by_mean = |a: &&Tried, b: &&Tried| a.mean().unwrap_or(f64::NAN).total_cmp(&b.mean().unwrap_or(f64::NAN));
    let best = tried.iter().filter(|t| t.mean().is_some()).min_by(by_mean)?;
    let spread = best.squares.as_deref().filter(|_| forward).map_or(0.0, standard_error);
    let most = best.mean()? + spread;
    let near = tried.iter().filter(|t| t.mean().is_some_and(|m| m <= most));
    near.min_by(|a, b| a.keys.cmp(&b.keys).then(by_mean(a, b)))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn tried(name: &str, keys: usize, squares: &[f64]) -> Tried {
        Tried { name: name.to_owned(), keys, squares: Some(squares.to_vec()) }
    }

    #[test]
    fn of_what_is_as_good_the_simplest_is_taken() {
        let best = tried("best", 3, &[1.0, 3.0]);
        // the standard error of the best candidate is 1
        let within = [best.clone(), tried("simple", 2, &[2.9, 2.9]), tried("other", 2, &[2.95, 2.95])];
        assert_eq!(taken(&within, true).unwrap().name, "simple");
        assert_eq!(taken(&within, false).unwrap().name, "best", "what is left of a fit has no such rule");
        let beyond = [best, tried("simple", 2, &[3.1, 3.1])];
        assert_eq!(taken(&beyond, true).unwrap().name, "best");
        let failed = Tried { squares: None, ..tried("failed", 1, &[]) };
        assert_eq!(taken(&[failed.clone(), tried("simple", 2, &[9.0])], true).unwrap().name, "simple");
        assert_eq!(taken(&[failed], true), None);
    }
}
