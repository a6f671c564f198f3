//! The needle driver: goes to where it is told, with limited speed and acceleration.

/// Limits of the motion. All positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriverLimits {
    /// Largest speed, m/s.
    pub speed_m_per_s: f64,
    /// Largest acceleration and deceleration, m/s^2.
    pub acceleration_m_per_s2: f64,
    /// Lowest and highest position, m.
    pub range_m: [f64; 2],
}

/// A joint under position control.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Driver {
    limits: DriverLimits,
    position_m: f64,
    velocity_m_per_s: f64,
    goal_m: f64,
}

impl Driver {
    /// A driver at rest.
    #[must_use]
    pub fn new(limits: DriverLimits, position_m: f64) -> Self {
        let position_m = position_m.clamp(limits.range_m[0], limits.range_m[1]);
        Self { limits, position_m, velocity_m_per_s: 0.0, goal_m: position_m }
    }

    /// Sets the goal; false (and the old goal stays) if it is not finite. Goals beyond the range are cut to it.
    pub fn go_to(&mut self, goal_m: f64) -> bool {
        if goal_m.is_finite() {
            self.goal_m = goal_m.clamp(self.limits.range_m[0], self.limits.range_m[1]);
        }
        goal_m.is_finite()
    }

    /// Where it is, m.
    #[must_use]
    pub const fn position_m(&self) -> f64 {
        self.position_m
    }

    /// How fast it moves, m/s.
    #[must_use]
    pub const fn velocity_m_per_s(&self) -> f64 {
        self.velocity_m_per_s
    }

    /// Where it goes, m.
    #[must_use]
    pub const fn goal_m(&self) -> f64 {
        self.goal_m
    }

    /// Advances by `dt_s`.
    ///
    /// The speed towards the goal is the one from which it can still stop there, in whole steps:
    /// v^2 / (2 a) + v dt <= distance left.
    pub fn step(&mut self, dt_s: f64) {
        let DriverLimits { speed_m_per_s: v_max, acceleration_m_per_s2: a, range_m } = self.limits;
        let left = self.goal_m - self.position_m;
        // The largest speed that can still be braked away within what is left after this step.
        let stoppable = (a * a * dt_s * dt_s + 2.0 * a * left.abs()).sqrt() - a * dt_s;
        let wanted = left.signum() * stoppable.clamp(0.0, v_max);
        let change = (wanted - self.velocity_m_per_s).clamp(-a * dt_s, a * dt_s);
        self.velocity_m_per_s += change;
        // What is left is no more than the slowest speed goes in one step.
        if left.abs() <= a * dt_s * dt_s && self.velocity_m_per_s.abs() <= a * dt_s {
            self.position_m = self.goal_m;
            self.velocity_m_per_s = 0.0;
        } else {
            self.position_m = (self.position_m + self.velocity_m_per_s * dt_s).clamp(range_m[0], range_m[1]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: DriverLimits =
        DriverLimits { speed_m_per_s: 0.01, acceleration_m_per_s2: 0.1, range_m: [-0.01, 0.02] };
    const DT: f64 = 1e-3;

    #[test]
    fn it_arrives_without_passing_and_within_its_limits() {
        let mut driver = Driver::new(LIMITS, 0.0);
        assert!(driver.go_to(0.008));
        let mut before = 0.0;
        let mut steps = 0;
        while driver.position_m() != 0.008 {
            driver.step(DT);
            steps += 1;
            let velocity = driver.velocity_m_per_s();
            assert!(velocity.abs() <= LIMITS.speed_m_per_s + 1e-15);
            assert!((velocity - before).abs() <= LIMITS.acceleration_m_per_s2 * DT + 1e-15, "step {steps}");
            assert!(driver.position_m() <= 0.008);
            assert!(steps < 2000);
            before = velocity;
        }
        // 0.008 m at 0.01 m/s and two ramps of 0.1 s.
        assert!((0.85..1.05).contains(&(f64::from(steps) * DT)), "{steps}");
        assert_eq!(driver.velocity_m_per_s(), 0.0);
    }

    #[test]
    fn a_goal_behind_is_reached_after_braking() {
        let mut driver = Driver::new(LIMITS, 0.0);
        driver.go_to(0.01);
        (0..300).for_each(|_| driver.step(DT));
        driver.go_to(-0.005);
        (0..5000).for_each(|_| driver.step(DT));
        assert_eq!(driver.position_m(), -0.005);
    }

    #[test]
    fn goals_are_cut_to_the_range_and_nan_is_refused() {
        let mut driver = Driver::new(LIMITS, 0.0);
        assert!(!driver.go_to(f64::NAN));
        assert_eq!(driver.goal_m(), 0.0);
        assert!(driver.go_to(1.0));
        assert_eq!(driver.goal_m(), 0.02);
    }
}
