//! Twins on one cloud: of scenes that differ in nothing that nodes, shape functions and shown body depend on. Those are there once.

use std::sync::Arc;

use crate::instrument::{Contact, surface};
use crate::scene::{Base, ContactLaw, Instrument, InstrumentKind, Interaction, Scene};
use mtled::solver::{Solver, Surface};

use super::body::enters_at_once;
use super::saved::Saved;
use super::work::Counters;
use super::{Along, Fixed, Folds, Happened, Pace, Progress, Recovered, Twin, assembly, regions};

impl Twin {
    /// An undeformed twin of another scene that differs from this one's in constants of materials, of friction, or of a needle; `None`
    /// where the other needs a cloud of its own. It answers with the bits of a twin that is built anew, is there in a fraction of the
    /// time, and shares with this one what they have in common: both hold on to it.
    #[must_use]
    pub fn sibling(&self, scene: &Scene) -> Option<Self> {
        let own = &*self.fixed;
        if !are_alike(&own.scene, scene) || matches!(self.contact, Some(Contact::Own(_))) {
            return None;
        }
        let model = self.solver.model();
        let mut model = model.with_laws(&regions::laws(scene, model.materials() > 1));
        let [instrument, base] = model.surfaces();
        let of_instrument = surface::of_instrument(scene, own.top, 0.0);
        let of_base = surface::of_base(scene, 0.0);
        model = model.with_surfaces(rubbing(instrument, of_instrument), rubbing(base, of_base));
        let mut solver = Solver::of(Arc::new(model), rayon::current_num_threads());
        let contact = self.contact.clone().map(|contact| fresh(contact, scene, own.top, &mut solver));
        let mut warnings = own.warnings[..own.of_cloud].to_vec();
        warnings.extend(scene.advice());
        let along = Along::of(scene, &own.tissue, own.top);
        warnings.extend(contact.iter().flat_map(|contact| along.missed(scene, contact)));
        let fixed = Fixed {
            scene: scene.clone(),
            dimension: own.dimension.clone(),
            mirror: own.mirror,
            along,
            tissue: Arc::clone(&own.tissue),
            warnings,
            ..*own
        };
        let mut twin = Self {
            folds: Folds::new(&fixed.tissue),
            recovered: Recovered::new(&fixed.scene, &fixed.tissue, fixed.top),
            saved: Saved::new(contact.clone()),
            progress: Progress::new(Pace::new(scene, own.height)),
            fixed: Arc::new(fixed),
            solver,
            contact,
            counters: Counters::default(),
            happened: Happened::default(),
        };
        twin.begin();
        Some(twin)
    }

    /// Whether this twin and another share their cloud, so that a double of one can take over the other's state.
    #[must_use]
    pub fn is_sibling_of(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.fixed.tissue, &other.fixed.tissue)
    }
}

/// Whether two scenes have one cloud with the same shape functions, roles and surfaces: they are equal but for constants, and what is
/// decided by constants is decided alike.
fn are_alike(one: &Scene, other: &Scene) -> bool {
    let mut same = one.clone();
    same.name.clone_from(&other.name);
    same.description.clone_from(&other.description);
    same.uncertainty.clone_from(&other.uncertainty);
    same.material = other.material;
    for (own, other) in same.materials.iter_mut().zip(&other.materials) {
        (own.material, own.pierced) = (other.material, other.pierced);
    }
    if let (Base::Coulomb { .. }, Base::Coulomb { .. }) = (same.sample.base, other.sample.base) {
        same.sample.base = other.sample.base;
    }
    if let (Some(own), Some(other)) = (&mut same.instrument, &other.instrument) {
        *own = with_coefficients_of(*own, other);
    }
    let crushed = |scene: &Scene| scene.regions.iter().map(|r| regions::is_crushed(scene, r)).collect::<Vec<_>>();
    let decided = |scene: &Scene| scene.instrument.map(|i| (surface::has_wall(scene), enters_at_once(&i)));
    same == *other && crushed(one) == crushed(other) && decided(one) == decided(other)
}

/// An instrument with the coefficients of another of its kind.
fn with_coefficients_of(own: Instrument, other: &Instrument) -> Instrument {
    let kind = match (own.kind, other.kind) {
        (InstrumentKind::Needle(needle), InstrumentKind::Needle(other)) => {
            InstrumentKind::Needle(crate::scene::Needle {
                deformation_coefficient: other.deformation_coefficient,
                retraction_coefficient: other.retraction_coefficient,
                puncture_strain: other.puncture_strain,
                ..needle
            })
        }
        (kind, _) => kind,
    };
    let contact = match (own.contact, other.contact) {
        (ContactLaw::Coulomb { .. }, ContactLaw::Coulomb { .. }) => other.contact,
        (contact, _) => contact,
    };
    let interaction = match (own.interaction, other.interaction) {
        (Interaction::Frictional { .. }, Interaction::Frictional { .. }) => other.interaction,
        (interaction, _) => interaction,
    };
    Instrument { kind, contact, interaction, ..own }
}

/// A surface with the friction of another.
fn rubbing(own: Option<Surface>, other: Option<Surface>) -> Option<Surface> {
    Some(Surface { friction: other?.friction, ..own? })
}

/// A contact before the first pose, with the coefficients of a scene, on an undeformed solver.
fn fresh(contact: Contact, scene: &Scene, top: f64, solver: &mut Solver) -> Contact {
    let mut contact = match (contact, scene.instrument.as_ref()) {
        (Contact::Needle(path), Some(Instrument { kind: InstrumentKind::Needle(needle), .. })) => {
            Contact::Needle(Box::new(assembly::in_tissue(path.with(*needle), scene, top)))
        }
        (Contact::Frictional(needle), Some(instrument)) => {
            Contact::Frictional(Box::new(needle.in_tissue(scene, instrument, top, |p| regions::at(scene, top, p))))
        }
        (contact, _) => contact,
    };
    contact.reset(solver);
    if matches!(contact, Contact::Frictional(_)) {
        solver.settle();
    }
    contact
}
