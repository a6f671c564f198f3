//! Look-ahead of the members over the next part of the motion.
//!
//! ```text
//! P(force limit) = mean_k Phi((max F_k(z) - limit) / e)              over the tip's depths z from here to the window's end
//! P(miss)        = share of the members whose target the tip misses by more than r:
//!                  |target - tip| at the goal where it lies in the window, else the target's distance from the needle's line
//! ```
//! k: members, updated by the load cell's readings; e: standard deviation of a reading's further error. The window
//! ends `look_ahead_m` ahead, and no later than at the goal.

use statrs::distribution::{ContinuousCDF as _, Normal};

/// A member's position of the target.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Depth along the needle's line, m.
    pub depth_m: f64,
    /// Distance from the line, m.
    pub aside_m: f64,
}

/// Forces and target of every member over the next part of the motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outlook {
    /// Depths of the tip, ascending from its present one, m.
    pub depths_m: Vec<f64>,
    /// Force of each member at each of these depths, N.
    pub forces_n: Vec<Vec<f64>>,
    /// Standard deviation of the error of a reading beyond the members' spread, N.
    pub error_n: f64,
    /// The target of each member with the tip at the first and at the last depth; empty without a target.
    pub targets: Vec<[Place; 2]>,
}

/// A question to a look-ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Question {
    /// Depth of the tip, m.
    pub depth_m: f64,
    /// Depth to go to, m.
    pub goal_m: f64,
    /// Distance of the look-ahead, m.
    pub look_ahead_m: f64,
    /// Force limit, N.
    pub force_limit_n: f64,
    /// Distance from the target that counts as a miss, m.
    pub miss_radius_m: f64,
}

/// Probabilities within the window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Odds {
    /// Probability that the force limit is exceeded.
    pub force_limit: f64,
    /// Probability that the target is missed; 0 without a target.
    pub miss: f64,
    /// Share already travelled of the distance for which the look-ahead suffices. From 1 on it is shorter than
    /// requested.
    pub used: f64,
}

impl Outlook {
    /// `None` if it has no members, a number is not finite, depths are not ascending, or the tip is beyond all of it.
    #[must_use]
    pub fn odds(&self, ask: &Question) -> Option<Odds> {
        let (first, last) = (*self.depths_m.first()?, *self.depths_m.last()?);
        let whole_m = (ask.depth_m + ask.look_ahead_m).min(ask.goal_m.max(ask.depth_m));
        let end_m = whole_m.min(last);
        let spare_m = last - first - ask.look_ahead_m;
        let used = if last >= ask.goal_m { 0.0 } else { (ask.depth_m - first) / spare_m.max(f64::MIN_POSITIVE) };
        let fits = |force: &Vec<f64>| force.len() == self.depths_m.len() && force.iter().all(|f| f.is_finite());
        // data from a peer may be in any order
        let ascending = first.is_finite() && last.is_finite() && self.depths_m.windows(2).all(|w| w[0] < w[1]);
        if !ascending
            || ask.depth_m > last
            || self.forces_n.is_empty()
            || !self.forces_n.iter().all(fits)
            || !self.error_n.is_finite()
        {
            return None;
        }
        let most = |force: &Vec<f64>| {
            let ends = [ask.depth_m.max(first), end_m].map(|depth| self.force(force, depth));
            let within = self.depths_m.iter().zip(force).filter(|(z, _)| (ask.depth_m..=end_m).contains(*z));
            within.map(|(_, f)| *f).chain(ends).fold(f64::NEG_INFINITY, f64::max)
        };
        let normal = Normal::new(0.0, self.error_n.max(f64::MIN_POSITIVE)).ok()?;
        let passed = self.forces_n.iter().map(|force| normal.cdf(most(force) - ask.force_limit_n));
        let force_limit = passed.sum::<f64>() / self.forces_n.len() as f64;
        let in_window = ask.goal_m <= end_m;
        let missed = |places: &&[Place; 2]| {
            let Place { depth_m, aside_m } = self.place(places, end_m);
            let off_m = if in_window { aside_m.hypot(depth_m - ask.goal_m) } else { aside_m };
            off_m.is_nan() || off_m > ask.miss_radius_m
        };
        let misses = self.targets.iter().filter(missed).count();
        Some(Odds { force_limit, miss: misses as f64 / self.targets.len().max(1) as f64, used })
    }

    /// Mean depth of the members' target with the tip at a depth, m; `None` without a target.
    #[must_use]
    pub fn target_depth_m(&self, depth_m: f64) -> Option<f64> {
        let depths = self.targets.iter().map(|places| self.place(places, depth_m).depth_m);
        let mean = depths.sum::<f64>() / self.targets.len() as f64;
        mean.is_finite().then_some(mean)
    }

    /// Force at a depth, interpolated linearly, N.
    fn force(&self, force: &[f64], depth_m: f64) -> f64 {
        let after = self.depths_m.partition_point(|z| *z < depth_m).min(self.depths_m.len() - 1);
        let Some(before) = after.checked_sub(1) else { return force[0] };
        let share = (depth_m - self.depths_m[before]) / (self.depths_m[after] - self.depths_m[before]);
        force[before] + share.clamp(0.0, 1.0) * (force[after] - force[before])
    }

    fn place(&self, [from, to]: &[Place; 2], depth_m: f64) -> Place {
        let (Some(first), Some(last)) = (self.depths_m.first(), self.depths_m.last()) else { return *from };
        let share = if last > first { ((depth_m - first) / (last - first)).clamp(0.0, 1.0) } else { 0.0 };
        let between = |a: f64, b: f64| a + share * (b - a);
        Place { depth_m: between(from.depth_m, to.depth_m), aside_m: between(from.aside_m, to.aside_m) }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const ASK: Question =
        Question { depth_m: 1e-3, goal_m: 5e-3, look_ahead_m: 1e-3, force_limit_n: 0.1, miss_radius_m: 5e-4 };

    /// Forces 10, 30, 50 and 70 N/m, targets at 5, 5.2, 5.4 and 5.6 mm.
    fn outlook() -> Outlook {
        let depths_m: Vec<f64> = (0..=20).map(|i| 1e-3 + 1e-4 * f64::from(i)).collect();
        let force = |k: usize| depths_m.iter().map(|z| (10.0 + 20.0 * k as f64) * z).collect();
        let place = |k: usize| Place { depth_m: 5e-3 + 2e-4 * k as f64, aside_m: 3e-4 };
        Outlook {
            forces_n: (0..4).map(force).collect(),
            targets: (0..4).map(|k| [place(k); 2]).collect(),
            error_n: 1e-6,
            depths_m,
        }
    }

    #[test]
    fn members_beyond_the_limit_within_the_window_are_counted() {
        let (outlook, odds) = (outlook(), |ask: Question| outlook().odds(&ask).unwrap());
        // 20, 60, 100 and 140 mN at 2 mm; the third is at the limit
        assert!((odds(ASK).force_limit - 0.375).abs() < 1e-9, "{:?}", odds(ASK));
        assert!((odds(Question { look_ahead_m: 1e-4, ..ASK }).force_limit).abs() < 1e-9, "77 mN at most");
        assert!((odds(Question { goal_m: 1.5e-3, ..ASK }).force_limit - 0.25).abs() < 1e-9, "it ends at the goal");
        assert!((outlook.target_depth_m(1e-3).unwrap() - 5.3e-3).abs() < 1e-12);
        let wide = Outlook { error_n: 0.1, ..outlook.clone() };
        assert!((0.2..0.6).contains(&wide.odds(&ASK).unwrap().force_limit));
        assert_eq!(outlook.odds(&Question { depth_m: 3.1e-3, ..ASK }), None, "beyond all that was looked at");
        let used = |depth_m: f64, goal_m: f64| odds(Question { depth_m, goal_m, ..ASK }).used;
        assert!((used(1.4e-3, 5e-3) - 0.4).abs() < 1e-9 && used(2.5e-3, 5e-3) > 1.0, "1 mm of 2 is to spare");
        assert_eq!(used(2.5e-3, 2.9e-3), 0.0, "it reaches to the goal");
        assert_eq!(Outlook { error_n: f64::NAN, ..outlook.clone() }.odds(&ASK), None);
        assert_eq!(Outlook::default().odds(&ASK), None);
        for wrong in [f64::NAN, f64::INFINITY, 0.0] {
            let mut disordered = outlook.clone();
            disordered.depths_m[20] = wrong;
            assert_eq!(disordered.odds(&ASK), None, "{wrong}");
        }
    }

    #[test]
    fn a_miss_is_aside_on_the_way_and_whole_at_the_goal() {
        let odds = |ask: Question| outlook().odds(&ask).unwrap().miss;
        assert_eq!(odds(ASK), 0.0, "all are 0.3 mm beside the line");
        assert_eq!(odds(Question { miss_radius_m: 2e-4, ..ASK }), 1.0);
        // at the goal of 5 mm: 0.3, 0.36, 0.5 and 0.67 mm off
        let near = Question { depth_m: 2.9e-3, look_ahead_m: 5e-3, goal_m: 3e-3, miss_radius_m: 5.5e-4, ..ASK };
        let mut shifted = outlook();
        shifted.targets.iter_mut().flatten().for_each(|place| place.depth_m -= 2e-3);
        assert_eq!(shifted.odds(&near).unwrap().miss, 0.25);
        shifted.targets[0][1].depth_m = f64::NAN;
        assert_eq!(shifted.odds(&near).unwrap().miss, 0.5, "where a member has no target it is missed");
        shifted.targets.clear();
        assert_eq!((shifted.odds(&near).unwrap().miss, shifted.target_depth_m(0.0)), (0.0, None));
    }
}
