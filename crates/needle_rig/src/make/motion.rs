//! The motion of a recording: rest, approach and insertion, hold, retraction, rest.

/// A motion along the instrument's axis, composed of moves with limited acceleration.
#[derive(Clone, Debug)]
pub(super) struct Motion {
    /// (start time in s, part).
    parts: Vec<(f64, Part)>,
    /// Duration, s.
    pub(super) duration_s: f64,
}

#[derive(Clone, Copy, Debug)]
enum Part {
    Rest { depth_m: f64 },
    Move { from_m: f64, to_m: f64, speed_m_per_s: f64, ramp_s: f64 },
}

impl Motion {
    /// An empty motion.
    pub(super) fn new() -> Self {
        Self { parts: Vec::new(), duration_s: 0.0 }
    }

    /// Appends a rest at a depth.
    pub(super) fn rest(mut self, depth_m: f64, duration_s: f64) -> Self {
        self.push(Part::Rest { depth_m }, duration_s);
        self
    }

    /// Appends a move between two depths: constant acceleration, constant speed, constant deceleration. A short move
    /// does not reach the full speed.
    pub(super) fn go(mut self, from_m: f64, to_m: f64, speed_m_per_s: f64, acceleration_m_per_s2: f64) -> Self {
        let way = (to_m - from_m).abs();
        let speed = speed_m_per_s.min((way * acceleration_m_per_s2).sqrt());
        if way > 0.0 {
            let ramp_s = speed / acceleration_m_per_s2;
            self.push(Part::Move { from_m, to_m, speed_m_per_s: speed, ramp_s }, way / speed + ramp_s);
        }
        self
    }

    fn push(&mut self, part: Part, duration_s: f64) {
        self.parts.push((self.duration_s, part));
        self.duration_s += duration_s;
    }

    /// Depth at a time, m.
    pub(super) fn depth_m(&self, time_s: f64) -> f64 {
        let after = self.parts.partition_point(|(start, _)| *start <= time_s);
        let Some((start, part)) = self.parts.get(after.saturating_sub(1)) else { return 0.0 };
        match *part {
            Part::Rest { depth_m } => depth_m,
            Part::Move { from_m, to_m, speed_m_per_s, ramp_s } => {
                let way = (to_m - from_m).abs();
                let duration = way / speed_m_per_s + ramp_s;
                let t = (time_s - start).clamp(0.0, duration);
                // Displacement since the start; the second half mirrors the first.
                let begun = |t: f64| {
                    if t < ramp_s { 0.5 * speed_m_per_s / ramp_s * t * t } else { speed_m_per_s * (t - 0.5 * ramp_s) }
                };
                let done = if t > duration - ramp_s { way - begun(duration - t) } else { begun(t) };
                from_m + (to_m - from_m).signum() * done
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speed_and_acceleration_stay_within_what_is_stated() {
        let motion =
            Motion::new().rest(-1e-3, 0.5).go(-1e-3, 0.01, 1e-3, 0.01).rest(0.01, 1.0).go(0.01, -1e-3, 5e-3, 0.05);
        assert!((motion.duration_s - (0.5 + 11.1 + 1.0 + 2.3)).abs() < 1e-12, "{}", motion.duration_s);
        let dt = 1e-3;
        let depths: Vec<f64> =
            (0..(motion.duration_s / dt) as i32).map(|i| motion.depth_m(f64::from(i) * dt)).collect();
        assert_eq!(depths[0], -1e-3);
        assert!(depths.iter().all(|d| (-1e-3 - 1e-12..=0.01 + 1e-12).contains(d)));
        assert!(depths.windows(2).all(|d| ((d[1] - d[0]) / dt).abs() <= 5e-3 + 1e-9));
        assert!(depths.windows(3).all(|d| ((d[2] - 2.0 * d[1] + d[0]) / (dt * dt)).abs() <= 0.05 + 1e-6));
        assert!((motion.depth_m(11.8) - 0.01).abs() < 1e-12);
        assert!((motion.depth_m(1e9) + 1e-3).abs() < 1e-12);
    }

    #[test]
    fn a_short_way_is_done_slower() {
        let motion = Motion::new().go(0.0, 1e-4, 1.0, 0.01);
        assert!((motion.duration_s - 0.2).abs() < 1e-12);
        assert!((motion.depth_m(0.1) - 5e-5).abs() < 1e-12);
    }
}
