//! The cases of a study: the product of method, dimension, spacing and steps per pose; and for a base case of each
//! dimension, variations of every other property, one at a time.

use super::{Case, Steps, StudyError};
use needle_core::scene::Word as _;
use needle_core::scene::{Dimension, Method, Scene};

/// Extent of the study. Every quick case is also part of the full study, so a quick start saves time later.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// Coarse clouds and few steps: a minute per preset on two cores.
    Quick,
    /// All cases: a quarter of an hour per preset on one core.
    Full,
    /// Three clouds in three dimensions per method, at rest at each depth, so that only the discretisation error
    /// remains.
    AtRest,
}

/// A stream of poses: poses per second, and steps per pose.
type Pace = (f64, Steps);

/// A rate at which a pose covers ten times the distance.
const SLOW: f64 = 100.0;
const FAST: f64 = 1000.0;
/// Paces of the product; the last one only in the half plane.
const PACES: [Pace; 4] =
    [(SLOW, Steps::Fixed(1)), (SLOW, Steps::Fixed(4)), (FAST, Steps::Fixed(1)), (FAST, Steps::Fixed(4))];
/// Paces that are varied one at a time; the last three only in the half plane.
const MORE_PACES: [Pace; 5] = [
    (SLOW, Steps::Fixed(2)),
    (SLOW, Steps::Fixed(8)),
    (SLOW, Steps::Fixed(16)),
    (SLOW, Steps::Auto),
    (FAST, Steps::Fixed(2)),
];

/// Settings for the cases of one dimension.
struct Range {
    dimension: Dimension,
    /// Factors on the scene's spacing.
    spacings: &'static [f64],
    /// Those of them in the quick study.
    quick: &'static [f64],
    /// The factor of the base case, for which the other properties are varied.
    base: f64,
    /// The pace of the base case.
    base_pace: Pace,
    paces: usize,
    more_paces: usize,
    /// Methods for which the other properties are varied.
    methods: &'static [&'static str],
    /// Number of paces in the quick study.
    quick_paces: usize,
}

const RANGES: [Range; 2] = [
    Range {
        dimension: Dimension::Axisymmetric,
        spacings: &[2.0, 1.41, 1.0, 0.71, 0.5],
        quick: &[2.0, 1.41, 1.0, 0.71],
        base: 1.0,
        base_pace: PACES[2],
        paces: 4,
        more_paces: 5,
        methods: Method::WORDS,
        quick_paces: 3,
    },
    Range {
        dimension: Dimension::Full,
        spacings: &[1.6, 1.25, 1.0],
        quick: &[1.6],
        base: 1.25,
        base_pace: PACES[1],
        paces: 3,
        more_paces: 2,
        // each of these runs takes a minute
        methods: &["mmls", "tet4"],
        quick_paces: 2,
    },
];

/// Factors on the spacing for runs to equilibrium, coarse first. For a needle they apply to its path: half a capture
/// radius is the coarsest spacing for a needle, and the force depends on little else.
const AT_REST: [f64; 3] = [1.6, 1.25, 1.0];
const AT_REST_PATH: [f64; 3] = [1.0, 0.7, 0.5];

/// Smallest ratio of the spacing to the scene's for which a corrected cloud is studied.
const COARSE: f64 = 1.2;
/// Cost of the equilibrium runs from which a correction is learnt and evaluated, in runs of the cloud itself: two of
/// a finer cloud with three times its nodes, and three of its own.
const LEARNING: f64 = 9.0;
/// Steps at each depth of a run to equilibrium, over those of a pose: several hundred.
const WAITING: f64 = 40.0;

/// The cases of a scene, cheapest first, without duplicates.
///
/// # Errors
/// [`StudyError`] if the scene has no cloud of its own or no motion.
pub fn plan(scene: &Scene, extent: Extent) -> Result<Vec<Case>, StudyError> {
    let own = Case::of(scene)?;
    let mut cases = match extent {
        Extent::AtRest => at_rest(scene, &own),
        Extent::Quick | Extent::Full => moving(scene, &own, extent),
    };
    let mut unique: Vec<Case> = Vec::new();
    cases.retain(|case| {
        let new = !unique.contains(case);
        if new {
            unique.push(case.clone());
        }
        new
    });
    cases.sort_by(|a, b| work(scene, a).total_cmp(&work(scene, b)));
    Ok(cases)
}

/// Cases with names, which readers look for first: the scene as it is, the same in three dimensions, and
/// `source_paper`.
///
/// # Errors
/// As [`plan`].
pub fn named(scene: &Scene) -> Result<Vec<(Case, &'static str)>, StudyError> {
    let own = Case::of(scene)?;
    let in_space = own.in_dimension(scene, Dimension::Full);
    Ok(vec![
        (own, "as shipped"),
        (in_space, "as shipped, in three dimensions"),
        (source_paper(scene)?, "the source paper's setting: MMLS, 1 point, no cure"),
    ])
}

/// The source paper's own settings on the scene's cloud: modified moving least squares in three dimensions, one point
/// per tetrahedron, no treatment of volumetric locking, one explicit step per pose.
///
/// # Errors
/// As [`plan`].
pub(crate) fn source_paper(scene: &Scene) -> Result<Case, StudyError> {
    let mut case = Case::of(scene)?;
    Method::Mmls.as_str().clone_into(&mut case.method);
    "pointwise".clone_into(&mut case.volume_ratio);
    Dimension::Full.as_str().clone_into(&mut case.dimension);
    case.points_per_cell = 1;
    case.cells_per_point = 1;
    case.points_per_support_node = 1;
    "f32".clone_into(&mut case.precision);
    Ok(at(&case, PACES[2]))
}

fn moving(scene: &Scene, own: &Case, extent: Extent) -> Vec<Case> {
    let mut cases = Vec::new();
    for range in RANGES.iter().filter(|r| r.dimension == Dimension::Full || scene.asymmetry().is_none()) {
        let base = own.in_dimension(scene, range.dimension);
        let (spacings, paces) = match extent {
            Extent::Quick => (range.quick, range.quick_paces),
            _ => (range.spacings, range.paces),
        };
        for &factor in spacings {
            for method in Method::WORDS {
                let mut case = base.spaced(scene, factor);
                (*method).clone_into(&mut case.method);
                cases.extend(PACES[..paces].iter().map(|pace| at(&case, *pace)));
            }
            if range.dimension == Dimension::Full {
                cases.extend(hexahedra(scene, &at(&base.spaced(scene, factor), range.base_pace)));
            }
            cases.extend(reduced(scene, &at(&base.spaced(scene, factor), range.base_pace), extent));
        }
        if extent == Extent::Full {
            cases.extend(one_at_a_time(scene, &at(&base.spaced(scene, range.base), range.base_pace), range.methods));
            let more = MORE_PACES[..range.more_paces].iter();
            cases.extend(more.map(|pace| at(&base.spaced(scene, range.base), *pace)));
            cases.push(base);
        }
    }
    if extent == Extent::Quick {
        cases.push(own.clone());
    }
    cases.extend(source_paper(scene).ok().filter(|_| extent == Extent::Full));
    cases
}

/// Variations of support, points per cell, cells per point, precision and treatment of locking, one at a time.
fn one_at_a_time(scene: &Scene, base: &Case, methods: &[&str]) -> Vec<Case> {
    let mut cases = Vec::new();
    for method in methods {
        let base = Case { method: (*method).to_owned(), ..base.clone() };
        // a linear finite element has no support and a constant strain
        if base.method != Method::Tet4.as_str() {
            cases.extend([1.4, 1.6, 2.2].map(|support_factor| Case { support_factor, ..base.clone() }));
            cases.push(Case { points_per_cell: 4, ..base.clone() });
            if !base.is_half_plane() {
                cases.push(Case { cells_per_point: 3 - base.cells_per_point, ..base.clone() });
            }
        }
        cases.extend(averaged(scene, &base));
        cases.push(Case { volume_ratio: "pointwise".to_owned(), ..base.clone() });
    }
    cases.push(Case { precision: "f64".to_owned(), ..base.clone() });
    cases
}

fn at(case: &Case, (pose_hz, steps): Pace) -> Case {
    Case { pose_hz, steps, ..case.clone() }
}

/// Three methods, three treatments of locking and more points, on three clouds in three dimensions.
fn at_rest(scene: &Scene, own: &Case) -> Vec<Case> {
    let needle = matches!(scene.instrument.map(|i| i.kind), Some(needle_core::scene::InstrumentKind::Needle(_)));
    let base = at(own, (SLOW, Steps::Rest)).in_dimension(scene, Dimension::Full);
    let mut cases = Vec::new();
    for (all, path) in AT_REST.into_iter().zip(AT_REST_PATH) {
        let base = if needle { base.spaced_at_edge(scene, path) } else { base.spaced(scene, all) };
        cases.extend(Method::WORDS.iter().map(|method| Case { method: (*method).to_owned(), ..base.clone() }));
        cases.extend(averaged(scene, &base));
        cases.push(Case { volume_ratio: "pointwise".to_owned(), ..base.clone() });
        cases.extend(hexahedra(scene, &base));
        cases.push(Case { points_per_cell: 4, ..base });
    }
    cases
}

/// The same with the volume ratio averaged over nodes, in builds with the feature `research`.
fn averaged(scene: &Scene, case: &Case) -> Option<Case> {
    let case = Case { volume_ratio: "averaged".to_owned(), ..case.clone() };
    case.scene(scene).is_ok().then_some(case)
}

/// The same with hexahedra of eight points and of one, in builds with the feature `research`, if the scene accepts them. If a cloud has no room for one, its
/// row reports that.
fn hexahedra(scene: &Scene, case: &Case) -> Vec<Case> {
    let of = |points_per_hexahedron| Case { points_per_hexahedron, ..case.clone() };
    [8, 1].map(of).into_iter().filter(|case| case.scene(scene).is_ok()).collect()
}

/// Reduced models on the cloud of a case: one side of its plane of symmetry; the same with coarse surroundings, with
/// and without support nodes that few points share; and coarse clouds with a correction from the equilibrium of a
/// finer one.
fn reduced(scene: &Scene, case: &Case, extent: Extent) -> Vec<Case> {
    let coarse = case.spacing_m > COARSE * scene.grading().map_or(0.0, |grading| grading.spacing.get());
    let corrected = |case: &Case| Case { corrected: true, ..at(case, PACES[2]) };
    if case.is_half_plane() {
        return if coarse { vec![corrected(case)] } else { Vec::new() };
    }
    let half = case.in_dimension(scene, Dimension::Mirrored);
    let around = half.with_coarse_surroundings();
    let mut cases =
        vec![half, Case { points_per_support_node: case.points_per_support_node, ..around.clone() }, around.clone()];
    if extent == Extent::Full {
        let fast: Vec<Case> = cases.iter().map(|case| at(case, PACES[2])).collect();
        cases.extend(fast);
        cases.extend(coarse.then(|| corrected(&around)));
    }
    cases.retain(|case| case.scene(scene).is_ok());
    cases
}

/// Approximate cost of a case: number of points within the supports, times steps. Only ratios are meaningful.
#[must_use]
pub fn work(scene: &Scene, case: &Case) -> f64 {
    let Ok(scene) = case.scene(scene) else { return 0.0 };
    let nodes = scene.estimate().map_or(0.0, |e| e.nodes);
    let (per_node, dimensions) = if case.is_half_plane() { (8.0, 2.0) } else { (5.5, 3.0) };
    let support = if case.method == Method::Tet4.as_str() { 0.5 } else { (case.support_factor / 1.8).powf(dimensions) };
    let steps = match case.steps {
        Steps::Auto => 1.5,
        Steps::Fixed(steps) => f64::from(steps),
        Steps::Rest => WAITING,
    };
    let learning = if case.corrected { LEARNING * WAITING * SLOW } else { 0.0 };
    let points = match case.has_hexahedra() {
        true => f64::from(case.points_per_hexahedron) / 6.0, // of six tetrahedra
        false => f64::from(case.points_per_cell) / f64::from(case.joined()),
    };
    nodes * per_node * (0.3 + support) * points * (steps * case.pose_hz + learning)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_case_is_a_scene_and_there_once() {
        for preset in ["compression", "indentation", "needle_insertion"] {
            let scene = Scene::preset(preset).unwrap();
            let full = plan(&scene, Extent::Full).unwrap();
            let quick = plan(&scene, Extent::Quick).unwrap();
            let at_rest = plan(&scene, Extent::AtRest).unwrap();
            println!("{preset}: {} cases, {} quick, {} at rest", full.len(), quick.len(), at_rest.len());
            assert!(quick.iter().all(|case| full.contains(case)), "a quick case is one of the full study");
            assert!(full.contains(&source_paper(&scene).unwrap()));
            for cases in [&full, &at_rest] {
                assert!((0..cases.len()).all(|i| !cases[..i].contains(&cases[i])), "{preset}: a case is there twice");
                for case in cases.iter() {
                    let back = case.scene(&scene).unwrap();
                    let back = Case { steps: case.steps, corrected: case.corrected, ..Case::of(&back).unwrap() };
                    assert_eq!(&back, case, "{}", case.name());
                }
            }
        }
    }

    #[test]
    fn a_scene_without_symmetry_is_studied_in_space() {
        let mut scene = Scene::preset("needle_insertion").unwrap();
        scene.set("instrument.entry_x_m", "0.002").unwrap();
        assert!(plan(&scene, Extent::Full).unwrap().iter().all(|case| !case.is_half_plane()));
    }
}
