//! What can be asked of the tissue between poses: the field at nodes and targets, volume ratio, stress.

use crate::instrument::Contact;
use crate::scene::InstrumentKind;

use super::{Phase, Pose, Twin, Work};

impl Twin {
    /// Displacement of the field at every reference point, m. Overwrites `out`.
    pub fn displacements(&self, out: &mut Vec<[f64; 3]>) {
        self.fixed.tissue.displacements(self.solver.parameters(), out);
        self.counters.displacements.add(out.len());
    }

    /// Volume ratio J and von Mises (Cauchy) stress in Pa, averaged to the reference points. Overwrites both.
    pub fn jacobian_and_stress(&self, jacobian: &mut Vec<f64>, von_mises_pa: &mut Vec<f64>) {
        self.fixed.tissue.jacobian_and_stress(&self.solver, jacobian, von_mises_pa);
        self.counters.volume_ratios.add(jacobian.len());
        self.counters.stresses.add(von_mises_pa.len());
    }

    /// Volume ratio J alone, averaged to the reference points. Overwrites `out`.
    pub fn jacobian(&self, out: &mut Vec<f64>) {
        self.fixed.tissue.jacobian(&self.solver, out);
        self.counters.volume_ratios.add(out.len());
    }

    /// What has been computed beside the force since the twin was built.
    #[must_use]
    pub fn work(&self) -> Work {
        self.counters.work()
    }

    /// Present positions of the scene's targets, m, in the scene's order. Overwrites `out`.
    pub fn target_positions(&self, out: &mut Vec<[f64; 3]>) {
        self.fixed.tissue.target_positions(&self.fixed.scene.targets, self.solver.parameters(), out);
        self.correct_targets(out);
        self.counters.targets.add(out.len());
    }

    /// Largest distance between the field and its prescribed value at a held node, m.
    #[must_use]
    pub(crate) fn constraint_error(&self) -> f64 {
        self.fixed.tissue.constraint_error(&self.solver)
    }

    /// Whether the needle's shaft bends.
    #[must_use]
    pub fn bends(&self) -> bool {
        self.contact.as_ref().and_then(Contact::shaft).is_some()
    }

    /// Poses along a needle that bends, from the driver's clamp to the tip. Overwrites `out`; empty for another instrument.
    pub fn needle_shape(&self, out: &mut Vec<Pose>) {
        out.clear();
        let Some(shaft) = self.contact.as_ref().and_then(Contact::shaft) else { return };
        let entry = self.path().entry;
        let start = [entry[0], entry[1], self.fixed.top];
        let directions = shaft.directions();
        out.extend(shaft.places().iter().zip(directions).map(|(x, axis)| Pose {
            tip: std::array::from_fn(|k| start[k] + x[k]),
            axis,
            roll_rad: self.progress.roll,
        }));
    }

    /// Where the tip of a needle that bends would be if it were straight, m; `None` for another instrument.
    #[must_use]
    pub fn straight_tip(&self) -> Option<[f64; 3]> {
        let entry = self.path().entry;
        let tip = self.progress.tip;
        self.bends().then(|| [entry[0] + tip[0], entry[1] + tip[1], self.fixed.top + tip[2]])
    }

    /// Where the tip of a needle that bends is, and its direction; `None` for another instrument, which is where its pose says.
    #[must_use]
    pub fn bent_tip(&self) -> Option<Pose> {
        let shaft = self.contact.as_ref().and_then(Contact::shaft)?;
        let x = shaft.places().last()?;
        let entry = self.path().entry;
        let tip = [entry[0] + x[0], entry[1] + x[1], self.fixed.top + x[2]];
        Some(Pose { tip, axis: shaft.directions().last()?, roll_rad: shaft.tip_roll() })
    }

    /// Radius that the cloud gives a needle, m ([`crate::instrument::NeedlePath::effective_radius`]); `None` without a
    /// needle.
    #[must_use]
    pub fn effective_radius(&self) -> Option<f64> {
        match &self.contact {
            Some(Contact::Needle(path)) => Some(path.effective_radius()),
            Some(Contact::Frictional(needle)) => Some(needle.effective_radius()),
            _ => None,
        }
    }

    /// Whether a needle is in the tissue.
    pub(super) fn inserted(&self) -> bool {
        matches!(self.progress.phase, Phase::Penetration | Phase::Retraction)
    }

    /// How far beside its path the tip may be, m: a needle enters on its path, and may then be moved sideways by as much
    /// as it is deep.
    pub(super) fn side_reach(&self) -> f64 {
        match self.fixed.scene.instrument.as_ref().map(|i| &i.kind) {
            Some(InstrumentKind::Needle(n)) => {
                let entering = 0.5 * n.capture_radius.get();
                if self.inserted() { entering.max(-self.progress.tip[2]) } else { entering }
            }
            // a shear of one half: beyond that the bond is not realistic
            _ => 0.5 * self.fixed.height,
        }
    }

    /// Depth at which the surface was punctured or deepest point of the insertion; `None` before.
    #[must_use]
    pub(crate) fn deepest(&self) -> Option<f64> {
        match &self.contact {
            Some(Contact::Needle(n)) if n.insertion().punctured => Some(n.insertion().deepest * self.path().secant()),
            Some(Contact::Frictional(n)) => n.deepest(),
            _ => None,
        }
    }
}
