//! Checks units, signs and sizes of a recording against the scene, before any time is spent on a fit.
//!
//! The checks: the depth against the sample's height; the signs of both during the insertion, in which force and
//! depth rise together; the size of the force against that of a coarse run of the model through the first
//! millimetres. A modulus may be wrong by a factor of ten, a unit by a factor of a thousand. Factors in between are
//! left to the fit.

use super::coarse::{POSES, coarse};
use super::placement::{misplaced, never_touched, turned, unreached};
use super::rows::Rows;
use needle_core::scene::{Preset, Scene};
use needle_core::twin::{StampedPose, Twin};
use needle_recording::{At, ForceSeries, Reading, Recording};

/// Possible units of positions and forces, in m and N, with a penalty (a natural logarithm) for unlikely ones.
const LENGTHS: [(&str, f64, f64); 4] =
    [("mm", 1e-3, 0.0), ("cm", 1e-2, 1.2), ("um", 1e-6, 0.0), ("inches", 0.0254, 1.2)];
const FORCES: [(&str, f64, f64); 6] = [
    ("mN", 1e-3, 0.0),
    ("kN", 1e3, 0.0),
    ("uN", 1e-6, 0.0),
    ("gram-force", 9.80665e-3, 1.2),
    ("kilogram-force", 9.80665, 1.2),
    ("pound-force", 4.448_221_615, 1.2),
];
/// Possible units of moduli, Pa, and shear moduli of soft matter: none is below the first limit, and few below the
/// second.
const PRESSURES: [(&str, f64); 3] = [("kPa", 1e3), ("MPa", 1e6), ("GPa", 1e9)];
const TOO_SOFT_PA: f64 = 20.0;
const SOFT_PA: f64 = 200.0;
/// Penalty for the assumption that the recording belongs to another scene.
const OTHER_SCENE: f64 = 0.5;
/// Depths beyond the model's reach by this factor indicate another unit.
const TOO_DEEP: f64 = 3.0;
/// A factor of the force that a wrong modulus does not explain.
const TOO_FAR: f64 = 60.0;
/// Correlation of force and depth above which the sign is reliable.
const CLEAR: f64 = 0.5;
/// Share of the height that the coarse run covers.
const PROBE: f64 = 0.2;
/// Poses at the end of the coarse run for the tissue to reach equilibrium.
const RESTING: u32 = 4;
/// Fewest readings for the checks.
const LEAST: usize = 64;
/// Share of the readings at either end of the range that may be outliers.
const NONSENSE: f64 = 0.01;
/// Distance of a count from a whole number by rounding, and way in counts above which numbers may be counts.
const WHOLE: f64 = 1e-5;
const MANY_COUNTS: f64 = 100.0;
/// A load cell whose reading without load is above this share of the tissue's force must be given its zero.
const UNTARED: f64 = 0.25;
/// The tissue's force is clear above this multiple of the noise, and the fewest readings that show a zero.
const CLEAR_LOAD: f64 = 10.0;
const LEAST_IDLE: usize = 8;

/// Depth and axial force of the readings that have a force, in order of time.
pub(super) fn pairs(twin: &Twin, readings: &[Reading], measured: &ForceSeries) -> Vec<(f64, f64)> {
    let axial = |reading: &Reading| {
        let (depth, axis) = match reading.at {
            At::Depth(depth) => (depth, twin.pose_at_depth(0.0).axis),
            At::Pose(pose) => (twin.depth_of(&pose), pose.axis),
        };
        let force = measured.at(reading.time_s)?;
        Some((depth, -(0..3).map(|k| force[k] * axis[k]).sum::<f64>()))
    };
    readings.iter().filter_map(axial).filter(|(d, f)| d.is_finite() && f.is_finite()).collect()
}

/// Reports a mistake in units, signs or scene of a recording with its likely cause; `None` if there is none. `told` is
/// the recording, for the scene that it was made for and the numbers that its position sensor showed.
#[must_use]
pub fn mistaken(twin: &Twin, readings: &[Reading], measured: &ForceSeries, told: Option<&Recording>) -> Option<String> {
    let all: Vec<f64> = readings.iter().map(|r| depth(twin, r)).filter(|d| d.is_finite()).collect();
    if all.len() < LEAST {
        return None;
    }
    if let Some(fault) = misplaced(twin, readings) {
        return Some(fault);
    }
    let by_depth = readings.iter().all(|r| matches!(r.at, At::Depth(_)));
    let numbers = Numbers::of(told.filter(|_| by_depth));
    let [shallow, deep] = ends(&all);
    let room = TOO_DEEP * twin.reach_m().max(twin.height_m());
    if deep - shallow > room {
        return Some(position_unit(twin, &all, numbers));
    }
    // a way that fits, far from the sample, or through its bottom and never out of it
    let in_place = twin.scene().motion.is_some_and(|motion| motion.start_depth.get() > 0.0);
    let through = deep > twin.height_m() && shallow > deep - shallow && !in_place;
    let away = || (deep.max(-shallow) > room || through).then(|| elsewhere(twin, shallow, deep, by_depth));
    let pairs = pairs(twin, readings, measured);
    if pairs.len() < LEAST {
        return away();
    }
    let shown = |contact_m: f64| told.map(|_| contact_m / numbers.m + numbers.zero);
    let untouched =
        || unreached(twin, readings, measured).map(|found| never_touched(found, by_depth, shown(found.contact_m)));
    let sign = turned(twin, readings, measured)
        .or_else(|| position_sign(&pairs, shallow, deep))
        .or_else(|| force_sign(&pairs));
    let named = told.and_then(|told| told.scene.as_deref());
    sign.or_else(untouched).or_else(away).or_else(|| size(twin, &pairs, deep, named))
}

/// Reports a load cell whose reading without load is large beside what the tissue adds: the weight of a tool, or a
/// zero that was never set. A fit finds it; a comparison as recorded says nothing then.
#[must_use]
pub fn untared(twin: &Twin, readings: &[Reading], measured: &ForceSeries) -> Option<String> {
    let of = |r: &Reading| Some((depth(twin, r), measured.at(r.time_s)?));
    let rows: Vec<(f64, [f64; 3])> = readings.iter().filter_map(of).filter(|(d, _)| d.is_finite()).collect();
    // half of the way to the first contact: its place is not known well
    let idle = rows.iter().position(|r| r.0 > 0.0)?.div_ceil(2);
    if rows.len() < LEAST || idle < LEAST_IDLE {
        return None;
    }
    let zero: [f64; 3] = std::array::from_fn(|k| median(rows[..idle].iter().map(|r| r.1[k])));
    let without = |f: &[f64; 3]| (0..3).map(|k| (f[k] - zero[k]).powi(2)).sum::<f64>().sqrt();
    let [_, signal] = ends(&rows.iter().map(|r| without(&r.1)).collect::<Vec<_>>());
    let noise = median(rows[..idle].iter().map(|r| without(&r.1)));
    let size = without(&[0.0; 3]);
    (size > UNTARED * signal && signal > CLEAR_LOAD * noise).then(|| {
        let [x, y, z] = zero;
        let shown = if x == 0.0 && y == 0.0 { format!("{z:.4} N") } else { format!("{x:.4},{y:.4},{z:.4} N in the sample's frame") };
        format!(
            "before the contact the load cell reads {shown}, and the tissue adds up to {signal:.4} N: the weight of a tool, or a zero that \
             was not set; give what it reads there, in its own unit and axes, with --force-zero"
        )
    })
}

fn median(of: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = of.collect();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

fn depth(twin: &Twin, reading: &Reading) -> f64 {
    match reading.at {
        At::Depth(depth) => depth,
        At::Pose(pose) => twin.depth_of(&pose),
    }
}

/// Least and largest value without outliers.
fn ends(values: &[f64]) -> [f64; 2] {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let off = ((sorted.len() as f64 * NONSENSE) as usize).max(1);
    [sorted[off], sorted[sorted.len() - 1 - off]]
}

/// The numbers that a position sensor showed: (number - zero) m = depth in m.
#[derive(Clone, Copy)]
struct Numbers {
    m: f64,
    zero: f64,
}

impl Numbers {
    fn of(told: Option<&Recording>) -> Self {
        let [m, zero] = told.map_or([1.0, 0.0], |told| told.position_scale);
        Self { m, zero }
    }

    /// Whether all are whole, as an encoder counts.
    fn are_counts(self, depths: &[f64]) -> bool {
        let off = |d: &f64| {
            let number = d / self.m + self.zero;
            (number - number.round()).abs()
        };
        depths.iter().all(|d| off(d) < WHOLE)
    }
}

/// The likely unit of positions over too long a way.
fn position_unit(twin: &Twin, depths: &[f64], numbers: Numbers) -> String {
    let [shallow, deep] = ends(depths);
    // what lies above the surface takes no room in the sample
    let way = if deep > 0.0 { deep.min(deep - shallow) } else { deep - shallow } / numbers.m.abs();
    let usual = twin.scene().motion.map_or(0.5 * twin.reach_m(), |m| m.depth.get());
    let likely = LENGTHS.iter().filter(|(_, m, _)| way * m <= twin.reach_m());
    let score = |(_, m, penalty): &(&str, f64, f64)| (way * m / usual).ln().abs() + penalty;
    let likely = likely.min_by(|a, b| score(a).total_cmp(&score(b)));
    let unit = likely.map(|(name, m, _)| {
        let word = if *name == "inches" { "in" } else { name };
        (format!("in {name} (then {:.4} m)", way * m), format!("--position-unit {word}"))
    });
    let counts = "one count's length, as --position-unit mm --position-scale 0.001 of 1000 counts per mm, and the count at first contact \
                  with --position-zero";
    let known = LENGTHS.iter().map(|(_, m, _)| *m).chain([1.0, 1e-9]).any(|m| (numbers.m.abs() / m - 1.0).abs() < 1e-9);
    let remedy = match unit {
        _ if !known => "look at --position-scale and --position-unit".to_owned(),
        Some((what, option)) if numbers.are_counts(depths) && way > MANY_COUNTS => {
            format!("its numbers are whole, as of an encoder: give {counts}; or they are {what}: give {option}")
        }
        None if numbers.are_counts(depths) => format!("its numbers are whole, as of an encoder: give {counts}"),
        Some((what, option)) => {
            format!(
                "the position is likely {what}: give {option}, --position-scale if it is counted by an encoder, or the right scene"
            )
        }
        None => {
            "no unit of length makes it fit: give --position-scale if it is counted by an encoder, or the right scene"
                .to_owned()
        }
    };
    format!(
        "the recorded depth goes over {:.4} m, and the sample is {:.4} m high: {remedy}",
        deep - shallow,
        twin.height_m()
    )
}

/// A way that fits the sample, in another place.
fn elsewhere(twin: &Twin, shallow: f64, deep: f64, by_depth: bool) -> String {
    let remedy = if by_depth {
        "the displacement sensor's zero is elsewhere; give its reading at first contact with --position-zero"
    } else {
        "the frame of the poses is another, as with its origin at the top; give the sample's pose in it with --sample-pose \
         X,Y,Z,QX,QY,QZ,QW (the centre of the sample's bottom face, z up)"
    };
    format!(
        "the recorded depth goes from {shallow:.4} to {deep:.4} m, and the sample is {:.4} m high: {remedy}",
        twin.height_m()
    )
}

/// Correlation of two columns; 0 if one is constant.
fn correlation(pairs: &[(f64, f64)]) -> f64 {
    let n = pairs.len() as f64;
    let (a, b) = (pairs.iter().map(|p| p.0).sum::<f64>() / n, pairs.iter().map(|p| p.1).sum::<f64>() / n);
    let sum = |f: &dyn Fn(&(f64, f64)) -> f64| pairs.iter().map(f).sum::<f64>();
    let (aa, bb) = (sum(&|p| (p.0 - a).powi(2)), sum(&|p| (p.1 - b).powi(2)));
    let both = (aa * bb).sqrt();
    if both > 0.0 { sum(&|p| (p.0 - a) * (p.1 - b)) / both } else { 0.0 }
}

/// Reading of the load cell before contact: at the start of a recording.
fn zero(pairs: &[(f64, f64)]) -> f64 {
    let mut first: Vec<f64> = pairs[..(pairs.len() / 50).max(5)].iter().map(|p| p.1).collect();
    first.sort_unstable_by(f64::total_cmp);
    first[first.len() / 2]
}

fn position_sign(pairs: &[(f64, f64)], shallow: f64, deep: f64) -> Option<String> {
    let zero = zero(pairs);
    let sizes: Vec<(f64, f64)> = pairs.iter().map(|(d, f)| (*d, (f - zero).abs())).collect();
    let turned = correlation(&sizes) < -CLEAR && -shallow > deep.max(0.0);
    turned.then(|| {
        format!(
            "the force is largest where the recorded depth is least ({:.4} m, above the sample): the sign of the position is likely \
             turned round (--position-sign -1): depth is positive into the sample",
            shallow
        )
    })
}

/// The insertion, up to the deepest reading.
pub(super) fn way_in(pairs: &[(f64, f64)]) -> &[(f64, f64)] {
    let deepest = pairs.iter().enumerate().max_by(|a, b| a.1.0.total_cmp(&b.1.0)).map_or(0, |d| d.0);
    &pairs[..=deepest]
}

fn force_sign(pairs: &[(f64, f64)]) -> Option<String> {
    let (zero, way) = (zero(pairs), way_in(pairs));
    let last = way.last()?.1 - zero;
    (way.len() >= LEAST && correlation(way) < -CLEAR && last < 0.0).then(|| {
        format!(
            "the measured force falls to {last:.4} N while the instrument goes in: the sign of the force is likely turned round \
             (--force-sign -1): it is that of the tissue on the instrument, in frame sample, and resists insertion with a positive z"
        )
    })
}

/// Predicted force at the end of a coarse insertion to a depth, N, from the undeformed state.
fn probe(twin: &Twin, depth_m: f64) -> Option<f64> {
    let mut double = coarse(twin);
    let mut force = None;
    for k in 1..=POSES + RESTING {
        let depth = depth_m * f64::from(k.min(POSES)) / f64::from(POSES);
        let pose = StampedPose { time_s: f64::from(k), pose: double.pose_at_depth(depth) };
        let answer = double.step(pose).ok()?;
        force = Some(-(0..3).map(|i| answer.force_n[i] * pose.pose.axis[i]).sum::<f64>());
    }
    force.filter(|f| f.is_finite())
}

/// Median of the measured forces near a depth during the insertion, N.
fn measured_at(pairs: &[(f64, f64)], depth_m: f64) -> Option<f64> {
    let zero = zero(pairs);
    let near = |d: f64| (0.9..=1.1).contains(&(d / depth_m));
    let mut forces: Vec<f64> = way_in(pairs).iter().filter(|p| near(p.0)).map(|p| p.1 - zero).collect();
    forces.sort_unstable_by(f64::total_cmp);
    (forces.len() >= 5).then(|| forces[forces.len() / 2])
}

/// Standard deviation of a reading's noise from second differences, N.
pub(super) fn noise(pairs: &[(f64, f64)]) -> f64 {
    let mut seconds: Vec<f64> = pairs.windows(3).map(|w| (w[0].1 - 2.0 * w[1].1 + w[2].1).abs()).collect();
    seconds.sort_unstable_by(f64::total_cmp);
    seconds[seconds.len() / 2] / (0.6745 * 6f64.sqrt())
}

/// Reports a mistake in unit or sign of the forces so far in a live run, with the likely cause.
#[must_use]
pub fn glance(rows: &Rows) -> Option<String> {
    let loaded = rows.loaded(0.02);
    let sum = |f: &dyn Fn(usize) -> f64| loaded.iter().map(|&i| f(i)).sum::<f64>();
    let (p, m) = (|i: usize| rows.predicted_n[i], |i: usize| rows.measured_n[i]);
    let (pp, mm, pm) = (sum(&|i| p(i) * p(i)), sum(&|i| m(i) * m(i)), sum(&|i| p(i) * m(i)));
    let ratio = pm / pp;
    // noise alone has neither size nor sign
    if !ratio.is_finite() || pm.abs() < CLEAR * (pp * mm).sqrt() {
        return None;
    }
    if ratio < 0.0 {
        return Some(
            "the measured force has the other sign than the predicted one: the sign of the force is likely turned round: it is that \
             of the tissue on the instrument, and resists insertion with a positive z"
                .to_owned(),
        );
    }
    let far = !(1.0 / TOO_FAR..=TOO_FAR).contains(&ratio);
    far.then(|| {
        let (unit, off) = unit_of(ratio);
        let likely = if off < TOO_FAR.ln() { format!("the force is likely in {unit}") } else { "look at scene and load cell".to_owned() };
        format!("the measured force is {ratio:.2e} times the predicted one: {likely}, or the scene is another one: it must be in N")
    })
}

fn size(twin: &Twin, pairs: &[(f64, f64)], deep: f64, named: Option<&str>) -> Option<String> {
    let at = deep.min(PROBE * twin.height_m()).min(0.9 * twin.reach_m());
    let measured = measured_at(pairs, 0.9 * at).filter(|_| at > 0.0)?;
    if measured < 5.0 * noise(pairs) {
        return None;
    }
    let predicted = probe(twin, 0.9 * at).filter(|f| *f > 0.0)?;
    let ratio = measured / predicted;
    if (1.0 / TOO_FAR..=TOO_FAR).contains(&ratio) {
        return None;
    }
    Some(format!(
        "at a depth of {:.2} mm the load cell reads {measured:.3e} N where this scene's model has {predicted:.3e} N, {ratio:.2e} times as \
         much: {}",
        0.9e3 * at,
        likely(twin, ratio, measured, 0.9 * at, named)
    ))
}

/// Likely unit of a force that is `ratio` times too large, and the remaining deviation with that unit.
#[must_use]
pub(crate) fn unit_of(ratio: f64) -> (&'static str, f64) {
    let score = |(_, n, penalty): &(&str, f64, f64)| (ratio * n).ln().abs() + penalty;
    let best = FORCES.iter().min_by(|a, b| score(a).total_cmp(&score(b)));
    best.map_or(("", f64::INFINITY), |unit| (unit.0, score(unit)))
}

/// Likely unit of the scene's modulus, for a material `ratio` times as stiff; `None` if it may well be in Pa.
fn modulus_unit(scene: &Scene, ratio: f64) -> Option<String> {
    let modulus = scene.material.shear_modulus();
    let off = |unit: f64| (ratio / unit).ln().abs();
    let (name, unit) = PRESSURES.into_iter().min_by(|a, b| off(a.1).total_cmp(&off(b.1)))?;
    let own = "material.shear_modulus_pa";
    let key = if scene.get(own).is_some() { own } else { "the shear modulus of [material]" };
    (modulus < SOFT_PA && off(unit) < TOO_FAR.ln()).then(|| {
        format!("{key} = {modulus} Pa is likely meant in {name}: it must be in Pa (then {:.4})", modulus * unit)
    })
}

/// Unit or scene for which the force would fit best.
fn likely(twin: &Twin, ratio: f64, measured: f64, depth_m: f64, named: Option<&str>) -> String {
    let own = &twin.scene().name;
    if let Some(named) = named.filter(|named| named != own) {
        return format!("the recording says that it was made for scene {named}, not {own}: give --scene {named}");
    }
    let off = |name: &str| {
        let other = Twin::new(&Scene::preset(name).ok()?).ok()?;
        let predicted = probe(&other, depth_m).filter(|f| *f > 0.0)?;
        Some((name.to_owned(), (measured / predicted).ln().abs() + OTHER_SCENE))
    };
    let modulus = modulus_unit(twin.scene(), ratio);
    if let Some(modulus) = modulus.as_ref().filter(|_| twin.scene().material.shear_modulus() < TOO_SOFT_PA) {
        return modulus.clone();
    }
    let scenes = Preset::of_the_paper().iter().map(|p| p.name).filter(|name| name != own).filter_map(off);
    let scene = scenes.min_by(|a, b| a.1.total_cmp(&b.1));
    let (unit, far) = unit_of(ratio);
    match scene {
        Some((name, scene_far)) if scene_far < far && scene_far < TOO_FAR.ln() => {
            format!("the recording is likely one of scene {name}, not {own}: give --scene {name}")
        }
        _ if far < TOO_FAR.ln() => match modulus {
            Some(modulus) => format!("either the force is in {unit}, and must be in N, or {modulus}"),
            None => format!("the force is likely in {unit}: it must be in N"),
        },
        _ => "no usual unit or preset explains it: look at scene and load cell".to_owned(),
    }
}
