//! What the load cell and tracked points say of the members, by a square-root ensemble Kalman filter (`filter.rs`).
//!
//! Force and each coordinate of each target are channels of their own: each learns how large its errors are, beyond the members' spread, from
//! its own innovations. The band of the force that comes next has the spread of the members and of the last forecasts' errors. So a model that
//! is wrong, or a load cell that drifts, makes forecast bands wide; intervals of the keys hold where the model is right.

use super::Band;
use super::filter::{Channel, Filter, Reading};

/// How far ahead the force is forecast, and the length of a block, s.
pub const HORIZON_S: f64 = 0.05;
/// Noise that every load cell has, N.
const LEAST_NOISE_N: f64 = 1e-6;
/// Noise that every tracker has, m.
const LEAST_NOISE_M: f64 = 1e-6;
/// Fewest members.
const FEWEST: usize = 4;

/// A measured force, and what the members say it should be.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observed {
    /// s
    pub time_s: f64,
    /// N
    pub measured_n: f64,
    /// Of each member, N.
    pub members_n: Vec<f64>,
}

/// Tracked points inside the sample, and where the members have them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tracked {
    /// s
    pub time_s: f64,
    /// Where each target was seen, m; not a number where it was not.
    pub measured_m: Vec<[f64; 3]>,
    /// The same of each member, m.
    pub members_m: Vec<Vec<[f64; 3]>>,
}

/// A force that was forecast from what had been measured up to one block before.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Forecast {
    /// N
    pub mean_n: f64,
    /// Of a reading about it, N.
    pub standard_deviation_n: f64,
}

impl Forecast {
    /// The band that holds 95 % of the readings.
    #[must_use]
    pub fn band(&self) -> Band {
        Band::normal(self.mean_n, self.standard_deviation_n)
    }
}

/// What a recording says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Assimilated {
    /// One for each reading of the load cell; `None` in the first block and after a gap.
    pub forecasts: Vec<Option<Forecast>>,
    /// Mean and standard deviation of each key after the last reading.
    pub keys: Vec<[f64; 2]>,
    /// Blocks of the load cell's readings, and how many of them were rejected.
    pub blocks: usize,
    /// See `blocks`.
    pub rejected_blocks: usize,
    /// The same of the coordinates of tracked points, all together.
    pub tracked_blocks: usize,
    /// See `tracked_blocks`.
    pub rejected_tracked_blocks: usize,
}

/// Assimilates readings and tracked points, each in the order of time; `values` has the keys' values of each member. `None` of fewer than four
/// members, or where nothing was measured.
#[must_use]
pub fn assimilate(observed: &[Observed], tracked: &[Tracked], values: &[Vec<f64>]) -> Option<Assimilated> {
    let mut filter = Assimilation::new(values.len()).filter(|_| !observed.is_empty() || !tracked.is_empty())?;
    let mut tracked = tracked.iter().peekable();
    let mut forecasts = Vec::with_capacity(observed.len());
    for one in observed {
        while let Some(points) = tracked.next_if(|points| points.time_s <= one.time_s) {
            filter.track(points);
        }
        forecasts.push(filter.take(one.clone()));
    }
    tracked.for_each(|points| filter.track(points));
    filter.close();
    let key = |k: usize| filter.state(&values.iter().map(|of_member| of_member[k]).collect::<Vec<_>>());
    let keys = (0..values[0].len()).map(|k| key(k).map_or([f64::NAN; 2], |(mean, variance)| [mean, variance.sqrt()]));
    Some(Assimilated {
        keys: keys.collect(),
        forecasts,
        blocks: filter.blocks(),
        rejected_blocks: filter.rejected(),
        tracked_blocks: filter.targets.iter().map(|c| c.blocks).sum(),
        rejected_tracked_blocks: filter.targets.iter().map(|c| c.rejected).sum(),
    })
}

/// What has been assimilated so far, reading by reading. See the module.
#[derive(Clone, Debug)]
pub struct Assimilation {
    filter: Filter,
    force: Channel,
    /// Three for each target that was tracked.
    targets: Vec<Channel>,
}

impl Assimilation {
    /// Nothing is assimilated yet; `None` of fewer than four members.
    #[must_use]
    pub fn new(members: usize) -> Option<Self> {
        (members >= FEWEST).then(|| Self {
            filter: Filter::new(members),
            force: Channel::new(LEAST_NOISE_N),
            targets: Vec::new(),
        })
    }

    /// Takes a reading of the load cell, no earlier than the one before, and gives what was forecast for it from what had been measured up to one
    /// block before; `None` in the first block and after a gap.
    pub fn take(&mut self, observed: Observed) -> Option<Forecast> {
        let reading = Reading { measured: observed.measured_n, members: observed.members_n };
        self.force.take(observed.time_s, reading, &mut self.filter)
    }

    /// Takes tracked points, no earlier than those before. What was not seen, or what a member doesn't have, says nothing.
    pub fn track(&mut self, tracked: &Tracked) {
        self.targets.resize_with(3 * tracked.measured_m.len(), || Channel::new(LEAST_NOISE_M));
        for (i, channel) in self.targets.iter_mut().enumerate() {
            let of = |points: &[[f64; 3]]| points.get(i / 3).map_or(f64::NAN, |point| point[i % 3]);
            let measured = of(&tracked.measured_m);
            let members: Vec<f64> = tracked.members_m.iter().map(|points| of(points)).collect();
            if measured.is_finite() && members.iter().all(|x| x.is_finite()) {
                channel.take(tracked.time_s, Reading { measured, members }, &mut self.filter);
            }
        }
    }

    /// A reading of the load cell at a time that has not been measured yet, if the members will have these forces; `None` where one of them is not finite.
    #[must_use]
    pub fn forecast(&self, ahead: &Observed) -> Option<Forecast> {
        let forecast = self.force.forecast(ahead.time_s, &ahead.members_n, &self.filter);
        Some(forecast).filter(|f| f.mean_n.is_finite() && f.standard_deviation_n.is_finite())
    }

    /// Ends the blocks that have been begun.
    pub fn close(&mut self) {
        self.force.close(&mut self.filter);
        self.targets.iter_mut().for_each(|channel| channel.close(&mut self.filter));
    }

    /// Mean and variance of what the members have; `None` where a number is not finite.
    #[must_use]
    pub fn state(&self, of_members: &[f64]) -> Option<(f64, f64)> {
        self.filter.state(of_members)
    }

    /// What the members would have with the values that the measurements say: their mean moved, their spread narrowed.
    #[must_use]
    pub fn analysed(&self, of_members: &[f64]) -> Vec<f64> {
        let (mean, off) = self.filter.spread(of_members);
        off.iter().map(|x| mean + x).collect()
    }

    /// Standard deviation of what a reading of the load cell is off by beyond the members' spread, N.
    #[must_use]
    pub fn error_n(&self) -> f64 {
        self.force.error()
    }

    /// Blocks of the load cell's readings that were seen.
    #[must_use]
    pub const fn blocks(&self) -> usize {
        self.force.blocks
    }

    /// Blocks of them that were rejected.
    #[must_use]
    pub const fn rejected(&self) -> usize {
        self.force.rejected
    }

    /// Whether the last block of them was rejected.
    #[must_use]
    pub const fn rejects(&self) -> bool {
        self.force.rejects
    }
}
