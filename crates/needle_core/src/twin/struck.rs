//! Poses at which a kinematic needle takes or leaves a layer of nodes: a blow.
//!
//! A node is held from one step to the next, or free, and what held it is gone at once. Tissue that stiffens as it is strained
//! is thrown by that: the forces on needle and base differ by up to the whole force for one to three poses, since a moving needle
//! leaves a pose before the tissue has come to rest. Such a pose gets further steps.

use mtled::solver::Balance;

use super::{Halt, Phase, Twin};
use crate::instrument::{Contact, Tip};

/// Steps between two looks at the balance, and most looks.
const LOOK: u32 = 8;
const LOOKS: u32 = 8;

impl Twin {
    /// Takes further steps at the same pose, at most so many, while the tissue is thrown by what the needle has taken or left.
    pub(super) fn calm(
        &mut self,
        first: &Balance,
        tip: &Tip,
        phase: Phase,
        time_s: f64,
        most: u32,
    ) -> Result<Option<(Balance, u32)>, Halt> {
        let (mut last, mut taken) = (None, 0);
        if !matches!(self.contact, Some(Contact::Needle(_))) {
            return Ok(None);
        }
        for _ in 0..LOOKS {
            let steps = LOOK.min(most.saturating_sub(taken));
            if steps == 0 || !self.progress.pace.is_struck(last.as_ref().unwrap_or(first)) {
                break;
            }
            last = Some(self.advance_safely(steps, [0.0; 3], tip, phase, time_s)?);
            taken += steps;
        }
        Ok(last.map(|balance| (balance, taken)))
    }
}
