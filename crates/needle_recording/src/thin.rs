//! Series of more readings than are kept: every other one goes, as often as it takes, while they are read.

/// Which readings of one series are kept.
#[derive(Clone, Copy, Debug)]
pub(super) struct Thin {
    most: usize,
    /// One of so many is kept.
    every: u64,
    seen: u64,
}

impl Default for Thin {
    fn default() -> Self {
        Self::to(None)
    }
}

impl Thin {
    /// Keeps so many at most; `None`: all.
    pub(super) fn to(most: Option<usize>) -> Self {
        Self { most: most.unwrap_or(usize::MAX).max(2), every: 1, seen: 0 }
    }

    /// Takes the next reading.
    pub(super) fn take<V>(&mut self, kept: &mut Vec<V>, reading: V) {
        if self.seen.is_multiple_of(self.every) {
            if kept.len() >= self.most {
                let mut number = 0_usize;
                kept.retain(|_| {
                    number += 1;
                    !number.is_multiple_of(2)
                });
                self.every *= 2;
            }
            if self.seen.is_multiple_of(self.every) {
                kept.push(reading);
            }
        }
        self.seen += 1;
    }

    /// What is said of a series of which readings were left out.
    pub(super) fn warning(&self, of: &str) -> Option<String> {
        let Self { most, every, seen } = self;
        (*every > 1).then(|| {
            format!("{of}: {seen} readings are more than {most} (--most-readings): one in {every} of them is used")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_are_evenly_spaced_and_few() {
        for (count, every) in [(0, 1), (99, 1), (100, 1), (101, 2), (200, 2), (201, 4), (12_345, 128)] {
            let (mut thin, mut kept) = (Thin::to(Some(100)), Vec::new());
            (0..count).for_each(|i: u64| thin.take(&mut kept, i));
            let expected: Vec<u64> = (0..count).filter(|i| i.is_multiple_of(every)).collect();
            assert_eq!(kept, expected, "{count}");
            assert_eq!(thin.warning("x").is_some(), every > 1, "{count}");
        }
        let (mut all, mut kept) = (Thin::default(), Vec::new());
        (0..1000).for_each(|i| all.take(&mut kept, i));
        assert_eq!(kept.len(), 1000);
    }
}
