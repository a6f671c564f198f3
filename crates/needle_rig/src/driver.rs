//! The needle driver: a joint under position control that follows commands within its limits.
//!
//! A single command is a goal, and the joint moves there. Commands that follow each other within the timeout are a
//! stream from a controller. If a stream ends, the controller has failed or a cable was cut. The joint then comes to
//! rest as soon as its limits allow.

use super::trajectory::{MotionLimits, Trajectory};

/// Limits of the driver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriverLimits {
    /// Speed, acceleration and jerk.
    pub motion: MotionLimits,
    /// Lowest and highest position, m.
    pub range_m: [f64; 2],
    /// Time of silence after which a stream of commands has ended, s; 0: never.
    pub command_timeout_s: f64,
}

/// Kind of the received commands.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Commands {
    /// None, or single goals; time since the last one, s.
    Single { age_s: f64 },
    /// A stream; time since the last command, s.
    Stream { age_s: f64 },
}

/// A joint under position control.
#[derive(Clone, Debug)]
pub struct Driver {
    limits: DriverLimits,
    step_s: f64,
    trajectory: Trajectory,
    commands: Commands,
}

impl Driver {
    /// A driver at rest that advances in steps of `step_s`.
    #[must_use]
    pub fn new(limits: DriverLimits, step_s: f64, position_m: f64) -> Self {
        let position_m = position_m.clamp(limits.range_m[0], limits.range_m[1]);
        let commands = Commands::Single { age_s: f64::INFINITY };
        Self { limits, step_s, trajectory: Trajectory::new(limits.motion, step_s, position_m), commands }
    }

    /// Takes a command. Returns false, without a change, if it is not finite. Goals beyond the range are limited to
    /// it.
    pub fn go_to(&mut self, goal_m: f64) -> bool {
        if !goal_m.is_finite() {
            return false;
        }
        let (Commands::Single { age_s } | Commands::Stream { age_s }) = self.commands;
        let follows = age_s <= self.limits.command_timeout_s;
        self.commands = if follows { Commands::Stream { age_s: 0.0 } } else { Commands::Single { age_s: 0.0 } };
        self.trajectory.go_to(goal_m.clamp(self.limits.range_m[0], self.limits.range_m[1]));
        true
    }

    /// Its limits.
    #[must_use]
    pub const fn limits(&self) -> &DriverLimits {
        &self.limits
    }

    /// Comes to rest as soon as its limits allow.
    pub fn brake(&mut self) {
        self.commands = Commands::Single { age_s: f64::INFINITY };
        self.trajectory.stop();
    }

    /// Stops at the present position. Its controller was not running, and the motor's amplifier has stopped it
    /// meanwhile.
    pub fn halt(&mut self) {
        *self = Self::new(self.limits, self.step_s, self.position_m());
    }

    /// Position, m.
    #[must_use]
    pub const fn position_m(&self) -> f64 {
        self.trajectory.position_m()
    }

    /// Velocity, m/s.
    #[must_use]
    pub const fn velocity_m_per_s(&self) -> f64 {
        self.trajectory.velocity_m_per_s()
    }

    /// Advances by one step. Returns true if a stream of commands ended in this step during a motion, so that the
    /// joint brakes.
    pub fn step(&mut self) -> bool {
        let (Commands::Single { age_s } | Commands::Stream { age_s }) = &mut self.commands;
        *age_s += self.step_s;
        let age_s = *age_s;
        let timeout_s = self.limits.command_timeout_s;
        let ceased = timeout_s > 0.0 && age_s > timeout_s && matches!(self.commands, Commands::Stream { .. });
        let brakes = ceased && !self.trajectory.is_at_rest();
        if ceased {
            self.commands = Commands::Single { age_s };
            self.trajectory.stop();
        }
        self.trajectory.step();
        brakes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOTION: MotionLimits = MotionLimits { speed_m_per_s: 0.01, acceleration_m_per_s2: 0.5, jerk_m_per_s3: 100.0 };
    const LIMITS: DriverLimits = DriverLimits { motion: MOTION, range_m: [-0.01, 0.02], command_timeout_s: 0.05 };
    const DT: f64 = 1e-3;

    fn run(driver: &mut Driver, steps: usize) {
        for _ in 0..steps {
            driver.step();
        }
    }

    #[test]
    fn a_single_command_is_gone_to() {
        let mut driver = Driver::new(LIMITS, DT, 0.0);
        assert!(driver.go_to(0.008));
        // 0.008 m at 0.01 m/s, plus the time to accelerate and decelerate
        for _ in 0..830 {
            assert!(!driver.step());
        }
        assert_eq!((driver.position_m(), driver.velocity_m_per_s()), (0.008, 0.0));
    }

    #[test]
    fn a_stream_that_ceases_is_braked_after_its_timeout_and_can_begin_again() {
        let mut driver = Driver::new(LIMITS, DT, 0.0);
        for i in 0..100 {
            if i % 5 == 0 {
                driver.go_to(0.01);
            }
            assert!(!driver.step(), "{i}");
        }
        // the last command came 5 steps ago; the timeout is 50 steps, up to rounding
        let ceased: Vec<usize> = (0..100).filter(|_| driver.step()).collect();
        assert!(ceased == [44] || ceased == [45], "{ceased:?}");
        let stood = driver.position_m();
        assert!(driver.velocity_m_per_s() == 0.0 && stood < 0.003, "{driver:?}");
        driver.go_to(0.01);
        run(&mut driver, 1000);
        assert_eq!(driver.position_m(), 0.01);
    }

    #[test]
    fn without_a_timeout_every_command_stands() {
        let mut driver = Driver::new(DriverLimits { command_timeout_s: 0.0, ..LIMITS }, DT, 0.0);
        for _ in 0..3 {
            driver.go_to(0.005);
            driver.step();
        }
        run(&mut driver, 1000);
        assert_eq!(driver.position_m(), 0.005);
    }

    #[test]
    fn goals_are_cut_to_the_range_and_nan_is_refused() {
        let mut driver = Driver::new(LIMITS, DT, 0.0);
        assert!(!driver.go_to(f64::NAN));
        assert_eq!(driver.trajectory.goal_m(), 0.0);
        assert!(driver.go_to(1.0));
        assert_eq!(driver.trajectory.goal_m(), 0.02);
    }
}
