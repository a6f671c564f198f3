//! A twin with an instrument of the user's own.

use super::saved::Saved;
use super::{BuildError, Twin};
use crate::instrument::{Contact, Instrument, Own};
use crate::scene::{Dimension, Scene};

/// The nodes that the instrument of the scene would hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Held {
    /// Numbers of the nodes, as [`mtled::solver::Solver::prescribe`] takes them.
    pub nodes: Vec<u32>,
    /// Where each of them is in the undeformed sample, m.
    pub points: Vec<[f64; 3]>,
}

impl Twin {
    /// The twin of a scene whose plate or bonded indenter is replaced by an own instrument. The scene's says where the cloud is fine and which nodes of the
    /// surface can be held.
    ///
    /// # Errors
    /// [`BuildError`] if the scene can't be discretised, holds no node, or is a half plane, whose nodes are rings.
    pub fn with_instrument<I: Instrument>(scene: &Scene, make: impl FnOnce(Held) -> I) -> Result<Self, BuildError> {
        let refused = |key, reason| BuildError::Unsupported { key, reason };
        let mut twin = Self::new(scene)?;
        if twin.dimension() == Dimension::Axisymmetric {
            return Err(refused(
                "discretisation.dimension",
                "an own instrument needs \"full\" or \"mirrored\": the nodes of a half plane are rings",
            ));
        }
        let nodes = match &twin.contact {
            Some(Contact::Press(press)) if !press.bonded().is_empty() => press.bonded().to_vec(),
            _ => {
                return Err(refused(
                    "instrument.kind",
                    "an own instrument takes the place of a plate or a bonded indenter",
                ));
            }
        };
        let points = nodes.iter().map(|n| twin.reference_points()[*n as usize]).collect();
        let own = Contact::Own(Own::new(make(Held { nodes, points })));
        twin.saved = Saved::new(Some(own.clone()));
        twin.contact = Some(own);
        twin.reset();
        Ok(twin)
    }
}
