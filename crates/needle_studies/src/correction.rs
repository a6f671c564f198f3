//! Learns the [correction](needle_core::twin::Similarity) of a coarse cloud: along the scene's path, at rest at each of some depths, force and targets of
//! that cloud and of a finer one. What is left is measured in a run that it was not learnt from: with another deformation coefficient
//! (a needle), or another Poisson's ratio, at depths between.

use super::accuracy::{COMPARED_FROM, Case, Driven, Row, Steps, StudyError, drive};
use super::reference_solution::{self, ReferenceSolution};
use super::tune::with_pace;
use needle_core::scene::{Correction, Override, Scene};
use needle_core::twin::Similarity;
use needle_estimate::compare::Cancel;

/// Depths, as far from each other as from the surface.
const DEPTHS: u32 = 20;
/// How far before them, of the way from one to the next, lie those where what is left is measured: the golden section, so that neither falls on nodes of
/// the path alone, which lie at equal distances.
const BEFORE: f64 = 0.382;
/// Ways from pose to pose beyond which such a depth is moved to a pose's.
const FAR: f64 = 20.0;
/// Share of the largest length, of the force or of any target's motion, below which a vector's direction says nothing; what is next deeper is then
/// taken.
const SMALL: f64 = 0.02;
/// What the run that it was not learnt from has: the share of the deformation coefficient, or what is taken from Poisson's ratio.
const OTHER_COEFFICIENT: f64 = 0.75;
const OTHER_RATIO: f64 = 0.01;

/// What was learnt.
#[derive(Clone, Debug, PartialEq)]
pub struct Learnt {
    /// The scene with its correction.
    pub scene: Scene,
    /// The finer cloud that it was learnt from, at rest at each depth.
    pub learnt_from: ReferenceSolution,
    /// Key and value of the run that it was not learnt from.
    pub held_out: (&'static str, f64),
    /// The finer cloud in that run, at rest at each depth.
    pub known: ReferenceSolution,
    /// Largest error of that run without the correction.
    pub before: f64,
    /// What is left of it.
    pub left: f64,
    /// What was nearer in that run without a correction, and has none: `force` or names of targets. A coarse cloud has nothing that could be
    /// stretched where a tip passes a target on its path.
    pub dropped: Vec<String>,
}

/// The row of a case; of one that is corrected after it was learnt how, to the reference solution's last depth. `None` if it was stopped.
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
    match learn(&problem, &case.scene(&problem)?, reference_solution.depth_m(), cancel) {
        Ok(None) => Ok(None),
        Ok(Some(learnt)) => case.row_of(&learnt.scene, reference_solution, cancel),
        Err(why @ (StudyError::Lost { .. } | StudyError::Untuned(_))) => {
            let ended = Some(format!("before it began: {why}"));
            Ok(Some(case.row(&problem, reference_solution, Driven { ended, ..Driven::default() })))
        }
        Err(error) => Err(error),
    }
}

/// The correction, down to a depth in m, of a scene's cloud `coarse` against a cloud 0.7 times as coarse (0.5 in a half plane) as the `problem`'s
/// own. `None` if it was stopped.
///
/// # Errors
/// [`StudyError`] if a cloud can't be built or is lost on the way, or is too far from the finer one to be corrected.
pub fn learn(problem: &Scene, coarse: &Scene, depth_m: f64, cancel: &Cancel) -> Result<Option<Learnt>, StudyError> {
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
        // a run that moves has a pose at each
        let way = motion.speed.get() / motion.pose_rate.get();
        between.iter_mut().filter(|depth| **depth > FAR * way).for_each(|depth| *depth = (*depth / way).round() * way);
    }
    let plain = Scene { correction: None, ..coarse.clone() };
    let finer = case.scene(problem)?;
    let run = |scene: &Scene| at_rest(scene, &depths, cancel);
    let (Some(known), Some(found)) = (run(&finer)?, run(&plain)?) else { return Ok(None) };
    let correction = Correction {
        learnt_from: format!("{} nodes, {} points", known.nodes, known.integration_points),
        ..correction(&plain, &depths, &found, &known)?
    }
    .sealed();
    let source = format!("a finer cloud of {} nodes at rest", known.nodes);
    let learnt_from = ReferenceSolution::driven(&finer, &depths, known, source)?;
    let mut scene = Scene { correction: Some(correction), ..plain.clone() };
    let held_out = held_out(problem);
    let run = |scene: &Scene| at_rest(&Learnt::other(held_out, scene)?, &between, cancel);
    let (Some(known), Some(before), Some(found)) = (run(&finer)?, run(&plain)?, run(&scene)?) else { return Ok(None) };
    let [before, found] = [&before, &found].map(|found| errors(&plain, &between, found, &known));
    let names: Vec<&str> =
        std::iter::once("force").chain(plain.targets.iter().map(|target| target.name.as_str())).collect();
    let mut dropped = Vec::new();
    scene.correction = scene.correction.take().map(|mut correction| {
        dropped = keep_what_helps(&mut correction, &names, &before, &found);
        correction.sealed()
    });
    let left = scene.correction.as_ref().map_or(0.0, |c| c.left);
    let before = before.into_iter().fold(0.0, f64::max);
    let source = format!("a finer cloud of {} nodes at rest with {} = {:.4}", known.nodes, held_out.0, held_out.1);
    let known = ReferenceSolution::driven(&finer, &between, known, source)?;
    Ok(Some(Learnt { before, left, dropped, scene, learnt_from, held_out, known }))
}

impl Learnt {
    /// A scene as in the run that the correction was not learnt from.
    ///
    /// # Errors
    /// [`StudyError::Scene`] if it does not take the key.
    pub fn other((key, value): (&str, f64), scene: &Scene) -> Result<Scene, StudyError> {
        Ok(scene.with(&[Override::typed(key, value, "tune")])?)
    }

    /// How near force and targets are on the way at the scene's own pace, in the run that the correction was not learnt from. `None` if it was
    /// stopped.
    ///
    /// # Errors
    /// As [`Case::run`].
    pub fn on_the_way(&self, cancel: &Cancel) -> Result<Option<Row>, StudyError> {
        let other = Self::other(self.held_out, &self.scene)?;
        Case::of(&other)?.row_of(&other, &self.known, cancel)
    }
}

/// The key that is changed for the run that a correction is not learnt from, and its value there.
fn held_out(scene: &Scene) -> (&'static str, f64) {
    const COEFFICIENT: &str = "instrument.deformation_coefficient";
    const RATIO: &str = "material.poisson_ratio";
    let number = |key: &str| scene.get(key).and_then(|value| value.as_real());
    match (number(COEFFICIENT).filter(|c| *c > 0.0), number(RATIO)) {
        (Some(coefficient), _) => (COEFFICIENT, OTHER_COEFFICIENT * coefficient),
        (None, ratio) => (RATIO, ratio.unwrap_or_default() - OTHER_RATIO),
    }
}

/// Forces and targets of a scene at each depth, at rest; `None` if it was stopped.
fn at_rest(scene: &Scene, depths: &[f64], cancel: &Cancel) -> Result<Option<Driven>, StudyError> {
    let case = Case { steps: Steps::Rest, ..Case::of(scene)? };
    let keys = case.keys().into_iter().filter(|(path, _)| path.starts_with("stepping."));
    let keys: Vec<Override> = keys.map(|(path, value)| Override::text(path, &value, "tune")).collect();
    let driven = drive(&with_pace(scene, case.steps)?.with(&keys)?, &case, depths, cancel)?;
    match driven.ended {
        _ if driven.stopped => Ok(None),
        Some(why) => Err(StudyError::Lost { scene: scene.name.clone(), why }),
        None => Ok(Some(driven)),
    }
}

/// Displacements of target i, depth by depth, m.
fn displacements(scene: &Scene, driven: &Driven, i: usize) -> Vec<[f64; 3]> {
    let from = scene.targets[i].position;
    driven.at_depths.iter().map(|places| std::array::from_fn(|k| places[i][k] - from[k])).collect()
}

/// What takes one cloud's answers to another's.
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

/// Numbers of the similarities from one to the other vector, depth by depth; of vectors that are longer than `least`.
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

/// Takes away what makes an error larger than it was, of force and targets in turn, and notes what is left; the names of what is without.
fn keep_what_helps(correction: &mut Correction, names: &[&str], before: &[f64], found: &[f64]) -> Vec<String> {
    let each = correction.depths.len() * Correction::NUMBERS;
    let all = correction.force.chunks_mut(each).chain(correction.targets.chunks_mut(each));
    let mut dropped = Vec::new();
    for (((name, numbers), before), found) in names.iter().zip(all).zip(before).zip(found) {
        if found > before {
            numbers.chunks_mut(Correction::NUMBERS).for_each(|n| n.copy_from_slice(&Similarity::NONE.numbers()));
            dropped.push((*name).to_owned());
        }
    }
    correction.left = before.iter().zip(found).map(|(before, found)| before.min(*found)).fold(0.0, f64::max);
    dropped
}

/// Largest distance from what is known, over its greatest length so far (what a needle comes to hold may move back), from a fifth of the path on: of
/// the force, and of each target's motion.
fn errors(scene: &Scene, depths: &[f64], found: &Driven, known: &Driven) -> Vec<f64> {
    let deepest = depths.last().copied().unwrap_or_default();
    let error = |found: &[[f64; 3]], known: &[[f64; 3]]| {
        let mut most = 0.0_f64;
        let mut worst = 0.0_f64;
        for ((depth, found), known) in depths.iter().zip(found).zip(known) {
            most = most.max(length(*known));
            if *depth >= COMPARED_FROM * deepest {
                worst = worst.max(length(std::array::from_fn(|k| found[k] - known[k])) / most);
            }
        }
        worst
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
        let dropped = keep_what_helps(&mut correction, &names, &[0.03, 0.05, 0.04], &[0.01, 0.09, 0.02]);
        assert_eq!(dropped, ["on the path"]);
        assert_eq!(correction.force, learnt);
        assert_eq!(correction.targets[..8], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        assert_eq!(correction.targets[8..], learnt);
        assert!((correction.left - 0.05).abs() < 1e-12, "{}", correction.left);
    }
}
