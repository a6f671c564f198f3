//! `accuracy.html`: error against cost of all rows, on one self-contained page. Hovering shows a row, clicking
//! filters.

use super::{cost_plot::Level, cost_plot::against, cost_plot::levels_of, cost_plot::special, page, svg::escaped};
use needle_studies::accuracy::Row;
use needle_studies::reference;
use serde_json::{Value, json};
use std::fmt::Write as _;

const STYLE: [&str; 2] = [include_str!("../assets/report/style.css"), include_str!("../assets/report/accuracy.css")];
const SCRIPT: &str = include_str!("../assets/report/accuracy.js");

/// Content of `accuracy.html`.
pub(super) fn cost_page(scenes: &[(&str, Vec<&Row>)]) -> String {
    let data: Vec<Value> = scenes.iter().map(|(scene, rows)| data(scene, rows)).collect();
    // A name in the JSON may contain "</script>"; an escaped "<" is equivalent in JSON.
    let data = Value::from(data).to_string().replace('<', "\\u003c");
    let parts = [
        ("{{title}}", "Error against cost".to_owned()),
        ("{{style}}", STYLE.concat()),
        ("{{body}}", body(scenes)),
        ("{{data}}", data),
        ("{{script}}", SCRIPT.to_owned()),
    ];
    page::filled(page::PAGE, &parts)
}

fn data(scene: &str, rows: &[&Row]) -> Value {
    let levels: Vec<Value> =
        levels_of(scene, rows).iter().map(|Level { error, text }| json!({ "error": error, "text": text })).collect();
    let special = special(scene, rows);
    let row = |(i, row): (usize, &&Row)| {
        let c = &row.case;
        let finite = |x: f64| Some(x).filter(|x| x.is_finite());
        json!({
            "method": c.method, "cure": c.volume_ratio, "dimension": c.dimension,
            "spacing": 1e3 * c.spacing_m, "edge": 1e3 * c.edge_spacing_m, "support": c.support_factor,
            "points": if c.has_hexahedra() { format!("{} (hexahedra)", c.points_per_hexahedron) } else if c.joined() == 2 { "½".to_owned() } else { c.points_per_cell.to_string() }, "precision": c.precision, "hz": c.pose_hz, "pace": c.steps.to_string(),
            "corrected": c.corrected,
            "nodes": row.nodes, "integration_points": row.integration_points, "steps": row.steps,
            "pose": finite(1e3 * row.cost_per_pose_s()), "second": finite(row.cost_per_simulated_s()),
            "factor": finite(row.real_time_factor()),
            "max": row.max_force_error().map(|e| 100.0 * e), "rms": row.rms_force_error().map(|e| 100.0 * e),
            "moved": row.displacement_error.and_then(|e| finite(100.0 * e)),
            "jacobian": finite(row.min_jacobian), "recoveries": row.recoveries, "ended": row.ended,
            "name": special.iter().find(|(k, _)| *k == i).map(|(_, name)| name),
        })
    };
    json!({ "scene": scene, "levels": levels, "rows": rows.iter().enumerate().map(row).collect::<Vec<_>>() })
}

fn body(scenes: &[(&str, Vec<&Row>)]) -> String {
    let without = scenes.iter().find(|(scene, _)| reference::force(scene).is_none());
    let against = without.or(scenes.first()).map_or("", |(scene, _)| against(scene));
    let mut html = format!(
        "<header>\n<h1>Error against cost</h1>\n<p>A mark per run: one way to discretise and step a scene. Errors are against \
         {against}, the largest (or root mean square) from a fifth of the path on. Costs are processor \
         time of one thread.</p>\n</header>\n<section id=\"cost\">\n<div class=\"controls\">\n",
    );
    let mut select = |control: &str, about: &str, options: &[(&str, &str)]| {
        let _ = write!(html, "<select data-control=\"{control}\" aria-label=\"{about}\">");
        for (value, text) in options {
            let _ = write!(html, "<option value=\"{}\">{}</option>", escaped(value), escaped(text));
        }
        html.push_str("</select>\n");
    };
    let names: Vec<(String, String)> =
        scenes.iter().enumerate().map(|(i, (scene, _))| (i.to_string(), (*scene).to_owned())).collect();
    let options: Vec<(&str, &str)> = names.iter().map(|(i, name)| (i.as_str(), name.as_str())).collect();
    select("scene", "Scene", &options);
    select(
        "y",
        "Error",
        &[
            ("max", "largest error of the force"),
            ("rms", "RMS error of the force"),
            ("moved", "error of the displacement"),
        ],
    );
    select("x", "Cost", &[("pose", "cost of a pose"), ("second", "cost of a simulated second")]);
    html.push_str(
        "</div>\n<div class=\"filters\"></div>\n<p class=\"readout\" aria-live=\"polite\"></p>\n<div class=\"chart\"></div>\n\
         <p class=\"note\"></p>\n</section>\n<section id=\"best\">\n<h2>The best</h2>\n<p>Of the marks shown, those that no \
         other of the same rate of poses beats in both error and cost.</p>\n<div class=\"wide\"></div>\n</section>\n",
    );
    let _ =
        writeln!(html, "<footer>needle_twin {}. Beside this page: accuracy.csv.</footer>", env!("CARGO_PKG_VERSION"));
    html
}
