//! The simulated rig: a player of recordings, a needle driver, and the models of its sensors.
#![warn(unreachable_pub)] // what is pub is for another crate

mod clock;
mod delay;
mod driver;
pub mod embedded;
pub mod make;
mod player;
pub mod sensors;
mod trajectory;

pub use clock::PlaybackClock;
pub use delay::Delay;
pub use driver::{Driver, DriverLimits};
pub use player::{PlayOptions, Player, Step, Stretch};
pub use trajectory::{MotionLimits, Trajectory};
