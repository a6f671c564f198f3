//! Checks whether a recorded motion is in the sample's frame: the unit and the frame of poses, and the zero of a
//! depth.

use super::alignment::reach_m;
use super::coarse::{POSES, coarse};
use needle_core::scene::Dimension;
use needle_core::twin::{Pose, StampedPose, Twin};
use needle_recording::{At, ForceSeries, Reading};

/// If the tip stays farther away than this many heights or reaches of the sample, the poses are in another frame or
/// unit.
const FAR: f64 = 3.0;
/// Possible units of poses, m.
const UNITS: [(&str, f64); 4] = [("mm", 1e-3), ("um", 1e-6), ("cm", 1e-2), ("in", 0.0254)];
/// Largest share of the reach that the needle may already be inserted at the start.
const BEGUN: f64 = 0.3;
/// Number of depths at which a contact is tried.
const CONTACTS: u32 = 240;
/// Number of readings used for it.
const LOOKED_AT: usize = 400;
/// A force is significant above this multiple of its noise.
const CLEAR: f64 = 10.0;
/// Largest residual, as a share of that of a curve without a beginning, at which forces clearly begin on the way.
const KINK: f64 = 0.2;
/// Least share of the force's rise that is felt at the recorded surface if the contact is far above it.
const FELT: f64 = 0.1;
/// Smallest share of the axial force at which a lateral force on a straight insertion is refused: 19 degrees, an error
/// of 6 % of the force.
const BESIDE: f64 = 0.35;
/// Largest share of the squared forces off their common direction.
const ONE_DIRECTION: f64 = 0.01;
/// Smallest cosine of the tilt of an instrument that counts as upright.
const STRAIGHT: f64 = 0.999;
/// Cosine of the angle to the scene's axis below which an instrument does not point into the sample, and least cosine of two
/// directions that are taken for one: 78 and 37 degrees.
const ACROSS: f64 = 0.2;
const ALONG: f64 = 0.8;
/// Tolerance of a depth at the surface, as a share of the insertion: a displacement sensor's noise.
const SURFACE: f64 = 0.02;

/// Reports a wrong frame or unit of the poses, with the likely cause.
pub(super) fn misplaced(twin: &Twin, readings: &[Reading]) -> Option<String> {
    let pose = |r: &Reading| if let At::Pose(pose) = r.at { Some(pose) } else { None };
    let poses: Vec<Pose> = readings.iter().filter_map(pose).filter(|p| p.tip.iter().all(|x| x.is_finite())).collect();
    if poses.len() * 2 <= readings.len() {
        return None;
    }
    let along = twin.pose_at_depth(0.0);
    if let Some(fault) = points_elsewhere(&poses, along.axis) {
        return Some(fault);
    }
    let offset = |p: &Pose, unit: f64| -> [f64; 3] { std::array::from_fn(|k| unit * p.tip[k] - along.tip[k]) };
    let nearest = |unit: f64| poses.iter().map(|p| norm(offset(p, unit))).fold(f64::INFINITY, f64::min);
    let room = FAR * twin.reach_m().max(twin.height_m());
    if nearest(1.0) <= room {
        return beside(twin, &poses);
    }
    let fits = |&&(_, unit): &&(&str, f64)| {
        let depth = |p: &Pose| -offset(p, unit)[2];
        let deepest = poses.iter().map(depth).fold(f64::NEG_INFINITY, f64::max);
        let beside = poses.iter().map(|p| offset(p, unit)).map(|[x, y, _]| x.hypot(y)).fold(0.0, f64::max);
        let begun = poses.first().map_or(0.0, depth);
        deepest > 0.0 && deepest <= twin.reach_m().max(twin.height_m()) && begun <= BEGUN * deepest && beside <= room
    };
    if let Some((unit, m)) = UNITS.iter().find(fits) {
        let heights = poses.iter().map(|p| m * p.tip[2]);
        let (low, high) = (heights.clone().fold(f64::INFINITY, f64::min), heights.fold(f64::NEG_INFINITY, f64::max));
        return Some(format!(
            "the tip stays {:.3} m away from the sample if its poses are in m; they are likely in {unit} (then it goes from {high:.4} m to \
             {low:.4} m above the sample's bottom, and the top is at {:.4} m): give --position-unit {unit}",
            nearest(1.0),
            along.tip[2]
        ));
    }
    let heights = || poses.iter().map(|p| p.tip[2]);
    let way = heights().fold(f64::NEG_INFINITY, f64::max) - heights().fold(f64::INFINITY, f64::min);
    let (unit, m) = UNITS.into_iter().find(|(_, m)| way > room && way * m <= room).unwrap_or(("", 1.0));
    let (and, give) = match unit {
        "" => (String::new(), String::new()),
        unit => (format!(", and likely in {unit}"), format!("--position-unit {unit}, and ")),
    };
    let near = poses.iter().map(|p| offset(p, m)).min_by(|a, b| norm(*a).total_cmp(&norm(*b)))?;
    let word = if near[2] > 0.0 { "above" } else { "below" };
    Some(format!(
        "the tip stays {:.2} m beside the sample and {:.2} m {word} its top: its poses are in another frame, as the robot's{and}. Give {give}the \
         sample's pose in that frame with --sample-pose X,Y,Z,QX,QY,QZ,QW (the centre of the sample's bottom face, z up)",
        near[0].hypot(near[1]),
        near[2].abs()
    ))
}

/// Reports poses of an instrument that goes in where the sample is not, or beside the only axis that the model has.
fn beside(twin: &Twin, poses: &[Pose]) -> Option<String> {
    let top = twin.pose_at_depth(0.0).tip;
    let inside: Vec<[f64; 3]> = poses.iter().map(|p| p.tip).filter(|tip| tip[2] < top[2]).collect();
    let points = twin.reference_points();
    let range = |of: &[[f64; 3]], k: usize| {
        of.iter().map(|p| p[k]).fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
    };
    let (sample, way) = ([0, 1].map(|k| range(points, k)), [0, 1].map(|k| range(&inside, k)));
    let off = |k: usize| sample[k][0] > way[k][1] || sample[k][1] < way[k][0];
    let middle = [0, 1].map(|k| 0.5 * (way[k][0] + way[k][1]) - top[k]);
    let width = [0, 1].map(|k| way[k][1] - way[k][0]);
    let distance = middle[0].hypot(middle[1]);
    let outside = off(0) || off(1);
    let one_axis = twin.dimension() == Dimension::Axisymmetric && 10.0 * width[0].hypot(width[1]) < distance;
    let pose = format!("--sample-pose {:.4},{:.4},0,0,0,0,1", middle[0], middle[1]);
    if inside.is_empty() || !(outside || one_axis && distance > SURFACE * twin.reach_m()) {
        return None;
    }
    let mm = 1e3 * distance;
    Some(if outside {
        format!(
            "the tip goes in {mm:.1} mm beside the instrument's axis in the scene, where there is no sample: its poses are in another frame. Give \
             the sample's pose in that frame ({pose}, if nothing else differs)"
        )
    } else {
        format!(
            "the tip goes in {mm:.1} mm beside the instrument's axis in the scene. If its poses are in another frame, give the sample's pose in \
             that frame ({pose}, if nothing else differs); if it went in there, give --set instrument.entry_x_m={:.4} --set \
             instrument.entry_y_m={:.4}",
            top[0] + middle[0],
            top[1] + middle[1]
        )
    })
}

/// Reports an instrument that does not point into the sample: the frame of its poses or its own frame is another.
fn points_elsewhere(poses: &[Pose], along: [f64; 3]) -> Option<String> {
    let off: Vec<&Pose> = poses.iter().filter(|p| dot(p.axis, along) < ACROSS).collect();
    if 2 * off.len() <= poses.len() {
        return None;
    }
    let pose = off[off.len() / 2];
    let what = if dot(pose.axis, along) < -ACROSS {
        "the instrument points up, out of the sample"
    } else {
        "the instrument lies across the sample and does not point into it"
    };
    // the way in goes to the place that is farthest from the first
    let from_first = |p: &Pose| -> [f64; 3] { std::array::from_fn(|k| p.tip[k] - poses[0].tip[k]) };
    let way = poses.iter().map(from_first).max_by(|a, b| norm(*a).total_cmp(&norm(*b)))?;
    let goes = |axis: [f64; 3]| dot(axis, way) > ALONG * norm(way);
    if goes(pose.axis) {
        let [w, x, y, z] = rotation(along, pose.axis.map(|a| -a)).unwrap_or([0.0, 1.0, 0.0, 0.0]);
        return Some(format!(
            "{what}, and goes that way: the frame of its poses is turned against the sample's. Give the sample's pose in that frame with \
             --sample-pose X,Y,Z,QX,QY,QZ,QW ({x:.5},{y:.5},{z:.5},{w:.5} is the least turn that makes it go in)"
        ));
    }
    let (x, z) = (pose.x_axis(), pose.axis);
    let y = cross(z, x);
    let axes = [("x", x), ("y", y), ("-x", x.map(|a| -a)), ("-y", y.map(|a| -a))];
    let found = axes.into_iter().find(|(_, axis)| goes(*axis));
    let remedy = match found {
        Some((name, _)) => format!("turn that frame, its {name} axis goes that way"),
        None => "turn that frame by half a turn about its x axis".to_owned(),
    };
    Some(format!("{what}: the z axis of its frame must point from the handle to the tip (CRTK's tool frame); {remedy}"))
}

/// Reports a rotated sensor: the force has a constant direction off the axis although the instrument moves along it.
pub(super) fn turned(twin: &Twin, readings: &[Reading], measured: &ForceSeries) -> Option<String> {
    let axis = twin.pose_at_depth(0.0).axis;
    let depth = |r: &Reading| match r.at {
        At::Depth(depth) => Some(depth),
        // beside an oblique instrument there is a force in truth
        At::Pose(pose) => (dot(pose.axis, axis) > STRAIGHT && axis[2] < -STRAIGHT).then(|| twin.depth_of(&pose)),
    };
    let of = |r: &Reading| Some((depth(r)?, measured.at(r.time_s)?));
    let rows: Vec<(f64, [f64; 3])> = readings.iter().filter_map(of).filter(|(d, _)| d.is_finite()).collect();
    let idle = (rows.len() / 50).max(5);
    let deep = rows.iter().map(|r| r.0).fold(f64::NEG_INFINITY, f64::max);
    if rows.len() < 64 || 2 * rows.len() < readings.len() || deep <= 0.0 {
        return None;
    }
    let zero = mean(rows[..idle].iter().map(|r| r.1));
    let without = |f: [f64; 3]| -> [f64; 3] { std::array::from_fn(|k| f[k] - zero[k]) };
    let loaded: Vec<[f64; 3]> = rows.iter().filter(|(d, _)| *d > 0.8 * deep).map(|(_, f)| without(*f)).collect();
    let force = mean(loaded.iter().copied());
    let along = dot(force, axis).abs();
    let across = (dot(force, force) - along * along).max(0.0).sqrt();
    let scatter = loaded.iter().map(|f| (0..3).map(|k| (f[k] - force[k]).powi(2)).sum::<f64>()).sum::<f64>()
        / loaded.len().max(1) as f64;
    // of a sensor that is turned all forces have one direction, but for its noise
    let size = norm(force);
    let (sum, beside) = rows.iter().map(|(_, f)| without(*f)).fold((0.0, 0.0), |(sum, beside), f| {
        let on = dot(f, force) / size;
        (sum + dot(f, f), beside + (dot(f, f) - on * on).max(0.0))
    });
    let steady = beside < ONE_DIRECTION * sum;
    let clear = across > 2.0 * scatter.sqrt() || steady;
    if !(clear && (across > along || (across > BESIDE * along && steady))) {
        return None;
    }
    let what = if across > along {
        let largest = (0..3).max_by(|a, b| force[*a].abs().total_cmp(&force[*b].abs()))?;
        let name = ["x", "y", "z"][largest];
        format!("mainly along {name} ({:.4} N, and {along:.4} N along the instrument)", force[largest])
    } else {
        let angle = across.atan2(along).to_degrees();
        format!(
            "{angle:.0} degrees beside the instrument ({across:.4} N across it, {along:.4} N along it), in one direction"
        )
    };
    let [w, x, y, z] = rotation(force, axis)?;
    Some(format!(
        "deep in the sample the force is {what}: the sensor is turned against the sample; give the rotation from its frame to the sample's with \
         --sensor-rotation W,X,Y,Z ({w:.5},{x:.5},{y:.5},{z:.5} is the least that puts the force along the instrument)"
    ))
}

fn mean(of: impl Iterator<Item = [f64; 3]>) -> [f64; 3] {
    let (sum, count) = of.fold(([0.0; 3], 0_usize), |(sum, n), f| (std::array::from_fn(|k| sum[k] + f[k]), n + 1));
    sum.map(|x: f64| x / count.max(1) as f64)
}

/// The least rotation, w, x, y, z, that turns a force to one that resists an instrument along an axis.
fn rotation(force: [f64; 3], axis: [f64; 3]) -> Option<[f64; 4]> {
    let (from, to) = (force.map(|f| f / norm(force)), axis.map(|a| -a));
    let about = cross(from, to);
    let [w, x, y, z] = [1.0 + dot(from, to), about[0], about[1], about[2]];
    let size = (w * w + dot(about, about)).sqrt();
    // half a turn has no one axis
    (size > 1e-6).then(|| [w, x, y, z].map(|part| (part / size * 1e5).round() * 1e-5 + 0.0))
}

/// Where the load cell clearly shows first contact, although by the recorded depths it is elsewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elsewhere {
    /// Recorded depth of first contact, m.
    pub contact_m: f64,
    /// Whether the recorded depth falls while the instrument goes in.
    pub reversed: bool,
    /// Whether the recorded depths reach the sample as well, later.
    pub early: bool,
}

/// Likely place of first contact, if the recorded depths never reach the sample, or are deeper in it from the first
/// reading on than they change, or reach it late, but the load cell shows contact on the way.
#[must_use]
pub(crate) fn unreached(twin: &Twin, readings: &[Reading], measured: &ForceSeries) -> Option<Elsewhere> {
    let pairs = super::scale::pairs(twin, readings, measured);
    let depths = pairs.iter().map(|p| p.0);
    let (shallow, deep) = (depths.clone().fold(f64::INFINITY, f64::min), depths.fold(f64::NEG_INFINITY, f64::max));
    let travel = deep - shallow;
    if pairs.len() < 64 || travel <= 0.0 {
        return None;
    }
    let in_place = twin.scene().motion.is_some_and(|motion| motion.start_depth.get() > 0.0);
    if deep > SURFACE * travel && (shallow < travel || in_place) {
        return early(twin, &pairs, deep, travel);
    }
    let curve = curve(twin, travel.min(0.9 * twin.reach_m()))?;
    if deep <= SURFACE * travel {
        return touch(&pairs, &curve).map(|touch| Elsewhere {
            contact_m: touch.contact_m,
            reversed: false,
            early: false,
        });
    }
    let away: Vec<(f64, f64)> = pairs.iter().map(|(depth, force)| (-depth, *force)).collect();
    let both = [(&pairs, false), (&away, true)].map(|(pairs, reversed)| {
        let touch = touch(pairs, &curve)?;
        // there is a way to the contact, and nothing else has such a kink
        let kinked = touch.before > SURFACE * travel && touch.left < KINK * touch.left_without;
        kinked.then_some((
            touch.left,
            Elsewhere { contact_m: if reversed { -touch.contact_m } else { touch.contact_m }, reversed, early: false },
        ))
    });
    both.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, found)| found)
}

/// A contact so far above the recorded surface that no alignment reaches it.
fn early(twin: &Twin, pairs: &[(f64, f64)], deep: f64, travel: f64) -> Option<Elsewhere> {
    let way = super::scale::way_in(pairs);
    let surface = way.iter().position(|p| p.0 > 0.0)?;
    let (few, last) = ((way.len() / 50).max(5), way.len() - 1);
    let about = |i: usize| {
        let around = &way[i.saturating_sub(few)..(i + few).min(way.len())];
        around.iter().map(|p| p.1).sum::<f64>() / around.len() as f64
    };
    let (idle, there) = (about(0), about(surface));
    let felt = there - idle > FELT * (about(last) - idle) && there - idle > CLEAR * super::scale::noise(pairs);
    if surface <= 2 * few || !felt {
        return None;
    }
    let found = touch(pairs, &curve(twin, travel.min(0.9 * twin.reach_m()))?)?;
    let kinked = found.before > SURFACE * travel && found.left < KINK * found.left_without;
    let reach = reach_m(deep)[0];
    (kinked && found.contact_m < reach).then_some(Elsewhere {
        contact_m: found.contact_m,
        reversed: false,
        early: true,
    })
}

/// A contact on the way in.
struct Touch {
    contact_m: f64,
    /// Way up to it, m.
    before: f64,
    /// Residual with it, and with a contact before all readings.
    left: f64,
    left_without: f64,
}

/// The contact that explains the forces of the way in best; `None` if they show none.
fn touch(pairs: &[(f64, f64)], curve: &[(f64, f64)]) -> Option<Touch> {
    let way = super::scale::way_in(pairs);
    let way: Vec<(f64, f64)> = way.iter().copied().step_by(way.len().div_ceil(LOOKED_AT)).collect();
    let depths = || way.iter().map(|p| p.0);
    let (shallow, deep) = (depths().fold(f64::INFINITY, f64::min), depths().fold(f64::NEG_INFINITY, f64::max));
    let contacts = (0..CONTACTS).map(|i| shallow + (deep - shallow) * f64::from(i) / f64::from(CONTACTS));
    let fits = contacts.filter_map(|contact| Some((contact, left(&way, curve, contact)?)));
    let (contact_m, rest) = fits.min_by(|a, b| a.1.total_cmp(&b.1))?;
    let left_without = left(&way, curve, shallow)?;
    let forces = way.iter().map(|p| p.1);
    let range = forces.clone().fold(f64::NEG_INFINITY, f64::max) - forces.fold(f64::INFINITY, f64::min);
    let clear = range > CLEAR * super::scale::noise(pairs);
    clear.then_some(Touch { contact_m, before: contact_m - shallow, left: rest, left_without })
}

/// The message about a contact elsewhere. `reading` is the recorded number there, if it is not the depth in m; of poses there is none.
#[must_use]
pub(crate) fn never_touched(found: Elsewhere, by_depth: bool, reading: Option<f64>) -> String {
    let Elsewhere { contact_m, reversed, early } = found;
    let sign = if reversed { "--position-sign -1 and " } else { "" };
    let (whose, what) = match reading {
        _ if !by_depth => {
            let word = if contact_m > 0.0 { "lower" } else { "higher" };
            let way = 1e3 * contact_m.abs();
            let what =
                format!("give the sample's pose in the frame of the poses with --sample-pose, {way:.3} mm {word}");
            ("the unit or the frame of the poses is another", what)
        }
        Some(number) => {
            ("the displacement sensor's zero is elsewhere", format!("give {sign}--position-zero {number:.6}"))
        }
        None => (
            "the displacement sensor's zero is elsewhere",
            format!("give {sign}the sensor's reading there with --position-zero"),
        ),
    };
    let depths = if reversed {
        "the recorded depths fall while the instrument goes in"
    } else if contact_m > 0.0 {
        "by the recorded depths the instrument is in the sample from the first reading on"
    } else if early {
        "by the recorded depths the sample is touched later"
    } else {
        "by the recorded depths the sample is never touched"
    };
    format!(
        "{depths}, and the load cell feels it from a recorded depth of about {:.3} mm on: {whose}; {what}",
        1e3 * contact_m
    )
}

/// Depths and predicted forces of a coarse insertion, the surface first.
fn curve(twin: &Twin, depth_m: f64) -> Option<Vec<(f64, f64)>> {
    let mut double = coarse(twin);
    let mut curve = vec![(0.0, 0.0)];
    for k in 1..=POSES {
        let depth = depth_m * f64::from(k) / f64::from(POSES);
        let pose = StampedPose { time_s: f64::from(k), pose: double.pose_at_depth(depth) };
        let answer = double.step(pose).ok()?;
        curve.push((depth, -dot(answer.force_n, pose.pose.axis)));
    }
    curve.iter().all(|(_, f)| f.is_finite()).then_some(curve)
}

/// Residual of the readings against a curve that begins at a contact, with its factor and the load cell's zero
/// fitted.
fn left(way: &[(f64, f64)], curve: &[(f64, f64)], contact: f64) -> Option<f64> {
    let model = |depth: f64| {
        let d = depth - contact;
        let after = curve.partition_point(|c| c.0 < d).clamp(1, curve.len() - 1);
        let ((a, fa), (b, fb)) = (curve[after - 1], curve[after]);
        if d <= 0.0 { 0.0 } else { fa + (d - a) / (b - a) * (fb - fa) }
    };
    let n = way.len() as f64;
    let rows: Vec<(f64, f64)> = way.iter().map(|(d, f)| (model(*d), *f)).collect();
    let (x, y) = (rows.iter().map(|r| r.0).sum::<f64>() / n, rows.iter().map(|r| r.1).sum::<f64>() / n);
    let sum = |f: &dyn Fn(&(f64, f64)) -> f64| rows.iter().map(f).sum::<f64>();
    let (xx, xy) = (sum(&|r| (r.0 - x).powi(2)), sum(&|r| (r.0 - x) * (r.1 - y)));
    let size = xy / xx;
    (size > 0.0).then(|| sum(&|r| (r.1 - y - size * (r.0 - x)).powi(2)))
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        a[i] * b[j] - a[j] * b[i]
    })
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}
