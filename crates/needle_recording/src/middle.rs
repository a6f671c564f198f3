//! The middle of many values without keeping them: 128 classes from each power of two to the next.

use std::collections::BTreeMap;

/// Bits of a number below its class.
const BELOW: u32 = 45;

/// Values from 0 on, counted by classes that are less than 1 % wide.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Middle {
    /// Number of values of a class, and the first of them.
    classes: BTreeMap<u64, (u64, f64)>,
    all: u64,
}

impl Middle {
    pub(super) fn note(&mut self, value: f64) {
        // the bits of numbers above 0 are in the order of the numbers
        self.classes.entry(value.to_bits() >> BELOW).or_insert((0, value)).0 += 1;
        self.all += 1;
    }

    /// The first value of the class with the median; `None` without values.
    pub(super) fn value(&self) -> Option<f64> {
        let mut below = 0;
        self.classes.values().find_map(|(count, first)| {
            below += count;
            (below > self.all / 2).then_some(*first)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_to_one_per_cent() {
        for (count, factor) in [(1_u32, 1.0), (2, 1e-9), (999, 0.37), (100_000, 1e7)] {
            let mut middle = Middle::default();
            (0..count).for_each(|i| middle.note(factor * f64::from(i * 7919 % count)));
            let (found, exact) = (middle.value().unwrap_or(f64::NAN), factor * f64::from(count / 2));
            assert!((found - exact).abs() <= 0.01 * exact, "{found} for {exact}");
        }
        assert_eq!(Middle::default().value(), None);
    }
}
