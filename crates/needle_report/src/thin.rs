//! Thins a long run for drawing without a loss of visible detail.

use needle_estimate::compare::{Answer, Run};
use std::collections::BTreeSet;

/// Indices of the answers to draw, in order. If there are few answers, all of them; otherwise per bucket of time the
/// first, the last and the extremes of each drawn quantity, so that no peak is lost.
///
/// Answers whose time, depth or predicted force is not finite can't be drawn and are left out.
pub(super) fn thin(run: &Run, buckets: usize) -> Vec<usize> {
    let drawable = |a: &Answer| a.time_s.is_finite() && a.depth_m.is_finite() && a.predicted_n.is_finite();
    let all: Vec<usize> = (0..run.answers.len()).filter(|&i| drawable(&run.answers[i])).collect();
    let drawn: [fn(&Answer) -> f64; 5] = [
        |a| a.predicted_n,
        |a| a.measured_n.unwrap_or(f64::NAN),
        |a| a.residual_n().unwrap_or(f64::NAN),
        |a| a.latency_s,
        |a| f64::from(a.steps),
    ];
    // A bucket contributes at most 12 answers.
    if all.len() <= 12 * buckets {
        return all;
    }
    let mut kept = BTreeSet::new();
    for bucket in all.chunks(all.len().div_ceil(buckets)) {
        kept.extend(bucket.first().into_iter().chain(bucket.last()));
        for quantity in drawn {
            let finite = || bucket.iter().filter(|&&i| quantity(&run.answers[i]).is_finite());
            let by = |a: &&usize, b: &&usize| quantity(&run.answers[**a]).total_cmp(&quantity(&run.answers[**b]));
            kept.extend(finite().min_by(by).into_iter().chain(finite().max_by(by)));
        }
    }
    kept.extend(all.iter().filter(|&&i| run.answers[i].event.is_some()));
    kept.into_iter().collect()
}
