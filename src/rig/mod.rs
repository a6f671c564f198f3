//! The simulated rig: a player of recordings and a needle driver.

mod clock;
mod driver;
mod player;

pub use clock::PlaybackClock;
pub use driver::{Driver, DriverLimits};
pub use player::{PlayOptions, Player, Step};
