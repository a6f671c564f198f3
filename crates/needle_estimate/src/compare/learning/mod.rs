//! What readings say of unknown values, while they come: Bayesian linear regression with errors of the model that are learnt as well.
//!
//! A reading y is what was expected, plus a row a of effects of unknowns w, each of which is normal with mean 0 and variance 1 before the first reading,
//! plus the error of the model, plus noise. Members of an ensemble are such unknowns (`ensemble::assimilate`), and so are a modulus and a zero
//! (`identifier`). What w is afterwards stands in `known`, how the error is learnt in `process`, noise in `noise`. One unknown is added: the size of
//! the twin's own force, [`FORCE_ERROR`].
//!
//! Readings come in blocks of [`BLOCK_S`]. A block farther off than three standard deviations is **rejected**: it says nothing of the unknowns. Where
//! what was known half a second to a second before can't explain a load cell for two blocks, either, its own force error allowed for, there is **trouble**:
//! the unknowns are again what they were then, and the load cell moves them no more until it has been explained for ten.
//! Forecasts go on with all readings.

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

/// Length of a block, s: how far ahead a reading is forecast.
pub const BLOCK_S: f64 = 0.05;
/// A block farther off than this, in standard deviations, is not explained.
const FAR: f64 = 3.0;
/// Blocks that are not explained by what was known before, until there is trouble; and explained, within half of [`FAR`], until it is over.
const PERSISTENT: usize = 2;
const RIGHT: usize = 10;
/// Blocks from one saved state to the next; trouble goes back to the last but one. A longer pause forgets the readings before it.
const ASIDE: f64 = 10.0;

/// How far off the expectation a reading will be, and how far about that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Mean.
    pub off: f64,
    /// Of a reading about it.
    pub variance: f64,
}

/// A sensor's number, whose readings come in blocks.
#[derive(Clone, Debug)]
struct Channel {
    noise: Noise,
    /// What it is known to be, of a reading.
    of_one: f64,
    /// Largest expected force so far.
    largest: f64,
    /// Readings of the block that is not over yet, and its number.
    block: Readings,
    number: f64,
    /// Number of the block before, and the time of the first reading.
    last: f64,
    first_s: Option<f64>,
    tally: Tally,
}

/// Blocks of a channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Blocks that were seen.
    pub blocks: usize,
    /// How many of them moved nothing.
    pub rejected: usize,
    /// Whether the last one did not.
    pub rejects: bool,
}

/// The load cell is not explained.
#[derive(Clone, Debug)]
struct Trouble {
    kept: Known,
    /// The residual by what was kept, in the last block.
    now: f64,
    /// What it was when it was noticed, and whether it came from one block to the next.
    residual: f64,
    sudden: bool,
    right: usize,
}

/// See the module.
#[derive(Clone, Debug)]
pub struct Learner {
    basis: Basis,
    now: Known,
    channels: Vec<Channel>,
    /// What was known before, the newer first, and the number of the block of that.
    saved: [Option<Known>; 2],
    saved_at: f64,
    trouble: Option<Trouble>,
    /// Blocks of the load cell that what was saved has not explained, one after the other, and whether the first was rejected.
    wrong: usize,
    sudden: bool,
}

/// Number of the block at a time after the first reading, s.
fn block_of(since_s: f64) -> f64 {
    (since_s / BLOCK_S * (1.0 + 1e-9)).floor()
}

impl Default for Learner {
    /// Nothing is known yet.
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
    /// Adds a sensor with at least this noise; its number. Trouble is that of the first.
    pub fn add(&mut self, least_noise: f64) -> usize {
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

    /// Takes a reading, no earlier than the one before. Whether it comes in the block after the last one that was seen, or in the same.
    pub fn take(&mut self, channel: usize, time_s: f64, reading: Reading<impl AsRef<[f64]>>) -> bool {
        self.begin(channel, time_s);
        let own = &mut self.channels[channel];
        own.largest = own.largest.max(reading.force_n.map_or(f64::INFINITY, f64::abs));
        own.block.push(&reading);
        own.number - own.last <= 1.0
    }

    /// The same, with what was expected of it from what had been measured up to one block before; `None` in the first block and after a gap.
    pub fn take_expected(&mut self, channel: usize, time_s: f64, reading: Reading) -> Option<Expected> {
        self.begin(channel, time_s);
        let expected = self.expect(channel, self.channels[channel].number, &reading);
        self.take(channel, time_s, reading).then_some(expected)
    }

    /// Ends the block before that of a reading.
    fn begin(&mut self, channel: usize, time_s: f64) {
        let first_s = *self.channels[channel].first_s.get_or_insert(time_s);
        let number = block_of(time_s - first_s);
        if number != self.channels[channel].number {
            self.close(channel);
            self.channels[channel].number = number;
        }
    }

    /// The reading of a time that has not been measured yet.
    #[must_use]
    pub fn expected(&self, channel: usize, time_s: f64, reading: &Reading) -> Expected {
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

    /// Ends the blocks that have been begun.
    pub fn close_all(&mut self) {
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

    /// Whether what was known before explains a block of the load cell, with an error of the force of this standard deviation.
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

    /// Takes note that the load cell is at fault: what it taught last is forgotten, and it teaches nothing until it has been explained for a while.
    pub fn fault(&mut self) {
        match &mut self.trouble {
            Some(trouble) => trouble.right = 0,
            None => {
                let kept = self.saved[1].as_ref().or(self.saved[0].as_ref()).unwrap_or(&self.now).clone();
                self.trouble = Some(Trouble { kept, now: 0.0, residual: 0.0, sudden: false, right: 0 });
            }
        }
    }

    /// What the residual was when there was trouble, and whether it came from one block to the next; `None` without trouble.
    #[must_use]
    pub fn trouble(&self) -> Option<(f64, bool)> {
        self.trouble.as_ref().map(|trouble| (trouble.residual, trouble.sudden))
    }

    /// What the unknowns are known to be by all that is believed.
    fn believed(&self) -> &Known {
        self.trouble.as_ref().map_or(&self.now, |trouble| &trouble.kept)
    }

    /// Mean and variance of a number on which each unknown has this effect.
    #[must_use]
    pub fn state(&self, row: &[f64]) -> (f64, f64) {
        let known = self.believed();
        let (along, left) = self.basis.of(row);
        let (n, a) = (along.len(), DVector::from_vec(along));
        (a.dot(&known.m.rows(1, n)), a.dot(&(known.c.view((1, 1), (n, n)) * &a)) + left.norm_squared())
    }

    /// Effects of unknowns that are independent and of variance 1 again.
    #[must_use]
    pub fn narrowed(&self, row: &[f64]) -> Vec<f64> {
        let (along, mut effects) = self.basis.of(row);
        let n = along.len();
        let narrower = self.believed().root().view((1, 1), (n, n)) * DVector::from_vec(along);
        self.basis.add(narrower.as_slice(), &mut effects);
        effects.iter().copied().collect()
    }

    /// Standard deviation of what a reading is off by beyond what is not known of the unknowns.
    #[must_use]
    pub fn error(&self, channel: usize) -> f64 {
        let own = &self.channels[channel];
        let unexplained = self.trouble.as_ref().filter(|_| channel == 0).map_or(0.0, |trouble| trouble.now);
        (own.of_one.powi(2) + self.now.error(channel, own.largest).max(unexplained * unexplained)).sqrt()
    }

    /// Noise of a reading, standard deviation.
    #[must_use]
    pub fn noise(&self, channel: usize) -> f64 {
        self.channels[channel].of_one
    }

    /// Blocks of a channel.
    #[must_use]
    pub fn tally(&self, channel: usize) -> Tally {
        self.channels[channel].tally
    }
}
