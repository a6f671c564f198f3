//! Finds the cheapest discretisation and the fewest steps per pose that keep a scene's force within a tolerance. All
//! candidates are run on this machine; nothing is estimated.
//!
//! The search:
//!
//! 1. Clouds from coarse to fine at the scene's own pace, until one is within the tolerance. In three dimensions each
//!    spacing is also tried with coarser surroundings.
//! 2. For the cheapest that are accurate enough, or for the nearest if none is: one, two, four ... steps per pose,
//!    until the force is accurate and the run's stability table holds.
//! 3. On that cloud and on the next coarser one: other supports, more points, and linear moving least squares; then
//!    the steps of those again.
//! 4. The other precision.
//!
//! Once a cloud is accurate enough, a run ends as soon as it can't win: its force is off by more than the tolerance,
//! or its pose takes longer than it may, or longer than that of the best so far. What is dearer than such a run is
//! not tried.
//!
//! The half plane is tried before three dimensions, if the scene's `discretisation.dimension` allows both.

use super::accuracy::{COMPARED_FROM, Case, Driven, MOST_STEPS, Row, Steps, StudyError, Watched};
use super::progress::Progress;
pub use super::progress::Tuned;
use super::reference_solution::ReferenceSolution;
use needle_core::scene::{Dimension, Override, Scene};
use needle_estimate::compare::{Keep, Session};

/// Factors on the scene's spacing in a half plane, coarse first.
const SPACINGS: [f64; 8] = [2.8, 2.0, 1.41, 1.0, 0.71, 0.5, 0.35, 0.25];
/// The same in three dimensions.
const SPACINGS_IN_SPACE: [f64; 5] = [2.0, 1.6, 1.25, 1.0, 0.8];
/// Steps per pose that are tried, few first.
const STEPS: [u32; 8] = [1, 2, 3, 4, 6, 8, 16, 32];
/// Number of discretisations whose steps per pose are varied.
const FINALISTS: usize = 4;
/// Largest share of the time between two poses for the mean pose; the rest is reserved for other load.
const HEADROOM: f64 = 0.7;
/// Factor on a processor time above which a run counts as dearer: two runs of one case differ by less.
const DEARER: f64 = 1.15;
/// The same for the first part of a run, whose poses may cost more than the others.
const DEARER_AT_FIRST: f64 = 1.5;
/// Largest share of the tolerance for a measured error.
const MARGIN: f64 = 0.95;

/// Requirements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// Largest relative error of the force, from a fifth of the path on.
    pub tolerance: f64,
    /// Poses per second that must be answered in time.
    pub pose_hz: f64,
}

impl Goal {
    fn near(&self, row: &Row) -> bool {
        row.max_force_error().is_some_and(|error| error <= MARGIN * self.tolerance)
    }

    /// Whether the targets are also within the tolerance during the motion, if their error is known.
    fn holds_targets(&self, row: &Row) -> bool {
        row.way_error.is_none_or(|error| error <= MARGIN * self.tolerance)
    }

    fn in_time(&self, row: &Row) -> bool {
        row.cost_per_pose_s() <= HEADROOM / self.pose_hz
    }

    /// The scene with the required rate of poses.
    pub fn asked_of(&self, scene: &Scene) -> Result<Scene, StudyError> {
        Ok(scene.with(&[Override::text("motion.pose_hz", &self.pose_hz.to_string(), "tune")])?)
    }
}

/// Runs a scene with different discretisations until the cheapest that meets the goal is found. `None` if it was
/// cancelled; `progress` then knows the best so far.
///
/// # Errors
/// [`StudyError::Untuned`] if none meets both requirements; the message names the nearest. Otherwise as
/// [`Case::run`].
pub fn tune(
    scene: &Scene,
    reference_solution: &ReferenceSolution,
    goal: Goal,
    progress: &Progress,
) -> Result<Option<Tuned>, StudyError> {
    let scene = goal.asked_of(scene)?;
    let mut search = Search::new(&scene, reference_solution, goal, progress);
    let own = Case::of(&scene)?;
    let mut dimensions = vec![scene.dimension().dimension];
    if scene.discretisation.dimension == Dimension::Auto && own.is_half_plane() {
        dimensions.push(Dimension::Full);
    }
    for dimension in dimensions {
        if search.dimension(&own.in_dimension(&scene, dimension))?.is_none() {
            return Ok(None);
        }
        if let Some(row) = search.best()? {
            return Ok(Some(Tuned::of(&scene, row)?));
        }
        // in three dimensions the same accuracy costs many times as much
        if search.rows.iter().any(|row| goal.near(row)) {
            break;
        }
    }
    if progress.cancel().is_cancelled() {
        return Ok(None);
    }
    Err(StudyError::Untuned(search.nearest()))
}

/// The scene on the coarsest cloud whose force is within a tolerance at the scene's own pace, with the resulting row;
/// `None` if it was cancelled.
///
/// # Errors
/// As [`tune`].
pub fn coarsest(
    scene: &Scene,
    reference_solution: &ReferenceSolution,
    goal: Goal,
    progress: &Progress,
) -> Result<Option<Tuned>, StudyError> {
    let scene = goal.asked_of(scene)?;
    let mut search = Search::new(&scene, reference_solution, goal, progress);
    let own = Case::of(&scene)?;
    let Some([near, _]) = search.first_near(&own, false)? else { return Ok(None) };
    let case = search.finalists(&own.dimension).into_iter().next().filter(|_| near.is_some());
    let Some(row) = case.and_then(|case| search.rows.iter().find(|row| row.case == case).cloned()) else {
        return Err(StudyError::Untuned(search.nearest()));
    };
    Ok(Some(Tuned::of(&scene, row)?))
}

/// The fewest steps per pose, or the scene's own pace, for a [corrected](super::correction) scene to meet the goal.
/// `case` describes its cloud.
///
/// The error is that of the force during the motion of `other`, the same scene with the change of the held-out run.
/// The error of the targets counts too, if any pace meets it. `None` if it was cancelled.
///
/// # Errors
/// As [`tune`].
pub fn paced(
    [scene, other]: [&Scene; 2],
    case: &Case,
    reference_solution: &ReferenceSolution,
    goal: Goal,
    progress: &Progress,
) -> Result<Option<Tuned>, StudyError> {
    let mut search = Search { corrected: true, ..Search::new(scene, reference_solution, goal, progress) };
    for (tried, steps) in std::iter::once(Steps::Auto).chain(STEPS.map(Steps::Fixed)).enumerate() {
        let case = Case { steps, ..case.clone() };
        let paced = with_pace(other, steps)?;
        progress.begin(format!("the corrected cloud, steps {steps}"), STEPS.len() - tried);
        let Some(row) = case.row_of(&paced, reference_solution, Watched::whole(progress))? else { return Ok(None) };
        search.add(&row)?;
        // the scene's own pace may be more expensive than a few steps
        if steps != Steps::Auto && (!goal.in_time(&row) || (goal.near(&row) && goal.holds_targets(&row))) {
            break;
        }
    }
    let targets = search.meeting(|row| goal.holds_targets(row));
    for row in targets.into_iter().chain(search.meeting(|row| !goal.holds_targets(row))) {
        let paced = with_pace(scene, row.case.steps)?;
        if search.holds(&paced, &row.case)? {
            return Ok(Some(Tuned { scene: paced, row }));
        }
    }
    if progress.cancel().is_cancelled() {
        return Ok(None);
    }
    Err(StudyError::Untuned(search.nearest()))
}

/// A scene with a fixed number of steps for every pose that moves, or with its own pace.
pub(super) fn with_pace(scene: &Scene, steps: Steps) -> Result<Scene, StudyError> {
    let (least, most) = match steps {
        Steps::Fixed(steps) => (steps, steps),
        Steps::Auto | Steps::Rest => (1, MOST_STEPS),
    };
    let keys = [("stepping.min_steps_per_pose", least), ("stepping.max_steps_per_pose", most)];
    Ok(scene.with(&keys.map(|(path, steps)| Override::typed(path, steps, "tune")))?)
}

struct Search<'a> {
    scene: &'a Scene,
    reference_solution: &'a ReferenceSolution,
    goal: Goal,
    rows: Vec<Row>,
    /// Whether the stability table holds over a case's whole motion, for the cases checked so far.
    stable: Vec<(Case, bool)>,
    /// Whether `scene` has a correction, and only its pace is looked for.
    corrected: bool,
    /// Largest number of runs that may follow the present one.
    left: usize,
    progress: &'a Progress,
}

impl<'a> Search<'a> {
    fn new(scene: &'a Scene, reference_solution: &'a ReferenceSolution, goal: Goal, progress: &'a Progress) -> Self {
        let (rows, stable) = (Vec::new(), Vec::new());
        Self { scene, reference_solution, goal, rows, stable, corrected: false, left: 0, progress }
    }

    /// Runs a case unless it has been run already; `None` if it was cancelled.
    fn run(&mut self, case: &Case) -> Result<Option<Row>, StudyError> {
        if let Some(known) = self.rows.iter().find(|row| row.case == *case) {
            return Ok(Some(known.clone()));
        }
        self.progress.begin(case.name(), self.left);
        self.left = self.left.saturating_sub(1);
        let scene = self.reference_solution.watched(&case.scene(self.scene)?);
        let useless = |driven: &Driven| self.useless(case, driven);
        let watch = Watched { progress: self.progress, useless: &useless };
        let Some(row) = case.row_of(&scene, self.reference_solution, watch)? else { return Ok(None) };
        self.add(&row)?;
        Ok(Some(row))
    }

    fn add(&mut self, row: &Row) -> Result<(), StudyError> {
        self.progress.measured(row);
        self.rows.push(row.clone());
        self.tell_best()
    }

    /// Why the rest of a run is of no use: none, as long as no cloud is accurate enough, since then the nearest counts.
    fn useless(&self, case: &Case, driven: &Driven) -> Option<String> {
        if !self.rows.iter().any(|row| self.goal.near(row)) {
            return None;
        }
        let from = COMPARED_FROM * self.reference_solution.depth_m() * (1.0 - 1e-9);
        let depth_m = driven.path.last().map_or(0.0, |p| p.0);
        let cost_s = least_cost(case, driven.cost_s, driven.poses, driven.steps);
        // what the whole run costs even if the rest of it costs nothing
        let least_s = cost_s * depth_m / self.reference_solution.depth_m();
        if self.is_too_dear(least_s) || (depth_m >= from && self.is_too_dear(DEARER / DEARER_AT_FIRST * cost_s)) {
            return Some("it takes too long".to_owned());
        }
        let errors = self.reference_solution.force_errors(&driven.path, &driven.vectors);
        let off = errors.iter().filter(|(depth, _)| *depth >= from).map(|(_, e)| e.abs()).fold(0.0, f64::max);
        // with few steps it may be nearest in time, which is to be known until something is near and in time
        let counts = matches!(case.steps, Steps::Auto) || self.cheapest().is_some();
        (counts && off > MARGIN * self.goal.tolerance).then(|| format!("off by {:.2} %", 100.0 * off))
    }

    /// Whether a pose of so many seconds is too slow, or dearer than the best so far.
    fn is_too_dear(&self, cost_per_pose_s: f64) -> bool {
        let most = HEADROOM / self.goal.pose_hz;
        cost_per_pose_s > DEARER * self.cheapest().map_or(most, |best| best.min(most))
    }

    /// Whether even one step of the coarsest cloud takes too long for a pose.
    fn is_hopeless(&self) -> bool {
        let cost = |row: &Row| least_cost(&row.case, row.cost_s, row.poses, row.steps);
        self.rows
            .iter()
            .filter(|row| row.poses > 0)
            .map(cost)
            .reduce(f64::min)
            .is_some_and(|least| self.is_too_dear(least))
    }

    /// Processor time per pose of the cheapest case that meets both requirements and whose stability table holds, s.
    fn cheapest(&self) -> Option<f64> {
        let holds = |row: &&Row| self.stable.iter().any(|(case, holds)| *case == row.case && *holds);
        let meets = |row: &&Row| self.goal.near(row) && self.goal.in_time(row);
        self.rows.iter().filter(meets).filter(holds).map(Row::cost_per_pose_s).reduce(f64::min)
    }

    /// Says what is the best so far: the cheapest within the tolerance, first of those that are in time, and not one
    /// whose stability table is known not to hold.
    fn tell_best(&self) -> Result<(), StudyError> {
        let fails = |row: &&Row| self.stable.iter().any(|(case, holds)| *case == row.case && !*holds);
        let near = self.rows.iter().filter(|row| self.goal.near(row) && !fails(row));
        let rank = |row: &Row| (!self.goal.in_time(row), row.cost_per_pose_s());
        let best = near.min_by(|a, b| {
            let ((a_late, a), (b_late, b)) = (rank(a), rank(b));
            a_late.cmp(&b_late).then(a.total_cmp(&b))
        });
        let best = best.cloned().map(|row| {
            if self.corrected {
                Ok(Tuned { scene: with_pace(self.scene, row.case.steps)?, row })
            } else {
                Tuned::of(self.scene, row)
            }
        });
        self.progress.best(best.transpose()?);
        Ok(())
    }

    /// Runs clouds at the scene's own pace, coarse ones first, until one is accurate enough. Returns the factor on
    /// the scene's spacings of that one, and of the next coarser one; `None` if it was cancelled. Of the clouds with one
    /// spacing, those after the first that is near are run if `every` is set: they have more nodes.
    fn first_near(&mut self, own: &Case, every: bool) -> Result<Option<[Option<f64>; 2]>, StudyError> {
        let factors: &[f64] = if own.is_half_plane() { &SPACINGS } else { &SPACINGS_IN_SPACE };
        let mut coarser = None;
        for (tried, &factor) in factors.iter().enumerate() {
            let each = clouds(own.clone()).len();
            self.left = (factors.len() - tried) * each - 1 + variants(own).len() + 2 * FINALISTS;
            let (mut near, mut fits) = (false, false);
            for case in clouds(own.spaced(self.scene, factor)) {
                let row = match self.run(&case) {
                    // the scene's own spacing may be close to the coarsest that its sample allows
                    Err(StudyError::Scene(_)) if factor > 1.0 => continue,
                    row => row?,
                };
                let Some(row) = row else { return Ok(None) };
                near |= self.goal.near(&row);
                fits = true;
                if near && !every {
                    break;
                }
            }
            if near {
                return Ok(Some([Some(factor), coarser]));
            }
            // a finer cloud takes longer still
            if fits && self.is_hopeless() {
                break;
            }
            coarser = fits.then_some(factor);
        }
        Ok(Some([None, coarser]))
    }

    /// The whole search in one dimension; `None` if it was cancelled.
    fn dimension(&mut self, own: &Case) -> Result<Option<()>, StudyError> {
        let Some([near, coarser]) = self.first_near(own, true)? else { return Ok(None) };
        self.left = 2 * variants(own).len() + 4 * FINALISTS;
        if self.few_steps(&own.dimension)?.is_none() {
            return Ok(None);
        }
        if let Some(factor) = near {
            let both = coarser.into_iter().chain([factor]);
            let cases: Vec<Case> = both.flat_map(|factor| variants(&own.spaced(self.scene, factor))).collect();
            for (tried, case) in cases.iter().enumerate() {
                self.left = cases.len() - tried - 1 + 2 * FINALISTS;
                if !self.is_dearer_than_useless(case) && self.run(case)?.is_none() {
                    return Ok(None);
                }
            }
            self.left = 2 * FINALISTS;
            if self.few_steps(&own.dimension)?.is_none() {
                return Ok(None);
            }
        }
        if let Some(best) = self.best()?.map(|row| row.case) {
            let other = if best.precision == "f32" { "f64" } else { "f32" };
            self.left = 1;
            if self.run(&Case { precision: other.to_owned(), ..best })?.is_none() {
                return Ok(None);
            }
        }
        Ok(Some(()))
    }

    /// The fewest steps per pose for those that may win; `None` if it was cancelled.
    fn few_steps(&mut self, dimension: &str) -> Result<Option<()>, StudyError> {
        for case in self.finalists(dimension) {
            if self.fewest_steps(&case)?.is_none() {
                return Ok(None);
            }
        }
        Ok(Some(()))
    }

    /// Whether it has the points of another case and more, or wider supports, and that one is too dear already.
    fn is_dearer_than_useless(&self, case: &Case) -> bool {
        let too_dear =
            |row: &&Row| row.poses > 0 && self.is_too_dear(least_cost(&row.case, row.cost_s, row.poses, row.steps));
        self.rows.iter().filter(too_dear).any(|row| {
            let Case { support_factor, points_per_cell, cells_per_point, .. } = row.case;
            let same = Case { support_factor, points_per_cell, cells_per_point, ..case.clone() } == row.case;
            same && case.support_factor >= support_factor
                && case.points_per_cell >= points_per_cell
                && case.cells_per_point <= cells_per_point
        })
    }

    /// Of the cases that are accurate enough at the scene's own pace, those cheapest per step; the nearest if there
    /// are none, since more steps may suffice.
    fn finalists(&self, dimension: &str) -> Vec<Case> {
        let own = || self.rows.iter().filter(|row| row.case.dimension == dimension);
        let mut best: Vec<&Row> = own().filter(|row| self.goal.near(row)).collect();
        if best.is_empty() {
            best = own().filter(|row| row.max_force_error().is_some()).collect();
            best.sort_by(|a, b| error(a).total_cmp(&error(b)));
        } else {
            let per_step = |row: &Row| row.cost_s / row.steps.max(1) as f64;
            best.sort_by(|a, b| per_step(a).total_cmp(&per_step(b)));
        }
        best.into_iter().take(FINALISTS).map(|row| row.case.clone()).collect()
    }

    /// Tries few steps per pose first, until force and stability are good or the pose takes too long.
    fn fewest_steps(&mut self, case: &Case) -> Result<Option<()>, StudyError> {
        for steps in STEPS {
            let known = self.rows.iter().find(|row| row.case == *case && row.poses > 0);
            let per_step = known.map_or(0.0, |row| row.cost_s / row.steps.max(1) as f64);
            // if none is accurate enough yet, the nearest is to be known
            let decided = self.rows.iter().any(|row| self.goal.near(row));
            if decided && self.is_too_dear(f64::from(steps) * per_step) {
                break;
            }
            let Some(row) = self.run(&Case { steps: Steps::Fixed(steps), ..case.clone() })? else { return Ok(None) };
            if !self.goal.in_time(&row) || (self.goal.near(&row) && self.is_stable(&row.case)?) {
                break;
            }
        }
        Ok(Some(()))
    }

    /// The cheapest row that meets both requirements and whose stability table holds.
    fn best(&mut self) -> Result<Option<Row>, StudyError> {
        for row in self.meeting(|row| matches!(row.case.steps, Steps::Fixed(_))) {
            if self.is_stable(&row.case)? {
                return Ok(Some(row));
            }
        }
        Ok(None)
    }

    /// The rows that meet both requirements, cheapest first.
    fn meeting(&self, counts: impl Fn(&Row) -> bool) -> Vec<Row> {
        let meets = |row: &&Row| counts(row) && self.goal.near(row) && self.goal.in_time(row);
        let mut meeting: Vec<Row> = self.rows.iter().filter(meets).cloned().collect();
        meeting.sort_by(|a, b| a.cost_per_pose_s().total_cmp(&b.cost_per_pose_s()));
        meeting
    }

    /// Whether the stability table holds over the whole motion, retraction included, as in `solve`.
    fn is_stable(&mut self, case: &Case) -> Result<bool, StudyError> {
        let scene = case.scene(self.scene)?;
        self.holds(&scene, case)
    }

    /// The same for a scene that already has the case's keys.
    fn holds(&mut self, scene: &Scene, case: &Case) -> Result<bool, StudyError> {
        if let Some((_, known)) = self.stable.iter().find(|(of, _)| of == case) {
            return Ok(*known);
        }
        if self.progress.cancel().is_cancelled() {
            return Ok(false);
        }
        let motion = scene.motion.ok_or_else(|| StudyError::NoMotion(scene.name.clone()))?;
        self.progress.begin(format!("stability over the whole motion, {}", case.name()), self.left);
        let session = Session::new(scene, "tune", Keep::ANSWERS)?;
        let mut watch = self.progress.poses(Session::motion(&motion).count());
        let run = session.run(Session::motion(&motion), &mut watch).run;
        if self.progress.cancel().is_cancelled() {
            return Ok(false);
        }
        let holds = run.diverged.is_none() && run.unstable().is_empty();
        self.stable.push((case.clone(), holds));
        self.tell_best()?;
        Ok(holds)
    }

    /// The message if no case meets both requirements.
    fn nearest(&self) -> String {
        let told = |row: &Row| {
            format!(
                "{} (error {:.2} %, {:.3} ms per pose)",
                row.case.name(),
                100.0 * row.max_force_error().unwrap_or(f64::NAN),
                1e3 * row.cost_per_pose_s()
            )
        };
        let by = |key: &dyn Fn(&Row) -> f64, rows: Vec<&Row>| {
            rows.into_iter().min_by(|a, b| key(a).total_cmp(&key(b))).map_or_else(|| "none".to_owned(), told)
        };
        let whole = || self.rows.iter().filter(|row| row.max_force_error().is_some());
        format!(
            "nothing that was run has both an error of {:.3} % and {:.3} ms per pose ({:.0} % of the time between two){}. \
             Nearest to the reference: {}. Nearest in time: {}. Ask for a wider --tolerance or a lower --pose-hz",
            100.0 * self.goal.tolerance,
            1e3 * HEADROOM / self.goal.pose_hz,
            100.0 * HEADROOM,
            if self.stable.iter().any(|(_, holds)| !holds) { " and a stability table that holds" } else { "" },
            by(&error, whole().collect()),
            by(&error, whole().filter(|row| self.goal.in_time(row)).collect()),
        )
    }
}

/// Processor time that a pose of a case takes at least, s: one step if their number is still to be chosen.
fn least_cost(case: &Case, cost_s: f64, poses: u64, steps: u64) -> f64 {
    let least = if case.steps == Steps::Auto { steps } else { poses };
    cost_s / least.max(1) as f64
}

fn error(row: &Row) -> f64 {
    row.max_force_error().unwrap_or(f64::INFINITY)
}

/// Clouds with one spacing. In three dimensions: with coarse surroundings, without and with support nodes that few
/// points share, and the scene's own.
fn clouds(case: Case) -> Vec<Case> {
    if case.is_half_plane() || case.method == "tet4" {
        return vec![case];
    }
    let around = case.with_coarse_surroundings();
    let all_nodes = Case { points_per_support_node: case.points_per_support_node, ..around.clone() };
    vec![around, all_nodes, case]
}

/// Other discretisations on the same cloud.
fn variants(case: &Case) -> Vec<Case> {
    let mut cases = vec![case.clone(), Case { points_per_cell: 4, ..case.clone() }];
    if case.method != "tet4" {
        if !case.is_half_plane() {
            cases.push(Case { cells_per_point: 3 - case.cells_per_point, ..case.clone() });
        }
        cases.extend([1.4, 1.6, 2.2].map(|support_factor| Case { support_factor, ..case.clone() }));
    }
    if case.method == "mmls" {
        cases.push(Case { method: "mls".to_owned(), ..case.clone() });
    }
    cases
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn in_space_a_cloud_with_coarse_surroundings_is_tried_first() {
        let mut scene = Scene::preset("needle_insertion").unwrap();
        let half_plane = Case::of(&scene).unwrap();
        assert_eq!(clouds(half_plane.clone()), [half_plane]);
        scene.set("instrument.tilt_rad", "0.3").unwrap();
        let own = Case::of(&scene).unwrap();
        let both = clouds(own.clone());
        assert!(both.len() == 3 && both[2] == own);
        let tried = both[0].scene(&scene).unwrap();
        let grading = tried.grading().unwrap();
        assert_eq!((grading.growth, grading.path_rings, tried.support_factor()), (0.45, 2, 1.5));
        assert_eq!([0, 1, 2].map(|k: usize| both[k].points_per_support_node), [2, 1, 1]);
        assert_eq!(grading.spacing, scene.grading().unwrap().spacing);
        let elements = Case { method: "tet4".to_owned(), ..own };
        assert_eq!(clouds(elements.clone()), [elements], "which have no supports");
    }
}
