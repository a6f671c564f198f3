//! Members of an ensemble: the scene with one draw of every uncertain key, and the alignment of the recording.

use super::EnsembleError;
use super::points::{DIMENSIONS, MOST, coordinate};
use needle_core::scene::{Base, Dependence, InstrumentKind, Override, Recorded, Scene};

/// Size of an ensemble, and the seed of its draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Number of members.
    pub members: usize,
    /// Seed.
    pub seed: u64,
}

/// Alignment of a recording with a member.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shift {
    /// Recorded depth at which the instrument touches the sample, m.
    pub contact_depth_m: f64,
    /// Delay of the force's stamps against the position's, s.
    pub time_offset_s: f64,
    /// Reading of the load cell without load, N.
    pub force_zero_n: f64,
}

/// One member.
#[derive(Clone, Debug, PartialEq)]
pub struct Member {
    /// Values of the uncertain keys, in the scene's order.
    pub values: Vec<f64>,
    /// The scene that is run, with these values. If `factor` accounts for the modulus, it has the ensemble's own
    /// modulus instead. The scene has no uncertain keys.
    pub scene: Scene,
    /// Force of the member over that of the scene that is run.
    pub factor: f64,
    /// Those of the values that describe the recording.
    pub shift: Shift,
}

impl Member {
    /// The scene with each uncertain key set to a quantile of its distribution; `shares` are the cumulative
    /// probabilities. `place` names the draw in messages.
    ///
    /// # Errors
    /// [`EnsembleError::Scene`] if a key can't have its value.
    pub fn new(scene: &Scene, shares: impl IntoIterator<Item = f64>, place: &str) -> Result<Self, EnsembleError> {
        let (mut values, mut changes, mut shift) = (Vec::new(), Vec::new(), Shift::default());
        let (proportional, mut factor) = (is_proportional(scene), 1.0);
        for (uncertain, share) in scene.uncertainty.iter().zip(shares) {
            let value = uncertain.draw(share, place)?;
            values.push(value);
            match Recorded::of(&uncertain.key) {
                Some(Recorded::ContactDepth) => shift.contact_depth_m = value,
                Some(Recorded::TimeOffset) => shift.time_offset_s = value,
                Some(Recorded::ForceZero) => shift.force_zero_n = value,
                None if proportional && uncertain.key == MODULUS => factor = value / scene.material.shear_modulus(),
                None => {
                    let tied =
                        scene.tied_to(&uncertain.key).filter(|key| scene.uncertainty.iter().all(|u| u.key != *key));
                    let keys = [Some(uncertain.key.as_str()), tied];
                    changes.extend(keys.into_iter().flatten().map(|key| Override::typed(key, value, place)));
                }
            }
        }
        let mut own = scene.with(&changes)?;
        own.uncertainty.clear();
        Ok(Self { values, scene: own, factor, shift })
    }
}

/// Whether the force is proportional to the shear modulus at a given Poisson's ratio. Then members that differ in it
/// alone need no runs of their own. This holds for one material, without friction or separating contact, if the
/// instrument's behaviour depends on strains alone. A separate run differs by less than a thousandth of the peak,
/// because round-off changes the number of steps of a pose (docs/uncertainty.md).
fn is_proportional(scene: &Scene) -> bool {
    let instrument = scene.instrument.is_none_or(|i| match i.kind {
        // what bends, or is pushed aside by a force, does not scale with the tissue
        InstrumentKind::Needle(needle) => !i.is_frictional() && needle.flexible.is_none() && needle.bevel.is_none(),
        InstrumentKind::Plate | InstrumentKind::Indenter { .. } => i.is_bonded(),
    });
    scene.regions.is_empty() && scene.sample.base == Base::Bonded && instrument
}

/// The members of a scene: member k uses the k-th point of the sequence, one coordinate for each key.
///
/// # Errors
/// [`EnsembleError`] if no key is uncertain, the number of members is out of range, or a draw is not a valid value of
/// its key.
pub fn members(scene: &Scene, size: Size) -> Result<Vec<Member>, EnsembleError> {
    check(scene, size.members, scene.uncertainty.len())?;
    // the correlations were checked with the scene
    let dependence = Dependence::of(&scene.uncertainty).ok();
    let of = |k: usize| {
        let independent = (0..scene.uncertainty.len()).map(|dimension| coordinate(k, dimension, size.seed)).collect();
        let shares = match &dependence {
            Some(dependence) => dependence.shares(independent),
            None => independent,
        };
        Member::new(scene, shares, &format!("member {k} of [uncertainty]"))
    };
    (0..size.members).map(of).collect()
}

/// Checks that a scene has uncertain keys, and that the sequence has that many points and dimensions.
///
/// # Errors
/// [`EnsembleError::NoUncertainty`], [`EnsembleError::Keys`] or [`EnsembleError::Count`].
pub fn check(scene: &Scene, points: usize, dimensions: usize) -> Result<(), EnsembleError> {
    if dimensions > DIMENSIONS {
        return Err(EnsembleError::Keys(scene.uncertainty.len()));
    }
    if scene.uncertainty.is_empty() {
        let (mean, ratio) = (scene.material.shear_modulus(), scene.material.poisson_ratio.get());
        let own = scene.get(MODULUS).is_some();
        let (key, mean, deviation) = if own { (MODULUS, mean, 0.1 * mean) } else { (RATIO, ratio, 0.001) };
        return Err(EnsembleError::NoUncertainty { scene: scene.name.clone(), key, mean, deviation });
    }
    if (2..=MOST).contains(&points) { Ok(()) } else { Err(EnsembleError::Count(points)) }
}

const MODULUS: &str = "material.shear_modulus_pa";
const RATIO: &str = "material.poisson_ratio";
