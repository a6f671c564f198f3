//! Learns the [correction](needle_core::twin::Similarity) of a coarse cloud. Force and targets of that cloud and of a
//! finer one are compared in equilibrium at several depths along the scene's path.
//!
//! The remaining error is measured in a held-out run with another deformation coefficient (needle) or another
//! Poisson's ratio, at depths in between.

use super::accuracy::{COMPARED_FROM, Case, Driven, Row, Steps, StudyError, Watched, drive};
use super::progress::Progress;
use super::reference_solution::{self, ReferenceSolution};
use super::tune::with_pace;
use needle_core::scene::{Correction, Override, Scene};
use needle_core::twin::Similarity;
use needle_estimate::compare::Cancel;

/// Number of depths, equally spaced from the surface.
const DEPTHS: u32 = 20;
/// Offset of the depths of the held-out run, as a fraction of the spacing: the golden section. So neither set of
/// depths coincides with the equally spaced nodes of the path.
const BEFORE: f64 = 0.382;
/// Beyond this many distances between poses, such a depth is moved to that of a pose.
const FAR: f64 = 20.0;
/// Share of the largest length (of the force, or of any target's displacement) below which a vector has no reliable
/// direction. The value of the next larger depth is then used.
const SMALL: f64 = 0.02;
/// Change of the held-out run: factor on the deformation coefficient, or decrease of Poisson's ratio.
const OTHER_COEFFICIENT: f64 = 0.75;
const OTHER_RATIO: f64 = 0.01;
/// Number of runs that may follow, for the pace.
const PACED: usize = 10;

/// A correction that was learnt.
#[derive(Clone, Debug, PartialEq)]
pub struct Learnt {
    /// The scene with its correction.
    pub scene: Scene,
    /// The finer cloud from which it was learnt, in equilibrium at each depth.
    pub learnt_from: ReferenceSolution,
    /// Changed key and value of the held-out run.
    pub held_out: (&'static str, f64),
    /// The finer cloud in that run, in equilibrium at each depth.
    pub known: ReferenceSolution,
    /// Largest error of that run without the correction.
    pub before: f64,
    /// Remaining error with the correction.
    pub left: f64,
    /// Quantities that have no correction because it increased their error in the held-out run: `force` or names of
    /// targets. No scaling corrects a coarse cloud where a tip passes a target on its path.
    pub dropped: Vec<String>,
}

/// The row of a case. For a corrected case, the correction is learnt first, to the reference solution's last depth.
/// `None` if it was cancelled.
///
/// # Errors
/// As [`Case::run`]. A cloud that can't be corrected is a result, not an error.
pub fn row(
    case: &Case,
    scene: &Scene,
    reference_solution: &ReferenceSolution,
    cancel: &Cancel,
) -> Result<Option<Row>, StudyError> {
    if !case.corrected {
        return case.run(scene, reference_solution, cancel);
    }
    let problem = reference_solution.watched(scene);
    match learn(&problem, &case.scene(&problem)?, reference_solution.depth_m(), &Progress::of(cancel)) {
        Ok(None) => Ok(None),
        Ok(Some(learnt)) => case.row_of(&learnt.scene, reference_solution, Watched::whole(&Progress::of(cancel))),
        Err(why @ (StudyError::Lost { .. } | StudyError::Untuned(_))) => {
            let ended = Some(format!("before it began: {why}"));
            Ok(Some(case.row(&problem, reference_solution, Driven { ended, ..Driven::default() })))
        }
        Err(error) => Err(error),
    }
}

/// Learns the correction, down to a depth in m, of a scene's cloud `coarse`. The finer cloud has 0.7 times the
/// spacing of the `problem`'s own (0.5 times in a half plane). `None` if it was cancelled.
///
/// # Errors
/// [`StudyError`] if a cloud can't be built, its run ends early, or it is too far from the finer one to be corrected.
pub fn learn(problem: &Scene, coarse: &Scene, depth_m: f64, progress: &Progress) -> Result<Option<Learnt>, StudyError> {
    let dimension = coarse.dimension().dimension;
    let own = Case::of(problem)?.in_dimension(problem, dimension);
    let case = own.spaced(
        problem,
        if own.is_half_plane() { reference_solution::FINE } else { reference_solution::FINE_IN_SPACE },
    );
    let depths = |before: f64| -> Vec<f64> {
        (1..=DEPTHS).map(|k| depth_m * (f64::from(k) - before) / f64::from(DEPTHS)).collect()
    };
    let (depths, mut between) = (depths(0.0), depths(BEFORE));
    if let Some(motion) = coarse.motion {
        // a moving run has a pose at each of these depths
        let way = motion.speed.get() / motion.pose_rate.get();
        between.iter_mut().filter(|depth| **depth > FAR * way).for_each(|depth| *depth = (*depth / way).round() * way);
    }
    let plain = Scene { correction: None, ..coarse.clone() };
    let finer = case.scene(problem)?;
    let run = |scene: &Scene, what: &str, left| {
        progress.begin(format!("{what} at rest along the path"), left + PACED);
        at_rest(scene, &depths, progress)
    };
    let Some(known) = run(&finer, "the finer cloud", 4)? else { return Ok(None) };
    let Some(found) = run(&plain, "the coarse cloud", 3)? else { return Ok(None) };
    let correction = Correction {
        learnt_from: format!("{} nodes, {} points", known.nodes, known.integration_points),
        ..correction(&plain, &depths, &found, &known)?
    }
    .sealed();
    let source = format!("a finer cloud of {} nodes at rest", known.nodes);
    let learnt_from = ReferenceSolution::driven(&finer, &depths, known, source)?;
    let mut scene = Scene { correction: Some(correction), ..plain.clone() };
    let held_out = held_out(problem);
    let run = |scene: &Scene, what: &str, left| {
        progress.begin(format!("{what} at rest with {} = {:.4}", held_out.0, held_out.1), left + PACED);
        at_rest(&Learnt::other(held_out, scene)?, &between, progress)
    };
    let Some(known) = run(&finer, "the finer cloud", 2)? else { return Ok(None) };
    let Some(before) = run(&plain, "the coarse cloud", 1)? else { return Ok(None) };
    let Some(found) = run(&scene, "the corrected cloud", 0)? else { return Ok(None) };
    let [before, found] = [&before, &found].map(|found| errors(&plain, &between, found, &known));
    let names: Vec<&str> =
        std::iter::once("force").chain(plain.targets.iter().map(|target| target.name.as_str())).collect();
    let mut dropped = Vec::new();
    scene.correction = scene.correction.take().map(|mut correction| {
        dropped = keep_what_helps(&mut correction, &names, &before, &found);
        correction.sealed()
    });
    let left = scene.correction.as_ref().map_or(0.0, |c| c.left);
    let before = before.into_iter().map(|error| error.largest).fold(0.0, f64::max);
    let source = format!("a finer cloud of {} nodes at rest with {} = {:.4}", known.nodes, held_out.0, held_out.1);
    let known = ReferenceSolution::driven(&finer, &between, known, source)?;
    Ok(Some(Learnt { before, left, dropped, scene, learnt_from, held_out, known }))
}

impl Learnt {
    /// A scene with the change of the held-out run.
    ///
    /// # Errors
    /// [`StudyError::Scene`] if it does not accept the key.
    pub fn other((key, value): (&str, f64), scene: &Scene) -> Result<Scene, StudyError> {
        Ok(scene.with(&[Override::typed(key, value, "tune")])?)
    }

    /// Errors of force and targets in the held-out run, during the motion at the scene's own pace. `None` if it was
    /// cancelled.
    ///
    /// # Errors
    /// As [`Case::run`].
    pub fn on_the_way(&self, progress: &Progress) -> Result<Option<Row>, StudyError> {
        let other = Self::other(self.held_out, &self.scene)?;
        progress.begin("the corrected cloud on the way", 1);
        let row = Case::of(&other)?.row_of(&other, &self.known, Watched::whole(progress))?;
        row.iter().for_each(|row| progress.measured(row));
        Ok(row)
    }
}

/// The key that is changed for the held-out run, and its value there.
fn held_out(scene: &Scene) -> (&'static str, f64) {
    const COEFFICIENT: &str = "instrument.deformation_coefficient";
    const RATIO: &str = "material.poisson_ratio";
    let number = |key: &str| scene.get(key).and_then(|value| value.as_real());
    match (number(COEFFICIENT).filter(|c| *c > 0.0), number(RATIO)) {
        (Some(coefficient), _) => (COEFFICIENT, OTHER_COEFFICIENT * coefficient),
        (None, ratio) => (RATIO, ratio.unwrap_or_default() - OTHER_RATIO),
    }
}

/// Forces and targets of a scene in equilibrium at each depth; `None` if it was cancelled.
fn at_rest(scene: &Scene, depths: &[f64], progress: &Progress) -> Result<Option<Driven>, StudyError> {
    let case = Case { steps: Steps::Rest, ..Case::of(scene)? };
    let keys = case.keys().into_iter().filter(|(path, _)| path.starts_with("stepping."));
    let keys: Vec<Override> = keys.map(|(path, value)| Override::text(path, &value, "tune")).collect();
    let driven = drive(&with_pace(scene, case.steps)?.with(&keys)?, &case, depths, Watched::whole(progress))?;
    match driven.ended {
        _ if driven.stopped => Ok(None),
        Some(why) => Err(StudyError::Lost { scene: scene.name.clone(), why }),
        None => Ok(Some(driven)),
    }
}

/// Displacements of target i at each depth, m.
fn displacements(scene: &Scene, driven: &Driven, i: usize) -> Vec<[f64; 3]> {
    let from = scene.targets[i].position;
    driven.at_depths.iter().map(|places| std::array::from_fn(|k| places[i][k] - from[k])).collect()
}

/// The transformation from one cloud's answers to another's.
fn correction(scene: &Scene, depths: &[f64], found: &Driven, known: &Driven) -> Result<Correction, StudyError> {
    let most = |vectors: &[[f64; 3]]| vectors.iter().map(|v| length(*v)).fold(0.0, f64::max);
    let force = similarities(depths, "force", &found.vectors, &known.vectors, SMALL * most(&found.vectors))?;
    let all = (0..scene.targets.len()).map(|i| most(&displacements(scene, found, i))).fold(0.0, f64::max);
    let mut targets = Vec::new();
    for (i, target) in scene.targets.iter().enumerate() {
        let [found, known] = [found, known].map(|driven| displacements(scene, driven, i));
        targets.extend(similarities(depths, &target.name, &found, &known, SMALL * all)?);
    }
    Ok(Correction {
        apply: true,
        learnt_from: String::new(),
        left: 0.0,
        of: scene.correction_digest(),
        mesh: scene.sample.mesh_digest(),
        depths: depths.to_vec(),
        force,
        targets,
        checksum: String::new(),
    })
}

/// Parameters of the similarities that map one vector to the other, for each depth; only vectors longer than `least`
/// are used.
fn similarities(
    depths: &[f64],
    what: &str,
    from: &[[f64; 3]],
    to: &[[f64; 3]],
    least: f64,
) -> Result<Vec<f64>, StudyError> {
    let mut numbers = vec![Similarity::NONE.numbers(); depths.len()];
    let mut deeper = None;
    for (i, depth) in depths.iter().enumerate().rev() {
        let own = Similarity::between(from[i], to[i]).filter(|_| length(from[i]) > least);
        let Some(similarity) = own.or(deeper) else { continue };
        if !Correction::SCALES.contains(&similarity.scale) || length(similarity.turn) > Correction::LARGEST_TURN {
            return Err(StudyError::Untuned(format!(
                "at {depth:.6} m the cloud's {what} is {:.2} of the finer cloud's and {:.2} rad beside it: too far off to be corrected; ask for a \
                 smaller --tolerance",
                1.0 / similarity.scale,
                length(similarity.turn)
            )));
        }
        numbers[i] = similarity.numbers();
        deeper = Some(similarity);
    }
    Ok(numbers.concat())
}

/// Distance from the finer cloud, over the largest length so far, at the compared depths.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Distance {
    largest: f64,
    /// Root mean square.
    mean: f64,
}

/// Removes the parts of the correction, of force and targets in turn, that increase the mean error, and stores the
/// remaining one. Where a tip passes a target, the largest error is that of one depth, which says little of the others. Returns the names
/// of the removed parts.
fn keep_what_helps(
    correction: &mut Correction,
    names: &[&str],
    before: &[Distance],
    found: &[Distance],
) -> Vec<String> {
    let each = correction.depths.len() * Correction::NUMBERS;
    let all = correction.force.chunks_mut(each).chain(correction.targets.chunks_mut(each));
    let (mut dropped, mut left) = (Vec::new(), 0.0_f64);
    for (((name, numbers), before), found) in names.iter().zip(all).zip(before).zip(found) {
        let helps = found.mean <= before.mean;
        left = left.max(if helps { found.largest } else { before.largest });
        if !helps {
            numbers.chunks_mut(Correction::NUMBERS).for_each(|n| n.copy_from_slice(&Similarity::NONE.numbers()));
            dropped.push((*name).to_owned());
        }
    }
    correction.left = left;
    dropped
}

/// Distances from the finer cloud, over the largest length so far (captured nodes may move back), from a fifth
/// of the path on: of the force, and of each target's displacement.
fn errors(scene: &Scene, depths: &[f64], found: &Driven, known: &Driven) -> Vec<Distance> {
    let deepest = depths.last().copied().unwrap_or_default();
    let error = |found: &[[f64; 3]], known: &[[f64; 3]]| {
        let mut most = 0.0_f64;
        let (mut worst, mut squares, mut count) = (0.0_f64, 0.0, 0.0_f64);
        for ((depth, found), known) in depths.iter().zip(found).zip(known) {
            most = most.max(length(*known));
            if *depth >= COMPARED_FROM * deepest {
                let apart = length(std::array::from_fn(|k| found[k] - known[k])) / most;
                worst = worst.max(apart);
                (squares, count) = (squares + apart * apart, count + 1.0);
            }
        }
        Distance { largest: worst, mean: (squares / count.max(1.0)).sqrt() }
    };
    let of_target = |i| error(&displacements(scene, found, i), &displacements(scene, known, i));
    std::iter::once(error(&found.vectors, &known.vectors)).chain((0..scene.targets.len()).map(of_target)).collect()
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_correction_makes_worse_goes_without() {
        let learnt = [0.9, 0.0, 0.01, 0.0, 1.1, 0.0, 0.02, 0.0];
        let mut correction = Correction {
            apply: true,
            learnt_from: String::new(),
            left: 0.0,
            of: String::new(),
            mesh: String::new(),
            depths: vec![1e-3, 2e-3],
            force: learnt.to_vec(),
            targets: [learnt, learnt].concat(),
            checksum: String::new(),
        };
        let names = ["force", "on the path", "beside it"];
        let of = |errors: [[f64; 2]; 3]| errors.map(|[largest, mean]| Distance { largest, mean });
        let [before, found] =
            [[[0.03, 0.02], [0.05, 0.02], [0.04, 0.03]], [[0.01, 0.01], [0.09, 0.03], [0.041, 0.01]]].map(of);
        let dropped = keep_what_helps(&mut correction, &names, &before, &found);
        assert_eq!(dropped, ["on the path"]);
        assert_eq!(correction.force, learnt);
        assert_eq!(correction.targets[..8], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        assert_eq!(correction.targets[8..], learnt);
        assert!((correction.left - 0.05).abs() < 1e-12, "{}", correction.left);
    }
}
