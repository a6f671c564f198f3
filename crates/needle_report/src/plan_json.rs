//! The plan of an insertion, for programs.

use needle_estimate::plan::{End, Plan, Wanted};
use serde_json::{Value, json};

/// A plan in SI units: how it ends and how a straight aim does, direction, runs, and the spread of the members.
#[must_use]
pub fn plan_json(plan: &Plan, wanted: &Wanted) -> Value {
    let end = |end: &End| {
        json!({
            "entry_m": end.entry_m,
            "depth_m": end.depth_m,
            "tip_m": end.tip_m,
            "target_m": end.target_m,
            "miss_m": end.miss_m,
            "clearance_m": end.clearance_m.is_finite().then_some(end.clearance_m),
            "peak_n": end.peak_n,
        })
    };
    json!({
        "target": wanted.target,
        "tilt_rad": plan.direction.tilt,
        "azimuth_rad": plan.direction.azimuth,
        "roll_rad": plan.direction.roll,
        "plan": end(&plan.end),
        "straight": end(&plan.straight),
        "runs": plan.tries,
        "radius_m": wanted.radius_m,
        "met": plan.end.miss_m <= wanted.radius_m,
        "risk": plan.spread.as_ref().map(|spread| json!({
            "members": spread.miss_m.len() + spread.lost,
            "lost": spread.lost,
            "probability": spread.probability,
            "miss_m": spread.miss_m,
        })),
    })
}
