//! Assembles a [`Run`] from its answers, for offline and live runs.

use needle_core::scene::Word as _;
use xxhash_rust::xxh3::Xxh3;

use super::{Answer, FinalState, NeedleRow, Occurrence, Run, Snapshot, TargetRow};
use needle_core::twin::{Health, Prediction, Twin};

/// Number of snapshots of a run whose length is known.
const SNAPSHOTS: f64 = 48.0;
/// Above this number every second snapshot is dropped.
const MOST_SNAPSHOTS: usize = 96;
/// First interval between snapshots if the length is not known, s.
const FIRST_INTERVAL_S: f64 = 0.05;

/// What a run keeps in addition to its answers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keep {
    /// Whether fields (snapshots, final Jacobian and stress) are computed.
    pub fields: bool,
    /// Length of the run, s, if it is known beforehand.
    pub duration_s: Option<f64>,
    /// Time between two snapshots, s; `None`: some forty per run.
    pub save_every_s: Option<f64>,
}

/// Assembles a [`Run`].
pub(crate) struct Collector {
    run: Run,
    keep: Keep,
    hash: Xxh3,
    /// Kinetic over strain energy of each answer.
    energy_ratio: Vec<f64>,
    /// Largest |base reaction - force on the instrument|, N: zero in equilibrium.
    imbalance_n: f64,
    /// Sum of its squares over the answers, N^2.
    imbalance_n2: f64,
    /// The same of what the steps may have made of the force, N^2.
    step_error_n2: f64,
    /// Largest |force on the instrument|, N.
    peak_n: f64,
    first_time_s: Option<f64>,
    snapshot_interval_s: f64,
    refused: u64,
    first_refusal: String,
    unanswered: u64,
}

impl Collector {
    /// Starts a run of a twin that has just been built or reset. `command` is the name of the command (`replay`).
    #[must_use]
    pub(crate) fn new(twin: &Twin, command: &str, build_s: f64, keep: Keep) -> Self {
        let scene = twin.scene();
        let run = Run {
            scene: scene.name.clone(),
            description: scene.description.clone(),
            method: scene.discretisation.method.as_str().to_owned(),
            dimension: twin.dimension().as_str().to_owned(),
            dimension_because: twin.dimension_because().to_owned(),
            nodes: twin.nodes(),
            integration_points: twin.integration_points(),
            target_names: scene.targets.iter().map(|target| target.name.clone()).collect(),
            effective_radius_m: twin.effective_radius(),
            build_s,
            min_jacobian: 1.0,
            accuracy: scene.accuracy,
            along: twin.along().clone(),
            instrument: scene.instrument,
            scene_toml: scene.to_toml(),
            command: command.to_owned(),
            ..Run::default()
        };
        Self {
            run,
            keep,
            hash: Xxh3::new(),
            energy_ratio: Vec::new(),
            imbalance_n: 0.0,
            imbalance_n2: 0.0,
            step_error_n2: 0.0,
            peak_n: 0.0,
            first_time_s: None,
            snapshot_interval_s: keep
                .save_every_s
                .unwrap_or_else(|| keep.duration_s.map_or(FIRST_INTERVAL_S, |duration| duration / SNAPSHOTS)),
            refused: 0,
            first_refusal: String::new(),
            unanswered: 0,
        }
    }

    /// Adds one prediction with the force measured at its time (force of the tissue on the instrument in frame
    /// `sample`, N) and its wall time. `axis` is the unit vector along the instrument, into the sample.
    pub(crate) fn answered(
        &mut self,
        twin: &Twin,
        prediction: &Prediction,
        axis: [f64; 3],
        measured_n: Option<[f64; 3]>,
        latency_s: f64,
    ) -> Answer {
        let time_s = prediction.time_s - *self.first_time_s.get_or_insert(prediction.time_s);
        let answer = Answer {
            time_s,
            depth_m: prediction.depth_m,
            predicted_n: 0.0 - dot(prediction.force_n, axis),
            measured_n: measured_n.map(|force| 0.0 - dot(force, axis)),
            predicted_vector_n: prediction.force_n,
            measured_vector_n: measured_n,
            model_error_n: prediction.model_error_n(),
            phase: prediction.phase,
            event: prediction.event,
            steps: prediction.steps,
            latency_s,
        };
        self.run.answers.push(answer);
        self.note_events(twin, time_s, axis);
        self.run.coefficients.extend(twin.deformation_coefficient().map(|c| [time_s, answer.depth_m, c]));
        if let (Some(bent), Some(straight)) = (twin.bent_tip(), twin.straight_tip()) {
            let aside: [f64; 3] = std::array::from_fn(|k| bent.tip[k] - straight[k]);
            self.run.needle.push(NeedleRow {
                time_s,
                depth_m: prediction.depth_m,
                tip: bent.tip,
                aside_m: norm(aside),
                force_n: prediction.force_n,
                torque_nm: prediction.torque_nm,
            });
        }
        self.run.steps += u64::from(prediction.steps);
        self.run.wall_s += latency_s;
        self.run.simulated_s = self.run.simulated_s.max(time_s);
        self.note_health(prediction);
        for component in prediction.force_n {
            self.hash.update(&component.to_le_bytes());
        }
        self.observe(twin, &answer);
        answer
    }

    fn note_events(&mut self, twin: &Twin, time_s: f64, axis: [f64; 3]) {
        self.run.events.extend(twin.happened().iter().map(|h| Occurrence {
            time_s,
            kind: h.event.kind().to_owned(),
            region: twin.along().name_of(h.event.region()).to_owned(),
            depth_m: h.event.depth_m(),
            force_before_n: 0.0 - dot(h.force_before_n, axis),
            force_after_n: 0.0 - dot(h.force_after_n, axis),
        }));
    }

    /// Sets whether force and position were stamped by one clock.
    pub(super) const fn on_one_clock(&mut self, one_clock: bool) {
        self.run.one_clock = one_clock;
    }

    /// Sets the number of readings of the load cell during the motion.
    pub(super) const fn read_forces(&mut self, readings: Option<usize>) {
        self.run.force_readings = readings;
    }

    /// Sets the intervals without recorded data, from and to, s.
    pub(super) fn over_holes(&mut self, holes: &[[f64; 2]]) {
        self.run.holes = holes.to_vec();
    }

    fn note_health(&mut self, prediction: &Prediction) {
        let health = &prediction.health;
        self.energy_ratio.push(health.kinetic_to_strain_energy);
        self.run.min_jacobian = self.run.min_jacobian.min(health.min_jacobian);
        self.run.constraint_error_m = self.run.constraint_error_m.max(health.constraint_error_m);
        self.run.note_folds(prediction.depth_m, health.folded_energy);
        // Both are forces of the tissue on its supports: in equilibrium they sum to zero.
        let unbalanced = prediction.unbalanced_n();
        self.imbalance_n = self.imbalance_n.max(norm(unbalanced));
        self.imbalance_n2 += dot(unbalanced, unbalanced);
        self.step_error_n2 += norm(unbalanced).min(health.approximations_apart_n).powi(2);
        self.peak_n = self.peak_n.max(norm(prediction.force_n));
    }

    /// Stores the targets of every answer, and from time to time the whole field.
    fn observe(&mut self, twin: &Twin, answer: &Answer) {
        let (time_s, depth_m) = (answer.time_s, answer.depth_m);
        if !self.run.target_names.is_empty() {
            let mut positions = Vec::with_capacity(self.run.target_names.len());
            twin.target_positions(&mut positions);
            self.run.targets.push(TargetRow { time_s, depth_m, positions });
        }
        let due = match self.run.snapshots.last() {
            // tolerance, since stamps are not exact
            Some(last) => time_s - last.time_s >= (1.0 - 1e-6) * self.snapshot_interval_s,
            None => true,
        };
        if self.keep.fields && due {
            self.snapshot(twin, time_s, depth_m);
        }
    }

    fn snapshot(&mut self, twin: &Twin, time_s: f64, depth_m: f64) {
        let mut snapshot = Snapshot { time_s, depth_m, ..Snapshot::default() };
        twin.displacements(&mut snapshot.displacement);
        twin.jacobian(&mut snapshot.jacobian);
        let mut shape = Vec::new();
        twin.needle_shape(&mut shape);
        snapshot.needle = shape.into_iter().map(|pose| pose.tip).collect();
        self.run.snapshots.push(snapshot);
        if self.keep.save_every_s.is_none() && self.run.snapshots.len() > MOST_SNAPSHOTS {
            let mut index = 0;
            self.run.snapshots.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.snapshot_interval_s *= 2.0;
        }
    }

    /// Counts a pose that the twin refused. The run reports their number and the first reason.
    pub(crate) fn refused(&mut self, reason: &str) {
        self.refused += 1;
        if self.refused == 1 {
            reason.clone_into(&mut self.first_refusal);
        }
    }

    /// Notes that a pose had no answer because the model had diverged. The run reports the first reason.
    pub(crate) fn diverged(&mut self, reason: String) {
        self.unanswered += 1;
        self.run.diverged.get_or_insert(reason);
    }

    /// Notes that an answer came later than the next pose.
    pub(crate) const fn missed_deadline(&mut self) {
        self.run.missed_deadlines += 1;
    }

    /// Notes a loss of data.
    pub(crate) fn lost(&mut self, what: String) {
        self.run.losses.push(what);
    }

    /// Sets the source of the measured force.
    pub(crate) fn measured_source(&mut self, what: &str) {
        what.clone_into(&mut self.run.measured_source);
    }

    /// The run so far.
    #[must_use]
    pub(crate) const fn run(&self) -> &Run {
        &self.run
    }

    /// Ends the run: final field, checksum, health over the whole of it.
    #[must_use]
    pub(crate) fn finish(mut self, twin: &Twin) -> Run {
        if self.refused > 0 {
            self.run
                .losses
                .push(format!("{} of the poses refused and left out; the first {}", self.refused, self.first_refusal));
        }
        if self.unanswered > 1 {
            self.run.losses.push(format!("{} poses without an answer since the model diverged", self.unanswered));
        }
        self.run.recoveries = twin.recoveries();
        self.run.repaired_supports = twin.repaired_supports();
        self.finish_health();
        let mut displacement = Vec::new();
        twin.displacements(&mut displacement);
        for component in displacement.iter().flatten() {
            self.hash.update(&component.to_le_bytes());
        }
        self.run.checksum = format!("{:032x}", self.hash.digest128());
        if self.keep.fields {
            self.finish_fields(twin, displacement);
        }
        self.run
    }

    fn finish_health(&mut self) {
        let peak = self.run.answers.iter().map(|a| a.predicted_n.abs()).fold(0.0, f64::max);
        let loaded = self.run.answers.iter().zip(&self.energy_ratio);
        self.run.max_kinetic_to_strain_energy = loaded
            .filter(|(a, _)| a.predicted_n.abs() >= Health::LOADED * peak)
            .map(|(_, ratio)| *ratio)
            .fold(0.0, f64::max);
        if self.peak_n > 0.0 {
            let rms = |squares: f64| (squares / self.run.answers.len() as f64).sqrt() / self.peak_n;
            self.run.force_imbalance = self.imbalance_n / self.peak_n;
            self.run.force_imbalance_rms = rms(self.imbalance_n2);
            self.run.step_error_rms = Some(rms(self.step_error_n2));
        }
    }

    fn finish_fields(&mut self, twin: &Twin, displacement: Vec<[f64; 3]>) {
        if let Some(last) = self.run.answers.last().copied()
            && self.run.snapshots.last().is_none_or(|snapshot| snapshot.time_s < last.time_s)
        {
            self.snapshot(twin, last.time_s, last.depth_m);
        }
        let mut state = FinalState {
            points: twin.reference_points().to_vec(),
            cells: twin.cells().to_vec(),
            region: twin.cell_regions().to_vec(),
            surface: twin.surface().to_vec(),
            displacement,
            ..FinalState::default()
        };
        twin.jacobian_and_stress(&mut state.jacobian, &mut state.von_mises_pa);
        self.run.final_state = state;
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}
