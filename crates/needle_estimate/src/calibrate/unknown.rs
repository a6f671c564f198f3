//! The unknowns of a search: keys of the scene, parameters of the load cell, and alignment of the recording with the
//! model.

use super::{CalibrateError, LoadCell, Wanted};
use crate::compare::least_squares;
use needle_core::scene::{Align, Kind, LARGEST_POISSON_RATIO, Scene, keys};

/// If an end of a key's range is excluded, the search stays away from it by this share of the start.
const OFF_THE_END: f64 = 1e-3;
/// Largest relative change of a key in one step.
const LARGEST_STEP: f64 = 0.5;
/// Scale of a key that starts at zero, over the distance of its bounds.
const SIZE_AT_ZERO: f64 = 0.1;
/// Scale of a shift of the contact, m, and of the clock, s; and the largest step of each in multiples of it.
const CONTACT: (f64, f64) = (1e-4, 5.0);
const CLOCK: (f64, f64) = (1e-2, 20.0);

/// An unknown.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Sought {
    /// A key of the scene.
    Key(String),
    /// Recorded depth of the first contact, m.
    Contact,
    /// Delay of the force's stamps, s.
    Clock,
    /// Reading of the load cell without load, N. `asked`: requested as the recording's zero.
    Zero { asked: bool },
    /// Change of the reading without load over time, N/s.
    Drift,
}

pub(super) const CONTACT_KEY: &str = "align.contact_depth_m";
pub(super) const CLOCK_KEY: &str = "align.time_offset_s";
pub(super) const ZERO_KEY: &str = "align.force_zero_n";
pub(super) const OFFSET_KEY: &str = "load_cell.offset_n";
pub(super) const DRIFT_KEY: &str = "load_cell.drift_n_per_s";
/// Keys of a recording that can be requested.
const ALIGN: [&str; 3] = [CONTACT_KEY, CLOCK_KEY, ZERO_KEY];

impl Sought {
    /// The requested keys, then the load cell's parameters.
    pub(crate) fn all(wanted: &[Wanted], load_cell: LoadCell) -> Vec<Self> {
        let asked = |w: &Wanted| match w.key.as_str() {
            CONTACT_KEY => Self::Contact,
            CLOCK_KEY => Self::Clock,
            ZERO_KEY => Self::Zero { asked: true },
            key => Self::Key(key.to_owned()),
        };
        let mut all: Vec<Self> = wanted.iter().map(asked).collect();
        if load_cell != LoadCell::Exact && !all.contains(&Self::Zero { asked: true }) {
            all.push(Self::Zero { asked: false });
        }
        if matches!(load_cell, LoadCell::Drift | LoadCell::Auto) {
            all.push(Self::Drift);
        }
        all
    }

    pub(crate) fn name(&self) -> &str {
        match self {
            Self::Key(key) => key,
            Self::Contact => CONTACT_KEY,
            Self::Clock => CLOCK_KEY,
            Self::Zero { asked: true } => ZERO_KEY,
            Self::Zero { asked: false } => OFFSET_KEY,
            Self::Drift => DRIFT_KEY,
        }
    }

    /// Whether it is the factor on all constants of the law.
    pub(crate) fn is_scale(&self) -> bool {
        matches!(self, Self::Key(key) if key == SCALE_KEY)
    }

    /// Whether it is a share or a time of relaxation.
    pub(crate) fn is_of_relaxation(&self) -> bool {
        matches!(self, Self::Key(key) if key.contains("prony_"))
    }

    /// Whether it is a key of one of several regions or materials.
    pub(crate) fn is_of_regions(&self) -> bool {
        matches!(self, Self::Key(key) if key.starts_with("regions.") || key.starts_with("materials."))
    }

    /// The change of a load cell's reading at a time for one unit of it.
    pub(crate) const fn added(&self, time_s: f64) -> f64 {
        match self {
            Self::Zero { .. } => 1.0,
            Self::Drift => time_s,
            _ => 0.0,
        }
    }

    /// Its value in the scene's `[align]`; 0 for all other unknowns.
    pub(crate) fn aligned(&self, scene: &Scene) -> f64 {
        let align = scene.align.unwrap_or(Align::NONE);
        match self {
            Self::Key(_) => 0.0,
            Self::Contact => align.contact_depth.get(),
            Self::Clock => align.time_offset.get(),
            Self::Zero { .. } => align.zero_n,
            Self::Drift => align.drift_n_per_s,
        }
    }

    /// Its start, bounds and scale.
    pub(crate) fn unknown(&self, scene: &Scene, wanted: &[Wanted]) -> Result<least_squares::Unknown, CalibrateError> {
        let bounds = wanted.iter().find(|w| w.key == self.name()).and_then(|w| w.bounds);
        // the recording is already corrected by the scene's value
        let bounds = bounds.map(|bounds| bounds.map(|bound| bound - self.aligned(scene)));
        let free = |(scale, largest_step): (f64, f64)| {
            let bounds = bounds.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
            least_squares::Unknown { start: 0.0_f64.clamp(bounds[0], bounds[1]), bounds, scale, largest_step }
        };
        if let (Some([low, high]), true) = (bounds, ALIGN.contains(&self.name()))
            && low >= high
        {
            let [low, high] = [low, high].map(|bound| bound + self.aligned(scene));
            let reason = format!("the bounds {low} to {high} hold nothing between them");
            return Err(CalibrateError::Key { key: self.name().to_owned(), reason });
        }
        match self {
            Self::Key(key) => of_key(scene, key, bounds),
            Self::Contact => Ok(free(CONTACT)),
            Self::Clock => Ok(free(CLOCK)),
            Self::Zero { .. } | Self::Drift => Ok(free((1e-6, f64::INFINITY))),
        }
    }
}

/// A factor on all constants of the law in Pa, whatever they are called; 1 as the scene has them. It is no key of a scene.
pub(crate) const SCALE_KEY: &str = "material.scale";
/// Its bounds.
const SCALES: [f64; 2] = [1e-6, 1e6];

/// Bounds and start of a scene's key.
fn of_key(scene: &Scene, name: &str, bounds: Option<[f64; 2]>) -> Result<least_squares::Unknown, CalibrateError> {
    let refuse = |reason: String| CalibrateError::Key { key: name.to_owned(), reason };
    if name == SCALE_KEY {
        let bounds = bounds.unwrap_or(SCALES);
        if !(0.0 < bounds[0] && bounds[0] < bounds[1]) {
            return Err(refuse(format!("the bounds {} to {} have to be above 0, and to rise", bounds[0], bounds[1])));
        }
        let start = 1.0_f64.clamp(bounds[0], bounds[1]);
        return Ok(least_squares::Unknown { start, bounds, scale: 0.01, largest_step: LARGEST_STEP });
    }
    let key = keys::require(name, "to be found", "--fit")?;
    let value = scene.get(name);
    // a list with one element is a number: the constants of a law with a single term
    let list = value.as_ref().and_then(|v| v.as_list()).filter(|list| list.len() == 1);
    let (range, start) = match key.kind {
        Kind::Real(range) => (range, value.and_then(|v| v.as_real())),
        Kind::List(range, _) if keys::element(name).is_some() => (range, value.and_then(|v| v.as_real())),
        Kind::List(range, _) if list.is_some() => (range, list.map(|list| list[0])),
        _ => {
            return Err(refuse(format!(
                "only a single number can be searched for ({name}[0] is the first of a list); this is: {}",
                key.allowed()
            )));
        }
    };
    let start = start.ok_or_else(|| refuse(format!("scene {} has no such key", scene.name)))?;
    let off = OFF_THE_END * start.abs().max(f64::MIN_POSITIVE);
    let own = [
        if range.low_allowed { range.low } else { range.low + off.min(0.5 * (start - range.low)) },
        if range.high_allowed { range.high } else { range.high - off.min(0.5 * (range.high - start)) },
    ];
    let own = match keys::element(name) {
        // what relaxes can't be more than all, whatever the other shares become
        Some((list, _)) if list.ends_with(".prony_shares") => {
            let shares = scene.get(list).and_then(|v| v.as_list()).unwrap_or_default();
            [own[0], start + (1.0 - OFF_THE_END) * (1.0 - shares.iter().sum::<f64>()) / shares.len() as f64]
        }
        _ => own,
    };
    let own = if name.ends_with(".poisson_ratio") { [own[0], own[1].min(LARGEST_POISSON_RATIO)] } else { own };
    let bounds = bounds.unwrap_or(own);
    for bound in bounds {
        if !range.contains(bound) {
            return Err(refuse(format!("the bound {bound} is out of range; allowed: {}", key.allowed())));
        }
    }
    if bounds[0] >= bounds[1] {
        return Err(refuse(format!("the bounds {} to {} hold nothing between them", bounds[0], bounds[1])));
    }
    let scale = match () {
        () if start != 0.0 => 0.01 * start.abs(),
        // the bounds of a pressure give no scale
        () if name.starts_with("material.") && key.unit == "Pa" => 0.01 * scene.material.shear_modulus(),
        () => SIZE_AT_ZERO * (bounds[1] - bounds[0]),
    };
    Ok(least_squares::Unknown { start: start.clamp(bounds[0], bounds[1]), bounds, scale, largest_step: LARGEST_STEP })
}
