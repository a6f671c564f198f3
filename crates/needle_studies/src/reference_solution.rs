//! Reference solution for the predictions of a scene: independent finite elements if there are any, and otherwise the
//! scene's own model on a much finer cloud.

use super::accuracy::{COMPARED_FROM, Case, Driven, MOST_STEPS, Steps, StudyError, Watched};
use super::composites::{COMPOSITES, Composite, posed};
use super::progress::Progress;
use super::reference::{self, DISPLACEMENT_DEPTH_M};
use needle_core::scene::{Motion, Override, Preset, Scene, Target};

/// Ratio of the fine cloud's spacing to the scene's, in a half plane.
pub(super) const FINE: f64 = 0.5;
/// The same in three dimensions, where half the spacing costs ten times as much.
pub(super) const FINE_IN_SPACE: f64 = 0.7;
/// Least number of steps per pose on the fine cloud; a fast motion uses more.
const FINE_STEPS: u32 = 4;
/// Number of depths at which forces are compared if the scene's own model is the reference.
const DEPTHS: u32 = 20;
/// Depth of the needle in the accuracy study, m. In three dimensions, a run to the preset's full depth takes minutes.
const NEEDLE_DEPTH_M: f64 = 0.005;

/// A reference solution.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReferenceSolution {
    /// Source of the forces, in a few words.
    pub source: String,
    /// (depth in m, force in N) by rising depth.
    pub force: Vec<(f64, f64)>,
    /// The same forces as vectors, frame `sample`, N, if the path is oblique and the lateral force matters; otherwise
    /// empty.
    pub vectors: Vec<[f64; 3]>,
    /// Relative uncertainty of these forces, if it is known.
    pub uncertainty: Option<f64>,
    /// Points in the tissue that are compared at the last depth, and their reference positions there, m.
    pub displaced: Vec<(Target, [f64; 3])>,
    /// Positions of these points in equilibrium at each depth of `force`, m; empty if they are not known.
    pub places: Vec<Vec<[f64; 3]>>,
    /// Source of the displacements, in a few words.
    pub displacement_source: String,
}

impl ReferenceSolution {
    /// The reference solution of a scene to a depth, m. If the finite elements do not contain everything, the scene's
    /// own model is run.
    ///
    /// # Errors
    /// [`StudyError`] if the scene has no motion, or can't be built and driven.
    pub fn of(scene: &Scene, depth_m: f64) -> Result<Self, StudyError> {
        let own = || {
            // it is not cancelled, so there is one
            let own = Self::own(scene, depth_m, &Progress::default())?;
            own.ok_or_else(|| StudyError::NoYardstick(scene.name.clone()))
        };
        let Some(published) = Self::published(scene, depth_m) else { return own() };
        let mut reference_solution = if is_indentation_at_4mm(scene, depth_m) {
            published
        } else {
            Self { force: published.force, source: published.source, uncertainty: published.uncertainty, ..own()? }
        };
        if is_indentation_at_4mm(scene, depth_m)
            && let Some(height) = scene.sample.shape.height()
        {
            reference_solution.displaced =
                reference::targets(height.get()).into_iter().zip(reference::displaced(height.get())).collect();
            reference_solution.displacement_source = reference_solution.source.clone();
        }
        Ok(reference_solution)
    }

    /// The same for forces alone: where there are independent finite elements, the own model is not run. `None` if it
    /// was cancelled.
    ///
    /// # Errors
    /// As [`ReferenceSolution::of`].
    pub fn of_force(scene: &Scene, depth_m: f64, progress: &Progress) -> Result<Option<Self>, StudyError> {
        let published = Self::published(scene, depth_m);
        published.map_or_else(|| Self::own(scene, depth_m, progress), |published| Ok(Some(published)))
    }

    /// The forces of independent finite elements, if they contain the scene.
    fn published(scene: &Scene, depth_m: f64) -> Option<Self> {
        let preset = preset_of(scene)?;
        Some(Self {
            force: within(reference::force(preset)?, depth_m)?,
            source: "independent finite elements".to_owned(),
            uncertainty: reference::uncertainty(preset, depth_m),
            ..Self::default()
        })
    }

    /// The scene's own model: half of the spacing, double precision, at least four steps per pose.
    fn own(scene: &Scene, depth_m: f64, progress: &Progress) -> Result<Option<Self>, StudyError> {
        let own = Case::of(scene)?;
        let mut case = own.spaced(scene, if own.is_half_plane() { FINE } else { FINE_IN_SPACE });
        "f64".clone_into(&mut case.precision);
        case.steps = Steps::Auto;
        let steps = [("stepping.min_steps_per_pose", FINE_STEPS), ("stepping.max_steps_per_pose", MOST_STEPS)];
        let steps = steps.map(|(path, steps)| Override::typed(path, steps, "study"));
        let mut scene = case.scene(scene)?.with(&steps)?;
        if scene.targets.is_empty() {
            scene.targets = probes(&scene);
        }
        let depths: Vec<f64> = (1..=DEPTHS).map(|k| depth_m * f64::from(k) / f64::from(DEPTHS)).collect();
        progress.begin("reference run of the own model on a fine cloud", 0);
        let driven = super::accuracy::drive(&scene, &case, &depths, Watched::whole(progress))?;
        if driven.stopped {
            return Ok(None);
        }
        let source = format!("the own model, {} nodes, double precision", driven.nodes);
        Ok(Some(Self { places: Vec::new(), ..Self::driven(&scene, &depths, driven, source)? }))
    }

    /// The reference solution from a run of a scene to equilibrium at some depths (m).
    pub(super) fn driven(scene: &Scene, depths: &[f64], driven: Driven, source: String) -> Result<Self, StudyError> {
        let lost = || StudyError::NoYardstick(scene.name.clone());
        if let Some(why) = driven.ended {
            return Err(StudyError::Lost { scene: scene.name.clone(), why });
        }
        let force = depths.iter().map(|d| Some((*d, force_at(&driven.path, *d)?))).collect::<Option<Vec<_>>>();
        let leans = scene.instrument.is_some_and(|i| i.slope() != [0.0; 2]);
        let vector = |depth: &f64| vector_at(&driven.path, &driven.vectors, *depth);
        let vectors = leans.then(|| depths.iter().map(vector).collect::<Option<Vec<_>>>());
        Ok(Self {
            force: force.ok_or_else(lost)?,
            vectors: vectors.unwrap_or_else(|| Some(Vec::new())).ok_or_else(lost)?,
            uncertainty: None,
            displaced: scene.targets.iter().cloned().zip(driven.targets).collect(),
            places: driven.at_depths,
            displacement_source: source.clone(),
            source,
        })
    }

    /// A scene whose targets are the compared points.
    pub(super) fn watched(&self, scene: &Scene) -> Scene {
        Scene { targets: self.displaced.iter().map(|(target, _)| target.clone()).collect(), ..scene.clone() }
    }

    /// The last depth, m.
    #[must_use]
    pub fn depth_m(&self) -> f64 {
        self.force.last().map_or(0.0, |p| p.0)
    }

    /// Relative errors of a path of (depth in m, force) at the depths that it reaches: depth, and force over that of
    /// the reference solution - 1. For an oblique path it is the distance between the force vectors over the length
    /// of the reference's.
    #[must_use]
    pub fn force_errors(&self, path: &[(f64, f64)], vectors: &[[f64; 3]]) -> Vec<(f64, f64)> {
        let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let error = |(i, &(depth, force)): (usize, &(f64, f64))| match self.vectors.get(i) {
            None => Some((depth, force_at(path, depth)? / force - 1.0)),
            Some(all) => {
                let found = vector_at(path, vectors, depth)?;
                Some((depth, length(std::array::from_fn(|k| found[k] - all[k])) / length(*all)))
            }
        };
        self.force.iter().enumerate().filter_map(error).collect()
    }

    /// Largest distance between positions and reference positions, over the last depth; `None` if no point is
    /// compared.
    #[must_use]
    pub(crate) fn displacement_error(&self, places: &[[f64; 3]]) -> Option<f64> {
        let distance = |(now, (_, then)): (&[f64; 3], &(Target, [f64; 3]))| {
            (0..3).map(|k| (now[k] - then[k]).powi(2)).sum::<f64>().sqrt()
        };
        let comparable = !places.is_empty() && places.len() == self.displaced.len();
        comparable.then(|| places.iter().zip(&self.displaced).map(distance).fold(0.0, f64::max) / self.depth_m())
    }

    /// Largest distance of a point from its equilibrium position, at depths from a fifth of the last on, over its
    /// largest displacement; `None` if no point is compared.
    #[must_use]
    pub(crate) fn way_error(&self, at_depths: &[Vec<[f64; 3]>]) -> Option<f64> {
        let distance = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
        let from = COMPARED_FROM * self.depth_m() * (1.0 - 1e-9);
        let of_point = |(i, (target, _)): (usize, &(Target, [f64; 3]))| {
            let known = || self.places.iter().filter_map(|places| places.get(i));
            let most = known().map(|place| distance(place, &target.position)).fold(0.0, f64::max);
            let all = self.force.iter().zip(known()).zip(at_depths);
            let compared = all.filter(|((force, _), _)| force.0 >= from);
            let off = compared.filter_map(|((_, place), found)| Some(distance(place, found.get(i)?)));
            off.fold(0.0, f64::max) / most
        };
        let comparable = !self.places.is_empty() && self.places.len() == at_depths.len();
        let points = self.displaced.iter().enumerate().map(of_point);
        comparable.then(|| points.reduce(f64::max)).flatten().filter(|error| error.is_finite())
    }
}

/// Force at a depth during the insertion, interpolated between neighbouring answers (depth, force); `None` if the
/// depth was not reached.
pub(super) fn force_at(path: &[(f64, f64)], depth_m: f64) -> Option<f64> {
    let (before, next, share) = between(path, depth_m)?;
    let [a, b] = [path[before].1, path[next].1];
    Some(a + share * (b - a))
}

/// The same for the force vector.
fn vector_at(path: &[(f64, f64)], vectors: &[[f64; 3]], depth_m: f64) -> Option<[f64; 3]> {
    let (before, next, share) = between(path, depth_m)?;
    let [a, b] = [vectors.get(before)?, vectors.get(next)?];
    Some(std::array::from_fn(|k| a[k] + share * (b[k] - a[k])))
}

/// The answers on both sides of a depth, and its position between them.
fn between(path: &[(f64, f64)], depth_m: f64) -> Option<(usize, usize, f64)> {
    let next = path.iter().position(|(depth, _)| *depth >= depth_m * (1.0 - 1e-9))?;
    let before = next.saturating_sub(1);
    let (a, b) = (path[before].0, path[next].0);
    Some((before, next, if b > a { ((depth_m - a) / (b - a)).min(1.0) } else { 1.0 }))
}

/// The preset or composite with the same problem (sample, materials, instrument), whatever its discretisation.
#[must_use]
pub(crate) fn preset_of(scene: &Scene) -> Option<&'static str> {
    let same = |other: &Scene| {
        other.sample == scene.sample
            && other.material == scene.material
            && other.instrument == scene.instrument
            && other.materials == scene.materials
            && other.regions == scene.regions
    };
    let names = Preset::of_the_paper().iter().map(|p| p.name).chain(COMPOSITES.iter().map(|c| c.name));
    names.into_iter().find(|name| posed(name).is_ok_and(|other| same(&other)))
}

/// Depth of the accuracy study for a scene, m:
///
/// - the indentation: the depth at which displacements are known and the reference's force is accurate to 0.45 %;
/// - the needle: half of its path;
/// - samples of several materials: the last depth of their reference before that;
/// - any other scene: its full depth.
///
/// # Errors
/// [`StudyError::NoMotion`] if it has no motion.
pub fn study_depth(scene: &Scene) -> Result<f64, StudyError> {
    let Motion { depth, .. } = scene.motion.ok_or_else(|| StudyError::NoMotion(scene.name.clone()))?;
    let most = match preset_of(scene) {
        Some("indentation") => DISPLACEMENT_DEPTH_M,
        Some("needle_insertion") => NEEDLE_DEPTH_M,
        Some(composite) if Composite::find(composite).is_some() => {
            let depths = reference::force(composite).unwrap_or_default().into_iter().map(|p| p.0);
            depths.filter(|depth| *depth <= NEEDLE_DEPTH_M).fold(0.0, f64::max)
        }
        _ => f64::INFINITY,
    };
    Ok(depth.get().min(most))
}

fn is_indentation_at_4mm(scene: &Scene, depth_m: f64) -> bool {
    preset_of(scene) == Some("indentation") && (depth_m / DISPLACEMENT_DEPTH_M - 1.0).abs() < 1e-9
}

/// The part of a table up to a depth; `None` if the table ends before.
fn within(mut table: Vec<(f64, f64)>, depth_m: f64) -> Option<Vec<(f64, f64)>> {
    let reaches = table.last().is_some_and(|p| p.0 >= depth_m * (1.0 - 1e-9));
    table.retain(|(depth, _)| *depth <= depth_m * (1.0 + 1e-9));
    (reaches && !table.is_empty()).then_some(table)
}

/// Points to compare in a scene without targets: on the axis at half the depth, and next to it.
fn probes(scene: &Scene) -> Vec<Target> {
    let Some(height) = scene.sample.shape.height() else { return Vec::new() };
    let h = height.get();
    let places = [[0.0, 0.0, 0.5 * h], [0.4 * h, 0.0, 0.5 * h], [0.0, 0.4 * h, 0.75 * h]];
    let target = |(i, position)| Target { name: format!("probe{i}"), position };
    places.into_iter().enumerate().map(target).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_depth_that_was_not_reached_has_no_force() {
        let path: Vec<(f64, f64)> = (0..=500).map(|i| (1e-5 * f64::from(i), 2e-5 * f64::from(i))).collect();
        assert!((force_at(&path, 1.234e-3).unwrap() - 2.468e-3).abs() < 1e-12);
        assert_eq!(force_at(&path, 6e-3), None);
    }

    #[test]
    fn what_is_across_a_path_that_leans_is_an_error_of_its_force() {
        let path = [(0.0, 0.0), (0.001, 2.0), (0.002, 4.0)];
        let vectors = [[0.0; 3], [0.3, 0.0, 2.0], [0.6, 0.0, 4.0]];
        let all = ReferenceSolution {
            force: vec![(0.0015, 3.0)],
            vectors: vec![[0.0, 0.0, 3.0]],
            ..ReferenceSolution::default()
        };
        let errors = all.force_errors(&path, &vectors);
        assert!(errors.len() == 1 && errors[0].0 == 0.0015 && (errors[0].1 - 0.15).abs() < 1e-12, "{errors:?}");
        let along = ReferenceSolution { vectors: Vec::new(), ..all };
        assert!(along.force_errors(&path, &vectors)[0].1.abs() < 1e-12);
        // the same via `of` for a scene
        let leaning = |tilt: &str| {
            let mut scene = Scene::preset("needle_insertion").unwrap();
            for (key, value) in
                [("instrument.tilt_rad", tilt), ("discretisation.spacing_m", "0.005"), ("motion.pose_hz", "50")]
            {
                scene.set(key, value).unwrap();
            }
            ReferenceSolution::own(&scene, 0.001, &Progress::default()).unwrap().unwrap().vectors
        };
        assert!(leaning("0.0").is_empty());
        let all = leaning("0.3");
        assert!(all.len() == 20 && all[19][0] < 0.0 && all[19][2] > 0.0, "{all:?}");
    }

    #[test]
    fn a_preset_is_known_by_its_problem() {
        let scene = Scene::preset("indentation").unwrap();
        let mut coarse = scene.clone();
        coarse.set("discretisation.spacing_m", "0.004").unwrap();
        "mine".clone_into(&mut coarse.name);
        assert_eq!(preset_of(&coarse), Some("indentation"));
        coarse.set("material.poisson_ratio", "0.4").unwrap();
        assert_eq!(preset_of(&coarse), None);
        assert_eq!(study_depth(&scene).unwrap(), 0.004);
    }

    #[test]
    fn a_sample_of_several_materials_is_known_by_its_problem() {
        let depths = [0.004, 0.004, 0.004, 0.0025, 0.002];
        for (composite, depth) in COMPOSITES.iter().zip(depths) {
            let mut scene = composite.scene().unwrap();
            "mine".clone_into(&mut scene.name);
            assert_eq!(preset_of(&scene), Some(composite.name));
            assert_eq!(study_depth(&scene).unwrap(), depth, "{}", composite.name);
            scene.regions.pop();
            assert_eq!(preset_of(&scene), None, "{}", composite.name);
        }
    }

    #[test]
    fn finite_elements_are_taken_where_there_are_any() {
        let scene = Scene::preset("indentation").unwrap();
        let reference_solution = ReferenceSolution::of(&scene, 0.004).unwrap();
        assert_eq!((reference_solution.force.len(), reference_solution.depth_m()), (8, 0.004));
        assert_eq!(reference_solution.source, "independent finite elements");
        assert!(
            (1e-3..5e-3).contains(&reference_solution.uncertainty.unwrap()),
            "{:?}",
            reference_solution.uncertainty
        );
        let places: Vec<[f64; 3]> = reference_solution.displaced.iter().map(|(_, then)| *then).collect();
        assert_eq!(reference_solution.displacement_error(&places), Some(0.0));
        let undeformed: Vec<[f64; 3]> =
            reference_solution.displaced.iter().map(|(target, _)| target.position).collect();
        assert!(
            (reference_solution.displacement_error(&undeformed).unwrap() - 1.0).abs() < 1e-9,
            "the disc moved by the depth"
        );
    }

    #[test]
    fn without_finite_elements_the_own_fine_model_is_taken() {
        let mut scene = Scene::preset("compression").unwrap();
        scene.set("material.poisson_ratio", "0.4").unwrap();
        scene.set("discretisation.spacing_m", "0.004").unwrap();
        scene.set("motion.pose_hz", "100").unwrap();
        let reference_solution = ReferenceSolution::of(&scene, 0.001).unwrap();
        assert_eq!(reference_solution.force.len(), 20);
        assert!(reference_solution.source.starts_with("the own model") && reference_solution.uncertainty.is_none());
        assert!(reference_solution.force.windows(2).all(|w| w[1].1 > w[0].1), "{:?}", reference_solution.force);
        assert_eq!(reference_solution.displaced.len(), 3);
    }
}
