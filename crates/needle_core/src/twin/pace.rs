//! How many explicit steps a pose is worth.
//!
//! The inertial error of the force falls with the travel per step. Relative to the force it is about
//! travel / (omega L) with omega the slowest frequency (rad per step) and L the distance over which the force changes
//! by its own size: that gives the steps that the tolerance asks for. What inertia adds is then taken out of the force, and
//! the error estimate that remains (see `solver::inertia`) says whether the steps were enough; so does, less strictly, the gap
//! between the forces on instrument and base, which grows with the lag of the tissue. The next pose gets more steps while they are
//! too large, and fewer when they are not. Where tissue slips, the force may change faster than over L ([`CHANGE_OF_SLIP`]). The start
//! of a motion is an impulse, so it begins with the most steps. So is a turn into a direction whose tangent motion the solver has not
//! learnt yet (`State::unpredicted`), which neither estimate sees: both compare with what was learnt. A resting instrument gets steps until
//! the gap has closed and the tissue stands still, and then none.
//!
//! Forces alone don't tell that it stands still: where cells were crushed, single nodes come back after force and smooth field have. Per
//! relaxation time 1/omega a mode of amplitude u goes the way q/omega, and has the energies T = m q^2/2 and W = m omega^2 u^2/2. So
//!
//! ```text
//! sqrt(T / W) = (q / omega) / u
//! ```
//!
//! is the way still made in that time over that made so far, the body's displacements weighed by their energy.

use crate::instrument::Resistance;
use crate::scene::{Dimension, InstrumentKind, Scene, Stepping};
use mtled::solver::Balance;

use super::health::Health;

/// L over the height of the sample, times the ratio of measured to estimated error (the estimate is an upper bound).
const LENGTH: f64 = 2.0;
/// Forces below this share of mu H^2 are judged as if they were as large: near zero a relative error means nothing. Under a small indenter it
/// is that share of mu H 8 a, the force of a rigid disc of radius a that is pressed into an incompressible half space by this share of H
/// (8 mu a d; Sneddon, Int. J. Engng Sci. 3:47, 1965).
const FORCE_FLOOR: f64 = 0.01;
/// The same for a needle, whose forces are those of a thin rod, and the diameters of a needle that count as the width of what it moves: with both
/// it is the force of the disc at 1.25 times that share. A needle with friction is judged by no more than what it meets on its first radii.
const FORCE_FLOOR_OF_NEEDLE: f64 = 0.0025;
const WIDTH_OF_NEEDLE: f64 = 20.0;
/// Steps of one relaxation towards equilibrium at rest, over 1/omega.
const RELAXATION: f64 = 0.5;
/// Relative stress relaxation, over what the tolerance allows, from which a resting instrument gets further steps.
const PATIENCE: f64 = 0.1;
/// The error or motion, over what the tolerance allows, at which a resting instrument needs no more steps.
const QUIET: f64 = 0.1;
/// Share of a former error that is still counted after a pose.
const FADE: f64 = 0.7;
/// Largest factor on the steps that the tolerance asks for, and on the one step that a moving instrument takes at least.
const LARGEST_BOOST: f64 = 16.0;
/// Least and largest change of the factor from one pose to the next; and the least for a needle with friction in space, whose front meets a layer
/// of nodes every R/2: what that asks for need not last until the next layer.
const BOOST: [f64; 2] = [0.9, 1.2];
const FALL_IN_SPACE: f64 = 0.6;
/// Steps for a way that the tissue does not go along with at once, over those that the tolerance asks for; and the largest factor for it. With
/// 20 and 16 the first forces of an indenter at 5 mm/s were two to five times those at rest (`docs/lab/performance.md`).
const IMPULSE: [f64; 2] = [80.0, 64.0];
/// The same where a small part of the way is new, as that aside of a tilted needle, and of a needle with friction, which comes to rest at each
/// pose; and the parts of the way between which it rises to [`IMPULSE`].
const PARTIAL_IMPULSE: [f64; 2] = [20.0, 16.0];
const NEW_PART: [f64; 2] = [0.25, 0.5];
/// Gap between the forces on instrument and base that a moving instrument may have, over what the tolerance allows the force.
const LAG: f64 = 6.0;
/// The same for a needle that holds tissue of several regions in a half plane. In front of a stiffer region the force lagged by 4 %.
const LAG_BETWEEN_REGIONS: f64 = 3.0;
/// The same where tissue slips along a needle: how far it lags decides about what slips.
const LAG_OF_SLIP: f64 = 1.0;
/// Where tissue slips along a needle, the force changes over the way on which slip spreads, some f/K, and not over the height; what sticks
/// lags, and no inertia in the sum of forces tells. So the change of the force at the last pose, times this, over n omega is the error that n
/// steps leave. This is of half planes: in space, where the path's layers are coarser, more steps do not change the error (`docs/lab/friction.md`).
const CHANGE_OF_SLIP: f64 = 0.9;
/// In space, where a step costs more, a needle with friction is judged by its largest force, and forces below that which it meets on its first
/// radii as if they were as large.
const FIRST_RADII: f64 = 2.0;
/// The same for the balance at the end of a pose, at most this over the largest force so far: the verdict asks for a balance over that.
const AHEAD: f64 = 20.0;
/// Imbalance that ends a pose of a needle with friction, over the scene's accuracy; kinetic over strain energy, over what [`Health`] takes.
const SETTLED: f64 = 1.5;
const SETTLED_ENERGIES: f64 = 0.75;
/// Imbalance from which a kinematic needle gets further steps at a pose, over what the tolerance allows of the largest force so far, and over the
/// usual imbalance: a motion that is smooth is not stopped at each pose.
const STRUCK: f64 = 2.5;
/// Forces below so many times the floor have no blows that are worth a step.
const FAINT: f64 = 4.0;
/// Factor by which the usual imbalance follows that of a pose at most, so that it is a median of the last ones.
const FOLLOWS: f64 = 1.05;
/// Steps after stress relaxation at rest, in which fast pressure waves restore the balance of volume.
const SETTLING: u32 = 4;

/// Pace of one scene.
#[derive(Clone, Debug)]
pub(super) struct Pace {
    stepping: Stepping,
    /// Tolerated relative error of the force from too few steps.
    tolerance: f64,
    /// Imbalance over the peak at which a pose of a needle with friction ends.
    settled: f64,
    /// Travel per step that keeps the tolerance, over omega, m.
    length: f64,
    force_floor: f64,
    /// Force by which the steps of a needle with friction in space are judged at least, N; 0 for others, and in a half plane.
    resistance: f64,
    /// Strain energy below which motions are judged as if it were as large, J: what [`FORCE_FLOOR`] stores in a body of stiffness mu H.
    energy_floor: f64,
    peak: f64,
    /// |force on the instrument + force on the base| over the peak force, at the last pose.
    pub imbalance: f64,
    /// The force's present error over what the tolerance allows, estimated.
    gap: f64,
    /// The larger of that and of the tissue's motion (see the module), over what the tolerance allows, with an exponentially decaying
    /// maximum: an oscillating gap is not closed when it passes through zero.
    unsettled: f64,
    /// Factor on the steps that the tolerance asks for, 1 or more.
    boost: f64,
    /// [`BOOST`] of the scene.
    change_of_boost: [f64; 2],
    /// [`IMPULSE`] of the scene.
    impulse: [f64; 2],
    /// [`LAG`] of the scene.
    lag: f64,
    /// [`CHANGE_OF_SLIP`], or zero.
    lags_by: f64,
    /// Force on the instrument at the last pose, N.
    force: [f64; 3],
    /// How far that was from the one before, N.
    change: f64,
    /// |force on the instrument + force on the base| at the last poses of a motion, before further steps, N.
    usual: f64,
    /// Most steps that there is time for.
    pub limit: u32,
    /// Relative stress relaxation since the last step.
    pending: f64,
}

impl Pace {
    /// `height`: of the sample, m.
    pub(crate) fn new(scene: &Scene, height: f64) -> Self {
        let slips = scene.instrument.is_some_and(|i| i.is_frictional());
        let needle = matches!(scene.instrument, Some(i) if matches!(i.kind, InstrumentKind::Needle(_)));
        let width = match scene.instrument.map(|i| i.kind) {
            Some(InstrumentKind::Indenter { diameter, .. }) => height.min(4.0 * diameter.get()),
            _ => height,
        };
        let mu = scene.material.shear_modulus();
        let in_plane = scene.dimension().dimension == Dimension::Axisymmetric;
        let in_space = slips && !in_plane;
        let force_floor = match scene.instrument.and_then(|i| i.needle_diameter_m()) {
            Some(diameter) => FORCE_FLOOR_OF_NEEDLE * mu * height * height.min(WIDTH_OF_NEEDLE * diameter),
            None => FORCE_FLOOR * mu * height * width,
        };
        let resistance = if slips { resistance(scene) } else { f64::INFINITY };
        Self {
            stepping: scene.stepping,
            tolerance: scene.tolerance(),
            settled: SETTLED * scene.accuracy,
            length: LENGTH * width,
            // a needle that nothing resists keeps the floor
            force_floor: if resistance > 0.0 { force_floor.min(resistance) } else { force_floor },
            resistance: if in_space { resistance } else { 0.0 },
            energy_floor: 0.5 * FORCE_FLOOR * FORCE_FLOOR * mu * height * height * width,
            peak: 0.0,
            imbalance: 0.0,
            gap: 0.0,
            unsettled: 0.0,
            boost: LARGEST_BOOST,
            change_of_boost: if in_space { [FALL_IN_SPACE, BOOST[1]] } else { BOOST },
            impulse: if slips { PARTIAL_IMPULSE } else { IMPULSE },
            lag: match slips {
                true => LAG_OF_SLIP,
                false if needle && in_plane && !scene.regions.is_empty() => LAG_BETWEEN_REGIONS,
                false => LAG,
            },
            lags_by: if in_plane { CHANGE_OF_SLIP } else { 0.0 },
            force: [0.0; 3],
            change: 0.0,
            usual: 0.0,
            limit: u32::MAX,
            pending: 0.0,
        }
    }

    /// Steps for a pose that is `travel` metres from the last one, `unpredicted` of them in directions that are new to the tissue, while
    /// relaxation has changed the stress by the share `relaxed`. `slips`: tissue may slip along the instrument.
    pub fn steps(&mut self, travel: f64, unpredicted: f64, slowest: f64, relaxed: f64, slips: bool) -> u32 {
        let s = &self.stepping;
        self.pending += relaxed;
        if travel > 0.0 {
            let unit = self.tolerance * slowest * self.length;
            let wanted = (travel / unit).max(1.0);
            let [none, all] = NEW_PART;
            let part = ((unpredicted / travel - none) / (all - none)).clamp(0.0, 1.0);
            let [impulse, largest] =
                std::array::from_fn(|k| PARTIAL_IMPULSE[k] + part * (self.impulse[k] - PARTIAL_IMPULSE[k]));
            let boost = self.boost.max((impulse * unpredicted / (unit * wanted)).min(largest));
            let size = self.peak.max(self.force_floor).max(self.resistance);
            let lags_by = if slips { self.lags_by } else { 0.0 };
            let lag = lags_by * self.change / (self.tolerance * slowest * size);
            return ((boost * wanted).max(lag).ceil() as u32).max(s.min_steps_per_pose).min(self.most());
        }
        if self.unsettled >= QUIET {
            return ((RELAXATION / slowest).ceil() as u32).min(self.most());
        }
        // relaxation of one material everywhere changes forces, and hardly displacements
        if self.pending > PATIENCE * self.tolerance { SETTLING.min(self.most()) } else { 0 }
    }

    /// Most steps that a pose may cost.
    pub(crate) fn most(&self) -> u32 {
        self.stepping.max_steps_per_pose.min(self.limit).max(1)
    }

    /// Learns from the balance after a pose.
    pub(crate) fn judge(&mut self, balance: &Balance, moving: bool) {
        self.pending = 0.0;
        let force = norm(balance.instrument);
        self.peak = self.peak.max(force);
        self.change = norm(std::array::from_fn(|k| balance.instrument[k] - self.force[k]));
        self.force = balance.instrument;
        self.note(balance);
        if moving {
            let present = unbalanced(balance);
            let range = [self.usual / FOLLOWS, self.usual * FOLLOWS];
            self.usual = if self.usual > 0.0 { present.clamp(range[0], range[1]) } else { present };
        }
        let gap = if moving { balance.gap / self.lag } else { balance.gap };
        let error = balance.error_estimate.max(gap);
        let size = if self.resistance > 0.0 { self.peak.max(self.resistance) } else { force };
        self.gap = error / (self.tolerance * size.max(self.force_floor));
        let motion = (balance.kinetic / balance.strain.max(self.energy_floor)).sqrt() / self.tolerance;
        self.unsettled = self.gap.max(motion).max(FADE * self.unsettled);
        let [least, largest] = self.change_of_boost;
        self.boost = (self.boost * self.gap.sqrt().clamp(least, largest)).clamp(1.0, LARGEST_BOOST);
    }

    /// Takes over the imbalance after further steps at the same pose.
    pub(crate) fn note(&mut self, balance: &Balance) {
        self.imbalance = if self.peak > 0.0 { unbalanced(balance) / self.peak } else { 0.0 };
    }

    /// Takes over the force after a fall that was followed to rest: it says nothing of how the force goes on.
    pub(crate) fn follow(&mut self, balance: &Balance) {
        (self.force, self.change) = (balance.instrument, 0.0);
    }

    /// Whether the tissue is near enough to rest for the pose to be answered. What slips and what is cut is not undone by the poses that
    /// follow, so a needle with friction does not leave a pose before. `energies`: kinetic over strain energy.
    pub(crate) fn is_settled(&self, balance: &Balance, energies: f64) -> bool {
        let force = norm(balance.instrument);
        let size = self.peak.max(force);
        let size = size.max(self.force_floor).max(self.resistance.min(AHEAD * size));
        let rests = energies <= SETTLED_ENERGIES * Health::MOST_KINETIC;
        unbalanced(balance) <= self.settled * size && (rests || force < Health::LOADED * self.peak)
    }

    /// Whether the tissue of a kinematic needle has been thrown out of balance (see [`super::struck`]).
    pub(crate) fn is_struck(&self, balance: &Balance) -> bool {
        let size = self.peak.max(FAINT * self.force_floor);
        unbalanced(balance) > STRUCK * self.usual.max(self.tolerance * size)
    }

    /// Makes the next pose take steps even if the instrument rests: the forces of the present state are not known.
    pub(crate) fn unsettle(&mut self) {
        self.unsettled = 1.0;
    }

    pub fn reset(&mut self) {
        self.peak = 0.0;
        self.imbalance = 0.0;
        self.gap = 0.0;
        (self.force, self.change, self.usual) = ([0.0; 3], 0.0, 0.0);
        self.unsettled = 0.0;
        self.boost = LARGEST_BOOST;
        self.pending = 0.0;
    }
}

/// Cutting force and friction of the first [`FIRST_RADII`] in whatever of the scene resists most, N.
fn resistance(scene: &Scene) -> f64 {
    let Some(InstrumentKind::Needle(needle)) = scene.instrument.map(|i| i.kind) else { return 0.0 };
    let way = FIRST_RADII * needle.capture_radius.get();
    let of = |region| Resistance::of(scene, region, needle.diameter.get());
    (0..=scene.regions.len() as u8).map(of).map(|r| r.cutting + way * r.friction).fold(0.0, f64::max)
}

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// |force on the instrument + force on the base|, N.
fn unbalanced(b: &Balance) -> f64 {
    norm(std::array::from_fn(|k| b.instrument[k] + b.base[k]))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Forces that balance, around tissue that moves: a resting instrument gets steps until that is over, also where no force is left.
    #[test]
    fn a_balance_of_forces_is_no_rest_while_the_tissue_moves() {
        let scene = Scene::preset("indentation").unwrap();
        let (height, slowest) = (0.017, 0.02);
        for strain in [5e-3, 0.0] {
            let mut pace = Pace::new(&scene, height);
            // per relaxation time the tissue goes twice, then half the share of its way that the tolerance lets pass
            let share = QUIET * scene.tolerance();
            let motion = |times: f64| (times * share).powi(2) * f64::max(strain, pace.energy_floor);
            let [moves, rests] =
                [2.0, 0.5].map(|times| Balance { strain, kinetic: motion(times), ..Balance::default() });
            pace.judge(&moves, false);
            assert_eq!(pace.steps(0.0, 0.0, slowest, 0.0, false), 25, "{strain}");
            (0..10).for_each(|_| pace.judge(&rests, false));
            assert_eq!(pace.steps(0.0, 0.0, slowest, 0.0, false), 0, "{strain}");
        }
    }

    /// Of a way in a new direction more, up to a bound; of a known one what the tolerance asks for.
    #[test]
    fn a_way_that_was_not_learnt_gets_more_steps() {
        let (height, slowest) = (0.017, 0.02);
        let mut pace = Pace::new(&Scene::preset("needle_insertion").unwrap(), height);
        let still = Balance { instrument: [0.0, 0.0, 1e-2], ..Balance::default() };
        let mut steps = |way: f64, unpredicted: f64| {
            (0..60).for_each(|_| pace.judge(&still, true));
            pace.steps(way, unpredicted, slowest, 0.0, false)
        };
        assert_eq!(steps(5e-6, 0.0), 1);
        assert_eq!(steps(5e-6, 1e-6), 3);
        assert_eq!(steps(5e-6, 5e-6), 59);
        assert_eq!((steps(1e-4, 0.0), steps(1e-4, 1e-4)), (15, 942));
    }
}
