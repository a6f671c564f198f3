// Inputs made from a corpus: the same number gives the same input, so that a find needs no more than its number.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Longest input, bytes.
const LONGEST: usize = 1 << 15;
/// What parsers stumble over.
const TOKENS: [&str; 26] = [
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "1e999",
    "1e-999",
    "4294967296",
    "18446744073709551615",
    "-9223372036854775808",
    "[",
    "]",
    "{",
    "}",
    "\"",
    "'",
    "\n",
    ":",
    "=",
    "---",
    "&a",
    "*a",
    "<!--",
    "$Nodes\n",
    "\u{0}",
    "\u{fffd}",
];
const NUMBERS: [u64; 8] = [0, 1, 0x7f, 0xff, 0x7fff_ffff, 0xffff_ffff, u64::MAX >> 1, u64::MAX];

/// Input number `index` of a corpus.
pub fn input(corpus: &[Vec<u8>], index: u64) -> Vec<u8> {
    let mut random = ChaCha8Rng::seed_from_u64(index);
    let mut below = |end: usize| (random.next_u64() % end.max(1) as u64) as usize;
    let mut data = corpus[below(corpus.len())].clone();
    for _ in 0..=below(6) {
        let at = below(data.len());
        match below(9) {
            0 if !data.is_empty() => data[at] ^= 1 << below(8),
            1 if !data.is_empty() => data[at] = below(256) as u8,
            2 => data.truncate(at),
            3 => {
                let bytes = NUMBERS[below(NUMBERS.len())].to_le_bytes();
                let width = [1, 2, 4, 8][below(4)].min(data.len() - at);
                data[at..at + width].copy_from_slice(&bytes[..width]);
            }
            4 => {
                let token = TOKENS[below(TOKENS.len())].as_bytes();
                data.splice(at..at, token.iter().copied());
            }
            5 => {
                let end = at + below(data.len() - at);
                data.drain(at..end.min(at + 64));
            }
            6 => {
                let piece = data[at..(at + below(256)).min(data.len())].to_vec();
                let to = below(data.len());
                data.splice(to..to, piece);
            }
            7 => {
                let other = &corpus[below(corpus.len())];
                let from = below(other.len());
                data.truncate(at);
                data.extend_from_slice(&other[from..]);
            }
            _ => number(&mut data, at, &mut below),
        }
    }
    data.truncate(LONGEST);
    data
}

/// Another number in the place of the next one that stands there as text.
fn number(data: &mut Vec<u8>, at: usize, below: &mut impl FnMut(usize) -> usize) {
    let Some(begin) = data[at.min(data.len())..].iter().position(u8::is_ascii_digit).map(|p| at + p) else { return };
    let end = begin + data[begin..].iter().position(|b| !b.is_ascii_digit()).unwrap_or(data.len() - begin);
    let other = match below(3) {
        0 => TOKENS[below(10)].to_owned(),
        1 => below(100).to_string(),
        _ => below(usize::MAX).to_string(),
    };
    data.splice(begin..end, other.bytes());
}
