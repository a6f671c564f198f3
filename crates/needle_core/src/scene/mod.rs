//! What is modelled: sample, material, instrument, discretisation, motion, targets, outputs.
//!
//! A scene is a TOML file that names only what is in it. [`Scene`] is the validated form, SI units.
//!
//! From file to scene: text → `parse` (every key looked up in the one registry, [`keys`]) → raw values → the sections'
//! own fields ([`Scene`]) → `check` (do the parts fit together?). `--set` and parameters meet the file at the raw
//! values, so that all of them obey the same types, ranges and messages.
//!
//! A key is a field of its section's struct, in the section's file: path, range, unit, default and description stand there
//! and nowhere else.

mod advice;
mod align;
mod check;
mod check_cells;
mod check_materials;
mod correction;
mod correlation;
mod discretisation;
mod edit;
mod error;
pub mod file;
mod grading;
mod instrument;
mod key;
pub mod keys;
mod material;
mod materials;
mod motion;
mod parse;
mod placement;
mod presets;
mod range;
mod region;
mod sample;
mod section;
pub mod size;
mod stepping;
mod symmetry;
mod target;
mod tie;
mod uncertainty;
mod units;
mod value;
mod values;

pub use align::Align;
pub use check::LARGEST_POISSON_RATIO;
pub use correction::Correction;
pub use correlation::Dependence;
pub use discretisation::AskedGrading;
pub use discretisation::{Cells, Dimension, Discretisation, Integration, Method, VolumeRatio};
pub use edit::{NewValue, Override};
pub use error::SceneError;
pub use grading::Grading;
pub use instrument::{
    Bevel, ContactLaw, DeformationRule, Flexible, IndenterTip, Instrument, InstrumentKind, Interaction, Needle,
    NeedleTip,
};
pub use key::{Key, Kind, Research};
pub use material::Material;
pub use material::MaterialModel;
pub use materials::{NamedMaterial, Pierced};
pub use motion::Motion;
pub use presets::{PRESETS, Preset};
pub use range::Range;
pub use region::Region;
pub use region::RegionShape;
pub use sample::{Base, MeshFile, Sample, Shape};
pub use section::Word;
pub use stepping::Stepping;
pub use symmetry::Resolved;
pub use target::Target;
pub use uncertainty::{Prior, Recorded, Uncertain};
pub use units::{Hertz, Metres, Radians, Seconds};
pub use units::{KilogramsPerCubicMetre, MetresPerSecond, Pascals, PoissonRatio};
pub use value::Value;

use section::section;

section! {
    /// A validated scene: everything that [`crate::twin::Twin`] needs, and nothing that is not modelled.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Scene => {
        /// Short name; the file's name where it is absent.
        name: String = Key::text("name").or("scene"),
        /// What the scene is and what it assumes.
        description: String = Key::text("description").or(""),
        /// Error that force and targets may have, of their largest values, as a root mean square over the poses: cloud and steps that are left
        /// to the program follow from it.
        accuracy: f64 = Key::real("accuracy", Range::closed(0.002, 0.1), "").or("0.01"),
        /// The tissue sample.
        sample: Sample,
        /// Its constitutive law: that of whatever lies in no region.
        material: Material,
        /// Further materials, for regions.
        materials: Vec<NamedMaterial>,
        /// Parts of the sample that are of another material.
        regions: Vec<Region>,
        /// The instrument; absent: nothing touches the sample.
        instrument: Option<Instrument>,
        /// How the field is approximated.
        discretisation: Discretisation,
        /// How poses become explicit steps.
        stepping: Stepping,
        /// The scene's own motion, for `solve`; absent: poses come from outside only.
        motion: Option<Motion>,
        /// Material points whose position is predicted.
        targets: Vec<Target>,
        /// What the cloud's answers lack against a finer one's; absent: nothing is corrected.
        correction: Option<Correction>,
        /// How the recording lies to the model that the scene was calibrated on; absent: as it was recorded.
        align: Option<Align>,
        /// Keys whose values are not known for sure, with their prior distributions.
        uncertainty: Vec<Uncertain>,
    }
}
