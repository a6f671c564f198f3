//! The simulated rig: a player of recordings, a needle driver, and the models of its sensors.

mod clock;
mod driver;
mod foreign;
mod player;
pub mod sensors;

pub use clock::PlaybackClock;
pub use driver::{Driver, DriverLimits};
pub use foreign::{ForceSource, ForeignError, PositionSource};
pub use player::{PlayOptions, Player, Step, Stretch};
