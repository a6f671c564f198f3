//! Intervals of one phase, over time and over depth.

use needle_estimate::compare::{Answer, Run};

/// An interval of one phase on an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stretch {
    pub word: &'static str,
    pub from: f64,
    pub to: f64,
}

/// Phases over the time of the run, s.
pub(super) fn over_time(run: &Run) -> Vec<Stretch> {
    stretches(&run.answers, |a| a.time_s)
}

/// Phases over the depth of the insertion, m. The retraction is not shown, since it covers the same depths again.
pub(super) fn over_depth(run: &Run) -> Vec<Stretch> {
    let mut deepest = f64::NEG_INFINITY;
    let insertion = run.answers[..run.legs().hold].iter().filter(|a| {
        // The noise of a sensor must not produce extra intervals.
        let advances = a.depth_m > deepest;
        deepest = deepest.max(a.depth_m);
        advances
    });
    let mut found = stretches(insertion, |a| a.depth_m);
    let depths = run.answers.iter().map(|a| a.depth_m).filter(|d| d.is_finite());
    if let (Some(last), Some(end)) = (found.last_mut(), depths.reduce(f64::max)) {
        last.to = end;
    }
    found
}

fn stretches<'a>(answers: impl IntoIterator<Item = &'a Answer>, place: impl Fn(&Answer) -> f64) -> Vec<Stretch> {
    let mut found: Vec<Stretch> = Vec::new();
    for a in answers {
        let (word, at) = (a.phase.as_str(), place(a));
        if !at.is_finite() {
            continue;
        }
        match found.last_mut() {
            Some(last) if last.word == word => last.to = at,
            Some(last) => {
                last.to = at;
                found.push(Stretch { word, from: at, to: at });
            }
            None => found.push(Stretch { word, from: at, to: at }),
        }
    }
    found
}
