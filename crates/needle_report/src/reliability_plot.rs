//! `reliability.svg`, the reliability diagram: share of the readings below each quantile of their forecasts.
//! Calibrated forecasts give the diagonal.
//!
//! ```text
//! y(p) = share of the readings with measured <= mean + z_p s        z_p: quantile of the normal distribution
//! ```

use statrs::distribution::{ContinuousCDF as _, Normal};

use super::{
    picture::{Anchor, Colour, Pen, Picture, Type},
    plot::{Axis, BLUE, INK, Panel, label, legend},
};
use needle_estimate::compare::Run;
use needle_estimate::compare::ensemble::assimilate::Forecast;

const WIDTH: u32 = 620;
const HEIGHT: u32 = 640;
const FRAME: [f64; 4] = [84.0, 70.0, 592.0, 578.0];
const EVEN: Pen = Pen::new(Colour(0x9a, 0xa4, 0xb1, 1.0), 1.8).dashed([6.0, 4.0]);
const SEEN: Pen = Pen::new(BLUE, 2.2);
/// Number of evaluated probabilities, including the ends of the 95 % band.
const PARTS: u32 = 40;

/// Deviations of the readings from their forecasts, in standard deviations.
fn deviations(run: &Run) -> Option<Vec<f64>> {
    let (answers, found) = run.ensemble.as_ref()?.assimilated.as_ref()?;
    let deviation = |(i, forecast): (&usize, &Option<Forecast>)| {
        let (measured_n, Forecast { mean_n, standard_deviation_n }) = (run.answers[*i].measured_n?, (*forecast)?);
        Some((measured_n - mean_n) / standard_deviation_n).filter(|z| z.is_finite())
    };
    let all: Vec<f64> = answers.iter().zip(&found.forecasts).filter_map(deviation).collect();
    (!all.is_empty()).then_some(all)
}

/// Probabilities, and the shares of the readings below the quantiles.
fn shares(deviations: &[f64]) -> Option<Vec<[f64; 2]>> {
    let normal = Normal::new(0.0, 1.0).ok()?;
    let below = |part: u32| {
        let share = f64::from(part) / f64::from(PARTS);
        let count = deviations.iter().filter(|z| normal.cdf(**z) <= share).count();
        [share, count as f64 / deviations.len() as f64]
    };
    Some((0..=PARTS).map(below).collect())
}

/// The diagram; `None` without forecasts.
pub(super) fn reliability_plot(run: &Run) -> Option<Picture> {
    let points = shares(&deviations(run)?)?;
    let mut picture = Picture::new(WIDTH, HEIGHT);
    let axis = || Axis::holding([0.0, 1.0], 5, 0.0);
    let panel = Panel { frame: FRAME, x: axis(), y: axis() };
    panel.grid(&mut picture, true);
    panel.title(&mut picture, "Share of the readings below", 11.0);
    panel.curve(&mut picture, [[0.0, 0.0], [1.0, 1.0]], EVEN);
    panel.curve(&mut picture, points.iter().copied(), SEEN);
    legend(&mut picture, [FRAME[0], 28.0], &[("as forecast", EVEN), ("measured", SEEN)]);
    let centre = Type { bold: true, colour: INK, ..label(Anchor::Middle) };
    picture.text([0.5 * (FRAME[0] + FRAME[2]), 620.0], "Share of the forecast's probability below", centre);
    Some(picture)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn forecasts_that_hold_give_the_diagonal_and_narrow_ones_a_flat_curve() {
        let normal = Normal::new(0.0, 1.0).unwrap();
        let right: Vec<f64> = (0..1000).map(|i| normal.inverse_cdf((f64::from(i) + 0.5) / 1000.0)).collect();
        assert!(shares(&right).unwrap().iter().all(|[p, y]| (p - y).abs() < 2e-3));
        let narrow: Vec<f64> = right.iter().map(|z| 2.0 * z).collect();
        let narrow = shares(&narrow).unwrap();
        assert!(narrow[4][1] > 0.2 && narrow[36][1] < 0.8, "{narrow:?}");
        assert!(reliability_plot(&Run::default()).is_none());
    }
}
