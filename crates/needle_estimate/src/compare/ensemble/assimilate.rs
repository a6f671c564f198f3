//! Data assimilation: updates the members of an ensemble from the load cell and from tracked points.
//!
//! The members have constant parameters and answer every reading already, so assimilation needs no further runs. In
//! the space of the members it is a linear regression ([`learning`](crate::compare::learning)). The unknowns are
//! weights w of the members' deviations from their mean. A priori they are normal with variance 1:
//!
//! ```text
//! x = mean(x_k) + X w / sqrt(n - 1),   X: members' x_k less their mean, a row
//! mean(x) + X m / sqrt(n - 1),   cov(x) = X C X' / (n - 1),   members afterwards: the mean + C^1/2 X'
//! ```
//!
//! This is the update of a square-root ensemble Kalman filter (Tippett et al., Mon. Weather Rev. 131, 2003). It
//! covers all readings at once, so that the size of the model error is the same for all of them. The force, and each
//! coordinate of each target, is a channel of its own. The predicted band of the force contains the uncertainty of
//! the members, the model error, and the noise.

use super::Band;
/// Forecast horizon of the force, s.
pub use crate::compare::learning::BLOCK_S as HORIZON_S;
use crate::compare::learning::{Expected, Learner, Reading};

/// Least noise that is assumed for a load cell, N.
const LEAST_NOISE_N: f64 = 1e-6;
/// Least noise that is assumed for a tracker, m.
const LEAST_NOISE_M: f64 = 1e-6;
/// Smallest number of members.
const FEWEST: usize = 4;

/// A measured force and the members' predictions of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observed {
    /// Time, s.
    pub time_s: f64,
    /// Measured force, N.
    pub measured_n: f64,
    /// Prediction of each member, N.
    pub members_n: Vec<f64>,
    /// Possible error of the members because their tissue oscillates ([`Swing`](crate::compare::learning::Swing)), N.
    pub doubt_n: f64,
}

/// Tracked points inside the sample, and the members' predictions of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tracked {
    /// Time, s.
    pub time_s: f64,
    /// Measured position of each target, m; not a number where it was not seen.
    pub measured_m: Vec<[f64; 3]>,
    /// Predicted positions of each member, m.
    pub members_m: Vec<Vec<[f64; 3]>>,
}

/// A forecast of the force from the measurements up to one block before.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Forecast {
    /// Mean, N.
    pub mean_n: f64,
    /// Standard deviation of a reading about the mean, N.
    pub standard_deviation_n: f64,
}

impl Forecast {
    /// The band that contains 95 % of the readings.
    #[must_use]
    pub fn band(&self) -> Band {
        Band::normal(self.mean_n, self.standard_deviation_n)
    }

    /// The forecast for members with this mean.
    fn of(mean_n: f64, Expected { off, variance }: Expected) -> Self {
        Self { mean_n: mean_n + off, standard_deviation_n: variance.sqrt() }
    }
}

/// Result of the assimilation of a recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Assimilated {
    /// One forecast for each reading of the load cell; `None` in the first block and after a gap.
    pub forecasts: Vec<Option<Forecast>>,
    /// Mean and standard deviation of each key after the last reading.
    pub keys: Vec<[f64; 2]>,
    /// The same after each block, with the time of its last reading, s.
    pub history: Vec<(f64, Vec<[f64; 2]>)>,
    /// Number of blocks of the load cell's readings.
    pub blocks: usize,
    /// Number of these blocks that were rejected.
    pub rejected_blocks: usize,
    /// Number of blocks of the tracked points' coordinates, all together.
    pub tracked_blocks: usize,
    /// Number of these blocks that were rejected.
    pub rejected_tracked_blocks: usize,
}

/// Assimilates readings and tracked points, each in order of time. `values` has the keys' values of each member.
/// `None` for fewer than four members, or if nothing was measured.
#[must_use]
pub fn assimilate(observed: &[Observed], tracked: &[Tracked], values: &[Vec<f64>]) -> Option<Assimilated> {
    let mut filter = Assimilation::new(values.len()).filter(|_| !observed.is_empty() || !tracked.is_empty())?;
    let mut history = History { of_key: transposed(values), seen: 0, last_s: f64::NAN, rows: Vec::new() };
    let mut tracked = tracked.iter().peekable();
    let mut forecasts = Vec::with_capacity(observed.len());
    for one in observed {
        while let Some(points) = tracked.next_if(|points| points.time_s <= one.time_s) {
            filter.track(points);
            history.see(points.time_s, &filter);
        }
        forecasts.push(filter.take(one));
        history.see(one.time_s, &filter);
    }
    for points in tracked {
        filter.track(points);
        history.see(points.time_s, &filter);
    }
    filter.close();
    history.see(f64::NAN, &filter);
    Some(Assimilated {
        keys: history.keys(&filter),
        history: history.rows,
        forecasts,
        blocks: filter.blocks(),
        rejected_blocks: filter.rejected(),
        tracked_blocks: filter.targets.iter().map(|c| filter.learner.tally(*c).blocks).sum(),
        rejected_tracked_blocks: filter.targets.iter().map(|c| filter.learner.tally(*c).rejected).sum(),
    })
}

/// Transposes to the values of all members for each key.
fn transposed(values: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let keys = values.first().map_or(0, Vec::len);
    (0..keys).map(|k| values.iter().map(|of_member| of_member[k]).collect()).collect()
}

/// Records the keys after each block.
struct History {
    of_key: Vec<Vec<f64>>,
    /// Number of blocks so far, and the time of the last reading.
    seen: usize,
    last_s: f64,
    rows: Vec<(f64, Vec<[f64; 2]>)>,
}

impl History {
    fn keys(&self, filter: &Assimilation) -> Vec<[f64; 2]> {
        let state = |values: &Vec<f64>| filter.state(values).map_or([f64::NAN; 2], |(mean, v)| [mean, v.sqrt()]);
        self.of_key.iter().map(state).collect()
    }

    /// Called for each reading; records the blocks that ended before it.
    fn see(&mut self, time_s: f64, filter: &Assimilation) {
        let blocks = filter.all_blocks();
        if blocks > self.seen {
            self.rows.push((self.last_s, self.keys(filter)));
        }
        (self.seen, self.last_s) = (blocks, time_s);
    }
}

/// Sequential assimilation, reading by reading. See the module.
#[derive(Clone, Debug)]
pub struct Assimilation {
    members: usize,
    learner: Learner,
    force: usize,
    /// Three channels for each target that was tracked.
    targets: Vec<usize>,
}

impl Assimilation {
    /// A filter without measurements; `None` for fewer than four members.
    #[must_use]
    pub fn new(members: usize) -> Option<Self> {
        (members >= FEWEST).then(|| {
            let mut learner = Learner::default();
            let force = learner.add(LEAST_NOISE_N);
            Self { members, learner, force, targets: Vec::new() }
        })
    }

    /// Mean of the members, and the effect of each unknown on it.
    fn row(&self, of_members: &[f64]) -> (f64, Vec<f64>) {
        let n = of_members.len() as f64;
        let mean = of_members.iter().sum::<f64>() / n;
        (mean, of_members.iter().map(|x| (x - mean) / (n - 1.0).sqrt()).collect())
    }

    fn reading(&self, observed: &Observed) -> (f64, Reading) {
        let (mean, row) = self.row(&observed.members_n);
        (mean, Reading { off: observed.measured_n - mean, row, force_n: Some(mean), doubt: observed.doubt_n })
    }

    /// Takes a reading of the load cell, no earlier than the last one. Returns its forecast from the measurements up
    /// to one block before; `None` in the first block and after a gap.
    pub fn take(&mut self, observed: &Observed) -> Option<Forecast> {
        let (mean, reading) = self.reading(observed);
        self.learner.take_expected(self.force, observed.time_s, reading).map(|expected| Forecast::of(mean, expected))
    }

    /// Takes tracked points, no earlier than the last ones. Points that were not seen, or that a member lacks, are
    /// ignored.
    pub(crate) fn track(&mut self, tracked: &Tracked) {
        while self.targets.len() < 3 * tracked.measured_m.len() {
            self.targets.push(self.learner.add(LEAST_NOISE_M));
        }
        for i in 0..self.targets.len() {
            let of = |points: &[[f64; 3]]| points.get(i / 3).map_or(f64::NAN, |point| point[i % 3]);
            let members: Vec<f64> = tracked.members_m.iter().map(|points| of(points)).collect();
            let (mean, row) = self.row(&members);
            let off = of(&tracked.measured_m) - mean;
            if off.is_finite() && members.len() == self.members {
                self.learner.take(self.targets[i], tracked.time_s, Reading { off, row, force_n: None, doubt: 0.0 });
            }
        }
    }

    /// Forecast of a future reading of the load cell, given the members' predictions of it. `None` if one of them is
    /// not finite.
    #[must_use]
    pub(crate) fn forecast(&self, ahead: &Observed) -> Option<Forecast> {
        let (mean, reading) = self.reading(&Observed { measured_n: 0.0, ..ahead.clone() });
        let forecast = Forecast::of(mean, self.learner.expected(self.force, ahead.time_s, &reading));
        Some(forecast).filter(|f| f.mean_n.is_finite() && f.standard_deviation_n.is_finite())
    }

    /// Ends the blocks that are incomplete.
    pub(crate) fn close(&mut self) {
        self.learner.close_all();
    }

    /// Mean and variance of a quantity of the members after the update; `None` if a number is not finite.
    #[must_use]
    pub(crate) fn state(&self, of_members: &[f64]) -> Option<(f64, f64)> {
        let (mean, row) = self.row(of_members);
        let (more, variance) = self.learner.state(&row);
        (mean.is_finite() && variance.is_finite()).then_some((mean + more, variance))
    }

    /// The members' values after the update: their mean is shifted and their spread reduced.
    #[must_use]
    pub fn analysed(&self, of_members: &[f64]) -> Vec<f64> {
        let (mean, row) = self.row(of_members);
        let mean = mean + self.learner.state(&row).0;
        let one = (of_members.len() as f64 - 1.0).sqrt();
        self.learner.narrowed(&row).into_iter().map(|off| mean + one * off).collect()
    }

    /// Standard deviation of the error of a load cell's reading beyond the members' spread, N.
    #[must_use]
    pub fn error_n(&self) -> f64 {
        self.learner.error(self.force)
    }

    /// Number of blocks of all channels.
    fn all_blocks(&self) -> usize {
        self.targets.iter().map(|target| self.learner.tally(*target).blocks).sum::<usize>() + self.blocks()
    }

    /// Number of blocks of the load cell's readings.
    #[must_use]
    pub fn blocks(&self) -> usize {
        self.learner.tally(self.force).blocks
    }

    /// Number of these blocks that were rejected.
    #[must_use]
    pub fn rejected(&self) -> usize {
        self.learner.tally(self.force).rejected
    }

    /// Whether the last of these blocks was rejected.
    #[must_use]
    pub fn rejects(&self) -> bool {
        self.learner.tally(self.force).rejects
    }
}
