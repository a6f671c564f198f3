//! Sequential Bayesian linear regression of unknown parameters, with a model error that is estimated too.
//!
//! A reading y is the expected value, plus a row a of effects of the unknowns w, plus the error of the model, plus
//! noise. A priori each w is normal with mean 0 and variance 1. The weights of an ensemble's members are such
//! unknowns (`ensemble::assimilate`), and so are a modulus and an offset (`identifier`). The posterior of w is in
//! `known`, the model error in `process`, and the noise in `noise`. One unknown is added: the size of the twin's own
//! force, [`FORCE_ERROR`].
//!
//! Readings are averaged in blocks of [`BLOCK_S`]. A block that deviates by more than three standard deviations is
//! **rejected**: it does not update the unknowns.
//!
//! **Trouble**: the state is saved every half a second. The older saved state, of half a second to a second ago, is
//! checked with its own force error included. If it does not explain two blocks of the load cell, the unknowns are
//! reset to it. The load cell then updates them again only after ten blocks that this state explains. Forecasts
//! continue to use all readings.

mod basis;
mod batched_matrix;
mod known;
mod noise;
mod process;
mod reading;
mod swing;

use nalgebra::DVector;

use super::uncertainty::FORCE_ERROR;
use basis::Basis;
use known::{Known, Off};
use noise::Noise;
use process::Block;
pub use reading::Reading;
use reading::Readings;
pub use swing::Swing;

/// Length of a block, s; also the forecast horizon.
pub const BLOCK_S: f64 = 0.05;
/// A block that deviates by more than this, in standard deviations, is not explained.
const FAR: f64 = 3.0;
/// Consecutive blocks that the saved state does not explain, until trouble begins; and explained ones, within half of
/// [`FAR`], until it ends.
const PERSISTENT: usize = 2;
const RIGHT: usize = 10;
/// Blocks between two saved states; trouble resets to the older of two. After a longer pause the readings before it
/// are discarded.
const ASIDE: f64 = 10.0;

/// Expected deviation of a reading, and its variance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Expected {
    /// Mean.
    pub off: f64,
    /// Variance of a reading about the mean.
    pub variance: f64,
}

/// A sensor, whose readings are averaged in blocks.
#[derive(Clone, Debug)]
struct Channel {
    noise: Noise,
    /// Standard deviation of a reading.
    of_one: f64,
    /// Largest expected force so far.
    largest: f64,
    /// Readings of the current block, and its number.
    block: Readings,
    number: f64,
    /// Number of the last completed block, and the time of the first reading.
    last: f64,
    first_s: Option<f64>,
    tally: Tally,
}

/// Block counts of a channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Tally {
    /// Blocks that were completed.
    pub blocks: usize,
    /// Number of these that did not update the unknowns.
    pub rejected: usize,
    /// Whether the last block did not update the unknowns.
    pub rejects: bool,
}

/// The state while the load cell is not explained.
#[derive(Clone, Debug)]
struct Trouble {
    kept: Known,
    /// Residual of the last block with respect to the kept state.
    now: f64,
    /// Residual when trouble began, and whether it changed from one block to the next.
    residual: f64,
    sudden: bool,
    right: usize,
}

/// See the module.
#[derive(Clone, Debug)]
pub(crate) struct Learner {
    basis: Basis,
    now: Known,
    channels: Vec<Channel>,
    /// Earlier states, the newer first, and the block number of the newer.
    saved: [Option<Known>; 2],
    saved_at: f64,
    trouble: Option<Trouble>,
    /// Number of consecutive blocks of the load cell that the saved state does not explain, and whether the first was
    /// rejected.
    wrong: usize,
    sudden: bool,
}

/// Number of the block at a time after the first reading, s.
fn block_of(since_s: f64) -> f64 {
    (since_s / BLOCK_S * (1.0 + 1e-9)).floor()
}

impl Default for Learner {
    /// The prior.
    fn default() -> Self {
        Self {
            basis: Basis::default(),
            now: Known::new(),
            channels: Vec::new(),
            saved: [None, None],
            saved_at: f64::NEG_INFINITY,
            trouble: None,
            wrong: 0,
            sudden: false,
        }
    }
}

impl Learner {
    /// Adds a sensor with at least this noise, and returns its number. Only the first sensor can cause trouble.
    pub(crate) fn add(&mut self, least_noise: f64) -> usize {
        self.now.add(least_noise);
        self.saved.iter_mut().flatten().for_each(|known| known.add(least_noise));
        self.trouble.iter_mut().for_each(|trouble| trouble.kept.add(least_noise));
        self.channels.push(Channel {
            noise: Noise::new(least_noise),
            of_one: least_noise,
            largest: 0.0,
            block: Readings::default(),
            number: 0.0,
            last: f64::NEG_INFINITY,
            first_s: None,
            tally: Tally::default(),
        });
        self.channels.len() - 1
    }

    /// Takes a reading, no earlier than the last one. Returns whether it belongs to the same block as the last one,
    /// or to the next.
    pub(crate) fn take(&mut self, channel: usize, time_s: f64, reading: Reading<impl AsRef<[f64]>>) -> bool {
        self.begin(channel, time_s);
        let own = &mut self.channels[channel];
        own.largest = own.largest.max(reading.force_n.map_or(f64::INFINITY, f64::abs));
        own.block.push(&reading);
        own.number - own.last <= 1.0
    }

    /// The same. Returns its forecast from the measurements up to one block before; `None` in the first block and
    /// after a gap.
    pub(crate) fn take_expected(&mut self, channel: usize, time_s: f64, reading: Reading) -> Option<Expected> {
        self.begin(channel, time_s);
        let expected = self.expect(channel, self.channels[channel].number, &reading);
        self.take(channel, time_s, reading).then_some(expected)
    }

    /// Ends the current block if a reading belongs to a later one.
    fn begin(&mut self, channel: usize, time_s: f64) {
        let first_s = *self.channels[channel].first_s.get_or_insert(time_s);
        let number = block_of(time_s - first_s);
        if number != self.channels[channel].number {
            self.close(channel);
            self.channels[channel].number = number;
        }
    }

    /// Forecast of a reading at a future time.
    #[must_use]
    pub(crate) fn expected(&self, channel: usize, time_s: f64, reading: &Reading) -> Expected {
        let own = &self.channels[channel];
        let number = own.first_s.map_or(own.last, |first_s| block_of(time_s - first_s));
        self.expect(channel, number.max(own.last + 1.0), reading)
    }

    fn expect(&self, channel: usize, number: f64, reading: &Reading) -> Expected {
        let own = &self.channels[channel];
        let (row, left) = reading.along(&self.basis);
        let noise = own.of_one.powi(2) + reading.doubt.powi(2) + left.norm_squared();
        let block = Block { row, noise, largest: own.largest };
        let number = if own.last.is_finite() { number } else { 0.0 };
        let Off { mean, variance } = self.now.off(channel, number, &block);
        Expected { off: reading.off - mean, variance }
    }

    /// Ends the blocks that are incomplete.
    pub(crate) fn close_all(&mut self) {
        (0..self.channels.len()).for_each(|channel| self.close(channel));
    }

    fn close(&mut self, channel: usize) {
        let readings = &self.channels[channel].block;
        if readings.is_empty() {
            return;
        }
        let unexplained = readings.unexplained(&self.basis, self.now.m.as_slice());
        let own = &mut self.channels[channel];
        if own.number - own.last > ASIDE {
            own.noise.pause();
        }
        let (number, largest) = (own.number, own.largest);
        if let Some((of_one, noise)) = own.noise.see(&unexplained) {
            own.of_one = of_one;
            let mean = own.block.mean();
            if self.basis.grow(&mean.row, of_one) {
                let others = self.saved.iter_mut().flatten().chain(self.trouble.iter_mut().map(|t| &mut t.kept));
                others.chain([&mut self.now]).for_each(Known::grow);
            }
            let (row, _) = mean.along(&self.basis);
            let block = Block { row, noise: noise + mean.doubt.powi(2), largest };
            let force_n = mean.force_n.unwrap_or(0.0);
            self.now.measure(force_n, &block);
            self.learn(channel, number, &block, force_n);
        }
        let own = &mut self.channels[channel];
        own.last = number;
        own.block.clear();
    }

    fn learn(&mut self, channel: usize, number: f64, block: &Block, force_n: f64) {
        let first = self.channels[channel].tally.blocks == 0;
        let far = !first && self.now.off(channel, number, block).deviations(0.0) > FAR;
        if channel == 0 {
            self.watch(number, block, FORCE_ERROR * force_n, far);
        }
        if far {
            self.now.pass(channel, number, block, FAR);
        } else {
            self.now.take(channel, number, block);
        }
        if let Some(trouble) = self.trouble.as_mut().filter(|_| channel > 0) {
            trouble.kept.take(channel, number, block);
        }
        let tally = &mut self.channels[channel].tally;
        tally.rejects = far || (channel == 0 && self.trouble.is_some());
        tally.blocks += 1;
        tally.rejected += usize::from(tally.rejects);
    }

    /// Checks whether the saved state explains a block of the load cell, with a force error of this standard
    /// deviation. Begins and ends trouble.
    fn watch(&mut self, number: f64, block: &Block, force_error: f64, far: bool) {
        let more = force_error * force_error;
        if let Some(trouble) = &mut self.trouble {
            trouble.kept.widen(0, block.largest);
            let off = trouble.kept.off(0, number, block);
            trouble.now = off.mean;
            let right = off.deviations(more) < 0.5 * FAR;
            trouble.right = if right { trouble.right + 1 } else { 0 };
            if trouble.right >= RIGHT {
                self.now = trouble.kept.clone();
                self.trouble = None;
                self.save(number);
                self.saved[1] = self.saved[0].clone();
            }
            return;
        }
        if let Some(before) = &mut self.saved[1] {
            before.widen(0, block.largest);
            let off = before.off(0, number, block);
            let wrong = off.deviations(more) > FAR;
            self.sudden = if self.wrong == 0 { far } else { self.sudden };
            self.wrong = if wrong { self.wrong + 1 } else { 0 };
            if self.wrong >= PERSISTENT {
                self.trouble = Some(Trouble {
                    kept: before.clone(),
                    now: off.mean,
                    residual: off.mean,
                    sudden: self.sudden,
                    right: 0,
                });
                self.wrong = 0;
                return;
            }
        }
        if number - self.saved_at >= ASIDE {
            self.save(number);
        }
    }

    fn save(&mut self, number: f64) {
        self.saved.swap(0, 1);
        self.saved[0] = Some(self.now.clone());
        self.saved_at = number;
    }

    /// Reports a fault of the load cell. Its recent updates are discarded, and it does not update the unknowns until
    /// it has been explained for a while.
    pub(crate) fn fault(&mut self) {
        match &mut self.trouble {
            Some(trouble) => trouble.right = 0,
            None => {
                let kept = self.saved[1].as_ref().or(self.saved[0].as_ref()).unwrap_or(&self.now).clone();
                self.trouble = Some(Trouble { kept, now: 0.0, residual: 0.0, sudden: false, right: 0 });
            }
        }
    }

    /// Residual when trouble began, and whether it changed from one block to the next; `None` without trouble.
    #[must_use]
    pub(crate) fn trouble(&self) -> Option<(f64, bool)> {
        self.trouble.as_ref().map(|trouble| (trouble.residual, trouble.sudden))
    }

    /// The current posterior; during trouble, the kept state.
    fn believed(&self) -> &Known {
        self.trouble.as_ref().map_or(&self.now, |trouble| &trouble.kept)
    }

    /// Mean and variance of a quantity on which the unknowns have these effects.
    #[must_use]
    pub(crate) fn state(&self, row: &[f64]) -> (f64, f64) {
        let known = self.believed();
        let (along, left) = self.basis.of(row);
        let (n, a) = (along.len(), DVector::from_vec(along));
        (a.dot(&known.m.rows(1, n)), a.dot(&(known.c.view((1, 1), (n, n)) * &a)) + left.norm_squared())
    }

    /// Transforms the effects to unknowns that are again independent with variance 1.
    #[must_use]
    pub(crate) fn narrowed(&self, row: &[f64]) -> Vec<f64> {
        let (along, mut effects) = self.basis.of(row);
        let n = along.len();
        let narrower = self.believed().root().view((1, 1), (n, n)) * DVector::from_vec(along);
        self.basis.add(narrower.as_slice(), &mut effects);
        effects.iter().copied().collect()
    }

    /// Standard deviation of the error of a reading, without the uncertainty of the unknowns.
    #[must_use]
    pub(crate) fn error(&self, channel: usize) -> f64 {
        let own = &self.channels[channel];
        let unexplained = self.trouble.as_ref().filter(|_| channel == 0).map_or(0.0, |trouble| trouble.now);
        (own.of_one.powi(2) + self.now.error(channel, own.largest).max(unexplained * unexplained)).sqrt()
    }

    /// Standard deviation of the noise of a reading.
    #[must_use]
    pub(crate) fn noise(&self, channel: usize) -> f64 {
        self.channels[channel].of_one
    }

    /// Block counts of a channel.
    #[must_use]
    pub(crate) fn tally(&self, channel: usize) -> Tally {
        self.channels[channel].tally
    }
}
