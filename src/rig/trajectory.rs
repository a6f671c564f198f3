//! A motion along one axis with limited speed, acceleration and jerk, which at every moment can come to rest at or before its
//! goal.
//!
//! The position S(x, v, a) at which the motion can stop soonest increases with x, v and a. One rule makes the whole motion:
//! in each step of length h the jerk j is the one after which S equals the goal, or the nearest that the limits allow.
//!
//! ```text
//! a' = a + j h      v' = v + a h + j h^2 / 2      x' = x + v h + a h^2 / 2 + j h^3 / 6
//! |j| <= J,  |a'| <= A,  |v' + a' n h / 2| <= V  with n = ceil(|a'| / J h),  S(x', v', a') = goal
//! ```
//!
//! The third is the speed that there will be when the acceleration has been taken away in n whole steps, so that it
//! changes its sign between steps and the speed has no peak inside one.
//!
//! Once S equals the goal, the motion is that stop. S never passes the goal, so neither does the motion, except when a goal is
//! set too late to be stopped at: the motion then passes it and returns. To stop in (v, a) with v + a|a|/2J > 0, the jerk is -J until a = -p, then +J, where
//! p = sqrt(J v + a^2 / 2); if that is above A, the deceleration stays at A in between (Biagiotti and Melchiorri,
//! Trajectory Planning for Automatic Machines and Robots, 2008, section 3.4). The mirror image for a negative sign.

/// Halvings of the interval of jerks: to the last bits of a double.
const HALVINGS: u32 = 60;
/// Distance to the goal, m, at which a motion whose stop ends there counts as being on it: far below any sensor.
const ON_GOAL_M: f64 = 1e-12;
/// Speed, m/s, that counts as none.
const AT_REST: f64 = 1e-12;
/// Share of a step that rounding may add to an acceleration which whole steps take away.
const ON_STEP: f64 = 1e-9;

/// Limits of a motion. All positive.
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
    /// Time that it takes to come to rest from the largest speed, s: 2 sqrt(V/J), or V/A + A/J if A is reached.
    #[must_use]
    pub fn braking_time_s(&self) -> f64 {
        let Self { speed_m_per_s: v, acceleration_m_per_s2: a, jerk_m_per_s3: j } = *self;
        if v * j < a * a { 2.0 * (v / j).sqrt() } else { v / a + a / j }
    }
}

/// Position, velocity and acceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct State {
    x: f64,
    v: f64,
    a: f64,
}

impl State {
    /// After `h` seconds with a constant jerk.
    fn after(self, h: f64, jerk: f64) -> Self {
        let Self { x, v, a } = self;
        Self { x: x + h * (v + h * (a / 2.0 + h * jerk / 6.0)), v: v + h * (a + h * jerk / 2.0), a: a + h * jerk }
    }

    /// Speed once the acceleration has been taken away, m/s.
    fn speed_at_no_acceleration(self, jerk: f64) -> f64 {
        self.v + self.a * self.a.abs() / (2.0 * jerk)
    }

    /// Speed once the acceleration has been taken away in whole steps of `h`; one that takes speed away counts for
    /// nothing.
    fn coming_speed(self, h: f64, jerk: f64) -> f64 {
        let steps = (self.a / (jerk * h) - ON_STEP).ceil().max(0.0);
        self.v + 0.5 * self.a * steps * h
    }

    fn mirrored(self) -> Self {
        Self { x: -self.x, v: -self.v, a: -self.a }
    }
}

/// The quickest way to rest: durations in s of three phases, the jerk of the first and the third being -+J.
struct Stop {
    times: [f64; 3],
    jerk: f64,
}

impl Stop {
    fn of(state: State, limits: &MotionLimits) -> Self {
        let (most, j) = (limits.acceleration_m_per_s2, limits.jerk_m_per_s3);
        let sign = if state.speed_at_no_acceleration(j) < 0.0 { -1.0 } else { 1.0 };
        let (v, a) = (sign * state.v, sign * state.a);
        let peak = (j * v + a * a / 2.0).max(0.0).sqrt();
        let p = peak.min(most.max(-a));
        let cruise = if peak > p { (v + a * a / (2.0 * j) - p * p / j) / p } else { 0.0 };
        Self { times: [((a + p) / j).max(0.0), cruise.max(0.0), p / j], jerk: sign * j }
    }

    fn time(&self) -> f64 {
        self.times.iter().sum()
    }

    /// Where a state comes to rest.
    fn end(&self, state: State) -> f64 {
        self.after(state, f64::INFINITY).x
    }

    /// The state after `h` seconds of its stop.
    fn after(&self, state: State, h: f64) -> State {
        let mut left = h;
        self.times.iter().zip([-self.jerk, 0.0, self.jerk]).fold(state, |state, (time, jerk)| {
            let time = time.min(left);
            left -= time;
            state.after(time, jerk)
        })
    }
}

/// A motion in equal steps of time. See the module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trajectory {
    limits: MotionLimits,
    step_s: f64,
    state: State,
    goal_m: f64,
}

impl Trajectory {
    /// At rest. The steps are the grain of the motion: where the jerk could turn the acceleration from nothing to its
    /// limit within one, it is taken as if that took the whole step.
    #[must_use]
    pub fn new(limits: MotionLimits, step_s: f64, position_m: f64) -> Self {
        let jerk_m_per_s3 = limits.jerk_m_per_s3.min(limits.acceleration_m_per_s2 / step_s);
        let limits = MotionLimits { jerk_m_per_s3, ..limits };
        Self { limits, step_s, state: State { x: position_m, ..State::default() }, goal_m: position_m }
    }

    /// Its limits.
    #[must_use]
    pub const fn limits(&self) -> &MotionLimits {
        &self.limits
    }

    /// Where it is, m.
    #[must_use]
    pub const fn position_m(&self) -> f64 {
        self.state.x
    }

    /// m/s.
    #[must_use]
    pub const fn velocity_m_per_s(&self) -> f64 {
        self.state.v
    }

    /// m/s^2.
    #[must_use]
    pub const fn acceleration_m_per_s2(&self) -> f64 {
        self.state.a
    }

    /// Where it goes, m.
    #[must_use]
    pub const fn goal_m(&self) -> f64 {
        self.goal_m
    }

    /// Where it comes to rest if it is stopped now, m.
    #[must_use]
    pub fn stopping_place_m(&self) -> f64 {
        Stop::of(self.state, &self.limits).end(self.state)
    }

    /// Whether it has come to rest.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.state.v == 0.0 && self.state.a == 0.0
    }

    /// Sets the goal. A number that is not finite is no goal: the old one stays.
    pub fn go_to(&mut self, goal_m: f64) {
        if goal_m.is_finite() {
            self.goal_m = goal_m;
        }
    }

    /// Comes to rest as soon as the limits allow.
    pub fn stop(&mut self) {
        self.goal_m = self.stopping_place_m();
    }

    /// Changes the largest speed, m/s; a faster motion slows down to it within the other limits. Zero makes it stand.
    pub fn limit_speed(&mut self, speed_m_per_s: f64) {
        if speed_m_per_s >= 0.0 {
            self.limits.speed_m_per_s = speed_m_per_s;
        }
    }

    /// Advances by one step.
    pub fn step(&mut self) {
        let limits = &self.limits;
        let stop = Stop::of(self.state, limits);
        let missing = self.goal_m - stop.end(self.state);
        if missing.abs() <= ON_GOAL_M && stop.time() <= self.step_s {
            self.state = State { x: self.goal_m, ..State::default() };
            return;
        }
        let next = self.state.after(self.step_s, self.jerk());
        // The jerk of a stop changes inside a step: one jerk for the whole of it would end in an oscillation around the
        // goal, or end beyond it. A motion away from the goal is stopped first.
        let passed = |place: f64| (self.goal_m - place) * missing < 0.0 && (self.goal_m - place).abs() > ON_GOAL_M;
        let away = |state: State| state.speed_at_no_acceleration(limits.jerk_m_per_s3) * missing.signum() < -AT_REST;
        let beyond = passed(Stop::of(next, limits).end(next)) || away(next);
        let braking = missing.abs() <= ON_GOAL_M || away(self.state) || beyond;
        self.state = if braking { stop.after(self.state, self.step_s) } else { next };
    }

    /// The jerk of the coming step, m/s^3.
    fn jerk(&self) -> f64 {
        let MotionLimits { speed_m_per_s: v, acceleration_m_per_s2: a, jerk_m_per_s3: j } = self.limits;
        let h = self.step_s;
        let (low, high) = (-j, j);
        let to = |jerk: f64| self.state.after(h, jerk);
        let forth = |jerk: f64| to(jerk).coming_speed(h, j);
        let back = |jerk: f64| to(-jerk).mirrored().coming_speed(h, j);
        let end = |jerk: f64| Stop::of(to(jerk), &self.limits).end(to(jerk));
        let fastest = root(low, high, v, forth);
        let slowest = -root(low, high, v, back);
        let wanted = root(low, high, self.goal_m, end).min(fastest).max(slowest);
        let now = self.state.a;
        wanted.clamp(((-a - now) / h).clamp(low, high), ((a - now) / h).clamp(low, high))
    }
}

/// Where a rising function reaches a value; the nearer end of the interval if it doesn't.
fn root(low: f64, high: f64, value: f64, rising: impl Fn(f64) -> f64) -> f64 {
    if rising(low) >= value {
        return low;
    }
    if rising(high) <= value {
        return high;
    }
    let (mut below, mut above) = (low, high);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (below + above);
        if rising(middle) < value {
            below = middle;
        } else {
            above = middle;
        }
    }
    below
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: MotionLimits =
        MotionLimits { speed_m_per_s: 0.005, acceleration_m_per_s2: 0.5, jerk_m_per_s3: 100.0 };
    const DT: f64 = 1e-3;

    /// Steps and checks every limit on what moved, with the rounding of the numbers themselves.
    fn step(t: &mut Trajectory, limits: &MotionLimits) -> Result<(), TestCaseError> {
        let (before, dt) = (*t, t.step_s);
        t.step();
        let at = format!("{before:?} -> {t:?}");
        let jerk = (t.acceleration_m_per_s2() - before.acceleration_m_per_s2()) / dt;
        prop_assert!(jerk.abs() <= limits.jerk_m_per_s3 * (1.0 + 1e-6), "jerk {jerk}: {at}");
        let a = t.acceleration_m_per_s2();
        prop_assert!(a.abs() <= limits.acceleration_m_per_s2 * (1.0 + 1e-6), "acceleration: {at}");
        prop_assert!(t.velocity_m_per_s().abs() <= limits.speed_m_per_s * (1.0 + 1e-6), "speed: {at}");
        let mean = (t.position_m() - before.position_m()) / dt;
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
            let limits = *t.limits();
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
                // what can't be stopped at any more is passed by no more than the stop takes
                seen = [goal, t.stopping_place_m()].into_iter().fold(seen, |s, p| s.max(p.abs()));
                for _ in 0..steps {
                    step(&mut t, &limits)?;
                    prop_assert!(t.position_m().abs() <= seen + 1e-9, "{t:?} beyond {seen}");
                }
            }
            let limits = *t.limits();
            let time = 0.05 / limits.speed_m_per_s + 8.0 * limits.braking_time_s() + 1.0;
            for _ in 0..(time / DT) as usize {
                step(&mut t, &limits)?;
            }
            prop_assert!(t.is_at_rest() && t.position_m() == t.goal_m(), "{t:?}");
        }

        #[test]
        fn a_stop_takes_no_longer_than_the_braking_time(limits in limits(), steps in 1..2000usize) {
            let mut t = Trajectory::new(limits, DT, 0.0);
            t.go_to(1.0);
            let limits = *t.limits();
            for _ in 0..steps {
                step(&mut t, &limits)?;
            }
            let a = t.acceleration_m_per_s2() / limits.jerk_m_per_s3;
            t.stop();
            let mut taken = 0.0;
            while !t.is_at_rest() {
                step(&mut t, &limits)?;
                taken += DT;
                // an acceleration in full swing has to be taken away first
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
        assert_eq!(t.goal_m(), 0.1);
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
