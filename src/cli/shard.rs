//! Parts of a work that several machines share.

use std::str::FromStr;

/// Part `number` of `of`, counted from 1: every `of`-th piece, beginning with that one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shard {
    pub number: usize,
    pub of: usize,
}

impl Shard {
    /// All of it.
    pub(crate) const WHOLE: Self = Self { number: 1, of: 1 };

    /// Whether piece i, from 0, is of this part.
    pub(crate) const fn has(self, i: usize) -> bool {
        i % self.of == self.number - 1
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let parts = text.split_once('/').and_then(|(i, n)| Some((i.trim().parse().ok()?, n.trim().parse().ok()?)));
        let whole = parts.filter(|(number, of)| (1..=*of).contains(number));
        whole.map(|(number, of)| Self { number, of }).ok_or_else(|| "i/n with i from 1 to n, as 2/8".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shard_is_a_number_of_a_count() {
        assert_eq!("2/8".parse(), Ok(Shard { number: 2, of: 8 }));
        for wrong in ["0/4", "5/4", "1", "a/b", "1/0", "-1/3"] {
            assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
        }
        assert!(Shard { number: 2, of: 3 }.has(4) && !Shard { number: 2, of: 3 }.has(3));
    }
}
