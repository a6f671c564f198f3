//! A motion along one axis with limited speed, acceleration and jerk. The goal can change at any time; the motion is
//! then replanned from the present state (Berscheid and Kroeger, Jerk-limited Real-time Trajectory Generation with
//! Arbitrary Target States, RSS 2021; crate `rsruckig`).

use rsruckig::prelude::{ControlInterface, InputParameter, Ruckig, ThrowErrorHandler, Trajectory as Plan};

/// Limits of a motion. All are positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionLimits {
    /// V: largest speed, m/s.
    pub speed_m_per_s: f64,
    /// A: largest acceleration and deceleration, m/s^2.
    pub acceleration_m_per_s2: f64,
    /// J: largest jerk, m/s^3.
    pub jerk_m_per_s3: f64,
}

impl MotionLimits {
    /// Time to come to rest from the largest speed, s: 2 sqrt(V/J), or V/A + A/J if A is reached.
    #[must_use]
    pub fn braking_time_s(&self) -> f64 {
        let Self { speed_m_per_s: v, acceleration_m_per_s2: a, jerk_m_per_s3: j } = *self;
        if v * j < a * a { 2.0 * (v / j).sqrt() } else { v / a + a / j }
    }
}

/// A motion in equal time steps. See the module.
#[derive(Clone, Debug)]
pub struct Trajectory {
    limits: MotionLimits,
    step_s: f64,
    /// Position, m, velocity, m/s, and acceleration, m/s^2.
    state: [f64; 3],
    goal_m: f64,
    plan: Plan<1>,
    /// End position of the plan, m.
    end_m: f64,
    /// Time since the plan was made, s.
    since_s: f64,
}

/// Target of a plan.
enum End {
    /// At rest at the goal.
    Goal,
    /// At rest at any position.
    Rest,
}

impl Trajectory {
    /// A motion that starts at rest.
    #[must_use]
    pub fn new(limits: MotionLimits, step_s: f64, position_m: f64) -> Self {
        let state = [position_m, 0.0, 0.0];
        Self { limits, step_s, state, goal_m: position_m, plan: Plan::new(None), end_m: position_m, since_s: 0.0 }
    }

    /// Position, m.
    #[must_use]
    pub const fn position_m(&self) -> f64 {
        self.state[0]
    }

    /// Velocity, m/s.
    #[must_use]
    pub const fn velocity_m_per_s(&self) -> f64 {
        self.state[1]
    }

    /// Goal, m.
    #[cfg(test)]
    pub(crate) const fn goal_m(&self) -> f64 {
        self.goal_m
    }

    /// Position at which it comes to rest if it is stopped now, m.
    #[must_use]
    pub(crate) fn stopping_place_m(&self) -> f64 {
        self.planned(&End::Rest).map_or(self.goal_m, |plan| at(&plan, plan.get_duration())[0])
    }

    /// Whether it is at rest.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.state[1] == 0.0 && self.state[2] == 0.0
    }

    /// Sets the goal. A number that is not finite is ignored.
    pub fn go_to(&mut self, goal_m: f64) {
        if goal_m.is_finite() && goal_m != self.goal_m {
            self.goal_m = goal_m;
            self.plan_anew();
        }
    }

    /// Comes to rest as soon as the limits allow.
    pub fn stop(&mut self) {
        self.go_to(self.stopping_place_m());
    }

    /// Changes the largest speed, m/s. A faster motion slows down within the other limits. Zero stops it.
    pub fn limit_speed(&mut self, speed_m_per_s: f64) {
        if speed_m_per_s >= 0.0 && speed_m_per_s != self.limits.speed_m_per_s {
            self.limits.speed_m_per_s = speed_m_per_s;
            self.plan_anew();
        }
    }

    /// Advances by one step.
    pub fn step(&mut self) {
        self.since_s += self.step_s;
        self.state = match self.since_s < self.plan.get_duration() {
            true => at(&self.plan, self.since_s),
            false => [self.end_m, 0.0, 0.0],
        };
    }

    fn plan_anew(&mut self) {
        let end = if self.limits.speed_m_per_s > 0.0 { End::Goal } else { End::Rest };
        // If no plan can be made, the old one stays; it respects its limits and comes to rest.
        if let Some(plan) = self.planned(&end) {
            self.end_m = match end {
                End::Goal => self.goal_m, // exactly, without rounding
                End::Rest => at(&plan, plan.get_duration())[0],
            };
            (self.plan, self.since_s) = (plan, 0.0);
        }
    }

    /// The time-optimal plan to a target from the present state.
    fn planned(&self, end: &End) -> Option<Plan<1>> {
        let MotionLimits { speed_m_per_s, acceleration_m_per_s2, jerk_m_per_s3 } = self.limits;
        let mut input = InputParameter::<1>::new(None);
        (input.current_position[0], input.current_velocity[0]) = (self.state[0], self.state[1]);
        input.current_acceleration[0] = self.state[2];
        input.target_position[0] = self.goal_m;
        if matches!(end, End::Rest) {
            input.control_interface = ControlInterface::Velocity;
        }
        input.max_velocity[0] = speed_m_per_s;
        input.max_acceleration[0] = acceleration_m_per_s2;
        input.max_jerk[0] = jerk_m_per_s3;
        let mut plan = Plan::new(None);
        Ruckig::<1, ThrowErrorHandler>::new(None, self.step_s).calculate(&input, &mut plan).ok()?;
        Some(plan)
    }
}

/// Position, velocity and acceleration at a time of a plan, s.
fn at(plan: &Plan<1>, time_s: f64) -> [f64; 3] {
    let input = InputParameter::<1>::new(None);
    let (mut x, mut v, mut a) =
        (input.current_position.clone(), input.current_position.clone(), input.current_position);
    plan.at_time(time_s, &mut Some(&mut x), &mut Some(&mut v), &mut Some(&mut a), &mut None, &mut None);
    [x[0], v[0], a[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: MotionLimits =
        MotionLimits { speed_m_per_s: 0.005, acceleration_m_per_s2: 0.5, jerk_m_per_s3: 100.0 };
    const DT: f64 = 1e-3;

    /// Steps and checks every limit on the motion, with a tolerance for rounding.
    fn step(t: &mut Trajectory, limits: &MotionLimits) -> Result<(), TestCaseError> {
        let (before, dt) = ([t.position_m(), t.velocity_m_per_s(), t.state[2]], t.step_s);
        t.step();
        let at = format!("{before:?} -> {t:?}");
        let jerk = (t.state[2] - before[2]) / dt;
        prop_assert!(jerk.abs() <= limits.jerk_m_per_s3 * (1.0 + 1e-6), "jerk {jerk}: {at}");
        let a = t.state[2];
        prop_assert!(a.abs() <= limits.acceleration_m_per_s2 * (1.0 + 1e-6), "acceleration: {at}");
        prop_assert!(t.velocity_m_per_s().abs() <= limits.speed_m_per_s * (1.0 + 1e-6), "speed: {at}");
        let mean = (t.position_m() - before[0]) / dt;
        prop_assert!(mean.abs() <= limits.speed_m_per_s * (1.0 + 1e-6), "mean speed {mean}: {at}");
        Ok(())
    }

    fn limits() -> impl Strategy<Value = MotionLimits> {
        (1e-3..0.05, 0.01..5.0, 1.0..1000.0).prop_map(|(speed_m_per_s, acceleration_m_per_s2, jerk_m_per_s3)| {
            MotionLimits { speed_m_per_s, acceleration_m_per_s2, jerk_m_per_s3 }
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 100, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn from_rest_it_arrives_exactly_and_never_passes(
            limits in limits(), goal in -0.02..0.02f64, dt in 2e-4..5e-3f64,
        ) {
            let mut t = Trajectory::new(limits, dt, 0.0);
            t.go_to(goal);
            let limits = t.limits;
            let time = goal.abs() / limits.speed_m_per_s + 4.0 * limits.braking_time_s() + 20.0 * dt
                + 4.0 * (goal.abs() / limits.jerk_m_per_s3).cbrt();
            for _ in 0..(time / dt) as usize {
                step(&mut t, &limits)?;
                prop_assert!(t.position_m().abs() <= goal.abs() + 1e-12, "{t:?}");
                prop_assert!(t.position_m() * goal >= 0.0, "{t:?}");
            }
            prop_assert!(t.is_at_rest() && t.position_m() == goal, "{t:?}");
        }

        #[test]
        fn goals_that_change_in_full_flight_keep_every_limit_and_the_last_is_reached(
            limits in limits(), goals in prop::collection::vec((-0.02..0.02f64, 1..400usize), 1..12),
        ) {
            let mut t = Trajectory::new(limits, DT, 0.0);
            let mut seen = 0.0_f64;
            for (goal, steps) in goals {
                t.go_to(goal);
                // a goal that is too close to stop at is overshot by no more than the stopping distance
                seen = [goal, t.stopping_place_m()].into_iter().fold(seen, |s, p| s.max(p.abs()));
                for _ in 0..steps {
                    step(&mut t, &limits)?;
                    prop_assert!(t.position_m().abs() <= seen + 1e-9, "{t:?} beyond {seen}");
                }
            }
            let limits = t.limits;
            let time = 0.05 / limits.speed_m_per_s + 8.0 * limits.braking_time_s() + 1.0;
            for _ in 0..(time / DT) as usize {
                step(&mut t, &limits)?;
            }
            prop_assert!(t.is_at_rest() && t.position_m() == t.goal_m, "{t:?}");
        }

        #[test]
        fn a_stop_takes_no_longer_than_the_braking_time(limits in limits(), steps in 1..2000usize) {
            let mut t = Trajectory::new(limits, DT, 0.0);
            t.go_to(1.0);
            let limits = t.limits;
            for _ in 0..steps {
                step(&mut t, &limits)?;
            }
            let a = t.state[2] / limits.jerk_m_per_s3;
            t.stop();
            let mut taken = 0.0;
            while !t.is_at_rest() {
                step(&mut t, &limits)?;
                taken += DT;
                // the present acceleration must be reduced first
                prop_assert!(taken <= limits.braking_time_s() + 2.0 * a + 2.0 * DT, "{t:?}");
            }
        }
    }

    #[test]
    fn a_speed_that_is_lowered_is_slowed_down_to() -> Result<(), TestCaseError> {
        let mut t = Trajectory::new(LIMITS, DT, 0.0);
        t.go_to(0.1);
        (0..100).for_each(|_| t.step());
        assert!((t.velocity_m_per_s() - 0.005).abs() < 1e-12);
        t.limit_speed(0.001);
        (0..30).for_each(|_| t.step());
        for _ in 0..50 {
            step(&mut t, &MotionLimits { speed_m_per_s: 0.001, ..LIMITS })?;
        }
        assert!((t.velocity_m_per_s() - 0.001).abs() < 1e-9, "{t:?}");
        t.limit_speed(0.0);
        (0..50).for_each(|_| t.step());
        assert!(t.velocity_m_per_s().abs() < 1e-12, "{t:?}");
        t.go_to(f64::NAN);
        assert_eq!(t.goal_m, 0.1);
        Ok(())
    }

    #[test]
    fn the_braking_time_is_that_of_the_motion() {
        // 5 mm/s: A is just reached, V/A + A/J
        assert!((LIMITS.braking_time_s() - 0.015).abs() < 1e-12);
        let slow = MotionLimits { speed_m_per_s: 0.001, ..LIMITS };
        assert!((slow.braking_time_s() - 2.0 * (1e-5_f64).sqrt()).abs() < 1e-12);
    }
}
