//! Where a needle has to enter so that its tip meets a target which moves with the tissue.
//!
//! The straight line to the target at rest is a first guess. The twin runs the insertion, and says where the tip ends and where the target is by then.
//! Their difference moves the entry point and the depth, until the tip is there:
//!
//! ```text
//! entry  <- entry + (q - t) - slope (q_z - t_z)       q: target, t: tip, both at the end of the insertion
//! depth  <- depth + (t_z - q_z) / cos(tilt)
//! ```
//!
//! A shallow path moves its own target little, so two or three runs do. Uncertain keys of the scene say how often such a plan misses.

use rayon::prelude::*;

use crate::compare::Cancel;
use crate::compare::ensemble::{EnsembleError, Size, members};
use needle_core::scene::{Override, Scene, SceneError};
use needle_core::twin::{BuildError, Halt, Pose, StampedPose, Twin};

/// Most runs for one direction.
const MOST_TRIES: u32 = 8;
/// Points of the needle that are looked at beside what is to be avoided.
const LOOKED_AT: usize = 200;

/// What is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// Name of the target.
    pub target: String,
    /// Regions that the needle must not touch.
    pub avoid: Vec<String>,
    /// Least distance from those, m.
    pub clearance_m: f64,
    /// Distance from the target within which it is met, m.
    pub radius_m: f64,
    /// Distance at which the search ends, m.
    pub tolerance_m: f64,
    /// Members of the ensemble; 0: none.
    pub members: usize,
}

/// Directions that are tried, each angle in rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    /// Angle between path and vertical.
    pub tilt: f64,
    /// Direction in which the path leans.
    pub azimuth: f64,
    /// Rotation of the shaft; `None`: the needle has no bevel.
    pub roll: Option<f64>,
}

impl Direction {
    /// Every combination of tilts, azimuths and rolls in rad; where none of a kind is given, the scene's own. Only a bevel has a roll.
    #[must_use]
    pub fn all(scene: &Scene, [tilts, azimuths, rolls]: [&[f64]; 3]) -> Vec<Self> {
        let needle = scene.instrument.as_ref().and_then(|i| i.needle());
        let or = |given: &[f64], own: f64| if given.is_empty() { vec![own] } else { given.to_vec() };
        let tilts = or(tilts, needle.map_or(0.0, |n| n.tilt.get()));
        let azimuths = or(azimuths, needle.map_or(0.0, |n| n.azimuth.get()));
        let rolls: Vec<Option<f64>> = match needle.and_then(|n| n.bevel) {
            Some(bevel) => or(rolls, bevel.roll.get()).into_iter().map(Some).collect(),
            None => vec![None],
        };
        let mut all = Vec::new();
        for tilt in &tilts {
            for azimuth in &azimuths {
                all.extend(rolls.iter().map(|roll| Self { tilt: *tilt, azimuth: *azimuth, roll: *roll }));
            }
        }
        all
    }
}

/// How an insertion ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct End {
    /// Where the needle enters, m.
    pub entry_m: [f64; 2],
    /// Depth along the path, m.
    pub depth_m: f64,
    /// Place of the tip, m.
    pub tip_m: [f64; 3],
    /// Place of the target, m.
    pub target_m: [f64; 3],
    /// Distance between the two, m.
    pub miss_m: f64,
    /// Distance of the needle from what is to be avoided, m; infinite where nothing is.
    pub clearance_m: f64,
    /// Largest force along the needle, N.
    pub peak_n: f64,
}

/// How the members of an ensemble end.
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    /// Distance of each member's tip from its target, m, sorted.
    pub miss_m: Vec<f64>,
    /// Members that had no answer: counted as misses.
    pub lost: usize,
    /// Share of the members farther away than the radius.
    pub probability: f64,
}

/// A plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The scene with entry, direction and depth of the plan.
    pub scene: Scene,
    /// Direction of the path.
    pub direction: Direction,
    /// How a straight aim at the target at rest ends.
    pub straight: End,
    /// How the plan ends.
    pub end: End,
    /// Runs that it took.
    pub tries: u32,
    /// How uncertain that is.
    pub spread: Option<Spread>,
}

/// Why there is no plan.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// The scene has no needle.
    #[error("the instrument is no needle (instrument.kind)")]
    NoNeedle,
    /// The scene has no motion, which says how fast the needle goes.
    #[error("the scene has no [motion], which says how fast the needle goes")]
    NoMotion,
    /// No such target.
    #[error("no target is called \"{name}\"; there are: {known}")]
    NoTarget {
        /// What was asked for.
        name: String,
        /// Those that there are.
        known: String,
    },
    /// No such region.
    #[error("no region is called \"{name}\"; there are: {known}")]
    NoRegion {
        /// What was asked for.
        name: String,
        /// Those that there are.
        known: String,
    },
    /// A sample without a known height.
    #[error(
        "the sample's height is not known before its mesh is read: a plan needs a cylinder or a box (sample.shape)"
    )]
    NoHeight,
    /// A scene of the plan can't be made.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The twin can't be built.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// The ensemble can't be made.
    #[error(transparent)]
    Ensemble(#[from] EnsembleError),
    /// An insertion has no answer.
    #[error("the insertion at ({:.6}, {:.6}) m ends at {depth_m:.6} m: {halt}", entry_m[0], entry_m[1])]
    Halt {
        /// Entry point, m.
        entry_m: [f64; 2],
        /// Depth, m.
        depth_m: f64,
        /// Why.
        halt: Halt,
    },
    /// No direction leaves enough room.
    #[error(
        "every direction that was tried comes nearer than {wanted_m} m to what is to be avoided; the best leaves {best_m:.6} m"
    )]
    NoRoom {
        /// Least distance asked for, m.
        wanted_m: f64,
        /// Largest that there is, m.
        best_m: f64,
    },
    /// The end was asked for.
    #[error("interrupted")]
    Interrupted,
}

/// The best plan of some directions: of those that leave enough room, the one that misses least often, and of equals the shortest.
///
/// # Errors
/// [`PlanError`]. A direction whose scene can't be made or run is left out while another one can.
pub fn plan(
    scene: &Scene,
    wanted: &Wanted,
    directions: &[Direction],
    cancel: &Cancel,
    mut said: impl FnMut(&Direction, u32, &End),
) -> Result<Plan, PlanError> {
    let (mut best, mut nearest, mut failed) = (None::<Plan>, f64::NEG_INFINITY, None);
    for direction in directions {
        let found = match aim(scene, wanted, direction, cancel, &mut |tries, end| said(direction, tries, end)) {
            Ok(found) => found,
            Err(PlanError::Interrupted) => return Err(PlanError::Interrupted),
            Err(error) => {
                failed.get_or_insert(error);
                continue;
            }
        };
        nearest = nearest.max(found.end.clearance_m);
        if found.end.clearance_m < wanted.clearance_m {
            continue;
        }
        let worth = |plan: &Plan| {
            let missed = plan.spread.as_ref().map_or(0.0, |spread| spread.probability);
            (missed, plan.end.depth_m)
        };
        if best.as_ref().is_none_or(|known| worth(&found) < worth(known)) {
            best = Some(found);
        }
    }
    match (best, failed) {
        (Some(plan), _) => Ok(plan),
        (None, Some(error)) if nearest == f64::NEG_INFINITY => Err(error),
        (None, _) => Err(PlanError::NoRoom { wanted_m: wanted.clearance_m, best_m: nearest }),
    }
}

/// The scene of a path.
fn at(scene: &Scene, direction: &Direction, entry: [f64; 2], depth: f64) -> Result<Scene, SceneError> {
    let set = |key: &str, value: f64| Override::typed(key, value, "plan");
    let mut changes = vec![
        set("instrument.entry_x_m", entry[0]),
        set("instrument.entry_y_m", entry[1]),
        set("instrument.tilt_rad", direction.tilt),
        set("instrument.azimuth_rad", direction.azimuth),
        set("motion.depth_m", depth),
        Override::typed("motion.retract", needle_core::scene::Value::Boolean(false), "plan"),
        Override::typed("motion.insertions", needle_core::scene::Value::Integer(1), "plan"),
    ];
    changes.extend(direction.roll.map(|roll| set("instrument.roll_rad", roll)));
    scene.with(&changes)
}

/// A plan in one direction.
fn aim(
    scene: &Scene,
    wanted: &Wanted,
    direction: &Direction,
    cancel: &Cancel,
    said: &mut dyn FnMut(u32, &End),
) -> Result<Plan, PlanError> {
    let target = target_of(scene, &wanted.target)?;
    let top = scene.sample.shape.height().ok_or(PlanError::NoHeight)?.get();
    let rest = scene.targets[target].position;
    let slope = [direction.azimuth.cos(), direction.azimuth.sin()].map(|c| direction.tilt.tan() * c);
    let secant = 1.0 / direction.tilt.cos();
    let mut entry: [f64; 2] = std::array::from_fn(|k| rest[k] - slope[k] * (top - rest[2]));
    let mut depth = secant * (top - rest[2]);
    let mut straight = None::<End>;
    let mut best = None::<(Scene, End)>;
    let mut tries = 0;
    while tries < MOST_TRIES {
        let planned = at(scene, direction, entry, depth)?;
        let end = insert(&Twin::new(&planned)?, wanted, target, cancel)?;
        tries += 1;
        said(tries, &end);
        straight.get_or_insert(end);
        if best.as_ref().is_none_or(|(_, known)| end.miss_m < known.miss_m) {
            best = Some((planned, end));
        }
        if end.miss_m <= wanted.tolerance_m {
            break;
        }
        let off: [f64; 3] = std::array::from_fn(|k| end.target_m[k] - end.tip_m[k]);
        (0..2).for_each(|k| entry[k] += off[k] + slope[k] * off[2]);
        depth -= secant * off[2];
    }
    let (Some(straight), Some((planned, end))) = (straight, best) else { return Err(PlanError::Interrupted) };
    let spread = (wanted.members > 0).then(|| spread(&planned, wanted, target, cancel)).transpose()?;
    Ok(Plan { scene: planned, direction: *direction, straight, end, tries, spread })
}

fn target_of(scene: &Scene, name: &str) -> Result<usize, PlanError> {
    let known = || scene.targets.iter().map(|t| t.name.as_str()).collect::<Vec<_>>().join(", ");
    let found = scene.targets.iter().position(|t| t.name == name);
    found.ok_or_else(|| PlanError::NoTarget { name: name.to_owned(), known: known() })
}

/// Checks what a plan asks of a scene.
///
/// # Errors
/// [`PlanError`].
pub fn check(scene: &Scene, wanted: &Wanted) -> Result<(), PlanError> {
    scene.instrument.as_ref().and_then(|i| i.needle()).ok_or(PlanError::NoNeedle)?;
    scene.motion.ok_or(PlanError::NoMotion)?;
    scene.sample.shape.height().ok_or(PlanError::NoHeight)?;
    target_of(scene, &wanted.target)?;
    let known = || scene.regions.iter().map(|r| r.name.as_str()).collect::<Vec<_>>().join(", ");
    match wanted.avoid.iter().find(|name| scene.regions.iter().all(|r| r.name != **name)) {
        Some(name) => Err(PlanError::NoRegion { name: name.clone(), known: known() }),
        None => Ok(()),
    }
}

/// Runs the scene's own insertion.
fn insert(built: &Twin, wanted: &Wanted, target: usize, cancel: &Cancel) -> Result<End, PlanError> {
    let mut twin = built.double();
    twin.stop_on(cancel.flag());
    let instrument = built.scene().instrument;
    let entry_m = instrument.map_or([0.0; 2], |i| i.entry.map(|e| e.get()));
    let motion = built.scene().motion.ok_or(PlanError::NoMotion)?;
    let mut peak_n = 0.0_f64;
    for (time_s, depth_m) in motion.poses() {
        if cancel.is_cancelled() {
            return Err(PlanError::Interrupted);
        }
        let pose = twin.pose_at_depth(depth_m);
        match twin.step(StampedPose { time_s, pose }) {
            Ok(answer) => {
                let along = (0..3).map(|k| answer.force_n[k] * pose.axis[k]).sum::<f64>();
                peak_n = peak_n.max(0.0 - along);
            }
            Err(Halt::Interrupted) => return Err(PlanError::Interrupted),
            Err(halt) => return Err(PlanError::Halt { entry_m, depth_m, halt }),
        }
    }
    let depth_m = motion.depth.get();
    let straight = twin.pose_at_depth(depth_m);
    let tip_m = twin.bent_tip().unwrap_or(straight).tip;
    let mut targets = Vec::new();
    twin.target_positions(&mut targets);
    let target_m = targets[target];
    let miss_m = distance(tip_m, target_m);
    let clearance_m = clearance(&twin, wanted, &straight);
    Ok(End { entry_m, depth_m, tip_m, target_m, miss_m, clearance_m, peak_n })
}

/// Least distance of the needle's surface from the cells of the regions that are to be avoided, as they are now, m.
fn clearance(twin: &Twin, wanted: &Wanted, straight: &Pose) -> f64 {
    let scene = twin.scene();
    let avoided: Vec<u8> = (1_u8..)
        .zip(&scene.regions)
        .filter(|(_, region)| wanted.avoid.contains(&region.name))
        .map(|(number, _)| number)
        .collect();
    if avoided.is_empty() || twin.cell_regions().is_empty() {
        return f64::INFINITY;
    }
    let mut shape = Vec::new();
    twin.needle_shape(&mut shape);
    let mut needle: Vec<[f64; 3]> = shape.iter().map(|pose| pose.tip).collect();
    if needle.is_empty() {
        let depth = twin.depth_of(straight);
        let along = |i: usize| depth * i as f64 / LOOKED_AT as f64;
        needle =
            (0..=LOOKED_AT).map(|i| std::array::from_fn(|k| straight.tip[k] - along(i) * straight.axis[k])).collect();
    }
    let mut moved = Vec::new();
    twin.displacements(&mut moved);
    let points = twin.reference_points();
    let place = |n: u32| -> [f64; 3] { std::array::from_fn(|k| points[n as usize][k] + moved[n as usize][k]) };
    let radius = 0.5 * scene.instrument.and_then(|i| i.needle_diameter_m()).unwrap_or(0.0);
    let cells = twin.cells().iter().zip(twin.cell_regions()).filter(|(_, region)| avoided.contains(region));
    let corners = cells.flat_map(|(corners, _)| corners.iter().map(|n| place(*n)));
    let nearest = |p: [f64; 3]| needle.windows(2).map(|w| from_segment(p, w[0], w[1])).fold(f64::INFINITY, f64::min);
    (corners.map(nearest).fold(f64::INFINITY, f64::min) - radius).max(0.0)
}

/// The insertions of an ensemble's members.
fn spread(planned: &Scene, wanted: &Wanted, target: usize, cancel: &Cancel) -> Result<Spread, PlanError> {
    let members = members(planned, Size { members: wanted.members, seed: 1 })?;
    let alone = |scene: &Scene| insert(&Twin::new(scene)?, wanted, target, cancel);
    let run = |scene: &Scene| -> Result<Option<f64>, PlanError> {
        // each member has a thread of its own
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        match pool.map_or_else(|_| alone(scene), |pool| pool.install(|| alone(scene))) {
            Ok(end) => Ok(Some(end.miss_m)),
            Err(PlanError::Interrupted) => Err(PlanError::Interrupted),
            Err(_) => Ok(None),
        }
    };
    let ends: Result<Vec<Option<f64>>, PlanError> = members.par_iter().map(|member| run(&member.scene)).collect();
    let ends = ends?;
    let mut miss_m: Vec<f64> = ends.iter().flatten().copied().collect();
    miss_m.sort_unstable_by(f64::total_cmp);
    let lost = ends.len() - miss_m.len();
    let missed = lost + miss_m.iter().filter(|miss| **miss > wanted.radius_m).count();
    Ok(Spread { probability: missed as f64 / ends.len().max(1) as f64, miss_m, lost })
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

/// Distance of a point from the segment between two others.
fn from_segment(p: [f64; 3], a: [f64; 3], b: [f64; 3]) -> f64 {
    let along: [f64; 3] = std::array::from_fn(|k| b[k] - a[k]);
    let square = along.iter().map(|x| x * x).sum::<f64>();
    let share = if square > 0.0 { (0..3).map(|k| (p[k] - a[k]) * along[k]).sum::<f64>() / square } else { 0.0 };
    let share = share.clamp(0.0, 1.0);
    distance(p, std::array::from_fn(|k| a[k] + share * along[k]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_from_a_segment_is_that_of_its_nearest_point() {
        let (a, b) = ([0.0; 3], [2.0, 0.0, 0.0]);
        assert!((from_segment([1.0, 3.0, 0.0], a, b) - 3.0).abs() < 1e-15);
        assert!((from_segment([5.0, 4.0, 0.0], a, b) - 5.0).abs() < 1e-15);
        assert!((from_segment([-3.0, 0.0, 4.0], a, b) - 5.0).abs() < 1e-15);
    }
}
