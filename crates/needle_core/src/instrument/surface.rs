//! The rigid surfaces of a scene and the nodes that may meet them: from the keys of instrument and sample to the solver's shapes.

use crate::scene::{Base, ContactLaw, Dimension, IndenterTip, Instrument, InstrumentKind, Scene};
use mtled::cloud::{BASE, SIDE, TOP};
use mtled::solver::{Shape, Surface};

/// The surface of the scene's instrument, whose tip touches the body at z = `top` at depth zero; `None` where nothing but a bond
/// holds the tissue. `edge`: distance between nodes at the edge of an indenter's face, m.
#[must_use]
pub(crate) fn of_instrument(scene: &Scene, top: f64, edge: f64) -> Option<Surface> {
    let instrument = scene.instrument.as_ref()?;
    let shape = match instrument.kind {
        InstrumentKind::Plate if instrument.contact == ContactLaw::Bonded => return None,
        InstrumentKind::Plate => Shape::Plate,
        InstrumentKind::Indenter { tip: IndenterTip::Flat, .. } if !has_wall(scene) => return None,
        InstrumentKind::Indenter { diameter, tip: IndenterTip::Flat, .. } => {
            Shape::Punch { radius: 0.5 * diameter.get(), edge: if instrument.is_bonded() { 0.0 } else { edge } }
        }
        InstrumentKind::Indenter { diameter, tip: IndenterTip::Sphere, .. } => {
            Shape::Ball { radius: 0.5 * diameter.get() }
        }
        InstrumentKind::Needle(_) if !has_wall(scene) => return None,
        // what the tip presses on has the radius of what it will capture
        InstrumentKind::Needle(needle) if needle.slope() == [0.0; 2] => {
            Shape::Punch { radius: needle.capture_radius.get(), edge: 0.0 }
        }
        InstrumentKind::Needle(needle) => Shape::Shaft { radius: needle.capture_radius.get(), slope: needle.slope() },
    };
    let [x, y] = instrument.entry.map(|m| m.get());
    let friction = match instrument.contact {
        // beside a bonded face the wall is smooth
        ContactLaw::Bonded if has_wall(scene) => 0.0,
        ContactLaw::Bonded => f64::INFINITY,
        ContactLaw::Frictionless => 0.0,
        ContactLaw::Coulomb { friction_coefficient } => friction_coefficient,
    };
    Some(Surface { shape, origin: [x, y, top], friction })
}

/// The table under a sample whose base is not bonded, at z = `bottom`.
#[must_use]
pub(crate) fn of_base(scene: &Scene, bottom: f64) -> Option<Surface> {
    let friction = match scene.sample.base {
        Base::Bonded => return None,
        Base::Frictionless => 0.0,
        Base::Coulomb { base_friction_coefficient } => base_friction_coefficient,
    };
    Some(Surface { shape: Shape::Table, origin: [0.0, 0.0, bottom], friction })
}

/// Faces of the body whose nodes may meet a surface. What touches a plate or a table may roll onto it with its side.
#[must_use]
pub(crate) fn touchable(scene: &Scene) -> u8 {
    let instrument = of_instrument(scene, 0.0, 0.0).map_or(0, |surface| match surface.shape {
        Shape::Plate | Shape::Table => TOP | SIDE,
        Shape::Punch { .. } | Shape::Shaft { .. } | Shape::Ball { .. } => TOP,
    });
    let base = of_base(scene, 0.0).map_or(0, |_| BASE | SIDE);
    instrument | base
}

/// Puncture strain up to which a needle has no wall: the surface is punctured before the tip is a quarter of the capture radius deep (at
/// 0.13 mm of 0.5 mm), and no free node, half a radius away, can have come to the shaft.
const UNFOLDED: f64 = 0.1;

/// Whether free tissue meets the side wall of the scene's instrument: of a flat indenter, of a kinematic needle before the puncture, and of a
/// needle with friction in a half plane that has a membrane to break. Without a wall the surface closes above a tip that is pressed some radii
/// deep, and what lies within the needle then is inverted when the membrane breaks. In space the surface's nodes are too far apart for it.
#[must_use]
pub fn has_wall(scene: &Scene) -> bool {
    let Some(instrument) = &scene.instrument else { return false };
    match instrument.kind {
        InstrumentKind::Indenter { tip: IndenterTip::Flat, wall_contact, .. } => {
            wall_contact || !instrument.is_bonded()
        }
        InstrumentKind::Needle(needle) if instrument.is_frictional() => {
            needle.wall_contact && scene.has_membrane() && scene.dimension().dimension == Dimension::Axisymmetric
        }
        InstrumentKind::Needle(needle) => needle.wall_contact && needle.puncture_strain > UNFOLDED,
        _ => false,
    }
}

/// Nodes along the radius of an edge: with fewer, tissue goes round it in jumps, and loading and unloading part by half a per cent.
const EDGE_NODES: f64 = 5.0;
/// Largest radius of an edge over that of the face.
const LARGEST_EDGE: f64 = 0.05;

/// Radius of an indenter's edge, m: as many times the distance to the nearest node of the top face beyond it, m; 0 without one.
#[must_use]
pub(crate) fn edge(instrument: &Instrument, points: &[[f64; 3]], faces: &[u8]) -> f64 {
    let InstrumentKind::Indenter { diameter, .. } = instrument.kind else { return 0.0 };
    let ([x, y], radius) = (instrument.entry.map(|m| m.get()), 0.5 * diameter.get());
    let beyond = |p: &[f64; 3]| (p[0] - x).hypot(p[1] - y) - radius;
    let on_top = points.iter().zip(faces).filter(|(_, face)| **face & TOP != 0);
    let nearest = on_top.map(|(p, _)| beyond(p)).filter(|d| *d > 1e-9 * radius).fold(f64::INFINITY, f64::min);
    (EDGE_NODES * nearest).min(LARGEST_EDGE * radius)
}

impl Instrument {
    /// Whether nodes of the contact face move with it from the start.
    #[must_use]
    pub fn is_bonded(&self) -> bool {
        match self.kind {
            InstrumentKind::Plate | InstrumentKind::Indenter { tip: IndenterTip::Flat, .. } => {
                self.contact == ContactLaw::Bonded
            }
            InstrumentKind::Indenter { .. } | InstrumentKind::Needle(_) => false,
        }
    }
}
